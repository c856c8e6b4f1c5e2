/* needs: shell */
/* Samples of a ray one by one from its front, the ray's loss, and compositing's backward sweep
 * (method.md 9, 10; twin: host/reference/composite.c). For composite.cl, and for stretch.cl, where
 * ranks composite parts of a ray.
 *
 *   RAY_BACKGROUND 0 | 1   one background for all rays, or one each
 *   LOSS 0 l2 | 1 huber;  ALPHA 0 | 1: opacity is compared with the image's alpha a, too,
 *     alpha_weight (T_end - (1 - a))^2;  CAUCHY, OPACITY, DISTORT 0 | 1: that regulariser is built
 *     in
 *   DEPTH_LOSS 0 | 1       for rays that show a known point, a pull of their depth to it:
 *                          depth_loss trust (sum w_i |t_i - t*| + T_end), t* the point's t
 *   MEASURES 0 | 1 | 3     numbers per sample for the structure optimisation (12.3): none; its
 *                          share of the ray's error; and T sigma delta, T delta (density weighted
 *                          by transmittance)
 *   AVERAGED 0 | 1         a pixel may be the mean of several rays (CLN_SPOT)
 */
#ifndef LOSS
#define AVERAGED       1
#define RAY_BACKGROUND 1
#define LOSS           1
#define ALPHA          1
#define CAUCHY         1
#define OPACITY        1
#define DISTORT        1
#define DEPTH_LOSS     1
#define MEASURES       3
#endif
#if LOSS > 1
#error "no code for this LOSS"
#endif

#if DEPTH_LOSS
#define DEPTH_ARGUMENTS                                                                         \
    , const __global float4 *restrict ray_o, /* [ray] */                                        \
        const __global float4 *restrict ray_d,                                                  \
        const __global float4 *restrict shown, /* [ray] a point of the cube, its trust */       \
        float depth_loss
#define DEPTH_PASS(r) depth_pull(shown[r], ray_o, ray_d, r, depth_loss)
#else
#define DEPTH_ARGUMENTS
#define DEPTH_PASS(r) ((float2)(0.0f))
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

#if AVERAGED
#define MOST_PIXEL_RAYS 16

/* Rays of a pixel from its first one on: at the end, those that the batch of n has room for. */
HELPER uint rays_of_pixel(const __global cln_pixel *pixels, uint first, uint n)
{
    return min(CLN_SPOT_COUNT(pixels[first].spot), n - first);
}

/* What a ray counts in its pixel. */
#define SHARE_OF_RAY(r) \
    (1.0f / convert_float(rays_of_pixel(pixels, r - CLN_SPOT_INDEX(pixels[r].spot), n)))

/* For a pixel that is the mean of several rays, r, g, b, T_end: moves each ray's target so that the
 * ray is as far from it as the mean is from the pixel's own, in colour and in opacity. The loss of
 * a ray is then its pixel's, and so is its gradient, but for its share in the mean. */
HELPER void move_targets(__global float4 *targets, const float4 rays[MOST_PIXEL_RAYS], uint count)
{
    float4 mean = (float4)(0.0f);

    for (uint k = 0; k < count; k++)
        mean += rays[k];
    mean /= convert_float(count);
    for (uint k = 0; k < count; k++) {
        float4 away = rays[k] - mean;

        away.w = -away.w; /* targets have 1 - T_end */
        targets[k] += away;
    }
}
#else
#define SHARE_OF_RAY(r) 1.0f
#endif

#if DEPTH_LOSS
/* t of the point of ray r that is nearest to one of the cube. */
HELPER float reach_of(float3 point, const __global float4 *ray_o, const __global float4 *ray_d,
                      uint r)
{
#if SHELL
    float least = NEVER, reach = 0.0f;

    for (uint row = r * CLN_LINE_ROWS + 1u; row < (r + 1u) * CLN_LINE_ROWS; row++) {
        const float4 o = ray_o[row], d = ray_d[row];
        const float t = fmin(fmax(dot(point - o.xyz, d.xyz), o.w), d.w);
        const float3 gap = point - MAD((float3)(t), d.xyz, o.xyz);

        if (o.w < NEVER && dot(gap, gap) < least) {
            least = dot(gap, gap);
            reach = t;
        }
    }
    return reach;
#else
    return dot(point - ray_o[r].xyz, ray_d[r].xyz);
#endif
}

/* How strongly ray r is pulled to the point that it shows, and that point's t. */
HELPER float2 depth_pull(float4 shown, const __global float4 *ray_o, const __global float4 *ray_d,
                         uint r, float depth_loss)
{
    return (float2)(depth_loss * shown.w, reach_of(shown.xyz, ray_o, ray_d, r));
}
#endif

/* What a ray, or a part of one, has passed from its front on; begins with through = 1. */
typedef struct passed {
    float4 colour;      /* sum of w_i c_i; its w has no meaning */
    float tau, through; /* optical depth, T behind it */
} passed;

/* Takes the next sample; returns its T_i, alpha_i, T_(i+1). */
HELPER float4 pass_sample(passed *p, float4 o, float delta)
{
    const float depth_here = OPTICAL_DEPTH(o.w * delta), before = p->through;
    const float alpha = ONE_MINUS_EXP(float, depth_here);

    p->colour = MAD((float4)(before * alpha), o, p->colour);
    p->tau += depth_here;
    p->through = EXP(-p->tau);
    return (float4)(before, alpha, p->through, 0.0f);
}

typedef struct ray_loss {
    float loss, square; /* without the regularisers; mean squared error */
    float4 g;           /* dL/dC */
    float rest;         /* T_end dL/dT_end: where S_i begins, at the back */
    float extra;        /* regularisers of the whole ray */
    float g_opacity;    /* dL/dA of the OPACITY regulariser */
} ray_loss;

/* colour: with the background behind it; through: T_end; target: r, g, b, a, which may be untold;
 * pull: DEPTH_PASS. */
HELPER ray_loss loss_of_ray(float4 colour, float4 back, float4 target, float through, float opacity,
                            float huber, float alpha_weight, float opacity_weight, float2 pull)
{
    ray_loss l;
    float4 difference = colour - target;

    difference.w = 0.0f;
    l.extra = l.g_opacity = 0.0f;
    l.square = dot(difference, difference) * (1.0f / 3.0f);
#if LOSS == 1
    const float4 a = fabs(difference);
    const float4 each =
        select(huber * (a - 0.5f * huber), 0.5f * difference * difference, a <= huber);

    l.loss = (each.x + each.y + each.z) * (1.0f / 3.0f);
    l.g = clamp(difference, -huber, huber) * (1.0f / 3.0f);
#else
    l.loss = l.square;
    l.g = difference * (2.0f / 3.0f);
#endif
    l.rest = dot(l.g.xyz, back.xyz); /* dL/dT_end */
#if ALPHA
    const float surplus = target.w > CLN_ALPHA_TOLD ? through - (1.0f - target.w) : 0.0f;

    l.extra = alpha_weight * surplus * surplus;
    l.rest += 2.0f * alpha_weight * surplus;
#endif
#if DEPTH_LOSS
    l.extra = MAD(pull.x, through, l.extra);
    l.rest += pull.x;
#endif
    (void)pull;
    l.rest *= through;
#if OPACITY
    const float miss = 1.0f - opacity;

    l.extra += opacity_weight * log1p(opacity * miss / 0.11f);
    l.g_opacity = opacity_weight * (1.0f - 2.0f * opacity) / (0.11f + opacity * miss);
#endif
    return l;
}

/* log(1 + 2 sigma^2). sigma = few * times, so that the square of few is finite; if times > 1, the 1
 * is negligible. */
HELPER float cauchy_of(float sigma)
{
    const float few = fmin(sigma, 1e6f), times = fmax(sigma, 1e6f) * 1e-6f;

    return log1p(2.0f * few * few) + 2.0f * log(times);
}

/* The backward sweep along a ray, from its last sample to its first. */
typedef struct sweep {
    float opacity, moment;       /* of the whole ray: sums of w and w t */
    float rest;                  /* S_i */
    float behind, moment_behind; /* sums of w and w t over j > i */
    float extra;                 /* regularisers of samples so far */
} sweep;

/* Takes the next sample: kept = T_i, alpha_i, T_(i+1); t has the origin of the sums of w t; off =
 * |t_i - t*|. Returns its dL/d(r, g, b, sigma). */
HELPER float4 sweep_back(sweep *s, const ray_loss *l, float4 kept, float4 o, float t, float delta,
                         float distort, float cauchy, float pull, float off)
{
    const float weight = kept.x * kept.y;
    float gain = dot(l->g.xyz, o.xyz), direct = 0.0f;

    (void)t;
    (void)distort;
    (void)cauchy;
    (void)pull;
    (void)off;
#if OPACITY
    gain += l->g_opacity;
#endif
#if DEPTH_LOSS
    gain += pull * off;
    s->extra = MAD(weight, pull * off, s->extra);
#endif
#if DISTORT
    const float before = s->opacity - weight - s->behind;
    const float moment_before = s->moment - weight * t - s->moment_behind;
    const float spread = t * (before - s->behind) - (moment_before - s->moment_behind);

    gain += distort * (2.0f * spread + (2.0f / 3.0f) * weight * delta);
    s->extra += distort * weight * (spread + weight * delta * (1.0f / 3.0f));
    s->behind += weight;
    s->moment_behind = MAD(weight, t, s->moment_behind);
#endif
#if CAUCHY
    const float few = fmin(o.w, 1e6f), times = fmax(o.w, 1e6f) * 1e-6f;

    direct = cauchy * 4.0f * few / ((1.0f + 2.0f * few * few) * times);
    s->extra += cauchy * cauchy_of(o.w);
#endif
    float4 d = weight * l->g;

    d.w = delta * (kept.z * gain - s->rest) + direct;
    s->rest = MAD(weight, gain, s->rest);
    return d;
}

#if MEASURES > 0
/* Measures of a sample; through: T_end. The share of the error that belongs to the background is
 * blamed on the leaves along the ray, by length. */
HELPER void measure_sample(__global float *measures, uint i, float square, float4 kept, float sigma,
                           float delta, float through, float length)
{
    measures[i * MEASURES] =
        square * (kept.x * kept.y + through * delta / fmax(length, CLN_MIN_CHORD));
#if MEASURES == 3
    measures[i * 3u + 1u] = kept.x * sigma * delta;
    measures[i * 3u + 2u] = kept.x * delta;
#else
    (void)sigma;
#endif
}
#endif
