/* Least work of each stage, for the benches' rates.
 *
 *   FLOP   The method's arithmetic: a multiply-add is 2; exp, sqrt and divide are 1 each. Networks:
 *          2 per weight (and bias) and sample forward; backward the same for the inputs' gradients
 *          (without the encodings') and the same for the weights'. Encodings, activations, padding
 *          and repeated work do not count. Selecting and moving data (scan, sort, rays, tree
 *          walk, projection) is 0 FLOP.
 *   bytes  The least traffic: every input read once, every output written once, regardless of
 *          passes, caches and write-allocation. A share of the copy ceiling above 1 means that the
 *          data stayed in caches.
 *
 * Struct sizes are include/device_abi.h's: sample 16, interval 20, ray 32 (two float4), pixel 16,
 * result 32. */
#include <math.h>

#include "bench.h"

enum { SAMPLE = 16, INTERVAL = 20, RAY = 32, PIXEL = 16, RESULT = 32, COLOUR = 16, WORD = 4 };

/* Weights of the layers, which every sample uses. It uses only 8 corners of a grid (grid_flop). */
static double layer_weights(const cln_network *net)
{
    const double edge = net->cells + 1;

    if (net->encoding == CLN_ENCODING_VOXEL) /* the harmonics' sums, and the decoder */
        return net->decoder_params + (net->features > 4 ? 3.0 * (net->features > 16 ? 8 : 3) : 0);
    return net->learned - (net->cells > 0 ? edge * edge * edge * net->features : 0);
}

/* One sample's trilinear interpolation, or its gradient's way back to the corners. */
static double grid_flop(const cln_network *net)
{
    return 2.0 * 8 * net->features;
}

/* Numbers of a leaf that its samples use, on average: all of a network's; of voxels those at the
 * corners of that many random cells, each vertex counted once. */
static double met_numbers(const cln_network *net, double samples)
{
    const double edge = net->cells + 1, vertices = edge * edge * edge;

    if (net->encoding != CLN_ENCODING_VOXEL)
        return net->params;
    return vertices * -expm1(samples * log1p(-8 / vertices)) * net->features;
}

static double density_weights(const cln_network *net)
{
    double n = layer_weights(net) - 3.0 * net->colour_width - 3;

    if (net->encoding == CLN_ENCODING_VOXEL)
        return 0;
    if (net->view_dependence)
        n -= (double)(net->width + net->dir + 1) * net->view_width;
    return n;
}

bench_work bench_work_density(const cln_network *net, double cells, double leaves)
{
    return (bench_work){
        .flop = (2 * density_weights(net) + grid_flop(net)) * cells,
        .bytes =
            2 * cells + leaves * WORD * (density_weights(net) + net->learned - layer_weights(net))};
}

bench_work bench_work_forward(const cln_network *net, const cln_tune *tune, bool training, double n,
                              double leaves, double slices)
{
    const double kept = training ? (double)cln_pipeline_act_bytes(net, tune) : 0;

    return (bench_work){.flop = (2 * layer_weights(net) + grid_flop(net)) * n,
                        .bytes = n * (SAMPLE + WORD + RAY + COLOUR + kept) +
                                 slices * (double)sizeof(cln_slice) +
                                 leaves * WORD * met_numbers(net, n / leaves)};
}

/* Without groups and slices. */
bench_work bench_work_in_order(const cln_network *net, double n, double rays, double leaves)
{
    return (bench_work){.flop = (2 * layer_weights(net) + grid_flop(net)) * n,
                        .bytes = n * (SAMPLE + COLOUR) + rays * RAY +
                                 leaves * WORD * met_numbers(net, n / leaves)};
}

bench_work bench_work_backward(const cln_network *net, const cln_tune *tune, double n,
                               double leaves, double slices)
{
    /* No gradient reaches an encoding, except a grid's features. */
    const double position = net->cells > 0 ? 0 : (double)net->enc * net->width;
    const double encoded = position * (net->skip_layer >= 0 ? 2 : 1) +
                           (net->view_dependence ? (double)net->dir * net->view_width : 0) +
                           (double)CLN_DECODER_HARMONICS * net->decoder;
    const double transposed = tune->leaf ? 0 : cln_pipeline_transposed(net);
    const double layers = net->encoding == CLN_ENCODING_VOXEL ? 0 : net->params; /* read again */

    return (bench_work){
        .flop = (4 * layer_weights(net) - 2 * encoded + grid_flop(net)) * n,
        .bytes =
            n * (SAMPLE + WORD + RAY + 2 * COLOUR + (double)cln_pipeline_act_bytes(net, tune)) +
            n * 2 * WORD * (net->decoder ? net->features : 0) +
            leaves * WORD * (layers + transposed) +
            slices * ((double)sizeof(cln_slice) + WORD * met_numbers(net, n / slices))};
}

/* 13 per weight (two moments 7, the step 6) plus the slices' sum. Voxels: only numbers that samples
 * used, without the first moment if beta1 is 0. */
bench_work bench_work_adam(const cln_config *config, const cln_network *net, const cln_tune *tune,
                           double n, double leaves, double slices)
{
    const double weights = leaves * met_numbers(net, n / leaves);
    const bool one = net->encoding == CLN_ENCODING_VOXEL && config->beta1 <= 0;
    const double transposed = tune->leaf ? 0 : cln_pipeline_transposed(net);

    return (bench_work){
        .flop = (one ? 10 : 13) * weights + (slices - leaves) * net->params,
        .bytes = weights * (2 * WORD + (one ? 2.0 : 4.0) * (double)cln_moment_bytes(config)) +
                 WORD * (slices * met_numbers(net, n / slices) + leaves * transposed)};
}

/* In: number, colour, density and gradient of every sample. Out: head gradient and row of about
 * half of them. */
bench_work bench_work_roulette(double n)
{
    return (bench_work){.flop = 40 * n, .bytes = WORD * n * (1 + 4 + 4 + 0.5 * (4 + 1))};
}

/* Backward and Adam; gradients of one-slice leaves do not pass through memory. */
bench_work bench_work_update(const cln_config *config, const cln_network *net, const cln_tune *tune,
                             double n, double leaves, double slices)
{
    const bench_work back = bench_work_backward(net, tune, n, leaves, slices);
    const bench_work adam = bench_work_adam(config, net, tune, n, leaves, slices);
    const double saved = net->encoding == CLN_ENCODING_VOXEL ? 0 : tune->leaf ? 2 * leaves : leaves;

    return (bench_work){.flop = back.flop + adam.flop,
                        .bytes =
                            back.bytes + adam.bytes - WORD * saved * met_numbers(net, n / leaves)};
}

/* Weights and both moments from host to device, the weights once more for their transposed copy. */
bench_work bench_work_upload(const cln_config *config, const cln_network *net, double leaves)
{
    const double moments = 4 * (double)cln_moment_bytes(config); /* two, read and written */

    return (bench_work){.bytes = leaves * (net->params * (3 * WORD + moments) +
                                           WORD * cln_pipeline_transposed(net))};
}

/* Weights, both moments and densities of the leaves, read and written. */
bench_work bench_work_carry(const cln_config *config, const cln_network *net, double leaves)
{
    const double moments = 2 * (double)cln_moment_bytes(config);
    const double cells = (double)config->n1 * config->n1 * config->n1;

    return (bench_work){.bytes = 2 * leaves * (net->params * (WORD + moments) + WORD / 2 * cells)};
}

bench_work bench_work_scan(double n)
{
    return (bench_work){.bytes = WORD * (2 * n + 1)};
}

/* Counts a single pass. */
bench_work bench_work_sort(double n, bool wide)
{
    return (bench_work){.bytes = 2 * n * (WORD + (wide ? 8 : 4))};
}

bench_work bench_work_group(double n, double leaves, double slices)
{
    return (bench_work){.bytes = n * (SAMPLE + WORD) + leaves * 3 * WORD +
                                 slices * (double)sizeof(cln_slice)};
}

bench_work bench_work_rays(double rays)
{
    return (bench_work){.bytes = rays * (PIXEL + RAY)};
}

/* cells: of stage 1, 2 bytes each; at most all of them and at most n1 per interval. */
bench_work bench_work_intervals(double rays, double intervals, double cells)
{
    return (bench_work){.bytes = rays * (RAY + 3 * WORD) + intervals * INTERVAL + 2 * cells};
}

bench_work bench_work_samples(double rays, double intervals, double cells, double n)
{
    return (bench_work){.bytes = rays * (RAY + 2 * WORD) + intervals * INTERVAL + 2 * cells +
                                 n * SAMPLE};
}

/* Every view looks at every cell. */
bench_work bench_work_project(double cells, double views, double entries)
{
    return (bench_work){.bytes = views * 2 * cells + entries * (8 + WORD)};
}

/* In: keys and values. Out: the lists' depths, densities, starts and lengths; padded: again. */
bench_work bench_work_lists(double entries, double cells, double lists, double padded)
{
    return (bench_work){.bytes = entries * (8 + WORD + 2 * WORD) + 2 * cells + lists * 2 * WORD +
                                 padded * 2 * WORD};
}

/* Per sample: depth 1, alpha 2, weight 1, colour 8, distance 2, opacity 1, transmittance 2. */
bench_work bench_work_composite(double rays, double n)
{
    return (bench_work){.flop = 17 * n,
                        .bytes = n * (SAMPLE + COLOUR) + rays * (WORD + RAY / 2 + RESULT)};
}

/* As above, without distance, opacity and depth. */
bench_work bench_work_composite_pixels(double rays, double n)
{
    return (bench_work){.flop = 14 * n,
                        .bytes = n * (SAMPLE + COLOUR) + rays * (WORD + PIXEL + 2 * COLOUR)};
}

/* Backward, per sample: weight 1, gain 5, colours 4, density 6, rest 2, scale 4; per measure 5. */
bench_work bench_work_composite_train(double rays, double n, double measures)
{
    return (bench_work){.flop = (17 + 22 + 5 * measures) * n,
                        .bytes = n * (SAMPLE + 2 * COLOUR + WORD * measures) +
                                 rays * (WORD + COLOUR + RESULT)};
}

bench_work bench_work_seen(double cells, double views)
{
    return (bench_work){.bytes = cells + views * (double)sizeof(cln_device_camera)};
}

bench_work bench_work_stats(double cells, double leaves)
{
    return (bench_work){.bytes = 3 * cells + leaves * 2 * WORD};
}

bench_work bench_work_leaf_measure(double n, double leaves, double measures)
{
    return (bench_work){.flop = n * measures,
                        .bytes =
                            n * WORD * (1 + measures) + leaves * WORD * (2 + 2 + 4 * measures)};
}

/* Per point: alpha 3, miss 1, differences 3, loss 9, gradients 13. */
bench_work bench_work_distil(double n)
{
    return (bench_work){.flop = 29 * n, .bytes = n * (SAMPLE + 3 * COLOUR + WORD)};
}

bench_work bench_work_points(double points, double pairs)
{
    return (bench_work){.bytes = (points + pairs) * RAY + (points + 2 * pairs) * SAMPLE};
}

bench_work bench_work_points_gradient(double points, double pairs)
{
    return (bench_work){.bytes = points * 2 * COLOUR + pairs * 2 * (SAMPLE + 2 * COLOUR)};
}
