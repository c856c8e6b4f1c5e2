/* Draws the pixels of a training step and their true colours. Host work: images stay 8-bit in host
 * memory, the device gets one batch of pixels. A pixel is a pure function of (seed, step, ray) and
 * the tree, so checkpoints need not store any. */
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
    float (*shown)[4];       /* [ray] sparse point x, y, z in the cube, its weight; or NULL */
    int train_views;
    uint64_t *first;       /* [train_views + 1] pixels before view i */
    cln_coverage coverage; /* the owner keeps it up to date */
} cln_batch;

typedef struct cln_draw {
    uint32_t step;
    int n; /* rays */
    bool ray_background;
    bool covered; /* only covered tiles of batch->coverage, at least one; gather only */
    double depth; /* > 0: every CLN_SIGHT_EVERY-th ray goes to a sparse point, of this weight times
                     its trust */
    const cln_space *space; /* of the cube, for the sparse points */
} cln_draw;

enum { CLN_SIGHT_EVERY = 8 };

/* Whether some rays go to sparse points: the scene has such points, and there is a depth loss. */
bool cln_batch_knows(const cln_scene *scene, const cln_config *config);
static inline bool cln_batch_is_sight(int ray)
{
    return ray % CLN_SIGHT_EVERY == CLN_SIGHT_EVERY - 1;
}

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out);
void cln_batch_free(cln_batch *batch);

/* Returns whether a training step skips pixels that see no leaf. */
bool cln_batch_skips(const cln_batch *batch, const cln_config *config, int64_t step);

/* Draws n <= capacity rays for a step. Gather: uniform over all training pixels, or over the
 * covered ones. Splat: uniform over the pixels of config.views_per_batch views, ordered by view,
 * then row. */
void cln_batch_draw(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                    const cln_draw *draw);

#endif
