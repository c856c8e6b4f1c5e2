/* Maintains the tree. See maintain.h. Every decision is a function of the seed, the step and the
 * model, all of which are in the checkpoint, so a resumed run decides like an uninterrupted one. */
#include "train/maintain.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "device/queue.h"
#include "train/carve.h"
#include "train/children.h"
#include "train/distil.h"
#include "train/plans.h"
#include "train/regrow.h"
#include "train/step.h"
#include "model/integer_program.h"
#include "model/structure.h"
#include "pipeline/carry.h"
#include "pipeline/share.h"
#include "pipeline/stage1.h"
#include "ranks/ranks.h"
#include "render/ray_batch.h"

/* ---- changes of the tree ---- */

/* Brings a change of the model's tree to the device. */
static cln_status carry(cln_trainer *t, const cln_octree_change *change)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_carry(&t->pipeline, &t->model.tree, change));
    CLN_TRY(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
done:
    return st;
}

/* Begins a new interval of measuring, on host and device. */
static cln_status restart_measures(cln_trainer *t)
{
    cln_model_restart_measures(&t->model);
    return cln_stage_measure_reset(&t->pipeline);
}

/* Mean density (--density-weight) and peak of every leaf; [leaf], the caller frees. */
static cln_status leaf_stats(cln_trainer *t, float **mean, float **peak)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const size_t leaves = (size_t)p->leaves, sums_count = leaves * CLN_MEASURES * 2;
    float(*pairs)[2] = NULL, (*sums)[CLN_MEASURES][2] = NULL;

    CLN_TRY(cln_alloc(&pairs, leaves, sizeof *pairs, "leaf statistics"));
    CLN_TRY(cln_alloc(mean, leaves, sizeof **mean, "leaf statistics"));
    CLN_TRY(cln_alloc(peak, leaves, sizeof **peak, "leaf statistics"));
    CLN_TRY(cln_stage_stats(p, pairs[0]));
    if (t->model.config.density_weight == CLN_WEIGHT_VISIBILITY) {
        CLN_TRY(cln_alloc(&sums, leaves, sizeof *sums, "leaf statistics"));
        CLN_TRY(cln_share_sums(p));
        CLN_TRY(cln_buffer_read(t->device, &p->leaf_sums, 0, sums, sums_count * sizeof(float)));
    }
    for (size_t i = 0; i < leaves; i++) {
        (*mean)[i] = pairs[i][0];
        (*peak)[i] = pairs[i][1];
        if (sums && sums[i][2][0] > 0) /* sum T sigma delta / sum T delta along the training rays */
            (*mean)[i] = sums[i][1][0] / sums[i][2][0];
    }
done:
    free(pairs);
    free(sums);
    return st;
}

/* Changing the tree costs as much as about ten steps, and a few empty leaves among thousands cost
 * little. So culling waits until one leaf in CULL_PART is marked, or for another change (`now`). */
enum { CULL_PART = 100 };

static cln_status cull(cln_trainer *t, bool now)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    int marked = 0;
    uint8_t *marks = NULL;
    cln_leaf_stats stats = {0};
    cln_octree_change change = {0};

    CLN_TRY(cln_step_catch_up(t));
    CLN_TRY(cln_alloc(&marks, (size_t)leaves, 1, "leaf marks"));
    CLN_TRY(leaf_stats(t, &stats.mean, &stats.peak));
    marked = cln_structure_cull(&t->model.tree, &stats, &t->model.config, marks);
    if (marked > 0 && (now || (int64_t)marked * CULL_PART >= leaves)) {
        CLN_TRY(cln_octree_cull(&t->model.tree, marks, &change));
        CLN_TRY(cln_model_follow(&t->model, &change));
        CLN_TRY(carry(t, &change));
        cln_debug("step %lld: culled %d of %d leaves", (long long)t->model.step,
                  leaves - t->pipeline.leaves, leaves);
    }
    if (!t->model.config.adaptive) { /* weights by visibility cover one interval, too */
        CLN_TRY(restart_measures(t));
    }
done:
    free(stats.mean);
    free(stats.peak);
    free(marks);
    cln_octree_change_free(&change);
    return st;
}

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

/* Whether the tree fits memory after a split of every leaf, which leaves children where their
 * parent was; warns the first time that it does
 * not. */
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
        if (!t->full)
            cln_warn("the tree stays at level %d: with %d leaves %s", t->model.level, 8 * leaves,
                     text);
        t->full = true;
    }
done:
    free(marks);
    return st;
}

/* Whether whole levels of voxels may still grow: always in a tree that does not adapt. In one that
 * does, before the first decision, while a level takes at most a WHOLE_PART of --max-leaves once
 * its empty leaves are culled, as SURFACE_CHILDREN of a leaf's children usually are not: single
 * leaves are chosen for the rest. */
enum { WHOLE_PART = 3, SURFACE_CHILDREN = 4 };

static bool has_whole_levels(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;

    return !c->adaptive || (t->model.decisions == 0 &&
                            SURFACE_CHILDREN * t->pipeline.leaves <= c->max_leaves / WHOLE_PART);
}

/* Whether the tree may grow a level: always for networks. For voxels, empty leaves of this level
 * must have been culled, as growth splits every leaf, the finer voxels must not be finer than the
 * photos can tell (--cell-pixels), and in a tree that adapts they must be few. */
static cln_status ready_to_grow(cln_trainer *t, bool *grows)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int level = t->model.level + 1;
    const double cell = 2 * ldexp(1.0 / c->grid_cells, -level); /* in a shell's core, too */
    double pixel = 0;

    *grows = !cln_leaf_kind_of(c->encoding)->levels_first;
    if (*grows || t->finest)
        return CLN_OK;
    *grows = t->model.step >= t->model.growth_step + 2 * c->cull_after + c->refresh_every;
    if (*grows && !has_whole_levels(t)) {
        if (!t->whole)
            cln_info("whole levels end at level %d, with %d %s; single leaves split from "
                     "--structure-from on",
                     t->model.level, t->pipeline.leaves,
                     cln_plural(t->pipeline.leaves, "leaf", "leaves"));
        t->whole = true;
        *grows = false;
    }
    if (!*grows || c->cell_pixels <= 0)
        return CLN_OK;
    CLN_TRY(cln_scene_pixel_width(t->scene, &t->model.space, &pixel));
    *grows = cell >= c->cell_pixels * pixel;
    t->finest = !*grows;
    if (t->finest)
        cln_info("the tree stays at level %d%s: voxels of the next level would be %.2g pixels of "
                 "the photos wide (--cell-pixels)",
                 t->model.level, c->adaptive ? ", but for single leaves" : "", cell / pixel);
done:
    return st;
}

/* After a split, culls leaves that are empty by geometry, as a part of that change. */
static cln_status carve(cln_trainer *t, cln_octree_change *splits)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;
    cln_octree_change change = {0};
    int count = 0;

    CLN_TRY(cln_carve_find(t->scene, &t->model.space, &t->model.config, &t->model.tree, &marks,
                           &count));
    if (count > 0) {
        CLN_TRY(cln_octree_cull(&t->model.tree, marks, &change));
        CLN_TRY(cln_model_follow(&t->model, &change));
        CLN_TRY(cln_octree_change_join(splits, &change));
        cln_debug("step %lld: %d leaves are seen by too few views, or outside the box",
                  (long long)t->model.step, count);
    }
done:
    free(marks);
    cln_octree_change_free(&change);
    return st;
}

/* Splits every leaf once by the exact split; there is room. */
static cln_status grow(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    cln_octree_change change = {0}, splits = {0};
    uint8_t *marks = NULL;
    int leaves = 0, own = 0;
    cln_plans next;

    CLN_TRY(leaves_left(t, &marks, &leaves));
    own = 8 * most_left(p, marks);
    cln_plans_make(t, 8 * leaves, own, &next);
    CLN_TRY(cln_step_catch_up(t));
    if (leaves < p->leaves) { /* marked leaves that waited for a change (cull) */
        CLN_TRY(cln_octree_cull(&t->model.tree, marks, &change));
        CLN_TRY(cln_model_follow(&t->model, &change));
    }
    CLN_TRY(cln_octree_split(&t->model.tree, NULL, &splits));
    CLN_TRY(cln_model_follow(&t->model, &splits));
    CLN_TRY(carve(t, &splits));
    if (change.count > 0)
        CLN_TRY(cln_octree_change_join(&change, &splits));
    t->model.level++;
    t->model.growth_step = t->model.step;
    t->model.last_square = 0;
    cln_plans_adopt(t, &next);
    CLN_TRY(carry(t, change.count > 0 ? &change : &splits));
    cln_plans_check_own(p, own);
    CLN_TRY(cln_plans_deal(t));
    CLN_TRY(restart_measures(t));
    cln_debug("step %lld: level %d, %d leaves", (long long)t->model.step, t->model.level,
              p->leaves);
done:
    free(marks);
    cln_octree_change_free(&change);
    cln_octree_change_free(&splits);
    return st;
}

/* Missing leaves are looked for while at least 1 / FREE_PART of the largest tree's leaves are
 * free. */
enum { FREE_PART = 64 };

/* Leaves that came back to `tree` but are empty by geometry go again. fresh: how many are left. */
static cln_status carve_fresh(const cln_trainer *t, cln_octree *tree, cln_octree_change *change,
                              int *fresh)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;
    cln_octree_change culled = {0};
    int count = 0;

    *fresh = 0;
    CLN_TRY(cln_carve_find(t->scene, &t->model.space, &t->model.config, tree, &marks, &count));
    count = 0;
    for (int s = 0; s < change->count; s++) {
        const bool is_fresh = change->octant[s] == CLN_FRESH;

        if (marks)
            marks[s] = marks[s] && is_fresh;
        count += marks && marks[s];
        *fresh += is_fresh;
    }
    *fresh -= count;
    if (count > 0) {
        CLN_TRY(cln_octree_cull(tree, marks, &culled));
        CLN_TRY(cln_octree_change_join(change, &culled));
    }
done:
    free(marks);
    cln_octree_change_free(&culled);
    return st;
}

/* Brings leaves back where something is missing: all of them, or none if they do not fit. splits:
 * the number of leaves that each leaf becomes right afterwards, 8 before a growth, else 1. */
static cln_status regrow(cln_trainer *t, int splits, bool *regrown)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    const double began = cln_now();
    const int most = cln_config_most_leaves(&t->model.config);
    uint8_t *empty = NULL;
    int fresh = 0, own = 0;
    cln_missing missing = {0};
    cln_leaf_stats stats = {0};
    cln_octree tree = {0}, old = {0};
    cln_octree_change change = {0};
    cln_plans next;

    *regrown = false;
    if (t->model.config.regrow <= 0 || most - leaves < most / FREE_PART)
        return CLN_OK;
    CLN_TRY(cln_step_catch_up(t));
    CLN_TRY(cln_alloc(&empty, (size_t)leaves, 1, "leaf marks"));
    CLN_TRY(leaf_stats(t, &stats.mean, &stats.peak));
    cln_structure_empty(&t->model.tree, &stats, &t->model.config, empty);
    CLN_TRY(cln_regrow_find(t, empty, &missing));
    if (missing.errors + missing.cut == 0)
        goto done;
    CLN_TRY(cln_octree_copy(&t->model.tree, &tree));
    CLN_TRY(cln_octree_regrow(&tree, &missing.marks, t->model.level, empty, &change));
    CLN_TRY(carve_fresh(t, &tree, &change, &fresh));
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
    cln_plans_adopt(t, &next);
    CLN_TRY(carry(t, &change));
    cln_plans_check_own(&t->pipeline, own);
    CLN_TRY(cln_plans_deal(t));
    CLN_TRY(restart_measures(t));
    if (missing.errors > 0) { /* densities change fast */
        t->model.growth_step = t->model.step;
        t->model.last_square = 0;
    }
    *regrown = true;
    cln_debug("step %lld: something is missing: %d leaves come back, now %d leaves (%d places by "
              "errors, %d by surfaces that are cut off); %.2f s",
              (long long)t->model.step, fresh, t->pipeline.leaves, missing.errors, missing.cut,
              cln_now() - began);
done:
    cln_marks_free(&missing.marks);
    free(empty);
    free(stats.mean);
    free(stats.peak);
    cln_octree_free(&tree);
    cln_octree_change_free(&change);
    return st;
}

/* ---- stage 1 ---- */

static cln_status refresh(cln_trainer *t, int first, int count)
{
    return cln_stage_refresh(&t->pipeline, first, count, true, (uint64_t)t->model.config.seed,
                             (uint32_t)t->model.step);
}

/* Refreshes the marked leaves only, run by run. */
static cln_status refresh_marked(cln_trainer *t, const uint8_t *marks)
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

/* ---- the effect of a change on a fixed batch ---- */

enum { PROBE_RAYS = 2048 };

cln_status cln_maintain_probe(cln_trainer *t, double *psnr)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    cln_pipeline *p = &t->pipeline;
    const int wanted = c->rays < PROBE_RAYS ? c->rays : PROBE_RAYS;
    const int rays = wanted < t->plan.max_rays ? wanted : t->plan.max_rays;
    cln_ray_batch batch = {.pixels = t->batch.pixels,
                           .n = rays,
                           .backgrounds = (const float(*)[4])t->batch.backgrounds,
                           .sampling = cln_render_sampling(p)};
    /* of all pixels, so that they are the same before and after a change */
    const cln_draw draw = {.step = UINT32_MAX, .n = rays, .ray_background = p->ray_background};
    int used = 0;
    double square = 0;

    batch.sampling.pictures = false; /* training's densities, as the next step reads them */
    batch.sampling.max_samples = t->plan.max_samples;
    CLN_TRY(cln_step_catch_up(t));
    cln_queue_book(t->device, CLN_STAGE_PROBE);
    t->drawn = false;
    cln_batch_draw(&t->batch, t->scene, c, &draw);
    CLN_TRY(cln_render_rays(p, &batch, t->results, &used));
    for (int i = 0; i < used; i++) {
        const float got[3] = {t->results[i].r, t->results[i].g, t->results[i].b};

        for (int k = 0; k < 3; k++)
            square += ((double)got[k] - t->batch.targets[i][k]) *
                      ((double)got[k] - t->batch.targets[i][k]);
    }
    *psnr = -10 * log10(fmax(square / (3.0 * used), 1e-10));
done:
    cln_queue_book(t->device, CLN_STAGES);
    return st;
}

/* ---- decisions ---- */

/* Sums the costs e d of the children to merge into cost[parent's node], before they are gone. */
static void save_costs(const cln_model *model, const float *mean, const uint8_t *merge,
                       double *cost)
{
    const cln_octree *tree = &model->tree;

    for (int s = 0; s < tree->leaf_count; s++)
        if (merge[s])
            cost[tree->parent[tree->leaf[s]]] +=
                model->error[s] * pow(fmax(mean[s], 0), model->config.cost_density);
}

/* Changes the model's tree by merges, then splits; *change: both as one. split, merge: marks [old
 * slot]; children [old slot]: bit i is set if a split leaf gets child i. *fresh: marks of new
 * leaves [slot], merged ones included. */
static cln_status change_model(cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                               const uint8_t *children, cln_octree_change *change, uint8_t **fresh)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    cln_octree *tree = &m->tree;
    const size_t nodes = (size_t)tree->node_count, old = (size_t)tree->leaf_count;
    cln_octree_change splits = {0};
    float *mean = NULL, *peak = NULL;
    uint8_t *marks = NULL, *by_node = NULL, *children_by_node = NULL;
    double *cost = NULL;

    CLN_TRY(cln_alloc(&by_node, nodes, 1, "leaf marks"));
    CLN_TRY(cln_alloc(&children_by_node, nodes, 1, "leaf marks"));
    CLN_TRY(cln_alloc(&cost, nodes, sizeof *cost, "costs of leaves"));
    CLN_TRY(leaf_stats(t, &mean, &peak));
    for (size_t s = 0; s < old; s++) {
        by_node[tree->leaf[s]] = split[s];
        children_by_node[tree->leaf[s]] = children[s];
    }
    save_costs(m, mean, merge, cost);
    CLN_TRY(cln_octree_merge(tree, merge, mean, change));
    CLN_TRY(cln_model_follow(m, change));
    CLN_TRY(cln_alloc(&marks, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count; s++) {
        marks[s] = by_node[tree->leaf[s]];
        if (change->octant[s] <= CLN_MERGED)
            m->saved[s] = (float)cost[tree->leaf[s]];
    }
    CLN_TRY(cln_octree_split(tree, marks, &splits));
    CLN_TRY(cln_model_follow(m, &splits));
    CLN_TRY(cln_children_drop(m, children_by_node, &splits));
    CLN_TRY(cln_octree_change_join(change, &splits));
    CLN_TRY(cln_alloc(fresh, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count; s++)
        (*fresh)[s] = change->octant[s] != CLN_COPIED;
done:
    free(mean);
    free(peak);
    free(marks);
    free(by_node);
    free(children_by_node);
    free(cost);
    cln_octree_change_free(&splits);
    return st;
}

/* Leaves that the rank with most will have after such a change, or a few more (groups that merge
 * across ranks count for each); 0 without ranks. */
static int most_after(const cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                      const uint8_t *children)
{
    const cln_pipeline *p = &t->pipeline;
    const cln_octree *tree = &t->model.tree;
    int most = 0;

    for (int r = 0; p->ranks > 1 && r < p->ranks; r++) {
        int after = 0, group = -1;

        for (int s = p->rank_first[r]; s < p->rank_first[r + 1]; s++) {
            const int parent = tree->parent[tree->leaf[s]];

            if (!merge[s])
                after += split[s] ? cln_children_count(children[s]) : 1;
            else if (parent != group)
                after++;
            group = merge[s] ? parent : group;
        }
        most = after > most ? after : most;
    }
    return most;
}

cln_status cln_maintain_restructure(cln_trainer *t, const uint8_t *split, const uint8_t *merge,
                                    const uint8_t *children, int leaves_after, cln_decision *d)
{
    cln_status st = CLN_OK;
    cln_distil distil = {0};
    cln_octree_change change = {0};
    const int own = most_after(t, split, merge, children);
    cln_plans next;
    uint8_t *fresh = NULL;

    CLN_TRY(cln_maintain_probe(t, &d->psnr_before));
    CLN_TRY(cln_distil_prepare(t, merge, &distil));
    cln_plans_make(t, leaves_after, own, &next);
    CLN_TRY(change_model(t, split, merge, children, &change, &fresh));
    CLN_ASSERT(t->model.tree.leaf_count == leaves_after);
    cln_plans_adopt(t, &next);
    CLN_TRY(carry(t, &change));
    cln_plans_check_own(&t->pipeline, own);
    CLN_TRY(cln_plans_deal(t));
    CLN_TRY(restart_measures(t));
    CLN_TRY(refresh_marked(t, fresh));
    CLN_TRY(cln_maintain_probe(t, &d->psnr_after));
    d->psnr_pretrained = d->psnr_after;
    if (distil.nets > 0) {
        CLN_TRY(cln_distil_train(t, &distil, &d->distil_steps));
        memset(fresh, 0, (size_t)t->model.tree.leaf_count);
        for (int n = 0; n < distil.nets; n++)
            fresh[t->model.tree.slot[distil.nodes[n]]] = 1;
        CLN_TRY(refresh_marked(t, fresh));
        CLN_TRY(cln_maintain_probe(t, &d->psnr_pretrained));
    }
done:
    free(fresh);
    cln_octree_change_free(&change);
    cln_distil_free(&distil);
    return st;
}

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
    if (n < wanted && n <= leaves && !t->full) {
        cln_warn("memory has no room for more than the present %d leaves (--max-leaves %d)", leaves,
                 wanted);
        t->full = true;
    }
    return n;
}

/* Marks leaves whose voxels must not become finer, [slot]: half of one would be below --cell-pixels
 * pixels of the photos that see it. None without voxels. met: leaves that met too few samples to
 * split are left out. */
static cln_status fine_leaves(cln_trainer *t, const int32_t *met, uint8_t **out)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const cln_octree *tree = &t->model.tree;
    double *each = NULL;

    CLN_TRY(cln_alloc(out, (size_t)tree->leaf_count, 1, "leaf marks"));
    if (c->encoding != CLN_ENCODING_VOXEL || c->cell_pixels <= 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&each, (size_t)cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN), sizeof *each,
                      "views"));
    for (int s = 0; s < tree->leaf_count; s++) {
        float box[4];
        double centre[3];

        if (met[s] < c->split_samples || tree->level[tree->leaf[s]] >= c->max_level)
            continue;
        cln_octree_box(tree, tree->leaf[s], box);
        for (int a = 0; a < 3; a++)
            centre[a] = box[a] + 0.5 * box[3];
        (*out)[s] = cln_scene_cell_pixels(t->scene, &t->model.space, centre,
                                          0.5 * box[3] / c->grid_cells, each) < c->cell_pixels;
    }
done:
    free(each);
    return st;
}

/* Measures every leaf: error per ray, density, whether it may split, and into which children:
 * before --cull-from, into all. Errors also go into the model. */
static cln_status measure(cln_trainer *t, double fraction, cln_leaf_measure **out,
                          uint8_t **children)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    cln_pipeline *p = &t->pipeline;
    const size_t leaves = (size_t)p->leaves;
    float *mean = NULL, *peak = NULL, (*sums)[CLN_MEASURES][2] = NULL;
    int32_t *met = NULL;
    uint8_t *stays = NULL, *asked = NULL;

    CLN_TRY(cln_alloc(out, leaves, sizeof **out, "measures of leaves"));
    CLN_TRY(cln_alloc(&sums, leaves, sizeof *sums, "measures of leaves"));
    CLN_TRY(cln_alloc(&met, leaves, sizeof *met, "measures of leaves"));
    CLN_TRY(leaf_stats(t, &mean, &peak));
    CLN_TRY(cln_share_sums(p));
    CLN_TRY(cln_buffer_read(t->device, &p->leaf_sums, 0, sums, leaves * sizeof *sums));
    CLN_TRY(cln_buffer_read(t->device, &p->leaf_met, 0, met, leaves * sizeof *met));
    CLN_TRY(fine_leaves(t, met, &stays));
    CLN_TRY(cln_alloc(&asked, leaves, 1, "leaf marks"));
    for (size_t i = 0; i < leaves; i++) {
        stays[i] = stays[i] || met[i] < m->config.split_samples;
        asked[i] = !stays[i] && fraction >= m->config.cull_from;
    }
    CLN_TRY(cln_children_find(t, asked, children));
    for (size_t i = 0; i < leaves; i++) {
        m->error[i] = sums[i][0][0] / (float)m->sum_rays;
        (*out)[i] = (cln_leaf_measure){.error = fmax(m->error[i], 0),
                                       .density = pow(fmax(mean[i], 0), m->config.cost_density),
                                       .saved = m->saved[i],
                                       .children = cln_children_count((*children)[i]),
                                       .may_split = !stays[i]};
    }
done:
    free(mean);
    free(peak);
    free(sums);
    free(met);
    free(stays);
    free(asked);
    return st;
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

/* By ranks, takes fewer leaves if those of one do not fit where they will be. */
static cln_status solve(cln_trainer *t, const uint8_t *children, cln_integer_program_desc *desc,
                        cln_integer_program_result *r)
{
    cln_status st = CLN_OK;
    const int leaves = t->pipeline.leaves;
    cln_plans next;

    CLN_TRY(cln_integer_program_solve(desc, r));
    while (t->pipeline.ranks > 1 && r->leaves > leaves &&
           !cln_plans_fit(t, r->leaves, most_after(t, r->split, r->merge, children), &next)) {
        cln_clear_error();
        desc->max_leaves = leaves + (r->leaves - leaves) / 2;
        cln_integer_program_result_free(r);
        CLN_TRY(cln_integer_program_solve(desc, r));
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
    cln_decision d = {.leaves_before = t->pipeline.leaves,
                      .psnr_before = NAN,
                      .psnr_after = NAN,
                      .psnr_pretrained = NAN};
    cln_integer_program_desc desc = {.tree = &m->tree,
                                     .max_leaves = leaf_budget(t),
                                     .max_level = m->config.max_level + m->space.shell,
                                     .split_factor = m->config.split_factor,
                                     .merge_factor = m->config.merge_factor,
                                     .no_merges = !cln_config_merges(&m->config)};

    CLN_TRY(measure(t, fraction, &measures, &children));
    desc.measures = measures;
    CLN_TRY(solve(t, children, &desc, &r));
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
        CLN_TRY(cln_maintain_restructure(t, r.split, r.merge, children, r.leaves, &d));
        m->last_square = 0;
        if (r.leaves - r.keeps > r.leaves / 8) /* as after a growth, densities change fast */
            m->growth_step = m->step;
    } else {
        m->last_square = square;
        CLN_TRY(restart_measures(t));
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

/* Returns whether a decision is due, and counts it even if the tree is then left alone. */
static bool decision_comes(cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;
    int due = 0;

    if (!c->adaptive || c->tree_from[0] || fraction < c->structure_from ||
        fraction >= c->structure_until)
        return false;
    due = 1 + (int)floor((fraction - c->structure_from) / c->structure_every);
    if (due <= t->model.decisions)
        return false;
    t->model.decisions = due;
    return t->model.sum_rays + (t->owed.due ? t->owed.rays : 0) > 0;
}

/* Whether a whole level of voxels is due, and only waits for the one before: decisions do, too. The
 * first of them also waits until the empty leaves of the last level are culled, as they would take
 * the budget, and the others have been measured. */
static bool awaits_level(const cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;

    if (!cln_leaf_kind_of(c->encoding)->levels_first)
        return false;
    if (t->model.decisions == 0 &&
        t->model.step < t->model.growth_step + c->cull_after + c->refresh_every)
        return true;
    return !t->finest && !t->full && has_whole_levels(t) &&
           t->model.level < cln_structure_level(c, fraction);
}

/* Says once that the tree never adapted, as the first decision waited (awaits_level) until
 * --structure-until: a training too short for --cull-after. */
static void say_none_came(cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;

    if (t->none_came || !c->adaptive || c->tree_from[0] || t->model.decisions > 0 ||
        c->structure_from >= c->structure_until || fraction < c->structure_until ||
        t->model.level >= c->max_level || !awaits_level(t, c->structure_until))
        return;
    t->none_came = true;
    cln_warn("no single leaf was split: at --structure-until %g, the tree still waited for "
             "--cull-after %d + --refresh-every %d steps after its last level, at step %lld; give "
             "a smaller --cull-after, or a larger budget",
             c->structure_until, c->cull_after, c->refresh_every, (long long)t->model.growth_step);
}

/* method.md 12.3: decides only when the error no longer falls from interval to interval. */
static cln_status wait_or_decide(cln_trainer *t, double fraction)
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
    CLN_TRY(restart_measures(t));
done:
    return st;
}

/* ---- all of it ---- */

/* A rolling refresh has PARTS parts, one every PARTS steps (instant-ngp's sixteen). */
enum { PARTS = 16 };

/* Steps from one look at the ranks' balance to the next. */
enum { BALANCE_EVERY = 16 };

cln_status cln_maintain(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int64_t refresh_age = t->model.step - t->model.refresh_step;
    cln_pipeline *p = &t->pipeline;
    const bool fixed = c->tree_from[0] != 0;
    bool grown = false, regrown = false, full = false, decision = false;
    cln_share_move move;

    if (!fixed && t->model.level < cln_structure_level(c, fraction))
        CLN_TRY(ready_to_grow(t, &grown));
    if (grown)
        CLN_TRY(room_to_grow(t, &grown));
    if (grown && t->model.step > 0)
        CLN_TRY(regrow(t, 8, &regrown));
    if (grown)
        CLN_TRY(grow(t));
    say_none_came(t, fraction);
    decision = !grown && !awaits_level(t, fraction) && decision_comes(t, fraction);
    if (grown || decision || t->model.step == 0 ||
        (!c->rolling_refresh && refresh_age >= refresh_interval(t))) {
        CLN_TRY(refresh(t, 0, p->leaves));
        t->model.refresh_step = t->model.step;
        full = true;
    } else if (c->rolling_refresh && t->model.step % PARTS == 0) {
        const int part = (int)(t->model.step / PARTS % PARTS);
        const int first = (int)((int64_t)p->leaves * part / PARTS);
        const int end = (int)((int64_t)p->leaves * (part + 1) / PARTS);

        CLN_TRY(refresh(t, first, end - first));
        full = part == PARTS - 1;
    }
    if (full && !grown && !fixed && fraction >= c->cull_from && t->model.step > 0 &&
        t->model.step >= t->model.growth_step + c->cull_after)
        CLN_TRY(cull(t, decision));
    if (decision)
        CLN_TRY(wait_or_decide(t, fraction));
    if (decision) {
        CLN_TRY(regrow(t, 1, &regrown));
        if (regrown)
            CLN_TRY(refresh(t, 0, p->leaves));
    }
    if (t->model.step > 0 && t->model.step % BALANCE_EVERY == 0) {
        CLN_TRY(cln_share_balance(p, &move));
        if (move.leaves > 0) {
            CLN_TRY(cln_plans_deal(t));
            CLN_TRY(cln_record_move(t, &move));
        }
    }
done:
    return st;
}
