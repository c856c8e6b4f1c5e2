/* Leaves of voxels (method.md section 1): no layers, but a grid of [cells + 1]^3 vertices (z, y, x)
 * of `features` numbers: red, green, blue, density, then red, green, blue of each further spherical
 * harmonic; all before their activations. Each leaf has its own copy of the vertices on its faces.
 * There are no merges. Kernels: kernels/voxel.cl; float64 twin:
 * host/reference/voxel.c. */
#ifndef CLN_ENCODING_VOXEL_H
#define CLN_ENCODING_VOXEL_H

#include "model/network.h"
#include "model/octree.h"

/* The split: a child's numbers are those of its parent where that has a vertex, and means of its
 * nearest ones between these; in float32 and in the order of kernels/voxel.cl, with the same bits.
 * octant: x is bit 0. */
void cln_voxel_split(const cln_network *net, int octant, const float *parent, float *child);

/* Whose numbers hold at a common vertex after a change of the tree, the lowest first: 0 of a leaf
 * that stayed, 1 of one that a split made, 2 of one that begins anew. octant: the leaf's in the
 * change. */
static inline int cln_voxel_grade(int8_t octant)
{
    return octant == CLN_COPIED ? 0 : octant == CLN_FRESH ? 2 : 1;
}

/* After a change of the tree: gives leaves of one size the same numbers at common vertices, those
 * of the lowest grade; of several, the first in the order of cln_octree_around. params:
 * [leaf][params]. CLN_MEMORY. */
cln_status cln_voxel_join(const cln_network *net, const cln_octree *tree,
                          const cln_octree_change *change, float *params);

#endif
