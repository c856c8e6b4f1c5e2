/* Views by the names of their photos (host/render/named.h), on a list of views made by hand: what a
 * name may be, several that share one, commas, splits, and what is said of names that are not
 * there. */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include "outcome.h"
#include "render/named.h"
#include "tests.h"

static cln_view views[] = {
    {.name = "images/left/IMG_1001.JPG",
     .path = "/s/images/left/IMG_1001.JPG",
     .file = "images_left_IMG_1001",
     .split = CLN_SPLIT_TEST},
    {.name = "images/left/IMG_1002.JPG",
     .path = "/s/images/left/IMG_1002.JPG",
     .file = "images_left_IMG_1002",
     .split = CLN_SPLIT_TRAIN},
    {.name = "images/right/IMG_1001.JPG",
     .path = "/s/images/right/IMG_1001.JPG",
     .file = "images_right_IMG_1001",
     .split = CLN_SPLIT_TEST},
    {.name = "./test/r_12",
     .path = "/s/./test/r_12.png",
     .file = "test_r_12",
     .split = CLN_SPLIT_TEST},
    {.name = "frame.0001",
     .path = "/s/images/frame.0001.png",
     .file = "frame.0001",
     .split = CLN_SPLIT_TEST},
    {.name = "a, b.png", .path = "/elsewhere/a, b.png", .file = "a, b", .split = CLN_SPLIT_TEST},
    {.name = "b.png", .path = "/s/b.png", .file = "b", .split = CLN_SPLIT_TEST},
};
static const cln_scene scene = {
    .path = "/s", .folder = "/s", .views = views, .view_count = sizeof views / sizeof *views};

static void names_are_found(void **state)
{
    static const struct {
        const char *names;
        unsigned chosen; /* a bit for each view */
    } rows[] = {
        {"images/left/IMG_1001.JPG", 1},
        {"images/left/IMG_1001", 1},
        {"images_left_IMG_1001", 1}, /* as its pictures are called */
        {"./images/left/IMG_1001.JPG", 1},
        {"/s/images/left/IMG_1001.JPG", 1}, /* as a shell completes it */
        {"IMG_1001.JPG", 1 | 4},
        {"IMG_1001", 1 | 4},
        {"r_12", 8},
        {"r_12.png", 8},
        {"test/r_12", 8},
        {"test/r_12.png", 8},
        {"frame.0001", 16},
        {"frame.0001.png", 16},
        {"b", 64},
        {"a, b", 32}, /* a name with a comma */
        {"b.png,a, b.png,r_12", 8 | 32 | 64},
        {"r_12, IMG_1001,r_12,test/r_12", 1 | 4 | 8},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        int *list = NULL, count = 0;
        unsigned chosen = 0;

        assert_ok(cln_views_choose(&scene, CLN_SPLIT_TEST, rows[i].names, 0, &list, &count));
        for (int k = 0; k < count; k++) {
            assert_true(k == 0 || list[k] > list[k - 1]);
            chosen |= 1u << list[k];
        }
        if (chosen != rows[i].chosen)
            fail_msg("%s: views %#x, not %#x", rows[i].names, chosen, rows[i].chosen);
        free(list);
    }
}

static void others_are_not(void **state)
{
    static const struct {
        const char *names, *words;
    } rows[] = {
        {"IMG_1002", "'IMG_1002' is in the split train, not test; give --split train"},
        {"r_12,IMG_101", "called 'IMG_101'; did you mean 'images/left/IMG_1001.JPG', 'images/right/"
                         "IMG_1001.JPG'?"},
        {"images/left/IMG_100", "did you mean 'images/left/IMG_1001.JPG'"},
        {"r_21", "did you mean 'test/r_12'?"},
        {"nothing like it", "'nothing like it'; it has 'images/left/IMG_1001.JPG', 'images/right/"
                            "IMG_1001.JPG', 'test/r_12', ..."},
        {"img_1001.jpg", "'img_1001.jpg'"},
        {"", "a name is empty"},
        {"r_12,,b", "a name is empty"},
        {"r_12,", "a name is empty"},
        {"IMG", "'IMG'"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        int *list = NULL, count = 0;

        assert_fails(cln_views_choose(&scene, CLN_SPLIT_TEST, rows[i].names, 0, &list, &count),
                     CLN_USAGE, rows[i].words);
        free(list);
    }
    assert_fails(cln_views_check("b", 1), CLN_USAGE, "--max-images cannot be combined");
    assert_ok(cln_views_check("b", 0));
    assert_ok(cln_views_check(NULL, 3));
}

int test_group_named(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_are_found),
        cmocka_unit_test(others_are_not),
    };

    return cmocka_run_group_tests_name("named", tests, NULL, NULL);
}
