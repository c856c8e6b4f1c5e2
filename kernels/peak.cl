/* The two ceilings beside which benches show a kernel's rate: arithmetic with vectors of VW floats,
 * and memory bandwidth. Not part of training.
 *
 *   VW      floats of a vector     (lanes.h)
 *   CHAINS  1 | 2 | ...            independent accumulators
 *
 * Rules that keep the figures honest:
 *   CHAINS accumulators hide the latency of an FMA, if they are enough and fit into the registers:
 *   which shape is fastest depends on the processor, so the benches try several and take the best;
 *   the stored result depends on all of them; the factor is not a constant, or the compiler would
 *   fold the loop
 *   the copy goes through more memory than any cache holds (the host ensures it); neighbouring
 *   work-items touch neighbouring vectors, a lone one goes straight through memory
 */
#ifndef CHAINS
#define CHAINS 12
#endif

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

/* Each group copies local_size * rounds vectors. */
__kernel void peak_copy(const __global float *restrict in, __global float *restrict out, int rounds)
{
    const size_t local_size = get_local_size(0);
    size_t at = get_group_id(0) * local_size * (size_t)rounds + get_local_id(0);

    for (int r = 0; r < rounds; r++, at += local_size)
        VSTORE(VLOAD(in + at * VW), out + at * VW);
}
