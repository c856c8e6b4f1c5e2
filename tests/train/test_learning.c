/* What a training learns, against what is known of its scene (run_fixture.h: a ball of radius 1
 * whose colour is its normal): pictures are better than any constant one, depth is the ball's, the
 * learning rate follows its schedule, random backgrounds empty the space around, and numbers that
 * are not finite end the training. */
#include "unit.h"
#include "render/open_run.h"
#include "render/view.h"
#include "run_fixture.h"
#include "sanitized.h"
#include "tests.h"
#include "train/step.h"

enum { LONG = 600 };

/* The longer training that pictures and depth are of, once. */
static cln_status train_long(const char *run, bool random_background, cln_train_result *result)
{
    cln_config config = fixture_config();

    config.steps = LONG;
    config.start_level = 2;
    config.bands = 4;
    config.rays = 512;
    config.batch_samples = 8192;
    config.log_every = 50;
    config.random_background = random_background;
    return fixture_train(run, false, &config, NULL, result);
}

static void test_beats_a_constant(void **state)
{
    cln_train_result result;
    const double constant = fixture_constant_psnr();

    NEED_DEVICE();
    assert_ok(train_long("long", false, &result));
    print_message("PSNR: constant %.2f, %d steps %.2f, %d steps %.2f\n", constant, STEPS,
                  fixture_whole.psnr_test, LONG, result.psnr_test);
    assert_true(fixture_whole.psnr_test > constant + 1);
    assert_true(result.psnr_test > constant + 8);
    assert_true(result.psnr_test < 60);
}

/* Depth of the test views: in the middle of the ball it is where the ray meets the ball; towards
 * the rim, which six photos leave open, about between there and the middle of the ray's chord. */
static void test_depth_is_the_balls(void **state)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    const float white[3] = {1, 1, 1};
    cln_open_run v;
    cln_picture picture;
    double off = 0, worst = 0;
    int middle = 0, rim = 0, beside = 0;

    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("long"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    for (int view = 0; view < v.scene->view_count; view++) {
        const cln_camera *camera = &v.scene->views[view].camera;

        if (v.scene->views[view].split != CLN_SPLIT_TEST)
            continue;
        assert_ok(cln_render_view(&v.pipeline, view, white, false, NULL, &picture));
        for (int i = 0; i < SIDE * SIDE; i++) {
            const double depth = cln_space_depth_to_scene(&v.model.space, picture.depth[i]);
            double o[3], d[3], b = 0, c = -1, square = 0, truth = 0;

            assert_true(cln_camera_ray(camera, i % SIDE + 0.5, i / SIDE + 0.5, o, d));
            for (int a = 0; a < 3; a++) {
                b += o[a] * d[a];
                c += o[a] * o[a];
            }
            square = b * b - c; /* of half the ray's chord */
            truth = -b - sqrt(fmax(square, 0));
            if (square < -0.2) {
                assert_true(picture.opacity[i] < 0.5f);
                beside++;
            } else if (square > 0.7) {
                assert_true(picture.opacity[i] > 0.9f);
                off += fabs(depth - truth);
                worst = fmax(worst, fabs(depth - truth));
                middle++;
            } else if (square > 0.2) {
                assert_true(picture.opacity[i] > 0.5f);
                assert_true(depth > truth - 0.25 && depth < -b + 0.25);
                rim++;
            }
        }
        cln_picture_free(&picture);
    }
    print_message("%d depths of 3 to 3.4 are off by %.3f, at most %.3f\n", middle, off / middle,
                  worst);
    assert_true(middle > 50 && rim > 50 && beside > 50);
    assert_true(off / middle < 0.25);
    assert_true(worst < 0.8);
    cln_open_run_close(&v);
}

/* metrics.jsonl tells the rate of every step: by --lr, --lr-final and --lr-schedule. */
static void check_rates(const char *run, bool steps)
{
    cln_config config = fixture_config();
    cln_train_result result;
    char name[64], line[4096];
    FILE *f = NULL;
    int rows = 0;

    config.lr = 0.01;
    config.lr_final = 0.001;
    config.lr_schedule = steps ? CLN_SCHEDULE_STEP : CLN_SCHEDULE_EXP;
    assert_ok(fixture_train(run, false, &config, NULL, &result));
    snprintf(name, sizeof name, "%s/metrics.jsonl", run);
    f = fopen(fixture_path(name), "r");
    assert_non_null(f);
    while (fgets(line, sizeof line, f)) {
        json_t *row = json_loads(line, 0, NULL);

        if (!json_object_get(row, "event")) {
            const double done = rows++ / (double)STEPS; /* before the step */
            const double want = steps ? (done < 1.0 / 3   ? 0.01
                                         : done < 2.0 / 3 ? 0.001
                                                          : 0.0001)
                                      : 0.01 * pow(0.1, done);
            const double got = json_number_value(json_object_get(row, "lr"));

            if (!(fabs(got / want - 1) < 1e-6))
                fail_msg("%s, step %d: %g, not %g", run, rows, got, want);
        }
        json_decref(row);
    }
    fclose(f);
    assert_int_equal(rows, STEPS);
}

static void test_learning_rate(void **state)
{
    NEED_DEVICE();
    check_rates("exponential", false);
    check_rates("in steps", true);
}

/* The harmonics' rate rises from 0 to its own, unless alpha shows where surfaces are. */
static void test_harmonic_rate(void **state)
{
    cln_config c = {.harmonic_rate = 0.4, .harmonics_rise = 0.2};

    (void)state;
    assert_true(cln_step_harmonic_rate(&c, false, 0) == 0);
    assert_float_equal(cln_step_harmonic_rate(&c, false, 0.05), 0.1, 1e-12);
    assert_true(cln_step_harmonic_rate(&c, false, 0.2) == 0.4);
    assert_true(cln_step_harmonic_rate(&c, false, 1) == 0.4);
    assert_true(cln_step_harmonic_rate(&c, true, 0) == 0.4);
    c.harmonics_rise = 0;
    assert_true(cln_step_harmonic_rate(&c, false, 0) == 0.4);
}

/* The decoder's rate is 0 at first, then rises to its own. */
static void test_decoder_rate(void **state)
{
    cln_config c = {.decoder_rate = 0.1, .decoder_after = 0.3};

    (void)state;
    assert_true(cln_step_decoder_rate(&c, 0) == 0);
    assert_true(cln_step_decoder_rate(&c, 0.3) == 0);
    assert_float_equal(cln_step_decoder_rate(&c, 0.4), 0.05, 1e-12);
    assert_float_equal(cln_step_decoder_rate(&c, 0.5), 0.1, 1e-12);
    assert_true(cln_step_decoder_rate(&c, 1) == 0.1);
    c.decoder_after = 0;
    assert_true(cln_step_decoder_rate(&c, 0) == 0.1);
}

/* Before a background of any colour nothing but opacity fits: what is transparent stays so, and the
 * run is another, resumed like any. */
static void test_random_background(void **state)
{
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 11};
    cln_train_result whole, part;

    NEED_DEVICE();
    config.random_background = true;
    config.alpha_loss = 0;
    assert_ok(fixture_train("random", false, &config, NULL, &whole));
    assert_true(whole.psnr_test > fixture_constant_psnr() + 1);
    assert_fails(fixture_train("random cut", false, &config, &stop, &part), CLN_SIGINT, "");
    assert_ok(fixture_train("random cut", true, &config, NULL, &part));
    assert_int_equal(part.digest, whole.digest);
    config.random_background = false;
    assert_ok(fixture_train("one background", false, &config, NULL, &part));
    assert_true(part.digest != whole.digest);
}

/* A loss or weights that are not finite end the training with a sentence; the checkpoint before
 * stays and can be resumed. */
static void test_diverges(void **state)
{
    static const struct {
        const char *file, *from, *to, *sentence;
    } faults[] = {
        {"composite.cl", "l.loss + s.extra, l.square", "NAN, l.square", "the loss of step"},
        {"adam.h", "VSTORE_IN(__global, w, params + p);",
         "VSTORE_IN(__global, w / 0.0f - w / 0.0f, params + p);", "not finite"},
    };
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 10};
    cln_train_result result;

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        char run[32], folder[32];
        const char *before = getenv("CLN_TEST_KERNEL_DIR");
        uint64_t kept = 0;
        cln_status st = CLN_OK;

        snprintf(run, sizeof run, "diverged %zu", i);
        snprintf(folder, sizeof folder, "nan %zu", i);
        assert_fails(fixture_train(run, false, &config, &stop, &result), CLN_SIGINT, "");
        stop = (fixture_stop){.signal = SIGINT, .step = 10};
        kept = fixture_digest(run);
        setenv("CLN_TEST_KERNEL_DIR",
               fixture_kernels_changed(folder, faults[i].file, faults[i].from, faults[i].to), 1);
        st = fixture_train(run, true, &config, NULL, &result);
        if (before)
            setenv("CLN_TEST_KERNEL_DIR", before, 1);
        else
            unsetenv("CLN_TEST_KERNEL_DIR");
        assert_fails(st, CLN_DIVERGED, faults[i].sentence);
        assert_int_equal(fixture_digest(run), kept);
        assert_ok(fixture_train(run, true, &config, NULL, &result));
        assert_int_equal(result.digest, fixture_whole.digest);
    }
}

/* A training that begins with colours at the ends of their sigmoids, as weights from elsewhere may
 * have them: red and blue at 1, green at 0, in all leaves. Returns the test PSNR. */
static double train_saturated(const char *run, double logit)
{
    cln_config config = fixture_config();
    fixture_stop stop = {.signal = SIGINT, .step = 2}; /* for a checkpoint to change */
    cln_train_result result;
    cln_model model = {0};
    size_t leaves = 0, moments = 0;

    config.steps = 400;
    config.lr_final = config.lr;
    assert_fails(fixture_train(run, false, &config, &stop, &result), CLN_SIGINT, "");
    assert_ok(cln_checkpoint_read(fixture_path(run), true, &model));
    leaves = (size_t)model.tree.leaf_count;
    moments = leaves * (size_t)model.net.params * cln_moment_bytes(&config);
    for (size_t s = 0; s < leaves; s++)
        for (int c = 0; c < 3; c++)
            model.params[s * (size_t)model.net.params + (size_t)(model.net.colour_b + c)] =
                (float)(c == 1 ? -logit : logit);
    memset(model.adam_m, 0, moments);
    memset(model.adam_v, 0, moments);
    memset(model.adam_steps, 0, leaves * sizeof *model.adam_steps);
    assert_ok(cln_checkpoint_write(fixture_path(run), &model));
    cln_model_free(&model);
    assert_ok(fixture_train(run, true, &config, NULL, &result));
    return result.psnr_test;
}

/* Saturated logits come back; without a least slope, where float32 rounds the sigmoid's slope to 0,
 * they do not. */
static void test_recovers(void **state)
{
    const char *before = getenv("CLN_TEST_KERNEL_DIR");
    const double constant = fixture_constant_psnr();
    double stuck = 0, near = 0, far = 0;

    NEED_DEVICE();
    near = train_saturated("saturated", 40);
    assert_true(near > constant + 4);
    if (SANITIZED) /* the others run the same host code */
        return;
    far = train_saturated("far", 200);
    setenv("CLN_TEST_KERNEL_DIR",
           fixture_kernels_changed("no slope", "roulette.cl", "SLOPE_LEAST 0x1p-25f",
                                   "SLOPE_LEAST 0.0f"),
           1);
    stuck = train_saturated("stuck", 40);
    if (before)
        setenv("CLN_TEST_KERNEL_DIR", before, 1);
    else
        unsetenv("CLN_TEST_KERNEL_DIR");
    print_message("PSNR from logits of 40: %.2f, 200: %.2f, without a least slope: %.2f\n", near,
                  far, stuck);
    assert_true(far > constant + 4);
    assert_true(stuck < constant + 1);
}

int test_group_learning(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_beats_a_constant), cmocka_unit_test(test_depth_is_the_balls),
        cmocka_unit_test(test_learning_rate),    cmocka_unit_test(test_harmonic_rate),
        cmocka_unit_test(test_decoder_rate),     cmocka_unit_test(test_random_background),
        cmocka_unit_test(test_diverges),         cmocka_unit_test(test_recovers),
    };

    return cmocka_run_group_tests_name("learning", tests, fixture_setup, fixture_teardown);
}
