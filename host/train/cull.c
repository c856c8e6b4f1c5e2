/* Culls empty leaves between steps. See cull.h. */
#include "train/cull.h"

#include <stdlib.h>

#include "base/log.h"
#include "base/memory.h"
#include "train/change.h"
#include "train/measure.h"
#include "train/plans.h"
#include "train/step.h"

bool cln_cull_due(const cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;

    return !c->tree_from[0] && fraction >= c->cull_from && t->model.step > 0 &&
           t->model.step >= t->model.growth_step + c->cull_after;
}

/* Changing the tree costs as much as about ten steps, and a few empty leaves among thousands cost
 * little. So culling waits until one leaf in CULL_PART is marked, or for another change (`now`). */
enum { CULL_PART = 100 };

cln_status cln_cull(cln_trainer *t, bool now)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    int marked = 0;
    uint8_t *marks = NULL;
    cln_leaf_stats stats = {0};
    cln_octree_change change = {0};

    CLN_TRY(cln_step_catch_up(t));
    CLN_TRY(cln_alloc(&marks, (size_t)leaves, 1, "leaf marks"));
    CLN_TRY(cln_measure_stats(t, &stats));
    marked = cln_structure_cull(&t->model.tree, &stats, &t->model.config, marks);
    if (marked > 0 && (now || (int64_t)marked * CULL_PART >= leaves)) {
        CLN_TRY(cln_octree_cull(&t->model.tree, marks, &change));
        CLN_TRY(cln_model_follow(&t->model, &change));
        CLN_TRY(cln_change_carry(t, &change));
        cln_plans_renew(t);
        cln_debug("step %lld: culled %d of %d leaves", (long long)t->model.step,
                  leaves - t->pipeline.leaves, leaves);
    }
    if (!t->model.config.adaptive) { /* weights by visibility cover one interval, too */
        CLN_TRY(cln_measure_restart(t));
    }
done:
    cln_leaf_stats_free(&stats);
    free(marks);
    cln_octree_change_free(&change);
    return st;
}
