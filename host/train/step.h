/* One training step (method.md 11): a batch is drawn, the pipeline's stages run forward, backward
 * and through Adam, and the results are accounted for. Results are looked at one step late, so that
 * the host does not wait for the device. Knows nothing of budgets, the tree's changes and the run
 * folder. */
#ifndef CLN_STEP_H
#define CLN_STEP_H

#include "train/trainer.h"

/* Adam's learning rate at a fraction 0..1 of the budget: config.lr, lower by config.lr_schedule. */
double cln_step_learning_rate(const cln_config *config, double fraction);

/* The step number model.step, which grows by 1. The results are owed until the next step or
 * cln_step_catch_up. CLN_DIVERGED if the step before had a loss that is not finite. */
cln_status cln_step(cln_trainer *t, double fraction);

/* Waits for the newest step's results and adds them to the sums of the model and of the interval;
 * does nothing if none are owed. Whoever reads or restarts those sums calls this first.
 * CLN_DIVERGED. */
cln_status cln_step_catch_up(cln_trainer *t);

/* Finds the training pixels that have a leaf before them, after a change of the tree: the next
 * batch is drawn from those. No results may be owed. */
void cln_step_cover(cln_trainer *t);

#endif
