/* Rays through the tree and stage 2's samples (method.md 3, 5, 7, 9; twin: host/reference/rays.c,
 * sampling.c). Lanes run over what is alike: rays while they walk (VW of them a work-item), points
 * of stage 1, samples of a passage. On a CPU most of the time goes into waiting, for densities and
 * after branches guessed wrong; so densities are fetched into the cache before their turn comes, and
 * branches hang as little as can be on what was just read.
 *
 *   intervals_fill    per leaf on the ray: chord, stage-1 optical depth, number of samples; leaves
 *                     behind opaque ones are left out; at most MAX_INTERVALS(depth) a ray, as many as
 *                     cells a line can meet in the map                            -> scan of samples
 *   samples_emit      positions by inverse CDF, deltas; front to back
 *
 * Stage 1 is read through one interface: segment_open(), segment_fetch(), segment_depth(),
 * segment_bins() and segment_mean(): the stage-1 points of one passage, ascending in t, with their densities; a bin
 * reaches half way to the neighbours, and the last one to the chord's end. Two ways give them:
 *   STAGE1 1 (gather)  n1-spaced points on the chord, nearest cell of the leaf's cached densities
 *   STAGE1 0 (splat)   samples projected into the views, sorted by (list, t); list = coarse pixel of
 *                      the leaf's level (splat.cl)
 *
 *   ALLOCATE 0 chord | 1 weight;  CDF 0 sigma | 1 weight;  PADDED 0 | 1: lists at list * longest
 */
#ifndef STAGE1
#define STAGE1   1
#define ALLOCATE 1
#define CDF      1
#define PADDED   0
#endif

/* Numbers of samples hang on it: the library's, whatever NATIVE says. */
#undef EXP
#define EXP(x) exp(x)

#define NEVER                1e30f
#define MAX_INTERVALS(depth) (3u << (depth))
#define EMPTY_BIN            1e-5f

/* ---- the walk through the tree: lanes over rays ---- */

typedef struct walk {
    vf o[3], d[3], inverse[3];
    vf never[3];   /* NEVER along an axis whose planes are never crossed, else 0 */
    vi ascends[3]; /* all bits set along an axis that the ray ascends, else none */
    vi cell[3];    /* of the map */
    vf t;          /* where the ray is */
    vi more;       /* does it walk on? As comparisons say it */
} walk;

/* Truncates: what floor would tell apart is clamped away. */
HELPER vi cell_of(vf o, vf d, vf t, float half_n, vi low, vi high)
{
    return clamp(V_TO_INT((MAD(d, t, o) + 1.0f) * half_n), low, high);
}

/* Rays first .. first + VW - 1 enter the cube; those from `end` on, and those that miss it, do not
 * walk. Components under 1e-12 count as zero. */
HELPER void walk_start(walk *w, const __global float4 *ray_o, const __global float4 *ray_d,
                       uint first, uint end, int depth)
{
    const vi none = (vi)(0), last = (vi)((1 << depth) - 1);
    float lanes[6][VW];
    vf t0 = (vf)(0.0f), t1 = (vf)(NEVER);

#pragma unroll
    for (uint l = 0; l < VW; l++) {
        const uint r = min(first + l, end - 1u);
        const float4 o = ray_o[r], d = ray_d[r];

        lanes[0][l] = o.x;
        lanes[1][l] = o.y;
        lanes[2][l] = o.z;
        lanes[3][l] = d.x;
        lanes[4][l] = d.y;
        lanes[5][l] = d.z;
    }
    w->more = V_TO_INT(V_IOTA) < (vi)((int)(end - first));
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vf o = VLOAD(lanes[a]), d = VLOAD(lanes[3 + a]);
        const vi parallel = fabs(d) < (vf)(1e-12f);
        const vf inverse = select((vf)(1.0f) / d, (vf)(0.0f), parallel);
        const vf ta = (-1.0f - o) * inverse, tb = (1.0f - o) * inverse;

        w->o[a] = o;
        w->d[a] = d;
        w->inverse[a] = inverse;
        w->never[a] = select((vf)(0.0f), (vf)(NEVER), parallel);
        w->ascends[a] = select(none, (vi)(-1), inverse > (vf)(0.0f));
        w->more = select(w->more, none, parallel & (fabs(o) > (vf)(1.0f)));
        t0 = select(fmax(t0, fmin(ta, tb)), t0, parallel);
        t1 = select(fmin(t1, fmax(ta, tb)), t1, parallel);
    }
    w->more = w->more & (t1 > t0);
    w->t = t0;
#pragma unroll
    for (int a = 0; a < 3; a++)
        w->cell[a] = cell_of(w->o[a], w->d[a], t0, 0.5f * (float)(1 << depth), none, last);
}

/* Every ray to where it leaves the leaf or culled node that it is in; returns their map entries, 0 of
 * rays that walk no more, as those do that leave the cube. Progress is by integers: the crossed axis
 * steps over the node's face, the others stay within its extent, so no rounding can trap the walk. */
HELPER vi walk_next(walk *w, const __global int *map, int depth)
{
    const int n = 1 << depth;
    const float side = 2.0f / (float)n;
    const vi was_more = w->more;
    vi base[3], plane[3];
    vf exits[3], t = (vf)(NEVER);
    int at[VW], found[VW];

    /* rays that walk no more may stand outside the map */
    VSTORE(((((w->cell[2] << depth) + w->cell[1]) << depth) + w->cell[0]) & (n * n * n - 1), at);
#pragma unroll
    for (int l = 0; l < VW; l++)
        found[l] = map[at[l]];
    const vi entry = VLOAD(found), size = (vi)(1) << (depth - (entry & 15));

#pragma unroll
    for (int a = 0; a < 3; a++) {
        base[a] = w->cell[a] & -size;
        plane[a] = base[a] + (size & w->ascends[a]);
        exits[a] = MAD(V_TO_FLOAT(plane[a]) * side - 1.0f - w->o[a], w->inverse[a], w->never[a]);
        t = fmin(t, exits[a]);
    }
    t = fmax(t, w->t);
    w->more = w->more & (t < (vf)(NEVER));
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vi over = plane[a] + ~w->ascends[a];
        const vi along = cell_of(w->o[a], w->d[a], t, 0.5f * (float)n, base[a], base[a] + size - 1);

        w->cell[a] = select(along, over, exits[a] <= t);
        w->more = w->more & (w->cell[a] >= (vi)(0)) & (w->cell[a] < (vi)(n));
    }
    w->t = t;
    return select((vi)(0), entry, was_more);
}

/* ---- stage 1's points on one passage ---- */

typedef struct segment {
    uint start, count;            /* splat: entries of the list */
    float t_in, step;             /* gather */
    float3 at, along;             /* gather: cell coordinates at t_in, and per unit of t */
    const __global ushort *cache; /* gather: the leaf's cells */
} segment;

#if STAGE1 == 1
#define STAGE1_ARGUMENTS                                                   \
    LEAF_ARRAY(const ushort, density),         /* [leaf][n1^3] bfloat16 */ \
        const __global float4 *restrict boxes, /* [leaf] */                \
        uint n1
#define STAGE1_PASS LEAF_PASS(density), boxes, n1

HELPER segment segment_open(STAGE1_ARGUMENTS, float3 o, float3 d, float t_in, float t_out, int slot)
{
    const float4 box = boxes[slot];
    const float scale = (float)n1 / box.w, cells = (t_out - t_in) * scale;
    const int whole = (int)cells;
    segment s;

    s.start = 0;
    s.count = (uint)max(1, whole + ((float)whole < cells)); /* ceil; PoCL's is slow */
    s.t_in = t_in;
    s.step = (t_out - t_in) / (float)s.count;
    s.at = (MAD((float3)(t_in), d, o) - box.xyz) * scale;
    s.along = d * scale;
    s.cache = LEAF_ROW(density, slot, n1 * n1 * n1);
    return s;
}

/* Cells of points j .. j + VW - 1. */
HELPER vi segment_cells(const segment *s, uint j, uint n1)
{
    const vi last = (vi)((int)n1 - 1), none = (vi)(0);
    const vf ahead = (V_TO_FLOAT(V_TO_INT(V_IOTA + j)) + 0.5f) * s->step;
    const vi x = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.x), (vf)(s->at.x))), none, last);
    const vi y = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.y), (vf)(s->at.y))), none, last);
    const vi z = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.z), (vf)(s->at.z))), none, last);

    return (z * (int)n1 + y) * (int)n1 + x;
}

/* The densities of all points of a passage, into the cache. */
HELPER void segment_fetch(STAGE1_ARGUMENTS, const segment *s)
{
    int cell[VW];

    (void)boxes;
    for (uint j = 0; j < s->count; j += VW) {
        VSTORE(segment_cells(s, j, n1), cell);
#pragma unroll
        for (int l = 0; l < VW; l++)
            FETCH(s->cache + cell[l]);
    }
}

/* Densities of points j .. j + VW - 1; beyond the last one zero. */
HELPER vf segment_points(STAGE1_ARGUMENTS, const segment *s, uint j)
{
    const vf number = V_TO_FLOAT(V_TO_INT(V_IOTA + j));
    int cell[VW];
    ushort bits[VW];

    (void)boxes;
    VSTORE(segment_cells(s, j, n1), cell);
#pragma unroll
    for (int l = 0; l < VW; l++)
        bits[l] = s->cache[(uint)cell[l]];
    return select((vf)(0.0f), V_AS_FLOAT(V_TO_UINT(VLOAD(bits)) << 16), number < (float)s->count);
}

/* Optical depth of a passage, by stage 1. */
HELPER float segment_depth(STAGE1_ARGUMENTS, const segment *s, float t_in, float t_out)
{
    vf sum = (vf)(0.0f);

    (void)t_in;
    (void)t_out;
    for (uint j = 0; j < s->count; j += VW)
        sum += segment_points(STAGE1_PASS, s, j);
    return V_SUM(sum) * s->step;
}

/* Bins j .. j + VW - 1: densities, and right edges to *right; beyond the last one zero and the end of
 * the chord. */
HELPER vf segment_bins(STAGE1_ARGUMENTS, const segment *s, uint j, float t_out, vf *right)
{
    const vf end = V_TO_FLOAT(V_TO_INT(V_IOTA + (j + 1u)));

    *right =
        select((vf)(t_out), MAD(end, (vf)(s->step), (vf)(s->t_in)), end < (vf)((float)s->count));
    return segment_points(STAGE1_PASS, s, j);
}

/* Mean density of a passage's points. */
HELPER float segment_mean(STAGE1_ARGUMENTS, const segment *s, float depth, float length)
{
    return depth / length; /* points are equally far apart */
}
#else
#define STAGE1_ARGUMENTS                                                                \
    const __global uint *restrict list_start,     /* [list + 1] */                      \
        const __global float *restrict list_t,    /* [entry] ascending within a list */ \
        const __global float *restrict list_sigma /* [entry] */
#define STAGE1_PASS list_start, list_t, list_sigma

/* First entry of [begin, end) with t >= value. */
HELPER uint lower_bound(const __global float *t, uint begin, uint end, float value)
{
    while (begin < end) {
        const uint middle = begin + (end - begin) / 2u;

        if (t[middle] < value)
            begin = middle + 1u;
        else
            end = middle;
    }
    return begin;
}

HELPER segment segment_open(STAGE1_ARGUMENTS, uint begin, uint end, float t_in, float t_out)
{
    segment s = {0};

    (void)list_start;
    (void)list_sigma;
    s.start = lower_bound(list_t, begin, end, t_in);
    s.count = lower_bound(list_t, s.start, end, t_out) - s.start;
    return s;
}

HELPER void segment_fetch(STAGE1_ARGUMENTS, const segment *s)
{
    (void)list_start;
    (void)list_t;
    FETCH(list_sigma + s->start);
}

/* Bins j .. j + VW - 1: densities, and right edges to *right; beyond the last one zero and the end of
 * the chord. */
HELPER vf segment_bins(STAGE1_ARGUMENTS, const segment *s, uint j, float t_out, vf *right)
{
    float edges[VW], sigma[VW];

    (void)list_start;
    for (uint l = 0; l < VW; l++) {
        const uint k = s->start + j + l;

        edges[l] = j + l + 1u < s->count ? 0.5f * (list_t[k] + list_t[k + 1u]) : t_out;
        sigma[l] = j + l < s->count ? list_sigma[k] : 0.0f;
    }
    *right = VLOAD(edges);
    return VLOAD(sigma);
}

/* Optical depth of a passage, by stage 1. */
HELPER float segment_depth(STAGE1_ARGUMENTS, const segment *s, float t_in, float t_out)
{
    float edge[VW];
    vf depth = (vf)(0.0f), right;

    edge[VW - 1] = t_in;
    for (uint j = 0; j < s->count; j += VW) {
        const vf sigma = segment_bins(STAGE1_PASS, s, j, t_out, &right);

        depth = MAD(sigma, right - V_SHIFT(right, edge[VW - 1]), depth);
        VSTORE(right, edge);
    }
    return V_SUM(depth);
}

/* Mean density of a passage's points. */
HELPER float segment_mean(STAGE1_ARGUMENTS, const segment *s, float depth, float length)
{
    float sum = 0.0f;

    for (uint j = 0; j < s->count; j++)
        sum += list_sigma[s->start + j];
    return sum / (float)max(1u, s->count);
}
#endif

/* The segment of ray r's passage through a leaf of `level`. */
#if STAGE1 == 1
#define SEGMENT_OF(r, o, d, t_in, t_out, slot, level) \
    segment_open(STAGE1_PASS, o, d, t_in, t_out, slot)
#define LIST_ARGUMENTS
#else
/* grids: [batch view][level 0..5] {first list, coarsening, lists per row, longest list} */
#define LIST_ARGUMENTS                                                                 \
    , const __global cln_pixel *restrict pixels, const __global uint4 *restrict grids, \
        const __global uint *restrict list_count /* [list] padded only */
HELPER uint list_of(const __global cln_pixel *pixels, const __global uint4 *grids, uint r,
                    int level)
{
    const cln_pixel p = pixels[r];
    const uint4 grid = grids[p.pad * 6u + (uint)level];

    return grid.x + p.y / grid.y * grid.z + p.x / grid.y;
}
#if PADDED
#define LIST_BEGIN(list) ((list)*grids[0].w)
#define LIST_END(list)   (LIST_BEGIN(list) + list_count[list])
#else
#define LIST_BEGIN(list) (list_start[list])
#define LIST_END(list)   (list_start[(list) + 1u])
#endif
#define SEGMENT_OF(r, o, d, t_in, t_out, slot, level)                       \
    segment_open(STAGE1_PASS, LIST_BEGIN(list_of(pixels, grids, r, level)), \
                 LIST_END(list_of(pixels, grids, r, level)), t_in, t_out)
#endif

/* ---- intervals ---- */

/* Nodes that the rays of a work-item walk before their densities are read, and those before anything
 * is decided. More would overlap more, and read in vain behind what is opaque. */
#define AHEAD (VW == 1 ? 1 : 2)

/* Samples of a passage that is nearly empty: one or none. */
#define ROULETTE (-1)

/* Of node i, which is of ray r. */
#define SEGMENT_OF_NODE(i, r)                                                                   \
    SEGMENT_OF(r, ray_o[r].xyz, ray_d[r].xyz, edges[i], edges[(i) + VW], (entries[i] >> 4) - 1, \
               entries[i] & 15)

/* Work-item i: rays first + i VW .. first + i VW + VW - 1. */
__kernel void intervals_fill(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
                             const __global float4 *restrict ray_d,
                             const __global int *restrict map,
                             __global cln_interval *restrict intervals, /* [MAX_INTERVALS][rays] */
                             __global uint *restrict used, /* [ray] intervals with samples */
                             __global uint *restrict sample_counts, /* [ray] */
                             uint first, uint n, uint rays, int depth, float max_depth,
                             uint per_leaf, uint per_ray, float empty_weight, float empty_share,
                             uint2 seed, uint step LIST_ARGUMENTS)
{
    const uint begin = first + (uint)get_global_id(0) * VW, end = first + n;
    /* [node][lane]: t where the node begins, one more where the last one ends; optical depth, then
     * mass; map entry; samples */
    float edges[(AHEAD + 1) * VW], mass[AHEAD * VW];
    int entries[AHEAD * VW], numbers[AHEAD * VW];
    uint passages[AHEAD * VW]; /* [k] index of node and lane | number of passages before << 8 */
    uint met[VW], kept[VW], samples[VW]; /* of each ray: passages, intervals, samples */
    vf tau = (vf)(0.0f);
    walk w;

    if (begin >= end)
        return;
    walk_start(&w, ray_o, ray_d, begin, end, depth);
    for (int l = 0; l < VW; l++)
        met[l] = kept[l] = samples[l] = 0u;
    while (V_ANY(w.more)) {
        int nodes = 0;
        uint count = 0;

        VSTORE(w.t, edges);
        for (; nodes < AHEAD * VW && V_ANY(w.more); nodes += VW) {
            VSTORE(walk_next(&w, map, depth), entries + nodes);
            VSTORE(w.t, edges + nodes + VW);
            VSTORE((vf)(0.0f), mass + nodes);
        }
        for (int i = 0; i < nodes; i++) {
            const bool passage = (entries[i] >= 16) & (edges[i + VW] - edges[i] > CLN_MIN_CHORD);

            passages[count] = (uint)i | met[i % VW] << 8;
            count += passage;
            met[i % VW] += passage;
        }
        for (uint k = 0; k < count; k++) {
            const uint i = passages[k] & 255u;
            const segment s = SEGMENT_OF_NODE(i, begin + i % VW);

            segment_fetch(STAGE1_PASS, &s);
        }
        for (uint k = 0; k < count; k++) {
            const uint i = passages[k] & 255u;
            const segment s = SEGMENT_OF_NODE(i, begin + i % VW);

            mass[i] = segment_depth(STAGE1_PASS, &s, edges[i], edges[i + VW]);
        }
        for (int i = 0; i < nodes; i += VW) {
            const vf passage = VLOAD(mass + i), alpha = ONE_MINUS_EXP(vf, passage);
#if ALLOCATE == 1
            const vf weight = EXP(-tau) * alpha;
            const vi most =
                V_TO_INT(fmax(fmin(weight, (vf)(1.0f)), (vf)(0.0f)) * (float)per_ray + 0.5f);
            const vi number = select(min(most + 1, (vi)((int)per_leaf)), (vi)(ROULETTE),
                                     weight < (vf)(empty_weight));
#else
            /* diagonal of a leaf of level 0: sqrt(3) * 2 */
            const vf size = V_TO_FLOAT((vi)(1) << (VLOAD(entries + i) & 15));
            const vf share = (VLOAD(edges + i + VW) - VLOAD(edges + i)) * size / 3.46410162f;
            const vi number = max((vi)(1), V_TO_INT(ceil((float)per_leaf * share)));
#endif

            VSTORE(select((vi)(0), number, tau <= (vf)(max_depth)), numbers + i);
            tau += passage;
#if CDF == 1
            VSTORE(alpha, mass + i);
#endif
        }
        for (uint k = 0; k < count; k++) {
            const uint i = passages[k] & 255u, l = i % VW, r = begin + l;
            const uint level = (uint)entries[i] & 15u;
            int number = numbers[i];

            if (number == ROULETTE)
                number = empty_share >= 1.0f ||
                         (empty_share > 0.0f && uniform4(seed, STREAM_SAMPLES, step, r,
                                                         CLN_DRAW_ROULETTE + (passages[k] >> 8))
                                                        .x < empty_share);
            if (number > 0) {
                const cln_interval v = {edges[i], edges[i + VW], mass[i], (entries[i] >> 4) - 1,
                                        (uint)number | level << 24};

                intervals[kept[l]++ * rays + r] = v;
                samples[l] += (uint)number;
            }
        }
        w.more = w.more & (tau <= (vf)(max_depth));
    }
    for (uint l = 0; l < min((uint)VW, end - begin); l++) {
        used[begin + l] = kept[l];
        sample_counts[begin + l] = samples[l];
    }
}

/* ---- samples ---- */

#define RANDOM ((VW + 3) / 4 * 4 + 4)

/* Uniform numbers drawn .. drawn + lanes - 1 of ray r, to random[drawn & 3] and behind. They are made
 * four at a time; *four are the last. */
HELPER void draw(float random[RANDOM], float4 *four, uint drawn, uint lanes, uint2 seed, uint step,
                 uint r)
{
    uint at = 0;

    if (drawn & 3u) {
        vstore4(*four, 0, random);
        at = 4;
    }
    for (; at < (drawn & 3u) + lanes; at += 4) {
        *four = uniform4(seed, STREAM_SAMPLES, step, r, (drawn + at) >> 2);
        vstore4(*four, 0, random + at);
    }
}

__kernel void
samples_emit(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
             const __global float4 *restrict ray_d,
             const __global cln_interval *restrict intervals, /* [MAX_INTERVALS][rays] */
             const __global uint *restrict used,              /* [ray] */
             const __global uint *restrict sample_starts,     /* [ray + 1] */
             __global cln_sample *restrict samples,           /* [sample] */
             uint first, uint n, uint rays, float uniform_share, uint jitter, uint2 seed,
             uint step LIST_ARGUMENTS)
{
    const uint r = first + get_global_id(0);
    float random[RANDOM];
    float4 four = (float4)(0.5f);
    uint drawn = 0;

    if (get_global_id(0) >= n || used[r] == 0)
        return;
    const float3 o = ray_o[r].xyz, d = ray_d[r].xyz;
    __global cln_sample *out = samples + sample_starts[r];

    for (int l = 0; l < RANDOM; l++)
        random[l] = 0.5f;
    for (uint i = 0; i < used[r]; i++) {
        const cln_interval v = intervals[i * rays + r];
        const uint count = v.count & 0xFFFFFFu;
        const float length = v.t_out - v.t_in;
        const segment s = SEGMENT_OF(r, o, d, v.t_in, v.t_out, v.slot, (int)(v.count >> 24));
        const uint more = i + 1u < used[r], r_next = more ? r : min(r + 1u, first + n - 1u);
        const uint i_next = more ? i + 1u : 0u;

        if (i_next < used[r_next]) { /* of this ray, or the first of the next work-item's */
            const cln_interval next = intervals[i_next * rays + r_next];
            const segment behind =
                SEGMENT_OF(r_next, ray_o[r_next].xyz, ray_d[r_next].xyz, next.t_in, next.t_out,
                           next.slot, (int)(next.count >> 24));

            segment_fetch(STAGE1_PASS, &behind);
        }
        /* total mass, with a little everywhere so that no bin is unreachable */
#if CDF == 1
        const float little = EMPTY_BIN / length;
        const float mass = v.mass + EMPTY_BIN;
#else
        const float little = EMPTY_BIN * fmax(1.0f, segment_mean(STAGE1_PASS, &s, v.mass, length));
        const float mass = MAD(little, length, v.mass);
#endif
        const float steered = (1.0f - uniform_share) / mass;
        const float even = MAD(little, steered, uniform_share / length);
        /* VW bins: right edges, the distribution function and the optical depth there, and the length
         * of chord per unit of the function */
        float right[VW], upto[VW], depth[VW], rise[VW];
        float edge = v.t_in, below = 0.0f, left = v.t_in, last = v.t_in;
        uint read = 0, b = VW;

        depth[VW - 1] = 0.0f;
        for (uint k = 0; k < count; k += VW) {
            const uint lanes = min((uint)VW, count - k);
            vf from_edge = (vf)(0.0f), from_u = (vf)(0.0f), slope = (vf)(0.0f);
            float place[VW];

            if (jitter)
                draw(random, &four, drawn, lanes, seed, step, r);
            const vf u =
                (V_TO_FLOAT(V_TO_INT(V_IOTA + k)) + VLOAD(random + (drawn & 3u))) / (float)count;

            drawn += jitter ? lanes : 0u;
            VSTORE(u, place);
            const float most = place[lanes - 1u];

            /* every sample takes the last bin that begins at or before it */
            for (;;) {
                if (b == VW) {
                    vf ends;
                    const vf sigma = segment_bins(STAGE1_PASS, &s, read, v.t_out, &ends);
                    const vf part = sigma * (ends - V_SHIFT(ends, edge));
#if CDF == 1
                    const vf sum =
                        V_PREFIX(fmin(part, (vf)(CLN_MAX_OPTICAL_DEPTH))) + depth[VW - 1];
                    const vf steer = ONE_MINUS_EXP(vf, sum);
#else
                    const vf sum = V_PREFIX(part) + depth[VW - 1], steer = sum;
#endif
                    const vf f = MAD(steer, (vf)(steered), (ends - v.t_in) * even);

                    VSTORE(ends, right);
                    VSTORE(sum, depth);
                    VSTORE(f, upto);
                    VSTORE((ends - V_SHIFT(ends, edge)) / fmax(f - V_SHIFT(f, below), (vf)(1e-30f)),
                           rise);
                    read += VW;
                    b = 0;
                }
                const vi here = u >= (vf)(below);

                from_edge = select(from_edge, (vf)(edge), here);
                from_u = select(from_u, (vf)(below), here);
                slope = select(slope, (vf)(rise[b]), here);
                /* the last samples look at all bins: whether to stop would hang on densities */
                if (((VW == 1 || k + VW < count) && most < upto[b]) ||
                    read - VW + b + 1u >= s.count)
                    break;
                edge = right[b];
                below = upto[b];
                b++;
            }
            VSTORE(min(max(MAD(u - from_u, slope, from_edge), (vf)(v.t_in)), (vf)(v.t_out)), place);
            for (uint l = 0; l < lanes; l++) {
                const float t = max(last, place[l]);

                if (k + l > 0) { /* the sample before ends half way to this one */
                    const float middle = 0.5f * (last + t);
                    const cln_sample sample = {last, middle - left, r, v.slot};

                    *out++ = sample;
                    left = middle;
                }
                last = t;
            }
        }
        const cln_sample sample = {last, v.t_out - left, r, v.slot};

        *out++ = sample;
    }
}
