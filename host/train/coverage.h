/* Finds the training pixels that see a leaf: a ray through any other pixel trains nothing.
 * Coverage is kept by tile and conservative: a covered tile may hold pixels that see no leaf, but
 * every pixel that sees one is in a covered tile. Host work, for pinhole cameras; a view with lens
 * distortion counts as covered if it sees the cube. batch.h decides which pixels are drawn. */
#ifndef CLN_COVERAGE_H
#define CLN_COVERAGE_H

#include "model/octree.h"
#include "scene/scene.h"

/* A square of `side` pixels: training view, and the tiles left of it and above it. It may reach
 * beyond the image's right and lower edges. */
typedef struct cln_tile {
    uint32_t view;
    uint16_t column, row;
} cln_tile;

typedef struct cln_coverage {
    int side;      /* of every tile, pixels */
    int views;     /* training views */
    size_t *first; /* [views + 1] tiles of the views before */
    float *error;  /* [tile] sum of squared errors of the bare background; < 0: not known yet */

    uint32_t *kept; /* [tile] pixels that count (cln_view_keeps); NULL: all of them */

    size_t *start;      /* [views + 1] where a view's tiles begin in `tiles` */
    cln_tile *tiles;    /* covered ones with pixels that count, by view, row and column */
    bool whole;         /* all tiles are in `tiles` */
    double share;       /* of the training pixels that count, those of covered tiles */
    double error_other; /* sum of squared errors of the others / training pixels that count */
} cln_coverage;

/* Counts every pixel as covered until the first update. The scene's training images must be
 * loaded. */
cln_status cln_coverage_create(const cln_scene *scene, cln_coverage *out);
void cln_coverage_free(cln_coverage *coverage);

/* Finds what this tree covers, its cube placed by `space`. Costs views x leaves; a view is done
 * once it is covered whole. */
void cln_coverage_update(cln_coverage *coverage, const cln_scene *scene, const cln_octree *tree,
                         const cln_space *space);

/* Host bytes for the training views of a scene. */
double cln_coverage_bytes(const cln_scene *scene);

#endif
