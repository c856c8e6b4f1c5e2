/* The stages of a step, a function each. Training, rendering, self-test, tests and benches call
 * these; nobody else names a kernel.
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
 * Functions return after enqueueing kernels, unless their comment says that they read back or wait.
 * Each reserves the buffers it writes; they grow as needed and are kept. */
#ifndef CLN_STAGES_H
#define CLN_STAGES_H

#include "pipeline/pipeline.h"

/* For the self-test: *out = x_(n n) of kernels/turns.cl, by n^2 turns of loops. Waits. */
cln_status cln_turns(cln_device *device, uint32_t n, uint32_t *out);

cln_status cln_stage_rays(cln_pipeline *p, int n);

typedef struct cln_sampling {
    bool jitter;             /* training: random positions, roulette; else midpoints */
    bool pictures;           /* densities: p->picture_density; else p->density */
    float min_transmittance; /* leaves behind less transmittance are skipped; 0 = none */
    float uniform_share, empty_weight, empty_share;
    uint64_t seed;
    uint32_t step;
    size_t max_samples; /* most samples of a batch (memory plan) */
    size_t extra;       /* samples that cln_stage_regularise will add to it */
    bool stretches;     /* cln_stretch_wanted(): only samples of this rank's leaves (stretch.h) */
    /* [6] half-spaces x p_x + y p_y + z p_z + w >= 0 of points p of the cube, as x, y, z, w: rays
     * see only what is inside all of them; NULL: all of the cube. Needs sampling_crop. */
    const float (*crop)[4];
} cln_sampling;

/* Makes intervals and samples of rays 0 .. n-1. *rays_used: the longest prefix of rays whose
 * samples fit max_samples (at least one ray). *sample_count: samples of them, in leaves of all
 * ranks; p->samples_here: those that are made. Waits for the total; the device makes samples
 * meanwhile, as far as they fit the reserved buffer. */
cln_status cln_stage_sample(cln_pipeline *p, int n, const cln_sampling *sampling, int *rays_used,
                            uint32_t *sample_count);

/* Regularisers of points: adds samples, and rays that carry their positions, after those of `rays`
 * rays; *samples grows by them. Does nothing without --sparsity and --edge. Call the gradient after
 * composite_train. */
cln_status cln_stage_regularise(cln_pipeline *p, const cln_sampling *sampling, int rays,
                                uint32_t *samples);
cln_status cln_stage_regularise_gradient(cln_pipeline *p, const cln_sampling *sampling,
                                         uint32_t samples);

/* *slice_count: a bound on the number of slices, min(samples, leaves) + samples / SL; slices from
 * slice_starts[leaves] on are empty. */
cln_status cln_stage_group(cln_pipeline *p, uint32_t sample_count, uint32_t *slice_count);
/* Reads back the number of slices. */
cln_status cln_stage_slices(cln_pipeline *p, uint32_t *slice_count);
/* Reads back how well the newest grouping fills the networks' tiles. *leaf_samples: mean over
 * leaves that have samples; *padding: share of empty rows in the forward pass's tiles, 0..1. Both
 * are 0 without samples. */
cln_status cln_stage_fill(cln_pipeline *p, double *leaf_samples, double *padding);

/* step_key: any number that differs between steps (slopes of RReLU, density noise). Voxels need no
 * slices unless they train, and no groups unless they train or there are several ranks. */
cln_status cln_stage_forward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                             bool training, uint32_t step_key);
/* Group, where forward needs it, and forward without training. */
cln_status cln_stage_evaluate(cln_pipeline *p, uint32_t sample_count);
/* depth: CLN_DEPTH_*. */
cln_status cln_stage_composite(cln_pipeline *p, int n, unsigned depth);
/* With p->stretched: exchanges the sums of stretches between ranks. */
cln_status cln_stage_composite_train(cln_pipeline *p, int n, uint32_t sample_count);
/* Its first part where pixels may have several rays (p->averaged): moves their targets. */
cln_status cln_stage_composite_pixels(cln_pipeline *p, int n);
/* Chooses the samples of the backward pass (kernels/roulette.cl) in leaves with at least
 * min_samples samples, into p->heads, p->chosen and p->chosen_counts. The backward passes below
 * call it with config.roulette as the cutoff. */
cln_status cln_stage_roulette(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t min_samples, double cutoff, uint32_t step_key);
/* Backward: gradients of all slices, p->grads [slice][params]. Adam: updates leaves with at least
 * min_samples samples by them. */
cln_status cln_stage_backward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t step_key);
cln_status cln_stage_adam(cln_pipeline *p, uint32_t min_samples, double lr);
/* Equals these two bit for bit; leaves of one slice take one pass, and their gradients are not
 * kept. */
cln_status cln_stage_update(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                            uint32_t min_samples, uint32_t step_key, double lr);

/* Add composite_train's measures of the first `samples` samples to leaf_sums
 * [leaf][CLN_MEASURES][2] and leaf_met [leaf]. Reset: zeroes both. Neither does anything if nothing
 * is measured. */
cln_status cln_stage_measure(cln_pipeline *p, uint32_t samples);
cln_status cln_stage_measure_reset(cln_pipeline *p);

cln_status cln_stage_distil_gradient(cln_pipeline *p, uint32_t samples, double scale);

/* Computes cached densities of leaves [first, first + count); jitter: at random positions in the
 * cells, else at their centres. */
cln_status cln_stage_refresh(cln_pipeline *p, int first, int count, bool jitter, uint64_t seed,
                             uint32_t step);

/* Computes densities of pictures: of all leaves, at cell centres, to p->picture_density. Release
 * frees them. */
cln_status cln_stage_picture_densities(cln_pipeline *p);
void cln_stage_picture_release(cln_pipeline *p);

/* Seen: marks the cells that a training view sees; due after a change of the tree. Stats: mean and
 * peak density per leaf, stats [leaf][2]; reads back. Each rank does so for its own leaves. */
cln_status cln_stage_seen(cln_pipeline *p);
cln_status cln_stage_stats(cln_pipeline *p, float *stats);

/* Of the sort: least elements per entry of its table of counts, most chunks per compute unit. */
enum { CLN_SORT_PER_DIGIT = 4, CLN_SORT_PARTS = 8 };

/* Primitives (sort.c, scan.cl). Scan: exclusive prefix sums out[0..n] of in[0..n-1]; *total (may be
 * NULL): out[n], read back. Sort: stable, by the low `bits` bits of keys[0], with values[0]; keys
 * and values are [2], the result is in [0] again. For many 64-bit keys it reads back in which bits
 * they differ, and skips the others. */
cln_status cln_stage_scan(cln_pipeline *p, const cln_buffer *in, const cln_buffer *out, uint32_t n,
                          cln_stage stage, uint32_t *total);
cln_status cln_stage_sort(cln_pipeline *p, cln_buffer *keys, cln_buffer *values, uint32_t n,
                          int bits, bool wide, cln_stage stage);

#endif
