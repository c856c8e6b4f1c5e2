/* Gains of the training photos: how much brighter each is than the scene, by channel, so that
 * exposure and white balance that change from photo to photo need not become fog or colours that
 * depend on the direction (--exposure). A photo is compared with the scene as photo / gain.
 * cln_model.exposure has the gains, and checkpoints store them.
 *
 * With --exposure=auto, the default, they are only measured until the first update. From then on
 * photos are divided by them if they differ enough, as those of the photos before and after do, and
 * as marks that two photos show do, unless these fade with their distance from the camera, as under
 * a lamp that goes along; if not, there are none. Where marks differ by much more than gains do, as
 * the scene has learnt the rest, gains then are those of the marks, also with --exposure. (Of
 * several processes the first asks marks, of its own photos.)
 *
 * Every EXPOSURE_STEPS steps a gain becomes the least-squares factor from rendered colours to the
 * photo's, over the rays so far, of which each update halves the weight. Then all gains are divided
 * by their geometric mean over the views, as a common factor belongs to the scene's colours.
 * Held-out views have gain 1. */
#ifndef CLN_EXPOSURE_H
#define CLN_EXPOSURE_H

#include "model/model.h"
#include "train/batch.h"

/* The photos that a step's rays are compared with. */
typedef struct cln_exposure_rays {
    int n;
    int32_t *view;     /* [ray] training view; -1: the ray does not count */
    float (*photo)[3]; /* [ray] the photo's colour */
} cln_exposure_rays;

typedef struct cln_exposure {
    int capacity, views;
    cln_exposure_rays rays[2]; /* of even and odd steps: results arrive a step late */
    int32_t *number_of;        /* [view of the scene] which training view it is */
} cln_exposure;

/* Makes gains of 1 for every training view, if the model has none yet and training is to have them
 * or to measure them. If not, and if the images have alpha, there are none, and the functions below
 * do nothing. Gains of other photos begin anew. */
cln_status cln_exposure_start(const cln_scene *scene, int capacity, cln_model *model,
                              cln_exposure *out);
void cln_exposure_free(cln_exposure *exposure); /* accepts a zeroed one */

/* Are gains updated before this step? All results must then have been added. */
bool cln_exposure_due(const cln_exposure *exposure, int64_t step);
cln_status cln_exposure_update(cln_exposure *exposure, const cln_scene *scene, int64_t step,
                               cln_model *model);

/* Divides a colour of a photo (view of the scene) by its gains; the targets of a batch's n rays. */
void cln_exposure_divide(const cln_exposure *exposure, const cln_model *model, int view,
                         float rgb[3]);
void cln_exposure_divide_batch(const cln_exposure *exposure, const cln_model *model,
                               cln_batch *batch, int n);

/* Does that for a step, and keeps their photos' colours for cln_exposure_add. */
void cln_exposure_apply(cln_exposure *exposure, const cln_model *model, cln_batch *batch,
                        int64_t step, int n);

/* Adds the results of a step's first n rays to their photos' sums. */
void cln_exposure_add(const cln_exposure *exposure, const cln_ray_result *results, int64_t step,
                      int n, cln_model *model);

/* Tells the range of the gains. */
void cln_exposure_say(const cln_exposure *exposure, const cln_model *model);

#endif
