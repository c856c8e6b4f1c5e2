/* Leaf networks and Adam at extremes: weights of all sizes, saturated colours, dead layers,
 * gradients and learning rates. Each leaf is an extreme of its own, and errors are relative to its
 * own numbers, so that a leaf of large numbers hides no other. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "check/selftest_checks.h"

/* ---- a leaf per extreme ---- */

typedef enum kind { SCALED, BRIGHT, DARK, DEAD, EMPTY } kind;

static const struct {
    const char *name;
    kind kind;
    double scale; /* of weights, times sqrt(2 / width) */
} leaves[] = {
    {"weights x 1e-6", SCALED, 1e-6}, {"weights x 1", SCALED, 1},      {"weights x 4", SCALED, 4},
    {"weights x 1e6", SCALED, 1e6},   {"saturated bright", BRIGHT, 1}, {"saturated dark", DARK, 1},
    {"dead layers", DEAD, 1},         {"weights of 0", EMPTY, 0},
};
enum { ORDINARY = 1, LEAVES = sizeof leaves / sizeof *leaves, EACH = 24, SAMPLES = LEAVES * EACH };

typedef struct data {
    cln_model model;
    cln_sample samples[SAMPLES];
    float ray_o[SAMPLES][4], ray_d[SAMPLES][4], dout[SAMPLES][4], out[SAMPLES][4];
    double want[SAMPLES][4];
    uint32_t slices;
    cln_slice *slice;
    float *grads, (*boxes)[4];
    double *got_grads, *want_grads; /* [leaf][params] */
} data;

static void free_data(data *d)
{
    if (!d)
        return;
    cln_model_free(&d->model);
    free(d->slice);
    free(d->grads);
    free(d->boxes);
    free(d->got_grads);
    free(d->want_grads);
    free(d);
}

/* Saturates, at every vertex, the constant part of the colours, or the density at 0. */
static void fill_voxels(const cln_network *net, int s, float *params)
{
    for (int i = 0; i < net->params; i++) {
        const int f = i % net->features;

        if (leaves[s].kind == BRIGHT && f < 3)
            params[i] = 30 + 30 * (float)f;
        if (leaves[s].kind == DARK && f < 3)
            params[i] = -20 - 20 * (float)f;
        if (leaves[s].kind == DEAD && f == 3)
            params[i] = -1e3f;
    }
}

static void fill_leaf(const cln_network *net, int s, float *params)
{
    const double size = leaves[s].scale * sqrt(2.0 / net->width);

    for (int i = 0; i < net->params; i++)
        params[i] = (float)(size * cln_check_uniform(91, (uint32_t)(s * net->params + i), -1, 1));
    if (net->encoding == CLN_ENCODING_VOXEL) {
        fill_voxels(net, s, params);
        return;
    }
    for (int k = 0; k < 3; k++) {
        if (leaves[s].kind == BRIGHT)
            params[net->colour_b + k] = 30 + 30 * (float)k;
        if (leaves[s].kind == DARK)
            params[net->colour_b + k] = -20 - 20 * (float)k;
    }
    for (int i = 0; i < net->width && leaves[s].kind == DEAD; i++) /* below 0 for every input */
        params[net->trunk_b[net->depth - 1] + i] = -1e3f;
}

/* Samples at exact places of a grid of 1/1024 of a leaf; see selftest_networks.c. */
static cln_status make_data(cln_checks *c, double factor, data **out)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int params = p->net.params;
    data *d = NULL;

    CLN_TRY(cln_alloc(&d, 1, sizeof *d, "self-test"));
    CLN_TRY(cln_model_create(&p->config, &d->model));
    CLN_ASSERT(d->model.tree.leaf_count == LEAVES);
    for (int s = 0; s < LEAVES; s++)
        fill_leaf(&p->net, factor > 1 ? ORDINARY : s, d->model.params + s * params);
    for (int i = 0; i < LEAVES * params && factor > 1; i++)
        d->model.params[i] = (float)(factor * (double)d->model.params[i]);
    for (int i = 0; i < p->net.decoder_params; i++)
        d->model.decoder[i] = (float)(factor * cln_check_uniform(96, (uint32_t)i, -0.25, 0.25));
    CLN_TRY(cln_octree_boxes(&d->model.tree, (float **)&d->boxes));
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const uint32_t s = i % LEAVES;
        cln_check_random_ray(d->boxes[s], 92, i, d->ray_o[i], d->ray_d[i]);
        for (uint32_t a = 0; a < 3; a++)
            d->dout[i][a] = (float)cln_check_uniform(94, 3 * i + a, -1, 1);
        d->dout[i][3] = (float)cln_check_uniform(95, i, -0.01, 0.01);
        d->samples[i] = (cln_sample){.delta = 0.01f, .ray = i, .slot = (int)s};
    }
    CLN_TRY(cln_alloc(&d->got_grads, (size_t)(LEAVES * params), sizeof *d->got_grads, "self-test"));
    CLN_TRY(
        cln_alloc(&d->want_grads, (size_t)(LEAVES * params), sizeof *d->want_grads, "self-test"));
    *out = d;
    return CLN_OK;
done:
    free_data(d);
    return st;
}

/* Forward and backward; gradients of a leaf's slices are added up. */
static cln_status launch(cln_pipeline *p, data *d)
{
    cln_status st = CLN_OK;
    const size_t params = (size_t)p->net.params;
    size_t floats = 0;

    CLN_TRY(cln_pipeline_upload(p, &d->model, true));
    CLN_TRY(cln_check_put(p->device, &p->samples, d->samples, sizeof d->samples));
    CLN_TRY(cln_check_put(p->device, &p->ray_o, d->ray_o, sizeof d->ray_o));
    CLN_TRY(cln_check_put(p->device, &p->ray_d, d->ray_d, sizeof d->ray_d));
    CLN_TRY(cln_check_put(p->device, &p->dout, d->dout, sizeof d->dout));
    CLN_TRY(cln_stage_group(p, SAMPLES, &d->slices));
    CLN_TRY(cln_stage_slices(p, &d->slices));
    floats = d->slices * params;
    free(d->slice); /* of the launch before */
    free(d->grads);
    d->slice = NULL;
    d->grads = NULL;
    CLN_TRY(cln_alloc(&d->slice, d->slices, sizeof *d->slice, "self-test"));
    CLN_TRY(cln_alloc(&d->grads, floats, sizeof *d->grads, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->slices, 0, d->slice, d->slices * sizeof *d->slice));
    CLN_TRY(cln_check_spoil(p->device, &p->out, sizeof d->out));
    CLN_TRY(cln_check_spoil(p->device, &p->grads, floats * sizeof *d->grads));
    if (p->net.encoding == CLN_ENCODING_VOXEL) /* only vertices near samples are written */
        CLN_TRY(cln_buffer_zero(p->device, &p->grads, floats * sizeof *d->grads));
    CLN_TRY(cln_stage_forward(p, SAMPLES, d->slices, true, 7));
    CLN_TRY(cln_stage_backward(p, SAMPLES, d->slices, 7));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, d->out, sizeof d->out));
    CLN_TRY(cln_buffer_read(p->device, &p->grads, 0, d->grads, floats * sizeof *d->grads));
    for (uint32_t s = 0; s < d->slices; s++)
        for (size_t i = 0; i < params && d->slice[s].slot >= 0 && d->slice[s].slot < LEAVES; i++)
            d->got_grads[(size_t)d->slice[s].slot * params + i] += d->grads[s * params + i];
done:
    return st;
}

static void run_reference(const cln_checks *c, data *d)
{
    const int params = c->p->net.params;
    const double slope = 0.5 * (c->p->config.rrelu_lower + c->p->config.rrelu_upper);

    for (uint32_t i = 0; i < SAMPLES; i++) {
        const int slot = d->samples[i].slot;
        const ref_network r = cln_check_network(&c->p->config, &d->model, slot);
        const float *weights = d->model.params + slot * params;
        double local[3], dir[3], dout[4];

        for (int a = 0; a < 3; a++) {
            local[a] = 2 * ((double)d->ray_o[i][a] - d->boxes[slot][a]) / d->boxes[slot][3] - 1;
            dir[a] = d->ray_d[i][a];
        }
        for (int k = 0; k < 4; k++)
            dout[k] = d->dout[i][k];
        ref_forward(&r, weights, local, dir, NULL, slope, d->want[i]);
        ref_backward(&r, weights, local, dir, NULL, slope, dout, d->want_grads + slot * params);
    }
}

/* Starts of the blocks of parameters, as gradients differ in size between blocks. Returns their
 * number. */
static int blocks_of(const cln_network *net, int starts[32])
{
    int n = 0;

    for (int i = 0; i < net->depth; i++) {
        starts[n++] = net->trunk_w[i];
        starts[n++] = net->trunk_b[i];
    }
    starts[n++] = net->sigma_w;
    starts[n++] = net->sigma_b;
    if (net->view_dependence) {
        starts[n++] = net->view_w;
        starts[n++] = net->view_b;
    }
    starts[n++] = net->colour_w;
    starts[n++] = net->colour_b;
    if (net->encoding == CLN_ENCODING_GRID)
        starts[n++] = net->grid_w;
    starts[n] = net->params;
    return n;
}

/* The block of a parameter; for voxels, its place among the numbers of its vertex. */
static int block_of(const cln_network *net, const int starts[32], int blocks, int parameter)
{
    int b = blocks - 1;

    if (net->encoding == CLN_ENCODING_VOXEL)
        return parameter % net->features;
    while (b > 0 && starts[b] > parameter)
        b--;
    return b;
}

/* Whether pre-activations stay in the range of 16 bits, 6e-5 to 65,504, where they keep 11 bits. */
static bool fits_half(int s)
{
    return leaves[s].scale == 0 || (leaves[s].scale >= 1 && leaves[s].scale <= 4);
}

/* A gradient's scale is the largest of its leaf's block; of bright colours at least 1e-3 of the
 * leaf's largest, as c saturates at 1 and float32 has 1 - c = 0 there. half: pre-activations are
 * kept in 16 bits. */
static void compare_gradients(const cln_network *net, bool half, const data *d, cln_extreme *row)
{
    const double bound = half ? 2e-3 : 1e-4;
    int starts[32];
    double most[32];
    const int blocks = blocks_of(net, starts);

    for (int s = 0; s < LEAVES; s++) {
        const double *got = d->got_grads + s * net->params, *want = d->want_grads + s * net->params;
        double all = 0;

        for (int i = 0; i < net->params; i++)
            all = fmax(all, fabs(want[i]));
        for (int b = 0; b < 32; b++)
            most[b] = leaves[s].kind == BRIGHT ? all * 1e-3 : 0;
        for (int i = 0; i < net->params; i++) {
            const int b = block_of(net, starts, blocks, i);

            most[b] = fmax(most[b], fabs(want[i]));
        }
        for (int i = 0; i < net->params; i++) {
            const int b = block_of(net, starts, blocks, i);

            if (half && !fits_half(s))
                cln_extreme_finite(row, got[i], "%s, parameter %d", leaves[s].name, i);
            else
                cln_extreme_meet(row, got[i], want[i], most[b], bound, "%s, block %d, parameter %d",
                                 leaves[s].name, b, i);
        }
    }
}

/* Compares the decoder's gradient from the samples of leaf s alone, as all leaves share it; `dout`:
 * of all samples. Scales are as of compare_gradients. */
static cln_status check_decoder_of(cln_checks *c, data *d, int s, const float (*dout)[4],
                                   cln_extreme *row)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_network *net = &p->net;
    const int n = net->decoder_params, width = net->decoder, biases = n - 4 * width;
    double *want = NULL, *got = NULL, *unused = NULL, most[3] = {0};
    float *parts = NULL;

    CLN_TRY(cln_alloc(&want, (size_t)n, sizeof *want, "self-test"));
    CLN_TRY(cln_alloc(&got, (size_t)n, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&unused, (size_t)net->params, sizeof *unused, "self-test"));
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const bool mine = d->samples[i].slot == s;
        ref_network r = cln_check_network(&p->config, &d->model, s);
        double local[3], dir[3], wide[4];

        for (int k = 0; k < 4; k++)
            wide[k] = d->dout[i][k] = mine ? dout[i][k] : 0;
        for (int a = 0; a < 3; a++) {
            local[a] = 2 * ((double)d->ray_o[i][a] - d->boxes[s][a]) / d->boxes[s][3] - 1;
            dir[a] = d->ray_d[i][a];
        }
        r.decoder_grad = want;
        if (mine)
            ref_backward(&r, d->model.params + s * net->params, local, dir, NULL, 0, wide, unused);
    }
    CLN_TRY(launch(p, d));
    CLN_TRY(cln_alloc(&parts, (size_t)(n * p->decoder_groups), sizeof *parts, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->decoder_grads, 0, parts,
                            (size_t)(n * p->decoder_groups) * sizeof *parts));
    for (int i = 0; i < n * p->decoder_groups; i++)
        got[i % n] += parts[i];
    for (int i = 0; i < n; i++) {
        const int block = (i >= biases) + (i >= biases + width);

        most[block] = fmax(most[block], fabs(want[i]));
    }
    for (int i = 0; i < n; i++) {
        const int block = (i >= biases) + (i >= biases + width);

        cln_extreme_meet(row, got[i], want[i], most[block], 1e-4, "%s, parameter %d",
                         leaves[s].name, i);
    }
done:
    free(want);
    free(got);
    free(unused);
    free(parts);
    return st;
}

static cln_status check_decoder(cln_checks *c, data *d, const char *range)
{
    cln_status st = CLN_OK;
    cln_extreme row = cln_extreme_row(c, "gradients of the decoder", range);
    float dout[SAMPLES][4];

    memcpy(dout, d->dout, sizeof dout);
    for (int s = 0; s < LEAVES; s++)
        CLN_TRY(check_decoder_of(c, d, s, (const float(*)[4])dout, &row));
    cln_extreme_report(&row);
done:
    return st;
}

static cln_status check_densities(cln_checks *c, const data *d, cln_extreme *row)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int n1 = p->config.n1, cells = n1 * n1 * n1, all = LEAVES * cells;
    const double slope = 0.5 * (p->config.rrelu_lower + p->config.rrelu_upper);
    const double along[3] = {0, 0, 1};
    uint16_t *density = NULL;

    CLN_TRY(cln_alloc(&density, (size_t)all, sizeof *density, "self-test"));
    CLN_TRY(cln_check_spoil(p->device, &p->density, (size_t)all * sizeof *density));
    CLN_TRY(cln_stage_refresh(p, 0, LEAVES, false, 0, 0));
    CLN_TRY(cln_buffer_read(p->device, &p->density, 0, density, (size_t)all * sizeof *density));
    for (int i = 0; i < all; i++) {
        const int s = i / cells, cell = i % cells;
        const int at[3] = {cell % n1, cell / n1 % n1, cell / (n1 * n1)};
        const ref_network r = cln_check_network(&p->config, &d->model, s);
        double local[3], out[4];

        for (int a = 0; a < 3; a++)
            local[a] = 2 * (at[a] + 0.5) / n1 - 1;
        ref_forward(&r, d->model.params + s * p->net.params, local, along, NULL, slope, out);
        cln_extreme_meet(row, ref_from_bf16(density[i]), out[3], out[3], 4.1e-3, "%s, cell %d",
                         leaves[s].name, cell); /* 8 bits */
    }
done:
    free(density);
    return st;
}

/* The forward pass of pictures, after that of training. */
static cln_status check_pictures(cln_checks *c, data *d, cln_extreme *row)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;

    CLN_TRY(cln_check_spoil(p->device, &p->out, sizeof d->out));
    CLN_TRY(cln_stage_forward(p, SAMPLES, d->slices, false, 7));
    CLN_TRY(cln_buffer_read(p->device, &p->out, 0, d->out, sizeof d->out));
    for (uint32_t i = 0; i < SAMPLES; i++)
        for (int k = 0; k < 4; k++)
            cln_extreme_meet(row, d->out[i][k], d->want[i][k], d->want[i][k], 1e-4,
                             "%s, sample %u, value %d", leaves[d->samples[i].slot].name, i, k);
done:
    return st;
}

cln_status cln_extremes_networks(cln_checks *c)
{
    static const char range[] = "weights x 0, 1e-6 to 1e6, saturated colours, dead layers";
    cln_status st = CLN_OK;
    cln_extreme colour = cln_extreme_row(c, "colour", range);
    cln_extreme density = cln_extreme_row(c, "density", range);
    cln_extreme gradient = cln_extreme_row(c, "gradients of weights", range);
    cln_extreme cached = cln_extreme_row(c, "cached density", range);
    cln_extreme pictures = cln_extreme_row(c, "colour and density of pictures", range);
    data *d = NULL;

    CLN_TRY(make_data(c, 1, &d));
    CLN_TRY(launch(c->p, d));
    run_reference(c, d);
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const char *name = leaves[d->samples[i].slot].name;

        for (int k = 0; k < 3; k++)
            cln_extreme_meet(&colour, d->out[i][k], d->want[i][k], d->want[i][k], 1e-4,
                             "%s, sample %u", name, i);
        cln_extreme_meet(&density, d->out[i][3], d->want[i][3], d->want[i][3], 1e-4,
                         "%s, sample %u", name, i);
    }
    compare_gradients(&c->p->net, c->p->tune.half, d, &gradient);
    CLN_TRY(check_densities(c, d, &cached));
    CLN_TRY(check_pictures(c, d, &pictures));
    cln_extreme_report(&colour);
    cln_extreme_report(&density);
    cln_extreme_report(&gradient);
    cln_extreme_report(&cached);
    cln_extreme_report(&pictures);
    if (c->p->net.decoder)
        CLN_TRY(check_decoder(c, d, range));
done:
    free_data(d);
    return st;
}

/* How far a colour is outside 0..1; the colour itself if it is not finite. */
static double outside(double colour)
{
    return isfinite(colour) ? fmax(fabs(colour - 0.5) - 0.5, 0) : colour;
}

/* Pre-activations beyond the range of 16 bits, exponential densities at their limit. There is no
 * oracle: numbers must be finite, colours in 0..1, the largest density the exponential's limit. */
cln_status cln_extremes_large_weights(cln_checks *c)
{
    static const char range[] = "weights x 1e6";
    cln_status st = CLN_OK;
    const cln_config *config = &c->p->config;
    cln_extreme colour = cln_extreme_row(c, "colours from 0 to 1", range);
    cln_extreme density = cln_extreme_row(c, "largest density", range);
    cln_extreme gradient = cln_extreme_row(c, "every gradient", range);
    double most = 0;
    data *d = NULL;

    CLN_TRY(make_data(c, 1e6, &d));
    CLN_TRY(launch(c->p, d));
    for (uint32_t i = 0; i < SAMPLES; i++) {
        for (int k = 0; k < 3; k++)
            cln_extreme_meet(&colour, outside(d->out[i][k]), 0, 1, 0, "sample %u", i);
        cln_extreme_finite(&density, d->out[i][3], "sample %u", i);
        most = fmax(most, d->out[i][3]);
    }
    if (config->density == CLN_DENSITY_EXP)
        cln_extreme_meet(&density, most, config->density_scale * exp(70),
                         config->density_scale * exp(70), 1e-4, "kappa e^70");
    for (size_t i = 0; i < d->slices * (size_t)c->p->net.params; i++)
        cln_extreme_finite(&gradient, d->grads[i], "parameter %zu", i % (size_t)c->p->net.params);
    cln_extreme_report(&colour);
    cln_extreme_report(&density);
    cln_extreme_report(&gradient);
done:
    free_data(d);
    return st;
}

/* ---- Adam ---- */

enum { LEAST = 8, UPDATES = 20 };

/* Gradients of 0 and of sizes 1e-30 to 1e18, of both signs, in every leaf; weights begin at 0, so a
 * weight after the update is its step. */
static double gradient_of(int i)
{
    return i % 50 == 49 ? 0 : (i % 2 ? -1 : 1) * pow(10, -30 + i % 49);
}

/* Earlier updates of each leaf: none, up to far more than bias correction lasts. */
static const int32_t before[LEAVES] = {0, 1, 10, 100, 1000, 100000, 10000000, 2000000000};

static cln_status put_leaf_runs(cln_pipeline *p)
{
    cln_status st = CLN_OK;
    uint32_t begin[LEAVES], end[LEAVES], starts[LEAVES + 1];

    for (uint32_t s = 0; s <= LEAVES; s++) {
        starts[s] = s;
        if (s < LEAVES) {
            begin[s] = s * LEAST;
            end[s] = begin[s] + LEAST;
        }
    }
    CLN_TRY(cln_buffer_write(p->device, &p->begin, 0, begin, sizeof begin));
    CLN_TRY(cln_buffer_write(p->device, &p->end, 0, end, sizeof end));
    CLN_TRY(cln_buffer_write(p->device, &p->slice_starts, 0, starts, sizeof starts));
    CLN_TRY(cln_check_spoil(p->device, &p->slices, LEAVES * sizeof(cln_slice)));
done:
    return st;
}

static void count_moments(const cln_config *config, const void *moments, size_t n, const char *name,
                          cln_extreme *row)
{
    for (size_t i = 0; i < n; i++)
        cln_extreme_finite(row,
                           config->moments == CLN_MOMENTS_BFLOAT16
                               ? (double)ref_from_bf16(((const uint16_t *)moments)[i])
                               : (double)((const float *)moments)[i],
                           "%s %zu", name, i);
}

cln_status cln_extremes_adam(cln_checks *c)
{
    static const double rates[] = {1e-8, 1e-3, 1}; /* 1: 100 times the fast preset's */
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_config *config = &p->config;
    const int params = p->net.params;
    const size_t all = (size_t)(LEAVES * params);
    cln_extreme step = cln_extreme_row(c, "Adam's step",
                                       "gradients 0, 1e-30 to 1e18, rates 1e-8 to 1, "
                                       "0 to 2e9 updates before");
    cln_extreme finite = cln_extreme_row(c, "weights and moments after 20 updates", step.range);
    float *grads = NULL, *got = NULL;
    cln_model model = {0}, after = {0};

    CLN_TRY(cln_alloc(&grads, all, sizeof *grads, "self-test"));
    CLN_TRY(cln_alloc(&got, all, sizeof *got, "self-test"));
    CLN_TRY(cln_model_create(config, &model));
    CLN_TRY(cln_model_create(config, &after));
    CLN_ASSERT(model.tree.leaf_count == LEAVES);
    memset(model.params, 0, all * sizeof *model.params);
    for (size_t i = 0; i < all; i++)
        grads[i] = (float)gradient_of((int)i);
    for (size_t k = 0; k < sizeof rates / sizeof *rates; k++) {
        memcpy(model.adam_steps, before, sizeof before);
        CLN_TRY(cln_pipeline_upload(p, &model, true));
        CLN_TRY(put_leaf_runs(p));
        CLN_TRY(cln_check_put(p->device, &p->grads, grads, all * sizeof *grads));
        for (int update = 0; update < UPDATES; update++) {
            CLN_TRY(cln_stage_adam(p, LEAST, rates[k]));
            if (update == 0)
                CLN_TRY(cln_buffer_read(p->device, &p->params, 0, got, all * sizeof *got));
        }
        for (int i = 0; i < (int)all; i++) {
            double w = 0, m = 0, v = 0, g = grads[i];

            ref_adam(1, &w, &g, &m, &v, (int64_t)before[i / params] + 1,
                     (ref_adam_rule){(float)rates[k], (float)config->beta1, (float)config->beta2,
                                     (float)config->epsilon});
            /* where the gradient's square underflows, epsilon outweighs its root, or the step is
             * below any weight's last bit */
            cln_extreme_meet(&step, got[i], w, fabs(w), 1e-4,
                             "gradient %g, rate %g, %d updates before", g, rates[k],
                             (int)before[i / params]);
        }
        CLN_TRY(cln_pipeline_download(p, &after, true));
        for (size_t i = 0; i < all; i++)
            cln_extreme_finite(&finite, after.params[i], "weight %zu", i);
        count_moments(config, after.adam_m, all, "first moment", &finite);
        count_moments(config, after.adam_v, all, "second moment", &finite);
    }
    cln_extreme_report(&step);
    cln_extreme_report(&finite);
done:
    cln_model_free(&model);
    cln_model_free(&after);
    free(grads);
    free(got);
    return st;
}
