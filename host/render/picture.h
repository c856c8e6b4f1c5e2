/* A rendered picture in memory, as float. Its files are render.c's and quality.c's. */
#ifndef CLN_PICTURE_H
#define CLN_PICTURE_H

#include "scene/scene.h"

typedef struct cln_picture {
    int width, height;
    float *rgb;     /* [height][width][3] */
    float *depth;   /* [height][width] normalised units; 0 where nothing is (opacity 0) */
    float *opacity; /* [height][width] */
} cln_picture;

void cln_picture_free(cln_picture *picture);

/* Brings a depth along the ray of pixel (x, y) to one along the camera's axis, which is negative
 * behind the camera's plane; with `back`, the other way round. */
float cln_depth_along_axis(const cln_camera *camera, int x, int y, bool back, float depth);

#endif
