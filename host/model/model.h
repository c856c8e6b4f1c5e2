/* A model on the host: tree, packed weights, its place in the world, and the training state for an
 * exact resume. Checkpoints hold it; the pipeline uploads from it and downloads into it. No
 * OpenCL. */
#ifndef CLN_MODEL_H
#define CLN_MODEL_H

#include <stdint.h>
#include "base/files.h"
#include "model/network.h"
#include "model/octree.h"
#include "scene/motion.h"
#include "scene/space.h"

enum { CLN_EXPOSURE = 9 }; /* numbers of a photo's exposure, below */

/* Steps since the last row of metrics.jsonl: what the next one has of them so far. */
typedef struct cln_row_sums {
    int64_t steps, rays, samples;
    double loss, square; /* sums of the steps' means */
    double began;        /* train_seconds at its start */
} cln_row_sums;

typedef struct cln_model {
    cln_config config;
    cln_network net;
    cln_octree tree;
    cln_space space; /* space of the cube that the tree divides */
    float background[3];
    bool has_alpha, has_distortion; /* of the scene it was trained on */
    float *params;                  /* [slot][net.params] */
    float *decoder;                 /* [net.decoder_params] */
    /* Training state; NULL / 0 in a model that only renders. */
    /* [slot][net.params] float or bfloat16, by config.moments; adam_m: or no bytes at all */
    void *adam_m, *adam_v;
    float *decoder_m, *decoder_v; /* [net.decoder_params] Adam's moments of the decoder */
    int32_t *adam_steps;          /* [slot] updates so far */
    uint16_t *density;            /* [slot][n1^3] cached stage-1 densities, bfloat16 */
    int64_t step;
    int64_t refresh_step; /* step of the last stage-1 refresh */
    int64_t growth_step;  /* step of the last growth of the tree */
    double train_seconds; /* budget used so far */
    cln_row_sums row;     /* of the metrics so far */
    int rays;             /* adapted batch size of the next step */
    int level;            /* growth reached so far */
    int64_t drawn;        /* pixels of the photos that training has drawn */
    bool averaged;        /* pixels at edges are means of several rays by now */
    bool in_parts;        /* its device has arrays P in parts, and keeps them so (pipeline.h) */
    /* Measures of the structure optimisation (method.md 12.3); kept with the training state. */
    float *sums;        /* [slot][CLN_MEASURES][2] since the last decision, with compensation */
    int32_t *met;       /* [slot] samples since the last decision */
    float *error;       /* [slot] e_b, of a checkpoint that since the last decision; NaN = none */
    float *saved;       /* [slot] cost of the children merged into it; NaN = none */
    int64_t sum_rays;   /* rays that `sums` cover */
    double sum_square;  /* sum of their squared errors */
    double last_square; /* mean squared error of the interval before; 0 = none */
    int decisions;      /* structure decisions due so far */
    /* Exposure of training photos (train/exposure.h): gains r, g, b, then per channel the sums of
     * rendered times photographed colour and of rendered colour squared; NULL without. */
    float (*exposure)[CLN_EXPOSURE]; /* [exposure_views] */
    int exposure_views;
    bool exposed; /* photos are divided by the gains; else these are only measured so far */
    /* Corrections of the training cameras' poses (scene/motion.h), in the split's order; NULL
     * without --refine-poses. A model that only renders has them, too. */
    float (*motions)[CLN_MOTION]; /* [motion_views] */
    int motion_views;
    uint64_t training_names; /* of exposure's and motions' views (cln_scene_training_names); or 0 */
} cln_model;

/* n x n rays make a pixel at an edge, in training and in pictures: 1 until --antialias-after. */
int cln_model_antialias(const cln_model *model);

/* The gains r, g, b by which a training view's photo is divided; NULL: it is not. */
const float *cln_model_gains(const cln_model *model, int view);

/* Measures of a leaf: error, transmittance-weighted density, its weight (kernels/composite.cl). */
enum { CLN_MEASURES = 3 };

/* Bytes of one of Adam's moments of a weight. */
size_t cln_moment_bytes(const cln_config *config);

/* The same for the first moment: 0 if nothing keeps one (voxels with --beta1 0). */
size_t cln_first_moment_bytes(const cln_config *config);

/* The tree that a training begins with, before leaves that are empty by geometry are culled: full,
 * of config.start_level; shell: that of a shell space, where start_level is one less than the level
 * of the core's leaves, and at least 2. *level: the growth reached. CLN_MEMORY, CLN_USAGE. */
cln_status cln_model_first_tree(const cln_config *config, bool shell, cln_octree *out, int *level);

/* Create a model on that tree, or on a copy of `tree`: initial weights, zero training state. */
cln_status cln_model_create(const cln_config *config, cln_model *out);
cln_status cln_model_create_shell(const cln_config *config, cln_model *out);
cln_status cln_model_create_on(const cln_config *config, const cln_octree *tree, cln_model *out);
void cln_model_free(cln_model *model); /* accepts a zeroed model */

/* Applies a change that octree.h made in model->tree to the arrays:
 *   params      copied, folded or unfolded
 *   moments     copied, zero for new leaves; adam_steps and measures likewise
 *   density     copied; for new leaves the nearest cells of the old grid, until the next refresh
 * CLN_MEMORY: the model has lost its weights. */
cln_status cln_model_apply(cln_model *model, const cln_octree_change *change);

/* Follows a change that the device carries out (pipeline/carry.h): carries error and saved, and
 * frees params, training state and measures of the old tree. cln_pipeline_download brings the new
 * ones. CLN_MEMORY. */
cln_status cln_model_follow(cln_model *model, const cln_octree_change *change);

/* Allocates missing arrays as zeros: params, and if `training` training state and measures.
 * CLN_MEMORY. */
cln_status cln_model_make_room(cln_model *model, bool training);

/* Starts a new interval of measuring: zeroes sums, samples and rays. Not between a change of the
 * tree and cln_model_apply. */
void cln_model_restart_measures(cln_model *model);

/* Digest of parameters and tree: what `info` prints as model_digest. 0 without weights. */
uint64_t cln_model_digest(const cln_model *model);
/* Begins that digest; the caller adds the parameters, leaf by leaf. */
void cln_model_digest_begin(const cln_model *model, cln_digest_part *out);

/* Writes RUN/checkpoint/NNNNNNNN.safetensors, NNNNNNNN.json (step, seconds, rays, config, cube,
 * digests) and RUN/checkpoint/latest, each by atomic rename; then removes all but the newest two.
 * CLN_OUTPUT leaves the earlier checkpoints whole. */
cln_status cln_checkpoint_write(const char *run, const cln_model *model);

/* The same by all ranks, each of which has the weights and Adam's state of leaves [first[rank],
 * first[rank + 1]) and the rest in full: each writes its rows of the one file, which rank 0 renames
 * when all have. Fails on all ranks if it fails on one. *written: false, with nothing done, if not
 * all ranks see the file, and so rank 0 must write it alone; else *model_digest is all ranks'
 * cln_model_digest(). CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_checkpoint_write_parts(const char *run, const cln_model *model, const int *first,
                                      uint64_t *model_digest, bool *written);

/* *bytes: size of one checkpoint of so many leaves, with training state. */
cln_status cln_checkpoint_bytes(const cln_config *config, int leaves, double *bytes);

/* *bytes: disk space that checkpoints may still need with the largest tree that the settings allow
 * in a shell space or another: for the two that are kept and the one being written, less what RUN
 * already has (NULL: nothing). */
cln_status cln_checkpoint_room(const char *run, const cln_config *config, bool shell,
                               double *bytes);

/* *exists: RUN has a checkpoint, whole or not. CLN_CHECKPOINT if none can be listed. */
cln_status cln_checkpoint_exists(const char *run, bool *exists);

/* The step of RUN's newest checkpoint, whole or not; -1 if there is none, or none can be listed. */
int64_t cln_checkpoint_newest(const char *run);

/* The step of the newest one that looks whole, by the length of its tensors' file, which is quicker
 * than to read it; -1 if there is none. */
int64_t cln_checkpoint_newest_whole(const char *run);

/* The size of the newest one's tensors; 0 if there is none. The next one is about as large. */
double cln_checkpoint_newest_bytes(const char *run);

/* Reads the newest whole checkpoint, with a warning for each damaged one after it. training: also
 * the training state. CLN_CHECKPOINT if none is whole. */
cln_status cln_checkpoint_read(const char *run, bool training, cln_model *out);

#endif
