/* The octree: create, split, merge, cull, look up, and to and from flat arrays. See octree.h for
 * the layout.
 *
 * New groups of eight children are appended, so a child's index is always larger than its parent's
 * and groups start at 1, 9, 17, ...; depth-first order over the octants is Morton order of the
 * leaves, the order of slots. A change allocates everything before it touches the tree: on failure
 * the tree is as it was. structure.c and integer_program.c decide on changes, octree_map.c makes
 * the kernels' map. */
#include "model/octree.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

_Static_assert(CLN_LEVELS == CLN_MAX_LEVEL + 1, "the settings' levels are the kernels' levels");

enum { ROW = 8, ROW_STATE = 0, ROW_LEVEL, ROW_STRIKES, ROW_PARENT, ROW_CHILD, ROW_POS };

void cln_octree_free(cln_octree *tree)
{
    free(tree->state);
    free(tree->level);
    free(tree->strikes);
    free(tree->parent);
    free(tree->child);
    free(tree->slot);
    free(tree->pos);
    free(tree->leaf);
    memset(tree, 0, sizeof *tree);
}

void cln_octree_change_free(cln_octree_change *change)
{
    free(change->from);
    free(change->octant);
    memset(change, 0, sizeof *change);
}

/* Allocates arrays for `capacity` nodes, none used; not `leaf`. */
static cln_status tree_alloc(int capacity, cln_octree *out)
{
    cln_status st = CLN_OK;
    size_t n = (size_t)capacity;

    memset(out, 0, sizeof *out);
    out->node_capacity = capacity;
    CLN_TRY(cln_alloc(&out->state, n, sizeof *out->state, "octree nodes"));
    CLN_TRY(cln_alloc(&out->level, n, sizeof *out->level, "octree nodes"));
    CLN_TRY(cln_alloc(&out->strikes, n, sizeof *out->strikes, "octree nodes"));
    CLN_TRY(cln_alloc(&out->parent, n, sizeof *out->parent, "octree nodes"));
    CLN_TRY(cln_alloc(&out->child, n, sizeof *out->child, "octree nodes"));
    CLN_TRY(cln_alloc(&out->slot, n, sizeof *out->slot, "octree nodes"));
    CLN_TRY(cln_alloc(&out->pos, n, sizeof *out->pos, "octree nodes"));
done:
    if (st != CLN_OK)
        cln_octree_free(out);
    return st;
}

/* Makes room for `extra` more nodes. */
static cln_status reserve(cln_octree *tree, int extra)
{
    cln_status st = CLN_OK;
    cln_octree bigger = {0};
    size_t n = (size_t)tree->node_count;

    if (tree->node_count + extra <= tree->node_capacity)
        return CLN_OK;
    CLN_TRY(tree_alloc(tree->node_count + extra, &bigger));
    memcpy(bigger.state, tree->state, n * sizeof *tree->state);
    memcpy(bigger.level, tree->level, n * sizeof *tree->level);
    memcpy(bigger.strikes, tree->strikes, n * sizeof *tree->strikes);
    memcpy(bigger.parent, tree->parent, n * sizeof *tree->parent);
    memcpy(bigger.child, tree->child, n * sizeof *tree->child);
    memcpy(bigger.slot, tree->slot, n * sizeof *tree->slot);
    memcpy(bigger.pos, tree->pos, n * sizeof *tree->pos);
    bigger.node_count = tree->node_count;
    bigger.leaf_count = tree->leaf_count;
    bigger.leaf = tree->leaf;
    tree->leaf = NULL;
    cln_octree_free(tree);
    *tree = bigger;
done:
    return st;
}

static cln_status change_alloc(int count, cln_octree_change *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_alloc(&out->from, (size_t)count, sizeof *out->from, "change of the octree"));
    CLN_TRY(cln_alloc(&out->octant, (size_t)count, sizeof *out->octant, "change of the octree"));
    out->count = count;
done:
    if (st != CLN_OK)
        cln_octree_change_free(out);
    return st;
}

cln_status cln_octree_change_join(cln_octree_change *change, const cln_octree_change *next)
{
    cln_status st = CLN_OK;
    cln_octree_change both = {0};

    CLN_TRY(change_alloc(next->count, &both));
    for (int s = 0; s < next->count; s++) {
        const int between = next->from[s];

        CLN_ASSERT(between < change->count);
        CLN_ASSERT(next->octant[s] == CLN_COPIED || change->octant[between] == CLN_COPIED);
        both.from[s] = change->from[between];
        both.octant[s] = next->octant[s] == CLN_COPIED ? change->octant[between] : next->octant[s];
    }
    cln_octree_change_free(change);
    *change = both;
done:
    return st;
}

/* Gives a leaf eight ACTIVE children, for which there is room; renumber() still needs its slot. */
static void add_children(cln_octree *tree, int node)
{
    int first = tree->node_count;

    for (int i = 0; i < 8; i++) {
        int c = first + i;
        tree->state[c] = CLN_NODE_ACTIVE;
        tree->level[c] = (uint8_t)(tree->level[node] + 1);
        tree->strikes[c] = 0;
        tree->parent[c] = node;
        tree->child[c] = -1;
        tree->slot[c] = -1;
        for (int a = 0; a < 3; a++)
            tree->pos[c][a] = (uint16_t)(2 * tree->pos[node][a] + ((i >> a) & 1));
    }
    tree->node_count += 8;
    tree->state[node] = CLN_NODE_INNER;
    tree->strikes[node] = 0;
    tree->child[node] = first;
}

/* Appends the ACTIVE leaves under `node` to leaf[] in Morton order; returns the new count. */
static int collect(const cln_octree *tree, int node, int32_t *leaf, int count)
{
    if (tree->state[node] == CLN_NODE_ACTIVE)
        leaf[count++] = node;
    else if (tree->state[node] == CLN_NODE_INNER)
        for (int i = 0; i < 8; i++)
            count = collect(tree, tree->child[node] + i, leaf, count);
    return count;
}

/* The slot of a new leaf that comes from no old one, until renumber(). */
enum { FRESH_SLOT = -2 };

/* Numbers the leaves anew into `leaf`, which the tree takes over (it has room for all), and writes
 * into `change` (may be NULL) where each comes from: its own old slot or its parent's, or none. */
static void renumber(cln_octree *tree, int32_t *leaf, cln_octree_change *change)
{
    free(tree->leaf);
    tree->leaf = leaf;
    tree->leaf_count = collect(tree, 0, leaf, 0);
    for (int s = 0; change && s < tree->leaf_count; s++) {
        int node = leaf[s], old = tree->slot[node];
        if (old >= 0) {
            change->from[s] = old;
            change->octant[s] = CLN_COPIED;
        } else if (old == FRESH_SLOT) {
            change->from[s] = s > 0 ? change->from[s - 1] : 0;
            change->octant[s] = CLN_FRESH;
        } else {
            int parent = tree->parent[node];
            change->from[s] = tree->slot[parent];
            change->octant[s] = (int8_t)(node - tree->child[parent]);
        }
    }
    for (int i = 0; i < tree->node_count; i++)
        tree->slot[i] = -1;
    for (int s = 0; s < tree->leaf_count; s++)
        tree->slot[leaf[s]] = s;
}

cln_status cln_octree_create(int level, cln_octree *out)
{
    cln_status st = CLN_OK;
    int32_t *leaf = NULL;
    int nodes = 1, first = 0;

    memset(out, 0, sizeof *out);
    if (level < 0 || level > CLN_MAX_LEVEL)
        return cln_fail(CLN_USAGE, "octree level %d is not in 0..%d", level, CLN_MAX_LEVEL);
    for (int l = 1; l <= level; l++)
        nodes += 1 << (3 * l);
    CLN_TRY(tree_alloc(nodes, out));
    CLN_TRY(cln_alloc(&leaf, (size_t)1 << (3 * level), sizeof *leaf, "octree leaves"));
    out->node_count = 1;
    out->state[0] = CLN_NODE_ACTIVE;
    out->parent[0] = out->child[0] = out->slot[0] = -1;
    for (int l = 0; l < level; l++) {
        int end = out->node_count;
        while (first < end)
            add_children(out, first++);
    }
    renumber(out, leaf, NULL);
    leaf = NULL;
done:
    free(leaf);
    if (st != CLN_OK)
        cln_octree_free(out);
    return st;
}

cln_status cln_octree_split(cln_octree *tree, const uint8_t *split, cln_octree_change *change)
{
    cln_status st = CLN_OK;
    int32_t *leaf = NULL;
    int splits = 0, leaves = 0;

    memset(change, 0, sizeof *change);
    for (int s = 0; s < tree->leaf_count; s++)
        splits += (!split || split[s]) && tree->level[tree->leaf[s]] < CLN_MAX_LEVEL;
    leaves = tree->leaf_count + 7 * splits;
    CLN_TRY(cln_alloc(&leaf, (size_t)leaves, sizeof *leaf, "octree leaves"));
    CLN_TRY(reserve(tree, 8 * splits));
    CLN_TRY(change_alloc(leaves, change));
    for (int s = 0; s < tree->leaf_count; s++)
        if ((!split || split[s]) && tree->level[tree->leaf[s]] < CLN_MAX_LEVEL)
            add_children(tree, tree->leaf[s]);
    renumber(tree, leaf, change);
    leaf = NULL;
done:
    free(leaf);
    return st;
}

cln_status cln_octree_cull(cln_octree *tree, const uint8_t *cull, cln_octree_change *change)
{
    cln_status st = CLN_OK;
    int32_t *leaf = NULL;
    int left = 0;

    memset(change, 0, sizeof *change);
    for (int s = 0; s < tree->leaf_count; s++)
        left += !cull[s];
    CLN_TRY(cln_alloc(&leaf, (size_t)left, sizeof *leaf, "octree leaves"));
    CLN_TRY(change_alloc(left, change));
    for (int s = 0; s < tree->leaf_count; s++)
        if (cull[s])
            tree->state[tree->leaf[s]] = CLN_NODE_CULLED;
    /* Backwards, children before their parents, so that collapses go on upwards. */
    for (int i = tree->node_count - 1; i >= 0; i--) {
        int culled = 0;
        if (tree->state[i] != CLN_NODE_INNER)
            continue;
        for (int c = 0; c < 8; c++)
            culled += tree->state[tree->child[i] + c] == CLN_NODE_CULLED;
        if (culled == 8) {
            tree->state[i] = CLN_NODE_CULLED;
            tree->child[i] = -1;
        }
    }
    renumber(tree, leaf, change);
    leaf = NULL;
done:
    free(leaf);
    return st;
}

cln_status cln_octree_cull_after(cln_octree *tree, const uint8_t *cull, cln_octree_change *change)
{
    cln_status st = CLN_OK;
    cln_octree_change culls = {0};

    CLN_TRY(cln_octree_cull(tree, cull, &culls));
    CLN_TRY(cln_octree_change_join(change, &culls));
done:
    cln_octree_change_free(&culls);
    return st;
}

/* Marked cells that cln_octree_regrow() makes leaves of. */
typedef struct regrowth {
    const cln_marks *marks;
    int level, core_level;
    const uint8_t *empty; /* [old slot] */
} regrowth;

static bool has_marked(const cln_octree *tree, int node, const regrowth *g)
{
    const int cell[3] = {tree->pos[node][0], tree->pos[node][1], tree->pos[node][2]};

    return cln_marks_meet(g->marks, tree->level[node], cell);
}

bool cln_octree_in_middle(const cln_octree *tree, int node)
{
    const int quarter = tree->level[node] - 2;

    for (int a = 0; a < 3 && quarter >= 0; a++) {
        const int at = tree->pos[node][a] >> quarter;

        if (at == 0 || at == 3)
            return false;
    }
    return quarter >= 0;
}

static cln_status regrow_under(cln_octree *tree, int node, const regrowth *g)
{
    cln_status st = CLN_OK;

    if (tree->state[node] != CLN_NODE_INNER && !has_marked(tree, node, g))
        return CLN_OK;
    if (tree->state[node] == CLN_NODE_ACTIVE) {
        if (g->empty[tree->slot[node]])
            tree->slot[node] = FRESH_SLOT; /* strikes stay: the next culling may take it back */
        return CLN_OK;
    }
    if (tree->state[node] == CLN_NODE_CULLED &&
        tree->level[node] >= (cln_octree_in_middle(tree, node) ? g->core_level : g->level)) {
        tree->state[node] = CLN_NODE_ACTIVE;
        tree->strikes[node] = 0;
        tree->slot[node] = FRESH_SLOT;
        tree->leaf_count++;
        return CLN_OK;
    }
    if (tree->state[node] == CLN_NODE_CULLED) {
        if (tree->node_capacity - tree->node_count < 8) /* a copy of the tree, so not each time */
            CLN_TRY(reserve(tree, 8 + tree->node_count / 2));
        add_children(tree, node);
        for (int i = 0; i < 8; i++)
            tree->state[tree->child[node] + i] = CLN_NODE_CULLED;
    }
    for (int i = 0; i < 8; i++)
        CLN_TRY(regrow_under(tree, tree->child[node] + i, g));
done:
    return st;
}

cln_status cln_octree_regrow(cln_octree *tree, const cln_marks *marks, int level, int core_level,
                             const uint8_t *empty, cln_octree_change *change)
{
    cln_status st = CLN_OK;
    const regrowth g = {marks, level, core_level, empty};
    int32_t *leaf = NULL;

    memset(change, 0, sizeof *change);
    CLN_TRY(regrow_under(tree, 0, &g)); /* counts the leaves */
    CLN_TRY(cln_alloc(&leaf, (size_t)tree->leaf_count, sizeof *leaf, "octree leaves"));
    CLN_TRY(change_alloc(tree->leaf_count, change));
    renumber(tree, leaf, change);
    leaf = NULL;
done:
    free(leaf);
    return st;
}

bool cln_octree_can_merge(const cln_octree *tree, int slot)
{
    int parent = tree->parent[tree->leaf[slot]];

    if (parent < 0)
        return false;
    for (int i = 0; i < 8; i++)
        if (tree->state[tree->child[parent] + i] == CLN_NODE_INNER)
            return false;
    return true;
}

/* The heaviest ACTIVE one of eight siblings, the first of equals. */
static int heaviest(const cln_octree *tree, int first, const float *weight)
{
    int best = -1;

    for (int c = first; c < first + 8; c++)
        if (tree->state[c] == CLN_NODE_ACTIVE &&
            (best < 0 || weight[tree->slot[c]] > weight[tree->slot[best]]))
            best = c;
    return best;
}

cln_status cln_octree_merge(cln_octree *tree, const uint8_t *merge, const float *weight,
                            cln_octree_change *change)
{
    cln_status st = CLN_OK;
    int32_t *leaf = NULL;
    int8_t *octant = NULL; /* [node] of the heaviest child of a merged node, -1 of others */
    int old_count = tree->leaf_count, left = 0;

    memset(change, 0, sizeof *change);
    CLN_TRY(cln_alloc(&leaf, (size_t)old_count, sizeof *leaf, "octree leaves"));
    CLN_TRY(cln_alloc(&octant, (size_t)tree->node_count, sizeof *octant, "octree leaves"));
    memset(octant, -1, (size_t)tree->node_count * sizeof *octant);
    for (int s = 0; s < old_count; s++) {
        int node = tree->leaf[s];

        if (merge[s] && !cln_octree_can_merge(tree, s))
            CLN_TRY(cln_fail(CLN_INTERNAL, "octree leaf %d cannot be merged", s));
        if (merge[s] && octant[tree->parent[node]] < 0) {
            int parent = tree->parent[node], first = tree->child[parent];
            octant[parent] = (int8_t)(heaviest(tree, first, weight) - first);
        }
    }
    for (int s = 0; s < old_count; s++) {
        int parent = tree->parent[tree->leaf[s]];
        left += parent < 0 || octant[parent] < 0;
    }
    for (int i = 0; i < tree->node_count; i++)
        left += octant[i] >= 0;
    CLN_TRY(change_alloc(left, change));
    for (int i = 0; i < tree->node_count; i++) {
        if (octant[i] < 0)
            continue;
        tree->slot[i] = tree->slot[tree->child[i] + octant[i]];
        for (int c = 0; c < 8; c++)
            tree->state[tree->child[i] + c] = CLN_NODE_CULLED;
        tree->state[i] = CLN_NODE_ACTIVE;
        tree->strikes[i] = 0;
        tree->child[i] = -1;
    }
    renumber(tree, leaf, change);
    leaf = NULL;
    for (int s = 0; s < tree->leaf_count; s++)
        if (octant[tree->leaf[s]] >= 0)
            change->octant[s] = (int8_t)(CLN_MERGED - octant[tree->leaf[s]]);
done:
    free(leaf);
    free(octant);
    return st;
}

cln_status cln_octree_copy(const cln_octree *tree, cln_octree *out)
{
    cln_status st = CLN_OK;
    int32_t *rows = NULL;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_octree_pack(tree, &rows));
    CLN_TRY(cln_octree_unpack(rows, tree->node_count, out));
done:
    free(rows);
    return st;
}

int cln_octree_depth(const cln_octree *tree)
{
    int depth = 0;

    for (int s = 0; s < tree->leaf_count; s++)
        if (tree->level[tree->leaf[s]] > depth)
            depth = tree->level[tree->leaf[s]];
    return depth;
}

cln_status cln_octree_most_intervals(const cln_octree *tree, int *most)
{
    cln_status st = CLN_OK;
    const int depth = cln_octree_depth(tree), planes = (1 << depth) + 1;
    uint8_t *met = NULL; /* [axis][plane] */

    CLN_TRY(cln_alloc(&met, (size_t)(3 * planes), 1, "planes of leaves"));
    for (int s = 0; s < tree->leaf_count; s++)
        for (int a = 0; a < 3; a++) {
            const int node = tree->leaf[s], finer = depth - tree->level[node];

            met[a * planes + (tree->pos[node][a] << finer)] = 1;
            met[a * planes + ((tree->pos[node][a] + 1) << finer)] = 1;
        }
    *most = 0;
    for (int i = 0; i < 3 * planes; i++)
        *most += met[i];
    if (*most > 3 << depth) /* a line meets no more cells of a whole level */
        *most = 3 << depth;
done:
    free(met);
    return st;
}

int cln_octree_find(const cln_octree *tree, const double point[3])
{
    double centre[3] = {0, 0, 0}, quarter = 0.5;
    int node = 0;

    for (int a = 0; a < 3; a++)
        if (!(point[a] >= -1 && point[a] <= 1))
            return -1;
    while (tree->state[node] == CLN_NODE_INNER) { /* centres are dyadic, so comparisons are exact */
        int octant = 0;
        for (int a = 0; a < 3; a++) {
            int upper = point[a] >= centre[a];
            octant |= upper << a;
            centre[a] += upper ? quarter : -quarter;
        }
        quarter /= 2;
        node = tree->child[node] + octant;
    }
    return tree->state[node] == CLN_NODE_ACTIVE ? tree->slot[node] : -1;
}

cln_status cln_octree_around(const cln_octree *tree, int32_t (**around)[CLN_AROUND])
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(around, (size_t)tree->leaf_count, sizeof **around, "neighbours of leaves"));
    for (int slot = 0; slot < tree->leaf_count; slot++) {
        const int node = tree->leaf[slot], level = tree->level[node];
        const double side = ldexp(2, -level);

        for (int i = 0; i < CLN_AROUND; i++) {
            const int step[3] = {i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1};
            double at[3];
            int found = -1;

            for (int a = 0; a < 3; a++)
                at[a] = (tree->pos[node][a] + step[a] + 0.5) * side - 1;
            found = cln_octree_find(tree, at);
            (*around)[slot][i] = found >= 0 && tree->level[tree->leaf[found]] == level ? found : -1;
        }
    }
done:
    return st;
}

void cln_octree_box(const cln_octree *tree, int node, float box[4])
{
    box[3] = 2.0f / (float)(1 << tree->level[node]);
    for (int a = 0; a < 3; a++)
        box[a] = -1 + box[3] * (float)tree->pos[node][a];
}

cln_status cln_octree_boxes(const cln_octree *tree, float **boxes)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(boxes, (size_t)tree->leaf_count, 4 * sizeof **boxes, "leaf boxes"));
    for (int s = 0; s < tree->leaf_count; s++)
        cln_octree_box(tree, tree->leaf[s], *boxes + 4 * (size_t)s);
done:
    return st;
}

cln_status cln_octree_pack(const cln_octree *tree, int32_t **rows)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(rows, (size_t)tree->node_count, ROW * sizeof **rows, "octree rows"));
    for (int i = 0; i < tree->node_count; i++) {
        int32_t *row = *rows + (size_t)ROW * i;
        row[ROW_STATE] = tree->state[i];
        row[ROW_LEVEL] = tree->level[i];
        row[ROW_STRIKES] = tree->strikes[i];
        row[ROW_PARENT] = tree->parent[i];
        row[ROW_CHILD] = tree->child[i];
        for (int a = 0; a < 3; a++)
            row[ROW_POS + a] = tree->pos[i][a];
    }
done:
    return st;
}

/* Describes the defect of node i, or NULL; all nodes before it must be sound. */
static const char *row_defect(const int32_t *rows, int node_count, int i)
{
    const int32_t *row = rows + (size_t)ROW * i, *parent = NULL;
    int p = row[ROW_PARENT], c = row[ROW_CHILD], octant = (i - 1) % 8, linked = i == 0;

    if (row[ROW_STATE] < CLN_NODE_INNER || row[ROW_STATE] > CLN_NODE_CULLED)
        return "its state is not 0, 1 or 2";
    if (row[ROW_STRIKES] < 0 || row[ROW_STRIKES] > UINT8_MAX)
        return "its strikes are out of range";
    if (i == 0 && (p != -1 || row[ROW_LEVEL] != 0 || row[ROW_POS] != 0 || row[ROW_POS + 1] != 0 ||
                   row[ROW_POS + 2] != 0))
        return "it is not a root";
    if (i > 0) {
        if (p < 0 || p >= i - octant)
            return "its parent is out of range";
        parent = rows + (size_t)ROW * p;
        linked = parent[ROW_CHILD] == i - octant;
        if (row[ROW_LEVEL] != parent[ROW_LEVEL] + 1 || row[ROW_LEVEL] > CLN_MAX_LEVEL)
            return "its level does not follow its parent's";
        for (int a = 0; a < 3; a++)
            if (row[ROW_POS + a] != 2 * parent[ROW_POS + a] + ((octant >> a) & 1))
                return "its position does not follow its parent's";
    }
    if (!linked && row[ROW_STATE] != CLN_NODE_CULLED)
        return "it hangs on no parent";
    if ((row[ROW_STATE] == CLN_NODE_INNER) != (c != -1))
        return "its children do not agree with its state";
    if (c != -1) {
        int culled = 0;
        if (c <= i || c % 8 != 1 || c > node_count - 8)
            return "its children are out of range";
        for (int k = 0; k < 8; k++) {
            const int32_t *child = rows + (size_t)ROW * (c + k);
            if (child[ROW_PARENT] != i)
                return "its children name another parent";
            culled += child[ROW_STATE] == CLN_NODE_CULLED;
        }
        if (culled == 8)
            return "all its children are culled";
    }
    return NULL;
}

cln_status cln_octree_unpack(const int32_t *rows, int node_count, cln_octree *out)
{
    cln_status st = CLN_OK;
    int32_t *leaf = NULL;
    int leaves = 0;

    memset(out, 0, sizeof *out);
    if (node_count < 1 || node_count % 8 != 1)
        return cln_fail(CLN_CHECKPOINT, "octree of %d nodes: not one root and groups of eight",
                        node_count);
    for (int i = 0; i < node_count; i++) {
        const char *defect = row_defect(rows, node_count, i);
        if (defect)
            return cln_fail(CLN_CHECKPOINT, "octree node %d of %d: %s", i, node_count, defect);
        leaves += rows[(size_t)ROW * i + ROW_STATE] == CLN_NODE_ACTIVE;
    }
    CLN_TRY(tree_alloc(node_count, out));
    CLN_TRY(cln_alloc(&leaf, (size_t)leaves, sizeof *leaf, "octree leaves"));
    out->node_count = node_count;
    for (int i = 0; i < node_count; i++) {
        const int32_t *row = rows + (size_t)ROW * i;
        out->state[i] = (uint8_t)row[ROW_STATE];
        out->level[i] = (uint8_t)row[ROW_LEVEL];
        out->strikes[i] = (uint8_t)row[ROW_STRIKES];
        out->parent[i] = row[ROW_PARENT];
        out->child[i] = row[ROW_CHILD];
        out->slot[i] = -1;
        for (int a = 0; a < 3; a++)
            out->pos[i][a] = (uint16_t)row[ROW_POS + a];
    }
    renumber(out, leaf, NULL);
    leaf = NULL;
done:
    free(leaf);
    if (st != CLN_OK)
        cln_octree_free(out);
    return st;
}
