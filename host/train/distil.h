/* Trains merged leaves on samples of the old ones, without rays (method.md 11, "Merge"; NAScenT
 * section 4, pre-training). Before the tree changes, prepare() draws points and evaluates the old
 * networks there; after it, train() fits the new ones, which start from unfolded weights. */
#ifndef CLN_DISTIL_H
#define CLN_DISTIL_H

#include "train/trainer.h"

typedef struct cln_distil {
    int nets, pool;      /* merged leaves; points of each = CLN_DISTIL_BATCHES * distil-samples */
    int32_t *nodes;      /* [net] the octree node that becomes the leaf */
    float (*targets)[4]; /* [net][point] r, g, b, alpha over its length */
    float *lengths;      /* [net] path of a point's opacity: diagonal / 32 */
} cln_distil;

/* Draws points and evaluates the old networks, for the groups with marked leaves (merge: [slot]).
 * The device must still hold the model's tree. CLN_MEMORY, CLN_CL: *out is freed. */
cln_status cln_distil_prepare(cln_trainer *t, const uint8_t *merge, cln_distil *out);
void cln_distil_free(cln_distil *distil); /* accepts a zeroed one */

/* Trains the leaves at `nodes` until each one's loss is below distil-stop or distil-steps are done.
 * *steps: steps done. Adam's state of these leaves is zero afterwards. CLN_MEMORY, CLN_CL. */
cln_status cln_distil_train(cln_trainer *t, const cln_distil *distil, int *steps);

/* Counters of a random number: its index and its draw (base/rng.h). None are equal for different
 * (node, index, what): index below 16 times the most --distil-samples, what below 8. */
void cln_distil_counter(int32_t node, uint32_t index, uint32_t what, uint32_t counter[2]);

#endif
