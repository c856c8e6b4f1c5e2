/* Finds the pixels of the training views that have a leaf before them: a ray through any other
 * pixel meets nothing that could learn. Kept by tiles, which may hold pixels without a leaf, and
 * never miss one that has. Host work, exact for pinhole cameras; a view through a distorting lens
 * counts as covered. batch.h decides which pixels are drawn. */
#ifndef CLN_COVERAGE_H
#define CLN_COVERAGE_H

#include "model/octree.h"
#include "scene/scene.h"

/* A square of pixels: training view, first column and first row. At an image's edge it may reach
 * over. */
typedef struct cln_tile {
    uint32_t view;
    uint16_t x, y;
} cln_tile;

typedef struct cln_coverage {
    int side;      /* of every tile, pixels */
    int views;     /* training views */
    size_t *first; /* [views + 1] tiles of the views before */
    float *error;  /* [tile] summed squared errors if all show the background; < 0: not known yet */

    size_t *start;      /* [views + 1] where a view's tiles begin in `tiles` */
    cln_tile *tiles;    /* those that are covered, by view, row and column */
    bool whole;         /* that is all of them */
    double share;       /* of the training pixels: those covered */
    double error_other; /* summed squared errors of the others / number of all training pixels */
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
