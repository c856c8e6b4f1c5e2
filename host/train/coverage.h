/* Which pixels of the training views have a leaf before them: a ray through any other meets nothing that could
 * learn, so drawing it would cost time and train nothing. Kept by tiles, never too few of them. Host work, exact for
 * pinhole cameras; a view through a distorting lens counts as covered. Decides nothing about which pixels are
 * drawn (batch.h). */
#ifndef CLN_COVERAGE_H
#define CLN_COVERAGE_H

#include "model/octree.h"
#include "scene/scene.h"

/* A square of pixels: training view, and its first column and row. Those at an image's edge may reach over it. */
typedef struct cln_tile {
    uint32_t view;
    uint16_t x, y;
} cln_tile;

typedef struct cln_coverage {
    int side;      /* of every tile, pixels */
    int views;     /* training views */
    size_t *first; /* [views + 1] tiles of the views before */
    float *
        error; /* [tile] its pixels' squared errors, summed, if all show the background; < 0: not known yet */

    size_t *start;   /* [views + 1] where a view's tiles begin in `tiles` */
    cln_tile *tiles; /* those that are covered, by view, row and column */
    bool whole;      /* that is all of them */
    double share;    /* of the training pixels: those covered */
    double
        error_other; /* squared errors of those that are not, over the number of all training pixels */
} cln_coverage;

/* Says nothing about any tree yet. The scene's training images must be loaded. */
cln_status cln_coverage_create(const cln_scene *scene, cln_coverage *out);
void cln_coverage_free(cln_coverage *coverage);

/* Of this tree, whose cube is `space`'s. Costs views x leaves, until a view is whole. */
void cln_coverage_update(cln_coverage *coverage, const cln_scene *scene, const cln_octree *tree,
                         const cln_space *space);

/* Host memory for the training views of a scene. */
double cln_coverage_bytes(const cln_scene *scene);

#endif
