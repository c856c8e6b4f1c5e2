/* Voxels in float64 (method.md 1), twin of kernels/voxel.cl. See reference.h. */
#include <math.h>
#include "base/rng.h"
#include "reference/reference.h"

enum { FEATURES = 32, HARMONICS = 9, SMOOTH_EVERY = 4 };

/* The functions of a direction of which colours are weighted sums, each divided by the constant
 * one: real spherical harmonics, as in Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2(2),
 * 2013. */
static int harmonics(int features, const double d[3], double y[HARMONICS])
{
    const double x = d[0], v = d[1], z = d[2];
    const double all[HARMONICS] = {1,
                                   sqrt(3) * v,
                                   sqrt(3) * z,
                                   sqrt(3) * x,
                                   sqrt(15) * x * v,
                                   sqrt(15) * v * z,
                                   sqrt(5) / 2 * (3 * z * z - 1),
                                   sqrt(15) * x * z,
                                   sqrt(15) / 2 * (x * x - v * v)};

    for (int k = 0; k < HARMONICS; k++)
        y[k] = all[k];
    return features == 4 ? 1 : features == 16 ? 4 : 9;
}

/* Where coefficient k of colour c is among a vertex's numbers. */
static int number_of(int k, int c)
{
    return k == 0 ? c : 4 + 3 * (k - 1) + c;
}

/* The decoder (kernels/decoder.h): its inputs, and hidden units before the activation. */
typedef struct decoder {
    int in, width;
    double x[FEATURES + CLN_DECODER_HARMONICS], h[64];
} decoder;

/* Weights as float32 or, for a trainer in double, as double. */
static double decoder_at(const ref_network *r, int i)
{
    return r->wide_decoder ? r->wide_decoder[i] : (double)r->decoder[i];
}

static void features_at(const ref_network *r, const float *params, const double local[3],
                        double at[FEATURES])
{
    if (r->wide)
        ref_grid_wide(r->net.cells, r->net.features, r->wide, local, at);
    else
        ref_grid(r->net.cells, r->net.features, params, local, at);
}

static decoder run_decoder(const ref_network *r, const double at[FEATURES],
                           const double y[HARMONICS])
{
    const int features = r->net.features;
    decoder d = {.in = features - 1 + CLN_DECODER_HARMONICS, .width = r->net.decoder};

    for (int f = 0; f < features; f++)
        if (f != 3)
            d.x[f < 3 ? f : f - 1] = at[f];
    for (int k = 1; k < HARMONICS; k++)
        d.x[features - 2 + k] = y[k];
    for (int j = 0; j < d.width; j++) {
        d.h[j] = decoder_at(r, d.in * d.width + j);
        for (int i = 0; i < d.in; i++)
            d.h[j] += decoder_at(r, i * d.width + j) * d.x[i];
    }
    return d;
}

/* Place of the weight of hidden unit j in colour c. */
static int out_of(const decoder *d, int c, int j)
{
    return (d->in + 1 + c) * d->width + j;
}

void ref_voxel(const ref_network *r, const float *params, const double local[3],
               const double dir[3], double raw[4])
{
    const cln_network *net = &r->net;
    double at[FEATURES], y[HARMONICS];
    const int count = harmonics(net->features, dir, y);

    features_at(r, params, local, at);
    raw[3] = at[3];
    for (int c = 0; c < 3; c++) {
        raw[c] = 0;
        for (int k = 0; k < count; k++)
            raw[c] += y[k] * at[number_of(k, c)];
    }
    if (net->decoder) {
        const decoder d = run_decoder(r, at, y);

        for (int c = 0; c < 3; c++)
            for (int j = 0; j < d.width; j++)
                raw[c] += decoder_at(r, out_of(&d, c, j)) * fmax(d.h[j], 0);
    }
}

double ref_decoder_margin(const ref_network *r, const float *params, const double local[3],
                          const double dir[3])
{
    double margin = INFINITY, at[FEATURES], y[HARMONICS];

    harmonics(r->net.features, dir, y);
    features_at(r, params, local, at);
    if (r->net.decoder) {
        const decoder d = run_decoder(r, at, y);

        for (int j = 0; j < d.width; j++)
            margin = fmin(margin, fabs(d.h[j]));
    }
    return margin;
}

/* Adds the gradient of the features through the decoder to dat, that of its weights to grad. */
static void decoder_back(const ref_network *r, const double at[FEATURES], const double y[HARMONICS],
                         const double draw[4], double dat[FEATURES], double *grad)
{
    const decoder d = run_decoder(r, at, y);

    for (int j = 0; j < d.width; j++) {
        double dh = 0;

        for (int c = 0; c < 3; c++) {
            dh += draw[c] * decoder_at(r, out_of(&d, c, j));
            if (grad)
                grad[out_of(&d, c, j)] += draw[c] * fmax(d.h[j], 0);
        }
        if (d.h[j] <= 0)
            continue;
        if (grad)
            grad[d.in * d.width + j] += dh;
        for (int i = 0; i < d.in; i++) {
            if (grad)
                grad[i * d.width + j] += d.x[i] * dh;
            if (i < r->net.features - 1)
                dat[i < 3 ? i : i + 1] += decoder_at(r, i * d.width + j) * dh;
        }
    }
}

void ref_voxel_backward(const ref_network *r, const float *params, const double local[3],
                        const double dir[3], const double draw[4], double *grad)
{
    const cln_network *net = &r->net;
    double at[FEATURES], d[FEATURES] = {0}, y[HARMONICS];
    const int count = harmonics(net->features, dir, y);

    d[3] = draw[3];
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < count; k++)
            d[number_of(k, c)] = y[k] * draw[c];
    if (net->decoder) {
        features_at(r, params, local, at);
        decoder_back(r, at, y, draw, d, r->decoder_grad);
    }
    ref_grid_backward(net->cells, net->features, local, d, grad);
}

/* Leaf and vertex of the first leaf around `slot` that has its vertex v, as leaf * vertices +
 * vertex. */
static int first_of(const cln_network *net, const int32_t around[27], int v)
{
    const int side = net->cells + 1;

    for (int i = 0; i < 27; i++) {
        const int x = v % side - (i % 3 - 1) * net->cells;
        const int y = v / side % side - (i / 3 % 3 - 1) * net->cells;
        const int z = v / side / side - (i / 9 - 1) * net->cells;

        if (around[i] >= 0 && x >= 0 && x < side && y >= 0 && y < side && z >= 0 && z < side)
            return ((around[i] * side + z) * side + y) * side + x;
    }
    return -1;
}

void ref_voxel_owners(const cln_network *net, int leaves, const int32_t (*around)[27], int *owner)
{
    const int vertices = (net->cells + 1) * (net->cells + 1) * (net->cells + 1);

    for (int i = 0; i < leaves * vertices; i++)
        owner[i] = first_of(net, around[i / vertices], i % vertices);
}

/* The slope of delta^2 (sqrt(1 + (d / delta)^2) - 1), or of half of d^2 where delta is 0. */
static double smooth_slope(double d, double delta)
{
    return delta > 0 ? d / sqrt(1 + d / delta * (d / delta)) : d;
}

/* Weight of an edge from vertex v along axis a: each leaf that has it adds its share. */
static double edge_share(const cln_network *net, int v, int a)
{
    const int side = net->cells + 1, at[3] = {v % side, v / side % side, v / side / side};
    double share = 1;

    for (int other = 0; other < 3; other++)
        if (other != a && at[other] % net->cells == 0)
            share /= 2;
    return share;
}

bool ref_voxel_smooth(const cln_config *config, const cln_network *net, int level, int slot,
                      uint32_t key, const float *params, const uint8_t *met, double *grad)
{
    const int side = net->cells + 1, step[3] = {1, side, side * side};

    if (cln_hash((key ^ 0x632BE5ABu) + (uint32_t)slot * 0x9E3779B9u) % SMOOTH_EVERY)
        return false;
    for (int v = 0; v < side * side * side; v++)
        for (int e = 0; e < 6; e++) { /* its edges: up and down each axis */
            const int a = e / 2, to = v / step[a] % side + (e % 2 ? 1 : -1);
            const int other = v + (e % 2 ? step[a] : -step[a]);
            const double area = SMOOTH_EVERY * pow(0.25, level - 5);

            if (!met[v] || to < 0 || to >= side)
                continue;
            for (int f = 0; f < net->features; f++)
                grad[v * net->features + f] +=
                    area * edge_share(net, v, a) *
                    (f == 3 ? config->smooth_density : config->smooth_colour) *
                    smooth_slope(
                        (double)params[v * net->features + f] - params[other * net->features + f],
                        f == 3 ? config->smooth_density_delta : config->smooth_colour_delta);
        }
    return true;
}

void ref_voxel_step(double *param, double grad, double *m, double *v, ref_adam_rule rule)
{
    *v = *v == 0 ? 0.1 * grad * grad : rule.beta2 * *v + (1 - rule.beta2) * grad * grad;
    *m = rule.beta1 * *m + (1 - rule.beta1) * grad;
    *param -= rule.lr * *m / (sqrt(*v) + rule.epsilon);
}
