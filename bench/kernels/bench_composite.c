/* Compositing, and its loss, gradient and measures. Compared: up to 2,000 rays. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "bench.h"

enum { MOST = 2000, PER_RAY = 16 };

enum { EACH = 4 }; /* rays of a pixel */

enum { COMPOSITE_PART, TRAIN_PART, PIXELS_PART };
static const bench_part composite_parts[] = {{"composite", "composite"},
                                             {"composite_train", "composite_train"},
                                             {"composite_pixels", "composite_pixels"}};
static const int composite_rays[] = {1, 64, 4096, 65536};

typedef struct batch {
    cln_pipeline *p;
    int rays;
    uint32_t samples, *starts;
    cln_sample *sample;
    float (*out)[4], (*targets)[4], (*ray_o)[4], (*ray_d)[4], (*shown)[4], background[4];
} batch;

/* Rays of 16 samples: empty, faint and opaque. */
static cln_status make_batch(batch *t)
{
    cln_status st = CLN_OK;
    cln_device *device = t->p->device;
    const size_t rays = (size_t)t->rays;
    uint32_t at = 0;

    t->samples = (uint32_t)t->rays * PER_RAY;
    CLN_TRY(cln_alloc(&t->starts, rays + 1, sizeof *t->starts, "bench"));
    CLN_TRY(cln_alloc(&t->sample, t->samples, sizeof *t->sample, "bench"));
    CLN_TRY(cln_alloc(&t->out, t->samples, sizeof *t->out, "bench"));
    CLN_TRY(cln_alloc(&t->targets, rays, sizeof *t->targets, "bench"));
    CLN_TRY(cln_alloc(&t->ray_o, rays, sizeof *t->ray_o, "bench"));
    CLN_TRY(cln_alloc(&t->ray_d, rays, sizeof *t->ray_d, "bench"));
    CLN_TRY(cln_alloc(&t->shown, rays, sizeof *t->shown, "bench"));
    for (uint32_t r = 0; r < (uint32_t)t->rays; r++) {
        double along = cln_check_uniform(8, r, 0, 2);

        t->starts[r] = at;
        for (uint32_t i = 0; i < PER_RAY; i++, at++) {
            const double delta = cln_check_uniform(9, at, 1e-3, 0.1);
            const double depth =
                r % 4 == 0 && i == PER_RAY / 2 ? 50 : pow(10, cln_check_uniform(10, at, -6, 0));

            t->sample[at] = (cln_sample){
                .t = (float)(along + delta / 2), .delta = (float)delta, .ray = r, .slot = 0};
            along += delta;
            for (uint32_t k = 0; k < 3; k++)
                t->out[at][k] = (float)cln_check_uniform(11, 3 * at + k, 0, 1);
            t->out[at][3] = (float)(depth / delta);
        }
        for (uint32_t k = 0; k < 3; k++)
            t->targets[r][k] = (float)cln_check_uniform(12, 3 * r + k, 0, 1);
        t->ray_d[r][3] = t->ray_d[r][2] = 1;
        if (r % 8 == 7) { /* as often as in training */
            t->shown[r][2] = (float)along;
            t->shown[r][3] = 1;
        }
    }
    t->starts[rays] = at;
    for (int k = 0; k < 3; k++)
        t->background[k] = 0.25f * (float)(k + 1);
    CLN_TRY(cln_check_put(device, &t->p->sample_starts, t->starts, (rays + 1) * sizeof *t->starts));
    CLN_TRY(cln_pipeline_samples(t->p, t->sample, t->samples));
    CLN_TRY(cln_check_put(device, &t->p->out, t->out, t->samples * sizeof *t->out));
    CLN_TRY(cln_check_put(device, &t->p->targets, t->targets, rays * sizeof *t->targets));
    CLN_TRY(cln_check_put(device, &t->p->backgrounds, t->background, sizeof t->background));
    CLN_TRY(cln_check_put(device, &t->p->ray_o, t->ray_o, rays * sizeof *t->ray_o));
    CLN_TRY(cln_check_put(device, &t->p->ray_d, t->ray_d, rays * sizeof *t->ray_d));
    if (t->p->config.depth_loss > 0)
        CLN_TRY(cln_check_put(device, &t->p->shown, t->shown, rays * sizeof *t->shown));
    CLN_TRY(cln_check_spoil(device, &t->p->results, rays * sizeof(cln_ray_result)));
done:
    return st;
}

static void free_batch(batch *t)
{
    free(t->starts);
    free(t->sample);
    free(t->out);
    free(t->targets);
    free(t->ray_o);
    free(t->ray_d);
    free(t->shown);
}

static cln_status picture_body(void *context)
{
    const batch *t = context;

    return cln_stage_composite(t->p, t->rays, 0);
}

static cln_status train_body(void *context)
{
    const batch *t = context;

    return cln_stage_composite_train(t->p, t->rays, t->samples);
}

/* The kernel moves the targets. */
static cln_status pixels_before(void *context)
{
    const batch *t = context;

    return cln_check_put(t->p->device, &t->p->targets, t->targets,
                         (size_t)t->rays * sizeof *t->targets);
}

static cln_status pixels_body(void *context)
{
    const batch *t = context;

    return cln_stage_composite_pixels(t->p, t->rays);
}

typedef struct wide_ray {
    double out[PER_RAY][4], t[PER_RAY], delta[PER_RAY], background[3], target[4];
} wide_ray;

static void widen(const batch *t, int r, wide_ray *w)
{
    for (uint32_t i = 0; i < PER_RAY; i++) {
        const uint32_t at = t->starts[r] + i;

        w->t[i] = t->sample[at].t;
        w->delta[i] = t->sample[at].delta;
        for (int k = 0; k < 4; k++)
            w->out[i][k] = t->out[at][k];
    }
    for (int k = 0; k < 3; k++)
        w->background[k] = t->background[k];
    for (int k = 0; k < 4; k++)
        w->target[k] = t->targets[r][k];
}

/* Compares every (rays / count)-th ray: its picture, or its gradients and measures. */
static cln_status check_batch(const batch *t, bool train, bench_errors *errors)
{
    enum { GRADIENTS = PER_RAY * 4 };
    cln_status st = CLN_OK;
    const cln_config *config = &t->p->config;
    ref_loss rule = cln_check_loss(t->p);
    const int count = t->rays < MOST ? t->rays : MOST, each = train ? GRADIENTS : 5;
    cln_ray_result *results = NULL;
    float(*dout)[4] = NULL, *measures = NULL, *got = NULL, *shares = NULL;
    double *want = NULL, *want_shares = NULL;

    CLN_TRY(cln_alloc(&results, (size_t)t->rays, sizeof *results, "bench"));
    CLN_TRY(cln_alloc(&dout, t->samples, sizeof *dout, "bench"));
    CLN_TRY(cln_alloc(&measures, t->samples, sizeof *measures, "bench"));
    CLN_TRY(cln_alloc(&got, (size_t)(count * each), sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&want, (size_t)(count * each), sizeof *want, "bench"));
    CLN_TRY(cln_alloc(&shares, (size_t)(count * PER_RAY), sizeof *shares, "bench"));
    CLN_TRY(cln_alloc(&want_shares, (size_t)(count * PER_RAY), sizeof *want_shares, "bench"));
    CLN_TRY(cln_buffer_read(t->p->device, &t->p->results, 0, results,
                            (size_t)t->rays * sizeof *results));
    if (train) {
        CLN_TRY(cln_buffer_read(t->p->device, &t->p->dout, 0, dout, t->samples * sizeof *dout));
        CLN_TRY(cln_buffer_read(t->p->device, &t->p->measures, 0, measures,
                                t->samples * sizeof *measures));
    }
    for (int k = 0; k < count; k++) {
        const int r = (int)((int64_t)k * t->rays / count);
        double rgb[5], grad[PER_RAY][4], measured[PER_RAY][3];
        wide_ray w;

        widen(t, r, &w);
        if (!train) {
            ref_composite(PER_RAY, (const double(*)[4])w.out, w.t, w.delta, w.background, rgb,
                          rgb + 3, rgb + 4, NULL);
            rgb[3] = ref_median_depth(PER_RAY, (const double(*)[4])w.out, w.t, w.delta);
            memcpy(want + 5 * k, rgb, sizeof rgb);
            memcpy(got + 5 * k,
                   (const float[5]){results[r].r, results[r].g, results[r].b, results[r].depth,
                                    results[r].opacity},
                   5 * sizeof(float));
            continue;
        }
        rule.depth = config->depth_loss * t->shown[r][3];
        rule.reach = ref_reach(t->ray_o[r], t->ray_d[r], t->shown[r]);
        ref_loss_of_ray(&rule, PER_RAY, (const double(*)[4])w.out, w.t, w.delta, w.background,
                        w.target, grad);
        ref_measures(PER_RAY, (const double(*)[4])w.out, w.delta, w.background, w.target, measured);
        for (int i = 0; i < GRADIENTS; i++) {
            want[k * GRADIENTS + i] = grad[i / 4][i % 4] / t->rays; /* the loss is a mean */
            got[k * GRADIENTS + i] = dout[t->starts[r] + (uint32_t)i / 4][i % 4];
        }
        for (int i = 0; i < PER_RAY; i++) {
            want_shares[k * PER_RAY + i] = measured[i][0];
            shares[k * PER_RAY + i] = measures[t->starts[r] + (uint32_t)i];
        }
    }
    bench_compare(errors, got, want, (size_t)(count * each), train ? 1e-8 : 1e-10,
                  train ? 1e-3 : 1e-4);
    if (train)
        bench_compare(errors, shares, want_shares, (size_t)(count * PER_RAY), 1e-9, 1e-3);
done:
    free(results);
    free(dout);
    free(measures);
    free(got);
    free(want);
    free(shares);
    free(want_shares);
    return st;
}

/* Compares the targets of every (pixels / count)-th pixel. */
static cln_status check_pixels(const batch *t, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const int pixels = (t->rays + EACH - 1) / EACH, most = MOST / EACH;
    const int count = pixels < most ? pixels : most;
    float(*targets)[4] = NULL, *got = NULL;
    double *want = NULL;
    size_t compared = 0;

    CLN_TRY(cln_alloc(&targets, (size_t)t->rays, sizeof *targets, "bench"));
    CLN_TRY(cln_alloc(&got, (size_t)(count * EACH) * 4, sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&want, (size_t)(count * EACH) * 4, sizeof *want, "bench"));
    CLN_TRY(cln_buffer_read(t->p->device, &t->p->targets, 0, targets,
                            (size_t)t->rays * sizeof *targets));
    for (int k = 0; k < count; k++) {
        const int first = (int)((int64_t)k * pixels / count) * EACH;
        const int rays = t->rays - first < EACH ? t->rays - first : EACH;
        double own[EACH][5], mean[4] = {0};

        for (int i = 0; i < rays; i++) {
            wide_ray w;

            widen(t, first + i, &w);
            ref_composite(PER_RAY, (const double(*)[4])w.out, w.t, w.delta, w.background, own[i],
                          &own[i][4], &own[i][3], NULL);
            for (int c = 0; c < 4; c++)
                mean[c] += own[i][c] / rays;
        }
        for (int i = 0; i < rays; i++)
            for (int c = 0; c < 4; c++) {
                want[compared] = t->targets[first + i][c] + own[i][c] - mean[c];
                got[compared++] = targets[first + i][c];
            }
    }
    bench_compare(errors, got, want, compared, 1e-10, 1e-4);
done:
    free(targets);
    free(got);
    free(want);
    return st;
}

static cln_status run_pixels(bench *b, cln_config *config, int shape)
{
    cln_status st = CLN_OK;
    batch t = {.rays = composite_rays[shape]};
    bench_errors errors = {0};
    cln_pixel *pixels = NULL;

    config->antialias = 2;
    CLN_TRY(bench_pipeline(b, config, false, NULL, &t.p));
    CLN_TRY(make_batch(&t));
    CLN_TRY(cln_alloc(&pixels, (size_t)t.rays, sizeof *pixels, "bench"));
    for (int r = 0; r < t.rays; r++)
        pixels[r].spot = CLN_SPOT(0, 0, r % EACH, EACH);
    CLN_TRY(cln_check_put(b->device, &t.p->pixels, pixels, (size_t)t.rays * sizeof *pixels));
    CLN_TRY(pixels_body(&t));
    CLN_TRY(check_pixels(&t, &errors));
    CLN_TRY(bench_add(b, PIXELS_PART, pixels_body, pixels_before, &t, CLN_STAGES,
                      bench_work_composite_pixels(t.rays, t.samples), &errors));
done:
    free(pixels);
    free_batch(&t);
    return st;
}

static cln_status run_composite(bench *b, int shape)
{
    cln_status st = CLN_OK;
    batch t = {.rays = composite_rays[shape]};
    bench_errors pictures = {0}, gradients = {0};
    cln_config config;

    CLN_TRY(bench_measuring(b, &config, &t.p));
    CLN_TRY(make_batch(&t));
    if (b->wanted[COMPOSITE_PART]) {
        CLN_TRY(picture_body(&t));
        CLN_TRY(check_batch(&t, false, &pictures));
        CLN_TRY(bench_add(b, COMPOSITE_PART, picture_body, NULL, &t, CLN_STAGES,
                          bench_work_composite(t.rays, t.samples), &pictures));
    }
    if (b->wanted[TRAIN_PART]) {
        CLN_TRY(train_body(&t));
        CLN_TRY(check_batch(&t, true, &gradients));
        CLN_TRY(bench_add(b, TRAIN_PART, train_body, NULL, &t, CLN_STAGES,
                          bench_work_composite_train(t.rays, t.samples, 1), &gradients));
    }
    if (b->wanted[PIXELS_PART])
        CLN_TRY(run_pixels(b, &config, shape));
done:
    free_batch(&t);
    return st;
}

static void composite_text(int shape, char out[64])
{
    snprintf(out, 64, "%d rays %d samples", composite_rays[shape], composite_rays[shape] * PER_RAY);
}

const bench_family bench_composite = {
    "composite",    composite_parts, 3, sizeof composite_rays / sizeof composite_rays[0],
    composite_text, run_composite};
