/* Maintains the tree between steps: decides in which order growth, refreshes of stage 1, culling,
 * structure decisions and the ranks' balance come (method.md 11, 12). The files below do the work:
 *
 *   grow.h         adds leaves: a whole level, or those that were culled too early (regrow.h)
 *   refresh.h      stage 1's cached densities
 *   cull.h         takes empty leaves away
 *   decide.h       when leaves split and merge, and which; restructure.h carries it out
 *   measure.h      what all of them read of the leaves
 *   change.h       how the device follows a change of the tree */
#ifndef CLN_MAINTAIN_H
#define CLN_MAINTAIN_H

#include "train/trainer.h"

/* Does what is due before the next step; fraction: 0..1 of the budget. CLN_MEMORY, CLN_CL,
 * CLN_OUTPUT, CLN_DIVERGED. */
cln_status cln_maintain(cln_trainer *t, double fraction);

#endif
