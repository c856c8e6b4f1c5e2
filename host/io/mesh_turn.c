/* Another place for a mesh: a turn that makes a direction its up, scale, offset. See mesh.h. */
#include <math.h>
#include <string.h>

#include "io/mesh.h"

void cln_mesh_upright(const double up[3], int axis, double turn[4])
{
    const double length = sqrt(up[0] * up[0] + up[1] * up[1] + up[2] * up[2]);
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    double size = 0;

    memcpy(turn, (const double[4]){0, 0, 0, 1}, 4 * sizeof *turn);
    if (!(length > 0))
        return;
    /* half way from up to the axis: up x axis, and 1 + up . axis */
    turn[b] = up[c] / length;
    turn[c] = 0 - up[b] / length;
    turn[3] = 1 + up[axis] / length;
    for (int i = 0; i < 4; i++)
        size += turn[i] * turn[i];
    if (size < 1e-18) /* upside down */
        memcpy(turn, (const double[4]){1, 0, 0, 0}, 4 * sizeof *turn);
    for (int i = 0; i < 4 && size >= 1e-18; i++)
        turn[i] /= sqrt(size);
}

void cln_mesh_turned(const double turn[4], const double v[3], double out[3])
{
    double once[3], twice[3];

    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;

        once[a] = 2 * (turn[b] * v[c] - turn[c] * v[b]);
    }
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;

        twice[a] = v[a] + turn[3] * once[a] + turn[b] * once[c] - turn[c] * once[b];
    }
    memcpy(out, twice, sizeof twice);
}

void cln_mesh_place(cln_mesh *mesh, const double turn[4], double scale)
{
    const bool turned = turn[0] != 0 || turn[1] != 0 || turn[2] != 0;

    for (size_t i = 0; i < mesh->vertices; i++) {
        const float *n = mesh->normal[i];
        double normal[3] = {n[0], n[1], n[2]};

        if (turned) {
            cln_mesh_turned(turn, mesh->at[i], mesh->at[i]);
            cln_mesh_turned(turn, normal, normal);
        }
        for (int a = 0; a < 3; a++) {
            mesh->at[i][a] *= scale;
            mesh->normal[i][a] = (float)normal[a];
        }
    }
    cln_mesh_turned(turn, mesh->origin, mesh->origin);
    for (int a = 0; a < 3; a++)
        mesh->origin[a] *= scale;
    mesh->fine *= scale;
}

void cln_mesh_move(cln_mesh *mesh, const double offset[3])
{
    for (size_t i = 0; i < mesh->vertices; i++)
        for (int a = 0; a < 3; a++)
            mesh->at[i][a] += offset[a];
    for (int a = 0; a < 3; a++)
        mesh->origin[a] += offset[a];
}
