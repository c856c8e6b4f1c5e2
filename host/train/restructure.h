/* Splits and merges leaves as a solution of the integer program says (method.md 11, "Merge" and
 * "Split"): the tree, the device, new leaves' densities, distillation of merged ones. decide.h
 * finds the solution. */
#ifndef CLN_RESTRUCTURE_H
#define CLN_RESTRUCTURE_H

#include "train/record.h"

/* What becomes of the leaves. Arrays: [slot] of the tree before it. */
typedef struct cln_restructuring {
    const uint8_t *split, *merge; /* marks; merge: on every ACTIVE leaf of a group */
    const uint8_t *children;      /* bit i is set if a split leaf gets child i */
    int leaves;                   /* that there are afterwards */
} cln_restructuring;

/* Merges (with distillation), splits, refreshes new leaves, begins a new interval of measuring.
 * Fills in the decision's PSNRs and distil_steps. Cached densities must be fresh. CLN_BUILD,
 * CLN_MEMORY, CLN_CL, CLN_DIVERGED. */
cln_status cln_restructure(cln_trainer *t, const cln_restructuring *how, cln_decision *decision);

/* Leaves that the rank with most will have after it, or a few more (groups that merge across ranks
 * count for each); 0 without ranks. */
int cln_restructure_own(const cln_trainer *t, const cln_restructuring *how);

#endif
