/* What is due before a step, in order. See maintain.h. Every decision is a function of the seed,
 * the step and the model, all of which are in the checkpoint, so a resumed run decides like an
 * uninterrupted one. */
#include "train/maintain.h"

#include "pipeline/share.h"
#include "train/cull.h"
#include "train/decide.h"
#include "train/grow.h"
#include "train/plans.h"
#include "train/record.h"
#include "train/refresh.h"

/* Steps from one look at the ranks' balance to the next. */
enum { BALANCE_EVERY = 16 };

static cln_status balance(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_share_move move;

    if (t->model.step == 0 || t->model.step % BALANCE_EVERY != 0)
        return CLN_OK;
    CLN_TRY(cln_share_balance(&t->pipeline, &move));
    if (move.leaves > 0) {
        CLN_TRY(cln_plans_deal(t));
        CLN_TRY(cln_record_move(t, &move));
    }
done:
    return st;
}

cln_status cln_maintain(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    bool grows = false, decides = false, refreshed = false, came_back = false;

    CLN_TRY(cln_grow_due(t, fraction, &grows));
    if (grows && t->model.step > 0)
        CLN_TRY(cln_grow_back(t, 8, &came_back));
    if (grows)
        CLN_TRY(cln_grow_level(t));
    decides = cln_decide_due(t, fraction, grows);
    CLN_TRY(cln_refresh_due(t, grows || decides, &refreshed));
    if (refreshed && !grows && cln_cull_due(t, fraction))
        CLN_TRY(cln_cull(t, decides));
    if (decides) {
        CLN_TRY(cln_decide(t, fraction));
        CLN_TRY(cln_grow_back(t, 1, &came_back));
        if (came_back)
            CLN_TRY(cln_refresh_all(t));
    }
    CLN_TRY(balance(t));
done:
    return st;
}
