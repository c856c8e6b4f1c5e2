/* A model on the host: tree, packed weights, its place in the world, and the training state that an
 * exact resume needs. Written to and read from a run's checkpoint. The pipeline uploads from it and
 * downloads into it. No OpenCL. */
#ifndef CLN_MODEL_H
#define CLN_MODEL_H

#include <stdint.h>
#include "model/network.h"
#include "model/octree.h"
#include "scene/space.h"

typedef struct cln_model {
    cln_config config;
    cln_network net;
    cln_octree tree;
    cln_space space; /* of the cube that the tree divides */
    float background[3];
    bool has_alpha, has_distortion; /* of the scene it was trained on */
    float *params;                  /* [slot][net.params] */
    /* Training state; NULL / 0 in a model that only renders. */
    void *adam_m, *adam_v; /* [slot][net.params] float or bfloat16, by config.moments */
    int32_t *adam_steps;   /* [slot] updates so far */
    uint16_t *density;     /* [slot][n1^3] cached stage-1 densities, bfloat16 */
    int64_t step;
    int64_t refresh_step; /* step of the last stage-1 refresh */
    int64_t growth_step;  /* step of the last growth of the tree */
    double train_seconds; /* budget used so far */
    int rays;             /* adapted batch size of the next step */
    int level;            /* growth reached so far */
    /* What the structure optimisation has measured (method.md 12.3); kept with the training
     * state. */
    float *sums;        /* [slot][CLN_MEASURES][2] since the last decision, with compensation */
    int32_t *met;       /* [slot] samples since the last decision */
    float *error;       /* [slot] e_b of the last decision; NaN before the first */
    float *saved;       /* [slot] cost of the children that were merged into it; NaN = none */
    int64_t sum_rays;   /* rays behind `sums` */
    double sum_square;  /* their summed square errors */
    double last_square; /* mean square error of the interval before; 0 = none */
    int decisions;      /* structure decisions that came due so far */
} cln_model;

/* Of each leaf: error, transmittance-weighted density, its weight (kernels/composite.cl). */
enum { CLN_MEASURES = 3 };

/* Bytes of one of Adam's moments of a weight. */
size_t cln_moment_bytes(const cln_config *config);

/* A new model: full tree at config.start_level, or a copy of `tree`; initial weights, training
 * state zero. */
cln_status cln_model_create(const cln_config *config, cln_model *out);
cln_status cln_model_create_on(const cln_config *config, const cln_octree *tree, cln_model *out);
void cln_model_free(cln_model *model); /* accepts a zeroed model */

/* Applies a change of the tree, already made in model->tree by octree.h, to the arrays:
 *   params      copied, folded or unfolded
 *   moments     copied, zero for new leaves; adam_steps and measures likewise
 *   density     copied; for new leaves the nearest cells of the old grid, until the next refresh
 * CLN_MEMORY: the model has no weights any more. */
cln_status cln_model_apply(cln_model *model, const cln_octree_change *change);

/* Follows a change whose leaves are carried over elsewhere (pipeline/carry.h): carries error and
 * saved, and frees params, training state and measures, which are of the tree before.
 * cln_pipeline_download brings them back. CLN_MEMORY. */
cln_status cln_model_follow(cln_model *model, const cln_octree_change *change);

/* Makes the missing arrays of params, and if `training` of training state and measures, as zeros.
 * CLN_MEMORY. */
cln_status cln_model_make_room(cln_model *model, bool training);

/* Starts a new interval of measuring: sums, samples and rays back to zero. Not between a change of
 * the tree and cln_model_apply. */
void cln_model_restart_measures(cln_model *model);

/* Digest of parameters and tree: what `info` prints as model_digest. 0 without weights. */
uint64_t cln_model_digest(const cln_model *model);

/* RUN/checkpoint/NNNNNNNN.safetensors + NNNNNNNN.json (step, seconds, rays, config, cube, digests),
 * then RUN/checkpoint/latest; each by atomic rename; then all but the newest two are removed.
 * CLN_OUTPUT leaves the earlier checkpoints whole. */
cln_status cln_checkpoint_write(const char *run, const cln_model *model);

/* The newest checkpoint that is whole. A damaged newest one is reported by a warning and the one
 * before it is used; none whole is CLN_CHECKPOINT. `training`: also the training state. */
cln_status cln_checkpoint_read(const char *run, bool training, cln_model *out);

#endif
