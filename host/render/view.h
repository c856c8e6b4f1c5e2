/* One view rendered with a pipeline whose tree and weights are uploaded: the way every picture is
 * made, for eval, render and the evaluations during training. Training's own densities stay as they
 * are. */
#ifndef CLN_VIEW_H
#define CLN_VIEW_H

#include "pipeline/pipeline.h"
#include "render/antialias.h"
#include "render/picture.h"
#include "render/ray_batch.h"

/* Makes the densities of pictures, at cell centres; call it again after a change of tree or
 * weights. CLN_MEMORY, CLN_CL. */
cln_status cln_render_prepare(cln_pipeline *p);

/* Gives back the memory of the densities of pictures. */
void cln_render_release(cln_pipeline *p);

/* Renders view number `view` of the cameras given to cln_pipeline_cameras. depth:
 * CLN_DEPTH_*. `interrupted` (may be NULL) is polled between batches and ends the picture with
 * CLN_SIGINT / CLN_SIGTERM. With p->antialias n > 1, pixels at edges (antialias.h) are the mean of
 * n x n rays. */
cln_status cln_render_view(cln_pipeline *p, int view, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_picture *out);

/* The same, shown as work pixel by pixel: of one picture that takes long, as a map does. */
cln_status cln_render_large(cln_pipeline *p, int view, const float background[3], unsigned depth,
                            const cln_callbacks *callbacks, cln_picture *out);

/* The same batch by batch, for callers that do other work in between: begin, step until it is
 * whole, end. In between, the pipeline may have other cameras and another `antialias` if these are
 * put back before the next step. */
typedef struct cln_rendering {
    cln_picture picture;
    int done;            /* pixels with the ray through their centre, in the order of these */
    int antialias;       /* the pipeline's when it began */
    cln_antialias edges; /* once all are done */
    int view, most;      /* most: rays of a batch */
    int next, side; /* rays of the next batch; squares of side x side pixels are taken in turn, 1:
                       row by row */
    bool under_way; /* of a batch that failed: other ranks may be in the middle of it */
    cln_pixel *pixels;
    cln_ray_result *results;
    float (*backgrounds)[4];
    cln_ray_batch batch;
} cln_rendering;

cln_status cln_rendering_begin(cln_pipeline *p, int view, const float background[3], unsigned depth,
                               cln_rendering *out);
/* The same for a rank that renders batches of a picture that another one keeps: without `picture`'s
 * arrays. The caller sets `done` and `next`. r: zeroed, or of earlier batches, whose arrays it
 * takes over. The caller ends it, also after a failure. */
cln_status cln_rendering_follow(cln_pipeline *p, int view, const float background[3],
                                cln_rendering *r);
cln_status cln_rendering_step(cln_pipeline *p, cln_rendering *r);
bool cln_rendering_whole(const cln_rendering *r);
void cln_rendering_end(cln_rendering *r); /* accepts a zeroed one */

/* Like cln_render_view of view 0, into arrays that are there: all of r->picture. r: zeroed, or of
 * an earlier one, whose other arrays it takes over. The caller ends it, also after a failure. */
cln_status cln_render_into(cln_pipeline *p, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_rendering *r);

#endif
