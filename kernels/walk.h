/* needs: shell */
/* The walk of rays through the octree (method.md 3; twin: host/reference/rays.c), VW rays side by
 * side, over the dense map of leaves and empty boxes (cln_octree_map, host/model/octree.h). For
 * sampling.cl, which decides what happens in the leaves.
 *
 *   CROP 0 | 1   1: rays walk only inside of six planes
 *   SHELL 0 | 1  1: they walk from line to line
 */
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
#if CROP || SHELL
    vf end; /* where it leaves the crop's planes, or its line */
#endif
#if SHELL
    const __global float4 *ray_o, *ray_d; /* [row] */
#if CROP
    const float4 *planes; /* of u */
#endif
    uint row[VW], last[VW]; /* of its line; of the ray's last */
#endif
} walk;

/* Truncation suffices: it differs from floor only below 0, which is clamped. */
HELPER vi cell_of(vf o, vf d, vf t, float half_n, vi low, vi high)
{
    return clamp(V_TO_INT((MAD(d, t, o) + 1.0f) * half_n), low, high);
}

#if SHELL
#if CROP
/* Cuts a line to the inside of the planes, which are of u. */
HELPER void line_crop(const float4 *planes, float3 o, float3 d, float *begin, float *end)
{
    const piece f = piece_of(MAD((float3)(0.5f * (*begin + *end)), d, o), 0.5f);

    for (int k = 0; k < 6; k++) {
        /* plane . (u, 1) times w, which is linear in p: 2 (1 - s p_a) in a face */
        float3 to = 2.0f * planes[k].xyz;
        float rest = planes[k].w;

        if (f.axis != CORE) {
            rest = MAD(f.sign, along_axis(planes[k].xyz, f.axis), 2.0f * planes[k].w);
            to = with_axis(to, f.axis, -2.0f * f.sign * planes[k].w);
        }
        const float here = dot(to, o) + rest, along = dot(to, d), t = -here / along;

        if (along > 0.0f)
            *begin = fmax(*begin, t);
        else if (along < 0.0f)
            *end = fmin(*end, t);
        else if (here < 0.0f)
            *end = -1.0f;
    }
}
#endif

/* Rays that are at the end of their line take the next one. */
HELPER void walk_line(walk *w, int depth)
{
    const vi none = (vi)(0), last = (vi)((1 << depth) - 1);
    const vi ended = w->more & (w->t >= w->end);
    float o[3][VW], d[3][VW], t[VW], end[VW];
    int turns[VW], more[VW];

    if (!V_ANY(ended))
        return;
#pragma unroll
    for (int a = 0; a < 3; a++) {
        VSTORE(w->o[a], o[a]);
        VSTORE(w->d[a], d[a]);
    }
    VSTORE(w->t, t);
    VSTORE(w->end, end);
    VSTORE(w->more, more);
    VSTORE(ended, turns);
    for (int l = 0; l < VW; l++) {
        if (!turns[l])
            continue;
        more[l] = 0;
        while (!more[l] && w->row[l] < w->last[l]) {
            const float4 from = w->ray_o[++w->row[l]], along = w->ray_d[w->row[l]];
            float begin = from.w, until = along.w;

            if (begin >= NEVER)
                break;
#if CROP
            line_crop(w->planes, from.xyz, along.xyz, &begin, &until);
#endif
            if (until > begin) {
                o[0][l] = from.x;
                o[1][l] = from.y;
                o[2][l] = from.z;
                d[0][l] = along.x;
                d[1][l] = along.y;
                d[2][l] = along.z;
                t[l] = begin;
                end[l] = until;
                more[l] = -1;
            }
        }
    }
    w->t = VLOAD(t);
    w->end = VLOAD(end);
    w->more = VLOAD(more);
#pragma unroll
    for (int a = 0; a < 3; a++) {
        w->o[a] = VLOAD(o[a]);
        w->d[a] = VLOAD(d[a]);
        const vi parallel = fabs(w->d[a]) < (vf)(1e-12f);

        w->inverse[a] = select((vf)(1.0f) / w->d[a], (vf)(0.0f), parallel);
        w->never[a] = select((vf)(0.0f), (vf)(NEVER), parallel);
        w->ascends[a] = select(none, (vi)(-1), w->inverse[a] > (vf)(0.0f));
        w->cell[a] = select(
            w->cell[a],
            cell_of(w->o[a], w->d[a], w->t, 0.5f * (float)(1 << depth), none, last), ended);
    }
}

/* Starts rays first .. first + VW - 1, each before its first line; those from `end` on do not
 * walk. */
HELPER void walk_start(walk *w, const __global float4 *ray_o, const __global float4 *ray_d,
                       uint first, uint end, int depth)
{
    w->ray_o = ray_o;
    w->ray_d = ray_d;
#pragma unroll
    for (uint l = 0; l < VW; l++) {
        w->row[l] = min(first + l, end - 1u) * CLN_LINE_ROWS;
        w->last[l] = w->row[l] + CLN_SPACE_LINES;
    }
    w->more = V_TO_INT(V_IOTA) < (vi)((int)(end - first));
    w->t = w->end = (vf)(0.0f);
#pragma unroll
    for (int a = 0; a < 3; a++) {
        w->o[a] = w->d[a] = (vf)(0.0f);
        w->cell[a] = (vi)(0);
    }
    (void)depth;
}
#else
/* Starts rays first .. first + VW - 1 where they enter the cube; those from `end` on, and those
 * that miss it, do not walk. Components under 1e-12 count as zero. */
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

#endif

#if CROP && !SHELL
/* Cuts rays that have just started to the inside of the planes: plane.xyz . p + plane.w >= 0. */
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
#if SHELL /* beyond the map, the line has ended */
        t = select(w->end, t, (w->cell[a] >= (vi)(0)) & (w->cell[a] < (vi)(n)));
#else
        w->more = w->more & (w->cell[a] >= (vi)(0)) & (w->cell[a] < (vi)(n));
#endif
    }
#if CROP && !SHELL
    w->more = w->more & (t < w->end);
    t = fmin(t, w->end);
#endif
#if SHELL
    t = fmin(t, w->end);
#endif
    w->t = t;
    return select((vi)(0), entry, was_more);
}
