/* Where on the earth a scene's frame is: metres against those of PROJ (its topocentric conversion),
 * the file, and what the reader of COLMAP's models makes of it. */
#include "unit.h"
#include <string.h>
#include "format_fixture.h"
#include "near.h"
#include "scene/dataset.h"
#include "scene/origin.h"
#include "scene/reader.h"
#include "scratch.h"
#include "tests.h"

static void test_local(void **state)
{
    static const struct {
        double origin[3], place[3], want[3];
    } cases[] = {
        {{48.75, 16.2, 360}, {48.7504, 16.2011, 372.5}, {80.8951, 44.4851, 12.4993}},
        {{-33.5, -70.6, -12}, {-33.509, -70.59, 4000}, {929.7114, -998.8943, 4011.8539}},
        {{10, 179.999, 0}, {10.001, -179.999, 5}, {219.2782, 110.6085, 4.9953}},
        {{89.999, 0, 0}, {89.9995, 90, 0}, {55.8470, 111.6940, -0.0012}},
        {{1, 2, 3}, {1, 2, 3}, {0, 0, 0}},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double at[3];

        memcpy(at, cases[i].place, sizeof at);
        cln_origin_local(cases[i].origin, at, at);
        for (int a = 0; a < 3; a++)
            assert_near(at[a], cases[i].want[a], 1e-4);
    }
}

static void test_file(void **state)
{
    static const char *const others[] = {"",
                                         "1 2 3\n",
                                         "# cl-nascent: x",
                                         "# cl-nascent: x\n1 2\n",
                                         "# cl-nascent: x\n1",
                                         "# cl-nascent: x\n1 2",
                                         "# cl-nascent: x\n1 ",
                                         "# cl-nascent: x\n1 2 3x",
                                         "# cl-nascent: x\n91 2 3\n",
                                         "# cl-nascent: x\n1 2 nan\n",
                                         "# cl-nascent: x\n1,2,3\n",
                                         "# another: x\n1 2 3\n"};
    double origin[3] = {-33.123456784, 151.000000006, 71.2344}, got[3];
    cln_origin_doubt doubt;
    const char *path = scratch_path(*state, "origin.txt");

    assert_false(cln_origin_is_there(*state));
    assert_false(cln_origin_read(*state, got, &doubt));
    cln_origin_round(origin);
    assert_near(origin[1], 151.00000001, 1e-12);
    assert_int_equal(cln_origin_write(*state, origin, (cln_origin_doubt){1.2344, 0.568}), CLN_OK);
    assert_true(cln_origin_is_there(*state));
    assert_true(cln_origin_read(*state, got, &doubt));
    for (int a = 0; a < 3; a++)
        assert_near(got[a], origin[a], 0);
    assert_near(doubt.distance, 1.234, 0);
    assert_near(doubt.up, 0.57, 0);
    for (size_t i = 0; i < sizeof others / sizeof *others; i++) {
        scratch_put(path, others[i], strlen(others[i]));
        assert_false(cln_origin_read(*state, got, &doubt));
        assert_string_equal(cln_error_text(), "");
    }
    scratch_put(path, "# cl-nascent: x\r\n1 -2 3.5\r\n", 28);
    assert_true(cln_origin_read(*state, got, &doubt));
    assert_near(got[1], -2, 0);
    assert_true(isnan(doubt.distance));
    scratch_put(path, "# cl-nascent: x\n1 2 3", 21); /* as of older programs, or cut off */
    assert_true(cln_origin_read(*state, got, &doubt));
    assert_true(got[2] == 3 && isnan(doubt.distance));
    scratch_put(path, "# cl-nascent: x\n1 2 3\n-0.5", 26); /* no distance */
    assert_true(cln_origin_read(*state, got, &doubt));
    assert_true(isnan(doubt.distance));
    scratch_put(path, "# cl-nascent: x\n1 2 3\n0.5", 25);
    assert_true(cln_origin_read(*state, got, &doubt));
    assert_near(doubt.distance, 0.5, 0);
    assert_true(isnan(doubt.up));
}

/* Models in both kinds of files: places of cameras, words and up. */
static void test_model(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (int binary = 0; binary < 2; binary++) {
        const char *folder = scratch_path(*state, binary ? "a" : "b");
        const char *model = scratch_path(folder, "sparse/0");
        const double origin[3] = {48.75, 16.2, binary ? 360.081 : -12.345}; /* below the sea */
        cln_names names = {0};
        double(*at)[3] = NULL;

        format_images(scratch_path(folder, "images"), 1);
        format_colmap(model, binary, cameras, NULL, NULL, 0);
        for (int how = 0; how < 3; how++) { /* without, as of older programs, with cameras' up */
            const cln_origin_doubt doubt = {0.84, how == 2 ? 0.3 : NAN};
            const bool there = how > 0;
            cln_scene *scene = NULL;
            json_t *about = NULL, *place = NULL;
            char *text = NULL;

            if (there)
                assert_int_equal(cln_origin_write(model, origin, doubt), CLN_OK);
            assert_int_equal(
                cln_scene_load(&(cln_scene_desc){.path = folder, .config = plain()}, &scene),
                CLN_OK);
            assert_int_equal(
                !!strstr(scene->because,
                         binary ? "metres east, north and up from the middle of the cameras, "
                                  "latitude 48.75000000, longitude 16.20000000, height 360.081"
                                : "latitude 48.75000000, longitude 16.20000000, height -12.345"),
                there);
            assert_near(scene->up[2], there, 0);
            assert_int_equal(scene->up_by_gps, how == 1);
            assert_int_equal(cln_scene_describe(scene, &about), CLN_OK);
            place = json_object_get(about, "origin");
            assert_int_equal(place != NULL, there);
            assert_near(json_real_value(json_object_get(place, "height")), there ? origin[2] : 0,
                        0);
            assert_near(json_real_value(json_object_get(place, "gps_distance")), there ? 0.84 : 0,
                        0);
            assert_int_equal(cln_origin_hide(about), CLN_OK);
            assert_null(json_object_get(about, "origin"));
            text = json_dumps(about, 0);
            assert_null(strstr(text, binary ? "360.081" : "12.345"));
            assert_null(strstr(text, "48.75"));
            assert_int_equal(!!strstr(text, "by the photos' GPS (half of them within 0.84 m)"),
                             there);
            free(text);
            json_decref(about);
            cln_scene_free(scene);
        }
        assert_int_equal(cln_colmap_places(model, &names, &at), CLN_OK);
        assert_int_equal(names.count, FORMAT_VIEWS);
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            const int number = atoi(names.name[v] + strlen("view_"));

            for (int a = 0; a < 3; a++)
                assert_near(at[v][a], cameras[number].c2w[4 * a + 3], 1e-6);
        }
        cln_dataset_free_names(&names);
        free(at);
    }
    cln_clear_error();
    assert_int_equal(
        cln_colmap_places(scratch_path(*state, "a"), &(cln_names){0}, &(double(*)[3]){NULL}),
        CLN_INPUT);
}

int test_group_origin(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_local),
        cmocka_unit_test_setup_teardown(test_file, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_model, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("origin", tests, NULL, NULL);
}
