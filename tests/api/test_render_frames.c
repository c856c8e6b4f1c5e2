/* Frames of render: ranges of them, pictures without their background, files that a copy cut
 * short, poses that come again, maps. */
#include "unit.h"
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>
#include "run_fixture.h"
#include "base/number.h"
#include "io/image.h"
#include "io/npy.h"
#include "near.h"
#include "tests.h"

static cln_render_desc desc_of(const char *out)
{
    return (cln_render_desc){.run = fixture_path("whole"),
                             .out = fixture_path(out),
                             .orbit_frames = 4,
                             .orbit_elevation = 10,
                             .orbit_radius = 1,
                             .width = 20,
                             .device = fixture_device()};
}

static bool is_there(const char *name)
{
    return cln_is_file(fixture_path(name));
}

static void some_frames_are_those_of_all(void **state)
{
    cln_render_desc all = desc_of("all"), some = desc_of("some");
    cln_render_result result;
    size_t bytes[2] = {0};
    char *png[2];

    NEED_DEVICE();
    fixture_rendered(&all, 4, 0);
    some.first_frame = 1;
    some.frame_count = 2;
    fixture_rendered(&some, 2, 0);
    assert_true(is_there("some/orbit_0001.png") && is_there("some/orbit_0002.png"));
    assert_false(is_there("some/orbit_0000.png") || is_there("some/orbit_0003.png"));
    png[0] = scratch_get(fixture_path("all/orbit_0002.png"), &bytes[0]);
    png[1] = scratch_get(fixture_path("some/orbit_0002.png"), &bytes[1]);
    assert_int_equal(bytes[0], bytes[1]);
    assert_memory_equal(png[0], png[1], bytes[0]);
    free(png[0]);
    free(png[1]);
    some.first_frame = 3;
    some.frame_count = 0; /* to the end */
    fixture_rendered(&some, 1, 0);
    some.first_frame = 0;
    fixture_rendered(&some, 1, 3);
    some.first_frame = 4;
    assert_fails(cln_render(&some, &result), CLN_USAGE, "--frames: there are 4");
    some.first_frame = 3;
    some.frame_count = 2;
    assert_fails(cln_render(&some, &result), CLN_USAGE,
                 "numbered from 0 to 3; for another number of them: --orbit N");
    some.first_frame = -1;
    assert_fails(cln_render(&some, &result), CLN_USAGE, "first_frame");
}

/* Over the model's background a picture without it is the one that has it, to the rounding of
 * colours and alpha. */
static void backgrounds_are_taken_out(void **state)
{
    const float black[3] = {0};
    cln_render_desc on = desc_of("on"), off = desc_of("off");
    int width = 0, height = 0, channels = 0, clear = 0, partly = 0;
    uint8_t *with = NULL, *without = NULL;
    cln_render_result result;

    NEED_DEVICE();
    off.transparent = true;
    on.cropped = off.cropped = true; /* so that some rays meet nothing */
    for (int a = 0; a < 6; a++)
        on.crop[a] = off.crop[a] = a < 3 ? -0.3 : 0.3;
    fixture_rendered(&on, 4, 0);
    fixture_rendered(&off, 4, 0);
    assert_ok(cln_image_load(fixture_path("on/orbit_0002.png"), &width, &height, &channels, &with));
    assert_int_equal(channels, 3);
    assert_ok(
        cln_image_load(fixture_path("off/orbit_0002.png"), &width, &height, &channels, &without));
    assert_int_equal(channels, 4);
    for (int i = 0; i < width * height; i++) {
        const double alpha = without[4 * i + 3] / 255.0;

        clear += alpha == 0;
        partly += alpha > 0.1 && alpha < 0.9;
        for (int k = 0; k < 3; k++) { /* white, as photos with alpha are read */
            const double over = alpha * without[4 * i + k] + (1 - alpha) * 255;

            assert_true(fabs(over - with[3 * i + k]) < 1.6);
        }
    }
    assert_true(clear > 0 && partly > 0);
    fixture_rendered(&off, 0, 4);
    off.transparent = false; /* another kind of picture */
    assert_fails(cln_render(&off, &result), CLN_OUTPUT, "of other settings");
    free(with);
    off.transparent = true;
    off.background = black; /* of what is not opaque nothing else is left */
    off.overwrite = true;
    fixture_rendered(&off, 4, 0);
    assert_ok(
        cln_image_load(fixture_path("off/orbit_0002.png"), &width, &height, &channels, &with));
    for (int i = 0; i < 4 * width * height; i++)
        if (without[i / 4 * 4 + 3] > 100)
            assert_true(abs(without[i] - with[i]) < 2);
    free(with);
    free(without);
    off.out = fixture_path("film.y4m");
    assert_fails(cln_render(&off, &result), CLN_USAGE, "film.y4m, a film of that kind");
}

static double told_background(const char *path, size_t c)
{
    json_t *about = fixture_json(path);
    const double value = json_number_value(json_array_get(fixture_at(about, "background"), c));

    json_decref(about);
    return value;
}

static void backgrounds_can_be_given(void **state)
{
    const float green[3] = {0, 1, 0.25f}, beyond[3] = {0, 0, 1.5f};
    cln_render_desc desc = desc_of("behind");
    int width = 0, height = 0, channels = 0;
    uint8_t *pixels = NULL;
    cln_render_result result;

    NEED_DEVICE();
    desc.cropped = true;
    for (int a = 0; a < 6; a++)
        desc.crop[a] = a < 3 ? -0.3 : 0.3;
    fixture_rendered(&desc, 4, 0);
    assert_true(told_background("behind/render.json", 2) == 1);
    desc.background = green;
    desc.overwrite = true;
    fixture_rendered(&desc, 4, 0);
    assert_true(told_background("behind/render.json", 0) == 0 &&
                told_background("behind/render.json", 2) == 0.25);
    assert_ok(
        cln_image_load(fixture_path("behind/orbit_0002.png"), &width, &height, &channels, &pixels));
    assert_true(pixels[0] == 0 && pixels[1] == 255 && pixels[2] == 64); /* a corner */
    free(pixels);
    desc.background = beyond;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "background");
}

static void files_cut_short_are_made_again(void **state)
{
    static const char *const files[] = {"cut/orbit_0001.png", "cut/orbit_0001.opacity.png",
                                        "cut/orbit_0001.depth.npy"};
    cln_render_desc desc = desc_of("cut");

    NEED_DEVICE();
    fixture_rendered(&desc, 4, 0);
    for (size_t i = 0; i < sizeof files / sizeof *files; i++)
        for (int empty = 0; empty < 2; empty++) {
            size_t bytes = 0, again = 0;
            char *whole = scratch_get(fixture_path(files[i]), &bytes), *after = NULL;

            scratch_put(fixture_path(files[i]), whole, empty ? 0 : bytes - 1);
            fixture_rendered(&desc, 1, 3);
            after = scratch_get(fixture_path(files[i]), &again);
            assert_int_equal(again, bytes);
            assert_memory_equal(after, whole, bytes);
            free(whole);
            free(after);
        }
}

/* A preview does not take the place of frames that took hours. */
static void other_frames_stay(void **state)
{
    cln_render_desc desc = desc_of("hours");
    cln_render_result result;
    size_t bytes = 0, after = 0;
    char *before = NULL, *now = NULL;

    NEED_DEVICE();
    fixture_rendered(&desc, 4, 0);
    before = scratch_get(fixture_path("hours/orbit_0003.png"), &bytes);
    assert_int_equal(remove(fixture_path("hours/orbit_0001.png")), 0);
    desc.width = 10;
    assert_fails(cln_render(&desc, &result), CLN_OUTPUT,
                 "hours: has 3 of these frames already, but of another size; --overwrite");
    now = scratch_get(fixture_path("hours/orbit_0003.png"), &after);
    assert_int_equal(after, bytes);
    assert_memory_equal(now, before, bytes);
    free(now);
    desc.width = 20;
    desc.mean_depth = true;
    assert_fails(cln_render(&desc, &result), CLN_OUTPUT, "of other settings; --overwrite");
    desc.first_frame = 1; /* the one that is missing is free */
    desc.frame_count = 1;
    fixture_rendered(&desc, 1, 0);
    desc.first_frame = desc.frame_count = 0;
    desc.width = 10;
    desc.overwrite = true;
    fixture_rendered(&desc, 4, 0);
    desc.overwrite = false;
    fixture_rendered(&desc, 0, 4);
    free(before);
}

/* Pictures that were begun. */
static void count_work(const char *what, int done, int total, void *user)
{
    *(int *)user += strcmp(what, "render") == 0 && done < total;
}

static bool same_bytes(const char *one, const char *other)
{
    size_t bytes[2] = {0};
    char *data[2] = {scratch_get(fixture_path(one), &bytes[0]),
                     scratch_get(fixture_path(other), &bytes[1])};
    const bool same = bytes[0] == bytes[1] && memcmp(data[0], data[1], bytes[0]) == 0;

    free(data[0]);
    free(data[1]);
    return same;
}

/* A pose that comes again has the same picture, which is rendered once: in a folder, where some of
 * its files are missing, and in a film. */
static void doubles_are_rendered_once(void **state)
{
    enum { FRAMES = 6, WIDTH = 20, HEIGHT = 12, FRAME = 6 + 3 * WIDTH * HEIGHT };
    static const int at[FRAMES] = {0, 1, 0, 2, 1, 0};
    cln_render_desc desc = desc_of("doubles");
    cln_render_result result;
    json_t *list = json_array(), *document = NULL, *about = NULL;
    char *text = NULL, *film = NULL;
    size_t bytes = 0;
    int begun = 0;

    NEED_DEVICE();
    for (int i = 0; i < FRAMES; i++) {
        char name[16];
        double m[3][4];

        snprintf(name, sizeof name, "p%d.png", i);
        fixture_pose(0.3 + at[i], 0.2, m);
        json_array_append_new(list,
                              json_pack("{s:s, s:[[f,f,f,f],[f,f,f,f],[f,f,f,f],[i,i,i,i]]}",
                                        "file_path", name, "transform_matrix", m[0][0], m[0][1],
                                        m[0][2], m[0][3], m[1][0], m[1][1], m[1][2], m[1][3],
                                        m[2][0], m[2][1], m[2][2], m[2][3], 0, 0, 0, 1));
    }
    document = json_pack("{s:f, s:i, s:i, s:o}", "camera_angle_x", 0.8, "w", WIDTH, "h", HEIGHT,
                         "frames", list);
    text = json_dumps(document, 0);
    assert_ok(cln_write_file(fixture_path("doubles.json"), text, strlen(text)));
    desc.poses = fixture_path("doubles.json");
    desc.orbit_frames = 0;
    desc.pfm = desc.normals = desc.seen = true;
    desc.callbacks = (cln_callbacks){.work = count_work, .user = &begun};
    fixture_rendered(&desc, FRAMES, 0);
    assert_int_equal(begun, 3);
    assert_true(same_bytes("doubles/p0.png", "doubles/p5.png"));
    assert_true(same_bytes("doubles/p1.depth.pfm", "doubles/p4.depth.pfm"));
    assert_true(same_bytes("doubles/p0.normal.npy", "doubles/p2.normal.npy"));
    assert_false(same_bytes("doubles/p0.png", "doubles/p1.png"));
    assert_false(same_bytes("doubles/p1.png", "doubles/p3.png"));
    about = fixture_json("doubles/render.json");
    for (int i = 0; i < FRAMES; i++) {
        char place[32];

        snprintf(place, sizeof place, "seen.p%d", i);
        assert_true(json_is_number(json_array_get(fixture_at(about, place), 0)));
    }
    json_decref(about);
    assert_int_equal(remove(fixture_path("doubles/p0.png")), 0);
    assert_int_equal(remove(fixture_path("doubles/p5.png")), 0);
    begun = 0;
    fixture_rendered(&desc, 2, FRAMES - 2);
    assert_int_equal(begun, 1);
    assert_true(same_bytes("doubles/p0.png", "doubles/p2.png"));
    assert_true(same_bytes("doubles/p0.png", "doubles/p5.png"));
    desc.normals = desc.pfm = desc.seen = false;
    desc.out = fixture_path("doubles.y4m");
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, FRAMES);
    film = scratch_get(desc.out, &bytes);
    assert_true(bytes > FRAMES * FRAME);
    film += bytes - FRAMES * FRAME; /* behind the film's first line */
    for (int i = 0; i < FRAMES; i++)
        for (int k = 0; k < i; k++)
            assert_true((memcmp(film + i * FRAME, film + k * FRAME, FRAME) == 0) ==
                        (at[i] == at[k]));
    free(film - (bytes - FRAMES * FRAME));
    json_decref(document);
    free(text);
}

/* PSNR over the values of two pictures. */
static double psnr_of(const char *one, const char *other)
{
    int width = 0, height = 0, w = 0, h = 0, channels = 0;
    uint8_t *a = NULL, *b = NULL;
    double sum = 0;

    assert_ok(cln_image_load(fixture_path(one), &width, &height, &channels, &a));
    assert_ok(cln_image_load(fixture_path(other), &w, &h, &channels, &b));
    assert_true(w == width && h == height);
    for (int i = 0; i < width * height * channels; i++)
        sum += pow(a[i] - b[i], 2) / (width * height * channels);
    free(a);
    free(b);
    return 20 * log10(255 / sqrt(fmax(sum, 1e-9)));
}

/* Heights of a map's grid of 40 x 40, and its number for none. */
static double read_heights(const char *name, double heights[1600])
{
    size_t bytes = 0;
    char *text = scratch_get(fixture_path(name), &bytes), *at = strstr(text, "NODATA_value ");
    const double none = strtod(at + strlen("NODATA_value "), &at);

    assert_memory_equal(text, "ncols 40\nnrows 40\n", 18);
    for (int i = 0; i < 1600; i++)
        heights[i] = strtod(at, &at);
    assert_string_equal(at, "\n");
    free(text);
    return none;
}

/* A map shows what a camera far above shows, by networks (which splat) and by voxels. */
static void maps_are_from_far_above(void **state)
{
    enum { SIDE_PIXELS = 40 };
    static const char *const runs[2] = {"whole", "voxels"};
    const double spacing = 0.05, away = 400;
    const cln_config voxels = fixture_voxels();
    char text[512], name[64];
    double heights[SIDE_PIXELS * SIDE_PIXELS];
    cln_train_result trained;

    NEED_DEVICE();
    assert_ok(fixture_train("voxels", false, &voxels, NULL, &trained));
    cln_format(text, sizeof text,
               "{\"w\":%d,\"h\":%d,\"fl_x\":%.17g,\"fl_y\":%.17g,\"cx\":20,\"cy\":20,"
               "\"frames\":[{\"file_path\":\"map.png\",\"transform_matrix\":[[1,0,0,0],[0,1,0,0],"
               "[0,0,1,%g],[0,0,0,1]]}]}",
               SIDE_PIXELS, SIDE_PIXELS, away / spacing, away / spacing, away);
    assert_ok(cln_write_file(fixture_path("far.json"), text, strlen(text)));
    for (int i = 0; i < 2; i++) {
        cln_render_desc desc = {.run = fixture_path(runs[i]),
                                .orbit_elevation = NAN,
                                .orbit_radius = 1,
                                .map = true,
                                .spacing = spacing,
                                .cropped = true,
                                .crop = {-1, -1, -1.2, 1, 1, 1.2},
                                .device = fixture_device()};
        float *depth = NULL;
        double none = 0;
        int dims = 0, shape[4], here = 0, there = 0;
        struct stat about;
        json_t *document = NULL;

        snprintf(name, sizeof name, "map of %s", runs[i]);
        desc.out = fixture_path(name);
        fixture_rendered(&desc, 1, 0);
        fixture_rendered(&desc, 0, 1);
        snprintf(name, sizeof name, "map of %s/transforms.json", runs[i]);
        assert_false(is_there(name));
        snprintf(name, sizeof name, "map of %s/map.height.asc", runs[i]);
        assert_int_equal(remove(fixture_path(name)), 0); /* it is made again */
        fixture_rendered(&desc, 1, 0);
        assert_int_equal(stat(fixture_path(name), &about), 0);
        assert_int_equal(truncate(fixture_path(name), about.st_size - 100), 0); /* a copy was */
        fixture_rendered(&desc, 1, 0);
        none = read_heights(name, heights);
        desc.seen = true; /* other heights would be left out */
        assert_fails(cln_render(&desc, &(cln_render_result){0}), CLN_OUTPUT, "of other settings");
        desc.seen = false;
        snprintf(name, sizeof name, "map of %s/render.json", runs[i]);
        document = fixture_json(name);
        for (int k = 0; k < 9; k++) {
            const json_t *row = json_array_get(fixture_at(document, "map.axes"), (size_t)k / 3);

            assert_true(json_number_value(json_array_get(row, (size_t)k % 3)) == (k % 4 == 0));
        }
        json_decref(document);
        desc.map = false;
        desc.spacing = 0;
        desc.poses = fixture_path("far.json");
        snprintf(name, sizeof name, "far of %s", runs[i]);
        desc.out = fixture_path(name);
        fixture_rendered(&desc, 1, 0);
        snprintf(name, sizeof name, "far of %s/map.depth.npy", runs[i]);
        assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &depth));
        for (int k = 0; k < SIDE_PIXELS * SIDE_PIXELS; k++) {
            here += heights[k] != none;
            there += heights[k] != none && fabs(away - (double)depth[k] - heights[k]) < 0.05;
        }
        free(depth);
        if (here < 300 || there < 0.98 * here)
            fail_msg("%s: of %d heights %d are those from far above", runs[i], here, there);
        snprintf(name, sizeof name, "map of %s/map.png", runs[i]);
        snprintf(text, sizeof text, "far of %s/map.png", runs[i]);
        if (!(psnr_of(name, text) > 40))
            fail_msg("%s: the map and the view from far above are %.2f dB alike", runs[i],
                     psnr_of(name, text));
    }
}

/* Shares that are counted against other training views are counted again, and no frame is lost or
 * refused for them. */
static void shares_are_of_their_views(void **state)
{
    cln_render_desc desc = desc_of("shares");
    json_t *document = NULL, *about = NULL;
    char by[2][32], *text = NULL;
    cln_render_result result;

    NEED_DEVICE();
    desc.orbit_frames = 0;
    desc.split = "test";
    desc.seen = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    fixture_rendered(&desc, 0, TEST_VIEWS);
    about = fixture_json("shares/render.json");
    snprintf(by[0], sizeof by[0], "%s", json_string_value(fixture_at(about, "seen_by")));
    json_decref(about);
    document = fixture_json("scene/transforms_train.json");
    while (json_array_size(fixture_at(document, "frames")) > 2)
        json_array_remove(fixture_at(document, "frames"), 2);
    text = json_dumps(document, 0);
    assert_ok(cln_make_dirs(fixture_path("fewer")));
    assert_ok(cln_write_file(fixture_path("fewer/transforms_train.json"), text, strlen(text)));
    assert_int_equal(symlink("../scene/train", fixture_path("fewer/train")), 0);
    assert_int_equal(symlink("../scene/test", fixture_path("fewer/test")), 0);
    assert_int_equal(
        symlink("../scene/transforms_test.json", fixture_path("fewer/transforms_test.json")), 0);
    desc.scene = fixture_path("fewer");
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, TEST_VIEWS);
    assert_true(result.hardly_seen == 1); /* two views are fewer than three */
    about = fixture_json("shares/render.json");
    snprintf(by[1], sizeof by[1], "%s", json_string_value(fixture_at(about, "seen_by")));
    assert_int_equal(json_object_size(fixture_at(about, "seen")), TEST_VIEWS);
    json_decref(about);
    assert_string_not_equal(by[0], by[1]);
    desc.scene = NULL; /* of one frame the first views again, and not of the others */
    desc.frame_count = 1;
    fixture_rendered(&desc, 1, 0);
    desc.frame_count = 0;
    fixture_rendered(&desc, TEST_VIEWS - 1, 1);
    fixture_rendered(&desc, 0, TEST_VIEWS);
    desc.mean_depth = true;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--depth mean");
    json_decref(document);
    free(text);
}

/* Of a scene with a shell a map is of its cube, too: of all of it, and has nothing of what lies
 * below it. In fog of so much depth through the cube a ray's half is not within it, or near its
 * top: at 0.215, but for the noise of fresh networks. */
static void maps_end_with_the_cube(void **state)
{
    static const double fog[] = {1, 10};

    NEED_DEVICE();
    for (int k = 0; k < 2; k++) {
        char run[32], out[32], name[64];
        cln_render_desc desc = {.orbit_elevation = NAN,
                                .orbit_radius = 1,
                                .map = true,
                                .spacing = 0.0125,
                                .device = fixture_device()};
        cln_config config = fixture_config();
        double heights[1600], none = 0;
        cln_train_result trained;
        int shown = 0;

        snprintf(run, sizeof run, "in shell %d", k);
        snprintf(out, sizeof out, "map in shell %d", k);
        snprintf(name, sizeof name, "%s/map.height.asc", out);
        desc.run = fixture_path(run);
        desc.out = fixture_path(out);
        config.steps = 1;
        config.initial_depth = fog[k];
        config.space = CLN_SPACE_SHELL;
        snprintf(config.bbox, sizeof config.bbox, "-0.25,-0.25,-0.25,0.25,0.25,0.25");
        assert_ok(fixture_train(run, false, &config, NULL, &trained));
        fixture_rendered(&desc, 1, 0);
        none = read_heights(name, heights);
        for (int i = 0; i < 1600; i++) {
            shown += heights[i] != none;
            if (heights[i] != none)
                assert_near(heights[i], 0.2, 0.05);
        }
        assert_int_equal(shown, k ? 1600 : 0);
    }
}

/* Cameras of frames that a map comes beside stay where they are written. */
static void maps_beside_frames(void **state)
{
    cln_render_desc desc = desc_of("beside");
    json_t *document = NULL;

    NEED_DEVICE();
    fixture_rendered(&desc, 4, 0);
    desc.orbit_frames = desc.width = 0;
    desc.map = true;
    desc.spacing = 0.25;
    fixture_rendered(&desc, 1, 0);
    document = fixture_json("beside/transforms.json");
    assert_int_equal(json_array_size(fixture_at(document, "frames")), 4);
    json_decref(document);
}

static void maps_that_cannot_be(void **state)
{
    cln_render_desc desc = {.run = fixture_path("whole"),
                            .out = fixture_path("no map"),
                            .orbit_elevation = NAN,
                            .orbit_radius = 1,
                            .map = true};
    cln_render_result result;

    NEED_DEVICE();
    desc.stereo = 0.1;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "leave --stereo out");
    desc.stereo = 0;
    desc.width = 100;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--spacing, in place of --width");
    desc.width = 0;
    desc.split = "test";
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "give no other poses");
    desc.split = NULL;
    desc.out = fixture_path("map.y4m");
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "a map is one picture");
    desc.out = fixture_path("no map");
    desc.map = false;
    desc.orbit_frames = 2;
    desc.spacing = 1;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--spacing requires --map");
    desc.spacing = 0;
    desc.offset[1] = -2;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--offset requires --map");
    assert_false(is_there("no map"));
}

int test_group_render_frames(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(some_frames_are_those_of_all),
        cmocka_unit_test(backgrounds_are_taken_out),
        cmocka_unit_test(backgrounds_can_be_given),
        cmocka_unit_test(files_cut_short_are_made_again),
        cmocka_unit_test(other_frames_stay),
        cmocka_unit_test(doubles_are_rendered_once),
        cmocka_unit_test(maps_are_from_far_above),
        cmocka_unit_test(maps_beside_frames),
        cmocka_unit_test(maps_end_with_the_cube),
        cmocka_unit_test(maps_that_cannot_be),
        cmocka_unit_test(shares_are_of_their_views),
    };

    return cmocka_run_group_tests_name("render_frames", tests, fixture_setup, fixture_teardown);
}
