/* Camera paths around what the training cameras look at, and pictures of another size. Plain
 * geometry in scene units. What a path takes from the scene is a frame, which a run keeps
 * (run.json), so that it needs no scene. */
#ifndef CLN_ORBIT_H
#define CLN_ORBIT_H

#include <jansson.h>
#include "cl_nascent.h"
#include "scene/scene.h"

/* Target: the point nearest to all optical axes, if it lies in the cube, else the cube's centre.
 * Around it a right-handed frame (east, north, up): up is where the training cameras, held
 * level, have it; in the east stands the first of them. */
typedef struct cln_orbit_frame {
    double target[3], east[3], north[3], up[3];
    double distance;  /* of the training cameras to the target: their mean */
    double elevation; /* above the plane of east and north, degrees: their mean */
    double from, to; /* degrees from east to north: the shortest arc that has all of them; to - from
                         is 360 where they leave no gap of more than 120 */
    int width, height; /* of the first training view, after --downscale */
    double fx, fy;
} cln_orbit_frame;

cln_status cln_orbit_frame_of(const cln_scene *scene, cln_orbit_frame *out);

/* To and from run.json's `orbit` (docs/formats.md), to the last bit. CLN_INPUT if `saved` is not
 * one. */
json_t *cln_orbit_frame_json(const cln_orbit_frame *frame);
cln_status cln_orbit_frame_read(const json_t *saved, cln_orbit_frame *out);

/* A path, by cln_orbit_make. */
typedef struct cln_orbit {
    cln_orbit_frame frame;
    double distance;  /* of the path's cameras to the target */
    double elevation; /* radians */
    double middle,
        swing;       /* radians: the path swings about `middle` by this much to either side... */
    bool circle;     /* ...or goes all around, from the east on */
    cln_camera lens; /* size and intrinsics; its pose is not used */
} cln_orbit;

/* Size and intrinsics of desc's pictures on a path: of the training view, without its lens and with
 * its axis in the middle. CLN_USAGE for a picture that is too large. */
cln_status cln_orbit_lens(const cln_orbit_frame *like, const cln_render_desc *desc,
                          cln_camera *out);

/* A circle where the frame's cameras stand all around or desc->orbit_circle wants one, with a
 * warning if they do not; else to and fro in their arc. Size and field of view 0: as the first
 * training view; of a size with one 0, the shape is kept. CLN_USAGE for a picture that is too
 * large. */
cln_status cln_orbit_make(const cln_orbit_frame *frame, const cln_render_desc *desc,
                          cln_orbit *out);

/* The camera with another size of its picture, and the same horizontal field of view; 0 = as it is,
 * or by the other with the shape kept. In another shape more or less is seen above and below.
 * Equirectangular pictures stay whole spheres. CLN_USAGE for a picture that is too large. */
cln_status cln_orbit_resize(const cln_camera *like, int width, int height, cln_camera *out);

/* Camera `i` of `count`; after the last one the first follows smoothly. */
void cln_orbit_camera(const cln_orbit *orbit, int i, int count, cln_camera *out);

#endif
