/* A change of the tree on the device. See carry.h. It goes array by array, so that only one array
 * exists twice:
 *
 *   1. kernels/carry.cl gathers the successor's rows from the old array
 *   2. weights of new leaves are folded (model/fold.c, in double) or made on the host: only their
 *      old leaves' rows are read, only their own are written; voxels split on the device
 *   3. the old array is freed */
#include "pipeline/carry.h"

#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "pipeline/halo.h"
#include "pipeline/share.h"

_Static_assert(CLN_COPIED == -1 && CLN_MERGED == -2 && CLN_FRESH == -10,
               "as kernels/carry.cl has them");

typedef struct carry {
    cln_pipeline *p;
    const cln_octree_change *change;
} carry;

static cln_status put_places(const carry *c)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)c->change->count;
    cl_int2 *places = NULL;

    CLN_TRY(cln_alloc(&places, count, sizeof *places, "change of the tree"));
    for (size_t s = 0; s < count; s++)
        places[s] = (cl_int2){{c->change->from[s], c->change->octant[s]}};
    CLN_TRY(CLN_PUT(c->p, places, places, count));
done:
    free(places);
    return st;
}

/* An array of old leaves as an argument of kernels that read parts: an array of one buffer lies in
 * the first part, and the others are not read. */
static cln_buffer in_parts(const cln_buffer *old)
{
    cln_buffer out = *old;

    for (int i = 1; i < CLN_PARTS && !old->part_bytes; i++)
        out.part[i] = old->part[0];
    return out;
}

/* Makes an array's successor with the kernel; count: the kernel's last argument. */
static cln_status gather(const carry *c, cln_buffer_id array, cl_kernel kernel, cl_uint count)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_buffer from = in_parts(cln_pipeline_buffer(p, array));

    CLN_TRY(cln_pipeline_succeed(p, array, (size_t)c->change->count));
    CLN_TRY(CLN_LAUNCH(p->device, kernel, CLN_STAGE_STRUCTURE, (size_t)c->change->count,
                       (size_t)p->tune.sg, CLN_LEAF_ARG_OF(p, &from), CLN_LEAF_ARG(p, successor),
                       CLN_ARG(p->places.mem), CLN_ARG(count)));
done:
    return st;
}

static cln_status gather_rows(const carry *c, cln_buffer_id array)
{
    const size_t bytes = cln_buffer_row_bytes(c->p, array);

    CLN_ASSERT(bytes % sizeof(cl_uint4) == 0);
    return gather(c, array, c->p->k.carry_rows, (cl_uint)(bytes / sizeof(cl_uint4)));
}

static cln_status carry_rows(const carry *c, cln_buffer_id array)
{
    cln_status st = CLN_OK;

    CLN_TRY(gather_rows(c, array));
    cln_pipeline_replace(c->p, array);
done:
    return st;
}

static cln_status carry_densities(const carry *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(gather(c, CLN_BUFFER_density, c->p->k.carry_densities, (cl_uint)c->p->config.n1));
    cln_pipeline_replace(c->p, CLN_BUFFER_density);
done:
    return st;
}

/* Length of the run of new leaves from slot `first` on whose old leaves are adjacent too, at most
 * CLN_CARRY_ROWS; *old_count: number of those old leaves. */
static int run_of(const cln_octree_change *change, int first, int *old_count)
{
    int end = first, last = change->from[first];

    while (end < change->count && end - first < CLN_CARRY_ROWS &&
           change->octant[end] != CLN_COPIED &&
           (change->from[end] == last || change->from[end] == last + 1))
        last = change->from[end++];
    *old_count = last - change->from[first] + 1;
    return end - first;
}

/* Folds or unfolds the weights of new leaves, from rows of `old` to rows of `new`. */
static cln_status fold(const carry *c, const cln_buffer *old, const cln_buffer *new)
{
    cln_status st = CLN_OK;
    const cln_octree_change *change = c->change;
    const cln_network *net = &c->p->net;
    const size_t row = (size_t)net->params, bytes = row * sizeof(float);
    float *parents = NULL, *children = NULL;

    CLN_TRY(cln_alloc(&parents, CLN_CARRY_ROWS, bytes, "change of the tree"));
    CLN_TRY(cln_alloc(&children, CLN_CARRY_ROWS, bytes, "change of the tree"));
    for (int s = 0, n = 1; s < change->count; s += n) {
        const int first = change->from[s];
        int old_count = 0;

        n = 1;
        if (change->octant[s] == CLN_COPIED)
            continue;
        n = run_of(change, s, &old_count);
        CLN_TRY(cln_buffer_read(c->p->device, old, (size_t)first * bytes, parents,
                                (size_t)old_count * bytes));
        for (int i = 0; i < n; i++) {
            const float *from = parents + (size_t)(change->from[s + i] - first) * row;
            const int octant = change->octant[s + i];

            if (octant == CLN_FRESH)
                cln_network_init(net, &c->p->config, children + (size_t)i * row);
            else if (octant >= 0)
                cln_network_fold(net, from, octant, children + (size_t)i * row);
            else
                cln_network_unfold(net, from, CLN_MERGED - octant, children + (size_t)i * row);
        }
        CLN_TRY(
            cln_buffer_write(c->p->device, new, (size_t)s * bytes, children, (size_t)n * bytes));
    }
done:
    free(parents);
    free(children);
    return st;
}

/* Voxels split on the device; they never merge, and those that begin anew are zeros. */
static cln_status split_voxels(const carry *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_buffer from = in_parts(&p->params);

    for (int s = 0; s < c->change->count; s++)
        CLN_ASSERT(c->change->octant[s] > CLN_MERGED || c->change->octant[s] == CLN_FRESH);
    CLN_TRY(CLN_LAUNCH(p->device, p->k.voxel_split, CLN_STAGE_STRUCTURE, (size_t)c->change->count,
                       (size_t)p->tune.ls, CLN_LEAF_ARG_OF(p, &from), CLN_LEAF_ARG(p, successor),
                       CLN_ARG(p->places.mem)));
done:
    return st;
}

static cln_status carry_weights(const carry *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(gather_rows(c, CLN_BUFFER_params));
    if (c->p->net.encoding == CLN_ENCODING_VOXEL)
        CLN_TRY(split_voxels(c));
    else
        CLN_TRY(fold(c, &c->p->params, &c->p->successor));
    cln_pipeline_replace(c->p, CLN_BUFFER_params);
done:
    return st;
}

/* Carries an array of a few numbers per leaf by way of the host; zeros for new leaves. */
static cln_status carry_numbers(const carry *c, cln_buffer_id array, int old_leaves)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)c->change->count, bytes = cln_buffer_row_bytes(c->p, array);
    char *old = NULL, *new = NULL;

    CLN_TRY(cln_alloc(&old, (size_t)old_leaves, bytes, "change of the tree"));
    CLN_TRY(cln_alloc(&new, count, bytes, "change of the tree"));
    CLN_TRY(cln_pipeline_get(c->p, array, old, (size_t)old_leaves));
    for (size_t s = 0; s < count; s++)
        if (c->change->octant[s] == CLN_COPIED)
            memcpy(new + s *bytes, old + (size_t)c->change->from[s] * bytes, bytes);
    CLN_TRY(cln_pipeline_put(c->p, array, new, count));
done:
    free(old);
    free(new);
    return st;
}

/* The change of this rank's leaves alone, by rows of its arrays. The caller frees out->from. */
static cln_status take_own(const cln_pipeline *p, const cln_octree_change *change, int old_first,
                           cln_octree_change *out)
{
    cln_status st = CLN_OK;

    *out = (cln_octree_change){.count = p->own, .octant = change->octant + p->first};
    CLN_TRY(cln_alloc(&out->from, (size_t)p->own, sizeof *out->from, "change of the tree"));
    for (int row = 0; row < p->own; row++)
        out->from[row] = change->from[p->first + row] - old_first;
done:
    return st;
}

cln_status cln_pipeline_carry(cln_pipeline *p, const cln_octree *tree,
                              const cln_octree_change *change)
{
    cln_status st = CLN_OK;
    const int old_leaves = p->leaves, old_own = p->own, old_first = p->first;
    const carry all = {.p = p, .change = change};
    cln_octree_change own = {0};
    const carry c = {.p = p, .change = &own}; /* of this rank's leaves */
    cl_uint first = 0, count = 0;

    CLN_ASSERT(change->count == tree->leaf_count);
    CLN_TRY(cln_share_sums(p));
    cln_buffer_free(p->device, &p->grads); /* sized by the leaves of the batches so far */
    cln_buffer_free(p->device, &p->seen);
    cln_buffer_free(p->device, &p->transposed);
    cln_share_change(p, change);
    CLN_TRY(cln_pipeline_tree(p, tree));
    CLN_TRY(take_own(p, change, old_first, &own));
    first = (cl_uint)p->first;
    count = (cl_uint)p->own;
    CLN_TRY(put_places(&c));
    CLN_TRY(carry_weights(&c));
    CLN_TRY(carry_rows(&c, CLN_BUFFER_adam_m));
    CLN_TRY(carry_rows(&c, CLN_BUFFER_adam_v));
    CLN_TRY(carry_numbers(&c, CLN_BUFFER_adam_steps, old_own));
    CLN_TRY(put_places(&all));
    CLN_TRY(carry_densities(&all));
    CLN_TRY(cln_pipeline_around(p, tree));
    CLN_TRY(cln_halo_join(p, change->octant));
    if (cln_leaf_kind_of(p->net.encoding)->joined)
        CLN_TRY(CLN_LAUNCH(p->device, p->k.voxel_join, CLN_STAGE_STRUCTURE, (size_t)p->own,
                           (size_t)p->tune.ls, CLN_ARG(p->around.mem), CLN_ARG(p->places.mem),
                           CLN_LEAF_ARG(p, params), CLN_ARG(first), CLN_ARG(count)));
    if (cln_pipeline_measures(&p->config) > 0) {
        CLN_TRY(carry_numbers(&all, CLN_BUFFER_leaf_sums, old_leaves));
        CLN_TRY(carry_numbers(&all, CLN_BUFFER_leaf_met, old_leaves));
    }
    CLN_TRY(cln_pipeline_derive(p));
done:
    free(own.from);
    cln_buffer_free(p->device, &p->places);
    return st;
}
