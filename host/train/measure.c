/* What decisions about the tree read of the leaves. See measure.h. */
#include "train/measure.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "train/children.h"

enum { MOST_LOOKED = 2048 }; /* leaves that are looked at for what they might become */

cln_status cln_measure_restart(cln_trainer *t)
{
    cln_model_restart_measures(&t->model);
    return cln_stage_measure_reset(&t->pipeline);
}

cln_status cln_measure_stats(cln_trainer *t, cln_leaf_stats *out)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const size_t leaves = (size_t)p->leaves, sums_count = leaves * CLN_MEASURES * 2;
    float(*pairs)[2] = NULL, (*sums)[CLN_MEASURES][2] = NULL;

    CLN_TRY(cln_alloc(&pairs, leaves, sizeof *pairs, "leaf statistics"));
    CLN_TRY(cln_alloc(&out->mean, leaves, sizeof *out->mean, "leaf statistics"));
    CLN_TRY(cln_alloc(&out->peak, leaves, sizeof *out->peak, "leaf statistics"));
    CLN_TRY(cln_stage_stats(p, pairs[0]));
    if (t->model.config.density_weight == CLN_WEIGHT_VISIBILITY) {
        CLN_TRY(cln_alloc(&sums, leaves, sizeof *sums, "leaf statistics"));
        CLN_TRY(cln_share_sums(p));
        CLN_TRY(cln_buffer_read(t->device, &p->leaf_sums, 0, sums, sums_count * sizeof(float)));
    }
    for (size_t i = 0; i < leaves; i++) {
        out->mean[i] = pairs[i][0];
        out->peak[i] = pairs[i][1];
        if (sums && sums[i][2][0] > 0) /* sum T sigma delta / sum T delta along the training rays */
            out->mean[i] = sums[i][1][0] / sums[i][2][0];
    }
done:
    free(pairs);
    free(sums);
    return st;
}

double cln_measure_cell_pixels(const cln_trainer *t)
{
    return t->model.config.cell_pixels / cln_model_antialias(&t->model);
}

/* Marks leaves whose voxels must not become finer, [slot]: half of one would be below
 * cln_measure_cell_pixels() of the photos that see it. None without voxels. met: leaves that met
 * too few samples to split are left out. */
static cln_status fine_leaves(cln_trainer *t, const int32_t *met, uint8_t **out)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const cln_octree *tree = &t->model.tree;
    const int finest = c->max_level + t->model.space.shell; /* as the program has it */
    double *each = NULL;

    CLN_TRY(cln_alloc(out, (size_t)tree->leaf_count, 1, "leaf marks"));
    if (c->encoding != CLN_ENCODING_VOXEL || c->cell_pixels <= 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&each, (size_t)cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN), sizeof *each,
                      "views"));
    for (int s = 0; s < tree->leaf_count; s++) {
        float box[4];
        double centre[3];

        if (met[s] < c->split_samples || tree->level[tree->leaf[s]] >= finest)
            continue;
        cln_octree_box(tree, tree->leaf[s], box);
        for (int a = 0; a < 3; a++)
            centre[a] = box[a] + 0.5 * box[3];
        (*out)[s] =
            cln_scene_cell_pixels(t->scene, &t->model.space, centre, 0.5 * box[3] / c->grid_cells,
                                  each) < cln_measure_cell_pixels(t);
    }
done:
    free(each);
    return st;
}

/* The share of the box whose voxels, once it is split `deeper` times more, are wide enough to be
 * halved. Looked at in up to four places along an axis; what no photo sees is not met, either. */
static double wide_share(const cln_trainer *t, const float box[4], int deeper, double *each)
{
    const cln_config *c = &t->model.config;
    const double half = ldexp(0.5 * box[3] / c->grid_cells, -deeper);
    const int parts = 1 << (deeper < 2 ? deeper : 2), all = parts * parts * parts;
    int wide = 0;

    for (int i = 0; i < all; i++) {
        const int at[3] = {i % parts, i / parts % parts, i / parts / parts};
        double centre[3], pixels = 0;

        for (int a = 0; a < 3; a++)
            centre[a] = box[a] + (at[a] + 0.5) * box[3] / parts;
        pixels = cln_scene_cell_pixels(t->scene, &t->model.space, centre, half, each);
        wide += isfinite(pixels) && pixels >= cln_measure_cell_pixels(t);
    }
    return (double)wide / all;
}

cln_status cln_measure_can_split(cln_trainer *t, int level, double *share)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const cln_octree *tree = &t->model.tree;
    const int deeper = level > t->model.level ? level - t->model.level : 0;
    const int step = 1 + tree->leaf_count / MOST_LOOKED;
    double *each = NULL, sum = 0;
    int looked = 0;

    *share = level < c->max_level;
    if (level >= c->max_level || c->encoding != CLN_ENCODING_VOXEL || c->cell_pixels <= 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&each, (size_t)cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN), sizeof *each,
                      "views"));
    for (int s = 0; s < tree->leaf_count; s += step) {
        float box[4];

        looked++;
        if (tree->level[tree->leaf[s]] + deeper >= c->max_level + t->model.space.shell)
            continue;
        cln_octree_box(tree, tree->leaf[s], box);
        sum += wide_share(t, box, deeper, each);
    }
    *share = looked > 0 ? sum / looked : 0;
done:
    free(each);
    return st;
}

cln_status cln_measure_leaves(cln_trainer *t, double fraction, cln_leaf_measure **out,
                              uint8_t **children, int *fine)
{
    cln_status st = CLN_OK;
    cln_model *m = &t->model;
    cln_pipeline *p = &t->pipeline;
    const size_t leaves = (size_t)p->leaves;
    float(*sums)[CLN_MEASURES][2] = NULL;
    cln_leaf_stats stats = {0};
    int32_t *met = NULL;
    uint8_t *stays = NULL, *asked = NULL;

    CLN_TRY(cln_alloc(out, leaves, sizeof **out, "measures of leaves"));
    CLN_TRY(cln_alloc(&sums, leaves, sizeof *sums, "measures of leaves"));
    CLN_TRY(cln_alloc(&met, leaves, sizeof *met, "measures of leaves"));
    CLN_TRY(cln_measure_stats(t, &stats));
    CLN_TRY(cln_share_sums(p));
    CLN_TRY(cln_buffer_read(t->device, &p->leaf_sums, 0, sums, leaves * sizeof *sums));
    CLN_TRY(cln_buffer_read(t->device, &p->leaf_met, 0, met, leaves * sizeof *met));
    CLN_TRY(fine_leaves(t, met, &stays));
    CLN_TRY(cln_alloc(&asked, leaves, 1, "leaf marks"));
    *fine = 0;
    for (size_t i = 0; i < leaves; i++) {
        *fine += stays[i];
        stays[i] = stays[i] || met[i] < m->config.split_samples;
        asked[i] = !stays[i] && fraction >= m->config.cull_from;
    }
    CLN_TRY(cln_children_find(t, asked, children));
    for (size_t i = 0; i < leaves; i++) {
        m->error[i] = sums[i][0][0] / (float)m->sum_rays;
        (*out)[i] =
            (cln_leaf_measure){.error = fmax(m->error[i], 0),
                               .density = pow(fmax(stats.mean[i], 0), m->config.cost_density),
                               .saved = m->saved[i],
                               .children = cln_children_count((*children)[i]),
                               .may_split = !stays[i]};
    }
done:
    cln_leaf_stats_free(&stats);
    free(sums);
    free(met);
    free(stays);
    free(asked);
    return st;
}
