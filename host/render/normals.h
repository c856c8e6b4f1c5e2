/* Normals of the surface that a picture shows, from its depths. */
#ifndef CLN_NORMALS_H
#define CLN_NORMALS_H

#include "scene/scene.h"

/* normals [height][width][3], unit vectors of the scene's frame that point to the camera; 0 where
 * none is known: where the pixel is mostly transparent, or both its neighbours in a row or column
 * are beyond an edge or out of the picture. depth, opacity [height][width]: scene units, along the
 * ray. A normal comes from the points that a pixel and its neighbours see; of two neighbours, the
 * one nearer in depth counts. */
void cln_normals_of_depth(const cln_camera *camera, const float *depth, const float *opacity,
                          float *normals);

#endif
