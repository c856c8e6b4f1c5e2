/* Trains a merged leaf on samples of the old ones, without rays (method.md 11, "Merge"; NAScenT
 * section 4, pre-training). Before the change of the tree, prepare() draws points and asks the old
 * networks; after it, train() teaches the new ones, which start from what unfolding gave them. */
#ifndef CLN_DISTIL_H
#define CLN_DISTIL_H

#include "train/trainer.h"

typedef struct cln_distil {
    int nets, pool; /* merged leaves; points of each = CLN_DISTIL_BATCHES * distil-samples */
    int32_t *nodes; /* [net] the octree node that becomes the leaf */
    float (*origins)[4], (*directions)[4]; /* [net][point] */
    float (*targets)[4];                   /* [net][point] r, g, b, alpha over its length */
    float *lengths;                        /* [net] a thirty-second of the diagonal */
} cln_distil;

/* Draws points and asks the old networks, for the groups with marked leaves: merge [slot], of the
 * model's tree, which the device still has. CLN_MEMORY, CLN_CL: *out is freed. */
cln_status cln_distil_prepare(cln_trainer *t, const uint8_t *merge, cln_distil *out);
void cln_distil_free(cln_distil *distil); /* accepts a zeroed one */

/* Trains the leaves that `nodes` now are, until the loss of each is below distil-stop or
 * distil-steps are done. *steps: how many were. Adam's state of these leaves is zero afterwards.
 * CLN_MEMORY, CLN_CL. */
cln_status cln_distil_train(cln_trainer *t, const cln_distil *distil, int *steps);

#endif
