/* What happens to the tree between steps: growth by level, refresh of stage 1, culling, and the structure
 * decisions (method.md 11, 12). The decisions themselves are model/structure.h and
 * model/integer_program.h; here they are measured, carried out and written down. */
#ifndef CLN_MAINTAIN_H
#define CLN_MAINTAIN_H

#include "train/record.h"

/* All that is due before the next step at this fraction of the budget. */
cln_status cln_maintain(cln_trainer *t, double fraction);

/* PSNR over a fixed batch of training rays, with evaluation's sampling. */
cln_status cln_maintain_probe(cln_trainer *t, double *psnr);

/* Carries a solution of the program out: merges (with distillation), splits, refresh of what is new. The
 * decision's PSNRs and distil_steps are filled in. */
cln_status cln_maintain_restructure(cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                                    int leaves_after, cln_decision *decision);

#endif
