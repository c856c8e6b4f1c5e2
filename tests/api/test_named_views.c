/* eval and render of views by name (cln_eval_desc.views, cln_render_desc.views): their figures are
 * those of the whole evaluation, whose file they leave as it is, each choice has its own; and the
 * pictures are those of the named views alone. */
#include "unit.h"
#include <dirent.h>
#include <string.h>
#include "run_fixture.h"
#include "tests.h"

static cln_status measure(const char *split, const char *names, cln_eval_result *result)
{
    const cln_eval_desc desc = {.run = fixture_path("whole"),
                                .split = split,
                                .views = names,
                                .save_images = true,
                                .device = fixture_device()};

    return cln_eval(&desc, result);
}

/* Files in a folder of the group whose names begin and end so; name: gets the last one's. */
static int count_files(const char *folder, const char *begin, const char *end, char name[64])
{
    DIR *dir = opendir(fixture_path(folder));
    int count = 0;

    assert_non_null(dir);
    for (struct dirent *e = readdir(dir); e; e = readdir(dir)) {
        const size_t length = strlen(e->d_name), tail = strlen(end);

        if (length < tail || strncmp(e->d_name, begin, strlen(begin)) != 0 ||
            strcmp(e->d_name + length - tail, end) != 0)
            continue;
        snprintf(name, 64, "%.63s", e->d_name);
        count++;
    }
    closedir(dir);
    return count;
}

static void a_part_is_measured_beside_the_whole(void **state)
{
    cln_eval_result all, one, other, some;
    char *before = NULL, *after = NULL, name[64] = "", path[128];
    size_t bytes = 0, more = 0;
    json_t *document = NULL;

    NEED_DEVICE();
    assert_ok(measure("train", NULL, &all));
    assert_int_equal(all.count, TRAIN_VIEWS);
    before = scratch_get(fixture_path("whole/eval/00000030-train.json"), &bytes);
    assert_ok(measure("train", "r_4", &one));
    assert_int_equal(one.count, 1);
    assert_string_equal(one.images[0].name, all.images[4].name);
    assert_true(one.psnr == all.images[4].psnr && one.images[0].ssim == all.images[4].ssim);
    assert_int_equal(count_files("whole/eval", "00000030-train-1-", ".json", name), 1);
    snprintf(path, sizeof path, "whole/eval/%s", name);
    document = fixture_json(path);
    assert_int_equal(json_array_size(fixture_at(document, "images")), 1);
    json_decref(document);
    snprintf(path, sizeof path, "whole/eval/%.*s", (int)strlen(name) - 5, name);
    assert_int_equal(count_files(path, "train_r_4", ".truth.png", name), 1);
    /* another choice of one has its own file; the same one, called otherwise, has not */
    assert_ok(measure("train", "./train/r_1.png", &other));
    assert_int_equal(count_files("whole/eval", "00000030-train-1-", ".json", name), 2);
    cln_eval_free(&other);
    assert_ok(measure("train", "train/r_1", &other));
    assert_int_equal(count_files("whole/eval", "00000030-train-1-", ".json", name), 2);
    after = scratch_get(fixture_path("whole/eval/00000030-train.json"), &more);
    assert_int_equal(bytes, more);
    assert_memory_equal(before, after, bytes);
    /* all of them by name are the whole */
    assert_ok(measure("test", "r_1,r_0", &some));
    assert_int_equal(some.count, TEST_VIEWS);
    assert_true(cln_is_file(fixture_path("whole/eval/00000030-test.json")));
    assert_int_equal(count_files("whole/eval", "00000030-test-", ".json", name), 0);
    free(before);
    free(after);
    cln_eval_free(&all);
    cln_eval_free(&one);
    cln_eval_free(&other);
    cln_eval_free(&some);
}

static void named_views_are_rendered(void **state)
{
    cln_render_desc desc = {.run = fixture_path("whole"),
                            .out = fixture_path("named"),
                            .split = "train",
                            .views = "r_4,r_2",
                            .device = fixture_device()};
    cln_render_result result;
    char name[64] = "";

    NEED_DEVICE();
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, 2);
    assert_int_equal(count_files("named", "", ".depth.npy", name), 2);
    assert_int_equal(count_files("named", "train_r_2", ".depth.npy", name), 1);
    assert_int_equal(count_files("named", "train_r_4", ".depth.npy", name), 1);
    desc.views = NULL; /* the others follow */
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, TRAIN_VIEWS - 2);
    assert_int_equal(result.skipped, 2);
}

static void mistakes_are_told(void **state)
{
    cln_render_desc desc = {.run = fixture_path("whole"),
                            .out = fixture_path("none"),
                            .split = "train",
                            .views = "r_9",
                            .device = fixture_device()};
    cln_eval_desc eval = {.run = fixture_path("whole"), .views = "r_0", .max_images = 1};
    cln_render_result result;
    cln_eval_result measured;

    NEED_DEVICE();
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "called 'r_9'; did you mean 'train/r_0'");
    desc.views = "r_0";
    desc.max_images = 2;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--max-images cannot be combined");
    desc.max_images = 0;
    desc.split = NULL;
    desc.orbit_frames = 1;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--views: names views of a split");
    assert_fails(cln_eval(&eval, &measured), CLN_USAGE, "--max-images cannot be combined");
    assert_fails(measure("test", "r_5", &measured), CLN_USAGE, "is in the split train, not test");
}

int test_group_named_views(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_part_is_measured_beside_the_whole),
        cmocka_unit_test(named_views_are_rendered),
        cmocka_unit_test(mistakes_are_told),
    };

    return cmocka_run_group_tests_name("named_views", tests, fixture_setup, fixture_teardown);
}
