/* Finds culled places where something is missing: nearly all photos that see the place have an
 * error there. So a leaf that was culled too early comes back; it would be lost for good otherwise,
 * as space outside the tree gets no samples (docs/method.md 11). model/octree.h changes the
 * tree. */
#ifndef CLN_REGROW_H
#define CLN_REGROW_H

#include "train/trainer.h"

/* Level of the tested cells. */
enum { CLN_REGROW_LEVEL = 5 };

/* Marks and counts cells [32 z][32 y][32 x] of the cube that have no leaf or an `empty` one [slot],
 * and where at least the share `regrow` of the training photos that see a point of the cell have an
 * error there. Renders a fixed set of rays, so it depends only on the model. Forward spaces: none.
 * The caller frees *cells. CLN_MEMORY, CLN_CL. */
cln_status cln_regrow_find(cln_trainer *t, const uint8_t *empty, uint8_t **cells, int *found);

#endif
