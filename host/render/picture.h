/* A rendered picture in memory, as float. Its files are render.c's and quality.c's. */
#ifndef CLN_PICTURE_H
#define CLN_PICTURE_H

#include "scene/scene.h"

#define CLN_SURFACE 0.5f /* from this opacity on, a pixel shows a surface */

typedef struct cln_picture {
    int width, height;
    float *rgb;     /* [height][width][3] */
    float *depth;   /* [height][width] normalised units; 0 where nothing is (opacity 0) */
    float *opacity; /* [height][width] */
    int8_t *seen;   /* [height][width] or NULL: by how many training views (seen.h) */
} cln_picture;

void cln_picture_free(cln_picture *picture);

/* Brings its depths from normalised units to the scene's; where opacity is 0, they are 0. */
void cln_picture_to_scene(const cln_space *space, cln_picture *picture);

/* Brings its depths, of any unit, from those along the rays to those along the camera's axis. */
void cln_picture_along_axis(const cln_camera *camera, cln_picture *picture);

/* Brings a depth along the ray of pixel (x, y) to one along the camera's axis, which is negative
 * behind the camera's plane; with `back`, the other way round. */
float cln_depth_along_axis(const cln_camera *camera, int x, int y, bool back, float depth);

/* [height][width][3], or with `alpha` its opacity as a fourth channel; the caller frees *bytes.
 * CLN_MEMORY. */
cln_status cln_picture_to_bytes(const cln_picture *picture, bool alpha, uint8_t **bytes);

/* The same in 16 bits. */
cln_status cln_picture_to_words(const cln_picture *picture, bool alpha, uint16_t **words);

/* Takes the background out of its colours, which become straight (not premultiplied), as in PNG:
 * 0 where opacity is 0. */
void cln_picture_straight(const float background[3], cln_picture *picture);

#endif
