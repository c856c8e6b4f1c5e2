/* The effect of a change of the tree, by the PSNR of a fixed batch of training rays before and
 * after it. No decision depends on it: it goes into the record. */
#ifndef CLN_PROBE_H
#define CLN_PROBE_H

#include "pipeline/stages.h"
#include "train/trainer.h"

/* Measures the PSNR, in dB, of a fixed batch of training rays, sampled as in pictures but with
 * training's densities. The batch that was drawn for the next step is lost. CLN_MEMORY, CLN_CL,
 * CLN_DIVERGED. */
cln_status cln_probe_psnr(cln_trainer *t, double *psnr);

/* The sampling with which a training looks at what it has learnt (the probe, regrow.c, refine.c):
 * that of pictures, but with training's densities and room for samples. */
cln_sampling cln_probe_sampling(const cln_trainer *t);

#endif
