/* Copies at extremes: weights, moments and densities over a change of the tree, and values of
 * samples that ranks exchange, of any bits: NaNs, infinities and denormal numbers among them must
 * arrive as they are. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "pipeline/carry.h"
#include "pipeline/share.h"

typedef struct rows {
    cln_extreme copies, zeros, densities;
} rows;

/* Fills an array with bits of every kind. */
static void fill(void *array, size_t bytes, uint32_t stream)
{
    static const uint32_t ends[] = {0x7F800001, 0xFFFFFFFF, 0x7F800000, 0xFF800000,
                                    0x00000001, 0x807FFFFF, 0x80000000, 0x7F7FFFFF};
    uint8_t *at = array;

    for (size_t i = 0; i < bytes; i += sizeof *ends) {
        const uint32_t draw = cln_hash(cln_hash((uint32_t)i + stream) ^ stream);
        const uint32_t word = draw % 4 ? draw : ends[draw / 4 % 8];

        memcpy(at + i, &word, bytes - i < sizeof word ? bytes - i : sizeof word);
    }
}

static size_t moments_of(const cln_model *m, bool first)
{
    return (size_t)m->net.params *
           (first ? cln_first_moment_bytes(&m->config) : cln_moment_bytes(&m->config));
}

/* Rows of new leaves are zeros, others their old leaf's. */
static void compare_rows(const char *name, const void *old, const void *got, size_t bytes,
                         const cln_octree_change *change, bool zeros, rows *to)
{
    const char *before = old, *after = got;

    for (int s = 0; s < change->count; s++) {
        const char *row = after + (size_t)s * bytes;
        size_t wrong = 0;

        if (change->octant[s] == CLN_COPIED)
            cln_extreme_meet(&to->copies,
                             memcmp(row, before + (size_t)change->from[s] * bytes, bytes) != 0, 0,
                             1, 0, "%s, leaf %d", name, s);
        else if (zeros) {
            for (size_t i = 0; i < bytes; i++)
                wrong += row[i] != 0;
            cln_extreme_meet(&to->zeros, (double)wrong, 0, 1, 0, "%s, leaf %d", name, s);
        }
    }
}

/* The middle of a cell along an axis, in the cube. */
static double middle(const float box[4], int axis, int cell, int n1)
{
    return (double)box[axis] + (cell + 0.5) * (double)box[3] / n1;
}

/* Whether a cell along an axis is the old one's, or one of the two, that are nearest to `at`. */
static bool nearest(const float box[4], int axis, double at, int cell, int n1)
{
    const double off = fabs(middle(box, axis, cell, n1) - at);

    for (int other = 0; other < n1; other++)
        if (fabs(middle(box, axis, other, n1) - at) < off - 1e-9)
            return false;
    return true;
}

/* Each new cell has the density of an old cell that is nearest to it. */
static void compare_densities(const cln_model *old, const float (*old_boxes)[4],
                              const cln_model *got, const float (*boxes)[4],
                              const cln_octree_change *change, rows *to)
{
    const int n1 = got->config.n1, cells = n1 * n1 * n1;

    for (int i = 0; i < change->count * cells; i++) {
        const int s = i / cells, cell = i % cells, from = change->from[s];
        const int at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
        bool found = false;

        for (int k = 0; k < cells && !found; k++) {
            const int there[3] = {k % n1, k / n1 % n1, k / (n1 * n1)};

            found = old->density[from * cells + k] == got->density[i];
            for (int a = 0; a < 3 && found; a++)
                found = nearest(old_boxes[from], a, middle(boxes[s], a, at[a], n1), there[a], n1);
        }
        cln_extreme_meet(&to->densities, found, 1, 1, 0, "leaf %d, cell %d", s, cell);
    }
}

/* Splits two leaves, or merges their children again. */
static cln_status change_tree(cln_octree *tree, bool merge, cln_octree_change *change)
{
    cln_status st = CLN_OK;
    uint8_t *marks = NULL;
    float *weights = NULL;
    const size_t leaves = (size_t)tree->leaf_count;

    CLN_TRY(cln_alloc(&marks, leaves, 1, "self-test"));
    CLN_TRY(cln_alloc(&weights, leaves, sizeof *weights, "self-test"));
    for (int s = 0; s < tree->leaf_count; s++) {
        weights[s] = (float)((s * 5) % 8); /* each group keeps another child */
        marks[s] = merge ? tree->level[tree->leaf[s]] == 2 : s == 2 || s == 7;
    }
    if (merge)
        CLN_TRY(cln_octree_merge(tree, marks, weights, change));
    else
        CLN_TRY(cln_octree_split(tree, marks, change));
done:
    free(marks);
    free(weights);
    return st;
}

static cln_status check_change(cln_pipeline *p, cln_model *old, bool merge, rows *to)
{
    cln_status st = CLN_OK;
    const size_t params = (size_t)old->net.params, n1 = (size_t)old->config.n1;
    cln_octree_change change = {0};
    cln_model got = {0};
    cln_octree tree = {0};
    float(*old_boxes)[4] = NULL, (*boxes)[4] = NULL;
    const size_t leaves = (size_t)old->tree.leaf_count;

    fill(old->params, leaves * params * sizeof(float), 141);
    fill(old->adam_m, leaves * moments_of(old, true), 142);
    fill(old->adam_v, leaves * moments_of(old, false), 143);
    fill(old->density, leaves * n1 * n1 * n1 * sizeof(uint16_t), 144);
    CLN_TRY(cln_octree_boxes(&old->tree, (float **)&old_boxes));
    CLN_TRY(cln_octree_copy(&old->tree, &tree));
    CLN_TRY(cln_pipeline_upload(p, old, true));
    CLN_TRY(change_tree(&tree, merge, &change));
    CLN_TRY(cln_octree_boxes(&tree, (float **)&boxes));
    CLN_TRY(cln_pipeline_rebuild(p, tree.leaf_count));
    CLN_TRY(cln_pipeline_carry(p, &tree, &change));
    CLN_TRY(cln_model_create_on(&p->config, &tree, &got));
    CLN_TRY(cln_pipeline_download(p, &got, true));
    compare_rows("weights", old->params, got.params, params * sizeof(float), &change, false, to);
    compare_rows("first moments", old->adam_m, got.adam_m, moments_of(old, true), &change, true,
                 to);
    compare_rows("second moments", old->adam_v, got.adam_v, moments_of(old, false), &change, true,
                 to);
    compare_densities(old, (const float(*)[4])old_boxes, &got, (const float(*)[4])boxes, &change,
                      to);
    cln_model_free(old);
    *old = got;
    got = (cln_model){0};
done:
    cln_octree_change_free(&change);
    cln_octree_free(&tree);
    cln_model_free(&got);
    free(old_boxes);
    free(boxes);
    return st;
}

cln_status cln_extremes_carry(cln_checks *c)
{
    static const char range[] = "a split and a merge; NaNs, infinities, denormal and other numbers";
    cln_status st = CLN_OK;
    rows to = {.copies = cln_extreme_row(c, "copies of weights and moments", range),
               .zeros = cln_extreme_row(c, "moments of new leaves", range),
               .densities = cln_extreme_row(c, "densities of the nearest cells", range)};
    cln_model model = {0};

    CLN_TRY(cln_model_create(&c->p->config, &model));
    for (int merge = 0; merge < 2; merge++)
        CLN_TRY(check_change(c->p, &model, merge, &to));
    cln_extreme_report(&to.copies);
    cln_extreme_report(&to.zeros);
    cln_extreme_report(&to.densities);
done:
    cln_model_free(&model);
    return st;
}

/* ---- values of samples, by ranks ---- */

enum { SAMPLES = 999, RANKS = 2 };

static cln_status share_pipeline(cln_pipeline *p)
{
    cln_status st = CLN_OK;

    p->ranks = RANKS;
    CLN_TRY(cln_alloc(&p->rank_first, RANKS + 1, sizeof *p->rank_first, "self-test"));
    for (int r = 0; r <= RANKS; r++)
        p->rank_first[r] = p->leaves * r / RANKS;
    CLN_TRY(cln_share_begin(p));
    CLN_TRY(cln_pipeline_want(p, CLN_PROGRAM_BIT(share)));
done:
    return st;
}

/* Rank 0's samples must leave as they are, and others arrive from the message, which no other rank
 * changes here. */
cln_status cln_extremes_share(cln_checks *c)
{
    static const char range[] = "NaNs, infinities, denormal and other numbers";
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    cln_extreme sent = cln_extreme_row(c, "values that leave", range);
    cln_extreme got = cln_extreme_row(c, "values after the exchange", range);
    cln_sample samples[SAMPLES];
    uint32_t order[SAMPLES], out[SAMPLES][4], others[SAMPLES][4], after[SAMPLES][4], slices = 0;
    cln_model model = {0};

    CLN_TRY(cln_model_create(&p->config, &model));
    CLN_TRY(cln_pipeline_upload(p, &model, false));
    CLN_TRY(share_pipeline(p));
    for (int i = 0; i < SAMPLES; i++)
        samples[i] = (cln_sample){.slot = i * 5 % p->leaves};
    fill(out, sizeof out, 145);
    fill(others, sizeof others, 146);
    CLN_TRY(cln_check_put(p->device, &p->samples, samples, sizeof samples));
    CLN_TRY(cln_stage_group(p, SAMPLES, &slices));
    CLN_TRY(cln_buffer_read(p->device, &p->values[0], 0, order, sizeof order));
    CLN_TRY(cln_check_put(p->device, &p->out, out, sizeof out));
    CLN_TRY(cln_share_room(p, sizeof others));
    memcpy(p->message, others, sizeof others);
    CLN_TRY(cln_share_samples(p, SAMPLES, false));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, after, sizeof after));
    for (int i = 0; i < SAMPLES; i++) {
        const uint32_t id = order[i];
        const bool mine = samples[id].slot < p->rank_first[1];

        if (mine)
            cln_extreme_meet(&sent, memcmp(p->message + i * sizeof *out, out[id], sizeof *out) != 0,
                             0, 1, 0, "sample %u", id);
        cln_extreme_meet(&got, memcmp(after[id], mine ? out[id] : others[i], sizeof *out) != 0, 0,
                         1, 0, "sample %u", id);
    }
    cln_extreme_report(&sent);
    cln_extreme_report(&got);
done:
    cln_model_free(&model);
    return st;
}
