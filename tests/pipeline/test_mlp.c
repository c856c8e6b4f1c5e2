/* mlp_density.cl, mlp_forward.cl and mlp_backward.cl against the float64 reference: densities,
 * forward and backward pass of many network shapes and parameter sets, with leaves of no, one and
 * many samples, random numbers in the padding of the weights (which must not matter), RReLU slopes
 * recalculated here from their documented hash, and the same bytes from the same launch. With many
 * bands samples lie at exact local coordinates: the encoding multiplies float32's rounding of a
 * position by 2^bands, which would count as an error of the network. */
#include "unit.h"
#include "device_test.h"
#include "pipeline/field.h"
#include "reference/reference.h"
#include "tests.h"

typedef struct mlp_case {
    const char *name;
    const tune_set *set;
    int width, depth, view_width, bands, view_bands;
    bool view, skip, by_level;
    int density, rrelu;
    double lower, upper;
    bool exact;   /* samples at t = 0 of rays with exact origins */
    double noise; /* std of the density noise */
    int cells;    /* of a grid, whose features are then 4, or 8 where cells are 6; 0: frequencies;
                     below 0: -CLN_ENCODING_* of another encoding */
} mlp_case;

enum { SOFT = CLN_DENSITY_SOFTPLUS, RELU = CLN_DENSITY_RELU, EXP = CLN_DENSITY_EXP };
enum { VOXEL = -CLN_ENCODING_VOXEL };
enum { ELEMENT = CLN_RRELU_ELEMENT, NEURON = CLN_RRELU_NEURON, MEAN = CLN_RRELU_MEAN };

static const mlp_case cases[] = {
    {"small, default", &tune_sets[0], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, false, 0, 0},
    {"small, plain", &tune_sets[1], 16, 2, 16, 3, 2, 1, 0, 0, SOFT, ELEMENT, -.3, -.1, false, 0, 0},
    {"small, wide vectors", &tune_sets[2], 16, 3, 48, 1, 3, 1, 0, 0, EXP, NEURON, -.3, -.1, false,
     0, 0},
    {"small, items", &tune_sets[3], 16, 2, 16, 4, 0, 1, 0, 0, RELU, ELEMENT, .1, .3, false, 0, 0},
    {"small, gpu", &tune_sets[4], 16, 3, 32, 2, 1, 1, 0, 0, SOFT, ELEMENT, -.3, -.1, false, 0, 0},
    {"no view, plain", &tune_sets[1], 16, 3, 16, 2, 0, 0, 0, 0, RELU, MEAN, -.3, -.1, false, 0, 0},
    {"no view, gpu", &tune_sets[4], 32, 6, 16, 5, 0, 0, 1, 0, SOFT, NEURON, -.3, -.1, true, 0, 0},
    {"fast preset", &tune_sets[0], 32, 3, 32, 6, 2, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0, 0},
    {"skip, items", &tune_sets[3], 32, 7, 64, 8, 4, 1, 1, 1, SOFT, ELEMENT, -.3, -.1, true, 0, 0},
    {"paper preset", &tune_sets[0], 64, 8, 256, 10, 4, 1, 1, 0, SOFT, ELEMENT, -.3, -.1, true, 0,
     0},
    {"paper preset, gpu", &tune_sets[4], 64, 8, 256, 10, 4, 1, 1, 1, EXP, MEAN, 0, 0, true, 0, 0},
    {"wide, wide vectors", &tune_sets[2], 128, 4, 128, 10, 4, 1, 0, 1, SOFT, MEAN, -.3, -.1, true,
     0, 0},
    {"noise, default", &tune_sets[0], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, ELEMENT, -.3, -.1, false, 1,
     0},
    {"noise, gpu", &tune_sets[4], 32, 3, 32, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, false, 0.3, 0},
    {"fast preset, native", &native_set, 32, 3, 32, 6, 2, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0,
     0},
    {"fast preset, half", &half_sets[0], 32, 3, 32, 6, 2, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0,
     0},
    {"no view, half, gpu", &half_sets[1], 32, 6, 16, 5, 0, 0, 1, 0, SOFT, ELEMENT, -.3, -.1, true,
     0, 0},
    {"widest, gpu", &tune_sets[4], 256, 2, 256, 7, 4, 1, 0, 0, SOFT, NEURON, -.3, -.1, true, 0, 0},
    {"grid, default", &tune_sets[0], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, false, 0, 4},
    {"grid, items", &tune_sets[3], 32, 3, 16, 2, 2, 1, 0, 0, SOFT, MEAN, -.3, -.1, false, 0, 6},
    {"grid, gpu", &tune_sets[4], 32, 2, 32, 2, 1, 0, 0, 0, EXP, MEAN, -.3, -.1, false, 0, 8},
    {"voxel, default", &tune_sets[0], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0,
     VOXEL},
    {"voxel, plain", &tune_sets[1], 16, 2, 16, 2, 1, 0, 0, 0, RELU, MEAN, -.3, -.1, true, 0, VOXEL},
    {"voxel, wide", &tune_sets[2], 16, 2, 16, 2, 1, 1, 0, 0, EXP, MEAN, -.3, -.1, true, 0.5, VOXEL},
    {"voxel, items", &tune_sets[3], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0, VOXEL},
    {"voxel, gpu", &tune_sets[4], 16, 2, 16, 2, 1, 1, 0, 0, SOFT, MEAN, -.3, -.1, true, 0.5, VOXEL},
};

static cln_config config_of(const mlp_case *c)
{
    cln_config config = small_config();

    config.width = c->width;
    config.depth = c->depth;
    config.view_width = c->view_width;
    config.bands = c->bands;
    config.view_bands = c->view_bands;
    config.view_dependence = c->view;
    config.skip = c->skip;
    config.bands_by_level = c->by_level;
    config.density = c->density;
    config.rrelu_scope = c->rrelu;
    config.rrelu_lower = c->lower;
    config.rrelu_upper = c->upper;
    config.density_noise = c->noise;
    config.roulette = 0;
    config.encoding = c->cells < 0 ? -c->cells : CLN_ENCODING_FREQUENCY;
    if (c->cells > 0) {
        config.encoding = CLN_ENCODING_GRID;
        config.grid_cells = c->cells;
        config.grid_features = c->cells == 6 ? 8 : 4;
    }
    return config;
}

/* ---- a model with different leaves, and samples ---- */

/* Numbers of rays do not fit 16 bits, nor can small ones be mistaken for them: there are no rays
 * below (NaN). */
enum { FIRST_RAY = 70000 };

typedef struct mlp_data {
    cln_model model; /* 22 leaves at levels 1, 2 and 3 */
    uint32_t n;
    cln_sample *samples;
    float (*ray_o)[4], (*ray_d)[4]; /* one ray per sample */
    float (*dout)[4];
} mlp_data;

static void split_first(cln_model *model)
{
    uint8_t split[64] = {1};
    cln_octree_change change = {0};

    assert_ok(cln_octree_split(&model->tree, split, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
}

/* Number of samples of leaf s: 0, 1, around a register tile, a block, a slice, and more. */
static uint32_t samples_of(int s, const cln_tune *tune)
{
    const int counts[] = {0,
                          1,
                          tune->ts - 1,
                          tune->ts,
                          tune->ts + 1,
                          tune->nb,
                          tune->nb + 1,
                          tune->sl + 3,
                          2 * tune->nb + 5};

    return s < 9 ? (uint32_t)(counts[s] < 150 ? counts[s] : 150 + counts[s] % 7) : (uint32_t)s % 3;
}

static void place(const float box[4], bool exact, uint32_t i, mlp_data *d)
{
    double length = 0, local[3];
    float *o = d->ray_o[i], *dir = d->ray_d[i];
    cln_sample *s = &d->samples[i];

    for (int a = 0; a < 3; a++) {
        dir[a] = (float)test_uniform(1, (int)(3 * i) + a, -1, 1);
        length += (double)dir[a] * dir[a];
    }
    for (int a = 0; a < 3; a++)
        dir[a] = (float)(dir[a] / sqrt(length));
    dir[3] = 1;
    s->t = exact ? 0 : (float)test_uniform(2, (int)i, 0.5, 3);
    for (int a = 0; a < 3; a++) {
        local[a] = floor(test_uniform(3, (int)(3 * i) + a, 0, 1024)) / 1024;
        o[a] = (float)(box[a] + local[a] * box[3] - (double)s->t * dir[a]);
    }
    s->ray = FIRST_RAY + i;
    s->delta = 0.01f;
}

static void make_data(const mlp_case *c, const cln_config *config, const cln_tune *tune,
                      mlp_data *d)
{
    float *boxes = NULL;
    uint32_t at = 0, stride = 0;

    assert_ok(cln_model_create(config, &d->model));
    split_first(&d->model);
    split_first(&d->model);
    assert_int_equal(d->model.tree.leaf_count, 22);
    stride = (uint32_t)d->model.net.params;
    for (uint32_t i = 0; i < 22 * stride; i++)
        d->model.params[i] = (float)test_uniform(4, (int)i, -1, 1) * sqrtf(2.0f / (float)c->width);
    for (int s = 0; s < 22; s++)
        d->n += samples_of(s, tune);
    d->samples = test_alloc(d->n, sizeof *d->samples);
    d->ray_o = test_alloc(d->n, sizeof *d->ray_o);
    d->ray_d = test_alloc(d->n, sizeof *d->ray_d);
    d->dout = test_alloc(d->n, sizeof *d->dout);
    assert_ok(cln_octree_boxes(&d->model.tree, &boxes));
    for (uint32_t round = 0; at < d->n; round++) { /* leaves in turn: needs grouping */
        for (int s = 0; s < 22; s++) {
            if (round < samples_of(s, tune)) {
                d->samples[at].slot = s;
                place(boxes + 4 * s, c->exact, at++, d);
            }
        }
    }
    for (uint32_t i = 0; i < d->n; i++) {
        for (int k = 0; k < 4; k++)
            d->dout[i][k] = (float)test_uniform(5, (int)(4 * i) + k, -1, 1) * (k == 3 ? 0.01f : 1);
    }
    free(boxes);
}

static void free_data(mlp_data *d)
{
    cln_model_free(&d->model);
    free(d->samples);
    free(d->ray_o);
    free(d->ray_d);
    free(d->dout);
}

/* ---- the reference's side ---- */

/* kernels/rng.h: the hash behind the slopes, and network.h's key of a layer. */
static uint32_t hash(uint32_t x)
{
    x ^= x >> 16;
    x *= 0x21F0AAADu;
    x ^= x >> 15;
    x *= 0xD35A2D97u;
    x ^= x >> 15;
    return x;
}

/* rng.h: the density noise, one normal number per sample and step (Box-Muller on two hashes). */
static double noise_of(uint32_t step_key, uint32_t sample)
{
    const uint32_t a = hash((step_key ^ 0x27D4EB2Fu) + sample * 0x9E3779B9u);
    uint32_t b = a * 0x85EBCA6Bu + 0x165667B1u;

    b = (b ^ b >> 16) * 0x21F0AAADu;
    b ^= b >> 15;
    return sqrt(-2 * log(((a >> 8) + 1) * 0x1p-24)) * cos(2 * M_PI * (b >> 8) * 0x1p-24);
}

/* [depth][width], then [view_width] */
static void make_slopes(const mlp_case *c, const cln_network *net, uint32_t step_key,
                        uint32_t sample, double *slopes)
{
    for (int i = 0; i < net->depth * net->width + net->view_width; i++) {
        const int layer = i / net->width < net->depth ? i / net->width : net->depth;
        const uint32_t base = c->rrelu == ELEMENT ? step_key + sample * 0x85EBCA6Bu : step_key;
        const uint32_t key = base ^ ((uint32_t)layer * 0xC2B2AE35u + 0x165667B1u);
        const uint32_t bits = hash((uint32_t)(i - layer * net->width) * 0x9E3779B9u ^ key) >> 8;

        slopes[i] = (float)c->lower + (double)((float)c->upper - (float)c->lower) * bits / 0x1p24;
    }
}

static void make_reference(const mlp_case *c, const cln_config *config, const cln_network *net,
                           int level, ref_network *r)
{
    memset(r, 0, sizeof *r);
    r->net = *net;
    r->density = c->density;
    r->kappa = (float)config->density_scale;
    r->bias = (float)cln_network_density_bias(config);
    for (int k = 0; k < 10; k++)
        r->level_bands[k] = c->by_level ? fmin(fmax(11 - level - k, 0), 1) : 1;
}

typedef struct sample_input {
    double local[3], dir[3];
} sample_input;

static sample_input input_of(const mlp_data *d, uint32_t i, const float box[4])
{
    sample_input in;

    for (int a = 0; a < 3; a++) {
        in.dir[a] = d->ray_d[i][a];
        in.local[a] =
            (d->ray_o[i][a] + (double)d->samples[i].t * in.dir[a] - box[a]) * 2 / box[3] - 1;
    }
    return in;
}

/* Outputs and, in training, the summed gradients of every leaf, each sample weighted by `factors`
 * (NULL: 1). */
static void run_reference(const mlp_case *c, const cln_config *config, const mlp_data *d,
                          bool training, uint32_t step_key, const double *factors, double (*out)[4],
                          double *grads)
{
    const cln_network *net = &d->model.net;
    double slopes[8 * 256 + 256], *use = training && c->rrelu != MEAN ? slopes : NULL;
    float *boxes = NULL, *params = test_alloc((size_t)net->params, sizeof *params);

    assert_ok(cln_octree_boxes(&d->model.tree, &boxes));
    for (uint32_t i = 0; i < d->n; i++) {
        const int slot = d->samples[i].slot;
        const float *box = boxes + 4 * slot;
        const sample_input in = input_of(d, i, box);
        double dout[4];
        ref_network r;

        for (int k = 0; k < 4; k++)
            dout[k] = d->dout[i][k] * (factors ? factors[i] : 1);
        make_reference(c, config, net, d->model.tree.level[d->model.tree.leaf[slot]], &r);
        memcpy(params, d->model.params + slot * net->params, (size_t)net->params * sizeof *params);
        const double noise = training ? c->noise * noise_of(step_key, i) : 0;

        /* noise on the head's output is noise on its bias, or on all vertices */
        params[net->sigma_b] += (float)(net->encoding == CLN_ENCODING_VOXEL ? 0 : noise);
        for (int v = 3; net->encoding == CLN_ENCODING_VOXEL && v < net->params; v += net->features)
            params[v] += (float)noise;
        if (use)
            make_slopes(c, net, step_key, i, slopes);
        ref_forward(&r, params, in.local, in.dir, use, (c->lower + c->upper) / 2, out[i]);
        if (training)
            ref_backward(&r, params, in.local, in.dir, use, (c->lower + c->upper) / 2, dout,
                         grads + slot * net->params);
    }
    free(boxes);
    free(params);
}

/* ---- comparisons ---- */

static void upload_rays(cln_pipeline *p, cln_buffer *buffer, float (*rays)[4], uint32_t n)
{
    float(*all)[4] = test_alloc(FIRST_RAY + n, sizeof *all);

    memset(all, 0xFF, FIRST_RAY * sizeof *all); /* NaN */
    memcpy(all + FIRST_RAY, rays, n * sizeof *all);
    test_fill(p->device, buffer, all, (FIRST_RAY + n) * sizeof *all);
    free(all);
}

static void upload(cln_pipeline *p, const mlp_data *d, uint32_t *slices)
{
    assert_ok(cln_pipeline_upload(p, &d->model, true));
    test_fill(p->device, &p->samples, d->samples, d->n * sizeof *d->samples);
    upload_rays(p, &p->ray_o, d->ray_o, d->n);
    upload_rays(p, &p->ray_d, d->ray_d, d->n);
    test_fill(p->device, &p->dout, d->dout, d->n * sizeof *d->dout);
    assert_ok(cln_stage_group(p, d->n, slices));
    assert_ok(cln_stage_slices(p, slices));
}

/* Bounds: about ten times the worst error over all cases and sets. */
static const bounds forward_bounds = {1e-11, 2e-5}, gradient_bounds = {1e-11, 2e-4};
/* Pre-activations of 11 bits err by up to 2^-12, and so do the activations in the weight gradients'
 * products (measured: 9e-8 and 6.5e-3). Outputs are not affected: they keep their bounds. */
static const bounds half_bounds = {1e-6, 5e-2};

static void compare_outputs(const mlp_case *c, float (*got)[4], double (*want)[4], uint32_t n)
{
    float *g = test_alloc(n, 3 * sizeof *g);
    double *w = test_alloc(n, 3 * sizeof *w);
    char what[96];

    for (uint32_t i = 0; i < 3 * n; i++) {
        g[i] = got[i / 3][i % 3];
        w[i] = want[i / 3][i % 3];
    }
    snprintf(what, sizeof what, "%s, %s: colour", c->name, c->set->name);
    compare(what, g, w, 3 * n, forward_bounds);
    for (uint32_t i = 0; i < n; i++) {
        g[i] = got[i][3];
        w[i] = want[i][3];
    }
    snprintf(what, sizeof what, "%s, %s: density", c->name, c->set->name);
    compare(what, g, w, n, forward_bounds);
    free(g);
    free(w);
}

/* Sums the slices of each leaf in double, then compares block by block over all leaves. */
static void compare_gradients(const mlp_case *c, const cln_network *net, int leaves,
                              const cln_slice *slices, uint32_t slice_count, const float *got,
                              const double *want, bounds allowed)
{
    int starts[32], blocks = 0;
    double *sums = test_alloc((size_t)(leaves * net->params), sizeof *sums);

    for (uint32_t s = 0; s < slice_count; s++) {
        for (int i = 0; i < net->params; i++)
            sums[slices[s].slot * net->params + i] += got[s * (uint32_t)net->params + (uint32_t)i];
    }
    for (int i = 0; i < net->depth; i++) {
        starts[blocks++] = net->trunk_w[i];
        starts[blocks++] = net->trunk_b[i];
    }
    starts[blocks++] = net->sigma_w;
    starts[blocks++] = net->sigma_b;
    if (net->view_dependence) {
        starts[blocks++] = net->view_w;
        starts[blocks++] = net->view_b;
    }
    starts[blocks++] = net->colour_w;
    starts[blocks++] = net->colour_b;
    starts[blocks] = net->params;
    for (int b = 0; b < blocks; b++) {
        const int size = starts[b + 1] - starts[b];
        float *g = test_alloc((size_t)(leaves * size), sizeof *g);
        double *w = test_alloc((size_t)(leaves * size), sizeof *w);
        char what[96];

        for (int i = 0; i < leaves * size; i++) {
            const int at = i / size * net->params + starts[b] + i % size;

            g[i] = (float)sums[at];
            w[i] = want[at];
        }
        snprintf(what, sizeof what, "%s, %s: gradient block %d", c->name, c->set->name, b);
        compare(what, g, w, (size_t)(leaves * size), allowed);
        free(g);
        free(w);
    }
    free(sums);
}

/* Weight of every sample in the newest backward pass: its chosen head gradient over its original
 * one. */
static double *factors_of(cln_pipeline *p, const mlp_data *d, const cln_slice *slices,
                          uint32_t slice_count, uint32_t step_key)
{
    double *factors = test_alloc(d->n, sizeof *factors);
    float(*heads)[4] = test_alloc(d->n, sizeof *heads), (*all)[4] = test_alloc(d->n, sizeof *all);
    cl_uint *order = test_alloc(d->n, sizeof *order), *chosen = test_alloc(d->n, sizeof *chosen);
    cl_uint *counts = test_alloc(slice_count, sizeof *counts);
    uint32_t went = 0;

    assert_ok(cln_buffer_read(p->device, &p->heads, 0, heads, d->n * sizeof *heads));
    assert_ok(cln_buffer_read(p->device, &p->chosen, 0, chosen, d->n * sizeof *chosen));
    assert_ok(
        cln_buffer_read(p->device, &p->chosen_counts, 0, counts, slice_count * sizeof *counts));
    assert_ok(cln_buffer_read(p->device, &p->values[0], 0, order, d->n * sizeof *order));
    assert_ok(cln_stage_roulette(p, d->n, slice_count, 0, 0, step_key));
    assert_ok(cln_buffer_read(p->device, &p->heads, 0, all, d->n * sizeof *all));
    for (uint32_t s = 0; s < slice_count; s++)
        for (uint32_t i = slices[s].start; i < slices[s].start + counts[s]; i++) {
            const uint32_t at = slices[s].start + chosen[i];

            factors[order[at]] = (double)heads[i][0] / (double)all[at][0];
            went++;
        }
    assert_true(went < 0.9 * d->n && went > 0.1 * d->n);
    free(heads);
    free(all);
    free(order);
    free(chosen);
    free(counts);
    return factors;
}

/* Gradients of vertices that no sample met, and of padding, are not written: they are 0. */
static void zero_unmet(cln_pipeline *p, float *grads, uint32_t slices)
{
    const int side = p->net.cells + 1;
    uint32_t *met = NULL;

    if (p->net.encoding != CLN_ENCODING_VOXEL)
        return;
    met = test_alloc((size_t)slices * (size_t)(side * side), sizeof *met);
    assert_ok(cln_buffer_read(p->device, &p->met, 0, met,
                              (size_t)slices * (size_t)(side * side) * sizeof *met));
    for (uint32_t s = 0; s < slices; s++) {
        float *row = grads + (size_t)s * (size_t)p->net.params;
        const int numbers = side * side * side * p->net.features;

        memset(row + numbers, 0, (size_t)(p->net.params - numbers) * sizeof *row);
        for (int v = 0; v < side * side * side; v++)
            if (!(met[s * (uint32_t)(side * side) + (uint32_t)(v / side)] >> v % side & 1))
                memset(row + v * p->net.features, 0, (size_t)p->net.features * sizeof *row);
    }
    free(met);
}

/* A backward pass of a subset of samples: the gradient is the subset's. */
static void check_some(const mlp_case *c, cln_pipeline *p, const mlp_data *d,
                       const cln_slice *slices, uint32_t slice_count, uint32_t step_key)
{
    const size_t floats = slice_count * (size_t)p->net.params, leaves = 22;
    double(*out)[4] = test_alloc(d->n, sizeof *out), *factors = NULL;
    double *want = test_alloc(leaves * (size_t)p->net.params, sizeof *want);
    float *got = NULL;

    p->config.roulette = 1.5;
    test_fill(p->device, &p->grads, NULL, floats * sizeof *got);
    assert_ok(cln_stage_backward(p, d->n, slice_count, step_key));
    p->config.roulette = 0;
    got = test_read(p->device, &p->grads, floats * sizeof *got, "grads");
    zero_unmet(p, got, slice_count);
    factors = factors_of(p, d, slices, slice_count, step_key);
    run_reference(c, &p->config, d, true, step_key, factors, out, want);
    compare_gradients(c, &p->net, (int)leaves, slices, slice_count, got, want,
                      p->tune.half ? half_bounds : gradient_bounds);
    free(out);
    free(factors);
    free(want);
    free(got);
}

static void check_case(const mlp_case *c)
{
    const cln_config config = config_of(c);
    cln_pipeline *p = test_pipeline(c->set, &config, false, false);
    const uint32_t step_key = 0x12345u;
    mlp_data d = {0};
    uint32_t slices = 0;
    float(*out)[4] = NULL, *grads = NULL, *again = NULL;
    double(*want)[4] = NULL, *want_grads = NULL;
    size_t grad_bytes = 0;
    cln_slice *slice = NULL;

    make_data(c, &config, &p->tune, &d);
    want = test_alloc(d.n, sizeof *want);
    want_grads = test_alloc(22 * (size_t)p->net.params, sizeof *want_grads);
    upload(p, &d, &slices);
    slice = test_alloc(slices, sizeof *slice);
    assert_ok(cln_buffer_read(p->device, &p->slices, 0, slice, slices * sizeof *slice));

    run_reference(c, &config, &d, false, 0, NULL, want, NULL);
    test_fill(p->device, &p->out, NULL, d.n * sizeof *out);
    assert_ok(cln_stage_forward(p, d.n, slices, false, step_key));
    out = test_read(p->device, &p->out, d.n * sizeof *out, "out");
    compare_outputs(c, out, want, d.n);
    free(out);

    run_reference(c, &config, &d, true, step_key, NULL, want, want_grads);
    grad_bytes = slices * (size_t)p->net.params * sizeof *grads;
    for (int pass = 0; pass < 2; pass++) {
        const size_t acts = cln_pipeline_act_bytes(&p->net, &p->tune);

        test_fill(p->device, &p->out, NULL, d.n * sizeof *out);
        test_fill(p->device, &p->acts, NULL, d.n * acts);
        test_fill(p->device, &p->grads, NULL, grad_bytes);
        assert_ok(cln_stage_forward(p, d.n, slices, true, step_key));
        assert_ok(cln_stage_backward(p, d.n, slices, step_key));
        free(test_read(p->device, &p->acts, d.n * acts, "acts"));
        out = test_read(p->device, &p->out, d.n * sizeof *out, "out");
        again = test_read(p->device, &p->grads, grad_bytes, "grads");
        zero_unmet(p, again, slices);
        if (pass == 0) {
            compare_outputs(c, out, want, d.n);
            compare_gradients(c, &p->net, 22, slice, slices, again, want_grads,
                              p->tune.half ? half_bounds : gradient_bounds);
            grads = again;
            again = NULL;
        }
        free(out);
    }
    if (memcmp(grads, again, grad_bytes) != 0)
        fail_msg("%s, %s: a second launch gave other gradients", c->name, c->set->name);
    check_some(c, p, &d, slice, slices, step_key);
    free(grads);
    free(again);
    free(want);
    free(want_grads);
    free(slice);
    free_data(&d);
}

/* A small case of each encoding, which the sanitized tests run, too. */
static bool is_small(const mlp_case *c)
{
    return strcmp(c->name, "small, default") == 0 || strcmp(c->name, "grid, default") == 0 ||
           strcmp(c->name, "voxel, default") == 0;
}

static int check_cases(bool small)
{
    int checked = 0;

    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        if (is_small(&cases[i]) == small) {
            check_case(&cases[i]);
            checked++;
        }
    return checked;
}

static void test_small_networks(void **state)
{
    (void)state;
    assert_int_equal(check_cases(true), 3);
    test_report("small networks");
}

static void test_networks(void **state)
{
    (void)state;
    check_cases(false);
    test_report("networks");
}

/* No samples at all: no slices, nothing written. */
static void test_no_samples(void **state)
{
    const cln_config config = config_of(&cases[0]);
    cln_pipeline *p = test_pipeline(cases[0].set, &config, false, false);
    cln_model model;
    uint32_t slices = 7;

    (void)state;
    assert_ok(cln_model_create(&config, &model));
    assert_ok(cln_pipeline_upload(p, &model, true));
    test_fill(p->device, &p->samples, NULL, 0);
    test_fill(p->device, &p->out, NULL, 0);
    test_fill(p->device, &p->grads, NULL, 0);
    assert_ok(cln_stage_group(p, 0, &slices));
    assert_int_equal(slices, 0);
    assert_ok(cln_stage_forward(p, 0, 0, true, 1));
    assert_ok(cln_stage_backward(p, 0, 0, 1));
    free(test_read(p->device, &p->out, 0, "out"));
    free(test_read(p->device, &p->grads, 0, "grads"));
    cln_model_free(&model);
}

/* Cached densities: at the cell's centre, or at a random point in it; accepts a neighbouring
 * bfloat16 only where float32's rounding may have decided. */
static void check_densities(const mlp_case *c, int n1, bool jitter)
{
    cln_config config = config_of(c);
    const int cells = n1 * n1 * n1;
    cln_pipeline *p = NULL;
    mlp_data d = {0};
    uint16_t *got = NULL;

    config.n1 = n1;
    p = test_pipeline(c->set, &config, false, false);
    make_data(c, &config, &p->tune, &d);
    assert_ok(cln_pipeline_upload(p, &d.model, false));
    test_fill(p->device, &p->density, NULL, (size_t)(22 * cells) * sizeof *got);
    assert_ok(cln_stage_refresh(p, 0, p->leaves, jitter, 99, 7));
    got = test_read(p->device, &p->density, (size_t)(22 * cells) * sizeof *got, "densities");
    for (int s = 0; s < 22; s++) {
        ref_network r;

        make_reference(c, &config, &p->net, d.model.tree.level[d.model.tree.leaf[s]], &r);
        for (int i = 0; i < cells; i++) {
            static const double dir[3] = {1, 0, 0};
            const int cell[3] = {i % n1, i / n1 % n1, i / n1 / n1};
            float xi[4] = {0.5f, 0.5f, 0.5f, 0};
            double local[3], out[4], have = ref_from_bf16(got[s * cells + i]);

            if (jitter)
                cln_uniform4(99, CLN_STREAM_GRID, 7, (uint32_t)(s * cells + i), 0, xi);
            for (int a = 0; a < 3; a++)
                local[a] = 2 * (cell[a] + (double)xi[a]) / n1 - 1;
            ref_forward(&r, d.model.params + s * p->net.params, local, dir, NULL,
                        (c->lower + c->upper) / 2, out);
            if (have != ref_from_bf16(ref_to_bf16((float)(out[3] * (1 - 1e-4)))) &&
                have != ref_from_bf16(ref_to_bf16((float)(out[3] * (1 + 1e-4)))))
                fail_msg("%s, n1 %d: leaf %d, cell %d has %g, the reference %g", c->name, n1, s, i,
                         have, out[3]);
        }
    }
    free(got);
    free_data(&d);
}

/* The field at points, in batches of at most 37: equals the reference's network inside leaves, zero
 * in a culled leaf and outside the cube. */
static void test_points(void **state)
{
    enum { POINTS = 100 };
    const mlp_case *c = &cases[0];
    const cln_config config = config_of(c);
    cln_pipeline *p = test_pipeline(c->set, &config, false, false);
    float at[POINTS][4] = {{0}}, along[POINTS][4] = {{0}}, got[POINTS][4], *boxes = NULL;
    uint8_t culled[64] = {[3] = 1};
    cln_octree_change change = {0};
    mlp_data d = {0};
    const double bound = 1e-5; /* relative */
    double worst = 0;
    int inside = 0;

    (void)state;
    make_data(c, &config, &p->tune, &d);
    assert_ok(cln_octree_cull(&d.model.tree, culled, &change));
    assert_ok(cln_model_apply(&d.model, &change));
    cln_octree_change_free(&change);
    assert_ok(cln_pipeline_upload(p, &d.model, false));
    assert_ok(cln_octree_boxes(&d.model.tree, &boxes));
    for (int i = 0; i < POINTS; i++) {
        for (int a = 0; a < 3; a++)
            at[i][a] = (float)test_uniform(41, 3 * i + a, -1.2, 1.2);
        along[i][i % 3] = i % 2 ? 1 : -1;
    }
    memset(got, 0xFF, sizeof got);
    p->max_samples = 37;
    assert_ok(cln_field_points(p, &d.model.tree, POINTS, (const float(*)[4])at,
                               (const float(*)[4])along, got));
    p->max_samples = 0;
    for (int i = 0; i < POINTS; i++) {
        const int slot =
            cln_octree_find(&d.model.tree, (const double[]){at[i][0], at[i][1], at[i][2]});
        double local[3], dir[3], want[4] = {0};
        ref_network r;

        for (int a = 0; a < 3 && slot >= 0; a++) {
            dir[a] = along[i][a];
            local[a] = ((double)at[i][a] - boxes[4 * slot + a]) * 2 / boxes[4 * slot + 3] - 1;
        }
        if (slot >= 0) {
            inside++;
            make_reference(c, &config, &p->net, d.model.tree.level[d.model.tree.leaf[slot]], &r);
            ref_forward(&r, d.model.params + slot * p->net.params, local, dir, NULL,
                        (c->lower + c->upper) / 2, want);
        }
        for (int k = 0; k < 4; k++) {
            const double error = fabs(got[i][k] - want[k]) / (want[k] != 0 ? fabs(want[k]) : 1);

            if (!(error <= bound))
                fail_msg("point %d, value %d: %g, the reference %g", i, k, got[i][k], want[k]);
            worst = fmax(worst, error);
        }
    }
    print_message("points                   at most %5.1f %% of a bound\n", 100 * worst / bound);
    assert_true(inside > 30 && inside < 80);
    free(boxes);
    free_data(&d);
}

static void test_densities(void **state)
{
    (void)state;
    check_densities(&cases[0], 4, false);
    check_densities(&cases[1], 5, true);
    check_densities(&cases[3], 9, true); /* 729 cells: more than one work-group of 512 per leaf */
    check_densities(&cases[6], 2, false);
}

/* ---- backward and Adam in one pass ---- */

typedef struct trained {
    float *params; /* [leaf][params] */
    void *m, *v;   /* [leaf][params] moments */
    size_t moment_bytes;
    cl_int *steps;
} trained;

/* Two steps in a row from the same model. */
static void train(cln_pipeline *p, const mlp_data *d, bool at_once, trained *out)
{
    const size_t n = 22 * (size_t)p->net.params;
    uint32_t slices = 0;
    const uint32_t least = (uint32_t)p->config.min_leaf_samples;
    double places = 0;

    upload(p, d, &slices);
    places = at_once ? cln_pipeline_gradients(&p->tune, d->n, slices) : slices;
    if (p->parts == 1)
        test_fill(p->device, &p->grads, NULL,
                  (size_t)places * (size_t)p->net.params * sizeof(float));
    for (uint32_t key = 1; key <= 2; key++) {
        assert_ok(cln_stage_forward(p, d->n, slices, true, key));
        if (at_once) {
            assert_ok(cln_stage_update(p, d->n, slices, least, key, 1e-3));
            continue;
        }
        assert_ok(cln_stage_backward(p, d->n, slices, key));
        assert_ok(cln_stage_adam(p, least, 1e-3));
    }
    if (p->parts == 1)
        free(test_read(p->device, &p->grads, (size_t)places * (size_t)p->net.params * sizeof(float),
                       "gradients"));
    out->params = test_alloc(n, sizeof(float));
    out->moment_bytes = n * cln_moment_bytes(&p->config);
    out->m = test_alloc(out->moment_bytes, 1);
    out->v = test_alloc(out->moment_bytes, 1);
    out->steps = test_alloc(22, sizeof(cl_int));
    assert_ok(cln_buffer_read(p->device, &p->params, 0, out->params, n * sizeof(float)));
    assert_ok(cln_buffer_read(p->device, &p->adam_m, 0, out->m, out->moment_bytes));
    assert_ok(cln_buffer_read(p->device, &p->adam_v, 0, out->v, out->moment_bytes));
    assert_ok(cln_buffer_read(p->device, &p->adam_steps, 0, out->steps, 22 * sizeof(cl_int)));
}

static void free_trained(trained *t)
{
    free(t->params);
    free(t->m);
    free(t->v);
    free(t->steps);
}

/* The same bytes as backward and then Adam, for leaves with too few samples, of one slice and of
 * several. Other tests compare these two with float64 (Adam: test_adam.c). */
static void check_update(const tune_set *set, int leaf, int moments, const mlp_case *like)
{
    mlp_case c = *like;
    cln_config config;
    cln_pipeline *p = NULL;
    mlp_data d = {0};
    trained apart, at_once;
    size_t bytes = 0, several = 0, idle = 0;

    c.set = set;
    config = config_of(&c);
    config.min_leaf_samples = 2;
    config.moments = moments;
    config.view_l2 = c.view ? 0.05 : 0;
    p = test_pipeline(set, &config, false, false);
    assert_int_equal(p->tune.leaf, leaf);
    make_data(&c, &config, &p->tune, &d);
    bytes = 22 * (size_t)p->net.params * sizeof(float);
    train(p, &d, false, &apart);
    train(p, &d, true, &at_once);
    assert_memory_equal(at_once.steps, apart.steps, 22 * sizeof(cl_int));
    if (memcmp(at_once.params, apart.params, bytes) != 0 ||
        memcmp(at_once.m, apart.m, apart.moment_bytes) != 0 ||
        memcmp(at_once.v, apart.v, apart.moment_bytes) != 0)
        fail_msg("%s, %s: the update in one pass differs", c.name, set->name);
    for (int s = 0; s < 22; s++) {
        several += samples_of(s, &p->tune) > (uint32_t)p->tune.sl;
        idle += at_once.steps[s] == 0;
        assert_int_equal(at_once.steps[s], samples_of(s, &p->tune) < 2 ? 0 : 2);
    }
    assert_true(idle > 1 && idle < 20 && (several > 0 || p->tune.sl > 150));
    free_trained(&apart);
    free_trained(&at_once);
    free_data(&d);
}

static void test_updates_at_once(void **state)
{
    static const int leaf[TUNE_SETS] = {1, 0, 1, 1, 0};

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        check_update(&tune_sets[set], leaf[set],
                     set == 2 ? CLN_MOMENTS_FLOAT32 : CLN_MOMENTS_BFLOAT16, &cases[0]);
    /* no view layer, the encoding read twice */
    check_update(&tune_sets[3], leaf[3], CLN_MOMENTS_FLOAT32, &cases[6]);
}

/* ---- arrays in parts ---- */

/* All results of the networks' kernels: two steps with gradients in memory and two without,
 * outputs, densities and their statistics. */
static void run_all(cln_pipeline *p, const mlp_data *d, trained *apart, trained *at_once,
                    float **out, uint16_t **density, float **stats)
{
    const size_t cells = (size_t)(p->config.n1 * p->config.n1 * p->config.n1);
    uint8_t *seen = test_alloc(22 * cells, 1);
    uint32_t slices = 0;

    train(p, d, false, apart);
    train(p, d, true, at_once);
    assert_ok(cln_stage_slices(p, &slices));
    *out = test_alloc(d->n, 4 * sizeof **out);
    assert_ok(cln_stage_forward(p, d->n, slices, false, 0));
    assert_ok(cln_buffer_read(p->device, &p->out, 0, *out, d->n * 4 * sizeof **out));
    *density = test_alloc(22 * cells, sizeof **density);
    assert_ok(cln_stage_refresh(p, 0, 22, true, 99, 7));
    assert_ok(cln_buffer_read(p->device, &p->density, 0, *density, 22 * cells * sizeof **density));
    for (size_t i = 0; i < 22 * cells; i++)
        seen[i] = test_uniform(9, (int)i, 0, 1) < 0.5;
    *stats = test_alloc(22, 2 * sizeof **stats);
    assert_ok(CLN_RESERVE(p, seen, (size_t)p->leaves));
    assert_ok(cln_buffer_write(p->device, &p->seen, 0, seen, 22 * cells));
    assert_ok(cln_stage_stats(p, *stats));
    free(seen);
}

static void check_same(const trained *a, const trained *b, size_t n)
{
    assert_memory_equal(a->params, b->params, n * sizeof(float));
    assert_int_equal(a->moment_bytes, b->moment_bytes);
    assert_memory_equal(a->m, b->m, a->moment_bytes);
    assert_memory_equal(a->v, b->v, a->moment_bytes);
    assert_memory_equal(a->steps, b->steps, 22 * sizeof(cl_int));
}

/* 22 leaves in four parts of six: the same bytes as in one buffer. */
static void check_split(const tune_set *set)
{
    cln_config config = config_of(&cases[0]);
    trained apart[2], at_once[2];
    float *out[2], *stats[2];
    uint16_t *density[2];
    mlp_data d = {0};
    cln_pipeline *p = NULL;
    size_t most = 0, n = 0;

    config.n1 = 20; /* densities larger than weights; a separate pipeline */
    config.min_leaf_samples = 2;
    p = test_pipeline(set, &config, false, false);
    make_data(&cases[0], &config, &p->tune, &d);
    n = 22 * (size_t)p->net.params;
    most = p->device->max_alloc;
    for (int split = 0; split < 2; split++) {
        if (split) {
            p->device->max_alloc = 7 * 2 * 8000 - 1;
            assert_int_equal(cln_pipeline_rebuild(p, 25), CLN_MEMORY);
            cln_clear_error();
            assert_int_equal(p->parts, 1);
            assert_int_equal(cln_pipeline_upload(p, &d.model, true), CLN_INTERNAL);
            cln_clear_error();
            assert_ok(cln_pipeline_rebuild(p, 22));
            p->device->max_alloc = most;
        }
        assert_int_equal(p->parts, split ? CLN_PARTS : 1);
        run_all(p, &d, &apart[split], &at_once[split], &out[split], &density[split], &stats[split]);
    }
    assert_int_equal(p->part_leaves, 6);
    assert_int_equal(p->params.part_bytes, 6 * (size_t)p->net.params * sizeof(float));
    assert_int_equal(p->density.part_bytes, 6 * 2 * 8000);
    assert_int_equal(p->adam_v.part_bytes,
                     6 * (size_t)p->net.params * cln_moment_bytes(&p->config));
    assert_true(p->grads.part_bytes > 0);
    check_same(&apart[1], &apart[0], n);
    check_same(&at_once[1], &at_once[0], n);
    assert_memory_equal(out[1], out[0], d.n * 4 * sizeof **out);
    assert_memory_equal(density[1], density[0], 22 * 8000 * sizeof **density);
    assert_memory_equal(stats[1], stats[0], 22 * 2 * sizeof **stats);
    for (int s = 0; s < 22; s++) /* no part is empty */
        assert_true(stats[0][2 * s + 1] > 0);
    for (int split = 0; split < 2; split++) {
        free_trained(&apart[split]);
        free_trained(&at_once[split]);
        free(out[split]);
        free(density[split]);
        free(stats[split]);
    }
    free_data(&d);
}

static void test_in_parts(void **state)
{
    (void)state;
    check_split(&tune_sets[0]);
    check_split(&tune_sets[4]); /* gradients and transposed weights in parts, too */
}

int test_group_mlp(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_small_networks), cmocka_unit_test(test_networks),
        cmocka_unit_test(test_no_samples),     cmocka_unit_test(test_updates_at_once),
        cmocka_unit_test(test_densities),      cmocka_unit_test(test_in_parts),
        cmocka_unit_test(test_points),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(group) | CLN_PROGRAM_BIT(mlp_density) |
                  CLN_PROGRAM_BIT(mlp_forward_eval) | CLN_PROGRAM_BIT(mlp_forward_train) |
                  CLN_PROGRAM_BIT(mlp_backward) | CLN_PROGRAM_BIT(voxel_eval) |
                  CLN_PROGRAM_BIT(voxel_train) | CLN_PROGRAM_BIT(roulette) | CLN_PROGRAM_BIT(adam) |
                  CLN_PROGRAM_BIT(regularise) | CLN_PROGRAM_BIT(stats) | CLN_PROGRAM_BIT(carry);
    return cmocka_run_group_tests_name("mlp", tests, NULL, test_device_close);
}
