/* Culls leaves that stage 1's densities show to be empty (method.md 12.3). Those that are empty by
 * geometry are carve.h's, empty children of a split children.h's. */
#ifndef CLN_CULL_H
#define CLN_CULL_H

#include "train/trainer.h"

/* Whether leaves may be culled at this step, right after a refresh. fraction: 0..1 of the
 * budget. */
bool cln_cull_due(const cln_trainer *t, double fraction);

/* Marks empty leaves, and culls the marked ones once they are many, or `now`, before another change
 * of the tree. CLN_MEMORY, CLN_CL, CLN_DIVERGED. */
cln_status cln_cull(cln_trainer *t, bool now);

#endif
