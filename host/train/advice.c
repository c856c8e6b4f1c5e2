/* What a training would need so that its tree adapts. See advice.h. */
#include "train/advice.h"

#include <math.h>
#include <stdio.h>

#include "base/config.h"
#include "base/log.h"
#include "train/grow.h"
#include "train/measure.h"
#include "train/step.h"

/* A share of leaves, mostly in corners where single photos were taken from near, that hardly any
 * sample meets. */
static const double FEW = 0.05;

/* Of a level's leaves to those of the one before: as few, and as many, as there may be. */
static const double FEWEST_TIMES = 2, MOST_TIMES = 8;

/* Would a training of so many steps make a decision, and at which level? Its levels come when a
 * training like this one's would (grow.c), which has reached a level with so many leaves; a level
 * that it has not reached counts so many `times` the leaves of the one before. */
static bool would_decide(const cln_trainer *t, double steps, double times, int *at_level)
{
    const cln_config *c = &t->model.config;
    const double wait = c->cull_after + c->refresh_every, end = c->structure_until * steps;
    double at[CLN_MAX_LEVEL + 1], grown = 0;

    if (cln_config_levels(c, at) != CLN_OK) {
        cln_clear_error();
        return false;
    }
    for (int level = c->start_level; level <= CLN_MAX_LEVEL && grown < end; level++) {
        const double leaves = t->pipeline.leaves * pow(times, level - t->model.level);
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
static double steps_to_decide(const cln_trainer *t, double steps, double times, int *at_level)
{
    const double most = 1e6;
    double unit = 10;

    for (double s = unit * ceil(steps / unit); s < most; s += unit) {
        unit = s >= 1000 ? 100 : 10;
        if (s > steps && would_decide(t, s, times, at_level))
            return s;
    }
    return 0;
}

/* The share of the leaves of *level that a decision could split; of the others voxels are as fine
 * as the photos. *level becomes the finest one that comes, if that is less. averaged: pixels are
 * means of several rays, which allows finer voxels. */
static double can_split(cln_trainer *t, bool averaged, int *level)
{
    const bool now = t->model.averaged;
    int finest = 0;
    double share = 1;

    t->model.averaged = averaged;
    if (cln_grow_finest(t, &finest) == CLN_OK)
        *level = *level < finest ? *level : finest;
    if (cln_measure_can_split(t, *level, &share) != CLN_OK)
        cln_clear_error();
    t->model.averaged = now;
    return share;
}

/* The same in a training of *steps or of as many more, which *steps become, as it takes until
 * pixels are means. */
static double could_split(cln_trainer *t, double *steps, int *level)
{
    int averaged_level = *level;
    double share = can_split(t, t->model.averaged, level), averaged = 0;

    if (share >= FEW || t->model.averaged || !t->pipeline.averaged)
        return share;
    averaged = can_split(t, true, &averaged_level);
    *level = averaged_level;
    if (averaged >= FEW)
        *steps = fmax(*steps, cln_steps_to_average(t));
    return averaged;
}

void cln_advise_first_tree(cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const int leaves = t->pipeline.leaves;

    if (!c->adaptive || c->tree_from[0] || leaves <= c->max_leaves)
        return;
    t->said.too_many = true;
    cln_warn("the first tree has %d leaves, more than --max-leaves %d, so none is split%s: give %d "
             "or more, or a lower --start-level than %d",
             leaves, c->max_leaves,
             cln_leaf_kind_of(c->encoding)->network ? " before others merge" : "", leaves,
             c->start_level);
}

void cln_advise_none_came(cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;
    const bool timed = t->steps == 0 || (c->time_limit > 0 && /* as cln_step_fraction divides */
                                         t->model.train_seconds / c->time_limit >= fraction);
    const double steps = timed ? floor((double)t->model.step / fraction) : (double)t->steps;
    double enough = 0, fewer = 0, decides = 0, share = 0;
    int level = 0, at_level = 0;
    char longer[160] = "", text[432];

    if (t->said.none_came || !c->adaptive || c->tree_from[0] || t->model.decisions > 0 ||
        t->pipeline.leaves > c->max_leaves || c->structure_from >= c->structure_until ||
        fraction < c->structure_until || t->model.level >= c->max_level ||
        !cln_grow_awaited(t, c->structure_until))
        return;
    t->said.none_came = true;
    enough = steps_to_decide(t, steps, FEWEST_TIMES, &level);
    fewer = steps_to_decide(t, steps, MOST_TIMES, &at_level); /* then no further level may come */
    decides = enough;
    share = enough > 0 ? could_split(t, &enough, &level) : 1;
    if (share < FEW) {
        cln_info("no single leaf was split, %s be in more steps: beyond level %d, voxels would be "
                 "below --cell-pixels %g of the photos%s",
                 share > 0 ? "and hardly any would" : "nor would any", level, c->cell_pixels,
                 share > 0 ? " almost everywhere" : "");
        return;
    }
    if (enough > 0 && timed) /* steps take longer in a larger tree */
        snprintf(longer, sizeof longer,
                 "; a new run may split some with a --time-limit of about %.0fs, for %.0f steps",
                 ceil(1.5 * c->time_limit * enough / steps), enough);
    else if (enough > 0 && fewer > 0 && fewer < enough && enough <= decides)
        snprintf(longer, sizeof longer,
                 "; a new run may split some with --steps %.0f or more, or with %.0f if no further "
                 "whole level comes",
                 enough, fewer);
    else if (enough > 0)
        snprintf(longer, sizeof longer, "; a new run may split some with --steps %.0f or more",
                 enough);
    snprintf(text, sizeof text,
             "no single leaf was split: of %s%.0f steps, those before --structure-until %g went by "
             "while whole levels came and were measured%s",
             timed ? "about " : "", steps, c->structure_until, longer);
    if (steps < 2 * (2 * c->cull_after + c->refresh_every))
        cln_info("%s", text);
    else
        cln_warn("%s", text);
}
