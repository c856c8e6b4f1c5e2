/* What a page needs to know of a run before it asks for pictures, as one JSON text. */
#ifndef CLN_FACTS_H
#define CLN_FACTS_H

#include "render/open_run.h"
#include "render/orbit.h"

/* {run, step, leaves, background, target, up, distance, centre, half, start, width, height, focal,
 * cameras: [{name, split, pose, focal, width, height}]}: scene units, poses row-major 3x4, OpenCV's
 * axes; focal: of the camera's vertical axis in pixels; cameras in the order of the scene's views,
 * none without a scene. start: the first camera. The caller frees *out. */
cln_status cln_view_facts(const cln_open_run *opened, const cln_orbit_frame *frame,
                          const cln_camera *start, char **out);

#endif
