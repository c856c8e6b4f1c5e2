/* Images that are not where the dataset names them: paths of another machine, and names in another
 * case. What is found is told once; what two files could be, or another frame has, is not taken. */
#include "unit.h"
#include <math.h>
#include "base/log.h"
#include "base/unicode.h"
#include "format_fixture.h"
#include "tests.h"

typedef struct kept_line {
    const char *wanted;
    int count;
    char text[512];
} kept_line;

static void keep_line(cln_log_level level, const char *line, void *user)
{
    kept_line *kept = user;

    (void)level;
    if (!strstr(line, kept->wanted))
        return;
    kept->count++;
    snprintf(kept->text, sizeof kept->text, "%s", line);
}

/* Loads the scene, of which `count` files are found elsewhere; the log has `words` then. */
static cln_scene *load_moved(const char *folder, const cln_config *config, int count,
                             const char *words)
{
    kept_line kept = {.wanted = "not where it says"};
    char counted[32];
    cln_scene *scene = NULL;
    cln_status st;

    cln_log_to(CLN_LOG_INFO, keep_line, &kept);
    st = try_load(folder, config, &scene);
    cln_log_to(CLN_LOG_INFO, NULL, NULL);
    if (st != CLN_OK)
        fail_msg("%s: %s", folder, cln_error_text());
    if (kept.count != (count > 0))
        fail_msg("told %d times: %s", kept.count, kept.text);
    snprintf(counted, sizeof counted, ": %d of", count);
    if (count && (!strstr(kept.text, counted) || !strstr(kept.text, words)))
        fail_msg("'%s' lacks '%s' or '%s'", kept.text, counted, words);
    return scene;
}

static cln_config all_train(void)
{
    cln_config config = default_config();

    config.holdout = 0;
    return config;
}

#define SCENE(frames) "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" frames "]}"
#define ONE(file)     SCENE(FRAME(file, POSE_FRONT))
#define TWO(a, b)     SCENE(FRAME(a, POSE_FRONT) "," FRAME(b, POSE_FRONT))

/* One frame, images that are there, and the one that it is. */
static void test_one(void **state)
{
    static const struct {
        const char *json, *there[3], *found;
    } cases[] = {
        {ONE("/home/somebody/data/images/x.png"), {"images/x.png"}, "images/x.png"},
        {ONE("/home/somebody/data/images/x"), {"images/x.png"}, "images/x.png"},
        {ONE("/home/data/images/x.png"), {"images/x.png", "small/x.png"}, "images/x.png"},
        {ONE("/home/data/images/x.png"),
         {"images/x.png", "data/images/x.png"},
         "data/images/x.png"},
        {ONE("/home/images/x.png"), {"x.png", "images/x.png"}, "images/x.png"},
        {ONE("C:\\\\Users\\\\me\\\\scan\\\\images\\\\x.png"), {"images/x.png"}, "images/x.png"},
        {ONE("\\\\\\\\nas\\\\scan\\\\x.png"), {"scan/x.png", "x.png"}, "scan/x.png"},
        {ONE("../../data/images/x.png"), {"images/x.png"}, "images/x.png"},
        {ONE("data/fox/images/x.png"), {"images/x.png"}, "images/x.png"},
        {ONE("/home/somebody/x.png"), {"photos/x.png"}, "photos/x.png"},
        {ONE("/home/somebody/x.png"), {"x.png"}, "x.png"},
        {ONE("images/x.png"), {"photos/x.png"}, "photos/x.png"},
        {ONE("sub1/x.png"), {"images/x.png", "masks/x.png"}, "images/x.png"},
        {ONE("images/IMG_1.PNG"), {"images/img_1.png"}, "images/img_1.png"},
        {ONE("images/img_1.png"), {"Images/img_1.PNG"}, "Images/img_1.PNG"},
        {ONE("IMG_1"), {"img_1.png"}, "img_1.png"},
        {ONE("/home/Images/IMG_1.PNG"), {"images/img_1.png"}, "images/img_1.png"},
        {ONE("/home/images/a.png"),
         {"images/A.png", "images/a.PNG", "images/a.png"},
         "images/a.png"},
    };
    const cln_config config = all_train();

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char name[16];
        const char *folder = NULL;
        cln_scene *scene = NULL;

        snprintf(name, sizeof name, "%zu", i);
        put_folder(*state, name);
        folder = scratch_path(*state, name);
        put_text(folder, "transforms.json", cases[i].json);
        for (int k = 0; k < 3 && cases[i].there[k]; k++) {
            char *path = NULL;

            assert_int_equal(cln_path_join(&path, folder, cases[i].there[k]), CLN_OK);
            if (strchr(cases[i].there[k], '/')) {
                *strrchr(path, '/') = 0;
                assert_int_equal(cln_make_dirs(path), CLN_OK);
            }
            free(path);
            put_image(folder, cases[i].there[k], 16, 12, 3, k);
        }
        scene = load_moved(folder, &config, 1, cases[i].found);
        assert_string_equal(scene->views[0].path, scratch_path(folder, cases[i].found));
        assert_int_equal(scene->views[0].camera.width, 16); /* the image's, as the file has none */
        assert_true(cln_view_is_loaded(&scene->views[0]));
        cln_scene_free(scene);
    }
}

/* Nothing is taken that is not clear. */
static void test_unclear(void **state)
{
    static const struct {
        const char *json, *there[2], *words[3];
    } cases[] = {
        {ONE("/home/somebody/x.png"),
         {"a/x.png", "b/x.png"},
         {"1 of 1 images is not there", "2 files there are called so", "correct the dataset"}},
        {ONE("images/img.png"), {"images/IMG.png", "images/Img.png"}, {"2 files there"}},
        {TWO("images/x.png", "images/y.png"), {"photos/x.png"}, {"photos/x.png is there: move it"}},
        {ONE("images/x.png"), {"a/x.png", "b/x.png"}, {"2 files there are called so"}},
        {TWO("sub1/x.png", "sub2/x.png"), {"images/x.png"}, {"2 of 2 images"}},
        {ONE("/home/somebody/y.png"), {"x.png"}, {"(the first should be /home/somebody/y.png);"}},
        {ONE("images/x.png"), {"a/X.tif"}, {"/a/X.tif is there, in a format that is not read"}},
        {ONE("images/x.png"), {"a/xy.tif"}, {"1 of 1 images is not there", "; restore it"}},
        {ONE("/home/somebody/x.png"), {"x.jpg"}, {"1 of 1 images is not there"}},
        /* two cameras, the images of one */
        {TWO("/home/cam0/1.png", "/home/cam1/1.png"), {"images/1.png"}, {"2 of 2 images"}},
        {TWO("cam0/1.png", "/home/cam1/1.png"),
         {"cam0/1.png"},
         {"1 of 2 images", "'home/cam1/1.png'"}},
        {TWO("/home/cam0/1.png", "/home/cam1/1.png"),
         {"cam0/1.png"},
         {"1 of 2", "'home/cam1/1.png'"}},
    };
    const cln_config config = all_train();

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char name[16];
        const char *folder = NULL;

        snprintf(name, sizeof name, "%zu", i);
        folder = scratch_path(*state, name);
        for (const char *const *f =
                 (const char *const[]){"a", "b", "images", "photos", "cam0", NULL};
             *f; f++)
            put_folder(folder, *f);
        put_text(folder, "transforms.json", cases[i].json);
        for (int k = 0; k < 2 && cases[i].there[k]; k++)
            put_image(folder, cases[i].there[k], 16, 12, 3, k);
        assert_refused(folder, &config, cases[i].words, cases[i].json);
    }
}

/* A held-out photo that was not copied is not the training photo of the same name. */
static void test_splits(void **state)
{
    const char *folder = *state;
    cln_scene *scene = NULL;

    put_folder(folder, "train");
    put_folder(folder, "test");
    put_image(folder, "train/r_0.png", 16, 12, 3, 0);
    put_text(folder, "transforms_train.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("/data/lego/train/r_0", POSE_FRONT) "]}");
    put_text(folder, "transforms_test.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("/data/lego/test/r_0", POSE_FRONT) "]}");
    assert_refused(folder, NULL,
                   (const char *const[3]){"1 of 2 images is not there ('data/lego/test/r_0')",
                                          "train/r_0.png is there"},
                   "test is missing");
    put_image(folder, "test/r_0.png", 16, 12, 3, 1);
    scene = load_moved(folder, NULL, 2, "train/r_0.png");
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 1);
    cln_scene_free(scene);
    /* the same frame in both splits is one photo */
    put_text(folder, "transforms_test.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("/data/lego/train/r_0", POSE_FRONT) "]}");
    scene = load_moved(folder, NULL, 2, "train/r_0.png");
    cln_scene_free(scene);
}

/* What is found elsewhere is there for --missing; what is not is counted as ever. */
static void test_missing_rule(void **state)
{
    enum { FRAMES = 24 };
    const char *folder = *state;
    cln_config config = default_config();
    char text[8192] = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[";
    cln_scene *scene = NULL;

    put_folder(folder, "images");
    for (int i = 0; i < FRAMES; i++) {
        char name[32];

        snprintf(text + strlen(text), sizeof text - strlen(text),
                 "%s{\"file_path\":\"/home/x/images/%02d.png\",\"transform_matrix\":" POSE_FRONT
                 "}",
                 i ? "," : "", i);
        snprintf(name, sizeof name, "images/%02d.png", i);
        if (i != 3)
            put_image(folder, name, 8, 6, 3, i);
    }
    strcat(text, "]}");
    put_text(folder, "transforms.json", text);
    scene = load_moved(folder, &config, FRAMES - 1, "images/00.png for /home/x/images/00.png");
    assert_int_equal(scene->missing, 1);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 3);
    cln_scene_free(scene);
    config.missing = CLN_MISSING_FAIL;
    assert_refused(folder, &config, (const char *const[3]){"'home/x/images/03.png'"}, "fail");
    put_image(folder, "images/03.PNG", 8, 6, 3, 3);
    scene = load_moved(folder, &config, FRAMES, "images/00.png");
    assert_int_equal(scene->missing, 0);
    cln_scene_free(scene);
}

/* Masks and points with such paths; a mask is never an image of that name. */
static void test_masks_and_points(void **state)
{
    static const cln_point points[2] = {{{1, 2, 3}, {4, 5, 6}, 2, 0}, {{2, 2, 3}, {4, 5, 6}, 3, 0}};
    static const char json[] =
        "{\"camera_angle_x\":0.8,\"ply_file_path\":\"/home/x/scan/sparse.ply\",\"frames\":[{"
        "\"file_path\":\"/home/x/scan/images/a.png\",\"mask_path\":\"/home/x/scan/masks/a.png\","
        "\"transform_matrix\":" POSE_FRONT "}]}";
    static const char alpha[] =
        "{\"camera_angle_x\":0.8,\"frames\":[{\"file_path\":\"/home/x/scan/images/a.png\","
        "\"alpha_path\":\"/home/x/scan/masks/a.png\",\"transform_matrix\":" POSE_FRONT "}]}";
    const char *folder = *state;
    const cln_config config = all_train();
    cln_scene *scene = NULL;
    kept_line kept = {.wanted = "sparse.ply"};

    put_folder(folder, "images");
    put_folder(folder, "masks");
    put_image(folder, "images/a.png", 16, 12, 3, 0);
    put_text(folder, "transforms.json", json);
    assert_refused(
        folder, &config,
        (const char *const[3]){"there is no mask /home/x/scan/masks/a.png", "restore it"},
        "no mask");
    put_text(folder, "transforms.json", alpha);
    assert_refused(folder, &config,
                   (const char *const[3]){"there is no mask /home/x/scan/masks/a.png",
                                          "remove alpha_path (then", "opaque"},
                   "no alpha");
    put_text(folder, "transforms.json", json);
    put_image(folder, "masks/a.png", 16, 12, 3, 1);
    format_ply(folder, "sparse.ply", true, points, 2);
    cln_log_set_sink(keep_line, &kept);
    assert_int_equal(try_load(folder, &config, &scene), CLN_OK);
    cln_log_set_sink(NULL, NULL);
    assert_int_equal(kept.count, 0); /* no warning that the points are not there */
    assert_string_equal(scene->views[0].mask_path, scratch_path(folder, "masks/a.png"));
    cln_scene_free(scene);
}

/* COLMAP's and OpenSfM's names in another case, also beside smaller copies, and with folders that
 * are not there. */
static void test_names(void **state)
{
    static const char *const renamed[][2] = {
        {"images/view_00.png", "images/VIEW_00.PNG"},
        {"images/view_01.png", "images/View_01.png"},
    };
    cln_camera cameras[FORMAT_VIEWS];
    const cln_config *config = plain();
    const char *folder = *state;
    char name[64], to[64];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    for (int i = 0; i < 2; i++)
        assert_int_equal(
            rename(scratch_path(folder, renamed[i][0]), scratch_path(folder, renamed[i][1])), 0);
    cln_scene_free(load_moved(folder, config, 2, "as images/VIEW_00.PNG for images/view_00.png"));
    for (int i = 2; i < FORMAT_VIEWS; i++) {
        snprintf(name, sizeof name, "images/view_%02d.png", i);
        snprintf(to, sizeof to, "images/VIEW_%02d.PNG", i);
        assert_int_equal(rename(scratch_path(folder, name), scratch_path(folder, to)), 0);
    }
    put_folder(folder, "images_2");
    put_image(folder, "images_2/VIEW_00.PNG", 8, 6, 3, 0);
    cln_scene_free(
        load_moved(folder, config, FORMAT_VIEWS, "as images/VIEW_00.PNG for images/view_00.png"));
    assert_int_equal(rename(scratch_path(folder, "sparse"), scratch_path(folder, ".sparse")), 0);
    format_opensfm(folder, cameras, "perspective", NULL, 0);
    cln_scene_free(
        load_moved(folder, config, FORMAT_VIEWS, "as images/VIEW_00.PNG for images/view_00.png"));
}

/* Names in the other Unicode form, composed or decomposed, of photos and of their masks. */
static void test_unicode(void **state)
{
    static const char *const names[2] = {"S\xc3\xbc"
                                         "d.png",
                                         "Su\xcc\x88"
                                         "d.png"};
    const cln_config config = all_train();
    char *form = cln_unicode_form(names[0], false);

    if (!form) {
        print_message("moved: built without utf8proc\n");
        skip();
    }
    assert_string_equal(form, names[1]);
    free(form);
    form = cln_unicode_form(names[1], true);
    assert_string_equal(form, names[0]);
    free(form);
    assert_null(cln_unicode_form(names[0], true));
    assert_null(cln_unicode_form("\xff", false));
    for (int i = 0; i < 2; i++) {
        const char *folder = scratch_path(*state, i ? "composed" : "decomposed");
        char name[64], json[1024];
        cln_scene *scene = NULL;

        put_folder(folder, "images");
        put_folder(folder, "m");
        snprintf(name, sizeof name, "images/%s", names[!i]);
        put_image(folder, name, 16, 12, 3, 0);
        snprintf(name, sizeof name, "m/%s", names[!i]);
        put_image(folder, name, 16, 12, 3, 1);
        snprintf(json, sizeof json,
                 "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[{\"file_path\":"
                 "\"images/%s\",\"mask_path\":\"m/%s\",\"transform_matrix\":" POSE_FRONT "}]}",
                 names[i], names[i]);
        put_text(folder, "transforms.json", json);
        scene = load_moved(folder, &config, 1, "another Unicode form");
        assert_string_equal(scene->views[0].mask_path, scratch_path(folder, name));
        cln_scene_free(scene);
    }
}

/* COLMAP's names lack the folder of images that a photo lies in: it is taken where it is the only
 * one of its name, but for masks and smaller copies. */
static void test_bare_names(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const cln_config *config = plain();
    const char *folder = *state;
    cln_scene *scene = NULL;
    char slash[512];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    for (const char *const *f = (const char *const[]){"cam1", "masks", NULL}; *f; f++)
        put_folder(scratch_path(folder, "images"), *f);
    put_folder(folder, "images_2");
    put_image(folder, "images/masks/view_03.png", 16, 12, 3, 0);
    put_image(folder, "images_2/view_03.png", 8, 6, 3, 0);
    assert_int_equal(rename(scratch_path(folder, "images/view_03.png"),
                            scratch_path(folder, "images/cam1/view_03.png")),
                     0);
    cln_scene_free(
        load_moved(folder, config, 1, "as images/cam1/view_03.png for images/view_03.png"));
    assert_int_equal(remove(scratch_path(folder, "images/cam1/view_03.png")), 0);
    assert_refused(folder, config, (const char *const[3]){"1 of 6 images is not there"},
                   "masks and smaller copies alone");
    put_image(folder, "images/cam1/view_03.png", 16, 12, 3, 0);
    put_folder(folder, "images/cam2");
    put_image(folder, "images/cam2/view_03.png", 16, 12, 3, 1);
    snprintf(slash, sizeof slash, "%s/", folder);
    assert_int_equal(try_load(slash, config, &scene), CLN_INPUT);
    if (!strstr(cln_error_text(), "files there are called so") || strstr(cln_error_text(), "//"))
        fail_msg("two of that name: %s", cln_error_text());
    cln_clear_error();
}

/* Where only smaller copies are left, as of a capture that should take less room, the first of
 * their folders counts. */
static void test_smaller_copies(void **state)
{
    static const char *const folders[] = {"images_4", "images_2"};
    const cln_config config = all_train();
    const char *folder = *state;
    cln_scene *scene = NULL;

    for (int i = 0; i < 2; i++) {
        char a[32], b[32];

        put_folder(folder, folders[i]);
        snprintf(a, sizeof a, "%s/a.png", folders[i]);
        snprintf(b, sizeof b, "%s/b.png", folders[i]);
        put_image(folder, a, 8 << i, 6 << i, 3, 0);
        put_image(folder, b, 8 << i, 6 << i, 3, 1);
    }
    put_text(folder, "transforms.json",
             "{\"w\":32,\"h\":24,\"fl_x\":40,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "images/a.png", POSE_FRONT) "," FRAME("images/b.png", POSE_FRONT) "]}");
    scene = load_moved(folder, &config, 2, "images_2/a.png");
    assert_int_equal(scene->views[0].camera.width, 16);
    assert_true(fabs(scene->views[0].camera.fx - 20) < 1e-9);
    cln_scene_free(scene);
}

/* COLMAP's undistorted photos have the names of the others: they are not taken for these, all or
 * one, as another model is beside them; the model's own folder is no other scene. */
static void test_undistorted(void **state)
{
    cln_camera cameras[FORMAT_VIEWS];
    const cln_config *config = plain();
    const char *folder = *state;

    format_cameras(cameras);
    format_images(scratch_path(folder, "dense/0/images"), 1);
    format_colmap(scratch_path(folder, "dense/0/sparse"), true, cameras, NULL, NULL, 0);
    cameras[0].k1 = -0.16;
    format_colmap(scratch_path(folder, "sparse/0"), true, cameras, NULL, NULL, 0);
    assert_refused(folder, config,
                   (const char *const[3]){"none of its 6 images", "its folder 'dense/0' is a scene",
                                          "give that one"},
                   "undistorted photos");
    cln_scene_free(load_moved(scratch_path(folder, "dense/0"), config, 0, ""));
    put_text(folder, "poses.json", ONE("/data/images/view_03.png"));
    assert_refused(scratch_path(folder, "poses.json"), config,
                   (const char *const[3]){"1 of 1 images is not there",
                                          "'dense/0', which has a photo of that name", "give that"},
                   "of a file");
    format_images(scratch_path(folder, "images"), 1);
    cln_scene_free(load_moved(folder, config, 0, ""));
    assert_int_equal(remove(scratch_path(folder, "images/view_03.png")), 0);
    assert_refused(folder, config,
                   (const char *const[3]){"1 of 6 images is not there", "its folder 'dense/0'",
                                          "give that one"},
                   "one of them");
    format_images(scratch_path(folder, "else/flat"), 1); /* photos beside their model */
    format_colmap(scratch_path(folder, "else/flat"), true, cameras, NULL, NULL, 0);
    format_colmap(scratch_path(folder, "else/sparse"), true, cameras, NULL, NULL, 0);
    assert_refused(scratch_path(folder, "else"), config,
                   (const char *const[3]){"'flat' is a scene: give that one"}, "flat");
    cln_scene_free(load_moved(scratch_path(folder, "else/flat"), config, 0, ""));
    format_images(scratch_path(folder, "own/colmap/in/here"), 1);
    format_colmap(scratch_path(folder, "own/colmap/sparse/0"), true, cameras, NULL, NULL, 0);
    cln_scene_free(load_moved(scratch_path(folder, "own"), config, FORMAT_VIEWS, "colmap/in/here"));
}

int test_group_moved(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_one, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_unclear, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_splits, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_missing_rule, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_masks_and_points, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_names, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_unicode, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bare_names, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_smaller_copies, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_undistorted, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("moved", tests, NULL, NULL);
}
