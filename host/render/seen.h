/* How many training views see what a picture shows. What none of them sees, the model invented: a
 * picture from the side of the photos says nothing about that by itself. */
#ifndef CLN_SEEN_H
#define CLN_SEEN_H

#include "render/open_run.h"
#include "render/picture.h"

enum {
    CLN_SEEN_MOST = 8, /* more views count as this many */
    CLN_SEEN_FEW = 3,  /* fewer tell little of where a thing is */
    CLN_SEEN_STEP = 30 /* of grey in NAME.seen.png, for each view; 255: nothing is shown there */
};

typedef struct cln_seen {
    int count;
    cln_camera *cameras; /* [count] */
    float **depth;       /* [count][height][width] along the ray, scene units; below 0: nothing */
} cln_seen;

/* Up to `most` training views, evenly chosen, of at most `width` pixels across; the caller frees
 * *cameras. CLN_INPUT without training views. */
cln_status cln_training_cameras(const cln_scene *scene, int most, int width, cln_camera **cameras,
                                int *count);

/* Chooses up to 100 training views, small ones. CLN_INPUT without any. */
cln_status cln_seen_choose(const cln_scene *scene, cln_seen *out);
/* Renders their depths. The run is started, without a crop; the pipeline's cameras are then
 * these. */
cln_status cln_seen_make(cln_open_run *opened, const cln_callbacks *callbacks, cln_seen *seen);
void cln_seen_free(cln_seen *seen); /* accepts a zeroed one */

/* How many of the views see a point of the scene, at most CLN_SEEN_MOST: it lies in their picture,
 * as far away as what they show there, give or take what small depths can tell. */
int cln_seen_at(const cln_seen *seen, const double point[3]);

/* picture->seen = the number for each pixel, or -1 where less than half is opaque; of a coarse grid
 * of rays, 320 across, but of each ray of a map. Depths are along the ray, in scene units.
 * CLN_MEMORY. */
cln_status cln_seen_picture(const cln_seen *seen, const cln_camera *camera, cln_picture *picture);

/* Of what pictures show, the shares that no view and that fewer than CLN_SEEN_FEW see. NaN if they
 * show nothing. */
typedef struct cln_seen_shares {
    double none, few;
} cln_seen_shares;
cln_seen_shares cln_seen_share(const cln_picture *picture);

/* A digest of the views that count: frames of the same cameras and others have other numbers. */
uint64_t cln_seen_digest(const cln_seen *seen);

#endif
