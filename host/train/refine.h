/* Poses of the training cameras, corrected by their photos (--refine-poses, method.md 11). Each
 * camera has a motion (scene/motion.h) relative to the pose that the scene gives it; they lie in
 * cln_model.motions and in checkpoints, and the scene's training views have the corrected poses
 * while it trains. Held-out views keep theirs.
 *
 * Every EVERY steps some cameras, in turn, take a step of Gauss and Newton: in pixels drawn where
 * their photo has contrast, it compares the rendered colour with the photo's, and how the rendered
 * one would change as the camera moves: by its slope between the neighbouring pixels, times the way
 * that the surface's point at the rendered depth moves in the image (Lucas and Kanade, 1981, for a
 * rendered picture). So no gradient passes the networks. A step counts if it surely lowers the
 * error of other pixels. What moves all cameras alike is taken out again. A function of seed, step,
 * model and photos alone. */
#ifndef CLN_REFINE_H
#define CLN_REFINE_H

#include "train/trainer.h"

/* Makes the model's motions if it has none, and moves the training views by them. Without
 * config.refine_poses neither. CLN_CHECKPOINT if they are of another number of views. */
cln_status cln_refine_start(cln_trainer *t);
void cln_refine_free(cln_refine *refine); /* accepts a zeroed one */

/* Corrects poses if it is their turn before the next step, on host and device, and finds anew what
 * training views see. fraction: 0..1 of the budget. */
cln_status cln_refine_poses(cln_trainer *t, double fraction);

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
    double scale;     /* the residual that is half trusted */
    double gain[3];   /* of the photo: how much brighter it is than what is rendered */
} cln_pose_step;

/* The step for a camera, from n spots and what is rendered there, looks [n][CLN_SPOT_LOOKS]. False
 * if they do not tell one. */
bool cln_refine_solve(const cln_camera *camera, const cln_space *space, int n,
                      const cln_spot *spots, const cln_ray_result (*looks)[CLN_SPOT_LOOKS],
                      cln_pose_step *out);

#endif
