/* Which pixels a training step looks at, and the colours it should find there. Host work: images stay
 * 8-bit in host memory, the device gets one batch of pixels. A pixel is a pure function of (seed, step,
 * ray) and the tree, so nothing has to be stored to resume. */
#ifndef CLN_BATCH_H
#define CLN_BATCH_H

#include "device_abi.h"
#include "train/coverage.h"
#include "scene/scene.h"

typedef struct cln_batch {
    int capacity;
    cln_pixel *pixels;       /* [ray] */
    float (*targets)[4];     /* [ray] r, g, b over its background, 0 */
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

/* Does a training step leave out pixels without a leaf before them? */
bool cln_batch_skips(const cln_batch *batch, const cln_config *config, int64_t step);

/* Draws n <= capacity rays for a step. Gather: pixels uniform over all training pixels, or over the covered ones.
 * Splat: config.views_per_batch views, ordered by view, then row; pixels uniform in each. */
void cln_batch_draw(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                    const cln_draw *draw);

#endif
