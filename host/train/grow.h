/* Adds leaves by schedule, not by the integer program (decide.h): whole levels (method.md 12.1),
 * and leaves that come back where something is missing (12.3), which regrow.h finds. */
#ifndef CLN_GROW_H
#define CLN_GROW_H

#include "train/trainer.h"

/* *due: a whole level is due (--level-at), may come by its leaves, and fits memory; says once why
 * one that is due does not come. fraction: 0..1 of the budget. CLN_MEMORY. */
cln_status cln_grow_due(cln_trainer *t, double fraction, bool *due);

/* Whether a whole level of voxels is due, and only waits for the one before: decisions do, too. The
 * first of them also waits until the empty leaves of the last level are culled, as they would take
 * the budget, and the others have been measured. */
bool cln_grow_awaited(const cln_trainer *t, double fraction);

/* Whether a whole level may follow `level`, with so many leaves, as far as is known: for the
 * present level and those to come, whose leaves the caller guesses. */
bool cln_grow_whole(const cln_trainer *t, int level, double leaves);

/* *level: the deepest whole level, of the present one and those to come, whose voxels the photos
 * can tell (--cell-pixels). CLN_MEMORY. */
cln_status cln_grow_finest(const cln_trainer *t, int *level);

/* About how many leaves a tree of voxels has at this moment of a training, of so many steps (0: its
 * budget is seconds): `first` at the start; whole levels as soon as they may come, with as many
 * children as surfaces have; then, with `singles`, single leaves, up to `most`. */
double cln_grow_foresee(const cln_config *c, double first, double most, bool singles,
                        double fraction, double steps);

/* Splits every leaf once by the exact split (model/fold.c), after cln_grow_due() found that it may:
 * the next step needs a refresh. CLN_BUILD, CLN_MEMORY, CLN_CL, CLN_DIVERGED. */
cln_status cln_grow_level(cln_trainer *t);

/* Brings leaves back where something is missing: all of them, or none if they do not fit. splits:
 * the number of leaves that each leaf becomes right afterwards, 8 before a growth, else 1. Cached
 * densities must be fresh; those of leaves that came back are not. CLN_BUILD, CLN_MEMORY, CLN_CL,
 * CLN_DIVERGED. */
cln_status cln_grow_back(cln_trainer *t, int splits, bool *came_back);

#endif
