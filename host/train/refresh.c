/* Refreshes of stage 1. See refresh.h. */
#include "train/refresh.h"

#include "pipeline/stages.h"

static cln_status refresh(cln_trainer *t, int first, int count)
{
    return cln_stage_refresh(&t->pipeline, first, count, true, (uint64_t)t->model.config.seed,
                             (uint32_t)t->model.step);
}

cln_status cln_refresh_all(cln_trainer *t)
{
    return refresh(t, 0, t->pipeline.leaves);
}

cln_status cln_refresh_marked(cln_trainer *t, const uint8_t *marks)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;

    for (int first = 0, end = 0; first < leaves; first = end) {
        if (!marks[first]) {
            end = first + 1;
            continue;
        }
        for (end = first + 1; end < leaves && marks[end];)
            end++;
        CLN_TRY(refresh(t, first, end - first));
    }
done:
    return st;
}

/* Steps from one refresh to the next: few after a growth, while densities change fast, then more,
 * up to refresh_every (instant-ngp, too, refreshes all cells in its first steps). */
static int64_t refresh_interval(const cln_trainer *t)
{
    const int64_t interval = (t->model.refresh_step - t->model.growth_step) / 4;
    const int64_t most = t->model.config.refresh_every;

    return interval < 32 ? (most < 32 ? most : 32) : interval < most ? interval : most;
}

/* A rolling refresh has PARTS parts, one every PARTS steps (instant-ngp's sixteen). */
enum { PARTS = 16 };

cln_status cln_refresh_due(cln_trainer *t, bool now, bool *whole)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int64_t age = t->model.step - t->model.refresh_step;
    const int leaves = t->pipeline.leaves;

    *whole = false;
    if (now || t->model.step == 0 || (!c->rolling_refresh && age >= refresh_interval(t))) {
        CLN_TRY(cln_refresh_all(t));
        t->model.refresh_step = t->model.step;
        *whole = true;
    } else if (c->rolling_refresh && t->model.step % PARTS == 0) {
        const int part = (int)(t->model.step / PARTS % PARTS);
        const int first = (int)((int64_t)leaves * part / PARTS);
        const int end = (int)((int64_t)leaves * (part + 1) / PARTS);

        CLN_TRY(refresh(t, first, end - first));
        *whole = part == PARTS - 1;
    }
done:
    return st;
}
