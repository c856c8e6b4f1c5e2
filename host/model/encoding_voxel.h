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

/* After a change of the tree: gives leaves of one size the same numbers at common vertices. Those
 * of leaves that stayed hold, then those of leaves that a split made, then those of leaves that
 * begin anew; of several, the first in the order of cln_octree_around. params: [leaf][params].
 * CLN_MEMORY. */
cln_status cln_voxel_join(const cln_network *net, const cln_octree *tree,
                          const cln_octree_change *change, float *params);

#endif
