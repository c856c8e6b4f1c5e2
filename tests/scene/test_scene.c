/* Scenes that load: both dialects of transforms JSON from files that the test writes, down to the
 * projected pixel of a known point; splits, order, downscale, bounds, digest, description. Oracles:
 * numbers calculated by hand from the conventions in scene.h. test_scene_input.c tests broken
 * input. */
#include "unit.h"
#include <string.h>
#include "io/image.h"
#include "near.h"
#include "scene/build.h"
#include "scene/photos.h"
#include "scene_fixture.h"
#include "tests.h"

/* Camera at (4, 0, 0) looking at the origin, z up: x right = +y, y up = +z, z backwards = +x. */
#define POSE_SIDE "[[0,0,1,4],[1,0,0,0],[0,1,0,0],[0,0,0,1]]"

static const cln_view *view_named(const cln_scene *scene, const char *name)
{
    for (int i = 0; i < scene->view_count; i++)
        if (!strcmp(scene->views[i].name, name))
            return &scene->views[i];
    fail_msg("no view '%s'", name);
    return NULL;
}

static void assert_projects(const cln_view *view, double x, double y, double z, double u, double v)
{
    double pu, pv, pz;

    assert_true(cln_camera_project(&view->camera, (double[3]){x, y, z}, &pu, &pv, &pz));
    assert_near(pu, u, 1e-9);
    assert_near(pv, v, 1e-9);
}

/* ---- dialects ---- */

static void test_blender(void **state)
{
    const char *folder = *state;
    cln_scene *scene = NULL;
    const cln_view *view = NULL;
    /* fx = 10 / tan(0.4) for a width of 20. */
    const double f = 10 / tan(0.4);
    float rgb[3], alpha = 0;
    const float white[3] = {1, 1, 1};

    put_folder(folder, "train");
    put_folder(folder, "test");
    put_image(folder, "train/r_0.png", 20, 12, 4, 1);
    put_image(folder, "train/r_1.png", 20, 12, 4, 2);
    put_image(folder, "test/r_0.png", 20, 12, 4, 3);
    put_text(folder, "transforms_train.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("./train/r_0", POSE_FRONT) "," FRAME(
                 "./train/r_1", POSE_SIDE) "]}");
    put_text(folder, "transforms_test.json",
             "{\"camera_angle_x\":0.8,\"frames\":[" FRAME("./test/r_0", POSE_FRONT) "]}");
    scene = load(folder, NULL);
    assert_string_equal(scene->dialect, "blender");
    assert_int_equal(scene->view_count, 3);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TRAIN), 2);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_VAL), 0);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 1);
    assert_string_equal(scene->views[cln_scene_split_view(scene, CLN_SPLIT_TEST, 0)].name,
                        "test/r_0");
    assert_true(scene->has_alpha);
    assert_int_equal(scene->lenses, 0);
    assert_near(scene->space.half, 1.5, 0);
    assert_near(scene->space.centre[0], 0, 0);
    /* In front: right is +x, up is +y and smaller v; depth 4. */
    view = view_named(scene, "train/r_0");
    assert_projects(view, 0, 0, 0, 10, 6);
    assert_projects(view, 0.5, 0.25, 0, 10 + f * 0.5 / 4, 6 - f * 0.25 / 4);
    assert_projects(view, 0.5, 0.25, 1, 10 + f * 0.5 / 3, 6 - f * 0.25 / 3);
    /* From the side: right is +y, up is +z. */
    view = view_named(scene, "train/r_1");
    assert_projects(view, 0, 0.5, 0.25, 10 + f * 0.5 / 4, 6 - f * 0.25 / 4);
    /* Pixel (2, 1) of image 1: i = 22, 110 + 17 etc., alpha 128, over white. */
    cln_view_pixel(view_named(scene, "train/r_0"), 2, 1, white, rgb, &alpha);
    assert_near(alpha, 128.0 / 255, 1e-6);
    assert_near(rgb[0], 127.0 / 255 * 128 / 255 + 127.0 / 255, 1e-6);
    assert_near(rgb[1], 187.0 / 255 * 128 / 255 + 127.0 / 255, 1e-6);
    cln_scene_free(scene);
}

/* Shared intrinsics overridden in one frame, distortion, comments and trailing commas. */
static void test_instant_ngp(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;
    const cln_view *view = NULL;

    config.holdout = 0;
    put_folder(folder, "images");
    put_image(folder, "images/0001.png", 20, 12, 3, 1);
    put_image(folder, "images/0002.png", 20, 12, 3, 2);
    put_text(
        folder, "transforms.json",
        "{ // made by hand\n"
        "  \"fl_x\": 30.0, \"fl_y\": 40, \"cx\": 9.5, \"cy\": 6.25, \"w\": 20.0, \"h\": 12,\n"
        "  /* a lens\n     \"k1\": 7 */ \"k1\": 0.1, \"k2\": 0.01, \"p1\": 0.001, \"p2\": 0.002,\n"
        "  \"aabb_scale\": 4, \"note\": \"// no comment, /* neither\",\n"
        "  \"frames\": [" FRAME("images/0001.png",
                                POSE_FRONT) ",\n"
                                            "  "
                                            "{\"file_path\":\"images\\\\0002.png\",\"fl_x\":50,"
                                            "\"k1\":0,\"k2\":0,\"p1\":0,\"p2\":0,"
                                            "\"transform_matrix\":" POSE_FRONT ",},\n  ],\n}\n");
    scene = load(folder, &config);
    assert_string_equal(scene->dialect, "instant-ngp");
    assert_int_equal(scene->view_count, 2);
    assert_int_equal(scene->lenses, 1u << CLN_LENS_OPENCV);
    assert_false(scene->has_alpha);
    /* 0.33: the box of side 4 around 0.5 is 4 / 0.33 wide here. */
    assert_near(scene->space.half, 2 / 0.33, 1e-12);
    assert_near(scene->space.centre[1], 0, 1e-12);
    /* a = 0.5, b = 0.25 (v down, so y = -0.25 * 4): the distorted point of test_camera.c. */
    view = view_named(scene, "images/0001.png");
    assert_projects(view, 2, -1, 0, 9.5 + 30 * 0.51798828125, 6.25 + 40 * 0.258994140625);
    /* Its own focal length applies to both axes; the principal point is shared. */
    view = view_named(scene, "images/0002.png");
    assert_projects(view, 2, -1, 0, 9.5 + 50 * 0.5, 6.25 + 50 * 0.25);
    cln_scene_free(scene);

    scene = load(scratch_path(folder, "transforms.json"), &config); /* by its file's path */
    assert_int_equal(scene->view_count, 2);
    assert_string_equal(scene->folder, folder);
    cln_scene_free(scene);
}

/* Lens models by name for all frames and for one, by instant-ngp's flag, by OPENCV's k3; the sphere
 * needs no focal length. */
static void test_lenses(void **state)
{
    static const struct {
        const char *name, *keys;
        cln_lens lens;
        double params[CLN_LENS_PARAMS];
    } frames[] = {
        {"0.png", "", CLN_LENS_OPENCV_FISHEYE, {0.01, 0.02, 0.03, 0.04}},
        {"1.png", "\"camera_model\":\"OPENCV\",\"k3\":0,\"k4\":0,", CLN_LENS_OPENCV, {0.01, 0.02}},
        {"2.png",
         "\"camera_model\":\"OPENCV\",\"k4\":0,",
         CLN_LENS_FULL_OPENCV,
         {0.01, 0.02, 0, 0, 0.03}},
        {"3.png",
         "\"camera_model\":\"FULL_OPENCV\",\"k6\":0.5,",
         CLN_LENS_FULL_OPENCV,
         {0.01, 0.02, 0, 0, 0.03, 0.04, 0, 0.5}},
        {"4.png",
         "\"camera_model\":null,\"is_fisheye\":true,\"k1\":0.5,",
         CLN_LENS_OPENCV_FISHEYE,
         {0.5, 0.02, 0.03, 0.04}},
        {"5.png",
         "\"camera_model\":\"EQUIRECTANGULAR\",\"k3\":0,\"k4\":0,",
         CLN_LENS_EQUIRECTANGULAR,
         {0}},
        {"6.png", "\"camera_model\":\"FOV\",\"omega\":0.9,\"k3\":0,\"k4\":0,", CLN_LENS_FOV, {0.9}},
        {"7.png",
         "\"camera_model\":\"SIMPLE_FISHEYE\",\"k1\":0,\"k2\":0,\"k3\":0,\"k4\":0,",
         CLN_LENS_OPENCV_FISHEYE,
         {0}},
        /* nerfstudio's lists, which come before single keys */
        {"8.png",
         "\"camera_model\":\"OPENCV\",\"distortion_params\":[0.1,0.2,0,0,0.3,0.4],",
         CLN_LENS_OPENCV,
         {0.1, 0.2, 0.3, 0.4}},
        {"9.png",
         "\"distortion_params\":[0.1,0.2,0.3,0.4,0,0],\"k1\":5,",
         CLN_LENS_OPENCV_FISHEYE,
         {0.1, 0.2, 0.3, 0.4}},
        {"10.png",
         "\"camera_model\":\"FISHEYE624\",\"distortion_params\":[0.01,0.02,0.03,0.04,0.05,0.06,"
         "0.07,0.08,0.09,0.11,0.12,0.13],",
         CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
         {0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.11, 0.12, 0.13}},
        {"11.png",
         "\"camera_model\":\"PINHOLE\",\"distortion_params\":[0,0,0,0],",
         CLN_LENS_OPENCV,
         {0}},
    };
    enum { FRAMES = sizeof frames / sizeof *frames };
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;
    char text[8192];
    int used = snprintf(text, sizeof text,
                        "{\"camera_model\":\"OPENCV_FISHEYE\",\"fl_x\":20,\"k1\":0.01,\"k2\":0.02,"
                        "\"k3\":0.03,\"k4\":0.04,\"frames\":[");

    config.holdout = 0;
    for (int i = 0; i < FRAMES; i++) {
        put_image(folder, frames[i].name, 20, 10, 3, i);
        used += snprintf(text + used, sizeof text - (size_t)used,
                         "%s{\"file_path\":\"%s\",%s\"transform_matrix\":" POSE_FRONT "}",
                         i ? "," : "", frames[i].name, frames[i].keys);
    }
    snprintf(text + used, sizeof text - (size_t)used, "]}");
    put_text(folder, "transforms.json", text);
    scene = load(folder, &config);
    assert_int_equal(scene->lenses, 1u << CLN_LENS_OPENCV | 1u << CLN_LENS_OPENCV_FISHEYE |
                                        1u << CLN_LENS_FULL_OPENCV |
                                        1u << CLN_LENS_EQUIRECTANGULAR | 1u << CLN_LENS_FOV |
                                        1u << CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE);
    for (int i = 0; i < FRAMES; i++) {
        const cln_camera *camera = &view_named(scene, frames[i].name)->camera;

        assert_int_equal(camera->lens, frames[i].lens);
        for (int k = 0; k < CLN_LENS_PARAMS; k++)
            assert_near(camera->distortion[k], frames[i].params[k], 0);
    }
    /* (2, -1, 0) is at (2, 1, 4) for the camera: longitude and latitude */
    assert_projects(view_named(scene, "5.png"), 2, -1, 0, 10 + 20 / 6.283185307179586 * atan2(2, 4),
                    5 + 10 / 3.141592653589793 * atan2(1, sqrt(20)));
    cln_scene_free(scene);
}

/* nerfstudio lists each split's files; a frame may be in two splits, frames in none are dropped. */
static void test_nerfstudio_lists(void **state)
{
    const char *folder = *state;
    int warnings = 0;
    cln_scene *scene = NULL;

    for (int i = 0; i < 4; i++) {
        char name[16];

        snprintf(name, sizeof name, "%d.png", i);
        put_image(folder, name, 20, 12, 3, i);
    }
    put_text(
        folder, "transforms.json",
        "{\"camera_model\":\"OPENCV\",\"camera_angle_x\":0.8,\"k3\":0,"
        "\"train_filenames\":[\"./2.png\",\"0.png\"],\"val_filenames\":[\"2.png\"],"
        "\"test_filenames\":[\"1.png\"],\"frames\":[" FRAME("0.png", POSE_FRONT) "," FRAME(
            "1.png", POSE_FRONT) "," FRAME("2.png", POSE_SIDE) "," FRAME("3.png", POSE_FRONT) "]}");
    cln_log_set_sink(scratch_count_warnings, &warnings);
    scene = load(folder, NULL);
    assert_string_equal(scene->dialect, "nerfstudio");
    assert_int_equal(warnings, 1); /* 3.png is dropped */
    assert_int_equal(scene->view_count, 4);
    assert_string_equal(scene->views[0].name, "0.png");
    assert_string_equal(scene->views[1].name, "2.png");
    assert_string_equal(scene->views[2].name, "2.png");
    assert_int_equal(scene->views[2].split, CLN_SPLIT_VAL);
    assert_string_equal(scene->views[3].name, "1.png");
    assert_int_equal(scene->views[3].split, CLN_SPLIT_TEST);
    cln_scene_free(scene);
}

/* The camera of a full-size image is scaled to a smaller copy, with one warning. */
static void test_smaller_copies(void **state)
{
    const char *folder = *state;
    int warnings = 0;
    cln_scene *scene = NULL;
    cln_config config = default_config();

    config.holdout = 0;
    put_image(folder, "0.png", 20, 12, 3, 0);
    put_image(folder, "1.png", 20, 12, 3, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":90,\"w\":60,\"h\":36,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "0.png", POSE_FRONT) "," FRAME("1.png", POSE_FRONT) "]}");
    cln_log_set_sink(scratch_count_warnings, &warnings);
    scene = load(folder, &config);
    assert_int_equal(warnings, 1);
    assert_near(scene->views[1].camera.fx, 30, 1e-12);
    assert_near(scene->views[1].camera.cy, 6, 1e-12);
    assert_int_equal(scene->views[1].camera.width, 20);
    cln_scene_free(scene);
    /* copies in images_3, of which nothing is said, do not take the warning from another */
    put_folder(folder, "images_3");
    put_image(folder, "images_3/0.png", 20, 12, 3, 0);
    put_image(folder, "z.png", 20, 12, 3, 1);
    put_text(folder, "transforms.json",
             "{\"fl_x\":90,\"w\":60,\"h\":36,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "images_3/0.png", POSE_FRONT) "," FRAME("z.png", POSE_FRONT) "]}");
    warnings = 0;
    scene = load(folder, &config);
    assert_int_equal(warnings, 1);
    cln_scene_free(scene);
}

/* ---- splits and order ---- */

/* Every 8th in bytewise order of names: r_0 r_1 r_10 r_11 .. r_16 r_2 .. r_9 has r_0, r_16 and r_9
 * at 0, 8 and 16. The views themselves are in natural order. */
static void test_holdout(void **state)
{
    const char *folder = *state;
    char json[8192] = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[";
    cln_config config = default_config();
    cln_scene *scene = NULL;
    /* of r_0, r_1 ...: 1 + number by name modulo 8 */
    static const int fold_of[17] = {1, 2, 2, 3, 4, 5, 6, 7, 8, 1, 3, 4, 5, 6, 7, 8, 1};
    int folds[17] = {0};

    for (int i = 16; i >= 0; i--) {
        char name[32], frame[256];

        snprintf(name, sizeof name, "r_%d.png", i);
        put_image(folder, name, 4, 4, 3, i);
        snprintf(frame, sizeof frame, FRAME("%s", POSE_FRONT) "%s", name, i ? "," : "]}");
        strcat(json, frame);
    }
    put_text(folder, "transforms.json", json);
    scene = load(folder, NULL);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TRAIN), 14);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TEST), 3);
    assert_string_equal(scene->views[0].name, "r_1.png");
    assert_string_equal(scene->views[1].name, "r_2.png");
    assert_string_equal(scene->views[8].name, "r_10.png");
    assert_string_equal(scene->views[14].name, "r_0.png");
    assert_string_equal(scene->views[15].name, "r_9.png");
    assert_string_equal(scene->views[16].name, "r_16.png");
    assert_non_null(strstr(scene->split_rule, "1 in 8 images by name, from the first, is test"));
    cln_scene_free(scene);
    for (config.holdout_from = 0; config.holdout_from < 8; config.holdout_from++) { /* folds */
        scene = load(folder, &config);
        for (int i = 0; i < 17; i++)
            if (scene->views[i].split == CLN_SPLIT_TEST)
                folds[atoi(scene->views[i].name + 2)] += config.holdout_from + 1;
        cln_scene_free(scene);
    }
    for (int i = 0; i < 17; i++)
        assert_int_equal(folds[i], fold_of[i]);
    config.holdout_from = 3;
    scene = load(folder, &config);
    assert_non_null(strstr(scene->split_rule, "from number 3 on (the first is 0)"));
    cln_scene_free(scene);
    config.holdout_from = 0;
    config.holdout = 0;
    scene = load(folder, &config);
    assert_int_equal(cln_scene_split_count(scene, CLN_SPLIT_TRAIN), 17);
    cln_scene_free(scene);
}

/* ---- sizes ---- */

/* Each photo is divided so that it is small enough, unless a number is asked for. */
static void test_downscale_of_each(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;

    config.holdout = 0;
    put_image(folder, "0.png", 3201, 8, 3, 0);
    put_image(folder, "1.png", 1600, 4, 3, 0);
    put_text(folder, "transforms.json",
             "{\"fl_x\":3000,\"aabb_scale\":1,\"frames\":[" FRAME("0.png", POSE_FRONT) "," FRAME(
                 "1.png", POSE_FRONT) "]}");
    scene = load(folder, &config);
    assert_true(scene->downscale == 3 && scene->downscale_least == 1);
    assert_true(scene->views[0].camera.width == 1067 && scene->views[0].camera.height == 2);
    assert_near(scene->views[0].camera.fx, 1000, 1e-12);
    assert_true(scene->views[1].camera.width == 1600 && scene->views[1].camera.height == 4);
    assert_near(scene->views[1].camera.fx, 3000, 1e-12);
    cln_scene_free(scene);
    config.downscale = 2;
    scene = load(folder, &config);
    assert_true(scene->downscale == 2 && scene->downscale_least == 2);
    assert_true(scene->views[0].camera.width == 1600 && scene->views[1].camera.width == 800);
    cln_scene_free(scene);
    config.downscale = 0; /* by no more than could be asked for, as cameras.json says it, too */
    put_image(folder, "0.png", 104001, 70, 1, 0);
    scene = load(folder, &config);
    assert_int_equal(scene->downscale, CLN_MOST_DOWNSCALE);
    cln_scene_free(scene);
}

static void test_downscale(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;
    const cln_view *view = NULL;

    config.holdout = 0;
    put_image(folder, "0.png", 3201, 7, 3, 0);
    put_text(folder, "transforms.json",
             "{\"fl_x\":3000,\"cx\":1600,\"cy\":3,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "0.png", POSE_FRONT) "]}");
    scene = load(folder, &config); /* auto: 3201 / 2 is above 1600, 3201 / 3 is not */
    view = &scene->views[0];
    assert_int_equal(scene->downscale, 3);
    assert_true(view->camera.width == 1067 && view->camera.height == 2);
    assert_true(view->file_width == 3201 && view->file_height == 7);
    assert_near(view->camera.fx, 1000, 1e-12);
    assert_near(view->camera.cx, 1600.0 / 3, 1e-12);
    /* Pixel (1, 0) is the mean of x 3..5, y 0..2: 5 (3201 y + x) has mean 5 * (3201 + 4), mod 256
     * per pixel: values 15 20 25 | 148 153 158 | 25 30 35 -> 609 / 9. */
    assert_int_equal(view->pixels[3], 68);
    cln_scene_free(scene);
    config.downscale = 1;
    scene = load(folder, &config);
    assert_int_equal(scene->views[0].camera.width, 3201);
    cln_scene_free(scene);
}

/* Only the wanted splits have pixels; the digest does not depend on the choice. */
static void test_wanted_splits(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    const cln_scene_desc train = {
        .path = folder, .config = &config, .pixels = {true, false, false}};
    cln_scene *all = NULL, *some = NULL;

    config.holdout = 2;
    put_image(folder, "0.png", 8, 8, 3, 0);
    put_image(folder, "1.png", 8, 8, 3, 1);
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":[" FRAME(
                 "0.png", POSE_FRONT) "," FRAME("1.png", POSE_FRONT) "]}");
    all = load(folder, &config);
    assert_int_equal(cln_scene_load(&train, &some), CLN_OK);
    assert_non_null(some->views[0].pixels);
    assert_null(some->views[1].pixels);
    assert_int_equal(some->views[1].camera.width, 8);
    assert_true(all->digest == some->digest);
    assert_memory_equal(all->views[0].pixels, some->views[0].pixels, 8 * 8 * 3);
    cln_scene_free(all);
    cln_scene_free(some);
}

/* ---- background ---- */

/* Two training photos and a test photo, of which colours over alpha have this mean to 3 digits. */
static void put_photos(const char *folder, int channels, double mean[3])
{
    double sums[4] = {0};

    for (int k = 0; k < 3; k++)
        put_image(folder, (const char *const[]){"0.png", "1.png", "2.png"}[k], 8, 8, channels, k);
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 64; i++) {
            const double alpha = channels == 4 && i % 8 < 4 ? 128 : 255;

            for (int c = 0; c < 3; c++)
                sums[c] += alpha * (double)((i * 5 + c * 60 + k * 17) % 256);
            sums[3] += alpha;
        }
    for (int c = 0; c < 3; c++)
        mean[c] = sums[c] / sums[3] / 255;
    put_text(folder, "transforms.json",
             "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"train_filenames\":[\"0.png\",\"1.png\"],"
             "\"test_filenames\":[\"2.png\"],\"frames\":[" FRAME("0.png", POSE_FRONT) "," FRAME(
                 "1.png", POSE_FRONT) "," FRAME("2.png", POSE_FRONT) "]}");
}

static void check_background(const char *folder, const char *text, bool by_photos,
                             const double want[3])
{
    cln_config config = default_config();
    const cln_scene_desc bare = {.path = folder, .config = &config};
    cln_scene *scene = NULL;
    json_t *about = NULL;

    snprintf(config.background, sizeof config.background, "%s", text);
    scene = load(folder, &config);
    assert_int_equal(scene->background_mean, by_photos);
    assert_int_equal(scene->background_known, by_photos);
    for (int c = 0; c < 3; c++)
        assert_near(scene->background[c], want[c], 5.01e-4);
    cln_scene_free(scene);
    assert_int_equal(cln_scene_load(&bare, &scene), CLN_OK); /* cameras alone tell no colour */
    assert_int_equal(scene->background_mean, by_photos);
    assert_false(scene->background_known);
    assert_int_equal(cln_scene_describe(scene, &about), CLN_OK);
    assert_int_equal(json_is_array(json_object_get(about, "background")), !by_photos);
    json_decref(about);
    cln_scene_free(scene);
}

/* White behind photos with alpha; without, what nothing was seen of has their mean colour. */
static void test_background(void **state)
{
    const char *folder = *state;
    double mean[3];

    put_photos(folder, 3, mean);
    check_background(folder, "auto", true, mean);
    check_background(folder, "mean", true, mean);
    check_background(folder, "white", false, (const double[]){1, 1, 1});
    put_photos(folder, 4, mean);
    check_background(folder, "auto", false, (const double[]){1, 1, 1});
    check_background(folder, "mean", true, mean);
    check_background(folder, "0,0.25,1", false, (const double[]){0, 0.25, 1});
}

/* Masks that failed, and labels of 0 and 1 in the place of alpha. */
static void test_empty_alpha(void **state)
{
    static const char *const said[] = {"", "of 1 of 3 photos alpha shows nothing: '1.png'",
                                       "alpha is at most 1 of 255 in all of 3 photos",
                                       "alpha is at most 0 of 255 in all of 3 photos"};
    const char *folder = *state;
    const cln_config config = default_config();
    uint8_t rgba[8 * 8 * 4];
    double mean[3];

    for (int i = 0; i < 4; i++) {
        char text[CLN_EMPTY_BYTES] = "";
        cln_scene *scene = NULL;

        put_photos(folder, 4, mean);
        for (int k = 0; k < 3; k++) {
            const char *const names[] = {"0.png", "1.png", "2.png"};

            memset(rgba, 100, sizeof rgba);
            for (int p = 0; p < 64; p++)
                rgba[4 * p + 3] = i == 2 ? p % 2 : 0;
            if (i > 1 || (i == 1 && k == 1))
                assert_int_equal(cln_image_write_png(scratch_path(folder, names[k]), 8, 8, 4, rgba),
                                 CLN_OK);
        }
        scene = load(folder, &config);
        assert_int_equal(cln_scene_is_empty(scene, text), i > 0);
        assert_true(strncmp(text, said[i], strlen(said[i])) == 0);
        assert_int_equal(cln_scene_check_shown(scene), i == 3 ? CLN_INPUT : CLN_OK);
        cln_scene_free(scene);
    }
}

/* ---- bounds ---- */

/* Loads one document with two frames and checks the cube. */
static void check_bounds(const char *folder, int space, const char *bbox, const char *keys,
                         const char *poses, const double centre[3], double half, const char *rule)
{
    cln_config config = default_config();
    char json[2048];
    cln_scene *scene = NULL;

    config.holdout = 0;
    config.space = space;
    snprintf(config.bbox, sizeof config.bbox, "%s", bbox);
    snprintf(json, sizeof json, "{\"fl_x\":10,%s\"frames\":[%s]}", keys, poses);
    put_text(folder, "transforms.json", json);
    scene = load(folder, &config);
    for (int i = 0; i < 3; i++)
        assert_near(scene->space.centre[i], centre[i], 1e-9);
    assert_near(scene->space.half, half, 1e-9);
    assert_int_equal(scene->space.shell, strstr(rule, "shell") != NULL);
    if (!strstr(scene->bounds_rule, rule))
        fail_msg("rule '%s' lacks '%s'", scene->bounds_rule, rule);
    cln_scene_free(scene);
}

static void test_bounds(void **state)
{
    const char *folder = *state;
    const char *crossing = FRAME("0.png", POSE_FRONT) "," FRAME("1.png", POSE_SIDE);
    /* Cameras at (0, 0, 4) and (2, 0, 4) look along -z. */
    const char *parallel =
        FRAME("0.png", POSE_FRONT) "," FRAME("1.png", "[[1,0,0,2],[0,1,0,0],[0,0,1,4],[0,0,0,1]]");
    /* Back to back at x = +-1, looking outwards along +-x. */
    const char *outwards = FRAME("0.png", "[[0,0,-1,1],[-1,0,0,0],[0,1,0,0]]") "," FRAME(
        "1.png", "[[0,0,1,-1],[1,0,0,0],[0,1,0,0]]");
    /* At (1, 0, 0) along x and at (0, 1, 0) along y, upright: the axes cross behind both. */
    const char *apart = FRAME("0.png", "[[0,0,-1,1],[-1,0,0,0],[0,1,0,0]]") "," FRAME(
        "1.png", "[[1,0,0,0],[0,0,-1,1],[0,1,0,0]]");

    put_image(folder, "0.png", 8, 8, 3, 0);
    put_image(folder, "1.png", 8, 8, 3, 1);
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"aabb_scale\":1,", crossing, (double[3]){0, 0, 0},
                 0.5 / 0.33, "aabb_scale 1");
    /* (0.5 - offset) / scale, aabb_scale / 2 / scale; offset may be one number for all axes. */
    check_bounds(folder, CLN_SPACE_CUBE, "",
                 "\"aabb_scale\":2,\"scale\":0.5,\"offset\":[0.5,0.25,1],", crossing,
                 (double[3]){0, 0.5, -1}, 2, "scale and offset");
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"scale\":0.5,\"offset\":0.25,", crossing,
                 (double[3]){0.5, 0.5, 0.5}, 1, "scale and offset");
    /* Above 4, a shell is around what the cameras look at, 4 away; if they look at nothing, the box
     * says nothing either. */
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"aabb_scale\":4,", crossing, (double[3]){0, 0, 0},
                 2 / 0.33, "aabb_scale 4");
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"aabb_scale\":32,", crossing, (double[3]){0, 0, 0},
                 2, "and a shell, as photos may show");
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"aabb_scale\":32,", outwards, (double[3]){0, 0, 0},
                 4, "because they look outwards; --bbox sets a better one; and a shell");
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"aabb_scale\":32,", outwards, (double[3]){0, 0, 0},
                 16 / 0.33, "aabb_scale 32");
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"aabb_scale\":32,", crossing, (double[3]){0, 0, 0},
                 16 / 0.33, "aabb_scale 32");
    /* Longest side 3, times 2. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"aabb_scale\":2,\"aabb\":[[-1,0,0],[1,3,1]],",
                 crossing, (double[3]){0, 1.5, 0.5}, 3, "aabb");
    /* --bbox overrides all of them. */
    check_bounds(folder, CLN_SPACE_CUBE, "-1,-1,0,1,3,1", "\"aabb_scale\":1,", crossing,
                 (double[3]){0, 1, 0.5}, 2, "--bbox");
    /* Axes cross in the origin; cameras are 4 away; at depth 4 the corner of 8 x 8 pixels at focal
     * length 10 is 4 * hypot(0.4, 0.4) = 2.26 away, less than 4; at focal length 1, 22.6. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "", crossing, (double[3]){0, 0, 0}, 4,
                 "nearest to all optical axes");
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"fl_y\":1,", crossing, (double[3]){0, 0, 0},
                 4 * hypot(0.4, 4), "nearest to all optical axes");
    /* Photos have a shell around half of that; one of instant-ngp's box if it is wanted, around the
     * box where that is smaller. */
    check_bounds(folder, CLN_SPACE_AUTO, "", "", crossing, (double[3]){0, 0, 0}, 2,
                 "half way out to the cameras; --bbox sets a tighter one; and a shell");
    /* Through a long lens no more is seen there. */
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"fl_y\":1000,", crossing, (double[3]){0, 0, 0},
                 4 * hypot(0.4, 0.004),
                 "as wide as the photos show there; --bbox sets a tighter one; and a shell");
    /* Without the shell it is the same, if it is far less than out to the cameras. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "\"fl_y\":1000,", crossing, (double[3]){0, 0, 0}, 4,
                 "out to the cameras");
    for (int space = CLN_SPACE_AUTO; space <= CLN_SPACE_CUBE; space++)
        check_bounds(folder, space, "", "\"fl_x\":50,", crossing, (double[3]){0, 0, 0},
                     4 * hypot(0.08, 0.08),
                     space == CLN_SPACE_CUBE
                         ? "as wide as the photos show there; --bbox sets a tighter one"
                         : "and a shell");
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"aabb_scale\":4,", crossing, (double[3]){0, 0, 0},
                 2 / 0.33, "aabb_scale 4");
    check_bounds(folder, CLN_SPACE_SHELL, "", "\"aabb_scale\":4,", crossing, (double[3]){0, 0, 0},
                 2, "half way out to the cameras; --bbox sets a tighter one; and a shell");
    check_bounds(folder, CLN_SPACE_SHELL, "", "\"aabb_scale\":1,", crossing, (double[3]){0, 0, 0},
                 0.5 / 0.33, "aabb_scale 1; and a shell");
    check_bounds(folder, CLN_SPACE_SHELL, "-1,-1,0,1,3,1", "", crossing, (double[3]){0, 1, 0.5}, 2,
                 "--bbox -1,-1,0,1,3,1; and a shell");
    /* Parallel: mean (1, 0, 4), spread 1, half 4, moved by 4 along -z. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "", parallel, (double[3]){1, 0, 0}, 4, "parallel");
    /* Outwards along one line: axes coincide, mean direction 0, spread 1. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "", outwards, (double[3]){0, 0, 0}, 4, "outwards");
    /* What outward cameras show is beyond any such cube; parallel ones have it before them. */
    check_bounds(folder, CLN_SPACE_AUTO, "", "", outwards, (double[3]){0, 0, 0}, 4,
                 "outwards; --bbox sets a better one; and a shell, as photos may show");
    check_bounds(folder, CLN_SPACE_AUTO, "", "", apart, (double[3]){1.5, 1.5, 0}, 2,
                 "outwards; --bbox sets a better one; and a shell, as photos may show");
    check_bounds(folder, CLN_SPACE_AUTO, "0,0,0,2,2,2", "", apart, (double[3]){1, 1, 1}, 1,
                 "--bbox");
    check_bounds(folder, CLN_SPACE_AUTO, "", "", parallel, (double[3]){1, 0, 0}, 4, "in parallel");
    /* Half the height, 4 pixels, is 2 focal lengths off the axis: by this lens 115 degrees. */
    check_bounds(folder, CLN_SPACE_AUTO, "", "\"camera_model\":\"FISHEYE\",\"fl_y\":2,", parallel,
                 (double[3]){1, 0, 0}, 4, "in parallel; --bbox sets a better one; and a shell");
    /* One camera gives no scale. */
    check_bounds(folder, CLN_SPACE_CUBE, "", "", FRAME("0.png", POSE_FRONT), (double[3]){0, 0, 3},
                 1, "guess");
}

/* What --slab keeps: instant-ngp's aabb, its sides times aabb_scale; a flat one is none. */
static void test_box_of_aabb(void **state)
{
    static const struct {
        const char *corners;
        bool is_box;
        double box[6];
    } cases[] = {{"[-1,3,0.25],[1,-3,0.75]", true, {-2, -6, 0, 2, 6, 1}},
                 {"[-1,-3,0.5],[1,3,0.5]", false, {0}}};
    const char *folder = *state;
    cln_config config = default_config();

    config.holdout = 0;
    put_image(folder, "0.png", 8, 8, 3, 0);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char text[512];
        cln_scene *scene = NULL;

        snprintf(text, sizeof text,
                 "{\"fl_x\":10,\"aabb_scale\":2,\"aabb\":[%s],\"frames\":[" FRAME("0.png",
                                                                                  POSE_FRONT) "]}",
                 cases[i].corners);
        put_text(folder, "transforms.json", text);
        scene = load(folder, &config);
        assert_near(scene->space.half, 6, 1e-12);
        assert_int_equal(scene->has_box, cases[i].is_box);
        for (int k = 0; k < 6 && scene->has_box; k++)
            assert_near(scene->box[k], cases[i].box[k], 1e-12);
        cln_scene_free(scene);
    }
}

/* Detects a cube that fills less than a grid step of the image or appears only in a corner. */
static void test_small_cubes_are_seen(void **state)
{
    const char *folder = *state;

    put_image(folder, "0.png", 1000, 1000, 3, 0);
    check_bounds(folder, CLN_SPACE_CUBE, "0.61,0.37,0,0.62,0.38,0.01",
                 "\"fl_y\":1000,\"fl_x\":1000,", FRAME("0.png", POSE_FRONT),
                 (double[3]){0.615, 0.375, 0.005}, 0.005, "--bbox");
    check_bounds(folder, CLN_SPACE_CUBE, "1.98,1.98,0,3,3,1", "\"fl_y\":1000,\"fl_x\":1000,",
                 FRAME("0.png", POSE_FRONT), (double[3]){2.49, 2.49, 0.5}, 0.51, "--bbox");
}

/* ---- digest and description ---- */

static uint64_t digest_of(const char *folder, const char *json)
{
    uint64_t digest = 0;
    cln_scene *scene = NULL;

    put_text(folder, "transforms.json", json);
    scene = load(folder, NULL);
    digest = scene->digest;
    cln_scene_free(scene);
    return digest;
}

#define DOCUMENT(angle, second, pose) \
    "{\"camera_angle_x\":" angle      \
    ",\"aabb_scale\":1,\"frames\":[" FRAME("0.png", POSE_FRONT) "," FRAME(second, pose) "]}"

static void test_digest(void **state)
{
    const char *folder = *state;
    const char *json = DOCUMENT("0.8", "1.png", POSE_SIDE);
    uint64_t first = 0;

    put_image(folder, "0.png", 8, 8, 3, 0);
    put_image(folder, "1.png", 8, 8, 3, 1);
    put_image(folder, "2.png", 8, 8, 3, 1);
    first = digest_of(folder, json);
    assert_true(first == digest_of(folder, json));
    assert_true(first != digest_of(folder, DOCUMENT("0.81", "1.png", POSE_SIDE)));
    assert_true(first != digest_of(folder, DOCUMENT("0.8", "1.png", POSE_FRONT)));
    assert_true(first != digest_of(folder, DOCUMENT("0.8", "2.png", POSE_SIDE)));
    put_image(folder, "0.png", 8, 8, 3, 7);
    assert_true(first != digest_of(folder, json));
    put_image(folder, "0.png", 8, 8, 3, 0);
    assert_true(first == digest_of(folder, json));
}

/* Alpha that is 255 everywhere cuts nothing out: the scene is as if its photos had none, in one way
 * of reading them, and keeps it where a run began so. One pixel anywhere changes all of that. */
static void test_opaque_alpha(void **state)
{
    enum { SIDE = 12, VIEWS = 5 };
    const char *folder = *state;
    /* clang-format off */
    const char *json = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":["
        FRAME("0.png", POSE_FRONT) "," FRAME("1.png", POSE_FRONT) "," FRAME("2.png", POSE_FRONT) ","
        FRAME("3.png", POSE_FRONT) "," FRAME("4.png", POSE_FRONT) "]}";
    /* clang-format on */
    const cln_config config = default_config();
    cln_scene_desc desc = {.path = folder, .config = &config, .pixels = {true, true, true}};
    uint8_t pixels[SIDE * SIDE * 4];
    cln_scene *scene = NULL;
    char name[16];

    put_text(folder, "transforms.json", json);
    for (int last = 255; last >= 254; last--) {
        for (int v = 0; v < VIEWS; v++) {
            for (int i = 0; i < SIDE * SIDE * 4; i++)
                pixels[i] = i % 4 == 3 ? 255 : (uint8_t)(i * 5 + v * 17);
            if (v == VIEWS - 1)
                pixels[sizeof pixels - 1] = (uint8_t)last;
            snprintf(name, sizeof name, "%d.png", v);
            assert_int_equal(cln_image_write_png(scratch_path(folder, name), SIDE, SIDE, 4, pixels),
                             CLN_OK);
        }
        for (int keep = 0; keep < 2; keep++) {
            const bool alpha = keep || last < 255;

            desc.keep_alpha = keep;
            assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
            assert_int_equal(scene->has_alpha, alpha);
            assert_int_equal(scene->background_mean, !alpha);
            for (int v = 0; v < VIEWS; v++) {
                const cln_view *view = &scene->views[v];
                const int file = view->name[0] - '0', i = 4 * (3 * SIDE + 7);
                uint8_t got[4];

                assert_int_equal(view->channels, alpha ? 4 : 3);
                cln_view_bytes(view, 7, 3, got);
                for (int c = 0; c < 3; c++)
                    assert_int_equal(got[c], (uint8_t)((i + c) * 5 + file * 17));
            }
            cln_scene_free(scene);
        }
    }
}

/* Photos that were opaque when a run began are not looked at, as the digest tells that they are the
 * same. Where that is wrong, their pixels tell, if they are read, or another digest. */
static void test_known_opaque(void **state)
{
    enum { SIDE = 12, VIEWS = 5 };
    const char *folder = *state;
    /* clang-format off */
    const char *json = "{\"camera_angle_x\":0.8,\"aabb_scale\":1,\"frames\":["
        FRAME("0.png", POSE_FRONT) "," FRAME("1.png", POSE_FRONT) "," FRAME("2.png", POSE_FRONT) ","
        FRAME("3.png", POSE_FRONT) "," FRAME("4.png", POSE_FRONT) "]}";
    /* clang-format on */
    const cln_config config = default_config();
    cln_scene_desc desc = {.path = folder, .config = &config};
    uint8_t pixels[SIDE * SIDE * 4];
    cln_scene *scene = NULL;

    put_text(folder, "transforms.json", json);
    for (int last = 255; last >= 254; last--) {
        uint64_t digest = 0;

        memset(pixels, 255, sizeof pixels);
        for (int v = 0; v < VIEWS; v++) {
            char name[16];

            if (v == VIEWS - 1)
                pixels[sizeof pixels - 1] = (uint8_t)last;
            snprintf(name, sizeof name, "%d.png", v);
            assert_int_equal(cln_image_write_png(scratch_path(folder, name), SIDE, SIDE, 4, pixels),
                             CLN_OK);
        }
        for (int wanted = 0; wanted < 2; wanted++) { /* the last photo is for training */
            desc.pixels[CLN_SPLIT_TRAIN] = wanted;
            desc.opaque_digest = 0;
            assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
            assert_int_equal(scene->has_alpha, last < 255);
            digest = scene->digest;
            cln_scene_free(scene);
            for (int same = 0; same < 2; same++) {
                const bool alpha = last < 255 && !(same && !wanted);

                desc.opaque_digest = digest + !same;
                assert_int_equal(cln_scene_load(&desc, &scene), CLN_OK);
                assert_true(scene->digest == digest);
                assert_int_equal(scene->has_alpha, alpha);
                for (int v = 0; v < VIEWS; v++)
                    assert_int_equal(scene->views[v].channels, alpha ? 4 : 3);
                cln_scene_free(scene);
            }
        }
    }
}

static void test_describe(void **state)
{
    const char *folder = *state;
    cln_config config = default_config();
    cln_scene *scene = NULL;
    json_t *text = NULL, *row = NULL;
    char digest[17];

    config.holdout = 2;
    put_image(folder, "0.png", 8, 6, 4, 0);
    put_image(folder, "1.png", 8, 6, 4, 1);
    put_text(folder, "transforms.json", DOCUMENT("0.8", "1.png", POSE_SIDE));
    scene = load(folder, &config);
    assert_int_equal(cln_scene_describe(scene, &text), CLN_OK);
    assert_string_equal(json_string_value(json_object_get(text, "dialect")), "instant-ngp");
    assert_int_equal(json_integer_value(json_object_get(text, "views")), 2);
    assert_int_equal(json_integer_value(json_object_get(json_object_get(text, "splits"), "test")),
                     1);
    assert_true(json_is_true(json_object_get(text, "alpha")));
    assert_near(json_real_value(json_object_get(text, "half")), 0.5 / 0.33, 1e-12);
    assert_near(json_real_value(json_object_get(text, "camera_distance")), 4, 1e-12);
    snprintf(digest, sizeof digest, "%016llx", (unsigned long long)scene->digest);
    assert_string_equal(json_string_value(json_object_get(text, "digest")), digest);
    row = json_array_get(json_object_get(text, "sizes"), 0);
    assert_int_equal(json_array_size(json_object_get(text, "sizes")), 1);
    assert_int_equal(json_integer_value(json_object_get(row, "width")), 8);
    assert_int_equal(json_integer_value(json_object_get(row, "views")), 2);
    row = json_array_get(json_object_get(text, "cameras"), 1);
    assert_string_equal(json_string_value(json_object_get(row, "name")), "0.png");
    assert_string_equal(json_string_value(json_object_get(row, "split")), "test");
    assert_int_equal(json_integer_value(json_object_get(row, "height")), 6);
    json_decref(text);
    cln_scene_free(scene);
}

/* How many rows `info` has for three cameras, one of which differs by `by` pixels. The first is of
 * the test view, which comes last. */
static size_t rows_of_intrinsics(const char *folder, int which, double by)
{
    static const char *const poses[3] = {POSE_FRONT, POSE_SIDE, POSE_FRONT};
    char json[2048] = "{\"frames\":[";
    cln_scene *scene = NULL;
    json_t *about = NULL;
    size_t rows = 0;

    for (int i = 0; i < 3; i++) {
        const size_t used = strlen(json);

        snprintf(json + used, sizeof json - used,
                 "%s{\"file_path\":\"%d.png\",\"fl_x\":%.9g,\"cx\":%.9g,"
                 "\"transform_matrix\":%s}",
                 i ? "," : "", i, 9 + (i == which) * by, 4 - (i == which) * by, poses[i]);
    }
    strcat(json, "]}");
    put_text(folder, "transforms.json", json);
    scene = load(folder, NULL);
    assert_int_equal(cln_scene_describe(scene, &about), CLN_OK);
    rows = json_array_size(json_object_get(about, "intrinsics"));
    json_decref(about);
    cln_scene_free(scene);
    return rows;
}

static void test_rows_of_intrinsics(void **state)
{
    const char *folder = *state;

    for (int i = 0; i < 3; i++) {
        char name[16];

        snprintf(name, sizeof name, "%d.png", i);
        put_image(folder, name, 8, 6, 3, i);
    }
    assert_int_equal(rows_of_intrinsics(folder, 1, 0), 1);
    assert_int_equal(rows_of_intrinsics(folder, 1, 0.004), 1);
    for (int which = 0; which < 3; which++) /* 2: the first row's come again behind it */
        assert_int_equal(rows_of_intrinsics(folder, which, 0.02), 2);
}

int test_group_scene(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_rows_of_intrinsics, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_blender, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_instant_ngp, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_lenses, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_nerfstudio_lists, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_smaller_copies, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_holdout, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_downscale_of_each, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_downscale, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_wanted_splits, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_background, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_empty_alpha, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_bounds, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_box_of_aabb, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_small_cubes_are_seen, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_digest, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_opaque_alpha, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_known_opaque, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_describe, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
