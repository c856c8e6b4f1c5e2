/* Frames whose image is missing or unreadable: few are left out with a warning, as --missing says;
 * the others keep their splits and names, and the scene lists what it lacks. */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>
#include "scene_fixture.h"
#include "tests.h"

enum { FRAMES = 24 };

/* 00.png ... 23.png, of which `gone` are missing, from number `first` on. */
static void put_scene(const char *folder, int first, int gone)
{
    char text[8192] = "", name[16], frame[256];

    for (int i = 0; i < FRAMES; i++) {
        snprintf(frame, sizeof frame,
                 "%s{\"file_path\":\"%02d.png\",\"transform_matrix\":" POSE_FRONT "}",
                 i ? "," : "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[", i);
        strcat(text, frame);
        snprintf(name, sizeof name, "%02d.png", i);
        if (i < first || i >= first + gone)
            put_image(folder, name, 8, 6, 3, i);
        else
            remove(scratch_path(folder, name));
    }
    strcat(text, "]}");
    put_text(folder, "transforms.json", text);
}

static cln_status load_with(const char *folder, int rule, int *warnings, cln_scene **scene)
{
    cln_config config = default_config();

    config.missing = rule;
    *warnings = 0;
    cln_log_set_sink(scratch_count_warnings, warnings);
    return try_load(folder, &config, scene);
}

/* Splits are counted with the missing ones: no photo changes sides because another is gone. */
static void test_few_are_left_out(void **state)
{
    cln_scene *whole = NULL, *scene = NULL;
    json_t *about = NULL;
    uint64_t digest = 0;
    int warnings = 0;

    put_scene(*state, 0, 0);
    assert_int_equal(load_with(*state, CLN_MISSING_AUTO, &warnings, &whole), CLN_OK);
    assert_int_equal(warnings, 0);
    assert_int_equal(whole->missing, 0);
    digest = whole->digest;
    cln_scene_free(whole);
    put_scene(*state, 1, 2); /* 01 and 02 */
    assert_int_equal(load_with(*state, CLN_MISSING_AUTO, &warnings, &scene), CLN_OK);
    assert_int_equal(warnings, 1);
    assert_int_equal(scene->missing, 2);
    assert_int_equal(scene->view_count, FRAMES - 2);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 3);
    assert_string_equal(scene->views[cln_scene_split_view(scene, CLN_SPLIT_TEST, 1)].name,
                        "08.png");
    assert_true(scene->digest != digest);
    assert_int_equal(cln_scene_describe(scene, &about), CLN_OK);
    assert_int_equal(json_integer_value(json_object_get(about, "missing")), 2);
    assert_string_equal(
        json_string_value(json_array_get(json_object_get(about, "missing_names"), 1)), "02.png");
    json_decref(about);
    cln_scene_free(scene);
}

static void assert_rule_refuses(const char *folder, int rule, const char *word)
{
    cln_config config = default_config();

    config.missing = rule;
    assert_refused(folder, &config, (const char *const[3]){word}, word);
}

static void test_rules(void **state)
{
    cln_scene *scene = NULL;
    int warnings = 0;

    put_scene(*state, 3, 1);
    assert_rule_refuses(*state, CLN_MISSING_FAIL, "03.png");
    put_scene(*state, 3, 3); /* a tenth of 24 is 2.4 */
    assert_rule_refuses(*state, CLN_MISSING_AUTO, "3 of 24");
    assert_int_equal(load_with(*state, CLN_MISSING_SKIP, &warnings, &scene), CLN_OK);
    assert_int_equal(scene->missing, 3);
    cln_scene_free(scene);
    put_scene(*state, 0, FRAMES);
    assert_rule_refuses(*state, CLN_MISSING_SKIP, "no training view");
}

static void keep_line(cln_log_level level, const char *line, void *user)
{
    (void)level;
    snprintf(user, 512, "%s", line);
}

static void put_broken(const char *folder)
{
    scratch_put(scratch_path(folder, "05.png"), "", 0);
    put_text(folder, "07.png", "<html>404</html>");
}

/* An image that is there and damaged counts as one that is missing. */
static void test_damage(void **state)
{
    cln_config config = default_config();
    cln_scene *scene = NULL;
    json_t *about = NULL;
    char text[512] = "";
    int warnings = 0;

    put_scene(*state, 3, 1);
    put_broken(*state);
    assert_refused(*state, &config,
                   (const char *const[3]){"2 of 24 cannot be read ('05.png', '07.png')",
                                          "05.png: empty", "--missing skip"},
                   "auto");
    put_scene(*state, 3, 0);
    put_broken(*state);
    config.missing = CLN_MISSING_FAIL;
    assert_refused(*state, &config,
                   (const char *const[3]){"05.png: empty", "'07.png'", "--missing skip"}, "fail");
    put_scene(*state, 9, 1);
    put_broken(*state);
    cln_log_to(CLN_LOG_WARN, keep_line, text);
    config.missing = CLN_MISSING_SKIP;
    assert_int_equal(try_load(*state, &config, &scene), CLN_OK);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    assert_non_null(strstr(text, "1 of 24 images is not there ('09.png'), 2 of 24 cannot be read "
                                 "('05.png', '07.png')"));
    assert_int_equal(scene->view_count, FRAMES - 3);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 3);
    assert_int_equal(cln_scene_describe(scene, &about), CLN_OK);
    assert_int_equal(json_integer_value(json_object_get(about, "missing")), 3);
    assert_int_equal(json_integer_value(json_object_get(about, "unreadable")), 2);
    assert_string_equal(
        json_string_value(json_array_get(json_object_get(about, "missing_names"), 0)), "09.png");
    json_decref(about);
    cln_scene_free(scene);
    put_scene(*state, 1, 0);
    put_broken(*state);
    assert_int_equal(load_with(*state, CLN_MISSING_SKIP, &warnings, &scene), CLN_OK);
    assert_int_equal(warnings, 1);
    assert_int_equal(scene->missing, 2);
    assert_int_equal(scene->unreadable, 2);
    cln_scene_free(scene);
}

/* Few are left out by themselves, with the reason: a PNG that is cut off and one that is empty. One
 * with bytes behind its end is whole. */
static void test_few_damaged(void **state)
{
    const char *cut = scratch_path(*state, "05.png"), *longer = scratch_path(*state, "06.png");
    cln_config config = default_config();
    cln_scene *scene = NULL;
    char text[512] = "", *data = NULL;
    size_t bytes = 0;

    put_scene(*state, 3, 0);
    assert_int_equal(cln_read_file(cut, 1 << 20, &data, &bytes), CLN_OK);
    scratch_put(cut, data, bytes - 8);
    free(data);
    assert_int_equal(cln_read_file(longer, 1 << 20, &data, &bytes), CLN_OK);
    scratch_put(longer, data, bytes + 1);
    free(data);
    scratch_put(scratch_path(*state, "07.png"), "", 0);
    cln_log_to(CLN_LOG_WARN, keep_line, text);
    assert_int_equal(try_load(*state, &config, &scene), CLN_OK);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    assert_non_null(strstr(text, ": 2 of 24 images cannot be read ('05.png', '07.png'); these "
                                 "frames are left out ("));
    assert_non_null(strstr(text, "05.png: truncated PNG"));
    assert_int_equal(scene->missing, 2);
    assert_int_equal(scene->unreadable, 2);
    cln_scene_free(scene);
    config.missing = CLN_MISSING_FAIL;
    assert_refused(*state, &config,
                   (const char *const[3]){"'05.png'", "07.png: empty", "--missing"}, "fail");
}

/* A folder that the user may not read is told as that. Root may read all, so it is another user. */
static void test_forbidden(void **state)
{
    const char *folder = *state, *images = scratch_path(folder, "images");
    const uid_t user = geteuid();
    cln_config config = default_config();

    config.holdout = 0;
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("images/a.png", POSE_FRONT) "]}");
    put_folder(folder, "images");
    put_image(folder, "images/a.png", 8, 6, 3, 0);
    assert_int_equal(chmod(folder, 0755), 0);
    assert_int_equal(chmod(images, 0), 0);
    if (user == 0)
        assert_int_equal(seteuid(65534), 0);
    assert_refused(folder, &config,
                   (const char *const[3]){"1 of 1 images is not there", "may not be read"},
                   "forbidden");
    assert_int_equal(seteuid(user), 0);
    assert_int_equal(chmod(images, 0755), 0);
}

/* A sound container with a wrong stream in it: only the decoder sees that, too late to leave the
 * frame out, and the sentence says what helps. */
static void test_damage_within(void **state)
{
    cln_config config = default_config();
    const char *path = scratch_path(*state, "06.png");
    char *data = NULL;
    size_t bytes = 0, at = 33, length = 0;

    put_scene(*state, 3, 0);
    assert_int_equal(cln_read_file(path, 1 << 20, &data, &bytes), CLN_OK);
    assert_memory_equal(data + at + 4, "IDAT", 4);
    for (int i = 0; i < 4; i++)
        length = length << 8 | (uint8_t)data[at + (size_t)i];
    data[at + 8] = 0; /* zlib knows no such method */
    for (size_t i = 0; i < 4; i++)
        data[at + 8 + length + i] =
            (char)(crc32(0, (uint8_t *)data + at + 4, (unsigned)length + 4) >> (24 - 8 * i));
    scratch_put(path, data, bytes);
    free(data);
    config.missing = CLN_MISSING_SKIP;
    assert_refused(*state, &config, (const char *const[3]){"06.png", "decoder", "remove the file"},
                   "within");
}

int test_group_missing(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_few_are_left_out, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_rules, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_damage, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_few_damaged, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_forbidden, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_damage_within, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("missing", tests, NULL, NULL);
}
