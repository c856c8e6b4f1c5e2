/* The leaf network's layout in memory and its initial weights (method.md sections 1 and 2). Initial
 * weights are a pure function of (seed, matrix, element), the same for every leaf. The split by
 * folding is in fold.c. */
#include "model/network.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/rng.h"
#include "model/encoding.h"

enum { ALIGN_FLOATS = 16, PAD_ROWS = 4 };
static const double GRID_BOUND = 0.1; /* initial features are nearly the same everywhere */

static int round_up(int n, int multiple)
{
    return (n + multiple - 1) / multiple * multiple;
}

/* Appends `floats` to the leaf's block, rounded up so that the next offset is aligned. */
static int take(cln_network *net, int floats)
{
    int offset = net->params;

    net->params += round_up(floats, ALIGN_FLOATS);
    return offset;
}

int cln_network_rows(const cln_network *net, int layer)
{
    if (layer == 0)
        return net->enc_pad;
    return net->width + (layer == net->skip_layer ? net->enc_pad : 0);
}

static cln_status check_shape(const cln_config *c)
{
    if (c->width != 16 && c->width != 32 && c->width != 64 && c->width != 128 && c->width != 256)
        return cln_fail(CLN_USAGE, "width %d: leaf networks are 16, 32, 64, 128 or 256 wide",
                        c->width);
    if (c->depth < 2 || c->depth > 8)
        return cln_fail(CLN_USAGE, "depth %d: leaf networks have 2 to 8 layers", c->depth);
    if (c->view_dependence &&
        (c->view_width < 16 || c->view_width > 256 || c->view_width % ALIGN_FLOATS != 0))
        return cln_fail(CLN_USAGE, "view-width %d: it must be a multiple of 16 from 16 to 256",
                        c->view_width);
    if (c->bands < 1 || c->bands > 10 || c->view_bands < 0 || c->view_bands > 4)
        return cln_fail(CLN_USAGE, "bands %d, view-bands %d: they must be 1 to 10 and 0 to 4",
                        c->bands, c->view_bands);
    if (c->encoding == CLN_ENCODING_FREQUENCY)
        return CLN_OK;
    if (c->grid_cells < 2 || c->grid_cells > 32 || c->grid_cells % 2 != 0)
        return cln_fail(CLN_USAGE,
                        "grid-cells %d: it must be an even number from 2 to 32, so that "
                        "vertices of a leaf are vertices of its children",
                        c->grid_cells);
    if (c->encoding == CLN_ENCODING_VOXEL && c->grid_cells > CLN_VOXEL_CELLS)
        return cln_fail(CLN_USAGE,
                        "grid-cells %d: leaves have at most %d voxels along an axis; for "
                        "finer voxels, give smaller leaves (--level-at, --max-level)",
                        c->grid_cells, CLN_VOXEL_CELLS);
    if (c->encoding == CLN_ENCODING_VOXEL && c->decoder_width % ALIGN_FLOATS != 0)
        return cln_fail(CLN_USAGE, "decoder-width %d: it is 0 (no decoder), 16, 32, 48 or 64",
                        c->decoder_width);
    if (c->encoding == CLN_ENCODING_VOXEL)
        return CLN_OK;
    if (c->grid_features < 4 || c->grid_features > 16 || c->grid_features % PAD_ROWS != 0)
        return cln_fail(CLN_USAGE, "grid-features %d: it must be 4, 8, 12 or 16", c->grid_features);
    if (c->skip && c->depth >= 6)
        return cln_fail(CLN_USAGE, "skip: networks on a grid have no skip connection; give "
                                   "--no-skip, or --encoding frequency");
    return CLN_OK;
}

/* Voxels: no layers, only a grid (encoding_voxel.h). */
static void layout_voxels(const cln_config *config, cln_network *net)
{
    static const int features[] = {4, 16, 32}, learned[] = {4, 13, 28};
    const int degree = config->view_dependence ? config->harmonics : 0;
    const int vertices = cln_encoding_vertices(config->grid_cells);

    net->encoding = CLN_ENCODING_VOXEL;
    net->skip_layer = net->view_w = net->view_b = -1;
    net->depth = 1;
    net->bands = 1;
    net->cells = config->grid_cells;
    net->features = net->width = net->colour_width = features[degree];
    take(net, vertices * net->features);
    if (config->view_dependence && config->decoder_width > 0) {
        const int in = net->features - 1 + CLN_DECODER_HARMONICS;

        net->decoder = config->decoder_width;
        net->decoder_params = net->decoder * (in + 1 + 3);
    }
    net->learned = vertices * (net->decoder ? net->features : learned[degree]);
}

cln_status cln_network_layout(const cln_config *config, cln_network *out)
{
    cln_status st = CLN_OK;
    cln_network net = {0};
    int w = config->width;

    CLN_TRY(check_shape(config));
    if (config->encoding == CLN_ENCODING_VOXEL) {
        layout_voxels(config, &net);
        *out = net;
        goto done;
    }
    net.width = w;
    net.depth = config->depth;
    net.bands = config->bands;
    net.view_dependence = config->view_dependence;
    net.view_width = config->view_dependence ? config->view_width : 0;
    net.view_bands = config->view_dependence ? config->view_bands : 0;
    net.skip_layer = config->skip && config->depth >= 6 ? config->depth / 2 + 1 : -1;
    net.encoding = config->encoding;
    if (net.encoding == CLN_ENCODING_GRID) {
        net.cells = config->grid_cells;
        net.features = config->grid_features;
    }
    net.enc = net.features > 0 ? net.features : cln_encoding_rows(net.bands);
    net.enc_pad = round_up(net.enc, PAD_ROWS);
    net.dir = net.view_dependence ? cln_encoding_rows(net.view_bands) : 0;
    net.dir_pad = round_up(net.dir, PAD_ROWS);
    net.colour_width = net.view_dependence ? net.view_width : w;
    for (int i = 0; i < net.depth; i++) {
        int rows = cln_network_rows(&net, i);
        net.trunk_w[i] = take(&net, rows * w);
        net.trunk_b[i] = take(&net, w);
        net.learned += (i == 0 ? net.enc : rows - (rows > w ? net.enc_pad - net.enc : 0)) * w + w;
    }
    net.sigma_w = take(&net, w);
    net.sigma_b = take(&net, 1);
    net.learned += w + 1;
    net.view_w = net.view_b = -1;
    if (net.view_dependence) {
        net.view_w = take(&net, (w + net.dir_pad) * net.view_width);
        net.view_b = take(&net, net.view_width);
        net.learned += (w + net.dir) * net.view_width + net.view_width;
    }
    net.colour_w = take(&net, 3 * net.colour_width);
    net.colour_b = take(&net, 3);
    net.learned += 3 * net.colour_width + 3;
    net.grid_w = net.params;
    if (net.encoding == CLN_ENCODING_GRID) {
        const int numbers = cln_encoding_vertices(net.cells) * net.features;

        take(&net, numbers);
        net.learned += numbers;
    }
    *out = net;
done:
    return st;
}

double cln_network_learned(const cln_network *net, int leaves)
{
    return (double)leaves * net->learned + net->decoder_params;
}

void cln_network_text(const cln_network *net, char out[32])
{
    if (net->encoding == CLN_ENCODING_VOXEL) {
        const int used = snprintf(out, 32, "X%dx%d", net->cells, net->features);

        if (net->decoder)
            snprintf(out + used, (size_t)(32 - used), "-D%d", net->decoder);
        return;
    }
    const int used = snprintf(out, 32, "W%d-D%d-V%d", net->width, net->depth, net->view_width);

    if (net->encoding == CLN_ENCODING_GRID)
        snprintf(out + used, (size_t)(32 - used), "-G%dx%d", net->cells, net->features);
}

/* Fills `out` with uniform random numbers in +-bound; block: number of the matrix or bias in the
 * network. */
static void fill_uniform(const cln_config *config, int block, int count, double bound, float *out)
{
    float u[4];

    for (int i = 0; i < count; i++) {
        if (i % 4 == 0)
            cln_uniform4((uint64_t)config->seed, CLN_STREAM_INIT, 0, (uint32_t)(i / 4),
                         (uint32_t)block, u);
        out[i] = (float)(bound * (2.0 * u[i % 4] - 1.0));
    }
}

/* Kaiming-uniform keeps the activations' second moment: a leaky activation with a slope r uniform
 * in [lower, upper] multiplies it by (1 + E[r^2]) / 2. */
static double weight_bound(const cln_config *config, int fan_in)
{
    double mean = (config->rrelu_lower + config->rrelu_upper) / 2;
    double range = config->rrelu_upper - config->rrelu_lower;
    double gain = sqrt(2 / (1 + mean * mean + range * range / 12));

    return config->init == CLN_INIT_FAN_IN ? 1 / sqrt(fan_in) : gain * sqrt(3.0 / fan_in);
}

void cln_network_init(const cln_network *net, const cln_config *config, float *params)
{
    int w = net->width, block = 0;

    memset(params, 0, (size_t)net->params * sizeof *params);
    if (net->encoding == CLN_ENCODING_VOXEL)
        return;
    for (int i = 0; i < net->depth; i++) {
        int rows = i == 0 ? net->enc : i == net->skip_layer ? w + net->enc : w;
        fill_uniform(config, block++, rows * w, weight_bound(config, rows),
                     params + net->trunk_w[i]);
        fill_uniform(config, block++, w, 1 / sqrt(rows), params + net->trunk_b[i]);
    }
    /* Nearly flat: the density starts at the activation's bias everywhere. */
    fill_uniform(config, block++, w, 0.1 * weight_bound(config, w), params + net->sigma_w);
    if (net->view_dependence) {
        int rows = w + net->dir;
        fill_uniform(config, block++, rows * net->view_width, weight_bound(config, rows),
                     params + net->view_w);
        fill_uniform(config, block++, net->view_width, 1 / sqrt(rows), params + net->view_b);
    }
    fill_uniform(config, block++, 3 * net->colour_width, sqrt(6.0 / (net->colour_width + 3)),
                 params + net->colour_w);
    if (net->encoding == CLN_ENCODING_GRID)
        fill_uniform(config, block, cln_encoding_vertices(net->cells) * net->features, GRID_BOUND,
                     params + net->grid_w);
}

void cln_decoder_init(const cln_network *net, const cln_config *config, float *params)
{
    const int in = net->features - 1 + CLN_DECODER_HARMONICS;

    memset(params, 0, (size_t)net->decoder_params * sizeof *params);
    fill_uniform(config, 0, in * net->decoder, sqrt(6.0 / in), params);
    fill_uniform(config, 1, net->decoder, 1 / sqrt(in), params + in * net->decoder);
}

bool cln_decoder_adds(const cln_network *net, const float *params)
{
    for (int i = net->decoder_params - 3 * net->decoder; i < net->decoder_params; i++)
        if (params[i] != 0)
            return true;
    return false;
}

double cln_network_density_bias(const cln_config *config)
{
    double y = config->initial_depth / (config->density_scale * 2); /* the root cube is 2 wide */

    switch (config->density) {
    case CLN_DENSITY_RELU:
        return y;
    case CLN_DENSITY_EXP:
        return log(y);
    default:
        return y + log(-expm1(-y)); /* log(expm1(y)) without overflow */
    }
}
