/* A batch of rays rendered with a pipeline whose tree and weights are uploaded: all pictures, the
 * probe of training (train/probe.h) and live views come from it. */
#ifndef CLN_RAY_BATCH_H
#define CLN_RAY_BATCH_H

#include "pipeline/stages.h"

typedef struct cln_ray_batch {
    const cln_pixel *pixels; /* [n]; for splatting by view (pad), then row (cln_pipeline_batch) */
    int n;
    const float (*backgrounds)[4]; /* r, g, b, 0: [n] if p->ray_background, else [1] */
    unsigned depth;                /* CLN_DEPTH_* */
    cln_sampling sampling;
} cln_ray_batch;

/* The sampling of pictures by p->config: midpoints, densities of pictures, at most the samples of
 * CLN_RENDER_BATCHES batches, or fewer by the memory plan: while training, CLN_TRAINING_BATCHES. */
cln_sampling cln_render_sampling(const cln_pipeline *p);

/* Changes a pipeline's settings for faster, slightly worse pictures (method.md 13). Call it before
 * it is created. */
void cln_render_faster(cln_config *config);

/* Renders the first *rendered rays of the batch, as many as have room for their samples (at least
 * one); results: [n]. Waits for them, also when it fails: the arrays are the caller's again then.
 * CLN_MEMORY, CLN_CL. */
cln_status cln_render_rays(cln_pipeline *p, const cln_ray_batch *batch, cln_ray_result *results,
                           int *rendered);

#endif
