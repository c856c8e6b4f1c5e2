/* Training's gradient is the integral's (docs/method.md 7, 9): compares the average over steps of a
 * few jittered samples with hundreds of even samples on the same rays of one trained model. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "render/open_run.h"
#include "run_fixture.h"
#include "tests.h"
#include "train/batch.h"

enum { RAYS = 256, AVERAGED = 16 };

static const char *run = "whole"; /* whose gradient it is */

/* A run's model on the device, and one batch of training rays. */
typedef struct bed {
    cln_open_run run;
    cln_batch batch;
    size_t numbers; /* of a gradient: [leaf][param] */
} bed;

static cln_config config_of_run(void)
{
    cln_open_run v;
    cln_config config;

    assert_ok(cln_open_run_model(fixture_path(run), &v));
    config = v.model.config;
    config.roulette = 0;                              /* the test is about sampling */
    config.depth_loss = 0;                            /* no ray shows a known point */
    config.smooth_density = config.smooth_colour = 0; /* no matter of samples */
    cln_open_run_close(&v);
    return config;
}

static void open_bed(const cln_config *config, bed *b)
{
    const bool pixels[CLN_SPLITS] = {true, false, false};
    const cln_device_desc device = fixture_device();
    const cln_draw draw = {.step = 7, .n = RAYS};
    cln_pipeline *p = &b->run.pipeline;

    memset(b, 0, sizeof *b);
    assert_ok(cln_open_run_open(fixture_path(run), NULL, pixels, NULL, &b->run));
    b->run.model.config = *config;
    b->run.wanted = CLN_PROGRAMS_ALL;
    assert_ok(cln_open_run_start(&b->run, &device, false));
    assert_ok(cln_pipeline_scene(p, b->run.scene, &b->run.model.space));
    assert_ok(CLN_RESERVE(p, density, (size_t)p->leaves));
    assert_ok(cln_stage_refresh(p, 0, p->leaves, false, 0, 0));
    assert_ok(cln_batch_create(b->run.scene, config, &b->batch));
    cln_batch_draw(&b->batch, b->run.scene, config, &draw);
    assert_ok(
        cln_pipeline_batch(p, b->batch.pixels, RAYS, b->batch.targets[0], b->batch.backgrounds[0]));
    assert_ok(cln_stage_rays(p, RAYS));
    b->numbers = (size_t)p->leaves * (size_t)p->net.params;
}

static void close_bed(bed *b)
{
    cln_batch_free(&b->batch);
    cln_open_run_close(&b->run);
}

/* Of voxels, which a slice's samples met: sets `grad` [params] to 0 at the others, where the kernel
 * leaves what was there. met: a row of bits along x for each z, y. */
static void clear_unmet(const cln_pipeline *p, const cl_uint *met, float *grad)
{
    const int side = p->net.cells + 1, features = p->net.features;

    for (int v = 0; v < side * side * side; v++)
        if (!(met[v / side] >> v % side & 1))
            memset(grad + v * features, 0, (size_t)features * sizeof *grad);
    memset(grad + side * side * side * features, 0,
           (size_t)(p->net.params - side * side * side * features) * sizeof *grad);
}

/* Adds the batch's gradient, over all slices of a leaf, with the samples of this step. */
static void add_gradient(bed *b, uint32_t step, bool jitter, double *sum)
{
    cln_pipeline *p = &b->run.pipeline;
    const cln_config *c = &b->run.model.config;
    const size_t params = (size_t)p->net.params;
    const cln_sampling sampling = {.jitter = jitter,
                                   .min_transmittance = (float)c->min_transmittance,
                                   .uniform_share = (float)c->uniform_share,
                                   .empty_weight = (float)c->empty_weight,
                                   .empty_share = (float)c->empty_share,
                                   .seed = 1,
                                   .step = step,
                                   .max_samples = (size_t)1 << 20};
    uint32_t samples = 0, slices = 0;
    cln_slice *slice = NULL;
    float *grads = NULL;
    int rays = 0;

    assert_ok(cln_stage_sample(p, RAYS, &sampling, &rays, &samples));
    assert_int_equal(rays, RAYS);
    assert_ok(cln_stage_group(p, samples, &slices));
    assert_ok(cln_stage_slices(p, &slices));
    assert_ok(cln_stage_forward(p, samples, slices, true, 0));
    assert_ok(cln_stage_composite_train(p, RAYS, samples));
    assert_ok(cln_stage_backward(p, samples, slices, 0));
    assert_ok(cln_alloc(&slice, slices, sizeof *slice, "test"));
    assert_ok(cln_alloc(&grads, slices * params, sizeof *grads, "test"));
    assert_ok(cln_buffer_read(p->device, &p->slices, 0, slice, slices * sizeof *slice));
    assert_ok(cln_buffer_read(p->device, &p->grads, 0, grads, slices * params * sizeof *grads));
    if (c->encoding == CLN_ENCODING_VOXEL) {
        const size_t row = (size_t)(p->net.cells + 1) * (size_t)(p->net.cells + 1);
        cl_uint *met = NULL;

        assert_ok(cln_alloc(&met, slices * row, sizeof *met, "test"));
        assert_ok(cln_buffer_read(p->device, &p->met, 0, met, slices * row * sizeof *met));
        for (size_t s = 0; s < slices; s++)
            clear_unmet(p, met + s * row, grads + s * params);
        free(met);
    }
    for (size_t s = 0; s < slices; s++)
        for (size_t i = 0; i < params; i++)
            sum[(size_t)slice[s].slot * params + i] += grads[s * params + i];
    free(slice);
    free(grads);
}

static double *dense_gradient(void)
{
    cln_config config = config_of_run();
    double *sum = NULL;
    bed b;

    config.allocate = CLN_ALLOCATE_CHORD;
    config.samples_per_leaf = 256;
    config.uniform_share = 1;
    config.empty_weight = 0;
    config.min_transmittance = 0;
    open_bed(&config, &b);
    assert_ok(cln_alloc(&sum, b.numbers, sizeof *sum, "test"));
    add_gradient(&b, 0, false, sum);
    close_bed(&b);
    return sum;
}

/* Distance of the mean gradient of AVERAGED steps from `want`, as a share of its length. samples:
 * of an opaque ray; 0: as the run has them. */
static double error_of(double uniform_share, int samples, const double *want)
{
    cln_config config = config_of_run();
    double *sum = NULL, square = 0, length = 0;
    bed b;

    config.uniform_share = uniform_share;
    if (samples > 0) {
        config.samples_per_ray = samples;
        config.samples_per_leaf = 256;
    }
    open_bed(&config, &b);
    assert_ok(cln_alloc(&sum, b.numbers, sizeof *sum, "test"));
    for (uint32_t step = 0; step < AVERAGED; step++)
        add_gradient(&b, step, true, sum);
    for (size_t i = 0; i < b.numbers; i++) {
        const double d = sum[i] / AVERAGED - want[i];

        square += d * d;
        length += want[i] * want[i];
    }
    free(sum);
    close_bed(&b);
    assert_true(length > 0);
    return sqrt(square / length);
}

/* most: how far it may be off; share: of how far it is without even samples; many: how far with
 * hundreds of samples a ray. */
static void check_gradient(double most, double share, double many)
{
    const double even = config_of_run().uniform_share;
    double *want = dense_gradient();
    const double own = error_of(even, 0, want), steered = error_of(0, 0, want);
    const double limit = error_of(even, 300, want);

    print_message("%s, gradient against dense sampling: off by %.3f; without even samples: %.3f; "
                  "with many: %.3f\n",
                  run, own, steered, limit);
    assert_true(own < most);
    assert_true(own < share * steered);
    assert_true(limit < many);
    free(want);
}

static void test_gradient_of_the_integral(void **state)
{
    NEED_DEVICE();
    check_gradient(0.1, 0.8, 0.01);
}

static void test_gradient_of_voxels(void **state)
{
    const cln_config config = fixture_voxels();
    cln_train_result result;

    NEED_DEVICE();
    assert_ok(fixture_train("voxels", false, &config, NULL, &result));
    run = "voxels";
    check_gradient(0.5, 0.5, 0.06); /* 0.41, of 1.09; 0.03: leaves are coarse, surfaces thin */
}

/* Teardown: a test that fails does not come back. */
static int back_to_whole(void **state)
{
    (void)state;
    run = "whole";
    return 0;
}

int test_group_gradient(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_gradient_of_the_integral),
        cmocka_unit_test_teardown(test_gradient_of_voxels, back_to_whole)};

    return cmocka_run_group_tests_name("gradient", tests, fixture_setup, fixture_teardown);
}
