/* Short trainings on photos and settings at the ends of what is possible: images of one pixel and
 * of one row, a single photo, photos that are all alike, black or transparent, cameras all in one
 * place, far too high learning rates, thousands of samples a ray; with networks and with voxels.
 * Each ends with finite numbers, in losses, weights and pictures, or with a sentence that has a way
 * out. */
#include "unit.h"
#include "render/open_run.h"
#include "render/view.h"
#include "run_fixture.h"
#include "sanitized.h"
#include "tests.h"

enum { FEW = 20, PIXELS = 512 };

/* DARK, FAINT: but for a bright pixel. */
typedef enum paint { BALL, BLACK, CLEAR, DARK, FAINT } paint;

typedef struct extreme {
    const char *name;
    int width, height, photos;
    paint paint;
    bool same, one_place; /* all photos and cameras are the first; all cameras are where it is */
    double rates;         /* times the learning rates, at most 1, the most that --lr takes */
    int samples;          /* of a leaf, and 4 times as many of an opaque ray; 0: the fixture's */
    const char *says;     /* a word of its sentence; NULL: it trains */
} extreme;

static const extreme extremes[] = {
    {"of one pixel", 1, 1, 6, BALL, false, false, 1, 0, NULL},
    {"of one column", 1, 100000, 2, BALL, false, false, 1, 0, NULL},
    {"of one row", 100000, 1, 2, BALL, false, false, 1, 0, NULL},
    {"one photo", SIDE, SIDE, 1, BALL, false, false, 1, 0, NULL},
    {"the same photo twice", SIDE, SIDE, 2, BALL, true, false, 1, 0, NULL},
    {"all black", SIDE, SIDE, 6, BLACK, false, false, 1, 0, "one colour alone"},
    {"all transparent", SIDE, SIDE, 6, CLEAR, false, false, 1, 0, "alpha is 0 everywhere"},
    {"black but for a pixel", SIDE, SIDE, 6, DARK, false, false, 1, 0, NULL},
    {"transparent but for a pixel", SIDE, SIDE, 6, FAINT, false, false, 1, 0, NULL},
    {"cameras in one place", SIDE, SIDE, 6, BALL, false, true, 1, 0, NULL},
    {"learning rates x 100", SIDE, SIDE, 6, BALL, false, false, 100, 0, NULL},
    {"very many samples a ray", SIDE, SIDE, 6, BALL, false, false, 1, 256, NULL},
};
enum { EXTREMES = sizeof extremes / sizeof *extremes };

/* Colours of a ball of radius 1, as run_fixture.h has it, of any size of photo. */
static void paint_photo(const extreme *e, double m[3][4], double focal, uint8_t *rgba)
{
    for (int i = 0; i < e->width * e->height; i++) {
        const double u = (i % e->width + 0.5 - e->width / 2.0) / focal;
        const double v = (i / e->width + 0.5 - e->height / 2.0) / focal;
        const double length = sqrt(u * u + v * v + 1);
        double d[3], b = 0, c = -1, root = 0;

        memset(rgba + 4 * i, 0, 4);
        rgba[4 * i + 3] = e->paint == CLEAR || e->paint == FAINT ? 0 : 255;
        if (i == 0 && (e->paint == DARK || e->paint == FAINT))
            memset(rgba, 255, 4);
        if (e->paint != BALL)
            continue;
        for (int a = 0; a < 3; a++) {
            d[a] = (u * m[a][0] - v * m[a][1] - m[a][2]) / length;
            b += m[a][3] * d[a];
            c += m[a][3] * m[a][3];
        }
        root = b * b - c;
        rgba[4 * i + 3] = root > 0 ? 255 : 0;
        for (int a = 0; a < 3 && root > 0; a++)
            rgba[4 * i + a] = cln_to_u8((float)(0.5 + 0.5 * (m[a][3] + (-b - sqrt(root)) * d[a])));
    }
}

static const char *make_scene(const extreme *e)
{
    const int larger = e->width > e->height ? e->width : e->height;
    const double focal = larger / 0.73;
    uint8_t *rgba = malloc((size_t)e->width * (size_t)e->height * 4);
    const char *folder = fixture_path(e->name);
    json_t *frames = json_array(), *document = NULL;
    double first[3][4];
    char *text = NULL;

    assert_non_null(rgba);
    assert_ok(cln_make_dirs(folder));
    for (int i = 0; i < e->photos; i++) {
        double m[3][4];
        char name[32];
        json_t *rows = json_array();

        fixture_pose(6.283185307 * (e->same ? 0 : i) / e->photos, 0.15 + 0.1 * (i % 3), m);
        if (i == 0 || e->same)
            fixture_pose(0, 0.15, m);
        if (i == 0)
            memcpy(first, m, sizeof m);
        for (int a = 0; a < 3 && e->one_place; a++)
            m[a][3] = first[a][3];
        paint_photo(e, m, focal, rgba);
        for (int a = 0; a < 3; a++)
            json_array_append_new(rows, json_pack("[f,f,f,f]", m[a][0], m[a][1], m[a][2], m[a][3]));
        json_array_append_new(rows, json_pack("[i,i,i,i]", 0, 0, 0, 1));
        snprintf(name, sizeof name, "%d.png", i);
        json_array_append_new(frames,
                              json_pack("{s:s, s:o}", "file_path", name, "transform_matrix", rows));
        assert_ok(cln_image_write_png(scratch_path(folder, name), e->width, e->height, 4, rgba));
    }
    document = json_pack("{s:f, s:f, s:f, s:f, s:i, s:i, s:o}", "fl_x", focal, "fl_y", focal, "cx",
                         e->width / 2.0, "cy", e->height / 2.0, "w", e->width, "h", e->height,
                         "frames", frames);
    text = json_dumps(document, 0);
    scratch_put(scratch_path(folder, "transforms.json"), text, strlen(text));
    free(text);
    free(rgba);
    json_decref(document);
    return folder;
}

/* Every row of metrics.jsonl has numbers: null stands for those that JSON cannot hold. */
static void check_rows(const char *run, const char *what)
{
    FILE *f = fopen(scratch_path(run, "metrics.jsonl"), "r");
    char line[8192];
    int rows = 0;

    assert_non_null(f);
    while (fgets(line, sizeof line, f)) {
        json_t *row = json_loads(line, 0, NULL);

        if (row && !json_object_get(row, "event")) {
            if (!json_is_number(json_object_get(row, "loss")))
                fail_msg("%s: %s", what, line);
            rows++;
        }
        json_decref(row);
    }
    fclose(f);
    assert_int_equal(rows, FEW);
}

/* A strip of each photo's picture: colours, opacity and depth are numbers, and colours are not
 * darker or brighter than any. */
static void check_pictures(const extreme *e, const char *run, const char *what)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    const float white[3] = {1, 1, 1};
    cln_open_run v;
    cln_picture picture;

    assert_ok(cln_open_run_open(run, NULL, pixels, NULL, &v));
    assert_int_equal(v.scene->view_count, e->photos);
    for (int i = 0; i < e->photos; i++) { /* the ends of rows are what is extreme */
        cln_camera *c = &v.scene->views[i].camera;

        c->width = c->width < PIXELS ? c->width : PIXELS;
        c->height = c->height < PIXELS ? c->height : PIXELS;
    }
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    for (int view = 0; view < e->photos; view++) {
        assert_ok(cln_render_view(&v.pipeline, view, white, false, NULL, &picture));
        for (int i = 0; i < picture.width * picture.height; i++) {
            for (int k = 0; k < 3; k++)
                if (!(picture.rgb[3 * i + k] >= 0 && picture.rgb[3 * i + k] <= 1.001f))
                    fail_msg("%s: colour %g in pixel %d", what, (double)picture.rgb[3 * i + k], i);
            if (!(picture.opacity[i] >= 0 && picture.opacity[i] <= 1.001f) ||
                !isfinite(picture.depth[i]))
                fail_msg("%s: opacity %g, depth %g in pixel %d", what, (double)picture.opacity[i],
                         (double)picture.depth[i], i);
        }
        cln_picture_free(&picture);
    }
    cln_open_run_close(&v);
}

static void train_extreme(const extreme *e, const char *scene, bool voxels)
{
    cln_settings settings = {.config = fixture_config(), .preset = "fast"};
    fixture_stop none = {0};
    cln_train_result result;
    char run[96];
    cln_status st = CLN_OK;

    snprintf(run, sizeof run, "%s by %s", e->name, voxels ? "voxels" : "networks");
    if (voxels) {
        assert_ok(cln_config_preset("voxel", &settings.config));
        snprintf(settings.preset, sizeof settings.preset, "voxel");
        settings.config.rays = 256;
        settings.config.batch_samples = 2048;
        settings.config.log_every = 1;
        settings.config.start_level = 1;
        settings.config.level_at[0] = 0;
        settings.config.adaptive = false;
    }
    settings.config.steps = FEW;
    settings.config.holdout = 0;
    settings.config.lr = fmin(settings.config.lr * e->rates, 1);
    settings.config.lr_final = fmin(settings.config.lr_final * e->rates, 1);
    if (e->samples > 0) {
        settings.config.samples_per_leaf = e->samples;
        settings.config.samples_per_ray = 4 * e->samples;
        settings.config.batch_samples = 65536;
        settings.config.rays = 64;
    }
    const cln_train_desc desc = {.scene = scene,
                                 .run = fixture_path(run),
                                 .skip_selftest = true,
                                 .settings = &settings,
                                 .device = fixture_device(),
                                 .command = "test",
                                 .callbacks = fixture_callbacks(&none)};

    st = cln_train(&desc, &result);
    if (e->says) {
        if (st == CLN_OK || !strstr(cln_error_text(), e->says))
            fail_msg("%s: '%s' without '%s'", run, cln_error_text(), e->says);
        cln_clear_error();
        return;
    }
    if (st != CLN_OK)
        fail_msg("%s: %s", run, cln_error_text());
    print_message("%-40s PSNR %.1f, %d leaves\n", run, result.psnr_train, result.leaves);
    assert_int_equal(result.step, FEW);
    assert_true(isfinite(result.psnr_train));
    check_rows(desc.run, run);
    check_pictures(e, desc.run, run);
}

static void test_extreme_scenes(void **state)
{
    NEED_DEVICE();
    for (int i = 0; i < EXTREMES; i++) {
        const char *scene = make_scene(&extremes[i]);

        if (!SANITIZED || i % 2 == 0) /* there by turns */
            train_extreme(&extremes[i], scene, false);
        if (!SANITIZED || i % 2 == 1)
            train_extreme(&extremes[i], scene, true);
    }
}

int test_group_extreme_scenes(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_extreme_scenes),
    };

    return cmocka_run_group_tests_name("extreme scenes", tests, fixture_setup_folder,
                                       fixture_teardown);
}
