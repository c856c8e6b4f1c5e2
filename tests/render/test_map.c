/* Maps (render/map.h): their cameras in cubes and boxes, plain and with a shell, upright and not;
 * their two files. tests/api/test_render_frames.c renders one. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "near.h"
#include "outcome.h"
#include "base/log.h"
#include "io/mesh.h"
#include "render/map.h"
#include "scratch.h"
#include "tests.h"

static const double UP[3] = {0, 0, 1}, NONE[3] = {0};

static cln_space space_of(bool shell)
{
    return (cln_space){.centre = {500000.5, 4200000, 120}, .half = 40, .shell = shell};
}

static cln_camera camera_of(const cln_space *space, const cln_crop *crop, const double up[3],
                            double spacing)
{
    double axes[9];
    cln_camera camera;

    cln_map_axes(up, axes);
    assert_ok(cln_map_camera(space, crop, axes, spacing, &camera));
    return camera;
}

/* The pixel of a place, by the map's own rule: columns along x, rows against y. */
static void assert_pixel(const cln_camera *c, const double point[3], double u, double v)
{
    double at[3];

    assert_true(cln_camera_project(c, point, &at[0], &at[1], &at[2]));
    assert_near(at[0], u, 1e-6);
    assert_near(at[1], v, 1e-6);
}

static void test_cube(void **state)
{
    const cln_space space = space_of(false);
    const cln_camera c = camera_of(&space, &(cln_crop){0}, UP, 0.25);
    double corner[3];

    (void)state;
    assert_true(c.parallel);
    assert_int_equal(c.width, 320);
    assert_int_equal(c.height, 320);
    cln_map_corner(&c, NONE, corner);
    assert_near(corner[0], 499960.5, 1e-9);
    assert_near(corner[1], 4200040, 1e-9);
    assert_near(corner[2], 160, 1e-9);
    assert_pixel(&c, (const double[3]){499960.5, 4200040, 0}, 0, 0);
    assert_pixel(&c, (const double[3]){499970.5, 4200010, -50}, 40, 120); /* east, south */
}

/* By itself a pixel is a round number: 800 to 2000 of them along the longer side. */
static void test_spacing(void **state)
{
    static const double halves[] = {1e-6, 0.3, 0.99, 1, 1.01, 7, 123.4, 1e6};
    cln_space space = space_of(false);

    (void)state;
    for (size_t i = 0; i < sizeof halves / sizeof *halves; i++) {
        double spacing = 0, digits = 0;
        cln_camera c;

        space.half = halves[i];
        c = camera_of(&space, &(cln_crop){0}, UP, 0);
        spacing = 1 / c.fx;
        digits = spacing / pow(10, floor(log10(spacing) + 1e-9));
        assert_true(fabs(digits - 1) < 1e-6 || fabs(digits - 2) < 1e-6 || fabs(digits - 5) < 1e-6);
        assert_in_range(c.width, 800, 2000);
    }
}

/* A box is cut to a plain space's cube, not to a shell's core; parts of pixels are whole ones. */
static void test_crop(void **state)
{
    const cln_space plain = space_of(false), shell = space_of(true), space_at_0 = {.half = 1};
    const cln_crop crop = {.on = true, .box = {499900, 4199990, 100, 500000.4, 4200010, 130}};
    cln_camera c = camera_of(&plain, &crop, UP, 0.25);
    double corner[3];

    (void)state;
    cln_map_corner(&c, NONE, corner);
    assert_near(corner[0], 499960.5, 1e-9);
    assert_near(corner[1], 4200010, 1e-9);
    assert_near(corner[2], 130, 1e-9);
    assert_int_equal(c.width, 160); /* 159.6 */
    c = camera_of(&space_at_0, &(cln_crop){.on = true, .box = {0.3, 0.1, 0, 0.7, 0.6, 1}}, UP, 0.1);
    assert_int_equal(c.width * 10 + c.height, 45); /* 0.3 is less than 3 times 0.1 */
    c = camera_of(&plain, &crop, UP, 0.75);
    cln_map_corner(&c, NONE, corner);
    assert_near(corner[0], 499960.5, 1e-9);
    assert_near(corner[1], 4200010.5, 1e-9);
    assert_int_equal(c.height, 28); /* 27.3 from there */
    c = camera_of(&plain, &crop, UP, 0.25);
    assert_int_equal(c.height, 80);
    c = camera_of(&shell, &crop, UP, 0.25);
    cln_map_corner(&c, NONE, corner);
    assert_near(corner[0], 499900, 1e-9);
    assert_int_equal(c.width, 402);
}

/* With another up the frame is a rotation, level, in which the whole cube has room. */
static void test_axes(void **state)
{
    static const double ups[][3] = {{0, 0, 1},  {0, 0, -1},    {0, 1, 0},          {0, -1, 0},
                                    {-1, 0, 0}, {0.6, 0, 0.8}, {-0.48, 0.6, -0.64}};
    const cln_space space = space_of(false);

    (void)state;
    for (size_t i = 0; i < sizeof ups / sizeof *ups; i++) {
        double axes[9];
        cln_camera c;

        cln_map_axes(ups[i], axes);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++)
                assert_near(axes[3 * a] * axes[3 * b] + axes[3 * a + 1] * axes[3 * b + 1] +
                                axes[3 * a + 2] * axes[3 * b + 2],
                            a == b, 1e-12);
        assert_near(axes[0] * (axes[4] * axes[8] - axes[5] * axes[7]) -
                        axes[1] * (axes[3] * axes[8] - axes[5] * axes[6]) +
                        axes[2] * (axes[3] * axes[7] - axes[4] * axes[6]),
                    1, 1e-12);
        for (int a = 0; a < 3; a++)
            assert_near(axes[6 + a], ups[i][a], 1e-12);
        if (i == 0)
            assert_true(axes[0] == 1 && axes[4] == 1);
        c = camera_of(&space, &(cln_crop){0}, ups[i], 0.5);
        for (int k = 0; k < 8; k++) {
            const double point[3] = {space.centre[0] + (k & 1 ? 39.999 : -39.999),
                                     space.centre[1] + (k & 2 ? 39.999 : -39.999),
                                     space.centre[2] + (k & 4 ? 39.999 : -39.999)};
            double u = 0, v = 0;

            assert_true(cln_camera_shows(&c, point, &u, &v));
        }
    }
}

static void hear(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN)
        snprintf(user, 300, "%s", line);
}

/* What the training cameras tell counts where it is sure and z is not about that; what is doubtful
 * is said. */
static void test_up(void **state)
{
    static const struct {
        double seen[3];
        bool guessed;
        double up[3];
        const char *says;
    } rows[] = {{{0.03, 0, 0.99955}, false, {0, 0, 1}, ""},
                {{0.03, 0, 0.99955}, true, {0, 0, 1}, ""},
                {{0.28, 0, 0.96}, false, {0, 0, 1}, "16.3 degrees from it: --up=0.28,0,0.96"},
                {{0.28, 0, 0.96}, true, {0, 0, 1}, "perhaps it is --up=0.28,0,0.96"},
                {{0.6, 0, 0.8}, false, {0.6, 0, 0.8}, "up (0.6, 0, 0.8)"},
                {{0.3676, 0, 0.93}, false, {0.3676, 0, 0.93}, "up (0.3676, 0, 0.93)"},
                {{0.6, 0, 0.8}, true, {0, 0, 1}, "perhaps it is --up=0.6,0,0.8"},
                {{0, -0.9998, 0.02}, false, {0, -1, 0}, "up (0, -1, 0)"},
                {{0, 0.998, 0.0632}, false, {0, 0.998, 0.0632}, "up (0, 0.998, 0.0632)"},
                {{0, 0.02, -0.9998}, false, {0, 0, -1}, "up (0, 0, -1)"},
                {{0, 0.02, -0.9998}, true, {0, 0, 1}, "perhaps it is --up=0,0,-1"}};
    double up[3];

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_orbit_frame frame = {.guessed = rows[i].guessed};
        char heard[300] = "";

        memcpy(frame.up, rows[i].seen, sizeof frame.up);
        cln_log_to(CLN_LOG_WARN, hear, heard);
        cln_map_up(&frame, up);
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        if (memcmp(up, rows[i].up, sizeof up) != 0 || !strstr(heard, rows[i].says) ||
            (!*rows[i].says && *heard))
            fail_msg("row %d: up (%g, %g, %g), \"%s\"", (int)i, up[0], up[1], up[2], heard);
    }
    cln_map_up(NULL, up);
    assert_true(up[0] == 0 && up[1] == 0 && up[2] == 1);
}

/* A map lies on what export --up makes of the same points. */
static void test_lies_on_exports(void **state)
{
    static const double ups[][3] = {{1, 0, 0}, {0, -2, 0}, {0, 0, -1}, {0.57, -0.76, 0.32}};

    (void)state;
    for (size_t i = 0; i < sizeof ups / sizeof *ups; i++) {
        const double point[3] = {3, -1, 0.4};
        double axes[9], turn[4], turned[3];

        cln_map_axes(ups[i], axes);
        cln_mesh_upright(ups[i], 2, turn);
        cln_mesh_turned(turn, point, turned);
        for (int a = 0; a < 3; a++)
            assert_near(axes[3 * a] * point[0] + axes[3 * a + 1] * point[1] +
                            axes[3 * a + 2] * point[2],
                        turned[a], 1e-12);
    }
}

static void test_refused(void **state)
{
    cln_space space = space_of(false);
    cln_crop crop = {.on = true, .box = {0, 0, 0, 1, 1, 1}};
    cln_camera c;
    double axes[9];

    (void)state;
    cln_map_axes(UP, axes);
    assert_fails(cln_map_camera(&space, &crop, axes, 0, &c), CLN_USAGE, "outside the scene's cube");
    assert_fails(cln_map_camera(&space, &(cln_crop){0}, axes, 1e-3, &c), CLN_USAGE,
                 "80000 x 80000 pixels");
    crop.turn[0] = 1;
    assert_fails(cln_map_camera(&space, &crop, axes, 0, &c), CLN_USAGE, "is turned");
    space.forward = true;
    assert_fails(cln_map_camera(&space, &(cln_crop){0}, axes, 0, &c), CLN_USAGE, "--space ndc");
}

/* Three by two pixels: heights to a thousandth of a pixel, none where nothing is, or nobody saw. */
static void test_files(void **state)
{
    const cln_space space = {.centre = {10, 20, -12000}, .half = 4};
    const cln_crop crop = {.on = true, .box = {8, 19, -12002, 11, 21, -11999}};
    const cln_camera c = camera_of(&space, &crop, UP, 1);
    float depth[6] = {0.5f, 1.25f, 2, 0.125f, 1, 1}, opacity[6] = {1, 0.5f, 0.49f, 1, 0, 1};
    const double shift[3] = {-1, 4e6, 10000};
    int8_t seen[6] = {3, 1, 2, 9, -1, 0};
    cln_picture picture = {.width = 3, .height = 2, .depth = depth, .opacity = opacity};
    char path[4096], *text = NULL;
    size_t bytes = 0;

    assert_int_equal(c.width * 10 + c.height, 32);
    snprintf(path, sizeof path, "%s/a", (char *)*state);
    assert_ok(cln_map_write_world(path, &c, NONE));
    text = scratch_get(path, &bytes);
    assert_string_equal(text, "1\n0\n0\n-1\n8.5\n20.5\n");
    free(text);
    assert_ok(cln_map_write_heights(path, &c, NONE, &picture));
    text = scratch_get(path, &bytes);
    assert_string_equal(text, "ncols 3\nnrows 2\nxllcorner 8\nyllcorner 19\ncellsize 1\n"
                              "NODATA_value -99999\n-11999.500 -12000.250 -99999\n"
                              "-11999.125 -99999 -12000.000\n");
    free(text);
    picture.seen = seen;
    assert_ok(cln_map_write_heights(path, &c, shift, &picture));
    text = scratch_get(path, &bytes);
    assert_non_null(strstr(text, "yllcorner 4000019\n"));
    assert_non_null(strstr(text, "NODATA_value -9999\n-1999.500 -2000.250 -9999\n"
                                 "-1999.125 -9999 -9999\n"));
    free(text);
    assert_ok(cln_map_write_heights(path, &c, (const double[3]){0, 0, 2001.75}, &picture));
    text = scratch_get(path, &bytes); /* the lowest is half above -9999 */
    assert_non_null(strstr(text, "NODATA_value -99999\n-9997.750 -9998.500 -99999\n"));
    free(text);
}

int test_group_map(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cube),
        cmocka_unit_test(test_spacing),
        cmocka_unit_test(test_crop),
        cmocka_unit_test(test_axes),
        cmocka_unit_test(test_up),
        cmocka_unit_test(test_lies_on_exports),
        cmocka_unit_test(test_refused),
        cmocka_unit_test_setup_teardown(test_files, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("map", tests, NULL, NULL);
}
