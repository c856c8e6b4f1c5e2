/* Training against a second trainer in float64: 50 steps from the same initial weights, on the same
 * rays and samples. It has its own weights and moments in double, and follows docs/method.md 1, 9,
 * 10 and 11 in plain loops (host/reference): networks, compositing, loss, gradient, roulette, Adam,
 * moments of 16 bits. It takes from the device which pixels a step drew and where its samples lie,
 * which test_rays, test_sampling and test_splat compare, and from base/rng.h the random numbers.
 *
 * Two trainings move apart: a rounding changes the side of an activation's kink or whether the
 * roulette takes a sample, and Adam, which divides by the gradient's size, makes steps of a
 * gradient that is all rounding. So the bound is on the loss curve. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "base/rng.h"
#include "check/selftest_checks.h"
#include "run_fixture.h"
#include "tests.h"
#include "train/step.h"

enum { CURVE = 50, BEGINNING = 20, REFRESH = 8, MOST_SLOPES = 8 * 64 + 64 };

/* A preset with few rays, and where its networks are large, smaller ones. */
typedef struct preset_case {
    const char *preset;
    int level, width, depth, view_width; /* 0: the preset's */
    double lr;                           /* enough to learn in 50 steps; 0: the preset's */
    double bound;                        /* relative, of a step's loss */
} preset_case;

/* ---- both trainings ---- */

typedef struct twin {
    const cln_config *config;
    const cln_network *net;
    double *params, *m, *v, *grads; /* [leaf][params] */
    int64_t *steps;                 /* [leaf] */
    float *boxes;                   /* [leaf][4] */
} twin;

/* What the device's step worked on. */
typedef struct step_work {
    uint32_t samples, slice_count;
    float (*ray_o)[4], (*ray_d)[4]; /* [ray] */
    cln_sample *sample;             /* [sample], of a ray side by side */
    uint32_t *order;                /* [grouped sample] */
    cln_slice *slice;
} step_work;

static cln_config config_of(const preset_case *c)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset(c->preset, &config));
    config.start_level = c->level;
    config.level_at[0] = 0;
    config.adaptive = false;
    config.cull_from = 1;
    config.width = c->width ? c->width : config.width;
    config.depth = c->depth ? c->depth : config.depth;
    config.view_width = c->view_width ? c->view_width : config.view_width;
    config.n1 = 8;
    config.rays = 96;
    config.views_per_batch = 3;
    config.batch_samples = 4096;
    config.steps = CURVE;
    config.seed = 3;
    config.depth_loss = 0; /* its scene has no sparse points */
    config.lr = c->lr > 0 ? c->lr : config.lr;
    config.lr_final = c->lr > 0 ? c->lr / 10 : config.lr_final;
    assert_ok(cln_config_check(&config));
    return config;
}

/* As cln_train does, but without a run folder. */
static void open_trainer(const cln_config *config, cln_trainer *t)
{
    const cln_scene_desc scene = {
        .path = fixture_path("scene"), .config = config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    const cln_device_desc device = fixture_device();
    cln_plan_desc plan = {&t->pipeline, NULL, 0, true, 0, 0};

    memset(t, 0, sizeof *t);
    assert_ok(cln_device_open(&device, &t->device));
    assert_ok(cln_scene_load(&scene, &t->scene));
    assert_ok(cln_model_create(config, &t->model));
    t->model.space = t->scene->space;
    memcpy(t->model.background, t->scene->background, sizeof t->model.background);
    t->model.has_alpha = t->scene->has_alpha;
    t->steps = config->steps;
    assert_ok(cln_batch_create(t->scene, config, &t->batch));
    assert_ok(
        cln_alloc(&t->results, (size_t)cln_config_most_rays(config), sizeof *t->results, "test"));
    assert_ok(cln_exposure_start(t->scene, cln_config_most_rays(config), &t->model, &t->exposure));
    assert_ok(cln_pipeline_create(t->device, config,
                                  &(cln_pipeline_facts){.lenses = t->scene->lenses,
                                                        .alpha = t->scene->has_alpha,
                                                        .space = &t->model.space},
                                  CLN_PROGRAMS_ALL, &t->pipeline));
    assert_ok(cln_pipeline_share(&t->pipeline));
    plan.scene = t->scene;
    plan.leaves = t->model.tree.leaf_count;
    cln_plan_device(&plan, &t->plan);
    cln_plan_apply(&t->plan, &t->pipeline);
    t->model.rays = config->rays;
    assert_ok(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    assert_ok(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    assert_ok(cln_pipeline_upload(&t->pipeline, &t->model, true));
    assert_ok(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
}

static void close_trainer(cln_trainer *t)
{
    free(t->results);
    cln_batch_free(&t->batch);
    cln_exposure_free(&t->exposure);
    cln_pipeline_free(&t->pipeline);
    cln_model_free(&t->model);
    cln_scene_free(t->scene);
    cln_device_close(t->device);
}

static void *room(size_t count, size_t size)
{
    void *p = calloc(count ? count : 1, size);

    assert_non_null(p);
    return p;
}

static void open_twin(const cln_model *model, const cln_config *config, twin *w)
{
    const size_t leaves = (size_t)model->tree.leaf_count, params = (size_t)model->net.params;

    *w = (twin){.config = config, .net = &model->net};
    w->params = room(leaves * params, sizeof *w->params);
    w->m = room(leaves * params, sizeof *w->m);
    w->v = room(leaves * params, sizeof *w->v);
    w->grads = room(leaves * params, sizeof *w->grads);
    w->steps = room(leaves, sizeof *w->steps);
    assert_ok(cln_octree_boxes(&model->tree, &w->boxes));
    for (size_t i = 0; i < leaves * params; i++)
        w->params[i] = model->params[i];
}

static void close_twin(twin *w)
{
    free(w->params);
    free(w->m);
    free(w->v);
    free(w->grads);
    free(w->steps);
    free(w->boxes);
}

static void read_work(cln_trainer *t, int rays, uint32_t samples, step_work *w)
{
    cln_pipeline *p = &t->pipeline;
    uint32_t last = 0;

    *w = (step_work){.samples = samples};
    w->ray_o = room((size_t)rays, sizeof *w->ray_o);
    w->ray_d = room((size_t)rays, sizeof *w->ray_d);
    w->sample = room(samples, sizeof *w->sample);
    w->order = room(samples, sizeof *w->order);
    assert_ok(CLN_GET(p, ray_o, w->ray_o, (size_t)rays));
    assert_ok(CLN_GET(p, ray_d, w->ray_d, (size_t)rays));
    assert_ok(CLN_GET(p, samples, w->sample, samples));
    assert_ok(CLN_GET(p, values, w->order, samples));
    assert_ok(cln_stage_slices(p, &last));
    w->slice_count = last;
    w->slice = room(last, sizeof *w->slice);
    assert_ok(CLN_GET(p, slices, w->slice, last));
}

static void free_work(step_work *w)
{
    free(w->ray_o);
    free(w->ray_d);
    free(w->sample);
    free(w->order);
    free(w->slice);
}

/* ---- a step in double ---- */

/* Slopes of a sample (method.md 1.1, 15): [depth][width], then [view_width]. NULL: the mean. */
static const double *slopes_of(const twin *w, uint32_t key, uint32_t sample, double *slopes)
{
    const cln_config *c = w->config;
    const int width = w->net->width, count = w->net->depth * width + w->net->view_width;

    if (c->rrelu_scope == CLN_RRELU_MEAN)
        return NULL;
    assert_true(count <= MOST_SLOPES);
    for (int i = 0; i < count; i++) {
        const int layer = i / width < w->net->depth ? i / width : w->net->depth;
        const uint32_t own = c->rrelu_scope == CLN_RRELU_ELEMENT ? key + sample * 0x85EBCA6Bu : key;
        const uint32_t of_layer = own ^ ((uint32_t)layer * 0xC2B2AE35u + 0x165667B1u);
        const uint32_t bits = cln_hash((uint32_t)(i - layer * width) * 0x9E3779B9u ^ of_layer) >> 8;

        slopes[i] = c->rrelu_lower + (c->rrelu_upper - c->rrelu_lower) * bits / 0x1p24;
    }
    return slopes;
}

/* One sample through its leaf's network: forward to out, or with dout backward into grads. */
static void network(const twin *w, const step_work *k, uint32_t key, uint32_t i, double out[4],
                    const double *dout)
{
    const cln_sample *s = &k->sample[i];
    const float *box = w->boxes + 4 * s->slot;
    const size_t own = (size_t)s->slot * (size_t)w->net->params;
    ref_network r = {.net = *w->net,
                     .density = w->config->density,
                     .kappa = w->config->density_scale,
                     .bias = cln_network_density_bias(w->config),
                     .wide = w->params + own};
    double local[3], dir[3], slopes[MOST_SLOPES];
    const double *use = slopes_of(w, key, i, slopes);
    const double mean = 0.5 * (w->config->rrelu_lower + w->config->rrelu_upper);

    for (int b = 0; b < 10; b++)
        r.level_bands[b] = 1;
    for (int a = 0; a < 3; a++) {
        dir[a] = k->ray_d[s->ray][a];
        local[a] = (k->ray_o[s->ray][a] + (double)s->t * dir[a] - box[a]) * 2 / box[3] - 1;
    }
    if (dout)
        ref_backward(&r, NULL, local, dir, use, mean, dout, w->grads + own);
    else
        ref_forward(&r, NULL, local, dir, use, mean, out);
}

/* Factors of samples that the roulette takes, and 0 (method.md 11): slices in parts. */
static void choose(const twin *w, const step_work *k, uint32_t key, const double (*out)[4],
                   const double (*dout)[4], double *factors)
{
    const ref_network r = {.density = w->config->density, .kappa = w->config->density_scale};
    float(*narrow)[4] = room(k->samples, sizeof *narrow), (*slope)[4] = room(k->samples, 16);
    double heads[CLN_ROULETTE_SEGMENT][4], chosen[CLN_ROULETTE_SEGMENT];

    for (uint32_t i = 0; i < k->samples; i++)
        for (int c = 0; c < 4; c++) {
            narrow[i][c] = (float)out[i][c];
            slope[i][c] = (float)dout[i][c];
        }
    for (uint32_t s = 0; s < k->slice_count; s++)
        for (uint32_t at = 0; at < k->slice[s].count; at += CLN_ROULETTE_SEGMENT) {
            const uint32_t left = k->slice[s].count - at, first = k->slice[s].start + at;
            const uint32_t n = left < CLN_ROULETTE_SEGMENT ? left : CLN_ROULETTE_SEGMENT;

            ref_roulette(&r, w->config->roulette, cln_hash(key), (int)n, k->order + first,
                         (const float(*)[4])narrow, (const float(*)[4])slope, heads, chosen);
            for (uint32_t i = 0; i < n; i++)
                factors[k->order[first + i]] = chosen[i];
        }
    free(narrow);
    free(slope);
}

/* bfloat16 by chance, 16 random bits (method.md 11). */
static double round_by_chance(double value, uint32_t chance)
{
    const float narrow = (float)value;
    uint32_t bits = 0;

    memcpy(&bits, &narrow, sizeof bits);
    return ref_from_bf16((uint16_t)((bits + chance) >> 16));
}

static void update(twin *w, int slot, double lr)
{
    const cln_config *c = w->config;
    const int params = w->net->params;
    const size_t own = (size_t)slot * (size_t)params;
    const int64_t steps = ++w->steps[slot];
    const uint32_t key = (uint32_t)steps * 0x85EBCA6Bu + (uint32_t)slot * 0xC2B2AE35u;

    ref_adam(params, w->params + own, w->grads + own, w->m + own, w->v + own, steps, lr, c->beta1,
             c->beta2, c->epsilon);
    for (int i = 0; i < params && c->moments == CLN_MOMENTS_BFLOAT16; i++) {
        const uint32_t chance = cln_hash((uint32_t)i * 0x9E3779B9u ^ key);

        w->m[own + (size_t)i] = round_by_chance(w->m[own + (size_t)i], chance & 0xFFFF);
        w->v[own + (size_t)i] = round_by_chance(w->v[own + (size_t)i], chance >> 16);
    }
}

/* Step number `step` on the device's rays and samples; returns the mean loss of its rays. */
static double step_in_double(twin *w, const step_work *k, const cln_batch *batch, int rays,
                             uint32_t step)
{
    const cln_config *c = w->config;
    const ref_loss loss = {.kind = c->loss, .huber_delta = c->huber_delta, .alpha = c->alpha_loss};
    const uint32_t key = cln_hash(step + cln_hash((uint32_t)c->seed));
    const double fraction = (double)step / CURVE;
    const double lr = c->lr_schedule == CLN_SCHEDULE_STEP
                          ? c->lr * pow(0.1, floor(3 * fraction))
                          : c->lr * pow(c->lr_final / c->lr, fraction);
    double(*out)[4] = room(k->samples, sizeof *out), (*dout)[4] = room(k->samples, sizeof *dout);
    double *factors = room(k->samples, sizeof *factors), total = 0;
    int *met = NULL, leaves = 0;

    for (uint32_t i = 0; i < k->samples; i++) {
        network(w, k, key, i, out[i], NULL);
        leaves = k->sample[i].slot >= leaves ? k->sample[i].slot + 1 : leaves;
    }
    for (uint32_t i = 0, r = 0; r < (uint32_t)rays; r++) {
        double t[512], delta[512], back[3], target[4];
        const uint32_t first = i;

        for (; i < k->samples && k->sample[i].ray == r; i++) {
            assert_true(i - first < 512);
            t[i - first] = k->sample[i].t;
            delta[i - first] = k->sample[i].delta;
        }
        for (int a = 0; a < 4; a++)
            target[a] = batch->targets[r][a];
        for (int a = 0; a < 3; a++)
            back[a] = batch->backgrounds[0][a];
        total += ref_loss_of_ray(&loss, (int)(i - first), (const double(*)[4])out + first, t, delta,
                                 back, target, dout + first);
    }
    for (uint32_t i = 0; i < k->samples; i++)
        for (int a = 0; a < 4; a++)
            dout[i][a] /= rays;
    choose(w, k, key, (const double(*)[4])out, (const double(*)[4])dout, factors);
    met = room((size_t)leaves, sizeof *met);
    for (uint32_t i = 0; i < k->samples; i++)
        met[k->sample[i].slot]++;
    memset(w->grads, 0, (size_t)leaves * (size_t)w->net->params * sizeof *w->grads);
    for (uint32_t i = 0; i < k->samples; i++) {
        for (int a = 0; a < 4; a++)
            dout[i][a] *= factors[i];
        if (factors[i] > 0 && met[k->sample[i].slot] >= c->min_leaf_samples)
            network(w, k, key, i, NULL, dout[i]);
    }
    for (int s = 0; s < leaves; s++)
        if (met[s] >= c->min_leaf_samples && met[s] > 0)
            update(w, s, lr);
    free(out);
    free(dout);
    free(factors);
    free(met);
    return total / rays;
}

/* ---- comparison ---- */

/* Trains both for the first `steps` steps; returns the largest relative difference of a step's
 * loss. *fell: the loss of the last five steps over that of the first five. */
static double compare_curves(const preset_case *c, uint32_t steps, double *fell)
{
    const cln_config config = config_of(c);
    double worst = 0, first = 0, last = 0, off = 0, moved = 0;
    int worst_step = 0;
    cln_trainer t;
    cln_batch batch;
    twin w;

    open_trainer(&config, &t);
    assert_ok(cln_batch_create(t.scene, &config, &batch));
    open_twin(&t.model, &config, &w);
    for (uint32_t step = 0; step < steps; step++) {
        const cln_draw draw = {.step = step, .n = t.model.rays};
        double own = 0, device = 0;
        step_work k;

        assert_false(cln_batch_skips(&t.batch, &config, step)); /* all leaves are there */
        cln_batch_draw(&batch, t.scene, &config, &draw);
        if (step % REFRESH == 0)
            assert_ok(cln_stage_refresh(&t.pipeline, 0, t.pipeline.leaves, true,
                                        (uint64_t)config.seed, step));
        assert_ok(cln_step(&t, (double)step / CURVE));
        assert_int_equal(t.owed.rays, draw.n);
        assert_ok(cln_step_catch_up(&t));
        for (int i = 0; i < draw.n; i++)
            device += t.results[i].loss / draw.n;
        read_work(&t, draw.n, t.owed.samples, &k);
        own = step_in_double(&w, &k, &batch, draw.n, step);
        free_work(&k);
        if (fabs(device / own - 1) > worst || !isfinite(device)) {
            worst = isfinite(device) ? fabs(device / own - 1) : INFINITY;
            worst_step = (int)step;
        }
        first += step < 5 ? own : 0;
        last += step >= steps - 5 ? own : 0;
    }
    assert_ok(cln_pipeline_download(&t.pipeline, &t.model, false));
    for (int i = 0; i < t.model.tree.leaf_count * w.net->params; i++) {
        off += pow(t.model.params[i] - w.params[i], 2);
        moved += pow(w.params[i], 2);
    }
    *fell = last / first;
    print_message("%s: the loss falls to %.3f; float32 is off by %.1e of it at most (step %d), "
                  "weights by %.1e\n",
                  c->preset, *fell, worst, worst_step, sqrt(off / moved));
    close_twin(&w);
    cln_batch_free(&batch);
    close_trainer(&t);
    return worst;
}

/* Bounds: ten times what PoCL is off by, on the whole curve. */
static const preset_case cases[] = {
    {"fast", 2, 0, 0, 0, 0, 5e-4},
    {"paper", 1, 16, 8, 32, 5e-3, 1e-3},
    {"nerf", 0, 32, 8, 32, 5e-3, 4e-3},
    {"kilonerf", 2, 0, 0, 0, 0, 5e-3},
};

static void test_curves(void **state)
{
    NEED_DEVICE();
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double fell = 0;
        const double worst = compare_curves(&cases[i], CURVE, &fell);

        if (!(worst < cases[i].bound))
            fail_msg("%s: off by %.2e, the bound is %.0e", cases[i].preset, worst, cases[i].bound);
        assert_true(fell < 0.9); /* it is training that is compared */
    }
}

/* Kernels that are slightly wrong leave the curve. */
static void test_notices(void **state)
{
    static const struct {
        const char *file, *from, *to;
    } faults[] = {
        {"adam.h", "a.rate * m1 /", "1.01f * a.rate * m1 /"},
        {"adam.h", "a.second = 1.0f /", "a.second = 0.98f /"},
        {"roulette.cl", "fmax((vf)(least) / size, (vf)(1.0f))", "(vf)(1.0f)"},
        {"loss.h", "#define OPTICAL_DEPTH(x) (", "#define OPTICAL_DEPTH(x) 1.005f * ("},
    };
    const char *before = getenv("CLN_TEST_KERNEL_DIR");

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        double fell = 0, worst = 0;
        char folder[32];

        snprintf(folder, sizeof folder, "wrong %zu", i);
        setenv("CLN_TEST_KERNEL_DIR",
               fixture_kernels_changed(folder, faults[i].file, faults[i].from, faults[i].to), 1);
        worst = compare_curves(&cases[0], BEGINNING, &fell);
        if (before)
            setenv("CLN_TEST_KERNEL_DIR", before, 1);
        else
            unsetenv("CLN_TEST_KERNEL_DIR");
        if (!(worst > cases[0].bound))
            fail_msg("%s is not noticed: %.2e", faults[i].to, worst);
    }
}

int test_group_float64(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_curves),
                                       cmocka_unit_test(test_notices)};

    return cmocka_run_group_tests_name("float64", tests, fixture_setup, fixture_teardown);
}
