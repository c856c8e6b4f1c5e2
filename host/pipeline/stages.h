/* The stages of a step, one function each. Training, rendering, self-test, tests and benches all
 * call these; nothing else names a kernel.
 *
 *   rays       pixels -> ray_o, ray_d
 *   sample     rays -> intervals -> samples          (stage 1 by a method of stage1.h, stage 2)
 *   group      samples -> order, slices              (runs of samples in one leaf)
 *   forward    order, slices -> out (r, g, b, sigma)
 *   composite  out -> results; training: -> dout
 *   backward   dout -> grads per slice
 *   adam       grads -> params of the leaves touched
 *   refresh    params -> cached stage-1 densities
 *
 * Functions return after enqueueing kernels, except where they say that they read back. Each
 * reserves what it writes; buffers grow as needed and are then kept. */
#ifndef CLN_STAGES_H
#define CLN_STAGES_H

#include "pipeline/pipeline.h"

cln_status cln_stage_rays(cln_pipeline *p, int n);

typedef struct cln_sampling {
    bool jitter;             /* training: random positions, roulette; else midpoints */
    bool pictures;           /* densities: p->picture_density; else p->density */
    float min_transmittance; /* leaves behind less transmittance are left out; 0 = none */
    float uniform_share, empty_weight, empty_share;
    uint64_t seed;
    uint32_t step;
    size_t max_samples; /* most samples of a batch (memory plan) */
} cln_sampling;

/* Intervals and samples of rays 0 .. n-1. *rays_used: the batch is cut to a prefix of rays whose
 * samples fit max_samples (at least one ray, whatever it needs). Waits for the total, while
 * samples are already made if as many as allowed fit the buffer that is there. */
cln_status cln_stage_sample(cln_pipeline *p, int n, const cln_sampling *sampling, int *rays_used,
                            uint32_t *sample_count);

/* Regularisers that look at points of the volume: extra samples (and rays that carry their
 * positions) behind those of `rays` rays; *samples grows by them. Nothing without --sparsity and
 * --edge. The gradient belongs after composite_train. */
cln_status cln_stage_regularise(cln_pipeline *p, const cln_sampling *sampling, int rays,
                                uint32_t *samples);
cln_status cln_stage_regularise_gradient(cln_pipeline *p, const cln_sampling *sampling,
                                         uint32_t samples);

/* *slice_count: the most slices that there can be, min(samples, leaves) + samples / SL; those
 * behind the last one (slice_starts[leaves]) are empty. */
cln_status cln_stage_group(cln_pipeline *p, uint32_t sample_count, uint32_t *slice_count);
/* Reads back how many slices there are. */
cln_status cln_stage_slices(cln_pipeline *p, uint32_t *slice_count);
/* Reads back how well the newest grouping fills the networks' tiles. *leaf_samples: mean of the
 * leaves that have any sample; *padding: share of the rows of the forward pass's tiles that
 * stand empty, 0..1. Both 0 without samples. */
cln_status cln_stage_fill(cln_pipeline *p, double *leaf_samples, double *padding);

/* step_key: any number that differs between steps (slopes of RReLU, density noise). */
cln_status cln_stage_forward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                             bool training, uint32_t step_key);
cln_status cln_stage_composite(cln_pipeline *p, int n, bool axis_depth);
cln_status cln_stage_composite_train(cln_pipeline *p, int n, uint32_t sample_count);
/* Chooses the samples of the backward pass (kernels/roulette.cl), in leaves with at least
 * min_samples samples: p->heads, p->chosen, p->chosen_counts. Both forms of the backward pass
 * below call it, with config.roulette as the cutoff. */
cln_status cln_stage_roulette(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t min_samples, double cutoff, uint32_t step_key);
/* Gradients of all slices, p->grads [slice][params]; then Adam with them, on leaves with at least
 * min_samples samples. */
cln_status cln_stage_backward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t step_key);
cln_status cln_stage_adam(cln_pipeline *p, uint32_t min_samples, double lr);
/* The same as these two, bit for bit, in one pass over leaves of one slice; their gradients are
 * not kept. */
cln_status cln_stage_update(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                            uint32_t min_samples, uint32_t step_key, double lr);

/* Adds what composite_train measured of the first `samples` samples to leaf_sums and leaf_met;
 * nothing if nothing is measured. Reset: both to zero. Read: leaf_sums [leaf][CLN_MEASURES][2],
 * leaf_met. */
cln_status cln_stage_measure(cln_pipeline *p, uint32_t samples);
cln_status cln_stage_measure_reset(cln_pipeline *p);

cln_status cln_stage_distil_gradient(cln_pipeline *p, uint32_t samples, double scale);

/* Cached densities of leaves [first, first + count); jitter: random positions in the cells, else
 * centres. */
cln_status cln_stage_refresh(cln_pipeline *p, int first, int count, bool jitter, uint64_t seed,
                             uint32_t step);

/* Densities of pictures: of all leaves, at cell centres, to p->picture_density. Release: frees
 * them. */
cln_status cln_stage_picture_densities(cln_pipeline *p);
void cln_stage_picture_release(cln_pipeline *p);

/* Which cells some view sees (after a change of structure), and mean and peak per leaf:
 * stats[leaf][2] (reads back). */
cln_status cln_stage_seen(cln_pipeline *p);
cln_status cln_stage_stats(cln_pipeline *p, float *stats);

/* Elements of the sort per entry of its table of counts, and most chunks per compute unit. */
enum { CLN_SORT_PER_DIGIT = 4, CLN_SORT_PARTS = 8 };

/* Primitives (sort.c, scan.cl). scan: out[0..n] of in[0..n-1]; *total (may be NULL) reads back
 * out[n]. sort: stable by the low `bits` bits of the keys [2], values [2]; the result is again
 * in keys[0], values[0]. Of many 64-bit keys it reads back in which bits they differ, and leaves
 * out the others. */
cln_status cln_stage_scan(cln_pipeline *p, const cln_buffer *in, const cln_buffer *out, uint32_t n,
                          cln_stage stage, uint32_t *total);
cln_status cln_stage_sort(cln_pipeline *p, cln_buffer *keys, cln_buffer *values, uint32_t n,
                          int bits, bool wide, cln_stage stage);

#endif
