/* Captures of phones' apps: Polycam's raw data (scene/reader_polycam.c) and Record3D's
 * (reader_record3d.c). Poses and intrinsics against a scene of known cameras; the cube by depth
 * images; pixels along the edges of corrected photos; what is left out, and what is refused. */
#include "unit.h"
#include <unistd.h>
#include "near.h"
#include "phone_fixture.h"
#include "render/up.h"
#include "tests.h"

/* Rays at the corners and inside, against those of the camera of the view's number. */
static void assert_rays(const cln_scene *scene, const cln_camera *cameras, double size)
{
    assert_int_equal(scene->view_count, FORMAT_VIEWS);
    for (int i = 0; i < FORMAT_VIEWS; i++) {
        const cln_view *view = &scene->views[i];
        const char *digits = strstr(view->name, "view_");
        const cln_camera *exact = &cameras[atoi(digits ? digits + 5 : view->name)];

        for (int p = 0; p < 9; p++) {
            const double u = (p % 3) * 0.5 * exact->width, v = (p / 3) * 0.5 * exact->height;
            double o[3], d[3], origin[3], direction[3];

            assert_true(cln_camera_ray(exact, u, v, o, d));
            assert_true(cln_camera_ray(&view->camera, u * size, v * size, origin, direction));
            for (int k = 0; k < 3; k++) {
                assert_near(origin[k], o[k], 1e-9);
                assert_near(direction[k], d[k], 1e-9);
            }
        }
    }
}

static void own_intrinsics(cln_camera *cameras)
{
    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        cameras[v].fx = 20 + 0.5 * v;
        cameras[v].fy = 21 + v;
        cameras[v].cx = 7.25;
        cameras[v].cy = 6.5 + 0.125 * v;
    }
}

/* The capture's folder and its keyframes; photos as taken, and corrected ones, which go first. */
static void test_polycam(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS], raw[FORMAT_VIEWS];
    cln_scene *scene = NULL;
    double up[3];
    int warnings = 0;

    own_intrinsics(cameras);
    memcpy(raw, cameras, sizeof raw);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        raw[v].c2w[3] += 0.01 * v;
    phone_polycam(folder, raw, false, 1);
    scratch_put(scratch_path(folder, "mesh_info.json"), "{}", 2);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    for (int i = 0; i < 2; i++) {
        scene = load(i ? scratch_path(folder, "keyframes") : folder, plain());
        assert_string_equal(scene->dialect, "Polycam");
        assert_non_null(strstr(scene->because, "not corrected ones"));
        assert_rays(scene, raw, 1);
        assert_true(scene->views[0].edge == 0 && scene->views[0].left_out == 0);
        assert_true(scene->space.shell);
        assert_true(cln_up_of_cameras(scene, up)); /* whichever way the phone was held */
        assert_true(up[0] == 0 && up[1] == 1 && up[2] == 0);
        cln_scene_free(scene);
    }
    assert_int_equal(warnings, 0);
    put_image(folder, "keyframes/images/extra.png", 16, 12, 3, 0);
    cln_scene_free(load(folder, plain()));
    assert_int_equal(warnings, 1);
    put_folder(folder, "keyframes/corrected_images"); /* a correction that failed */
    put_folder(folder, "keyframes/corrected_cameras");
    scene = load(folder, plain());
    assert_non_null(strstr(scene->because, "not corrected ones"));
    cln_scene_free(scene);
    phone_polycam(folder, cameras, true, 4);
    scene = load(folder, plain());
    assert_non_null(strstr(scene->because, "corrected ones; 15 pixels"));
    assert_rays(scene, cameras, 4);
    assert_int_equal(scene->views[0].edge, 15);
    cln_scene_free(scene);
    for (int v = 0; v < FORMAT_VIEWS; v++) { /* newer captures have no sizes there */
        char name[64], *text = NULL, *at = NULL;
        size_t bytes = 0;

        snprintf(name, sizeof name, "keyframes/corrected_cameras/view_%02d.json", v);
        text = scratch_get(scratch_path(folder, name), &bytes);
        while ((at = strstr(text, "\"width\"")) || (at = strstr(text, "\"height\"")))
            memcpy(at + 1, "oth", 3);
        scratch_put(scratch_path(folder, name), text, bytes);
        free(text);
    }
    scene = load(folder, plain());
    assert_rays(scene, cameras, 4);
    cln_scene_free(scene);
    { /* nor does a photo tell that cannot be read: it is left out */
        cln_config config = *plain();

        config.missing = CLN_MISSING_SKIP;
        scratch_put(scratch_path(folder, "keyframes/corrected_images/view_03.png"), "x", 1);
        scene = load(folder, &config);
        assert_true(scene->view_count == FORMAT_VIEWS - 1 && scene->unreadable == 1);
        cln_scene_free(scene);
    }
}

/* A converter's file in the capture goes first, and is told. */
static void test_converted(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    cln_scene *scene = NULL;
    int warnings = 0;

    format_cameras(cameras);
    phone_polycam(folder, cameras, false, 1);
    format_images(scratch_path(folder, "images"), 1);
    format_transforms(folder, "instant-ngp", cameras);
    cln_log_set_sink(scratch_count_warnings, &warnings);
    scene = load(folder, &config);
    assert_string_equal(scene->dialect, "instant-ngp");
    assert_int_equal(warnings, 1);
    cln_scene_free(scene);
    config.format = CLN_FORMAT_POLYCAM;
    scene = load(folder, &config);
    assert_string_equal(scene->dialect, "Polycam");
    assert_int_equal(warnings, 1);
    cln_scene_free(scene);
}

/* Of corrected photos 15 pixels along each edge do not count; fewer of smaller copies. */
static void test_edges(void **state)
{
    static const int edges[] = {0, 15, 8, 5}; /* by --downscale */
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_config config = *plain();
    cln_scene *scene = NULL;

    format_cameras(cameras);
    cameras[3].fx = 19; /* cameras differ, maps do not */
    phone_polycam(folder, cameras, true, 4);
    for (int n = 1; n <= 3; n++) {
        const cln_view *view = NULL;
        int64_t left_out = 0;

        config.downscale = n;
        scene = load(folder, &config);
        view = &scene->views[3];
        assert_int_equal(view->camera.width, 64 / n);
        for (int y = 0; y < view->camera.height; y++)
            for (int x = 0; x < view->camera.width; x++) {
                const int e = edges[n];
                const bool inside =
                    x >= e && y >= e && x < view->camera.width - e && y < view->camera.height - e;

                assert_true(cln_view_keeps(view, x, y) == inside);
                left_out += !inside;
            }
        assert_int_equal(view->left_out, left_out);
        assert_ptr_equal(view->kept, scene->views[0].kept);
        assert_int_equal(cln_scene_fold(scene).views, 0); /* it is none of a lens */
        cln_scene_free(scene);
    }
    config.downscale = 1;
    format_images(scratch_path(folder, "keyframes/corrected_images"), 2); /* smaller photos */
    scene = load(folder, &config);
    assert_int_equal(scene->views[0].edge, 8);
    cln_scene_free(scene);
    phone_polycam(folder, cameras, true, 2);
    assert_int_equal(try_load(folder, &config, &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "are all edge"));
    cln_clear_error();
}

/* Depths tell where the scene is: a ball; what is unsure of them, and what is too far, does not. */
static void test_depths(void **state)
{
    static const double centre[3] = {1, 2, 3};
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    format_cameras(cameras);
    phone_polycam(folder, cameras, false, 1);
    scene = load(folder, plain());
    assert_null(strstr(scene->bounds_rule, "points"));
    cln_scene_free(scene);
    phone_depths(folder, cameras, centre, 1, true, 4000);
    scene = load(folder, plain());
    if (!strstr(scene->bounds_rule, " points of depth images and what the images show"))
        fail_msg("%s", scene->bounds_rule);
    assert_true(scene->has_box);
    for (int a = 0; a < 3; a++) { /* photos show a little beside the ball */
        assert_true(scene->box[a] < centre[a] - 0.8 && scene->box[a] > centre[a] - 3);
        assert_true(scene->box[3 + a] > centre[a] + 0.8 && scene->box[3 + a] < centre[a] + 3);
    }
    cln_scene_free(scene);
    /* A damaged one is none, and so is one of 8 bits. */
    scratch_put(scratch_path(folder, "keyframes/depth/view_00.png"), "x", 1);
    phone_grey(scratch_path(folder, "keyframes/depth"), "view_01.png", false, 2, 1,
               (const uint16_t[2]){9, 9});
    scene = load(folder, plain());
    assert_non_null(strstr(scene->bounds_rule, " points of depth images"));
    cln_scene_free(scene);
}

/* Each point is on the ball, whose depths are in whole millimetres; without confidences, what is
 * beside it counts as far as the sensor measures: 5 m. */
static void test_points(void **state)
{
    static const struct {
        bool rated, all;
        uint16_t beside;
    } cases[] = {{true, true, 4000}, {false, false, 4990}, {false, true, 5010}};
    static const double centre[3] = {1, 2, 3};
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];

    own_intrinsics(cameras);
    phone_polycam(folder, cameras, false, 1);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        cln_reader_result result = {0};
        int on = 0;

        phone_depths(folder, cameras, centre, 1, cases[k].rated, cases[k].beside);
        for (int v = 0; v < FORMAT_VIEWS && k == 1; v++) {
            char name[64];

            snprintf(name, sizeof name, "keyframes/confidence/view_%02d.png", v);
            assert_int_equal(unlink(scratch_path(folder, name)), 0);
        }
        assert_int_equal(cln_reader_polycam.read(folder, &result), CLN_OK);
        for (int i = 0; i < result.point_count; i++) {
            double square = 0;

            for (int a = 0; a < 3; a++)
                square +=
                    (result.points[i].xyz[a] - centre[a]) * (result.points[i].xyz[a] - centre[a]);
            on += fabs(sqrt(square) - 1) < 2e-3;
        }
        assert_in_range(on, 100, 6 * 108);
        assert_true(cases[k].all ? on == result.point_count : on < result.point_count);
        for (int i = 0; i < result.view_count; i++) {
            free(result.views[i].name);
            free(result.views[i].path);
            free(result.views[i].depth.depth);
            free(result.views[i].depth.confidence);
        }
        free(result.views);
        free(result.points);
        free(result.because);
    }
}

/* Depth images that frames of a transforms file name, in units of the file's, where it has no other
 * points: the ball again, of a lens with distortion. */
static void test_depths_of_transforms(void **state)
{
    static const double centre[3] = {1, 2, 3};
    const char *folder = *state, *file = scratch_path(folder, "transforms.json");
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    for (int v = 0; v < FORMAT_VIEWS; v++)
        cameras[v].k1 = -0.05;
    format_images(scratch_path(folder, "images"), 1);
    phone_depths(folder, cameras, centre, 1, true, 0);
    /* without depths; in a wrong unit of the file's, which is told; in
     * nerfstudio's; in one of the file's */
    for (int i = 0; i < 4; i++) {
        static const char frame[] = "{\"file_path\": \"./images/view_";
        char *text = NULL, *from = NULL, *at = NULL;
        cln_scene *scene = NULL;
        size_t bytes = 0;
        FILE *f = NULL;

        format_transforms(folder, "nerfstudio", cameras);
        text = from = scratch_get(file, &bytes);
        f = fopen(file, "wb");
        assert_non_null(f);
        fprintf(f, "%s",
                i == 1   ? "{\"integer_depth_scale\": 0.1, "
                : i == 3 ? "{\"integer_depth_scale\": 0.001, \"depth_unit_scale_factor\": 7, "
                         : "{");
        for (from++; i && (at = strstr(from, frame)); from = at + sizeof frame - 1) {
            fwrite(from, 1, (size_t)(at - from), f);
            fprintf(f, "{\"%s\": \"keyframes/depth/view_%.2s.png\", %s",
                    i % 2 ? "depth_path" : "depth_file_path", at + sizeof frame - 1, frame + 1);
        }
        fprintf(f, "%s", from);
        fclose(f);
        free(text);
        scene = load(folder, plain());
        assert_true((strstr(scene->bounds_rule, " points of depth images") != NULL) == (i > 1));
        assert_int_equal(json_array_size(scene->ignored), 0);
        for (int a = 0; a < 3 && i > 1; a++)
            assert_true(scene->box[a] < centre[a] - 0.8 && scene->box[3 + a] > centre[a] + 0.8);
        cln_scene_free(scene);
    }
}

static void test_record3d(void **state)
{
    static const struct {
        const char *scene, *metadata, *images;
        bool each;
    } cases[] = {
        {"export", "metadata.json", "rgb", true},
        {"around", "EXR_RGBD/metadata.json", "EXR_RGBD/rgb", false},
        {"unpacked", "metadata", "rgbd", true},
    };
    cln_camera cameras[FORMAT_VIEWS];

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *folder = scratch_path(*state, cases[i].scene);
        cln_scene *scene = NULL;
        int warnings = 0;

        own_intrinsics(cameras);
        for (int v = 0; v < FORMAT_VIEWS && !cases[i].each; v++) {
            cameras[v].fx = 20;
            cameras[v].fy = 21;
            cameras[v].cy = 6.5;
        }
        put_folder(*state, cases[i].scene);
        if (i == 1)
            put_folder(folder, "EXR_RGBD");
        phone_record3d(folder, cases[i].metadata, cases[i].images, cameras, cases[i].each);
        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load(folder, plain());
        assert_string_equal(scene->dialect, "Record3D");
        assert_rays(scene, cameras, 1);
        assert_int_equal(warnings, 0);
        cln_scene_free(scene);
        put_image(scratch_path(folder, cases[i].images), "6.png", 16, 12, 3, 0); /* has no pose */
        put_image(scratch_path(folder, cases[i].images), "x.png", 16, 12, 3, 0);
        cln_scene_free(load(folder, plain()));
        assert_int_equal(warnings, 1);
    }
}

typedef struct broken {
    const char *file, *from, *to, *words[3];
} broken;

/* One replacement at a time. */
static void refuse_each(const char *folder, const broken *cases, size_t count)
{
    for (size_t i = 0; i < count; i++) {
        const char *file = scratch_path(folder, cases[i].file);
        size_t bytes = 0;
        char *good = scratch_get(file, &bytes);
        const char *at = strstr(good, cases[i].from);
        FILE *f = fopen(file, "wb");

        assert_non_null(at);
        fwrite(good, 1, (size_t)(at - good), f);
        fprintf(f, "%s%s", cases[i].to, at + strlen(cases[i].from));
        fclose(f);
        assert_refused(folder, plain(), cases[i].words, cases[i].to);
        scratch_put(file, good, bytes);
        free(good);
    }
    cln_scene_free(load(folder, plain()));
}

static void test_broken(void **state)
{
#define CAMERA "keyframes/cameras/view_02.json"
    static const broken polycam[] = {
        {CAMERA, "\"t_12\"", "\"t_99\"", {CAMERA, "no t_12", "remove the file"}},
        {CAMERA, "\"fx\": ", "\"fx\": [], \"f\": ", {CAMERA, "fx must be a number"}},
        {CAMERA, "\"fx\": ", "\"fx\": -", {"view_02.png", "fl_x"}},
        {CAMERA, "\"width\": 16", "\"width\": 0", {CAMERA, "absurd image size 0 x 12"}},
        {CAMERA, "\"t_00\": ", "\"t_00\": 3, \"t\": ", {"view_02.png", "not rigid"}},
        {CAMERA, "{", "[", {CAMERA, "line 1"}},
    };
    static const broken record3d[] = {
        {"metadata.json", "\"w\": 16", "\"w\": 0", {"metadata.json", "w must be"}},
        {"metadata.json", "\"poses\": [\n[", "\"poses\": [\n[9,", {"pose 0", "unit quaternion"}},
        {"metadata.json", "\"poses\": [\n[", "\"poses\": [[1,0],\n[", {"pose 0", "7 numbers"}},
        {"metadata.json", "\"poses\"", "\"pose\"", {"no photo in it has a number", "which has 0"}},
        {"metadata.json", "\"K\": [20", "\"K\": [-20", {"0.png", "fl_x = -20"}},
        {"metadata.json", "\"K\": [20", "\"K\": [\"\"", {"K must have 9 numbers"}},
        {"metadata.json", "{", "", {"metadata.json: line 1"}},
    };
    const char *folder = scratch_path(*state, "p");
    cln_camera cameras[FORMAT_VIEWS];
    cln_scene *scene = NULL;

    format_cameras(cameras);
    phone_polycam(folder, cameras, false, 1);
    refuse_each(folder, polycam, sizeof polycam / sizeof *polycam);
    assert_int_equal(
        rename(scratch_path(folder, "keyframes/cameras"), scratch_path(folder, "keyframes/c")), 0);
    assert_int_equal(try_load(folder, plain(), &scene), CLN_INPUT);
    assert_non_null(strstr(cln_error_text(), "the Polycam reader wants"));
    assert_non_null(strstr(cln_error_text(), "Developer mode"));
    cln_clear_error();
    folder = scratch_path(*state, "r");
    phone_record3d(folder, "metadata.json", "rgb", cameras, false);
    refuse_each(folder, record3d, sizeof record3d / sizeof *record3d);
}

int test_group_phones(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_polycam, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_converted, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_edges, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_depths, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_points, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_depths_of_transforms, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_record3d, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_broken, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("captures of phones", tests, NULL, NULL);
}
