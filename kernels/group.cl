/* Groups samples by leaf, so that a work-group reads one leaf's weights (method.md 8). After a
 * stable sort by slot, each leaf has one run of samples. A run is cut into as few slices as
 * possible of at most `slice` samples, of about equal length, and all but the leaf's last are whole
 * blocks of `block` samples (NB of the networks). `slice` is an even number of blocks, so that with
 * several slices none but the last is shorter than half of it.
 *
 *   keys -> (scan.cl's sort) -> bounds -> slice counts -> (scan) -> slices
 *
 * The host knows only a bound on the number of slices: empty ones fill the rest of the list. */

__kernel void group_keys(const __global cln_sample *restrict samples, __global uint *restrict keys,
                         __global uint *restrict values, uint n)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    keys[i] = (uint)samples[i].slot;
    values[i] = i;
}

/* begin[slot], end[slot] of the sorted keys; slots without samples keep their zeros. */
__kernel void group_bounds(const __global uint *restrict keys, __global uint *restrict begin,
                           __global uint *restrict end, uint n)
{
    const uint i = get_global_id(0);

    if (i >= n)
        return;
    if (i == 0 || keys[i - 1u] != keys[i])
        begin[keys[i]] = i;
    if (i == n - 1u || keys[i + 1u] != keys[i])
        end[keys[i]] = i + 1u;
}

/* Counts the slices of the `own` leaves from `first` on, whose weights are on this device. */
__kernel void group_slice_counts(const __global uint *restrict begin,
                                 const __global uint *restrict end,
                                 __global uint *restrict counts, uint leaves, uint slice,
                                 uint first, uint own)
{
    const uint leaf = get_global_id(0);

    if (leaf < leaves)
        counts[leaf] = leaf - first < own ? (end[leaf] - begin[leaf] + slice - 1u) / slice : 0u;
}

__kernel void group_slices(const __global uint *restrict begin, const __global uint *restrict end,
                           const __global uint *restrict starts, /* [leaf + 1] */
                           __global cln_slice *restrict slices, /* [most] */
                           uint leaves, uint block, uint most)
{
    const uint leaf = get_global_id(0);

    if (leaf < most && leaf >= starts[leaves]) {
        const cln_slice none = {0, 0u, 0u, 0u};

        slices[leaf] = none;
    }
    if (leaf >= leaves)
        return;
    const uint first = starts[leaf], count = starts[leaf + 1u] - first;
    const uint blocks = (end[leaf] - begin[leaf] + block - 1u) / block;

    /* longer ones last, as the last one is cut short */
    for (uint s = 0, at = begin[leaf]; s < count; s++) {
        const uint whole = (blocks / count + (s >= count - blocks % count)) * block;
        const cln_slice out = {(int)leaf, at, min(whole, end[leaf] - at), starts[leaves]};

        slices[first + s] = out;
        at += out.count;
    }
}
