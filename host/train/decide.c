/* Structure decisions. See decide.h. */
#include "train/decide.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/config.h"
#include "base/log.h"
#include "base/text.h"
#include "model/integer_program.h"
#include "model/structure.h"
#include "train/advice.h"
#include "train/grow.h"
#include "train/measure.h"
#include "train/plans.h"
#include "train/record.h"
#include "train/restructure.h"
#include "train/step.h"

/* ---- when ---- */

/* Decisions due by this fraction of the budget; 0 before the first. */
static int due_by(const cln_config *c, double fraction)
{
    return fraction < c->structure_from
               ? 0
               : 1 + (int)floor((fraction - c->structure_from) / c->structure_every);
}

void cln_decide_recount(cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const int due = due_by(c, cln_step_fraction(t));
    /* whole levels of voxels stay over (grow.c) */
    const int least = cln_leaf_kind_of(c->encoding)->levels_first && due < 1 ? 1 : due;

    if (t->model.decisions > least)
        t->model.decisions = least;
}

/* Returns whether a decision is due, and counts it even if the tree is then left alone. */
static bool decision_comes(cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;
    int due = 0;

    if (!c->adaptive || c->tree_from[0] || fraction < c->structure_from ||
        fraction >= c->structure_until)
        return false;
    due = due_by(c, fraction);
    if (due <= t->model.decisions)
        return false;
    t->model.decisions = due;
    return t->model.sum_rays + (t->owed.due ? t->owed.rays : 0) > 0;
}

bool cln_decide_due(cln_trainer *t, double fraction, bool grown)
{
    cln_advise_none_came(t, fraction);
    return !grown && !cln_grow_awaited(t, fraction) && decision_comes(t, fraction);
}

/* ---- a decision ---- */

/* --max-leaves, or fewer if memory is short. */
static int leaf_budget(cln_trainer *t)
{
    const int wanted = t->model.config.max_leaves, leaves = t->pipeline.leaves;
    int n = wanted;
    cln_plans p;

    while (n > leaves && !cln_plans_fit(t, n, 0, &p)) {
        cln_clear_error();
        n = n * 15 / 16 > leaves ? n * 15 / 16 : leaves;
    }
    if (n < wanted && n <= leaves && !t->said.no_room_for_leaves) {
        cln_warn("memory has no room for more than the present %d leaves (--max-leaves %d)", leaves,
                 wanted);
        t->said.no_room_for_leaves = true;
    }
    return n;
}

/* fine: leaves that --cell-pixels kept from being split. */
static void say(cln_trainer *t, const cln_decision *d, int fine)
{
    const bool merges = cln_leaf_kind_of(t->model.config.encoding)->merges;
    char psnr[96] = "";

    if (d->splits + d->merges > 0)
        snprintf(psnr, sizeof psnr, "; PSNR of a fixed batch %.2f -> %.2f%s dB", d->psnr_before,
                 d->psnr_pretrained, d->merges ? " (merged leaves trained)" : "");
    cln_debug("step %lld: %d leaves -> %d: %d split, %d groups merged, %d kept; objective %.4g -> "
              "%.4g%s; %.1f s",
              (long long)t->model.step, d->leaves_before, d->leaves, d->splits, d->merges, d->keeps,
              d->objective_before, d->objective, psnr, d->work_seconds);
    if (d->splits == 0 && fine > 0)
        cln_debug("step %lld: of %d %s voxels half as wide would be below --cell-pixels %g of the "
                  "photos, so %s not split",
                  (long long)t->model.step, fine, cln_plural(fine, "leaf", "leaves"),
                  t->model.config.cell_pixels, cln_plural(fine, "it was", "they were"));
    if (d->infeasible && !t->said.too_many)
        cln_warn("no choice of splits and merges meets --max-leaves %d; %s", d->budget,
                 merges ? "only merges were made"
                        : "no leaf was added, as voxels do not merge; give more");
    t->said.too_many |= d->infeasible;
}

/* By ranks, takes fewer leaves if those of one do not fit where they will be. *how: the
 * solution. */
static cln_status solve(cln_trainer *t, const uint8_t *children, cln_integer_program_desc *desc,
                        cln_integer_program_result *r, cln_restructuring *how)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    cln_plans next;

    CLN_TRY(cln_integer_program_solve(desc, r));
    *how = (cln_restructuring){r->split, r->merge, children, r->leaves};
    while (t->pipeline.ranks > 1 && r->leaves > leaves &&
           !cln_plans_fit(t, r->leaves, cln_restructure_own(t, how), &next)) {
        cln_clear_error();
        desc->max_leaves = leaves + (r->leaves - leaves) / 2;
        cln_integer_program_result_free(r);
        CLN_TRY(cln_integer_program_solve(desc, r));
        *how = (cln_restructuring){r->split, r->merge, children, r->leaves};
    }
done:
    return st;
}

static cln_status decide(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    const double began = cln_now(), square = m->sum_square / (double)m->sum_rays;
    cln_leaf_measure *measures = NULL;
    uint8_t *children = NULL;
    int fine = 0;
    cln_integer_program_result r = {0};
    cln_restructuring how;
    cln_decision d = {.leaves_before = t->pipeline.leaves,
                      .psnr_before = NAN,
                      .psnr_after = NAN,
                      .psnr_pretrained = NAN};
    cln_integer_program_desc desc = {.tree = &m->tree,
                                     .max_leaves = leaf_budget(t),
                                     .max_level = m->config.max_level + m->space.shell,
                                     .split_factor = m->config.split_factor,
                                     .merge_factor = m->config.merge_factor,
                                     .no_merges = !cln_config_merges(&m->config),
                                     .coarsest = m->space.shell ? 2 : 0};

    if (desc.max_leaves < m->config.max_leaves)
        CLN_TRY(cln_record_held(t));
    CLN_TRY(cln_measure_leaves(t, fraction, &measures, &children, &fine));
    desc.measures = measures;
    CLN_TRY(solve(t, children, &desc, &r, &how));
    if (t->desc->dump_program)
        CLN_TRY(cln_integer_program_write_lp(&desc, t->desc->dump_program));
    d.leaves = r.leaves;
    d.splits = r.splits;
    d.merges = r.merges;
    d.keeps = r.keeps;
    d.budget = desc.max_leaves;
    d.infeasible = r.infeasible;
    d.objective = r.objective;
    d.objective_before = r.cost_before;
    if (r.splits + r.merges > 0) {
        CLN_TRY(cln_restructure(t, &how, &d));
        m->last_square = 0;
        if (r.leaves - r.keeps > r.leaves / 8) /* as after a growth, densities change fast */
            m->growth_step = m->step;
    } else {
        m->last_square = square;
        CLN_TRY(cln_measure_restart(t));
    }
    d.work_seconds = cln_now() - began;
    say(t, &d, fine);
    CLN_TRY(cln_record_decision(t, &d));
done:
    free(measures);
    free(children);
    cln_integer_program_result_free(&r);
    return st;
}

cln_status cln_decide(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    const double wait = m->config.structure_wait;
    double square = 0;

    CLN_TRY(cln_step_catch_up(t));
    square = m->sum_square / (double)m->sum_rays;
    if (wait <= 0 || (m->last_square > 0 && square >= wait * m->last_square))
        return decide(t, fraction);
    cln_debug("step %lld: mean square error %.4g after %.4g: the tree waits", (long long)m->step,
              square, m->last_square);
    m->last_square = square;
    CLN_TRY(cln_measure_restart(t));
done:
    return st;
}
