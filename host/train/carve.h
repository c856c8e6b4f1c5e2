/* Finds leaves that are empty by geometry alone, before training: those that too few training views
 * see (--seen-by), where leaves could paint what a single photo shows, and those of the cube
 * outside the scene's box (--slab): regrow.h brings none of them back; and those far from all
 * sparse points (--points-near). */
#ifndef CLN_CARVE_H
#define CLN_CARVE_H

#include "model/octree.h"
#include "scene/scene.h"

/* Marks such leaves; the caller frees *marks [slot]. *count: how many; 0 if it would be all. whole:
 * the tree is of whole levels, so that --points-near applies, too. CLN_MEMORY. */
cln_status cln_carve_find(const cln_scene *scene, const cln_space *space, const cln_config *config,
                          const cln_octree *tree, bool whole, uint8_t **marks, int *count);

/* Right after a change of the tree: culls such leaves, or `fresh` only those of them that the
 * change brought back (CLN_FRESH), as a part of it. *count: how many. CLN_MEMORY. */
cln_status cln_carve_after(const cln_scene *scene, const cln_space *space, const cln_config *config,
                           bool fresh, cln_octree *tree, cln_octree_change *change, int *count);

#endif
