/* Masks of datasets: NeuS's, and those that transforms JSON names. test_cutout.c tests which masks
 * are of an object, test_placing.c those that a dataset does not name. */
#include "unit.h"
#include "exif_fixture.h"
#include "format_fixture.h"
#include "near.h"
#include "outcome.h"
#include "phone_fixture.h"
#include "report/scene_page.h"
#include "scene/dataset.h"
#include "tests.h"

/* A mask that is white from column `from` to the right, of 16 x 12 pixels. */
static void put_mask(const char *folder, const char *name, int from, int channels)
{
    uint8_t pixels[FORMAT_WIDTH * FORMAT_HEIGHT * 3] = {0};

    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        if (i % FORMAT_WIDTH >= from)
            pixels[i * channels + channels - 1] = 255; /* of three, blue alone */
    assert_int_equal(cln_image_write_png(scratch_path(folder, name), FORMAT_WIDTH, FORMAT_HEIGHT,
                                         channels, pixels),
                     CLN_OK);
}

/* Masks: brightness becomes alpha, also with downscale; the digest includes them. */
static void test_neus_masks(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    uint8_t mask[FORMAT_WIDTH * FORMAT_HEIGHT];
    uint64_t digest = 0;
    cln_scene *scene = NULL;

    format_cameras(cameras);
    format_images(scratch_path(folder, "image"), 1);
    format_neus(folder, cameras, false);
    put_folder(folder, "mask");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[32];

        for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
            mask[i] = (uint8_t)(i % FORMAT_WIDTH < 8 ? 0 : 250 + v);
        snprintf(name, sizeof name, "mask/%03d.png", v);
        assert_int_equal(
            cln_image_write_png(scratch_path(folder, name), FORMAT_WIDTH, FORMAT_HEIGHT, 1, mask),
            CLN_OK);
    }
    scene = load(folder, &config);
    assert_true(scene->has_alpha);
    digest = scene->digest;
    for (int v = 0; v < FORMAT_VIEWS; v++)
        for (int x = 0; x < FORMAT_WIDTH; x++) {
            const uint8_t *p = scene->views[v].pixels + 4 * (5 * FORMAT_WIDTH + x);

            assert_int_equal(scene->views[v].channels, 4);
            assert_int_equal(p[0], 20 * v);
            assert_int_equal(p[3], x < 8 ? 0 : 250 + v);
        }
    cln_scene_free(scene);
    put_mask(scratch_path(folder, "mask"), "005.png", 8, 3); /* blue alone is as bright */
    scene = load(folder, &config);
    for (int x = 0; x < FORMAT_WIDTH; x++)
        assert_int_equal(scene->views[5].pixels[4 * (5 * FORMAT_WIDTH + x) + 3], x < 8 ? 0 : 255);
    cln_scene_free(scene);
    config.downscale = 4;
    scene = load(folder, &config);
    assert_int_equal(scene->views[2].pixels[4 * 2 + 3], 252);
    assert_int_equal(scene->views[2].pixels[4 * 1 + 3], 0);
    cln_scene_free(scene);
    mask[0] = 1;
    assert_int_equal(cln_image_write_png(scratch_path(folder, "mask/005.png"), FORMAT_WIDTH,
                                         FORMAT_HEIGHT, 1, mask),
                     CLN_OK);
    config.downscale = 1;
    scene = load(folder, &config);
    assert_true(scene->digest != digest);
    cln_scene_free(scene);
}

/* Masks that failed the other way, as alpha and as what does not count: all of a photo is left, of
 * the others little. Where that little is most, or where many are so, it may be meant. */
static void test_whole_masks(void **state)
{
    static const struct {
        int from, whole; /* column from which others are left; how many are whole */
        bool said;
    } cases[] = {{12, 1, true}, {12, 0, false}, {12, 2, false}};
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    const cln_config config = *plain();

    format_cameras(cameras);
    for (size_t i = 0; i < 2 * sizeof cases / sizeof *cases; i++) {
        const bool alpha = i % 2;
        const char *in = scratch_path(folder, alpha ? "alpha" : "left out");
        char text[CLN_EMPTY_BYTES] = "", json[4096] = "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[";
        cln_scene *scene = NULL;

        put_folder(folder, alpha ? "alpha" : "left out");
        put_folder(in, alpha ? "mask" : "m");
        format_images(alpha ? scratch_path(in, "image") : in, 1);
        for (int v = 0; v < FORMAT_VIEWS; v++) {
            char name[32];

            snprintf(name, sizeof name, alpha ? "mask/%03d.png" : "m/%d.png", v);
            put_mask(in, name, v < cases[i / 2].whole ? 0 : cases[i / 2].from, 1);
            snprintf(json + strlen(json), sizeof json - strlen(json),
                     "%s{\"file_path\":\"view_%02d.png\",\"mask_path\":\"m/%d.png\","
                     "\"transform_matrix\":" POSE_FRONT "}",
                     v ? "," : "", v, v);
        }
        snprintf(json + strlen(json), sizeof json - strlen(json), "]}");
        if (alpha)
            format_neus(in, cameras, false);
        else
            put_text(in, "transforms.json", json);
        scene = load(in, &config);
        assert_int_equal(scene->has_alpha, alpha);
        /* masks of what is to be ignored may hide nothing in many a photo */
        assert_int_equal(cln_scene_is_whole(scene, text), cases[i / 2].said && alpha);
        scene->masks_doubtful = true;
        assert_int_equal(cln_scene_is_whole(scene, text), cases[i / 2].said);
        if (cases[i / 2].said) {
            assert_non_null(strstr(text, "of 1 of 6 photos "));
            assert_non_null(strstr(text, alpha ? "alpha hides nothing: " : "the mask hides n"));
        }
        cln_scene_free(scene);
    }
}

/* A folder masks beside what has no other place for them: a mask each, or one for all. */
static void test_folder_of_masks(void **state)
{
    static const char *const dialects[3] = {"NSVF", "Polycam", "Record3D"};
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (int i = 0; i < 6; i++) {
        const char in[] = {(char)('a' + i), 0}, *folder = scratch_path(*state, in);
        cln_scene *scene = NULL;

        put_folder(*state, in);
        if (i / 2 == 0)
            format_nsvf(folder, cameras, "", 0);
        else if (i / 2 == 1)
            phone_polycam(folder, cameras, false, 1);
        else
            phone_record3d(folder, "metadata.json", "rgb", cameras, false);
        put_folder(folder, "masks");
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, dialects[i / 2]);
        assert_int_equal(scene->mask_count, 0);
        for (int v = 0; v < FORMAT_VIEWS && i % 2 == 0; v++) {
            char name[320];

            snprintf(name, sizeof name, "masks/%s.png", scene->views[v].name);
            put_mask(folder, name, 5, 1);
        }
        if (i % 2)
            put_mask(folder, "masks/all.png", 5, 1);
        cln_scene_free(scene);
        scene = load(folder, plain());
        assert_int_equal(scene->mask_count, FORMAT_VIEWS);
        assert_false(cln_view_keeps(&scene->views[3], 4, 2));
        assert_true(cln_view_keeps(&scene->views[3], 5, 2));
        cln_scene_free(scene);
    }
}

/* ---- masks of transforms JSON ---- */

#define MASKED(file, mask) \
    "{\"file_path\":\"" file "\",\"mask_path\":\"" mask "\",\"transform_matrix\":" POSE_FRONT "}"
#define MASK_SCENE                                                                         \
    "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" MASKED("view_00.png", "m.png") "," FRAME( \
        "view_01.png", POSE_FRONT) "," FRAME("view_02.png", POSE_FRONT) "]}"

/* nerfstudio: black does not count; instant-ngp: what is not black does not. */
static void test_masks(void **state)
{
    static const int first[3] = {5, 0, 0}, last[3] = {15, 9, 15}; /* columns that count */
    const char *folder = *state;
    cln_config config = *plain();
    uint64_t digest = 0;
    cln_scene *scene = NULL;
    int warnings = 0;

    format_images(folder, 1);
    put_mask(folder, "m.png", 5, 1);
    put_mask(folder, "dynamic_mask_view_01.png", 10, 3);
    put_text(folder, "transforms.json", MASK_SCENE);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    for (int n = 1; n <= 2; n++) { /* a pixel counts if all pixels that it averages do */
        config.downscale = n;
        scene = load(folder, &config);
        for (int v = 0; v < 3; v++)
            for (int x = 0; x < FORMAT_WIDTH / n; x++)
                if (cln_view_keeps(&scene->views[v], x, 5 / n) !=
                    (x * n >= first[v] && x * n + n - 1 <= last[v]))
                    fail_msg("view %d, column %d of %d", v, x, FORMAT_WIDTH / n);
        assert_int_equal(cln_scene_fold(scene).views, 0);
        digest = scene->digest;
        cln_scene_free(scene);
    }
    assert_int_equal(warnings, 0);
    put_mask(folder, "m.png", 0, 1); /* nothing is ignored, in one of two */
    scene = load(folder, &config);
    assert_true(scene->digest != digest);
    cln_scene_free(scene);
    assert_int_equal(warnings, 0);
    put_mask(folder, "dynamic_mask_view_01.png", 16,
             3); /* and in the other: the wrong way round? */
    cln_scene_free(load(folder, &config));
    assert_int_equal(warnings, 1);
}

/* The size of the page of `check` and the sum of its bytes. */
static uint64_t page(const char *folder)
{
    const char *path = scratch_path(folder, "page.html");
    json_t *document = json_object();
    cln_scene *scene = load(folder, plain());
    uint64_t sum = 0;
    FILE *f = NULL;

    assert_int_equal(cln_scene_page(path, scene, document), CLN_OK);
    f = fopen(path, "r");
    assert_non_null(f);
    for (int c = getc(f); c != EOF; c = getc(f))
        sum = sum * 31 + (uint64_t)c;
    fclose(f);
    cln_scene_free(scene);
    json_decref(document);
    return sum;
}

/* What a mask hides is not on the page of `check`. */
static void test_hidden_on_page(void **state)
{
    const char *folder = *state;
    uint8_t photo[FORMAT_WIDTH * FORMAT_HEIGHT * 3];
    uint64_t sum[3];

    put_mask(folder, "m.png", 9, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"mask_path\":\"m.png\",\"frames\":[" FRAME(
                 "view_00.png", POSE_FRONT) "," FRAME("view_01.png", POSE_FRONT) "]}");
    for (int n = 0; n < 3; n++) {
        format_images(folder, 1);
        for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT * 3; i++) /* black is 0 in either part */
            photo[i] = n > 0 && (i / 3 % FORMAT_WIDTH < 9) == (n == 1) ? 240 : 0;
        assert_int_equal(cln_image_write_png(scratch_path(folder, "view_00.png"), FORMAT_WIDTH,
                                             FORMAT_HEIGHT, 3, photo),
                         CLN_OK);
        sum[n] = page(folder);
    }
    assert_true(sum[0] == sum[1]);
    assert_true(sum[0] != sum[2]);
}

/* The document's mask is that of all frames without one of their own. */
static void test_one_mask_for_all(void **state)
{
    static const int first[2] = {9, 5}; /* column that counts */
    const char *folder = *state;
    cln_scene *scene = NULL;

    format_images(folder, 1);
    put_mask(folder, "m.png", 9, 1);
    put_mask(folder, "all.png", 5, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"mask_path\":\"all.png\",\"frames\":[" MASKED(
                 "view_00.png", "m.png") "," FRAME("view_01.png", POSE_FRONT) "]}");
    scene = load(folder, plain());
    assert_int_equal(json_array_size(scene->ignored), 0);
    for (int v = 0; v < 2; v++)
        for (int x = 0; x < FORMAT_WIDTH; x++)
            assert_int_equal(cln_view_keeps(&scene->views[v], x, 5), x >= first[v]);
    cln_scene_free(scene);
}

/* A document that names no mask has those of a folder, as other formats have. */
static void test_masks_in_folder(void **state)
{
    const char *folder = *state, *masks = scratch_path(folder, "masks");
    cln_scene *scene = NULL;

    put_folder(folder, "images");
    put_folder(folder, "masks");
    format_images(scratch_path(folder, "images"), 1);
    put_mask(masks, "view_00.png", 9, 1);
    put_mask(masks, "view_01.png", 5, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"frames\":[" FRAME("images/view_00.png", POSE_FRONT) "," FRAME(
                 "images/view_01.png", POSE_FRONT) "]}");
    scene = load(folder, plain());
    for (int x = 0; x < FORMAT_WIDTH; x++) {
        assert_int_equal(cln_view_keeps(&scene->views[0], x, 5), x >= 9);
        assert_int_equal(cln_view_keeps(&scene->views[1], x, 5), x >= 5);
    }
    cln_scene_free(scene);
    put_text(folder, "transforms.json", /* one that names some has these alone */
             "{\"fl_x\":20,\"frames\":[" MASKED("images/view_00.png",
                                                "masks/view_01.png") "," FRAME("images/view_01.png",
                                                                               POSE_FRONT) "]}");
    scene = load(folder, plain());
    assert_true(cln_view_keeps(&scene->views[0], 5, 5));
    assert_true(cln_view_keeps(&scene->views[1], 0, 5));
    cln_scene_free(scene);
}

/* Files that instant-ngp would take alpha from, by either form of file_path; not those that a frame
 * names itself. */
static void test_unread_alpha(void **state)
{
    const char *folder = *state;
    int warnings = 0;

    format_images(folder, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "view_00.png", POSE_FRONT) "," FRAME("view_01", POSE_FRONT) "]}");
    cln_log_set_sink(scratch_count_warnings, &warnings);
    put_mask(folder, "view_00.alpha.png", 5, 1); /* not a name that it looks for */
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 0);
    put_mask(folder, "view_01.alpha.png", 5, 1);
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 1);
    assert_int_equal(remove(scratch_path(folder, "view_01.alpha.png")), 0);
    put_mask(folder, "view_00.png.alpha.png", 5, 1);
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 2);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[{\"file_path\":\"view_00.png\","
             "\"alpha_path\":\"view_00.png.alpha.png\",\"transform_matrix\":" POSE_FRONT "}]}");
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 2);
}

/* Beside an edge a JPEG's black is not quite black, nor its white quite white: a mask keeps what
 * its pixels were before. In a PNG every value but 0 is other than black, as in label images. */
static void test_jpeg_masks(void **state)
{
    enum { EDGE = 5 };
    const char *folder = *state;
    uint8_t pixels[FORMAT_WIDTH * FORMAT_HEIGHT * 3], *jpeg = NULL;
    cln_scene *scene = NULL;
    size_t bytes = 0;
    bool above = false;

    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        memset(pixels + 3 * i, i % FORMAT_WIDTH < EDGE ? 0 : 255, 3);
    assert_int_equal(
        cln_image_encode_jpeg(FORMAT_WIDTH, FORMAT_HEIGHT, 3, pixels, 75, &jpeg, &bytes), CLN_OK);
    format_images(folder, 1);
    scratch_put(scratch_path(folder, "m.jpg"), (const char *)jpeg, bytes);
    free(jpeg);
    assert_int_equal(
        cln_image_load(scratch_path(folder, "m.jpg"), &(int){0}, &(int){0}, &(int){0}, &jpeg),
        CLN_OK);
    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        above |= i % FORMAT_WIDTH < EDGE && jpeg[3 * i] > 0;
    free(jpeg);
    assert_true(above); /* the case is one */
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" MASKED("view_00.png", "m.jpg") "]}");
    scene = load(folder, plain());
    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        if (cln_view_keeps(scene->views, i % FORMAT_WIDTH, i / FORMAT_WIDTH) !=
            (i % FORMAT_WIDTH >= EDGE))
            fail_msg("column %d, row %d", i % FORMAT_WIDTH, i / FORMAT_WIDTH);
    cln_scene_free(scene);
    for (int i = 0; i < FORMAT_WIDTH * FORMAT_HEIGHT; i++)
        memset(pixels + 3 * i, i % FORMAT_WIDTH >= EDGE, 3);
    assert_int_equal(
        cln_image_write_png(scratch_path(folder, "l.png"), FORMAT_WIDTH, FORMAT_HEIGHT, 3, pixels),
        CLN_OK);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" MASKED("view_00.png", "l.png") "]}");
    scene = load(folder, plain());
    for (int x = 0; x < FORMAT_WIDTH; x++)
        assert_int_equal(cln_view_keeps(scene->views, x, 3), x >= EDGE);
    cln_scene_free(scene);
}

/* A mask of half the size, or of twice, is brought to the photo's, by the nearest pixels. */
static void test_masks_of_other_sizes(void **state)
{
    const char *folder = *state;

    for (int twice = 0; twice < 2; twice++) {
        const int width = twice ? 2 * FORMAT_WIDTH : FORMAT_WIDTH / 2;
        const int height = twice ? 2 * FORMAT_HEIGHT : FORMAT_HEIGHT / 2;
        uint8_t *mask = calloc((size_t)width * (size_t)height, 3);
        char path[512];
        cln_scene *scene = NULL;

        assert_non_null(mask);
        for (int i = 0; i < width * height; i++)
            memset(mask + 3 * i, i % width * 4 >= width ? 255 : 0, 3); /* from a quarter on */
        format_images(folder, 1);
        put_mask(folder, "dynamic_mask_view_01.png", 10, 3);
        put_text(folder, "transforms.json", MASK_SCENE);
        snprintf(path, sizeof path, "%s/m.png", folder);
        assert_int_equal(cln_image_write_png(path, width, height, 3, mask), CLN_OK);
        scene = load(folder, plain());
        for (int x = 0; x < FORMAT_WIDTH; x++)
            assert_int_equal(cln_view_keeps(scene->views, x, 3), x >= FORMAT_WIDTH / 4);
        cln_scene_free(scene);
        free(mask);
    }
}

/* The pixels of a mask that was written for COLMAP. */
static uint8_t *black_mask(const char *path, int width, int height)
{
    int wide = 0, high = 0, channels = 0;
    uint8_t *pixels = NULL;

    assert_int_equal(cln_image_load(path, &wide, &high, &channels, &pixels), CLN_OK);
    assert_int_equal(wide, width);
    assert_int_equal(high, height);
    for (int i = 0; i < width * height; i++)
        pixels[i] = pixels[channels * i];
    return pixels;
}

/* Masks for COLMAP are as large as stored photos: one of half the size, one that was drawn on a
 * turned photo, one whose alpha cuts away, in a folder; a photo without one has none. So is what
 * photos' own alpha cuts away, if it is anything. */
static void test_black_masks(void **state)
{
    enum { W = FORMAT_WIDTH, H = FORMAT_HEIGHT };
    const char *folder = *state, *images = scratch_path(folder, "images");
    uint8_t pixels[W * H * 4] = {0}, grey[W * H], *jpeg = NULL, *mask = NULL;
    cln_names names = {0};
    cln_black_masks found = {0};
    size_t bytes = 0;

    put_folder(folder, "images");
    put_folder(folder, "images/in");
    put_folder(folder, "masks");
    put_folder(folder, "masks/in");
    assert_int_equal(cln_image_write_png(scratch_path(images, "a.png"), W, H, 3, pixels), CLN_OK);
    assert_int_equal(cln_image_write_png(scratch_path(images, "d.png"), W, H, 3, pixels), CLN_OK);
    assert_int_equal(cln_image_write_png(scratch_path(images, "in/c.png"), W, H, 3, pixels),
                     CLN_OK);
    jpeg = exif_jpeg(W, H, pixels, 6, &bytes); /* shown with its left side above */
    assert_non_null(jpeg);
    scratch_put(scratch_path(images, "b.jpg"), (const char *)jpeg, bytes);
    free(jpeg);
    for (int i = 0; i < W / 2 * H / 2; i++)
        pixels[i] = i % (W / 2) < 3 ? 0 : 200;
    assert_int_equal(
        cln_image_write_png(scratch_path(folder, "masks/a.png.png"), W / 2, H / 2, 1, pixels),
        CLN_OK);
    for (int i = 0; i < W * H; i++)
        pixels[i] = i / H < 4 ? 0 : 200; /* its upper rows */
    assert_int_equal(cln_image_write_png(scratch_path(folder, "masks/b.png"), H, W, 1, pixels),
                     CLN_OK);
    for (int i = 0; i < W * H; i++)
        memcpy(pixels + 4 * i, (uint8_t[]){255, 255, 255, i % W < 2 ? 0 : 255}, 4);
    assert_int_equal(cln_image_write_png(scratch_path(folder, "masks/in/c.png"), W, H, 4, pixels),
                     CLN_OK);
    for (int i = 0; i < W * H; i++)
        memcpy(pixels + 4 * i, (uint8_t[]){9, 9, 9, i % W < 5 ? 100 : 130}, 4);
    assert_int_equal(cln_image_write_png(scratch_path(images, "e.png"), W, H, 4, pixels), CLN_OK);
    memset(pixels, 200, sizeof pixels);
    assert_int_equal(cln_image_write_png(scratch_path(images, "f.png"), W, H, 4, pixels), CLN_OK);
    assert_int_equal(cln_image_write_png(scratch_path(images, "g.png"), W, H, 3, pixels), CLN_OK);
    for (int i = 0; i < W * H; i++) /* of a colour is not black */
        for (int a = 0; a < 3; a++)
            pixels[3 * i + a] = i % W > 3 || i % W == a + 1 ? 200 : 0;
    assert_int_equal(cln_image_write_png(scratch_path(folder, "masks/g.png"), W, H, 3, pixels),
                     CLN_OK);
    for (int i = 0; i < W * H; i++) { /* by its alpha, and by its mask */
        memcpy(pixels + 4 * i, (uint8_t[]){9, 9, 9, i % W < 3 ? 0 : 255}, 4);
        grey[i] = i % W >= 3 && i % W < 7 ? 0 : 255;
    }
    assert_int_equal(cln_image_write_png(scratch_path(images, "h.png"), W, H, 4, pixels), CLN_OK);
    assert_int_equal(cln_image_write_png(scratch_path(folder, "masks/h.png"), W, H, 1, grey),
                     CLN_OK);
    assert_int_equal(cln_dataset_images(images, &names), CLN_OK);
    assert_int_equal(cln_dataset_write_black(folder, images, &names, scratch_path(folder, "out"),
                                             &(cln_callbacks){0}, &found),
                     CLN_OK);
    assert_int_equal(found.count, 5);
    assert_int_equal(found.cut, 2);
    assert_int_equal(found.written, 6);
    assert_near(found.black, (6 + 4 + 2 + 5 + 1 + 7) / 6.0 / W, 1e-9);
    assert_false(cln_has_file(folder, "out/d.png.png"));
    assert_false(cln_has_file(folder, "out/f.png.png"));
    for (int k = 0; k < 6; k++) {
        static const struct {
            const char *name;
            int black; /* columns on the left */
        } cases[] = {{"out/a.png.png", 6}, {"out/b.jpg.png", 4}, {"out/in/c.png.png", 2},
                     {"out/e.png.png", 5}, {"out/g.png.png", 1}, {"out/h.png.png", 7}};

        mask = black_mask(scratch_path(folder, cases[k].name), W, H);
        for (int i = 0; i < W * H; i++)
            if (mask[i] != (i % W < cases[k].black ? 0 : 255))
                fail_msg("%s: column %d, row %d: %d", cases[k].name, i % W, i / W, mask[i]);
        free(mask);
    }
    assert_int_equal(cln_dataset_write_black(NULL, images, &names, scratch_path(folder, "out 2"),
                                             &(cln_callbacks){0}, &found),
                     CLN_OK);
    assert_int_equal(found.count, 0); /* masks were not asked for */
    assert_int_equal(found.written, 2);
    cln_dataset_free_names(&names);
}

static void test_broken_masks(void **state)
{
    static const struct {
        const char *name;
        int from;
        const char *text, *words[2];
    } cases[] = {
        {"m.png", 16, NULL, {"m.png: the mask leaves no pixel", "other than black"}},
        {"dynamic_mask_view_01.png", 0, NULL, {"mask_view_01.png: the mask leaves no", "(black"}},
        {"m.png", 0, "GIF", {"m.png", "not a PNG"}},
        {"transforms.json",
         0,
         "{\"fl_x\":20,\"frames\":[" MASKED("view_00.png", "gone.png") "]}",
         {"'view_00.png'", "gone.png"}},
        {"transforms.json",
         0,
         "{\"fl_x\":20,\"frames\":[" MASKED("view_00.png", "") "]}",
         {"'view_00.png'", "mask_path must be a string"}},
        {"transforms.json",
         0,
         "{\"fl_x\":20,\"mask_path\":\"gone.png\",\"frames\":[" FRAME("view_01.png",
                                                                      POSE_FRONT) "]}",
         {"'view_01.png'", "gone.png; restore it, or remove mask_path"}},
    };
    const char *folder = *state;
    cln_scene *scene = NULL;

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        format_images(folder, 1);
        put_mask(folder, "m.png", 5, 1);
        put_mask(folder, "dynamic_mask_view_01.png", 10, 3);
        put_text(folder, "transforms.json", MASK_SCENE);
        if (cases[i].text)
            put_text(folder, cases[i].name, cases[i].text);
        else
            put_mask(folder, cases[i].name, cases[i].from, 1);
        assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
        assert_null(scene);
        for (int k = 0; k < 2; k++)
            if (!strstr(cln_error_text(), cases[i].words[k]))
                fail_msg("case %zu: '%s' lacks '%s'", i, cln_error_text(), cases[i].words[k]);
        cln_clear_error();
    }
    put_mask(folder, "m.png", 5, 1);
    put_text(folder, "transforms.json", MASK_SCENE);
    put_image(folder, "m.png", 16, 11, 3, 0);
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "m.png: the mask has 16 x 11 pixels"));
    cln_clear_error();
}

int test_group_masks(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_neus_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_folder_of_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_whole_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_hidden_on_page, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_one_mask_for_all, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks_in_folder, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_unread_alpha, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_jpeg_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks_of_other_sizes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_black_masks, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_broken_masks, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("masks", tests, NULL, NULL);
}
