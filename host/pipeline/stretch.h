/* A training step's rays shared by ranks: each samples and composites only its own leaves, and
 * tells the others a few numbers for every stretch, a run of a ray's intervals in leaves of one
 * rank (kernels/stretch.cl; the idea is NeRF-XL's, arXiv 2404.16221). No sample, weight or gradient
 * travels. A ray's colour, loss and gradients are those of one rank but for rounding; on all ranks
 * the results of rays are the same.
 *
 *   find       intervals -> stretches of every ray, samples here; before samples_emit
 *   composite  samples here -> sums of the stretches here
 *   exchange   sums of the stretches here -> of all
 *   train      sums of all -> results of rays, gradients and measures of samples here
 *
 * Random numbers that belong to a sample (RReLU's slopes, density noise, roulette) go by its place
 * in the batch, which is another than with one rank. */
#ifndef CLN_STRETCH_H
#define CLN_STRETCH_H

#include "pipeline/pipeline.h"

/* Whether steps share their rays like this: several ranks, --exchange stretches, and no points of
 * regularisers beside the samples. */
bool cln_stretch_wanted(const cln_pipeline *p);

/* Of the n rays whose intervals are made; me: this rank. Counts samples here to p->own_starts
 * [ray + 1], the stretches to p->stretch_starts [ray + 1], lists them, and leaves the intervals of
 * other ranks without samples. Reads the totals back. Uploads p->leaf_rank if it is out of date. */
cln_status cln_stretch_find(cln_pipeline *p, int n, int me);

/* The first n rays count: *samples here, p->stretch_total stretches. Reads back. */
cln_status cln_stretch_cut(cln_pipeline *p, int n, uint32_t *samples);

/* Of n rays, after the forward pass. */
cln_status cln_stretch_composite(cln_pipeline *p, int n, int me);
cln_status cln_stretch_exchange(cln_pipeline *p);
cln_status cln_stretch_train(cln_pipeline *p, int n, int me, uint32_t samples);

#endif
