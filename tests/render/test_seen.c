/* How many training views see what a picture shows (render/seen.h): views that are made up, and
 * depths of a run's training views. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "near.h"
#include "render/seen.h"
#include "run_fixture.h"
#include "tests.h"

enum { VIEWS = 10, ACROSS = 16 };

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

        *c = (cln_camera){.width = ACROSS,
                          .height = ACROSS,
                          .fx = ACROSS,
                          .fy = ACROSS,
                          .cx = ACROSS / 2,
                          .cy = ACROSS / 2,
                          .c2w = {1, 0, 0, 0.1 * i, 0, 1, 0, 0, 0, 0, 1, 0}};
        seen->depth[i] = calloc((size_t)ACROSS * ACROSS, sizeof **seen->depth);
        assert_non_null(seen->depth[i]);
        for (int k = 0; k < ACROSS * ACROSS; k++) {
            double o[3], d[3];

            assert_true(cln_camera_ray(c, k % ACROSS + .5, k / ACROSS + .5, o, d));
            seen->depth[i][k] = (float)(4 / d[2]);
        }
    }
}

static void set_depths(cln_seen *seen, int view, float depth)
{
    for (int k = 0; k < ACROSS * ACROSS; k++)
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

/* What the first view alone shows, at pixel (8, 8) alone, at 4 from its eye: is a point that it has
 * at that pixel's place, moved by so many pixels, and so far away, on it? */
static bool is_on(double focal, int right, int down, double distance)
{
    double o[3], d[3], point[3];
    cln_seen seen;
    int views = 0;

    make_row(&seen);
    for (int i = 0; i < VIEWS; i++)
        set_depths(&seen, i, -1);
    seen.cameras[0].fx = seen.cameras[0].fy = focal;
    seen.depth[0][8 * ACROSS + 8] = 4;
    assert_true(cln_camera_ray(seen.cameras, 8.5 + right, 8.5 + down, o, d));
    for (int a = 0; a < 3; a++)
        point[a] = o[a] + distance * d[a];
    views = cln_seen_at(&seen, point);
    assert_in_range(views, 0, 1);
    cln_seen_free(&seen);
    return views;
}

/* Depths agree up to a hundredth and two widths of a pixel, of the point's distance: that decides
 * where pixels are small and where they are large. Pixels right beside one count as it does. */
static void test_tolerance(void **state)
{
    (void)state;
    assert_true(is_on(1e6, 0, 0, 4.039) && is_on(1e6, 0, 0, 3.962));
    assert_false(is_on(1e6, 0, 0, 4.042) || is_on(1e6, 0, 0, 3.959));
    assert_true(is_on(20, 0, 0, 4.48) && is_on(20, 0, 0, 3.61)); /* 4 / 0.89, 4 / 1.11 */
    assert_false(is_on(20, 0, 0, 4.51) || is_on(20, 0, 0, 3.59));
    for (int v = -2; v <= 2; v++)
        for (int u = -2; u <= 2; u++)
            assert_int_equal(is_on(100, u, v, 4), abs(u) < 2 && abs(v) < 2);
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

/* Of a map each pixel is asked, as its heights are left out one by one. */
static void test_map(void **state)
{
    const int width = 700, height = 4;
    cln_camera camera = {.width = 700,
                         .height = 4,
                         .fx = 17.5,
                         .fy = 17.5,
                         .parallel = true,
                         .c2w = {1, 0, 0, -20, 0, 1, 0, 0, 0, 0, 1, 0}};
    cln_picture picture = {.width = width, .height = height};
    const size_t n = (size_t)width * (size_t)height;
    cln_seen seen;

    (void)state;
    make_row(&seen);
    picture.depth = calloc(n, sizeof *picture.depth);
    picture.opacity = calloc(n, sizeof *picture.opacity);
    assert_true(picture.depth && picture.opacity);
    for (size_t i = 0; i < n; i++) {
        picture.depth[i] = i % 5 == 1 ? 4 : 3; /* on the wall, and before it */
        picture.opacity[i] = i % 3 == 0 ? 0.4f : 1;
    }
    assert_ok(cln_seen_picture(&seen, &camera, &picture));
    for (size_t i = 0; i < n; i++) {
        const double at = ((double)(i % 700) + .5) / 17.5 - 20;

        if (i % 3 == 0)
            assert_int_equal(picture.seen[i], -1);
        else if (i % 5 != 1 || at < -2.1 || at > 3)
            assert_int_equal(picture.seen[i], 0);
        else if (at > -1.9 && at < 2.8)
            assert_true(picture.seen[i] > 0);
    }
    cln_picture_free(&picture);
    cln_seen_free(&seen);
}

/* Of a trained ball of radius 1, 4 from the eyes: depths are lengths of the scene, and there are
 * none beside it. */
static void test_depths(void **state)
{
    const cln_device_desc device = fixture_device();
    const cln_callbacks none = {0};
    cln_config config = fixture_voxels();
    cln_train_result trained;
    cln_open_run run = {0};
    cln_seen seen = {0};
    bool alike = false;

    (void)state;
    NEED_DEVICE();
    config.steps = 200;
    assert_ok(fixture_train("voxels", false, &config, NULL, &trained));
    assert_ok(cln_open_run_cameras(fixture_path("voxels"), NULL, &none, &alike, &run));
    assert_true(fabs(run.model.space.half - 1) > 0.2); /* else lengths of the cube are these */
    assert_ok(cln_seen_choose(run.scene, &seen));
    assert_int_equal(seen.count, TRAIN_VIEWS);
    assert_ok(cln_open_run_start(&run, &device, 0));
    assert_ok(cln_seen_make(&run, &none, &seen));
    for (int i = 0; i < seen.count; i++) {
        const int width = seen.cameras[i].width, height = seen.cameras[i].height;
        const double middle = (double)seen.depth[i][height / 2 * width + width / 2];

        assert_true(width == SIDE && height == SIDE);
        if (!(fabs(middle - 3) < 0.5))
            fail_msg("view %d: %g in the middle", i, middle);
        for (int corner = 0; corner < 4; corner++) {
            const int x = corner & 1 ? width - 1 : 0, y = corner & 2 ? height - 1 : 0;

            assert_true(seen.depth[i][y * width + x] == -1);
        }
    }
    cln_seen_free(&seen);
    cln_open_run_close(&run);
}

int test_group_seen(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_points),  cmocka_unit_test(test_tolerance),
        cmocka_unit_test(test_picture), cmocka_unit_test(test_map),
        cmocka_unit_test(test_depths),
    };

    return cmocka_run_group_tests_name("seen", tests, fixture_setup, fixture_teardown);
}
