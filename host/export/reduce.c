/* Fewer triangles, by meshoptimizer. See reduce.h. */
#include "export/reduce.h"

#ifndef CLN_WITH_MESHOPTIMIZER

cln_status cln_mesh_reduce_possible(void)
{
    return cln_fail(CLN_FAILED,
                    "--triangles: this program was built without meshoptimizer, which was not "
                    "there; install the Debian package libmeshoptimizer-dev and run make again, "
                    "or give a larger --spacing");
}

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, double *error)
{
    (void)mesh, (void)most;
    *error = 0;
    return cln_mesh_reduce_possible();
}

#else

#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

cln_status cln_mesh_reduce_possible(void)
{
    return CLN_OK;
}

/* Drops vertices that no face has; the others keep their order. */
static cln_status drop_unused(cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    uint32_t *to = NULL;
    size_t kept = 0;

    CLN_TRY(cln_alloc(&to, mesh->vertices, sizeof *to, "vertices"));
    for (size_t f = 0; f < mesh->faces; f++)
        for (int k = 0; k < 3; k++)
            to[mesh->face[f][k]] = 1;
    for (size_t v = 0; v < mesh->vertices; v++) {
        if (!to[v])
            continue;
        memmove(mesh->at[kept], mesh->at[v], sizeof mesh->at[0]);
        memmove(mesh->normal[kept], mesh->normal[v], sizeof mesh->normal[0]);
        memmove(mesh->colour[kept], mesh->colour[v], sizeof mesh->colour[0]);
        to[v] = (uint32_t)kept++;
    }
    for (size_t f = 0; f < mesh->faces; f++)
        for (int k = 0; k < 3; k++)
            mesh->face[f][k] = to[mesh->face[f][k]];
    mesh->vertices = kept;
done:
    free(to);
    return st;
}

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, double *error)
{
    const float any_error = 1e10f; /* the number of triangles decides, not this */
    cln_status st = CLN_OK;
    float(*at)[3] = NULL, relative = 0;
    uint32_t(*face)[3] = NULL;
    size_t indices = 0;

    *error = 0;
    if (mesh->faces <= most)
        return CLN_OK;
    CLN_TRY(cln_alloc(&at, mesh->vertices, sizeof *at, "vertices"));
    CLN_TRY(cln_alloc(&face, mesh->faces, sizeof *face, "triangles"));
    for (size_t v = 0; v < mesh->vertices; v++) /* floats are coarse far from 0 */
        for (int a = 0; a < 3; a++)
            at[v][a] = (float)(mesh->at[v][a] - mesh->origin[a]);
    indices = meshopt_simplify(face[0], mesh->face[0], 3 * mesh->faces, at[0], mesh->vertices,
                               sizeof at[0], 3 * most, any_error, 0, &relative);
    *error = (double)relative * meshopt_simplifyScale(at[0], mesh->vertices, sizeof at[0]);
    mesh->faces = indices / 3;
    memcpy(mesh->face, face, mesh->faces * sizeof *face);
    CLN_TRY(drop_unused(mesh));
done:
    free(at);
    free(face);
    return st;
}

#endif
