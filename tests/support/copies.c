/* build/voxel-copies RUN: of the newest checkpoint of a run of voxels, how many vertices leaves of
 * one size have in common, and how many of these copies differ in a bit: "M copies, N differ". */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/status.h"
#include "model/model.h"

/* Counts the vertices that a leaf has in common with its neighbour at an offset of d sides. */
static void compare(const cln_model *m, int leaf, int other, const int d[3], long *all,
                    long *differ)
{
    const int cells = m->net.cells, side = cells + 1, features = m->net.features;
    const float *here = m->params + (size_t)leaf * (size_t)m->net.params;
    const float *there = m->params + (size_t)other * (size_t)m->net.params;

    for (int v = 0; v < side * side * side; v++) {
        const int at[3] = {v % side, v / side % side, v / side / side};
        int vertex = 0;
        bool common = true;

        for (int a = 2; a >= 0; a--) {
            const int x = at[a] - d[a] * cells;

            common &= x >= 0 && x <= cells;
            vertex = vertex * side + x;
        }
        if (!common)
            continue;
        *all += 1;
        *differ += memcmp(here + v * features, there + vertex * features,
                          (size_t)features * sizeof *here) != 0;
    }
}

int main(int argc, char **argv)
{
    cln_model model;
    int32_t(*around)[27] = NULL;
    long all = 0, differ = 0;

    if (argc != 2 || cln_checkpoint_read(argv[1], false, &model) != CLN_OK ||
        cln_octree_around(&model.tree, &around) != CLN_OK) {
        fprintf(stderr, "voxel-copies RUN: %s\n", cln_error_text());
        return 1;
    }
    for (int leaf = 0; leaf < model.tree.leaf_count; leaf++)
        for (int n = 14; n < 27; n++)
            if (around[leaf][n] >= 0)
                compare(&model, leaf, around[leaf][n],
                        (const int[3]){n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1}, &all, &differ);
    printf("%ld copies, %ld differ\n", all, differ);
    free(around);
    cln_model_free(&model);
    return 0;
}
