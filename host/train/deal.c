/* Memory plans by ranks. See deal.h. */
#include "train/deal.h"

#include "base/log.h"
#include "ranks/ranks.h"

/* A plan is a bound: what it counts may still fit. Says so once. */
static void say_full(cln_trainer *t, const cln_plan *device, const cln_plan *host)
{
    if (t->dealt.full)
        return;
    if (cln_plan_check(t->device, device) == CLN_OK)
        (void)cln_plan_check_host(host);
    cln_warn("with %d leaves, as they are dealt to ranks, %s", t->model.tree.leaf_count,
             cln_error_text());
    cln_clear_error();
    t->dealt.full = true;
}

cln_status cln_deal_plan(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_deal deal;
    const cln_plan_desc desc = {&t->pipeline,
                                t->scene,
                                t->model.tree.leaf_count,
                                true,
                                cln_coverage_bytes(t->scene),
                                cln_octree_depth(&t->model.tree),
                                &deal};
    cln_plan device, host;
    double least = 0;

    if (t->pipeline.ranks <= 1)
        return CLN_OK;
    CLN_TRY(cln_plan_deal(&t->pipeline, &t->model.tree, &deal));
    cln_plan_device(&desc, &device);
    cln_plan_host(&desc, &device, &host);
    if (device.total > t->dealt.device.total)
        t->dealt.device = device;
    if (host.total > t->dealt.host.total)
        t->dealt.host = host;
    if (!cln_plan_fits(t->device, &device, &host))
        say_full(t, &device, &host);
    t->plan = t->dealt.device;
    t->host_plan = t->dealt.host;
    cln_plan_apply(&t->plan, &t->pipeline);
    least = -cln_plan_most_own(&desc); /* ranks have room for different numbers */
    cln_ranks_largest(&least, 1);
    t->pipeline.most_own = (int)-least;
done:
    return st;
}
