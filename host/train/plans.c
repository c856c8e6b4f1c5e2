/* Memory plans of a training. See plans.h. */
#include "train/plans.h"

#include "base/log.h"
#include "pipeline/stage1.h"
#include "ranks/ranks.h"

cln_plan_desc cln_plans_desc(const cln_trainer *t, int leaves, int depth, const cln_deal *deal)
{
    return (cln_plan_desc){.pipeline = &t->pipeline,
                           .scene = t->scene,
                           .leaves = leaves,
                           .training = true,
                           .coverage_bytes = cln_batch_bytes(t->scene),
                           .depth = depth,
                           .deal = deal};
}

void cln_plans_now(const cln_trainer *t, cln_plans *out)
{
    const cln_plan_desc desc =
        cln_plans_desc(t, t->model.tree.leaf_count, cln_octree_depth(&t->model.tree), NULL);

    cln_plan_device(&desc, &out->device);
    cln_plan_host(&desc, &out->device, &out->host);
}

void cln_plans_make(const cln_trainer *t, int leaves, int own, cln_plans *out)
{
    const int depth = cln_octree_depth(&t->model.tree), level = t->model.level;
    const int grown = level + t->model.space.shell; /* deepest leaves that come back */
    cln_plan_desc desc = cln_plans_desc(t, leaves, 1 + (depth > grown ? depth : grown), NULL);
    cln_deal deal;

    if (t->pipeline.ranks > 1 && own > 0) {
        deal = cln_plan_any_deal(&desc, own);
        desc.deal = &deal;
    }
    cln_plan_device(&desc, &out->device);
    cln_plan_host(&desc, &out->device, &out->host);
}

void cln_plans_adopt(cln_trainer *t, const cln_plans *plans)
{
    t->plan = plans->device;
    t->host_plan = plans->host;
    cln_plan_apply(&plans->device, &t->pipeline);
    cln_stage1_release(&t->pipeline); /* the next batch allocates by the new plan */
}

/* Whether batches may have as many rays and samples by both. */
static bool batches_alike(const cln_plan *a, const cln_plan *b)
{
    return a->max_rays == b->max_rays && a->max_samples == b->max_samples &&
           a->batch_samples == b->batch_samples && a->max_entries == b->max_entries;
}

void cln_plans_renew(cln_trainer *t)
{
    cln_plans plans;

    if (t->pipeline.ranks > 1)
        return;
    cln_plans_now(t, &plans);
    if (!batches_alike(&plans.device, &t->plan))
        cln_plans_adopt(t, &plans);
}

void cln_plans_check_own(const cln_pipeline *p, int own)
{
    for (int r = 0; p->ranks > 1 && r < p->ranks; r++)
        CLN_ASSERT(p->rank_first[r + 1] - p->rank_first[r] <= own);
}

static cln_status check(const cln_trainer *t, const cln_plans *plans)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_plan_check(t->device, &plans->device));
    CLN_TRY(cln_plan_check_host(&plans->host));
done:
    return st;
}

bool cln_plans_fit(const cln_trainer *t, int leaves, int own, cln_plans *out)
{
    double full = 0, others = 0;

    cln_plans_make(t, leaves, own, out);
    full = check(t, out) != CLN_OK;
    others = full;
    cln_ranks_largest(&others, 1);
    if (others > full)
        (void)cln_fail(CLN_MEMORY, "another rank has not enough memory for its plan");
    return others == 0;
}

/* A plan is a bound: what it counts may still fit. Says so once. */
static void say_full(cln_trainer *t, const cln_plans *plans)
{
    if (t->dealt.full)
        return;
    (void)check(t, plans);
    cln_warn("with %d leaves, as they are dealt to ranks, %s", t->model.tree.leaf_count,
             cln_error_text());
    cln_clear_error();
    t->dealt.full = true;
}

cln_status cln_plans_deal(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_deal deal;
    const cln_plan_desc desc =
        cln_plans_desc(t, t->model.tree.leaf_count, cln_octree_depth(&t->model.tree), &deal);
    cln_plans now;
    double least = 0;

    if (t->pipeline.ranks <= 1)
        return CLN_OK;
    CLN_TRY(cln_plan_deal(&t->pipeline, &t->model.tree, &deal));
    cln_plan_device(&desc, &now.device);
    cln_plan_host(&desc, &now.device, &now.host);
    if (now.device.total > t->dealt.device.total)
        t->dealt.device = now.device;
    if (now.host.total > t->dealt.host.total)
        t->dealt.host = now.host;
    if (!cln_plan_fits(t->device, &now.device, &now.host))
        say_full(t, &now);
    t->plan = t->dealt.device;
    t->host_plan = t->dealt.host;
    cln_plan_apply(&t->plan, &t->pipeline);
    least = -cln_plan_most_own(&desc); /* ranks have room for different numbers */
    cln_ranks_largest(&least, 1);
    t->pipeline.most_own = (int)-least;
done:
    return st;
}
