/* Gains of the training photos (train/exposure.h): found from what is rendered beside the photos,
 * late results go to their own step, and pixels that show nothing do not count. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "lit_fixture.h"
#include "model/model.h"
#include "near.h"
#include "tests.h"
#include "train/exposure.h"

enum { VIEWS = 4, RAYS = 256 };
typedef double photo_gains[VIEWS][3];
static const photo_gains gains = {{1, 1, 1}, {0.5, 0.6, 0.7}, {1.5, 1.4, 1.1}, {0.9, 1.2, 2}};

static double colour(int step, int ray, int channel)
{
    const uint32_t bits = cln_hash((uint32_t)(3 * (RAYS * step + ray) + channel) + 1);

    return 0.1 + 0.4 * (bits >> 8) / 16777216.0;
}

static cln_scene *photos(const char *folder)
{
    char json[2048] = "{\"camera_angle_x\":0.7,\"frames\":[";

    for (int i = 0; i < VIEWS; i++) {
        char name[32], frame[256];

        snprintf(name, sizeof name, "v%d.png", i);
        put_image(folder, name, 8, 8, 3, i);
        snprintf(frame, sizeof frame,
                 "%s{\"file_path\":\"v%d\",\"transform_matrix\":[[1,0,0,%d],[0,1,0,0],[0,0,1,4],"
                 "[0,0,0,1]]}",
                 i ? "," : "", i, i);
        strcat(json, frame);
    }
    strcat(json, "]}");
    put_text(folder, "transforms_train.json", json);
    put_text(folder, "transforms_test.json", json);
    return load(folder, NULL);
}

/* A step's rays, dealt to the views in turn; every seventh of the first two views' looks at a pixel
 * that shows nothing. */
static void make_targets(const cln_scene *scene, const photo_gains gain, int step, cln_batch *batch)
{
    for (int i = 0; i < RAYS; i++) {
        const int view = i % VIEWS;

        batch->pixels[i].view = (uint32_t)cln_scene_split_view(scene, CLN_SPLIT_TRAIN, view);
        for (int c = 0; c < 3; c++)
            batch->targets[i][c] = (float)(colour(step, i, c) * gain[view][c]);
        batch->targets[i][3] = 1;
        if (i % 7 == 0 && view < 2)
            memset(batch->targets[i], 0, sizeof batch->targets[i]);
    }
}

static void test_gains(void **state)
{
    cln_scene *scene = photos(*state);
    cln_config config = default_config();
    cln_model model = {0};
    cln_exposure e = {0};
    cln_batch batch = {0};
    cln_ray_result results[2][RAYS];
    double mean[3] = {1, 1, 1};

    config.exposure = CLN_EXPOSURE_YES;
    model.config = config;
    assert_int_equal(cln_batch_create(scene, &config, &batch), CLN_OK);
    assert_true(batch.capacity >= RAYS);
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    assert_int_equal(model.exposure_views, VIEWS);
    for (int step = 0; step < 640; step++) {
        if (cln_exposure_due(&e, step)) {
            cln_exposure_add(&e, results[(step - 1) % 2], step - 1, RAYS, &model);
            assert_int_equal(cln_exposure_update(&e, scene, step, &model), CLN_OK);
        }
        make_targets(scene, gains, step, &batch);
        cln_exposure_apply(&e, &model, &batch, step, RAYS);
        for (int i = 0; i < RAYS; i++) { /* from half on four rays a pixel, about its colour */
            static const double apart[4] = {0.5, -0.5, 0.2, -0.2};
            const int pixel = i < RAYS / 8 * 4 ? i : i - i % 4;
            const double times = i < RAYS / 8 * 4 ? 1 : 1 + apart[i % 4];

            results[step % 2][i] = (cln_ray_result){.r = (float)(times * colour(step, pixel, 0)),
                                                    .g = (float)(times * colour(step, pixel, 1)),
                                                    .b = (float)(times * colour(step, pixel, 2)),
                                                    .share = i < RAYS / 8 * 4 ? 1 : 0.25f};
        }
        if (step > 0 && !cln_exposure_due(&e, step)) /* a step late */
            cln_exposure_add(&e, results[(step - 1) % 2], step - 1, RAYS, &model);
    }
    for (int v = 0; v < VIEWS; v++)
        for (int c = 0; c < 3; c++)
            mean[c] *= pow(gains[v][c], 1.0 / VIEWS);
    for (int v = 0; v < VIEWS; v++)
        for (int c = 0; c < 3; c++)
            if (fabs(model.exposure[v][c] / (gains[v][c] / mean[c]) - 1) > 0.05)
                fail_msg("gain %d of view %d is %g, not %g", c, v, (double)model.exposure[v][c],
                         gains[v][c] / mean[c]);
    for (int i = 1; i < RAYS; i++) /* what training sees: the scene's colour but for one factor */
        for (int c = 0; c < 3 && i % 7; c++)
            assert_true(fabs(batch.targets[i][c] / (colour(639, i, c) * mean[c]) - 1) < 0.05);
    assert_true(batch.targets[0][0] == 0);
    make_targets(scene, gains, 640, &batch); /* a batch of no step: the probe's */
    cln_exposure_divide_batch(&e, &model, &batch, RAYS);
    for (int i = 1; i < RAYS; i++)
        for (int c = 0; c < 3 && i % 7; c++)
            assert_true(fabs(batch.targets[i][c] / (colour(640, i, c) * mean[c]) - 1) < 0.05);
    assert_true(batch.targets[0][0] == 0);
    cln_batch_free(&batch);
    cln_exposure_free(&e);
    cln_model_free(&model);
    cln_scene_free(scene);
}

/* Trains until after the step that decides, by a scene that has learnt a power of the gains.
 * Returns the last photo's gain over the first one's then, in their red; 0: there are none. */
static double decides(const cln_scene *scene, const photo_gains gain, int64_t begin, int mode,
                      double learnt)
{
    enum { DECIDES = 64 };
    cln_config config = default_config();
    cln_model model = {.step = begin};
    cln_exposure e = {0};
    cln_batch batch = {0};
    cln_ray_result results[2][RAYS];
    double ratio = 0;

    assert_int_equal(config.exposure, CLN_EXPOSURE_AUTO);
    config.exposure = mode;
    model.config = config;
    assert_int_equal(cln_batch_create(scene, &config, &batch), CLN_OK);
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    for (int step = (int)begin; step <= DECIDES + 1; step++) {
        if (cln_exposure_due(&e, step)) {
            cln_exposure_add(&e, results[(step - 1) % 2], step - 1, RAYS, &model);
            assert_int_equal(cln_exposure_update(&e, scene, step, &model), CLN_OK);
        }
        assert_true(!model.exposed || step >= DECIDES || mode == CLN_EXPOSURE_YES);
        make_targets(scene, gain, step, &batch);
        cln_exposure_apply(&e, &model, &batch, step, RAYS);
        for (int i = 0; i < RAYS; i++)
            results[step % 2][i] =
                (cln_ray_result){.r = (float)(colour(step, i, 0) * pow(gain[i % VIEWS][0], learnt)),
                                 .g = (float)(colour(step, i, 1) * pow(gain[i % VIEWS][1], learnt)),
                                 .b = (float)(colour(step, i, 2) * pow(gain[i % VIEWS][2], learnt)),
                                 .share = 1};
        for (int i = 1; i < RAYS && !model.exposed; i++) /* as they are */
            for (int c = 0; c < 3 && i % 7; c++)
                assert_true(batch.targets[i][c] ==
                            (float)(colour(step, i, c) * gain[i % VIEWS][c]));
        if (step > 0 && !cln_exposure_due(&e, step))
            cln_exposure_add(&e, results[(step - 1) % 2], step - 1, RAYS, &model);
    }
    assert_true(model.exposed == (model.exposure != NULL));
    if (model.exposed && learnt == 0) /* brightness between photos is gone */
        assert_true(fabs(batch.targets[1][0] / colour(DECIDES + 1, 1, 0) /
                             (batch.targets[2][0] / colour(DECIDES + 1, 2, 0)) -
                         1) < 0.1);
    if (model.exposed)
        ratio = (double)model.exposure[VIEWS - 1][0] / (double)model.exposure[0][0];
    cln_exposure_free(&e);
    cln_batch_free(&batch);
    cln_model_free(&model);
    return ratio;
}

/* By itself there are gains where photos differ, and follow each other. */
static void test_auto(void **state)
{
    static const photo_gains alike = {{1, 1, 1}, {1.01, 1, 1}, {1, 1.02, 1}, {0.99, 1, 1}},
                             clouds = {
                                 {0.6, 0.6, 0.7}, {0.8, 0.8, 0.9}, {1.1, 1.1, 1}, {1.4, 1.4, 1.2}};
    cln_scene *scene = photos(*state);

    assert_true(decides(scene, clouds, 0, CLN_EXPOSURE_AUTO, 0) > 0);
    assert_true(decides(scene, alike, 0, CLN_EXPOSURE_AUTO, 0) == 0);
    assert_true(decides(scene, gains, 0, CLN_EXPOSURE_AUTO, 0) == 0); /* those around say nothing */
    assert_true(decides(scene, clouds, 65, CLN_EXPOSURE_AUTO, 0) == 0);
    cln_scene_free(scene);
}

/* Nor where marks that two photos show tell that the light goes along with the camera, or that it
 * does not change. */
static void test_auto_asks_marks(void **state)
{
    static const photo_gains rising = {
        {0.7, 0.7, 0.7}, {0.85, 0.85, 0.85}, {1.15, 1.15, 1.15}, {1.4, 1.4, 1.4}};
    static const double as_gains[VIEWS] = {0, 0.6, 1.6, 2.2}, none[VIEWS] = {0};
    const char *names[] = {"changes", "lamp", "same"};

    for (int i = 0; i < 3; i++) {
        cln_scene *scene = NULL;

        put_folder(*state, names[i]);
        scene = lit_photos(scratch_path(*state, names[i]), VIEWS, i == 1 ? 2 : 0,
                           i == 0 ? as_gains : none);
        if ((decides(scene, rising, 0, CLN_EXPOSURE_AUTO, 0) > 0) != (i == 0))
            fail_msg("%s: gains %d", names[i], i != 0);
        cln_scene_free(scene);
    }
}

/* Gains that are a part of what marks say, as the scene has learnt the rest, become theirs; where
 * they are most of it, they go on by themselves. */
static void test_takes_marks(void **state)
{
    static const photo_gains rising = {
        {0.7, 0.7, 0.7}, {0.85, 0.85, 0.85}, {1.15, 1.15, 1.15}, {1.4, 1.4, 1.4}};
    static const double stops[VIEWS] = {0, 0.6, 1.6, 2.2}; /* 2.2 log2 of these */
    cln_scene *scene = lit_photos(*state, VIEWS, 0, stops);

    assert_near(decides(scene, rising, 0, CLN_EXPOSURE_AUTO, 0.6), 2, 0.1);
    assert_near(decides(scene, rising, 0, CLN_EXPOSURE_YES, 0.6), 2, 0.1);
    /* these are 1.56 times as much */
    assert_near(decides(scene, rising, 0, CLN_EXPOSURE_AUTO, 0.36), pow(2, 0.64), 0.05);
    cln_scene_free(scene);
}

/* The sums by which a photo's gains become this, by the formula of docs/method.md: they are drawn
 * to 1 as by five rays of a white wall. */
static void put_sums(float row[9], double gain)
{
    for (int c = 0; c < 3; c++) {
        row[6 + c] = 10;
        row[3 + c] = (float)(gain * (10 + 5) - 5);
    }
}

/* Of many photos some alone are asked for marks, and all gains are on one scale then: also of those
 * that were not asked, which are brighter. Gains do not follow each other, but are asked for. */
static void test_marks_of_many(void **state)
{
    enum { MANY = 52 }; /* 12, 25, 38 and 39 are not asked */
    static const int others[] = {12, 25, 38, 39};
    static const double learnt = 0.5, gamma = 2.2;
    cln_model model = {.config = default_config()};
    cln_exposure e = {0};
    double stops[MANY], own[MANY], got[MANY], mean = 0, share = 0;
    cln_scene *scene = NULL;

    for (int i = 0; i < MANY; i++)
        stops[i] = 0.3 * (i * i % 7 - 3);
    for (int i = 0; i < 4; i++)
        stops[others[i]] = 4 - i;
    for (int i = 0; i < MANY; i++)
        mean += stops[i] / MANY;
    scene = lit_photos(*state, MANY, 0, stops);
    model.config.exposure = CLN_EXPOSURE_YES;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    assert_int_equal(model.exposure_views, MANY);
    for (int i = 0; i < MANY; i++) {
        own[i] = learnt * (stops[i] - mean);
        put_sums(model.exposure[i], exp2(own[i] / gamma));
    }
    assert_int_equal(cln_exposure_update(&e, scene, 64, &model), CLN_OK);
    for (int i = 0; i < MANY; i++) {
        const float *row = model.exposure[i];

        got[i] = gamma * log2((double)row[0]);
        for (int c = 0; c < 3; c++)
            assert_true(row[c] == row[0] && row[3 + c] == 0 && row[6 + c] == 0);
    }
    share = (got[12] - got[39]) / (own[12] - own[39]);
    assert_near(share, 1 / learnt, 0.1);
    for (int i = 0; i < 4; i++)
        assert_near(got[others[i]], share * own[others[i]], 1e-4);
    for (int i = 0; i < MANY; i++)
        assert_near(got[i], stops[i] - mean, 0.25);
    cln_exposure_free(&e);
    cln_model_free(&model);
    cln_scene_free(scene);
}

/* A photo without rays has a gain of 1, and none is beyond 8 either way; sums fade. */
static void test_bounds(void **state)
{
    static const double wanted[VIEWS] = {1, 8, 0.125, 2};
    cln_scene *scene = photos(*state);
    cln_model model = {.config = default_config()};
    cln_exposure e = {0};

    model.config.exposure = CLN_EXPOSURE_YES;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    put_sums(model.exposure[1], 20);
    put_sums(model.exposure[3], 2);
    for (int c = 0; c < 3; c++)
        model.exposure[2][6 + c] = 1e6f; /* a black photo */
    assert_int_equal(cln_exposure_update(&e, scene, 128, &model), CLN_OK);
    for (int i = 0; i < VIEWS; i++)
        for (int c = 0; c < 3; c++)
            assert_near(model.exposure[i][c], wanted[i] / pow(2, 0.25), 1e-6);
    assert_true(model.exposure[3][3] == 12.5f && model.exposure[3][6] == 5);
    cln_exposure_free(&e);
    cln_model_free(&model);
    cln_scene_free(scene);
}

/* No gains without the option, and no gains of another number of photos. */
static void test_no_gains(void **state)
{
    cln_scene *scene = photos(*state);
    cln_model model = {.config = default_config()};
    cln_exposure e = {0};

    model.config.exposure = CLN_EXPOSURE_NO;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    assert_true(!model.exposure && !cln_exposure_due(&e, 64));
    cln_exposure_apply(&e, &model, NULL, 0, RAYS);
    cln_exposure_divide(&e, &model, 0, NULL);
    cln_exposure_add(&e, NULL, 0, RAYS, &model);
    model.config.exposure = CLN_EXPOSURE_YES;
    model.has_alpha = true;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    assert_null(model.exposure);
    model.has_alpha = false;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    cln_exposure_free(&e);
    model.exposure[0][0] = 2;
    model.exposure_views = VIEWS - 1;
    assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
    assert_true(model.exposure_views == VIEWS && model.exposure[0][0] == 1);
    cln_exposure_free(&e);
    for (int other = 0; other < 2; other++) { /* as many, but others */
        model.exposure[0][0] = 2;
        model.training_names += (uint64_t)other;
        assert_int_equal(cln_exposure_start(scene, RAYS, &model, &e), CLN_OK);
        assert_true(model.exposure[0][0] == (other ? 1 : 2));
        cln_exposure_free(&e);
    }
    cln_model_free(&model);
    cln_scene_free(scene);
}

int test_group_exposure(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_gains, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_auto, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_auto_asks_marks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_takes_marks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_marks_of_many, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bounds, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_no_gains, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("exposure", tests, NULL, NULL);
}
