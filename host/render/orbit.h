/* Camera paths around what the training cameras look at, and pictures of another size. Plain
 * geometry in scene units. From the scene a path needs only a frame, which run.json keeps, so that
 * a run can do without the scene. */
#ifndef CLN_ORBIT_H
#define CLN_ORBIT_H

#include <jansson.h>
#include "cl_nascent.h"
#include "scene/scene.h"
#include "render/up.h"

/* Target: the point nearest to all optical axes, if it lies in the cube, else the cube's centre.
 * Around it a right-handed frame (east, north, up): up is told by the training cameras (up.h) or
 * given; the first of them stands in the east. */
typedef struct cln_orbit_frame {
    double target[3], east[3], north[3], up[3];
    double distance;  /* of the training cameras to the target, mean */
    double elevation; /* of the cameras above the plane of east and north, degrees, mean */
    /* degrees from east to north: the shortest arc with all cameras; to - from is 360 if they leave
     * no gap of more than 120 */
    double from, to;
    /* of the first training view, after --downscale; where EXIF data turn photos (cln_view_turn),
     * of the first that stands or lies as most do, as people see it */
    int width, height;
    double fx, fy;
    bool guessed; /* up may as well be the opposite (cln_up_of_cameras) */
} cln_orbit_frame;

/* up: a vector of any length; all 0: what the cameras tell. */
cln_status cln_orbit_frame_of(const cln_scene *scene, const double up[3], cln_orbit_frame *out);

/* To and from run.json's `orbit` (docs/formats.md), to the last bit. CLN_INPUT if `saved` is not
 * one. */
json_t *cln_orbit_frame_json(const cln_orbit_frame *frame);
cln_status cln_orbit_frame_read(const json_t *saved, cln_orbit_frame *out);

/* Gives a saved frame another up, if one is given: elevation and arc are those of cameras that are
 * turned with it, exact for the opposite one. */
void cln_orbit_frame_turn(const double up[3], cln_orbit_frame *frame);

/* A path, by cln_orbit_make. */
typedef struct cln_orbit {
    cln_orbit_frame frame;
    double distance;      /* of the path's cameras to the target */
    double elevation;     /* radians */
    double middle, swing; /* radians: the path swings by `swing` to either side of `middle` */
    bool circle;          /* goes all around instead, from the east on */
    cln_camera lens;      /* size and intrinsics; its pose is not used */
} cln_orbit;

/* Size and intrinsics of desc's pictures on a path: those of the training view, without its lens
 * and with the principal point in the middle; of another shape, its field of view along the shorter
 * side. CLN_USAGE for a picture that is too large. */
cln_status cln_orbit_lens(const cln_orbit_frame *like, const cln_render_desc *desc,
                          cln_camera *out);

/* Makes a circle if the frame's cameras stand all around or desc->orbit_circle asks for one, with a
 * warning if they do not; else a path to and fro in their arc. Size and field of view 0: those of
 * the first training view; if one side is 0, the aspect ratio is kept. CLN_USAGE for a picture that
 * is too large. */
cln_status cln_orbit_make(const cln_orbit_frame *frame, const cln_render_desc *desc,
                          cln_orbit *out);

/* The camera with a picture of another size and the same horizontal field of view. A side 0: as it
 * is or, if the other is given, by the aspect ratio. With another aspect ratio, more or less is
 * seen above and below. Panoramas of the whole sphere stay such. CLN_USAGE for a picture that is
 * too large. */
cln_status cln_orbit_resize(const cln_camera *like, int width, int height, cln_camera *out);

/* Camera `i` of `count`; after the last one the first follows smoothly. */
void cln_orbit_camera(const cln_orbit *orbit, int i, int count, cln_camera *out);

#endif
