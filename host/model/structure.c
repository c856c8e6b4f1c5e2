/* Decides on culling of empty leaves and on growth by schedule. See structure.h. */
#include "model/structure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/log.h"

void cln_leaf_stats_free(cln_leaf_stats *stats)
{
    free(stats->mean);
    free(stats->peak);
    memset(stats, 0, sizeof *stats);
}

/* Is a leaf empty by its mean density and, if culling is guarded, by its peak? A thin opaque rod in
 * a big leaf has a tiny mean (1e-5 of the volume at sigma 500 gives 0.005) but one opaque
 * sample. */
static bool is_empty(const cln_config *config, float mean, float peak, double side)
{
    if (!(mean < config->cull_mean))
        return false;
    return config->cull == CLN_CULL_MEAN || peak * (side / config->n1) < config->cull_max;
}

/* Marks leaves by their strikes, possibly all. */
static int mark(const cln_octree *tree, const cln_config *config, uint8_t *cull)
{
    const int needed = config->cull == CLN_CULL_MEAN ? 1 : config->cull_strikes;
    int marked = 0;

    for (int s = 0; s < tree->leaf_count; s++) {
        cull[s] = tree->strikes[tree->leaf[s]] >= needed;
        marked += cull[s];
    }
    return marked;
}

int cln_structure_marked(const cln_octree *tree, const cln_config *config, uint8_t *cull)
{
    const int marked = mark(tree, config, cull);

    if (marked < tree->leaf_count)
        return marked;
    memset(cull, 0, (size_t)tree->leaf_count);
    return 0;
}

void cln_structure_empty(const cln_octree *tree, const cln_leaf_stats *stats,
                         const cln_config *config, uint8_t *empty)
{
    for (int s = 0; s < tree->leaf_count; s++)
        empty[s] = is_empty(config, stats->mean[s], stats->peak[s],
                            2.0 / (1 << tree->level[tree->leaf[s]]));
}

static float value_of(uint16_t bfloat16)
{
    const uint32_t bits = (uint32_t)bfloat16 << 16;
    float value = 0;

    memcpy(&value, &bits, sizeof value);
    return value;
}

/* A surface moves a little when cells become finer, and a part that is thinner than a cell shows
 * first as a faint one. So a child also has the cells next to its octant, and its guard is
 * stricter. */
enum { AROUND = 1, STRICTER = 4 };

uint8_t cln_structure_children(const cln_config *config, int level, const uint16_t *density,
                               const uint8_t *seen)
{
    const int n1 = config->n1, part = (n1 + 1) / 2;
    const double side = 1.0 / (1 << level);
    uint8_t children = 0;

    for (int child = 0; child < 8; child++) {
        float sum = 0, peak = 0;
        int count = 0;

        for (int i = 0; i < n1 * n1 * n1; i++) {
            const int at[3] = {i % n1, i / n1 % n1, i / n1 / n1};
            bool inside = true, close = true;

            for (int a = 0; a < 3; a++) {
                const int x = at[a] - (child >> a & 1) * (n1 / 2);

                inside = inside && x >= 0 && x < part;
                close = close && x >= -AROUND && x < part + AROUND;
            }
            if (!seen[i] || !close)
                continue;
            peak = fmaxf(peak, value_of(density[i]));
            if (inside) {
                sum += value_of(density[i]);
                count++;
            }
        }
        if (!is_empty(config, count > 0 ? sum / (float)count : 0, peak, STRICTER * side))
            children |= (uint8_t)(1 << child);
    }
    return children;
}

int cln_structure_cull(cln_octree *tree, const cln_leaf_stats *stats, const cln_config *config,
                       uint8_t *cull)
{
    int marked = 0, densest = 0;

    for (int s = 0; s < tree->leaf_count; s++) {
        int node = tree->leaf[s];
        double side = 2.0 / (1 << tree->level[node]);
        uint8_t *strikes = &tree->strikes[node];

        if (!is_empty(config, stats->mean[s], stats->peak[s], side))
            *strikes = 0;
        else if (*strikes < UINT8_MAX)
            ++*strikes;
        if (stats->mean[s] > stats->mean[densest])
            densest = s;
    }
    marked = mark(tree, config, cull);
    if (marked > 0 && marked == tree->leaf_count) {
        cull[densest] = 0;
        marked--;
        cln_warn("all %d leaves look empty (largest mean density %g); one is kept: the training "
                 "images may see nothing of the cube, see --bbox and --cull-mean",
                 tree->leaf_count, (double)stats->mean[densest]);
    }
    return marked;
}

int cln_structure_level(const cln_config *config, double fraction)
{
    double at[CLN_MAX_LEVEL + 1];
    int level = config->start_level;

    /* The check of the options has refused wrong syntax; without a plan the tree keeps its first
     * level. */
    if (cln_config_levels(config, at) != CLN_OK) {
        cln_clear_error();
        return level;
    }
    for (int l = level + 1; l <= CLN_MAX_LEVEL; l++)
        if (fraction >= at[l])
            level = l;
    return level;
}
