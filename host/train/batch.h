/* Draws the pixels of a training step and their true colours. Host work: images stay 8-bit in host
 * memory, of several ranks each image on one, and the device gets one batch of pixels. A pixel is a
 * pure function of (seed, step, its number) and the tree, so checkpoints need not store any. */
#ifndef CLN_BATCH_H
#define CLN_BATCH_H

#include "device_abi.h"
#include "train/coverage.h"
#include "train/photo_edges.h"
#include "ranks/rows.h"
#include "scene/scene.h"

typedef struct cln_batch {
    int capacity;
    cln_pixel *pixels;       /* [ray] */
    uint8_t (*stored)[4];    /* [ray] channels of the pixels, as photos have them; of 3 channels
                                before a backdrop the fourth tells what stands before it */
    cln_rows asked;          /* of these, from ranks that have the photos */
    float (*targets)[4];     /* [ray] r, g, b over its background, alpha or CLN_ALPHA_UNTOLD */
    float (*backgrounds)[4]; /* [ray] with random_background, else [1] */
    int drawn;               /* pixels that are drawn ... */
    int n;                   /* their rays ... */
    bool ray_background;     /* ... each over a background of its own */
    float (*shown)[4];       /* [ray] sparse point x, y, z in the cube, its weight; or NULL */
    int train_views;
    uint64_t *first;       /* [train_views + 1] pixels before view i */
    cln_coverage coverage; /* the owner keeps it up to date ... */
    cln_photo_edges edges; /* ... and finds these before a draw with antialias > 1 */
} cln_batch;

typedef struct cln_draw {
    uint32_t step;
    int n;         /* rays */
    int antialias; /* above 1: pixels at edges of their photo have antialias^2 rays; gather only */
    bool ray_background;
    bool covered; /* only covered tiles of batch->coverage, at least one; gather only */
    double depth; /* > 0: every CLN_SIGHT_EVERY-th pixel is left for a ray to a sparse point, of
                     this weight times its trust */
    const cln_space *space; /* of the cube, for the sparse points */
} cln_draw;

enum { CLN_SIGHT_EVERY = 8 };

/* Whether some rays go to sparse points: the scene has such points, and there is a depth loss. */
bool cln_batch_knows(const cln_scene *scene, const cln_config *config);

/* Whether the pixel of this number is left for one, in a draw that has them. */
static inline bool cln_batch_is_sight(int pixel)
{
    return pixel % CLN_SIGHT_EVERY == CLN_SIGHT_EVERY - 1;
}

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out);
void cln_batch_free(cln_batch *batch);

/* Host bytes that grow with the scene's training views: of coverage and edges. */
double cln_batch_bytes(const cln_scene *scene);

/* Returns whether a training step skips pixels that see no leaf. */
bool cln_batch_skips(const cln_batch *batch, const cln_config *config, int64_t step);

/* Draws n <= capacity rays for a step. Gather: uniform over all training pixels, or over the
 * covered ones; the rays of a pixel follow each other, and the last pixel has those that there is
 * room for. Splat: uniform over the pixels of config.views_per_batch views, ordered by view, then
 * row. In two calls: begin draws pixels and backgrounds and asks ranks for the photos'
 * colours, colour waits for these; another begin may take its place. Draw: both. */
void cln_batch_begin(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                     const cln_draw *draw);
void cln_batch_colour(cln_batch *batch, const cln_scene *scene);
void cln_batch_draw(cln_batch *batch, const cln_scene *scene, const cln_config *config,
                    const cln_draw *draw);

/* Forgets what was asked for: no message is on its way then. */
void cln_batch_forget(cln_batch *batch);

/* Brings the stored channels of batch->pixels, n <= capacity, to all ranks, in batch->stored. */
void cln_batch_look(cln_batch *batch, const cln_scene *scene, int n);

#endif
