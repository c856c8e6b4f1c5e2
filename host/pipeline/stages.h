/* The pipeline of a step: one struct owns the programs and device buffers, one function per stage.
 * Training, rendering, self-test, tests and benches all call these; nothing else names a kernel.
 *
 *   rays       pixels -> ray_o, ray_d
 *   sample     rays -> intervals -> samples          (stage 1 by gather or splat, stage 2)
 *   group      samples -> order, slices              (runs of samples in one leaf)
 *   forward    order, slices -> out (r, g, b, sigma)
 *   composite  out -> results; training: -> dout
 *   backward   dout -> grads per slice
 *   adam       grads -> params of the leaves touched
 *   refresh    params -> cached stage-1 densities
 *
 * Buffers grow as needed and are then kept. Shapes are in the struct. Functions return after
 * enqueueing kernels, except where they say that they read back; uploads wait. */
#ifndef CLN_STAGES_H
#define CLN_STAGES_H

#include "device/buffer.h"
#include "device/program.h"
#include "device/queue.h"
#include "device_abi.h"
#include "model/model.h"
#include "scene/scene.h"

/* X(kernel, program): every kernel of the pipeline. */
#define CLN_KERNEL_LIST(X)        \
    X(scan_sums, scan)            \
    X(scan_write, scan)           \
    X(sort_count, scan)           \
    X(sort_scatter, scan)         \
    X(rays_make, rays)            \
    X(intervals_fill, sampling)   \
    X(samples_emit, sampling)     \
    X(group_keys, group)          \
    X(group_bounds, group)        \
    X(group_slice_counts, group)  \
    X(group_slices, group)        \
    X(mlp_density, mlp_density)   \
    X(mlp_backward, mlp_backward) \
    X(roulette, roulette)         \
    X(composite, composite)       \
    X(composite_train, composite) \
    X(adam_count, adam)           \
    X(adam, adam)                 \
    X(transpose, adam)            \
    X(carry_rows, carry)          \
    X(carry_densities, carry)     \
    X(stats_seen, stats)          \
    X(stats_leaf, stats)

/* Built only when the structure optimisation measures. */
#define CLN_MEASURE_KERNEL_LIST(X) X(leaf_measure, stats)

/* Built only when leaves may merge. */
#define CLN_DISTIL_KERNEL_LIST(X) X(distil_gradient, distil)

/* Built only when stage 1 splats. sort64 is scan.cl with 64-bit keys. */
#define CLN_SPLAT_KERNEL_LIST(X) \
    X(splat_count, splat)        \
    X(splat_emit, splat)         \
    X(splat_bounds, splat)       \
    X(splat_read, splat)         \
    X(splat_lengths, splat)      \
    X(splat_pad, splat)

/* Built only with a regulariser that looks at points. */
#define CLN_REGULARISE_KERNEL_LIST(X) \
    X(regularise_points, regularise)  \
    X(regularise_gradient, regularise)

typedef struct cln_pipeline {
    cln_device *device;
    cln_config config;
    cln_network net;
    cln_tune tune; /* chosen for the network, fitted to its shape and the local memory */
    char tune_from[CLN_TUNE_FROM]; /* where from, as a phrase */
    int line_bits;       /* widest digit of a sort that writes whole lines (scan.cl, SG = 1) */
    bool distortion;     /* built in */
    bool ray_background; /* one background per ray (random_background with alpha) */
    /* Arrays marked P, of a row per leaf (grads: per slice): in one buffer, or once there are leaves of which one
     * array would pass the device's largest allocation, in CLN_PARTS of so many rows (kernels/leaves.h). */
    int parts, part_leaves, part_slices;

    cln_program scan, sort64, rays, sampling, splat, group, mlp_density, mlp_forward_train,
        mlp_forward_eval, mlp_backward, composite, roulette, adam, stats, carry, regularise, distil;
    struct {
#define X(kernel, program) cl_kernel kernel;
        CLN_KERNEL_LIST(X)
        CLN_SPLAT_KERNEL_LIST(X)
        CLN_REGULARISE_KERNEL_LIST(X)
        CLN_MEASURE_KERNEL_LIST(X)
        CLN_DISTIL_KERNEL_LIST(X)
#undef X
        cl_kernel mlp_forward_train, mlp_forward_eval; /* mlp_forward.cl, built twice */
        cl_kernel sort64_varying, sort64_count, sort64_scatter, sort64_buckets;
    } k;

    /* The tree and its networks. */
    int leaves, depth;
    cln_buffer boxes;  /* float4 [leaf] min x, y, z, side */
    cln_buffer map;    /* int [8^depth] CLN_MAP_LEAF or empty box */
    cln_buffer params; /* float [leaf][net.params], P */
    cln_buffer
        transposed; /* float [leaf][wt] for the input gradients, P; training without tune.leaf */
    cln_buffer adam_m, adam_v;      /* [leaf][params] float or bfloat16, P */
    cln_buffer adam_steps, norms;   /* int [leaf], float [leaf] */
    cln_buffer density;             /* bfloat16 [leaf][n1^3], P; training's */
    cln_buffer picture_density;     /* the same at cell centres, while pictures are made */
    cln_buffer seen;                /* uchar [leaf][n1^3], P */
    cln_buffer leaf_stats;          /* float2 [leaf] */
    cln_buffer leaf_sums, leaf_met; /* float2 [leaf][CLN_MEASURES], int [leaf]; if measured */

    /* A batch of rays. */
    int max_rays; /* of a batch, and samples (memory plan); 0 = any number */
    size_t max_samples;
    int view_count, training_views;  /* the first ones are for training */
    cln_buffer cameras;              /* cln_device_camera [view] */
    cln_buffer pixels;               /* cln_pixel [ray] */
    cln_buffer ray_o, ray_d;         /* float4 [ray] */
    cln_buffer targets, backgrounds; /* float4 [ray]; backgrounds [1] or [ray] */
    cln_buffer results;              /* cln_ray_result [ray] */

    /* Its samples. */
    cln_buffer intervals,
        used; /* cln_interval [CLN_MOST_INTERVALS(depth)][ray], uint [ray]: how many of them */
    cln_buffer sample_counts, sample_starts, samples; /* uint [ray], [ray+1]; cln_sample [sample] */
    uint32_t sample_total; /* of the newest batch, once cln_stage_sample has returned */
    cln_buffer begin, end, slice_counts, slice_starts, slices; /* [leaf] x3, [leaf+1], [slice] */
    cln_buffer out, dout;                                      /* float4 [sample] */
    cln_buffer heads, chosen,
        chosen_counts;   /* of the backward pass: float4, uint [grouped sample], uint [slice] */
    cln_buffer measures; /* float [sample][numbers measured] */
    cln_buffer losses;   /* float [sample]; distillation only */
    cln_buffer acts;  /* float or half, cln_pipeline_acts() of each grouped sample; training only */
    cln_buffer grads; /* float [slice or place][net.params], P; training only */

    /* Splatting: lists of one view (or band of it). */
    cln_buffer batch_views, grids, list_start, list_count, list_t, list_sigma, padded_t,
        padded_sigma;
    cln_buffer splat_counts, splat_starts, keys64[2];
    size_t max_entries;    /* projected samples held at a time (memory plan) */
    int64_t splat_entries; /* projected in the last batch, for reports */

    /* Host copies that plan the splatting. */
    cln_pixel *host_pixels; /* [ray] */
    int host_rays, batch_view_count, list_total;
    cln_device_camera *host_cameras; /* [view] */

    /* Scratch of scan and sort. */
    cln_buffer sums, digit_counts, keys[2], values[2];
} cln_pipeline;

/* Programs for this network and scene; no buffers yet. Kernel parameters as cln_device_tune says; where no
 * program can be made with them, plain ones with a warning (not if device->tune_exact). CLN_BUILD,
 * CLN_MEMORY, CLN_CL. */
cln_status cln_pipeline_create(cln_device *device, const cln_config *config, bool distortion,
                               bool ray_background, cln_pipeline *out);
void cln_pipeline_free(cln_pipeline *p); /* accepts a zeroed one */

/* An array P as an argument of a kernel. */
#define CLN_LEAF_ARG(p, array) CLN_LEAF_ARG_OF(p, &(p)->array)
#define CLN_LEAF_ARG_OF(p, buffer)                 \
    {                                              \
        sizeof(cl_mem), (buffer)->part, (p)->parts \
    }

/* Leaves, and gradients, whose every row fits the device's largest allocation: what one part holds. At least 1. */
int cln_pipeline_part_leaves(const cln_pipeline *p);
int cln_pipeline_part_slices(const cln_pipeline *p);

/* Do so many leaves need parts? Without tune.leaf, gradients do before weights: every leaf that has samples takes one,
 * those of many samples more. */
bool cln_pipeline_in_parts(const cln_pipeline *p, int leaves);

/* What `leaves` leaves need, before their arrays are reserved: builds the programs again if these are the first
 * that need parts. CLN_MEMORY if CLN_PARTS parts do not do. */
cln_status cln_pipeline_split(cln_pipeline *p, int leaves);

/* Room for a row of each leaf in an array P, and not much more; for so many gradients. Contents are lost when an
 * array grows. */
cln_status cln_pipeline_slice_rows(cln_pipeline *p, cln_buffer *array, size_t count,
                                   size_t row_bytes, const char *what);
cln_status cln_pipeline_leaf_rows(cln_pipeline *p, cln_buffer *array, size_t row_bytes,
                                  const char *what);

/* Makes vectors, tiles and blocks divide this network and fit the device's groups and local memory. */
void cln_pipeline_fit(const cln_device *device, const cln_network *net, cln_tune *tune);

/* The "#define" lines of a program of this pipeline (programs.c); the caller frees *text. */
cln_status cln_pipeline_defines(const cln_pipeline *p, char **text);

/* Numbers that a training step measures per sample: 0, 1 or CLN_MEASURES. */
int cln_pipeline_measures(const cln_config *config);

/* A work-group of the adam kernel: weights that it updates, of so many leaves in turn. */
enum { CLN_ADAM_PART = 1024, CLN_ADAM_EACH = 16 };

/* Kept pre-activations per sample, and the bytes they take (tune.half); transposed weights per leaf. */
int cln_pipeline_acts(const cln_network *net);
size_t cln_pipeline_act_bytes(const cln_network *net, const cln_tune *tune);
int cln_pipeline_transposed(const cln_network *net);

/* Gradients that an update holds at a time, of so many samples in slices of at most tune.sl: with tune.leaf only those
 * of slices that share a leaf (kernels/mlp_backward.cl). */
double cln_pipeline_gradients(const cln_tune *tune, double samples, double slices);

/* Uploads a tree alone: boxes, map, room for runs and slices of its leaves. Their arrays P are the caller's. */
cln_status cln_pipeline_tree(cln_pipeline *p, const cln_octree *tree);
/* Makes what follows from a training pipeline's leaves and weights: room for norms, transposed weights. */
cln_status cln_pipeline_derive(cln_pipeline *p);
/* Uploads tree and weights, and the training state if `training`; densities if the model has them.
 * Download: params, and the training state if `training`, into the model's arrays, which are made if they
 * are not there. Reads back. A change of the tree goes without either (carry.h). */
cln_status cln_pipeline_upload(cln_pipeline *p, const cln_model *model, bool training);
cln_status cln_pipeline_download(cln_pipeline *p, cln_model *model, bool training);

/* Cameras of `count` views in normalised space. */
cln_status cln_pipeline_cameras(cln_pipeline *p, const cln_camera *const *cameras, int count,
                                const cln_space *space);

/* The same of all views of a scene, by their numbers; the training views come first. */
cln_status cln_pipeline_scene(cln_pipeline *p, const cln_scene *scene, const cln_space *space);

/* A batch's pixels (pad = index of the view among the batch's views; for splatting, rays are in order of
 * pad, then y), and in training its targets and backgrounds ([n][4], [1][4] or [n][4]). Does not wait: the arrays
 * must stay until cln_stage_sample has returned. */
cln_status cln_pipeline_batch(cln_pipeline *p, const cln_pixel *pixels, int n, const float *targets,
                              const float *backgrounds);

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
 * samples fit max_samples (at least one ray, whatever it needs). Waits for the total, while samples are already made if
 * as many as allowed fit the buffer that is there. */
cln_status cln_stage_sample(cln_pipeline *p, int n, const cln_sampling *sampling, int *rays_used,
                            uint32_t *sample_count);

/* Regularisers that look at points of the volume: extra samples (and rays that carry their positions)
 * behind those of `rays` rays; *samples grows by them. Nothing without --sparsity and --edge. The
 * gradient belongs after composite_train. */
int cln_pipeline_extra_rays(const cln_pipeline *p);
int cln_pipeline_extra_samples(const cln_pipeline *p);
cln_status cln_stage_regularise(cln_pipeline *p, const cln_sampling *sampling, int rays,
                                uint32_t *samples);
cln_status cln_stage_regularise_gradient(cln_pipeline *p, const cln_sampling *sampling,
                                         uint32_t samples);

/* *slice_count: the most slices that there can be, min(samples, leaves) + samples / SL; those behind the last one
 * (slice_starts[leaves]) are empty. */
cln_status cln_stage_group(cln_pipeline *p, uint32_t sample_count, uint32_t *slice_count);
/* Reads back how many slices there are. */
cln_status cln_stage_slices(cln_pipeline *p, uint32_t *slice_count);
/* Reads back how well the newest grouping fills the networks' tiles. *leaf_samples: mean of the leaves that have any
 * sample; *padding: share of the rows of the forward pass's tiles that stand empty, 0..1. Both 0 without samples. */
cln_status cln_stage_fill(cln_pipeline *p, double *leaf_samples, double *padding);

/* step_key: any number that differs between steps (slopes of RReLU, density noise). */
cln_status cln_stage_forward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                             bool training, uint32_t step_key);
cln_status cln_stage_composite(cln_pipeline *p, int n, bool axis_depth);
cln_status cln_stage_composite_train(cln_pipeline *p, int n, uint32_t sample_count);
/* What goes through the backward pass (kernels/roulette.cl), of slices of leaves with at least min_samples
 * samples: p->heads, p->chosen, p->chosen_counts. Both forms of the backward pass below begin with it, by config.roulette. */
cln_status cln_stage_roulette(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t min_samples, double cutoff, uint32_t step_key);
/* Gradients of all slices, p->grads [slice][params]; then Adam with them, on leaves with at least min_samples
 * samples. */
cln_status cln_stage_backward(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                              uint32_t step_key);
cln_status cln_stage_adam(cln_pipeline *p, uint32_t min_samples, double lr);
/* The same as these two, bit for bit, in one pass over leaves of one slice; their gradients are not kept. */
cln_status cln_stage_update(cln_pipeline *p, uint32_t sample_count, uint32_t slice_count,
                            uint32_t min_samples, uint32_t step_key, double lr);

/* Adds what composite_train measured of the first `samples` samples to leaf_sums and leaf_met; nothing
 * if nothing is measured. Reset: both to zero. Read: leaf_sums [leaf][CLN_MEASURES][2], leaf_met. */
cln_status cln_stage_measure(cln_pipeline *p, uint32_t samples);
cln_status cln_stage_measure_reset(cln_pipeline *p);

/* Points instead of rays, for the distillation of merged leaves: rays of their own (origin = the point,
 * [n][4] both), and samples on them. Gradient: kernels/distil.cl; targets [ray][4] in p->targets. */
cln_status cln_pipeline_points(cln_pipeline *p, const float *origins, const float *directions,
                               const float *targets, uint32_t rays);
cln_status cln_pipeline_samples(cln_pipeline *p, const cln_sample *samples, uint32_t n);
cln_status cln_stage_distil_gradient(cln_pipeline *p, uint32_t samples, double scale);

/* Cached densities of leaves [first, first + count); jitter: random positions in the cells, else centres. */
cln_status cln_stage_refresh(cln_pipeline *p, int first, int count, bool jitter, uint64_t seed,
                             uint32_t step);

/* Densities of pictures: of all leaves, at cell centres, to p->picture_density. Release: frees them. */
cln_status cln_stage_picture_densities(cln_pipeline *p);
void cln_stage_picture_release(cln_pipeline *p);

/* Which cells some view sees (after a change of structure), and mean and peak per leaf: stats[leaf][2]
 * (reads back). */
cln_status cln_stage_seen(cln_pipeline *p);
cln_status cln_stage_stats(cln_pipeline *p, float *stats);

/* Stage 1 by splatting (splat.c): a batch's views are projected together if their entries fit
 * max_entries, else in groups of views or bands of rows. plan counts and cuts; lists builds the lists
 * of one group for rays [first_ray, first_ray + rays). density: p->density or p->picture_density. Both read
 * back totals. */
typedef struct cln_splat_group {
    int first_view, views, row_begin, row_end, first_ray, rays;
} cln_splat_group;
cln_status cln_stage_splat_plan(cln_pipeline *p, const cln_buffer *density, int n,
                                cln_splat_group **groups, int *count);
cln_status cln_stage_splat_lists(cln_pipeline *p, const cln_buffer *density,
                                 const cln_splat_group *group);
void cln_stage_splat_release(cln_pipeline *p); /* frees what grows with the entries */

/* Elements of the sort per entry of its table of counts, and most chunks per compute unit. */
enum { CLN_SORT_PER_DIGIT = 4, CLN_SORT_PARTS = 8 };

/* Primitives (sort.c, scan.cl). scan: out[0..n] of in[0..n-1]; *total (may be NULL) reads back out[n].
 * sort: stable by the low `bits` bits of the keys [2], values [2]; the result is again in keys[0], values[0].
 * Of many 64-bit keys it reads back in which bits they differ, and leaves out the others. */
cln_status cln_stage_scan(cln_pipeline *p, const cln_buffer *in, const cln_buffer *out, uint32_t n,
                          cln_stage stage, uint32_t *total);
cln_status cln_stage_sort(cln_pipeline *p, cln_buffer *keys, cln_buffer *values, uint32_t n,
                          int bits, bool wide, cln_stage stage);

#endif
