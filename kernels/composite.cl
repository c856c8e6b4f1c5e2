/* needs: space */
/* Compositing along each ray, the loss, and its gradient back to every sample's (r, g, b, sigma)
 * (method.md 9, 10; twin: host/reference/composite.c). One work-item per ray, samples front to
 * back.
 *
 *   w_i = T_i alpha_i, alpha_i = 1 - exp(-x_i), x_i = sigma_i delta_i, T_i = exp(-sum_{j<i} x_j):
 *   a product of 1 - alpha would lose small x
 *   C = sum w_i c_i + T_end background
 *   with G_i = dL/dw_i:  dL/dc_i = w_i g,  dL/dsigma_i = delta_i (T_{i+1} G_i - S_i),
 *   S_i = sum_{j>i} w_j G_j + T_end g.background, a true backward sweep (no cancellation)
 *
 * A picture's depth is the median of the weights: where half of the opacity lies before. `depth`
 * has the bits of CLN_DEPTH_*: along the camera's axis; the mean instead.
 *
 *   RAY_BACKGROUND 0 | 1   one background for all rays, or one each
 *   LOSS 0 l2 | 1 huber;  ALPHA 0 | 1: opacity is compared with the image's alpha a, too,
 *     alpha_weight (T_end - (1 - a))^2;  CAUCHY, OPACITY, DISTORT 0 | 1: that regulariser is built
 *     in
 *   MEASURES 0 | 1 | 3     numbers per sample for the structure optimisation (12.3): none; its
 *                          share of the ray's error; and T sigma delta, T delta (density weighted
 *                          by transmittance)
 */
#ifndef LOSS
#define RAY_BACKGROUND 1
#define LOSS           1
#define ALPHA          1
#define CAUCHY         1
#define OPACITY        1
#define DISTORT        1
#define MEASURES       3
#endif

#if MEASURES > 0
#define MEASURE_ARGUMENT , __global float *restrict measures /* [sample][MEASURES] */
#else
#define MEASURE_ARGUMENT
#endif

/* sigma delta >= 0, clamped; a NaN stays visible (clamp() would hide it). */
#define OPTICAL_DEPTH(x) ((x) > CLN_MAX_OPTICAL_DEPTH ? CLN_MAX_OPTICAL_DEPTH : (x))

#if RAY_BACKGROUND
#define BACKGROUND(r) (backgrounds[r])
#else
#define BACKGROUND(r) (backgrounds[0])
#endif

/* Where half of the opacity lies before, the samples being as long as their deltas: there the
 * optical depth is -log(1 - opacity / 2). */
HELPER float median_depth(const __global cln_sample *samples, const __global float4 *out,
                          uint begin, uint end, float opacity)
{
    const float half_way = -log1p(-0.5f * opacity);
    float tau = 0.0f, t = 0.0f;

    for (uint i = begin; i < end; i++) {
        const float depth_here = OPTICAL_DEPTH(out[i].w * samples[i].delta);

        if (tau + depth_here >= half_way && depth_here > 0.0f) {
            t = MAD(samples[i].delta, (half_way - tau) / depth_here - 0.5f, samples[i].t);
            break;
        }
        tau += depth_here;
    }
    return t;
}

__kernel void composite(const __global uint *restrict sample_starts, /* [ray + 1] */
                        const __global cln_sample *restrict samples, /* [sample] */
                        const __global float4 *restrict out,         /* [sample] r, g, b, sigma */
                        const __global float4 *restrict backgrounds, /* [1] or [ray] */
                        const __global float4 *restrict ray_o,       /* [ray] for ray_depth() */
                        const __global float4 *restrict ray_d,       /* [ray] */
                        __global cln_ray_result *restrict results, uint n, uint depth)
{
    const uint r = get_global_id(0);
    float tau = 0.0f, through = 1.0f, moment = 0.0f, opacity = 0.0f;
    float4 colour = (float4)(0.0f);

    if (r >= n)
        return;
    for (uint i = sample_starts[r]; i < sample_starts[r + 1u]; i++) {
        const float4 o = out[i];
        const float depth_here = OPTICAL_DEPTH(o.w * samples[i].delta);
        const float alpha = ONE_MINUS_EXP(float, depth_here);
        const float weight = through * alpha;

        colour = MAD((float4)(weight), o, colour);
        moment = MAD(weight, samples[i].t, moment);
        opacity += weight;
        tau += depth_here;
        through = EXP(-tau);
    }
    colour = MAD((float4)(through), BACKGROUND(r), colour);
    /* where the ray begins counts as much as the weights, not at all without any */
    const float share = opacity / fmax(opacity, 1e-10f);
    const float t = depth & CLN_DEPTH_MEAN ? moment / fmax(opacity, 1e-10f)
                                           : median_depth(samples, out, sample_starts[r],
                                                          sample_starts[r + 1u], opacity);
    const cln_ray_result result = {
        colour.x, colour.y,
        colour.z, ray_depth(t, ray_o, ray_d, r, share, depth & CLN_DEPTH_AXIS),
        opacity,  0.0f,
        0.0f,     0.0f};

    results[r] = result;
}

__kernel void composite_train(const __global uint *restrict sample_starts, /* [ray + 1] */
                              const __global cln_sample *restrict samples, /* [sample] */
                              const __global float4 *restrict out,         /* [sample] */
                              const __global float4 *restrict backgrounds, /* [1] or [ray] */
                              const __global float4 *restrict targets,     /* [ray] r, g, b, a */
                              __global float4 *restrict dout,              /* [sample] */
                              __global cln_ray_result *restrict results, uint n, float scale,
                              float huber, float alpha_weight, float cauchy, float opacity_weight,
                              float distort MEASURE_ARGUMENT)
{
    const uint r = get_global_id(0);

    if (r >= n)
        return;
    const uint begin = sample_starts[r], end = sample_starts[r + 1u];
    const float4 back = BACKGROUND(r);
    /* moments are about the first sample: differences of those about 0 would cancel far away */
    const float start = begin < end ? samples[begin].t : 0.0f;
    float tau = 0.0f, through = 1.0f, opacity = 0.0f, moment = 0.0f, loss, extra = 0.0f;
    float4 colour = (float4)(0.0f), g, difference;
#if MEASURES > 0
    float length = 0.0f; /* of the ray in the leaves with samples: their deltas sum to it */
#endif

    for (uint i = begin; i < end; i++) { /* dout keeps T_i, alpha_i, T_(i+1) for what follows */
        const float4 o = out[i];
        const float depth_here = OPTICAL_DEPTH(o.w * samples[i].delta);
        const float alpha = ONE_MINUS_EXP(float, depth_here);
        const float weight = through * alpha;

        colour = MAD((float4)(weight), o, colour);
        opacity += weight;
        moment = MAD(weight, samples[i].t - start, moment);
        tau += depth_here;
        const float behind = EXP(-tau);

        dout[i] = (float4)(through, alpha, behind, 0.0f);
        through = behind;
#if MEASURES > 0
        length += samples[i].delta;
#endif
    }
    colour = MAD((float4)(through), back, colour);
    difference = colour - targets[r];
    difference.w = 0.0f;
    const float square = dot(difference, difference) * (1.0f / 3.0f);

#if LOSS == 1
    const float4 a = fabs(difference);
    const float4 each =
        select(huber * (a - 0.5f * huber), 0.5f * difference * difference, a <= huber);

    loss = (each.x + each.y + each.z) * (1.0f / 3.0f);
    g = clamp(difference, -huber, huber) * (1.0f / 3.0f);
#else
    loss = square;
    g = difference * (2.0f / 3.0f);
#endif
    float rest = dot(g.xyz, back.xyz); /* dL/dT_end, then S_i */
#if ALPHA
    const float surplus = through - (1.0f - targets[r].w);

    extra = alpha_weight * surplus * surplus;
    rest += 2.0f * alpha_weight * surplus;
#endif
    rest *= through;
#if OPACITY
    const float miss = 1.0f - opacity;

    extra += opacity_weight * log1p(opacity * miss / 0.11f);
    const float g_opacity = opacity_weight * (1.0f - 2.0f * opacity) / (0.11f + opacity * miss);
#endif
#if DISTORT
    float behind = 0.0f, moment_behind = 0.0f; /* sums of w and w t over j > i */
#endif
    for (uint i = end; i-- > begin;) {
        const float4 kept = dout[i], o = out[i];
        const float delta = samples[i].delta, weight = kept.x * kept.y;
        float gain = dot(g.xyz, o.xyz), direct = 0.0f;

#if OPACITY
        gain += g_opacity;
#endif
#if DISTORT
        const float t = samples[i].t - start;
        const float before = opacity - weight - behind;
        const float moment_before = moment - weight * t - moment_behind;
        const float spread = t * (before - behind) - (moment_before - moment_behind);

        gain += distort * (2.0f * spread + (2.0f / 3.0f) * weight * delta);
        extra += distort * weight * (spread + weight * delta * (1.0f / 3.0f));
        behind += weight;
        moment_behind = MAD(weight, t, moment_behind);
#endif
#if CAUCHY
        /* sigma = few * times: the square of few is finite, and 1 beside it nothing if times > 1 */
        const float few = fmin(o.w, 1e6f), times = fmax(o.w, 1e6f) * 1e-6f;

        direct = cauchy * 4.0f * few / ((1.0f + 2.0f * few * few) * times);
        extra += cauchy * (log1p(2.0f * few * few) + 2.0f * log(times));
#endif
        float4 d = weight * g;

        d.w = delta * (kept.z * gain - rest) + direct;
        rest = MAD(weight, gain, rest);
        dout[i] = d * scale;
#if MEASURES > 0
        /* what was seen through blames the leaves that it was seen through, by length */
        measures[i * MEASURES] = square * (weight + through * delta / fmax(length, CLN_MIN_CHORD));
#endif
#if MEASURES == 3
        measures[i * 3u + 1u] = kept.x * o.w * delta;
        measures[i * 3u + 2u] = kept.x * delta;
#endif
    }
    const float depth = MAD(start, opacity, moment) / fmax(opacity, 1e-10f);
    const cln_ray_result result = {colour.x, colour.y,     colour.z, depth,
                                   opacity,  loss + extra, square,   0.0f};

    results[r] = result;
}
