/* Splits and merges leaves. See restructure.h. */
#include "train/restructure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "train/change.h"
#include "train/children.h"
#include "train/distil.h"
#include "train/measure.h"
#include "train/probe.h"
#include "train/refresh.h"

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

/* Changes the model's tree by merges, then splits; *change: both as one. *fresh: marks of new
 * leaves [slot], merged ones included. */
static cln_status change_model(cln_trainer *t, const cln_restructuring *how,
                               cln_octree_change *change, uint8_t **fresh)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    cln_octree *tree = &m->tree;
    const size_t nodes = (size_t)tree->node_count, old = (size_t)tree->leaf_count;
    cln_octree_change splits = {0};
    cln_leaf_stats stats = {0};
    uint8_t *marks = NULL, *by_node = NULL, *children_by_node = NULL;
    double *cost = NULL;

    CLN_TRY(cln_alloc(&by_node, nodes, 1, "leaf marks"));
    CLN_TRY(cln_alloc(&children_by_node, nodes, 1, "leaf marks"));
    CLN_TRY(cln_alloc(&cost, nodes, sizeof *cost, "costs of leaves"));
    CLN_TRY(cln_measure_stats(t, &stats));
    for (size_t s = 0; s < old; s++) {
        by_node[tree->leaf[s]] = how->split[s];
        children_by_node[tree->leaf[s]] = how->children[s];
    }
    save_costs(m, stats.mean, how->merge, cost);
    CLN_TRY(cln_octree_merge(tree, how->merge, stats.mean, change));
    CLN_TRY(cln_model_follow(m, change));
    CLN_TRY(cln_alloc(&marks, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count; s++) {
        marks[s] = by_node[tree->leaf[s]];
        if (change->octant[s] <= CLN_MERGED)
            m->saved[s] = (float)cost[tree->leaf[s]];
    }
    CLN_TRY(cln_octree_split(tree, marks, &splits));
    CLN_TRY(cln_children_drop(tree, children_by_node, &splits));
    CLN_TRY(cln_model_follow(m, &splits));
    CLN_TRY(cln_octree_change_join(change, &splits));
    CLN_TRY(cln_alloc(fresh, (size_t)tree->leaf_count, 1, "leaf marks"));
    for (int s = 0; s < tree->leaf_count; s++)
        (*fresh)[s] = change->octant[s] != CLN_COPIED;
done:
    cln_leaf_stats_free(&stats);
    free(marks);
    free(by_node);
    free(children_by_node);
    free(cost);
    cln_octree_change_free(&splits);
    return st;
}

int cln_restructure_own(const cln_trainer *t, const cln_restructuring *how)
{
    const cln_pipeline *p = &t->pipeline;
    const cln_octree *tree = &t->model.tree;
    int most = 0;

    for (int r = 0; p->ranks > 1 && r < p->ranks; r++) {
        int after = 0, group = -1;

        for (int s = p->rank_first[r]; s < p->rank_first[r + 1]; s++) {
            const int parent = tree->parent[tree->leaf[s]];

            if (!how->merge[s])
                after += how->split[s] ? cln_children_count(how->children[s]) : 1;
            else if (parent != group)
                after++;
            group = how->merge[s] ? parent : group;
        }
        most = after > most ? after : most;
    }
    return most;
}

cln_status cln_restructure(cln_trainer *t, const cln_restructuring *how, cln_decision *d)
{
    cln_status st = CLN_OK;
    cln_distil distil = {0};
    cln_octree_change change = {0};
    const int own = cln_restructure_own(t, how);
    cln_plans next;
    uint8_t *fresh = NULL;

    CLN_TRY(cln_probe_psnr(t, &d->psnr_before));
    CLN_TRY(cln_distil_prepare(t, how->merge, &distil));
    cln_plans_make(t, how->leaves, own, &next);
    CLN_TRY(change_model(t, how, &change, &fresh));
    CLN_ASSERT(t->model.tree.leaf_count == how->leaves);
    CLN_TRY(cln_change_adopt(t, &change, &next, own));
    CLN_TRY(cln_refresh_marked(t, fresh));
    CLN_TRY(cln_probe_psnr(t, &d->psnr_after));
    d->psnr_pretrained = d->psnr_after;
    if (distil.nets > 0) {
        CLN_TRY(cln_distil_train(t, &distil, &d->distil_steps));
        memset(fresh, 0, (size_t)t->model.tree.leaf_count);
        for (int n = 0; n < distil.nets; n++)
            fresh[t->model.tree.slot[distil.nodes[n]]] = 1;
        CLN_TRY(cln_refresh_marked(t, fresh));
        CLN_TRY(cln_probe_psnr(t, &d->psnr_pretrained));
    }
done:
    free(fresh);
    cln_octree_change_free(&change);
    cln_distil_free(&distil);
    return st;
}
