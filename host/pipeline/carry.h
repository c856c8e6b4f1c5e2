/* A change of the tree on the device: weights, Adam's state, densities and measures of the
 * leaves go from their old slots to their new ones without a way through the host. */
#ifndef CLN_CARRY_H
#define CLN_CARRY_H

#include "pipeline/stages.h"

/* Most new leaves whose weights are folded at a time (host memory: as many rows, and their
 * parents'). */
enum { CLN_CARRY_ROWS = 512 };

/* tree: the new one; change: what became of the old one's slots (model/octree.h). Bit for bit
 * what downloading, cln_model_apply and uploading would do. Adam's state and measures of new
 * leaves are zero. Belongs behind cln_pipeline_rebuild for the new leaves. Afterwards
 * cln_stage_seen is due. The model's arrays on the host are not touched. CLN_MEMORY, CLN_CL: the
 * pipeline is fit for cln_pipeline_free alone. */
cln_status cln_pipeline_carry(cln_pipeline *p, const cln_octree *tree,
                              const cln_octree_change *change);

#endif
