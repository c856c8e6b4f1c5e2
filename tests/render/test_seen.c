/* How many training views see what a picture shows (render/seen.h): views that are made up. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "near.h"
#include "outcome.h"
#include "render/seen.h"
#include "tests.h"

enum { VIEWS = 10, SIDE = 16 };

/* Cameras in a row along x, all looking along +z, and a wall at z = 4. */
static void make_row(cln_seen *seen)
{
    memset(seen, 0, sizeof *seen);
    seen->count = VIEWS;
    seen->cameras = calloc(VIEWS, sizeof *seen->cameras);
    seen->depth = calloc(VIEWS, sizeof *seen->depth);
    assert_true(seen->cameras && seen->depth);
    for (int i = 0; i < VIEWS; i++) {
        cln_camera *c = &seen->cameras[i];

        *c = (cln_camera){.width = SIDE,
                          .height = SIDE,
                          .fx = SIDE,
                          .fy = SIDE,
                          .cx = SIDE / 2,
                          .cy = SIDE / 2,
                          .c2w = {1, 0, 0, 0.1 * i, 0, 1, 0, 0, 0, 0, 1, 0}};
        seen->depth[i] = calloc((size_t)SIDE * SIDE, sizeof **seen->depth);
        assert_non_null(seen->depth[i]);
        for (int k = 0; k < SIDE * SIDE; k++) {
            double o[3], d[3];

            assert_true(cln_camera_ray(c, k % SIDE + .5, k / SIDE + .5, o, d));
            seen->depth[i][k] = (float)(4 / d[2]);
        }
    }
}

static void set_depths(cln_seen *seen, int view, float depth)
{
    for (int k = 0; k < SIDE * SIDE; k++)
        seen->depth[view][k] = depth;
}

/* On the wall all see it, and more than so many count as these; before and behind it none does. */
static void test_points(void **state)
{
    cln_seen seen;

    (void)state;
    make_row(&seen);
    assert_int_equal(cln_seen_at(&seen, (double[]){0.4, 0, 4}), CLN_SEEN_MOST);
    assert_int_equal(cln_seen_at(&seen, (double[]){0.4, 0, 2}), 0);
    assert_int_equal(cln_seen_at(&seen, (double[]){0.4, 0, 6}), 0);
    assert_int_equal(cln_seen_at(&seen, (double[]){0.4, 0, -4}), 0); /* behind the cameras */
    /* what is beside the picture of a camera, whose half is 2 wide there, is not seen by it */
    assert_int_equal(cln_seen_at(&seen, (double[]){2.65, 0, 4}), 3);
    assert_int_equal(cln_seen_at(&seen, (double[]){-1.95, 0, 4}), 1);
    assert_int_equal(cln_seen_at(&seen, (double[]){-2.5, 0, 4}), 0);
    set_depths(&seen, 9, 1);  /* something hides the wall */
    set_depths(&seen, 8, -1); /* or nothing is there */
    assert_int_equal(cln_seen_at(&seen, (double[]){2.65, 0, 4}), 1);
    cln_seen_free(&seen);
    assert_null(seen.depth);
}

/* A picture of the wall: numbers by columns; where it is not opaque there are none. */
static void test_picture(void **state)
{
    const int width = 700, height = 30; /* a grid of three pixels, and a rest */
    cln_camera camera = {.width = 700,
                         .height = 30,
                         .fx = 70,
                         .fy = 70,
                         .cx = 350,
                         .cy = 15,
                         .c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0}};
    cln_picture picture = {.width = width, .height = height};
    const size_t n = (size_t)width * (size_t)height;
    size_t shown = 0, none = 0, few = 0;
    cln_seen_shares shares;
    cln_seen seen;

    (void)state;
    make_row(&seen);
    picture.depth = calloc(n, sizeof *picture.depth);
    picture.opacity = calloc(n, sizeof *picture.opacity);
    assert_true(picture.depth && picture.opacity);
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            double o[3], d[3];

            assert_true(cln_camera_ray(&camera, x + .5, y + .5, o, d));
            picture.depth[y * width + x] = (float)(4 / d[2]);
            picture.opacity[y * width + x] = y < 15 ? 1 : 0.4f;
        }
    assert_ok(cln_seen_picture(&seen, &camera, &picture));
    for (int y = 0; y < height; y++)
        for (int x = 0; x < width; x++) {
            const double at = (x + .5 - 350) / 70 * 4; /* along the wall */
            int views = 0;

            for (int i = 0; i < VIEWS; i++)
                views += fabs(at - 0.1 * i) < 2;
            views = views > CLN_SEEN_MOST ? CLN_SEEN_MOST : views;
            if (y >= 15)
                assert_int_equal(picture.seen[y * width + x], -1);
            else if (abs(picture.seen[y * width + x] - views) > 1) /* of a pixel beside */
                fail_msg("(%d, %d): %d, not %d", x, y, picture.seen[y * width + x], views);
            shown += picture.seen[y * width + x] >= 0;
            none += picture.seen[y * width + x] == 0;
            few += picture.seen[y * width + x] >= 0 && picture.seen[y * width + x] < 3;
        }
    shares = cln_seen_share(&picture);
    assert_near(shares.none, (double)none / (double)shown, 1e-12);
    assert_near(shares.few, (double)few / (double)shown, 1e-12);
    assert_near(shares.none, 1 - 4.9 * 70 / 4 / 700, 0.01); /* they see from -2 to 2.9 */
    for (size_t i = 0; i < n; i++)
        picture.seen[i] = -1;
    assert_true(isnan(cln_seen_share(&picture).none));
    cln_picture_free(&picture);
    cln_seen_free(&seen);
}

int test_group_seen(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_points),
                                       cmocka_unit_test(test_picture)};

    return cmocka_run_group_tests_name("seen", tests, NULL, NULL);
}
