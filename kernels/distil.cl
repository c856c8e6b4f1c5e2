/* The gradient of a merge's distillation (method.md 11; twin: host/reference/points.c): a new leaf
 * learns the old ones' values at points, without rays.
 *
 *   loss = mean (alpha - alpha*)^2 + alpha* |c - c*|^2 / 3,   alpha = 1 - exp(-sigma delta)
 *
 * with the sample's delta, a thirty-second of the leaf's diagonal. Each sample has a ray of its
 * own (t = 0), which is also the index of its target. */

__kernel void distil_gradient(const __global cln_sample *restrict samples, /* [sample] */
                              const __global float4 *restrict out,     /* [sample] r g b sigma */
                              const __global float4 *restrict targets, /* [ray] r g b alpha */
                              __global float4 *restrict dout,              /* [sample] */
                              __global float *restrict losses,             /* [sample] */
                              uint n, float scale)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    const float4 o = out[i], target = targets[samples[i].ray];
    const float tau = fmin(o.w * samples[i].delta, CLN_MAX_OPTICAL_DEPTH);
    const float miss = ONE_MINUS_EXP(float, tau) - target.w;
    float4 d = o - target;

    d.w = 0.0f;
    losses[i] = miss * miss + target.w * dot(d, d) * (1.0f / 3.0f);
    d *= target.w * (2.0f / 3.0f);
    d.w = 2.0f * miss * samples[i].delta * exp(-tau);
    dout[i] = d * scale;
}
