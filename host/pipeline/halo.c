/* Common vertices of voxels on several ranks. See halo.h. A link's copy is in leaf x, vertex y; its
 * owner is leaf z, vertex w. Both ranks list the links between them in the same order, so a message
 * names one by its number. */
#include "pipeline/halo.h"

#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "model/encoding_voxel.h"
#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "ranks/ranks.h"

/* As kernels/halo.cl and vertices.h have them. */
enum { MARK_LEAF, MARK_VERTEX, MARK_ALL };
static const cl_uint NO_SLICE = 0xFFFFFFFFu;

bool cln_halo_is_linked(const cln_pipeline *p)
{
    return p->ranks > 1 && cln_leaf_kind_of(p->net.encoding)->joined;
}

/* ---- links ---- */

static bool is_here(const cln_pipeline *p, int slot)
{
    return cln_share_row(p, slot) >= 0;
}

/* first: [ranks + 1] */
static int rank_in(const int *first, int ranks, int slot)
{
    int low = 0, high = ranks;

    while (high - low > 1) {
        const int middle = (low + high) / 2;

        if (first[middle] <= slot)
            low = middle;
        else
            high = middle;
    }
    return low;
}

static int rank_of(const cln_pipeline *p, int slot)
{
    return rank_in(p->rank_first, p->ranks, slot);
}

/* Of leaves with common vertices, the numbers of the lowest grade hold, of several those of the
 * first (model/encoding_voxel.c). octant: of a change of the tree; NULL in a step, where all are
 * equal. */
static int grade_of(const int8_t *octant, int slot)
{
    return octant ? cln_voxel_grade(octant[slot]) : 0;
}

/* The owner of a leaf's vertices on a face, an edge or a corner, `face` along the axes: -1, 0 or 1.
 * around: its neighbours. shift: what to add to a vertex' number in the leaf. */
static int owner_of(const int32_t around[CLN_AROUND], int cells, const int8_t *octant,
                    const int face[3], int *shift)
{
    const int side = cells + 1;
    int best = -1;

    for (int z = face[2] < 0 ? -1 : 0; z <= (face[2] > 0); z++)
        for (int y = face[1] < 0 ? -1 : 0; y <= (face[1] > 0); y++)
            for (int x = face[0] < 0 ? -1 : 0; x <= (face[0] > 0); x++) {
                const int other = around[CLN_SELF + (z * 3 + y) * 3 + x];

                if (other < 0 || (best >= 0 && grade_of(octant, other) >= grade_of(octant, best)))
                    continue;
                best = other;
                *shift = -((z * side + y) * side + x) * cells;
            }
    return best;
}

/* Coordinates of vertices on a face: [*from, *to]. */
static void range_of(int face, int cells, int *from, int *to)
{
    *from = face < 0 ? 0 : face > 0 ? cells : 1;
    *to = face == 0 ? cells - 1 : *from;
}

/* Lists a leaf's links with other ranks, up or down, from next[rank] on; links NULL: only counts
 * them. */
static void list_leaf(const cln_pipeline *p, const int8_t *octant, int slot, bool up, int *next,
                      cl_uint4 *links)
{
    const int cells = p->net.cells, side = cells + 1;

    for (int n = 0; n < CLN_AROUND; n++) {
        const int face[3] = {n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
        int shift = 0, rank = 0, from[3], to[3];
        const int owner = owner_of(p->common.around[slot], cells, octant, face, &shift);

        if (n == CLN_SELF || is_here(p, owner) == up)
            continue;
        rank = rank_of(p, up ? owner : slot);
        for (int a = 0; a < 3; a++)
            range_of(face[a], cells, &from[a], &to[a]);
        for (int z = from[2]; z <= to[2]; z++)
            for (int y = from[1]; y <= to[1]; y++)
                for (int x = from[0]; x <= to[0]; x++) {
                    const int vertex = (z * side + y) * side + x, at = next[rank]++;

                    if (links)
                        links[at] = (cl_uint4){{(cl_uint)slot, (cl_uint)vertex, (cl_uint)owner,
                                                (cl_uint)(vertex + shift)}};
                }
    }
}

/* Counts the links of a leaf for both ranks, and the leaf for each other one with an owner. */
static void count_leaf(const int32_t around[CLN_AROUND], int cells, const int *first, int ranks,
                       int slot, int64_t *links, int *far)
{
    const int mine = rank_in(first, ranks, slot);
    int told[CLN_AROUND], n_told = 0;

    for (int n = 0; n < CLN_AROUND; n++) {
        const int face[3] = {n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1};
        int shift = 0, vertices = 1, k = 0;
        const int owner = rank_in(first, ranks, owner_of(around, cells, NULL, face, &shift));

        if (owner == mine)
            continue;
        for (int a = 0; a < 3; a++)
            vertices *= face[a] ? 1 : cells - 1;
        links[mine] += vertices;
        links[owner] += vertices;
        while (k < n_told && told[k] != owner)
            k++;
        if (k == n_told) {
            told[n_told++] = owner;
            far[owner]++;
        }
    }
}

/* A change of the tree may turn links round. */
cln_status cln_halo_count(const cln_pipeline *p, const cln_octree *tree, const int *first,
                          int64_t *links, int *far)
{
    cln_status st = CLN_OK;
    int32_t(*around)[CLN_AROUND] = NULL;

    memset(links, 0, CLN_RANKS_MOST * sizeof *links);
    memset(far, 0, CLN_RANKS_MOST * sizeof *far);
    if (!cln_halo_is_linked(p))
        return CLN_OK;
    CLN_TRY(cln_octree_around(tree, &around));
    for (int s = 0; s < tree->leaf_count; s++)
        count_leaf(around[s], p->net.cells, first, p->ranks, s, links, far);
done:
    free(around);
    return st;
}

/* Has it a neighbour that is here? */
static bool is_near(const cln_pipeline *p, int slot)
{
    for (int n = 0; n < CLN_AROUND; n++) {
        const int other = p->common.around[slot][n];

        if (other >= 0 && is_here(p, other))
            return true;
    }
    return false;
}

static void list_all(const cln_pipeline *p, const int8_t *octant, bool up, int *next,
                     cl_uint4 *links)
{
    for (int slot = 0; slot < p->leaves; slot++)
        if (is_here(p, slot) == up && (up || is_near(p, slot)) &&
            (!octant || grade_of(octant, slot) > 0))
            list_leaf(p, octant, slot, up, next, links);
}

static cln_status find_side(const cln_pipeline *p, const int8_t *octant, bool up, cl_uint4 **links,
                            int **first)
{
    cln_status st = CLN_OK;
    int next[CLN_RANKS_MOST] = {0};

    free(*links);
    free(*first);
    *links = NULL;
    CLN_TRY(cln_alloc(first, (size_t)p->ranks + 1, sizeof **first, "common vertices"));
    list_all(p, octant, up, next, NULL);
    for (int r = 0; r < p->ranks; r++) {
        (*first)[r + 1] = (*first)[r] + next[r];
        next[r] = (*first)[r];
    }
    CLN_TRY(cln_alloc(links, (size_t)(*first)[p->ranks], sizeof **links, "common vertices"));
    list_all(p, octant, up, next, *links);
done:
    return st;
}

static cln_status find_links(cln_pipeline *p, const int8_t *octant)
{
    cln_status st = CLN_OK;
    cln_common *h = &p->common;
    size_t up = 0, down = 0;

    CLN_TRY(find_side(p, octant, true, &h->up, &h->up_first));
    CLN_TRY(find_side(p, octant, false, &h->down, &h->down_first));
    up = (size_t)h->up_first[p->ranks];
    down = (size_t)h->down_first[p->ranks];
    CLN_TRY(CLN_PUT(p, halo_up, h->up, up));
    CLN_TRY(CLN_PUT(p, halo_down, h->down, down));
    h->far_leaves = 0;
    for (size_t i = 0; i < down; i++) /* a leaf's links are adjacent */
        h->far_leaves += i == 0 || h->down[i].s[0] != h->down[i - 1].s[0];
    free(h->far);
    free(h->met);
    h->met = NULL;
    CLN_TRY(cln_alloc(&h->far, (size_t)p->leaves, sizeof *h->far, "common vertices"));
    CLN_TRY(cln_alloc(&h->met, (size_t)h->far_leaves, cln_buffer_row_bytes(p, CLN_BUFFER_met),
                      "common vertices"));
done:
    return st;
}

cln_status cln_halo_room(cln_pipeline *p, size_t *slices)
{
    cln_status st = CLN_OK;

    *slices = 0;
    if (!cln_halo_is_linked(p))
        return CLN_OK;
    if (!p->common.there)
        CLN_TRY(find_links(p, NULL));
    p->common.there = true;
    *slices = (size_t)p->common.far_leaves;
done:
    return st;
}

/* ---- messages ---- */

/* Finds the links that have something to send, of `count`; *rows: how many. */
static cln_status mark(cln_pipeline *p, const cln_buffer *links, int count, cl_uint what,
                       uint32_t *rows)
{
    cln_status st = CLN_OK;
    const size_t wg = (size_t)p->tune.wg, all = (size_t)count;
    const cl_uint n = (cl_uint)count, first = (cl_uint)p->first, own = (cl_uint)p->own;

    *rows = 0;
    CLN_TRY(CLN_RESERVE(p, halo_far, (size_t)p->leaves));
    CLN_TRY(CLN_RESERVE(p, halo_marks, all));
    CLN_TRY(CLN_RESERVE(p, halo_places, all + 1));
    CLN_TRY(CLN_RESERVE(p, met, 0)); /* a change of the tree may precede all steps */
    if (count == 0)
        return CLN_OK;
    CLN_TRY(CLN_LAUNCH(p->device, p->k.halo_mark, CLN_STAGE_ADAM, cln_groups(all, wg), wg,
                       CLN_ARG(links->mem), CLN_ARG(p->slice_starts.mem), CLN_ARG(p->halo_far.mem),
                       CLN_ARG(p->around.mem), CLN_ARG(p->met.mem), CLN_ARG(p->halo_marks.mem),
                       CLN_ARG(n), CLN_ARG(what), CLN_ARG(first), CLN_ARG(own)));
    CLN_TRY(cln_stage_scan(p, &p->halo_marks, &p->halo_places, n, CLN_STAGE_ADAM, rows));
    CLN_TRY(CLN_RESERVE(p, halo_rows, *rows));
done:
    return st;
}

/* A row's link. */
static cl_uint *link_of(char *rows, size_t i, size_t row)
{
    return (cl_uint *)(void *)(rows + i * row);
}

/* Sends the `rows` packed rows of links that begin at from_first[rank], and gets those of links at
 * to_first[rank]: *got rows at *came, in p->message. */
static cln_status swap(cln_pipeline *p, uint32_t rows, const int *from_first, const int *to_first,
                       char **came, size_t *got)
{
    cln_status st = CLN_OK;
    const size_t row = cln_buffer_row_bytes(p, CLN_BUFFER_halo_rows);
    const size_t room = (size_t)to_first[p->ranks];
    int sent_first[CLN_RANKS_MOST + 1] = {0}, count[CLN_RANKS_MOST] = {0};
    bool to[CLN_RANKS_MOST] = {false};
    uint32_t i = 0;

    CLN_TRY(cln_share_room(p, (rows + room) * row));
    CLN_TRY(cln_buffer_read(p->device, &p->halo_rows, 0, p->message, rows * row));
    for (int r = 0; r < p->ranks; r++) { /* links are numbered from the rank's first one on */
        sent_first[r] = (int)i;
        to[r] = from_first[r + 1] > from_first[r];
        for (; i < rows && *link_of(p->message, i, row) < (cl_uint)from_first[r + 1]; i++)
            *link_of(p->message, i, row) -= (cl_uint)from_first[r];
    }
    CLN_ASSERT(i == rows);
    sent_first[p->ranks] = (int)rows;
    *came = p->message + rows * row;
    cln_ranks_swap(p->message, sent_first, to, *came, to_first, count, row);
    *got = 0;
    for (int r = 0; r < p->ranks; r++) {
        char *at = *came + *got * row;

        memmove(at, *came + (size_t)to_first[r] * row, (size_t)count[r] * row);
        for (int k = 0; k < count[r]; k++) {
            *link_of(at, (size_t)k, row) += (cl_uint)to_first[r];
            CLN_ASSERT(*link_of(at, (size_t)k, row) < (cl_uint)to_first[r + 1]);
        }
        *got += (size_t)count[r];
    }
    p->common.bytes += (double)rows * (double)row;
done:
    return st;
}

/* Gives other ranks' leaves that sent gradients a slice each, from `slices` on: p->halo_far, and
 * which of its vertices samples met there. */
static cln_status put_slices(cln_pipeline *p, char *rows, size_t count, uint32_t slices)
{
    cln_status st = CLN_OK;
    cln_common *h = &p->common;
    const size_t row = cln_buffer_row_bytes(p, CLN_BUFFER_halo_rows);
    const size_t bytes = cln_buffer_row_bytes(p, CLN_BUFFER_met), words = bytes / sizeof *h->met;
    const cl_uint side = (cl_uint)p->net.cells + 1;
    cl_uint n = 0;

    for (int s = 0; s < p->leaves; s++)
        h->far[s] = NO_SLICE;
    for (size_t i = 0; i < count; i++) {
        const cl_uint4 link = h->down[*link_of(rows, i, row)];
        const cl_uint leaf = link.s[0], vertex = link.s[1];

        if (h->far[leaf] == NO_SLICE) {
            memset(h->met + n * words, 0, bytes);
            h->far[leaf] = slices + n++;
        }
        h->met[(h->far[leaf] - slices) * words + vertex / side] |= 1u << vertex % side;
    }
    CLN_TRY(CLN_PUT(p, halo_far, h->far, (size_t)p->leaves));
    CLN_TRY(cln_buffer_write(p->device, &p->met, slices * bytes, h->met, n * bytes));
done:
    return st;
}

cln_status cln_halo_gradients(cln_pipeline *p, uint32_t slices)
{
    cln_status st = CLN_OK;
    const cln_common *h = &p->common;
    const size_t wg = (size_t)p->tune.wg;
    uint32_t rows = 0;
    char *came = NULL;
    size_t got = 0;
    cl_uint n = 0;

    if (!cln_halo_is_linked(p))
        return CLN_OK;
    n = (cl_uint)h->up_first[p->ranks];
    CLN_TRY(mark(p, &p->halo_up, (int)n, MARK_LEAF, &rows));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.halo_pack_gradients, CLN_STAGE_ADAM, cln_groups(n, wg), wg,
                       CLN_ARG(p->halo_up.mem), CLN_ARG(p->slice_starts.mem),
                       CLN_LEAF_ARG(p, grads), CLN_ARG(p->met.mem), CLN_ARG(p->halo_places.mem),
                       CLN_ARG(p->halo_rows.mem), CLN_ARG(n)));
    CLN_TRY(swap(p, rows, h->up_first, h->down_first, &came, &got));
    CLN_TRY(put_slices(p, came, got, slices));
    CLN_TRY(CLN_PUT(p, halo_rows, came, got));
    n = (cl_uint)got;
    CLN_TRY(CLN_LAUNCH(p->device, p->k.halo_put_gradients, CLN_STAGE_ADAM, cln_groups(n, wg), wg,
                       CLN_ARG(p->halo_down.mem), CLN_ARG(p->halo_far.mem), CLN_LEAF_ARG(p, grads),
                       CLN_ARG(p->halo_rows.mem), CLN_ARG(n)));
done:
    return st;
}

/* Brings owners' numbers to copies: of vertices that samples met, or of all. */
static cln_status bring_values(cln_pipeline *p, cl_uint what)
{
    cln_status st = CLN_OK;
    const cln_common *h = &p->common;
    const size_t wg = (size_t)p->tune.wg;
    const cl_uint first = (cl_uint)p->first;
    uint32_t rows = 0;
    char *came = NULL;
    size_t got = 0;
    cl_uint n = (cl_uint)h->down_first[p->ranks];

    CLN_TRY(mark(p, &p->halo_down, (int)n, what, &rows));
    CLN_TRY(CLN_LAUNCH(p->device, p->k.halo_pack_values, CLN_STAGE_ADAM, cln_groups(n, wg), wg,
                       CLN_ARG(p->halo_down.mem), CLN_LEAF_ARG(p, params),
                       CLN_ARG(p->halo_places.mem), CLN_ARG(p->halo_rows.mem), CLN_ARG(n),
                       CLN_ARG(first)));
    CLN_TRY(swap(p, rows, h->down_first, h->up_first, &came, &got));
    CLN_TRY(CLN_PUT(p, halo_rows, came, got));
    n = (cl_uint)got;
    CLN_TRY(CLN_LAUNCH(p->device, p->k.halo_put_values, CLN_STAGE_ADAM, cln_groups(n, wg), wg,
                       CLN_ARG(p->halo_up.mem), CLN_LEAF_ARG(p, params), CLN_ARG(p->halo_rows.mem),
                       CLN_ARG(n), CLN_ARG(first)));
done:
    return st;
}

cln_status cln_halo_values(cln_pipeline *p)
{
    return cln_halo_is_linked(p) ? bring_values(p, MARK_VERTEX) : CLN_OK;
}

cln_status cln_halo_join(cln_pipeline *p, const int8_t *octant)
{
    cln_status st = CLN_OK;

    if (!cln_halo_is_linked(p))
        return CLN_OK;
    CLN_TRY(find_links(p, octant));
    p->common.there = false; /* those of steps are others */
    CLN_TRY(bring_values(p, MARK_ALL));
done:
    return st;
}

cln_status cln_halo_decoder(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const size_t size = (size_t)p->net.decoder_params, bytes = size * sizeof(float);
    const size_t groups = (size_t)p->decoder_groups, ranks = (size_t)p->ranks;
    int each[CLN_RANKS_MOST + 1];
    float *sums = NULL, *mine = NULL;

    if (!cln_halo_is_linked(p) || size == 0)
        return CLN_OK;
    CLN_TRY(cln_share_room(p, (groups + ranks) * bytes));
    sums = (float *)(void *)p->message;
    CLN_TRY(cln_buffer_read(p->device, &p->decoder_grads, 0, sums + ranks * size, groups * bytes));
    mine = sums + (size_t)cln_ranks_me() * size;
    memset(mine, 0, bytes);
    for (size_t k = 0; k < groups; k++)
        for (size_t i = 0; i < size; i++)
            mine[i] += sums[(ranks + k) * size + i];
    for (int r = 0; r <= p->ranks; r++)
        each[r] = r;
    cln_ranks_gather(sums, bytes, each, true);
    CLN_TRY(cln_buffer_write(p->device, &p->decoder_grads, 0, sums, ranks * bytes));
    p->decoder_groups = p->ranks;
done:
    return st;
}
