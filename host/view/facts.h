/* What a page needs to know of a run before it asks for pictures, as one JSON text. */
#ifndef CLN_FACTS_H
#define CLN_FACTS_H

#include "model/model.h"
#include "render/orbit.h"

typedef struct cln_facts {
    const char *run;
    const cln_model *model;
    const cln_scene *scene; /* NULL: no cameras */
    const cln_orbit_frame *frame;
    const cln_camera *start; /* the first camera */
    bool training;           /* it is under way */
    const char *transforms;  /* of cln_frames_transforms; NULL: none */
    bool transforms_gone;
} cln_facts;

/* {run, step, leaves, training, background, target, up, distance, centre, half, box, endless,
 * levels, errors, start, width, height, focal, cameras: [{name, split, pose, focal, width,
 * height}], applied: {transform, scale, known}}: scene units, poses row-major 3x4, OpenCV's axes;
 * box: [x0, y0, z0, x1, y1, z1] within which a page offers to crop, endless: there is more beyond
 * it; levels, errors: the colours "#rrggbb" of leaves, by level, and of errors from small to large;
 * focal: of the camera's vertical axis in pixels; cameras in the order of the scene's views;
 * applied: of cln_frames_applied; known: false if the scene's transforms JSON is not there, or is
 * damaged. The caller frees *out. */
cln_status cln_facts_text(const cln_facts *facts, char **out);

/* A camera to begin with: where an orbit begins, or the middle of its arc. */
cln_status cln_facts_camera(const cln_orbit_frame *frame, cln_camera *out);

#endif
