/* Compositing, losses and their gradients at extreme optical depths. Bounds are relative to each
 * number or, where terms cancel, to the terms. See extremes.h. */
#include "check/extremes.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "check/selftest_checks.h"
#include "pipeline/stretch.h"
#include "reference/reference.h"

/* A batch of rays on the device. */
typedef struct batch {
    int rays;
    uint32_t n, *starts; /* [rays + 1] */
    cln_sample *samples;
    float (*out)[4], (*dout)[4], (*targets)[4], (*backgrounds)[4], (*ray_o)[4], (*ray_d)[4];
    float (*shown)[4];
    cln_ray_result *median, *mean, *trained;
    double (*wide)[4], *t, *delta, (*grad)[4]; /* of one ray; room for the longest */
} batch;

static cln_status make(batch *b, int rays, uint32_t most_samples, uint32_t longest)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)rays;
    const char *what = "self-test";

    b->rays = rays;
    CLN_TRY(cln_alloc(&b->starts, n + 1, sizeof *b->starts, what));
    CLN_TRY(cln_alloc(&b->samples, most_samples, sizeof *b->samples, what));
    CLN_TRY(cln_alloc(&b->out, most_samples, sizeof *b->out, what));
    CLN_TRY(cln_alloc(&b->dout, most_samples, sizeof *b->dout, what));
    CLN_TRY(cln_alloc(&b->targets, n, sizeof *b->targets, what));
    CLN_TRY(cln_alloc(&b->backgrounds, n, sizeof *b->backgrounds, what));
    CLN_TRY(cln_alloc(&b->ray_o, n, sizeof *b->ray_o, what));
    CLN_TRY(cln_alloc(&b->ray_d, n, sizeof *b->ray_d, what));
    CLN_TRY(cln_alloc(&b->shown, n, sizeof *b->shown, what));
    CLN_TRY(cln_alloc(&b->median, n, sizeof *b->median, what));
    CLN_TRY(cln_alloc(&b->mean, n, sizeof *b->mean, what));
    CLN_TRY(cln_alloc(&b->trained, n, sizeof *b->trained, what));
    CLN_TRY(cln_alloc(&b->wide, longest, sizeof *b->wide, what));
    CLN_TRY(cln_alloc(&b->t, longest, sizeof *b->t, what));
    CLN_TRY(cln_alloc(&b->delta, longest, sizeof *b->delta, what));
    CLN_TRY(cln_alloc(&b->grad, longest, sizeof *b->grad, what));
    for (int r = 0; r < rays; r++)
        b->ray_d[r][3] = 1;
done:
    return st;
}

static void free_batch(batch *b)
{
    free(b->starts);
    free(b->samples);
    free(b->out);
    free(b->dout);
    free(b->targets);
    free(b->backgrounds);
    free(b->ray_o);
    free(b->ray_d);
    free(b->shown);
    free(b->median);
    free(b->mean);
    free(b->trained);
    free(b->wide);
    free(b->t);
    free(b->delta);
    free(b->grad);
}

static cln_status put(cln_pipeline *p, const batch *b)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t rays = (size_t)b->rays, row = 4 * sizeof(float);

    CLN_TRY(cln_check_put(device, &p->sample_starts, b->starts, (rays + 1) * sizeof *b->starts));
    CLN_TRY(cln_check_put(device, &p->samples, b->samples, b->n * sizeof *b->samples));
    CLN_TRY(cln_check_put(device, &p->out, b->out, b->n * row));
    CLN_TRY(cln_check_put(device, &p->targets, b->targets, rays * row));
    CLN_TRY(cln_check_put(device, &p->backgrounds, b->backgrounds, rays * row));
    CLN_TRY(cln_check_put(device, &p->ray_o, b->ray_o, rays * row));
    CLN_TRY(cln_check_put(device, &p->ray_d, b->ray_d, rays * row));
    if (p->depth_loss > 0)
        CLN_TRY(cln_check_put(device, &p->shown, b->shown, rays * row));
    CLN_TRY(cln_check_spoil(device, &p->dout, b->n * row));
done:
    return st;
}

/* Composites with the median depth, with the mean depth, and for training. */
static cln_status run(cln_pipeline *p, batch *b)
{
    cln_status st = CLN_OK;
    cln_device *device = p->device;
    const size_t rays = (size_t)b->rays, row = 4 * sizeof(float);
    cln_ray_result *results[3] = {b->median, b->mean, b->trained};

    CLN_TRY(put(p, b));
    for (int pass = 0; pass < 3; pass++) {
        CLN_TRY(cln_check_spoil(device, &p->results, rays * sizeof **results));
        if (pass == 2)
            CLN_TRY(cln_stage_composite_train(p, b->rays, b->n));
        else
            CLN_TRY(cln_stage_composite(p, b->rays, pass ? CLN_DEPTH_MEAN : CLN_DEPTH_MEDIAN));
        CLN_TRY(cln_buffer_read(device, &p->results, 0, results[pass], rays * sizeof **results));
    }
    CLN_TRY(cln_buffer_read(device, &p->dout, 0, b->dout, b->n * row));
done:
    return st;
}

/* Copies ray r to float64; returns its number of samples. */
static int widen(batch *b, int r)
{
    const uint32_t first = b->starts[r];
    const int n = (int)(b->starts[r + 1] - first);

    for (int i = 0; i < n; i++) {
        b->t[i] = b->samples[first + (uint32_t)i].t;
        b->delta[i] = b->samples[first + (uint32_t)i].delta;
        for (int k = 0; k < 4; k++)
            b->wide[i][k] = b->out[first + (uint32_t)i][k];
    }
    return n;
}

static double optical_depth(const batch *b, int i)
{
    return fmin(b->wide[i][3] * b->delta[i], (double)CLN_MAX_OPTICAL_DEPTH);
}

/* ---- equal samples ---- */

/* Rays of `count` equal, black samples at t = 1000 before a white background: the colour is the
 * transmittance, and nothing in the loss and its gradient cancels. */
typedef struct even {
    uint32_t count;
    double depth, delta; /* a sample's optical depth and length */
} even;

static const even evens[] = {
    {100000, 2.9e-8, 1e-3}, /* 1 - depth rounds to 1 */
    {50, 1e-12, 0.01},      {50, 1e-10, 0.01},   {50, 1e-8, 0.01},   {50, 1e-6, 0.01},
    {50, 1e-4, 0.01},       {50, 1e-2, 0.01},    {50, 0.149, 0.01},  {50, 0.151, 0.01},
    {50, 1, 0.01},          {50, 3, 0.01},       {50, 10, 0.01},     {50, 79, 0.01},
    {50, 81, 0.01},         {50, 1e3, 0.01},     {50, 1e6, 0.01},    {50, 1e30, 1e-4},
    {1, 1e-12, 0.01},       {1, 1e-6, 0.01},     {1, 1, 0.01},       {1, 1e6, 0.01},
    {10, 0.1, 0.01},        {100, 0.01, 0.01},   {1000, 1e-3, 1e-3}, {10, 1e-9, 1e-6},
    {10, 1e-9, 1e3},        {1000, 1e-12, 1e-3},
};
enum { EVENS = sizeof evens / sizeof *evens, EVEN_RAYS = EVENS + 1, EVEN_MOST = 100000 };

/* The last ray has the largest density that an activation can give, with deltas of 0. */
static const double most_density = 2.5e34; /* 1e4 exp(70) */

static void fill_evens(batch *b)
{
    for (int r = 0; r < EVEN_RAYS; r++) {
        const even *e = &evens[r < EVENS ? r : 0];

        b->starts[r] = b->n;
        for (uint32_t i = 0; i < (r < EVENS ? e->count : 3); i++, b->n++) {
            cln_sample *s = &b->samples[b->n];

            if (r < EVENS) {
                *s = (cln_sample){.t = (float)(1000 + e->delta * i), .delta = (float)e->delta};
                b->out[b->n][3] = (float)(e->depth / e->delta);
            } else {
                *s = (cln_sample){.t = 3, .delta = i == 2 ? 1 : 0};
                b->out[b->n][3] = i == 2 ? 0 : (float)most_density;
            }
            s->ray = (uint32_t)r;
        }
        for (int k = 0; k < 4; k++)
            b->backgrounds[r][k] = 1;
    }
    b->starts[EVEN_RAYS] = b->n;
}

cln_status cln_extremes_composite(cln_checks *c)
{
    static const char range[] = "sigma delta 0 to 1e30, 1 to 10^5 samples, t 1000";
    cln_status st = CLN_OK;
    const double cauchy = c->p->config.cauchy;
    cln_extreme opacities = cln_extreme_row(c, "opacity", range);
    cln_extreme depths = cln_extreme_row(c, "mean depth", range);
    cln_extreme medians = cln_extreme_row(c, "median depth", range);
    cln_extreme through = cln_extreme_row(c, "transmittance over 1e-30", range);
    cln_extreme losses = cln_extreme_row(c, "loss", range);
    cln_extreme gradients = cln_extreme_row(c, "density gradient, T over 1e-15", range);
    cln_extreme finite = cln_extreme_row(c, "every gradient", range);
    batch b = {0};

    CLN_TRY(make(&b, EVEN_RAYS, 2 * EVEN_MOST, EVEN_MOST));
    fill_evens(&b);
    CLN_TRY(run(c->p, &b));
    for (int r = 0; r < EVEN_RAYS; r++) {
        const int n = widen(&b, r);
        /* relative errors of float32 sums of n equal numbers, and of tau */
        const double sums = 1e-5 + 5e-9 * n, of_tau = 3e-7 + 2e-8 * n;
        double tau = 0, opacity = 0, depth = 0, regular = 0, left = 1, median = 0;

        for (int i = 0; i < n; i++) {
            const double x = optical_depth(&b, i), sigma = b.wide[i][3];

            opacity += exp(-tau) * -expm1(-x);
            depth += exp(-tau) * -expm1(-x) * b.t[i];
            tau += x;
            regular += cauchy * log1p(2 * sigma * sigma);
        }
        left = exp(-tau);
        median = ref_median_depth(n, (const double(*)[4])b.wide, b.t, b.delta);
        cln_extreme_meet(&opacities, b.median[r].opacity, opacity, opacity, sums,
                         "sigma delta %.3g x %d", n ? optical_depth(&b, 0) : 0, n);
        if (opacity > 1e-9) {
            cln_extreme_meet(&medians, b.median[r].depth, median, median, sums,
                             "sigma delta %.3g x %d", optical_depth(&b, 0), n);
            cln_extreme_meet(&depths, b.mean[r].depth, depth / opacity, depth / opacity, sums,
                             "sigma delta %.3g x %d", optical_depth(&b, 0), n);
        }
        if (left > 1e-30) /* the absolute error of tau is the relative one of exp(-tau) */
            cln_extreme_meet(&through, b.median[r].r, left, left, 1e-6 + of_tau * tau,
                             "sigma delta %.3g x %d", optical_depth(&b, 0), n);
        cln_extreme_meet(&losses, b.trained[r].loss, left * left + regular, left * left + regular,
                         sums + 2 * of_tau * tau, "sigma delta %.3g x %d", optical_depth(&b, 0), n);
        for (int i = 0; i < n; i++) {
            const float *got = b.dout[b.starts[r] + (uint32_t)i];
            const double sigma = b.wide[i][3], prior = 4 * sigma / (1 + 2 * sigma * sigma);
            const double slope = (cauchy * prior - 2 * left * left * b.delta[i]) / EVEN_RAYS;

            for (int k = 0; k < 4; k++)
                cln_extreme_finite(&finite, got[k], "value %d of sample %d of ray %d", k, i, r);
            if (left > 1e-15)
                cln_extreme_meet(&gradients, got[3], slope, slope, 1e-5 + 2 * of_tau * tau,
                                 "sigma delta %.3g, sample %d of %d", optical_depth(&b, i), i, n);
        }
    }
    cln_extreme_report(&opacities);
    cln_extreme_report(&medians);
    cln_extreme_report(&depths);
    cln_extreme_report(&through);
    cln_extreme_report(&losses);
    cln_extreme_report(&gradients);
    cln_extreme_report(&finite);
done:
    free_batch(&b);
    return st;
}

/* ---- coloured samples of every kind ---- */

enum { KINDS = 7, EACH = 12, MIXED_RAYS = KINDS * EACH, MIXED_MOST = 61 };
static const char *const kinds[KINDS] = {"random depths", "opaque first", "a thin surface",
                                         "depths mixed",  "equal t",      "deltas of 0",
                                         "far away"};

static void fill_mixed(batch *b)
{
    static const double extremes[] = {0, 1e-12, 1e-6, 1e-3, 1, 80, 1e4, 1e6};

    for (uint32_t r = 0; r < MIXED_RAYS; r++) {
        const uint32_t kind = r % KINDS, n = 1 + r * 13 % (MIXED_MOST - 1);
        const bool far = kind == 6; /* t near 1e3, where floats are 6e-5 apart */
        double t = cln_check_uniform(51, r, 0, 4) + (far ? 1000 : 0);

        b->starts[r] = b->n;
        for (uint32_t i = 0; i < n; i++, b->n++) {
            const double delta = pow(10, cln_check_uniform(52, b->n, far ? -2 : -4, -1));
            double x = pow(10, cln_check_uniform(53, b->n, -4, 0.5));

            if (kind == 1)
                x = i == 0 ? 1e6 : 0.1;
            if (kind == 2)
                x = i == n / 2 ? 30 : 1e-9;
            if (kind == 3)
                x = extremes[(r + i * 5) % 8];
            b->samples[b->n] =
                (cln_sample){.t = (float)(t + delta / 2), .delta = (float)delta, .ray = r};
            if (kind == 5 && i % 3 == 0)
                b->samples[b->n].delta = 0;
            t += kind == 4 ? 0 : delta;
            if (kind == 4)
                b->samples[b->n].t = (float)t;
            for (uint32_t k = 0; k < 3; k++)
                b->out[b->n][k] = (float)cln_check_uniform(54, 3 * b->n + k, 0, 1);
            b->out[b->n][3] = (float)(x / delta);
        }
        for (uint32_t k = 0; k < 4; k++) {
            b->targets[r][k] = (float)cln_check_uniform(55, 4 * r + k, 0, 1);
            b->backgrounds[r][k] = (float)cln_check_uniform(56, 4 * r + k, 0, 1);
        }
        for (uint32_t k = 0; k < 3; k++) { /* points on and beside rays; every fifth has none */
            b->ray_o[r][k] = (float)cln_check_uniform(57, 4 * r + k, -1, 1);
            b->ray_d[r][k] = k == 1 ? 0 : k ? 0.8f : 0.6f;
            b->shown[r][k] = (float)cln_check_uniform(58, 4 * r + k, -1, 3);
        }
        /* far from a point, its pull would hide all other gradients */
        b->shown[r][3] = r % 5 && !far ? (float)cln_check_uniform(59, r, 0, 1) : 0;
    }
    b->starts[MIXED_RAYS] = b->n;
}

/* ---- the same rays by several processes, one after the other on one device ---- */

enum { RANKS = 3 };

/* Each ray's samples, cut into intervals of one to four in leaves 0 to RANKS - 1, one of each rank:
 * [k][ray], used [ray]. */
static void cut(const batch *b, cln_interval *all, uint32_t *used)
{
    for (uint32_t r = 0; r < MIXED_RAYS; r++) {
        used[r] = 0;
        for (uint32_t i = b->starts[r], n = 0; i < b->starts[r + 1]; i += n) {
            const uint32_t left = b->starts[r + 1] - i;
            cln_interval *v = &all[used[r]++ * MIXED_RAYS + r];

            n = 1 + (uint32_t)cln_check_uniform(63, i, 0, 4);
            n = n < left ? n : left;
            *v = (cln_interval){.t_in = b->samples[i].t - b->samples[i].delta / 2,
                                .slot = (int32_t)cln_check_uniform(64, i, 0, RANKS),
                                .count = CLN_INTERVAL_COUNT(n, 3u)};
        }
    }
}

/* Uploads rank me's part of the batch, *count samples, and finds stretches. mine: their numbers. */
static cln_status put_part(cln_pipeline *p, const batch *b, int me, uint32_t *mine, uint32_t *count)
{
    cln_status st = CLN_OK;
    const size_t most = MIXED_MOST * MIXED_RAYS;
    cln_interval *all = NULL;
    cln_sample *samples = NULL;
    float(*out)[4] = NULL;
    uint32_t used[MIXED_RAYS];

    *count = 0;
    CLN_TRY(cln_alloc(&all, most, sizeof *all, "self-test"));
    CLN_TRY(cln_alloc(&samples, b->n, sizeof *samples, "self-test"));
    CLN_TRY(cln_alloc(&out, b->n, sizeof *out, "self-test"));
    cut(b, all, used);
    for (uint32_t r = 0; r < MIXED_RAYS; r++)
        for (uint32_t k = 0, i = b->starts[r]; k < used[r]; k++) {
            const cln_interval *v = &all[k * MIXED_RAYS + r];

            for (uint32_t j = 0; j < CLN_INTERVAL_SAMPLES(v->count); j++, i++)
                if (v->slot == me) {
                    samples[*count] = b->samples[i];
                    memcpy(out[*count], b->out[i], sizeof *out);
                    mine[(*count)++] = i;
                }
        }
    CLN_TRY(cln_check_put(p->device, &p->intervals, all, most * sizeof *all));
    CLN_TRY(cln_check_put(p->device, &p->used, used, sizeof used));
    CLN_TRY(cln_check_put(p->device, &p->samples, samples, *count * sizeof *samples));
    CLN_TRY(cln_check_put(p->device, &p->out, out, *count * sizeof *out));
    CLN_TRY(cln_stretch_find(p, MIXED_RAYS, me, SIZE_MAX));
done:
    free(all);
    free(samples);
    free(out);
    return st;
}

/* Takes rank me's stretches from the device; *sums: of all, made at the first call. */
static cln_status take_sums(cln_pipeline *p, int me, size_t row, char **sums)
{
    cln_status st = CLN_OK;
    const size_t n = p->stretch_total;
    uint32_t *rank = NULL;
    char *part = NULL;

    if (!*sums)
        CLN_TRY(cln_alloc(sums, n, row, "self-test"));
    CLN_TRY(cln_alloc(&rank, n, sizeof *rank, "self-test"));
    CLN_TRY(cln_alloc(&part, n, row, "self-test"));
    CLN_TRY(cln_buffer_read(p->device, &p->stretch_rank, 0, rank, n * sizeof *rank));
    CLN_TRY(cln_buffer_read(p->device, &p->stretch_sums, 0, part, n * row));
    for (size_t k = 0; k < n; k++)
        if ((int)rank[k] == me)
            memcpy(*sums + k * row, part + k * row, row);
done:
    free(rank);
    free(part);
    return st;
}

/* composite_train by RANKS ranks: each sees only the others' sums. The results are the last
 * rank's. */
static cln_status run_shared(cln_pipeline *p, batch *b)
{
    cln_status st = CLN_OK;
    const size_t row = cln_buffer_row_bytes(p, CLN_BUFFER_stretch_sums);
    const size_t rays = MIXED_RAYS * sizeof *b->trained;
    uint32_t *mine = NULL, count = 0;
    float(*got)[4] = NULL;
    char *sums = NULL;

    CLN_TRY(cln_alloc(&mine, b->n, sizeof *mine, "self-test"));
    CLN_TRY(cln_alloc(&got, b->n, sizeof *got, "self-test"));
    p->ranks = p->leaves = RANKS;
    CLN_TRY(cln_alloc(&p->rank_first, RANKS + 1, sizeof *p->rank_first, "self-test"));
    for (int r = 0; r <= RANKS; r++)
        p->rank_first[r] = r;
    CLN_TRY(cln_pipeline_want(p, CLN_PROGRAM_BIT(stretch)));
    CLN_TRY(put(p, b));
    for (int me = 0; me < RANKS; me++) {
        CLN_TRY(put_part(p, b, me, mine, &count));
        CLN_TRY(cln_stretch_composite(p, MIXED_RAYS, me));
        CLN_TRY(take_sums(p, me, row, &sums));
    }
    for (int me = 0; me < RANKS; me++) {
        CLN_TRY(put_part(p, b, me, mine, &count));
        CLN_TRY(cln_buffer_write(p->device, &p->stretch_sums, 0, sums, p->stretch_total * row));
        CLN_TRY(cln_check_spoil(p->device, &p->results, rays));
        CLN_TRY(cln_check_spoil(p->device, &p->dout, b->n * sizeof *got));
        CLN_TRY(cln_stretch_train(p, MIXED_RAYS, me, count));
        CLN_TRY(cln_buffer_read(p->device, &p->dout, 0, got, count * sizeof *got));
        for (uint32_t i = 0; i < count; i++)
            memcpy(b->dout[mine[i]], got[i], sizeof *got);
        CLN_TRY(cln_buffer_read(p->device, &p->results, 0, b->trained, rays));
    }
done:
    free(mine);
    free(got);
    free(sums);
    return st;
}

/* ---- the comparison ---- */

/* Scales of gradients: of dL/dc the sample's weight; of dL/dsigma delta times the light that
 * reaches behind the sample times the largest dL/dw that the losses can have. */
static cln_status check_mixed(cln_checks *c, bool shared)
{
    static const char range[] =
        "sigma delta 0 to 1e6, 1 to 60 samples, equal t, t of 1e3, deltas of 0";
    cln_status st = CLN_OK;
    const cln_config *config = &c->p->config;
    ref_loss loss = cln_check_loss(c->p);
    cln_extreme colours = cln_extreme_row(c, "colour and opacity", range);
    cln_extreme losses = cln_extreme_row(c, "loss", range);
    cln_extreme by_colour = cln_extreme_row(c, "colour gradient / sample weight", range);
    cln_extreme by_density = cln_extreme_row(c, "density gradient / light behind", range);
    batch b = {0};

    CLN_TRY(make(&b, MIXED_RAYS, MIXED_RAYS * MIXED_MOST, MIXED_MOST));
    fill_mixed(&b);
    CLN_TRY(shared ? run_shared(c->p, &b) : run(c->p, &b));
    for (int r = 0; r < MIXED_RAYS; r++) {
        const int n = widen(&b, r), back = c->p->ray_background ? r : 0;
        const char *kind = kinds[r % KINDS];
        const double span = b.t[n - 1] - b.t[0] + b.delta[n - 1];
        const double reach = ref_reach(b.ray_o[r], b.ray_d[r], b.shown[r]);
        const double pull = config->depth_loss * b.shown[r][3];
        const double most = 3 + loss.opacity_entropy / 0.11 + 4 * loss.distortion * span +
                            2 * loss.alpha + pull * (1 + fabs(reach) + b.t[n - 1]); /* of dL/dw */
        double background[3], target[4], rgb[3], depth = 0, opacity = 0, tau = 0, want = 0;

        loss.depth = pull;
        loss.reach = reach;
        for (int k = 0; k < 3; k++)
            background[k] = b.backgrounds[back][k];
        for (int k = 0; k < 4; k++)
            target[k] = b.targets[r][k];
        ref_composite(n, (const double(*)[4])b.wide, b.t, b.delta, background, rgb, &depth,
                      &opacity, NULL);
        for (int k = 0; k < 3; k++)
            cln_extreme_meet(&colours, (&b.trained[r].r)[k], rgb[k], rgb[k], 1e-5, "%s, ray %d",
                             kind, r);
        cln_extreme_meet(&colours, b.trained[r].opacity, opacity, opacity, 1e-5, "%s, ray %d", kind,
                         r);
        want = ref_loss_of_ray(&loss, n, (const double(*)[4])b.wide, b.t, b.delta, background,
                               target, b.grad);
        cln_extreme_meet(&losses, b.trained[r].loss, want, fmax(want, 1e-2), 1e-4, "%s, ray %d",
                         kind, r);
        for (int i = 0; i < n; i++) {
            const float *got = b.dout[b.starts[r] + (uint32_t)i];
            const double x = optical_depth(&b, i), weight = exp(-tau) * -expm1(-x);

            tau += x;
            for (int k = 0; k < 3; k++)
                cln_extreme_meet(&by_colour, got[k], b.grad[i][k] / MIXED_RAYS, weight / MIXED_RAYS,
                                 1e-5 + 3e-7 * tau, "%s, sample %d of ray %d", kind, i, r);
            cln_extreme_meet(&by_density, got[3], b.grad[i][3] / MIXED_RAYS,
                             most * b.delta[i] * exp(-tau) / MIXED_RAYS, 1e-5 + 1e-6 * tau,
                             "%s, sample %d of ray %d", kind, i, r);
        }
    }
    cln_extreme_report(&colours);
    cln_extreme_report(&losses);
    cln_extreme_report(&by_colour);
    cln_extreme_report(&by_density);
done:
    free_batch(&b);
    return st;
}

cln_status cln_extremes_regularised(cln_checks *c)
{
    return check_mixed(c, false);
}

cln_status cln_extremes_stretches(cln_checks *c)
{
    return check_mixed(c, true);
}
