/* The choice of a reader for a path, and the sentence if none accepts it: it names the path's
 * contents, what is missing and the remedy. Also scenes whose folder and images have names with a
 * meaning to shells, patterns and JSON: they load, and `info` prints them unchanged. And what
 * becomes of the colours of a PLY file. */
#include "unit.h"
#include <jansson.h>
#include <sys/stat.h>
#include "base/files.h"
#include "base/settings.h"
#include "cl_nascent.h"
#include "outcome.h"
#include "scene/dataset.h"
#include "scene/reader.h"
#include "scene_fixture.h"
#include "tests.h"

typedef struct no_scene {
    const char *what;
    const char *files[8]; /* to create: "/" at the end makes a folder */
    const char *path;     /* to load: "" = the folder itself */
    const char *words[6];
} no_scene;

static const no_scene cases[] = {
    {"empty folder",
     {NULL},
     "",
     {"it is empty", "give the folder of a scene: photos with their poses"}},
    {"photos",
     {"IMG 10.JPG", "IMG 9.JPG", "more/x.png", ".hidden"},
     "",
     {"it holds 3 images (the first is 'IMG 9.JPG'); ", "photos alone",
      "`cl-nascent poses PHOTOS -o SCENE` or COLMAP"}},
    {"one photo", {"b.jpg"}, "", {"it holds an image ('b.jpg'); "}},
    {"COLMAP without images",
     {"images/1.jpg", "images/2.jpg", "sparse/0/cameras.bin", "sparse/0/points3D.bin"},
     "",
     {"it holds 2 images (the first is 'images/1.jpg'); ", "the COLMAP reader wants",
      "there are cameras, but no images beside them"}},
    {"COLMAP without cameras",
     {"sparse/images.txt"},
     "",
     {"there are images, but no cameras beside them"}},
    {"NSVF without poses",
     {"bbox.txt", "intrinsics.txt", "rgb/0.png"},
     "",
     {"it holds an image ('rgb/0.png'), 2 files (", "pose and rgb: it lacks one of them"}},
    {"zip file",
     {"scene.zip"},
     "scene.zip",
     {"scene.zip: not a scene: it is an archive", "unpack"}},
    {"packed notes are files", {"a.gz", "b.1.gz", "c.txt"}, "", {"it holds 3 files ("}},
    {"a packed folder", {"a.tar.gz"}, "", {"it holds an archive ('a.tar.gz')", "unpack"}},
    {"images of a scene",
     {"lego/transforms.json", "lego/images/1.png"},
     "lego/images",
     {"it holds an image ('1.png'); the folder around it, '", "lego', is a scene: give that one"}},
    {"a file of a scene",
     {"lego/transforms.json", "lego/notes.txt"},
     "lego/notes.txt",
     {"the folder around it, '", "lego', is a scene: give that one"}},
    {"a folder of a run",
     {"run/run.json", "run/checkpoint/1.safetensors"},
     "run/checkpoint",
     {"run', is a run: give that one"}},
    {"the folder around runs",
     {"r10/run.json", "r9/run.json", "r9/cameras.json"},
     "",
     {"it holds 2 folders (the first is 'r9'", "; its folder 'r9' is a run, which eval"}},
    {"folder with a zip file", {"a.zip"}, "", {"it holds an archive ('a.zip')", "unpack"}},
    {"video file",
     {"walk.MP4"},
     "walk.MP4",
     {"walk.MP4: not a scene: it is a video", "give the video to `cl-nascent poses`"}},
    {"folder with a video and a note",
     {"walk.mov", "notes.txt"},
     "",
     {"it holds a video ('walk.mov'), a file ('notes.txt'); ", "which takes pictures"}},
    {"image file", {"a.png"}, "a.png", {"it is an image", "give the folder of a scene"}},
    {"file of no kind", {"Makefile"}, "Makefile", {"it is a file", "give the folder of a scene"}},
    {"JSON of another name",
     {"cameras.json", "a.png"},
     "",
     {"it holds a JSON file ('cameras.json'), an image ('a.png'); ",
      "no frames are in that; if poses are",
      "as a transforms.json: docs/formats.md, \"Your own poses\""}}, /* below with frames */
    {"NeRF++, poses in files",
     {"rgb/a.png", "pose/a.txt", "intrinsics/a.txt"},
     "",
     {"files of poses", "(pose), an image ('rgb/a.png'); ", "\"Your own poses\""}},
    {"test without train",
     {"transforms_test.json"},
     "",
     {"transforms_train.json is missing beside the others"}},
    {"folders only", {"one/", "two/"}, "", {"it holds 2 folders (the first is 'one'); "}},
    {"the folder around a scene",
     {"lego 2/transforms_train.json", "lego 2/a.png"},
     "",
     {"its folder 'lego 2' is a scene: give that one"}},
    {"a folder around the folder around a scene",
     {"images/a.png", "outputs/sfm/transforms.json"},
     "",
     {"its folder 'outputs/sfm' is a scene: give that one"}},
    {"transforms JSON under a name of Windows",
     {"images/a.png", "transforms.json.txt"},
     "",
     {"photos alone"}}, /* of an x in it; below with frames */
    {"the folder around two scenes",
     {"b/transforms.json", "a/transforms.json", "c.txt"},
     "",
     {"its folder 'a' is a scene: give that one, or another"}},
};

static void put(const char *folder, const char *name)
{
    char *path = NULL, *slash = NULL;

    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    slash = strrchr(path, '/');
    *slash = 0;
    assert_int_equal(cln_make_dirs(path), CLN_OK);
    *slash = '/';
    if (slash[1])
        scratch_put(path, "x", 1);
    free(path);
}

static void test_not_a_scene(void **state)
{
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const no_scene *c = &cases[i];
        const char *folder = NULL;
        cln_scene *scene = NULL;
        char name[16];

        snprintf(name, sizeof name, "case %zu", i);
        put_folder(*state, name);
        folder = scratch_path(*state, name);
        for (int k = 0; k < 8 && c->files[k]; k++)
            put(folder, c->files[k]);
        assert_int_equal(
            try_load(c->path[0] ? scratch_path(folder, c->path) : folder, NULL, &scene), CLN_INPUT);
        assert_null(scene);
        if (!strstr(cln_error_text(), ": not a scene: "))
            fail_msg("%s: '%s'", c->what, cln_error_text());
        if (strlen(cln_error_text()) > 400) /* readers that found nothing of theirs are not named */
            fail_msg("%s: too long: '%s'", c->what, cln_error_text());
        for (int k = 0; k < 6 && c->words[k]; k++)
            if (!strstr(cln_error_text(), c->words[k]))
                fail_msg("%s: '%s' lacks '%s'", c->what, cln_error_text(), c->words[k]);
        cln_clear_error();
    }
}

/* A single JSON file is proposed only if it may be a scene's. */
static void test_frames_elsewhere(void **state)
{
    const char *folder = *state;
    cln_scene *scene = NULL;

    put_text(folder, "cameras.json", "{\"frames\": []}");
    assert_int_equal(try_load(folder, NULL, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "if its frames are in that, give the file: '"));
    cln_clear_error();
}

/* What is given in place of a run is told, with what to give. */
static void test_no_run(void **state)
{
    static const struct {
        const char *path, *words[2];
    } rows[] = {
        {"runs", {"runs: not a run, but its folder 'r9' is one: give that one, or another"}},
        {"runs/r9/checkpoint/00000111.safetensors", {"not a run, but in one: give ", "runs/r9"}},
        {"runs/r9/eval/00000111-test/a.png", {"not a run, but in one: give ", "runs/r9"}},
        {"pot", {"pot: a scene, not a run: train on it first, by `cl-nascent train ", "-o RUN`"}},
        {"torn", {"torn: a run without its run.json; copy the run again"}},
        {"m.glb", {"not a run: it is a mesh or point cloud; give the folder that"}},
        {"photos", {"not a run, as there is no run.json in it: it holds an image ('a.jpg')"}},
        {"gone", {"gone: no such folder; give the folder that"}},
    };
    static const char *const files[] = {"runs/r9/run.json",
                                        "runs/r10/run.json",
                                        "runs/r9/checkpoint/00000111.safetensors",
                                        "pot/transforms.json",
                                        "torn/checkpoint/latest",
                                        "m.glb",
                                        "runs/r9/eval/00000111-test/a.png",
                                        "photos/a.jpg"};

    for (size_t i = 0; i < sizeof files / sizeof files[0]; i++)
        put(*state, files[i]);
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        json_t *document = NULL;

        assert_int_equal(cln_reader_run(scratch_path(*state, rows[i].path), &document), CLN_INPUT);
        assert_null(document);
        for (int w = 0; w < 2 && rows[i].words[w]; w++)
            if (!strstr(cln_error_text(), rows[i].words[w]))
                fail_msg("%s: no '%s' in: %s", rows[i].path, rows[i].words[w], cln_error_text());
        cln_clear_error();
    }
}

/* A missing path, and a folder with an unreadable subfolder. */
static void test_unreadable(void **state)
{
    const char *folder = *state;
    cln_scene *scene = NULL;

    assert_int_equal(try_load(scratch_path(folder, "gone"), NULL, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "gone: No such file"));
    cln_clear_error();
    put(folder, "shut/a.png");
    assert_int_equal(chmod(scratch_path(folder, "shut"), 0), 0);
    assert_int_equal(try_load(folder, NULL, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "not a scene: it holds ")); /* root can read it */
    cln_clear_error();
    assert_int_equal(chmod(scratch_path(folder, "shut"), 0700), 0);
}

/* Names with a meaning to shells, regular expressions, printf, HTML, JSON or paths. */
static const char *const odd_names[] = {
    "a (1) [2].png",
    "b + c * d?.png",
    "quote ' and \" and `.png",
    "back\\slash $x.png",
    "<b>&amp;%s%n.png",
    "\xC3\xA9t\xC3\xA9 \xE6\x97\xA5\xE6\x9C\xAC.png",
    " -leading and trailing .png",
    "#1;{x}|y^~!.png",
};
enum { ODD = sizeof odd_names / sizeof *odd_names };

/* transforms.json over all odd names. */
static void put_odd_scene(const char *folder)
{
    json_t *frames = json_array(), *document = NULL;
    char *text = NULL;

    for (int i = 0; i < ODD; i++) {
        char pixels[8 * 6 * 3];
        json_t *pose = json_loads(POSE_FRONT, 0, NULL);

        memset(pixels, 20 * i, sizeof pixels);
        assert_int_equal(cln_image_write_png(scratch_path(folder, odd_names[i]), 8, 6, 3,
                                             (const uint8_t *)pixels),
                         CLN_OK);
        json_array_append_new(
            frames, json_pack("{s:s, s:o}", "file_path", odd_names[i], "transform_matrix", pose));
    }
    document =
        json_pack("{s:f, s:i, s:o}", "camera_angle_x", 0.8, "aabb_scale", 1, "frames", frames);
    text = json_dumps(document, 0);
    put_text(folder, "transforms.json", text);
    json_decref(document);
    free(text);
}

static void test_odd_names(void **state)
{
    static const char odd_folder[] = "s [1] (x+*) 'q' \"d\" \\ %s <i> \xC3\xBC \xE5\x9C\xB0";
    const char *folder = NULL;
    const cln_config config = default_config();
    cln_scene *scene = NULL;
    json_t *told = NULL;
    char *text = NULL;

    put_folder(*state, odd_folder);
    folder = scratch_path(*state, odd_folder);
    put_odd_scene(folder);
    scene = load(folder, NULL);
    assert_string_equal(scene->folder, folder);
    assert_int_equal(scene->view_count, ODD);
    for (int i = 0; i < ODD; i++) {
        const char *name = strchr(odd_names[i], '\\') ? "back/slash $x.png" : odd_names[i];
        bool there = false;

        for (int v = 0; v < ODD; v++) /* each has its own pixels */
            there = there || (!strcmp(scene->views[v].name, name) &&
                              scene->views[v].pixels[0] == (uint8_t)(20 * i));
        if (!there)
            fail_msg("no view '%s' with its pixels", name);
    }
    assert_int_equal(cln_info_scene(folder, &(cln_settings){.config = config}, &text), CLN_OK);
    told = json_loads(text, 0, NULL);
    assert_non_null(told);
    assert_string_equal(json_string_value(json_object_get(told, "folder")), folder);
    assert_int_equal(json_array_size(json_object_get(told, "cameras")), ODD);
    for (int v = 0; v < ODD; v++) {
        const json_t *row = json_array_get(json_object_get(told, "cameras"), (size_t)v);

        assert_string_equal(json_string_value(json_object_get(row, "name")), scene->views[v].name);
    }
    json_decref(told);
    free(text);
    cln_scene_free(scene);
    /* The same in a sentence. */
    assert_int_equal(remove(scratch_path(folder, odd_names[1])), 0);
    assert_int_equal(try_load(folder, NULL, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), odd_folder));
    assert_non_null(strstr(cln_error_text(), odd_names[1]));
    cln_clear_error();
}

/* JSON cannot contain a folder's name that is not UTF-8. */
static void test_name_not_utf8(void **state)
{
    const char *folder = NULL;
    const cln_config config = default_config();
    char *text = NULL;

    put_folder(*state, "caf\xE9");
    folder = scratch_path(*state, "caf\xE9");
    put_image(folder, "a.png", 8, 6, 3, 0);
    put_image(folder, "b.png", 8, 6, 3, 1);
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "a.png", POSE_FRONT) "," FRAME("b.png", POSE_FRONT) "]}");
    assert_int_equal(cln_info_scene(folder, &(cln_settings){.config = config}, &text), CLN_INPUT);
    assert_null(text);
    assert_non_null(strstr(cln_error_text(), "not UTF-8"));
    cln_clear_error();
}

/* The example of docs/formats.md, "Your own poses", is read as the page says. */
static void test_documented_example(void **state)
{
    static const char page_name[] = "docs/formats.md", begins[] = "```json\n{\n  \"camera_model\"";
    const double east[3] = {3, 1, 2.5}, both[3] = {2, 1, 1.5};
    const char *folder = *state;
    cln_config config = default_config();
    char *page = NULL, *example = NULL, *end = NULL;
    cln_scene *scene = NULL;
    double u = 0, v = 0, z = 0;
    size_t bytes = 0;

    if (!cln_is_file(page_name))
        skip(); /* not run from the repository's root */
    page = scratch_get(page_name, &bytes);
    example = strstr(page, begins);
    assert_non_null(example);
    end = strstr(example + 7, "```");
    assert_non_null(end);
    assert_non_null(strstr(end, "**up** in it, the third **backwards**"));
    assert_non_null(strstr(end, "(451.25, 108.75)"));
    *end = 0;
    put_folder(folder, "rgb");
    put_image(folder, "rgb/1305031102.175304.png", 640, 480, 3, 0);
    put_image(folder, "rgb/1305031102.275326.png", 640, 480, 3, 1);
    put_text(folder, "transforms.json", example + 8);
    config.holdout = 0;
    scene = load(folder, &config);
    assert_string_equal(scene->dialect, "nerfstudio");
    assert_int_equal(scene->view_count, 2);
    assert_null(json_array_get(scene->ignored, 0));
    assert_true(cln_camera_project(&scene->views[0].camera, east, &u, &v, &z));
    assert_float_equal(u, 451.25, 1e-9);
    assert_float_equal(v, 108.75, 1e-9);
    assert_float_equal(z, 4, 1e-9);
    for (int i = 0; i < 2; i++) { /* what both have in their middle */
        assert_true(cln_camera_project(&scene->views[i].camera, both, &u, &v, &z));
        assert_float_equal(u, 320, 1e-9);
        assert_float_equal(v, 240, 1e-9);
        assert_float_equal(z, 4 - i, 1e-9);
    }
    cln_scene_free(scene);
    free(page);
}

/* A point's colour has bytes, whatever the file has. */
static void test_colours_of_points(void **state)
{
    static const uint8_t wanted[2][3] = {{7, 200, 255}, {0, 255, 0}};
    cln_reader_result result = {0};
    const char *path = scratch_path(*state, "colours.ply");
    FILE *f = fopen(path, "w");

    assert_non_null(f);
    fprintf(f, "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
               "property float z\nproperty short red\nproperty short green\n"
               "property short blue\nend_header\n1 2 3 7 200 255\n4 5 6 -5 300 0\n");
    fclose(f);
    assert_ok(cln_dataset_read_ply(path, &result));
    assert_int_equal(result.point_count, 2);
    for (int i = 0; i < 2; i++)
        assert_memory_equal(result.points[i].rgb, wanted[i], 3);
    free(result.points);
}

int test_group_readers(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_not_a_scene, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_frames_elsewhere, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_no_run, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_unreadable, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_odd_names, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_name_not_utf8, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_documented_example, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_colours_of_points, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("readers", tests, NULL, NULL);
}
