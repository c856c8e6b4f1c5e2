/* Corrects the poses of the training cameras by their photos (--refine-poses, method.md 11). Each
 * camera has a motion (scene/motion.h) relative to the pose that the scene gives it. The motions
 * are in cln_model.motions and in checkpoints; the scene's training views have the corrected poses
 * during training. Held-out views keep theirs.
 *
 * Every EVERY steps some cameras, in turn, take a Gauss-Newton step. At pixels where the photo has
 * contrast it compares the rendered colour with the photo's. The rendered colour changes with the
 * camera's motion by its slope between neighbouring pixels, times the motion in the image of the
 * surface point at the rendered depth (Lucas and Kanade, 1981, here for a rendered picture). So no
 * gradient passes the leaves. A step is kept if it clearly lowers the error at other pixels. The
 * motion that all cameras have in common is removed. All this depends only on seed, step, model and
 * photos. */
#ifndef CLN_REFINE_H
#define CLN_REFINE_H

#include "train/trainer.h"

/* Makes the model's motions if it has none, and moves the training views by them; does nothing
 * without config.refine_poses. CLN_CHECKPOINT if the motions are of another number of views. */
cln_status cln_refine_start(cln_trainer *t);
void cln_refine_free(cln_refine *refine); /* accepts a zeroed one */

/* Corrects poses on host and device if a correction is due before the next step, and updates what
 * the training views see. fraction: 0..1 of the budget. */
cln_status cln_refine_poses(cln_trainer *t, double fraction);

/* The camera that was turned far more than the others, an index of training views, or -1; median:
 * degrees of all, NAN of too few. */
int cln_refine_outlier(const cln_model *m, double *median);

/* Tells how far the cameras are from their given poses. */
void cln_refine_say(const cln_trainer *t);

/* One camera's pixel, and what its photo shows there; x is -1 if none was found. */
typedef struct cln_spot {
    int x, y;
    float photo[3];
} cln_spot;

enum { CLN_SPOT_LOOKS = 5 }; /* the pixel, then those left, right, above, below */

typedef struct cln_pose_step {
    double motion[6]; /* relative to the present pose */
    double scale;     /* the residual whose weight is a half */
    double gain[3];   /* of the photo: how much brighter it is than the render */
} cln_pose_step;

/* Solves for a camera's step, from n spots and their renders, looks [n][CLN_SPOT_LOOKS]. False if
 * they do not determine one. */
bool cln_refine_solve(const cln_camera *camera, const cln_space *space, int n,
                      const cln_spot *spots, const cln_ray_result (*looks)[CLN_SPOT_LOOKS],
                      cln_pose_step *out);

/* Do other spots than those agree with the step, by their renders before and after it? Their mean
 * error, which grows little beyond the scale, must fall by more than twice the standard error of
 * that: poses that are right would wander by chance. */
bool cln_refine_is_better(int count, const cln_spot *spots, const cln_ray_result *before,
                          const cln_ray_result *after, const cln_pose_step *step);

#endif
