/* needs: rng */
/* Regularisers of points of the volume (method.md 10): extra samples after those of the rays, in
 * the same networks and gradients. An extra ray carries the position (t = 0) and a direction; both
 * samples of an edge pair share one.
 *
 *   sparsity  lambda mean(1 - exp(-0.05 sigma)) at random points of random leaves
 *   edge      lambda mean U |f_a - f_b|, f = alpha (r, g, b, 1), alpha over one stage-1 spacing, at
 *             random points of faces that two ACTIVE leaves a, b share
 *
 *   samples: [rays' ... | points | a of every pair | b of every pair]
 */

#define SPARSITY_LENGTH 0.05f

HELPER int slot_at(const __global int *map, int depth, float3 p)
{
    const int n = 1 << depth;
    const int3 c = convert_int3(floor((p + 1.0f) * (0.5f * (float)n)));

    if (c.x < 0 || c.y < 0 || c.z < 0 || c.x >= n || c.y >= n || c.z >= n)
        return -1;
    return CLN_MAP_SLOT(map[(c.z * n + c.y) * n + c.x]);
}

__kernel void regularise_points(const __global float4 *restrict boxes,
                                const __global int *restrict map,
                                __global float4 *restrict ray_o, __global float4 *restrict ray_d,
                                __global cln_sample *restrict samples, uint first_ray,
                                uint first_sample, uint points, uint pairs, uint leaves, int depth,
                                uint2 seed, uint step)
{
    const uint i = get_global_id(0);

    if (i >= points + pairs)
        return;
    const float4 u = uniform4(seed, STREAM_POINTS, step, i, 0u);
    const float4 v = uniform4(seed, STREAM_POINTS, step, i, 1u);
    const uint leaf = min((uint)(u.w * (float)leaves), leaves - 1u);
    const float4 box = boxes[leaf];
    const float z = 2.0f * v.x - 1.0f, r = sqrt(fmax(1.0f - z * z, 0.0f));
    float3 p = box.xyz + u.xyz * box.w;
    int other = (int)leaf;

    /* onto one of the six faces; without a neighbour the leaf is paired with itself */
    if (i >= points) {
        const int face = min((int)(v.z * 6.0f), 5), axis = face >> 1;
        const float side = (float)(face & 1), out = 1e-3f * box.w * (2.0f * side - 1.0f);
        float3 beyond;

        ((float *)&p)[axis] = ((const float *)&box)[axis] + side * box.w;
        beyond = p;
        ((float *)&beyond)[axis] += out;
        other = slot_at(map, depth, beyond);
        if (other < 0)
            other = (int)leaf;
    }
    ray_o[first_ray + i] = (float4)(p, 0.0f);
    ray_d[first_ray + i] = (float4)(r * cospi(2.0f * v.y), r * sinpi(2.0f * v.y), z, 1.0f);
    const cln_sample a = {0.0f, 0.0f, first_ray + i, (int)leaf};

    samples[first_sample + i] = a;
    if (i >= points) {
        const cln_sample b = {0.0f, 0.0f, first_ray + i, other};

        samples[first_sample + i + pairs] = b;
    }
}

__kernel void regularise_gradient(const __global cln_sample *restrict samples,
                                  const __global float4 *restrict boxes,
                                  const __global float4 *restrict out,
                                  __global float4 *restrict dout, uint first_sample, uint points,
                                  uint pairs, float n1, float sparsity, float edge, uint2 seed,
                                  uint step)
{
    const uint i = get_global_id(0), at = first_sample + i;

    if (i >= points + pairs)
        return;
    if (i < points) {
        dout[at] = (float4)(0.0f, 0.0f, 0.0f,
                            sparsity * SPARSITY_LENGTH * exp(-SPARSITY_LENGTH * out[at].w) /
                                (float)points);
        return;
    }
    const float4 a = out[at], b = out[at + pairs];
    const float sa = boxes[samples[at].slot].w / n1, sb = boxes[samples[at + pairs].slot].w / n1;
    const float spacing = fmin(sa, sb);
    const float xa = spacing * a.w, xb = spacing * b.w, ta = exp(-xa), tb = exp(-xb);
    const float alpha = ONE_MINUS_EXP(float, xa), beta = ONE_MINUS_EXP(float, xb);
    const float4 fa = alpha * (float4)(a.xyz, 1.0f), fb = beta * (float4)(b.xyz, 1.0f);
    const float u = uniform4(seed, STREAM_POINTS, step, i, 1u).w;
    const float4 g = sign(fa - fb) * (edge * u * 0.25f / (float)pairs);

    dout[at] = (float4)(g.xyz * alpha, spacing * ta * (dot(g.xyz, a.xyz) + g.w));
    dout[at + pairs] = (float4)(-g.xyz * beta, -spacing * tb * (dot(g.xyz, b.xyz) + g.w));
}
