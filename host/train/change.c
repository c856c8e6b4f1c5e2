/* Brings a change of the model's tree to the device. See change.h. */
#include "train/change.h"

#include "pipeline/carry.h"
#include "pipeline/stages.h"
#include "train/measure.h"
#include "train/step.h"

cln_status cln_change_carry(cln_trainer *t, const cln_octree_change *change)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_carry(&t->pipeline, &t->model.tree, change));
    CLN_TRY(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
done:
    return st;
}

cln_status cln_change_adopt(cln_trainer *t, const cln_octree_change *change, const cln_plans *plans,
                            int own)
{
    cln_status st = CLN_OK;

    cln_plans_adopt(t, plans);
    CLN_TRY(cln_change_carry(t, change));
    cln_plans_check_own(&t->pipeline, own);
    CLN_TRY(cln_plans_deal(t));
    CLN_TRY(cln_measure_restart(t));
done:
    return st;
}
