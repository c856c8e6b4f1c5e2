/* The walk of rays through the octree (method.md 3; twin: host/reference/rays.c), VW rays side by
 * side, over the dense map of leaves and empty boxes (cln_octree_map, host/model/octree.h). For
 * sampling.cl, which decides what happens in the leaves.
 *
 *   CROP 0 | 1   1: rays walk only inside of six planes
 */
#define NEVER 1e30f
#ifndef CROP
#define CROP 0
#endif

typedef struct walk {
    vf o[3], d[3], inverse[3];
    vf never[3];   /* NEVER for an axis whose planes the ray never crosses, else 0 */
    vi ascends[3]; /* all bits set for an axis along which the ray ascends, else none */
    vi cell[3];    /* of the map */
    vf t;          /* the ray's position */
    vi more;       /* it walks on: a mask like a vector comparison's */
#if CROP
    vf end; /* where it leaves what is inside */
#endif
} walk;

/* Truncation suffices: it differs from floor only below 0, which is clamped. */
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

#if CROP
/* Cuts rays that have just started to what is inside: plane.xyz . p + plane.w >= 0. */
HELPER void walk_crop(walk *w, const float4 *planes, int depth)
{
    const vi none = (vi)(0), last = (vi)((1 << depth) - 1);
    vf begin = w->t;

    w->end = (vf)(NEVER);
    for (int k = 0; k < 6; k++) {
        const float4 plane = planes[k];
        const vf here = MAD((vf)(plane.x), w->o[0],
                            MAD((vf)(plane.y), w->o[1],
                                MAD((vf)(plane.z), w->o[2], (vf)(plane.w))));
        const vf along =
            MAD((vf)(plane.x), w->d[0], MAD((vf)(plane.y), w->d[1], plane.z * w->d[2]));
        const vi parallel = fabs(along) < (vf)(1e-12f);
        const vf t = -here / select(along, (vf)(1.0f), parallel);

        begin = select(begin, fmax(begin, t), along >= (vf)(1e-12f));
        w->end = select(w->end, fmin(w->end, t), along <= (vf)(-1e-12f));
        w->more = select(w->more, none, parallel & (here < (vf)(0.0f)));
    }
    w->more = w->more & (w->end > begin);
    w->t = begin;
#pragma unroll
    for (int a = 0; a < 3; a++)
        w->cell[a] = cell_of(w->o[a], w->d[a], begin, 0.5f * (float)(1 << depth), none, last);
}
#endif

/* Moves every ray to the exit of its current leaf or empty box. Returns the map entries of these
 * boxes, 0 for rays that have stopped; a ray stops when it leaves the cube. Progress is in
 * integers: the crossed axis steps over the box's face, the others stay within its extent and never
 * go back, so rounding cannot trap the walk. */
HELPER vi walk_next(walk *w, const __global int *map, int depth)
{
    const int n = 1 << depth;
    const float side = 2.0f / (float)n;
    const vi was_more = w->more;
    vi low[3], high[3], plane[3];
    vf exits[3], t = (vf)(NEVER);
    int at[VW], found[VW];

    /* rays that have stopped may be outside the map */
    VSTORE(((((w->cell[2] << depth) + w->cell[1]) << depth) + w->cell[0]) & (n * n * n - 1), at);
#pragma unroll
    for (int l = 0; l < VW; l++)
        found[l] = map[at[l]];
    const int unit = CLN_MAP_UNIT(depth);
    const vi entry = VLOAD(found), size = (vi)(1) << (depth - CLN_MAP_LEVEL(entry)),
             box = CLN_MAP_IS_BOX(entry);

#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vi corner = w->cell[a] & -size;

        low[a] = select(corner, CLN_MAP_LOW(entry, a) << unit, box);
        high[a] = select(corner + size, CLN_MAP_HIGH(entry, a) << unit, box);
        plane[a] = select(low[a], high[a], w->ascends[a]);
        exits[a] = MAD(V_TO_FLOAT(plane[a]) * side - 1.0f - w->o[a], w->inverse[a], w->never[a]);
        t = fmin(t, exits[a]);
    }
    t = fmax(t, w->t);
    w->more = w->more & (t < (vf)(NEVER));
#pragma unroll
    for (int a = 0; a < 3; a++) {
        const vi over = plane[a] + ~w->ascends[a];
        /* never back: a ray along an edge could step between two boxes forever */
        const vi from = select(low[a], w->cell[a], w->ascends[a]);
        const vi to = select(w->cell[a], high[a] - 1, w->ascends[a]);
        const vi along = cell_of(w->o[a], w->d[a], t, 0.5f * (float)n, from, to);

        w->cell[a] = select(along, over, exits[a] <= t);
        w->more = w->more & (w->cell[a] >= (vi)(0)) & (w->cell[a] < (vi)(n));
    }
#if CROP
    w->more = w->more & (t < w->end);
    t = fmin(t, w->end);
#endif
    w->t = t;
    return select((vi)(0), entry, was_more);
}
