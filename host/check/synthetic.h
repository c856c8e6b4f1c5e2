/* Synthetic training work for the tuner and the benches: a function of the settings, the same each
 * time. No scene, no files; it learns nothing. */
#ifndef CLN_SYNTHETIC_H
#define CLN_SYNTHETIC_H

#include "pipeline/plan.h"
#include "pipeline/stages.h"

enum { CLN_SYNTHETIC_VIEWS = 4 };

/* A training step on an object in the middle of the cube, seen from four sides. */
typedef struct cln_synthetic {
    cln_model model;
    cln_camera cameras[CLN_SYNTHETIC_VIEWS];
    cln_pixel *pixels;   /* [initial rays] by view, then row */
    float (*targets)[4]; /* [initial rays] */
    cln_ray_result *results;
    int rays; /* of a step */
    cln_sampling sampling;
    size_t max_entries;
    int used;                 /* rays of the last step whose samples fit */
    uint32_t samples, slices; /* of the last step */
} cln_synthetic;

/* Makes a ball of leaves at --start-level or, if --level-at goes deeper, at its last level, at most
 * 3; networks, sampling, loss and batch are the settings'; stage 1 has at most 2^21 cells.
 * CLN_MEMORY if the device has no room for it. */
cln_status cln_synthetic_create(cln_device *device, const cln_config *config, cln_synthetic *out);

/* The same with a ball of about `leaves` leaves, as a tree that has grown: of the level at which
 * they are a ball of the usual size or smaller. */
cln_status cln_synthetic_create_grown(cln_device *device, const cln_config *config, int leaves,
                                      cln_synthetic *out);
void cln_synthetic_free(cln_synthetic *s); /* accepts a zeroed one */

/* Uploads tree, weights and cameras to a pipeline made for s->model.config. */
cln_status cln_synthetic_upload(const cln_synthetic *s, cln_pipeline *p);

/* Runs every stage of a training step except sparsity and edge, with a learning rate that changes
 * nothing, and waits for its end. */
cln_status cln_synthetic_step(cln_synthetic *s, cln_pipeline *p);

/* Gives the steps to come `rays` rays, at most the settings' --rays. */
void cln_synthetic_draw(cln_synthetic *s, int rays);

/* Halves the rays until a step takes at most `seconds` (or 256 are left). */
cln_status cln_synthetic_settle(cln_synthetic *s, cln_pipeline *p, double seconds);

#endif
