/* Prefix sums and a stable radix sort, the two primitives under grouping and splatting (method.md 6, 8).
 * One work-item takes one chunk of consecutive elements in turn, so the result does not depend on how
 * many run at once.
 *
 *   scan:  out[i] = sum of in[0 .. i-1], out[n] = the total          (in may be out; n + 1 outputs)
 *   sort:  LSD radix, 8 bits a pass, values travel with their keys; equal keys keep their order
 *
 *   counts of a pass, digit-major: counts[digit][chunk]; its scan is where each chunk's digit goes
 *
 * KEY_BITS  32 | 64: width of the sort's keys
 */
#ifndef KEY_BITS
#define KEY_BITS 32
#endif
#if KEY_BITS == 64
typedef ulong key_type;
#else
typedef uint key_type;
#endif
#define DIGITS 256u

__kernel void scan_sums(const __global uint *restrict in, /* [n] */
                        __global uint *restrict sums,     /* [ceil(n / chunk)] */
                        uint n, uint chunk)
{
    const uint c = get_global_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint sum = 0;

    if (begin >= n)
        return;
    for (uint i = begin; i < end; i++)
        sum += in[i];
    sums[c] = sum;
}

/* One work-item: exclusive scan of the chunks' sums in place. */
__kernel void scan_chunks(__global uint *restrict sums, uint chunks)
{
    uint sum = 0;

    if (get_global_id(0) != 0)
        return;
    for (uint i = 0; i < chunks; i++) {
        const uint value = sums[i];

        sums[i] = sum;
        sum += value;
    }
}

__kernel void scan_write(const __global uint *in,            /* [n], may be out */
                         const __global uint *restrict sums, /* [chunks] scanned */
                         __global uint *out,                 /* [n + 1] */
                         uint n, uint chunk)
{
    const uint c = get_global_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint sum;

    if (begin >= n)
        return;
    sum = sums[c];
    for (uint i = begin; i < end; i++) {
        const uint value = in[i];

        out[i] = sum;
        sum += value;
    }
    if (end == n)
        out[n] = sum;
}

__kernel void sort_count(const __global key_type *restrict keys, /* [n] */
                         __global uint *restrict counts,         /* [DIGITS][chunks] */
                         uint n, uint chunk, uint chunks, uint shift)
{
    const uint c = get_global_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint digits[DIGITS];

    if (c >= chunks)
        return;
    for (uint d = 0; d < DIGITS; d++)
        digits[d] = 0;
    for (uint i = begin; i < end; i++)
        digits[(uint)(keys[i] >> shift) & (DIGITS - 1u)]++;
    for (uint d = 0; d < DIGITS; d++)
        counts[d * chunks + c] = digits[d];
}

__kernel void sort_scatter(const __global key_type *restrict keys, const __global uint *restrict values,
                           const __global uint *restrict starts, /* [DIGITS][chunks] scanned */
                           __global key_type *restrict keys_out, __global uint *restrict values_out,
                           uint n, uint chunk, uint chunks, uint shift)
{
    const uint c = get_global_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint digits[DIGITS];

    if (c >= chunks)
        return;
    for (uint d = 0; d < DIGITS; d++)
        digits[d] = starts[d * chunks + c];
    for (uint i = begin; i < end; i++) {
        const key_type key = keys[i];
        const uint to = digits[(uint)(key >> shift) & (DIGITS - 1u)]++;

        keys_out[to] = key;
        values_out[to] = values[i];
    }
}
