/* Forward spaces (normalised device coordinates): LLFF scenes whose cameras look one way have one,
 * other scenes on request. Tested: the mean camera, the near plane by depths or points, sides that
 * hold what the images show, and the reason why a scene has none. */
#include "unit.h"
#include "base/text.h"
#include "format_fixture.h"
#include "tests.h"

/* A hand-held grid of cameras that look along x (z up) from about (1, 2, 3), rolled a little. */
static void make_cameras(cln_camera cameras[FORMAT_VIEWS])
{
    format_cameras(cameras); /* their intrinsics */
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const double roll = 0.05 * (v - 2.5), yaw = 0.04 * (v % 3 - 1);
        const double place[3] = {1 + 0.1 * (v % 2), 2 + 0.2 * (v % 3 - 1), 3 + 0.15 * (v / 3)};
        const double z[3] = {cos(yaw), sin(yaw), 0}, flat[3] = {sin(yaw), -cos(yaw), 0};
        const double down[3] = {0, 0, -1};
        double *m = cameras[v].c2w;

        for (int a = 0; a < 3; a++) {
            m[4 * a] = cos(roll) * flat[a] + sin(roll) * down[a];
            m[4 * a + 1] = -sin(roll) * flat[a] + cos(roll) * down[a];
            m[4 * a + 2] = z[a];
            m[4 * a + 3] = place[a];
        }
    }
}

/* The mean camera, and how near its frame finds what is `depth` in front of the cameras. */
static double check_mean(const cln_scene *scene, const cln_camera cameras[FORMAT_VIEWS],
                         double depth)
{
    const cln_space *space = &scene->space;
    double mean[3] = {0}, nearest = INFINITY, down = 0;

    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int a = 0; a < 3; a++)
            mean[a] += cameras[v].c2w[4 * a + 3] / FORMAT_VIEWS;
    for (int a = 0; a < 3; a++) {
        assert_float_equal(space->centre[a], mean[a], 1e-12);
        assert_float_equal(space->axes[6 + a], a == 0, 1e-12); /* the yaws cancel out */
        down += space->axes[3 + a] * (a == 2 ? -1 : 0);
    }
    assert_true(down > 0.999 && fabs(space->axes[0]) < 1e-12);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int k = 0; k < 4; k++) {
            const cln_camera *c = &cameras[v];
            double o[3], d[3], along = 0;

            assert_true(cln_camera_ray(c, k & 1 ? c->width : 0, k & 2 ? c->height : 0, o, d));
            for (int a = 0; a < 3; a++)
                along += d[a] * c->c2w[4 * a + 2];
            nearest = fmin(nearest, o[0] + depth / along * d[0] - mean[0]);
        }
    return nearest;
}

/* Every border's ray runs through the cube from its near face to the far one, and one of each pair
 * of sides has almost no room left. */
static void check_sides(const cln_scene *scene, const cln_camera cameras[FORMAT_VIEWS])
{
    double most[2] = {0, 0};

    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int k = 0; k < 8; k++) {
            const cln_camera *c = &cameras[v];
            const double u = k < 4 ? k % 2 : k == 4 || k == 5 ? 0.5 : k - 6;
            const double w = k < 4 ? k / 2 : k == 4 || k == 5 ? k - 4 : 0.5;
            double o[3], d[3], q[3], e[3];

            assert_true(cln_camera_ray(c, u * c->width, w * c->height, o, d));
            cln_space_ray_to_cube(&scene->space, o, d, q, e);
            assert_float_equal(q[2], -1, 1e-12);
            for (int a = 0; a < 2; a++)
                most[a] = fmax(most[a], fmax(fabs(q[a]), fabs(q[a] + 2 / e[2] * e[a])));
        }
    for (int a = 0; a < 2; a++)
        assert_true(most[a] > 0.97 && most[a] < 1);
}

static void test_llff(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    cln_scene *scene = NULL;

    make_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_llff(folder, cameras, 1, false);
    scene = load(folder, &config);
    assert_true(scene->space.forward);
    assert_non_null(strstr(scene->bounds_rule, "normalised device coordinates"));
    assert_false(scene->cube_guessed);
    assert_float_equal(scene->cube_share, 1, 0);
    assert_float_equal(scene->space.half, 0.9 * check_mean(scene, cameras, 2), 1e-12);
    check_sides(scene, cameras);
    cln_scene_free(scene);
    /* not wanted */
    config.space = CLN_SPACE_CUBE;
    scene = load(folder, &config);
    assert_false(scene->space.forward);
    assert_non_null(strstr(scene->bounds_rule, "near and far"));
    cln_scene_free(scene);
    config.space = CLN_SPACE_AUTO;
    strcpy(config.bbox, "0,0,0,9,9,9");
    scene = load(folder, &config);
    assert_false(scene->space.forward);
    assert_non_null(strstr(scene->bounds_rule, "--bbox"));
    cln_scene_free(scene);
}

/* Scenes without one: their default space, and the error if one is requested. */
static void test_refused(void **state)
{
    static const char *const whys[] = {"do not look one way", "'view_02.png' looks more than 78",
                                       "begins at depth", "tell how near"};

    for (int i = 0; i < 4; i++) {
        const char *folder = scratch_path(*state, (const char *[]){"a", "b", "c", "d"}[i]);
        cln_camera cameras[FORMAT_VIEWS];
        cln_config config = *plain();
        cln_scene *scene = NULL;

        make_cameras(cameras);
        format_images(scratch_path(folder, "images"), 1);
        if (i == 0)
            format_cameras(cameras);
        if (i == 1)
            for (int a = 0; a < 3; a++) { /* to the left */
                const double x = cameras[2].c2w[4 * a];

                cameras[2].c2w[4 * a] = cameras[2].c2w[4 * a + 2];
                cameras[2].c2w[4 * a + 2] = -x;
            }
        if (i == 2)
            cameras[4].c2w[3] -= 40; /* what is 2 in front of it is behind the mean one */
        if (i < 3) {
            format_llff(folder, cameras, 1, false);
            scene = load(folder, &config);
            assert_false(scene->space.forward);
            if (!strstr(scene->bounds_rule, whys[i]))
                fail_msg("case %d: '%s'", i, scene->bounds_rule);
            cln_scene_free(scene);
        } else {
            format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
        }
        config.space = CLN_SPACE_NDC;
        assert_int_equal(try_load(folder, &config, &scene), CLN_INPUT);
        assert_non_null(strstr(cln_error_text(), "--space ndc"));
        if (!strstr(cln_error_text(), whys[i]))
            fail_msg("case %d: '%s'", i, cln_error_text());
        cln_clear_error();
    }
}

/* The lowest cosine of the images' corners and sides' middles with the mean of the axes. */
static double least_cosine(const cln_camera cameras[FORMAT_VIEWS])
{
    double mean[3] = {0}, length = 0, least = 1;

    for (int a = 0; a < 3; a++) {
        for (int v = 0; v < FORMAT_VIEWS; v++)
            mean[a] += cameras[v].c2w[4 * a + 2];
        length += mean[a] * mean[a];
    }
    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int k = 0; k < 9; k++) {
            const cln_camera *c = &cameras[v];
            double o[3], d[3], sum = 0, square = 0;

            assert_true(
                cln_camera_ray(c, 0.5 * (k % 3) * c->width, 0.5 * (k / 3 % 3) * c->height, o, d));
            for (int a = 0; a < 3; a++) {
                sum += d[a] * mean[a];
                square += d[a] * d[a];
            }
            least = fmin(least, sum / sqrt(square * length));
        }
    return least;
}

/* A camera turned aside until its image reaches 77 degrees from the mean axis is no reason to
 * refuse; 80 degrees are. */
static void test_aside(void **state)
{
    for (int i = 0; i < 2; i++) {
        const char *folder = scratch_path(*state, i ? "far" : "near");
        const double wanted = cos((i ? 80 : 77) * 3.14159265358979323846 / 180);
        cln_camera cameras[FORMAT_VIEWS];
        cln_config config = *plain();
        cln_scene *scene = NULL;
        double low = 0, high = 1.5;

        for (int round = 0; round < 50; round++) {
            const double turn = 0.5 * (low + high);

            make_cameras(cameras);
            for (int a = 0; a < 3; a++) {
                double *m = cameras[2].c2w + 4 * a;
                const double x = m[0];

                m[0] = cos(turn) * x + sin(turn) * m[2];
                m[2] = cos(turn) * m[2] - sin(turn) * x;
            }
            if (least_cosine(cameras) > wanted)
                low = turn;
            else
                high = turn;
        }
        assert_float_equal(least_cosine(cameras), wanted, 1e-9);
        format_images(scratch_path(folder, "images"), 1);
        format_llff(folder, cameras, 1, false);
        scene = load(folder, &config);
        if ((strstr(scene->bounds_rule, "'view_02.png' looks more than 78") != NULL) != (i == 1))
            fail_msg("case %d: '%s'", i, scene->bounds_rule);
        assert_int_equal(scene->space.forward, i == 0);
        cln_scene_free(scene);
    }
}

/* The name of the camera that looks aside is shortened between two characters. */
static void test_long_name(void **state)
{
    const char *folder = *state;
    const cln_config config = *plain();
    cln_camera cameras[FORMAT_VIEWS];
    char name[160] = "images/view_02";
    cln_scene *scene = NULL;

    make_cameras(cameras);
    for (int a = 0; a < 3; a++) { /* to where the right one's x axis points */
        double *m = cameras[2].c2w + 4 * a;
        const double x = m[0];

        m[0] = -m[2];
        m[2] = x;
    }
    for (int i = 0; i < 60; i++)
        strcat(name, "\xc3\xa9");
    strcat(name, ".png");
    format_images(scratch_path(folder, "images"), 1);
    assert_int_equal(rename(scratch_path(folder, "images/view_02.png"), scratch_path(folder, name)),
                     0);
    format_llff(folder, cameras, 1, false);
    scene = load(folder, &config);
    assert_non_null(strstr(scene->bounds_rule, "'view_02\xc3\xa9"));
    assert_non_null(strstr(scene->bounds_rule, "\xc3\xa9' looks more than 78"));
    assert_true(cln_utf8_valid(scene->bounds_rule));
    cln_scene_free(scene);
}

/* COLMAP's points, except an outlier, give the near plane. Such scenes are cubes unless told
 * otherwise. */
static void test_points(void **state)
{
    enum { POINTS = 400 };
    const char *folder = *state;
    cln_point points[POINTS];
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    cln_scene *scene = NULL;

    make_cameras(cameras);
    for (int i = 0; i < POINTS; i++)
        points[i] = (cln_point){.xyz = {4 + 0.01 * i, 2 + 0.3 * sin(i), 3 + 0.3 * cos(i)},
                                .views = FORMAT_VIEWS};
    points[7].xyz[0] = 1.2; /* 0.1 before the mean camera */
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, points, POINTS);
    scene = load(folder, &config);
    assert_false(scene->space.forward);
    assert_null(strstr(scene->bounds_rule, "normalised"));
    cln_scene_free(scene);
    config.space = CLN_SPACE_NDC;
    scene = load(folder, &config);
    assert_true(scene->space.forward);
    assert_non_null(strstr(scene->bounds_rule, "sparse points"));
    assert_float_equal(scene->space.half, 0.9 * (4 - scene->space.centre[0]), 0.03);
    check_sides(scene, cameras);
    cln_scene_free(scene);
}

int test_group_forward(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_llff, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refused, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_aside, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_long_name, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_points, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("forward", tests, NULL, NULL);
}
