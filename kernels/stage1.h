/* needs: leaves fetch bfloat16 shell */
/* Stage 1 along rays (method.md 4, 5): the points of VW intervals at a time, one interval per lane,
 * by bundle_begin(), bundle_depth(), bundle_bin() and bundle_mean(). An interval's points ascend in
 * t and have densities; a point's bin reaches half way to its neighbours, the first and last to the
 * interval's ends, and no further than its reach: gaps between have density 0 and are bins, too.
 * For sampling.cl. Two methods give the points:
 *
 *   STAGE1 1 (gather)  points of the interval, spaced like the cells, with the nearest cell's
 *                      cached density; their reach has no end
 *   STAGE1 0 (splat)   samples projected into the views, sorted by (list, t); list = coarse pixel
 *                      of the leaf's level (splat.cl)
 *
 *   PADDED 0 | 1    1: lists are at list * longest
 *   DROPPED 0 | 1   1: faint samples are not in the lists, so the others have a reach
 */
#ifndef STAGE1
#define STAGE1  1
#define PADDED  0
#define DROPPED 1
#endif
#if STAGE1 > 1
#error "no code for this STAGE1"
#endif
#ifndef LEVELS
#define LEVELS 6u /* of the tree, from the host */
#endif

/* Points of an interval that are computed at once: all of them with 12^3 cells; more take turns. */
#define POINTS 24
#define KEPT   (VW > 1 ? POINTS : 0)

typedef struct bundle {
    vf t_in, t_out;
    vi count; /* bins: one per point, and with DROPPED one per gap around them */
#if STAGE1 == 1
    vf step, at[3], along[3]; /* cell coordinates at t_in, and per unit of t */
    const __global ushort *cells[VW];
#if KEPT > 0
    int kept[KEPT * VW]; /* cells of the first points */
#endif
#else
    uint first[VW]; /* entries of the lists */
    float cell[VW], spread[VW];
#endif
} bundle;

/* The intervals of a bundle. Lanes without one have a copy of another, or an empty one. */
typedef struct lanes {
    float t_in[VW], t_out[VW];
    uint ray[VW];
    int slot[VW], level[VW];
#if SHELL
    uint row[VW]; /* of its line */
#endif
} lanes;
#if SHELL
#define ROW_OF(of, l) ((of)->row[l])
#else
#define ROW_OF(of, l) ((of)->ray[l])
#endif

#if STAGE1 == 1
#define STAGE1_ARGUMENTS                                                   \
    LEAF_ARRAY(const ushort, density),         /* [leaf][n1^3] bfloat16 */ \
        const __global float4 *restrict boxes, /* [leaf] */                \
        uint n1
#define STAGE1_PASS LEAF_PASS(density), boxes, n1
#define LIST_ARGUMENTS
#define LIST_PASS

HELPER void bundle_open(bundle *b, STAGE1_ARGUMENTS, const lanes *p, const __global float4 *ray_o,
                        const __global float4 *ray_d LIST_ARGUMENTS)
{
    float o[3][VW], d[3][VW], low[3][VW], side[VW];

#pragma unroll
    for (int l = 0; l < VW; l++) {
        const float4 from = ray_o[ROW_OF(p, l)], along = ray_d[ROW_OF(p, l)];
        const float4 box = boxes[p->slot[l]];

        o[0][l] = from.x;
        o[1][l] = from.y;
        o[2][l] = from.z;
        d[0][l] = along.x;
        d[1][l] = along.y;
        d[2][l] = along.z;
        low[0][l] = box.x;
        low[1][l] = box.y;
        low[2][l] = box.z;
        side[l] = box.w;
        b->cells[l] = LEAF_ROW(density, p->slot[l], n1 * n1 * n1);
    }
    const vf scale = (float)n1 / VLOAD(side);

    b->t_in = VLOAD(p->t_in);
    b->t_out = VLOAD(p->t_out);
    const vf cells = (b->t_out - b->t_in) * scale;
    const vi whole = V_TO_INT(cells);

    b->count = max((vi)(1), select(whole, whole + 1, V_TO_FLOAT(whole) < cells)); /* ceil */
    b->step = (b->t_out - b->t_in) / V_TO_FLOAT(b->count);
#pragma unroll
    for (int a = 0; a < 3; a++) {
        b->at[a] = (MAD(b->t_in, VLOAD(d[a]), VLOAD(o[a])) - VLOAD(low[a])) * scale;
        b->along[a] = VLOAD(d[a]) * scale;
    }
}

/* The cells that hold the points j. */
HELPER vi bundle_cells(const bundle *b, vi j, uint n1)
{
    const vi last = (vi)((int)n1 - 1), none = (vi)(0);
    const vf ahead = (V_TO_FLOAT(j) + 0.5f) * b->step;
    const vi x = clamp(V_TO_INT(MAD(ahead, b->along[0], b->at[0])), none, last);
    const vi y = clamp(V_TO_INT(MAD(ahead, b->along[1], b->at[1])), none, last);
    const vi z = clamp(V_TO_INT(MAD(ahead, b->along[2], b->at[2])), none, last);

    return (z * (int)n1 + y) * (int)n1 + x;
}

/* Fetches the cells of the first points. */
HELPER void bundle_fetch(bundle *b, STAGE1_ARGUMENTS)
{
    (void)boxes;
#if KEPT > 0
    for (int j = 0; j < KEPT && V_ANY((vi)(j) < b->count); j++) {
        VSTORE(bundle_cells(b, (vi)(j), n1), b->kept + j * VW);
#pragma unroll
        for (int l = 0; l < VW; l++)
            FETCH(b->cells[l] + b->kept[j * VW + l]);
    }
#endif
}

/* Densities of points first + j, zero after the last one; `first` differs between lanes. */
HELPER vf bundle_points(const bundle *b, STAGE1_ARGUMENTS, vi first, int j, bool kept)
{
    ushort bits[VW];

    (void)boxes;
#if KEPT > 0
    if (kept) {
#pragma unroll
        for (int l = 0; l < VW; l++)
            bits[l] = b->cells[l][b->kept[j * VW + l]];
    } else
#endif
    {
        int cell[VW];

        VSTORE(bundle_cells(b, first + j, n1), cell);
#pragma unroll
        for (int l = 0; l < VW; l++)
            bits[l] = b->cells[l][cell[l]];
    }
    return select((vf)(0.0f), bfloat16_values(VLOAD(bits)), first + j < b->count);
}

/* Optical depths of the intervals. *sure: without their last points. A cell is dense if a part of
 * it is, which a ray may pass that goes on into the next leaf. */
HELPER vf bundle_depth(const bundle *b, STAGE1_ARGUMENTS, vf *sure)
{
    const vi none = (vi)(0);
    vf sum = (vf)(0.0f), last = (vf)(0.0f);

    for (int j = 0; V_ANY((vi)(j) < b->count); j++) {
        const vf sigma = bundle_points(b, STAGE1_PASS, none, j, j < KEPT);

        sum += sigma;
        last = select(last, sigma, (vi)(j) < b->count);
    }
    *sure = (sum - last) * b->step;
    return sum * b->step;
}

/* Bins first + j: densities, and right edges to *right; beyond the last one zero and the interval's
 * end. */
HELPER vf bundle_bin(const bundle *b, STAGE1_ARGUMENTS, vi first, int j, bool kept, vf *right)
{
    *right = select(b->t_out, MAD(V_TO_FLOAT(first + j + 1), b->step, b->t_in),
                    first + j + 1 < b->count);
    return bundle_points(b, STAGE1_PASS, first, j, kept);
}
#else
#define STAGE1_ARGUMENTS                                                                \
    const __global uint *restrict list_start,     /* [list + 1] */                      \
        const __global float *restrict list_t,    /* [entry] ascending within a list */ \
        const __global float *restrict list_sigma /* [entry] */
#define STAGE1_PASS list_start, list_t, list_sigma

/* grids: [batch view][LEVELS] */
#define LIST_ARGUMENTS                                                                    \
    , const __global cln_pixel *restrict pixels, const __global cln_grid *restrict grids, \
        const __global uint *restrict list_count /* [list] padded only */
#define LIST_PASS , pixels, grids, list_count

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

HELPER void bundle_open(bundle *b, STAGE1_ARGUMENTS, const lanes *p, const __global float4 *ray_o,
                        const __global float4 *ray_d LIST_ARGUMENTS)
{
    int count[VW];

    (void)list_sigma;
    (void)ray_o;
    (void)ray_d;
    for (int l = 0; l < VW; l++) {
        const cln_pixel pixel = pixels[p->ray[l]];
        const cln_grid grid = grids[pixel.spot * LEVELS + (uint)p->level[l]];
        const uint list = grid.first + pixel.y / grid.coarse_y * grid.row + pixel.x / grid.coarse_x;
#if PADDED
        const uint begin = list * grids[0].longest, end = begin + list_count[list];
#else
        const uint begin = list_start[list], end = list_start[list + 1u];
#endif

        b->first[l] = lower_bound(list_t, begin, end, p->t_in[l]);
        count[l] = (int)(lower_bound(list_t, b->first[l], end, p->t_out[l]) - b->first[l]);
#if DROPPED
        count[l] = 2 * count[l] + 1;
#endif
        b->cell[l] = grid.cell;
        b->spread[l] = grid.spread;
    }
    b->t_in = VLOAD(p->t_in);
    b->t_out = VLOAD(p->t_out);
    b->count = VLOAD(count);
}

HELPER void bundle_fetch(bundle *b, STAGE1_ARGUMENTS)
{
    (void)list_start;
    (void)list_t;
    for (int l = 0; l < VW; l++)
        FETCH(list_sigma + b->first[l]);
}

#if DROPPED
/* Distance from a point to its bin's edge, given the distance to the middle between it and its
 * neighbour, or to the interval's end. Where that is too far, samples between were left out as
 * faint. */
HELPER float bundle_reach(float distance, float length)
{
    return distance > 1.5f * length ? 0.5f * length : distance;
}

/* Bin `bin` of `count` of lane l: density to *sigma, right edge to *end, which holds the interval's
 * end on entry. Bin 2 i + 1 is point i's, bin 2 i the gap before it. */
HELPER void bundle_lane(const bundle *b, STAGE1_ARGUMENTS, int l, int bin, int count, float start,
                        float *end, float *sigma)
{
    const uint k = b->first[l] + (uint)bin / 2u;

    (void)list_start;
    *sigma = 0.0f;
    if (bin + 1 >= count)
        return;
    const float t = list_t[k];
    const float length = fmax(b->cell[l], b->spread[l] / fmax(t * t, 1e-12f));

    if (bin & 1) {
        const float after = bin + 2 < count ? 0.5f * (t + list_t[k + 1u]) : *end;

        *end = t + bundle_reach(after - t, length);
        *sigma = list_sigma[k];
    } else {
        const float before = bin > 0 ? 0.5f * (list_t[k - 1u] + t) : start;

        *end = t - bundle_reach(t - before, length);
    }
}
#else
/* Bin `bin` of `count` of lane l, which is a point's: density to *sigma, right edge to *end, which
 * holds the interval's end on entry. */
HELPER void bundle_lane(const bundle *b, STAGE1_ARGUMENTS, int l, int bin, int count, float start,
                        float *end, float *sigma)
{
    const uint k = b->first[l] + (uint)bin;

    (void)list_start;
    (void)start;
    if (bin + 1 < count)
        *end = 0.5f * (list_t[k] + list_t[k + 1u]);
    *sigma = bin < count ? list_sigma[k] : 0.0f;
}
#endif

/* Bins first + j: densities, and right edges to *right; beyond the last one zero and the interval's
 * end. */
HELPER vf bundle_bin(const bundle *b, STAGE1_ARGUMENTS, vi first, int j, bool kept, vf *right)
{
    float ends[VW], starts[VW], sigma[VW];
    int bin[VW], count[VW];

    (void)kept;
    VSTORE(first + j, bin);
    VSTORE(b->count, count);
    VSTORE(b->t_out, ends);
    VSTORE(b->t_in, starts);
    for (int l = 0; l < VW; l++)
        bundle_lane(b, STAGE1_PASS, l, bin[l], count[l], starts[l], &ends[l], &sigma[l]);
    *right = VLOAD(ends);
    return VLOAD(sigma);
}

/* Optical depths of the intervals; all of it is sure. */
HELPER vf bundle_depth(const bundle *b, STAGE1_ARGUMENTS, vf *sure)
{
    vf depth = (vf)(0.0f), left = b->t_in, right;

    for (int j = 0; V_ANY((vi)(j) < b->count); j++) {
        const vf sigma = bundle_bin(b, STAGE1_PASS, (vi)(0), j, false, &right);

        depth = MAD(sigma, right - left, depth);
        left = right;
    }
    *sure = depth;
    return depth;
}
#endif

/* Opens the bundle and fetches its data. */
HELPER void bundle_begin(bundle *b, STAGE1_ARGUMENTS, const lanes *p, const __global float4 *ray_o,
                         const __global float4 *ray_d LIST_ARGUMENTS)
{
    bundle_open(b, STAGE1_PASS, p, ray_o, ray_d LIST_PASS);
    bundle_fetch(b, STAGE1_PASS);
}

/* Mean densities of the intervals. */
HELPER vf bundle_mean(const bundle *b, vf depth)
{
    return depth / (b->t_out - b->t_in);
}
