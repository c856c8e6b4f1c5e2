/* The memory plans of a training by ranks follow the leaves that each rank has: with a new tree,
 * and when leaves move. Without other ranks nothing is done. */
#ifndef CLN_DEAL_H
#define CLN_DEAL_H

#include "train/trainer.h"

/* Makes the plans of the tree as it is dealt (the pipeline's rank_first), or takes those of an
 * earlier tree or deal if they are larger, as buffers are then; and finds how many leaves a rank
 * may get by moves. Warns, once, of plans above their limits: it is too late to refuse them. */
cln_status cln_deal_plan(cln_trainer *t);

#endif
