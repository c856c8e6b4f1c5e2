/* needs: space loss */
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
 * A picture's depth, along the ray, is the median of the weights: half of the opacity lies before
 * it; or, where `depth` is CLN_DEPTH_MEAN, their mean.
 *
 * Losses, regularisers and their parameters, pixels of several rays: loss.h. */

/* The t before which half of the opacity lies, with samples as long as their deltas: the optical
 * depth there is -log(1 - opacity / 2). */
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

/* Samples whose optical depths and transmittances are found at once. */
#define PIECE (VW == 1 ? 1 : 32)

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
    const uint begin = sample_starts[r], end = sample_starts[r + 1u];

    for (uint at = begin; at < end; at += PIECE) { /* what has no order, side by side */
        const uint count = min((uint)PIECE, end - at);
        float depths[PIECE], alphas[PIECE], behind[PIECE];

        for (uint l = 0; l < PIECE; l++) {
            const uint i = at + min(l, count - 1u);

            depths[l] = l < count ? out[i].w * samples[i].delta : 0.0f;
        }
        /* floats, as a vector's exp may differ; the compiler finds the lanes */
        for (uint l = 0; l < PIECE; l++) {
            depths[l] = OPTICAL_DEPTH(depths[l]);
            alphas[l] = ONE_MINUS_EXP(float, depths[l]);
        }
        for (uint l = 0; l < PIECE; l++)
            behind[l] = tau += depths[l];
        for (uint l = 0; l < PIECE; l++)
            behind[l] = EXP(-behind[l]);
        for (uint l = 0; l < count; l++) {
            const float weight = through * alphas[l];

            colour = MAD((float4)(weight), out[at + l], colour);
            moment = MAD(weight, samples[at + l].t, moment);
            opacity += weight;
            through = behind[l];
        }
    }
    colour = MAD((float4)(through), BACKGROUND(r), colour);
    /* the ray's start counts by the opacity: not at all without weights */
    const float share = opacity / fmax(opacity, 1e-10f);
    const float t = depth == CLN_DEPTH_MEAN ? moment / fmax(opacity, 1e-10f)
                                            : median_depth(samples, out, begin, end, opacity);
    const cln_ray_result result = {
        colour.x, colour.y, colour.z, ray_depth(t, ray_o, ray_d, r, share),
        opacity,  0.0f,     0.0f,     0.0f};

    results[r] = result;
}

#if AVERAGED
/* Moves the targets of pixels with several rays (loss.h). */
__kernel void composite_pixels(const __global uint *restrict sample_starts, /* [ray + 1] */
                               const __global cln_sample *restrict samples, /* [sample] */
                               const __global float4 *restrict out,         /* [sample] */
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
    for (uint k = 0; k < count; k++) {
        const uint r = first + k;
        passed p = {.through = 1.0f};

        for (uint i = sample_starts[r]; i < sample_starts[r + 1u]; i++)
            pass_sample(&p, out[i], samples[i].delta);
        rays[k] = MAD((float4)(p.through), BACKGROUND(r), p.colour);
        rays[k].w = p.through;
    }
    move_targets(targets + first, rays, count);
}
#endif

__kernel void composite_train(const __global uint *restrict sample_starts, /* [ray + 1] */
                              const __global cln_sample *restrict samples, /* [sample] */
                              const __global float4 *restrict out,         /* [sample] */
                              const __global float4 *restrict backgrounds, /* [1] or [ray] */
                              const __global float4 *restrict targets,     /* [ray] r, g, b, a */
                              const __global cln_pixel *restrict pixels,   /* [ray] */
                              __global float4 *restrict dout,              /* [sample] */
                              __global cln_ray_result *restrict results, uint n, float scale,
                              float huber, float alpha_weight, float cauchy, float opacity_weight,
                              float distort DEPTH_ARGUMENTS MEASURE_ARGUMENT)
{
    const uint r = get_global_id(0);

    if (r >= n)
        return;
    const uint begin = sample_starts[r], end = sample_starts[r + 1u];
    const float4 back = BACKGROUND(r);
    const float share = SHARE_OF_RAY(r);
    /* moments are about the first sample: differences of those about 0 would cancel far away */
    const float start = begin < end ? samples[begin].t : 0.0f;
    float opacity = 0.0f, moment = 0.0f;
    passed p = {.through = 1.0f};
#if MEASURES > 0
    float length = 0.0f; /* of the ray in the leaves with samples: their deltas sum to it */
#endif

    for (uint i = begin; i < end; i++) {
        const float4 kept = pass_sample(&p, out[i], samples[i].delta);
        const float weight = kept.x * kept.y;

        dout[i] = kept; /* for what follows */
        opacity += weight;
        moment = MAD(weight, samples[i].t - start, moment);
#if MEASURES > 0
        length += samples[i].delta;
#endif
    }
    const float4 colour = MAD((float4)(p.through), back, p.colour);
    const float2 pull = DEPTH_PASS(r);
    const ray_loss l = loss_of_ray(colour, back, targets[r], p.through, opacity, huber,
                                   alpha_weight, opacity_weight, pull);
    sweep s = {opacity, moment, l.rest, 0.0f, 0.0f, l.extra};

    for (uint i = end; i-- > begin;) {
        const float4 kept = dout[i], o = out[i];
        const float delta = samples[i].delta;

        dout[i] = share * scale *
                  sweep_back(&s, &l, kept, o, samples[i].t - start, delta, distort, cauchy, pull.x,
                             fabs(samples[i].t - pull.y));
#if MEASURES > 0
        measure_sample(measures, i, share * l.square, kept, o.w, delta, p.through, length);
#endif
    }
    const float depth = MAD(start, opacity, moment) / fmax(opacity, 1e-10f);
    const cln_ray_result result = {
        colour.x, colour.y,         colour.z, depth,
        opacity,  l.loss + s.extra, l.square, pull.x > 0.0f ? -share : share};

    results[r] = result;
}
