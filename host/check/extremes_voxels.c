/* What voxels have instead of layers, at extremes: updates of vertices that leaves share, steps of
 * the decoder, splits and common vertices after them. Forward and backward:
 * extremes_networks.c. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "check/selftest_checks.h"
#include "pipeline/carry.h"

enum { LEAVES = 8, UPDATES = 20, GROUPS = 3, MOST_FEATURES = 32 };

static const double rates[] = {1e-8, 1e-3, 1};

/* Gradients of 0 and of sizes 1e-30 to 1e18, of both signs. */
static double gradient_of(int i)
{
    return i % 50 == 49 ? 0 : (i % 2 ? -1 : 1) * pow(10, -30 + i % 49);
}

/* Second moments of earlier updates: none, and 1e-30 to 1e36. */
static double moment_of(int i)
{
    return i % 7 == 0 ? 0 : ref_from_bf16(ref_to_bf16((float)pow(10, -30 + i % 67)));
}

/* Samples met some of a vertex's copies, or none. */
static bool is_met(int leaf, int vertex)
{
    return (leaf + vertex) % 4 != 0;
}

/* ---- updates ---- */

typedef struct update {
    cln_model model;
    int vertices, features, params, all;
    int *owner;                   /* [all] */
    float *grads, *got;           /* [all] */
    double *sum, *before, *steps; /* [all]; of owners: gradient, second moment, what to expect */
    uint8_t *met;                 /* [all] of owners */
    uint32_t *bits;               /* [LEAVES][side * side] */
} update;

static void free_update(update *u)
{
    if (!u)
        return;
    cln_model_free(&u->model);
    free(u->owner);
    free(u->grads);
    free(u->got);
    free(u->sum);
    free(u->before);
    free(u->steps);
    free(u->met);
    free(u->bits);
    free(u);
}

/* Gradients of a vertex's copies have its sign, and differ in size; those of copies that no sample
 * met are NaN, as the kernel must not read them. */
static cln_status make_update(cln_checks *c, update **out)
{
    cln_status st = CLN_OK;
    const cln_config *config = &c->p->config;
    const int side = config->grid_cells + 1;
    update *u = NULL;

    CLN_TRY(cln_alloc(&u, 1, sizeof *u, "self-test"));
    CLN_TRY(cln_model_create(config, &u->model));
    CLN_ASSERT(u->model.tree.leaf_count == LEAVES);
    u->vertices = side * side * side;
    u->features = u->model.net.features;
    u->params = u->model.net.params;
    u->all = LEAVES * u->params;
    CLN_ASSERT(u->params == u->vertices * u->features);
    CLN_TRY(cln_check_owners(&u->model, &u->owner));
    CLN_TRY(cln_alloc(&u->grads, (size_t)u->all, sizeof *u->grads, "self-test"));
    CLN_TRY(cln_alloc(&u->got, (size_t)u->all, sizeof *u->got, "self-test"));
    CLN_TRY(cln_alloc(&u->sum, (size_t)u->all, sizeof *u->sum, "self-test"));
    CLN_TRY(cln_alloc(&u->before, (size_t)u->all, sizeof *u->before, "self-test"));
    CLN_TRY(cln_alloc(&u->steps, (size_t)u->all, sizeof *u->steps, "self-test"));
    CLN_TRY(cln_alloc(&u->met, (size_t)u->all, sizeof *u->met, "self-test"));
    CLN_TRY(cln_alloc(&u->bits, (size_t)(LEAVES * side * side), sizeof *u->bits, "self-test"));
    memset(u->model.params, 0, (size_t)u->all * sizeof *u->model.params);
    for (int i = 0; i < u->all; i++) {
        const int leaf = i / u->params, vertex = i % u->params / u->features;

        u->grads[i] = NAN;
        if (!is_met(leaf, vertex))
            continue;
        u->grads[i] = (float)(gradient_of(u->owner[i]) * (1 + leaf) / LEAVES);
        u->sum[u->owner[i]] += u->grads[i];
        u->met[u->owner[i]] = 1;
        u->bits[leaf * side * side + vertex / side] |= 1u << vertex % side;
    }
    *out = u;
    return CLN_OK;
done:
    free_update(u);
    return st;
}

/* Uploads a leaf of one slice each, and the moments. */
static cln_status put_update(cln_pipeline *p, update *u, bool begins)
{
    cln_status st = CLN_OK;
    const int side = p->config.grid_cells + 1;
    uint32_t starts[LEAVES + 1];

    for (uint32_t s = 0; s <= LEAVES; s++)
        starts[s] = s;
    for (int i = 0; i < u->all; i++) {
        u->before[i] = begins ? 0 : moment_of(i);
        if (p->config.moments == CLN_MOMENTS_BFLOAT16)
            ((uint16_t *)u->model.adam_v)[i] = ref_to_bf16((float)u->before[i]);
        else
            ((float *)u->model.adam_v)[i] = (float)u->before[i];
    }
    CLN_TRY(cln_pipeline_upload(p, &u->model, true));
    CLN_TRY(cln_buffer_write(p->device, &p->slice_starts, 0, starts, sizeof starts));
    CLN_TRY(cln_check_put(p->device, &p->grads, u->grads, (size_t)u->all * sizeof *u->grads));
    CLN_TRY(cln_check_put(p->device, &p->met, u->bits,
                          (size_t)(LEAVES * side * side) * sizeof *u->bits));
done:
    return st;
}

static void expect_steps(const cln_config *config, update *u, double lr)
{
    for (int i = 0; i < u->all; i++) {
        const int f = i % u->features;
        const double rate = f == 3 ? config->density_rate : f > 3 ? config->harmonic_rate : 1;
        double m = 0, v = u->before[i];

        u->steps[i] = 0;
        if (u->met[i])
            ref_voxel_step(&u->steps[i], u->sum[i], &m, &v,
                           (ref_adam_rule){(float)lr * rate, (float)config->beta1,
                                           (float)config->beta2, (float)config->epsilon});
    }
}

/* Gradients of groups of slices, of one sign for a weight. */
static cln_status put_decoder(cln_pipeline *p, update *u, double *sum)
{
    cln_status st = CLN_OK;
    const int n = p->net.decoder_params;
    float *grads = NULL;

    if (n == 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&grads, (size_t)(GROUPS * n), sizeof *grads, "self-test"));
    memset(u->model.decoder, 0, (size_t)n * sizeof *u->model.decoder);
    memset(sum, 0, (size_t)n * sizeof *sum);
    for (int i = 0; i < GROUPS * n; i++) {
        grads[i] = (float)(gradient_of(i % n) * (1 + i / n) / GROUPS);
        sum[i % n] += grads[i];
    }
    p->decoder_groups = GROUPS;
    CLN_TRY(
        cln_check_put(p->device, &p->decoder_grads, grads, (size_t)(GROUPS * n) * sizeof *grads));
done:
    free(grads);
    return st;
}

static cln_status check_decoder(cln_pipeline *p, const double *sum, double lr, cln_extreme *row)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->net.decoder_params;
    float *got = NULL;

    CLN_TRY(cln_alloc(&got, n, sizeof *got, "self-test"));
    CLN_TRY(CLN_GET(p, decoder_w, got, 1));
    for (size_t i = 0; i < n; i++) {
        double w = 0, m = 0, v = 0;

        ref_voxel_step(&w, sum[i], &m, &v,
                       (ref_adam_rule){(float)(lr * p->config.decoder_rate), 0.9, 0.99,
                                       (float)p->config.epsilon});
        cln_extreme_meet(row, got[i], w, w, 1e-4, "gradient %g, rate %g", sum[i], lr);
    }
done:
    free(got);
    return st;
}

static cln_status count_moments(cln_pipeline *p, update *u, cln_extreme *row)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_download(p, &u->model, true));
    for (int i = 0; i < u->all; i++) {
        cln_extreme_finite(row, u->model.params[i], "number %d", i);
        cln_extreme_finite(row,
                           p->config.moments == CLN_MOMENTS_BFLOAT16
                               ? (double)ref_from_bf16(((const uint16_t *)u->model.adam_v)[i])
                               : (double)((const float *)u->model.adam_v)[i],
                           "second moment %d", i);
    }
    for (int i = 0; i < p->net.decoder_params; i++) {
        cln_extreme_finite(row, u->model.decoder[i], "decoder's weight %d", i);
        cln_extreme_finite(row, u->model.decoder_v[i], "decoder's second moment %d", i);
    }
    memset(u->model.params, 0, (size_t)u->all * sizeof *u->model.params);
    for (int i = 0; i < p->net.decoder_params; i++)
        u->model.decoder[i] = u->model.decoder_m[i] = u->model.decoder_v[i] = 0;
    if (p->config.beta1 > 0)
        memset(u->model.adam_m, 0, (size_t)u->all * cln_first_moment_bytes(&p->config));
done:
    return st;
}

static cln_status check_updates(cln_checks *c)
{
    static const char range[] =
        "gradients 0, 1e-30 to 1e18, second moments 0, 1e-30 to 1e36, rates "
        "1e-8 to 1";
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    cln_extreme step = cln_extreme_row(c, "a vertex's step", range);
    cln_extreme copies = cln_extreme_row(c, "copies of a vertex", range);
    cln_extreme decoder = cln_extreme_row(c, "the decoder's step", range);
    cln_extreme finite = cln_extreme_row(c, "numbers and moments after 20 updates", range);
    double *decoder_sum = NULL;
    update *u = NULL;

    CLN_TRY(make_update(c, &u));
    CLN_TRY(cln_alloc(&decoder_sum, (size_t)p->net.decoder_params + 1, sizeof *decoder_sum,
                      "self-test"));
    for (int k = 0; k < 2 * (int)(sizeof rates / sizeof *rates); k++) {
        const double lr = rates[k / 2];

        CLN_TRY(put_decoder(p, u, decoder_sum));
        CLN_TRY(put_update(p, u, k % 2 == 0));
        expect_steps(&p->config, u, lr);
        for (int i = 0; i < UPDATES; i++) {
            CLN_TRY(cln_stage_adam(p, 0, lr));
            if (i > 0)
                continue;
            CLN_TRY(
                cln_buffer_read(p->device, &p->params, 0, u->got, (size_t)u->all * sizeof *u->got));
            if (p->net.decoder)
                CLN_TRY(check_decoder(p, decoder_sum, lr, &decoder));
        }
        for (int i = 0; i < u->all; i++) {
            const int own = u->owner[i];

            cln_extreme_meet(&step, u->got[i], u->steps[own], u->steps[own], 1e-4,
                             "gradient %g, rate %g, second moment %g", u->sum[own], lr,
                             u->before[own]);
            cln_extreme_meet(&copies, u->got[i], u->got[own], 1, 0, "leaf %d, number %d",
                             i / u->params, i % u->params);
        }
        CLN_TRY(count_moments(p, u, &finite));
    }
    cln_extreme_report(&step);
    cln_extreme_report(&copies);
    if (p->net.decoder)
        cln_extreme_report(&decoder);
    cln_extreme_report(&finite);
done:
    free(decoder_sum);
    free_update(u);
    return st;
}

/* ---- splits ---- */

enum { STAYS = 5 }; /* the only leaf that is not split */

/* Compares the numbers of a new leaf's vertex with those that the parent of the vertex's owner has
 * there, and with their sizes. */
static void check_vertex(const cln_model *old, const cln_octree_change *change, int owner,
                         const float *got, const float *sizes, cln_extreme *row)
{
    const cln_network *net = &old->net;
    const int side = net->cells + 1, vertices = side * side * side;
    const int leaf = owner / vertices, v = owner % vertices, octant = change->octant[leaf];
    const int at[3] = {v % side, v / side % side, v / side / side};
    const size_t parent = (size_t)change->from[leaf] * (size_t)net->params;
    double local[3], want[MOST_FEATURES], size[MOST_FEATURES];

    for (int a = 0; a < 3; a++) {
        const double place = octant < 0 ? at[a] : ((octant >> a & 1) * net->cells + at[a]) / 2.0;

        local[a] = 2 * place / net->cells - 1;
    }
    ref_grid(net->cells, net->features, old->params + parent, local, want);
    ref_grid(net->cells, net->features, sizes + parent, local, size);
    for (int f = 0; f < net->features; f++)
        cln_extreme_meet(row, got[f], want[f], size[f], octant < 0 ? 0 : 1e-6,
                         "octant %d, vertex %d %d %d, sizes %.3g", octant, at[0], at[1], at[2],
                         size[f]);
}

/* Numbers of 1e-30 to 1e30, which differ between leaves at common vertices: after the split the
 * first leaf's hold. */
static cln_status check_split(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    cln_extreme row =
        cln_extreme_row(c, "a split, and common vertices after it", "numbers 1e-30 to 1e30");
    const int side = p->config.grid_cells + 1, vertices = side * side * side;
    const int params = p->net.params;
    cln_model old = {0};
    cln_octree tree = {0};
    cln_octree_change change = {0};
    uint8_t split[LEAVES];
    int32_t(*around)[27] = NULL;
    float *sizes = NULL, *got = NULL;
    int *owner = NULL;

    CLN_TRY(cln_model_create(&p->config, &old));
    CLN_TRY(cln_alloc(&sizes, (size_t)(LEAVES * params), sizeof *sizes, "self-test"));
    for (int i = 0; i < LEAVES * params; i++) {
        const double sign = cln_check_uniform(102, (uint32_t)i, -1, 1) < 0 ? -1 : 1;

        sizes[i] = (float)pow(10, cln_check_uniform(101, (uint32_t)i, -30, 30));
        old.params[i] = (float)sign * sizes[i];
    }
    for (int s = 0; s < LEAVES; s++)
        split[s] = s != STAYS;
    CLN_TRY(cln_pipeline_upload(p, &old, true));
    CLN_TRY(cln_octree_copy(&old.tree, &tree));
    CLN_TRY(cln_octree_split(&tree, split, &change));
    CLN_TRY(cln_pipeline_rebuild(p, tree.leaf_count));
    CLN_TRY(cln_pipeline_carry(p, &tree, &change));
    CLN_TRY(cln_octree_around(&tree, &around));
    CLN_TRY(cln_alloc(&owner, (size_t)(tree.leaf_count * vertices), sizeof *owner, "self-test"));
    CLN_TRY(cln_alloc(&got, (size_t)(tree.leaf_count * params), sizeof *got, "self-test"));
    ref_voxel_owners(&p->net, tree.leaf_count, (const int32_t(*)[27])around, owner);
    CLN_TRY(cln_buffer_read(p->device, &p->params, 0, got,
                            (size_t)(tree.leaf_count * params) * sizeof *got));
    for (int i = 0; i < tree.leaf_count * vertices; i++)
        check_vertex(&old, &change, owner[i],
                     got + i / vertices * params + i % vertices * p->net.features, sizes, &row);
    cln_extreme_report(&row);
done:
    cln_model_free(&old);
    cln_octree_free(&tree);
    cln_octree_change_free(&change);
    free(around);
    free(sizes);
    free(got);
    free(owner);
    return st;
}

cln_status cln_extremes_voxels(cln_checks *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(check_updates(c));
    CLN_TRY(check_split(c));
done:
    return st;
}
