/* Adds leaves between decisions. See grow.h. */
#include "train/grow.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "model/structure.h"
#include "train/carve.h"
#include "train/change.h"
#include "train/measure.h"
#include "train/plans.h"
#include "train/record.h"
#include "train/regrow.h"
#include "train/step.h"

/* ---- whether a whole level comes ---- */

/* Marks leaves to cull at the next change [slot] (the caller frees them), and counts the others. */
static cln_status leaves_left(const cln_trainer *t, uint8_t **marks, int *left)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(marks, (size_t)t->pipeline.leaves, 1, "leaf marks"));
    *left = t->pipeline.leaves - cln_structure_marked(&t->model.tree, &t->model.config, *marks);
done:
    return st;
}

/* Of the leaves that are not marked, those of the rank that has most. */
static int most_left(const cln_pipeline *p, const uint8_t *marks)
{
    int most = 0;

    for (int r = 0; p->ranks > 1 && r < p->ranks; r++) {
        int left = 0;

        for (int s = p->rank_first[r]; s < p->rank_first[r + 1]; s++)
            left += !marks[s];
        most = left > most ? left : most;
    }
    return most;
}

/* Whether the tree fits memory after a split of every leaf, which leaves children where their
 * parent was; warns when it does not any more. */
static cln_status room_to_grow(cln_trainer *t, bool *room)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;
    int leaves = 0;
    cln_plans next;
    char text[1536];

    CLN_TRY(leaves_left(t, &marks, &leaves));
    *room = cln_plans_fit(t, 8 * leaves, 8 * most_left(&t->pipeline, marks), &next);
    if (!*room) {
        snprintf(text, sizeof text, "%s", cln_error_text());
        cln_clear_error();
        if (!t->next_level.no_room)
            cln_warn("the tree stays at level %d: with %d leaves %s", t->model.level, 8 * leaves,
                     text);
    }
    t->next_level.no_room = !*room;
    if (!*room)
        CLN_TRY(cln_record_held(t));
done:
    free(marks);
    return st;
}

/* Whether whole levels of voxels may still grow: always in a tree that does not adapt. In one that
 * does, before the first decision, while a level takes at most a WHOLE_PART of --max-leaves once
 * its empty leaves are culled, as SURFACE_CHILDREN of a leaf's children usually are not: single
 * leaves are chosen for the rest. */
enum { WHOLE_PART = 3, SURFACE_CHILDREN = 4 };

static bool is_whole(const cln_config *c, double leaves)
{
    return SURFACE_CHILDREN * leaves <= floor((double)c->max_leaves / WHOLE_PART);
}

static bool has_whole_levels(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;

    return !c->adaptive || (t->model.decisions == 0 && is_whole(c, t->pipeline.leaves));
}

bool cln_grow_whole(const cln_trainer *t, int level, double leaves)
{
    if (level < t->model.level) /* it was followed by one */
        return true;
    return is_whole(&t->model.config, leaves) &&
           !(level == t->model.level && (t->next_level.finest || t->next_level.no_room));
}

/* Width of a voxel of a whole level, in half sides of the cube, in a shell of its core. */
static double cell_of(const cln_config *c, int level)
{
    return 2 * ldexp(1.0 / c->grid_cells, -level);
}

cln_status cln_grow_finest(const cln_trainer *t, int *level)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    double pixel = 0;

    *level = CLN_MAX_LEVEL;
    if (!cln_leaf_kind_of(c->encoding)->levels_first || c->cell_pixels <= 0)
        return CLN_OK;
    CLN_TRY(cln_scene_pixel_width(t->scene, (const double(*)[12])t->refine.given, &t->model.space,
                                  &pixel));
    *level = t->model.level;
    while (*level < CLN_MAX_LEVEL && cell_of(c, *level + 1) >= cln_measure_cell_pixels(t) * pixel)
        ++*level;
done:
    return st;
}

double cln_grow_foresee(const cln_config *c, double first, double most, bool singles,
                        double fraction, double steps)
{
    const double wait = 2.0 * c->cull_after + c->refresh_every, now = fraction * steps;
    double at[CLN_MAX_LEVEL + 1], leaves = first, grown = 0, ramp = 0;

    if (cln_config_levels(c, at) != CLN_OK) {
        cln_clear_error();
        return most;
    }
    for (int level = CLN_MAX_LEVEL; level > 0;
         level--) /* one that is left out comes with the next */
        at[level - 1] = fmin(at[level - 1], at[level]);
    for (int level = c->start_level + 1;
         level <= CLN_MAX_LEVEL && (!c->adaptive || is_whole(c, leaves)); level++) {
        grown = fmax(grown + wait, at[level] * steps);
        if (fraction < at[level] || (steps > 0 && now < grown))
            return fmin(leaves, most);
        leaves *= SURFACE_CHILDREN;
    }
    ramp = (fraction - c->structure_from) / (c->structure_until - c->structure_from);
    if (!c->adaptive || !singles || !(ramp > 0) ||
        (steps > 0 && now < grown + wait - c->cull_after))
        return fmin(leaves, most);
    return fmin(leaves + (most - leaves) * fmin(ramp, 1), most);
}

/* Whether the tree may grow a level: always for networks. For voxels, empty leaves of this level
 * must have been culled, as growth splits every leaf, the finer voxels must not be finer than the
 * photos can tell (--cell-pixels), and in a tree that adapts they must be few. */
static cln_status ready_to_grow(cln_trainer *t, double fraction, bool *grows)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int level = t->model.level + 1;
    const double cell = cell_of(c, level);
    double pixel = 0;
    double splits = 0;

    *grows = !cln_leaf_kind_of(c->encoding)->levels_first;
    if (*grows || t->next_level.finest)
        return CLN_OK;
    *grows = t->model.step >= t->model.growth_step + 2 * c->cull_after + c->refresh_every;
    if (*grows && !has_whole_levels(t)) {
        if (!t->said.whole)
            cln_info("whole levels end at level %d, with %d %s%s", t->model.level,
                     t->pipeline.leaves, cln_plural(t->pipeline.leaves, "leaf", "leaves"),
                     fraction < c->structure_until
                         ? "; single leaves split from --structure-from on"
                         : "");
        t->said.whole = true;
        *grows = false;
    }
    if (!*grows || c->cell_pixels <= 0)
        return CLN_OK;
    /* by poses that do not change, so that a resumed run finds the same */
    CLN_TRY(cln_scene_pixel_width(t->scene, (const double(*)[12])t->refine.given, &t->model.space,
                                  &pixel));
    *grows = cell >= cln_measure_cell_pixels(t) * pixel;
    t->next_level.finest = !*grows;
    if (!t->next_level.finest)
        goto done;
    if (c->adaptive)
        CLN_TRY(cln_measure_can_split(t, t->model.level, &splits));
    cln_info("the tree stays at level %d%s: voxels of the next level would be %.2g pixels of the "
             "photos wide (--cell-pixels)",
             t->model.level,
             splits > 0                                   ? ", but for single leaves"
             : t->pipeline.averaged && !t->model.averaged ? " for now" /* means allow finer ones */
             : c->adaptive                                ? ", and single leaves cannot split"
                                                          : "",
             cell / pixel);
done:
    return st;
}

cln_status cln_grow_due(cln_trainer *t, double fraction, bool *due)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;

    *due = false;
    if (!c->tree_from[0] && t->model.level < cln_structure_level(c, fraction))
        CLN_TRY(ready_to_grow(t, fraction, due));
    if (*due)
        CLN_TRY(room_to_grow(t, due));
done:
    return st;
}

bool cln_grow_awaited(const cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;

    if (!cln_leaf_kind_of(c->encoding)->levels_first)
        return false;
    if (t->model.decisions == 0 &&
        t->model.step < t->model.growth_step + c->cull_after + c->refresh_every)
        return true;
    return !t->next_level.finest && !t->next_level.no_room && has_whole_levels(t) &&
           t->model.level < cln_structure_level(c, fraction);
}

/* ---- a whole level ---- */

cln_status cln_grow_level(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_octree *tree = &t->model.tree;
    cln_octree_change change = {0}, splits = {0};
    uint8_t *marks = NULL;
    int leaves = 0, own = 0, carved = 0;
    cln_plans next;

    CLN_TRY(leaves_left(t, &marks, &leaves));
    own = 8 * most_left(&t->pipeline, marks);
    cln_plans_make(t, 8 * leaves, own, &next);
    CLN_TRY(cln_step_catch_up(t));
    CLN_TRY(cln_octree_cull(tree, marks, &change)); /* they waited for a change (cull.c) */
    CLN_TRY(cln_octree_split(tree, NULL, &splits));
    CLN_TRY(cln_octree_change_join(&change, &splits));
    CLN_TRY(cln_carve_after(t->scene, &t->model.space, &t->model.config, false, tree, &change,
                            &carved));
    CLN_TRY(cln_model_follow(&t->model, &change));
    if (carved > 0)
        cln_debug("step %lld: %d leaves are seen by too few views, or outside the box",
                  (long long)t->model.step, carved);
    t->model.level++;
    t->model.growth_step = t->model.step;
    t->model.last_square = 0;
    CLN_TRY(cln_change_adopt(t, &change, &next, own));
    cln_debug("step %lld: level %d, %d leaves", (long long)t->model.step, t->model.level,
              t->pipeline.leaves);
done:
    free(marks);
    cln_octree_change_free(&change);
    cln_octree_change_free(&splits);
    return st;
}

/* ---- leaves that come back ---- */

/* Leaves that the rank with most will have after this change; 0 without ranks. */
static int most_from(const cln_pipeline *p, const cln_octree_change *change)
{
    int most = 0, after = 0, rank = 0;

    for (int s = 0; p->ranks > 1 && s < change->count; s++) { /* old slots ascend with the new */
        while (change->from[s] >= p->rank_first[rank + 1]) {
            after = 0;
            rank++;
        }
        after++;
        most = after > most ? after : most;
    }
    return most;
}

/* Missing leaves are looked for while at least 1 / FREE_PART of the largest tree's leaves are
 * free. */
enum { FREE_PART = 64 };

static int count_fresh(const cln_octree_change *change)
{
    int fresh = 0;

    for (int s = 0; s < change->count; s++)
        fresh += change->octant[s] == CLN_FRESH;
    return fresh;
}

cln_status cln_grow_back(cln_trainer *t, int splits, bool *came_back)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    const double began = cln_now();
    const int most = cln_config_most_leaves(&t->model.config, t->model.space.shell);
    uint8_t *empty = NULL;
    int fresh = 0, own = 0, carved = 0;
    cln_missing missing = {0};
    cln_leaf_stats stats = {0};
    cln_octree tree = {0}, old = {0};
    cln_octree_change change = {0};
    cln_plans next;

    *came_back = false;
    if (t->model.config.regrow <= 0 || most - leaves < most / FREE_PART)
        return CLN_OK;
    CLN_TRY(cln_step_catch_up(t));
    CLN_TRY(cln_alloc(&empty, (size_t)leaves, 1, "leaf marks"));
    CLN_TRY(cln_measure_stats(t, &stats));
    cln_structure_empty(&t->model.tree, &stats, &t->model.config, empty);
    CLN_TRY(cln_regrow_find(t, empty, &missing));
    if (missing.errors + missing.cut == 0)
        goto done;
    CLN_TRY(cln_octree_copy(&t->model.tree, &tree));
    CLN_TRY(cln_octree_regrow(&tree, &missing.marks, t->model.level,
                              t->model.level + t->model.space.shell, empty, &change));
    CLN_TRY(cln_carve_after(t->scene, &t->model.space, &t->model.config, true, &tree, &change,
                            &carved));
    fresh = count_fresh(&change);
    if (fresh == 0)
        goto done;
    own = most_from(&t->pipeline, &change);
    if (splits * tree.leaf_count > most ||
        !cln_plans_fit(t, splits * tree.leaf_count, splits * own, &next)) {
        cln_clear_error();
        cln_debug("step %lld: no room to bring back %d leaves", (long long)t->model.step, fresh);
        goto done;
    }
    cln_plans_make(t, tree.leaf_count, own, &next);
    old = t->model.tree;
    t->model.tree = tree;
    tree = old;
    CLN_TRY(cln_model_follow(&t->model, &change));
    CLN_TRY(cln_change_adopt(t, &change, &next, own));
    /* Densities change fast. But culling does not wait for empty leaves that begin anew: they do at
     * every decision, and it would never come. */
    if (missing.errors > 0 && t->pipeline.leaves > leaves) {
        t->model.growth_step = t->model.step;
        t->model.last_square = 0;
    }
    *came_back = true;
    cln_debug("step %lld: something is missing: %d leaves come back, now %d leaves (%d places by "
              "errors, %d by surfaces that are cut off); %.2f s",
              (long long)t->model.step, fresh, t->pipeline.leaves, missing.errors, missing.cut,
              cln_now() - began);
done:
    cln_marks_free(&missing.marks);
    free(empty);
    cln_leaf_stats_free(&stats);
    cln_octree_free(&tree);
    cln_octree_change_free(&change);
    return st;
}
