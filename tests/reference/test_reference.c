/* The float64 reference itself, first half: leaf network, compositing with its loss, Adam. Oracles:
 * central differences (step 1e-5), the closed form of method.md 9 in long double, hand-computed
 * numbers. If a perturbation crosses a kink, the difference does not converge when the step is
 * quartered; such elements are skipped, counted and limited to 2 %. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/rng.h"
#include "draws.h"
#include "near.h"
#include "reference/reference.h"
#include "tests.h"

/* ---- network: finite differences ---- */

typedef struct network_case {
    const char *name;
    int width, depth, view_width, bands, view_bands;
    bool view, skip;
    int density;
    bool slopes; /* one random slope per element; else `slope` */
    double slope;
    bool fade_bands;
    int stride; /* checks every stride-th parameter */
    int cells;  /* of a grid with 4 features; 0: frequencies; below 0: -CLN_ENCODING_* of another */
} network_case;

static const network_case network_cases[] = {
    {"small", 16, 2, 16, 2, 1, true, false, CLN_DENSITY_SOFTPLUS, false, -0.2, false, 1, 0},
    {"no view", 16, 3, 16, 1, 0, false, false, CLN_DENSITY_SOFTPLUS, false, -0.2, false, 1, 0},
    {"no direction bands", 16, 2, 32, 3, 0, true, false, CLN_DENSITY_RELU, false, 0.1, false, 1, 0},
    {"skip, exp", 16, 6, 16, 4, 2, true, true, CLN_DENSITY_EXP, false, -0.3, false, 2, 0},
    {"element slopes", 16, 4, 48, 4, 4, true, false, CLN_DENSITY_SOFTPLUS, true, 0, false, 2, 0},
    {"skip, slopes, faded", 32, 8, 32, 10, 4, true, true, CLN_DENSITY_SOFTPLUS, true, 0, true, 13,
     0},
    {"no view, skip, relu", 32, 7, 16, 6, 0, false, true, CLN_DENSITY_RELU, true, 0, false, 11, 0},
    {"paper", 64, 8, 256, 10, 4, true, true, CLN_DENSITY_SOFTPLUS, false, -0.2, false, 149, 0},
    {"grid", 16, 2, 16, 1, 1, true, false, CLN_DENSITY_SOFTPLUS, false, -0.2, false, 1, 2},
    {"grid, slopes", 16, 3, 16, 1, 0, false, false, CLN_DENSITY_SOFTPLUS, true, 0, false, 3, 4},
    {"voxel", 16, 3, 16, 1, 0, true, false, CLN_DENSITY_SOFTPLUS, false, 0, false, 1,
     -CLN_ENCODING_VOXEL},
    {"voxel, no view", 16, 3, 16, 1, 0, false, false, CLN_DENSITY_EXP, false, 0, false, 1,
     -CLN_ENCODING_VOXEL},
};

static cln_config config_of(const network_case *c)
{
    cln_config config;

    assert_int_equal(cln_config_preset("paper", &config), CLN_OK);
    config.width = c->width;
    config.depth = c->depth;
    config.view_width = c->view_width;
    config.bands = c->bands;
    config.view_bands = c->view_bands;
    config.view_dependence = c->view;
    config.skip = c->skip;
    config.density = c->density;
    config.encoding = c->cells > 0 ? CLN_ENCODING_GRID : -c->cells;
    if (c->cells > 0)
        config.grid_cells = c->cells;
    return config;
}

static void make_network(const network_case *c, ref_network *r)
{
    cln_config config = config_of(c);

    memset(r, 0, sizeof *r);
    assert_int_equal(cln_network_layout(&config, &r->net), CLN_OK);
    r->density = c->density;
    r->kappa = 10;
    r->bias = -0.5;
    for (int k = 0; k < 10; k++)
        r->level_bands[k] = c->fade_bands ? fmin(fmax(6.5 - k, 0), 1) : 1;
}

/* sum_k g[k] out[k]: the scalar whose gradient is checked. */
static double network_value(const ref_network *r, const float *params, const double *slopes,
                            double slope, const double g[4])
{
    static const double local[3] = {0.31, -0.72, 0.05}, dir[3] = {0.48, -0.6, 0.64};
    double out[4], sum = 0;

    ref_forward(r, params, local, dir, slopes, slope, out);
    for (int k = 0; k < 4; k++)
        sum += g[k] * out[k];
    return sum;
}

/* Central difference with respect to parameter i, with the step as rounded to float32. */
static double network_difference(const ref_network *r, float *params, int i, double step,
                                 const double *slopes, double slope, const double g[4])
{
    const float kept = params[i], high = (float)(kept + step), low = (float)(kept - step);
    double up = 0, down = 0;

    params[i] = high;
    up = network_value(r, params, slopes, slope, g);
    params[i] = low;
    down = network_value(r, params, slopes, slope, g);
    params[i] = kept;
    return (up - down) / ((double)high - low);
}

static void check_network_case(const network_case *c)
{
    static const double local[3] = {0.31, -0.72, 0.05}, dir[3] = {0.48, -0.6, 0.64};
    static const double g[4] = {0.7, -1.1, 0.4, 0.03};
    ref_network r;
    float *params = NULL;
    double *grad = NULL, *slopes = NULL, square = 0, bound = 0;
    int checked = 0, kinks = 0, nonzero = 0, elements = 0;

    make_network(c, &r);
    elements = r.net.depth * r.net.width + r.net.view_width;
    params = calloc((size_t)r.net.params, sizeof *params);
    grad = calloc((size_t)r.net.params, sizeof *grad);
    slopes = calloc((size_t)elements, sizeof *slopes);
    assert_true(params && grad && slopes);
    for (int i = 0; i < r.net.params; i++)
        params[i] = (float)uniform(1, i, -1, 1) * sqrtf(3.0f / (float)r.net.width);
    for (int i = 0; i < elements; i++)
        slopes[i] = uniform(2, i, -0.3, -0.1);
    ref_backward(&r, params, local, dir, c->slopes ? slopes : NULL, c->slope, g, grad);
    for (int i = 0; i < r.net.params; i++) {
        square += grad[i] * grad[i];
        nonzero += grad[i] != 0;
    }
    /* Padding has no gradient; learned numbers have one, except for faded bands and dead relu. */
    assert_true(nonzero <= r.net.learned);
    if (r.net.encoding == CLN_ENCODING_VOXEL) /* of the cell's eight corners */
        assert_int_equal(nonzero, c->view ? 8 * 13 : 8 * 4);
    else
        assert_true(nonzero > r.net.learned / 2);
    bound = 1e-6 * sqrt(square / r.net.params);
    for (int i = 0; i < r.net.params; i += c->stride) {
        double coarse =
            network_difference(&r, params, i, 1e-5, c->slopes ? slopes : NULL, c->slope, g);
        double fine =
            network_difference(&r, params, i, 2.5e-6, c->slopes ? slopes : NULL, c->slope, g);

        checked++;
        if (fabs(coarse - fine) > 10 * bound + 1e-6 * fabs(fine)) {
            kinks++;
            continue;
        }
        if (!(fabs(grad[i] - coarse) <= 10 * bound + 1e-6 * fabs(coarse)))
            fail_msg("%s: parameter %d: gradient %.12g, difference %.12g", c->name, i, grad[i],
                     coarse);
    }
    if (kinks > checked / 50)
        fail_msg("%s: %d of %d elements do not settle", c->name, kinks, checked);
    /* A second sample adds to the gradient. */
    square = grad[r.net.colour_b];
    ref_backward(&r, params, local, dir, c->slopes ? slopes : NULL, c->slope, g, grad);
    assert_near(grad[r.net.colour_b], 2 * square, 1e-12);
    free(params);
    free(grad);
    free(slopes);
}

static void test_network_gradients(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof network_cases / sizeof network_cases[0]; i++)
        check_network_case(&network_cases[i]);
}

/* ---- network: hand numbers ---- */

static void test_encoding(void **state)
{
    static const double x[3] = {0.1, -0.2, 0.3}, weights[3] = {1, 0.5, 0};
    double out[24];

    (void)state;
    memset(out, 0x7f, sizeof out);
    ref_encode(3, x, weights, 24, out);
    for (int a = 0; a < 3; a++) {
        assert_true(out[a] == x[a]);
        assert_near(out[3 + a], sin(x[a]), 1e-15);
        assert_near(out[6 + a], cos(x[a]), 1e-15);
        assert_near(out[9 + a], 0.5 * sin(2 * x[a]), 1e-15);
        assert_near(out[12 + a], 0.5 * cos(2 * x[a]), 1e-15);
        assert_true(out[15 + a] == 0 && out[18 + a] == 0);
        assert_true(out[21 + a] == 0); /* padding */
    }
    ref_encode(0, x, NULL, 4, out);
    assert_true(out[2] == x[2] && out[3] == 0);
}

/* Two cells an axis: at a vertex its number; in between the mean of neighbours; beyond, the
 * nearest. */
static void test_grid(void **state)
{
    static const double vertex[3] = {1, -1, 0}, middle[3] = {0.5, -1, 0}, outside[3] = {3, -1, -2};
    static const double inside[3] = {-0.75, 0.5, -0.5}, dout[1] = {2};
    float grid[27];
    double out = 0, grad[27] = {0}, sum = 0;

    (void)state;
    for (int i = 0; i < 27; i++)
        grid[i] = (float)(i * i);
    ref_grid(2, 1, grid, vertex, &out);
    assert_near(out, 11 * 11, 1e-12); /* x 2, y 0, z 1 */
    ref_grid(2, 1, grid, middle, &out);
    assert_near(out, (10 * 10 + 11 * 11) / 2.0, 1e-12);
    ref_grid(2, 1, grid, outside, &out);
    assert_near(out, 2 * 2, 1e-12);
    ref_grid_backward(2, 1, inside, dout, grad);
    assert_near(grad[0 + 3 + 0], 2 * 0.75 * 0.5 * 0.5, 1e-12);
    assert_near(grad[1 + 6 + 9], 2 * 0.25 * 0.5 * 0.5, 1e-12);
    for (int i = 0; i < 27; i++)
        sum += grad[i];
    assert_near(sum, 2, 1e-12);
}

/* A voxel's harmonics are orthogonal over the sphere, each with the square 1 on average: their sums
 * over directions with weights of the sphere's area, without the code's formulas. */
static void test_harmonics(void **state)
{
    enum { STEPS = 200, MOST = 9 };
    cln_config config;
    ref_network r = {.decoder = NULL};
    double sums[MOST][MOST] = {{0}}, area = 0;
    float params[27 * 32];
    const double middle[3] = {0, 0, 0};

    (void)state;
    assert_int_equal(cln_config_preset("voxel", &config), CLN_OK);
    config.harmonics = 2;
    config.decoder_width = 0;
    config.grid_cells = 2;
    assert_int_equal(cln_network_layout(&config, &r.net), CLN_OK);
    assert_true(r.net.params <= 27 * 32);
    for (int i = 0; i < STEPS; i++)
        for (int j = 0; j < 2 * STEPS; j++) {
            const double polar = M_PI * (i + 0.5) / STEPS, round = M_PI * (j + 0.5) / STEPS;
            const double d[3] = {sin(polar) * cos(round), sin(polar) * sin(round), cos(polar)};
            double y[MOST], raw[4];

            for (int k = 0; k < MOST; k++) { /* red with one coefficient is that harmonic */
                memset(params, 0, sizeof params);
                params[13 * 32 + (k == 0 ? 0 : 4 + 3 * (k - 1))] = 1;
                ref_voxel(&r, params, middle, d, raw);
                y[k] = raw[0];
                assert_true(raw[1] == 0 && raw[2] == 0 && raw[3] == 0);
            }
            area += sin(polar);
            for (int a = 0; a < MOST; a++)
                for (int b = 0; b < MOST; b++)
                    sums[a][b] += sin(polar) * y[a] * y[b];
        }
    for (int a = 0; a < MOST; a++)
        for (int b = 0; b < MOST; b++)
            assert_near(sums[a][b] / area, a == b ? 1 : 0, 1e-4);
}

/* The decoder's gradients are differences of its colours: of its weights, and of the features that
 * it reads. */
static void test_decoder(void **state)
{
    enum { PARAMS = 27 * 16, MOST = 1024 };
    const double at[3] = {0.3, -0.7, 0.1}, draw[4] = {0.7, -0.4, 0.9, 0.2};
    const double dir[3] = {2.0 / 3, -1.0 / 3, 2.0 / 3}, step = 1.0 / 1024;
    static float params[PARAMS], decoder[MOST];
    static double grad[PARAMS], decoder_grad[MOST];
    cln_config config;
    ref_network r = {.decoder = decoder, .decoder_grad = decoder_grad};
    static double wide[PARAMS], wide_decoder[MOST], wide_grad[PARAMS], wide_decoder_grad[MOST];
    double raw[4], wide_raw[4], worst = 0;
    ref_network in_double = {
        .wide = wide, .wide_decoder = wide_decoder, .decoder_grad = wide_decoder_grad};

    (void)state;
    assert_int_equal(cln_config_preset("voxel", &config), CLN_OK);
    config.grid_cells = 2;
    config.decoder_width = 16;
    assert_int_equal(cln_network_layout(&config, &r.net), CLN_OK);
    assert_true(r.net.params == PARAMS && r.net.decoder_params <= MOST);
    for (int i = 0; i < PARAMS; i++)
        params[i] = (float)uniform(1, i, -1, 1);
    for (int i = 0; i < r.net.decoder_params; i++)
        decoder[i] = (float)uniform(2, i, -0.5, 0.5);
    ref_voxel_backward(&r, params, at, dir, draw, grad);
    for (int i = 0; i < PARAMS + r.net.decoder_params; i++) {
        float *p = i < PARAMS ? &params[i] : &decoder[i - PARAMS];
        const float before = *p;
        const double want = i < PARAMS ? grad[i] : decoder_grad[i - PARAMS];
        double difference = 0;

        for (int side = -1; side <= 1; side += 2) {
            *p = before + (float)(side * step);
            ref_voxel(&r, params, at, dir, raw);
            for (int c = 0; c < 4; c++)
                difference += side * draw[c] * raw[c] / (2 * step);
        }
        *p = before;
        assert_true(isfinite(difference - want));
        worst = fmax(worst, fabs(difference - want));
    }
    assert_true(ref_decoder_margin(&r, params, at, dir) > 3 * step); /* no kink in between */
    assert_true(worst < 1e-4);
    /* the same numbers as double */
    in_double.net = r.net;
    for (int i = 0; i < PARAMS; i++)
        wide[i] = params[i];
    for (int i = 0; i < r.net.decoder_params; i++)
        wide_decoder[i] = decoder[i];
    ref_voxel(&r, params, at, dir, raw);
    ref_voxel(&in_double, NULL, at, dir, wide_raw);
    ref_voxel_backward(&in_double, NULL, at, dir, draw, wide_grad);
    assert_memory_equal(wide_raw, raw, sizeof raw);
    assert_memory_equal(wide_grad, grad, sizeof grad);
    assert_memory_equal(wide_decoder_grad, decoder_grad, sizeof decoder_grad);
}

/* Half of the sum over a leaf's edges of squares of differences, which turn linear; edges on n of
 * the leaf's faces count 1 / 2^n. */
static double roughness(const cln_config *c, const float *p, int side, int features)
{
    double sum = 0;

    for (int v = 0; v < side * side * side; v++)
        for (int a = 0, step = 1; a < 3; a++, step *= side) {
            const int faces[3] = {v % side % (side - 1) == 0, v / side % side % (side - 1) == 0,
                                  v / (side * side) % (side - 1) == 0};

            if (v / step % side == side - 1)
                continue;
            for (int f = 0; f < features; f++) {
                const double d = (double)p[v * features + f] - p[(v + step) * features + f];
                const double delta = f == 3 ? c->smooth_density_delta : c->smooth_colour_delta;

                sum += (f == 3 ? c->smooth_density : c->smooth_colour) *
                       (delta > 0 ? delta * delta * (sqrt(1 + d * d / (delta * delta)) - 1)
                                  : d * d / 2) /
                       (1 << (faces[0] + faces[1] + faces[2] - faces[a]));
            }
        }
    return sum;
}

/* The smoothness' gradient is differences of the roughness, at vertices that were met, of leaves
 * whose turn it is. */
static void test_smoothness(void **state)
{
    enum { SIDE = 5, VERTICES = SIDE * SIDE * SIDE, FEATURES = 4, STEPS = 4000 };
    const double step = 1.0 / 1024;
    static float p[VERTICES * FEATURES];
    cln_config config;
    cln_network net;
    int turns = 0, own_turn = -1;

    (void)state;
    assert_int_equal(cln_config_preset("voxel", &config), CLN_OK);
    config.grid_cells = SIDE - 1;
    config.view_dependence = false;
    config.smooth_density = 0.03;
    config.smooth_colour = 0.02;
    assert_int_equal(cln_network_layout(&config, &net), CLN_OK);
    assert_int_equal(net.features, FEATURES);
    for (int i = 0; i < VERTICES * FEATURES; i++)
        p[i] = (float)uniform(1, i, -1, 1);
    for (int way = 0; way < 2; way++) {
        double grad[VERTICES * FEATURES] = {0}, worst = 0;
        uint8_t met[VERTICES];

        config.smooth_density_delta = way ? 0 : 0.3;
        config.smooth_colour_delta = way ? 0.2 : 0;
        for (int v = 0; v < VERTICES; v++)
            met[v] = v % 7 != 0;
        for (int slot = 0; slot < 40 && own_turn < 0; slot++)
            if (ref_voxel_smooth(&config, &net, 4, slot, 7, p, met, grad))
                own_turn = slot;
        memset(grad, 0, sizeof grad);
        assert_true(own_turn >= 0);
        assert_true(ref_voxel_smooth(&config, &net, 4, own_turn, 7, p, met, grad));
        for (int i = 0; i < VERTICES * FEATURES; i++) {
            const float before = p[i];
            double difference = 0;

            for (int side = -1; side <= 1; side += 2) {
                p[i] = before + (float)(side * step);
                difference += side * roughness(&config, p, SIDE, FEATURES) / (2 * step);
            }
            p[i] = before;
            /* level 4 has four times the weights of level 5, and one leaf in four counts for all */
            worst = fmax(worst, fabs(grad[i] - (met[i / FEATURES] ? 16 * difference : 0)));
        }
        assert_true(worst < 1e-4);
    }
    for (uint32_t key = 0; key < STEPS; key++) {
        const uint8_t none[VERTICES] = {0};

        turns += ref_voxel_smooth(&config, &net, 4, own_turn, key, p, none, NULL);
    }
    assert_in_range(turns, STEPS / 4 - 150, STEPS / 4 + 150);
}

/* A network with six nonzero weights, calculated by hand: x -> 2x -> 3h -> heads. */
static void test_network_by_hand(void **state)
{
    const network_case shape = {"hand", 16,   2,     16, 1, 0, true, false, CLN_DENSITY_SOFTPLUS,
                                false,  -0.2, false, 1,  0};
    static const double dir[3] = {0, 0, -1};
    float params[4096] = {0};
    double out[4], slopes[48], local[3] = {0.5, 0.9, -0.9};
    ref_network r;

    (void)state;
    make_network(&shape, &r);
    assert_true(r.net.params <= 4096);
    params[r.net.trunk_w[0]] = 2;
    params[r.net.trunk_w[1]] = 3;
    params[r.net.sigma_w] = 0.5f;
    params[r.net.sigma_b] = 0.25f;
    params[r.net.view_w] = 1;                 /* h -> view neuron 0 */
    params[r.net.view_w + (16 + 2) * 16] = 4; /* direction z -> view neuron 0 */
    params[r.net.colour_w + 16] = 1;          /* view neuron 0 -> green */
    params[r.net.colour_b + 2] = -1;          /* blue */

    /* x = 0.5: h0 = 1, h1 = 3, s = 1.75, view = 3 - 4 = -1 -> +0.2. */
    ref_forward(&r, params, local, dir, NULL, -0.2, out);
    assert_near(out[0], 0.5, 1e-12);
    assert_near(out[1], 1 / (1 + exp(-0.2)), 1e-12);
    assert_near(out[2], 1 / (1 + exp(1)), 1e-12);
    assert_near(out[3], 10 * log(1 + exp(1.75 - 0.5)), 1e-12);

    /* x = -0.5: -1 -> +0.2 (the slope is taken literally), 0.6, s = 0.55, view = -3.4 -> 0.68. */
    local[0] = -0.5;
    ref_forward(&r, params, local, dir, NULL, -0.2, out);
    assert_near(out[1], 1 / (1 + exp(-0.68)), 1e-12);
    assert_near(out[3], 10 * log(1 + exp(0.55 - 0.5)), 1e-12);
    /* With slope 0.1: -0.1, then -0.3 -> -0.03, s = 0.235. */
    ref_forward(&r, params, local, dir, NULL, 0.1, out);
    assert_near(out[3], 10 * log(1 + exp(0.235 - 0.5)), 1e-12);

    /* Slopes are [layer][neuron], the view layer last. */
    for (int i = 0; i < 48; i++)
        slopes[i] = 100 + i;
    slopes[0] = -0.3;  /* trunk layer 0, neuron 0: -1 -> 0.3, then 0.9 */
    slopes[32] = -0.1; /* view neuron 0: 0.9 - 4 = -3.1 -> 0.31 */
    ref_forward(&r, params, local, dir, slopes, 0, out);
    assert_near(out[1], 1 / (1 + exp(-0.31)), 1e-12);
    assert_near(out[3], 10 * log(1 + exp(0.45 + 0.25 - 0.5)), 1e-12);
    slopes[0] = 0.1; /* -1 -> -0.1, then -0.3 by slopes[16] -> 0.06 */
    slopes[16] = -0.2;
    ref_forward(&r, params, local, dir, slopes, 0, out);
    assert_near(out[3], 10 * log(1 + exp(0.03 + 0.25 - 0.5)), 1e-12);
}

/* The skip layer reads the encoding after its own input; without view dependence colour comes from
 * the trunk. */
static void test_skip_by_hand(void **state)
{
    const network_case shape = {"hand",           16,    6,   16,    1, 0, false, true,
                                CLN_DENSITY_RELU, false, 0.1, false, 1, 0};
    static const double local[3] = {0.5, 0.75, -0.9};
    float *params = NULL;
    double out[4];
    ref_network r;

    (void)state;
    make_network(&shape, &r);
    params = calloc((size_t)r.net.params, sizeof *params);
    assert_non_null(params);
    assert_int_equal(r.net.skip_layer, 4);
    params[r.net.trunk_w[4] + (16 + 1) * 16 + 5] = 2; /* y -> neuron 5 of layer 4 */
    params[r.net.trunk_w[5] + 5 * 16 + 7] = 3;        /* neuron 5 -> 7 */
    params[r.net.sigma_w + 7] = 1;
    params[r.net.colour_w + 2 * 16 + 7] = -1;
    ref_forward(&r, params, local, NULL, NULL, 0.1, out);
    assert_near(out[0], 0.5, 1e-12);
    assert_near(out[2], 1 / (1 + exp(4.5)), 1e-12);
    assert_near(out[3], 10 * (4.5 - 0.5), 1e-12);
    free(params);
}

/* Density at extreme s, through a network of one bias. */
static double density_at(int kind, double bias, float s, double *gradient)
{
    const network_case shape = {"bias", 16, 2, 16, 1, 0, false, false, kind, false, 0, false, 1, 0};
    static const double local[3] = {0, 0, 0}, dout[4] = {0, 0, 0, 1};
    float params[4096] = {0};
    double grad[4096] = {0}, out[4];
    ref_network r;

    make_network(&shape, &r);
    r.bias = bias;
    params[r.net.sigma_b] = s;
    ref_forward(&r, params, local, NULL, NULL, 0, out);
    ref_backward(&r, params, local, NULL, NULL, 0, dout, grad);
    *gradient = grad[r.net.sigma_b];
    return out[3];
}

static void test_density_extremes(void **state)
{
    double g = 0;

    (void)state;
    assert_near(density_at(CLN_DENSITY_SOFTPLUS, 0, 0, &g), 10 * log(2), 1e-12);
    assert_near(g, 5, 1e-12);
    assert_near(density_at(CLN_DENSITY_SOFTPLUS, -3, 1000, &g), 9970, 1e-9);
    assert_near(g, 10, 1e-9);
    assert_near(density_at(CLN_DENSITY_SOFTPLUS, 0, -50, &g) / (10 * exp(-50)), 1, 1e-12);
    assert_near(g / (10 * exp(-50)), 1, 1e-12);
    assert_near(density_at(CLN_DENSITY_SOFTPLUS, 0, -1000, &g), 0, 0);
    assert_near(g, 0, 0);
    assert_near(density_at(CLN_DENSITY_RELU, 1, -2, &g), 0, 0);
    assert_near(g, 0, 0);
    assert_near(density_at(CLN_DENSITY_RELU, 1, 2, &g), 30, 1e-12);
    assert_near(g, 10, 0);
    assert_near(density_at(CLN_DENSITY_EXP, 1, 2, &g), 10 * exp(3), 1e-9);
    assert_near(g, 10 * exp(3), 1e-9);
    assert_near(density_at(CLN_DENSITY_EXP, 1, 19, &g) / (10 * exp(20)), 1, 1e-12);
    assert_near(g, 10 * exp(15), 1e-5);
    assert_true(isfinite((float)density_at(CLN_DENSITY_EXP, 0, 1e30f, &g)));
    assert_near(g, 10 * exp(15), 1e-5);
}

/* ---- compositing ---- */

typedef struct ray_case {
    int n;
    double optical; /* sigma * delta of an ordinary sample */
    int odd;        /* this sample (if any) has `odd_optical` instead */
    double odd_optical;
} ray_case;

static const ray_case ray_cases[] = {
    {0, 0, -1, 0},      {1, 1e-12, -1, 0}, {1, 1, -1, 0},      {1, 1e4, -1, 0},  {2, 1, -1, 0},
    {7, 1e-12, -1, 0},  {7, 0.3, -1, 0},   {7, 1e4, -1, 0},    {9, 0.2, 0, 1e4}, {9, 1e-12, 4, 1e4},
    {9, 0.5, 8, 1e-12}, {40, 0.05, -1, 0}, {40, 1e-12, 20, 1},
};

enum { MAX_SAMPLES = 64 };

typedef struct ray_data {
    int n;
    double out[MAX_SAMPLES][4], t[MAX_SAMPLES], delta[MAX_SAMPLES], background[3], target[4];
} ray_data;

static void make_ray(const ray_case *c, ray_data *ray)
{
    double t = 0.5;

    memset(ray, 0, sizeof *ray);
    ray->n = c->n;
    for (int i = 0; i < c->n; i++) {
        ray->delta[i] = uniform(3, i, 0.05, 0.2);
        ray->t[i] = t + ray->delta[i] * uniform(4, i, 0.3, 0.7);
        t += ray->delta[i];
        for (int k = 0; k < 3; k++)
            ray->out[i][k] = uniform(5, 3 * i + k, 0.05, 0.95);
        ray->out[i][3] = (i == c->odd ? c->odd_optical : c->optical) / ray->delta[i];
    }
    for (int k = 0; k < 3; k++) {
        ray->background[k] = uniform(6, k, 0, 1);
        ray->target[k] = uniform(7, k, 0, 1);
    }
    ray->target[3] = uniform(8, c->n, 0, 1);
}

static double loss_of(const ref_loss *loss, const ray_data *ray, double (*grad)[4])
{
    return ref_loss_of_ray(loss, ray->n, ray->out, ray->t, ray->delta, ray->background, ray->target,
                           grad);
}

static const ref_loss losses[] = {
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1},
    {.kind = CLN_LOSS_HUBER, .huber_delta = 0.1},
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .cauchy = 1e-3},
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .opacity_entropy = 0.05},
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .distortion = 0.3},
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .alpha = 0.4},
    {.kind = CLN_LOSS_L2, .huber_delta = 0.1, .depth = 0.7, .reach = 0.4},
    {.kind = CLN_LOSS_HUBER,
     .huber_delta = 0.2,
     .cauchy = 1e-3,
     .opacity_entropy = 0.02,
     .distortion = 0.1,
     .alpha = 0.2,
     .depth = 0.3,
     .reach = 1},
};

/* Bound: 1e-6 of the gradient's size, plus the rounding of a loss of up to 50 in double at this
 * step (50 * 2^-53 / 1e-5 = 6e-10). */
static void test_loss_gradients(void **state)
{
    (void)state;
    for (size_t l = 0; l < sizeof losses / sizeof losses[0]; l++) {
        for (size_t c = 0; c < sizeof ray_cases / sizeof ray_cases[0]; c++) {
            ray_data ray;
            double grad[MAX_SAMPLES][4];

            make_ray(&ray_cases[c], &ray);
            memset(grad, 0x7f, sizeof grad);
            assert_true(loss_of(&losses[l], &ray, grad) == loss_of(&losses[l], &ray, NULL));
            for (int i = 0; i < 4 * ray.n; i++) {
                double *value = &ray.out[i / 4][i % 4], kept = *value, up = 0, down = 0, fd = 0;

                *value = kept + 1e-5;
                up = loss_of(&losses[l], &ray, NULL);
                *value = kept - 1e-5;
                down = loss_of(&losses[l], &ray, NULL);
                *value = kept;
                fd = (up - down) / 2e-5;
                if (!(fabs(grad[i / 4][i % 4] - fd) <= 1e-6 * fabs(fd) + 5e-9))
                    fail_msg("loss %zu, ray %zu, sample %d, component %d: %.12g, difference %.12g",
                             l, c, i / 4, i % 4, grad[i / 4][i % 4], fd);
            }
        }
    }
}

/* The closed form of method.md 9 in long double: accurate also where gradients are tiny. */
static void test_loss_closed_form(void **state)
{
    (void)state;
    for (size_t c = 0; c < sizeof ray_cases / sizeof ray_cases[0]; c++) {
        ray_data ray;
        double grad[MAX_SAMPLES][4], rgb[3], depth = 0, opacity = 0;
        long double trans[MAX_SAMPLES + 1], suffix[3];

        make_ray(&ray_cases[c], &ray);
        ref_composite(ray.n, ray.out, ray.t, ray.delta, ray.background, rgb, &depth, &opacity,
                      NULL);
        loss_of(&losses[0], &ray, grad);
        trans[0] = 1;
        for (int i = 0; i < ray.n; i++)
            trans[i + 1] = trans[i] * expl(-fminl((long double)ray.out[i][3] * ray.delta[i], 80));
        for (int k = 0; k < 3; k++)
            suffix[k] = trans[ray.n] * ray.background[k];
        for (int i = ray.n - 1; i >= 0; i--) {
            double x = ray.out[i][3] * ray.delta[i];
            long double w = trans[i] * -expm1l(-fminl(x, 80)), dsigma = 0, size = 0;

            for (int k = 0; k < 3; k++) {
                long double g = 2 * ((long double)rgb[k] - ray.target[k]) / 3;

                assert_near(grad[i][k], (double)(w * g), 1e-12 * (double)fabsl(w));
                dsigma += ray.delta[i] * g * (trans[i + 1] * ray.out[i][k] - suffix[k]);
                size += ray.delta[i] * fabsl(g) * (trans[i + 1] * ray.out[i][k] + suffix[k]);
                suffix[k] += w * ray.out[i][k];
            }
            assert_near(grad[i][3], x < 80 ? (double)dsigma : 0, 1e-12 * (double)size);
        }
    }
}

static void test_composite_by_hand(void **state)
{
    const double half = log(2), bg[3] = {1, 0, 0.5}, t[2] = {1, 3}, delta[2] = {0.5, 0.25};
    const double out[2][4] = {{0.2, 0.4, 0.6, half / 0.5}, {1, 0.5, 0, half / 0.25}};
    const double target[4] = {0, 0, 0, 0};
    double rgb[4], depth = 0, opacity = 0, w[2] = {0, 0}, plain = 0;
    ref_loss loss = {.kind = CLN_LOSS_L2, .huber_delta = 0.1};

    (void)state;
    ref_composite(0, NULL, NULL, NULL, bg, rgb, &depth, &opacity, NULL);
    assert_true(rgb[0] == 1 && rgb[1] == 0 && rgb[2] == 0.5 && depth == 0 && opacity == 0);
    assert_near(ref_loss_of_ray(&loss, 0, NULL, NULL, NULL, bg, target, NULL), 1.25 / 3, 1e-15);

    ref_composite(1, out, t, delta, bg, rgb, &depth, &opacity, w);
    assert_near(rgb[0], 0.6, 1e-15);
    assert_near(rgb[1], 0.2, 1e-15);
    assert_near(rgb[2], 0.55, 1e-15);
    assert_near(depth, 1, 1e-15);
    assert_near(opacity, 0.5, 1e-15);

    ref_composite(2, out, t, delta, bg, rgb, &depth, &opacity, w);
    assert_near(w[0], 0.5, 1e-15);
    assert_near(w[1], 0.25, 1e-15);
    assert_near(rgb[0], 0.5 * 0.2 + 0.25 * 1 + 0.25 * 1, 1e-15);
    assert_near(rgb[1], 0.5 * 0.4 + 0.25 * 0.5, 1e-15);
    assert_near(rgb[2], 0.5 * 0.6 + 0.25 * 0.5, 1e-15);
    assert_near(depth, (0.5 * 1 + 0.25 * 3) / 0.75, 1e-15);
    assert_near(opacity, 0.75, 1e-15);
    /* half of 0.5 has passed after log(4/3) of the first sample's log(2); half of 0.75 likewise */
    assert_near(ref_median_depth(1, out, t, delta), 1 + 0.5 * (log(4. / 3) / half - 0.5), 1e-15);
    assert_near(ref_median_depth(2, out, t, delta), 1 + 0.5 * (log(1.6) / half - 0.5), 1e-15);
    assert_true(ref_median_depth(0, NULL, NULL, NULL) == 0);

    plain = ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL);
    assert_near(plain, 0, 1e-30);
    loss.cauchy = 1;
    assert_near(ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL),
                log(1 + 8 * half * half) + log(1 + 32 * half * half), 1e-12);
    loss.cauchy = 0;
    loss.opacity_entropy = 1;
    assert_near(ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL), log(1 + 0.1875 / 0.11),
                1e-12);
    loss.opacity_entropy = 0;
    loss.distortion = 1;
    assert_near(ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL),
                2 * 0.5 * 0.25 * 2 + (0.25 * 0.5 + 0.0625 * 0.25) / 3, 1e-12);
    loss.distortion = 0;
    loss.alpha = 2;
    rgb[3] = 0.25; /* of the target; the ray's is 0.75 */
    assert_near(ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL), 2 * 0.25, 1e-15);
    loss.alpha = 0;
    loss.depth = 2;
    loss.reach = 1.5; /* weights 1/2 at 1, 1/4 at 3, 1/4 beyond */
    assert_near(ref_loss_of_ray(&loss, 2, out, t, delta, bg, rgb, NULL),
                2 * (0.5 * 0.5 + 0.25 * 1.5 + 0.25), 1e-15);
    assert_near(ref_reach((const float[4]){1, 2, 3, 0}, (const float[4]){0, 0.6f, 0.8f, 1},
                          (const float[4]){9, 3, 4, 0}),
                1.4, 1e-6);
}

static void test_huber_by_hand(void **state)
{
    const ref_loss loss = {.kind = CLN_LOSS_HUBER, .huber_delta = 0.1};
    const double bg[3] = {0.5, 0.5, 0.5}, target[4] = {0.45, 0.8, 0.5, 1};

    (void)state;
    assert_near(ref_loss_of_ray(&loss, 0, NULL, NULL, NULL, bg, target, NULL),
                (0.05 * 0.05 / 2 + 0.1 * (0.3 - 0.05)) / 3, 1e-15);
}

/* Samples behind an opaque one do not count, nothing overflows, and a ray of empty samples is
 * background. */
static void test_composite_extremes(void **state)
{
    static const double optical[] = {0, 1e-300, 1e-12, 80, 1e4, 1e6, 1e300};
    const double bg[3] = {0.1, 0.2, 0.3};

    (void)state;
    for (size_t e = 0; e < sizeof optical / sizeof optical[0]; e++) {
        const ray_case c = {5, 0.5, 0, optical[e]};
        ray_data ray;
        double grad[MAX_SAMPLES][4], rgb[3], depth = 0, opacity = 0, w[5];

        make_ray(&c, &ray);
        ref_composite(5, ray.out, ray.t, ray.delta, bg, rgb, &depth, &opacity, w);
        loss_of(&losses[5], &ray, grad);
        for (int i = 0; i < 20; i++)
            assert_true(isfinite(grad[i / 4][i % 4]));
        if (optical[e] >= 80) {
            assert_near(rgb[0], ray.out[0][0], 1e-15);
            assert_near(depth, ray.t[0], 1e-15);
            assert_near(opacity, 1, 1e-15);
            assert_true(w[1] < 1e-34);
        } else {
            assert_near(w[0], optical[e], 1e-12 * optical[e]); /* alpha = x (1 - x/2 ...) */
        }
    }
}

/* ---- Adam ---- */

static void test_adam(void **state)
{
    double p[2] = {1, -1}, m[2] = {0, 0}, v[2] = {0, 0};
    const double g1[2] = {0.5, -1e-3}, g2[2] = {-0.25, 0};
    double m2 = 0.9 * 0.05 + 0.1 * -0.25, v2 = 0.99 * 0.0025 + 0.01 * 0.0625;

    (void)state;
    /* The first step is lr * sign(g), regardless of the size. */
    ref_adam(2, p, g1, m, v, 1, (ref_adam_rule){0.01, 0.9, 0.99, 0});
    assert_near(p[0], 0.99, 1e-14);
    assert_near(p[1], -0.99, 1e-14);
    assert_near(m[0], 0.05, 1e-15);
    assert_near(v[0], 0.0025, 1e-15);
    ref_adam(2, p, g2, m, v, 2, (ref_adam_rule){0.01, 0.9, 0.99, 0});
    assert_near(p[0], 0.99 - 0.01 * (m2 / 0.19) / sqrt(v2 / 0.0199), 1e-14);
    assert_near(p[1], -0.99 + 0.01 * (0.09e-3 / 0.19) / sqrt(0.0099e-6 / 0.0199), 1e-14);
    p[0] = m[0] = v[0] = 0;
    ref_adam(1, p, g1 + 1, m, v, 1,
             (ref_adam_rule){0.01, 0.9, 0.99, 1e-3}); /* epsilon as large as the gradient */
    assert_near(p[0], 0.005, 1e-14);
    p[0] = m[0] = v[0] = 0;
    ref_adam(1, p, m, m, v, 1, (ref_adam_rule){0.01, 0.9, 0.99, 1e-8});
    assert_true(p[0] == 0);
}

int test_group_reference(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_network_gradients),
        cmocka_unit_test(test_encoding),
        cmocka_unit_test(test_grid),
        cmocka_unit_test(test_harmonics),
        cmocka_unit_test(test_decoder),
        cmocka_unit_test(test_smoothness),
        cmocka_unit_test(test_network_by_hand),
        cmocka_unit_test(test_skip_by_hand),
        cmocka_unit_test(test_density_extremes),
        cmocka_unit_test(test_loss_gradients),
        cmocka_unit_test(test_loss_closed_form),
        cmocka_unit_test(test_composite_by_hand),
        cmocka_unit_test(test_huber_by_hand),
        cmocka_unit_test(test_composite_extremes),
        cmocka_unit_test(test_adam),
    };

    return cmocka_run_group_tests_name("reference", tests, NULL, NULL);
}
