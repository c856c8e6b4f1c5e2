/* One training step (method.md 11): draws a batch, runs the pipeline's stages forward, backward and
 * through Adam, and sums up the results. The host reads results one step late, so that it does not
 * wait for the device. Budgets, changes of the tree and the run folder are others' work. */
#ifndef CLN_STEP_H
#define CLN_STEP_H

#include "train/trainer.h"

/* Adam's learning rate at a fraction 0..1 of the budget: config.lr, lower by config.lr_schedule. */
double cln_step_learning_rate(const cln_config *config, double fraction);

/* Likewise the rate of voxels' harmonics above degree 0, as a share of Adam's: harmonic_rate of the
 * settings, which of photos without alpha rises from 0 over the fraction harmonics_rise (method.md
 * 1.2). */
double cln_step_harmonic_rate(const cln_config *config, bool has_alpha, double fraction);

/* Likewise the rate of their decoder: decoder_rate, which is 0 until the fraction decoder_after and
 * rises over CLN_STEP_DECODER_RISE (method.md 1.2). */
#define CLN_STEP_DECODER_RISE 0.2
double cln_step_decoder_rate(const cln_config *config, double fraction);

/* The used fraction 0..1 of the budget in steps or in time, whichever is larger. */
double cln_step_fraction(const cln_trainer *t);

/* About how many steps a training takes, in round numbers, in which pixels become means while the
 * tree still adapts. */
double cln_steps_to_average(const cln_trainer *t);

/* A step has at least so many rays, however many samples each of them has. */
enum { CLN_STEP_LEAST_RAYS = 16 };

/* Takes step number model.step and increments it. Its results are owed until the next step or
 * cln_step_catch_up. CLN_DIVERGED if the loss of the step before was not finite. */
cln_status cln_step(cln_trainer *t, double fraction);

/* Waits for the newest step's results and adds them to the sums of the model and of the interval;
 * does nothing if none are owed. Call it before reading or restarting those sums. CLN_DIVERGED. */
cln_status cln_step_catch_up(cln_trainer *t);

/* Finds the training pixels that see a leaf, after a change of the tree: the next batch is drawn
 * from those. No results may be owed. */
void cln_step_cover(cln_trainer *t);

#endif
