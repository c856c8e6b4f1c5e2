/* The octree. Tested: counts and Morton order of full trees, half-open membership, slot changes of
 * splits, culls and merges, collapse of culled groups, the kernels' map against point lookup,
 * packing, refusal of damaged node tables. Oracles: brute-force geometry from level and position,
 * and hand-made cases. test_structure.c tests decisions about the tree. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "device_abi.h"
#include "model/octree.h"
#include "model/shell_tree.h"
#include "reference/reference.h"
#include "tests.h"

enum { SEED = 20240607, ROW = 8 };

static uint32_t draw(uint32_t *counter)
{
    uint32_t c[4] = {(*counter)++, 0, 0, 0}, key[2] = {SEED, 0}, out[4];

    cln_philox(c, key, out);
    return out[0];
}

/* Morton key of a leaf's lower corner at the finest level, bit by bit. */
static uint32_t morton(const cln_octree *tree, int node)
{
    uint32_t key = 0;

    for (int bit = 0; bit < CLN_MAX_LEVEL; bit++)
        for (int a = 0; a < 3; a++) {
            uint32_t p = (uint32_t)tree->pos[node][a] << (CLN_MAX_LEVEL - tree->level[node]);
            key |= (p >> bit & 1) << (3 * bit + a);
        }
    return key;
}

/* Slot of the leaf whose box [min, max) holds the point, by trying all. boxes: [leaf][4] */
static int brute_find(const float *boxes, int leaves, const double point[3])
{
    for (int s = 0; s < leaves; s++) {
        const float *box = boxes + 4 * s;
        int a = 0;

        for (; a < 3; a++) {
            const double low = box[a], high = low + box[3];

            if (!(point[a] >= low && (point[a] < high || (high == 1 && point[a] == 1))))
                break;
        }
        if (a == 3)
            return s;
    }
    return -1;
}

/* The box of an empty cell holds the cell and no leaf's cell; enlarged on any side it would hold
 * one, unless it is a node below the level of boxes. */
static void check_empty_box(const int32_t *map, int depth, const int cell[3], int32_t entry)
{
    const int n = 1 << depth, unit = CLN_MAP_UNIT(depth), grown = CLN_MAP_IS_BOX(entry);
    int low[3], high[3];

    assert_true(grown || CLN_MAP_LEVEL(entry) > CLN_BOX_LEVEL);
    for (int a = 0; a < 3; a++) {
        const int side = grown ? 0 : 1 << (depth - CLN_MAP_LEVEL(entry));

        low[a] = grown ? (int)CLN_MAP_LOW((uint32_t)entry, a) << unit : cell[a] & -side;
        high[a] = grown ? (int)CLN_MAP_HIGH((uint32_t)entry, a) << unit : low[a] + side;
        assert_true(low[a] >= 0 && low[a] <= cell[a] && cell[a] < high[a] && high[a] <= n);
    }
    for (int side = -1; side < (grown ? 6 : 0); side++) { /* -1: the box itself */
        int from[3] = {low[0], low[1], low[2]}, to[3] = {high[0], high[1], high[2]}, leaves = 0;

        if (side >= 0 && (side < 3 ? low[side] == 0 : high[side - 3] == n))
            continue;
        if (side >= 0)
            *(side < 3 ? &from[side] : &to[side - 3]) += (side < 3 ? -1 : 1) * (1 << unit);
        for (int z = from[2]; z < to[2]; z++)
            for (int y = from[1]; y < to[1]; y++)
                for (int x = from[0]; x < to[0]; x++)
                    leaves += map[(z * n + y) * n + x] >= 0;
        assert_true(side < 0 ? leaves == 0 : leaves > 0);
    }
}

/* Invariants of any tree. */
static void check_tree(const cln_octree *tree)
{
    int32_t *map = NULL;
    float *boxes = NULL;
    int depth = cln_octree_depth(tree), n = 1 << depth, deepest = 0,
        step = n > 32 ? n * n * n / 61 + 1 : 1;
    double volume = 0;

    assert_int_equal(cln_octree_boxes(tree, &boxes), CLN_OK);
    for (int s = 0; s < tree->leaf_count; s++) {
        int node = tree->leaf[s];
        double side = 2.0 / (1 << tree->level[node]);
        assert_int_equal(tree->state[node], CLN_NODE_ACTIVE);
        assert_int_equal(tree->slot[node], s);
        if (s > 0)
            assert_true(morton(tree, tree->leaf[s - 1]) < morton(tree, node));
        if (tree->level[node] > deepest)
            deepest = tree->level[node];
        for (int a = 0; a < 3; a++)
            assert_true(boxes[4 * s + a] == (float)(-1 + side * tree->pos[node][a]));
        assert_true(boxes[4 * s + 3] == (float)side);
        volume += side * side * side;
    }
    assert_true(volume <= 8);
    assert_int_equal(depth, deepest);
    assert_int_equal(cln_octree_map(tree, depth, &map), CLN_OK);
    for (int i = 0; i < n * n * n; i += step) {
        int cell[3] = {i % n, i / n % n, i / n / n};
        double centre[3];
        int slot = map[i] < 0 ? -1 : CLN_MAP_SLOT(map[i]);
        for (int a = 0; a < 3; a++)
            centre[a] = -1 + 2 * (cell[a] + 0.5) / n;
        assert_int_equal(slot, brute_find(boxes, tree->leaf_count, centre));
        assert_int_equal(slot, cln_octree_find(tree, centre));
        if (slot >= 0)
            assert_int_equal(CLN_MAP_LEVEL(map[i]), tree->level[tree->leaf[slot]]);
        else
            check_empty_box(map, depth, cell, map[i]);
    }
    free(map);
    free(boxes);
}

static void test_full_trees(void **state)
{
    (void)state;
    for (int level = 0; level <= 5; level++) {
        cln_octree tree;
        int leaves = 1 << (3 * level);
        assert_int_equal(cln_octree_create(level, &tree), CLN_OK);
        assert_int_equal(tree.leaf_count, leaves);
        assert_int_equal(tree.node_count, (8 * leaves - 1) / 7);
        assert_int_equal(cln_octree_depth(&tree), level);
        for (int s = 0; s < leaves; s++) /* a full tree's slots are the Morton keys themselves */
            assert_int_equal(morton(&tree, tree.leaf[s]), s << (3 * (CLN_MAX_LEVEL - level)));
        if (level <= 3)
            check_tree(&tree);
        cln_octree_free(&tree);
    }
}

static void test_wrong_level(void **state)
{
    cln_octree tree;

    (void)state;
    assert_int_equal(cln_octree_create(CLN_MAX_LEVEL + 1, &tree), CLN_USAGE);
    assert_non_null(strstr(cln_error_text(), "level 9"));
    cln_clear_error();
    cln_octree_free(&tree); /* a failed one is empty */
}

/* No line meets more leaves than cln_octree_most_intervals says. */
static void check_lines(const cln_octree *tree, uint32_t *counter)
{
    int most = 0;

    assert_int_equal(cln_octree_most_intervals(tree, &most), CLN_OK);
    for (int i = 0; i < 200; i++) {
        double o[3], d[3], length = 0;

        for (int a = 0; a < 3; a++) {
            o[a] = draw(counter) / 0x1p31 - 1;
            d[a] = draw(counter) / 0x1p31 - 1;
            length = hypot(length, d[a]);
        }
        for (int a = 0; a < 3; a++) {
            d[a] /= length;
            o[a] -= 4 * d[a];
        }
        assert_true(ref_intervals(tree, o, d, NULL, 0) <= most);
    }
}

/* A whole tree of level 2 whose leaves around a point are split down to `level`. */
static void make_deep(int level, const double point[3], cln_octree *tree)
{
    assert_int_equal(cln_octree_create(2, tree), CLN_OK);
    while (cln_octree_depth(tree) < level) {
        cln_octree_change change;
        uint8_t *marks = calloc((size_t)tree->leaf_count, 1);

        marks[cln_octree_find(tree, point)] = 1;
        assert_int_equal(cln_octree_split(tree, marks, &change), CLN_OK);
        cln_octree_change_free(&change);
        free(marks);
    }
}

/* Trees deeper than whole ones may be, and their maps with holes of all sizes. */
static void test_deep(void **state)
{
    static const double points[][3] = {{0.999, 0.999, 0.999}, {0.01, -0.01, 0.3}, {-0.5, 0.7, -1}};
    uint32_t counter = 7;
    int most = 0;
    cln_octree tree;

    (void)state;
    for (int level = 6; level <= CLN_MAX_LEVEL; level++) {
        cln_octree_change change;
        uint8_t *marks = NULL;

        make_deep(level, points[level - 6], &tree);
        assert_int_equal(tree.leaf_count, 64 + 7 * (level - 2));
        check_lines(&tree, &counter);
        marks = calloc((size_t)tree.leaf_count, 1);
        for (int s = 0; s < tree.leaf_count; s++)
            marks[s] = draw(&counter) % 8 < 7 && tree.level[tree.leaf[s]] < level;
        assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
        cln_octree_change_free(&change);
        free(marks);
        check_tree(&tree);
        check_lines(&tree, &counter);
        cln_octree_free(&tree);
    }
    assert_int_equal(cln_octree_create(2, &tree), CLN_OK);
    assert_int_equal(cln_octree_most_intervals(&tree, &most), CLN_OK);
    assert_int_equal(most, 12); /* 4 cells along each axis */
    cln_octree_free(&tree);
}

static void test_membership(void **state)
{
    static const struct {
        double point[3];
        int slot;
    } cases[] = {{{0, 0, 0}, 7},       {{-1, -1, -1}, 0},          {{1, 1, 1}, 7},
                 {{1, -1, -1}, 1},     {{-1, 0, -1}, 2},           {{-1, -1, 0}, 4},
                 {{-1e-300, 0, 0}, 6}, {{1.0000000001, 0, 0}, -1}, {{0, -1.0000000001, 0}, -1},
                 {{0, 0, NAN}, -1},    {{0, INFINITY, 0}, -1}};
    cln_octree tree;

    (void)state;
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        assert_int_equal(cln_octree_find(&tree, cases[i].point), cases[i].slot);
    cln_octree_free(&tree);
}

/* Splits slot 2 of eight: its children take slots 2..9. */
static void test_split(void **state)
{
    uint8_t marks[8] = {0, 0, 1};
    cln_octree tree;
    cln_octree_change change;

    (void)state;
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    tree.strikes[tree.leaf[2]] = 1;
    tree.strikes[tree.leaf[3]] = 1;
    assert_int_equal(cln_octree_split(&tree, marks, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 15);
    assert_int_equal(change.count, 15);
    for (int s = 0; s < 15; s++) {
        int child = s >= 2 && s < 10;
        assert_int_equal(change.from[s], s < 2 ? s : child ? 2 : s - 7);
        assert_int_equal(change.octant[s], child ? s - 2 : -1);
    }
    assert_int_equal(tree.strikes[tree.leaf[2]], 0);
    assert_int_equal(tree.strikes[tree.leaf[10]], 1);
    check_tree(&tree);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
}

static void test_split_stops_at_deepest(void **state)
{
    cln_octree tree;
    cln_octree_change change;

    (void)state;
    assert_int_equal(cln_octree_create(0, &tree), CLN_OK);
    for (int level = 0; level < CLN_MAX_LEVEL; level++) { /* only the last corner, on every level */
        uint8_t marks[64] = {0};
        marks[tree.leaf_count - 1] = 1;
        assert_int_equal(cln_octree_split(&tree, marks, &change), CLN_OK);
        cln_octree_change_free(&change);
    }
    assert_int_equal(tree.leaf_count, 1 + 7 * CLN_MAX_LEVEL);
    assert_int_equal(cln_octree_depth(&tree), CLN_MAX_LEVEL);
    check_tree(&tree);
    assert_int_equal(cln_octree_split(&tree, NULL, &change), CLN_OK);
    for (int s = 0; s < tree.leaf_count; s++)
        if (tree.level[tree.leaf[s]] == CLN_MAX_LEVEL && change.octant[s] < 0)
            assert_true(change.from[s] >=
                        1 + 7 * CLN_MAX_LEVEL - 8); /* the eight deepest were last and stay last */
    assert_int_equal(tree.leaf_count, 8 + 7 * (CLN_MAX_LEVEL - 1) * 8);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
}

/* Splits slot 2 of eight, then culls old slot 1 and the children 0 and 3: as one change. */
static void test_cull_after(void **state)
{
    static const int from[12] = {0, 2, 2, 2, 2, 2, 2, 3, 4, 5, 6, 7};
    static const int octant[12] = {-1, 1, 2, 4, 5, 6, 7, -1, -1, -1, -1, -1};
    const uint8_t split[8] = {0, 0, 1}, cull[15] = {0, 1, 1, 0, 0, 1};
    cln_octree tree;
    cln_octree_change change;

    (void)state;
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    assert_int_equal(cln_octree_split(&tree, split, &change), CLN_OK);
    assert_int_equal(cln_octree_cull_after(&tree, cull, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 12);
    assert_int_equal(change.count, 12);
    for (int s = 0; s < 12; s++) {
        assert_int_equal(change.from[s], from[s]);
        assert_int_equal(change.octant[s], octant[s]);
    }
    check_tree(&tree);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
}

static void test_cull_collapses(void **state)
{
    uint8_t marks[64] = {0};
    cln_octree tree;
    cln_octree_change change;
    int32_t *map = NULL;

    (void)state;
    assert_int_equal(cln_octree_create(2, &tree), CLN_OK);
    memset(marks, 1, 8); /* one whole group, and one single leaf */
    marks[20] = 1;
    assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 55);
    for (int s = 0; s < 55; s++) {
        assert_int_equal(change.from[s], s < 12 ? s + 8 : s + 9);
        assert_int_equal(change.octant[s], -1);
    }
    assert_int_equal(tree.state[1], CLN_NODE_CULLED); /* the group's parent */
    assert_int_equal(tree.child[1], -1);
    check_tree(&tree);
    assert_int_equal(cln_octree_map(&tree, 2, &map), CLN_OK);
    assert_true(map[0] < 0); /* culled at level 1 */
    free(map);
    map = NULL;
    assert_int_equal(cln_octree_map(&tree, 1, &map), CLN_INTERNAL); /* leaves are deeper */
    cln_clear_error();
    cln_octree_change_free(&change);

    memset(marks, 1, sizeof marks); /* now all: culled groups collapse up to the root */
    assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
    assert_int_equal(change.count, 0);
    assert_int_equal(tree.leaf_count, 0);
    assert_int_equal(tree.state[0], CLN_NODE_CULLED);
    assert_int_equal(cln_octree_depth(&tree), 0);
    check_tree(&tree);
    cln_octree_change_free(&change);
    assert_int_equal(cln_octree_split(&tree, NULL, &change), CLN_OK);
    assert_int_equal(change.count, 0);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
}

/* A merged leaf next to leaves as deep as its former children, which stay in the table but must not
 * hide it. */
static void test_merge_one_of_two(void **state)
{
    const uint8_t split[8] = {0, 0, 1, 0, 0, 1};
    uint8_t merge[22] = {0};
    float weight[22] = {0};
    cln_octree tree;
    cln_octree_change change;

    (void)state;
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    assert_int_equal(cln_octree_split(&tree, split, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(tree.leaf_count, 22);
    merge[3] = 1;
    assert_int_equal(cln_octree_merge(&tree, merge, weight, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 15);
    assert_int_equal(cln_octree_depth(&tree), 2);
    check_tree(&tree);
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
}

/* Merging: a group becomes its parent, which takes over the heaviest sibling; slots stay in
 * order. */
static void test_merge(void **state)
{
    uint8_t split[8] = {0, 0, 1}, cull[15] = {0}, merge[16] = {0};
    float weight[16];
    cln_octree tree;
    cln_octree_change change;

    (void)state;
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    assert_int_equal(cln_octree_split(&tree, split, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(tree.leaf_count, 15);
    cull[4] = 1; /* third child of node 3 */
    assert_int_equal(cln_octree_cull(&tree, cull, &change), CLN_OK);
    cln_octree_change_free(&change);
    for (int s = 0; s < 14; s++) {
        weight[s] = (float)(s * 5 % 9);
        assert_int_equal(cln_octree_can_merge(&tree, s), s >= 2 && s <= 8);
    }
    merge[3] = 1; /* one mark is enough */
    tree.strikes[tree.parent[tree.leaf[3]]] = tree.strikes[tree.leaf[9]] = 1;
    assert_int_equal(cln_octree_merge(&tree, merge, weight, &change), CLN_OK);
    check_tree(&tree);
    assert_int_equal(tree.leaf_count, 8);
    assert_int_equal(change.count, 8);
    for (int s = 0; s < 8; s++) {
        /* slot 7 is the heaviest of 2..8 (weight 8): child 6, after the culled third one */
        assert_int_equal(change.from[s], s < 2 ? s : s == 2 ? 7 : s + 6);
        assert_int_equal(change.octant[s], s == 2 ? CLN_MERGED - 6 : CLN_COPIED);
        assert_int_equal(tree.level[tree.leaf[s]], 1);
        assert_int_equal(tree.strikes[tree.leaf[s]], s == 3);
    }
    cln_octree_change_free(&change);
    /* up to the root, which has no siblings */
    assert_int_equal(cln_octree_merge(&tree, merge, weight, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 1);
    assert_int_equal(change.octant[0], CLN_MERGED - 7);
    cln_octree_change_free(&change);
    merge[0] = 1;
    assert_false(cln_octree_can_merge(&tree, 0));
    assert_int_equal(cln_octree_merge(&tree, merge, weight, &change), CLN_INTERNAL);
    cln_clear_error();
    check_tree(&tree);
    /* a group with an inner sibling is refused and left alone */
    cln_octree_free(&tree);
    assert_int_equal(cln_octree_create(1, &tree), CLN_OK);
    assert_int_equal(cln_octree_split(&tree, split, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(cln_octree_merge(&tree, merge, weight, &change), CLN_INTERNAL);
    cln_clear_error();
    assert_int_equal(tree.leaf_count, 15);
    check_tree(&tree);
    cln_octree_free(&tree);
}

static void same_tree(const cln_octree *a, const cln_octree *b)
{
    size_t n = (size_t)a->node_count;

    assert_int_equal(a->node_count, b->node_count);
    assert_int_equal(a->leaf_count, b->leaf_count);
    assert_memory_equal(a->state, b->state, n);
    assert_memory_equal(a->level, b->level, n);
    assert_memory_equal(a->strikes, b->strikes, n);
    assert_memory_equal(a->parent, b->parent, n * sizeof *a->parent);
    assert_memory_equal(a->child, b->child, n * sizeof *a->child);
    assert_memory_equal(a->slot, b->slot, n * sizeof *a->slot);
    assert_memory_equal(a->pos, b->pos, n * sizeof *a->pos);
    if (a->leaf_count)
        assert_memory_equal(a->leaf, b->leaf, (size_t)a->leaf_count * sizeof *a->leaf);
}

/* In a shell space, what comes back in the core is a level finer, like its neighbours. */
static void test_regrow_shell(void **state)
{
    static const double places[2][3] = {{0.1, 0.1, 0.1}, {0.9, 0.1, 0.1}}; /* core, face */
    cln_octree tree;
    cln_octree_change change;
    cln_marks cells = {0};
    uint8_t marks[1024] = {0};

    (void)state;
    assert_int_equal(cln_shell_tree_create(3, &tree), CLN_OK);
    assert_true(tree.leaf_count <= 1024);
    for (int k = 0; k < 2; k++) { /* a group of siblings each */
        const int slot = cln_octree_find(&tree, places[k]);
        const int first = tree.child[tree.parent[tree.leaf[slot]]];
        int cell[3];

        assert_int_equal(tree.level[tree.leaf[slot]], k == 0 ? 4 : 3);
        for (int i = 0; i < 8; i++)
            if (tree.state[first + i] == CLN_NODE_ACTIVE)
                marks[tree.slot[first + i]] = 1;
        for (int a = 0; a < 3; a++)
            cell[a] = (int)((places[k][a] + 1) * 8);
        assert_int_equal(cln_marks_add(&cells, 4, cell), CLN_OK);
    }
    cln_marks_order(&cells);
    assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
    cln_octree_change_free(&change);
    memset(marks, 0, sizeof marks);
    assert_int_equal(cln_octree_regrow(&tree, &cells, 3, 4, marks, &change), CLN_OK);
    for (int k = 0; k < 2; k++) {
        const int slot = cln_octree_find(&tree, places[k]);

        assert_true(slot >= 0 && change.octant[slot] == CLN_FRESH);
        assert_int_equal(tree.level[tree.leaf[slot]], k == 0 ? 4 : 3);
    }
    cln_octree_change_free(&change);
    cln_marks_free(&cells);
    cln_octree_free(&tree);
}

/* Culled places come back as leaves of a level where cells are marked, and empty leaves with marked
 * cells restart; all others stay as they are. */
static void test_regrow(void **state)
{
    static const int marked[][3] = {
        {0, 0, 0}, {1, 0, 0}, /* two cells of level 3 in the group */
        {3, 3, 3},            /* another, in its last child */
        {7, 7, 7},            /* one in the leaf at the highest corner */
        {4, 0, 0}, {6, 0, 0}, /* in the first two leaves of the second group */
    };
    uint8_t marks[64] = {0}, empty[64] = {0};
    cln_marks cells = {0};
    cln_octree tree;
    cln_octree_change change;
    int fresh = 0, back = 0;

    (void)state;
    assert_int_equal(cln_octree_create(2, &tree), CLN_OK);
    memset(marks, 1, 8); /* the group at the lowest corner, [-1, 0)^3, which collapses */
    marks[63] = 1;       /* the leaf at the highest corner */
    tree.strikes[tree.leaf[63]] = tree.strikes[tree.parent[tree.leaf[0]]] = 2;
    assert_int_equal(cln_octree_cull(&tree, marks, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_int_equal(cln_octree_regrow(&tree, &cells, 3, 3, empty, &change), CLN_OK);
    assert_int_equal(change.count, 55); /* no marks, no change */
    for (int s = 0; s < 55; s++)
        assert_true(change.octant[s] == CLN_COPIED && change.from[s] == s);
    cln_octree_change_free(&change);

    for (size_t i = 0; i < sizeof marked / sizeof marked[0]; i++)
        assert_int_equal(cln_marks_add(&cells, 3, marked[i]), CLN_OK);
    cln_marks_order(&cells);
    empty[0] = 1;
    tree.strikes[tree.leaf[0]] = tree.strikes[tree.leaf[1]] = 1;
    assert_int_equal(cln_octree_regrow(&tree, &cells, 3, 3, empty, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 55 + 4);
    check_tree(&tree);
    for (int s = 0; s < change.count; s++) {
        float box[4];
        const bool new = s < 3 || s == 58, anew = s == 3;

        cln_octree_box(&tree, tree.leaf[s], box);
        assert_true(box[3] == (new ? 0.25f : 0.5f));
        assert_int_equal(change.octant[s], new || anew ? CLN_FRESH : CLN_COPIED);
        assert_true(s == 0 || change.from[s] >= change.from[s - 1]);
        if (change.octant[s] == CLN_COPIED)
            assert_int_equal(change.from[s], s - 3);
        fresh += change.octant[s] == CLN_FRESH;
        assert_int_equal(tree.strikes[tree.leaf[s]], s == 3 || s == 4);
    }
    assert_int_equal(fresh, 5);
    assert_int_equal(cln_octree_find(&tree, (double[3]){-0.9, -0.9, -0.9}), 0);
    assert_int_equal(cln_octree_find(&tree, (double[3]){-0.9, -0.6, -0.9}), -1);
    cln_octree_change_free(&change);

    /* a level above that of the culled nodes: those themselves come back */
    assert_int_equal(cln_marks_add(&cells, 3, (int[3]){2, 0, 0}), CLN_OK);
    cln_marks_order(&cells);
    memset(empty, 0, sizeof empty);
    for (int i = 0; i < tree.node_count; i++)
        if (tree.state[i] == CLN_NODE_CULLED)
            tree.strikes[i] = 2;
    assert_int_equal(cln_octree_regrow(&tree, &cells, 1, 1, empty, &change), CLN_OK);
    assert_int_equal(tree.leaf_count, 60);
    back = cln_octree_find(&tree, (double[3]){-0.375, -0.875, -0.875});
    assert_true(back >= 0 && change.octant[back] == CLN_FRESH);
    assert_int_equal(tree.strikes[tree.leaf[back]], 0);
    check_tree(&tree);
    cln_octree_change_free(&change);
    cln_marks_free(&cells);
    cln_octree_free(&tree);
}

/* A random history of splits and culls; checks every change against the previous boxes. */
static void random_tree(uint32_t *counter, cln_octree *tree)
{
    assert_int_equal(cln_octree_create(1, tree), CLN_OK);
    for (int round = 0; round < 6; round++) {
        int before = tree->leaf_count, splits = round % 2 == 0;
        uint8_t *marks = calloc((size_t)before + 1, 1);
        float *old = NULL, *new = NULL;
        cln_octree_change change;
        for (int s = 0; s < before; s++)
            marks[s] = draw(counter) % (splits ? 4 : 3) == 0;
        assert_int_equal(cln_octree_boxes(tree, &old), CLN_OK);
        assert_int_equal(splits ? cln_octree_split(tree, marks, &change)
                                : cln_octree_cull(tree, marks, &change),
                         CLN_OK);
        assert_int_equal(cln_octree_boxes(tree, &new), CLN_OK);
        assert_int_equal(change.count, tree->leaf_count);
        for (int s = 0; s < change.count; s++) {
            const float *was = old + 4 * change.from[s], *is = new + 4 * s;
            int octant = change.octant[s];
            assert_in_range(change.from[s], 0, before - 1);
            assert_int_equal(octant >= 0, splits && marks[change.from[s]]);
            for (int a = 0; a < 3; a++)
                assert_true(is[a] == was[a] + (octant >= 0 && octant >> a & 1 ? is[3] : 0));
            assert_true(is[3] == (octant >= 0 ? was[3] / 2 : was[3]));
        }
        check_tree(tree);
        cln_octree_change_free(&change);
        free(old);
        free(new);
        free(marks);
    }
}

static void test_random_histories(void **state)
{
    uint32_t counter = 0;

    (void)state;
    for (int i = 0; i < 8; i++) {
        cln_octree tree, back;
        int32_t *rows = NULL;
        random_tree(&counter, &tree);
        assert_int_equal(cln_octree_pack(&tree, &rows), CLN_OK);
        assert_int_equal(cln_octree_unpack(rows, tree.node_count, &back), CLN_OK);
        same_tree(&tree, &back);
        free(rows);
        cln_octree_free(&tree);
        cln_octree_free(&back);
    }
}

static void test_unpack_refuses(void **state)
{
    static const struct {
        int node, column, value;
        const char *word;
    } cases[] = {
        {0, 0, 3, "state"},
        {0, 0, -1, "state"},
        {3, 2, 256, "strikes"},
        {0, 3, 0, "root"},
        {0, 1, 1, "root"},
        {0, 5, 1, "root"},
        {4, 3, 9, "parent"},
        {4, 3, -1, "parent"},
        {9, 3, 9, "parent"},
        {12, 1, 3, "level"},
        {12, 5, 5, "position"},
        {12, 7, 70000, "position"},
        {0, 4, -1, "children"},
        {12, 4, 65, "children"},
        {1, 4, 0, "children"},
        {1, 4, 10, "children"},
        {1, 4, 17, "children"},
        {8, 4, 73, "children"},
        {1, 4, INT32_MAX, "children"},
        {1, 4, INT32_MIN, "children"},
        {1, 0, CLN_NODE_CULLED, "children"},
        {12, 0, CLN_NODE_INNER, "children"},
    };
    cln_octree tree, back;
    int32_t *rows = NULL;

    (void)state;
    assert_int_equal(cln_octree_create(2, &tree), CLN_OK);
    assert_int_equal(cln_octree_pack(&tree, &rows), CLN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        int32_t *cell = &rows[ROW * cases[i].node + cases[i].column], kept = *cell;
        *cell = cases[i].value;
        assert_int_equal(cln_octree_unpack(rows, tree.node_count, &back), CLN_CHECKPOINT);
        if (!strstr(cln_error_text(), cases[i].word))
            fail_msg("case %zu: '%s' does not name %s", i, cln_error_text(), cases[i].word);
        cln_clear_error();
        *cell = kept;
    }
    for (int k = 0; k < 8; k++) /* eight culled children under an inner node */
        rows[ROW * (9 + k)] = CLN_NODE_CULLED;
    assert_int_equal(cln_octree_unpack(rows, tree.node_count, &back), CLN_CHECKPOINT);
    cln_clear_error();
    assert_int_equal(cln_octree_unpack(rows, 72, &back), CLN_CHECKPOINT);
    cln_clear_error();
    assert_int_equal(cln_octree_unpack(rows, 0, &back), CLN_CHECKPOINT);
    cln_clear_error();
    free(rows);
    cln_octree_free(&tree);
}

/* Damage is refused or leaves a valid tree. */
static void test_unpack_fuzz(void **state)
{
    static const int32_t extremes[] = {0, 1, 2, 8, 9, -1, INT32_MAX, INT32_MIN, 255, 65535};
    uint32_t counter = 1 << 20;
    cln_octree tree, back;
    int32_t *rows = NULL;
    int refused = 0;

    (void)state;
    random_tree(&counter, &tree);
    assert_int_equal(cln_octree_pack(&tree, &rows), CLN_OK);
    for (int i = 0; i < 3000; i++) {
        uint32_t at = draw(&counter) % (uint32_t)(ROW * tree.node_count);
        int32_t kept = rows[at];
        rows[at] = draw(&counter) % 2 ? extremes[draw(&counter) % 10]
                                      : (int32_t)(draw(&counter) % (uint32_t)tree.node_count);
        if (cln_octree_unpack(rows, tree.node_count, &back) == CLN_OK)
            check_tree(&back);
        else
            refused++;
        cln_octree_free(&back);
        cln_clear_error();
        rows[at] = kept;
    }
    assert_true(refused > 1500);
    free(rows);
    cln_octree_free(&tree);
}

int test_group_octree(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_full_trees),
        cmocka_unit_test(test_wrong_level),
        cmocka_unit_test(test_deep),
        cmocka_unit_test(test_membership),
        cmocka_unit_test(test_split),
        cmocka_unit_test(test_split_stops_at_deepest),
        cmocka_unit_test(test_cull_collapses),
        cmocka_unit_test(test_cull_after),
        cmocka_unit_test(test_regrow),
        cmocka_unit_test(test_regrow_shell),
        cmocka_unit_test(test_merge),
        cmocka_unit_test(test_merge_one_of_two),
        cmocka_unit_test(test_random_histories),
        cmocka_unit_test(test_unpack_refuses),
        cmocka_unit_test(test_unpack_fuzz),
    };

    return cmocka_run_group_tests_name("octree", tests, NULL, NULL);
}
