/* needs: loss */
/* Compositing of rays whose samples are on several ranks (host/pipeline/stretch.h). A stretch is a
 * run of a ray's intervals in leaves of one rank. All ranks know all intervals; a rank has only the
 * samples of its own leaves, and composites its own stretches as if nothing were before them. From
 * the sums of all stretches it computes the ray's colour, its loss and its own samples' gradient,
 * equal to composite.cl's up to rounding (twin: host/reference/composite.c).
 *
 *   sums[k] of a stretch, T counted from its begin, t from the ray's first interval:
 *     [0] sum w_i c_i; optical depth        [1] length, sum w_i t_i, distortion, cauchy
 *     with DEPTH_LOSS: [2] sum w_i |t_i - t*|
 *   T_k = exp(-optical depths before k);  C = sum_k T_k C_k + T_end background
 *   S behind stretch k = sum over the stretches behind it of sum_i w_i G_i, + T_end dL/dT_end
 *
 * One work-item per ray; stretches of ray r: stretch_starts[r] to stretch_starts[r + 1], front to
 * back; samples of stretch k that are here: stretch_first[k] to stretch_first[k + 1]. */

#define SUMS (2u + DEPTH_LOSS)

/* A ray's intervals; 0 if its samples and those before are more than `most`, but for the first
 * ray: it will be cut off the batch. */
HELPER uint intervals_of(const __global uint *used, const __global uint *sample_starts, uint r,
                         uint most)
{
    return r > 0u && sample_starts[r + 1u] > most ? 0u : used[r];
}

/* Counts a ray's stretches, and its samples here. leaf_rank: [leaf]. */
__kernel void stretch_count(const __global cln_interval *restrict intervals, /* [most][rays] */
                            const __global uint *restrict used,              /* [ray] */
                            const __global uint *restrict sample_starts,     /* [ray + 1] */
                            const __global uint *restrict leaf_rank,
                            __global uint *restrict own_counts, /* [ray] samples */
                            __global uint *restrict stretch_counts, uint n, uint rays, uint me,
                            uint most)
{
    const uint r = get_global_id(0);
    uint own = 0, count = 0, before = UINT_MAX;

    if (r >= n)
        return;
    for (uint k = 0; k < intervals_of(used, sample_starts, r, most); k++) {
        const cln_interval v = intervals[k * rays + r];
        const uint rank = leaf_rank[v.slot];

        count += rank != before;
        before = rank;
        own += rank == me ? CLN_INTERVAL_SAMPLES(v.count) : 0u;
    }
    own_counts[r] = own;
    stretch_counts[r] = count;
}

/* Lists the stretches, and sets the sample counts of other ranks' intervals to 0. */
__kernel void stretch_list(__global cln_interval *restrict intervals, /* [most][rays] */
                           const __global uint *restrict used,
                           const __global uint *restrict sample_starts,
                           const __global uint *restrict leaf_rank,
                           const __global uint *restrict own_starts,     /* [ray + 1] */
                           const __global uint *restrict stretch_starts, /* [ray + 1] */
                           __global uint *restrict stretch_rank,         /* [stretch] */
                           __global uint *restrict stretch_first,        /* [stretch + 1] */
                           uint n, uint rays, uint me, uint most)
{
    const uint r = get_global_id(0);
    uint before = UINT_MAX;

    if (r >= n)
        return;
    uint at = stretch_starts[r], sample = own_starts[r];

    for (uint k = 0; k < intervals_of(used, sample_starts, r, most); k++) {
        const cln_interval v = intervals[k * rays + r];
        const uint rank = leaf_rank[v.slot];

        if (rank != before) {
            stretch_rank[at] = rank;
            stretch_first[at++] = sample;
        }
        before = rank;
        if (rank == me)
            sample += CLN_INTERVAL_SAMPLES(v.count);
        else
            intervals[k * rays + r].count =
                CLN_INTERVAL_COUNT(0u, CLN_INTERVAL_LEVEL(v.count));
    }
    if (r == n - 1u)
        stretch_first[at] = sample;
}

/* The sums of this rank's stretches. */
__kernel void stretch_composite(const __global cln_interval *restrict intervals,
                                const __global uint *restrict stretch_starts,
                                const __global uint *restrict stretch_rank,
                                const __global uint *restrict stretch_first,
                                const __global cln_sample *restrict samples,
                                const __global float4 *restrict out, /* [sample] r, g, b, sigma */
                                __global float4 *restrict sums,      /* [stretch][SUMS] */
                                uint n, uint me DEPTH_ARGUMENTS)
{
    const uint r = get_global_id(0);

    if (r >= n)
        return;
    const float2 pull = DEPTH_PASS(r);

    (void)pull;
    for (uint k = stretch_starts[r]; k < stretch_starts[r + 1u]; k++) {
        const float start = intervals[r].t_in;
        float length = 0.0f, moment = 0.0f, distortion = 0.0f, cauchy = 0.0f, off = 0.0f;
#if DISTORT
        float weights = 0.0f;
#endif
        passed p = {.through = 1.0f};

        if (stretch_rank[k] != me)
            continue;
        for (uint i = stretch_first[k]; i < stretch_first[k + 1u]; i++) {
            const float4 o = out[i];
            const float delta = samples[i].delta, t = samples[i].t - start;
            const float4 kept = pass_sample(&p, o, delta);
            const float weight = kept.x * kept.y;

#if DISTORT
            /* pairs with what is before, twice, and with itself */
            distortion += weight * (2.0f * (t * weights - moment) + weight * delta * (1.0f / 3.0f));
            weights += weight;
#endif
#if CAUCHY
            cauchy += cauchy_of(o.w);
#endif
#if DEPTH_LOSS
            off = MAD(weight, fabs(samples[i].t - pull.y), off);
#endif
            moment = MAD(weight, t, moment);
            length += delta;
        }
        sums[SUMS * k] = (float4)(p.colour.xyz, p.tau);
        sums[SUMS * k + 1u] = (float4)(length, moment, distortion, cauchy);
#if DEPTH_LOSS
        sums[SUMS * k + 2u] = (float4)(off);
#else
        (void)off;
#endif
    }
    (void)r;
}

/* Sums along a whole ray, and what is left behind it. */
typedef struct joined {
    float4 colour; /* without the background */
    float through, opacity, moment, length, distortion, cauchy, off;
} joined;

/* Joins a ray's stretches `begin` to `end`. Of each, sums then keep the optical depth before it and
 * its own, in place of its own and the cauchy. */
HELPER joined join_stretches(__global float4 *sums, uint begin, uint end)
{
    joined a = {.colour = (float4)(0.0f), .through = 1.0f};
    float tau = 0.0f;

    for (uint k = begin; k < end; k++) {
        const float4 c = sums[SUMS * k], more = sums[SUMS * k + 1u];
        const float weight = a.through * ONE_MINUS_EXP(float, c.w), far = a.through * more.y;

        a.colour = MAD((float4)(a.through), c, a.colour);
#if DISTORT
        a.distortion +=
            a.through * a.through * more.z + 2.0f * (a.opacity * far - weight * a.moment);
#endif
        a.opacity += weight;
        a.moment += far;
        a.length += more.x;
        a.cauchy += more.w;
#if DEPTH_LOSS
        a.off = MAD(a.through, sums[SUMS * k + 2u].x, a.off);
#endif
        sums[SUMS * k].w = tau;
        sums[SUMS * k + 1u].w = c.w;
        tau += c.w;
        a.through = EXP(-tau);
    }
    a.colour.w = 0.0f;
    return a;
}

/* Takes another rank's stretch all at once, as sweep_back() does sample by sample. sums: the
 * stretch's, joined. */
HELPER void sweep_over(sweep *s, const ray_loss *l, const __global float4 *sums, float distort,
                       float pull)
{
    const float4 c = sums[0], more = sums[1];
    const float front = EXP(-c.w), weight = front * ONE_MINUS_EXP(float, more.w);
    const float far = front * more.y;
    float gain = front * dot(l->g.xyz, c.xyz);

#if OPACITY
    gain += l->g_opacity * weight;
#endif
#if DEPTH_LOSS
    gain += pull * front * sums[2].x;
#endif
#if DISTORT
    const float before = s->opacity - weight - s->behind;
    const float moment_before = s->moment - far - s->moment_behind;

    gain += 2.0f * distort *
            (front * front * more.z + far * (before - s->behind) -
             weight * (moment_before - s->moment_behind));
#endif
    (void)distort;
    (void)pull;
    s->rest += gain;
    s->behind += weight;
    s->moment_behind += far;
}

#if AVERAGED
/* Moves the targets of pixels with several rays (loss.h), as composite_pixels does. sums: of all
 * ranks. */
__kernel void stretch_pixels(const __global uint *restrict stretch_starts,
                             const __global float4 *restrict sums,
                             const __global float4 *restrict backgrounds, /* [1] or [ray] */
                             const __global cln_pixel *restrict pixels,   /* [ray] */
                             __global float4 *restrict targets,           /* [ray] r, g, b, a */
                             uint n)
{
    const uint first = get_global_id(0);

    if (first >= n || CLN_SPOT_INDEX(pixels[first].spot) > 0u)
        return;
    const uint count = rays_of_pixel(pixels, first, n);
    float4 rays[MOST_PIXEL_RAYS];

    if (count == 1u)
        return;
    for (uint i = 0; i < count; i++) {
        const uint r = first + i;
        float4 colour = (float4)(0.0f);
        float tau = 0.0f, through = 1.0f;

        for (uint k = stretch_starts[r]; k < stretch_starts[r + 1u]; k++) {
            colour = MAD((float4)(through), sums[SUMS * k], colour);
            tau += sums[SUMS * k].w;
            through = EXP(-tau);
        }
        rays[i] = MAD((float4)(through), BACKGROUND(r), colour);
        rays[i].w = through;
    }
    move_targets(targets + first, rays, count);
}
#endif

/* Results of every ray; gradients and measures of this rank's samples. sums: of all ranks;
 * overwritten. */
__kernel void stretch_train(const __global cln_interval *restrict intervals,
                            const __global uint *restrict stretch_starts,
                            const __global uint *restrict stretch_rank,
                            const __global uint *restrict stretch_first,
                            const __global cln_sample *restrict samples,
                            const __global float4 *restrict out,
                            const __global float4 *restrict backgrounds, /* [1] or [ray] */
                            const __global float4 *restrict targets,     /* [ray] r, g, b, a */
                            const __global cln_pixel *restrict pixels,   /* [ray] */
                            __global float4 *restrict sums, __global float4 *restrict dout,
                            __global cln_ray_result *restrict results, uint n, uint me, float scale,
                            float huber, float alpha_weight, float cauchy, float opacity_weight,
                            float distort DEPTH_ARGUMENTS MEASURE_ARGUMENT)
{
    const uint r = get_global_id(0);

    if (r >= n)
        return;
    const uint begin = stretch_starts[r], end = stretch_starts[r + 1u];
    const float4 back = BACKGROUND(r);
    const float start = begin < end ? intervals[r].t_in : 0.0f, share = SHARE_OF_RAY(r);
    const joined a = join_stretches(sums, begin, end);
    const float4 colour = MAD((float4)(a.through), back, a.colour);
    const float2 pull = DEPTH_PASS(r);
    const ray_loss l = loss_of_ray(colour, back, targets[r], a.through, a.opacity, huber,
                                   alpha_weight, opacity_weight, pull);
    sweep s = {a.opacity, a.moment, l.rest, 0.0f, 0.0f, 0.0f};
    const float extra =
        l.extra + distort * a.distortion + cauchy * a.cauchy + pull.x * a.off;

    for (uint k = end; k-- > begin;) {
        if (stretch_rank[k] != me) {
            sweep_over(&s, &l, sums + SUMS * k, distort, pull.x);
            continue;
        }
        passed p = {.tau = sums[SUMS * k].w};

        p.through = EXP(-p.tau);
        for (uint i = stretch_first[k]; i < stretch_first[k + 1u]; i++)
            dout[i] = pass_sample(&p, out[i], samples[i].delta); /* for what follows */
        for (uint i = stretch_first[k + 1u]; i-- > stretch_first[k];) {
            const float4 kept = dout[i], o = out[i];
            const float delta = samples[i].delta;

            dout[i] = share * scale *
                      sweep_back(&s, &l, kept, o, samples[i].t - start, delta, distort, cauchy,
                                 pull.x, fabs(samples[i].t - pull.y));
#if MEASURES > 0
            measure_sample(measures, i, share * l.square, kept, o.w, delta, a.through, a.length);
#endif
        }
    }
    const float depth = MAD(start, a.opacity, a.moment) / fmax(a.opacity, 1e-10f);
    const cln_ray_result result = {colour.x,  colour.y,       colour.z, depth,
                                   a.opacity, l.loss + extra, l.square,
                                   pull.x > 0.0f ? -share : share};

    results[r] = result;
}
