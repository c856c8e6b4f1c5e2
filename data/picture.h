/* Pictures of a generated scene: one camera in, 8-bit pixels and exact depth out. */
#ifndef DATA_PICTURE_H
#define DATA_PICTURE_H

#include <stdint.h>
#include "scene/scene.h"
#include "scenes.h"

/* Renders with 3 x 3 samples a pixel. rgba: [height][width][4], straight alpha by coverage, black
 * without a surface. depth: [height][width], distance along the ray through the pixel's centre to
 * the first surface, scene units, 0 without one; NULL = not wanted. */
void picture_render(const world *w, const cln_camera *camera, uint8_t *rgba, float *depth);

/* In place: [pixels][4] -> [pixels][3] over white. */
void picture_over_white(int pixels, uint8_t *image);

#endif
