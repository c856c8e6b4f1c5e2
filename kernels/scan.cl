/* Prefix sums and a stable radix sort, the primitives of grouping and splatting (method.md 6, 8). A
 * work-group takes a chunk of consecutive elements. Sums are of integers and a stable sort has one
 * result, so neither the chunks nor the number of concurrent groups change a bit.
 *
 *   scan:  out[i] = sum of in[0 .. i-1], out[n] = the total          (in may be out; n + 1 outputs)
 *   sort:  radix, from the lowest digit up; values go with their keys, equal keys keep their order
 *
 *   a digit: bits of the key in one or two pieces, (key >> shift & mask) | (key >> shift2 & mask2);
 *   no digit has bits that are equal in all keys (sort.c)
 *   counts of a pass, digit-major: counts[digit][chunk]; their scan gives the places of each
 *   chunk's digits
 *
 *   SG = 1 (CPUs): for many elements, each digit has a line of LINE elements, which is written past
 *   the caches when it is full: single writes would read every line first, and again after its
 *   eviction. If that takes several passes, the first is by the highest digit, and the buckets are
 *   then sorted in cache.
 *   SG > 1 (GPUs): a tile of SG * ITEMS elements is sorted in local memory, RANK_BITS of the digit
 *   at a time, and then written, so that neighbours go to neighbouring places.
 *
 * KEY_BITS  32 | 64        width of the sort's keys
 * SG        power of two   work-items of a group
 * DB        1 .. 12        most bits of a digit
 * LINE_BITS                the same if lines are written
 */
#ifndef KEY_BITS
#define KEY_BITS 32
#endif
#ifndef SG
#define SG 1
#define DB 8
#define LINE_BITS 9
#endif
#if KEY_BITS == 64
typedef ulong key_type;
typedef ulong4 key_vector;
#else
typedef uint key_type;
typedef uint8 key_vector;
#endif
#if SG & (SG - 1)
#error "SG must be a power of two"
#endif

#define DIGITS    (1u << DB)
#define ITEMS     8u /* elements that a work-item holds at a time */
#define TILE      (SG * ITEMS)
#define RANK_BITS 4u
#define RANKS     (1u << RANK_BITS)
#define LINE      16u /* elements of a digit written at a time: 64 bytes of values */
#define LINES     (1u << (DB < LINE_BITS ? DB : LINE_BITS))

/* Whole lines bypass the caches where that is known to work: on CPUs, compiled by clang. */
#if defined(__has_builtin) && (defined(__x86_64__) || defined(__aarch64__))
#if __has_builtin(__builtin_nontemporal_store)
#define STREAMS           1
#define STREAM(value, to) __builtin_nontemporal_store(value, to)
#define STREAM_END()      __sync_synchronize() /* nothing else orders such stores */
#endif
#endif
#ifndef STREAMS
#define STREAMS           0
#define STREAM(value, to) (*(to) = (value))
#define STREAM_END()
#endif

#define GROUP __attribute__((reqd_work_group_size(SG, 1, 1)))
#if SG > 1
#define SYNC() barrier(CLK_LOCAL_MEM_FENCE)
#else
#define SYNC()
#endif

/* Sum of `value` over the work-items before this one; *total: over all. scratch [2 * SG]. */
HELPER uint group_scan(uint value, uint lid, __local uint *scratch, uint *total)
{
#if SG > 1
    uint from = 0;

    scratch[lid] = value;
    SYNC();
    for (uint step = 1; step < SG; step *= 2) {
        const uint sum = scratch[from + lid] + (lid >= step ? scratch[from + lid - step] : 0u);

        from = SG - from;
        scratch[from + lid] = sum;
        SYNC();
    }
    *total = scratch[from + SG - 1u];
    value = scratch[from + lid] - value;
    SYNC(); /* before scratch is written again */
    return value;
#else
    *total = value;
    return 0;
#endif
}

GROUP __kernel void scan_sums(const __global uint *restrict in, /* [n] */
                              __global uint *restrict sums,     /* [ceil(n / chunk)] */
                              uint n, uint chunk)
{
    __local uint scratch[2 * SG];
    const uint c = get_group_id(0), lid = get_local_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint sum = 0, total;

    for (uint i = begin + lid; i < end; i += SG)
        sum += in[i];
    group_scan(sum, lid, scratch, &total);
    if (lid == 0)
        sums[c] = total;
}

/* A single chunk starts from 0 and needs no sums. */
GROUP __kernel void scan_write(const __global uint *in,   /* [n], may be out */
                               const __global uint *sums, /* [chunks] scanned */
                               __global uint *out,        /* [n + 1] */
                               uint n, uint chunk)
{
    __local uint scratch[2 * SG];
    const uint c = get_group_id(0), lid = get_local_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    uint sum = n > chunk ? sums[c] : 0u;

    for (uint tile = begin; tile < end; tile += TILE) {
        const uint first = min(end, tile + lid * ITEMS), last = min(end, first + ITEMS);
        uint own = 0, total, at;

        for (uint i = first; i < last; i++)
            own += in[i];
        at = sum + group_scan(own, lid, scratch, &total);
        for (uint i = first; i < last; i++) {
            const uint value = in[i];

            out[i] = at;
            at += value;
        }
        sum += total;
    }
    if (end == n && lid == 0)
        out[n] = sum;
}

#if KEY_BITS == 64
/* masks[chunk]: bits in which keys of the chunk differ from keys[0]. */
GROUP __kernel void sort_varying(const __global key_type *restrict keys, /* [n] */
                                 __global ulong *restrict masks, uint n, uint chunk)
{
    __local key_type parts[SG];
    const uint c = get_group_id(0), lid = get_local_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);
    const key_type first = keys[0];
    key_type mask = 0;

    for (uint i = begin + lid; i < end; i += SG)
        mask |= keys[i] ^ first;
    parts[lid] = mask;
    SYNC();
    if (lid > 0)
        return;
    for (uint i = 1; i < SG; i++)
        mask |= parts[i];
    masks[c] = mask;
}
#endif

HELPER uint digit_of(key_type key, uint shift, uint mask, uint shift2, uint mask2)
{
    return ((uint)(key >> shift) & mask) | ((uint)(key >> shift2) & mask2);
}

GROUP __kernel void sort_count(const __global key_type *restrict keys, /* [n] */
                               __global uint *restrict counts,         /* [digits][chunks] */
                               uint n, uint chunk, uint chunks, uint digits, uint shift,
                               uint mask, uint shift2, uint mask2)
{
    __local uint count[DIGITS];
    const uint c = get_group_id(0), lid = get_local_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);

    for (uint d = lid; d < digits; d += SG)
        count[d] = 0;
    SYNC();
    for (uint i = begin + lid; i < end; i += SG)
#if SG > 1
        atomic_inc(&count[digit_of(keys[i], shift, mask, shift2, mask2)]);
#else
        count[digit_of(keys[i], shift, mask, shift2, mask2)]++;
#endif
    SYNC();
    for (uint d = lid; d < digits; d += SG)
        counts[d * chunks + c] = count[d];
}

#define SCATTER_ARGUMENTS                                                                          \
    const __global key_type *restrict keys, const __global uint *restrict values,                  \
        const __global uint *restrict starts, /* [digits][chunks] scanned */                       \
        __global key_type *restrict keys_out, __global uint *restrict values_out, uint n,          \
        uint chunk, uint chunks, uint digits, uint shift, uint mask, uint shift2, uint mask2,      \
        uint stream

#if SG == 1

/* A digit's elements before they are written: output place j is in slot j % LINE. */
typedef struct __attribute__((aligned(64))) digit_line {
    key_type keys[LINE];
    uint values[LINE];
    uint first, at; /* the chunk's first and next place of this digit */
} digit_line;

/* Writes places from .. to - 1 one by one: the ends of a chunk's part of a digit. */
HELPER void write_places(const __local digit_line *line, __global key_type *keys,
                         __global uint *values, uint from, uint to)
{
    for (uint j = from; j < to; j++) {
        keys[j] = line->keys[j % LINE];
        values[j] = line->values[j % LINE];
    }
}

/* Writes the whole line, to places from `from` on, a multiple of LINE. */
HELPER void write_line(const __local digit_line *line, __global key_type *keys,
                       __global uint *values, uint from)
{
#pragma unroll
    for (uint j = 0; j < LINE; j += 32u / sizeof(key_type))
        STREAM(*(const __local key_vector *)(line->keys + j),
               (__global key_vector *)(keys + from + j));
#pragma unroll
    for (uint j = 0; j < LINE; j += 8u)
        STREAM(*(const __local uint8 *)(line->values + j), (__global uint8 *)(values + from + j));
}

GROUP __kernel void sort_scatter(SCATTER_ARGUMENTS)
{
    __local uint at[DIGITS];
    __local digit_line lines[LINES];
    const uint c = get_group_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);

    if (!STREAMS || !stream) {
        for (uint d = 0; d < digits; d++)
            at[d] = starts[d * chunks + c];
        for (uint i = begin; i < end; i++) {
            const key_type key = keys[i];
            const uint to = at[digit_of(key, shift, mask, shift2, mask2)]++;

            keys_out[to] = key;
            values_out[to] = values[i];
        }
        return;
    }
    for (uint d = 0; d < digits; d++)
        lines[d].first = lines[d].at = starts[d * chunks + c];
    for (uint i = begin; i < end; i++) {
        const key_type key = keys[i];
        __local digit_line *line = &lines[digit_of(key, shift, mask, shift2, mask2)];
        const uint to = line->at++;

        line->keys[to % LINE] = key;
        line->values[to % LINE] = values[i];
        if (to % LINE == LINE - 1u) {
            const uint from = to + 1u - LINE;

            if (from >= line->first)
                write_line(line, keys_out, values_out, from);
            else /* the line's other places belong to the chunk before */
                write_places(line, keys_out, values_out, line->first, to + 1u);
        }
    }
    for (uint d = 0; d < digits; d++)
        write_places(&lines[d], keys_out, values_out,
                     max(lines[d].first, lines[d].at / LINE * LINE), lines[d].at);
    STREAM_END();
}

#if KEY_BITS == 64
/* After a pass by the keys' highest digit, group b sorts bucket b from the lowest digit up, in
 * cache. A digit is key >> shifts[pass] & mask. The result is in `keys` after an even number of
 * passes, else in `spare_keys`. The loop over elements is written for few registers. */
GROUP __kernel void sort_buckets(__global key_type *keys, __global uint *values,
                                 __global key_type *spare_keys, __global uint *spare_values,
                                 const __global uint *restrict starts, /* [buckets * chunks + 1] */
                                 const __global uint *restrict shifts, /* [passes] */
                                 uint chunks, uint passes, uint mask)
{
    __local uint counts[2 * DIGITS];
    const uint b = get_group_id(0), begin = starts[b * chunks], end = starts[(b + 1u) * chunks];

    for (uint d = 0; d <= mask; d++)
        counts[d] = 0;
    for (uint i = begin; i < end; i++)
        counts[(uint)(keys[i] >> shifts[0]) & mask]++;
    for (uint p = 0; p < passes; p++) {
        const uint odd = p % 2u, shift = shifts[p], next = shifts[min(p + 1u, passes - 1u)];
        const __global key_type *from_keys = odd ? spare_keys : keys;
        const __global uint *from_values = odd ? spare_values : values;
        __global key_type *to_keys = odd ? keys : spare_keys;
        __global uint *to_values = odd ? values : spare_values;
        __local uint *at = counts + odd * DIGITS, *count = counts + (1u - odd) * DIGITS;
        uint sum = begin;

        for (uint d = 0; d <= mask; d++) {
            const uint value = at[d];

            at[d] = sum;
            sum += value;
            count[d] = 0;
        }
        for (uint i = begin; i < end; i++) {
            const key_type key = from_keys[i];
            const uint value = from_values[i];
            const uint to = at[(uint)(key >> shift) & mask]++;

            to_keys[to] = key;
            to_values[to] = value;
            count[(uint)(key >> next) & mask]++;
        }
    }
}
#endif

#else

GROUP __kernel void sort_scatter(SCATTER_ARGUMENTS)
{
    __local key_type tile_keys[TILE];
    __local uint tile_values[TILE];
    __local ushort ranks[RANKS * SG]; /* [part of a digit][work-item] */
    __local uint at[DIGITS], first[DIGITS], scratch[2 * SG];
    const uint c = get_group_id(0), lid = get_local_id(0);
    const uint begin = min(n, c * chunk), end = min(n, begin + chunk);

    for (uint d = lid; d < digits; d += SG)
        at[d] = starts[d * chunks + c];
    for (uint tile = begin; tile < end; tile += TILE) {
        const uint count = min(end - tile, TILE);

        for (uint i = lid; i < count; i += SG) {
            tile_keys[i] = keys[tile + i];
            tile_values[i] = values[tile + i];
        }
        SYNC();
        /* Stable counting sorts of the tile, from the digit's lowest bits up. */
        for (uint shift_in = 0; (1u << shift_in) < digits; shift_in += RANK_BITS) {
            const uint own = lid * ITEMS;
            key_type held_keys[ITEMS];
            uint held_values[ITEMS], part[ITEMS], rank[ITEMS], sum = 0, total;

            for (uint r = 0; r < RANKS; r++)
                ranks[r * SG + lid] = 0;
            /* Past the count it takes the last element again, uncounted: with both loops over the
             * existing 0 to 7 elements, PoCL 3.1 for AVX-512 let all work-items skip the second
             * loop when the last one did. */
#pragma unroll
            for (uint j = 0; j < ITEMS; j++) {
                const uint i = min(own + j, count - 1u);

                held_keys[j] = tile_keys[i];
                held_values[j] = tile_values[i];
                const uint digit = digit_of(held_keys[j], shift, mask, shift2, mask2);

                part[j] = (digit >> shift_in) % RANKS * SG + lid;
                rank[j] = ranks[part[j]];
                ranks[part[j]] += own + j < count;
            }
            SYNC();
            for (uint r = 0; r < RANKS; r++)
                sum += ranks[lid * RANKS + r];
            sum = group_scan(sum, lid, scratch, &total);
            for (uint r = 0; r < RANKS; r++) {
                const uint value = ranks[lid * RANKS + r];

                ranks[lid * RANKS + r] = (ushort)sum;
                sum += value;
            }
            SYNC();
#pragma unroll
            for (uint j = 0; j < ITEMS; j++)
                if (own + j < count) {
                    const uint to = ranks[part[j]] + rank[j];

                    tile_keys[to] = held_keys[j];
                    tile_values[to] = held_values[j];
                }
            SYNC();
        }
        for (uint i = lid; i < count; i += SG) {
            const uint d = digit_of(tile_keys[i], shift, mask, shift2, mask2);

            if (i == 0 || digit_of(tile_keys[i - 1u], shift, mask, shift2, mask2) != d)
                first[d] = i;
        }
        SYNC();
        for (uint i = lid; i < count; i += SG) {
            const key_type key = tile_keys[i];
            const uint d = digit_of(key, shift, mask, shift2, mask2), to = at[d] + (i - first[d]);

            keys_out[to] = key;
            values_out[to] = tile_values[i];
        }
        SYNC();
        for (uint i = lid; i < count; i += SG) {
            const uint d = digit_of(tile_keys[i], shift, mask, shift2, mask2);

            if (i + 1u == count || digit_of(tile_keys[i + 1u], shift, mask, shift2, mask2) != d)
                at[d] += i + 1u - first[d];
        }
        SYNC();
    }
}

#endif
