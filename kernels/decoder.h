/* needs: network harmonics */
/* The decoder of voxels' colours (method.md 1): one shallow network, shared by all leaves, that
 * adds to the raw colours of a sample. Samples are in lanes, so that every weight is read once for
 * VW of them.
 *
 *   x = (the sample's features but its density, Y_1 .. Y_8 of its direction)      [DECODER_IN]
 *   h = max(0, b + x in),   raw_c += out_c . h
 *
 *   DECODER   width of h; 0: no decoder
 *   Weights: in [DECODER_IN][DECODER], b [DECODER], out [3][DECODER]; row major. */
#ifndef DECODER
#define DECODER 16
#endif
#define DECODER_IN   (FEATURES - 1 + 8)
#define DECODER_B    (DECODER_IN * DECODER)
#define DECODER_OUT  (DECODER_B + DECODER)
#define DECODER_SIZE (DECODER_OUT + 3 * DECODER)
#define DECODER_TILE 8 /* hidden units that share the loads of inputs */

/* The inputs of one sample, x[i * step]; f [FEATURES]: its features. */
HELPER void decoder_inputs(const float *f, float3 direction, int step, float *x)
{
    float y[9];

    for (int i = 0; i < FEATURES; i++)
        if (i != 3)
            x[(i < 3 ? i : i - 1) * step] = f[i];
    harmonics_of(direction, 9, 1, y);
    for (int k = 1; k < 9; k++)
        x[(FEATURES - 2 + k) * step] = y[k];
}

/* h [DECODER], after the activation. */
HELPER void decoder_hidden(const __global float *net, const vf x[DECODER_IN], vf *h)
{
    for (int j = 0; j < DECODER; j += DECODER_TILE) {
        vf sum[DECODER_TILE];

#pragma unroll
        for (int k = 0; k < DECODER_TILE; k++)
            sum[k] = (vf)(net[DECODER_B + j + k]);
        for (int i = 0; i < DECODER_IN; i++)
#pragma unroll
            for (int k = 0; k < DECODER_TILE; k++)
                sum[k] = MAD((vf)(net[i * DECODER + j + k]), x[i], sum[k]);
#pragma unroll
        for (int k = 0; k < DECODER_TILE; k++)
            h[j + k] = select((vf)(0.0f), sum[k], !(sum[k] <= 0.0f)); /* keeps a NaN */
    }
}
