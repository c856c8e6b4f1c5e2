/* Draws the pixels of a training step and their true colours. Host work: images stay 8-bit in host
 * memory, the device gets one batch of pixels. A pixel is a pure function of (seed, step, ray) and
 * the tree, so a resume needs nothing stored. */
#ifndef CLN_BATCH_H
#define CLN_BATCH_H

#include "device_abi.h"
#include "train/coverage.h"
#include "scene/scene.h"

typedef struct cln_batch {
    int capacity;
    cln_pixel *pixels;       /* [ray] */
    float (*targets)[4];     /* [ray] r, g, b over its background, alpha */
    float (*backgrounds)[4]; /* [ray] with random_background, else [1] */
    int train_views;
    uint64_t *first;       /* [train_views + 1] pixels before view i */
    cln_coverage coverage; /* the owner keeps it up to date */
} cln_batch;

typedef struct cln_draw {
    uint32_t step;
    int n; /* rays */
    bool ray_background;
    bool covered; /* only pixels of batch->coverage, which has some; gather only */
} cln_draw;

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out);
void cln_batch_free(cln_batch *batch);

/* Returns whether a training step leaves out pixels without a leaf before them. */
bool cln_batch_skips(const cln_batch *batch, const cln_config *config, int64_t step);

/* Draws n <= capacity rays for a step. Gather: uniform pixels of all training pixels, or of the
 * covered ones. Splat: uniform pixels of config.views_per_batch views, ordered by view, then
 * row. */
void cln_batch_draw(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                    const cln_draw *draw);

#endif
