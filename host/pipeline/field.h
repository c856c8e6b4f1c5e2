/* Evaluates the field at points away from rays: for distillation, cln_field_at and exports. */
#ifndef CLN_PIPELINE_FIELD_H
#define CLN_PIPELINE_FIELD_H

#include "pipeline/pipeline.h"

/* Evaluates the leaves' networks at n points of the cube as rendering does (no noise, mean slopes).
 *   tree        the uploaded one
 *   positions   [n][4] x, y, z in [-1, 1], and 0
 *   directions  [n][4] unit vectors from the eye to the point, and anything
 *   out         [n][4] r, g, b in 0..1, density per unit of the cube; 0 outside active leaves
 * Works in batches of p->max_samples, at most 65,536 (if it is 0: of 65,536). Reads back.
 * CLN_MEMORY, CLN_CL. */
cln_status cln_field_points(cln_pipeline *p, const cln_octree *tree, size_t n,
                            const float (*positions)[4], const float (*directions)[4],
                            float (*out)[4]);

#endif
