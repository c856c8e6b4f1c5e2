/* needs: leaves */
/* Carries rows of leaves over a change of the tree, from arrays of the old leaves to those of the
 * new ones (host/pipeline/carry.c; the host's twin is cln_model_apply). A group takes a leaf.
 *
 *   places[leaf] = (old leaf, octant): octant -1: the same leaf; k >= 0: child k of the old leaf;
 *                  -2 - k: the parent of the old leaf, its child k; -10: a leaf without an old one
 *
 * SG  work-items of a group
 */
#ifndef SG
#define SG 4
#endif

/* Weights and moments, rows of `row` times 16 bytes: copied for the same leaf, zeros for a new
 * one. */
__kernel __attribute__((reqd_work_group_size(SG, 1, 1))) void
carry_rows(LEAF_ARRAY(const uint4, from), LEAF_ARRAY(uint4, to), /* [leaf][row] */
           const __global int2 *restrict places, uint row)
{
    const uint leaf = get_group_id(0);
    const int2 place = places[leaf];
    const __global uint4 *old = LEAF_ROW(from, place.x, row);
    __global uint4 *new = LEAF_ROW(to, leaf, row);

    for (uint i = get_local_id(0); i < row; i += SG)
        new[i] = place.y == -1 ? old[i] : (uint4)(0u);
}

/* Cell of the old leaf's grid nearest to cell `at` of the new one's, along an axis. upper: the
 * child's half of the parent. */
HELPER uint nearest(uint at, uint n1, int octant, uint upper)
{
    if (octant == -1)
        return at;
    if (octant >= 0)
        return (2u * at + 1u + 2u * n1 * upper) / 4u;
    return (uint)clamp((int)(2u * at + 1u) - (int)(upper * n1), 0, (int)n1 - 1);
}

/* Stage 1's densities: those of the nearest cells, or 0. */
__kernel __attribute__((reqd_work_group_size(SG, 1, 1))) void
carry_densities(LEAF_ARRAY(const ushort, from), /* [leaf][n1 z][n1 y][n1 x] */
                LEAF_ARRAY(ushort, to),
                const __global int2 *restrict places, uint n1)
{
    const uint leaf = get_group_id(0), cells = n1 * n1 * n1;
    const int2 place = places[leaf];
    const uint child = (uint)(place.y >= 0 ? place.y : -2 - place.y);
    const __global ushort *old = LEAF_ROW(from, place.x, cells);
    __global ushort *new = LEAF_ROW(to, leaf, cells);

    for (uint i = get_local_id(0); i < cells; i += SG) {
        const uint x = nearest(i % n1, n1, place.y, child & 1u);
        const uint y = nearest(i / n1 % n1, n1, place.y, child >> 1 & 1u);
        const uint z = nearest(i / (n1 * n1), n1, place.y, child >> 2 & 1u);

        new[i] = place.y == -10 ? (ushort)0 : old[(z * n1 + y) * n1 + x];
    }
}
