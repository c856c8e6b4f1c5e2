/* Photos whose EXIF data tell viewers to turn them (io/exif.h, scene/turned.c): what is read of the
 * data, how pixels are turned, which photos of a scene are, and their masks with them; and as what
 * people see the others. Oracle: the standard's words on where the stored picture's first row and
 * column belong, on pictures of few pixels. */
#include "unit.h"
#include <jansson.h>
#include "exif_fixture.h"
#include "near.h"
#include "format_fixture.h"
#include "io/exif.h"
#include "scene/build.h"
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
            assert_int_equal(cln_exif_read(data, sizeof data).orientation,
                             o >= 1 && o <= 8 ? o : 1);
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
        assert_int_equal(cln_exif_read(cut, bytes).orientation, bytes > (size_t)last + 2 ? 6 : 1);
        free(cut);
    }
    for (size_t at = 0; at < EXIF_BYTES; at++)
        for (int value = 0; value < 256; value++) {
            uint8_t *changed = malloc(EXIF_BYTES);

            assert_non_null(changed);
            exif_write(changed, true, 6);
            changed[at] = (uint8_t)value;
            assert_in_range(cln_exif_read(changed, EXIF_BYTES).orientation, 1, 8);
            free(changed);
        }
}

/* A TIFF file whose second directory has a focal length of `tenths` / 10 mm, which is its digital
 * zoom, too, and one as on 35 mm film. */
enum { TAKEN_AT = 26, RATIONAL_AT = 68, FOCAL_BYTES = 76 };

static void write_focal(uint8_t out[FOCAL_BYTES], bool little, uint32_t tenths, uint32_t film)
{
    const uint32_t entries[4][4] = {{0x8769, 4, 4, TAKEN_AT}, /* LONG */
                                    {0x920A, 5, 4, RATIONAL_AT},
                                    {0xA404, 5, 4, RATIONAL_AT},
                                    {0xA405, 3, 2, film}}; /* SHORT */

    memset(out, 0, FOCAL_BYTES);
    memcpy(out, little ? "II" : "MM", 2);
    exif_number(out + 2, 2, little, 42);
    exif_number(out + 4, 4, little, 8);
    exif_number(out + 8, 2, little, 1);
    exif_number(out + TAKEN_AT, 2, little, 3);
    for (int i = 0; i < 4; i++) {
        uint8_t *entry = out + (i == 0 ? 10 : TAKEN_AT + 2 + 12 * (i - 1));

        exif_number(entry, 2, little, entries[i][0]);
        exif_number(entry + 2, 2, little, entries[i][1]);
        exif_number(entry + 4, 4, little, 1);
        exif_number(entry + 8, (int)entries[i][2], little, entries[i][3]);
    }
    exif_number(out + RATIONAL_AT, 4, little, tenths);
    exif_number(out + RATIONAL_AT + 4, 4, little, 10);
}

static void test_focal_length(void **state)
{
    uint8_t data[FOCAL_BYTES];

    (void)state;
    for (int little = 0; little < 2; little++) {
        write_focal(data, little, 413, 62);
        assert_true(cln_exif_read_tiff(data, sizeof data).focal_film == 62);
        assert_true(cln_exif_read_tiff(data, sizeof data).focal == 41.3);
        assert_true(cln_exif_read_tiff(data, sizeof data).zoom == 41.3);
        write_focal(data, little, 413, 0); /* not told */
        assert_true(cln_exif_read_tiff(data, sizeof data).focal_film == 0);
        for (size_t bytes = 0; bytes < FOCAL_BYTES; bytes++) {
            uint8_t *cut = malloc(bytes + !bytes);

            assert_non_null(cut);
            memcpy(cut, data, bytes);
            assert_true(cln_exif_read_tiff(cut, bytes).focal == 0);
            free(cut);
        }
        memset(data + RATIONAL_AT + 4, 0, 4);
        assert_true(cln_exif_read_tiff(data, sizeof data).focal == 0);
        assert_true(cln_exif_read_tiff(data, sizeof data).zoom == 1);
    }
}

/* 41 degrees 7' 30.36" and so on; "altitude 1234.5 m". */
static const uint32_t position[7][2] = {{41, 1}, {7, 1},        {3036, 100}, {73, 1},
                                        {30, 1}, {0, 12345678}, {12345, 10}};

static void test_gps(void **state)
{
    static const struct {
        const char *halves;
        int below;
        double want[3];
    } cases[] = {{"NE", 0, {41.1251, 73.5, 1234.5}},   {"SW", 1, {-41.1251, -73.5, -1234.5}},
                 {"NW", 2, {41.1251, -73.5, 1234.5}}, /* EXIF 3.0: over the ellipsoid */
                 {"NE", 3, {41.1251, 73.5, -1234.5}},  {"ne", 0, {41.1251, 73.5, 1234.5}},
                 {"sw", 0, {-41.1251, -73.5, 1234.5}}, {"N?", 0, {41.1251, NAN, 1234.5}}};
    static const struct {
        int row, column;
        uint32_t value;
        int told; /* bits of what is left */
    } damaged[] = {{0, 0, 91, 6}, {3, 0, 181, 5}, {0, 1, 0, 6},         {2, 1, 0, 6},
                   {5, 1, 0, 7},  {6, 1, 0, 3},   {6, 0, 4294967200, 3}};
    uint8_t data[GPS_BYTES];

    (void)state;
    for (int i = 0; i < 2 * (int)(sizeof cases / sizeof *cases); i++) {
        cln_exif got;

        exif_write_gps(data, i % 2, cases[i / 2].halves, position, cases[i / 2].below);
        got = cln_exif_read_tiff(data, sizeof data);
        for (int a = 0; a < 3; a++)
            if (isnan(cases[i / 2].want[a]))
                assert_true(isnan(got.gps[a]));
            else
                assert_near(got.gps[a], cases[i / 2].want[a], 1e-9);
    }
    for (size_t i = 0; i < sizeof damaged / sizeof *damaged; i++) {
        uint32_t values[7][2];
        cln_exif got;

        memcpy(values, position, sizeof values);
        values[damaged[i].row][damaged[i].column] = damaged[i].value;
        exif_write_gps(data, true, "NE", values, 0);
        got = cln_exif_read_tiff(data, sizeof data);
        for (int a = 0; a < 3; a++)
            assert_int_equal(!isnan(got.gps[a]), damaged[i].told >> a & 1);
    }
    exif_write_gps(data, true, "NE",
                   (const uint32_t[7][2]){{0, 1}, {0, 1}, {0, 1}, {0, 1}, {0, 1}, {0, 1}, {5, 1}},
                   0);
    assert_true(isnan(cln_exif_read_tiff(data, sizeof data).gps[0])); /* no reception */
    for (int zero = 0; zero < 2; zero++) { /* on the equator, at Greenwich */
        uint32_t values[7][2];
        cln_exif got;

        memcpy(values, position, sizeof values);
        for (int i = 0; i < 3; i++)
            values[3 * zero + i][0] = 0;
        values[5][1] = 1;
        exif_write_gps(data, true, "NE", values, 0);
        got = cln_exif_read_tiff(data, sizeof data);
        assert_near(got.gps[zero], 0, 0);
        assert_true(got.gps[1 - zero] > 40);
    }
    exif_write_gps(data, true, "NE",
                   (const uint32_t[7][2]){{41, 1}, {0, 0}, {0, 0}, {0, 0}, {0, 1}, {0, 1}, {5, 1}},
                   0);
    assert_near(cln_exif_read_tiff(data, sizeof data).gps[0], 41, 0);
    assert_true(isnan(cln_exif_read_tiff(data, sizeof data).gps[1])); /* no degrees */
    for (int type = 3; type <= 4; type++) /* a whole number for an altitude */
        for (int little = 0; little < 2; little++) {
            uint8_t *entry = data + GPS_AT + 2 + 12 * 5;

            exif_write_gps(data, little, "NE", position, 1);
            exif_number(entry + 2, 2, little, (uint32_t)type);
            memset(entry + 8, 0, 4);
            exif_number(entry + 8, type == 3 ? 2 : 4, little, 321);
            assert_near(cln_exif_read_tiff(data, sizeof data).gps[2], -321, 0);
        }
    assert_true(isnan(cln_exif_read(NULL, 0).gps[2]));
}

/* What is cut off or changed tells nothing wrong of its place in the data, nor reads beyond them
 * (the sanitizers tell). */
static void test_damaged_gps(void **state)
{
    uint8_t data[GPS_BYTES];

    (void)state;
    exif_write_gps(data, false, "NE", position, 0);
    for (size_t bytes = 0; bytes < GPS_BYTES; bytes++) {
        uint8_t *cut = malloc(bytes + !bytes);
        cln_exif got;

        assert_non_null(cut);
        memcpy(cut, data, bytes);
        got = cln_exif_read_tiff(cut, bytes);
        assert_int_equal(!isnan(got.gps[0]), bytes >= GPS_VALUES + 24);
        assert_int_equal(!isnan(got.gps[1]), bytes >= GPS_VALUES + 48);
        assert_true(isnan(got.gps[2]));
        free(cut);
    }
    for (size_t at = 0; at < GPS_BYTES; at++)
        for (int value = 0; value < 256; value++) {
            uint8_t *changed = malloc(GPS_BYTES);
            cln_exif got;

            assert_non_null(changed);
            memcpy(changed, data, GPS_BYTES);
            changed[at] = (uint8_t)value;
            got = cln_exif_read_tiff(changed, GPS_BYTES);
            assert_false(fabs(got.gps[0]) > 90 || fabs(got.gps[1]) > 180 || isinf(got.gps[2]));
            free(changed);
        }
}

/* A PNG's chunk, before its pixels: the same without "Exif" and two zeros; its CRC is not looked
 * at, as it harms no pixel. */
static void test_png_exif(void **state)
{
    static const uint8_t pixels[3 * 6] = {0};
    const char *path = scratch_path(*state, "a.png");
    char chunk[12 + EXIF_BYTES - 6] = {0, 0, 0, EXIF_BYTES - 6, 'e', 'X', 'I', 'f'}, *data = NULL;
    uint8_t exif[EXIF_BYTES];
    cln_image_head head;
    size_t bytes = 0;

    for (int o = 1; o <= 8; o++) {
        char *longer = NULL;

        assert_int_equal(cln_image_write_png(path, 3, 2, 3, pixels), CLN_OK);
        data = scratch_get(path, &bytes);
        exif_write(exif, o % 2, o);
        memcpy(chunk + 8, exif + 6, EXIF_BYTES - 6);
        longer = malloc(bytes + sizeof chunk);
        assert_non_null(longer);
        memcpy(longer, data, 33);
        memcpy(longer + 33, chunk, sizeof chunk);
        memcpy(longer + 33 + sizeof chunk, data + 33, bytes - 33);
        scratch_put(path, longer, bytes + sizeof chunk);
        assert_int_equal(cln_image_read_head(path, &head), CLN_OK);
        assert_int_equal(head.orientation, o);
        free(longer);
        free(data);
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

/* A pixel of the picture that people see has the ray that it has in the stored one, and what is up
 * there is up by the standard's words: where the stored first row (2: its column) belongs. Of
 * mirrors it is the picture before they mirror it. */
static void test_seen(void **state)
{
    enum { WIDE = 4, HIGH = 3 };
    static const double ups[9][2] = {[1] = {0, -1}, [2] = {0, -1}, [3] = {0, 1}, [4] = {0, 1},
                                     [5] = {-1, 0}, [6] = {-1, 0}, [7] = {1, 0}, [8] = {1, 0}};
    cln_view view = {.camera = {.c2w = {0.8, 0, 0.6, 1, 0, 1, 0, 2, -0.6, 0, 0.8, 3},
                                .fx = 5,
                                .fy = 7,
                                .cx = 1.75,
                                .cy = 1.25,
                                .width = WIDE,
                                .height = HIGH}};
    const cln_camera *c = &view.camera;

    (void)state;
    for (int o = 0; o <= 8; o++) {
        const double *up = ups[o ? o : 1];
        uint8_t *pixels = malloc(3 * WIDE * HIGH);
        int width = WIDE, height = HIGH;
        cln_camera seen;

        assert_non_null(pixels);
        for (int i = 0; i < 3 * WIDE * HIGH; i++)
            pixels[i] = (uint8_t)(i / 3);
        view.orientation = o;
        cln_view_seen(&view, &seen);
        assert_int_equal(cln_image_turn(cln_view_turn(&view), &width, &height, 3, &pixels), CLN_OK);
        assert_true(seen.width == width && seen.height == height);
        for (int a = 0; a < 3; a++)
            assert_true(-seen.c2w[4 * a + 1] == up[0] * c->c2w[4 * a] + up[1] * c->c2w[4 * a + 1]);
        for (int i = 0; i < WIDE * HIGH; i++) {
            const int from = pixels[3 * i];
            double at[2][3], along[2][3];

            assert_true(cln_camera_ray(&seen, i % width + 0.5, i / width + 0.5, at[0], along[0]));
            assert_true(cln_camera_ray(c, from % WIDE + 0.5, from / WIDE + 0.5, at[1], along[1]));
            for (int a = 0; a < 3; a++) {
                assert_true(at[0][a] == at[1][a]);
                assert_float_equal(along[0][a], along[1][a], 1e-12);
            }
        }
        free(pixels);
        view.turned = true; /* its pixels are as they are seen */
        if (o > 1)
            assert_int_equal(cln_view_turn(&view), 1);
        view.turned = false;
    }
}

/* ---- scenes ---- */

/* A picture of which one quarter is dark (0 upper left, 1 upper right, 2 and 3 below). */
static void put_picture(const char *folder, const char *kind, int view, int width, int height,
                        int quarter, int orientation)
{
    uint8_t *pixels = malloc((size_t)(width * height * 3)), *jpeg = NULL;
    char name[32], *path = NULL;
    size_t bytes = 0;

    assert_non_null(pixels);
    for (int i = 0; i < width * height; i++)
        memset(pixels + 3 * i,
               i % width / (width / 2) + 2 * (i / width / (height / 2)) == quarter ? 0 : 230, 3);
    jpeg = exif_jpeg(width, height, pixels, orientation, &bytes);
    assert_non_null(jpeg);
    snprintf(name, sizeof name, "%s_%02d.jpg", kind, view);
    assert_int_equal(cln_make_dirs(folder), CLN_OK);
    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    scratch_put(path, (const char *)jpeg, bytes);
    free(path);
    free(jpeg);
    free(pixels);
}

/* A photo whose stored picture is dark in its upper left quarter. */
static void put_photo(const char *folder, int view, int width, int height, int orientation)
{
    put_picture(folder, "view", view, width, height, 0, orientation);
}

/* A transforms file whose cameras have such a size (0: none is told), the images in the folder
 * itself; the first `masks` frames have a mask. */
static void put_masked(const char *folder, int width, int height, int masks)
{
    cln_camera cameras[FORMAT_VIEWS];
    FILE *f = format_open(folder, "transforms.json");

    format_cameras(cameras);
    fprintf(f, "{\"fl_x\": 20, ");
    if (width)
        fprintf(f, "\"w\": %d, \"h\": %d, ", width, height);
    fprintf(f, "\"frames\": [");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const double *m = cameras[v].c2w;

        fprintf(f, "%s{\"file_path\": \"view_%02d.jpg\", ", v ? "," : "", v);
        if (v < masks)
            fprintf(f, "\"mask_path\": \"mask_%02d.jpg\", ", v);
        fprintf(f, "\"transform_matrix\": [");
        for (int row = 0; row < 3; row++) /* OpenGL's axes */
            fprintf(f, "[%.17g,%.17g,%.17g,%.17g],", m[4 * row], -m[4 * row + 1], -m[4 * row + 2],
                    m[4 * row + 3]);
        fprintf(f, "[0,0,0,1]]}");
    }
    fprintf(f, "]}");
    fclose(f);
}

static void put_transforms(const char *folder, int width, int height)
{
    put_masked(folder, width, height, 0);
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

/* All warnings but that of few photos around something. */
static void warn_of_turns(const cln_scene *scene, int *warnings)
{
    cln_scene_warn_doubts(scene);
    *warnings -= cln_scene_few_around(scene);
}

/* The number of findings about orientations, and whether their texts have a word. */
static int findings_of(const cln_scene *scene, const char *word)
{
    json_t *all = NULL;
    int count = 0;

    assert_int_equal(cln_scene_inspect(scene, NULL, &all), CLN_OK);
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
        int turn;                       /* of photo 0, to be seen */
        int warnings;
        const char *told;
    } cases[] = {
        {"none", 16, 12, 1, 0, 0, 0, 1, 0, NULL},
        {"stored", 16, 12, 6, 0, 0, 0, 6, 0, "as the poses are of these; what is up goes by these"},
        {"right", 12, 16, 6, 0, 1, 0, 1, 0, "turned as EXIF data say"},
        {"left", 12, 16, 8, 0, 2, 0, 1, 0, "turned as EXIF data say"},
        {"half", 16, 12, 3, 0, 0, 0, 3, 1, "mogrify -auto-orient"},
        {"mirrored", 16, 12, 2, 0, 0, 0, 1, 1, "mogrify -auto-orient"},
        {"all turned", 12, 16, 6, 3, 1, 3, 1, 0, "turned as EXIF data say"},
        {"all stored", 16, 12, 6, 3, 0, 0, 6, 0, "taken as stored, as the poses are of these"},
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
        warn_of_turns(scene, &warnings);
        print_message("    %s\n", cases[i].name);
        assert_int_equal(warnings, cases[i].warnings);
        assert_int_equal(dark_quarter(scene, 0), cases[i].first);
        assert_int_equal(cln_view_turn(&scene->views[0]), cases[i].turn);
        for (int v = 1; v < FORMAT_VIEWS; v++)
            assert_int_equal(dark_quarter(scene, v), cases[i].rest);
        assert_true(scene->views[0].file_width == 16 && scene->views[0].file_height == 12);
        assert_int_equal(findings_of(scene, cases[i].told ? cases[i].told : ""),
                         cases[i].told != NULL);
        cln_scene_free(scene);
    }
}

/* ---- masks ---- */

/* Where an orientation brings the upper left quarter, by the standard's words. */
static const int quarter_of[9] = {0, 0, 1, 3, 2, 0, 1, 3, 2};

/* The mask of such a photo, dark where this is: drawn on the turned picture, or on the stored one;
 * own: its own orientation. */
static void put_mask(const char *folder, const char *kind, int view, int width, int height,
                     int orientation, bool on_turned, int own)
{
    const bool swapped = on_turned && orientation >= 5;

    put_picture(folder, kind, view, swapped ? height : width, swapped ? width : height,
                on_turned ? quarter_of[orientation] : 0, own);
}

/* The quarter of a view that its mask leaves out; -1: none alone. */
static int left_out_quarter(const cln_view *v)
{
    int found = -1, count = 0;

    for (int k = 0; k < 4; k++)
        if (!cln_view_keeps(v, (k % 2 ? 3 : 1) * v->camera.width / 4,
                            (k / 2 ? 3 : 1) * v->camera.height / 4)) {
            found = k;
            count++;
        }
    return count == 1 ? found : -1;
}

/* Masks lie on what they hide, drawn on stored or on turned pictures, whether photos are turned or
 * not. Views 0 and 1 have masks; view 1 has a half turn, a mirror, or none. Their quarters are
 * whole blocks of JPEG's, so that black stays black. */
static void test_mask_turns(void **state)
{
    static const struct {
        const char *name;
        int width, height, orientation; /* of photo 0; camera 64 x 48 */
        int other;                      /* orientation of photo 1, of 64 x 48 */
        bool on_turned;                 /* both masks */
        int own;                        /* orientation in their own EXIF data */
        int first, second;              /* quarters, dark and left out */
        int warnings;                   /* of orientations */
    } cases[] = {
        {"turned photos, stored masks", 48, 64, 6, 3, false, 0, 1, 3, 0},
        {"turned photos, turned masks", 48, 64, 6, 3, true, 0, 1, 3, 0},
        {"to the left", 48, 64, 8, 2, false, 0, 2, 1, 0},
        {"to the left, turned masks", 48, 64, 8, 2, true, 0, 2, 1, 0},
        {"stored photos, stored masks", 64, 48, 6, 3, false, 0, 0, 0, 0},
        {"stored photos, turned masks", 64, 48, 6, 3, true, 0, 0, 0, 0},
        {"the other way", 64, 48, 8, 4, true, 0, 0, 0, 0},
        {"mirrored and turned", 64, 48, 5, 0, true, 0, 0, 0, 0},
        {"mirrored and turned back", 64, 48, 7, 0, true, 0, 0, 0, 0},
        {"mirrored, turned photos", 48, 64, 7, 4, false, 0, 3, 2, 0},
        {"half turns alone: neither photos nor masks tell", 64, 48, 3, 3, false, 0, 0, 0, 2},
        {"their masks have EXIF data, too", 64, 48, 3, 3, false, 3, 0, 0, 1},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].name);
        cln_scene *scene = NULL;
        int warnings = 0;

        print_message("    %s\n", cases[i].name);
        put_photo(folder, 0, cases[i].width, cases[i].height, cases[i].orientation);
        put_mask(folder, "mask", 0, cases[i].width, cases[i].height, cases[i].orientation,
                 cases[i].on_turned, cases[i].own);
        for (int v = 1; v < FORMAT_VIEWS; v++)
            put_photo(folder, v, 64, 48, v == 1 ? cases[i].other : 0);
        put_mask(folder, "mask", 1, 64, 48, cases[i].other, cases[i].on_turned, cases[i].own);
        put_masked(folder, 64, 48, 2);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        warn_of_turns(scene, &warnings);
        assert_int_equal(warnings, cases[i].warnings);
        assert_int_equal(dark_quarter(scene, 0), cases[i].first);
        assert_int_equal(dark_quarter(scene, 1), cases[i].second);
        assert_int_equal(left_out_quarter(&scene->views[0]), cases[i].first);
        assert_int_equal(left_out_quarter(&scene->views[1]), cases[i].second);
        cln_scene_free(scene);
    }
}

/* Masks of stored pixels beside masks of turned ones tell nothing about a third, which is then
 * taken as stored, with a warning. */
static void test_masks_contradict(void **state)
{
    static const int orientation[3] = {6, 6, 3};
    const char *folder = *state;
    cln_scene *scene = NULL;
    int warnings = 0;

    for (int v = 0; v < FORMAT_VIEWS; v++)
        put_photo(folder, v, 64, 48, v < 3 ? orientation[v] : 0);
    for (int v = 0; v < 3; v++)
        put_mask(folder, "mask", v, 64, 48, orientation[v], v == 1, 0);
    put_masked(folder, 64, 48, 3);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    scene = load(folder, plain());
    warn_of_turns(scene, &warnings);
    assert_int_equal(warnings, 1);
    for (int v = 0; v < 3; v++) {
        assert_int_equal(scene->views[v].masks_known, v < 2);
        assert_int_equal(left_out_quarter(&scene->views[v]), 0);
    }
    cln_scene_free(scene);
}

/* A mask whose size fits neither way: the sentence has all three. */
static void test_mask_fits_neither(void **state)
{
    const char *folder = *state;

    for (int v = 0; v < FORMAT_VIEWS; v++)
        put_photo(folder, v, 48, 64, 6);
    put_picture(folder, "mask", 0, 64, 40, 0, 0);
    put_masked(folder, 64, 48, 1);
    assert_refused(folder, plain(),
                   (const char *const[3]){"mask_00.jpg: the mask has 64 x 40", "48 x 64",
                                          "turned as its EXIF data say 64 x 48"},
                   "neither");
    put_photo(folder, 0, 64, 48, 0);
    put_picture(folder, "mask", 0, 48, 64, 0, 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"mask_00.jpg: the mask has 48 x 64", "its image 64 x 48",
                                          "give it the same shape"},
                   "swapped sides without EXIF data");
}

/* NeuS's masks, which become alpha, of photos as they are stored. */
static void test_alpha_turns(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_neus(folder, cameras, false);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        put_photo(scratch_path(folder, "image"), v, 16, 12, 8);
        put_mask(scratch_path(folder, "mask"), "view", v, 16, 12, 8, v % 2, 0);
    }
    scene = load(folder, plain());
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const uint8_t *p = scene->views[v].pixels;

        assert_int_equal(scene->views[v].channels, 4);
        for (int k = 0; k < 4; k++) {
            const uint8_t *pixel = p + 4 * ((k / 2 ? 9 : 3) * 16 + (k % 2 ? 12 : 4));

            assert_true(k ? pixel[3] > 200 && pixel[0] > 200 : pixel[3] < 30 && pixel[0] < 30);
        }
    }
    cln_scene_free(scene);
}

/* Without w and h a camera has the size of the stored file, whatever EXIF data say: that is no
 * evidence that poses are of stored pixels, and half turns follow nothing. A frame with a size of
 * its own is evidence. */
static void test_sized_by_file(void **state)
{
    const char *folder = *state, *path = scratch_path(folder, "transforms.json");
    cln_scene *scene = NULL;
    size_t bytes = 0;
    char *text = NULL, *longer = NULL;

    put_photo(folder, 0, 12, 16, 6);
    for (int v = 1; v < FORMAT_VIEWS; v++)
        put_photo(folder, v, 16, 12, v == 1 ? 3 : 0);
    put_transforms(folder, 0, 0);
    scene = load(folder, plain());
    assert_true(scene->views[0].by_file.size);
    assert_int_equal(scene->views[0].camera.width, 12);
    assert_int_equal(scene->views[0].camera.height, 16);
    for (int v = 0; v < 2; v++) {
        assert_false(scene->views[v].turn_known);
        assert_false(scene->views[v].turned);
        assert_int_equal(dark_quarter(scene, v), 0);
    }
    assert_int_equal(findings_of(scene, "nothing tells whether"), 1);
    cln_scene_free(scene);

    text = scratch_get(path, &bytes);
    assert_int_equal(cln_asprintf(&longer, "{\"fl_x\": 20, \"frames\": [{\"w\": 16, \"h\": 12, %s",
                                  strstr(text, "\"file_path\"")),
                     CLN_OK);
    scratch_put(path, longer, strlen(longer));
    scene = load(folder, plain());
    assert_false(scene->views[0].by_file.size);
    assert_int_equal(dark_quarter(scene, 0), 1);
    assert_int_equal(dark_quarter(scene, 1), 3);
    assert_int_equal(findings_of(scene, "turned as EXIF data say"), 1);
    cln_scene_free(scene);
    free(longer);
    free(text);
}

/* Photos stored upright whose first frame alone has a size, that of turned ones: the others follow,
 * with all that comes from a size. keys: of all frames. */
static void test_some_sized(void **state)
{
    static const struct {
        const char *name, *keys;
        double fx, fy, cx, cy; /* of 16 x 12 */
    } cases[] = {
        {"focal length", "\"fl_x\": 20", 20, 20, 8, 6},
        {"angle", "\"camera_angle_x\": 1.5707963267948966", 8, 8, 8, 6},
        {"both angles",
         "\"camera_angle_x\": 1.5707963267948966, \"camera_angle_y\": 1.5707963267948966", 8, 6, 8,
         6},
        {"angle across the height", "\"camera_angle_y\": 1.5707963267948966", 6, 6, 8, 6},
        {"principal point", "\"fl_x\": 20, \"cx\": 7, \"cy\": 5.5", 20, 20, 7, 5.5},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].name);
        cln_scene *scene = NULL;
        char *text = NULL, *longer = NULL;
        size_t bytes = 0;

        for (int v = 0; v < FORMAT_VIEWS; v++)
            put_photo(folder, v, 12, 16, 6);
        put_transforms(folder, 0, 0);
        text = scratch_get(scratch_path(folder, "transforms.json"), &bytes);
        assert_int_equal(cln_asprintf(&longer, "{%s, \"frames\": [{\"w\": 16, \"h\": 12, %s",
                                      cases[i].keys, strstr(text, "\"file_path\"")),
                         CLN_OK);
        put_text(folder, "transforms.json", longer);
        scene = load(folder, plain());
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            const cln_camera *c = &scene->views[v].camera;

            assert_int_equal(dark_quarter(scene, v), 1);
            assert_true(c->width == 16 && c->height == 12);
            assert_float_equal(c->fx, cases[i].fx, 1e-9);
            assert_float_equal(c->fy, cases[i].fy, 1e-9);
            assert_float_equal(c->cx, cases[i].cx, 1e-9);
            assert_float_equal(c->cy, cases[i].cy, 1e-9);
        }
        cln_scene_free(scene);
        free(longer);
        free(text);
    }
}

/* No frame has a size, but a principal point, near the middle of one of both pictures. */
static void test_told_by_middle(void **state)
{
    static const struct {
        const char *keys;
        int quarter;
        const char *told;
    } cases[] = {
        {"\"cx\": 8.2, \"cy\": 5.8", 1, "turned as EXIF data say"},
        {"\"cx\": 6.2, \"cy\": 7.8", 0, "taken as stored, as the poses are of these"},
        {"\"cx\": 7, \"cy\": 7", 0, "nothing tells whether"},
        {"\"cx\": 8.2", 0, "nothing tells whether"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        cln_scene *scene = NULL;
        char *text = NULL, *longer = NULL;
        size_t bytes = 0;

        for (int v = 0; v < FORMAT_VIEWS; v++)
            put_photo(*state, v, 12, 16, 6);
        put_transforms(*state, 0, 0);
        text = scratch_get(scratch_path(*state, "transforms.json"), &bytes);
        assert_int_equal(cln_asprintf(&longer, "{\"fl_x\": 20, %s, \"frames\": [{%s", cases[i].keys,
                                      strstr(text, "\"file_path\"")),
                         CLN_OK);
        put_text(*state, "transforms.json", longer);
        scene = load(*state, plain());
        for (int v = 0; v < FORMAT_VIEWS; v++)
            assert_int_equal(dark_quarter(scene, v), cases[i].quarter);
        assert_int_equal(findings_of(scene, cases[i].told), 1);
        cln_scene_free(scene);
        free(longer);
        free(text);
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
    warn_of_turns(scene, &warnings);
    assert_int_equal(warnings, 0);
    assert_int_equal(dark_quarter(scene, 2), 0);
    assert_int_equal(findings_of(scene, "taken as stored, as poses of such files are of these"), 1);
    cln_scene_free(scene);
    put_photo(scratch_path(folder, "images"), 0, 12, 16, 6); /* another's: it tells of all */
    scene = load(folder, plain());
    warn_of_turns(scene, &warnings);
    assert_int_equal(warnings, 0);
    assert_int_equal(dark_quarter(scene, 0), 1);
    assert_int_equal(dark_quarter(scene, 2), 3);
    assert_int_equal(findings_of(scene, "turned as EXIF data say"), 1);
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
        cmocka_unit_test(test_focal_length),
        cmocka_unit_test(test_gps),
        cmocka_unit_test(test_damaged_gps),
        cmocka_unit_test_setup_teardown(test_png_exif, scratch_make, scratch_remove),
        cmocka_unit_test(test_turn),
        cmocka_unit_test(test_seen),
        cmocka_unit_test_setup_teardown(test_scenes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_mask_turns, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks_contradict, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_mask_fits_neither, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_alpha_turns, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_sized_by_file, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_some_sized, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_told_by_middle, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_refused, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("orientation", tests, NULL, NULL);
}
