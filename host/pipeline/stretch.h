/* A training step's rays shared by ranks: each samples and composites only its own leaves, and
 * sends the others a few numbers for every stretch, a run of a ray's intervals in leaves of one
 * rank (kernels/stretch.cl; the idea is NeRF-XL's, arXiv 2404.16221). No sample, weight or gradient
 * travels, but for voxels' common vertices (halo.h). A ray's colour, loss and gradients are those
 * of one rank but for rounding; on all ranks the results of rays are the same.
 *
 *   find       intervals -> stretches of every ray, samples here; before samples_emit
 *   composite  samples here -> sums of the stretches here
 *   exchange   sums of the stretches here -> of all
 *   train      sums of all -> results of rays, gradients and measures of samples here
 *
 * Random numbers that belong to a sample (RReLU's slopes, density noise, roulette) depend on its
 * place in the batch, which differs from its place with one rank. */
#ifndef CLN_STRETCH_H
#define CLN_STRETCH_H

#include "pipeline/pipeline.h"

/* Whether steps share their rays like this: several ranks, --exchange stretches, and no points of
 * regularisers beside the samples. */
bool cln_stretch_wanted(const cln_pipeline *p);

/* Finds the stretches of n rays, whose intervals are made, and all samples counted; me: this rank.
 * Rays behind the longest prefix (at least one) with max_samples have none. Writes where the
 * samples here and the stretches of each ray begin to p->own_starts and p->stretch_starts, both
 * [rays + 1], lists the stretches, and leaves intervals in other ranks' leaves without samples.
 * Reads the totals back. Uploads p->leaf_rank if it is out of date. */
cln_status cln_stretch_find(cln_pipeline *p, int n, int me, size_t max_samples);

/* Cuts the batch to its first n rays: sets *samples, those here, and p->stretch_total. Reads
 * back. */
cln_status cln_stretch_cut(cln_pipeline *p, int n, uint32_t *samples);

/* The further steps for n rays, after the forward pass. */
cln_status cln_stretch_composite(cln_pipeline *p, int n, int me);
cln_status cln_stretch_exchange(cln_pipeline *p);
cln_status cln_stretch_train(cln_pipeline *p, int n, int me, uint32_t samples);

#endif
