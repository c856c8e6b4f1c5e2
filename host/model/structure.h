/* Decisions about the tree (method.md section 12): which leaves are empty (12.3), and when whole
 * levels grow. octree.h carries them out; which leaves split and merge is integer_program.h's. */
#ifndef CLN_STRUCTURE_H
#define CLN_STRUCTURE_H

#include "base/config_rows.h"
#include "model/octree.h"

/* Measured per ACTIVE leaf from the stage-1 samples, sigma in normalised units. */
typedef struct cln_leaf_stats {
    float *mean; /* [slot] D_b: mean density of samples that a training view sees; 0 if none */
    float *peak; /* [slot] largest sampled density */
} cln_leaf_stats;

/* Marks leaves to cull, [slot], and counts them; updates tree->strikes. Guarded: mean < cull_mean
 * and peak * side / n1 < cull_max, in cull_strikes checks in a row. Mean: mean < cull_mean alone.
 * Never marks every leaf: if all are empty, the densest stays, with a warning. */
int cln_structure_cull(cln_octree *tree, const cln_leaf_stats *stats, const cln_config *config,
                       uint8_t *cull);

/* Marks the leaves that the checks so far would cull, [slot], and counts them; none if that were
 * all. */
int cln_structure_marked(const cln_octree *tree, const cln_config *config, uint8_t *cull);

/* The level the tree should have at this fraction (0..1) of the budget. */
int cln_structure_level(const cln_config *config, double fraction);

#endif
