/* A map: the scene from straight above, by parallel rays, as programs for maps read it: with a
 * world file beside the picture, and heights as a grid. Its frame is a rotation of the scene's:
 * columns along its x, rows against its y, heights its z. Geometry and these two files only;
 * pictures are api/render.c's. */
#ifndef CLN_MAP_H
#define CLN_MAP_H

#include "render/crop.h"
#include "render/orbit.h"
#include "render/picture.h"
#include "scene/scene.h"

/* A map's up, where none is given, by what the training cameras tell; NULL: an older run, which
 * does not have it. The scene's z, as of a survey, if theirs is within 20 degrees of it or a guess:
 * then with a warning, unless it is within 2, which is what they can tell. Else theirs, or the axis
 * that is within 2 degrees of it, with a warning. */
void cln_map_up(const cln_orbit_frame *seen, double up[3]);

/* Rows of a map's frame for this up: the scene's, turned as exports are (cln_mesh_upright). */
void cln_map_axes(const double up[3], double axes[9]);

/* The camera of the map of the crop's box, or without one of the scene's cube: pixels of `spacing`
 * scene units; 0: 1, 2 or 5 times a power of ten, so that the longer side has 800 to 2000. Its
 * upper left corner is at a whole number of pixels. It stands above the box's highest corner; what
 * is not in the cube of a plain space is not in the map. CLN_USAGE: a forward space, a turned box,
 * none in common with a plain space's cube, or too many pixels. */
cln_status cln_map_camera(const cln_space *space, const cln_crop *crop, const double axes[9],
                          double spacing, cln_camera *out);

/* The place of the map's upper left corner in its frame, and the camera's height; `offset` is added
 * to them. */
void cln_map_corner(const cln_camera *camera, const double offset[3], double corner[3]);

/* The world file of a map's picture: its pixel size and the middle of its upper left pixel, six
 * lines. CLN_OUTPUT. */
cln_status cln_map_write_world(const char *path, const cln_camera *camera, const double offset[3]);

/* The height of what each pixel shows, as an ESRI ASCII grid, to a thousandth of a pixel; no data
 * where less than half is opaque, or where picture->seen says that no training view sees it.
 * picture: of that camera, depths in scene units. CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_map_write_heights(const char *path, const cln_camera *camera, const double offset[3],
                                 const cln_picture *picture);

#endif
