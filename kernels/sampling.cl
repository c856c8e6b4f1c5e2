/* Rays through the tree and stage 2's samples (method.md 3, 5, 7, 9; twin: host/reference/rays.c,
 * sampling.c). One work-item per ray.
 *
 *   intervals_fill    per leaf on the ray: chord, stage-1 optical depth, number of samples; leaves
 *                     behind opaque ones are left out; at most MAX_INTERVALS(depth) a ray, as many as
 *                     cells a line can meet in the map                            -> scan of samples
 *   samples_emit      positions by inverse CDF, deltas; front to back
 *
 * Stage 1 is read through one interface: segment_open(), segment_depth() and segment_bins(): the stage-1 points of
 * one passage, ascending in t, with their densities; a bin reaches half way to the neighbours, and the last one to
 * the chord's end. Lanes run over points. Two ways give them:
 *   STAGE1 1 (gather)  n1-spaced points on the chord, nearest cell of the leaf's cached densities
 *   STAGE1 0 (splat)   samples projected into the views, sorted by (list, t); list = coarse pixel of
 *                      the leaf's level (splat.cl)
 *
 *   ALLOCATE 0 chord | 1 weight;  CDF 0 sigma | 1 weight;  PADDED 0 | 1: lists at list * longest
 */
#ifndef STAGE1
#define STAGE1 1
#define ALLOCATE 1
#define CDF 1
#define PADDED 0
#endif

#define NEVER 1e30f
#define MAX_INTERVALS(depth) (3u << (depth))
#define EMPTY_BIN 1e-5f

typedef struct tree_ray {
    float o[3], d[3], inverse[3]; /* inverse 0: the axis' planes are never crossed */
    int cell[3];
    float t;      /* where the walk is */
    int n;        /* cells per axis of the map */
} tree_ray;

HELPER int cell_of(float o, float d, float t, int n)
{
    return clamp((int)floor((MAD(d, t, o) + 1.0f) * (0.5f * (float)n)), 0, n - 1);
}

/* Enters the cube; false if the ray misses it. Components under 1e-12 count as zero. */
HELPER bool walk_start(tree_ray *w, float4 o, float4 d, int depth)
{
    float t0 = 0.0f, t1 = NEVER;
    bool inside = true;

    w->o[0] = o.x;
    w->o[1] = o.y;
    w->o[2] = o.z;
    w->d[0] = d.x;
    w->d[1] = d.y;
    w->d[2] = d.z;
    w->n = 1 << depth;
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const bool parallel = fabs(w->d[a]) < 1e-12f;
        const float inverse = parallel ? 0.0f : 1.0f / w->d[a];
        const float ta = (-1.0f - w->o[a]) * inverse, tb = (1.0f - w->o[a]) * inverse;

        w->inverse[a] = inverse;
        inside = inside && !(parallel && fabs(w->o[a]) > 1.0f);
        t0 = parallel ? t0 : fmax(t0, fmin(ta, tb));
        t1 = parallel ? t1 : fmin(t1, fmax(ta, tb));
    }
    w->t = t0;
#pragma unroll
    for (int a = 0; a < 3; a++)
        w->cell[a] = cell_of(w->o[a], w->d[a], t0, w->n);
    return inside && t1 > t0;
}

/* The leaf or culled node the walk is in: its map entry, t where the ray leaves it in *t_out; moves on.
 * *more turns false once the cube is left. Progress is by integers: the crossed axis steps over the
 * node's face, the others stay within its extent, so no rounding can trap the walk. */
HELPER int walk_next(tree_ray *w, const __global int *map, int depth, float *t_out, bool *more)
{
    const int entry = map[(w->cell[2] * w->n + w->cell[1]) * w->n + w->cell[0]];
    const int size = 1 << (depth - (entry & 15));
    const float cell = 2.0f / (float)w->n;
    float exits[3], t = NEVER;

#pragma unroll
    for (int a = 0; a < 3; a++) {
        const int base = w->cell[a] & ~(size - 1);
        const int plane = w->inverse[a] > 0.0f ? base + size : base;

        exits[a] = w->inverse[a] == 0.0f
                       ? NEVER
                       : ((float)plane * cell - 1.0f - w->o[a]) * w->inverse[a];
        t = fmin(t, exits[a]);
    }
    t = fmax(t, w->t);
    *more = t < NEVER;
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const int base = w->cell[a] & ~(size - 1);
        const int over = w->inverse[a] > 0.0f ? base + size : base - 1;
        const int along = clamp(cell_of(w->o[a], w->d[a], t, w->n), base, base + size - 1);

        w->cell[a] = exits[a] <= t ? over : along;
        *more = *more && w->cell[a] >= 0 && w->cell[a] < w->n;
    }
    *t_out = t;
    w->t = t;
    return entry;
}

/* ---- stage 1's points on one passage ---- */

typedef struct segment {
    uint start, count; /* splat: entries of the list */
    float t_in, step;  /* gather */
    float3 at, along;  /* gather: cell coordinates at t_in, and per unit of t */
    uint cache;        /* gather: first cell of the leaf */
} segment;

#if STAGE1 == 1
#define STAGE1_ARGUMENTS                                                                           \
    const __global ushort *restrict density, /* [leaf][n1^3] bfloat16 */                           \
        const __global float4 *restrict boxes, /* [leaf] */                                        \
        uint n1
#define STAGE1_PASS density, boxes, n1

HELPER segment segment_open(STAGE1_ARGUMENTS, float3 o, float3 d, float t_in, float t_out, int slot)
{
    const float4 box = boxes[slot];
    const float scale = (float)n1 / box.w;
    segment s;

    (void)density;
    s.start = 0;
    s.count = (uint)fmax(1.0f, ceil((t_out - t_in) * scale));
    s.t_in = t_in;
    s.step = (t_out - t_in) / (float)s.count;
    s.at = (MAD((float3)(t_in), d, o) - box.xyz) * scale;
    s.along = d * scale;
    s.cache = (uint)slot * n1 * n1 * n1;
    return s;
}

/* Densities of points j .. j + VW - 1; beyond the last one zero. */
HELPER vf segment_points(STAGE1_ARGUMENTS, const segment *s, uint j)
{
    const vi last = (vi)((int)n1 - 1), none = (vi)(0);
    const vf number = V_TO_FLOAT(V_IOTA + j), ahead = (number + 0.5f) * s->step;
    const vi x = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.x), (vf)(s->at.x))), none, last);
    const vi y = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.y), (vf)(s->at.y))), none, last);
    const vi z = clamp(V_TO_INT(MAD(ahead, (vf)(s->along.z), (vf)(s->at.z))), none, last);
    int cell[VW];
    float sigma[VW];

    (void)boxes;
    VSTORE((z * (int)n1 + y) * (int)n1 + x, cell);
#pragma unroll
    for (int l = 0; l < VW; l++)
        sigma[l] = as_float((uint)density[s->cache + (uint)cell[l]] << 16);
    return select((vf)(0.0f), VLOAD(sigma), number < (float)s->count);
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

/* Bins j .. j + VW - 1: right edges and densities; beyond the last one the chord's end and zero. */
HELPER void segment_bins(STAGE1_ARGUMENTS, const segment *s, uint j, float t_out, float right[VW],
                         float sigma[VW])
{
    const vf end = V_TO_FLOAT(V_IOTA + (j + 1u));

    VSTORE(select((vf)(t_out), MAD(end, (vf)(s->step), (vf)(s->t_in)), end < (float)s->count), right);
    VSTORE(segment_points(STAGE1_PASS, s, j), sigma);
}
#else
#define STAGE1_ARGUMENTS                                                                           \
    const __global uint *restrict list_start,     /* [list + 1] */                                 \
        const __global float *restrict list_t,    /* [entry] ascending within a list */            \
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

/* Bins j .. j + VW - 1: right edges and densities; beyond the last one the chord's end and zero. */
HELPER void segment_bins(STAGE1_ARGUMENTS, const segment *s, uint j, float t_out, float right[VW],
                         float sigma[VW])
{
    (void)list_start;
    for (uint l = 0; l < VW; l++) {
        const uint k = s->start + j + l;

        right[l] = j + l + 1u < s->count ? 0.5f * (list_t[k] + list_t[k + 1u]) : t_out;
        sigma[l] = j + l < s->count ? list_sigma[k] : 0.0f;
    }
}

/* Optical depth of a passage, by stage 1. */
HELPER float segment_depth(STAGE1_ARGUMENTS, const segment *s, float t_in, float t_out)
{
    float tau = 0.0f, edge = t_in, right[VW], sigma[VW];

    for (uint j = 0; j < s->count; j += VW) {
        segment_bins(STAGE1_PASS, s, j, t_out, right, sigma);
        for (uint l = 0; l < VW; l++) {
            tau = MAD(sigma[l], right[l] - edge, tau);
            edge = right[l];
        }
    }
    return tau;
}
#endif

/* The segment of ray r's passage through a leaf of `level`. */
#if STAGE1 == 1
#define SEGMENT_OF(r, o, d, t_in, t_out, slot, level)                                              \
    segment_open(STAGE1_PASS, o, d, t_in, t_out, slot)
#define LIST_ARGUMENTS
#else
/* grids: [batch view][level 0..5] {first list, coarsening, lists per row, longest list} */
#define LIST_ARGUMENTS                                                                             \
    , const __global cln_pixel *restrict pixels, const __global uint4 *restrict grids,             \
        const __global uint *restrict list_count /* [list] padded only */
HELPER uint list_of(const __global cln_pixel *pixels, const __global uint4 *grids, uint r, int level)
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
#define SEGMENT_OF(r, o, d, t_in, t_out, slot, level)                                              \
    segment_open(STAGE1_PASS, LIST_BEGIN(list_of(pixels, grids, r, level)),                        \
                 LIST_END(list_of(pixels, grids, r, level)), t_in, t_out)
#endif

/* 1 - exp(-tau) to 1e-6 relative, by a series where almost every point is: in thin space. */
HELPER float alpha_of(float tau)
{
    if (tau < 0.15f)
        return tau * MAD(tau, MAD(tau, MAD(tau, MAD(tau, 8.3333333e-3f, -4.1666667e-2f),
                                           1.6666667e-1f), -0.5f), 1.0f);
    return 1.0f - exp(-tau);
}

/* ---- intervals ---- */

__kernel void intervals_fill(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
                             const __global float4 *restrict ray_d, const __global int *restrict map,
                             __global cln_interval *restrict intervals, /* [ray][MAX_INTERVALS] */
                             __global uint *restrict used,         /* [ray] intervals with samples */
                             __global uint *restrict sample_counts, /* [ray] */
                             uint first, uint n, int depth, float max_depth, uint per_leaf, uint per_ray,
                             float empty_weight, float empty_share, uint2 seed,
                             uint step LIST_ARGUMENTS)
{
    const uint r = first + get_global_id(0);
    tree_ray w;
    uint kept = 0, samples = 0, index = 0;
    float tau = 0.0f;

    if (get_global_id(0) >= n)
        return;
    const float3 o = ray_o[r].xyz, d = ray_d[r].xyz;
    bool more = walk_start(&w, ray_o[r], ray_d[r], depth);

    while (more && tau <= max_depth) {
        const float t_in = w.t;
        float t_out;
        const int entry = walk_next(&w, map, depth, &t_out, &more), slot = (entry >> 4) - 1;
        const float length = t_out - t_in;

        if (slot < 0 || !(length > CLN_MIN_CHORD))
            continue;
        const segment s = SEGMENT_OF(r, o, d, t_in, t_out, slot, entry & 15);
        const float passage = segment_depth(STAGE1_PASS, &s, t_in, t_out);
        uint count;

#if ALLOCATE == 1
        const float weight = exp(-tau) * alpha_of(passage);

        if (weight < empty_weight)
            count = empty_share >= 1.0f ||
                    (empty_share > 0.0f &&
                     uniform4(seed, STREAM_SAMPLES, step, r, CLN_DRAW_ROULETTE + index).x <
                         empty_share);
        else
            count = min(per_leaf, 1u + (uint)(clamp(weight, 0.0f, 1.0f) * (float)per_ray + 0.5f));
#else
        /* diagonal of a leaf of this level: sqrt(3) * 2 / 2^level */
        count = max(1u, (uint)ceil((float)per_leaf * length /
                                   (3.46410162f / (float)(1 << (entry & 15)))));
#endif
        if (count > 0) {
            const cln_interval i = {t_in, t_out, slot, count | (uint)(entry & 15) << 24};

            intervals[r * MAX_INTERVALS(depth) + kept++] = i;
            samples += count;
        }
        tau += passage;
        index++;
    }
    used[r] = kept;
    sample_counts[r] = samples;
}

/* ---- samples ---- */

__kernel void samples_emit(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
                           const __global float4 *restrict ray_d,
                           const __global cln_interval *restrict intervals, /* [ray][MAX_INTERVALS] */
                           const __global uint *restrict used,          /* [ray] */
                           const __global uint *restrict sample_starts, /* [ray + 1] */
                           __global cln_sample *restrict samples,       /* [sample] */
                           uint first, uint n, int depth, float uniform_share, uint jitter, uint2 seed,
                           uint step LIST_ARGUMENTS)
{
    const uint r = first + get_global_id(0);
    uint at, drawn = 0;
    float4 random = (float4)(0.5f);

    if (get_global_id(0) >= n)
        return;
    const float3 o = ray_o[r].xyz, d = ray_d[r].xyz;

    at = sample_starts[r];
    if (jitter)
        random = uniform4(seed, STREAM_SAMPLES, step, r, 0u);
    for (uint i = 0; i < used[r]; i++) {
        const cln_interval v = intervals[r * MAX_INTERVALS(depth) + i];
        const uint count = v.count & 0xFFFFFFu;
        const float length = v.t_out - v.t_in;
        const segment s = SEGMENT_OF(r, o, d, v.t_in, v.t_out, v.slot, (int)(v.count >> 24));
        const uint bins = max(1u, s.count);
        const float even = uniform_share / length;
        float mass, floor_mass, edge = v.t_in, through = 1.0f, cdf = 0.0f;
        float left = v.t_in, last = 0.0f, right[VW], sigma[VW];
        uint k = 0;

        /* total mass, with a little everywhere so that no bin is unreachable */
#if CDF == 1
        floor_mass = EMPTY_BIN / length;
        mass = alpha_of(segment_depth(STAGE1_PASS, &s, v.t_in, v.t_out)) + EMPTY_BIN;
#else
        floor_mass = 0.0f;
        for (uint j = 0; j < s.count; j += VW) {
            segment_bins(STAGE1_PASS, &s, j, v.t_out, right, sigma);
            for (uint l = 0; l < VW; l++)
                floor_mass += sigma[l];
        }
        floor_mass = EMPTY_BIN * fmax(1.0f, floor_mass / (float)bins);
        mass = MAD(floor_mass, length, segment_depth(STAGE1_PASS, &s, v.t_in, v.t_out));
#endif
        const float steered = (1.0f - uniform_share) / mass;

        for (uint j = 0; k < count; j += VW) {
            segment_bins(STAGE1_PASS, &s, j, v.t_out, right, sigma);
            for (uint l = 0; l < VW && k < count; l++) {
                const float width = right[l] - edge;
#if CDF == 1
                const float alpha = alpha_of(fmin(sigma[l] * width, CLN_MAX_OPTICAL_DEPTH));
                const float p = MAD(through, alpha, floor_mass * width);

                through *= 1.0f - alpha;
#else
                const float p = (sigma[l] + floor_mass) * width;
#endif
                const float q = MAD(p, steered, even * width), next_cdf = cdf + q;

                while (k < count) {
                    const float u = ((float)k + random.x) / (float)count;

                    if (u >= next_cdf && j + l + 1u < bins)
                        break;
                    const float where =
                        clamp(edge + width * clamp((u - cdf) / q, 0.0f, 1.0f), v.t_in, v.t_out);

                    if (k > 0) { /* the sample before ends half way to this one */
                        const float middle = 0.5f * (last + where);

                        samples[at].t = last;
                        samples[at].delta = middle - left;
                        left = middle;
                        at++;
                    }
                    samples[at].ray = r;
                    samples[at].slot = v.slot;
                    last = where;
                    k++;
                    drawn++;
                    random = random.yzwx; /* the next sample's number to the front */
                    if (jitter && (drawn & 3u) == 0)
                        random = uniform4(seed, STREAM_SAMPLES, step, r, drawn >> 2);
                }
                cdf = next_cdf;
                edge = right[l];
            }
        }
        samples[at].t = last;
        samples[at].delta = v.t_out - left;
        at++;
    }
}
