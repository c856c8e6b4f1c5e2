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

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, const uint8_t *plane, double *error,
                           size_t *crowded, size_t *bent)
{
    (void)mesh, (void)most, (void)plane;
    *error = 0;
    *crowded = *bent = 0;
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
    cln_keep_vertices(mesh->vertices, to, sizeof mesh->views[0], mesh->views);
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

/* The faces of a mesh by the plane that they lie in: part p begins at begin[p]. */
typedef struct pieces {
    uint32_t (*face)[3];
    size_t begin[CLN_REDUCE_PLANES + 2];
} pieces;

static cln_status make_parts(const cln_mesh *mesh, const uint8_t *plane, pieces *out)
{
    cln_status st = CLN_OK;
    size_t n = 0;

    CLN_TRY(cln_alloc(&out->face, mesh->faces, sizeof *out->face, "triangles"));
    for (int p = 0; p <= CLN_REDUCE_PLANES; p++) {
        out->begin[p] = n;
        for (size_t f = 0; f < mesh->faces; f++)
            if (plane[f] == p)
                memcpy(out->face[n++], mesh->face[f], sizeof mesh->face[0]);
    }
    out->begin[CLN_REDUCE_PLANES + 1] = n;
done:
    return st;
}

/* Writes the triangles of a part that stay, all if there are no more than `most`; returns their
 * number. */
static size_t simplify_part(const cln_mesh *of, const float (*at)[3], const pieces *parts, int p,
                            size_t most, uint32_t (*out)[3])
{
    const float any_error = 1e10f; /* the number of triangles decides, not this */
    const float none = 1e-5f;      /* share of the mesh: rounding */
    const size_t first = parts->begin[p], count = parts->begin[p + 1] - first;

    if (count <= most) { /* the library takes no larger target */
        if (count > 0)
            memcpy(out, parts->face[first], count * sizeof *out);
        return count;
    }
    return meshopt_simplify(out[0], parts->face[first], 3 * count, at[0], of->vertices,
                            sizeof at[0], 3 * most, p > 0 ? none : any_error,
                            meshopt_SimplifyLockBorder, NULL) /
           3;
}

/* Sets mesh->face to those triangles of `of` that stay, part by part, with the borders between
 * parts as they are, or as one if parts is NULL; *pairs: too many, at crowded edges. */
static cln_status simplify(const cln_mesh *of, const float (*at)[3], const pieces *parts,
                           size_t most, cln_mesh *mesh, size_t *pairs)
{
    const float any_error = 1e10f;
    cln_status st = CLN_OK;
    cln_mesh_edges edges;

    mesh->faces = 0;
    for (int p = CLN_REDUCE_PLANES; p >= 0 && parts; p--) {
        const size_t left = p > 0 || most < mesh->faces ? 0 : most - mesh->faces;

        mesh->faces += simplify_part(of, at, parts, p, left, mesh->face + mesh->faces);
    }
    if (!parts)
        mesh->faces = meshopt_simplify(mesh->face[0], of->face[0], 3 * of->faces, at[0],
                                       of->vertices, sizeof at[0], 3 * most, any_error, 0, NULL) /
                      3;
    CLN_TRY(drop_pairs(mesh));
    CLN_TRY(cln_mesh_count_edges(mesh, &edges));
    *pairs = edges.pairs;
done:
    return st;
}

/* The same until the triangles that part edges have room, too. */
static cln_status simplify_to(const cln_mesh *of, const float (*at)[3], const pieces *parts,
                              size_t most, cln_mesh *mesh)
{
    enum { TRIES = 4 };
    cln_status st = CLN_OK;
    size_t pairs = 0, target = most;

    for (int try = 0; try < TRIES; try++) {
        CLN_TRY(simplify(of, at, parts, target, mesh, &pairs));
        if (mesh->faces + 2 * pairs <= most || mesh->faces > target || target <= 2 * pairs + 4)
            break;
        target -= mesh->faces + 2 * pairs - most;
    }
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

cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, const uint8_t *plane, double *error,
                           size_t *crowded, size_t *bent)
{
    cln_status st = CLN_OK;
    const size_t vertices = mesh->vertices, faces = mesh->faces;
    float(*at)[3] = NULL;
    cln_mesh fewer = *mesh;
    pieces parts = {0};
    size_t flat = 0;
    bool whole = false;

    *error = 0;
    *crowded = *bent = 0;
    if (mesh->faces <= most)
        return CLN_OK;
    fewer.face = NULL;
    CLN_TRY(cln_alloc(&at, mesh->vertices, sizeof *at, "vertices"));
    CLN_TRY(cln_alloc(&fewer.face, mesh->faces, sizeof *fewer.face, "triangles"));
    for (size_t v = 0; v < mesh->vertices; v++) /* floats are coarse far from 0 */
        for (int a = 0; a < 3; a++)
            at[v][a] = (float)(mesh->at[v][a] - mesh->origin[a]);
    if (plane)
        CLN_TRY(make_parts(mesh, plane, &parts));
    whole = !plane || parts.begin[1] == mesh->faces;
    for (int p = 1; p <= CLN_REDUCE_PLANES && !whole; p++)
        flat += simplify_part(mesh, (const float(*)[3])at, &parts, p, 0, fewer.face);
    if (flat > most / 4) { /* what is beside the outline takes as many */
        *bent = flat;
        whole = true;
    }
    CLN_TRY(simplify_to(mesh, (const float(*)[3])at, whole ? NULL : &parts, most, &fewer));
    CLN_TRY(measure(mesh, &fewer, (const float(*)[3])at, error));
    mesh->faces = fewer.faces;
    memcpy(mesh->face, fewer.face, mesh->faces * sizeof *mesh->face);
    CLN_TRY(drop_unused(mesh));
    CLN_TRY(cln_mesh_part_crowded(mesh, vertices, faces, crowded));
done:
    free(at);
    free(fewer.face);
    free(parts.face);
    return st;
}

#endif
