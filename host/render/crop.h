/* A box to which pictures are cropped: rays see only the field inside it, nothing before or behind
 * it. */
#ifndef CLN_CROP_H
#define CLN_CROP_H

#include "base/number.h"
#include "model/octree.h"
#include "pipeline/pipeline.h"

typedef struct cln_crop {
    bool on;
    double box[6];      /* x0, y0, z0, x1, y1, z1, in the scene's frame and units */
    double turn[9];     /* rows: the box's axes, if it is turned about its middle; else all 0 */
    float planes[6][4]; /* the same in the cube, as cln_sampling takes it */
} cln_crop;

/* Sets a box and switches it on: finite numbers, each maximum above its minimum; turned about its
 * middle by angles in radians about x, then y, then z. CLN_USAGE; name: what messages call it. */
cln_status cln_crop_set(const char *name, const double box[6], const double angle[3],
                        cln_crop *out);

/* The same from the text of a request or an option: the six numbers of the box and, if it is
 * turned, the three angles in degrees. */
enum { CLN_CROP_NUMBERS = 9 };
cln_status cln_crop_read(const char *name, const char *text, double numbers[CLN_CROP_NUMBERS]);
cln_status cln_crop_from_numbers(const char *name, const double numbers[CLN_CROP_NUMBERS],
                                 cln_crop *out);

/* The same between an option's text and a desc's members: its text (NULL: nothing is set), and a
 * desc's box and degrees; off if it is not `cropped`. Messages call it --crop. CLN_USAGE. */
cln_status cln_crop_of_option(const char *text, bool *cropped, double box[6], double turn[3]);
cln_status cln_crop_of_desc(bool cropped, const double box[6], const double turn[3], cln_crop *out);

/* Cosine of the angle between up (unit) and the box's axis that is nearest to it; numbers: the same
 * box and the degrees that turn it, by the shortest way, so that it is 1. */
double cln_crop_level(const cln_crop *crop, const double up[3], double numbers[CLN_CROP_NUMBERS]);

bool cln_crop_is_turned(const cln_crop *crop);

/* The scene's cube as an option's box, for messages. */
void cln_crop_cube(const cln_space *space, char text[CLN_BOX_BYTES]);

/* Empty: is every ACTIVE leaf outside one side of the box? Sets its planes. Warn: warns if so, also
 * of a shell space if only leaves beyond the cube reach into it. Check: then it is CLN_USAGE, for
 * what is made of the cube alone; a crop that is off passes. It warns of a box that holds the whole
 * cube, as of another unit. */
bool cln_crop_is_empty(const cln_space *space, const cln_octree *tree, cln_crop *crop);
void cln_crop_warn(const char *name, const cln_space *space, const cln_octree *tree,
                   cln_crop *crop);

cln_status cln_crop_check(const char *name, const cln_space *space, const cln_octree *tree,
                          cln_crop *crop);

/* Computes the planes; cln_crop_use does it, too. */
void cln_crop_place(const cln_space *space, cln_crop *crop);

/* How far within the planes a point of the cube is (of a shell space: a point of u), below 0
 * outside. */
double cln_crop_depth(const float planes[6][4], const float point[3]);

/* The box, or what a turned one spans, in the cube of a space that is neither forward nor shell. */
void cln_crop_span(const cln_space *space, const cln_crop *crop, double low[3], double high[3]);

/* Crops the pipeline's pictures from now on; with NULL, or a crop that is off, no longer. Builds
 * the kernel for it at its first use. The crop stays the caller's. CLN_BUILD, CLN_CL. */
cln_status cln_crop_use(cln_pipeline *p, const cln_space *space, cln_crop *crop);

#endif
