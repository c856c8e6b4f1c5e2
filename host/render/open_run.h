/* A trained run opened for pictures: newest checkpoint (weights only), scene, device, programs.
 * Eval and render share it. Writes nothing. */
#ifndef CLN_OPEN_RUN_H
#define CLN_OPEN_RUN_H

#include "pipeline/stages.h"

typedef struct cln_open_run {
    const char *run;
    cln_model model;
    cln_scene *scene; /* NULL after cln_open_run_model; poses as training refined them */
    bool same_scene;  /* the scene is the one that the run was trained on */
    bool refined;     /* its training views have the poses that training refined */
    cln_device *device;
    /* Of the start, unless changed before it: programs to build, those of pictures; faster,
     * slightly worse pictures (cln_render_faster), not. */
    uint32_t wanted;
    bool fast;
    double view_pixels, picture_pixels; /* as in cln_plan_desc, 0 */
    cln_pipeline pipeline;
} cln_open_run;

/* Opens the checkpoint and the scene (NULL = the run's own, where cln_recorded_load finds it) with
 * the images of these splits; a scene that is given for its images needs no training view. No
 * device yet. callbacks: told of the images; NULL: none. CLN_SIGINT,
 * CLN_SIGTERM: they stopped it. */
cln_status cln_open_run_open(const char *run, const char *scene, const bool pixels[CLN_SPLITS],
                             const cln_callbacks *callbacks, cln_open_run *out);

/* Opens the checkpoint and the scene's cameras, for what needs no photo. If the scene cannot be
 * read and `scene` names no other, the cameras are those that the run keeps, if it does, which a
 * line tells. *alike: after CLN_INPUT, whether all ranks got that. */
cln_status cln_open_run_cameras(const char *run, const char *scene, const cln_callbacks *callbacks,
                                bool *alike, cln_open_run *out);

/* Opens the checkpoint alone, for what needs no scene. */
cln_status cln_open_run_model(const char *run, cln_open_run *out);

/* Opens the device, checks the memory plan, builds the programs and uploads tree and weights: of
 * several ranks (ranks/ranks.h), each those of its own leaves. The caller uploads cameras. lenses:
 * of the views that will be rendered (cln_camera_lenses). */
cln_status cln_open_run_start(cln_open_run *opened, const cln_device_desc *device, unsigned lenses);

/* Plans memory anew, once view_pixels or picture_pixels have changed; the start does it, too. After
 * a failure, the plan before holds. CLN_MEMORY. */
cln_status cln_open_run_plan(cln_open_run *opened);

void cln_open_run_close(cln_open_run *opened); /* accepts a zeroed one */

/* n x n rays that pixels at edges get: as many as are asked for, or, of 0, as in training. */
int cln_open_run_antialias(const cln_open_run *opened, int asked);

/* Finds a split by its name: "train", "val" or "test", of which the scene has views; with `all`
 * also "all", which is CLN_SPLITS. CLN_USAGE, CLN_INPUT. */
cln_status cln_open_run_split(const cln_scene *scene, const char *name, bool all, cln_split *split);

#endif
