/* needs: rng walk stage1 */
/* Rays through the tree, and stage 2's samples (method.md 3, 5, 7, 9; twins: host/reference/rays.c,
 * sampling.c). An interval is the part of a ray inside one leaf. Lanes run over rays while they
 * walk (walk.h), then over their intervals (stage1.h). A work-item has many rays, so that its lanes
 * are full: half of an object's rays meet no leaf.
 *
 *   intervals_fill    of each interval: ends, stage-1 optical depth, number of samples; none behind
 *                     opaque leaves; at most cln_octree_most_intervals() a ray
 *                                                                            -> scan of samples
 *   samples_emit      positions by inverse CDF, deltas; front to back
 *
 *   ALLOCATE 0 chord | 1 weight;  CDF 0 sigma | 1 weight
 *   CROP 0 | 1   1: intervals_fill cuts rays to what is inside of six planes (walk.h)
 */
#ifndef ALLOCATE
#define ALLOCATE 1
#define CDF      1
#endif
#if ALLOCATE > 1 || CDF > 1
#error "no code for this ALLOCATE or CDF"
#endif

/* The library's exp even with NATIVE: the number of samples depends on it. */
#undef EXP
#define EXP(x) exp(x)

#define EMPTY_BIN 1e-5f

/* Shell spaces: an interval is on one line of its ray. */
#if SHELL
#define LINE_ARGUMENT , const __global float4 *ray_o
#define LINE_PASS     , ray_o
#define SET_ROW(of, l, to) ((of)->row[l] = (to))
#else
#define LINE_ARGUMENT
#define LINE_PASS
#define SET_ROW(of, l, to)
#endif

/* ---- intervals ---- */

/* Groups of VW rays of a work-item: intervals of many rays leave few lanes empty. */
#define GROUPS (CLN_RAYS_EACH(VW) / VW)
#define RAYS   (GROUPS * VW)

/* Nodes that a ray walks before densities are read. More would be wasted behind opaque leaves. */
#define AHEAD (VW == 1 ? 4 : 8)

/* Marks a nearly empty interval, which gets one sample or none, by chance. */
#define ROULETTE (-1)

/* The intervals that a work-item's rays have just walked through; ray l's begin at l * AHEAD. */
typedef struct walked {
    float t_in[RAYS * AHEAD], t_out[RAYS * AHEAD];
    int entry[RAYS * AHEAD];
#if SHELL
    uint row[RAYS * AHEAD]; /* of their lines */
#endif
    uint found[RAYS];
} walked;

/* Rays l .. l + VW - 1 walk AHEAD nodes. */
HELPER void walk_ahead(walk *w, const __global int *map, int depth, walked *p, uint l)
{
    float t_in[VW], t_out[VW];
    int entry[VW];
    uint at[VW];

#pragma unroll
    for (uint i = 0; i < VW; i++)
        at[i] = (l + i) * AHEAD;
    for (int node = 0; node < AHEAD && V_ANY(w->more); node++) {
#if SHELL
        walk_line(w, depth);
#endif
        VSTORE(w->t, t_in);
        VSTORE(walk_next(w, map, depth), entry);
        VSTORE(w->t, t_out);
#pragma unroll
        for (int i = 0; i < VW; i++) {
            p->t_in[at[i]] = t_in[i];
            p->t_out[at[i]] = t_out[i];
            p->entry[at[i]] = entry[i];
#if SHELL
            p->row[at[i]] = w->row[i];
#endif
            at[i] += (entry[i] >= 16) & (t_out[i] - t_in[i] > CLN_MIN_CHORD);
        }
    }
#pragma unroll
    for (uint i = 0; i < VW; i++)
        p->found[l + i] = at[i] - (l + i) * AHEAD;
}

/* How samples are dealt to intervals, and the key of the roulette's draws. */
typedef struct allocation {
    uint per_leaf, per_ray;
    float empty_weight, empty_share;
    uint key;
} allocation;

/* Numbers of samples of intervals with optical depths `own`, behind depths `before`. */
HELPER vi sample_numbers(vf own, vf before, const bundle *b, vi level, const allocation *how)
{
#if ALLOCATE == 1
    const vf weight = EXP(-before) * ONE_MINUS_EXP(vf, own);
    const vi most =
        V_TO_INT(fmax(fmin(weight, (vf)(1.0f)), (vf)(0.0f)) * (float)how->per_ray + 0.5f);

    (void)b;
    (void)level;
    return select(min(most + 1, (vi)((int)how->per_leaf)), (vi)(ROULETTE),
                  weight < (vf)(how->empty_weight));
#else
    /* diagonal of a leaf of level 0: sqrt(3) * 2 */
    const vf share = (b->t_out - b->t_in) * V_TO_FLOAT((vi)(1) << level) / 3.46410162f;

    (void)own;
    (void)before;
    return max((vi)(1), V_TO_INT(ceil((float)how->per_leaf * share)));
#endif
}

/* VW intervals, one a lane. */
typedef struct turn {
    lanes of;
    uint whose[VW]; /* index among the work-item's rays; RAYS: none */
    bundle points;
} turn;

/* What only stage 1's last points hide keeps a quarter of the light: log(4). */
#define DOUBT 1.3862944f

/* What a work-item's rays have met so far: optical depth in all, the sure part of it, and what
 * counts of both; intervals, intervals with samples, and samples. */
typedef struct tally {
    float all[RAYS], sure[RAYS], tau[RAYS];
    uint met[RAYS], kept[RAYS], samples[RAYS];
} tally;

/* Each lane's remaining intervals: from `at` up to `upto`, of ray `whose`; next: the next ray. */
typedef struct places {
    uint at[VW], upto[VW], whose[VW], next;
} places;

/* Takes every lane's next interval: a lane finishes a ray, then takes the next ray. False if none
 * is left. */
HELPER bool turn_take(turn *t, places *o, const walked *p, const tally *sum, float max_depth,
                      uint begin, uint count)
{
    bool any = false;

    for (uint l = 0; l < VW; l++) {
        if (o->at[l] == o->upto[l] || sum->tau[o->whose[l]] > max_depth) {
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
            t->of.slot[l] = CLN_MAP_SLOT(p->entry[k]);
            t->of.level[l] = CLN_MAP_LEVEL(p->entry[k]);
            t->whose[l] = o->whose[l];
            any = true;
            SET_ROW(&t->of, l, p->row[k]);
        } else { /* an empty one */
            t->of.t_in[l] = t->of.t_out[l] = 0.0f;
            t->of.ray[l] = begin;
            t->of.slot[l] = t->of.level[l] = 0;
            SET_ROW(&t->of, l, begin * CLN_LINE_ROWS + 1u);
            t->whose[l] = RAYS;
        }
    }
    return any;
}

/* Which of a turn's intervals, if nearly empty, get a sample: 1, else 0. */
HELPER vi turn_roulette(const turn *t, const tally *sum, const allocation *how)
{
    vf chance = (vf)(0.0f);

    if (how->empty_share > 0.0f && how->empty_share < 1.0f) { /* else it decides nothing */
        uint draws[VW];

        for (int l = 0; l < VW; l++)
            draws[l] = CLN_DRAW_ROULETTE + sum->met[min(t->whose[l], RAYS - 1u)];
        chance = uniform_lanes_of(how->key, VLOAD(t->of.ray), VLOAD(draws), 0u);
    }
    return select((vi)(0), (vi)(1), chance < (vf)(how->empty_share));
}

/* Decides on a turn's intervals: writes those that get samples, and adds all to their rays. */
HELPER void turn_decide(const turn *t, tally *sum, const allocation *how, float max_depth,
                        uint begin, uint rays, __global cln_interval *intervals, STAGE1_ARGUMENTS)
{
    const bundle *b = &t->points;
    float all[VW], sure[VW], tau[VW], mass[VW];
    int numbers[VW];
    vf own_sure;

    for (uint l = 0; l < VW; l++) {
        const uint w = min(t->whose[l], RAYS - 1u);

        all[l] = sum->all[w];
        sure[l] = sum->sure[w];
        tau[l] = sum->tau[w];
    }
    const vf own = bundle_depth(b, STAGE1_PASS, &own_sure), before = VLOAD(tau);
    const vi number = sample_numbers(own, before, b, VLOAD(t->of.level), how);
    const vi drawn = turn_roulette(t, sum, how);

    VSTORE(select(number, drawn, number == (vi)(ROULETTE)), numbers);
    const vf met = VLOAD(all) + own, met_sure = VLOAD(sure) + own_sure;

    VSTORE(met, all);
    VSTORE(met_sure, sure);
    VSTORE(fmin(met, met_sure + DOUBT), tau);
#if CDF == 1
    VSTORE(ONE_MINUS_EXP(vf, own), mass);
#else
    VSTORE(own, mass);
#endif
    for (uint l = 0; l < VW; l++) {
        const uint w = t->whose[l], n_samples = (uint)numbers[l];

        if (w == RAYS || sum->tau[w] > max_depth)
            continue;
        if (n_samples > 0u) {
            const cln_interval v = {t->of.t_in[l], t->of.t_out[l], mass[l], t->of.slot[l],
                                    CLN_INTERVAL_COUNT(n_samples, t->of.level[l])};

            intervals[sum->kept[w]++ * rays + begin + w] = v;
            sum->samples[w] += n_samples;
        }
        sum->met[w]++;
        sum->all[w] = all[l];
        sum->sure[w] = sure[l];
        sum->tau[w] = tau[l];
    }
}

#if CROP
#define CROP_ARGUMENTS \
    , float4 crop_0, float4 crop_1, float4 crop_2, float4 crop_3, float4 crop_4, float4 crop_5
#else
#define CROP_ARGUMENTS
#endif

/* Work-item i: rays first + i RAYS .. first + i RAYS + RAYS - 1. They walk side by side; then lanes
 * go over their intervals. Data of the next intervals are fetched before these are decided on, in
 * vain if a ray turns out to end. */
__kernel void intervals_fill(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
                             const __global float4 *restrict ray_d,
                             const __global int *restrict map,
                             __global cln_interval *restrict intervals, /* [most intervals][rays] */
                             __global uint *restrict used, /* [ray] intervals with samples */
                             __global uint *restrict sample_counts, /* [ray] */
                             uint first, uint n, uint rays, int depth, float max_depth,
                             uint per_leaf, uint per_ray, float empty_weight, float empty_share,
                             uint2 seed, uint step CROP_ARGUMENTS LIST_ARGUMENTS)
{
    const uint begin = first + (uint)get_global_id(0) * RAYS, end = first + n;
    const uint count = begin < end ? min((uint)RAYS, end - begin) : 0u;
    const allocation how = {per_leaf, per_ray, empty_weight, empty_share,
                            stream_key(seed, STREAM_SAMPLES, step)};
    tally sum;
    walk walks[GROUPS];
    walked p;
    turn turns[2];
    bool more = count > 0u;

    for (uint l = 0; l < RAYS; l++) {
        sum.all[l] = sum.sure[l] = sum.tau[l] = 0.0f;
        sum.met[l] = sum.kept[l] = sum.samples[l] = p.found[l] = 0u;
    }
    for (uint g = 0; g * VW < count; g++)
        walk_start(&walks[g], ray_o, ray_d, begin + g * VW, end, depth);
#if CROP
    const float4 planes[6] = {crop_0, crop_1, crop_2, crop_3, crop_4, crop_5};

    for (uint g = 0; g * VW < count; g++)
#if SHELL
        walks[g].planes = planes;
#else
        walk_crop(&walks[g], planes, depth);
#endif
#endif
    while (more) {
        places at = {.next = 0u};
        uint now = 0;
        bool next = false;

        for (uint g = 0; g * VW < count; g++)
            walk_ahead(&walks[g], map, depth, &p, g * VW);
        for (int l = 0; l < VW; l++)
            at.at[l] = at.upto[l] = at.whose[l] = 0u;
        next = turn_take(&turns[0], &at, &p, &sum, max_depth, begin, count);
        if (next)
            bundle_begin(&turns[0].points, STAGE1_PASS, &turns[0].of, ray_o, ray_d LIST_PASS);
        for (; next; now ^= 1u) {
            turn *behind = &turns[now ^ 1u];

            next = turn_take(behind, &at, &p, &sum, max_depth, begin, count);
            if (next)
                bundle_begin(&behind->points, STAGE1_PASS, &behind->of, ray_o, ray_d LIST_PASS);
            turn_decide(&turns[now], &sum, &how, max_depth, begin, rays, intervals, STAGE1_PASS);
        }
        more = false;
        for (uint g = 0; g * VW < count; g++) {
            walks[g].more = walks[g].more & (VLOAD(sum.tau + g * VW) <= (vf)(max_depth));
            more |= V_ANY(walks[g].more) != 0;
        }
    }
    for (uint l = 0; l < count; l++) {
        used[begin + l] = sum.kept[l];
        sample_counts[begin + l] = sum.samples[l];
    }
}

/* ---- samples ---- */

#define NO_BORDER 2.0f /* above the distribution function */

/* Bins first .. first + bins - 1, of each lane. border[j], edge[j]: distribution function and t at
 * the start of bin j; rise: length of chord per unit of the function. */
typedef struct window {
    vi first;
    bool moved; /* away from bin 0 */
    int bins;   /* of the lane with the most */
    vf border[POINTS + 1], edge[POINTS + 1], rise[POINTS];
    vf begin[2], end[2]; /* function and optical depth at the window's start and end */
} window;

/* The distribution function of an interval: factors of the part that follows the densities, and of
 * the even part. */
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
        /* the last bin takes the rest */
        w->border[j] = select((vf)(NO_BORDER), f, w->first + j < b->count);
        w->edge[j] = left = right;
    } while (j < POINTS && V_ANY(w->first + j < b->count));
    w->bins = j;
    w->end[0] = f;
    w->end[1] = sum;
}

/* Moves the lanes of `move` to their next bins; the others compute the same ones again. */
HELPER void window_move(window *w, vi move)
{
    w->moved = true;
    w->first = select(w->first, w->first + w->bins, move);
    w->edge[0] = select(w->edge[0], w->edge[w->bins], move);
    w->begin[0] = select(w->begin[0], w->end[0], move);
    w->begin[1] = select(w->begin[1], w->end[1], move);
}

/* The windows' first bins. */
HELPER void window_begin(window *w, const bundle *b, blend mix, STAGE1_ARGUMENTS)
{
    w->first = (vi)(0);
    w->moved = false;
    w->edge[0] = b->t_in;
    w->begin[0] = w->begin[1] = (vf)(0.0f);
    window_fill(w, b, mix, STAGE1_PASS);
}

/* t where the function is u: in the last bin that begins at or before u. */
HELPER vf window_invert(const window *w, vf u)
{
    vf from = w->edge[0], below = w->border[0], slope = w->rise[0];

    for (int j = 1; j < w->bins; j++) {
        const vi past = u >= w->border[j];

        from = select(from, w->edge[j], past);
        below = select(below, w->border[j], past);
        slope = select(slope, w->rise[j], past);
    }
    return MAD(u - below, slope, from);
}

/* VW intervals, each with its number of samples, its first sample and its number along the ray. */
typedef struct batch {
    lanes of;
    float mass[VW];
    int number[VW];
    uint start[VW], interval[VW], filled, most; /* filled lanes; most samples of an interval */
    bundle points;
} batch;

/* The next interval and its first sample. */
typedef struct cursor {
    uint ray, interval, sample;
#if SHELL
    uint line; /* of the ray, from 1; they ascend along it */
#endif
} cursor;

#if SHELL
/* The row of the line that the ray's next interval is on. */
HELPER uint cursor_row(cursor *c, const __global float4 *ray_o, cln_interval v)
{
    const __global float4 *o = ray_o + c->ray * CLN_LINE_ROWS;

    while (c->line + 1u < CLN_LINE_ROWS && o[c->line + 1u].w <= 0.5f * (v.t_in + v.t_out))
        c->line++;
    return c->ray * CLN_LINE_ROWS + c->line;
}
#endif

/* Takes the next VW intervals of rays up to `end`. Lanes without one repeat the first. */
HELPER void batch_fill(batch *b, cursor *c, const __global cln_interval *intervals,
                       const __global uint *used, uint end, uint rays LINE_ARGUMENT)
{
    b->filled = b->most = 0u;
    while (b->filled < VW && c->ray < end) {
        if (c->interval == used[c->ray]) {
            c->ray++;
            c->interval = 0;
#if SHELL
            c->line = 1u;
#endif
            continue;
        }
        const cln_interval v = intervals[c->interval * rays + c->ray];
        const uint count = CLN_INTERVAL_SAMPLES(v.count);

        if (count == 0u) { /* another rank's (stretch.cl) */
            c->interval++;
            continue;
        }
        const uint l = b->filled++;

        b->of.t_in[l] = v.t_in;
        b->of.t_out[l] = v.t_out;
        b->of.ray[l] = c->ray;
        b->of.slot[l] = v.slot;
        b->of.level[l] = (int)CLN_INTERVAL_LEVEL(v.count);
        SET_ROW(&b->of, l, cursor_row(c, ray_o, v));
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
        SET_ROW(&b->of, l, b->of.row[0]);
        b->mass[l] = b->mass[0];
        b->number[l] = b->number[0];
        b->start[l] = b->start[0];
        b->interval[l] = b->interval[0];
    }
}

/* The parts of a batch's distribution functions, over the total mass of their intervals, with a
 * little everywhere, so that every bin can be reached. */
HELPER blend batch_blend(const batch *a, float uniform_share)
{
    const bundle *b = &a->points;
    const vf length = b->t_out - b->t_in;
#if CDF == 1
    const vf little = EMPTY_BIN / length, mass = VLOAD(a->mass) + EMPTY_BIN;
#else
    const vf mean = bundle_mean(b, VLOAD(a->mass));
    const vf little = EMPTY_BIN * fmax((vf)(1.0f), mean);
    const vf mass = MAD(little, length, VLOAD(a->mass));
#endif
    blend mix;

    mix.steered = (1.0f - uniform_share) / mass;
    mix.even = MAD(little, mix.steered, uniform_share / length);
    return mix;
}

/* Writes sample k of a batch's intervals; those that have fewer write their last one again. */
HELPER void batch_write(const batch *b, uint k, vf t, vf delta, __global cln_sample *samples)
{
    float ts[VW], deltas[VW];

    VSTORE(t, ts);
    VSTORE(delta, deltas);
#pragma unroll
    for (uint l = 0; l < VW; l++) {
        const cln_sample sample = {ts[l], deltas[l], ROW_OF(&b->of, l), b->of.slot[l]};

        samples[b->start[l] + min(k, (uint)b->number[l] - 1u)] = sample;
    }
}

/* Writes the samples of a batch's intervals. */
HELPER void batch_emit(const batch *now, float uniform_share, uint jitter, uint key,
                       __global cln_sample *samples, STAGE1_ARGUMENTS)
{
    const bundle *b = &now->points;
    const vi number = VLOAD(now->number);
    const blend mix = batch_blend(now, uniform_share);
    vf last = b->t_in, left = b->t_in, delta = (vf)(0.0f);
    window w;

    window_begin(&w, b, mix, STAGE1_PASS);
    /* a sample ends half way to the next one, so it is written once that is known */
    for (uint k = 0; k <= now->most; k++) {
        vf within = (vf)(0.5f);

        if (jitter)
            within = uniform_lanes_of(key, VLOAD(now->of.ray), VLOAD(now->interval), k);
        const vf u = ((float)k + within) / V_TO_FLOAT(number);
        const vi here = (vi)((int)k) < number, ends = (vi)((int)k) <= number;
        vi move = here & (u >= w.border[w.bins]);

        while (V_ANY(move)) {
            window_move(&w, move);
            window_fill(&w, b, mix, STAGE1_PASS);
            move = here & (u >= w.border[w.bins]);
        }
        const vf t = fmax(last, fmin(fmax(window_invert(&w, u), b->t_in), b->t_out));
        const vf middle = select(b->t_out, 0.5f * (last + t), here);

        if (k > 0u) {
            delta = select(delta, middle - left, ends);
            left = middle;
            batch_write(now, k - 1u, last, delta, samples);
        }
        last = select(last, t, here);
    }
}

/* Work-item i: rays first + i RAYS .. first + i RAYS + RAYS - 1, without the rays whose samples
 * would exceed `most` in total; lanes over their intervals. */
__kernel void
samples_emit(STAGE1_ARGUMENTS, const __global float4 *restrict ray_o,
             const __global float4 *restrict ray_d,
             const __global cln_interval *restrict intervals, /* [most intervals][rays] */
             const __global uint *restrict used,              /* [ray] */
             const __global uint *restrict sample_starts,     /* [ray + 1] */
             __global cln_sample *restrict samples,           /* [sample] */
             uint first, uint n, uint rays, uint most, float uniform_share, uint jitter, uint2 seed,
             uint step LIST_ARGUMENTS)
{
    const uint begin = first + (uint)get_global_id(0) * RAYS;
    uint end = min(begin + RAYS, first + n);
    batch batches[2];
    cursor c = {.ray = begin};

    while (begin < end && sample_starts[end] > most)
        end--;
    if (begin >= end)
        return;
    const uint key = stream_key(seed, STREAM_SAMPLES, step);

    c.sample = sample_starts[begin];
#if SHELL
    c.line = 1u;
#endif
    batch_fill(&batches[0], &c, intervals, used, end, rays LINE_PASS);
    if (batches[0].filled)
        bundle_begin(&batches[0].points, STAGE1_PASS, &batches[0].of, ray_o, ray_d LIST_PASS);
    for (uint turn = 0; batches[turn].filled; turn ^= 1u) {
        batch *next = &batches[turn ^ 1u];

        batch_fill(next, &c, intervals, used, end, rays LINE_PASS);
        if (next->filled)
            bundle_begin(&next->points, STAGE1_PASS, &next->of, ray_o, ray_d LIST_PASS);
        batch_emit(&batches[turn], uniform_share, jitter, key, samples, STAGE1_PASS);
    }
}
