/* Sums of measures over leaves, the distillation's gradient, the regularisers' points and
 * gradients. Compared: all leaves, up to 2,000 points of the distillation, all points of the
 * regularisers. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "bench.h"

enum { MOST = 2000 };

/* ---- sums over leaves ---- */

static const bench_part leaf_parts[] = {{"leaf_measure", "leaf_measure"}};
static const struct {
    uint32_t n;
    int level;
} leaf_shapes[] = {{1, 0}, {64, 1}, {1000000, 4}};

typedef struct leaf {
    cln_pipeline *p;
    uint32_t n;
} leaf;

static cln_status leaf_body(void *context)
{
    const leaf *l = context;

    return cln_stage_measure(l->p, l->n);
}

static cln_status run_leaf(bench *b, int shape)
{
    cln_status st = CLN_OK;
    leaf l = {.n = leaf_shapes[shape].n};
    bench_errors errors = {0};
    uint32_t slices = 0;
    size_t leaves = 0;
    cln_sample *samples = NULL;
    float *measures = NULL, *sums = NULL;
    double *want = NULL;
    cln_model model = {0};
    cln_config config;

    CLN_TRY(bench_measuring(b, &config, &l.p));
    config.start_level = leaf_shapes[shape].level;
    CLN_TRY(cln_model_create(&config, &model));
    CLN_TRY(cln_pipeline_rebuild(l.p, model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(l.p, &model, true));
    leaves = (size_t)l.p->leaves;
    CLN_TRY(cln_alloc(&samples, l.n, sizeof *samples, "bench"));
    CLN_TRY(cln_alloc(&measures, l.n, sizeof *measures, "bench"));
    CLN_TRY(cln_alloc(&sums, leaves * CLN_MEASURES * 2, sizeof *sums, "bench"));
    CLN_TRY(cln_alloc(&want, leaves, sizeof *want, "bench"));
    for (uint32_t i = 0; i < l.n; i++) {
        samples[i].slot = (cln_i32)(i * 7919u % leaves);
        measures[i] = (float)pow(10, cln_check_uniform(31, i, -6, 0));
        want[samples[i].slot] += measures[i];
    }
    CLN_TRY(cln_pipeline_samples(l.p, samples, l.n));
    CLN_TRY(cln_check_put(b->device, &l.p->measures, measures, l.n * sizeof *measures));
    CLN_TRY(cln_stage_group(l.p, l.n, &slices));
    CLN_TRY(cln_stage_measure_reset(l.p));
    CLN_TRY(leaf_body(&l));
    CLN_TRY(cln_buffer_read(b->device, &l.p->leaf_sums, 0, sums,
                            leaves * CLN_MEASURES * 2 * sizeof *sums));
    for (size_t i = 0; i < leaves; i++)
        sums[i] = sums[i * CLN_MEASURES * 2]; /* the first sum of each leaf, to the front */
    bench_compare(&errors, sums, want, leaves, 1e-11, 1e-5);
    CLN_TRY(bench_add(b, 0, leaf_body, NULL, &l, CLN_STAGES,
                      bench_work_leaf_measure(l.n, (double)leaves, 1), &errors));
done:
    cln_model_free(&model);
    free(samples);
    free(measures);
    free(sums);
    free(want);
    return st;
}

static void leaf_text(int shape, char out[64])
{
    snprintf(out, 64, "%u samples %d leaves", leaf_shapes[shape].n,
             1 << (3 * leaf_shapes[shape].level));
}

const bench_family bench_leaf = {
    "measure", leaf_parts, 1, sizeof leaf_shapes / sizeof leaf_shapes[0], leaf_text, run_leaf};

/* ---- distillation ---- */

static const bench_part distil_parts[] = {{"distil_gradient", "distil_gradient"}};
static const int distil_points[] = {1, 64, 1000000};

typedef struct distil {
    cln_pipeline *p;
    uint32_t n;
} distil;

static cln_status distil_body(void *context)
{
    const distil *d = context;

    return cln_stage_distil_gradient(d->p, d->n, 1);
}

static cln_status run_distil(bench *b, int shape)
{
    cln_status st = CLN_OK;
    const int count = distil_points[shape] < MOST ? distil_points[shape] : MOST;
    distil d = {.n = (uint32_t)distil_points[shape]};
    bench_errors errors = {0};
    cln_sample *samples = NULL;
    float(*out)[4] = NULL, (*targets)[4] = NULL, (*dout)[4] = NULL, got[MOST * 4];
    double want[MOST * 4];
    cln_config config;

    CLN_TRY(bench_measuring(b, &config, &d.p));
    CLN_TRY(cln_alloc(&samples, d.n, sizeof *samples, "bench"));
    CLN_TRY(cln_alloc(&out, d.n, sizeof *out, "bench"));
    CLN_TRY(cln_alloc(&targets, d.n, sizeof *targets, "bench"));
    CLN_TRY(cln_alloc(&dout, d.n, sizeof *dout, "bench"));
    for (uint32_t i = 0; i < d.n; i++) {
        const double delta = cln_check_uniform(32, i, 0.01, 0.1);

        samples[i] = (cln_sample){.delta = (float)delta, .ray = i};
        for (uint32_t k = 0; k < 4; k++) {
            out[i][k] = (float)cln_check_uniform(34, 4 * i + k, 0, 1);
            targets[i][k] = (float)cln_check_uniform(35, 4 * i + k, 0, 1);
        }
        out[i][3] = (float)(pow(10, cln_check_uniform(33, i, -6, 1)) / delta);
    }
    CLN_TRY(cln_pipeline_samples(d.p, samples, d.n));
    CLN_TRY(cln_check_put(b->device, &d.p->out, out, d.n * sizeof *out));
    CLN_TRY(cln_check_put(b->device, &d.p->targets, targets, d.n * sizeof *targets));
    CLN_TRY(distil_body(&d));
    CLN_TRY(cln_buffer_read(b->device, &d.p->dout, 0, dout, d.n * sizeof *dout));
    for (int k = 0; k < count; k++) {
        const uint32_t i = (uint32_t)((int64_t)k * d.n / count);
        double wide_out[4], wide_target[4];

        for (int c = 0; c < 4; c++) {
            wide_out[c] = out[i][c];
            wide_target[c] = targets[i][c];
            got[4 * k + c] = dout[i][c];
        }
        ref_distil(wide_out, wide_target, samples[i].delta, want + 4 * k);
    }
    bench_compare(&errors, got, want, 4 * (size_t)count, 1e-9, 1e-3);
    CLN_TRY(bench_add(b, 0, distil_body, NULL, &d, CLN_STAGES, bench_work_distil(d.n), &errors));
done:
    free(samples);
    free(out);
    free(targets);
    free(dout);
    return st;
}

static void distil_text(int shape, char out[64])
{
    snprintf(out, 64, "%d points", distil_points[shape]);
}

const bench_family bench_distil = {"distil",    distil_parts,
                                   1,           sizeof distil_points / sizeof distil_points[0],
                                   distil_text, run_distil};

/* ---- regularisers ---- */

enum { POINTS_PART, GRADIENT_PART };
static const bench_part regularise_parts[] = {{"regularise_points", "regularise_points"},
                                              {"regularise_gradient", "regularise_gradient"}};
static const int regularise_levels[] = {1, 4};

static const cln_sampling sampling = {.jitter = true, .seed = 5, .step = 9};

typedef struct regularise {
    cln_pipeline *p;
    uint32_t n; /* extra samples */
    float *boxes;
    cln_sample *samples;
    float (*ray_o)[4], (*out)[4], (*dout)[4];
} regularise;

static cln_status points_body(void *context)
{
    const regularise *g = context;
    uint32_t samples = 0;

    return cln_stage_regularise(g->p, &sampling, 0, &samples);
}

static cln_status gradient_body(void *context)
{
    const regularise *g = context;

    return cln_stage_regularise_gradient(g->p, &sampling, g->n);
}

/* Sparsity points must lie in their leaves where the random numbers put them. */
static cln_status check_points(const regularise *g, int points, bench_errors *errors)
{
    cln_status st = CLN_OK;
    float *got = NULL;
    double *want = NULL;

    CLN_TRY(cln_alloc(&got, 3 * (size_t)points, sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&want, 3 * (size_t)points, sizeof *want, "bench"));
    for (int i = 0; i < points; i++) {
        const float *box = g->boxes + 4 * (size_t)g->samples[i].slot;
        float u[4];

        cln_uniform4(sampling.seed, CLN_STREAM_POINTS, sampling.step, (uint32_t)i, 0, u);
        for (int a = 0; a < 3; a++) {
            got[3 * i + a] = g->ray_o[i][a];
            want[3 * i + a] = box[a] + (double)u[a] * box[3];
        }
        errors->failed =
            errors->failed || abs(g->samples[i].slot - (int)((double)u[3] * g->p->leaves)) > 1;
    }
    bench_compare(errors, got, want, 3 * (size_t)points, 1e-12, 1e-5);
done:
    free(got);
    free(want);
    return st;
}

static cln_status check_gradient(const regularise *g, int points, int pairs, bench_errors *errors)
{
    cln_status st = CLN_OK;
    const cln_config *config = &g->p->config;
    double(*want)[4] = NULL;

    CLN_TRY(cln_alloc(&want, g->n, sizeof *want, "bench"));
    for (int i = 0; i < points; i++)
        want[i][3] = config->sparsity / points * ref_sparsity_gradient(g->out[i][3]);
    for (int i = points; i < points + pairs; i++) {
        const int j = i + pairs;
        const double side = fmin(g->boxes[4 * (size_t)g->samples[i].slot + 3],
                                 g->boxes[4 * (size_t)g->samples[j].slot + 3]);
        double a[4], b[4];
        float u[4];

        cln_uniform4(sampling.seed, CLN_STREAM_POINTS, sampling.step, (uint32_t)i, 1, u);
        for (int c = 0; c < 4; c++) {
            a[c] = g->out[i][c];
            b[c] = g->out[j][c];
        }
        ref_edge_gradient(a, b, side / config->n1, want[i], want[j]);
        for (int c = 0; c < 4; c++) {
            want[i][c] *= config->edge * (double)u[3] / pairs;
            want[j][c] *= config->edge * (double)u[3] / pairs;
        }
    }
    bench_compare(errors, g->dout[0], want[0], 4 * (size_t)points, 1e-9, 1e-4);
    bench_compare(errors, g->dout[points], want[points], 8 * (size_t)pairs, 1e-7, 1e-3);
done:
    free(want);
    return st;
}

static cln_status start_regularise(bench *b, int level, cln_model *model, regularise *g)
{
    cln_status st = CLN_OK;
    const float background[4] = {1, 1, 1, 0};
    cln_config config;

    CLN_TRY(bench_small_config(&config));
    config.start_level = level;
    config.stage1 = CLN_STAGE1_GATHER;
    config.n1 = 4;
    config.sparsity = 0.5;
    config.edge = 0.25;
    CLN_TRY(bench_pipeline(b, &config, false, NULL, &g->p));
    CLN_TRY(cln_model_create(&config, model));
    CLN_TRY(cln_pipeline_rebuild(g->p, model->tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(g->p, model, false));
    CLN_TRY(cln_octree_boxes(&model->tree, &g->boxes));
    g->n = (uint32_t)cln_pipeline_extra_samples(g->p);
    CLN_TRY(cln_alloc(&g->samples, g->n, sizeof *g->samples, "bench"));
    CLN_TRY(cln_alloc(&g->ray_o, g->n, sizeof *g->ray_o, "bench"));
    CLN_TRY(cln_alloc(&g->out, g->n, sizeof *g->out, "bench"));
    CLN_TRY(cln_alloc(&g->dout, g->n, sizeof *g->dout, "bench"));
    for (uint32_t i = 0; i < g->n; i++)
        for (uint32_t c = 0; c < 4; c++)
            g->out[i][c] = (float)(c < 3 ? cln_check_uniform(40, 4 * i + c, 0, 1)
                                         : pow(10, cln_check_uniform(41, i, -6, 4)));
    CLN_TRY(cln_pipeline_batch(g->p, (const cln_pixel[]){{0}}, 0, NULL, background));
    CLN_TRY(cln_pipeline_samples(g->p, g->samples, g->n));
    CLN_TRY(cln_check_put(b->device, &g->p->out, g->out, g->n * sizeof *g->out));
    CLN_TRY(cln_check_spoil(b->device, &g->p->dout, g->n * sizeof *g->dout));
    CLN_TRY(points_body(g));
    CLN_TRY(gradient_body(g));
    CLN_TRY(cln_buffer_read(b->device, &g->p->samples, 0, g->samples, g->n * sizeof *g->samples));
    CLN_TRY(cln_buffer_read(b->device, &g->p->ray_o, 0, g->ray_o,
                            (size_t)cln_pipeline_extra_rays(g->p) * sizeof *g->ray_o));
    CLN_TRY(cln_buffer_read(b->device, &g->p->dout, 0, g->dout, g->n * sizeof *g->dout));
done:
    return st;
}

static cln_status run_regularise(bench *b, int shape)
{
    cln_status st = CLN_OK;
    bench_errors places = {0}, gradients = {0};
    cln_model model = {0};
    regularise g = {0};
    int pairs = 0, points = 0;

    CLN_TRY(start_regularise(b, regularise_levels[shape], &model, &g));
    pairs = (int)g.n - cln_pipeline_extra_rays(g.p); /* two samples on one ray */
    points = (int)g.n - 2 * pairs;
    CLN_TRY(check_points(&g, points, &places));
    CLN_TRY(check_gradient(&g, points, pairs, &gradients));
    if (b->wanted[POINTS_PART])
        CLN_TRY(bench_add(b, POINTS_PART, points_body, NULL, &g, CLN_STAGES,
                          bench_work_points(points, pairs), &places));
    if (b->wanted[GRADIENT_PART])
        CLN_TRY(bench_add(b, GRADIENT_PART, gradient_body, NULL, &g, CLN_STAGES,
                          bench_work_points_gradient(points, pairs), &gradients));
done:
    cln_model_free(&model);
    free(g.boxes);
    free(g.samples);
    free(g.ray_o);
    free(g.out);
    free(g.dout);
    return st;
}

static void regularise_text(int shape, char out[64])
{
    snprintf(out, 64, "8192 samples %d leaves", 1 << (3 * regularise_levels[shape]));
}

const bench_family bench_regularise = {
    "regularise",    regularise_parts, 2, sizeof regularise_levels / sizeof regularise_levels[0],
    regularise_text, run_regularise};
