/* Structure decisions. See decide.h. */
#include "train/decide.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/config.h"
#include "base/log.h"
#include "model/integer_program.h"
#include "model/structure.h"
#include "train/grow.h"
#include "train/measure.h"
#include "train/plans.h"
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

/* Would a training of so many steps with these settings make a decision, and at which level? Its
 * levels come when a training like this one's would (grow.c), which has reached a level with so
 * many leaves; a level that it has not reached counts twice the leaves of the one before, as few as
 * are usual. */
static bool would_decide(const cln_trainer *t, const cln_config *c, double steps, int *at_level)
{
    const double wait = c->cull_after + c->refresh_every, end = c->structure_until * steps;
    double at[CLN_MAX_LEVEL + 1], grown = 0;

    if (cln_config_levels(c, at) != CLN_OK) {
        cln_clear_error();
        return false;
    }
    for (int level = c->start_level; level <= CLN_MAX_LEVEL && grown < end; level++) {
        const double leaves = ldexp(t->pipeline.leaves, level - t->model.level);
        const double decision = fmax(grown + wait, c->structure_from * steps);
        double asked = INFINITY; /* the step from which another level is */

        *at_level = level;
        for (int l = level + 1; l <= CLN_MAX_LEVEL && cln_grow_whole(t, level, leaves); l++)
            asked = fmin(asked, at[l] * steps);
        if (ceil(decision) < asked)
            return ceil(decision) < end;
        grown = ceil(fmax(grown + wait + c->cull_after, asked));
    }
    return false;
}

/* The fewest steps, in round numbers, with which the tree would adapt; 0 if a long training's does
 * not, either. */
static double steps_to_decide(const cln_trainer *t, double steps, int *at_level)
{
    const double most = 1e6;
    double unit = 10;

    for (double s = unit * ceil(steps / unit); s < most; s += unit) {
        unit = s >= 1000 ? 100 : 10;
        if (s > steps && would_decide(t, &t->model.config, s, at_level))
            return s;
    }
    return 0;
}

/* Finds a shorter --cull-after and --refresh-every with which it would in so many steps. */
static bool waits_to_decide(const cln_trainer *t, double steps, cln_config *out)
{
    int level = 0;

    *out = t->model.config;
    while (out->cull_after > 1 || out->refresh_every > 1) {
        out->cull_after /= 2;
        out->refresh_every = out->refresh_every > 2 ? out->refresh_every / 2 : 1;
        if (would_decide(t, out, steps, &level))
            return true;
    }
    return false;
}

/* Could a decision at this level split any leaf? If not, its voxels are as fine as the photos. */
static bool can_split(cln_trainer *t, int level)
{
    int finest = 0;
    bool can = true;

    if (cln_grow_finest(t, &finest) != CLN_OK ||
        cln_measure_can_split(t, level < finest ? level : finest, &can) != CLN_OK)
        cln_clear_error();
    return can;
}

/* Says once that the tree never adapted, as the first decision waited (cln_grow_awaited) until
 * --structure-until, and what would do. A training of a few steps is a try, so its user is not
 * warned. */
static void say_none_came(cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;
    const bool timed = t->steps == 0 || (c->time_limit > 0 && /* as cln_step_fraction divides */
                                         t->model.train_seconds / c->time_limit >= fraction);
    const double steps = timed ? floor((double)t->model.step / fraction) : (double)t->steps;
    double enough = 0;
    int level = 0;
    char longer[96] = "", sooner[96] = "", text[400];
    cln_config other;

    if (t->none_came || !c->adaptive || c->tree_from[0] || t->model.decisions > 0 ||
        c->structure_from >= c->structure_until || fraction < c->structure_until ||
        t->model.level >= c->max_level || !cln_grow_awaited(t, c->structure_until))
        return;
    t->none_came = true;
    enough = steps_to_decide(t, steps, &level);
    if (enough > 0 && !can_split(t, level)) {
        cln_info("no single leaf was split, nor would any be in more steps: voxels half as wide "
                 "would be below --cell-pixels %g of the photos",
                 c->cell_pixels);
        return;
    }
    if (enough > 0 && timed) /* steps take longer in a larger tree */
        snprintf(longer, sizeof longer, "a --time-limit of about %.0fs, for %.0f steps",
                 ceil(1.5 * c->time_limit * enough / steps), enough);
    else if (enough > 0)
        snprintf(longer, sizeof longer, "--steps %.0f or more", enough);
    if (waits_to_decide(t, steps, &other))
        snprintf(sooner, sizeof sooner, "--cull-after %d --refresh-every %d", other.cull_after,
                 other.refresh_every);
    snprintf(text, sizeof text,
             "no single leaf was split: of %s%.0f steps, those before --structure-until %g went by "
             "while whole levels came and were measured%s%s%s%s",
             timed ? "about " : "", steps, c->structure_until,
             *longer || *sooner ? "; single leaves would be split by " : "", longer,
             *longer && *sooner ? ", or by " : "", sooner);
    if (steps < 2 * (2 * c->cull_after + c->refresh_every))
        cln_info("%s", text);
    else
        cln_warn("%s", text);
}

bool cln_decide_due(cln_trainer *t, double fraction, bool grown)
{
    say_none_came(t, fraction);
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
    if (n < wanted && n <= leaves && !t->no_room_for_leaves) {
        cln_warn("memory has no room for more than the present %d leaves (--max-leaves %d)", leaves,
                 wanted);
        t->no_room_for_leaves = true;
    }
    return n;
}

static void say(const cln_trainer *t, const cln_decision *d)
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
    if (d->infeasible)
        cln_warn("no choice of splits and merges meets --max-leaves %d; %s", d->budget,
                 merges ? "only merges were made"
                        : "no leaf was added, as voxels do not merge; give more");
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

    CLN_TRY(cln_measure_leaves(t, fraction, &measures, &children));
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
    say(t, &d);
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
