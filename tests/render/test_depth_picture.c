/* The scale of depth pictures that a film's frames share (render/depth_picture.h). */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "render/depth_picture.h"
#include "outcome.h"
#include "tests.h"

/* One scale for all frames of a film: percentiles of the depths of both, by hand. */
static void test_depth_pictures_share_a_scale(void **state)
{
    float depth[2][100];
    uint8_t opacity[100], grey[100];
    cln_depth_scale scale = {0};

    (void)state;
    memset(opacity, 255, sizeof opacity);
    for (int i = 0; i < 100; i++) {
        depth[0][i] = 1 / (1.0f + (float)i / 100); /* inverse 1 to 2, and 3 to 4 */
        depth[1][i] = 1 / (3.0f + (float)i / 100);
    }
    opacity[7] = 100; /* does not count, and is darker */
    assert_ok(cln_depth_scale_add(&scale, 100, depth[0], opacity));
    assert_ok(cln_depth_scale_add(&scale, 100, depth[1], opacity));
    assert_true(cln_depth_scale_make(&scale));
    assert_true(fabsf(scale.low - 1.03f) < 0.011f && fabsf(scale.high - 3.96f) < 0.011f);
    cln_depth_draw(&scale, 100, depth[0], opacity, grey);
    assert_in_range(grey[99], (int)(255 * (0.15 + 0.85 * 0.31)), (int)(255 * (0.15 + 0.85 * 0.36)));
    assert_true(grey[7] < grey[0]);
    cln_depth_draw(&scale, 100, depth[1], opacity, grey);
    assert_in_range(grey[99], 254, 255);
    cln_depth_scale_free(&scale);
}

/* A long film's samples are moved a few times, not with each frame. */
static void test_depth_scale_of_many_frames(void **state)
{
    enum { FRAMES = 1000, PIXELS = 4096 };
    static float depth[PIXELS];
    static uint8_t opacity[PIXELS];
    cln_depth_scale scale = {0};
    int moved = 0;

    (void)state;
    memset(opacity, 255, sizeof opacity);
    for (int i = 0; i < FRAMES; i++) {
        const float *before = scale.sample;

        for (int k = 0; k < PIXELS; k++)
            depth[k] = (float)(1 + i);
        assert_ok(cln_depth_scale_add(&scale, PIXELS, depth, opacity));
        moved += scale.sample != before;
    }
    assert_int_equal(scale.count, FRAMES * PIXELS);
    assert_in_range(moved, 1, 16);
    assert_true(scale.sample[0] == 1 && scale.sample[scale.count - 1] == 1.0f / FRAMES);
    cln_depth_scale_free(&scale);
}

int test_group_depth_picture(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_depth_pictures_share_a_scale),
        cmocka_unit_test(test_depth_scale_of_many_frames),
    };

    return cmocka_run_group_tests_name("depth_picture", tests, NULL, NULL);
}
