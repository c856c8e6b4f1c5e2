/* Training of voxels by ranks: vertices that leaves of several ranks have. The leaf that steps for
 * all, the first of those around a vertex (kernels/voxel.cl), is its owner; a leaf of another rank
 * has a copy, and a link to the owner. These gradients and weights are all that travel in a step:
 *
 *   gradients  of copies that samples met, to the owner's rank: each leaf's sum over its slices, so
 *              that sums are those of one rank bit for bit
 *   values     of vertices that samples met in any leaf, from there to the copies, which stay equal
 *              bit for bit
 *
 * Moments are with the owner alone. Of networks, and without other ranks, nothing is done. */
#ifndef CLN_HALO_H
#define CLN_HALO_H

#include "pipeline/pipeline.h"

/* Whether ranks have vertices in common: of several, and of leaves that are joined. */
bool cln_halo_is_linked(const cln_pipeline *p);

/* Finds the links, if tree or ranks of leaves have changed since. *slices: gradients that others
 * may send in a step, for which p->grads and p->met need room beside those of the backward pass. */
cln_status cln_halo_room(cln_pipeline *p, size_t *slices);

/* Of each rank, for a deal of the tree's leaves: links of both directions in a step, about as many
 * as of one at a change of the tree; leaves of other ranks with vertices that are its own. first:
 * [ranks + 1], as p->rank_first; links, far: [CLN_RANKS_MOST]. 0 for networks, and without other
 * ranks. */
cln_status cln_halo_count(const cln_pipeline *p, const cln_octree *tree, const int *first,
                          int64_t *links, int *far);

/* Between the backward pass, which made `slices` slices (or fewer), and the update: brings
 * gradients to owners, in slices from there on. */
cln_status cln_halo_gradients(cln_pipeline *p, uint32_t slices);
/* After the update: brings new numbers to copies. */
cln_status cln_halo_values(cln_pipeline *p);

/* After a change of the tree, before voxel_join, by which numbers hold that are another leaf's:
 * brings those of other ranks' leaves. octant: the change's. */
cln_status cln_halo_join(cln_pipeline *p, const int8_t *octant);

/* The decoder's gradients of all ranks, one each, in place of those of groups of slices. */
cln_status cln_halo_decoder(cln_pipeline *p);

#endif
