/* Finds places of the tree that should have a leaf and have none: where nearly all photos that see
 * the place have an error, and behind which a surface is cut off by a leaf's face. So a leaf that
 * was culled too early comes back; it would be lost for good otherwise, as space outside the tree
 * gets no samples (docs/method.md 12.3). model/octree.h changes the tree. */
#ifndef CLN_REGROW_H
#define CLN_REGROW_H

#include "train/trainer.h"

typedef struct cln_missing {
    cln_marks marks; /* what lacks a leaf, in order; the caller frees them */
    int errors;      /* cells of level 5 found by errors */
    int cut;         /* cells found by surfaces that are cut off */
} cln_missing;

/* Marks cells that have no leaf or an `empty` one [slot], and where at least the share `regrow` of
 * the training photos that see a point of the cell have an error there; and cells without a leaf
 * before the face of one in which photos see a surface begin. Renders a fixed set of rays, so it
 * depends only on the model. Forward spaces: none. CLN_MEMORY, CLN_CL. */
cln_status cln_regrow_find(cln_trainer *t, const uint8_t *empty, cln_missing *missing);

#endif
