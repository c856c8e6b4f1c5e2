/* export --cameras of scenes that are made up: what the file has of each view and of all, where
 * views differ in one thing. test_exports.c reads such files back. */
#include "unit.h"
#include <jansson.h>
#include <math.h>
#include "export/export.h"
#include "near.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

enum { VIEWS = 3 };

/* Two training views and a test view, of one fisheye camera and with depths in millimetres. */
static void make_views(const char *folder, cln_view views[VIEWS])
{
    static const char *const names[VIEWS] = {"a.png", "b.png", "c.png"};

    memset(views, 0, VIEWS * sizeof *views);
    for (int i = 0; i < VIEWS; i++) {
        views[i] = (cln_view){.name = (char *)names[i],
                              .path = (char *)scratch_path(folder, names[i]),
                              .file_width = 16,
                              .file_height = 12,
                              .downscale = 1,
                              .split = i < 2 ? CLN_SPLIT_TRAIN : CLN_SPLIT_TEST,
                              .disc = 0.375};
        views[i].camera = (cln_camera){.width = 16,
                                       .height = 12,
                                       .fx = 9,
                                       .fy = 9,
                                       .cx = 8,
                                       .cy = 6,
                                       .lens = CLN_LENS_OPENCV_FISHEYE,
                                       .c2w = {1, 0, 0, i, 0, 1, 0, 0, 0, 0, 1, 0}};
        views[i].depth = (cln_depth_image){
            .depth = (char *)scratch_path(folder, "depth.png"), .unit = 1e-3, .most = INFINITY};
    }
}

/* Exports it, lengths times `scale`; the caller drops the reference. */
static json_t *exported(const char *folder, cln_view views[VIEWS], double scale)
{
    cln_scene scene = {.folder = (char *)folder, .views = views, .view_count = VIEWS};
    cln_export_result result = {0};
    const cln_export_desc desc = {.what = "cameras",
                                  .run = scratch_path(folder, "run"),
                                  .scene = folder,
                                  .file = scratch_path(folder, "cameras.json")};
    cln_export_job job = {.desc = &desc, .scale = scale, .result = &result};
    json_t *document = NULL;
    char *text = NULL;
    size_t bytes = 0;

    scene.space.half = 1;
    job.opened.scene = &scene;
    assert_ok(cln_export_cameras(&job));
    assert_int_equal(result.views, VIEWS);
    text = scratch_get(desc.file, &bytes);
    document = json_loads(text, 0, NULL);
    assert_non_null(document);
    free(text);
    return document;
}

static double number(const json_t *object, const char *key)
{
    return json_number_value(json_object_get(object, key));
}

/* Depth images stay as they are: lengths that are scaled have another unit of them. */
static void units_are_scaled(void **state)
{
    cln_view views[VIEWS];

    make_views(*state, views);
    for (int i = 1; i <= 3; i += 2) {
        json_t *document = exported(*state, views, i);
        const json_t *frame = json_array_get(json_object_get(document, "frames"), 1);
        const json_t *row = json_array_get(json_object_get(frame, "transform_matrix"), 0);

        assert_near(number(document, "depth_unit_scale_factor"), 1e-3 * i, 1e-12);
        assert_near(json_number_value(json_array_get(row, 3)), i, 1e-12);
        assert_string_equal(json_string_value(json_object_get(frame, "depth_file_path")),
                            "depth.png");
        json_decref(document);
    }
}

/* A camera of all stands once; those that differ in the radius of their disc alone are several. */
static void discs_are_of_cameras(void **state)
{
    cln_view views[VIEWS];
    json_t *document = NULL;

    make_views(*state, views);
    document = exported(*state, views, 1);
    assert_near(number(document, "fl_x"), 9, 0);
    assert_near(number(document, "fisheye_crop_radius"), 6, 1e-12); /* 0.375 of 16 */
    json_decref(document);
    views[1].disc = 0.4375;
    views[2].disc = 0;
    document = exported(*state, views, 1);
    assert_null(json_object_get(document, "fl_x"));
    assert_null(json_object_get(document, "fisheye_crop_radius"));
    for (int i = 0; i < VIEWS; i++) {
        const json_t *frame = json_array_get(json_object_get(document, "frames"), (size_t)i);

        assert_near(number(frame, "fl_x"), 9, 0);
        assert_near(number(frame, "fisheye_crop_radius"), 16 * views[i].disc, 1e-12);
        assert_int_equal(json_object_get(frame, "fisheye_crop_radius") != NULL, i < 2);
    }
    json_decref(document);
}

/* The lists of the splits, as "ab" of a.png and b.png, and those that are there again. */
static void assert_lists(const char *folder, cln_view views[VIEWS], const char *train,
                         const char *val, const char *test, const char *again)
{
    static const char *const keys[] = {"train_filenames", "val_filenames", "test_filenames",
                                       "listed_again"};
    const char *const wanted[] = {train, val, test, again};
    json_t *document = exported(folder, views, 1);

    for (int k = 0; k < 4; k++) {
        const json_t *list = json_object_get(document, keys[k]);
        char first[8] = "";

        assert_in_range(json_array_size(list), 0, VIEWS);
        for (size_t i = 0; i < json_array_size(list); i++)
            first[i] = *json_string_value(json_array_get(list, i));
        if (strcmp(first, wanted[k]) != 0)
            fail_msg("%s: '%s' instead of '%s'", keys[k], first, wanted[k]);
    }
    json_decref(document);
}

/* A split without views has the list of the other that is held out, else the training views'. */
static void no_list_is_empty(void **state)
{
    cln_view views[VIEWS];

    make_views(*state, views);
    assert_lists(*state, views, "ab", "c", "c", "v");
    views[2].split = CLN_SPLIT_VAL;
    assert_lists(*state, views, "ab", "c", "c", "t");
    views[2].split = CLN_SPLIT_TRAIN;
    assert_lists(*state, views, "abc", "abc", "abc", "vt");
    views[1].split = CLN_SPLIT_VAL;
    views[2].split = CLN_SPLIT_TEST;
    assert_lists(*state, views, "a", "b", "c", "");
}

int test_group_export_cameras(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(units_are_scaled, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(discs_are_of_cameras, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(no_list_is_empty, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("export_cameras", tests, NULL, NULL);
}
