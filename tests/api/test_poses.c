/* What cln_find_poses says of photos before COLMAP works, and of the focal length that it found. */
#include "unit.h"
#include <stdlib.h>
#include "api/colmap.h"
#include "base/log.h"
#include "cl_nascent.h"
#include "io/image.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

static void put_photo(const char *folder, const char *name, int width, int height)
{
    uint8_t *pixels = calloc((size_t)(width * height), 3);
    const char *path = scratch_path(folder, name);

    assert_non_null(pixels);
    assert_ok(cln_image_write_png(path, width, height, 3, pixels));
    free(pixels);
}

/* Without a COLMAP, so that nothing more is done than to look at the photos. */
static void look_at_for(const char *folder, const char *out, cln_warned *warned)
{
    const char *path = getenv("PATH");
    char *before = path ? strdup(path) : NULL;
    const cln_poses_desc desc = {.photos = folder, .out = out};
    cln_poses_result result;

    cln_log_set_sink(NULL, NULL);
    setenv("PATH", "/nowhere", 1);
    cln_warned_open(warned);
    assert_fails(cln_find_poses(&desc, &result), CLN_FAILED, "COLMAP, which is not installed");
    if (before)
        setenv("PATH", before, 1);
    free(before);
}

static void look_at(const char *folder, cln_warned *warned)
{
    look_at_for(folder, scratch_path(folder, "../posed"), warned);
}

/* Of the scene's own photos, which are all looked at, it is said that they should not be there. */
static void sweeps_in_place_are_told(void **state)
{
    const char *images = scratch_path(*state, "images");
    cln_warned warned;

    assert_ok(cln_make_dirs(images));
    for (int i = 0; i < 8; i++) {
        char name[32];

        snprintf(name, sizeof name, "photo_%d.png", i);
        put_photo(images, name, i ? 40 : 90, 30);
    }
    look_at_for(images, *state, &warned);
    assert_int_equal(warned.count, 1);
    assert_non_null(
        strstr(warned.lines[0], ": 1 photo far longer than the others (photo_0.png): "));
    assert_non_null(strstr(warned.lines[0], "; move them out of the folder"));
    cln_warned_close(&warned);
}

static void sweeps_of_a_phone_are_left_out(void **state)
{
    for (int longer = 2; longer <= 4; longer++) {
        char name[32];
        cln_warned warned;

        for (int i = 0; i < 8; i++) {
            snprintf(name, sizeof name, "photo_%d.png", i);
            put_photo(*state, name, i % 2 ? 60 : 30, i % 2 ? 30 : 60); /* 2 : 1 is no sweep */
        }
        for (int i = 0; i < longer; i++) {
            snprintf(name, sizeof name, "wide_%d.png", i);
            put_photo(*state, name, i % 2 ? 20 : 60, i % 2 ? 60 : 20);
        }
        look_at(*state, &warned);
        assert_int_equal(warned.count, longer <= 2); /* more than a quarter are no exception */
        if (longer == 2)
            assert_non_null(strstr(warned.lines[0], ": 2 photos far longer than the others are "
                                                    "left out (wide_0.png, ...)"));
        cln_warned_close(&warned);
    }
}

/* A camera's raw files, and a phone's HEIC files, are the photos that are read once more. */
static void twins_of_photos_are_not_missed(void **state)
{
    cln_warned warned;

    put_photo(*state, "DSCF1.png", 40, 30);
    put_photo(*state, "DSCF2.png", 40, 30);
    put_photo(*state, "DSCF3.png", 40, 30);
    scratch_put(scratch_path(*state, "DSCF1.DNG"), "raw", 3);
    scratch_put(scratch_path(*state, "dscf2.heic"), "raw", 3);
    look_at(*state, &warned);
    assert_int_equal(warned.count, 0);
    cln_warned_close(&warned);
    scratch_put(scratch_path(*state, "DSCF.dng"), "raw", 3);
    scratch_put(scratch_path(*state, "DSCF11.dng"), "raw", 3);
    look_at(*state, &warned);
    assert_int_equal(warned.count, 1);
    assert_non_null(strstr(warned.lines[0], ": 2 photos in formats that are not read are left out "
                                            "(the first is 'DSCF.dng')"));
    cln_warned_close(&warned);
}

/* COLMAP's focal length beside that of EXIF data; not where there are several, as of a zoom. */
static void focal_lengths_are_compared(void **state)
{
    static const struct {
        double told[2], found[2];
        const char *warning;
    } cases[] = {{{266, 266}, {257, 257}, NULL},   {{266, 266}, {446, 446}, "1.7 times"},
                 {{213, 213}, {127, 127}, "0.6 "}, {{266, 266}, {257, 361}, NULL},
                 {{200, 300}, {446, 446}, NULL},   {{266, 266}, {342, 342}, NULL},
                 {{0, 0}, {446, 446}, NULL}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_view views[2] = {
            {.file_width = 600, .camera = {.width = 300, .fx = cases[i].found[0] / 2}},
            {.file_width = 600, .camera = {.width = 300, .fx = cases[i].found[1] / 2}}};
        const cln_scene scene = {.views = views, .view_count = 2};
        const cln_colmap c = {.focal_lengths = cases[i].told[0] > 0 ? 2 : 0,
                              .focal_least = cases[i].told[0],
                              .focal_most = cases[i].told[1]};
        cln_warned warned;

        cln_warned_open(&warned);
        cln_colmap_say_focal_length(&c, &scene);
        assert_int_equal(warned.count, cases[i].warning != NULL);
        if (cases[i].warning)
            assert_non_null(strstr(warned.lines[0], cases[i].warning));
        cln_warned_close(&warned);
    }
}

int test_group_poses(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(sweeps_of_a_phone_are_left_out, scratch_make,
                                        scratch_remove),
        cmocka_unit_test_setup_teardown(sweeps_in_place_are_told, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(twins_of_photos_are_not_missed, scratch_make,
                                        scratch_remove),
        cmocka_unit_test(focal_lengths_are_compared)};

    return cmocka_run_group_tests_name("poses", tests, NULL, NULL);
}
