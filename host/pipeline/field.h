/* Asking the field at points: the seam under distillation, cln_field_at and whatever else looks at
 * the scene away from rays. */
#ifndef CLN_PIPELINE_FIELD_H
#define CLN_PIPELINE_FIELD_H

#include "pipeline/stages.h"

/* What the leaves' networks say at n points of the cube, as rendering asks them (no noise, mean
 * slopes). tree        the one that was uploaded positions   [n][4] x, y, z in [-1, 1], and 0
 *   directions  [n][4] unit vectors from the eye to the point, and anything
 *   out         [n][4] r, g, b in 0..1, density per unit of the cube; 0 where no active leaf is
 * In batches of p->max_samples, at most 65,536 (0 = that many). Reads back. CLN_MEMORY, CLN_CL. */
cln_status cln_field_points(cln_pipeline *p, const cln_octree *tree, size_t n,
                            const float (*positions)[4], const float (*directions)[4],
                            float (*out)[4]);

#endif
