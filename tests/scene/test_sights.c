/* Depths from sparse points: the pixels of training views that show a point, against the
 * projection of the known cameras; which points and views count, and how far they are trusted. */
#include "unit.h"
#include "format_fixture.h"
#include "tests.h"

enum { POINTS = 200 };

/* Points around what the cameras look at; point i is in the first i % 7 views, so in 0 to 6. */
static void make_points(cln_point points[POINTS])
{
    for (int i = 0; i < POINTS; i++)
        points[i] = (cln_point){
            {1 + 0.2 * (i % 5 - 2), 2 + 0.15 * (i / 5 % 5 - 2), 3 + 0.1 * (i / 25 % 5 - 2)},
            {1, 2, 3},
            i % 7,
            0};
}

static cln_scene *load_with(const char *folder, int holdout, double depth_loss)
{
    cln_config config = *plain();
    const cln_scene_desc desc = {
        .path = folder, .config = &config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;

    config.holdout = holdout;
    config.depth_loss = depth_loss;
    if (cln_scene_load(&desc, &scene) != CLN_OK)
        fail_msg("%s", cln_error_text());
    return scene;
}

/* Every sight, in order, by the definition. holdout: view v is test where v % holdout is 0. */
static void assert_sights(const cln_scene *scene, const cln_camera *cameras,
                          const cln_point *points, int holdout, double trust)
{
    int64_t at = 0;

    for (int i = 0; i < POINTS; i++) {
        int training = 0;

        for (int v = 0; v < points[i].views; v++)
            training += v % holdout != 0;
        for (int v = 0; v < points[i].views; v++) {
            const cln_sight *sight = &scene->sights[at];
            double x, y, z;

            if (v % holdout == 0 || training < 2 ||
                !cln_camera_project(&cameras[v], points[i].xyz, &x, &y, &z) || z <= 0 || x < 0 ||
                y < 0 || x >= FORMAT_WIDTH || y >= FORMAT_HEIGHT)
                continue;
            assert_true(at++ < scene->sight_count);
            assert_int_equal(atoi(strstr(scene->views[sight->view].name, "view_") + 5), v);
            assert_int_equal(scene->views[sight->view].split, CLN_SPLIT_TRAIN);
            assert_int_equal(sight->x, (int)x);
            assert_int_equal(sight->y, (int)y);
            for (int k = 0; k < 3; k++)
                assert_float_equal(sight->point[k], points[i].xyz[k], 1e-12);
            assert_float_equal(sight->trust, trust, 1e-6);
        }
    }
    assert_int_equal(at, scene->sight_count);
    assert_true(at > POINTS / 2);
}

static void test_colmap(void **state)
{
    cln_point points[POINTS];
    cln_camera cameras[FORMAT_VIEWS];

    make_points(points);
    format_cameras(cameras);
    for (int binary = 0; binary < 2; binary++) {
        const char *folder = scratch_path(*state, binary ? "binary" : "text");

        format_images(scratch_path(folder, "images"), 1);
        format_colmap(scratch_path(folder, "sparse/0"), binary, cameras, NULL, points, POINTS);
        for (int holdout = 3; holdout <= 1000; holdout += 997) { /* 1000: only view 0 */
            cln_scene *scene = load_with(folder, holdout, 0.1);

            assert_sights(scene, cameras, points, holdout, exp(-1)); /* one error for all */
            cln_scene_free(scene);
        }
    }
}

/* The same from tracks.csv, beside reconstruction.json; that file has no errors. */
static void test_opensfm(void **state)
{
    cln_point points[POINTS];
    cln_camera cameras[FORMAT_VIEWS];

    make_points(points);
    format_cameras(cameras);
    for (int version = 0; version < 2; version++) {
        const char *folder = scratch_path(*state, version ? "new" : "old");
        cln_scene *scene = NULL;

        format_images(scratch_path(folder, "images"), 1);
        format_opensfm(scratch_path(folder, "opensfm"), cameras, "brown", points, POINTS);
        scene = load_with(folder, 3, 0.1);
        assert_int_equal(scene->sight_count, 0);
        cln_scene_free(scene);
        format_opensfm_tracks(scratch_path(folder, "opensfm"), version, points, POINTS);
        scene = load_with(folder, 3, 0.1);
        assert_sights(scene, cameras, points, 3, 1);
        cln_scene_free(scene);
    }
}

/* No sights are looked for without a depth loss; a scene whose points have no images has none. */
static void test_none(void **state)
{
    cln_point points[POINTS];
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    make_points(points);
    format_cameras(cameras);
    format_images(scratch_path(*state, "images"), 1);
    format_colmap(scratch_path(*state, "sparse/0"), true, cameras, NULL, points, POINTS);
    scene = load_with(*state, 0, 0);
    assert_true(scene->sight_count == 0 && !scene->sights);
    cln_scene_free(scene);
    for (int i = 0; i < POINTS; i++)
        points[i].views = i % 2; /* one image tells no depth */
    format_colmap(scratch_path(*state, "sparse/0"), true, cameras, NULL, points, POINTS);
    scene = load_with(*state, 0, 0.1);
    assert_int_equal(scene->sight_count, 0);
    cln_scene_free(scene);
}

/* Trust falls with a point's error, exp(-(e / mean)^2): written by hand, three points of error 1, 2
 * and 3. The first line's images have an unknown id and one that is not a number. */
static void test_trust(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;
    FILE *f = NULL;

    format_cameras(cameras);
    format_images(scratch_path(*state, "images"), 1);
    format_colmap(scratch_path(*state, "sparse/0"), false, cameras, NULL, NULL, 0);
    f = format_open(scratch_path(*state, "sparse/0"), "points3D.txt");
    fprintf(f, "1 1 2 3 9 9 9 1 1 0 99 0 2 5 x 7\n2 1 2 3 9 9 9 2 2 0 3 1\n3 1 2 3 9 9 9 3 3 0 1 "
               "1\n");
    fclose(f);
    scene = load_with(*state, 0, 0.1);
    assert_int_equal(scene->sight_count, 6);
    for (int i = 0; i < 6; i++) {
        const double share = (i / 2 + 1) / 2.0;

        assert_float_equal(scene->sights[i].trust, exp(-share * share), 1e-6);
    }
    cln_scene_free(scene);
}

int test_group_sights(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_colmap, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_opensfm, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_none, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_trust, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("sights", tests, NULL, NULL);
}
