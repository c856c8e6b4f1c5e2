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

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, double *error, size_t *crowded)
{
    (void)mesh, (void)most;
    *error = 0;
    *crowded = 0;
    return cln_mesh_reduce_possible();
}

#else

#include <math.h>
#include <meshoptimizer.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "export/crowded.h"
#include "export/deviation.h"
#include "export/triangles.h"

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

    CLN_TRY(cln_faces_renumber(mesh->faces, mesh->face, mesh->vertices, &kept, &to));
    cln_keep_vertices(mesh->vertices, to, sizeof mesh->at[0], mesh->at);
    cln_keep_vertices(mesh->vertices, to, sizeof mesh->normal[0], mesh->normal);
    cln_keep_vertices(mesh->vertices, to, sizeof mesh->colour[0], mesh->colour);
    mesh->vertices = kept;
done:
    free(to);
    return st;
}

/* A face by its corners in order of number, the first two in one; and whether it is turned. */
typedef struct corners {
    uint64_t first;
    uint32_t last, face;
    bool turned;
} corners;

static corners corners_of(const uint32_t v[3], size_t face)
{
    const int least = v[1] < v[0] ? (v[2] < v[1] ? 2 : 1) : v[2] < v[0] ? 2 : 0;
    const uint32_t a = v[least], b = v[(least + 1) % 3], c = v[(least + 2) % 3];
    const bool turned = c < b;

    return (corners){(uint64_t)a << 32 | (turned ? c : b), turned ? b : c, (uint32_t)face, turned};
}

static int by_corners(const void *a, const void *b)
{
    const corners *x = a, *y = b;

    if (x->first != y->first)
        return x->first < y->first ? -1 : 1;
    if (x->last != y->last)
        return x->last < y->last ? -1 : 1;
    return x->face < y->face ? -1 : x->face > y->face;
}

/* Drops pairs of faces that turn their backs to each other over the same corners: they enclose
 * nothing, and their edges would have four faces. The others keep their order. */
static cln_status drop_pairs(cln_mesh *mesh)
{
    cln_status st = CLN_OK;
    corners *list = NULL;
    bool *drop = NULL;
    size_t kept = 0;

    CLN_TRY(cln_alloc(&list, mesh->faces, sizeof *list, "triangles"));
    CLN_TRY(cln_alloc(&drop, mesh->faces, sizeof *drop, "triangles"));
    for (size_t f = 0; f < mesh->faces; f++)
        list[f] = corners_of(mesh->face[f], f);
    qsort(list, mesh->faces, sizeof *list, by_corners);
    for (size_t i = 0, end = 0; i < mesh->faces; i = end) {
        size_t j = i, k = i;

        for (end = i; end < mesh->faces && list[end].first == list[i].first &&
                      list[end].last == list[i].last;)
            end++;
        for (;; j++, k++) { /* the next one of each side */
            while (j < end && list[j].turned)
                j++;
            while (k < end && !list[k].turned)
                k++;
            if (j >= end || k >= end)
                break;
            drop[list[j].face] = drop[list[k].face] = true;
        }
    }
    for (size_t f = 0; f < mesh->faces; f++)
        kept += !drop[f];
    if (kept == 0) /* rather a flat mesh than none */
        goto done;
    kept = 0;
    for (size_t f = 0; f < mesh->faces; f++)
        if (!drop[f])
            memmove(mesh->face[kept++], mesh->face[f], sizeof mesh->face[0]);
    mesh->faces = kept;
done:
    free(list);
    free(drop);
    return st;
}

/* Sets mesh->face to those triangles of `of` that stay; *pairs: too many, at crowded edges. */
static cln_status simplify(const cln_mesh *of, const float (*at)[3], size_t most, cln_mesh *mesh,
                           size_t *pairs)
{
    const float any_error = 1e10f; /* the number of triangles decides, not this */
    cln_status st = CLN_OK;
    cln_mesh_edges edges;

    mesh->faces = meshopt_simplify(mesh->face[0], of->face[0], 3 * of->faces, at[0], of->vertices,
                                   sizeof at[0], 3 * most, any_error, 0, NULL) /
                  3;
    CLN_TRY(drop_pairs(mesh));
    CLN_TRY(cln_mesh_count_edges(mesh, &edges));
    *pairs = edges.pairs;
done:
    return st;
}

/* How far the surfaces of some and of fewer triangles over the same vertices are apart: those that
 * are gone from what is left, and the middles of what is left from what was there. */
static cln_status measure(const cln_mesh *mesh, const cln_mesh *fewer, const float (*at)[3],
                          double *error)
{
    cln_status st = CLN_OK;
    float(*middles)[3] = NULL;
    double back = 0;

    CLN_TRY(cln_alloc(&middles, fewer->faces, sizeof *middles, "triangles"));
    for (size_t f = 0; f < fewer->faces; f++)
        for (int k = 0; k < 9; k++)
            middles[f][k % 3] += at[fewer->face[f][k / 3]][k % 3] / 3;
    CLN_TRY(cln_deviation(mesh->vertices, at, fewer->faces, (const uint32_t(*)[3])fewer->face, at,
                          error));
    CLN_TRY(cln_deviation(fewer->faces, (const float(*)[3])middles, mesh->faces,
                          (const uint32_t(*)[3])mesh->face, at, &back));
    *error = fmax(*error, back);
done:
    free(middles);
    return st;
}

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, double *error, size_t *crowded)
{
    enum { TRIES = 4 };
    cln_status st = CLN_OK;
    const size_t vertices = mesh->vertices, faces = mesh->faces;
    float(*at)[3] = NULL;
    cln_mesh fewer = *mesh;
    size_t pairs = 0, target = most;

    *error = 0;
    *crowded = 0;
    if (mesh->faces <= most)
        return CLN_OK;
    fewer.face = NULL;
    CLN_TRY(cln_alloc(&at, mesh->vertices, sizeof *at, "vertices"));
    CLN_TRY(cln_alloc(&fewer.face, mesh->faces, sizeof *fewer.face, "triangles"));
    for (size_t v = 0; v < mesh->vertices; v++) /* floats are coarse far from 0 */
        for (int a = 0; a < 3; a++)
            at[v][a] = (float)(mesh->at[v][a] - mesh->origin[a]);
    for (int try = 0; try < TRIES; try++) { /* with room for the triangles that part edges */
        CLN_TRY(simplify(mesh, (const float(*)[3])at, target, &fewer, &pairs));
        if (fewer.faces + 2 * pairs <= most || fewer.faces > target || target <= 2 * pairs + 4)
            break;
        target -= fewer.faces + 2 * pairs - most;
    }
    CLN_TRY(measure(mesh, &fewer, (const float(*)[3])at, error));
    mesh->faces = fewer.faces;
    memcpy(mesh->face, fewer.face, mesh->faces * sizeof *mesh->face);
    CLN_TRY(drop_unused(mesh));
    CLN_TRY(cln_mesh_part_crowded(mesh, vertices, faces, crowded));
done:
    free(at);
    free(fewer.face);
    return st;
}

#endif
