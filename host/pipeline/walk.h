/* The walk of a batch's rays, dealt to ranks (share.h): each finds the intervals of its part of the
 * rays (kernels/sampling.cl), and tells the others those with samples. After it, all ranks have all
 * intervals, bit for bit those of one rank. Not what happens in the leaves: their densities are on
 * all ranks. */
#ifndef CLN_WALK_H
#define CLN_WALK_H

#include "pipeline/pipeline.h"
#include "pipeline/stage1.h"

/* With fewer ranks each walks all rays: the messages would take as long as half a walk
 * (docs/scale-out.md). */
enum { CLN_WALK_RANKS = 3 };

/* The rays of n that this rank walks. */
cln_ray_group cln_walk_part(const cln_pipeline *p, int n);

/* Brings the intervals of all ranks' parts to all ranks: p->intervals, p->used, p->sample_counts,
 * reserved for n rays. Rays behind the longest prefix (at least one) with at most max_samples
 * samples keep their counts, but lose their intervals: they are left out of the batch. Waits. Sets
 * p->interval_total, 0 where each rank walks all rays. */
cln_status cln_walk_share(cln_pipeline *p, int n, size_t max_samples);

#endif
