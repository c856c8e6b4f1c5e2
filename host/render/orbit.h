/* Cameras on a circle around what the training cameras look at, and pictures of another size. Plain
 * geometry in scene units. */
#ifndef CLN_ORBIT_H
#define CLN_ORBIT_H

#include "cl_nascent.h"
#include "scene/scene.h"

/* A right-handed frame (east, north, up) around the target; the circle starts in the east, where
 * the first training camera stands. */
typedef struct cln_orbit {
    double target[3], east[3], north[3], up[3];
    double distance;  /* of the orbit's cameras to the target */
    double elevation; /* radians */
    cln_camera lens;  /* size and intrinsics; its pose is not used */
} cln_orbit;

/* Target: the point nearest to all optical axes, if it lies in the cube, else the cube's centre.
 * Up: the mean of the training cameras' up vectors. Size and field of view 0: as the first training
 * view; of a size with one 0, the shape is kept. CLN_USAGE for a picture that is too large. */
cln_status cln_orbit_make(const cln_scene *scene, const cln_render_desc *desc, cln_orbit *out);

/* The camera with another size of its picture, and the same horizontal field of view; 0 = as it is,
 * or by the other with the shape kept. In another shape more or less is seen above and below.
 * CLN_USAGE for a picture that is too large. */
cln_status cln_orbit_resize(const cln_camera *like, int width, int height, cln_camera *out);

/* Camera `i` of `count`, evenly spaced. */
void cln_orbit_camera(const cln_orbit *orbit, int i, int count, cln_camera *out);

#endif
