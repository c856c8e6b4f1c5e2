/* Common vertices of voxels by ranks (kernels/halo.cl, links of pipeline/halo.c; voxel_join of
 * voxel.cl) against a search of vertices by their places, and sums in double. One process takes the
 * place of each rank in turn, with that rank's leaves alone, and the test carries what ranks would
 * send. Numbers that a kernel must not read are NaN; all that it must not write is compared,
 * too. */
#include "unit.h"
#include <limits.h>
#include "device_test.h"
#include "pipeline/halo.h"
#include "pipeline/share.h"
#include "ranks/ranks.h"
#include "tests.h"

enum { MOST = 128, RANKS = 5 }; /* leaves; ranks */
enum { MARK_LEAF, MARK_VERTEX, MARK_ALL };
static const cl_uint NO_SLICE = 0xFFFFFFFFu;

typedef struct halo_case {
    const char *name;
    int set, cells, harmonics, ranks;
    bool parts; /* arrays of a row per leaf are split */
} halo_case;

static const halo_case cases[] = {
    {"default", 0, 4, 1, 2, false},        {"harmonics of degree 2", 0, 2, 2, 3, false},
    {"plain", 1, 8, 0, 5, false},          {"wide vectors", 2, 4, 1, 3, false},
    {"items, no view", 3, 2, 0, 2, false}, {"gpu", 4, 8, 1, 3, false},
    {"gpu, in parts", 4, 4, 1, 2, true},
};

typedef struct message {
    float *rows; /* [n][1 + features] */
    uint32_t n;
} message;

/* What a rank has. A slice of its own leaves has gradients only at vertices that it met; each leaf
 * of other ranks has a slice of garbage, which nobody may read. */
typedef struct rank {
    cl_uint4 *up, *down;
    int up_first[RANKS + 1], down_first[RANKS + 1];
    cl_uint starts[MOST + 1], far[MOST];
    uint32_t slices, all;      /* before those of other ranks' leaves; with them */
    cl_uint *met;              /* [slice][side * side] */
    float *grads;              /* [slice][row] */
    float *params;             /* [own leaf][row] */
    message gradients, values; /* that it sent last */
} rank;

typedef struct world {
    const halo_case *c;
    cln_pipeline *p;
    cln_model model;
    int leaves, vertices, side, features, row;
    int *owner;      /* [leaf * vertices]: the first that is the same vertex */
    uint8_t *marked; /* likewise: samples met it in any leaf; of owners */
    rank ranks[RANKS];
} world;

static int rank_of(const world *w, int slot)
{
    int r = 0;

    while (slot >= w->p->rank_first[r + 1])
        r++;
    return r;
}

/* 64 leaves of level 2, some of them gone, neighbours split. */
static void make_tree(world *w, const cln_config *config)
{
    uint8_t cull[MOST] = {0}, split[MOST] = {0};
    cln_octree_change change = {0};

    assert_ok(cln_model_create(config, &w->model));
    for (int s = 3; s < 64; s += 5)
        cull[s] = 1;
    assert_ok(cln_octree_cull(&w->model.tree, cull, &change));
    assert_ok(cln_model_apply(&w->model, &change));
    cln_octree_change_free(&change);
    split[22] = split[24] = split[25] = split[26] = 1;
    assert_ok(cln_octree_split(&w->model.tree, split, &change));
    assert_ok(cln_model_apply(&w->model, &change));
    cln_octree_change_free(&change);
    w->leaves = w->model.tree.leaf_count;
    assert_true(w->leaves > 70 && w->leaves <= MOST);
}

/* Order of the leaves of a level: by z, y, x. */
static int place_of(const world *w, int slot)
{
    const cln_octree *tree = &w->model.tree;
    const int node = tree->leaf[slot];

    return (tree->pos[node][2] * 8 + tree->pos[node][1]) * 8 + tree->pos[node][0];
}

/* Two leaves of a level have a vertex in common if it lies at the same place in the lattice of all
 * vertices of that level. The first of them owns it. */
static void find_owners(world *w)
{
    const cln_octree *tree = &w->model.tree;
    const int cells = w->c->cells, fine = (cells << 3) + 1, all = w->leaves * w->vertices;
    int *first = test_alloc((size_t)(4 * fine * fine * fine), sizeof *first);

    w->owner = test_alloc((size_t)all, sizeof *w->owner);
    w->marked = test_alloc((size_t)all, 1);
    for (int i = 0; i < all; i++) {
        const int node = tree->leaf[i / w->vertices], v = i % w->vertices;
        const int at[3] = {v % w->side, v / w->side % w->side, v / (w->side * w->side)};
        int key = tree->level[node];

        for (int a = 0; a < 3; a++)
            key = key * fine + tree->pos[node][a] * cells + at[a];
        w->owner[i] = key;
        if (first[key] == 0 ||
            place_of(w, i / w->vertices) < place_of(w, (first[key] - 1) / w->vertices))
            first[key] = i + 1;
    }
    for (int i = 0; i < all; i++)
        w->owner[i] = first[w->owner[i]] - 1;
    free(first);
}

static bool is_met(const world *w, const rank *r, cl_uint slice, int v)
{
    return r->met[slice * (cl_uint)(w->side * w->side) + (cl_uint)(v / w->side)] >> v % w->side & 1;
}

static bool is_met_in_leaf(const world *w, int slot, int v)
{
    const rank *r = &w->ranks[rank_of(w, slot)];

    for (cl_uint slice = r->starts[slot]; slice < r->starts[slot + 1]; slice++)
        if (is_met(w, r, slice, v))
            return true;
    return false;
}

/* A rank's slices, none to three a leaf, with room for one of each leaf of other ranks. */
static void fill_rank(world *w, int me)
{
    rank *r = &w->ranks[me];
    const int first = w->p->rank_first[me], own = w->p->rank_first[me + 1] - first;
    const int words = w->side * w->side;

    for (int s = 0; s < w->leaves; s++)
        r->starts[s + 1] =
            r->starts[s] + (rank_of(w, s) == me ? cln_hash((cl_uint)s) % 4 : (cl_uint)(s % 2));
    r->slices = r->starts[w->leaves];
    r->all = r->slices + (cl_uint)w->leaves;
    r->met = test_alloc((size_t)r->all * (size_t)words, sizeof *r->met);
    r->grads = test_alloc((size_t)r->all * (size_t)w->row, sizeof *r->grads);
    r->params = test_alloc((size_t)(own * w->row), sizeof *r->params);
    memset(r->grads, 0xFF, (size_t)r->all * (size_t)w->row * sizeof *r->grads);
    for (int s = 0; s < w->leaves; s++)
        for (cl_uint slice = r->starts[s]; slice < r->starts[s + 1]; slice++)
            for (int i = 0; i < words; i++) /* a quarter of the vertices */
                r->met[slice * (cl_uint)words + (cl_uint)i] =
                    rank_of(w, s) == me
                        ? cln_hash(slice * 1000u + (cl_uint)(me * 100000 + i)) &
                              cln_hash(slice * 2000u + (cl_uint)(me * 300000 + i + 1))
                        : 0xFFFFFFFFu;
    for (int i = 0; i < own * w->row; i++)
        r->params[i] = (float)test_uniform(3, first * w->row + i, -1, 1);
    for (int s = first; s < first + own; s++)
        for (cl_uint slice = r->starts[s]; slice < r->starts[s + 1]; slice++)
            for (int i = 0; i < w->row; i++)
                if (is_met(w, r, slice, i / w->features))
                    r->grads[slice * (cl_uint)w->row + (cl_uint)i] =
                        (float)test_uniform(4 + (uint64_t)me, (int)slice * w->row + i, -1, 1);
    for (int s = 0; s < w->leaves; s++)
        r->far[s] = NO_SLICE;
}

/* Puts a rank's leaves, slices and links on the device. */
static void enter(world *w, int me)
{
    cln_pipeline *p = w->p;
    const rank *r = &w->ranks[me];
    size_t far = 0;

    p->first = p->rank_first[me];
    p->own = p->rank_first[me + 1] - p->first;
    p->common.there = false;
    assert_ok(cln_halo_room(p, &far));
    assert_ok(CLN_PUT(p, slice_starts, r->starts, (size_t)w->leaves + 1));
    assert_ok(CLN_PUT(p, halo_far, r->far, (size_t)w->leaves));
    assert_ok(CLN_PUT(p, met, r->met, r->all));
    assert_ok(CLN_PUT(p, grads, r->grads, r->all));
    assert_ok(CLN_PUT(p, params, r->params, (size_t)p->own));
}

/* Keeps a rank's links, which are those that the places tell, each once. Its leaves' copies of
 * vertices of other ranks are `up`, theirs of its own vertices `down`. */
static void check_links(world *w, int me)
{
    rank *r = &w->ranks[me];
    const cln_common *h = &w->p->common;
    uint8_t *seen = test_alloc((size_t)(w->leaves * w->vertices), 1);
    size_t far = 0, leaves = 0;
    int up = 0, down = 0;

    enter(w, me);
    for (int s = 0; s < w->leaves; s++) {
        bool any = false;

        for (int v = 0; v < w->vertices; v++) {
            const int mine = rank_of(w, s);
            const int owner = rank_of(w, w->owner[s * w->vertices + v] / w->vertices);

            up += mine == me && owner != me;
            down += mine != me && owner == me;
            any |= mine != me && owner == me;
        }
        leaves += any;
    }
    assert_ok(cln_halo_room(w->p, &far));
    assert_int_equal(far, leaves);
    assert_int_equal(h->up_first[w->c->ranks], up);
    assert_int_equal(h->down_first[w->c->ranks], down);
    assert_true(up + down > 50);
    for (int way = 0; way < 2; way++) {
        const cl_uint4 *links = way ? h->down : h->up;
        const int *first = way ? h->down_first : h->up_first;

        for (int other = 0; other < w->c->ranks; other++)
            for (int i = first[other]; i < first[other + 1]; i++) {
                const int copy = (int)links[i].s[0] * w->vertices + (int)links[i].s[1];
                const int owner = (int)links[i].s[2] * w->vertices + (int)links[i].s[3];

                assert_int_equal(w->owner[copy], owner);
                assert_int_equal(rank_of(w, (int)links[i].s[0]), way ? other : me);
                assert_int_equal(rank_of(w, (int)links[i].s[2]), way ? me : other);
                assert_false(seen[copy]);
                seen[copy] = 1;
            }
    }
    r->up = test_alloc((size_t)up, sizeof *r->up);
    r->down = test_alloc((size_t)down, sizeof *r->down);
    memcpy(r->up, h->up, (size_t)up * sizeof *r->up);
    memcpy(r->down, h->down, (size_t)down * sizeof *r->down);
    memcpy(r->up_first, h->up_first, ((size_t)w->c->ranks + 1) * sizeof *r->up_first);
    memcpy(r->down_first, h->down_first, ((size_t)w->c->ranks + 1) * sizeof *r->down_first);
    free(seen);
}

/* A message names a link by its number, so both ranks list their links in the same order. */
static void check_order(const world *w)
{
    for (int a = 0; a < w->c->ranks; a++)
        for (int b = 0; b < w->c->ranks; b++) {
            const rank *from = &w->ranks[a], *to = &w->ranks[b];
            const int n = from->up_first[b + 1] - from->up_first[b];

            assert_int_equal(to->down_first[a + 1] - to->down_first[a], n);
            assert_memory_equal(from->up + from->up_first[b], to->down + to->down_first[a],
                                (size_t)n * sizeof *from->up);
        }
}

/* The count of a deal has each rank's links of both directions, and leaves of others with links
 * down. */
static void check_count(const world *w)
{
    int64_t links[CLN_RANKS_MOST];
    int far[CLN_RANKS_MOST];

    assert_ok(cln_halo_count(w->p, &w->model.tree, w->p->rank_first, links, far));
    for (int r = 0; r < w->c->ranks; r++) {
        const rank *mine = &w->ranks[r];
        const int n = mine->down_first[w->c->ranks];
        bool seen[MOST] = {false};
        int leaves = 0;

        for (int i = 0; i < n; i++) {
            leaves += !seen[mine->down[i].s[0]];
            seen[mine->down[i].s[0]] = true;
        }
        assert_int_equal(links[r], n + mine->up_first[w->c->ranks]);
        assert_int_equal(far[r], leaves);
    }
}

/* Marks n links on the device: want[link]. Returns how many are. */
static uint32_t mark(world *w, const cln_buffer *links, cl_uint n, cl_uint what,
                     const uint8_t *want)
{
    cln_pipeline *p = w->p;
    const cl_uint first = (cl_uint)p->first, own = (cl_uint)p->own;
    cl_uint *places = test_alloc((size_t)n + 1, sizeof *places);
    uint32_t rows = 0;

    if (n == 0)
        goto done;
    assert_ok(CLN_RESERVE(p, halo_marks, n));
    assert_ok(CLN_RESERVE(p, halo_places, (size_t)n + 1));
    assert_ok(CLN_LAUNCH(p->device, p->k.halo_mark, CLN_STAGE_ADAM,
                         cln_groups(n, (size_t)p->tune.wg), (size_t)p->tune.wg, CLN_ARG(links->mem),
                         CLN_ARG(p->slice_starts.mem), CLN_ARG(p->halo_far.mem),
                         CLN_ARG(p->around.mem), CLN_ARG(p->met.mem), CLN_ARG(p->halo_marks.mem),
                         CLN_ARG(n), CLN_ARG(what), CLN_ARG(first), CLN_ARG(own)));
    assert_ok(cln_stage_scan(p, &p->halo_marks, &p->halo_places, n, CLN_STAGE_ADAM, &rows));
    assert_ok(CLN_GET(p, halo_places, places, (size_t)n + 1));
    for (cl_uint i = 0; i < n; i++)
        if (places[i + 1] - places[i] != want[i])
            fail_msg("%s: link %u of %u is marked %u, want %u", w->c->name, i, n,
                     places[i + 1] - places[i], want[i]);
    assert_int_equal(places[n], rows);
    assert_ok(CLN_RESERVE(p, halo_rows, rows));
done:
    free(places);
    return rows;
}

static const float *row_of(const world *w, const float *rows, uint32_t row)
{
    return rows + row * (1 + (size_t)w->features);
}

/* A row's link. */
static cl_uint link_of(const world *w, const float *rows, uint32_t row)
{
    cl_uint link = 0;

    memcpy(&link, row_of(w, rows, row), sizeof link);
    return link;
}

/* Reads packed rows, whose numbers are those of marked links in order. */
static void read_rows(world *w, message *out, uint32_t rows, const uint8_t *want)
{
    cl_uint link = 0;

    free(out->rows);
    out->rows = test_alloc((size_t)rows * (1 + (size_t)w->features), sizeof *out->rows);
    out->n = rows;
    if (rows > 0)
        assert_ok(CLN_GET(w->p, halo_rows, out->rows, rows));
    for (uint32_t i = 0; i < rows; i++, link++) {
        while (!want[link])
            link++;
        assert_int_equal(link_of(w, out->rows, i), link);
    }
}

/* The rows that all ranks sent to `me`, gradients or values, with its own numbers of links. Returns
 * how many. */
static uint32_t carry_rows(const world *w, int me, bool gradients, float **out)
{
    const rank *r = &w->ranks[me];
    const int *to = gradients ? r->down_first : r->up_first;
    const size_t each = 1 + (size_t)w->features;
    uint32_t n = 0;

    *out = test_alloc((size_t)to[w->c->ranks] * each, sizeof **out);
    for (int k = 0; k < w->c->ranks; k++) {
        const rank *from = &w->ranks[k];
        const message *sent = gradients ? &from->gradients : &from->values;
        const int *first = gradients ? from->up_first : from->down_first;

        for (uint32_t i = 0; i < sent->n; i++) {
            cl_uint link = link_of(w, sent->rows, i);

            if ((int)link < first[me] || (int)link >= first[me + 1])
                continue;
            memcpy(*out + n * each, row_of(w, sent->rows, i), each * sizeof **out);
            link = link - (cl_uint)first[me] + (cl_uint)to[k];
            memcpy(*out + n * each, &link, sizeof link);
            n++;
        }
    }
    return n;
}

/* A rank sends the gradients of its copies that samples met, each the sum over the leaf's
 * slices. */
static void send_gradients(world *w, int me)
{
    cln_pipeline *p = w->p;
    rank *r = &w->ranks[me];
    const cl_uint n = (cl_uint)r->up_first[w->c->ranks];
    const size_t wg = (size_t)p->tune.wg;
    uint8_t *want = test_alloc(n, 1);
    uint32_t rows = 0, sums = 0;

    enter(w, me);
    for (cl_uint i = 0; i < n; i++)
        want[i] = is_met_in_leaf(w, (int)r->up[i].s[0], (int)r->up[i].s[1]);
    rows = mark(w, &p->halo_up, n, MARK_LEAF, want);
    assert_true(n == 0 || (rows > n / 8 && rows < n));
    if (n > 0)
        assert_ok(CLN_LAUNCH(p->device, p->k.halo_pack_gradients, CLN_STAGE_ADAM, cln_groups(n, wg),
                             wg, CLN_ARG(p->halo_up.mem), CLN_ARG(p->slice_starts.mem),
                             CLN_LEAF_ARG(p, grads), CLN_ARG(p->met.mem),
                             CLN_ARG(p->halo_places.mem), CLN_ARG(p->halo_rows.mem), CLN_ARG(n)));
    read_rows(w, &r->gradients, rows, want);
    for (uint32_t i = 0; i < rows; i++) {
        const cl_uint4 link = r->up[link_of(w, r->gradients.rows, i)];
        const float *mine = row_of(w, r->gradients.rows, i) + 1;

        for (int f = 0; f < w->features; f++) {
            double sum = 0, size = 0;
            int parts = 0;

            for (cl_uint k = r->starts[link.s[0]]; k < r->starts[link.s[0] + 1]; k++)
                if (is_met(w, r, k, (int)link.s[1])) {
                    const double g = r->grads[k * (cl_uint)w->row +
                                              link.s[1] * (cl_uint)w->features + (cl_uint)f];

                    sum += g;
                    size += fabs(g);
                    parts++;
                }
            sums += parts > 1;
            if (!(fabs((double)mine[f] - sum) <= 1.2e-7 * size))
                fail_msg("%s: a gradient of %d slices is %.9g, want %.9g", w->c->name, parts,
                         (double)mine[f], sum);
        }
    }
    assert_true(n == 0 || sums > 10);
    free(want);
}

/* An owner's rank gives each leaf that sent something a slice, after its own, and puts the numbers
 * there; then it sends its vertices that samples met on any rank, or all of them. */
static void answer(world *w, int me, cl_uint what)
{
    cln_pipeline *p = w->p;
    rank *r = &w->ranks[me];
    const size_t wg = (size_t)p->tune.wg, numbers = (size_t)w->features;
    const size_t words = (size_t)(w->side * w->side);
    const cl_uint n = (cl_uint)r->down_first[w->c->ranks], first = (cl_uint)p->rank_first[me];
    float *came = NULL, *got = test_alloc((size_t)r->all * (size_t)w->row, sizeof *got);
    uint8_t *want = test_alloc(n, 1);
    uint32_t rows = 0, next = r->slices;
    cl_uint count = 0;

    count = carry_rows(w, me, true, &came);
    for (cl_uint i = 0; i < count; i++) {
        const cl_uint4 link = r->down[link_of(w, came, i)];

        if (r->far[link.s[0]] == NO_SLICE)
            r->far[link.s[0]] = next++;
        r->met[r->far[link.s[0]] * words + link.s[1] / (cl_uint)w->side] |=
            1u << link.s[1] % (cl_uint)w->side;
    }
    enter(w, me);
    assert_ok(CLN_PUT(p, halo_rows, came, count));
    if (count > 0)
        assert_ok(CLN_LAUNCH(p->device, p->k.halo_put_gradients, CLN_STAGE_ADAM,
                             cln_groups(count, wg), wg, CLN_ARG(p->halo_down.mem),
                             CLN_ARG(p->halo_far.mem), CLN_LEAF_ARG(p, grads),
                             CLN_ARG(p->halo_rows.mem), CLN_ARG(count)));
    for (cl_uint i = 0; i < count; i++) {
        const cl_uint4 link = r->down[link_of(w, came, i)];

        memcpy(r->grads + r->far[link.s[0]] * (size_t)w->row + link.s[1] * numbers,
               row_of(w, came, i) + 1, numbers * sizeof *came);
    }
    assert_ok(CLN_GET(p, grads, got, r->all));
    assert_memory_equal(got, r->grads, (size_t)r->all * (size_t)w->row * sizeof *got);
    for (cl_uint i = 0; i < n; i++)
        want[i] =
            what == MARK_ALL || w->marked[r->down[i].s[2] * (cl_uint)w->vertices + r->down[i].s[3]];
    rows = mark(w, &p->halo_down, n, what, want);
    assert_true(n == 0 || (what == MARK_ALL ? rows == n : rows > n / 8 && rows < n));
    if (n > 0)
        assert_ok(CLN_LAUNCH(p->device, p->k.halo_pack_values, CLN_STAGE_ADAM, cln_groups(n, wg),
                             wg, CLN_ARG(p->halo_down.mem), CLN_LEAF_ARG(p, params),
                             CLN_ARG(p->halo_places.mem), CLN_ARG(p->halo_rows.mem), CLN_ARG(n),
                             CLN_ARG(first)));
    read_rows(w, &r->values, rows, want);
    for (uint32_t i = 0; i < rows; i++) {
        const cl_uint4 link = r->down[link_of(w, r->values.rows, i)];

        assert_memory_equal(row_of(w, r->values.rows, i) + 1,
                            r->params + (link.s[2] - first) * (size_t)w->row + link.s[3] * numbers,
                            numbers * sizeof *r->params);
    }
    free(came);
    free(got);
    free(want);
}

/* A copy gets its owner's numbers, of vertices that any leaf's samples met, or of all; the rest of
 * the leaf stays. */
static void take_values(world *w, int me, cl_uint what)
{
    cln_pipeline *p = w->p;
    rank *r = &w->ranks[me];
    const size_t wg = (size_t)p->tune.wg, numbers = (size_t)w->features;
    const cl_uint first = (cl_uint)p->rank_first[me];
    float *came = NULL, *got = NULL;
    cl_uint n = 0;

    enter(w, me);
    n = carry_rows(w, me, false, &came);
    assert_ok(CLN_PUT(p, halo_rows, came, n));
    if (n > 0)
        assert_ok(CLN_LAUNCH(p->device, p->k.halo_put_values, CLN_STAGE_ADAM, cln_groups(n, wg), wg,
                             CLN_ARG(p->halo_up.mem), CLN_LEAF_ARG(p, params),
                             CLN_ARG(p->halo_rows.mem), CLN_ARG(n), CLN_ARG(first)));
    for (int i = 0; i < r->up_first[w->c->ranks]; i++) {
        const cl_uint4 link = r->up[i];
        const int to = rank_of(w, (int)link.s[2]);

        if (what == MARK_VERTEX && !w->marked[link.s[2] * (cl_uint)w->vertices + link.s[3]])
            continue;
        memcpy(r->params + (link.s[0] - first) * (size_t)w->row + link.s[1] * numbers,
               w->ranks[to].params + (link.s[2] - (cl_uint)p->rank_first[to]) * (size_t)w->row +
                   link.s[3] * numbers,
               numbers * sizeof *r->params);
    }
    got = test_alloc((size_t)(p->own * w->row), sizeof *got);
    assert_ok(CLN_GET(p, params, got, (size_t)p->own));
    assert_memory_equal(got, r->params, (size_t)(p->own * w->row) * sizeof *got);
    free(came);
    free(got);
}

/* The vertex whose numbers hold after a change: of its copies in leaves that stayed, else of those
 * that were split, else of those that begin anew, the first. holds [leaf * vertices], by owners. */
static void find_holders(const world *w, const cl_int2 *places, int *holds)
{
    static const int anew = -10; /* kernels/carry.cl */
    const int all = w->leaves * w->vertices;
    int *best = test_alloc((size_t)all, sizeof *best); /* of owners */

    for (int i = 0; i < all; i++)
        best[i] = INT_MAX;
    for (int i = 0; i < all; i++) {
        const int slot = i / w->vertices, octant = places[slot].s[1];
        const int grade = octant == -1 ? 0 : octant == anew ? 2 : 1;
        const int order = grade * 1000 + place_of(w, slot);

        if (order < best[w->owner[i]]) {
            best[w->owner[i]] = order;
            holds[w->owner[i]] = i;
        }
    }
    free(best);
}

/* After a change of the tree: a leaf that did not stay takes common vertices from this rank's
 * leaves. Where another rank's hold, halo.cl has brought them, and they stay. */
static void join(world *w, int me)
{
    cln_pipeline *p = w->p;
    const int all = w->leaves * w->vertices;
    const cl_uint first = (cl_uint)w->p->rank_first[me];
    const cl_uint own = (cl_uint)w->p->rank_first[me + 1] - first;
    float *want = test_alloc((size_t)own * (size_t)w->row, sizeof *want);
    float *got = test_alloc((size_t)own * (size_t)w->row, sizeof *got);
    cl_int2 *places = test_alloc((size_t)w->leaves, sizeof *places);
    int *holds = test_alloc((size_t)all, sizeof *holds), joined = 0, far = 0, given = 0;
    const size_t bytes = (size_t)w->features * sizeof *want;

    for (int s = 0; s < w->leaves; s++)
        places[s].s[1] = (const int[]){-1, s % 8, -10, -10}[cln_hash((cl_uint)s) % 4];
    find_holders(w, places, holds);
    enter(w, me);
    memcpy(want, w->ranks[me].params, (size_t)own * (size_t)w->row * sizeof *want);
    for (int i = (int)first * w->vertices; i < (int)(first + own) * w->vertices; i++) {
        const int from = holds[w->owner[i]], slot = i / w->vertices;
        const int there = from / w->vertices, octant = places[slot].s[1];

        if (octant == -1 || there == slot)
            continue;
        joined += rank_of(w, there) == me;
        far += rank_of(w, there) != me;
        given += octant == -10 && places[there].s[1] >= 0;
        if (rank_of(w, there) == me)
            memcpy(want + (slot - (int)first) * w->row + i % w->vertices * w->features,
                   w->ranks[me].params + (there - (int)first) * w->row +
                       from % w->vertices * w->features,
                   bytes);
    }
    assert_true(joined > 20 && far > 20 && given > 10);
    assert_ok(CLN_PUT(p, places, places, (size_t)w->leaves));
    assert_ok(CLN_LAUNCH(p->device, p->k.voxel_join, CLN_STAGE_STRUCTURE, own, (size_t)p->tune.ls,
                         CLN_ARG(p->around.mem), CLN_ARG(p->places.mem), CLN_LEAF_ARG(p, params),
                         CLN_ARG(first), CLN_ARG(own)));
    assert_ok(CLN_GET(p, params, got, (size_t)own));
    if (memcmp(got, want, (size_t)own * (size_t)w->row * sizeof *got) != 0)
        fail_msg("%s: rank %d's leaves are joined in another way", w->c->name, me);
    free(want);
    free(got);
    free(places);
    free(holds);
}

static void free_world(world *w)
{
    for (int r = 0; r < w->c->ranks; r++) {
        free(w->ranks[r].up);
        free(w->ranks[r].down);
        free(w->ranks[r].met);
        free(w->ranks[r].grads);
        free(w->ranks[r].params);
        free(w->ranks[r].gradients.rows);
        free(w->ranks[r].values.rows);
    }
    free(w->owner);
    free(w->marked);
    cln_model_free(&w->model);
}

static void begin_ranks(world *w, const cln_config *config)
{
    cln_pipeline *p = w->p;
    const size_t most = p->device->max_alloc;

    if (w->c->parts)
        p->device->max_alloc = (size_t)w->leaves * 5 / 8 * (size_t)p->net.params * sizeof(float);
    assert_ok(cln_pipeline_rebuild(p, w->leaves));
    assert_int_equal(p->parts, w->c->parts ? CLN_PARTS : 1);
    assert_ok(cln_pipeline_tree(p, &w->model.tree));
    p->device->max_alloc = most;
    p->ranks = w->c->ranks;
    p->rank_first = test_alloc((size_t)p->ranks + 1, sizeof *p->rank_first);
    cln_share_evenly(p, w->leaves);
    assert_ok(cln_pipeline_around(p, &w->model.tree));
    assert_ok(cln_pipeline_want(p, CLN_PROGRAM_BIT(halo) | CLN_PROGRAM_BIT(voxel_train)));
    w->features = p->net.features;
    w->row = p->net.params;
    w->side = config->grid_cells + 1;
    w->vertices = w->side * w->side * w->side;
}

static void check_case(const halo_case *c)
{
    static const cl_uint whats[] = {MARK_VERTEX, MARK_ALL};
    cln_config config = small_config();
    world w = {.c = c};

    config.encoding = CLN_ENCODING_VOXEL;
    config.grid_cells = c->cells;
    config.view_dependence = c->harmonics > 0;
    config.harmonics = c->harmonics;
    config.decoder_width = 0;
    config.start_level = 2;
    if (c->parts) /* a part has room for more slices than leaves */
        config.n1 = 18;
    make_tree(&w, &config);
    w.p = test_pipeline(&tune_sets[c->set], &config, false, false);
    begin_ranks(&w, &config);
    find_owners(&w);
    for (int r = 0; r < c->ranks; r++)
        fill_rank(&w, r);
    for (int i = 0; i < w.leaves * w.vertices; i++)
        if (is_met_in_leaf(&w, i / w.vertices, i % w.vertices))
            w.marked[w.owner[i]] = 1;
    for (int r = 0; r < c->ranks; r++)
        check_links(&w, r);
    check_order(&w);
    check_count(&w);
    for (int r = 0; r < c->ranks; r++)
        send_gradients(&w, r);
    for (int k = 0; k < 2; k++) {
        for (int r = 0; r < c->ranks; r++)
            answer(&w, r, whats[k]);
        for (int r = 0; r < c->ranks; r++)
            take_values(&w, r, whats[k]);
    }
    for (int r = 0; r < c->ranks; r++)
        join(&w, r);
    free_world(&w);
}

static void test_halo(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
        check_case(&cases[i]);
}

int test_group_halo(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_halo)};

    test_wanted = CLN_PROGRAM_BIT(scan);
    return cmocka_run_group_tests_name("halo", tests, NULL, test_device_close);
}
