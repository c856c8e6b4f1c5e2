/* Rays through the tree and stage 2's samples (method.md 3, 5, 7, 9; twin: host/reference/rays.c,
 * sampling.c). Lanes run over what is alike: rays while they walk, then passages through leaves. A
 * work-item has many rays, so that its lanes are full: half of an object's rays meet no leaf at all.
 *
 *   intervals_fill    per leaf on the ray: chord, stage-1 optical depth, number of samples; leaves
 *                     behind opaque ones are left out; at most MAX_INTERVALS(depth) a ray, as many as
 *                     cells a line can meet in the map                            -> scan of samples
 *   samples_emit      positions by inverse CDF, deltas; front to back
 *
 * Stage 1 is read through one interface, for VW passages at a time: bundle_open(), bundle_depth(),
 * bundle_bin() and bundle_mean(): the stage-1 points of a passage, ascending in t, with their densities; a bin
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

/* Every ray to where it leaves the leaf or empty box that it is in; returns their map entries, 0 of
 * rays that walk no more, as those do that leave the cube. Progress is by integers: the crossed axis
 * steps over the box's face, the others stay within its extent and never go back, so no rounding can trap
 * the walk. */
HELPER vi walk_next(walk *w, const __global int *map, int depth)
{
    const int n = 1 << depth;
    const float side = 2.0f / (float)n;
    const vi was_more = w->more;
    vi low[3], high[3], plane[3];
    vf exits[3], t = (vf)(NEVER);
    int at[VW], found[VW];

    /* rays that walk no more may stand outside the map */
    VSTORE(((((w->cell[2] << depth) + w->cell[1]) << depth) + w->cell[0]) & (n * n * n - 1), at);
#pragma unroll
    for (int l = 0; l < VW; l++)
        found[l] = map[at[l]];
    const vi entry = VLOAD(found), size = (vi)(1) << (depth - (entry & 15)),
             empty = entry < (vi)(0);

#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vi corner = w->cell[a] & -size;

        low[a] = select(corner, CLN_MAP_LOW(entry, a), empty);
        high[a] = select(corner + size, CLN_MAP_HIGH(entry, a), empty);
        plane[a] = select(low[a], high[a], w->ascends[a]);
        exits[a] = MAD(V_TO_FLOAT(plane[a]) * side - 1.0f - w->o[a], w->inverse[a], w->never[a]);
        t = fmin(t, exits[a]);
    }
    t = fmax(t, w->t);
    w->more = w->more & (t < (vf)(NEVER));
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vi over = plane[a] + ~w->ascends[a];
        /* never back, or rays along edges would go between two boxes for ever */
        const vi from = select(low[a], w->cell[a], w->ascends[a]);
        const vi to = select(w->cell[a], high[a] - 1, w->ascends[a]);
        const vi along = cell_of(w->o[a], w->d[a], t, 0.5f * (float)n, from, to);

        w->cell[a] = select(along, over, exits[a] <= t);
        w->more = w->more & (w->cell[a] >= (vi)(0)) & (w->cell[a] < (vi)(n));
    }
    w->t = t;
    return select((vi)(0), entry, was_more);
}

/* ---- stage 1's points on VW passages, one a lane ---- */

/* Points of a passage that are worked out at once: all of them for 12^3 cells, others come in turns. */
#define POINTS 24
#define KEPT   (VW > 1 ? POINTS : 0)

typedef struct bundle {
    vf t_in, t_out;
    vi count; /* points; splat: perhaps none */
#if STAGE1 == 1
    vf step, at[3], along[3]; /* cell coordinates at t_in, and per unit of t */
    const __global ushort *cells[VW];
#if KEPT > 0
    int kept[KEPT * VW]; /* which cells the first points read */
#endif
#else
    uint first[VW]; /* entries of the lists */
#endif
} bundle;

/* What passages a bundle is made of. Lanes without one hold any that there is. */
typedef struct lanes {
    float t_in[VW], t_out[VW];
    uint ray[VW];
    int slot[VW], level[VW];
} lanes;

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
        const float4 from = ray_o[p->ray[l]], along = ray_d[p->ray[l]], box = boxes[p->slot[l]];

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

/* Cells of points j. */
HELPER vi bundle_cells(const bundle *b, vi j, uint n1)
{
    const vi last = (vi)((int)n1 - 1), none = (vi)(0);
    const vf ahead = (V_TO_FLOAT(j) + 0.5f) * b->step;
    const vi x = clamp(V_TO_INT(MAD(ahead, b->along[0], b->at[0])), none, last);
    const vi y = clamp(V_TO_INT(MAD(ahead, b->along[1], b->at[1])), none, last);
    const vi z = clamp(V_TO_INT(MAD(ahead, b->along[2], b->at[2])), none, last);

    return (z * (int)n1 + y) * (int)n1 + x;
}

/* What the first points will read comes into the cache. */
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

/* Densities of points first + j, zero beyond the last one; first: a lane's own. */
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
    return select((vf)(0.0f), V_AS_FLOAT(V_TO_UINT(VLOAD(bits)) << 16), first + j < b->count);
}

/* Optical depths of the passages, by stage 1. */
HELPER vf bundle_depth(const bundle *b, STAGE1_ARGUMENTS)
{
    const vi none = (vi)(0);
    vf sum = (vf)(0.0f);

    for (int j = 0; V_ANY((vi)(j) < b->count); j++)
        sum += bundle_points(b, STAGE1_PASS, none, j, j < KEPT);
    return sum * b->step;
}

/* Bins first + j: densities, and right edges to *right; beyond the last one zero and the end of the chord. */
HELPER vf bundle_bin(const bundle *b, STAGE1_ARGUMENTS, vi first, int j, bool kept, vf *right)
{
    *right = select(b->t_out, MAD(V_TO_FLOAT(first + j + 1), b->step, b->t_in),
                    first + j + 1 < b->count);
    return bundle_points(b, STAGE1_PASS, first, j, kept);
}

/* Mean densities of the passages' points. */
HELPER vf bundle_mean(const bundle *b, STAGE1_ARGUMENTS, vf depth)
{
    return depth / (b->t_out - b->t_in); /* points are equally far apart */
}
#else
#define STAGE1_ARGUMENTS                                                                \
    const __global uint *restrict list_start,     /* [list + 1] */                      \
        const __global float *restrict list_t,    /* [entry] ascending within a list */ \
        const __global float *restrict list_sigma /* [entry] */
#define STAGE1_PASS list_start, list_t, list_sigma

/* grids: [batch view][level 0..5] {first list, coarsening, lists per row, longest list} */
#define LIST_ARGUMENTS                                                                 \
    , const __global cln_pixel *restrict pixels, const __global uint4 *restrict grids, \
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
        const uint4 grid = grids[pixel.pad * 6u + (uint)p->level[l]];
        const uint list = grid.x + pixel.y / grid.y * grid.z + pixel.x / grid.y;
#if PADDED
        const uint begin = list * grids[0].w, end = begin + list_count[list];
#else
        const uint begin = list_start[list], end = list_start[list + 1u];
#endif

        b->first[l] = lower_bound(list_t, begin, end, p->t_in[l]);
        count[l] = (int)(lower_bound(list_t, b->first[l], end, p->t_out[l]) - b->first[l]);
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

/* Bins first + j: densities, and right edges to *right; beyond the last one zero and the end of the chord. */
HELPER vf bundle_bin(const bundle *b, STAGE1_ARGUMENTS, vi first, int j, bool kept, vf *right)
{
    float edges[VW], sigma[VW];
    int bin[VW], count[VW];

    (void)list_start;
    (void)kept;
    VSTORE(first + j, bin);
    VSTORE(b->count, count);
    VSTORE(b->t_out, edges);
    for (int l = 0; l < VW; l++) {
        const uint k = b->first[l] + (uint)bin[l];

        if (bin[l] + 1 < count[l])
            edges[l] = 0.5f * (list_t[k] + list_t[k + 1u]);
        sigma[l] = bin[l] < count[l] ? list_sigma[k] : 0.0f;
    }
    *right = VLOAD(edges);
    return VLOAD(sigma);
}

/* Optical depths of the passages, by stage 1. */
HELPER vf bundle_depth(const bundle *b, STAGE1_ARGUMENTS)
{
    vf depth = (vf)(0.0f), left = b->t_in, right;

    for (int j = 0; V_ANY((vi)(j) < b->count); j++) {
        const vf sigma = bundle_bin(b, STAGE1_PASS, (vi)(0), j, false, &right);

        depth = MAD(sigma, right - left, depth);
        left = right;
    }
    return depth;
}

/* Mean densities of the passages' points. */
HELPER vf bundle_mean(const bundle *b, STAGE1_ARGUMENTS, vf depth)
{
    vf sum = (vf)(0.0f), right;

    (void)depth;
    for (int j = 0; V_ANY((vi)(j) < b->count); j++)
        sum += bundle_bin(b, STAGE1_PASS, (vi)(0), j, false, &right);
    return sum / V_TO_FLOAT(max((vi)(1), b->count));
}
#endif

/* ---- intervals ---- */

/* Groups of VW rays of a work-item: passages of many rays, so that few lanes stay empty. */
#define GROUPS (CLN_RAYS_EACH(VW) / VW)
#define RAYS   (GROUPS * VW)

/* Nodes that a ray walks before densities are read. More would walk in vain behind what is opaque. */
#define AHEAD (VW == 1 ? 4 : 8)

/* Samples of a passage that is nearly empty: one or none. */
#define ROULETTE (-1)

/* The passages that a work-item's rays have just walked through: those of ray l at l * AHEAD. */
typedef struct passages {
    float t_in[RAYS * AHEAD], t_out[RAYS * AHEAD];
    int entry[RAYS * AHEAD];
    uint found[RAYS];
} passages;

/* Rays l .. l + VW - 1 walk AHEAD nodes. */
HELPER void walk_ahead(walk *w, const __global int *map, int depth, passages *p, uint l)
{
    float t_in[VW], t_out[VW];
    int entry[VW];
    uint at[VW];

#pragma unroll
    for (uint i = 0; i < VW; i++)
        at[i] = (l + i) * AHEAD;
    for (int node = 0; node < AHEAD && V_ANY(w->more); node++) {
        VSTORE(w->t, t_in);
        VSTORE(walk_next(w, map, depth), entry);
        VSTORE(w->t, t_out);
#pragma unroll
        for (int i = 0; i < VW; i++) {
            p->t_in[at[i]] = t_in[i];
            p->t_out[at[i]] = t_out[i];
            p->entry[at[i]] = entry[i];
            at[i] += (entry[i] >= 16) & (t_out[i] - t_in[i] > CLN_MIN_CHORD);
        }
    }
#pragma unroll
    for (uint i = 0; i < VW; i++)
        p->found[l + i] = at[i] - (l + i) * AHEAD;
}

/* Numbers of samples of passages with these optical depths, at level `level`, behind tau. */
HELPER vi sample_numbers(vf passage, vf tau, const bundle *b, vi level, uint per_leaf, uint per_ray,
                         float empty_weight)
{
#if ALLOCATE == 1
    const vf weight = EXP(-tau) * ONE_MINUS_EXP(vf, passage);
    const vi most = V_TO_INT(fmax(fmin(weight, (vf)(1.0f)), (vf)(0.0f)) * (float)per_ray + 0.5f);

    (void)b;
    (void)level;
    return select(min(most + 1, (vi)((int)per_leaf)), (vi)(ROULETTE), weight < (vf)(empty_weight));
#else
    /* diagonal of a leaf of level 0: sqrt(3) * 2 */
    const vf share = (b->t_out - b->t_in) * V_TO_FLOAT((vi)(1) << level) / 3.46410162f;

    (void)passage;
    (void)tau;
    (void)per_ray;
    (void)empty_weight;
    return max((vi)(1), V_TO_INT(ceil((float)per_leaf * share)));
#endif
}

/* VW passages, one a lane. */
typedef struct turn {
    lanes of;
    uint whose[VW]; /* rays, of the work-item's; RAYS: no passage */
    bundle points;
} turn;

/* Where lanes are among the passages: from `at` up to `upto` of ray `whose`; which ray comes next. */
typedef struct places {
    uint at[VW], upto[VW], whose[VW], next;
} places;

/* The next passage of every lane, each along one ray and from an ended ray to the next. False if there is none. */
HELPER bool turn_take(turn *t, places *o, const passages *p, const float *taus, float max_depth,
                      uint begin, uint count)
{
    bool any = false;

    for (uint l = 0; l < VW; l++) {
        if (o->at[l] == o->upto[l] || taus[o->whose[l]] > max_depth) {
            o->at[l] = o->upto[l];
            while (o->next < count && p->found[o->next] == 0u)
                o->next++;
            if (o->next < count) {
                o->whose[l] = o->next;
                o->at[l] = o->next * AHEAD;
                o->upto[l] = o->at[l] + p->found[o->next++];
            }
        }
        if (o->at[l] < o->upto[l]) {
            const uint k = o->at[l]++;

            t->of.t_in[l] = p->t_in[k];
            t->of.t_out[l] = p->t_out[k];
            t->of.ray[l] = begin + o->whose[l];
            t->of.slot[l] = (p->entry[k] >> 4) - 1;
            t->of.level[l] = p->entry[k] & 15;
            t->whose[l] = o->whose[l];
            any = true;
        } else { /* an empty one */
            t->of.t_in[l] = t->of.t_out[l] = 0.0f;
            t->of.ray[l] = begin;
            t->of.slot[l] = t->of.level[l] = 0;
            t->whose[l] = RAYS;
        }
    }
    return any;
}

/* Work-item i: rays first + i RAYS .. first + i RAYS + RAYS - 1. They walk side by side; then lanes go over
 * their passages. What the next passages read is fetched before these are decided upon, in vain if a ray
 * turns out to end. */
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
    const uint begin = first + (uint)get_global_id(0) * RAYS, end = first + n;
    const uint count = begin < end ? min((uint)RAYS, end - begin) : 0u;
    const uint key = stream_key(seed, STREAM_SAMPLES, step);
    float taus[RAYS];
    uint met[RAYS], kept[RAYS], samples[RAYS]; /* of each ray: passages, intervals, samples */
    walk walks[GROUPS];
    passages p;
    turn turns[2];
    bool more = count > 0u;

    for (uint l = 0; l < RAYS; l++) {
        taus[l] = 0.0f;
        met[l] = kept[l] = samples[l] = p.found[l] = 0u;
    }
    for (uint g = 0; g * VW < count; g++)
        walk_start(&walks[g], ray_o, ray_d, begin + g * VW, end, depth);
    while (more) {
        places at = {.next = 0u};
        uint now = 0;
        bool next = false;

        for (uint g = 0; g * VW < count; g++)
            walk_ahead(&walks[g], map, depth, &p, g * VW);
        for (int l = 0; l < VW; l++)
            at.at[l] = at.upto[l] = at.whose[l] = 0u;
        next = turn_take(&turns[0], &at, &p, taus, max_depth, begin, count);
        if (next) {
            bundle_open(&turns[0].points, STAGE1_PASS, &turns[0].of, ray_o, ray_d LIST_PASS);
            bundle_fetch(&turns[0].points, STAGE1_PASS);
        }
        for (; next; now ^= 1u) {
            turn *t = &turns[now], *behind = &turns[now ^ 1u];
            const bundle *b = &t->points;
            float tau[VW], mass[VW];
            int numbers[VW];

            next = turn_take(behind, &at, &p, taus, max_depth, begin, count);
            if (next) {
                bundle_open(&behind->points, STAGE1_PASS, &behind->of, ray_o, ray_d LIST_PASS);
                bundle_fetch(&behind->points, STAGE1_PASS);
            }
            for (int l = 0; l < VW; l++)
                tau[l] = taus[min(t->whose[l], RAYS - 1u)];
            const vf passage = bundle_depth(b, STAGE1_PASS), before = VLOAD(tau);
            const vi number = sample_numbers(passage, before, b, VLOAD(t->of.level), per_leaf,
                                             per_ray, empty_weight);
            uint passed[VW];

            for (int l = 0; l < VW; l++)
                passed[l] = CLN_DRAW_ROULETTE + met[min(t->whose[l], RAYS - 1u)];
            const vf chance = uniform_lanes_of(key, VLOAD(t->of.ray), VLOAD(passed), 0u);
            const vi drawn = select((vi)(0), (vi)(1), chance < (vf)(empty_share));

            VSTORE(select(number, drawn, number == (vi)(ROULETTE)), numbers);
            VSTORE(before + passage, tau);
#if CDF == 1
            VSTORE(ONE_MINUS_EXP(vf, passage), mass);
#else
            VSTORE(passage, mass);
#endif
            for (uint l = 0; l < VW; l++) {
                const uint w = t->whose[l], r = begin + w, n_samples = (uint)numbers[l];

                if (w == RAYS || taus[w] > max_depth)
                    continue;
                if (n_samples > 0u) {
                    const cln_interval v = {t->of.t_in[l], t->of.t_out[l], mass[l], t->of.slot[l],
                                            n_samples | (uint)t->of.level[l] << 24};

                    intervals[kept[w]++ * rays + r] = v;
                    samples[w] += n_samples;
                }
                met[w]++;
                taus[w] = tau[l];
            }
        }
        more = false;
        for (uint g = 0; g * VW < count; g++) {
            walks[g].more = walks[g].more & (VLOAD(taus + g * VW) <= (vf)(max_depth));
            more |= V_ANY(walks[g].more) != 0;
        }
    }
    for (uint l = 0; l < count; l++) {
        used[begin + l] = kept[l];
        sample_counts[begin + l] = samples[l];
    }
}

/* ---- samples ---- */

#define NO_BORDER 2.0f /* above the distribution function */

/* Bins first .. first + bins - 1, a lane's own. Border j and edge j: the distribution function and t where bin
 * j begins; rise: length of chord per unit of the function. */
typedef struct window {
    vi first;
    bool moved; /* from bin 0 */
    int bins;   /* of the lane with the most */
    vf border[POINTS + 1], edge[POINTS + 1], rise[POINTS];
    vf begin[2], end[2]; /* function and optical depth where the first one begins and all end */
} window;

/* The distribution function of a passage: what is steered by densities, and what is even along the chord. */
typedef struct blend {
    vf steered, even;
} blend;

HELPER void window_fill(window *w, const bundle *b, blend mix, STAGE1_ARGUMENTS)
{
    vf left = w->edge[0], f = w->begin[0], sum = w->begin[1];
    int j = 0;

    w->border[0] = f;
    do {
        vf right;
        const vf sigma = bundle_bin(b, STAGE1_PASS, w->first, j, !w->moved, &right);
        const vf part = sigma * (right - left), below = f;
#if CDF == 1
        sum += fmin(part, (vf)(CLN_MAX_OPTICAL_DEPTH));
        const vf steer = ONE_MINUS_EXP(vf, sum);
#else
        sum += part;
        const vf steer = sum;
#endif

        f = MAD(steer, mix.steered, (right - b->t_in) * mix.even);
        w->rise[j] = (right - left) / fmax(f - below, (vf)(1e-30f));
        j++;
        /* the last bin takes all that is left */
        w->border[j] = select((vf)(NO_BORDER), f, w->first + j < b->count);
        w->edge[j] = left = right;
    } while (j < POINTS && V_ANY(w->first + j < b->count));
    w->bins = j;
    w->end[0] = f;
    w->end[1] = sum;
}

/* On to the bins behind, for the lanes that `move`; the others work out the same ones again. */
HELPER void window_move(window *w, vi move)
{
    w->moved = true;
    w->first = select(w->first, w->first + w->bins, move);
    w->edge[0] = select(w->edge[0], w->edge[w->bins], move);
    w->begin[0] = select(w->begin[0], w->end[0], move);
    w->begin[1] = select(w->begin[1], w->end[1], move);
}

/* VW intervals; of each the number of samples, the first one, and its own number along the ray. */
typedef struct batch {
    lanes of;
    float mass[VW];
    int number[VW];
    uint start[VW], interval[VW], filled, most; /* lanes that hold one; samples of one */
    bundle points;
} batch;

/* The interval that comes next, and its first sample. */
typedef struct cursor {
    uint ray, interval, sample;
} cursor;

/* The next VW intervals of rays up to `end`. Lanes without one hold the first one once more. */
HELPER void batch_fill(batch *b, cursor *c, const __global cln_interval *intervals,
                       const __global uint *used, uint end, uint rays)
{
    b->filled = b->most = 0u;
    while (b->filled < VW && c->ray < end) {
        if (c->interval == used[c->ray]) {
            c->ray++;
            c->interval = 0;
            continue;
        }
        const uint l = b->filled++;
        const cln_interval v = intervals[c->interval * rays + c->ray];
        const uint count = v.count & 0xFFFFFFu;

        b->of.t_in[l] = v.t_in;
        b->of.t_out[l] = v.t_out;
        b->of.ray[l] = c->ray;
        b->of.slot[l] = v.slot;
        b->of.level[l] = (int)(v.count >> 24);
        b->mass[l] = v.mass;
        b->number[l] = (int)count;
        b->start[l] = c->sample;
        b->interval[l] = c->interval++;
        b->most = max(b->most, count);
        c->sample += count;
    }
    for (uint l = b->filled; l < VW; l++) {
        b->of.t_in[l] = b->of.t_in[0];
        b->of.t_out[l] = b->of.t_out[0];
        b->of.ray[l] = b->of.ray[0];
        b->of.slot[l] = b->of.slot[0];
        b->of.level[l] = b->of.level[0];
        b->mass[l] = b->mass[0];
        b->number[l] = b->number[0];
        b->start[l] = b->start[0];
        b->interval[l] = b->interval[0];
    }
}

/* Work-item i: rays first + i RAYS .. first + i RAYS + RAYS - 1, but none that would reach past `most` samples;
 * lanes over their intervals. */
__kernel void
samples_emit(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
             const __global float4 *restrict ray_d,
             const __global cln_interval *restrict intervals, /* [MAX_INTERVALS][rays] */
             const __global uint *restrict used,              /* [ray] */
             const __global uint *restrict sample_starts,     /* [ray + 1] */
             __global cln_sample *restrict samples,           /* [sample] */
             uint first, uint n, uint rays, uint most, float uniform_share, uint jitter, uint2 seed,
             uint step LIST_ARGUMENTS)
{
    const uint begin = first + (uint)get_global_id(0) * RAYS;
    uint end = min(begin + RAYS, first + n);
    batch batches[2];
    cursor c = {begin, 0u, 0u};

    while (begin < end && sample_starts[end] > most)
        end--;
    if (begin >= end)
        return;
    const uint key = stream_key(seed, STREAM_SAMPLES, step);

    c.sample = sample_starts[begin];
    batch_fill(&batches[0], &c, intervals, used, end, rays);
    if (batches[0].filled) {
        bundle_open(&batches[0].points, STAGE1_PASS, &batches[0].of, ray_o, ray_d LIST_PASS);
        bundle_fetch(&batches[0].points, STAGE1_PASS);
    }
    for (uint turn = 0; batches[turn].filled; turn ^= 1u) {
        const batch *now = &batches[turn];
        const bundle *b = &now->points;
        batch *next = &batches[turn ^ 1u];
        window w;
        blend mix;

        batch_fill(next, &c, intervals, used, end, rays);
        if (next->filled) {
            bundle_open(&next->points, STAGE1_PASS, &next->of, ray_o, ray_d LIST_PASS);
            bundle_fetch(&next->points, STAGE1_PASS);
        }
        const vf length = b->t_out - b->t_in;
        const vi number = VLOAD(now->number);
        /* total mass, with a little everywhere so that no bin is unreachable */
#if CDF == 1
        const vf little = EMPTY_BIN / length, mass = VLOAD(now->mass) + EMPTY_BIN;
#else
        const vf mean = bundle_mean(b, STAGE1_PASS, VLOAD(now->mass));
        const vf little = EMPTY_BIN * fmax((vf)(1.0f), mean);
        const vf mass = MAD(little, length, VLOAD(now->mass));
#endif

        mix.steered = (1.0f - uniform_share) / mass;
        mix.even = MAD(little, mix.steered, uniform_share / length);
        w.first = (vi)(0);
        w.moved = false;
        w.edge[0] = b->t_in;
        w.begin[0] = w.begin[1] = (vf)(0.0f);
        window_fill(&w, b, mix, STAGE1_PASS);

        vf last = b->t_in, left = b->t_in, delta = (vf)(0.0f);

        /* a sample is written when the next one is known, half way to which it ends */
        for (uint k = 0; k <= now->most; k++) {
            const vf random = uniform_lanes_of(key, VLOAD(now->of.ray), VLOAD(now->interval), k);
            const vf u = ((float)k + (jitter ? random : (vf)(0.5f))) / V_TO_FLOAT(number);
            const vi here = (vi)((int)k) < number, ends = (vi)((int)k) <= number;
            vi move = here & (u >= w.border[w.bins]);

            while (V_ANY(move)) {
                window_move(&w, move);
                window_fill(&w, b, mix, STAGE1_PASS);
                move = here & (u >= w.border[w.bins]);
            }
            vf from = w.edge[0], below = w.border[0], slope = w.rise[0];

            for (int j = 1; j < w.bins; j++) { /* the last bin that begins at or before u */
                const vi past = u >= w.border[j];

                from = select(from, w.edge[j], past);
                below = select(below, w.border[j], past);
                slope = select(slope, w.rise[j], past);
            }
            const vf t = fmax(last, fmin(fmax(MAD(u - below, slope, from), b->t_in), b->t_out));
            const vf middle = select(b->t_out, 0.5f * (last + t), here);

            if (k > 0u) {
                float ts[VW], deltas[VW];

                delta = select(delta, middle - left, ends);
                left = middle;
                VSTORE(last, ts);
                VSTORE(delta, deltas);
#pragma unroll
                for (uint l = 0; l < VW; l++) { /* of those without more, the last one again */
                    const cln_sample sample = {ts[l], deltas[l], now->of.ray[l], now->of.slot[l]};

                    samples[now->start[l] + min(k, (uint)now->number[l]) - 1u] = sample;
                }
            }
            last = select(last, t, here);
        }
    }
}
