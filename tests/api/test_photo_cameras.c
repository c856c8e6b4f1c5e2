/* Which photos are panoramas, by what they say of themselves and by their shape, and which are two
 * circles side by side (api/photo_cameras.h). Oracle: how they were made. */
#include "unit.h"
#include <math.h>
#include "api/photo_cameras.h"
#include "io/image.h"
#include "scratch.h"
#include "tests.h"

enum { WIDTH = 400, HEIGHT = 200 };

/* EXIF data of a focal length in tenths of mm, on 35 mm film if `film`; then, if xmp, XMP data. */
static void put_photo(const char *path, int width, int height, int tenths, bool film,
                      const char *xmp)
{
    static const char name[] = "http://ns.adobe.com/xap/1.0/";
    uint8_t *pixels = calloc((size_t)(width * height), 3), *jpeg = NULL, head[512] = {0};
    /* a TIFF with a directory that has the place of another, with the focal length */
    uint8_t tiff[70] = {'I', 'I', 42, 0, 8,  0, 0, 0, 1, 0, 0x69, 0x87, 4, 0,
                        1,   0,   0,  0, 26, 0, 0, 0, 0, 0, 0,    0,    1, 0};
    size_t bytes = 0, used = 0, length = 0;
    char *all = NULL;

    assert_non_null(pixels);
    assert_int_equal(cln_image_encode_jpeg(width, height, 3, pixels, 80, &jpeg, &bytes), CLN_OK);
    if (tenths) {
        const uint8_t of_film[12] = {0x05, 0xA4, 3, 0, 1, 0, 0, 0, (uint8_t)(tenths / 10)};
        const uint8_t of_lens[12] = {0x0A, 0x92, 5, 0, 1, 0, 0, 0, 50};

        memcpy(tiff + 28, film ? of_film : of_lens, 12);
        tiff[50] = (uint8_t)tenths;
        tiff[54] = 10;
        memcpy(head,
               "\xFF\xE1\0\x4E"
               "Exif\0\0",
               10);
        memcpy(head + 10, tiff, sizeof tiff);
        used = 80;
    }
    if (xmp) {
        length = sizeof name + strlen(xmp);
        memcpy(head + used, "\xFF\xE1", 2);
        head[used + 3] = (uint8_t)(length + 2);
        memcpy(head + used + 4, name, sizeof name);
        memcpy(head + used + 4 + sizeof name, xmp, strlen(xmp));
        used += 4 + length;
    }
    all = malloc(bytes + used);
    assert_non_null(all);
    memcpy(all, jpeg, 2);
    memcpy(all + 2, head, used);
    memcpy(all + 2 + used, jpeg + 2, bytes - 2);
    scratch_put(path, all, bytes + used);
    free(all);
    free(jpeg);
    free(pixels);
}

static void find(const char *folder, cln_names *names, cln_photo_cameras *out)
{
    assert_int_equal(cln_dataset_images(folder, names), CLN_OK);
    assert_int_equal(cln_photo_cameras_find(folder, names, out), CLN_OK);
}

#define SPHERE "GPano:ProjectionType=\"equirectangular\""
#define PART   " GPano:FullPanoHeightPixels=\"9\" GPano:CroppedAreaImageHeightPixels=\"5\""

static void test_panoramas(void **state)
{
    static const struct {
        int width, height, tenths;
        bool film;
        const char *xmp;
        bool sphere, told, cut;
    } cases[] = {
        {64, 32, 0, false, NULL, true, false, false},
        {64, 32, 10, false, NULL, true, false, false}, /* as such cameras have */
        {64, 32, 14, false, NULL, true, false, false},
        {64, 32, 15, false, NULL, false, false, false}, /* as phones have */
        {64, 32, 30, false, NULL, false, false, false},
        {64, 32, 70, true, NULL, true, false, false}, /* no lens of one picture, on film */
        {64, 32, 100, true, NULL, false, false, false},
        {64, 32, 260, true, NULL, false, false, false},
        {64, 33, 0, false, NULL, false, false, false},
        {64, 32, 30, false, SPHERE, true, true, false}, /* a large sensor's */
        {64, 32, 260, true, SPHERE, true, true, false},
        {64, 32, 0, false, SPHERE PART, false, false, true},
        {64, 20, 0, false, SPHERE, false, false, true}, /* by its shape */
        {64, 33, 0, false, SPHERE, true, true, false},  /* rounded */
        {64, 34, 0, false, SPHERE, false, false, true},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_names names = {0};
        cln_photo_cameras found = {0};

        put_photo(scratch_path(*state, "a.jpg"), cases[i].width, cases[i].height, cases[i].tenths,
                  cases[i].film, cases[i].xmp);
        find(*state, &names, &found);
        if (found.sphere[0] != cases[i].sphere || found.panoramas != cases[i].sphere ||
            found.told != cases[i].told || found.cuts != cases[i].cut ||
            found.guessed != (cases[i].sphere && !cases[i].told ? 0 : -1))
            fail_msg("case %zu", i);
        cln_photo_cameras_free(&found);
        cln_dataset_free_names(&names);
    }
}

/* Panoramas beside photos of their size are another camera's. */
static void test_mix(void **state)
{
    cln_names names = {0};
    cln_photo_cameras found = {0};

    put_photo(scratch_path(*state, "a.jpg"), 64, 32, 30, false, NULL);
    put_photo(scratch_path(*state, "b.jpg"), 64, 32, 30, false, SPHERE);
    put_photo(scratch_path(*state, "c.jpg"), 64, 32, 30, false, NULL);
    put_photo(scratch_path(*state, "d.jpg"), 64, 32, 30, false, SPHERE PART);
    find(*state, &names, &found);
    assert_int_equal(found.count, 2);
    assert_int_equal(found.camera[2], found.camera[0]);
    assert_true(found.camera[1] != found.camera[0] && found.sphere[found.camera[1]]);
    assert_false(found.sphere[found.camera[0]]);
    assert_int_equal(found.panoramas, 1);
    assert_int_equal(found.cuts, 1);
    assert_int_equal(found.cut, 3);
    cln_photo_cameras_free(&found);
    cln_dataset_free_names(&names);
}

/* The photos that a message names are the first ones. */
static void test_first_are_named(void **state)
{
    cln_names names = {0};
    cln_photo_cameras found = {0};

    for (int i = 0; i < 5; i++) {
        const char name[] = {(char)('a' + i), '.', 'j', 'p', 'g', 0};

        put_photo(scratch_path(*state, name), 64, i == 0 ? 48 : 32, 0, false,
                  i == 0 || i % 2 ? NULL : SPHERE PART);
    }
    find(*state, &names, &found);
    assert_int_equal(found.guessed, 1);
    assert_int_equal(found.cut, 2);
    assert_int_equal(found.panoramas, 2);
    assert_int_equal(found.cuts, 2);
    cln_photo_cameras_free(&found);
    cln_dataset_free_names(&names);
}

/* A camera has photos of one size, both ways, and of one focal length but for rounding. */
static void test_cameras(void **state)
{
    static const struct {
        int width, height, mm, cameras;
        bool sizes, lengths;
        int longest;
    } cases[] = {
        {64, 48, 20, 1, false, false, 64}, {64, 40, 20, 2, true, false, 64},
        {48, 64, 20, 2, true, false, 64},  {40, 80, 20, 2, true, false, 80},
        {64, 48, 22, 2, false, true, 64},  {64, 48, 0, 2, false, true, 64},
    };
    cln_photo_cameras found = {0};
    cln_names names = {0};

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_photo(scratch_path(*state, "a.jpg"), 64, 48, 200, true, NULL);
        put_photo(scratch_path(*state, "b.jpg"), cases[i].width, cases[i].height, 10 * cases[i].mm,
                  true, NULL);
        find(*state, &names, &found);
        if (found.count != cases[i].cameras || found.sizes != cases[i].sizes ||
            found.lengths != cases[i].lengths || found.longest != cases[i].longest)
            fail_msg("case %zu", i);
        cln_photo_cameras_free(&found);
        cln_dataset_free_names(&names);
    }
    put_photo(scratch_path(*state, "a.jpg"), 64, 48, 2000, true, NULL); /* mm: 200 and 203 */
    put_photo(scratch_path(*state, "b.jpg"), 64, 48, 2030, true, NULL);
    find(*state, &names, &found);
    assert_int_equal(found.count, 1);
    cln_photo_cameras_free(&found);
    cln_dataset_free_names(&names);
}

/* COLMAP takes spaces around a line away, and ends a name where one ends. */
static void test_names_for_lists(void **state)
{
    static const struct {
        char *name;
        bool is;
    } cases[] = {{"a b.jpg", true}, {" a.jpg", false}, {"a.jpg ", false}, {"a\nb.jpg", false}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char *both[] = {"a.jpg", cases[i].name};
        const cln_names names = {.name = both, .count = 2};

        assert_int_equal(cln_photo_cameras_listable(&names), cases[i].is);
    }
}

/* Two circles of radius `radius` (of the height) on black; else a picture all over, in which rows
 * to `bar` and from its other side are black. */
static bool has_circles(const char *path, double radius, double bar)
{
    uint8_t *pixels = malloc((size_t)WIDTH * HEIGHT);
    bool circles = false;

    assert_non_null(pixels);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const double u = (x % HEIGHT + 0.5) / HEIGHT - 0.5, v = (y + 0.5) / HEIGHT - 0.5;
            const bool in = radius > 0 ? hypot(u, v) < radius : fabs(v) < 0.5 - bar;

            pixels[y * WIDTH + x] = (uint8_t)(in ? 100 + (x * 7 + y * 13) % 60 : 4);
        }
    assert_int_equal(cln_image_write_png(path, WIDTH, HEIGHT, 1, pixels), CLN_OK);
    assert_int_equal(cln_photo_has_circles(path, &circles), CLN_OK);
    free(pixels);
    return circles;
}

static void test_circles(void **state)
{
    const char *path = scratch_path(*state, "a.png");

    assert_true(has_circles(path, 0.5, 0));
    assert_true(has_circles(path, 0.45, 0));
    assert_false(has_circles(path, 0, 0));
    assert_false(has_circles(path, 0, 0.05));
    assert_false(has_circles(path, 0, 0.2)); /* what was cut off is black */
    assert_false(has_circles(path, 0, 0.5));
    assert_false(has_circles(path, 1, 0));
}

/* A photo with EXIF data of 26 mm on 35 mm film and a digital zoom in tenths. */
static void put_zoomed(const char *path, uint8_t tenths)
{
    uint8_t head[10 + 76] = "\xFF\xE1\0\x54"
                            "Exif\0\0"
                            "II*\0\b\0\0\0\1\0\x69\x87\4\0\1\0\0\0\x1A\0\0\0\0\0\0\0"
                            "\2\0\4\xA4\5\0\1\0\0\0\x44\0\0\0"
                            "\5\xA4\3\0\1\0\0\0\x1A\0\0\0";
    uint8_t pixels[3 * 64 * 48] = {0}, *jpeg = NULL, all[8192];
    size_t bytes = 0;

    head[10 + 0x44] = tenths;
    head[10 + 0x48] = 10;
    assert_int_equal(cln_image_encode_jpeg(64, 48, 3, pixels, 80, &jpeg, &bytes), CLN_OK);
    assert_true(bytes + sizeof head <= sizeof all);
    memcpy(all, jpeg, 2);
    memcpy(all + 2, head, sizeof head);
    memcpy(all + 2 + sizeof head, jpeg + 2, bytes - 2);
    scratch_put(path, all, bytes + sizeof head);
    free(jpeg);
}

/* Phones leave their digital zoom out of the focal lengths: it makes a camera of its own. */
static void digital_zoom_makes_a_camera(void **state)
{
    static const uint8_t zoom[] = {10, 0, 16, 16, 10, 30};
    static const int camera[] = {0, 0, 1, 1, 0, 2};
    cln_names names = {0};
    cln_photo_cameras found;

    for (int i = 0; i < 6; i++) {
        char name[16];

        snprintf(name, sizeof name, "%d.jpg", i);
        put_zoomed(scratch_path(*state, name), zoom[i]);
    }
    find(*state, &names, &found);
    assert_int_equal(found.count, 3);
    assert_true(found.lengths);
    for (int i = 0; i < 6; i++)
        assert_int_equal(found.camera[i], camera[i]);
    cln_photo_cameras_free(&found);
    cln_dataset_free_names(&names);
}

/* Two circles, and a patch of other brightness in one of them: in a corner, or in its middle, above
 * or below. */
static bool with_patch(const char *path, int half, double x, bool below, uint8_t value)
{
    uint8_t *pixels = NULL;
    int width = 0, height = 0, channels = 0;
    bool circles = false;

    assert_true(has_circles(path, 0.5, 0));
    assert_int_equal(cln_image_load(path, &width, &height, &channels, &pixels), CLN_OK);
    for (int v = 0; v < HEIGHT; v++)
        for (int u = half * HEIGHT; u < (half + 1) * HEIGHT; u++)
            if (fabs((u % HEIGHT + 0.5) / HEIGHT - x) < 0.08 && (v > HEIGHT / 2) == below)
                memset(pixels + (size_t)(v * WIDTH + u) * (size_t)channels, value,
                       (size_t)channels);
    assert_int_equal(cln_image_write_png(path, WIDTH, HEIGHT, channels, pixels), CLN_OK);
    assert_int_equal(cln_photo_has_circles(path, &circles), CLN_OK);
    free(pixels);
    return circles;
}

/* Of either circle, each of the four corners is black, and the middle bright above and below. */
static void test_circles_all_round(void **state)
{
    const char *path = scratch_path(*state, "a.png");

    for (int half = 0; half < 2; half++)
        for (int below = 0; below < 2; below++) {
            if (with_patch(path, half, 0, below, 200) || with_patch(path, half, 1, below, 200) ||
                with_patch(path, half, 0.5, below, 4))
                fail_msg("half %d, below %d", half, below);
            assert_true(with_patch(path, half, 0.5, below, 200));
        }
}

int test_group_photo_cameras(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_panoramas, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_mix, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(digital_zoom_makes_a_camera, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_first_are_named, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_cameras, scratch_make, scratch_remove),
        cmocka_unit_test(test_names_for_lists),
        cmocka_unit_test_setup_teardown(test_circles, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_circles_all_round, scratch_make, scratch_remove)};

    return cmocka_run_group_tests_name("photo_cameras", tests, NULL, NULL);
}
