/* Photos whose EXIF data tell viewers to turn them (io/exif.h, scene/turned.c): what is read of the
 * data, how pixels are turned, and which photos of a scene are. Oracle: the standard's words on
 * where the stored picture's first row and column belong, on pictures of few pixels. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <jansson.h>
#include "exif_fixture.h"
#include "format_fixture.h"
#include "io/exif.h"
#include "scene/inspect.h"
#include "tests.h"

/* ---- the data ---- */

static void test_exif(void **state)
{
    (void)state;
    for (int little = 0; little < 2; little++)
        for (int o = 0; o <= 9; o++) {
            uint8_t data[EXIF_BYTES];

            exif_write(data, little, o);
            assert_int_equal(cln_exif_orientation(data, sizeof data), o >= 1 && o <= 8 ? o : 1);
        }
}

/* Cut at every byte, in memory of just that size, and with every byte changed: it reads nothing
 * beyond the data (the sanitizers tell) and gives a number from 1 to 8. */
static void test_damaged_exif(void **state)
{
    static const int last = 6 + 10 + 12 + 9; /* byte of the data that tells it */
    uint8_t data[EXIF_BYTES];

    (void)state;
    for (size_t bytes = 0; bytes <= EXIF_BYTES; bytes++) {
        uint8_t *cut = malloc(bytes + !bytes);

        assert_non_null(cut);
        exif_write(data, true, 6);
        memcpy(cut, data, bytes);
        assert_int_equal(cln_exif_orientation(cut, bytes), bytes > (size_t)last + 2 ? 6 : 1);
        free(cut);
    }
    for (size_t at = 0; at < EXIF_BYTES; at++)
        for (int value = 0; value < 256; value++) {
            uint8_t *changed = malloc(EXIF_BYTES);

            assert_non_null(changed);
            exif_write(changed, true, 6);
            changed[at] = (uint8_t)value;
            assert_in_range(cln_exif_orientation(changed, EXIF_BYTES), 1, 8);
            free(changed);
        }
}

/* ---- turning ---- */

/* The picture 0 1 2 / 3 4 5, turned. */
static void test_turn(void **state)
{
    static const int8_t turned[9][6] = {
        [1] = {0, 1, 2, 3, 4, 5}, [2] = {2, 1, 0, 5, 4, 3}, [3] = {5, 4, 3, 2, 1, 0},
        [4] = {3, 4, 5, 0, 1, 2}, [5] = {0, 3, 1, 4, 2, 5}, [6] = {3, 0, 4, 1, 5, 2},
        [7] = {5, 2, 4, 1, 3, 0}, [8] = {2, 5, 1, 4, 0, 3}};

    (void)state;
    for (int o = 1; o <= 8; o++)
        for (int channels = 3; channels <= 4; channels++) {
            uint8_t *pixels = malloc((size_t)(6 * channels));
            int width = 3, height = 2;

            assert_non_null(pixels);
            for (int i = 0; i < 6 * channels; i++)
                pixels[i] = (uint8_t)(10 * (i / channels) + i % channels);
            assert_int_equal(cln_image_turn(o, &width, &height, channels, &pixels), CLN_OK);
            assert_int_equal(width, o < 5 ? 3 : 2);
            assert_int_equal(height, o < 5 ? 2 : 3);
            for (int i = 0; i < 6 * channels; i++)
                if (pixels[i] != 10 * turned[o][i / channels] + i % channels)
                    fail_msg("orientation %d, value %d: %d", o, i, pixels[i]);
            free(pixels);
        }
}

/* ---- scenes ---- */

/* A photo whose stored picture is dark in its upper left quarter. */
static void put_photo(const char *folder, int view, int width, int height, int orientation)
{
    uint8_t *pixels = malloc((size_t)(width * height * 3)), *jpeg = NULL;
    char name[32], *path = NULL;
    size_t bytes = 0;

    assert_non_null(pixels);
    for (int i = 0; i < width * height; i++)
        memset(pixels + 3 * i, i % width < width / 2 && i / width < height / 2 ? 20 : 230, 3);
    jpeg = exif_jpeg(width, height, pixels, orientation, &bytes);
    assert_non_null(jpeg);
    snprintf(name, sizeof name, "view_%02d.jpg", view);
    assert_int_equal(cln_make_dirs(folder), CLN_OK);
    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    scratch_put(path, (const char *)jpeg, bytes);
    free(path);
    free(jpeg);
    free(pixels);
}

/* A transforms file whose cameras have such a size, the images in the folder itself. */
static void put_transforms(const char *folder, int width, int height)
{
    cln_camera cameras[FORMAT_VIEWS];
    FILE *f = format_open(folder, "transforms.json");

    format_cameras(cameras);
    fprintf(f, "{\"fl_x\": 20, \"w\": %d, \"h\": %d, \"frames\": [", width, height);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const double *m = cameras[v].c2w;

        fprintf(f, "%s{\"file_path\": \"view_%02d.jpg\", \"transform_matrix\": [", v ? "," : "", v);
        for (int row = 0; row < 3; row++) /* OpenGL's axes */
            fprintf(f, "[%.17g,%.17g,%.17g,%.17g],", m[4 * row], -m[4 * row + 1], -m[4 * row + 2],
                    m[4 * row + 3]);
        fprintf(f, "[0,0,0,1]]}");
    }
    fprintf(f, "]}");
    fclose(f);
}

/* The quarter of a view's pixels that is dark: 0 upper left, 1 upper right, 2 and 3 below. */
static int dark_quarter(const cln_scene *scene, int view)
{
    const cln_view *v = &scene->views[view];

    for (int k = 0; k < 4; k++) {
        const int x = (k % 2 ? 3 : 1) * v->camera.width / 4;
        const int y = (k / 2 ? 3 : 1) * v->camera.height / 4;

        if (v->pixels[3 * (y * v->camera.width + x)] < 128)
            return k;
    }
    return -1;
}

/* The number of findings about orientations, and whether their texts have a word. */
static int findings_of(const cln_scene *scene, const char *word)
{
    json_t *all = NULL;
    int count = 0;

    assert_int_equal(cln_scene_inspect(scene, &all), CLN_OK);
    for (size_t i = 0; i < json_array_size(json_object_get(all, "findings")); i++) {
        const json_t *one = json_array_get(json_object_get(all, "findings"), i);

        if (strcmp(json_string_value(json_object_get(one, "what")), "orientation") != 0)
            continue;
        count++;
        if (!strstr(json_string_value(json_object_get(one, "text")), word))
            fail_msg("'%s' lacks '%s'", json_string_value(json_object_get(one, "text")), word);
    }
    json_decref(all);
    return count;
}

/* A quarter turn by which photos have the shape of their cameras or lose it; half turns and
 * mirrors, which follow these; and photos of which nothing is known. */
static void test_scenes(void **state)
{
    static const struct {
        const char *name;
        int width, height, orientation; /* of photo 0; camera 16 x 12 */
        int others;                     /* orientation of the other photos, of 16 x 12 */
        int first, rest;                /* dark quarters */
        int warnings;
        const char *told;
    } cases[] = {
        {"none", 16, 12, 1, 0, 0, 0, 0, NULL},
        {"stored", 16, 12, 6, 0, 0, 0, 0, "taken as stored, as the poses are of these"},
        {"right", 12, 16, 6, 0, 1, 0, 0, "turned as EXIF data say"},
        {"left", 12, 16, 8, 0, 2, 0, 0, "turned as EXIF data say"},
        {"half", 16, 12, 3, 0, 0, 0, 1, "mogrify -auto-orient"},
        {"mirrored", 16, 12, 2, 0, 0, 0, 1, "mogrify -auto-orient"},
        {"all turned", 12, 16, 6, 3, 1, 3, 0, "turned as EXIF data say"},
        {"all stored", 16, 12, 6, 3, 0, 0, 0, "taken as stored, as the poses are of these"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].name);
        cln_scene *scene = NULL;
        int warnings = 0;

        put_photo(folder, 0, cases[i].width, cases[i].height, cases[i].orientation);
        for (int v = 1; v < FORMAT_VIEWS; v++)
            put_photo(folder, v, 16, 12, cases[i].others);
        put_transforms(folder, 16, 12);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        cln_scene_warn_doubts(scene);
        print_message("    %s\n", cases[i].name);
        assert_int_equal(warnings, cases[i].warnings);
        assert_int_equal(dark_quarter(scene, 0), cases[i].first);
        for (int v = 1; v < FORMAT_VIEWS; v++)
            assert_int_equal(dark_quarter(scene, v), cases[i].rest);
        assert_true(scene->views[0].file_width == 16 && scene->views[0].file_height == 12);
        assert_int_equal(findings_of(scene, cases[i].told ? cases[i].told : ""),
                         cases[i].told != NULL);
        cln_scene_free(scene);
    }
}

/* COLMAP's poses are of stored pixels: a half turn is no doubt. */
static void test_colmap(void **state)
{
    const char *folder = *state, *images = scratch_path(folder, "sparse/0/images.txt");
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;
    size_t bytes = 0;
    char *text = NULL;
    int warnings = 0;

    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        put_photo(scratch_path(folder, "images"), v, 16, 12, 3);
    format_colmap(scratch_path(folder, "sparse/0"), false, cameras, NULL, NULL, 0);
    text = scratch_get(images, &bytes);
    for (char *at = strstr(text, ".png"); at; at = strstr(at, ".png"))
        memcpy(at, ".jpg", 4);
    scratch_put(images, text, bytes);
    free(text);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    scene = load(folder, plain());
    cln_scene_warn_doubts(scene);
    assert_int_equal(warnings, 0);
    assert_int_equal(dark_quarter(scene, 2), 0);
    assert_int_equal(findings_of(scene, "taken as stored, as the poses are of these"), 1);
    cln_scene_free(scene);
}

/* Swapped sides that no EXIF data explain; the second, of half a turn, does not, either. */
static void test_refused(void **state)
{
    const char *folder = *state;
    static const int orientations[] = {0, 3};

    for (int i = 0; i < 2; i++) {
        for (int v = 0; v < FORMAT_VIEWS; v++)
            put_photo(folder, v, 12, 16, orientations[i]);
        put_transforms(folder, 16, 12);
        assert_refused(folder, plain(),
                       (const char *const[3]){"12 x 16", "sides are swapped", "turn its pixels"},
                       "swapped");
    }
}

int test_group_orientation(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_exif),
        cmocka_unit_test(test_damaged_exif),
        cmocka_unit_test(test_turn),
        cmocka_unit_test_setup_teardown(test_scenes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refused, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("orientation", tests, NULL, NULL);
}
