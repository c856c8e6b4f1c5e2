/* What ranks exchange, packed for messages (host/pipeline/share.c): values of samples in their
 * grouped order, in which each rank's leaves, and so its samples, are a run. */

/* packed[i] = out[order[i]] of grouped samples [first, first + n). */
__kernel void share_pack(const __global float4 *restrict out, /* [sample] */
                         const __global uint *restrict order, /* [grouped sample] -> sample */
                         __global float4 *restrict packed,    /* [grouped sample] */
                         uint first, uint n)
{
    const uint i = get_global_id(0);

    if (i < n)
        packed[first + i] = out[order[first + i]];
}

/* The inverse, for all of n grouped samples except [first, end). */
__kernel void share_unpack(__global float4 *restrict out, const __global uint *restrict order,
                           const __global float4 *restrict packed, uint first, uint end, uint n)
{
    const uint i = get_global_id(0);

    if (i < n && (i < first || i >= end))
        out[order[i]] = packed[i];
}
