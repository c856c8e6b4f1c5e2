/* Meshes as PLY and OBJ; glTF is in mesh_glb.c, STL in mesh_stl.c. See mesh.h. */
#include "io/mesh.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/files.h"
#include "base/number.h"

/* Numbers are written as they are in memory. */
_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "mesh.c is for little-endian hosts");

enum { LINE = 256 };

double cln_mesh_area(const cln_mesh *mesh, size_t f, double normal[3])
{
    const uint32_t *v = mesh->face[f];
    double side[2][3], square = 0;

    for (int k = 0; k < 2; k++)
        for (int a = 0; a < 3; a++)
            side[k][a] = mesh->at[v[k + 1]][a] - mesh->at[v[0]][a];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;

        normal[a] = (side[0][b] * side[1][c] - side[0][c] * side[1][b]) / 2;
        square += normal[a] * normal[a];
    }
    return sqrt(square);
}

double cln_mesh_rounding(const cln_mesh *mesh)
{
    double largest = 0;

    for (size_t i = 0; i < mesh->vertices; i++)
        for (int a = 0; a < 3; a++)
            largest = fmax(largest, fabs(mesh->at[i][a]));
    return largest * 0x1p-24;
}

bool cln_mesh_fits_floats(const cln_mesh *mesh)
{
    return cln_mesh_rounding(mesh) <= mesh->fine / 100;
}

double cln_mesh_bytes(const cln_mesh *mesh)
{
    return 4096 + 160.0 * (double)mesh->vertices + 70.0 * (double)mesh->faces; /* OBJ's */
}

/* ---- PLY ---- */

static void put(uint8_t **to, const void *data, size_t bytes)
{
    memcpy(*to, data, bytes);
    *to += bytes;
}

static cln_status ply_header(cln_atomic_file *file, const cln_mesh *mesh, bool wide)
{
    const char *real = wide ? "double" : "float";
    char text[2048];
    int used = snprintf(text, sizeof text,
                        "ply\nformat binary_little_endian 1.0\ncomment %.512s\n"
                        "element vertex %zu\n"
                        "property %s x\nproperty %s y\nproperty %s z\n"
                        "property float nx\nproperty float ny\nproperty float nz\n"
                        "property uchar red\nproperty uchar green\nproperty uchar blue\n%s",
                        mesh->comment, mesh->vertices, real, real, real,
                        mesh->views ? "property uchar views\n" : "");

    if (mesh->faces > 0)
        used += snprintf(text + used, sizeof text - (size_t)used,
                         "element face %zu\nproperty list uchar int vertex_indices\n", mesh->faces);
    used += snprintf(text + used, sizeof text - (size_t)used, "end_header\n");
    return cln_atomic_write(file, text, (size_t)used);
}

static cln_status ply_body(cln_atomic_file *file, const cln_mesh *mesh, bool wide)
{
    cln_status st = CLN_OK;
    uint8_t bytes[64], *to = NULL;
    const uint8_t corners = 3;

    for (size_t i = 0; i < mesh->vertices; i++) {
        to = bytes;
        for (int a = 0; a < 3; a++) {
            const float narrow = (float)mesh->at[i][a];

            if (wide)
                put(&to, &mesh->at[i][a], sizeof(double));
            else
                put(&to, &narrow, sizeof narrow);
        }
        put(&to, mesh->normal[i], sizeof mesh->normal[0]);
        put(&to, mesh->colour[i], sizeof mesh->colour[0]);
        if (mesh->views)
            put(&to, &mesh->views[i], 1);
        CLN_TRY(cln_atomic_write(file, bytes, (size_t)(to - bytes)));
    }
    for (size_t i = 0; i < mesh->faces; i++) {
        to = bytes;
        put(&to, &corners, 1);
        put(&to, mesh->face[i], sizeof mesh->face[0]);
        CLN_TRY(cln_atomic_write(file, bytes, (size_t)(to - bytes)));
    }
done:
    return st;
}

cln_status cln_mesh_write_ply(const char *path, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    const bool wide = !cln_mesh_fits_floats(mesh);

    if (mesh->vertices > INT32_MAX)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %zu vertices are more than a PLY file can name", path,
                         mesh->vertices));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(ply_header(file, mesh, wide));
    CLN_TRY(ply_body(file, mesh, wide));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}

/* ---- OBJ ---- */

/* Writes colours behind the coordinates of vertices, where most programs read them. */
cln_status cln_mesh_write_obj(const char *path, const cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    const int digits = cln_mesh_fits_floats(mesh) ? 9 : 15;
    char line[LINE];
    int n = 0;

    CLN_TRY(cln_atomic_open(path, &file));
    fprintf(cln_atomic_stream(file), "# %s\n", mesh->comment);
    for (size_t i = 0; i < mesh->vertices; i++) {
        const double *p = mesh->at[i];
        const float *v = mesh->normal[i];
        const uint8_t *c = mesh->colour[i];

        n = cln_format(line, sizeof line, "v %.*g %.*g %.*g %.4f %.4f %.4f\nvn %.5f %.5f %.5f\n",
                       digits, p[0], digits, p[1], digits, p[2], c[0] / 255.0, c[1] / 255.0,
                       c[2] / 255.0, (double)v[0], (double)v[1], (double)v[2]);
        CLN_TRY(cln_atomic_write(file, line, (size_t)n));
    }
    for (size_t i = 0; i < mesh->faces; i++) {
        const uint32_t *f = mesh->face[i];

        n = snprintf(line, sizeof line, "f %lld//%lld %lld//%lld %lld//%lld\n", f[0] + 1ll,
                     f[0] + 1ll, f[1] + 1ll, f[1] + 1ll, f[2] + 1ll, f[2] + 1ll);
        CLN_TRY(cln_atomic_write(file, line, (size_t)n));
    }
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}
