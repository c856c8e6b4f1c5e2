/* Answers what is asked, on the thread that has the device: renders pictures, reads photos, looks
 * up points, makes a film. A picture is rendered batch by batch, so that a large one can wait for
 * small ones. */
#ifndef CLN_PAINTER_H
#define CLN_PAINTER_H

#include "render/view.h"
#include "view/reel.h"
#include "view/request.h"

/* The caller sets the members down to `training`. */
typedef struct cln_painter {
    cln_pipeline *pipeline; /* a painting replaces its cameras; not cropped */
    const cln_model *model; /* gives space and background */
    const cln_scene *scene; /* NULL: no photos */
    bool training; /* the pipeline is a training's: pictures take its densities as they are */
    double seconds_per_pixel; /* of pictures, encoding included; measured */
    cln_reel reel;            /* the film that is made or was made last */
    bool leads;               /* other ranks follow */
    double polled;            /* when they were last asked for signals */
} cln_painter;

/* A request and its answer; the caller zeroes it and sets `ask`. */
typedef struct cln_painting {
    cln_ask ask;
    bool begun;
    cln_rendering rendering;
    double seconds; /* spent on it so far */
    /* the answer */
    int status; /* of HTTP; 0 = not answered yet */
    const char *type;
    uint8_t *body; /* the caller frees it, by cln_painting_free */
    size_t bytes;
    int width, height; /* picture: as rendered */
    bool finer;        /* picture: with `edges` it would be a better one */
    double near, far;  /* ends of a picture's scale of depths (scene units) or errors; else 0 */
    bool is_file;      /* the answer is a film's file, not the body */
    int file;          /* its descriptor, the caller's */
    const char *file_name;
} cln_painting;

/* Prepares the densities of pictures, unless `training`, and renders some small ones, of `first`,
 * to learn the device's speed. CLN_CL, CLN_MEMORY. */
cln_status cln_painter_open(cln_painter *painter, const cln_camera *first);

/* Continues a painting by one batch; it is done when its status is not 0. An error of one painting
 * (no memory for its size, a photo that cannot be read) becomes its answer; errors of the device,
 * and those in a batch that other ranks render, too, are returned. */
cln_status cln_painter_step(cln_painter *painter, cln_painting *painting);

/* With a pipeline that ranks share, rank 0 paints, and each of its batches of rays takes all of
 * them: the others follow it, instead of opening a painter, until it says that there are no more.
 * CLN_CL, CLN_MEMORY. */
cln_status cln_painter_follow(cln_painter *painter, const cln_callbacks *callbacks);

/* Tells those that follow, if any do, that there are no more batches. */
void cln_painter_end(cln_painter *painter);

/* Polls `interrupted` (may be NULL), about once a second on the ranks that follow, too; 0: none. */
int cln_painter_signal(cln_painter *painter, const cln_callbacks *callbacks);

/* Makes a sentence the answer. */
void cln_painting_say(cln_painting *painting, int status, const char *sentence);
void cln_painting_free(cln_painting *painting); /* its contents */

/* The client has gone: if the painting was a film's frame, drops the film. */
void cln_painter_forget(cln_painter *painter, const cln_painting *painting);

#endif
