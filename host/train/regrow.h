/* Finds culled places where something is missing: where nearly all photos that see a place have an
 * error there, as if what they show had been taken away. A leaf that was culled too early among
 * coarse leaves comes back so; without this it would be lost for good, as what is not in the tree
 * gets no samples (docs/method.md 11). Not the change of the tree: model/octree.h. */
#ifndef CLN_REGROW_H
#define CLN_REGROW_H

#include "train/trainer.h"

/* Level of the cells that are looked at. */
enum { CLN_REGROW_LEVEL = 5 };

/* Marks cells [32 z][32 y][32 x] of the cube without a leaf, or in one that is `empty` [slot], in
 * which places show errors in at least `regrow` of the training photos that see them, and counts
 * them. Renders a fixed set of rays, so it depends on the model alone. Forward spaces: none. The
 * caller frees *cells. CLN_MEMORY, CLN_CL. */
cln_status cln_regrow_find(cln_trainer *t, const uint8_t *empty, uint8_t **cells, int *found);

#endif
