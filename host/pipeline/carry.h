/* A change of the tree on the device: weights, Adam's state, densities and measures move from old
 * slots to new ones; large arrays stay on the device but for the weights of new leaves. */
#ifndef CLN_CARRY_H
#define CLN_CARRY_H

#include "pipeline/pipeline.h"

/* Most new leaves that are folded at a time; host memory has two rows of weights for each. */
enum { CLN_CARRY_ROWS = 512 };

/* tree: the new one; change: where its slots come from (model/octree.h). The result equals
 * downloading, cln_model_apply and uploading bit for bit. Adam's state and measures of new leaves
 * are zero. Call cln_pipeline_rebuild for the new leaves before, cln_stage_seen after. The model's
 * arrays on the host stay as they are. CLN_MEMORY, CLN_CL: the pipeline can only be freed. */
cln_status cln_pipeline_carry(cln_pipeline *p, const cln_octree *tree,
                              const cln_octree_change *change);

#endif
