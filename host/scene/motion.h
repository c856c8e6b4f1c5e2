/* Small corrections of poses. A motion is a rotation vector (radians), then a translation (scene
 * units), both along the camera's own axes: with a pose [R|o] it makes [R exp(w) | o + R t]. So it
 * means the same wherever the scene lies, and float is fine enough for it. */
#ifndef CLN_MOTION_H
#define CLN_MOTION_H

#include "scene/scene.h"

enum { CLN_MOTION = 6 };

/* Poses are 3x4, row-major, camera to scene (cln_camera.c2w). out may be c2w. */
void cln_motion_apply(const double c2w[12], const double motion[CLN_MOTION], double out[12]);

/* The motion that makes `to` of `from`; for rotations of less than half a turn. */
void cln_motion_between(const double from[12], const double to[12], double out[CLN_MOTION]);

/* Removes from the poses `to` what moved all of them alike since `from`: the rotation, translation
 * and scale about their middle that fit best, as photos alone do not determine them. `reach`: the
 * length in scene units that weighs an angle against a distance. */
void cln_motion_hold(int count, const double (*from)[12], double reach, double (*to)[12]);

/* Moves the training views of a scene, by motions in the split's order, and finds the pixels of its
 * sights anew. */
void cln_motion_views(cln_scene *scene, const float (*motions)[CLN_MOTION]);

#endif
