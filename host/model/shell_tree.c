/* The tree of a shell space. See shell_tree.h. */
#include "model/shell_tree.h"

#include <math.h>
#include <stdlib.h>
#include "base/memory.h"

enum { FACES = 6, CORE = 6, PIECES = 7, LINES = 6 };

bool cln_shell_holds(const double cube[3])
{
    int outside = 0;

    for (int a = 0; a < 3; a++)
        outside += fabs(cube[a]) > 0.5;
    return outside < 2;
}

/* The piece of a node of level 2 or deeper: a face, 2 axis + (0 or 1), or CORE; -1: none. */
static int piece_of(const cln_octree *tree, int node)
{
    const int quarter = tree->level[node] - 2;
    int piece = CORE;

    for (int a = 0; a < 3; a++) {
        const int at = tree->pos[node][a] >> quarter;

        if (at == 1 || at == 2)
            continue;
        if (piece != CORE)
            return -1;
        piece = 2 * a + (at == 3);
    }
    return piece;
}

cln_status cln_shell_tree_create(int level, cln_octree *out)
{
    cln_status st = CLN_OK;
    cln_octree_change change = {0};
    uint8_t *marks = NULL;

    CLN_TRY(cln_octree_create(2, out));
    CLN_TRY(cln_alloc(&marks, (size_t)out->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < out->leaf_count; s++)
        marks[s] = piece_of(out, out->leaf[s]) < 0;
    CLN_TRY(cln_octree_cull(out, marks, &change));
    cln_octree_change_free(&change);
    for (int s = 0; s < out->leaf_count; s++)
        marks[s] = cln_octree_in_middle(out, out->leaf[s]);
    CLN_TRY(cln_octree_split(out, marks, &change));
    for (int l = 2; l < level; l++) {
        cln_octree_change_free(&change);
        CLN_TRY(cln_octree_split(out, NULL, &change));
    }
done:
    cln_octree_change_free(&change);
    free(marks);
    if (st != CLN_OK)
        cln_octree_free(out);
    return st;
}

cln_status cln_shell_tree_most_intervals(const cln_octree *tree, int *most)
{
    cln_status st = CLN_OK;
    const int depth = cln_octree_depth(tree), planes = (1 << depth) + 1;
    uint8_t *met = NULL; /* [piece][axis][plane] */
    int counts[PIECES] = {0}, least = 0;

    CLN_TRY(cln_alloc(&met, (size_t)(PIECES * 3 * planes), 1, "planes of leaves"));
    for (int s = 0; s < tree->leaf_count; s++) {
        const int node = tree->leaf[s], finer = depth - tree->level[node];
        const bool in_all = tree->level[node] < 2; /* it has parts of several */

        for (int i = 0; i < PIECES * 3; i++) {
            uint8_t *row = met + i * planes;

            if (!in_all && piece_of(tree, node) != i / 3)
                continue;
            row[tree->pos[node][i % 3] << finer] = 1;
            row[(tree->pos[node][i % 3] + 1) << finer] = 1;
        }
    }
    for (int i = 0; i < PIECES * 3 * planes; i++)
        counts[i / (3 * planes)] += met[i];
    *most = 0;
    for (int i = 0; i < PIECES; i++) {
        *most += counts[i];
        least = i < FACES && counts[i] < counts[least] ? i : least;
    }
    *most -= counts[least];
    if (*most > cln_shell_most_intervals(depth))
        *most = (int)cln_shell_most_intervals(depth);
done:
    free(met);
    return st;
}

/* A ray is at most LINES straight lines in the cube of side 2, whose extents along the three axes
 * add up to at most 4. Outside the core, q = u / max |u_a| follows half of a convex polygon, the
 * section of a cube of side 2 by the plane of ray and centre (in the core, a chord of it), so each
 * coordinate of q changes by at most 2, and that in the cube by 1; the outward coordinate, 1 - 1 /
 * (2 max |u_a|), falls and rises by at most 1/2. A line meets one cell more than it crosses planes,
 * and along each axis crosses at most one plane more than its extent has cells. */
double cln_shell_most_intervals(int level)
{
    return 2 * ldexp(1, level) + LINES * (1 + 3);
}
