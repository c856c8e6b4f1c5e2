/* Datasets that must not load: every reader with its files truncated at every length, damaged at
 * random, and with wrong contents. Each gives CLN_INPUT, a sentence that names the file, a NULL
 * scene and no leak (run under sanitizers). test_scene_input.c tests the transforms reader. */
#include "unit.h"
#include "format_fixture.h"
#include "tests.h"

/* The file truncated at every length, in steps of `step`: refused, and the sentence names it. */
static void cut_everywhere(const char *scene, const char *file, size_t step)
{
    size_t bytes = 0;
    char *data = scratch_get(file, &bytes);

    for (size_t cut = 0; cut < bytes; cut += step) {
        char what[64];

        snprintf(what, sizeof what, "cut at %zu", cut);
        scratch_put(file, data, cut);
        assert_refused(scene, plain(), (const char *const[3]){file}, what);
    }
    scratch_put(file, data, bytes);
    free(data);
    cln_scene_free(load(scene, plain()));
}

/* A text of a good file, what stands there instead, and words of the refusal. */
typedef struct replacement {
    const char *from, *to, *words[3];
} replacement;

/* One replacement at a time; at the end the file is good again. */
static void replace_each(const char *scene, const char *file, const replacement *cases, size_t n)
{
    size_t bytes = 0;
    char *good = scratch_get(file, &bytes);

    for (size_t i = 0; i < n; i++) {
        const char *at = strstr(good, cases[i].from);
        FILE *f = fopen(file, "wb");

        assert_non_null(at);
        fwrite(good, (size_t)(at - good), 1, f);
        fprintf(f, "%s%s", cases[i].to, at + strlen(cases[i].from));
        fclose(f);
        assert_refused(scene, plain(), cases[i].words, cases[i].to);
    }
    scratch_put(file, good, bytes);
    free(good);
}

/* Each byte changed to several values: refused with a sentence, or read. */
static void damage_everywhere(const char *scene_path, const char *file, size_t step)
{
    static const unsigned char values[] = {0, 0xFF, 0x7F, ' ', '9', 'e', '-', '\n', '#', '"'};
    size_t bytes = 0;
    char *data = scratch_get(file, &bytes);

    for (size_t at = 0; at < bytes; at += step) {
        const char before = data[at];
        cln_scene *scene = NULL;

        data[at] = (char)values[at / step % sizeof values];
        scratch_put(file, data, bytes);
        if (try_load(scene_path, plain(), &scene) != CLN_OK) {
            assert_null(scene);
            assert_true(cln_error_text()[0]);
        }
        cln_scene_free(scene);
        cln_clear_error();
        data[at] = before;
    }
    scratch_put(file, data, bytes);
    free(data);
}

/* Overwrites bytes of a file; *before: their old values. */
static void patch(const char *file, long at, const void *bytes, size_t count, void *before)
{
    FILE *f = fopen(file, "r+b");

    assert_non_null(f);
    assert_int_equal(fseek(f, at, SEEK_SET), 0);
    assert_int_equal(fread(before, 1, count, f), count);
    assert_int_equal(fseek(f, at, SEEK_SET), 0);
    assert_int_equal(fwrite(bytes, 1, count, f), count);
    assert_int_equal(fclose(f), 0);
}

/* ---- COLMAP ---- */

static const cln_point few_points[2] = {{{1, 2, 3}, {4, 5, 6}, 2, 0}, {{2, 2, 3}, {4, 5, 6}, 3, 0}};

/* A good model of two points in "sparse/0". */
static void put_colmap(const char *folder, bool binary)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), binary, cameras, NULL, few_points, 2);
    cln_scene_free(load(folder, plain()));
}

static void test_colmap_binary(void **state)
{
    static const char *const files[] = {"cameras.bin", "images.bin", "points3D.bin"};
    const char *folder = *state, *model = scratch_path(folder, "sparse/0");

    put_colmap(folder, true);
    for (int i = 0; i < 3; i++) {
        cut_everywhere(folder, scratch_path(model, files[i]), 3);
        damage_everywhere(folder, scratch_path(model, files[i]), 5);
    }
}

static void test_colmap_text(void **state)
{
    static const char *const files[] = {"cameras.txt", "images.txt", "points3D.txt"};
    const char *folder = *state, *model = scratch_path(folder, "sparse/0");

    put_colmap(folder, false);
    for (int i = 0; i < 3; i++)
        damage_everywhere(folder, scratch_path(model, files[i]), 7);
}

/* Fields of the binary files by offset: cameras.bin has the count, then cameras of 56 bytes, the
 * first with id 22; images.bin images of 4 + 56 + 4 + 12 + 8 + 24 bytes. */
static void test_colmap_fields(void **state)
{
    static const double nan_value = NAN, huge = 1e300, zero = 0, two = 2;
    static const uint64_t many = UINT64_MAX, lots = 1000000, none = 0, absurd = (uint64_t)1 << 40;
    static const uint32_t id = 19, model = 99, minus = UINT32_MAX;
    static const struct {
        const char *file;
        long at;
        const void *value;
        size_t bytes;
        const char *words[3];
    } cases[] = {
        {"cameras.bin", 0, &many, 8, {"cameras.bin", "18446744073709551615 cameras", "cut off"}},
        {"cameras.bin", 0, &lots, 8, {"cameras.bin", "1000000 cameras"}},
        {"cameras.bin", 0, &none, 8, {"images.bin", "'view_00.png'", "camera 7 is not in"}},
        {"cameras.bin", 8, &id, 4, {"cameras.bin", "camera 19 appears twice"}},
        {"cameras.bin", 12, &model, 4, {"cameras.bin", "camera 22", "camera model 99"}},
        {"cameras.bin", 12, &minus, 4, {"cameras.bin", "camera 22", "camera model -1"}},
        {"cameras.bin", 16, &absurd, 8, {"cameras.bin", "camera 22", "absurd image size"}},
        {"cameras.bin", 24, &none, 8, {"cameras.bin", "camera 22", "absurd image size 16 x 0"}},
        {"cameras.bin", 32, &nan_value, 8, {"'view_05.png'", "absurd fl_x"}},
        {"cameras.bin", 40, &zero, 8, {"'view_05.png'", "absurd fl_y = 0"}},
        {"cameras.bin", 48, &huge, 8, {"'view_05.png'", "absurd cx"}},
        {"images.bin", 0, &many, 8, {"images.bin", "18446744073709551615 images"}},
        {"images.bin", 0, &none, 8, {"images.bin", "no image has a pose"}},
        {"images.bin", 12, &nan_value, 8, {"images.bin", "'view_00.png'", "quaternion"}},
        {"images.bin", 12, &two, 8, {"images.bin", "'view_00.png'", "quaternion"}},
        {"images.bin", 44, &nan_value, 8, {"'view_00.png'", "not finite"}},
        {"images.bin", 44, &huge, 8, {"'view_00.png'", "beyond"}},
        {"images.bin", 68, &model, 4, {"images.bin", "'view_00.png'", "camera 99 is not in"}},
        {"images.bin", 72, "\xFF", 1, {"images.bin", "not UTF-8"}},
        {"images.bin", 72, "", 1, {"images.bin", "names no image"}},
        {"images.bin", 72, "X", 1, {"1 of 6 images is not there", "'Xiew_00.png'", "restore"}},
        {"images.bin", 84, &many, 8, {"images.bin", "18446744073709551615 points of an image"}},
        {"points3D.bin", 0, &many, 8, {"points3D.bin", "18446744073709551615 points"}},
        {"points3D.bin", 16, &nan_value, 8, {"points3D.bin", "point 1 is not finite"}},
        {"points3D.bin", 51, &many, 8, {"points3D.bin", "images of a point"}},
    };
    const char *folder = *state, *model_folder = scratch_path(folder, "sparse/0");

    put_colmap(folder, true);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *file = scratch_path(model_folder, cases[i].file);
        char before[8], ignored[8], what[64];

        snprintf(what, sizeof what, "case %zu, %s", i, cases[i].file);
        patch(file, cases[i].at, cases[i].value, cases[i].bytes, before);
        assert_refused(folder, plain(), cases[i].words, what);
        patch(file, cases[i].at, before, cases[i].bytes, ignored);
    }
    cln_scene_free(load(folder, plain()));
}

static void test_colmap_lines(void **state)
{
    static const struct {
        const char *file, *text, *words[3];
    } cases[] = {
        {"cameras.txt", "", {"images.txt", "camera 7 is not in"}},
        {"cameras.txt", "\x89PNG\r\n\x1a\n", {"cameras.txt: line 1", "camera models"}},
        {"cameras.txt", "# c\n7 PINHOLE 16 12 20 20 8\n", {"cameras.txt: line 2"}},
        {"cameras.txt", "7 PINHOLE 16 12 20 20 8 6 1\n", {"cameras.txt: line 1"}},
        {"cameras.txt", "7 PINHALE 16 12 20 20 8 6\n", {"cameras.txt: line 1"}},
        {"cameras.txt", "7 PINHOLE 16 12 20 nan 8 6\n", {"cameras.txt: line 1"}},
        {"cameras.txt",
         "7 SPHERE 16 8 1 8 4\n",
         {"line 1: SPHERE is", "\"7 EQUIRECTANGULAR 16 8 16 8\""}},
        {"cameras.txt", "7 SPHERICAL 16 8 16 8\n", {"\"7 EQUIRECTANGULAR 16 8 16 8\""}},
        {"cameras.txt", "7 SPHERE x 8 1 8 4\n", {"line 1 is not", "camera models"}},
        {"cameras.txt", "7 SPHERES 16 8 1 8 4\n", {"line 1 is not", "camera models"}},
        {"cameras.txt", "-7 PINHOLE 16 12 20 20 8 6\n", {"cameras.txt: line 1"}},
        {"cameras.txt", "7 PINHOLE 1e9 12 20 20 8 6\n", {"cameras.txt: camera 7", "1e+09 x 12"}},
        {"images.txt", "", {"images.txt", "no image has a pose"}},
        {"images.txt", "1 1 0 0 0 0 0 4 7\n\n", {"images.txt: line 1", "name of an image"}},
        {"images.txt", "1 1 0 0 0 inf 0 4 7 a.png\n", {"images.txt: line 1"}},
        {"images.txt", "1 1 0 0 0 0 0 4 7.5 a.png\n", {"images.txt: line 1"}},
        {"images.txt", "1 1 0 0 0 0 0 4 7 ../..\n", {"images.txt", "names no image"}},
        {"images.txt",
         "1 1 0 0 0 0 0 4 7 a b.png\n",
         {"images.txt", "'a b.png'; the images in", "the first is 'images/view_00.png'"}},
        {"images.txt",
         "1 1 0 0 0 0 0 4 7 view_00.png\n2 1 0 0 0 0 0 4 10 view_01.png\n",
         {"images.txt: line 2 is an image", "points of 'view_00.png'"}},
        {"images.txt", "1 0 0 0 0 0 0 4 7 view_00.png\n", {"images.txt", "length 0"}},
        {"points3D.txt", "1 2 3\n", {"points3D.txt: line 1"}},
        {"points3D.txt", "1 2 3 4 256 0 0 .5 1 2\n", {"points3D.txt: line 1"}},
        {"points3D.txt", "1 2 3 1e999 0 0 0 .5 1 2\n", {"points3D.txt: line 1"}},
    };
    const char *folder = *state, *model = scratch_path(folder, "sparse/0");

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        put_colmap(folder, false);
        put_text(model, cases[i].file, cases[i].text);
        assert_refused(folder, plain(), cases[i].words, cases[i].text);
    }
}

/* Images: all missing, one missing, of another shape, broken. */
static void test_colmap_images(void **state)
{
    const char *folder = *state;

    put_colmap(folder, true);
    assert_int_equal(remove(scratch_path(folder, "images/view_03.png")), 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"1 of 6 images is not there", "'view_03.png'"},
                   "one image gone");
    put_image(folder, "images/view_03.png", 16, 5, 3, 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"view_03.png", "16 x 5",
                                          "16 x 12; replace the image, or correct its camera in "
                                          "cameras.txt: the size, after a crop also cx and cy"},
                   "shape");
    put_text(folder, "images/view_03.png", "not an image");
    assert_refused(folder, plain(), (const char *const[3]){"view_03.png", "not a PNG"}, "no image");
    assert_int_equal(rename(scratch_path(folder, "images"), scratch_path(folder, ".images")), 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"images.bin: none of its 6 images is there", folder},
                   "all images gone");
    put_folder(folder, "images");
    put_text(folder, "images/other.tif", "");
    assert_refused(folder, plain(), (const char *const[3]){"put them into its folder images"},
                   "other images");
    put_text(folder, "images/view_00.tiff", "");
    assert_refused(folder, plain(),
                   (const char *const[3]){"for 'view_00.png'",
                                          "has 'images/view_00.tiff', one of 2 photos in formats "
                                          "that are not read",
                                          "convert them"},
                   "images of another format");
}

/* ---- LLFF, NeuS ---- */

static void put_llff(const char *folder)
{
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_llff(folder, cameras, 1, false);
    cln_scene_free(load(folder, plain()));
}

/* Rows of 17 doubles, after a header of 10 + 61 bytes. */
static void test_llff(void **state)
{
    static const double nan_value = NAN, zero = 0, huge = 1e300, seven = 7, below = -1;
    enum { HEADER = 10 + 61 };
    static const struct {
        int number; /* in the first row */
        const double *value;
        const char *words[3];
    } cases[] = {
        {0, &nan_value, {"row 1 (of 'view_00.png')", "number 1 is not finite"}},
        {4, &zero, {"row 1", "image size 16 x 0"}},
        {9, &huge, {"row 1", "absurd image size"}},
        {14, &zero, {"'view_00.png'", "fl_x = 0"}},
        {1, &seven, {"'view_00.png'", "not rigid"}},
        {15, &seven, {"row 1", "depths 7 and 6 are not"}},
        {15, &below, {"row 1", "depths -1 and 6 are not"}},
    };
    const char *folder = *state, *file = scratch_path(folder, "poses_bounds.npy");

    put_llff(folder);
    cut_everywhere(folder, file, 3);
    damage_everywhere(folder, file, 7);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char before[8], ignored[8], what[32];

        snprintf(what, sizeof what, "case %zu", i);
        patch(file, HEADER + 8 * cases[i].number, cases[i].value, 8, before);
        assert_refused(folder, plain(), cases[i].words, what);
        patch(file, HEADER + 8 * cases[i].number, before, 8, ignored);
    }
    put_image(folder, "images/z.png", 16, 12, 3, 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"poses_bounds.npy: poses of 6 images", "images has 7"},
                   "an image more");
    assert_int_equal(rename(scratch_path(folder, "images"), scratch_path(folder, "photos")), 0);
    assert_refused(folder, plain(), (const char *const[3]){"poses_bounds.npy", "no folder images"},
                   "no images");
}

static void test_neus(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const char *folder = *state, *file = scratch_path(folder, "cameras_sphere.npz");
    char before[1];

    format_cameras(cameras);
    format_images(scratch_path(folder, "image"), 1);
    format_neus(folder, cameras, false);
    patch(file, 125, "x", 1, before); /* in the first array's numbers */
    assert_refused(folder, plain(), (const char *const[3]){"world_mat_0", "checksum"}, "one byte");
    for (int deflate = 0; deflate < 2; deflate++) {
        format_neus(folder, cameras, deflate);
        cut_everywhere(folder, file, 31);
        damage_everywhere(folder, file, 13);
    }
    format_neus(folder, cameras, true);
    put_image(folder, "image/z.png", 16, 12, 3, 0);
    assert_refused(folder, plain(),
                   (const char *const[3]){"cameras_sphere.npz: cameras of 6 images", "image has 7"},
                   "an image more");
    assert_int_equal(remove(scratch_path(folder, "image/z.png")), 0);
    assert_int_equal(
        rename(scratch_path(folder, "image/view_02.png"), scratch_path(folder, "view_02.png")), 0);
    assert_refused(folder, plain(), (const char *const[3]){"cameras of 6 images", "image has 5"},
                   "an image less: the others' cameras would be their neighbours'");
    assert_int_equal(
        rename(scratch_path(folder, "view_02.png"), scratch_path(folder, "image/view_02.png")), 0);
    put_folder(folder, "mask");
    assert_refused(folder, plain(), (const char *const[3]){"mask: 0 masks for 6 images"},
                   "no masks");
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        char name[32];

        snprintf(name, sizeof name, "mask/%d.png", v);
        put_image(folder, name, 16, v < 5 ? 12 : 11, 3, 0);
    }
    assert_refused(folder, plain(), (const char *const[3]){"5.png", "16 x 11", "16 x 12"},
                   "mask's size");
    put_text(folder, "mask/5.png", "");
    assert_refused(folder, plain(), (const char *const[3]){"mask/5.png", "empty"}, "mask");
    assert_int_equal(rename(scratch_path(folder, "image"), scratch_path(folder, "photos")), 0);
    assert_refused(folder, plain(), (const char *const[3]){"cameras_sphere.npz", "no folder image"},
                   "no images");
}

/* Matrices that are not cameras. */
static void test_neus_matrices(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const char *folder = *state;

    for (int i = 0; i < 3; i++) {
        static const char *const words[3][3] = {
            {"camera 2 (of 'view_02.png')", "linearly dependent"},
            {"world_mat_2", "not finite"},
            {"camera 2 (of 'view_02.png')", "skew"},
        };
        cln_camera *c = &cameras[2];

        format_cameras(cameras);
        format_images(scratch_path(folder, "image"), 1);
        if (i == 0)
            c->c2w[0] = c->c2w[4] = c->c2w[8] = 0;
        if (i == 1)
            c->c2w[3] = NAN;
        if (i == 2) /* x axis towards y */
            for (int a = 0; a < 3; a++)
                c->c2w[4 * a] += 0.2 * c->c2w[4 * a + 1];
        format_neus(folder, cameras, false);
        assert_refused(folder, plain(), words[i], words[i][1]);
    }
}

/* ---- NSVF, OpenSfM ---- */

static void test_nsvf(void **state)
{
    static const struct {
        const char *file, *text, *words[3];
    } cases[] = {
        {"intrinsics.txt", "", {"intrinsics.txt", "neither a matrix"}},
        {"intrinsics.txt", "20 8 6\n", {"intrinsics.txt", "neither a matrix"}},
        {"intrinsics.txt", "f 8 6 0\n", {"intrinsics.txt: line 1", "'f 8 6 0'"}},
        {"intrinsics.txt", "nan 8 6 0\n", {"intrinsics.txt: line 1"}},
        {"intrinsics.txt", "0 8 6 0\n", {"view_00.png", "fl_x = 0"}},
        {"intrinsics.txt", "1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17", {"intrinsics.txt: line 1"}},
        {"pose/view_03.txt", "", {"pose/view_03.txt", "4x4", "it has 0"}},
        {"pose/view_03.txt", "1 0 0 0\n0 1 0 0\n", {"pose/view_03.txt", "it has 8"}},
        {"pose/view_03.txt", "1 0 0 inf\n", {"pose/view_03.txt: line 1"}},
        {"pose/view_03.txt", "1 0 0 0 0 1 0 0 0 0 2 0", {"'view_03.png'", "not rigid"}},
        {"bbox.txt", "-1 -1 -1 1 1\n", {"bbox.txt", "six numbers"}},
        {"bbox.txt", "-1 -1 1 1 1 -1 0.1\n", {"bbox.txt", "six numbers"}},
        {"rgb/view_03.png", "x", {"view_03.png", "not a PNG"}},
    };
    cln_camera cameras[FORMAT_VIEWS];
    char folder_name[16];

    format_cameras(cameras);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = NULL;

        snprintf(folder_name, sizeof folder_name, "%zu", i);
        folder = scratch_path(*state, folder_name);
        format_nsvf(folder, cameras, "", (int)i % 4);
        put_text(folder, cases[i].file, cases[i].text);
        assert_refused(folder, plain(), cases[i].words, cases[i].text);
    }
    assert_int_equal(rename(scratch_path(*state, "0/pose"), scratch_path(*state, "0/x")), 0);
    put_folder(*state, "0/pose");
    put_text(scratch_path(*state, "0"), "intrinsics.txt", "20 8 6 0\n");
    assert_refused(scratch_path(*state, "0"), plain(), (const char *const[3]){"no file in rgb"},
                   "no poses");
}

static void test_opensfm(void **state)
{
    static const replacement cases[] = {
        {"\"focal\": 1.25", "\"focal\": \"wide\"", {"'view_00.png'", "focal must be a number"}},
        {"\"focal\": 1.25", "\"focal\": 0", {"'view_00.png'", "no focal length"}},
        {"\"focal\": 1.25", "\"local\": 1", {"'view_00.png'", "no focal length"}},
        {"perspective", "dual", {"'view_00.png'", "projection_type dual", "perspective, simple"}},
        {"\"perspective\"", "7", {"'view_00.png'", "projection_type (no text)"}},
        {"\"width\": 16", "\"width\": -16", {"'view_00.png'", "image size -16 x 12"}},
        {"\"width\": 16", "\"width\": 40", {"view_00.png", "16 x 12", "40 x 12"}},
        {"\"camera\": \"v2 cam 0\"", "\"camera\": \"x\"", {"'view_00.png'", "camera 'x'"}},
        {"\"camera\": \"v2 cam 0\"", "\"camera\": 0", {"'view_00.png'", "not among"}},
        {"\"rotation\"", "\"spin\"", {"'view_00.png'", "rotation must be three numbers"}},
        {"\"translation\": [", "\"translation\": [1, ", {"'view_00.png'", "translation must"}},
        {"\"translation\": [",
         "\"translation\": [1e300, 0, 0], \"x\": [",
         {"view_00", "beyond 1e+12"}},
        {"view_00.png", "../..", {"reconstruction.json: shot '../..'", "names no image"}},
        {"view_00.png", "gone.png", {"1 of 6 images", "'gone.png'"}},
        {"\"shots\": {\n", "\"shats\": {\n", {"reconstruction.json", "no image has a pose"}},
        {"\"coordinates\"", "\"place\"", {"point '0'", "coordinates must be"}},
        {"}}]", "}}", {"reconstruction.json: line"}},
    };
    const char *folder = *state, *file = scratch_path(folder, "reconstruction.json");
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_opensfm(folder, cameras, "perspective", few_points, 2);
    replace_each(folder, file, cases, sizeof cases / sizeof *cases);
    cut_everywhere(folder, file, 101);
    damage_everywhere(folder, file, 29);
    put_text(folder, "reconstruction.json", "{}");
    assert_refused(folder, plain(), (const char *const[3]){"not an array of reconstructions"},
                   "{}");
    put_text(folder, "reconstruction.json", "[{\"shots\":{},\"cameras\":{}}]");
    assert_refused(folder, plain(), (const char *const[3]){"no image has a pose"}, "no shots");
}

/* Points that transforms.json names: texts of the good file replaced, each a sentence; damaged
 * anywhere. */
static void test_ply(void **state)
{
    static const replacement cases[] = {
        {"ply\n", "plyx\n", {"text.ply", "not a PLY file"}},
        {"format ascii", "format binary_big_endian", {"line 2", "not a format", "little-endian"}},
        {"element vertex", "element face", {"line 4", "not an element vertex"}},
        {"vertex 2", "vertex -2", {"line 4", "not an element vertex"}},
        {"vertex 2", "vertex 40000000", {"text.ply", "too short", "40000000 points"}},
        {"vertex 2", "vertex 3", {"text.ply", "too short", "3 points"}},
        {"float x", "float w", {"no x, y or z"}},
        {"float x", "list uchar x", {"line 5", "not a number"}},
        {"float x", "x", {"line 5", "without type or name"}},
        {"end_header", "end_of_header", {"neither an element nor"}},
        {"1 2 3 4 5 6", "1 2 3 4 5 blue", {"line 12", "no 6 numbers"}},
        {"1 2 3 4 5 6", "1 2 1e300 4 5 6", {"point 0", "nowhere"}},
        {"1 2 3 4 5 6", "1 2 inch 4 5 6", {"line 12", "no 6 numbers"}},
        {"1 2 3 4 5 6\n2 ", "1 2 nan 4 5 6\n-inf ", {"none of its 2 points", "NaN"}},
    };
    const char *folder = *state, *file = scratch_path(folder, "text.ply");

    format_images(scratch_path(folder, "images"), 1);
    format_ply(folder, "text.ply", false, few_points, 2);
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"ply_file_path\":\"text.ply\",\"frames\":[" FRAME(
                 "images/view_00.png", POSE_FRONT) "]}");
    replace_each(folder, file, cases, sizeof cases / sizeof *cases);
    format_ply(folder, "text.ply", true, few_points, 2);
    damage_everywhere(folder, file, 1);
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"ply_file_path\":7,\"frames\":[" FRAME("images/view_00.png",
                                                                              POSE_FRONT) "]}");
    assert_refused(folder, plain(), (const char *const[3]){"ply_file_path must be a string"}, "7");
}

typedef struct told {
    const char *wanted;
    int lines, warnings;
} told;

static void count_told(cln_log_level level, const char *line, void *user)
{
    told *t = user;

    t->lines += strstr(line, t->wanted) != NULL;
    t->warnings += level == CLN_LOG_WARN && strstr(line, "at the origin") != NULL;
}

/* A sensor's points: those without a place are left out and counted, many at the origin told: more
 * than 20, and a hundredth. */
static void test_sensor_points(void **state)
{
    enum { MOST = 2200 };
    static const struct {
        int count, none, zeros;
        bool binary, warned;
    } cases[] = {
        {1000, 0, 0, true, false},   {1000, 300, 0, true, false}, {1000, 300, 0, false, false},
        {1000, 0, 21, true, true},   {1000, 0, 20, true, false},  {1000, 300, 30, false, true},
        {1000, 980, 0, true, false}, {MOST, 0, 21, true, false},  {MOST, 0, 22, true, true}};
    const char *folder = *state;
    cln_point points[MOST];

    format_images(scratch_path(folder, "images"), 1);
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.1,\"ply_file_path\":\"a.ply\",\"frames\":[" FRAME(
                 "images/view_00.png", POSE_FRONT) "]}");
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        char counted[64];
        told t = {.wanted = counted};
        cln_scene *scene = NULL;

        snprintf(counted, sizeof counted, "%d of its %d points have no place", cases[k].none,
                 cases[k].count);
        memset(points, 0, sizeof points);
        for (int i = 0; i < cases[k].count; i++)
            for (int a = 0; a < 3; a++) {
                const int turn = i * (a + 1) * 7 % 20; /* the same places again and again */

                points[i].xyz[a] = i < cases[k].none ? (a == i % 3 ? (i % 2 ? NAN : -INFINITY) : 1)
                                   : i < cases[k].none + cases[k].zeros ? 0
                                                                        : 0.1 * turn - 1;
            }
        format_ply(folder, "a.ply", cases[k].binary, points, cases[k].count);
        cln_log_set_sink(count_told, &t);
        scene = load(folder, plain());
        cln_log_set_sink(NULL, NULL);
        assert_in_range((long)(1000 * scene->space.half), 1100, 1200);
        assert_int_equal(t.lines, cases[k].none > 0);
        assert_int_equal(t.warnings, cases[k].warned);
        cln_scene_free(scene);
    }
}

int test_group_broken_formats(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_colmap_binary, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_text, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_fields, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_lines, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colmap_images, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_llff, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_neus, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_neus_matrices, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_nsvf, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_opensfm, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_ply, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_sensor_points, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("broken_formats", tests, NULL, NULL);
}
