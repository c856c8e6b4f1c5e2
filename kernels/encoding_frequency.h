/* needs: network space */
/* The frequency encoding (method.md 1): the networks' input in place of a position or a direction.
 * ENCODING 0; the other encoding of positions is encoding_grid.h.
 *
 *   encode_position()   local positions -> inputs of the trunk's first layer, and of layer SKIP
 *   encode_direction()  directions -> inputs of the view layer, beside the trunk's outputs
 *
 * An encoding is stored by row, [rows][NB], so that lanes run over samples when it is computed; a
 * layer reads it with the operand by_row() (layer.h). It has no parameters, and nothing needs
 * gradients of positions, so it has no backward pass.
 *
 * BANDS, VIEW_BANDS     of positions and of directions
 * ENC_PAD, DIR_PAD      rows, 3 + 6 bands, up to a multiple of 4
 * BANDS_BY_LEVEL 0 | 1  1: leaves of deeper levels lack the highest bands
 */

/* sin and cos of |x| <= 1, to 2e-7: Taylor to x^11 and x^12. */
HELPER vf sin_unit(vf x)
{
    const vf q = x * x;
    vf p = MAD(q, (vf)(-2.5052108e-8f), (vf)(2.7557319e-6f));

    p = MAD(p, q, (vf)(-1.9841270e-4f));
    p = MAD(p, q, (vf)(8.3333333e-3f));
    p = MAD(p, q, (vf)(-1.6666667e-1f));
    return MAD(p * q, x, x);
}

HELPER vf cos_unit(vf x)
{
    const vf q = x * x;
    vf p = MAD(q, (vf)(2.0876757e-9f), (vf)(-2.7557319e-7f));

    p = MAD(p, q, (vf)(2.4801587e-5f));
    p = MAD(p, q, (vf)(-1.3888889e-3f));
    p = MAD(p, q, (vf)(4.1666667e-2f));
    p = MAD(p, q, (vf)(-0.5f));
    return MAD(p, q, (vf)(1.0f));
}

/* x [3][NB] of the first `rows` samples -> out [pad][NB]: rows 0 .. 2 are x, row 3 + 6k + a is the
 * sine and row 6 + 6k + a the cosine of 2^k x_a, the rest is zero. A band doubles the angle of the
 * band before; every sixth is computed directly, so that rounding errors stay below 2^5 ulp. level:
 * of the leaf. */
HELPER void encode(const __local float *x, int bands, int level, __local float *out, int pad,
                   int rows, int lid)
{
    (void)level;
    for (int s = lid * VW; s < rows; s += STEP_N) {
#pragma unroll
        for (int a = 0; a < 3; a++) {
            const vf value = VLOAD(x + a * NB + s);
            vf sine = sin_unit(value), cosine = cos_unit(value);

            VSTORE_IN(__local, value, out + a * NB + s);
#pragma unroll
            for (int k = 0; k < bands; k++) {
                if (k > 0 && k % 6 == 0) {
                    sine = SIN(value * (float)(1 << k));
                    cosine = COS(value * (float)(1 << k));
                } else if (k > 0) {
                    const vf twice = 2.0f * sine;

                    sine = twice * cosine;
                    cosine = MAD(twice * -0.5f, twice, (vf)(1.0f));
                }
#if BANDS_BY_LEVEL
                const float weight = clamp((float)(11 - level - k), 0.0f, 1.0f);
#else
                const float weight = 1.0f;
#endif
                VSTORE_IN(__local, sine * weight, out + (3 + 6 * k + a) * NB + s);
                VSTORE_IN(__local, cosine * weight, out + (6 + 6 * k + a) * NB + s);
            }
        }
        for (int row = 3 + 6 * bands; row < pad; row++)
            VSTORE_IN(__local, (vf)(0.0f), out + row * NB + s);
    }
}

/* The leaf's box gives its level. */
#if ENCODING == 0
HELPER void encode_position(const __local float *at, float4 box, const __global float *w,
                            __local float *enc, int rows, int lid)
{
    (void)w;
    encode(at, BANDS, leaf_level(box), enc, ENC_PAD, rows, lid);
}
#endif

#if VIEW > 0
HELPER void encode_direction(const __local float *along, __local float *dir, int rows, int lid)
{
    encode(along, VIEW_BANDS, 0, dir, DIR_PAD, rows, lid);
}
#endif
