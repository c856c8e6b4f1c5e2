/* Rays to sparse points: which rays of a batch go to them, that all points get equally many, and
 * what the device gets for each. */
#include "unit.h"
#include "format_fixture.h"
#include "scene/motion.h"
#include "tests.h"
#include "train/batch.h"

enum { POINTS = 40, STEPS = 50 };

static cln_scene *make_scene(const char *folder, cln_config *config)
{
    cln_point points[POINTS];
    cln_camera cameras[FORMAT_VIEWS];
    const cln_scene_desc desc = {
        .path = folder, .config = config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;

    for (int i = 0; i < POINTS; i++)
        points[i] = (cln_point){{1 + 0.05 * (i % 8), 2 + 0.04 * (i / 8), 3}, {0}, 2 + i % 4, 0};
    *config = *plain();
    config->depth_loss = 0.1;
    config->rays = 256;
    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points, POINTS);
    assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
    assert_true(scene->sight_count > POINTS);
    return scene;
}

/* The sight of a pixel and a place of the cube; -1 without any. */
static int find(const cln_scene *scene, const cln_pixel *pixel, const float shown[4])
{
    for (int s = 0; s < scene->sight_count; s++) {
        const cln_sight *sight = &scene->sights[s];
        double cube[3], square = 0;

        cln_space_point_to_cube(&scene->space, sight->point, cube);
        for (int k = 0; k < 3; k++)
            square += pow(cube[k] - shown[k], 2);
        if (square < 1e-12 && (int)pixel->view == sight->view && (int)pixel->x == sight->x &&
            (int)pixel->y == sight->y)
            return s;
    }
    return -1;
}

static void test_draw(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    cln_batch b, plain_batch;
    double square = 0, expected = 0;
    int *counts = calloc((size_t)scene->sight_count, sizeof *counts);
    cln_config off = config;

    off.depth_loss = 0;
    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    assert_int_equal(cln_batch_create(scene, &off, &plain_batch), CLN_OK);
    assert_non_null(b.shown);
    assert_null(plain_batch.shown);
    for (uint32_t step = 0; step < STEPS; step++) {
        cln_draw draw = {.step = step, .n = config.rays, .depth = 0.5, .space = &scene->space};

        cln_batch_draw(&b, scene, &config, &draw);
        cln_batch_draw(&plain_batch, scene, &off, &(cln_draw){.step = step, .n = config.rays});
        for (int i = 0; i < config.rays; i++) {
            if (i % CLN_SIGHT_EVERY == CLN_SIGHT_EVERY - 1) {
                const int s = find(scene, &b.pixels[i], b.shown[i]);

                assert_true(s >= 0);
                assert_float_equal(b.shown[i][3], 0.5 * scene->sights[s].trust, 1e-6);
                assert_int_equal((int)lroundf(255 * b.targets[i][0]), 20 * b.pixels[i].view);
                counts[s]++;
            } else { /* the others are as without */
                assert_true(b.shown[i][3] == 0);
                assert_memory_equal(&b.pixels[i], &plain_batch.pixels[i], sizeof *b.pixels);
                assert_memory_equal(b.targets[i], plain_batch.targets[i], sizeof *b.targets);
            }
        }
        draw.depth = 0; /* later in training */
        cln_batch_draw(&b, scene, &config, &draw);
        assert_memory_equal(b.pixels, plain_batch.pixels, (size_t)config.rays * sizeof *b.pixels);
        for (int i = 0; i < config.rays; i++)
            assert_true(b.shown[i][3] == 0);
    }
    expected = (double)STEPS * config.rays / CLN_SIGHT_EVERY / (double)scene->sight_count;
    for (int s = 0; s < scene->sight_count; s++)
        square += pow(counts[s] - expected, 2) / expected;
    /* chi squared of n sights: mean n, standard deviation sqrt(2 n); sights of one pixel and place
     * would be one */
    if (fabs(square - (double)scene->sight_count) > 4 * sqrt(2. * (double)scene->sight_count))
        fail_msg("chi squared %.0f of %d sights", square, (int)scene->sight_count);
    free(counts);
    cln_batch_free(&b);
    cln_batch_free(&plain_batch);
    cln_scene_free(scene);
}

/* None while --precrop-steps keep rays in the images' middle. */
static void test_cropped(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    cln_draw draw = {.n = config.rays, .depth = 0.5, .space = &scene->space};
    cln_batch b;

    config.precrop_steps = 2;
    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    for (draw.step = 0; draw.step < 4; draw.step++) {
        int sights = 0;

        cln_batch_draw(&b, scene, &config, &draw);
        for (int i = 0; i < config.rays; i++)
            sights += b.shown[i][3] > 0;
        assert_true(draw.step < 2 ? sights == 0 : sights > 0);
        for (int i = 0; i < config.rays && draw.step < 2; i++) {
            assert_in_range(b.pixels[i].x, FORMAT_WIDTH / 4 - 1, FORMAT_WIDTH * 3 / 4);
            assert_in_range(b.pixels[i].y, FORMAT_HEIGHT / 4 - 1, FORMAT_HEIGHT * 3 / 4);
        }
    }
    cln_batch_free(&b);
    cln_scene_free(scene);
}

/* Cameras that --refine-poses moved: a ray goes through the pixel that shows the point now, and
 * none goes to a point that left its image. */
static void test_moved(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    float(*motions)[CLN_MOTION] = calloc((size_t)views, sizeof *motions);
    int moved = 0, left = 0, sights = 0;
    cln_batch b;

    for (int i = 0; i < views; i++) {
        motions[i][1] = 0.08F * (float)(i + 1); /* a turn */
        motions[i][3] = 0.02F;
    }
    for (int s = 0; s < scene->sight_count; s++)
        assert_true(scene->sights[s].x >= 0);
    cln_motion_views(scene, (const float(*)[CLN_MOTION])motions);
    for (int s = 0; s < scene->sight_count; s++) {
        const cln_sight *sight = &scene->sights[s];
        const cln_camera *c = &scene->views[sight->view].camera;
        double u = 0, v = 0, z = 0;
        const bool there = cln_camera_project(c, sight->point, &u, &v, &z) && z > 0 && u >= 0 &&
                           v >= 0 && u < c->width && v < c->height;

        assert_int_equal(sight->x, there ? (int)u : -1);
        assert_int_equal(sight->y, there ? (int)v : -1);
        moved += there;
        left += !there;
    }
    assert_true(moved > 0 && left > 0);
    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    for (uint32_t step = 0; step < STEPS; step++) {
        cln_batch_draw(
            &b, scene, &config,
            &(cln_draw){.step = step, .n = config.rays, .depth = 0.5, .space = &scene->space});
        for (int i = 0; i < config.rays; i++) {
            const cln_camera *c = &scene->views[b.pixels[i].view].camera;

            assert_true((int)b.pixels[i].x < c->width && (int)b.pixels[i].y < c->height);
            if (b.shown[i][3] > 0)
                assert_true(find(scene, &b.pixels[i], b.shown[i]) >= 0);
            sights += b.shown[i][3] > 0;
        }
    }
    assert_true(sights > 0 && sights < STEPS * config.rays / CLN_SIGHT_EVERY);
    free(motions);
    cln_batch_free(&b);
    cln_scene_free(scene);
}

/* A sight whose pixel its mask leaves out: the ray stays what it is without. */
static void test_masked(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);
    uint8_t kept[(FORMAT_WIDTH * FORMAT_HEIGHT + 7) / 8] = {0};
    cln_config off = config;
    cln_batch b, without;
    int sights = 0, left = 0;

    memset(kept, 0xff, sizeof kept / 2); /* the upper half counts */
    for (int v = 0; v < scene->view_count; v++)
        scene->views[v].kept = kept;
    off.depth_loss = 0;
    assert_int_equal(cln_batch_create(scene, &config, &b), CLN_OK);
    assert_int_equal(cln_batch_create(scene, &off, &without), CLN_OK);
    for (uint32_t step = 0; step < STEPS; step++) {
        const cln_draw draw = {.step = step, .n = config.rays, .depth = 1, .space = &scene->space};

        cln_batch_draw(&b, scene, &config, &draw);
        cln_batch_draw(&without, scene, &off, &(cln_draw){.step = step, .n = config.rays});
        for (int i = 0; i < config.rays; i++) {
            const cln_pixel *p = &b.pixels[i];

            if (!cln_batch_is_sight(i))
                continue;
            if (b.shown[i][3] > 0) {
                assert_true(cln_view_keeps(&scene->views[p->view], (int)p->x, (int)p->y));
                sights++;
            } else {
                assert_memory_equal(p, &without.pixels[i], sizeof *p);
                left++;
            }
        }
    }
    assert_true(sights > 0 && left > 0);
    cln_batch_free(&b);
    cln_batch_free(&without);
    cln_scene_free(scene);
}

/* Not for splatting, which draws rays of a few views. */
static void test_never(void **state)
{
    cln_config config;
    cln_scene *scene = make_scene(*state, &config);

    assert_true(cln_batch_knows(scene, &config));
    config.stage1 = CLN_STAGE1_SPLAT;
    assert_false(cln_batch_knows(scene, &config));
    config.stage1 = CLN_STAGE1_GATHER;
    config.depth_loss = 0;
    assert_false(cln_batch_knows(scene, &config));
    cln_scene_free(scene);
}

int test_group_sight_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_draw, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masked, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_cropped, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_moved, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_never, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("sight_rays", tests, NULL, NULL);
}
