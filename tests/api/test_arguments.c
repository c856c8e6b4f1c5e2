/* Arguments that a caller of the library may get wrong (cl_nascent.h): pointers that are NULL and
 * numbers out of range are CLN_USAGE with a sentence that names them, or are accepted where the
 * header says so; never a crash. Needs no device. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "cl_nascent.h"
#include "outcome.h"
#include "tests.h"

static void test_missing_descs_and_results(void **state)
{
    cln_train_result trained;
    cln_eval_result measured;
    cln_render_result rendered;
    cln_export_result exported;
    cln_tune_result tuned;
    cln_poses_result posed;
    cln_device_info *devices = NULL;
    char *json = NULL;
    int count = 0;

    (void)state;
    assert_fails(cln_train(NULL, &trained), CLN_USAGE, "cln_train: desc is missing");
    assert_fails(cln_train(&(cln_train_desc){0}, NULL), CLN_USAGE, "cln_train: result is missing");
    assert_fails(cln_eval(NULL, &measured), CLN_USAGE, "cln_eval: desc is missing");
    assert_int_equal(measured.count, 0);
    assert_fails(cln_eval(&(cln_eval_desc){0}, NULL), CLN_USAGE, "cln_eval: result is missing");
    assert_fails(cln_eval_json(&measured, NULL), CLN_USAGE, "cln_eval_json: json is missing");
    assert_fails(cln_eval_json(NULL, &json), CLN_USAGE, "cln_eval_json: result is missing");
    assert_fails(cln_render(NULL, &rendered), CLN_USAGE, "cln_render: desc is missing");
    assert_fails(cln_render(&(cln_render_desc){0}, NULL), CLN_USAGE, "render: result is missing");
    assert_fails(cln_view_run(NULL), CLN_USAGE, "cln_view_run: desc is missing");
    assert_fails(cln_export(NULL, &exported), CLN_USAGE, "cln_export: desc is missing");
    assert_fails(cln_export(&(cln_export_desc){0}, NULL), CLN_USAGE, "export: result is missing");
    assert_fails(cln_check(NULL, &json), CLN_USAGE, "cln_check: desc is missing");
    assert_fails(cln_check(&(cln_check_desc){0}, NULL), CLN_USAGE, "cln_check: json is missing");
    assert_fails(cln_find_poses(NULL, &posed), CLN_USAGE, "cln_find_poses: desc is missing");
    assert_fails(cln_find_poses(&(cln_poses_desc){0}, NULL), CLN_USAGE, "result is missing");
    assert_fails(cln_info_scene(".", NULL, NULL), CLN_USAGE, "cln_info_scene: json is missing");
    assert_fails(cln_info_run(".", NULL), CLN_USAGE, "cln_info_run: json is missing");
    assert_fails(cln_tune_search(NULL, &tuned), CLN_USAGE, "cln_tune_search: desc is missing");
    assert_fails(cln_tune_search(&(cln_tune_desc){0}, NULL), CLN_USAGE, "result is missing");
    assert_fails(cln_devices_list(NULL, false, NULL, &count), CLN_USAGE, "out is missing");
    assert_fails(cln_devices_list(NULL, false, &devices, NULL), CLN_USAGE, "count is missing");
    assert_fails(cln_devices_test(NULL, 0, NULL, NULL), CLN_USAGE, "info is missing");
    assert_null(json);
}

/* An error that the caller left there is none of the next call. */
static void test_error_of_before(void **state)
{
    cln_settings *settings = NULL;
    char *json = NULL;

    (void)state;
    assert_int_equal(cln_settings_create("nonsense", &settings), CLN_USAGE);
    assert_int_equal(cln_info_run("none", &json), CLN_INPUT);
    assert_int_equal(cln_error_status(), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "none: "));
    cln_clear_error();
}

static void test_missing_objects(void **state)
{
    cln_settings *settings = NULL;
    cln_field *field = NULL;
    double at[3] = {0}, box[3] = {7, 7, 7};
    float sigma = 0;
    char text[CLN_SETTING_BYTES];

    (void)state;
    assert_fails(cln_settings_create(NULL, NULL), CLN_USAGE, "cln_settings_create: out is missing");
    assert_fails(cln_settings_of_run(".", NULL), CLN_USAGE, "cln_settings_of_run: out is missing");
    assert_fails(cln_settings_set(NULL, "steps", "1"), CLN_USAGE, "settings is missing");
    assert_fails(cln_settings_get(NULL, "steps", text, sizeof text), CLN_USAGE, "settings is miss");
    assert_fails(cln_settings_check(NULL), CLN_USAGE, "cln_settings_check: settings is missing");
    assert_ok(cln_settings_create(NULL, &settings));
    assert_fails(cln_settings_set(settings, NULL, "1"), CLN_USAGE, "name is missing");
    assert_fails(cln_settings_set(settings, "steps", NULL), CLN_USAGE, "value is missing");
    assert_fails(cln_settings_get(settings, "steps", NULL, 9), CLN_USAGE, "value is missing");
    cln_settings_free(settings);
    assert_false(cln_setting_describe(0, NULL));
    assert_fails(cln_field_open(".", NULL, NULL), CLN_USAGE, "cln_field_open: out is missing");
    assert_fails(cln_field_open(NULL, NULL, &field), CLN_USAGE, "cln_field_open: run is missing");
    assert_fails(cln_field_at(NULL, 1, (const double(*)[3]) & at, NULL, NULL, &sigma), CLN_USAGE,
                 "cln_field_at: field is missing");
    assert_fails(cln_field_render(NULL, &(cln_frame_desc){0}, &sigma, NULL, NULL), CLN_USAGE,
                 "cln_field_render: field is missing");
    cln_field_box(NULL, box, box);
    assert_true(box[0] == 7);
}

static void test_freeing_nothing(void **state)
{
    (void)state;
    cln_settings_free(NULL);
    cln_field_close(NULL);
    cln_eval_free(NULL);
    cln_tune_free(NULL);
}

static void test_numbers_out_of_range(void **state)
{
    static const double wrong[] = {-1, NAN, INFINITY};
    cln_export_result exported;
    cln_tune_result tuned;
    char *json = NULL;

    (void)state;
    for (int i = 0; i < 3; i++) {
        assert_fails(cln_tune_search(&(cln_tune_desc){.budget = wrong[i]}, &tuned), CLN_USAGE,
                     "cln_tune_search: budget is");
        assert_fails(cln_check(&(cln_check_desc){.scene = ".", .probe = wrong[i]}, &json),
                     CLN_USAGE, "cln_check: probe is");
    }
    assert_fails(
        cln_export(&(cln_export_desc){.run = ".", .file = "x.ply", .what = "points", .count = -1},
                   &exported),
        CLN_USAGE, "cln_export: count is -1");
    assert_fails(cln_export(&(cln_export_desc){.run = ".",
                                               .file = "x.ply",
                                               .what = "points",
                                               .cropped = true,
                                               .crop = {0, 0, 0, 1, NAN, 1}},
                            &exported),
                 CLN_USAGE, "--crop: the minimum 0 is not below the maximum nan along y");
    assert_fails(cln_tune_search(&(cln_tune_desc){.max_tries = -1}, &tuned), CLN_USAGE,
                 "cln_tune_search: max_tries is -1");
}

static void test_nothing_given(void **state)
{
    const char *scene = "scene", *none = NULL;
    char *text = NULL;
    cln_train_result trained;
    cln_eval_result measured;
    cln_render_result rendered;
    cln_export_result exported;
    cln_poses_result posed;
    cln_field *field = NULL;

    (void)state;
    assert_fails(cln_train(&(cln_train_desc){.scene = scene}, &trained), CLN_USAGE, "run");
    assert_fails(cln_train(&(cln_train_desc){.run = "r"}, &trained), CLN_USAGE, "scene");
    assert_fails(cln_train(&(cln_train_desc){.run = "/no/such/nowhere", .resume = true}, &trained),
                 CLN_INPUT, "nowhere");
    assert_fails(cln_eval(&(cln_eval_desc){0}, &measured), CLN_USAGE, "run");
    assert_fails(cln_render(&(cln_render_desc){.out = "o"}, &rendered), CLN_USAGE, "run");
    assert_fails(cln_render(&(cln_render_desc){.run = "r"}, &rendered), CLN_USAGE, "out");
    assert_fails(cln_view_run(&(cln_view_desc){0}), CLN_USAGE, "run");
    assert_fails(cln_view_run(&(cln_view_desc){.run = "r", .port = 70000}), CLN_USAGE,
                 "port 70000");
    assert_fails(cln_view_run(&(cln_view_desc){.run = "r", .port = -5}), CLN_USAGE, "port -5");
    assert_fails(cln_eval(&(cln_eval_desc){.run = "r", .antialias = 99}, &measured), CLN_USAGE,
                 "antialias is 99; give 0 to 8");
    assert_fails(cln_eval(&(cln_eval_desc){.run = "r", .out = ""}, &measured), CLN_USAGE,
                 "out is empty");
    assert_fails(cln_eval(&(cln_eval_desc){.run = "r", .max_images = -1}, &measured), CLN_USAGE,
                 "max_images");
    assert_fails(cln_render(&(cln_render_desc){.run = "r", .out = "o", .width = -8}, &rendered),
                 CLN_USAGE, "width is -8");
    assert_fails(cln_render(&(cln_render_desc){.run = "r", .out = "o", .fps = NAN}, &rendered),
                 CLN_USAGE, "fps is nan");
    assert_fails(cln_render(&(cln_render_desc){.run = "r", .out = "o.y4m", .fps = 3e-4}, &rendered),
                 CLN_USAGE, "fps is 0.0003; give 0.001 or more");
    assert_fails(cln_field_open(none, NULL, &field), CLN_USAGE, "run");
    assert_fails(cln_export(&(cln_export_desc){.file = "f"}, &exported), CLN_USAGE, "run");
    assert_fails(cln_export(&(cln_export_desc){.run = "r"}, &exported), CLN_USAGE, "file");
    assert_fails(cln_check(&(cln_check_desc){0}, &text), CLN_USAGE, "scene");
    assert_fails(cln_info_run(none, &text), CLN_USAGE, "run");
    assert_fails(cln_find_poses(&(cln_poses_desc){.out = "o"}, &posed), CLN_USAGE, "photos");
    assert_fails(
        cln_find_poses(&(cln_poses_desc){.photos = "p", .out = "o", .match = "nxt"}, &posed),
        CLN_USAGE, "'nxt'; give auto, all or next");
    assert_fails(
        cln_find_poses(&(cln_poses_desc){.photos = "p", .out = "o", .lens = "fish"}, &posed),
        CLN_USAGE, "--lens fish: not the name");
    assert_fails(cln_find_poses(&(cln_poses_desc){.photos = "p", .out = "o", .frames = -5}, &posed),
                 CLN_USAGE, "frames is -5");
}

/* The program refuses the same by the same sentences (tests/cli/cli.sh). */
static void test_members_without_use(void **state)
{
    const struct {
        cln_render_desc desc;
        const char *says; /* NULL: it gets as far as the run, which is not there */
    } rows[] = {
        {{.orbit_frames = 2, .interpolate = 3}, "--interpolate cannot be combined with --orbit"},
        {{.spiral_frames = 2, .interpolate = 3}, "--interpolate cannot be combined with --spiral"},
        {{.split = "test", .interpolate = 3, .orbit_frames = 2}, NULL},
        {{.orbit_frames = 2, .max_images = 3}, "--max-images cannot be combined with --orbit"},
        {{.poses = "p", .max_images = 3}, NULL},
        {{.map = true, .max_images = 3}, "--max-images cannot be combined with --map"},
        {{.map = true, .first_frame = 3}, "--frames cannot be combined with --map"},
        {{.split = "test", .loop = true}, "--loop requires --interpolate"},
        {{.orbit_frames = 2, .loop = true}, "an orbit or spiral is closed as it is"},
        {{.split = "test", .loop = true, .interpolate = 3}, NULL},
        {{.split = "test", .fov = 50}, "--fov requires --orbit, --spiral or --interpolate"},
        {{.map = true, .fov = 50}, "--fov requires --orbit, --spiral or --interpolate"},
        {{.spiral_frames = 2, .fov = 50}, NULL},
        {{.poses = "p", .up = {0, 0, 1}}, "--up requires --orbit, --spiral, --map"},
        {{.map = true, .up = {0, 0, 1}}, NULL},
        {{.poses = "p", .up = {0, 0, 1}, .interpolate = 3}, NULL},
        {{.spiral_frames = 2, .orbit_circle = true}, "--circle requires --orbit"},
        {{.split = "test", .orbit_circle = true}, "--circle requires --orbit"},
        {{.orbit_frames = 2, .orbit_circle = true}, NULL},
        {{.orbit_frames = 2, .fps = 25}, "--fps requires a film"},
        {{.orbit_frames = 2, .fps = 25, .out = "o.y4m"}, NULL},
        {{.split = "test", .orbit_elevation = NAN, .orbit_radius = 1}, NULL},
    };
    cln_render_result result;

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_render_desc desc = rows[i].desc;

        desc.run = "/no run";
        desc.out = desc.out ? desc.out : "o";
        assert_fails(cln_render(&desc, &result), rows[i].says ? CLN_USAGE : CLN_INPUT,
                     rows[i].says ? rows[i].says : "/no run");
    }
}

int test_group_arguments(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_missing_descs_and_results), cmocka_unit_test(test_error_of_before),
        cmocka_unit_test(test_missing_objects),           cmocka_unit_test(test_freeing_nothing),
        cmocka_unit_test(test_numbers_out_of_range),      cmocka_unit_test(test_nothing_given),
        cmocka_unit_test(test_members_without_use),
    };

    return cmocka_run_group_tests_name("arguments", tests, NULL, NULL);
}
