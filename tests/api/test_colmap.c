/* How many photos COLMAP looks for features in at a time, by the memory that there is, and what is
 * said of its focal lengths (api/colmap.h); which GPS positions tell how a scene is turned
 * (api/photo_gps.h). */
#include "unit.h"
#include <stdio.h>
#include <string.h>
#include "api/photo_gps.h"
#include "base/log.h"
#include "near.h"
#include "tests.h"

static const double GIB = 1024.0 * 1024 * 1024;

/* Photos of 12 megapixels take 2.2 GiB each, as measured by COLMAP 3.8, at its 3200 pixels. */
static void test_fit(void **state)
{
    cln_colmap_room room = cln_colmap_fit(64 * GIB, 8, 4000, 12e6);

    (void)state;
    assert_int_equal(room.threads, 0); /* all of its own threads */
    assert_int_equal(room.side, 0);
    assert_near(room.each / GIB, 2.15, 0.05);
    room = cln_colmap_fit(8 * GIB, 8, 4000, 12e6);
    assert_int_equal(room.threads, 2);
    assert_int_equal(room.side, 0);
    room = cln_colmap_fit(3.7 * GIB, 2, 4000, 12e6);
    assert_int_equal(room.threads, 1);
    assert_int_equal(room.side, 0);
    room = cln_colmap_fit(2 * GIB, 2, 4000, 12e6); /* not even one at its full size */
    assert_int_equal(room.threads, 1);
    assert_in_range(room.side, 2400, 2700);
    assert_true(room.each <= 0.8 * 2 * GIB - 200e6 && room.each > 0.7 * (0.8 * 2 * GIB - 200e6));
    room = cln_colmap_fit(0.1 * GIB, 2, 4000, 12e6);
    assert_int_equal(room.side, 640);
    room = cln_colmap_fit(2 * GIB, 2, 1000, 0.7e6); /* small ones fit as they are */
    assert_int_equal(room.threads, 0);
}

/* Which GPS positions are far enough apart. */
static void test_wide(void **state)
{
    double degrees[4][3] = {{48, 16, 300}, {48, 16.0001, 300}, {48, 16.0002, 300}, {48, NAN, NAN}};
    cln_photo_gps gps = {.count = 3, .at = degrees};

    (void)state;
    degrees[3][0] = NAN;
    assert_true(cln_photo_gps_wide(&gps, 4)); /* 15 m, along a line */
    degrees[2][1] = 16.00005;
    assert_false(cln_photo_gps_wide(&gps, 4));
    degrees[1][0] += 0.0001; /* 11 m to the north */
    assert_true(cln_photo_gps_wide(&gps, 4));
    degrees[1][0] -= 0.0001;
    degrees[1][2] += 11; /* or up */
    assert_true(cln_photo_gps_wide(&gps, 4));
    degrees[2][0] = NAN;
    assert_false(cln_photo_gps_wide(&gps, 4));
}

static void keep_line(cln_log_level level, const char *line, void *user)
{
    (void)level;
    snprintf(user, 256, "%s", line);
}

/* In pixels of the files; panoramas have none, and one width is told if all that have one share it.
 */
static void test_focal_length(void **state)
{
    const cln_view sphere = {.camera = {.lens = CLN_LENS_EQUIRECTANGULAR, .width = 80, .fx = 12.7},
                             .file_width = 80},
                   half = {.camera = {.width = 100, .fx = 90}, .file_width = 200},
                   whole = {.camera = {.width = 200, .fx = 220}, .file_width = 200},
                   wide = {.camera = {.width = 300, .fx = 220}, .file_width = 300};
    const struct {
        cln_view views[3];
        int count;
        const char *said;
    } rows[] = {
        {{half, whole}, 2, "180 to 220 pixels, of photos 200 pixels wide"},
        {{sphere, half, sphere}, 3, "180 pixels, of photos 200 pixels wide"},
        {{whole, wide}, 2, "220 pixels"},
        {{whole, wide, whole}, 3, "220 pixels"},
        {{sphere, sphere}, 2, NULL},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char text[256] = "";
        cln_view views[3];
        const cln_scene scene = {.views = views, .view_count = rows[i].count};
        const char *said = NULL;

        memcpy(views, rows[i].views, sizeof views);
        cln_log_set_sink(keep_line, text);
        cln_colmap_say_focal_length(&(cln_colmap){0}, &scene);
        cln_log_set_sink(NULL, NULL);
        said = strstr(text, "focal length: ");
        if (rows[i].said ? !said || strcmp(said + 14, rows[i].said) != 0 : *text)
            fail_msg("row %zu: '%s'", i, text);
    }
}

int test_group_colmap(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_fit), cmocka_unit_test(test_wide),
                                       cmocka_unit_test(test_focal_length)};

    return cmocka_run_group_tests_name("colmap", tests, NULL, NULL);
}
