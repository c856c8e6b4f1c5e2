/* A change of the tree on the device. See carry.h. Array by array, so that only one of them is there twice:
 *
 *   1. the successor is made, and kernels/carry.cl gathers its rows from the old array
 *   2. weights of new leaves are folded (model/fold.c, in double): their old leaves' rows alone come to the
 *      host, and their own alone go back
 *   3. the old array is freed */
#include "pipeline/carry.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

_Static_assert(CLN_COPIED == -1 && CLN_MERGED == -2, "as kernels/carry.cl has them");

typedef struct carry {
    cln_pipeline *p;
    const cln_octree_change *change;
    cln_buffer places; /* int2 [leaf] old slot, octant */
} carry;

static cln_status put_places(carry *c)
{
    cln_status st = CLN_OK;
    const size_t bytes = (size_t)c->change->count * sizeof(cl_int2);
    cl_int2 *places = NULL;

    CLN_TRY(cln_alloc(&places, (size_t)c->change->count, sizeof *places, "change of the tree"));
    for (int s = 0; s < c->change->count; s++)
        places[s] = (cl_int2){{c->change->from[s], c->change->octant[s]}};
    CLN_TRY(cln_buffer_reserve(c->p->device, &c->places, bytes, "change of the tree"));
    CLN_TRY(cln_buffer_write(c->p->device, &c->places, 0, places, bytes));
done:
    free(places);
    return st;
}

/* An array of old leaves as an argument of kernels that have parts: if it is in one buffer, it fits the first
 * part, and the others are not read. */
static cln_buffer in_parts(const cln_buffer *old)
{
    cln_buffer out = *old;

    for (int i = 1; i < CLN_PARTS && !old->part_bytes; i++)
        out.part[i] = old->part[0];
    return out;
}

/* The successor of an array of rows, filled by the kernel; count: the kernel's last argument. */
static cln_status gather(const carry *c, cl_kernel kernel, const cln_buffer *old, size_t row_bytes,
                         cl_uint count, const char *what, cln_buffer *new)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_buffer from = in_parts(old);

    CLN_TRY(cln_pipeline_leaf_rows(p, new, row_bytes, what));
    CLN_TRY(CLN_LAUNCH(p->device, kernel, CLN_STAGE_STRUCTURE, (size_t)c->change->count,
                       (size_t)p->tune.sg, CLN_LEAF_ARG_OF(p, &from), CLN_LEAF_ARG_OF(p, new),
                       CLN_ARG(c->places.mem), CLN_ARG(count)));
done:
    return st;
}

static void replace(const carry *c, cln_buffer *old, cln_buffer *new)
{
    cln_buffer_free(c->p->device, old);
    *old = *new;
    memset(new, 0, sizeof *new);
}

static cln_status carry_rows(const carry *c, cln_buffer *array, size_t row_bytes, const char *what)
{
    cln_status st = CLN_OK;
    cln_buffer new = {0};

    CLN_ASSERT(row_bytes % sizeof(cl_uint4) == 0);
    CLN_TRY(gather(c, c->p->k.carry_rows, array, row_bytes, (cl_uint)(row_bytes / sizeof(cl_uint4)),
                   what, &new));
    replace(c, array, &new);
done:
    cln_buffer_free(c->p->device, &new);
    return st;
}

static cln_status carry_densities(const carry *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cl_uint n1 = (cl_uint)p->config.n1;
    cln_buffer new = {0};

    CLN_TRY(gather(c, p->k.carry_densities, &p->density, (size_t)n1 * n1 * n1 * sizeof(cl_ushort),
                   n1, "stage-1 densities", &new));
    replace(c, &p->density, &new);
done:
    cln_buffer_free(p->device, &new);
    return st;
}

/* New leaves from slot `first` on, at most CLN_CARRY_ROWS, whose old ones stand in a row, too: how many,
 * and of how many old leaves. */
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

/* Weights of new leaves, folded or unfolded from rows of `old` to rows of `new`. */
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

            if (octant >= 0)
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

static cln_status carry_weights(const carry *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const size_t bytes = (size_t)p->net.params * sizeof(float);
    cln_buffer new = {0};

    CLN_TRY(gather(c, p->k.carry_rows, &p->params, bytes, (cl_uint)(bytes / sizeof(cl_uint4)),
                   "network weights", &new));
    CLN_TRY(fold(c, &p->params, &new));
    replace(c, &p->params, &new);
done:
    cln_buffer_free(p->device, &new);
    return st;
}

/* An array of a few numbers a leaf goes through the host; zeros for new leaves. */
static cln_status carry_numbers(const carry *c, cln_buffer *array, int old_leaves, size_t row_bytes,
                                const char *what)
{
    cln_status st = CLN_OK;
    cln_device *device = c->p->device;
    const size_t count = (size_t)c->change->count;
    char *old = NULL, *new = NULL;

    CLN_TRY(cln_alloc(&old, (size_t)old_leaves, row_bytes, what));
    CLN_TRY(cln_alloc(&new, count, row_bytes, what));
    CLN_TRY(cln_buffer_read(device, array, 0, old, (size_t)old_leaves * row_bytes));
    for (size_t s = 0; s < count; s++)
        if (c->change->octant[s] == CLN_COPIED)
            memcpy(new + s *row_bytes, old + (size_t)c->change->from[s] * row_bytes, row_bytes);
    cln_buffer_free(device, array);
    CLN_TRY(cln_buffer_reserve(device, array, count * row_bytes, what));
    CLN_TRY(cln_buffer_write(device, array, 0, new, count * row_bytes));
done:
    free(old);
    free(new);
    return st;
}

cln_status cln_pipeline_carry(cln_pipeline *p, const cln_octree *tree,
                              const cln_octree_change *change)
{
    cln_status st = CLN_OK;
    carry c = {.p = p, .change = change};
    const int old_leaves = p->leaves;
    const size_t moments = (size_t)p->net.params * cln_moment_bytes(&p->config);

    CLN_ASSERT(change->count == tree->leaf_count);
    cln_buffer_free(p->device, &p->grads); /* sized by the leaves of the batches so far */
    cln_buffer_free(p->device, &p->seen);
    cln_buffer_free(p->device, &p->transposed);
    CLN_TRY(cln_pipeline_tree(p, tree));
    CLN_TRY(put_places(&c));
    CLN_TRY(carry_weights(&c));
    CLN_TRY(carry_rows(&c, &p->adam_m, moments, "Adam's first moments"));
    CLN_TRY(carry_rows(&c, &p->adam_v, moments, "Adam's second moments"));
    CLN_TRY(carry_densities(&c));
    CLN_TRY(carry_numbers(&c, &p->adam_steps, old_leaves, sizeof(cl_int), "step counts"));
    if (cln_pipeline_measures(&p->config) > 0) {
        CLN_TRY(carry_numbers(&c, &p->leaf_sums, old_leaves, 2 * CLN_MEASURES * sizeof(float),
                              "measures of leaves"));
        CLN_TRY(carry_numbers(&c, &p->leaf_met, old_leaves, sizeof(cl_int), "measures of leaves"));
    }
    CLN_TRY(cln_pipeline_derive(p));
done:
    cln_buffer_free(p->device, &c.places);
    return st;
}
