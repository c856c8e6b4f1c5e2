/* Pictures as good as the model (docs/method.md 13): compares a picture's few samples with hundreds
 * of evenly spread ones, whose sum is nearly the integral, on the same rays of one trained
 * model. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <cmocka.h>
#include "render/open_run.h"
#include "render/quality.h"
#include "render/view.h"
#include "run_fixture.h"
#include "tests.h"

/* The first test view of the run, with these settings of its sampling. */
static void render(const cln_config *sampling, cln_picture *out)
{
    const bool pixels[CLN_SPLITS] = {false, false, true};
    const cln_device_desc device = fixture_device();
    cln_open_run v;
    int *views = NULL, count = 0;

    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, &v));
    if (sampling)
        v.model.config = *sampling;
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_render_view(&v.pipeline, views[0], v.scene->background, false, NULL, out));
    cln_open_run_close(&v);
    free(views);
}

static double psnr(const cln_picture *a, const cln_picture *b)
{
    const size_t n = (size_t)a->width * (size_t)a->height * 3;
    double sum = 0;

    for (size_t i = 0; i < n; i++)
        sum += ((double)a->rgb[i] - b->rgb[i]) * ((double)a->rgb[i] - b->rgb[i]);
    return -10 * log10(sum / (double)n);
}

static cln_config config_of_run(void)
{
    cln_open_run v;
    cln_config config;

    assert_ok(cln_open_run_model(fixture_path("whole"), &v));
    config = v.model.config;
    cln_open_run_close(&v);
    return config;
}

static void test_agree_with_dense_sampling(void **state)
{
    cln_config dense, steered;
    cln_picture own, even, without;

    (void)state;
    NEED_DEVICE();
    dense = steered = config_of_run();
    dense.allocate = CLN_ALLOCATE_CHORD;
    dense.samples_per_leaf = 256;
    dense.uniform_share = 1;
    dense.empty_weight = 0;
    dense.render_min_transmittance = 0;
    steered.uniform_share = 0;
    render(NULL, &own);
    render(&dense, &even);
    render(&steered, &without);
    print_message("against dense sampling: %.2f dB; without even samples: %.2f dB\n",
                  psnr(&own, &even), psnr(&without, &even));
    assert_true(psnr(&own, &even) > 40);
    assert_true(psnr(&own, &even) > psnr(&without, &even) + 1);
    cln_picture_free(&own);
    cln_picture_free(&even);
    cln_picture_free(&without);
}

int test_group_pictures(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_agree_with_dense_sampling)};

    return cmocka_run_group_tests_name("pictures", tests, fixture_setup, fixture_teardown);
}
