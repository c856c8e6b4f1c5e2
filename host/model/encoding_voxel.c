/* Voxels at a split, and their common vertices after it. See encoding_voxel.h. */
#include "model/encoding_voxel.h"

#include <stdlib.h>
#include <string.h>

/* Coordinate of direction i, 0 .. 26, along an axis: -1, 0 or 1. */
static int direction(int i, int axis)
{
    return (axis == 0 ? i : axis == 1 ? i / 3 : i / 9) % 3 - 1;
}

/* The number that a leaf's vertex `at` has in its neighbour `i`, or -1 if the neighbour lacks
 * it. */
static int vertex_in(int cells, const int at[3], int i)
{
    int there = 0;

    for (int a = 2; a >= 0; a--) {
        const int x = at[a] - direction(i, a) * cells;

        if (x < 0 || x > cells)
            return -1;
        there = there * (cells + 1) + x;
    }
    return there;
}

void cln_voxel_split(const cln_network *net, int octant, const float *parent, float *child)
{
    const int side = net->cells + 1;

    memset(child, 0, (size_t)net->params * sizeof *child);
    for (int v = 0; v < side * side * side; v++) {
        const int at[3] = {(octant & 1 ? net->cells : 0) + v % side,
                           (octant & 2 ? net->cells : 0) + v / side % side,
                           (octant & 4 ? net->cells : 0) + v / side / side};

        for (int f = 0; f < net->features; f++) {
            float n[8];

            for (int c = 0; c < 8; c++)
                n[c] =
                    parent[((((at[2] + (c >> 2)) / 2) * side + (at[1] + (c >> 1 & 1)) / 2) * side +
                            (at[0] + (c & 1)) / 2) *
                               net->features +
                           f];
            child[v * net->features + f] =
                0.125f * (((n[0] + n[1]) + (n[2] + n[3])) + ((n[4] + n[5]) + (n[6] + n[7])));
        }
    }
}

cln_status cln_voxel_join(const cln_network *net, const cln_octree *tree,
                          const cln_octree_change *change, float *params)
{
    cln_status st = CLN_OK;
    const int side = net->cells + 1;
    const size_t bytes = (size_t)net->features * sizeof *params;
    int32_t(*around)[CLN_AROUND] = NULL;

    CLN_TRY(cln_octree_around(tree, &around));
    for (int slot = 0; slot < change->count; slot++)
        for (int v = 0; cln_voxel_grade(change->octant[slot]) > 0 && v < side * side * side; v++) {
            const int at[3] = {v % side, v / side % side, v / side / side};
            int best = -1, vertex = v;

            for (int i = 0; i < CLN_AROUND; i++) {
                const int other = around[slot][i], there = vertex_in(net->cells, at, i);

                if (other < 0 || there < 0 ||
                    (best >= 0 && cln_voxel_grade(change->octant[other]) >=
                                      cln_voxel_grade(change->octant[best])))
                    continue;
                best = other;
                vertex = there;
            }
            if (best != slot)
                memcpy(params + (size_t)slot * (size_t)net->params + v * net->features,
                       params + (size_t)best * (size_t)net->params + vertex * net->features, bytes);
        }
done:
    free(around);
    return st;
}
