/* Which pixels a training batch has, and their true colours: the middle of photos by
 * --precrop-steps, and what stands for pixels that masks leave out. Oracle: counts, and the pixels
 * that the fixture keeps. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "format_fixture.h"
#include "outcome.h"
#include "tests.h"
#include "train/batch.h"

/* Photos of 16 x 12 pixels times `size`. */
static cln_scene *make_scene(const char *folder, int size)
{
    cln_camera cameras[FORMAT_VIEWS];
    const cln_scene_desc desc = {
        .path = folder, .config = plain(), .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;

    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        cameras[v].width *= size;
        cameras[v].height *= size;
        cameras[v].fx = cameras[v].fy *= size;
        cameras[v].cx *= size;
        cameras[v].cy *= size;
    }
    format_images(scratch_path(folder, "images"), size);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    assert_ok(cln_scene_load(&desc, &scene));
    return scene;
}

/* Evenly over the middle half of rows and columns, and later over all. */
static void the_middle_comes_first(void **state)
{
    enum { STEPS = 40, MIDDLE = FORMAT_WIDTH / 2 * FORMAT_HEIGHT / 2 * FORMAT_VIEWS };
    cln_scene *scene = make_scene(*state, 1);
    cln_config config = *plain();
    int counts[FORMAT_VIEWS][FORMAT_HEIGHT][FORMAT_WIDTH] = {{{0}}}, outside = 0;
    double square = 0;
    cln_batch b;

    config.precrop_steps = STEPS;
    config.rays = 512;
    assert_ok(cln_batch_create(scene, &config, &b));
    for (uint32_t step = 0; step < STEPS; step++) {
        cln_batch_draw(&b, scene, &config, &(cln_draw){.step = step, .n = config.rays});
        for (int i = 0; i < config.rays; i++)
            counts[b.pixels[i].view][b.pixels[i].y][b.pixels[i].x]++;
    }
    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int y = 0; y < FORMAT_HEIGHT; y++)
            for (int x = 0; x < FORMAT_WIDTH; x++) {
                const bool middle = y >= FORMAT_HEIGHT / 4 && y < FORMAT_HEIGHT * 3 / 4 &&
                                    x >= FORMAT_WIDTH / 4 && x < FORMAT_WIDTH * 3 / 4;
                const double expected = middle ? (double)config.rays * STEPS / MIDDLE : 0;

                if (middle)
                    square += pow(counts[v][y][x] - expected, 2) / expected;
                else
                    assert_int_equal(counts[v][y][x], 0);
            }
    /* chi squared of n pixels: mean n, standard deviation sqrt(2 n) */
    if (fabs(square - MIDDLE) > 4 * sqrt(2.0 * MIDDLE))
        fail_msg("chi squared %.0f of %d pixels", square, MIDDLE);
    cln_batch_draw(&b, scene, &config, &(cln_draw){.step = STEPS, .n = config.rays});
    for (int i = 0; i < config.rays; i++)
        outside += b.pixels[i].x < FORMAT_WIDTH / 4;
    assert_in_range(outside, config.rays / 8, config.rays / 2);
    cln_batch_free(&b);
    cln_scene_free(scene);
}

/* Of one pixel in 18,432, at an edge, which few draws find: the others repeat it with a ray through
 * its middle. What is drawn before the first of them is the background, without a surface. */
static void what_is_left_out_teaches_nothing(void **state)
{
    enum { SIZE = 4, SIDE = 2, RAYS = 400, ONE = 20, BYTES = 384 };
    enum { STEP = 4 };                /* whose first draws find none */
    static const uint8_t none[BYTES]; /* no pixel counts */
    static uint8_t one[BYTES];
    cln_scene *scene = make_scene(*state, SIZE);
    cln_view *shown = &scene->views[3];
    const size_t at = (size_t)(ONE * shown->camera.width + ONE);
    const float found[4] = {1, 1, 1, 1};
    float lost[4] = {0, 0, 0, 0};
    int before = 0, parts = 0, middles = 0;
    cln_batch b;

    one[at / 8] = (uint8_t)(1 << at % 8);
    memset(shown->pixels + 3 * at, 255, 3);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        assert_int_equal(scene->views[v].camera.width * scene->views[v].camera.height, 8 * BYTES);
        scene->views[v].kept = v == 3 ? one : none;
    }
    for (int c = 0; c < 3; c++)
        lost[c] = scene->background[c] = 0.2f * (float)(c + 1);
    assert_ok(cln_batch_create(scene, plain(), &b));
    assert_in_range(RAYS, 1, b.capacity);
    cln_batch_draw(&b, scene, plain(), &(cln_draw){.step = STEP, .n = RAYS, .antialias = SIDE});
    for (int i = 0; i < RAYS; i++) {
        const cln_pixel *p = &b.pixels[i];
        const bool counts = cln_view_keeps(&scene->views[p->view], (int)p->x, (int)p->y);

        assert_true(counts || i == before); /* never one after one that counts */
        before += !counts;
        assert_memory_equal(b.targets[i], counts ? found : lost, sizeof lost);
        if (!counts || p->spot == 0) {
            assert_int_equal(parts % (SIDE * SIDE), 0);
            middles += counts;
        } else {
            assert_int_equal(CLN_SPOT_INDEX(p->spot), parts % (SIDE * SIDE));
            parts++;
        }
    }
    assert_true(before > 0 && parts > 2 * SIDE * SIDE && middles > 100);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        scene->views[v].kept = NULL;
    cln_batch_free(&b);
    cln_scene_free(scene);
}

int test_group_batch(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(the_middle_comes_first, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(what_is_left_out_teaches_nothing, scratch_make,
                                        scratch_remove),
    };

    return cmocka_run_group_tests_name("batch", tests, NULL, NULL);
}
