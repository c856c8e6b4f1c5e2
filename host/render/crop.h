/* A box that pictures are cropped to: rays see the field inside it alone, and what is before and
 * behind it is not there. */
#ifndef CLN_CROP_H
#define CLN_CROP_H

#include "pipeline/pipeline.h"

typedef struct cln_crop {
    bool on;
    double box[6];      /* x0, y0, z0, x1, y1, z1, in the scene's frame and units */
    double turn[9];     /* rows: the box's axes, if it is turned about its middle; else all 0 */
    float planes[6][4]; /* the same in the cube, as cln_sampling takes it */
} cln_crop;

/* Numbers of a request or an option: finite, and each of the last three above its first. CLN_USAGE;
 * name: what they are called. */
cln_status cln_crop_check(const char *name, const double box[6]);

/* Warns if the cube has nothing in the box. Forward and shell spaces and turned boxes:
 * never. */
void cln_crop_warn(const char *name, const cln_space *space, const cln_crop *crop);

bool cln_crop_is_turned(const cln_crop *crop);

/* Computes the planes; cln_crop_use does it, too. */
void cln_crop_place(const cln_space *space, cln_crop *crop);

/* The pictures of the pipeline are cropped from here on; NULL, or one that is not on: they are not
 * any more. Builds the kernel for it when it is first wanted. The crop stays the caller's.
 * CLN_BUILD, CLN_CL. */
cln_status cln_crop_use(cln_pipeline *p, const cln_space *space, cln_crop *crop);

#endif
