/* The octree as the kernels read it, a dense map with boxes of empty cells. See octree.h. */
#include "model/octree.h"

#include <stdlib.h>
#include "base/memory.h"

/* Cells [low, high) of a node in the map at `depth`; if the node is smaller than a cell, the cell
 * that it is in. */
static void find_cells(const cln_octree *tree, int node, int depth, int low[3], int high[3])
{
    const int finer = depth - tree->level[node];

    for (int a = 0; a < 3; a++) {
        low[a] = finer >= 0 ? tree->pos[node][a] << finer : tree->pos[node][a] >> -finer;
        high[a] = low[a] + (finer > 0 ? 1 << finer : 1);
    }
}

static void fill_box(int32_t *map, int n, const int low[3], const int high[3], int32_t value)
{
    for (int z = low[2]; z < high[2]; z++)
        for (int y = low[1]; y < high[1]; y++)
            for (int x = low[0]; x < high[0]; x++)
                map[cln_cell_at(x, y, z, n)] = value;
}

/* Turns zeros, sums[z][y][x] of (n + 1)^3, into the number of cells with a leaf below (x, y, z):
 * its values at the eight corners of a box then tell whether the box is empty. */
static void sum_up(const cln_octree *tree, int depth, int32_t *sums)
{
    const int n = 1 << depth;
    int low[3], high[3];

    for (int s = 0; s < tree->leaf_count; s++) {
        find_cells(tree, tree->leaf[s], depth, low, high);
        for (int z = low[2]; z < high[2]; z++)
            for (int y = low[1]; y < high[1]; y++)
                for (int x = low[0]; x < high[0]; x++)
                    sums[cln_cell_at(x + 1, y + 1, z + 1, n + 1)] = 1;
    }
    for (int z = 1; z <= n; z++)
        for (int y = 1; y <= n; y++) {
            int32_t row = 0;

            for (int x = 1; x <= n; x++) {
                int32_t *here = &sums[cln_cell_at(x, y, z, n + 1)];

                row += *here;
                *here = row + sums[cln_cell_at(x, y - 1, z, n + 1)] +
                        sums[cln_cell_at(x, y, z - 1, n + 1)] -
                        sums[cln_cell_at(x, y - 1, z - 1, n + 1)];
            }
        }
}

static bool is_empty(const int32_t *sums, int n, const int low[3], const int high[3])
{
    int32_t cells = 0;

    for (int corner = 0; corner < 8; corner++) {
        const int x = corner & 1 ? high[0] : low[0], y = corner & 2 ? high[1] : low[1];
        const int z = corner & 4 ? high[2] : low[2],
                  sign = __builtin_popcount((unsigned)corner) & 1;

        cells += (sign ? 1 : -1) * sums[cln_cell_at(x, y, z, n + 1)];
    }
    return cells == 0;
}

/* Grows an empty box by a layer of cells on each side in turn, until none can grow. */
static void grow_box(const int32_t *sums, int n, int low[3], int high[3])
{
    for (int side = 0, stuck = 0; stuck < 6; side = (side + 1) % 6) {
        int *end = side < 3 ? &low[side] : &high[side - 3];
        const int was = *end;

        *end += side < 3 ? -1 : 1;
        if (*end < 0 || *end > n || !is_empty(sums, n, low, high)) {
            *end = was;
            stuck++;
        } else {
            stuck = 0;
        }
    }
}

/* Fills in boxes for the culled nodes from `node` down; it descends because the arrays also have
 * unreachable nodes. */
static void fill_empty(const cln_octree *tree, int node, int depth, const int32_t *sums,
                       int32_t *map)
{
    const int n = 1 << depth, boxes = depth - CLN_MAP_UNIT(depth);
    int low[3], high[3], from[3], to[3];
    uint32_t entry = CLN_MAP_NODE(tree->level[node]);

    if (tree->state[node] == CLN_NODE_INNER)
        for (int i = 0; i < 8; i++)
            fill_empty(tree, tree->child[node] + i, depth, sums, map);
    if (tree->state[node] != CLN_NODE_CULLED)
        return;
    find_cells(tree, node, depth, low, high);
    if (tree->level[node] <= boxes) {
        find_cells(tree, node, boxes, from, to);
        grow_box(sums, 1 << boxes, from, to);
        entry = CLN_MAP_EMPTY | CLN_MAP_BOX(from, 0) | CLN_MAP_BOX(to, 1);
    }
    fill_box(map, n, low, high, (int32_t)entry);
}

cln_status cln_octree_map(const cln_octree *tree, int depth, int32_t **map)
{
    cln_status st = CLN_OK;
    const int n = 1 << depth, boxes = depth - CLN_MAP_UNIT(depth);
    const size_t corners =
        (size_t)((1 << boxes) + 1) * (size_t)((1 << boxes) + 1) * (size_t)((1 << boxes) + 1);
    int32_t *sums = NULL;
    int low[3], high[3];

    *map = NULL;
    /* The deepest leaf is ACTIVE: eight culled siblings become one culled node. */
    if (depth < cln_octree_depth(tree) || depth > CLN_MAX_LEVEL)
        return cln_fail(CLN_INTERNAL, "octree map at level %d: leaves go down to level %d", depth,
                        cln_octree_depth(tree));
    CLN_TRY(cln_alloc(map, (size_t)n * (size_t)n * (size_t)n, sizeof **map, "octree map"));
    CLN_TRY(cln_alloc(&sums, corners, sizeof *sums, "octree map"));
    for (int s = 0; s < tree->leaf_count; s++) {
        const int node = tree->leaf[s];

        find_cells(tree, node, depth, low, high);
        fill_box(*map, n, low, high, CLN_MAP_LEAF(s, tree->level[node]));
    }
    sum_up(tree, boxes, sums);
    fill_empty(tree, 0, depth, sums, *map);
done:
    free(sums);
    if (st != CLN_OK) {
        free(*map);
        *map = NULL;
    }
    return st;
}
