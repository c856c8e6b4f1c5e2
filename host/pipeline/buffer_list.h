/* The list of the pipeline's buffers: a new one takes a row here. The list generates the members of
 * cln_pipeline, the code that reserves and releases them, and the memory plan's rows (plan.h). */
#ifndef CLN_BUFFER_LIST_H
#define CLN_BUFFER_LIST_H

#include "device/buffer.h"
#include "device_abi.h"

typedef struct cln_pipeline cln_pipeline;

/* X(purpose, name, what to lower in training, in rendering): the memory plan's rows, in order. */
#define CLN_PURPOSE_LIST(X)                                                 \
    X(WEIGHTS, "leaf weights", CLN_LOWER_LEAVES, CLN_LOWER_LEAVES)          \
    X(OPTIMISER, "optimiser state", CLN_LOWER_LEAVES, CLN_LOWER_LEAVES)     \
    X(GRADIENTS, "weight gradients", CLN_LOWER_BATCH, CLN_LOWER_BATCH)      \
    X(ACTIVATIONS, "activations", CLN_LOWER_BATCH, CLN_LOWER_BATCH)         \
    X(MEASURES, "measures", "--batch-samples, or give --no-adaptive", NULL) \
    X(DENSITIES, "stage-1 densities", CLN_LOWER_CELLS, CLN_LOWER_CELLS)     \
    X(CHANGES, "changes of the tree", CLN_LOWER_LEAVES, CLN_LOWER_LEAVES)   \
    X(TREE, "tree and cameras", CLN_LOWER_TREE, CLN_LOWER_TREE)             \
    X(SAMPLES, "samples", CLN_LOWER_SAMPLES, CLN_LOWER_SAMPLES)             \
    X(RAYS, "rays", "--max-alloc, --max-level or --rays", "--max-alloc")    \
    X(LISTS, "lists of views", CLN_LOWER_VIEWS, CLN_LOWER_VIEWS)            \
    X(PROJECTED, "projected samples", CLN_LOWER_PROJECTED, CLN_LOWER_PROJECTED)
#define CLN_LOWER_LEAVES    "--start-level, --max-leaves, --width or --depth"
#define CLN_LOWER_BATCH     "--batch-samples, --width or --depth"
#define CLN_LOWER_TREE      "--max-leaves"
#define CLN_LOWER_CELLS     "--n1, --start-level or --max-leaves"
#define CLN_LOWER_SAMPLES   "--batch-samples or --samples-per-leaf"
#define CLN_LOWER_VIEWS     "--views-per-batch or the size with --downscale, or use --stage1 gather"
#define CLN_LOWER_PROJECTED "--n1, or use --stage1 gather"

typedef enum cln_purpose {
#define X(purpose, name, training, rendering) CLN_FOR_##purpose,
    CLN_PURPOSE_LIST(X)
#undef X
        CLN_PURPOSES
} cln_purpose;

/* What a buffer has one row for; plan.c knows the largest numbers. P: may be split into parts
 * (cln_pipeline). A buffer with a row per leaf also shrinks when many leaves are gone. */
typedef enum cln_per {
    CLN_PER_MODEL, /* one */
    CLN_PER_LEAF,
    CLN_PER_LEAF_P,
    CLN_PER_LEAF_START, /* leaves + 1 */
    CLN_PER_CELL,       /* of the octree map */
    CLN_PER_VIEW,
    CLN_PER_RAY,
    CLN_PER_RAY_START, /* rays + 1 */
    CLN_PER_ORIGIN,    /* of rays, of the regularisers' points, or of distillation's points */
    CLN_PER_TARGET,    /* of rays, or of distillation's points */
    CLN_PER_INTERVAL,  /* rays * most_intervals */
    CLN_PER_SAMPLE,
    CLN_PER_SAMPLE_START, /* samples + 1 */
    CLN_PER_SLICE,
    CLN_PER_GRADIENT_P, /* cln_pipeline_gradients() */
    CLN_PER_CHUNK,      /* of a scan or sort */
    CLN_PER_PLACE,      /* of a sort's table: digits x chunks, + 1 */
    CLN_PER_BATCH_VIEW,
    CLN_PER_GRID,       /* batch views x levels */
    CLN_PER_LIST,       /* of projected samples: coarse pixels of all grids */
    CLN_PER_LIST_START, /* lists + 1 */
    CLN_PER_RUN,        /* of cells that one work-item projects, x batch views */
    CLN_PER_RUN_START,  /* runs + 1 */
    CLN_PER_ENTRY,      /* projected samples held at a time */
    CLN_PER_PADDED,     /* lists x the longest; not planned */
    CLN_PER_LINK,       /* copies of vertices whose owner is on another rank (halo.h), + 1 */
} cln_per;

/* When the plan counts a buffer. */
typedef enum cln_when {
    CLN_WHEN_ALWAYS,
    CLN_WHEN_TRAINING,
    CLN_WHEN_MEASURED,   /* training that measures leaves */
    CLN_WHEN_DISTILLING, /* training in which leaves may merge */
    CLN_WHEN_SPLATTING,
    CLN_WHEN_SHARED,  /* by ranks */
    CLN_WHEN_INSTEAD, /* takes the place of another row: not planned */
} cln_when;

/* X or PAIR(member, element, elements of a row, per, purpose, when, what): messages call the buffer
 * `what`. A PAIR is two buffers, the sort's input and output. buffers.c evaluates the number of
 * elements, an expression of `p`. */
#define CLN_BUFFER_LIST(X, PAIR)                                                                  \
    /* the networks; no transposed weights with tune.leaf; moments: float or bfloat16 */          \
    X(params, cl_float, p->net.params, LEAF_P, WEIGHTS, ALWAYS, "leaf weights")                   \
    X(transposed, cl_float, transposed_of(p), LEAF_P, OPTIMISER, TRAINING, "transposed weights")  \
    X(adam_m, cl_uchar, firsts_of(p), LEAF_P, OPTIMISER, TRAINING, "Adam's first moments")        \
    X(adam_v, cl_uchar, moments_of(p), LEAF_P, OPTIMISER, TRAINING, "Adam's second moments")      \
    X(adam_steps, cl_int, 1, LEAF, OPTIMISER, TRAINING, "step counts")                            \
    X(norms, cl_float, 1, LEAF, OPTIMISER, TRAINING, "norms")                                     \
    X(grads, cl_float, p->net.params, GRADIENT_P, GRADIENTS, TRAINING, "weight gradients")        \
    /* voxels' decoder, its moments, its gradients by groups of slices */                         \
    X(decoder_w, cl_float, p->net.decoder_params, MODEL, WEIGHTS, ALWAYS, "decoder")              \
    X(decoder_m, cl_float, p->net.decoder_params, MODEL, OPTIMISER, TRAINING, "decoder")          \
    X(decoder_v, cl_float, p->net.decoder_params, MODEL, OPTIMISER, TRAINING, "decoder")          \
    X(decoder_grads, cl_float, decoder_part_of(p), SLICE, GRADIENTS, TRAINING, "decoder")         \
    X(feature_grads, cl_float, decoded_of(p), SAMPLE, ACTIVATIONS, TRAINING, "feature gradients") \
    X(met, cl_uint, met_of(p), SLICE, GRADIENTS, TRAINING, "met vertices")                        \
    /* kept by the forward pass; inputs of the backward pass, in order of grouped samples */      \
    X(acts, cl_uchar, kept_of(p), SAMPLE, ACTIVATIONS, TRAINING, "activations")                   \
    X(heads, cl_float4, 1, SAMPLE, ACTIVATIONS, TRAINING, "head gradients")                       \
    X(chosen, cl_uint, 1, SAMPLE, ACTIVATIONS, TRAINING, "samples of the backward pass")          \
    X(chosen_counts, cl_uint, 1, SLICE, ACTIVATIONS, TRAINING, "counts of the backward pass")     \
    X(leaf_sums, cl_float2, CLN_MEASURES, LEAF, MEASURES, MEASURED, "measures of leaves")         \
    X(leaf_met, cl_int, 1, LEAF, MEASURES, MEASURED, "measures of leaves")                        \
    X(measures, cl_float, cln_pipeline_measures(&p->config), SAMPLE, MEASURES, MEASURED,          \
      "measures")                                                                                 \
    /* stage 1, n1^3 cells a leaf: bfloat16, and whether a view sees it; mean and peak */         \
    X(density, cl_ushort, cells_of(p), LEAF_P, DENSITIES, ALWAYS, "stage-1 densities")            \
    X(seen, cl_uchar, cells_of(p), LEAF_P, DENSITIES, TRAINING, "visibility of cells")            \
    X(leaf_stats, cl_float2, 1, LEAF, DENSITIES, TRAINING, "leaf statistics")                     \
    /* an array's successor, of rows of its size; old slot and octant; densities of pictures, \
     * held instead of training's in rendering, and instead of the successor in training */   \
    X(successor, cl_uchar, longest_of(p), LEAF_P, CHANGES, TRAINING, "changes of the tree")       \
    X(places, cl_int2, 1, LEAF, CHANGES, TRAINING, "changes of the tree")                         \
    X(picture_density, cl_ushort, cells_of(p), LEAF_P, DENSITIES, INSTEAD,                        \
      "densities of pictures")                                                                    \
    /* minimum x, y, z and side of leaves; octree map; runs and slices of grouped samples */      \
    X(boxes, cl_float4, 1, LEAF, TREE, ALWAYS, "leaf boxes")                                      \
    X(around, cl_int, around_of(p), LEAF, TREE, TRAINING, "neighbours of leaves")                 \
    X(map, cl_int, 1, CELL, TREE, ALWAYS, "leaf map")                                             \
    X(begin, cl_uint, 1, LEAF, TREE, ALWAYS, "leaf runs")                                         \
    X(end, cl_uint, 1, LEAF, TREE, ALWAYS, "leaf runs")                                           \
    X(slice_counts, cl_uint, 1, LEAF, TREE, ALWAYS, "slice counts")                               \
    X(slice_starts, cl_uint, 1, LEAF_START, TREE, ALWAYS, "slice counts")                         \
    X(leaf_rank, cl_uint, 1, LEAF, TREE, SHARED, "ranks of leaves")                               \
    /* voxels by ranks: links, which of them send, rows of messages, others' slices (halo.cl) */  \
    X(halo_up, cl_uint4, linked_of(p), LINK, TREE, SHARED, "common vertices")                     \
    X(halo_down, cl_uint4, linked_of(p), LINK, TREE, SHARED, "common vertices")                   \
    X(halo_marks, cl_uint, linked_of(p), LINK, TREE, SHARED, "common vertices")                   \
    X(halo_places, cl_uint, linked_of(p), LINK, TREE, SHARED, "common vertices")                  \
    X(halo_rows, cl_float, halo_row_of(p), LINK, GRADIENTS, SHARED, "common vertices")            \
    X(halo_far, cl_uint, linked_of(p), LEAF, TREE, SHARED, "common vertices")                     \
    X(cameras, cln_device_camera, 1, VIEW, TREE, ALWAYS, "cameras")                               \
    /* samples; r, g, b, sigma of each and their gradients; keys and order of grouping */         \
    X(samples, cln_sample, 1, SAMPLE, SAMPLES, ALWAYS, "samples")                                 \
    X(out, cl_float4, 1, SAMPLE, SAMPLES, ALWAYS, "sample colours")                               \
    X(dout, cl_float4, 1, SAMPLE, SAMPLES, TRAINING, "sample gradients")                          \
    X(losses, cl_float, 1, SAMPLE, SAMPLES, DISTILLING, "losses")                                 \
    X(packed, cl_float4, 1, SAMPLE, SAMPLES, SHARED, "messages")                                  \
    X(walked, cln_interval, walked_of(p), SAMPLE, SAMPLES, SHARED, "messages")                    \
    /* stretches, no more than samples: rank, first sample here, sums (stretch.cl) */             \
    X(stretch_rank, cl_uint, 1, SAMPLE, SAMPLES, SHARED, "stretches")                             \
    X(stretch_first, cl_uint, 1, SAMPLE_START, SAMPLES, SHARED, "stretches")                      \
    X(stretch_sums, cl_float4, sums_of(p), SAMPLE, SAMPLES, SHARED, "stretches")                  \
    PAIR(keys, cl_uint, 1, SAMPLE, SAMPLES, ALWAYS, "group keys")                                 \
    PAIR(values, cl_uint, 1, SAMPLE, SAMPLES, ALWAYS, "group order")                              \
    X(slices, cln_slice, 1, SLICE, SAMPLES, ALWAYS, "slices")                                     \
    X(digit_counts, cl_uint, 1, PLACE, SAMPLES, ALWAYS, "sort counts")                            \
    X(sums, cl_ulong, 1, CHUNK, SAMPLES, ALWAYS, "scan sums")                                     \
    /* rays; backgrounds: one, or one per ray; intervals, and number used of each ray */          \
    X(pixels, cln_pixel, 1, RAY, RAYS, ALWAYS, "pixels")                                          \
    X(ray_o, cl_float4, 1, ORIGIN, RAYS, ALWAYS, "rays")                                          \
    X(ray_d, cl_float4, 1, ORIGIN, RAYS, ALWAYS, "rays")                                          \
    X(targets, cl_float4, 1, TARGET, RAYS, TRAINING, "targets")                                   \
    /* with a depth loss: points that rays show, in the cube, and their weights */                \
    X(shown, cl_float4, shown_of(p), RAY, RAYS, TRAINING, "points of rays")                       \
    X(backgrounds, cl_float4, 1, RAY, RAYS, ALWAYS, "backgrounds")                                \
    X(results, cln_ray_result, 1, RAY, RAYS, ALWAYS, "ray results")                               \
    X(intervals, cln_interval, 1, INTERVAL, RAYS, ALWAYS, "intervals")                            \
    X(used, cl_uint, 1, RAY, RAYS, ALWAYS, "intervals")                                           \
    X(sample_counts, cl_uint, 1, RAY, RAYS, ALWAYS, "samples")                                    \
    X(sample_starts, cl_uint, 1, RAY_START, RAYS, ALWAYS, "samples")                              \
    /* by ranks: a ray's intervals in `walked`, its samples here, and its stretches */            \
    X(walk_starts, cl_uint, walked_of(p), RAY_START, RAYS, SHARED, "messages")                    \
    X(own_counts, cl_uint, 1, RAY, RAYS, SHARED, "samples here")                                  \
    X(own_starts, cl_uint, 1, RAY_START, RAYS, SHARED, "samples here")                            \
    X(stretch_counts, cl_uint, 1, RAY, RAYS, SHARED, "stretches")                                 \
    X(stretch_starts, cl_uint, 1, RAY_START, RAYS, SHARED, "stretches")                           \
    /* splatting: the batch's views, their grids of lists, counts of projected samples */         \
    X(batch_views, cl_uint, 1, BATCH_VIEW, LISTS, SPLATTING, "views")                             \
    X(grids, cln_grid, 1, GRID, LISTS, SPLATTING, "grids")                                        \
    X(list_start, cl_uint, 1, LIST_START, LISTS, SPLATTING, "list starts")                        \
    X(list_count, cl_uint, 1, LIST, LISTS, SPLATTING, "list lengths")                             \
    X(splat_counts, cl_uint, 1, RUN, LISTS, SPLATTING, "splat counts")                            \
    X(splat_starts, cl_uint, 1, RUN_START, LISTS, SPLATTING, "splat counts")                      \
    /* projected samples: keys of list and t, cells; sorted into lists of t and sigma */          \
    PAIR(keys64, cl_ulong, 1, ENTRY, PROJECTED, SPLATTING, "splat keys")                          \
    PAIR(values64, cl_uint, 1, ENTRY, PROJECTED, SPLATTING, "splat values")                       \
    X(list_t, cl_float, 1, ENTRY, PROJECTED, SPLATTING, "splat lists")                            \
    X(list_sigma, cl_float, 1, ENTRY, PROJECTED, SPLATTING, "splat lists")                        \
    X(padded_t, cl_float, 1, PADDED, PROJECTED, SPLATTING,                                        \
      "padded lists (--lists csr needs less)")                                                    \
    X(padded_sigma, cl_float, 1, PADDED, PROJECTED, SPLATTING,                                    \
      "padded lists (--lists csr needs less)")

typedef enum cln_buffer_id {
#define X(member, ...) CLN_BUFFER_##member,
    CLN_BUFFER_LIST(X, X)
#undef X
        CLN_BUFFERS
} cln_buffer_id;

typedef struct cln_buffer_row {
    const char *what;
    size_t at; /* in cln_pipeline */
    int count; /* 2 for a PAIR, else 1 */
    cln_per per;
    cln_purpose purpose;
    cln_when when;
} cln_buffer_row;
extern const cln_buffer_row cln_buffer_rows[CLN_BUFFERS];

/* Bytes of one row: elements of a row times their size. */
size_t cln_buffer_row_bytes(const cln_pipeline *p, cln_buffer_id id);

/* Reserves `rows` rows, of both buffers of a PAIR. Contents are lost when the buffer grows, or
 * shrinks because it has a row per leaf and is far too large. CLN_MEMORY names the buffer. */
cln_status cln_pipeline_reserve(cln_pipeline *p, cln_buffer_id id, size_t rows);
#define CLN_RESERVE(p, member, rows) cln_pipeline_reserve(p, CLN_BUFFER_##member, rows)

/* Succeed: reserves p->successor with rows of the array's size; array: one with a row per leaf.
 * Replace: frees the array and puts the successor in its place. */
cln_status cln_pipeline_succeed(cln_pipeline *p, cln_buffer_id array, size_t rows);
void cln_pipeline_replace(cln_pipeline *p, cln_buffer_id array);

/* The buffer of a row; of a PAIR, the first. */
cln_buffer *cln_pipeline_buffer(cln_pipeline *p, cln_buffer_id id);

/* Reserve rows and write them. Put waits; put_soon does not: `data` must stay until a later call
 * has waited. */
cln_status cln_pipeline_put(cln_pipeline *p, cln_buffer_id id, const void *data, size_t rows);
cln_status cln_pipeline_put_soon(cln_pipeline *p, cln_buffer_id id, const void *data, size_t rows);
#define CLN_PUT(p, member, data, rows) cln_pipeline_put(p, CLN_BUFFER_##member, data, rows)
#define CLN_PUT_SOON(p, member, data, rows) \
    cln_pipeline_put_soon(p, CLN_BUFFER_##member, data, rows)

/* Reads the first rows back. */
cln_status cln_pipeline_get(cln_pipeline *p, cln_buffer_id id, void *data, size_t rows);
#define CLN_GET(p, member, data, rows) cln_pipeline_get(p, CLN_BUFFER_##member, data, rows)

/* Frees the buffers of one purpose, or all buffers. */
void cln_pipeline_release(cln_pipeline *p, cln_purpose purpose);
void cln_pipeline_release_all(cln_pipeline *p);

#endif
