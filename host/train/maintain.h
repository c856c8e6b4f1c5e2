/* Maintains the tree between steps: growth by level, refresh of stage 1, culling, and the structure
 * decisions (method.md 11, 12). model/structure.h and model/integer_program.h decide; this file
 * measures leaves, carries decisions out and records them. */
#ifndef CLN_MAINTAIN_H
#define CLN_MAINTAIN_H

#include "train/record.h"

/* Does what is due before the next step; fraction: 0..1 of the budget. CLN_MEMORY, CLN_CL,
 * CLN_OUTPUT, CLN_DIVERGED. */
cln_status cln_maintain(cln_trainer *t, double fraction);

/* Measures the PSNR, in dB, of a fixed batch of training rays, sampled as in pictures but with
 * training's densities. */
cln_status cln_maintain_probe(cln_trainer *t, double *psnr);

/* Carries out a solution of the integer program: merges (with distillation), splits, refresh of new
 * leaves. split, merge: marks [slot]; children [slot]: of a split leaf, bit i is set if it gets
 * child i; leaves_after: the resulting number of leaves. Fills in the decision's PSNRs and
 * distil_steps. CLN_MEMORY, CLN_CL. */
cln_status cln_maintain_restructure(cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                                    const uint8_t *children, int leaves_after,
                                    cln_decision *decision);

#endif
