/* How many photos COLMAP looks for features in at a time, by the memory that there is
 * (api/colmap.h); which GPS positions tell how a scene is turned (api/photo_gps.h). */
#include "unit.h"
#include "api/photo_gps.h"
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

int test_group_colmap(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_fit), cmocka_unit_test(test_wide)};

    return cmocka_run_group_tests_name("colmap", tests, NULL, NULL);
}
