/* The FMA ceiling, for benches alone: what the arithmetic units can do with vectors of VW floats, so that
 * a kernel's rate has its limit beside it.
 *
 * Rules that keep the figure honest: CHAINS independent accumulators hide the latency of an FMA; the
 * result depends on all of them and is stored; the factor is not a constant, or the loop would fold.
 */
#define CHAINS 12

__kernel void peak_fma(__global float *restrict out, float factor, int rounds)
{
    vf acc[CHAINS];
    vf sum = (vf)(0.0f);
    const vf f = (vf)(factor);

#pragma unroll
    for (int i = 0; i < CHAINS; i++)
        acc[i] = (vf)((float)(i + 1) + (float)get_global_id(0));
    for (int r = 0; r < rounds; r++)
#pragma unroll
        for (int i = 0; i < CHAINS; i++)
            acc[i] = MAD(acc[i], f, f);
#pragma unroll
    for (int i = 0; i < CHAINS; i++)
        sum += acc[i];
    out[get_global_id(0)] = V_SUM(sum);
}
