/* Which pixels a training step looks at, and the colours it should find there. Host work: images stay
 * 8-bit in host memory, the device gets one batch of pixels. A pixel is a pure function of (seed, step,
 * ray), so nothing has to be stored to resume. */
#ifndef CLN_BATCH_H
#define CLN_BATCH_H

#include "device_abi.h"
#include "scene/scene.h"

typedef struct cln_batch {
    int capacity;
    cln_pixel *pixels;       /* [ray] */
    float (*targets)[4];     /* [ray] r, g, b over its background, 0 */
    float (*backgrounds)[4]; /* [ray] with random_background, else [1] */
    int train_views;
    uint64_t *first; /* [train_views + 1] pixels before view i */
} cln_batch;

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out);
void cln_batch_free(cln_batch *batch);

/* Draws n <= config.rays rays for a step. Gather: pixels uniform over all training pixels. Splat:
 * config.views_per_batch views, ordered by view, then row. */
void cln_batch_draw(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                    bool ray_background, uint32_t step, int n);

#endif
