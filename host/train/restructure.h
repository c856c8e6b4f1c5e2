/* Splits and merges leaves as a solution of the integer program says (method.md 11, "Merge" and
 * "Split"): the tree, the device, new leaves' densities, distillation of merged ones. decide.h
 * finds the solution. */
#ifndef CLN_RESTRUCTURE_H
#define CLN_RESTRUCTURE_H

#include "train/record.h"

/* Carries out a solution of the integer program: merges (with distillation), splits, refresh of new
 * leaves. split, merge: marks [slot]; children [slot]: of a split leaf, bit i is set if it gets
 * child i; leaves_after: the resulting number of leaves. Fills in the decision's PSNRs and
 * distil_steps. CLN_BUILD, CLN_MEMORY, CLN_CL, CLN_DIVERGED. */
cln_status cln_restructure(cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                           const uint8_t *children, int leaves_after, cln_decision *decision);

/* Leaves that the rank with most will have after such a change, or a few more (groups that merge
 * across ranks count for each); 0 without ranks. */
int cln_restructure_own(const cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                        const uint8_t *children);

#endif
