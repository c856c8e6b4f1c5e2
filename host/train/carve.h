/* Which leaves are empty before anything is trained: those that too few training views see
 * (--seen-by), where what one photo shows alone could be painted, and those outside the box of the
 * scene (--slab), which its cube holds besides. By geometry alone; regrow.h brings back what is
 * missing. */
#ifndef CLN_CARVE_H
#define CLN_CARVE_H

#include "model/octree.h"
#include "scene/scene.h"

/* Marks such leaves; the caller frees *marks [slot]. *count: how many; 0 if it would be all.
 * CLN_MEMORY. */
cln_status cln_carve_find(const cln_scene *scene, const cln_space *space, const cln_config *config,
                          const cln_octree *tree, uint8_t **marks, int *count);

#endif
