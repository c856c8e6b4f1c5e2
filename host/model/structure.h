/* Decisions about the tree (method.md section 12): which leaves are empty (12.3), and when whole
 * levels grow (12.1). octree.h carries them out; integer_program.h decides on splits and merges. */
#ifndef CLN_STRUCTURE_H
#define CLN_STRUCTURE_H

#include "base/config_rows.h"
#include "model/octree.h"

/* Measures of ACTIVE leaves from cached densities, in normalised units. */
typedef struct cln_leaf_stats {
    float *mean; /* [slot] D_b: mean density of cells that a training view sees; 0 without any */
    float *peak; /* [slot] largest density of these cells */
} cln_leaf_stats;

void cln_leaf_stats_free(cln_leaf_stats *stats); /* accepts a zeroed one */

/* Marks leaves to cull, [slot], and counts them; updates tree->strikes. Guarded: mean < cull_mean
 * and peak * side / n1 < cull_max, in cull_strikes consecutive checks. Mean: only mean < cull_mean.
 * Never marks every leaf: if all are empty, the densest stays, with a warning. */
int cln_structure_cull(cln_octree *tree, const cln_leaf_stats *stats, const cln_config *config,
                       uint8_t *cull);

/* Bit i is set if child i of a leaf is surely not empty after a split, or may not be, by the leaf's
 * cached densities [n1^3], bfloat16, of cells that a training view sees [n1^3]: by the mean of its
 * octant (with n1 odd, cells in the middle are of both sides) and, guarded, by the peak of it and
 * of the cells around it, at a quarter of the threshold. */
uint8_t cln_structure_children(const cln_config *config, int level, const uint16_t *density,
                               const uint8_t *seen);

/* Marks the leaves that are empty now, by the means and guards of cln_structure_cull, [slot]. */
void cln_structure_empty(const cln_octree *tree, const cln_leaf_stats *stats,
                         const cln_config *config, uint8_t *empty);

/* Marks the leaves that the checks so far would cull, [slot], and counts them; none if these are
 * all leaves. */
int cln_structure_marked(const cln_octree *tree, const cln_config *config, uint8_t *cull);

/* The level the tree should have at this fraction (0..1) of the budget. */
int cln_structure_level(const cln_config *config, double fraction);

#endif
