/* Every hyperparameter and run option, a row each. The list generates the struct, the presets, the
 * command-line options with their help, the settings of the public interface, run.json and the
 * checkpoint's settings, so they cannot drift apart.
 *
 * Rows, by type (paper = method.md's default, fast = chosen by error against run time on a CPU,
 * docs/history.md; config.c has what preset voxel and the baselines change of fast):
 *   INT (field, option, paper, fast, min, max, help)
 *   REAL(field, option, paper, fast, min, max, help)
 *   BOOL(field, option, paper, fast, help)                 --option / --no-option
 *   ENUM(field, option, paper, fast, "a|b|c", help)        stored as the index of the word
 *   TEXT(field, option, paper, fast, help)                 at most 255 characters
 * A row may have after its help:
 *   .flags = CLN_ROW_...      special treatment (below)
 *   .alias = "old-name"       an earlier name: still an option, and a key of older runs
 *
 * A new row is CLN_ROW_LATER, and its paper value means the behaviour without it: older runs are
 * read with that value.
 */
#ifndef CLN_CONFIG_ROWS_H
#define CLN_CONFIG_ROWS_H

#include <stdbool.h>
#include <stdint.h>
#include "cl_nascent.h"

enum { CLN_TEXT_BYTES = CLN_SETTING_BYTES };

/* Whole trees begin at levels 0 to 5; they grow, and adaptive ones go, up to CLN_LEVELS - 1. */
enum { CLN_FULL_LEVELS = 6 };

/* Flags of a row. */
enum {
    CLN_ROW_FIXED = 1,   /* a checkpoint fixes it: a resumed run cannot change it */
    CLN_ROW_SHAPE = 2,   /* shape of the networks' kernels: checked on the device before training */
    CLN_ROW_TUNE = 4,    /* an option of `tune`, too */
    CLN_ROW_SCENE = 8,   /* an option of `info SCENE`, too: how a scene is read */
    CLN_ROW_LATER = 16,  /* runs older than this row have its paper value */
    CLN_ROW_BUDGET = 32, /* +N extends a resumed run */
    CLN_ROW_SECONDS = 64, /* REAL: also 90s, 10m, 2h, 1:30 */
    CLN_ROW_BYTES = 128,  /* REAL: also 512M, 4G */
    CLN_ROW_AUTO = 256,   /* INT: "auto" is its least value */
    CLN_ROW_TIME = 512,   /* a step's time depends on it: `info --like` names it if it differs */
    CLN_ROW_NONE = 1024,  /* TEXT: "none" is the empty text */
    CLN_ROW_FILE = 2048,  /* TEXT: a file's path; cl-nascent.conf names it from its own folder */
    CLN_ROW_REGULARISER = 4096, /* REAL: a weight of the loss; at 0 it is left out, which is told */
    CLN_ROW_SWITCH = 8192,      /* ENUM "no|yes|...": as BOOL, with further words: --option=auto */
    CLN_ROW_NETWORK = CLN_ROW_FIXED | CLN_ROW_SHAPE | CLN_ROW_TUNE | CLN_ROW_TIME
};

/* Words of the ENUM rows, in the order of their "a|b|c". */
enum { CLN_RRELU_ELEMENT, CLN_RRELU_NEURON, CLN_RRELU_MEAN };
enum { CLN_DENSITY_SOFTPLUS, CLN_DENSITY_RELU, CLN_DENSITY_EXP };
enum { CLN_INIT_KAIMING, CLN_INIT_FAN_IN };
enum { CLN_ENCODING_FREQUENCY, CLN_ENCODING_GRID, CLN_ENCODING_VOXEL };
enum { CLN_STAGE1_SPLAT, CLN_STAGE1_GATHER };
enum { CLN_LISTS_CSR, CLN_LISTS_PADDED };
enum { CLN_CDF_SIGMA, CLN_CDF_WEIGHT };
enum { CLN_ALLOCATE_CHORD, CLN_ALLOCATE_WEIGHT };
enum { CLN_CULL_GUARDED, CLN_CULL_MEAN };
enum { CLN_WEIGHT_MASK, CLN_WEIGHT_VISIBILITY };
enum { CLN_LOSS_L2, CLN_LOSS_HUBER };
enum { CLN_SCHEDULE_STEP, CLN_SCHEDULE_EXP };
enum { CLN_MOMENTS_FLOAT32, CLN_MOMENTS_BFLOAT16 };
enum { /* the order in which they are looked for (scene/readers.c) */
       CLN_FORMAT_AUTO,
       CLN_FORMAT_TRANSFORMS,
       CLN_FORMAT_COLMAP,
       CLN_FORMAT_LLFF,
       CLN_FORMAT_NEUS,
       CLN_FORMAT_NSVF,
       CLN_FORMAT_OPENSFM,
       CLN_FORMAT_METASHAPE,
       CLN_FORMAT_POLYCAM,
       CLN_FORMAT_RECORD3D,
       CLN_FORMATS
};
enum { CLN_EXPOSURE_NO, CLN_EXPOSURE_YES, CLN_EXPOSURE_AUTO };
enum { CLN_EXCHANGE_SAMPLES, CLN_EXCHANGE_STRETCHES };
enum { CLN_MISSING_AUTO, CLN_MISSING_SKIP, CLN_MISSING_FAIL };
enum {
    CLN_MASKS_AUTO,
    CLN_MASKS_ALPHA,
    CLN_MASKS_IGNORE,
    CLN_MASKS_INVERTED,
    CLN_MASKS_IGNORE_WHITE
};
enum { CLN_SPACE_AUTO, CLN_SPACE_CUBE, CLN_SPACE_NDC, CLN_SPACE_SHELL };

/* Leaves: compile-time constants of the kernels (method.md sections 1, 2). */
#define CLN_CONFIG_NETWORK(INT, REAL, BOOL, ENUM, TEXT)                                            \
    INT(width, "width", 64, 32, 16, 256,                                                           \
        "networks: neurons of a trunk layer: 16, 32, 64, 128 or 256", .flags = CLN_ROW_NETWORK)    \
    INT(depth, "depth", 8, 3, 2, 8, "networks: trunk layers", .flags = CLN_ROW_NETWORK)            \
    INT(view_width, "view-width", 256, 32, 16, 256,                                                \
        "networks: neurons of the view layer: 16 to 256", .flags = CLN_ROW_NETWORK)                \
    INT(bands, "bands", 10, 6, 1, 10, "networks: frequencies of the position encoding",            \
        .flags = CLN_ROW_NETWORK)                                                                  \
    INT(view_bands, "view-bands", 4, 2, 0, 4, "networks: frequencies of the direction encoding",   \
        .flags = CLN_ROW_NETWORK)                                                                  \
    ENUM(encoding, "encoding", CLN_ENCODING_FREQUENCY, CLN_ENCODING_FREQUENCY,                     \
         "frequency|grid|voxel",                                                                   \
         "what a leaf is: a network of a position's sines or of features of a grid, or voxels",    \
         .flags = CLN_ROW_NETWORK | CLN_ROW_LATER)                                                 \
    INT(grid_cells, "grid-cells", 8, 8, 2, 32, "grid, voxel: cells of a leaf along an axis, even", \
        .flags = CLN_ROW_NETWORK | CLN_ROW_LATER)                                                  \
    INT(grid_features, "grid-features", 4, 4, 4, 16, "grid: features of a vertex: 4, 8, 12, 16",   \
        .flags = CLN_ROW_NETWORK | CLN_ROW_LATER)                                                  \
    INT(harmonics, "harmonics", 1, 1, 0, 2,                                                        \
        "voxel: degree of the spherical harmonics by which colours depend on the direction; 2 "    \
        "pays for things that shine, in more memory and time",                                     \
        .flags = CLN_ROW_NETWORK | CLN_ROW_LATER)                                                  \
    INT(decoder_width, "decoder-width", 0, 0, 0, 64,                                               \
        "voxel: width of a network, shared by all leaves, that adds to colours: 0 (none), 16, "    \
        "32, 48 or 64",                                                                            \
        .flags = CLN_ROW_NETWORK | CLN_ROW_LATER)                                                  \
    BOOL(view_dependence, "view-dependence", true, true,                                           \
         "colour depends on the direction; without it view layer or harmonics are left out",       \
         .flags = CLN_ROW_NETWORK)                                                                 \
    BOOL(skip, "skip", true, false,                                                                \
         "networks: feed the encoding again into the layer after depth/2 layers",                  \
         .flags = CLN_ROW_NETWORK)                                                                 \
    BOOL(bands_by_level, "bands-by-level", false, false,                                           \
         "networks: fade bands out that alias at a level", .flags = CLN_ROW_FIXED)                 \
    ENUM(rrelu_scope, "rrelu-scope", CLN_RRELU_ELEMENT, CLN_RRELU_MEAN, "element|neuron|mean",     \
         "networks: one random slope per element, per neuron and step, or the mean slope")         \
    REAL(rrelu_lower, "rrelu-lower", -0.3, -0.3, -1, 1,                                            \
         "networks: lower bound of the negative-side slope")                                       \
    REAL(rrelu_upper, "rrelu-upper", -0.1, -0.1, -1, 1,                                            \
         "networks: upper bound of the negative-side slope")                                       \
    ENUM(density, "density", CLN_DENSITY_SOFTPLUS, CLN_DENSITY_SOFTPLUS, "softplus|relu|exp",      \
         "density activation", .flags = CLN_ROW_FIXED | CLN_ROW_SHAPE)                             \
    REAL(density_scale, "density-scale", 10, 10, 1e-3, 1e4,                                        \
         "kappa: density per unit of the normalised cube and unit of activation",                  \
         .flags = CLN_ROW_FIXED)                                                                   \
    REAL(initial_depth, "initial-depth", 1, 1, 1e-4, 10,                                           \
         "optical depth straight through the empty cube at the start", .flags = CLN_ROW_FIXED)     \
    ENUM(init, "init", CLN_INIT_KAIMING, CLN_INIT_KAIMING, "kaiming|fan-in",                       \
         "networks: bound of the initial weights")

/* The tree and its growth (method.md sections 3, 11, 12.3). */
#define CLN_CONFIG_TREE(INT, REAL, BOOL, ENUM, TEXT)                                            \
    INT(start_level, "start-level", 1, 2, 0, CLN_FULL_LEVELS - 1,                               \
        "level of the full tree at the first step", .flags = CLN_ROW_TIME)                      \
    TEXT(level_at, "level-at", "2:0.067,3:0.133", "3:0.08,4:0.25",                              \
         "growth: LEVEL:FRACTION of the budget, comma separated",                               \
         .flags = CLN_ROW_TIME | CLN_ROW_NONE)                                                  \
    REAL(cell_pixels, "cell-pixels", 0, 0, 0, 1000,                                             \
         "voxel: no cells below so many pixels of the photos that see them, or, where a whole " \
         "level grows, in the cube's middle (0: any)",                                          \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                 \
    ENUM(cull, "cull", CLN_CULL_GUARDED, CLN_CULL_GUARDED, "guarded|mean",                      \
         "cull empty leaves with the two guards, or by the mean density alone")                 \
    REAL(cull_mean, "cull-mean", 0.01, 0.5, 0, 1e6,                                             \
         "cull below this mean density of seen samples")                                        \
    REAL(cull_max, "cull-max", 0.05, 0.05, 0, 1e6,                                              \
         "guard: and only where every sample's density x spacing is below this")                \
    INT(cull_strikes, "cull-strikes", 2, 4, 1, 100, "guard: in this many consecutive checks")   \
    REAL(cull_from, "cull-from", 0.067, 0.02, 0, 1,                                             \
         "no culling before this fraction of the budget")                                       \
    INT(cull_after, "cull-after", 0, 512, 0, 1000000,                                           \
        "no culling in so many steps after the start or a growth of the tree",                  \
        .flags = CLN_ROW_LATER)                                                                 \
    INT(seen_by, "seen-by", 0, 0, 0, 1000, "space that fewer training views see stays empty",   \
        .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                  \
    REAL(points_near, "points-near", 0, 0, 0, 2,                                                \
         "whole levels: only leaves so near to a sparse point (1: half the cube); 0: all",      \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                 \
    BOOL(slab, "slab", false, false,                                                            \
         "what lies in the cube but outside --bbox, or the box of the points, stays empty",     \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                 \
    REAL(regrow, "regrow", 0, 0.7, 0, 1,                                                        \
         "after growth, culled leaves come back where this share of the photos has errors, or " \
         "where a surface is cut off (0: never)",                                               \
         .flags = CLN_ROW_LATER)                                                                \
    ENUM(density_weight, "density-weight", CLN_WEIGHT_MASK, CLN_WEIGHT_MASK, "mask|visibility", \
         "mean density of a leaf: over samples that a view sees, or weighted by how well")      \
    BOOL(adaptive, "adaptive", true, true,                                                      \
         "split single leaves by the integer program, and of networks merge them, besides "     \
         "growth by level",                                                                     \
         .flags = CLN_ROW_TIME)                                                                 \
    INT(max_leaves, "max-leaves", 1024, 4096, 1, 262144, "adaptive: most leaves",               \
        .flags = CLN_ROW_TIME)                                                                  \
    INT(max_level, "max-level", 5, 6, 0, CLN_LEVELS - 1, "adaptive: deepest level",             \
        .flags = CLN_ROW_TIME)                                                                  \
    REAL(structure_from, "structure-from", 0.233, 0.4, 0, 1,                                    \
         "adaptive: no change before this fraction of the budget")                              \
    REAL(structure_every, "structure-every", 0.0334, 0.05, 1e-4, 1,                             \
         "adaptive: fraction of the budget from one decision to the next")                      \
    REAL(structure_until, "structure-until", 0.6, 0.7, 0, 1,                                    \
         "adaptive: the tree is frozen from this fraction of the budget on")                    \
    REAL(structure_wait, "structure-wait", 0.95, 0, 0, 1,                                       \
         "adaptive: wait while the error still falls below this share of what it was")          \
    INT(split_samples, "split-samples", 2000, 2000, 0, 1000000000,                              \
        "adaptive: no split of a leaf that met fewer samples since the last decision")          \
    REAL(split_factor, "split-factor", 0.75, 0.75, 0, 100,                                      \
         "adaptive: cost of a split leaf, as a share of the leaf's")                            \
    REAL(merge_factor, "merge-factor", 1.1, 1.7, 0, 100,                                        \
         "adaptive: cost of a merged leaf, as a multiple of its children's")                    \
    REAL(cost_density, "cost-density", 1, 0, 0, 4,                                              \
         "adaptive: power of the mean density in a leaf's cost, error x density^power")         \
    INT(distil_steps, "distil-steps", 500, 500, 0, 1000000,                                     \
        "merge: most steps of training the new leaf on samples of the old ones")                \
    INT(distil_samples, "distil-samples", 256, 256, 8, 65536, "merge: samples per step")        \
    REAL(distil_lr, "distil-lr", 1e-3, 1e-3, 1e-8, 1, "merge: learning rate")                   \
    REAL(distil_stop, "distil-stop", 1e-4, 1e-4, 0, 1, "merge: stop at this loss")              \
    TEXT(tree_from, "tree-from", "", "", "take over the tree of this run and keep it as it is", \
         .flags = CLN_ROW_NONE)

/* Stage 1 and stage 2 sampling (method.md sections 4 to 7). */
#define CLN_CONFIG_SAMPLING(INT, REAL, BOOL, ENUM, TEXT)                                           \
    INT(n1, "n1", 64, 12, 2, 128, "stage-1 samples per leaf and axis",                             \
        .flags = CLN_ROW_FIXED | CLN_ROW_TIME)                                                     \
    INT(refresh_every, "refresh-every", 256, 768, 1, 1000000,                                      \
        "most steps between refreshes of the cached stage-1 densities", .flags = CLN_ROW_TIME)     \
    BOOL(rolling_refresh, "rolling-refresh", false, false,                                         \
         "refresh a sixteenth of the leaves every 16 steps instead of all at once",                \
         .flags = CLN_ROW_TIME)                                                                    \
    ENUM(stage1, "stage1", CLN_STAGE1_SPLAT, CLN_STAGE1_GATHER, "splat|gather",                    \
         "project the stage-1 samples into the views and sort, or read them along each ray",       \
         .flags = CLN_ROW_TUNE | CLN_ROW_TIME)                                                     \
    ENUM(lists, "lists", CLN_LISTS_CSR, CLN_LISTS_CSR, "csr|padded",                               \
         "splat: lists by offset, or padded to one length (the paper's)", .flags = CLN_ROW_TIME)   \
    REAL(splat_per_ray, "splat-per-ray", 8, 8, 0.1, 1000,                                          \
         "splat: join pixels, at most 64 x 64, until a ray meets this many samples in a leaf",     \
         .flags = CLN_ROW_TIME)                                                                    \
    REAL(splat_min_alpha, "splat-min-alpha", 0, 1e-4, 0, 1,                                        \
         "splat: leave out samples with density x spacing below this", .flags = CLN_ROW_TIME)      \
    INT(views_per_batch, "views-per-batch", 4, 4, 1, 1000000, "splat: views that share a batch",   \
        .flags = CLN_ROW_TIME)                                                                     \
    ENUM(allocate, "allocate", CLN_ALLOCATE_CHORD, CLN_ALLOCATE_WEIGHT, "chord|weight",            \
         "stage-2 samples per leaf by chord length, or by the share of the ray's weight",          \
         .flags = CLN_ROW_TIME)                                                                    \
    INT(samples_per_leaf, "samples-per-leaf", 32, 8, 1, 256,                                       \
        "chord: samples on a leaf's diagonal; weight: most samples in one leaf",                   \
        .flags = CLN_ROW_TIME)                                                                     \
    INT(samples_per_ray, "samples-per-ray", 64, 16, 1, 1024, "weight: samples of an opaque ray",   \
        .flags = CLN_ROW_TIME)                                                                     \
    REAL(uniform_share, "uniform-share", 0.25, 0.25, 0, 1, "stage-2 samples: share placed evenly") \
    ENUM(cdf, "cdf", CLN_CDF_SIGMA, CLN_CDF_WEIGHT, "sigma|weight",                                \
         "stage-2 samples follow the density, or the compositing weight")                          \
    REAL(empty_weight, "empty-weight", 0, 1e-3, 0, 1,                                              \
         "a ray's interval through a leaf counts as empty below this stage-1 weight",              \
         .flags = CLN_ROW_TIME)                                                                    \
    REAL(empty_share, "empty-share", 1, 0.25, 0, 1,                                                \
         "training: probability that an empty interval gets one sample all the same",              \
         .flags = CLN_ROW_TIME)                                                                    \
    REAL(min_transmittance, "min-transmittance", 1e-4, 1e-3, 0, 0.5,                               \
         "training: skip leaves of a ray where less transmittance than this is left",              \
         .flags = CLN_ROW_TIME, .alias = "t-min")                                                  \
    REAL(render_min_transmittance, "render-min-transmittance", 1e-3, 1e-3, 0, 0.5,                 \
         "the same when rendering", .alias = "render-t-min")                                       \
    REAL(occlusion_from, "occlusion-from", 0.067, 0.02, 0, 1,                                      \
         "no samples left out as occluded before this fraction of the budget")                     \
    REAL(near, "near", 0, 0, 0, 1,                                                                 \
         "rays begin at this distance from the camera, in half sides of the scene's cube",         \
         .flags = CLN_ROW_LATER)

/* Loss, regularisers, optimiser, batch (method.md sections 10, 11). */
#define CLN_CONFIG_OPTIM(INT, REAL, BOOL, ENUM, TEXT)                                              \
    INT(rays, "rays", 8192, 2048, 16, 1048576, "rays in a batch",                                  \
        .flags = CLN_ROW_TUNE | CLN_ROW_TIME)                                                      \
    REAL(leaf_samples, "leaf-samples", 0, 24, 0, 10000,                                            \
         "more rays, up to 8 times, until a leaf meets this many samples on average",              \
         .flags = CLN_ROW_TIME)                                                                    \
    BOOL(skip_uncovered, "skip-uncovered", false, true,                                            \
         "gather: no rays through pixels that have no leaf before them; they would train nothing", \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                    \
    INT(batch_samples, "batch-samples", 262144, 65536, 256, 16777216,                              \
        "samples per batch; fewer rays where it would be more",                                    \
        .flags = CLN_ROW_TUNE | CLN_ROW_TIME)                                                      \
    REAL(lr, "lr", 5e-4, 1e-2, 1e-8, 1, "learning rate at the start")                              \
    REAL(lr_final, "lr-final", 5e-6, 2e-4, 1e-9, 1, "learning rate at the end of the budget")      \
    ENUM(lr_schedule, "lr-schedule", CLN_SCHEDULE_STEP, CLN_SCHEDULE_EXP, "step|exp",              \
         "x0.1 at each third of the budget, or exponential from lr to lr-final")                   \
    REAL(beta1, "beta1", 0.9, 0.9, 0, 0.9999, "Adam")                                              \
    REAL(beta2, "beta2", 0.999, 0.99, 0, 0.999999, "Adam")                                         \
    REAL(density_rate, "density-lr", 1, 1, 1e-3, 1e3,                                              \
         "voxel: learning rate of densities, times --lr", .flags = CLN_ROW_LATER)                  \
    REAL(harmonic_rate, "harmonics-lr", 1, 1, 1e-3, 1e3,                                           \
         "voxel: learning rate of harmonics above degree 0, times --lr", .flags = CLN_ROW_LATER)   \
    REAL(                                                                                          \
        harmonics_rise, "harmonics-rise", 0, 0, 0, 1,                                              \
        "voxel: --harmonics-lr rises from 0 over this fraction of the budget, for images without " \
        "alpha",                                                                                   \
        .flags = CLN_ROW_LATER)                                                                    \
    REAL(decoder_rate, "decoder-lr", 0.1, 0.1, 0, 1e3,                                             \
         "voxel: learning rate of the decoder, times --lr", .flags = CLN_ROW_LATER)                \
    REAL(decoder_after, "decoder-after", 0, 0, 0, 1,                                               \
         "voxel: --decoder-lr is 0 until this fraction of the budget, then rises over a fifth",    \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                    \
    REAL(epsilon, "epsilon", 1e-8, 1e-10, 1e-20, 1, "Adam")                                        \
    ENUM(moments, "moments", CLN_MOMENTS_FLOAT32, CLN_MOMENTS_BFLOAT16, "float32|bfloat16",        \
         "Adam's moments in memory; bfloat16 is rounded up or down by chance, right on average",   \
         .flags = CLN_ROW_FIXED | CLN_ROW_LATER | CLN_ROW_TIME)                                    \
    REAL(roulette, "roulette", 0, 0.1, 0, 1000,                                                    \
         "train only some of the samples whose gradient is below this share of their leaf's mean " \
         "(0: all)",                                                                               \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                    \
    INT(min_leaf_samples, "min-leaf-samples", 32, 8, 1, 1000000,                                   \
        "networks: a leaf with fewer samples in a batch is not updated")                           \
    ENUM(loss, "loss", CLN_LOSS_L2, CLN_LOSS_L2, "l2|huber", "loss per colour channel")            \
    REAL(huber_delta, "huber-delta", 0.1, 0.1, 1e-6, 10, "where huber turns linear")               \
    INT(antialias, "antialias", 1, 1, 0, 4,                                                        \
        "gather: pixels at edges of a photo are the mean of N x N rays, in pictures, too (0 or "   \
        "auto: 2, if that begins in the first half of the budget, else 1)",                        \
        .flags = CLN_ROW_LATER | CLN_ROW_TIME | CLN_ROW_AUTO)                                      \
    REAL(antialias_after, "antialias-after", 2, 2, 0, 1e6,                                         \
         "antialias: begins once so many rays were drawn per pixel of the training photos",        \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)                                                    \
    BOOL(random_background, "random-background", false, false,                                     \
         "a random background colour per ray")                                                     \
    REAL(alpha_loss, "alpha-loss", 0, 0.1, 0, 1e3,                                                 \
         "weight of (opacity - alpha)^2 per ray, for images with alpha", .flags = CLN_ROW_LATER)   \
    REAL(opaque_loss, "opaque-loss", 0, 0.01, 0, 1e3,                                              \
         "weight of (1 - opacity)^2 per ray, for images without alpha; of those whose borders "    \
         "have "                                                                                   \
         "the background's colour, where they differ from it",                                     \
         .flags = CLN_ROW_LATER)                                                                   \
    REAL(depth_loss, "depth-loss", 0, 2, 0, 1e3,                                                   \
         "weight of the distance between where a ray ends and a depth that is known there: of a "  \
         "sparse point, or by a depth image",                                                      \
         .flags = CLN_ROW_LATER)                                                                   \
    REAL(depth_until, "depth-until", 0.5, 1, 0, 1,                                                 \
         "depth-loss: falls to 0 until this fraction of the budget", .flags = CLN_ROW_LATER)       \
    ENUM(exposure, "exposure", CLN_EXPOSURE_NO, CLN_EXPOSURE_AUTO, "no|yes|auto",                  \
         "fit a gain to each training photo and channel, for images without alpha; auto: if "      \
         "photos differ early in training, and as those before and after them do",                 \
         .flags = CLN_ROW_LATER | CLN_ROW_SWITCH)                                                  \
    BOOL(refine_poses, "refine-poses", false, false,                                               \
         "gather: correct the training cameras' poses a little, by their photos",                  \
         .flags = CLN_ROW_FIXED | CLN_ROW_LATER | CLN_ROW_TIME)                                    \
    REAL(density_noise, "density-noise", 0, 0, 0, 100,                                             \
         "std of noise added before the density activation")                                       \
    REAL(sparsity, "sparsity", 0, 0, 0, 1e3, "weight of 1-exp(-0.05 sigma) at random points",      \
         .flags = CLN_ROW_TIME | CLN_ROW_REGULARISER)                                              \
    REAL(cauchy, "cauchy", 0, 0, 0, 1e3, "weight of log(1+2 sigma^2) along rays",                  \
         .flags = CLN_ROW_REGULARISER)                                                             \
    REAL(opacity_entropy, "opacity-entropy", 0, 0, 0, 1e3, "weight of log(1+A(1-A)/0.11) per ray", \
         .flags = CLN_ROW_REGULARISER)                                                             \
    REAL(distortion_loss, "distortion-loss", 0, 0, 0, 1e3, "weight of the distortion loss",        \
         .flags = CLN_ROW_REGULARISER)                                                             \
    REAL(edge, "edge", 0, 0, 0, 1e3, "weight of the difference of two leaves at a shared face",    \
         .flags = CLN_ROW_TIME | CLN_ROW_REGULARISER)                                              \
    REAL(smooth_density, "smooth-density", 0, 0, 0, 1,                                             \
         "voxel: weight of half the squared differences of neighbours' densities",                 \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME | CLN_ROW_REGULARISER)                              \
    REAL(smooth_colour, "smooth-colour", 0, 0, 0, 1,                                               \
         "voxel: weight of half the squared differences of neighbours' colours",                   \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME | CLN_ROW_REGULARISER)                              \
    REAL(smooth_density_delta, "smooth-density-delta", 0, 0, 0, 1e6,                               \
         "voxel: where the squares of --smooth-density turn linear (0: never)",                    \
         .flags = CLN_ROW_LATER)                                                                   \
    REAL(smooth_colour_delta, "smooth-colour-delta", 0, 0, 0, 1e6,                                 \
         "voxel: where the squares of --smooth-colour turn linear (0: never)",                     \
         .flags = CLN_ROW_LATER)                                                                   \
    REAL(view_l2, "view-l2", 0, 0, 0, 1e3, "networks: weight of the norm of the view layer",       \
         .flags = CLN_ROW_REGULARISER)                                                             \
    INT(precrop_steps, "precrop-steps", 0, 0, 0, 1000000,                                          \
        "first steps that draw rays from the middle half of the images only")

/* Data, budgets and output of a run. */
#define CLN_CONFIG_RUN(INT, REAL, BOOL, ENUM, TEXT)                                                \
    INT(seed, "seed", 42, 42, 0, 2147483647, "seed of every random number")                        \
    INT(steps, "steps", 0, 0, 0, 2000000000, "budget: steps (0 = none)", .flags = CLN_ROW_BUDGET)  \
    REAL(time_limit, "time-limit", 0, 0, 0, 1e9,                                                   \
         "budget: training seconds, or 90s 10m 2h 1:30 (0 = none)",                                \
         .flags = CLN_ROW_SECONDS | CLN_ROW_BUDGET)                                                \
    REAL(target_psnr, "target-psnr", 0, 0, 0, 200,                                                 \
         "budget: stop when test PSNR reaches this (0 = none); measured at --eval-every or "       \
         "--eval-at; with neither after 64 steps, then after a quarter more each time")            \
    INT(epochs, "epochs", 30, 30, 1, 1000000,                                                      \
        "budget when none other is set; an epoch draws a tenth of all training pixels; if it is "  \
        "not given either, voxels have at least 1500 steps",                                       \
        .flags = CLN_ROW_BUDGET)                                                                   \
    INT(log_every, "log-every", 25, 25, 1, 1000000, "steps between rows of metrics.jsonl")         \
    TEXT(eval_at, "eval-at", "", "",                                                               \
         "test PSNR during training at these points: 60s,2m,5m or steps", .flags = CLN_ROW_NONE)   \
    INT(eval_every, "eval-every", 0, 0, 0, 1000000000,                                             \
        "test PSNR during training every N steps (0 = never)")                                     \
    INT(eval_images, "eval-images", 8, 8, 1, 1000000, "test images for it, evenly chosen")         \
    REAL(save_every, "save-every", 300, 300, 1, 1e9, "seconds between checkpoints",                \
         .flags = CLN_ROW_SECONDS)                                                                 \
    TEXT(save_at, "save-at", "", "",                                                               \
         "keeps the model at these points, each as a run in RUN/at: 60s,2m,5m or steps",           \
         .flags = CLN_ROW_LATER | CLN_ROW_NONE)                                                    \
    ENUM(format, "format", CLN_FORMAT_AUTO, CLN_FORMAT_AUTO,                                       \
         "auto|transforms|colmap|llff|neus|nsvf|opensfm|metashape|polycam|record3d",               \
         "what the scene is read as; auto: the first of the others that is there",                 \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER)                                   \
    INT(downscale, "downscale", 0, 0, 0, CLN_MOST_DOWNSCALE,                                       \
        "divide the image size by N with an area filter (0 or auto: each so that its longest "     \
        "side "                                                                                    \
        "is <= 1600)",                                                                             \
        .flags = CLN_ROW_SCENE | CLN_ROW_AUTO)                                                     \
    TEXT(bbox, "bbox", "", "",                                                                     \
         "scene box minx,miny,minz,maxx,maxy,maxz in scene units; none: by the reader",            \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_NONE)                                    \
    ENUM(space, "space", CLN_SPACE_AUTO, CLN_SPACE_AUTO, "auto|cube|ndc|shell",                    \
         "what the tree divides: a cube of the scene, normalised device coordinates for cameras "  \
         "that all look one way, or a cube and a shell that holds all that lies beyond it; auto, " \
         "without --bbox: ndc for LLFF scenes like that, shell for photos without alpha of "       \
         "COLMAP, OpenSfM and nerfstudio",                                                         \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER)                                   \
    TEXT(background, "background", "white", "auto",                                                \
         "white, black, r,g,b in 0..1, or mean, the training photos' mean colour, behind "         \
         "everything; auto: white where a photo has alpha; else the one colour along the photos' " \
         "borders, or mean if they have several",                                                  \
         .flags = CLN_ROW_SCENE)                                                                   \
    INT(holdout, "holdout", 8, 8, 0, 1000000,                                                      \
        "every Nth image is test where no split is named (0 = none)",                              \
        .flags = CLN_ROW_FIXED | CLN_ROW_SCENE)                                                    \
    INT(holdout_from, "holdout-from", 0, 0, 0, 999999,                                             \
        "holdout: the first image that is test, counted from 0; with each number below N, each "   \
        "image is test once",                                                                      \
        .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER)                                    \
    TEXT(test_views, "test-views", "", "",                                                         \
         "file with the names of the photos that are test, one a line, instead of --holdout; all " \
         "others train",                                                                           \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER | CLN_ROW_NONE | CLN_ROW_FILE)     \
    TEXT(train_views, "train-views", "", "",                                                       \
         "file with the names of the photos to train on, one a line, instead of all that are not " \
         "test; the others are val",                                                               \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER | CLN_ROW_NONE | CLN_ROW_FILE)     \
    ENUM(missing, "missing", CLN_MISSING_AUTO, CLN_MISSING_AUTO, "auto|skip|fail",                 \
         "frames whose image is not there or cannot be read: leave them out while they are fewer " \
         "than a tenth, leave them out however many (and photos without alpha or mask, where "     \
         "most cut an object out), or refuse the scene",                                           \
         .flags = CLN_ROW_SCENE | CLN_ROW_LATER)                                                   \
    ENUM(masks, "masks", CLN_MASKS_IGNORE, CLN_MASKS_AUTO,                                         \
         "auto|alpha|ignore|inverted|ignore-white",                                                \
         "masks beside photos: the alpha of an object, outside of which is nothing, or pixels "    \
         "that do not count; auto: alpha if nearly all keep one part around the middle and drop "  \
         "the border; inverted: alpha, black is the object; ignore-white: what is white does not " \
         "count",                                                                                  \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER)                                   \
    BOOL(multiplied_alpha, "multiplied-alpha", false, false,                                       \
         "photos with alpha: colours are multiplied by it, as of cut-outs over black: divide",     \
         .flags = CLN_ROW_FIXED | CLN_ROW_SCENE | CLN_ROW_LATER)                                   \
    REAL(device_mem, "device-mem", 0, 0, 0, 1e15,                                                  \
         "device memory to stay under, bytes or 512M, 4G (0 = by the device)",                     \
         .flags = CLN_ROW_BYTES)                                                                   \
    REAL(host_mem, "host-mem", 0, 0, 0, 1e15,                                                      \
         "host memory to stay under, bytes or 512M, 4G (0 = what the machine has)",                \
         .flags = CLN_ROW_BYTES)                                                                   \
    ENUM(exchange, "exchange", CLN_EXCHANGE_SAMPLES, CLN_EXCHANGE_STRETCHES, "samples|stretches",  \
         "what several processes tell each other of a step: every sample's colour and density, "   \
         "with the bits of one process; or sums of each ray's stretches, which is less",           \
         .flags = CLN_ROW_LATER | CLN_ROW_TIME)

#define CLN_CONFIG_LIST(INT, REAL, BOOL, ENUM, TEXT) \
    CLN_CONFIG_NETWORK(INT, REAL, BOOL, ENUM, TEXT)  \
    CLN_CONFIG_TREE(INT, REAL, BOOL, ENUM, TEXT)     \
    CLN_CONFIG_SAMPLING(INT, REAL, BOOL, ENUM, TEXT) \
    CLN_CONFIG_OPTIM(INT, REAL, BOOL, ENUM, TEXT)    \
    CLN_CONFIG_RUN(INT, REAL, BOOL, ENUM, TEXT)

typedef struct cln_config {
#define CLN_FIELD_INT(field, option, paper, fast, min, max, help, ...)  int field;
#define CLN_FIELD_REAL(field, option, paper, fast, min, max, help, ...) double field;
#define CLN_FIELD_BOOL(field, option, paper, fast, help, ...)           bool field;
#define CLN_FIELD_ENUM(field, option, paper, fast, words, help, ...)    int field;
#define CLN_FIELD_TEXT(field, option, paper, fast, help, ...)           char field[CLN_TEXT_BYTES];
    CLN_CONFIG_LIST(CLN_FIELD_INT, CLN_FIELD_REAL, CLN_FIELD_BOOL, CLN_FIELD_ENUM, CLN_FIELD_TEXT)
#undef CLN_FIELD_INT
#undef CLN_FIELD_REAL
#undef CLN_FIELD_BOOL
#undef CLN_FIELD_ENUM
#undef CLN_FIELD_TEXT
} cln_config;

#endif
