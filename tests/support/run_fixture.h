/* Support of the tests of runs: a scene of a coloured ball (6 training views, 2 test views, 24 x
 * 24, RGBA, Blender's format), settings that train in a second, a finished run, and callbacks that
 * request a stop at a chosen moment. Skips without an OpenCL device. */
#ifndef CLN_TESTS_RUN_FIXTURE_H
#define CLN_TESTS_RUN_FIXTURE_H

#include <dirent.h>
#include <jansson.h>
#include <math.h>
#include "base/config.h"
#include "base/memory.h"
#include "base/settings.h"
#include "cl_nascent.h"
#include "device/device.h"
#include "io/image.h"
#include "io/run_folder.h"
#include "outcome.h"
#include "scratch.h"

enum { SIDE = 24, STEPS = 30, TRAIN_VIEWS = 6, TEST_VIEWS = 2 };

static char fixture_folder[PATH_MAX - 64]; /* of the whole group */

static inline void fixture_no_log(cln_log_level level, const char *line, void *user)
{
    (void)level;
    (void)line;
    (void)user;
}

static inline cln_device_desc fixture_device(void)
{
    return (cln_device_desc){.spec = getenv("CLN_TEST_DEVICE"),
                             .kernel_dir = getenv("CLN_TEST_KERNEL_DIR")};
}

/* ---- the scene ---- */

/* View i on a ring around z, looking at the origin; OpenGL's axes, as in the files. */
static inline void fixture_pose(double yaw, double height, double m[3][4])
{
    const double r = sqrt(1 - height * height);
    const double z[3] = {r * cos(yaw), r * sin(yaw), height}; /* backwards */
    const double x[3] = {-sin(yaw), cos(yaw), 0};
    const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                         z[0] * x[1] - z[1] * x[0]};

    for (int a = 0; a < 3; a++) {
        m[a][0] = x[a];
        m[a][1] = y[a];
        m[a][2] = z[a];
        m[a][3] = 4 * z[a];
    }
}

/* A ball of radius 1 whose colour is its normal. */
static inline void fixture_picture(double m[3][4], double focal, uint8_t *rgba)
{
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double u = (i % SIDE + 0.5 - SIDE / 2) / focal,
                     v = (i / SIDE + 0.5 - SIDE / 2) / focal;
        const double length = sqrt(u * u + v * v + 1);
        double o[3], d[3], b = 0, c = -1, root = 0;

        for (int a = 0; a < 3; a++) {
            o[a] = m[a][3];
            d[a] = (u * m[a][0] - v * m[a][1] - m[a][2]) / length;
            b += o[a] * d[a];
            c += o[a] * o[a];
        }
        root = b * b - c;
        memset(rgba + 4 * i, 0, 4);
        for (int a = 0; a < 3 && root > 0; a++)
            rgba[4 * i + a] = cln_to_u8((float)(0.5 + 0.5 * (o[a] + (-b - sqrt(root)) * d[a])));
        rgba[4 * i + 3] = root > 0 ? 255 : 0;
    }
}

static inline void fixture_split(const char *folder, const char *split, int count, double phase)
{
    uint8_t rgba[SIDE * SIDE * 4];
    json_t *frames = json_array(), *document = NULL;
    const double angle = 0.7;
    char name[64], path[PATH_MAX + 64], *text = NULL;

    snprintf(path, sizeof path, "%s/%s", folder, split);
    assert_ok(cln_make_dirs(path));
    for (int i = 0; i < count; i++) {
        double m[3][4];
        json_t *rows = json_array();

        fixture_pose(6.283185307 * (i + phase) / count, 0.15 + 0.1 * (i % 3), m);
        fixture_picture(m, 0.5 * SIDE / tan(0.5 * angle), rgba);
        for (int a = 0; a < 3; a++)
            json_array_append_new(rows, json_pack("[f,f,f,f]", m[a][0], m[a][1], m[a][2], m[a][3]));
        json_array_append_new(rows, json_pack("[i,i,i,i]", 0, 0, 0, 1));
        snprintf(name, sizeof name, "./%s/r_%d", split, i);
        json_array_append_new(frames,
                              json_pack("{s:s, s:o}", "file_path", name, "transform_matrix", rows));
        snprintf(path, sizeof path, "%s/%s.png", folder, name + 2);
        assert_ok(cln_image_write_png(path, SIDE, SIDE, 4, rgba));
    }
    document = json_pack("{s:f, s:o}", "camera_angle_x", angle, "frames", frames);
    text = json_dumps(document, 0);
    snprintf(path, sizeof path, "%s/transforms_%s.json", folder, split);
    scratch_put(path, text, strlen(text));
    free(text);
    json_decref(document);
}

/* ---- settings and runs ---- */

/* Sets every byte, so that settings can be compared and copied. */
static inline cln_config fixture_config(void)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset("fast", &config));
    config.width = config.view_width = 16;
    config.depth = config.bands = 2;
    config.view_bands = 1;
    config.start_level = 1;
    config.level_at[0] = 0;
    config.adaptive = false;
    config.n1 = 6;
    config.rays = 256;
    config.batch_samples = 2048;
    config.refresh_every = 8;
    config.cull_from = 1;
    config.cull_after = 0;
    config.lr = 0.02; /* learns in few steps */
    config.steps = STEPS;
    config.log_every = 1;
    config.eval_images = TEST_VIEWS;
    return config;
}

/* The default preset's, voxels, of the same kind; what a ray's samples are is the preset's. */
static inline cln_config fixture_voxels(void)
{
    cln_config config;

    memset(&config, 0, sizeof config);
    assert_ok(cln_config_preset("voxel", &config));
    config.start_level = 2;
    config.level_at[0] = 0;
    config.adaptive = false;
    config.rays = 1024;
    config.batch_samples = 32768;
    config.refresh_every = 8;
    config.steps = 100;
    config.eval_images = TEST_VIEWS;
    return config;
}

static inline const char *fixture_preset(const cln_config *config)
{
    return config->encoding == CLN_ENCODING_VOXEL ? "voxel" : "fast";
}

/* A test's callbacks: one signal after `step` steps, `photos` calls of work() for photos that are
 * read, or `pictures` other calls, then none. */
typedef struct fixture_stop {
    int signal;
    int64_t step;
    int pictures, photos;
    int64_t steps_seen, train_calls;
    double psnr_seen;
    int pictures_seen, photos_seen;
} fixture_stop;

static inline void fixture_on_train(const cln_train_progress *progress, void *user)
{
    fixture_stop *s = user;

    s->steps_seen = progress->step;
    s->train_calls++;
    s->psnr_seen = progress->psnr_train;
}

static inline void fixture_on_work(const char *what, int done, int total, void *user)
{
    fixture_stop *s = user;

    (void)done;
    (void)total;
    ++*(strcmp(what, "images") == 0 ? &s->photos_seen : &s->pictures_seen);
}

static inline int fixture_interrupted(void *user)
{
    fixture_stop *s = user;

    if ((s->step && s->steps_seen == s->step) || (s->photos && s->photos_seen == s->photos) ||
        (s->pictures && s->pictures_seen == s->pictures)) {
        s->step = s->photos = s->pictures = 0;
        return s->signal;
    }
    return 0;
}

static inline cln_callbacks fixture_callbacks(fixture_stop *stop)
{
    return (cln_callbacks){fixture_on_train, fixture_on_work, fixture_interrupted, stop};
}

static inline const char *fixture_path(const char *name)
{
    return scratch_path(fixture_folder, name);
}

/* A new run (scene given) or a resumed one (scene NULL). stop may be NULL. */
static inline cln_status fixture_train(const char *run, bool resume, const cln_config *config,
                                       fixture_stop *stop, cln_train_result *result)
{
    fixture_stop none = {0};
    cln_settings settings = {.config = *config};
    const cln_train_desc desc = {.scene = resume ? NULL : fixture_path("scene"),
                                 .run = fixture_path(run),
                                 .resume = resume,
                                 .skip_selftest = true,
                                 .settings = &settings,
                                 .device = fixture_device(),
                                 .command = "test",
                                 .callbacks = fixture_callbacks(stop ? stop : &none)};

    snprintf(settings.preset, sizeof settings.preset, "%s", fixture_preset(config));
    return cln_train(&desc, result);
}

/* Renders; asserts how many frames were, and how many were left as they are. */
static inline void fixture_rendered(const cln_render_desc *desc, int rendered, int skipped)
{
    cln_render_result result;

    assert_ok(cln_render(desc, &result));
    assert_int_equal(result.rendered, rendered);
    assert_int_equal(result.skipped, skipped);
}

/* A kernel folder whose lanes.h ends with these lines; skips outside the source tree. */
static inline const char *fixture_kernels_with(const char *name, const char *lines)
{
    char file[128], *text = NULL, *more = NULL;
    size_t bytes = 0;

    if (!cln_is_file("kernels/lanes.h"))
        skip();
    assert_ok(cln_read_file("kernels/lanes.h", (size_t)1 << 20, &text, &bytes));
    assert_true(asprintf(&more, "%s\n%s\n", text, lines) > 0);
    snprintf(file, sizeof file, "%s/lanes.h", name);
    assert_ok(cln_make_dirs(fixture_path(name)));
    scratch_put(fixture_path(file), more, strlen(more));
    free(text);
    free(more);
    return fixture_path(name);
}

/* A kernel folder whose FILE has `to` instead of its first `from`, besides what was changed before;
 * skips outside the source tree. */
static inline const char *fixture_kernels_changed(const char *name, const char *file,
                                                  const char *from, const char *to)
{
    char path[128], source[128], *text = NULL, *at = NULL, *changed = NULL;
    size_t bytes = 0;

    snprintf(path, sizeof path, "%s/%s", name, file);
    snprintf(source, sizeof source, "kernels/%s", file);
    if (!cln_is_file(source))
        skip();
    assert_ok(cln_read_file(cln_is_file(fixture_path(path)) ? fixture_path(path) : source,
                            (size_t)1 << 20, &text, &bytes));
    at = strstr(text, from);
    if (!at)
        fail_msg("%s has no \"%s\"", source, from);
    assert_true(asprintf(&changed, "%.*s%s%s", (int)(at - text), text, to, at + strlen(from)) > 0);
    assert_ok(cln_make_dirs(fixture_path(name)));
    scratch_put(fixture_path(path), changed, strlen(changed));
    free(text);
    free(changed);
    return fixture_path(name);
}

/* PSNR over the test pictures of the constant one that fits them best, on white. */
static inline double fixture_constant_psnr(void)
{
    double sum[3] = {0}, square[3] = {0}, error = 0;
    int n = 0;

    for (int i = 0; i < TEST_VIEWS; i++) {
        uint8_t *pixels = NULL;
        int width = 0, height = 0, channels = 0;
        char name[64];

        snprintf(name, sizeof name, "scene/test/r_%d.png", i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &pixels));
        assert_int_equal(channels, 4);
        for (int k = 0; k < width * height; k++, n++)
            for (int c = 0; c < 3; c++) {
                const double value = pixels[4 * k + 3] ? pixels[4 * k + c] / 255.0 : 1;

                sum[c] += value;
                square[c] += value * value;
            }
        free(pixels);
    }
    for (int c = 0; c < 3; c++)
        error += (square[c] - sum[c] * sum[c] / n) / n / 3;
    return -10 * log10(error);
}

/* A JSON file of the group's folder; the caller drops the reference. */
static inline json_t *fixture_json(const char *name)
{
    json_t *document = NULL;

    assert_ok(cln_json_read(fixture_path(name), false, &document));
    return document;
}

static inline json_t *fixture_parse(char *text)
{
    json_t *document = json_loads(text, 0, NULL);

    assert_non_null(document);
    free(text);
    return document;
}

/* Value at "a.b" of a document. */
static inline json_t *fixture_at(json_t *document, const char *path)
{
    char key[64];

    while (document && *path) {
        const size_t n = strcspn(path, ".");

        snprintf(key, sizeof key, "%.*s", (int)n, path);
        document = json_object_get(document, key);
        path += n + (path[n] == '.');
    }
    if (!document)
        fail_msg("no %s in the document", key);
    return document;
}

static inline uint64_t fixture_digest(const char *run)
{
    char *text = NULL;
    json_t *about = NULL;
    uint64_t digest = 0;

    assert_ok(cln_info_run(fixture_path(run), &text));
    about = fixture_parse(text);
    digest = strtoull(json_string_value(fixture_at(about, "model_digest")), NULL, 16);
    json_decref(about);
    return digest;
}

/* Group setup: folder, scene, and the run "whole" for comparison. Without a device it still makes
 * the scene, and tests skip themselves. */
static cln_train_result fixture_whole;
static bool fixture_has_device;

/* The folder alone, for groups without a scene; also finds out whether there is a device. */
static inline int fixture_setup_folder(void **state)
{
    const char *base = getenv("TMPDIR");
    const cln_device_desc desc = fixture_device();
    cln_device *device = NULL;

    (void)state;
    snprintf(fixture_folder, sizeof fixture_folder, "%s/cln-test-XXXXXX", base ? base : "/tmp");
    if (!mkdtemp(fixture_folder))
        return -1;
    cln_log_set_sink(fixture_no_log, NULL);
    fixture_has_device = cln_device_open(&desc, &device) == CLN_OK;
    cln_device_close(device);
    cln_clear_error();
    return 0;
}

static inline int fixture_setup(void **state)
{
    const cln_config config = fixture_config();
    char path[PATH_MAX];

    if (fixture_setup_folder(state) != 0)
        return -1;
    snprintf(path, sizeof path, "%s/scene", fixture_folder);
    fixture_split(path, "train", TRAIN_VIEWS, 0);
    fixture_split(path, "test", TEST_VIEWS, 0.3);
    if (fixture_has_device &&
        fixture_train("whole", false, &config, NULL, &fixture_whole) != CLN_OK) {
        print_error("%s\n", cln_error_text());
        return -1;
    }
    return 0;
}

static inline int fixture_teardown(void **state)
{
    char *folder = strdup(fixture_folder);
    void *own = folder;

    (void)state;
    return folder ? scratch_remove(&own) : -1;
}

/* First line of every test that computes. */
#define NEED_DEVICE()                           \
    do {                                        \
        (void)state;                            \
        cln_log_set_sink(fixture_no_log, NULL); \
        if (!fixture_has_device)                \
            skip();                             \
    } while (0)

#endif
