/* Cameras without files: the lens model against numbers worked out by hand, pixel -> ray -> point
 * -> pixel with strong distortion, the fold of the model, and the check of poses. */
#include "unit.h"
#include <string.h>
#include "base/rng.h"
#include "near.h"
#include "scene/build.h"
#include "tests.h"

static cln_camera plain_camera(void)
{
    cln_camera camera = {.c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                         .fx = 100,
                         .fy = 200,
                         .cx = 32,
                         .cy = 24,
                         .width = 64,
                         .height = 48};
    return camera;
}

/* Rotation by yaw about y, then pitch about x (camera axes in world, columns), at (1, -2, 3). */
static void turn(cln_camera *camera, double yaw, double pitch)
{
    const double c = cos(yaw), s = sin(yaw), d = cos(pitch), t = sin(pitch);
    const double m[12] = {c, s * t, s * d, 1, 0, d, -t, -2, -s, c * t, c * d, 3};

    memcpy(camera->c2w, m, sizeof m);
}

static void test_project_by_hand(void **state)
{
    cln_camera camera = plain_camera();
    double u, v, z;

    (void)state;
    assert_true(cln_camera_project(&camera, (double[3]){1, -0.5, 4}, &u, &v, &z));
    assert_near(u, 32 + 100 * 0.25, 1e-12);
    assert_near(v, 24 - 200 * 0.125, 1e-12);
    assert_near(z, 4, 1e-12);
    assert_false(cln_camera_project(&camera, (double[3]){1, 1, -4}, &u, &v, &z));
    assert_false(cln_camera_project(&camera, (double[3]){1, 1, 0}, &u, &v, &z));

    /* a = 0.5, b = 0.25, r2 = 0.3125, radial = 1 + 0.03125 + 0.0009765625 = 1.0322265625
     * a' = 0.51611328125 + 2 * 0.001 * 0.125 + 0.002 * (0.3125 + 0.5)     = 0.51798828125
     * b' = 0.258056640625 + 0.001 * (0.3125 + 0.125) + 2 * 0.002 * 0.125  = 0.258994140625 */
    camera.k1 = 0.1;
    camera.k2 = 0.01;
    camera.p1 = 0.001;
    camera.p2 = 0.002;
    assert_true(cln_camera_is_distorted(&camera));
    assert_true(cln_camera_project(&camera, (double[3]){1, 0.5, 2}, &u, &v, &z));
    assert_near(u, 32 + 51.798828125, 1e-12);
    assert_near(v, 24 + 51.798828125, 1e-12); /* fy = 2 fx */

    /* Turned by 90 degrees about y: looks along world -x, its x axis is world z. */
    camera = plain_camera();
    turn(&camera, -1.5707963267948966, 0);
    assert_true(cln_camera_project(&camera, (double[3]){-1, -2, 3.5}, &u, &v, &z));
    assert_near(z, 2, 1e-12);
    assert_near(u, 32 + 100 * 0.25, 1e-12);
    assert_near(v, 24, 1e-12);
}

/* The shortcut for a camera without a lens gives the lens models' bits. */
static void test_project_as_a_lens(void **state)
{
    static const double points[][3] = {{1, -0.5, 4},  {-0.3, 0.7, 1e3}, {0, 0, 1e-9}, {5, 7, 1e-4},
                                       {1e200, 0, 1}, {0, 0, 0},        {1, 2, -1},   {1, 2, 0}};
    const cln_camera camera = plain_camera();
    int found = 0;

    (void)state;
    for (size_t i = 0; i < sizeof points / sizeof points[0]; i++) {
        double place[2], u, v, z;
        const bool is_found = cln_lens_distort(camera.lens, camera.distortion, points[i], place);

        assert_int_equal(cln_camera_project(&camera, points[i], &u, &v, &z), is_found);
        assert_true(z == points[i][2]);
        if (is_found)
            assert_true(u == camera.fx * place[0] + camera.cx &&
                        v == camera.fy * place[1] + camera.cy);
        found += is_found;
    }
    assert_int_equal(found, 4);
}

/* Of a panorama, what is behind it is in its image, too. */
static void test_shows(void **state)
{
    cln_camera camera = plain_camera();
    double u, v;

    (void)state;
    assert_true(cln_camera_shows(&camera, (double[3]){0, 0, 2}, &u, &v));
    assert_true(u == camera.cx && v == camera.cy);
    assert_false(cln_camera_shows(&camera, (double[3]){0, 0, -2}, &u, &v));
    assert_false(cln_camera_shows(&camera, (double[3]){2, 0, 2}, &u, &v)); /* beside it */
    camera.lens = CLN_LENS_EQUIRECTANGULAR;
    camera.fx = camera.width / (2 * M_PI);
    camera.fy = camera.height / M_PI;
    assert_true(cln_camera_shows(&camera, (double[3]){1, 0, -2}, &u, &v));
    assert_near(u, camera.cx + camera.fx * atan2(1, -2), 1e-9);
}

static void test_ray_by_hand(void **state)
{
    cln_camera camera = plain_camera();
    double o[3], d[3];

    (void)state;
    /* Pixel (132, 24): a = 1, b = 0 -> (1, 0, 1) / sqrt 2. */
    assert_true(cln_camera_ray(&camera, 132, 24, o, d));
    assert_near(d[0], 0.70710678118654752, 1e-15);
    assert_near(d[1], 0, 0);
    assert_near(d[2], 0.70710678118654752, 1e-15);
    turn(&camera, -1.5707963267948966, 0);
    assert_true(cln_camera_ray(&camera, 32, 24, o, d));
    assert_near(d[0], -1, 1e-15);
    assert_near(o[0], 1, 0);
    assert_near(o[1], -2, 0);
    assert_near(o[2], 3, 0);
}

/* Parallel rays begin where the pixel is in the camera's plane. */
static void test_parallel(void **state)
{
    cln_camera camera = plain_camera();
    double o[3], d[3], u, v, z;

    (void)state;
    camera.parallel = true;
    assert_int_equal(cln_camera_lenses(&camera), 1u << CLN_LENSES);
    assert_true(cln_camera_project(&camera, (double[3]){0.25, -0.1, 1e6}, &u, &v, &z));
    assert_near(u, 32 + 100 * 0.25, 1e-12);
    assert_near(v, 24 - 200 * 0.1, 1e-12);
    assert_false(cln_camera_project(&camera, (double[3]){0.25, -0.1, 0}, &u, &v, &z));
    assert_false(cln_camera_project(&camera, (double[3]){0.25, -0.1, -4}, &u, &v, &z));
    turn(&camera, 0.7, 0.3);
    assert_true(cln_camera_ray(&camera, 5.5, 40.25, o, d));
    for (int a = 0; a < 3; a++)
        assert_near(d[a], camera.c2w[4 * a + 2], 0);
    for (double t = 0.001; t < 1e4; t *= 10) {
        const double point[3] = {o[0] + t * d[0], o[1] + t * d[1], o[2] + t * d[2]};

        assert_true(cln_camera_project(&camera, point, &u, &v, &z));
        assert_near(u, 5.5, 1e-8);
        assert_near(v, 40.25, 1e-8);
        assert_near(z, t, 1e-9);
    }
}

/* Lenses far stronger than photographs have, and the share of positions, over the image and beyond
 * it, that must have a ray: all, unless the model folds. The second row's fold is far outside. */
static const struct {
    cln_lens lens;
    double distortion[CLN_LENS_PARAMS], share;
} lenses[] = {
    {CLN_LENS_OPENCV, {0, 0, 0, 0}, 1},
    {CLN_LENS_OPENCV, {0.0578421, -0.0805099, -0.000980296, 0.00015575}, 1},
    {CLN_LENS_OPENCV, {-0.4, 0.2, 0, 0}, 0.6},
    {CLN_LENS_OPENCV, {0.8, 0.5, 0.01, -0.02}, 1},
    {CLN_LENS_OPENCV, {0, 0, 0.05, 0.05}, 1},
    {CLN_LENS_OPENCV, {-0.3, 0.12, -0.03, 0.02}, 0.6},
    {CLN_LENS_OPENCV, {2, 0, 0, 0}, 1},
    {CLN_LENS_FULL_OPENCV, {0.9, 0.35, -0.0007, 0.0004, 0.05, 1.25, 0.4, 0.08}, 1},
    {CLN_LENS_OPENCV_FISHEYE, {0}, 1},
    {CLN_LENS_OPENCV_FISHEYE, {-0.02, 0.004, -0.001, 0.0001}, 1},
    {CLN_LENS_THIN_PRISM_FISHEYE, {-0.03, 0.006, 0.001, -0.002, -0.001, 0, 0.01, -0.02}, 1},
    {CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     {0.1, -0.02, 0, 0, 0, 0, 0.01, -0.02, 0.01, 0, -0.01, 0},
     1},
    {CLN_LENS_FOV, {0.9}, 1},
    {CLN_LENS_DIVISION, {-0.3}, 1},
    {CLN_LENS_EUCM, {0.6, 1.1}, 1},
    {CLN_LENS_EQUIRECTANGULAR, {0}, 1},
};
enum { LENSES = sizeof lenses / sizeof *lenses, POSITIONS = 500 };

static void test_round_trip(void **state)
{
    int found[LENSES] = {0};
    bool tested[CLN_LENSES] = {false};

    (void)state;
    for (uint32_t i = 0; i < LENSES * POSITIONS; i++) {
        const uint32_t row = i / POSITIONS;
        cln_camera camera = plain_camera();
        float r[4];
        double u, v, z, o[3], d[3], point[3], length = 0;

        cln_uniform4(1, CLN_STREAM_SCENE, 0, i, 0, r);
        camera.lens = lenses[row].lens;
        memcpy(camera.distortion, lenses[row].distortion, sizeof camera.distortion);
        camera.fx = camera.fy = 50;
        turn(&camera, 6 * r[2], 3 * r[3] - 1.5);
        u = 80 * r[0] - 8;
        v = 60 * r[1] - 6;
        if (!cln_camera_ray(&camera, u, v, o, d))
            continue;
        found[row]++;
        for (int k = 0; k < 3; k++) {
            point[k] = o[k] + 7.5 * d[k];
            length += d[k] * d[k];
        }
        assert_near(length, 1, 1e-14);
        assert_true(cln_camera_project(&camera, point, &u, &v, &z));
        assert_near(u, 80 * r[0] - 8, 1e-9);
        assert_near(v, 60 * r[1] - 6, 1e-9);
    }
    for (int row = 0; row < LENSES; row++)
        tested[lenses[row].lens] = true;
    for (int lens = 0; lens < CLN_LENSES; lens++)
        if (!tested[lens])
            fail_msg("no row of `lenses` is %s's", cln_lens_models[lens].name);
    for (int row = 0; row < LENSES; row++)
        if (found[row] < lenses[row].share * POSITIONS)
            fail_msg("lens %d has %d rays for %d positions", row, found[row], POSITIONS);
}

/* k1 = -0.5: r' = r - r^3/2 grows up to r = sqrt(2/3), r' = 0.5443310539518174. */
static void test_fold(void **state)
{
    cln_camera camera = plain_camera();
    const double edge = 0.5443310539518174;
    double o[3], d[3], a = 0;

    (void)state;
    camera.k1 = -0.5;
    assert_true(cln_camera_ray(&camera, 32 + 100 * (edge - 1e-6), 24, o, d));
    a = d[0] / d[2];
    assert_true(a < 0.81649658092772603);
    assert_near(a - 0.5 * a * a * a, edge - 1e-6, 1e-12);
    assert_false(cln_camera_ray(&camera, 32 + 100 * (edge + 1e-6), 24, o, d));
    assert_near(d[0] / d[2], edge + 1e-6, 1e-15); /* as without distortion */
    assert_false(cln_camera_ray(&camera, 32, 24 + 200 * 3.0, o, d));
    assert_near(d[1] / d[2], 3, 1e-14);
    /* A direction in every quarter turn, close to the fold. */
    for (int k = 0; k < 4; k++)
        assert_true(cln_camera_ray(&camera, 32 + 100 * 0.54 * cos(k * 1.5707963267948966 + 0.3),
                                   24 + 200 * 0.54 * sin(k * 1.5707963267948966 + 0.3), o, d));
}

static void test_resize(void **state)
{
    cln_camera camera = plain_camera();
    double u, v, z, u2, v2;
    const double point[3] = {0.3, -0.2, 2};

    (void)state;
    camera.k1 = 0.2;
    camera.p1 = 0.01;
    assert_true(cln_camera_project(&camera, point, &u, &v, &z));
    cln_camera_resize(&camera, 16, 12, 4, 4);
    assert_true(cln_camera_project(&camera, point, &u2, &v2, &z));
    assert_near(u2, u / 4, 1e-12); /* pixel centres at .5: positions just divide */
    assert_near(v2, v / 4, 1e-12);
    assert_int_equal(camera.width, 16);
}

/* The check must name the camera and the error. */
static void assert_bad(cln_camera camera, const char *word)
{
    assert_int_equal(cln_camera_check(&camera, "frame 'r_7'"), CLN_INPUT);
    if (!strstr(cln_error_text(), "frame 'r_7'") || !strstr(cln_error_text(), word))
        fail_msg("'%s' lacks the frame or '%s'", cln_error_text(), word);
    cln_clear_error();
}

static void test_check(void **state)
{
    cln_camera camera = plain_camera(), good;

    (void)state;
    turn(&camera, 0.7, -0.4);
    good = camera;
    /* Slightly scaled: accepted, and exact afterwards. */
    for (int i = 0; i < 12; i++)
        if (i % 4 < 3)
            camera.c2w[i] *= 1.0009;
    assert_int_equal(cln_camera_check(&camera, "frame"), CLN_OK);
    for (int i = 0; i < 12; i++)
        assert_near(camera.c2w[i], good.c2w[i], 1e-12);
    /* Slightly sheared: orthonormal afterwards. */
    camera.c2w[1] += 5e-4;
    assert_int_equal(cln_camera_check(&camera, "frame"), CLN_OK);
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = 0;

            for (int k = 0; k < 3; k++)
                dot += camera.c2w[4 * k + i] * camera.c2w[4 * k + j];
            assert_near(dot, i == j, 1e-14);
        }

#define WITH(change, word) \
    camera = good;         \
    change;                \
    assert_bad(camera, word)
    WITH(camera.c2w[0] += 0.01, "off by 0.00");
    WITH(for (int i = 0; i < 12; i++) if (i % 4 < 3) camera.c2w[i] *= 1.002, "not rigid");
    WITH(for (int i = 0; i < 12; i++) if (i % 4 < 3) camera.c2w[i] *= 3, "not rigid");
    WITH(for (int i = 0; i < 12; i++) if (i % 4 < 3) camera.c2w[i] = 0, "determinant");
    WITH(for (int i = 0; i < 3; i++) camera.c2w[4 * i] *= -1, "mirrored");
    WITH(camera.c2w[5] = NAN, "not finite");
    WITH(camera.c2w[3] = INFINITY, "not finite");
    WITH(camera.c2w[3] = 1e300, "1e+300");
    WITH(camera.c2w[1] = 1e300, "1e+300");
    WITH(camera.fx = 0, "fl_x = 0");
    WITH(camera.fy = -5, "fl_y = -5");
    WITH(camera.fx = NAN, "fl_x");
    WITH(camera.cx = 1e30, "cx = 1e+30");
    WITH(camera.k2 = INFINITY, "k2");
    WITH(camera.width = 0, "absurd image size 0 x 48");
    WITH(camera.width = camera.height = 20000, "20000 x 20000");
#undef WITH
}

int test_group_camera(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_project_by_hand),
        cmocka_unit_test(test_project_as_a_lens),
        cmocka_unit_test(test_shows),
        cmocka_unit_test(test_ray_by_hand),
        cmocka_unit_test(test_parallel),
        cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_fold),
        cmocka_unit_test(test_resize),
        cmocka_unit_test(test_check),
    };

    return cmocka_run_group_tests_name("camera", tests, NULL, NULL);
}
