/* What ranks exchange, packed for messages: values of samples in their grouped order, in which each
 * rank's leaves, and so its samples, are a run (host/pipeline/share.c); and intervals of rays, of
 * which each rank has walked a run (host/pipeline/walk.c). */

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

/* packed[starts[r] + k] = interval k of ray r, of rays [first, first + n). */
__kernel void walk_pack(const __global cln_interval *restrict intervals, /* [most][rays] */
                        const __global uint *restrict starts,            /* [ray + 1] */
                        __global cln_interval *restrict packed, uint first, uint n, uint rays)
{
    const uint i = get_global_id(0), r = first + i;

    if (i >= n)
        return;
    for (uint k = 0, at = starts[r]; at < starts[r + 1u]; k++, at++)
        packed[at] = intervals[k * rays + r];
}

/* The inverse, for all rays except [first, end). */
__kernel void walk_unpack(__global cln_interval *restrict intervals,
                          const __global uint *restrict starts,
                          const __global cln_interval *restrict packed, uint first, uint end,
                          uint rays)
{
    const uint r = get_global_id(0);

    if (r >= rays || (r >= first && r < end))
        return;
    for (uint k = 0, at = starts[r]; at < starts[r + 1u]; k++, at++)
        intervals[k * rays + r] = packed[at];
}
