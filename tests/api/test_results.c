/* Functions that read a run: eval (equal to train's own figures, image by image), render (files,
 * existing files, stopping, foreign folders), info. */
#include "unit.h"
#include <pthread.h>
#include "run_fixture.h"
#include "render/open_run.h"
#include "render/recorded.h"
#include "render/view.h"
#include "io/npy.h"
#include "near.h"
#include "tests.h"

/* ---- eval ---- */

static cln_status evaluate(const char *run, const char *split, fixture_stop *stop,
                           cln_eval_result *result)
{
    fixture_stop none = {0};
    const cln_eval_desc desc = {.run = fixture_path(run),
                                .split = split,
                                .save_images = true,
                                .device = fixture_device(),
                                .callbacks = fixture_callbacks(stop ? stop : &none)};

    return cln_eval(&desc, result);
}

/* Removes measured times from the document. */
static void drop_seconds(json_t *document)
{
    json_t *images = fixture_at(document, "images");

    json_object_del(fixture_at(document, "mean"), "seconds");
    for (size_t i = 0; i < json_array_size(images); i++)
        json_object_del(json_array_get(images, i), "seconds");
}

static void test_eval_equals_training(void **state)
{
    json_t *of_train = NULL, *of_eval = NULL, *printed = NULL;
    cln_eval_result result;
    char *text = NULL;

    NEED_DEVICE();
    of_train = fixture_json("whole/eval/00000030-test.json");
    assert_ok(evaluate("whole", "test", NULL, &result));
    assert_int_equal(result.count, TEST_VIEWS);
    assert_true(result.psnr == fixture_whole.psnr_test);
    assert_int_equal(result.digest, fixture_whole.digest);
    assert_int_equal(result.step, STEPS);
    assert_string_equal(result.images[1].name, "test/r_1");
    of_eval = fixture_json("whole/eval/00000030-test.json");
    assert_ok(cln_eval_json(&result, &text));
    printed = fixture_parse(text);
    assert_true(json_equal(printed, of_eval));
    drop_seconds(of_train);
    drop_seconds(of_eval);
    if (!json_equal(of_train, of_eval))
        fail_msg("train's last evaluation: %s, eval's: %s", json_dumps(of_train, 0),
                 json_dumps(of_eval, 0));
    assert_true(cln_is_file(fixture_path("whole/eval/00000030-test/test_r_0.error.png")));
    cln_eval_free(&result);
    json_decref(of_train);
    json_decref(of_eval);
    json_decref(printed);
}

/* Opacity of a test view of a run, as pictures have it. */
static cln_picture picture_of(const char *run, int number)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_open_run v;
    cln_picture picture;
    int view = 0;

    assert_ok(cln_open_run_open(fixture_path(run), NULL, pixels, NULL, &v));
    while (v.scene->views[view].split != CLN_SPLIT_TEST)
        view++;
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(
        cln_render_view(&v.pipeline, view + number, v.scene->background, false, NULL, &picture));
    cln_open_run_close(&v);
    return picture;
}

/* Opacity beside the photos' alpha, by hand: its RMS error, and how much of the transparent part is
 * opaque. After one step there is fog all over, thick in the cube's middle and thin at its rim. */
static void test_eval_measures_opacity(void **state)
{
    cln_config config = fixture_config();
    cln_train_result trained;
    cln_eval_result result;
    double all_error = 0, all_air = 0;

    NEED_DEVICE();
    config.steps = 1;
    config.initial_depth = 0.7;
    assert_ok(fixture_train("fog", false, &config, NULL, &trained));
    assert_ok(evaluate("fog", "test", NULL, &result));
    assert_int_equal(result.count, TEST_VIEWS);
    for (int i = 0; i < TEST_VIEWS; i++) {
        cln_picture picture = picture_of("fog", i);
        uint8_t *photo = NULL;
        int width = 0, height = 0, channels = 0, air = 0, opaque = 0;
        double square = 0, want_air = 0;
        char name[64];

        snprintf(name, sizeof name, "scene/test/r_%d.png", i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &photo));
        assert_int_equal(channels, 4);
        assert_int_equal(picture.width * picture.height, SIDE * SIDE);
        for (int k = 0; k < SIDE * SIDE; k++) {
            const double alpha = photo[4 * k + 3] / 255.0;

            square += pow((double)picture.opacity[k] - alpha, 2);
            air += alpha == 0;
            opaque += alpha == 0 && picture.opacity[k] > 0.5f;
        }
        want_air = (double)opaque / air;
        print_message("opacity off by %.4f, %.1f %% of the air is opaque\n",
                      sqrt(square / (SIDE * SIDE)), 100 * want_air);
        assert_true(want_air > 0.05 && want_air < 0.95);
        assert_true(fabs(result.images[i].opacity_error - sqrt(square / (SIDE * SIDE))) < 1e-9);
        assert_true(fabs(result.images[i].opaque_air - want_air) < 1e-9);
        all_error += result.images[i].opacity_error / TEST_VIEWS;
        all_air += result.images[i].opaque_air / TEST_VIEWS;
        assert_true(isnan(result.images[i].psnr_most)); /* by the background it would be high */
        cln_picture_free(&picture);
        free(photo);
    }
    assert_true(fabs(result.opacity_error - all_error) < 1e-9);
    assert_true(fabs(result.opaque_air - all_air) < 1e-9);
    cln_eval_free(&result);
}

/* The scene with photos of another kind: of test view 0 they have no alpha, of view 1 no
 * transparent pixel. */
static void test_eval_without_alpha(void **state)
{
    cln_eval_result result;
    json_t *document = NULL;
    char *text = NULL, copy[2 * PATH_MAX];

    NEED_DEVICE();
    snprintf(copy, sizeof copy, "cp -r '%s' '%s'", fixture_path("scene"), fixture_path("solid"));
    assert_int_equal(system(copy), 0);
    for (int i = 0; i < TEST_VIEWS; i++) {
        uint8_t *photo = NULL;
        int width = 0, height = 0, channels = 0;
        char name[64];

        snprintf(name, sizeof name, "solid/test/r_%d.png", i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &photo));
        for (int k = 0; k < SIDE * SIDE; k++)
            if (i == 0)
                memmove(photo + 3 * k, photo + 4 * k, 3);
            else
                photo[4 * k + 3] = photo[4 * k + 3] / 2 + 1;
        assert_ok(cln_image_write_png(fixture_path(name), width, height, i == 0 ? 3 : 4, photo));
        free(photo);
    }
    const cln_eval_desc desc = {.run = fixture_path("whole"),
                                .scene = fixture_path("solid"),
                                .split = "test",
                                .out = fixture_path("solid eval"),
                                .device = fixture_device()};

    assert_ok(cln_eval(&desc, &result));
    assert_true(isnan(result.images[0].opacity_error) && isnan(result.images[0].opaque_air));
    assert_true(result.images[1].opacity_error > 0 && isnan(result.images[1].opaque_air));
    assert_true(result.opacity_error == result.images[1].opacity_error);
    assert_true(isnan(result.opaque_air));
    assert_ok(cln_eval_json(&result, &text));
    document = fixture_parse(text);
    assert_true(json_is_null(fixture_at(document, "mean.opaque_air")));
    assert_true(json_is_real(fixture_at(document, "mean.opacity_error")));
    json_decref(document);
    cln_eval_free(&result);
}

/* PSNR of the 93 % of two pictures' pixels that are nearest to each other. */
static double psnr_of_most(const char *a, const char *b)
{
    uint8_t *pixels[2] = {NULL, NULL};
    double errors[SIDE * SIDE], sum = 0;
    int most = (int)ceil(0.93 * SIDE * SIDE), width = 0, height = 0, channels = 0;

    for (int k = 0; k < 2; k++) {
        assert_ok(cln_image_load(fixture_path(k ? b : a), &width, &height, &channels, &pixels[k]));
        assert_true(width == SIDE && height == SIDE && channels == 3);
    }
    for (int i = 0; i < SIDE * SIDE; i++) {
        double error = 0;
        int at = i;

        for (int c = 3 * i; c < 3 * i + 3; c++)
            error += pow((pixels[0][c] - (double)pixels[1][c]) / 255, 2) / 3;
        for (; at > 0 && errors[at - 1] > error; at--) /* in order */
            errors[at] = errors[at - 1];
        errors[at] = error;
    }
    for (int i = 0; i < most; i++)
        sum += errors[i] / most;
    free(pixels[0]);
    free(pixels[1]);
    return -10 * log10(sum);
}

/* Photos without alpha are also told of by most of their pixels, up to digits of the pictures that
 * are saved. */
static void test_eval_of_most_pixels(void **state)
{
    static const char *const splits[] = {"train", "test"};
    cln_eval_result result;
    char copy[2 * PATH_MAX];

    NEED_DEVICE();
    snprintf(copy, sizeof copy, "cp -r '%s' '%s'", fixture_path("scene"), fixture_path("plain"));
    assert_int_equal(system(copy), 0);
    for (int i = 0; i < TRAIN_VIEWS + TEST_VIEWS; i++) {
        uint8_t *photo = NULL;
        int width = 0, height = 0, channels = 0;
        char name[64];

        snprintf(name, sizeof name, "plain/%s/r_%d.png", splits[i >= TRAIN_VIEWS], i % TRAIN_VIEWS);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &photo));
        for (int k = 0; k < SIDE * SIDE; k++)
            if (photo[4 * k + 3] > 0)
                memmove(photo + 3 * k, photo + 4 * k, 3);
            else
                memset(photo + 3 * k, 255, 3); /* the background */
        assert_ok(cln_image_write_png(fixture_path(name), width, height, 3, photo));
        free(photo);
    }
    const cln_eval_desc desc = {.run = fixture_path("whole"),
                                .scene = fixture_path("plain"),
                                .split = "test",
                                .out = fixture_path("plain eval"),
                                .save_images = true,
                                .device = fixture_device()};

    assert_ok(cln_eval(&desc, &result));
    for (int i = 0; i < TEST_VIEWS; i++) {
        char name[64], truth[64];
        double most = 0;

        snprintf(name, sizeof name, "plain eval/%08d-test/test_r_%d.png", STEPS, i);
        snprintf(truth, sizeof truth, "plain eval/%08d-test/test_r_%d.truth.png", STEPS, i);
        most = psnr_of_most(name, truth);
        print_message("%.3f dB, %.3f of most pixels\n", result.images[i].psnr, most);
        assert_true(most > result.images[i].psnr + 0.3);
        assert_near(result.images[i].psnr_most, most, 0.05);
    }
    cln_eval_free(&result);
}

static void test_eval_of_other_splits(void **state)
{
    cln_eval_result result;
    fixture_stop stop = {.signal = SIGINT, .pictures = 2};

    NEED_DEVICE();
    assert_ok(evaluate("whole", "train", NULL, &result));
    assert_int_equal(result.count, TRAIN_VIEWS);
    assert_string_equal(result.split, "train");
    cln_eval_free(&result);
    assert_fails(evaluate("whole", "val", NULL, &result), CLN_INPUT, "val");
    assert_fails(evaluate("whole", "nonsense", NULL, &result), CLN_USAGE, "nonsense");
    assert_fails(evaluate("scene", "test", NULL, &result), CLN_INPUT, "a scene, not a run");
    assert_fails(evaluate("whole", "test", &stop, &result), CLN_SIGINT, "");
    assert_null(result.images);
}

/* Photos of large scenes take minutes to read. */
static void test_eval_stops_while_photos_are_read(void **state)
{
    cln_eval_result result;
    fixture_stop stop = {.signal = SIGTERM, .photos = 1};

    NEED_DEVICE();
    assert_fails(evaluate("whole", "test", &stop, &result), CLN_SIGTERM, "signal");
    assert_null(strstr(cln_error_text(), "--scene"));
    assert_int_equal(stop.photos_seen, 1);
    assert_int_equal(stop.pictures_seen, 0);
}

/* ---- render ---- */

static cln_render_desc render_desc(const char *out, fixture_stop *stop)
{
    return (cln_render_desc){.run = fixture_path("whole"),
                             .out = fixture_path(out),
                             .split = "test",
                             .device = fixture_device(),
                             .callbacks = fixture_callbacks(stop)};
}

static uint64_t digest_of(const char *path)
{
    size_t bytes = 0;
    char *data = scratch_get(path, &bytes);
    const uint64_t digest = cln_digest(CLN_DIGEST_START, data, bytes);

    free(data);
    return digest;
}

static void test_render_skips(void **state)
{
    static const char *const files[] = {"frames/test_r_1.png", "frames/test_r_1.depth.npy",
                                        "frames/test_r_1.depth.png", "frames/test_r_1.opacity.png",
                                        "frames/render.json"};
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("frames", &none);
    uint64_t before[5];

    NEED_DEVICE();
    fixture_rendered(&desc, TEST_VIEWS, 0);
    for (int i = 0; i < 5; i++)
        before[i] = digest_of(fixture_path(files[i]));
    fixture_rendered(&desc, 0, TEST_VIEWS);
    for (int i = 0; i < 4; i++) {    /* whichever file is missing, it is made again */
        const int rendered = i != 2; /* a depth picture comes from what is there */

        assert_int_equal(remove(fixture_path(files[i])), 0);
        fixture_rendered(&desc, rendered, TEST_VIEWS - rendered);
    }
    for (int i = 0; i < 5; i++)
        assert_int_equal(digest_of(fixture_path(files[i])), before[i]);
    desc.overwrite = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    assert_int_equal(digest_of(fixture_path(files[0])), before[0]);
}

/* Frames that are rendered again leave no file of before: it would be taken for one of now. */
static void test_render_drops_what_is_stale(void **state)
{
    static const char *const extra[] = {"kinds/test_r_1.depth.pfm", "kinds/test_r_1.metric.png",
                                        "kinds/test_r_1.normal.npy", "kinds/test_r_1.normal.png"};
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("kinds", &none);
    uint64_t before = 0;

    NEED_DEVICE();
    desc.pfm = desc.normals = true;
    desc.depth_unit = 0.001;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    before = digest_of(fixture_path(extra[0]));
    desc.z_depth = true;
    desc.pfm = desc.normals = false;
    desc.depth_unit = 0;
    desc.overwrite = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    for (int i = 0; i < 4; i++)
        assert_false(cln_is_file(fixture_path(extra[i])));
    desc.pfm = desc.normals = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    assert_true(digest_of(fixture_path(extra[0])) != before);
}

/* The size that is asked for is told, also if it is of one side alone, and the least. */
static void test_render_tells_size(void **state)
{
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("narrow", &none);
    json_t *document = NULL;

    NEED_DEVICE();
    desc.width = 1;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    document = fixture_json("narrow/render.json");
    assert_int_equal(json_integer_value(json_array_get(fixture_at(document, "size"), 0)), 1);
    json_decref(document);
}

/* A frame whose files cannot be written or read is refused before anything is rendered. */
static void test_render_refuses_sizes(void **state)
{
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("too large", &none);
    cln_render_result result;

    NEED_DEVICE();
    desc.split = NULL;
    desc.orbit_frames = 1;
    desc.orbit_radius = 1;
    desc.normals = true;
    desc.width = 8192;
    desc.height = 32768; /* 2^28 pixels, 3 x 2^30 bytes of normals */
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--normals");
    desc.normals = false;
    desc.stereo = 0.1;
    assert_fails(cln_render(&desc, &result), CLN_USAGE, "--stereo");
    assert_false(cln_is_dir(fixture_path("too large")));
}

/* The plans are for the pictures that are asked for, not for the scene's photos: a run whose host
 * memory they would exceed ends before it renders, and so do lists of projected samples. */
static void test_render_is_planned(void **state)
{
    fixture_stop none = {0};
    cln_config config = fixture_config();
    cln_render_desc desc = render_desc("planned pictures", &none);
    cln_render_result result;

    NEED_DEVICE();
    config.steps = 1;
    config.host_mem = 600.0 * (1 << 20);
    assert_ok(fixture_train("frugal", false, &config, NULL, &(cln_train_result){0}));
    desc.run = fixture_path("frugal");
    desc.split = NULL;
    desc.orbit_frames = 1;
    desc.orbit_radius = 1;
    desc.width = desc.height = 32;
    fixture_rendered(&desc, 1, 0);
    desc.out = fixture_path("larger pictures");
    desc.width = desc.height = 2000; /* 400 MB at most; with a pair's other eye, 800 */
    desc.stereo = 0.1;
    assert_fails(cln_render(&desc, &result), CLN_MEMORY, "batches and pictures");
    assert_false(cln_is_dir(desc.out));
}

/* Colour as evaluated; depth in scene units, shorter along the axis than along the ray, 0 in empty
 * space. */
static void test_render_files(void **state)
{
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("along", &none);
    int dims = 0, shape[4], width = 0, height = 0, channels = 0, seen = 0;
    float *ray = NULL, *axis = NULL;
    uint8_t *opacity = NULL, *picture = NULL, *evaluated = NULL;

    NEED_DEVICE();
    fixture_rendered(&desc, TEST_VIEWS, 0);
    desc.out = fixture_path("axis");
    desc.z_depth = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    assert_ok(cln_npy_read_f32(fixture_path("along/test_r_0.depth.npy"), &dims, shape, &ray));
    assert_int_equal(dims, 2);
    assert_int_equal(shape[0], SIDE);
    assert_int_equal(shape[1], SIDE);
    assert_ok(cln_npy_read_f32(fixture_path("axis/test_r_0.depth.npy"), &dims, shape, &axis));
    assert_ok(cln_image_load(fixture_path("along/test_r_0.opacity.png"), &width, &height, &channels,
                             &opacity));
    for (int i = 0; i < SIDE * SIDE; i++) {
        assert_true(isfinite(ray[i]) && ray[i] >= 0 && axis[i] <= ray[i]);
        if (opacity[i * channels] < 128)
            continue;
        seen++;
        assert_true(ray[i] > 1.3 && ray[i] < 6.7); /* the cube of +-1.5 from 4 away */
        assert_true(axis[i] > 0.85f * ray[i]);     /* 1 / cos of the corner */
    }
    assert_true(seen > SIDE);
    assert_ok(
        cln_image_load(fixture_path("along/test_r_0.png"), &width, &height, &channels, &picture));
    assert_int_equal(channels, 3);
    free(evaluated);
    assert_ok(cln_image_load(fixture_path("whole/eval/00000030-test/test_r_0.png"), &width, &height,
                             &channels, &evaluated));
    assert_memory_equal(picture, evaluated, SIDE * SIDE * 3);
    /* the same poses from a file */
    desc = render_desc("of a file", &none);
    desc.split = NULL;
    desc.poses = fixture_path("scene/transforms_test.json");
    fixture_rendered(&desc, TEST_VIEWS, 0);
    assert_true(digest_of(fixture_path("of a file/test_r_0.png")) ==
                digest_of(fixture_path("along/test_r_0.png")));
    free(ray);
    free(axis);
    free(opacity);
    free(picture);
    free(evaluated);
}

static void count_behind(cln_log_level level, const char *line, void *user)
{
    *(int *)user += level == CLN_LOG_WARN && strstr(line, "are behind the camera");
}

/* A panorama from within sees behind its camera's plane. There depths along the axis are negative,
 * ray times cosine; all that is made from depths is as along the ray; 16-bit files cannot tell. */
static void test_render_behind(void **state)
{
    enum { WIDTH = 48, HEIGHT = 24 };
    static const char poses[] =
        "{\"camera_model\":\"EQUIRECTANGULAR\",\"w\":48,\"h\":24,\"frames\":[{\"file_path\":"
        "\"round.png\",\"transform_matrix\":[[1,0,0,0.1],[0,1,0,-1.1],[0,0,1,0.2],[0,0,0,1]]}]}";
    static const char *const out[2] = {"round, ray", "round, axis"};
    fixture_stop none = {0};
    uint8_t *colour[2], *grey[2];
    float *depth[2], *normal[2];
    int dims = 0, shape[4], width = 0, height = 0, channels = 0, behind = 0, with_normal = 0,
        warnings = 0;

    NEED_DEVICE();
    assert_ok(cln_write_file(fixture_path("round.json"), poses, sizeof poses - 1));
    for (int axis = 0; axis < 2; axis++) {
        cln_render_desc desc = render_desc(out[axis], &none);
        char name[64];

        desc.split = NULL;
        desc.poses = fixture_path("round.json");
        desc.antialias = 2;
        desc.normals = true;
        desc.z_depth = axis == 1;
        desc.depth_unit = 0.001;
        cln_log_to(CLN_LOG_WARN, count_behind, &warnings);
        fixture_rendered(&desc, 1, 0);
        cln_log_to(CLN_LOG_INFO, fixture_no_log, NULL);
        assert_int_equal(warnings, axis);
        snprintf(name, sizeof name, "%s/round.depth.npy", out[axis]);
        assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &depth[axis]));
        snprintf(name, sizeof name, "%s/round.normal.npy", out[axis]);
        assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &normal[axis]));
        assert_true(shape[0] == HEIGHT && shape[1] == WIDTH);
        snprintf(name, sizeof name, "%s/round.depth.png", out[axis]);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &grey[axis]));
        snprintf(name, sizeof name, "%s/round.png", out[axis]);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &(int){0}, &colour[axis]));
    }
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const double turn = (i % WIDTH + 0.5) / WIDTH * 2 - 1;
        const double cosine = cos(M_PI * turn) * cos(M_PI * ((i / WIDTH + 0.5) / HEIGHT - 0.5));

        assert_near(depth[1][i], (double)depth[0][i] * cosine, 1e-5);
        assert_near(grey[1][channels * i], grey[0][channels * i], 1);
        for (int c = 0; c < 3; c++) {
            assert_int_equal(colour[1][3 * i + c], colour[0][3 * i + c]);
            assert_true(normal[1][3 * i + c] == normal[0][3 * i + c]);
            with_normal += depth[1][i] < 0 && normal[1][3 * i + c] != 0;
        }
        behind += depth[1][i] < 0;
    }
    print_message("a panorama: %d of %d pixels behind the camera, %d with a normal\n", behind,
                  WIDTH * HEIGHT, with_normal / 3);
    assert_true(behind > WIDTH * HEIGHT / 4 && with_normal > 60);
    for (int axis = 0; axis < 2; axis++) {
        free(colour[axis]);
        free(grey[axis]);
        free(depth[axis]);
        free(normal[axis]);
    }
}

typedef struct heard {
    pthread_t thread;
    int here, elsewhere; /* warnings on that thread, on others */
} heard;

static void hear(cln_log_level level, const char *line, void *user)
{
    heard *h = user;

    if (level != CLN_LOG_WARN || !strstr(line, "--depth-unit"))
        return;
    if (pthread_equal(pthread_self(), h->thread))
        h->here++;
    else
        h->elsewhere++;
}

/* Frames are written beside the work, but their warnings are said on the caller's thread. */
static void test_render_warns_here(void **state)
{
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("fine", &none);
    heard h = {.thread = pthread_self()};

    NEED_DEVICE();
    desc.depth_unit = 1e-6;
    cln_log_to(CLN_LOG_WARN, hear, &h);
    fixture_rendered(&desc, TEST_VIEWS, 0);
    cln_log_to(CLN_LOG_INFO, fixture_no_log, NULL);
    assert_int_equal(h.here, TEST_VIEWS);
    desc = render_desc("coarse", &none);
    desc.depth_unit = 0.1; /* of a scene of 3 */
    cln_log_to(CLN_LOG_WARN, hear, &h);
    fixture_rendered(&desc, TEST_VIEWS, 0);
    cln_log_to(CLN_LOG_INFO, fixture_no_log, NULL);
    assert_int_equal(h.here, TEST_VIEWS + 1); /* once */
    assert_int_equal(h.elsewhere, 0);
}

/* The poses of the test views, their cameras moved along their own right. */
static void write_poses(const char *path, double right)
{
    json_t *document = fixture_json("scene/transforms_test.json");
    json_t *frames = fixture_at(document, "frames");
    char *text = NULL;

    for (size_t i = 0; i < json_array_size(frames); i++) {
        json_t *m = json_object_get(json_array_get(frames, i), "transform_matrix");

        for (size_t a = 0; a < 3; a++) {
            json_t *row = json_array_get(m, a);
            const double moved = json_number_value(json_array_get(row, 3)) +
                                 right * json_number_value(json_array_get(row, 0));

            json_array_set_new(row, 3, json_real(moved));
        }
    }
    text = json_dumps(document, JSON_REAL_PRECISION(17));
    assert_ok(cln_write_file(fixture_path(path), text, strlen(text)));
    free(text);
    json_decref(document);
}

/* A pair has the left eye's picture beside the right one's, in all files. */
static void test_render_pairs(void **state)
{
    static const char *const eyes[2] = {"left", "right"};
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("pairs", &none);
    int width = 0, height = 0, channels = 0, dims = 0, shape[4];
    uint8_t *pair = NULL;
    float *depths = NULL, *normals = NULL;
    json_t *about = NULL;

    NEED_DEVICE();
    desc.stereo = 0.4;
    desc.normals = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    fixture_rendered(&desc, 0, TEST_VIEWS);
    about = fixture_json("pairs/render.json");
    assert_true(json_number_value(fixture_at(about, "stereo")) == 0.4);
    json_decref(about);
    assert_ok(
        cln_image_load(fixture_path("pairs/test_r_1.png"), &width, &height, &channels, &pair));
    assert_int_equal(width, 2 * SIDE);
    assert_int_equal(height, SIDE);
    assert_ok(cln_npy_read_f32(fixture_path("pairs/test_r_1.depth.npy"), &dims, shape, &depths));
    assert_int_equal(shape[1], 2 * SIDE);
    assert_ok(cln_npy_read_f32(fixture_path("pairs/test_r_1.normal.npy"), &dims, shape, &normals));
    assert_true(dims == 3 && shape[0] == SIDE && shape[1] == 2 * SIDE && shape[2] == 3);
    for (int e = 0; e < 2; e++) {
        char name[64];
        uint8_t *one = NULL;
        float *depth = NULL, *normal = NULL;

        snprintf(name, sizeof name, "%s.json", eyes[e]);
        write_poses(name, e ? 0.2 : -0.2);
        desc = render_desc(eyes[e], &none);
        desc.split = NULL;
        desc.poses = fixture_path(name);
        desc.normals = true;
        fixture_rendered(&desc, TEST_VIEWS, 0);
        snprintf(name, sizeof name, "%s/test_r_1.png", eyes[e]);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &one));
        snprintf(name, sizeof name, "%s/test_r_1.depth.npy", eyes[e]);
        assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &depth));
        snprintf(name, sizeof name, "%s/test_r_1.normal.npy", eyes[e]);
        assert_ok(cln_npy_read_f32(fixture_path(name), &dims, shape, &normal));
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++) {
                const int at = y * SIDE + x, in = (2 * y + e) * SIDE + x;

                assert_true(depths[in] == depth[at]);
                for (int c = 0; c < 3; c++) {
                    assert_int_equal(pair[3 * in + c], one[3 * at + c]);
                    assert_true(normals[3 * in + c] == normal[3 * at + c]);
                }
            }
        free(one);
        free(depth);
        free(normal);
    }
    free(pair);
    free(depths);
    free(normals);
}

static void test_render_stops_and_goes_on(void **state)
{
    fixture_stop stop = {.signal = SIGTERM, .pictures = 2}, none = {0};
    cln_render_desc desc = render_desc("stopped", &stop);
    cln_render_result result;

    NEED_DEVICE();
    assert_fails(cln_render(&desc, &result), CLN_SIGTERM, "1 of 2 frames");
    assert_int_equal(result.rendered, 1);
    desc.callbacks = fixture_callbacks(&none);
    fixture_rendered(&desc, 1, 1);
}

/* Frames of other settings are replaced if that is asked for, frames of the same settings are kept,
 * whatever was rendered in between; foreign folders stay as they are. */
static void test_render_folders(void **state)
{
    fixture_stop none = {0}, stop = {.signal = SIGTERM, .pictures = 2};
    cln_render_desc desc = render_desc("mixed", &none);
    cln_render_result result;
    json_t *about = NULL;

    NEED_DEVICE();
    fixture_rendered(&desc, TEST_VIEWS, 0);
    fixture_rendered(&desc, 0, TEST_VIEWS);
    desc.z_depth = true;
    assert_fails(cln_render(&desc, &result), CLN_OUTPUT, "of other settings");
    desc.overwrite = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    desc.overwrite = false;
    fixture_rendered(&desc, 0, TEST_VIEWS);
    desc.split = "train";
    desc.max_images = 1;
    fixture_rendered(&desc, 1, 0);
    desc.split = "test";
    desc.max_images = 0;
    fixture_rendered(&desc, 0, TEST_VIEWS);
    about = fixture_json("mixed/render.json");
    assert_int_equal(json_object_size(fixture_at(about, "frames")), TEST_VIEWS + 1);
    json_decref(about);
    /* stopped while rendering with other settings: old frames are not taken for new ones */
    desc.z_depth = false;
    desc.overwrite = true;
    desc.callbacks = fixture_callbacks(&stop);
    assert_fails(cln_render(&desc, &result), CLN_SIGTERM, "1 of 2 frames");
    desc.overwrite = false; /* goes on, though it was not given */
    assert_false(cln_is_file(fixture_path("mixed/test_r_1.png")));
    assert_false(cln_is_file(fixture_path("mixed/test_r_1.depth.png")));
    desc.callbacks = fixture_callbacks(&none);
    fixture_rendered(&desc, 1, 1);
    desc.out = fixture_path("scene");
    assert_fails(cln_render(&desc, &result), CLN_OUTPUT, "render.json");
    assert_false(cln_is_file(fixture_path("scene/render.json")));
}

/* After more training the same folder gets the newer model's frames, if that is asked for. */
static void test_render_follows_the_model(void **state)
{
    fixture_stop none = {0};
    cln_render_desc desc = render_desc("followed", &none);
    cln_config config = fixture_config();
    cln_train_result trained;
    cln_render_result result;
    uint64_t before = 0;

    NEED_DEVICE();
    config.steps = 2;
    assert_ok(fixture_train("longer", false, &config, NULL, &trained));
    desc.run = fixture_path("longer");
    fixture_rendered(&desc, TEST_VIEWS, 0);
    before = digest_of(fixture_path("followed/test_r_0.png"));
    config.steps = 4;
    assert_ok(fixture_train("longer", true, &config, NULL, &trained));
    assert_fails(cln_render(&desc, &result), CLN_OUTPUT, "of another model; --overwrite");
    assert_int_equal(digest_of(fixture_path("followed/test_r_0.png")), before);
    desc.overwrite = true;
    fixture_rendered(&desc, TEST_VIEWS, 0);
    assert_true(digest_of(fixture_path("followed/test_r_0.png")) != before);
    desc.overwrite = false;
    fixture_rendered(&desc, 0, TEST_VIEWS);
}

/* A run.json that says that its photos have no alpha is believed where they are not decoded, and
 * not where they are, nor for other photos. */
static void test_recorded_alpha(void **state)
{
    const cln_config config = fixture_config();
    cln_scene_desc desc = {.path = fixture_path("scene"), .config = &config};
    cln_scene *scene = NULL;
    char text[1024];
    bool same = false;

    (void)state;
    assert_ok(cln_scene_load(&desc, &scene));
    assert_ok(cln_make_dirs(fixture_path("told")));
    for (int other = 0; other < 2; other++) {
        snprintf(text, sizeof text,
                 "{\"schema\": \"cl-nascent.run/1\", \"dataset\": {\"alpha\": false, "
                 "\"digest\": \"%016llx\"}}",
                 (unsigned long long)scene->digest + (unsigned)other);
        scratch_put(fixture_path("told/run.json"), text, strlen(text));
        for (int pixels = 0; pixels < 2; pixels++) {
            cln_scene *told = NULL;

            desc.pixels[CLN_SPLIT_TRAIN] = pixels;
            assert_ok(cln_recorded_load(fixture_path("told"), &desc, &told, &same));
            assert_int_equal(same, !other);
            assert_int_equal(told->has_alpha, other || pixels);
            cln_scene_free(told);
        }
    }
    cln_scene_free(scene);
}

/* ---- info ---- */

static void test_info(void **state)
{
    const cln_settings settings = {.config = fixture_config()};
    char *text = NULL;
    json_t *about = NULL;
    json_int_t leaves = 0;

    (void)state;
    assert_ok(cln_info_scene(fixture_path("scene"), &settings, &text));
    about = fixture_parse(text);
    assert_string_equal(json_string_value(fixture_at(about, "dialect")), "blender");
    assert_int_equal(json_integer_value(fixture_at(about, "splits.train")), TRAIN_VIEWS);
    json_decref(about);
    assert_fails(cln_info_scene(fixture_path("nowhere"), &settings, &text), CLN_INPUT, "nowhere");
    assert_null(text);
    NEED_DEVICE();
    assert_ok(cln_info_run(fixture_path("whole"), &text));
    about = fixture_parse(text);
    assert_int_equal(json_integer_value(fixture_at(about, "step")), STEPS);
    for (size_t level = 0; level < 6; level++)
        leaves += json_integer_value(json_array_get(fixture_at(about, "leaves_by_level"), level));
    assert_int_equal(leaves, json_integer_value(fixture_at(about, "leaves")));
    assert_int_equal(json_integer_value(json_array_get(fixture_at(about, "leaves_by_level"), 1)),
                     8);
    assert_string_equal(json_string_value(fixture_at(about, "result.model_digest")),
                        json_string_value(fixture_at(about, "model_digest")));
    assert_int_equal(json_integer_value(fixture_at(about, "config.width")), 16);
    json_decref(about);
    assert_fails(cln_info_run(fixture_path("scene"), &text), CLN_INPUT, "a scene, not a run");
}

/* What cln_info_scene tells, without what is of this moment: free memory and disk. */
static json_t *info_without_moment(char *text)
{
    static const char *const keys[] = {"host_memory_free", "disk_free", "free_note"};
    json_t *document = fixture_parse(text), *training = json_object_get(document, "training");

    assert_true(json_is_object(training));
    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        json_object_del(training, keys[i]);
    return document;
}

/* A desc names what is missing or out of range; without settings the default preset's count. */
/* No settings are the default ones. */
static void test_info_of_a_scene(void **state)
{
    const char *scene = fixture_path("scene");
    cln_settings *settings = NULL;
    char *text = NULL, *same = NULL;
    json_t *one = NULL, *other = NULL;

    (void)state;
    assert_ok(cln_settings_create(NULL, &settings));
    assert_ok(cln_info_scene(scene, settings, &text));
    assert_ok(cln_info_scene(scene, NULL, &same));
    one = info_without_moment(text);
    other = info_without_moment(same);
    assert_true(json_equal(one, other));
    json_decref(one);
    json_decref(other);
    cln_settings_free(settings);
}

/* A box behind test photo 0 is seen by those that look that way: the means are over these, and
 * training measures no other view. With a shell the box decides, too. */
static void test_eval_of_a_part(void **state)
{
    NEED_DEVICE();
    for (int shell = 0; shell < 2; shell++) {
        const char *run = shell ? "part in shell" : "part";
        cln_config config = fixture_config();
        cln_train_result trained;
        cln_eval_result result;
        json_t *document = NULL;
        char *text = NULL;
        double sum = 0;
        int seen = 0;

        config.steps = 2;
        config.space = shell ? CLN_SPACE_SHELL : CLN_SPACE_CUBE;
        snprintf(config.bbox, sizeof config.bbox, "2.44,3.55,-0.3,3.44,4.55,0.7");
        assert_ok(fixture_train(run, false, &config, NULL, &trained));
        assert_ok(evaluate(run, "all", NULL, &result));
        assert_int_equal(result.count, TRAIN_VIEWS + TEST_VIEWS);
        assert_int_equal(result.apart, TRAIN_VIEWS - 1 + TEST_VIEWS - 1);
        assert_int_equal(trained.eval_views, 1);
        assert_int_equal(trained.test_views, TEST_VIEWS);
        for (int i = 0; i < result.count; i++) {
            seen += !result.images[i].apart;
            sum += result.images[i].apart ? 0 : result.images[i].psnr;
            assert_false(result.images[i].apart && result.images[i].empty);
        }
        assert_int_equal(seen, result.count - result.apart);
        assert_near(result.psnr, sum / seen, 1e-9);
        assert_ok(cln_eval_json(&result, &text));
        document = fixture_parse(text);
        assert_int_equal(json_integer_value(fixture_at(document, "apart")), result.apart);
        json_decref(document);
        cln_eval_free(&result);
    }
}

int test_group_results(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_eval_equals_training),
        cmocka_unit_test(test_eval_measures_opacity),
        cmocka_unit_test(test_eval_of_a_part),
        cmocka_unit_test(test_eval_without_alpha),
        cmocka_unit_test(test_eval_of_most_pixels),
        cmocka_unit_test(test_eval_of_other_splits),
        cmocka_unit_test(test_eval_stops_while_photos_are_read),
        cmocka_unit_test(test_render_skips),
        cmocka_unit_test(test_render_drops_what_is_stale),
        cmocka_unit_test(test_render_tells_size),
        cmocka_unit_test(test_render_refuses_sizes),
        cmocka_unit_test(test_render_is_planned),
        cmocka_unit_test(test_render_files),
        cmocka_unit_test(test_render_behind),
        cmocka_unit_test(test_render_warns_here),
        cmocka_unit_test(test_render_pairs),
        cmocka_unit_test(test_render_stops_and_goes_on),
        cmocka_unit_test(test_render_folders),
        cmocka_unit_test(test_render_follows_the_model),
        cmocka_unit_test(test_recorded_alpha),
        cmocka_unit_test(test_info),
        cmocka_unit_test(test_info_of_a_scene),
    };

    return cmocka_run_group_tests_name("results", tests, fixture_setup, fixture_teardown);
}
