/* Which children a split of a leaf makes: of networks all eight; of voxels those that stage 1 shows
 * not to be empty, once culling has begun (method.md 12.2). */
#ifndef CLN_CHILDREN_H
#define CLN_CHILDREN_H

#include "train/trainer.h"

/* *children[slot]: bit i is set if child i is one; the caller frees it. asked[slot]: marks of
 * leaves, the others get all eight. Cached densities must be fresh. CLN_MEMORY, CLN_CL. */
cln_status cln_children_find(cln_trainer *t, const uint8_t *asked, uint8_t **children);

/* Number of children in such a set. */
int cln_children_count(uint8_t children);

/* Right after a split, culls the children that are none: children[node] of split leaves. *splits:
 * the split, which becomes both changes. CLN_MEMORY. */
cln_status cln_children_drop(cln_octree *tree, const uint8_t *children, cln_octree_change *splits);

#endif
