/* Depth images (scene/depth_points.c) as depths of training pixels, and what else of a photo shows
 * nothing or stands still. Oracle: a ball, whose depths are known; circles and borders that were
 * drawn. */
#include "unit.h"
#include "phone_fixture.h"
#include "scene/build.h"
#include "scene/cameras_file.h"
#include "tests.h"

enum { DEEP_WIDE = 48, DEEP_HIGH = 36 };
static const double centre[3] = {1, 2, 3};

/* Depth of the ball in pixel (u, v), along the axis; 0: beside it. */
static double depth_of(const cln_camera *c, double u, double v)
{
    double o[3], d[3], along = 0, square = -1, cosine = 0, root = 0;

    assert_true(cln_camera_ray(c, u, v, o, d));
    for (int a = 0; a < 3; a++) {
        along += d[a] * (centre[a] - o[a]);
        square += (centre[a] - o[a]) * (centre[a] - o[a]);
        cosine += d[a] * c->c2w[4 * a + 2];
    }
    root = along * along - square;
    return root > 0 ? cosine * (along - sqrt(root)) : 0;
}

/* A transforms JSON with depth images in thousandths, of which it says that they are in `unit`. */
static void put_scene(const char *folder, const cln_camera *cameras, const char *more, double unit)
{
    FILE *f = format_open(folder, "transforms.json");

    fprintf(f,
            "{\"fl_x\": 20, \"fl_y\": 20, \"cx\": 8, \"cy\": 6, %s\"depth_unit_scale_factor\": "
            "%g, \"frames\": [",
            more, unit);
    for (int v = 0; v < FORMAT_VIEWS; v++) {
        const double *m = cameras[v].c2w;
        uint16_t depth[DEEP_WIDE * DEEP_HIGH];
        char name[32], deep[32];

        snprintf(name, sizeof name, "view_%02d.png", v);
        snprintf(deep, sizeof deep, "z_%02d.png", v);
        for (int i = 0; i < DEEP_WIDE * DEEP_HIGH; i++)
            depth[i] =
                (uint16_t)(1000 * depth_of(&cameras[v],
                                           (i % DEEP_WIDE + 0.5) / DEEP_WIDE * FORMAT_WIDTH,
                                           (i / DEEP_WIDE + 0.5) / DEEP_HIGH * FORMAT_HEIGHT) +
                           0.5);
        phone_grey(scratch_path(folder, "images"), deep, true, DEEP_WIDE, DEEP_HIGH, depth);
        fprintf(f,
                "%s{\"file_path\": \"images/%s\", \"depth_file_path\": \"images/%s\", "
                "\"transform_matrix\": [[%.17g,%.17g,%.17g,%.17g],[%.17g,%.17g,%.17g,%.17g],"
                "[%.17g,%.17g,%.17g,%.17g]]}",
                v ? ", " : "", name, deep, m[0], -m[1], -m[2], m[3], m[4], -m[5], -m[6], m[7], m[8],
                -m[9], -m[10], m[11]);
    }
    fprintf(f, "]}\n");
    fclose(f);
}

static cln_scene *load_for(const char *folder, double depth_loss, int downscale)
{
    cln_config config = *plain();
    const cln_scene_desc desc = {
        .path = folder, .config = &config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    cln_scene *scene = NULL;

    config.depth_loss = depth_loss;
    config.downscale = downscale;
    config.holdout = 3;
    if (cln_scene_load(&desc, &scene) != CLN_OK)
        fail_msg("%s", cln_error_text());
    return scene;
}

/* Every sight is on the ball, in the pixel of a training view that shows it; many are there. Depth
 * images beside the photos are no photos without a pose. */
static void test_sights(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    int warnings = 0;

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    put_scene(folder, cameras, "", 0.001);
    for (int downscale = 1; downscale <= 2; downscale++) {
        cln_scene *scene = NULL;

        cln_log_set_sink(scratch_count_warnings, &warnings);
        scene = load_for(folder, 2, downscale);
        cln_log_set_sink(NULL, NULL);
        assert_int_equal(warnings, 0);
        assert_true(scene->depth_sights == scene->sight_count);
        if (scene->sight_count <= 150)
            fail_msg("%d", (int)scene->sight_count);
        for (int64_t i = 0; i < scene->sight_count; i++) {
            const cln_sight *s = &scene->sights[i];
            const cln_view *view = &scene->views[s->view];
            double far = 0, u, v;

            assert_int_equal(view->split, CLN_SPLIT_TRAIN);
            assert_true(cln_camera_shows(&view->camera, s->point, &u, &v));
            assert_true(s->x == (int)u && s->y == (int)v && s->trust == 1);
            for (int a = 0; a < 3; a++)
                far += pow(s->point[a] - centre[a], 2);
            assert_float_equal(sqrt(far), 1, 0.01); /* thousandths, near the rim */
        }
        cln_scene_free(scene);
    }
    {
        cln_scene *scene = load_for(folder, 0, 1); /* none are looked for */

        assert_int_equal(scene->sight_count, 0);
        cln_scene_free(scene);
    }
    /* beside other points, too, and without the photos that have none */
    put_scene(folder, cameras, "\"ply_file_path\": \"points.ply\", ", 0.001);
    {
        FILE *f = format_open(folder, "points.ply");
        cln_scene *scene = NULL;

        fprintf(f, "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\n"
                   "property float z\nend_header\n1 2 3\n0 2 3\n1 3 3.5\n");
        fclose(f);
        assert_int_equal(remove(scratch_path(folder, "images/z_01.png")), 0);
        scene = load_for(folder, 2, 1);
        assert_true(scene->depth_sights > 80);
        for (int64_t i = 0; i < scene->sight_count; i++)
            assert_null(strstr(scene->views[scene->sights[i].view].name, "view_01"));
        cln_scene_free(scene);
    }
}

static char said[4096];

static void keep_line(cln_log_level level, const char *line, void *user)
{
    char *text = user;

    (void)level;
    snprintf(text + strlen(text), sizeof said - strlen(text), "%s\n", line);
}

/* Depths that do not fit each other are not learnt from; in which unit they would is told. */
static void test_units(void **state)
{
    static const struct {
        double unit;
        const char *words;
    } rows[] = {{1, " 0.00"},
                {0.01, " 0.10"},
                {0.003280839895, " times as large"},
                {0.00037, " times as large"}};
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];
    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 1);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_scene *scene = NULL;

        put_scene(folder, cameras, "\"aabb_scale\": 4, ", rows[i].unit);
        said[0] = 0;
        cln_log_to(CLN_LOG_WARN, keep_line, said);
        scene = load_for(folder, 2, 1);
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        assert_int_equal(scene->sight_count, 0);
        if (!strstr(said, "depth images are not used") || !strstr(said, rows[i].words))
            fail_msg("unit %g: %s", rows[i].unit, said);
        cln_scene_free(scene);
    }
}

/* A fisheye's pixels beyond fisheye_crop_radius do not count; a run's cameras keep that. */
static void test_disc(void **state)
{
    const char *folder = *state;
    cln_camera cameras[FORMAT_VIEWS];

    format_cameras(cameras);
    format_images(scratch_path(folder, "images"), 2); /* 32 x 24 */
    for (int downscale = 1; downscale <= 2; downscale++) {
        cln_scene *scene = NULL;
        int out = 0;

        put_scene(folder, cameras,
                  "\"w\": 16, \"h\": 12, \"camera_model\": \"OPENCV_FISHEYE\", "
                  "\"fisheye_crop_radius\": 5, ",
                  0.001);
        scene = load_for(folder, 0, downscale);
        for (int y = 0; y < 24 / downscale; y++)
            for (int x = 0; x < 32 / downscale; x++) {
                bool all = true;

                for (int k = 0; k < downscale * downscale; k++)
                    all = all && hypot(x * downscale + k % downscale + 0.5 - 16,
                                       y * downscale + k / downscale + 0.5 - 12) <= 10;
                assert_int_equal(cln_view_keeps(&scene->views[0], x, y), all);
                out += !all;
            }
        assert_int_equal(scene->views[0].left_out, out);
        assert_true(out > 0);
        cln_scene_free(scene);
    }
    put_scene(folder, cameras, "\"fisheye_crop_radius\": 5, ", 0.001); /* no fisheye */
    {
        cln_scene *scene = load_for(folder, 0, 1);

        assert_int_equal(scene->views[0].left_out, 0);
        cln_scene_free(scene);
    }
}

/* Borders that are one picture, or not, of cameras that turn, or hardly do. */
static void test_still(void **state)
{
    static const struct {
        int moved;   /* how far the border's picture goes from photo to photo */
        double turn; /* radians from camera to camera */
        int noise;
        bool still;
    } rows[] = {{0, 0.5, 3, true}, {3, 0.5, 3, false}, {0, 0.01, 3, false}, {0, 0.5, 40, false}};
    enum { VIEWS = 12, SIDE = 24 };

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const char *folder = scratch_path(*state, (const char[]){(char)('a' + i), 0});
        FILE *f = NULL;
        cln_scene *scene = NULL;

        put_folder(*state, (const char[]){(char)('a' + i), 0});
        f = format_open(folder, "transforms.json");
        fprintf(f, "{\"fl_x\": 24, \"frames\": [");
        for (int v = 0; v < VIEWS; v++) {
            const double angle = rows[i].turn * v;
            uint8_t pixels[SIDE * SIDE * 3];
            char name[32];

            for (int k = 0; k < SIDE * SIDE * 3; k++)
                pixels[k] = (uint8_t)(100 + 4 * ((k / 3 + rows[i].moved * v) % SIDE) +
                                      (k * 7 + v * 13) % (rows[i].noise + 1));
            snprintf(name, sizeof name, "%d.png", v);
            assert_int_equal(cln_image_write_png(scratch_path(folder, name), SIDE, SIDE, 3, pixels),
                             CLN_OK);
            fprintf(f,
                    "%s{\"file_path\": \"%s\", \"transform_matrix\": [[%g,0,%g,%g],[0,1,0,0],"
                    "[%g,0,%g,%g]]}",
                    v ? ", " : "", name, cos(angle), sin(angle), 4 * sin(angle), -sin(angle),
                    cos(angle), 4 * cos(angle));
        }
        fprintf(f, "]}\n");
        fclose(f);
        scene = load(folder, plain());
        if (scene->still != rows[i].still)
            fail_msg("row %zu: %d", i, scene->still);
        cln_scene_free(scene);
    }
}

/* Colours that were multiplied by alpha are divided by it, where that is asked for, and no others;
 * straight ones come back to what 8 bits keep of them. */
static void test_multiplied(void **state)
{
    enum { SIDE = 16 };
    const char *folder = *state;
    uint8_t pixels[SIDE * SIDE * 4];
    cln_config config = *plain();

    for (int i = 0; i < SIDE * SIDE; i++) {
        pixels[4 * i + 3] = (uint8_t)i;
        for (int c = 0; c < 3; c++)
            pixels[4 * i + c] = (uint8_t)((i * (200 - 60 * c) + 127) / 255);
    }
    assert_int_equal(cln_image_write_png(scratch_path(folder, "a.png"), SIDE, SIDE, 4, pixels),
                     CLN_OK);
    put_text(folder, "transforms.json",
             "{\"fl_x\":20,\"aabb_scale\":1,\"frames\":[" FRAME("a.png", POSE_FRONT) "]}");
    for (int divided = 0; divided < 2; divided++) {
        cln_scene *scene = NULL;

        config.multiplied_alpha = divided;
        scene = load(folder, &config);
        for (int i = 0; i < SIDE * SIDE; i++)
            for (int c = 0; c < 4; c++) {
                const int was = pixels[4 * i + c], is = scene->views[0].pixels[4 * i + c];

                if (c == 3 || !divided)
                    assert_int_equal(is, was);
                else if (i > 0 && abs(is - (200 - 60 * c)) > 128 / i + 1)
                    fail_msg("alpha %d: %d", i, is);
            }
        cln_scene_free(scene);
    }
}

int test_group_depth_images(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_sights, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_units, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_disc, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_still, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_multiplied, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("depth_images", tests, NULL, NULL);
}
