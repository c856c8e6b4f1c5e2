/* What the memory plans (plan.h) of a training have room for: all of the largest tree or a part of
 * it, and the photos' pixels in memory or in a file (scene/store.h).
 *
 * The largest tree is a bound that few trainings come to, and growth that does not fit is left out.
 * So photos come first, up to a quarter of host memory: drawing them from a file takes twenty times
 * as long, and where the system has no memory for that file either, a disk's time. Larger ones give
 * way to leaves, but for a cache. Wherever they lie, the same pixels are drawn. */
#ifndef CLN_ROOM_H
#define CLN_ROOM_H

#include "pipeline/plan.h"

/* Of host memory: what photos may take before leaves get what they may need; and how much of those
 * that lie in a file is in memory, at most. */
#define CLN_ROOM_PHOTOS 0.25
#define CLN_ROOM_CACHED 0.125

typedef struct cln_room_desc {
    cln_device *device;
    const cln_config *config;
    const cln_scene *scene; /* cameras; pixels need not be loaded */
    int leaves, depth;      /* the largest tree; depth 0: as deep as it may become */
    int first, first_depth; /* the tree that a training begins or goes on with */
    double coverage_bytes;  /* of a training (train/coverage.h); below 0: only pictures are made,
                               of the tree of `leaves` leaves */
    double photos;          /* bytes of the photos' pixels */
} cln_room_desc;

typedef struct cln_room {
    cln_plan device, host; /* of the largest tree, with the photos as they will lie */
    cln_plan first_device, first_host;
    bool whole;     /* the largest tree fits, however deep it is */
    bool in_memory; /* all photos' pixels */
    bool budget;    /* they are not because leaves need that memory, beyond the first tree's */
    double kept;    /* bytes of them in memory; 0: there are none */
    int leaves;     /* of the largest tree that fits if it is no deeper than usual; 0: not even
                       the first does */
    double needed;  /* bytes of host memory that it needs, or the first tree does */
    int keeping;    /* --max-leaves with which photos would be in memory; 0: none, or they are */
    int fitting;    /* --max-leaves with which the largest tree would fit; likewise */
} cln_room;

/* The desc of a training's room, from the tree that it has (NULL: the first one of the settings) to
 * the largest. */
cln_room_desc cln_room_training(cln_device *device, const cln_config *config,
                                const cln_scene *scene, const cln_octree *tree,
                                double coverage_bytes, double photos);

/* What a training has by itself where none is given: --batch-samples, in halves, until its first
 * tree fits, and of a tree that grows until a step's arrays take no more than half of the memory
 * that the first tree leaves (device, host), as what they take leaves cannot; where not even the
 * smallest fits, and `rays_too`, --rays in halves as well. Those of the settings where the largest
 * tree fits, or nothing does. The same settings, scene and limits of memory give the same.
 * CLN_MEMORY, CLN_USAGE: as cln_pipeline_outline. */
cln_status cln_room_fit_batch(const cln_room_desc *desc, bool rays_too, int *samples, int *rays);

/* CLN_MEMORY, CLN_USAGE: as cln_pipeline_outline. */
cln_status cln_room_find(const cln_room_desc *desc, cln_room *out);

/* Called before a pipeline is made, desc->photos being those that are loaded: brings the scene's
 * pixels to where cln_room_find wants them, with a sentence that says why. *out is what it finds.
 * CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_room_place_images(const cln_room_desc *desc, cln_scene *scene, cln_room *out);

enum { CLN_ROOM_TEXT = 1536 };

/* Of a batch that was fitted: what it is instead of that of the settings; "" if it is the same. */
void cln_room_say_batch(const cln_room_desc *desc, int samples, int rays, char out[CLN_ROOM_TEXT]);

/* Of a tree far below --max-leaves, where pictures of the photos' size take a quarter of host
 * memory and more: the --downscale that makes them small; 0 elsewhere. */
int cln_room_downscale(const cln_room_desc *desc, const cln_room *room);

/* What becomes of a tree beyond memory, in words; of photos that take a file, or that stay before
 * leaves; and of a plan beyond what is free now: `available` (base/memory.h). *now: already the
 * first tree's is. "" if there is nothing to say. */
void cln_room_say_tree(const cln_room_desc *desc, const cln_room *room, char out[CLN_ROOM_TEXT]);
void cln_room_say_photos(const cln_room_desc *desc, const cln_room *room, char out[CLN_ROOM_TEXT]);
void cln_room_say_free(const cln_room_desc *desc, const cln_room *room, double available, bool *now,
                       char out[CLN_ROOM_TEXT]);

#endif
