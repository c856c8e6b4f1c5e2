/* Pictures as good as the model (docs/method.md 13): compares a picture's few samples with hundreds
 * of evenly spread ones, whose sum is nearly the integral, on the same rays of one trained
 * model. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <sys/stat.h>
#include "render/antialias.h"
#include "render/crop.h"
#include "render/open_run.h"
#include "render/quality.h"
#include "render/ray_batch.h"
#include "render/view.h"
#include "run_fixture.h"
#include "tests.h"
#include "view/painter.h"

/* What render_fine shows: a run, and a part of it; NULL: all. */
static const char *run = "whole";
static cln_crop *shown;

/* Teardown of tests that change these: a test that fails does not come back. */
static int show_all_of_whole(void **state)
{
    (void)state;
    run = "whole";
    shown = NULL;
    return 0;
}

/* The first test view of the run, with these settings of its sampling (NULL: its own), so many
 * times as large; max_rays 0: the pipeline's own. */
static size_t render_fine(const cln_config *sampling, int antialias, int larger, int max_rays,
                          cln_picture *out)
{
    const bool pixels[CLN_SPLITS] = {false, false, true};
    const cln_device_desc device = fixture_device();
    cln_open_run v;
    int *views = NULL, count = 0;
    size_t samples = 0;

    assert_ok(cln_open_run_open(fixture_path(run), NULL, pixels, NULL, &v));
    if (sampling)
        v.model.config = *sampling;
    assert_ok(cln_open_run_start(&v, &device, false));
    for (int i = 0; i < v.scene->view_count; i++) {
        cln_camera *c = &v.scene->views[i].camera;

        c->width *= larger;
        c->height *= larger;
        c->fx *= larger;
        c->fy *= larger;
        c->cx *= larger;
        c->cy *= larger;
    }
    v.pipeline.antialias = antialias;
    if (max_rays > 0)
        v.pipeline.max_rays = max_rays;
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_crop_use(&v.pipeline, &v.model.space, shown));
    assert_ok(cln_render_view(&v.pipeline, views[0], v.scene->background, false, NULL, out));
    assert_ok(cln_crop_use(&v.pipeline, &v.model.space, NULL));
    samples = v.pipeline.sample_total;
    cln_open_run_close(&v);
    free(views);
    return samples;
}

static size_t render(const cln_config *sampling, cln_picture *out)
{
    return render_fine(sampling, 1, 1, 0, out);
}

/* The same view cropped to a box of the scene; *space and *camera are the view's. */
static void render_crop(const double box[6], cln_picture *out, cln_space *space, cln_camera *camera)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_crop crop = {.on = true};
    cln_open_run v;
    int *views = NULL, count = 0;

    memcpy(crop.box, box, sizeof crop.box);
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_crop_use(&v.pipeline, &v.model.space, &crop));
    assert_ok(cln_render_view(&v.pipeline, views[0], v.scene->background, 0, NULL, out));
    assert_ok(cln_crop_use(&v.pipeline, &v.model.space, NULL));
    assert_null(v.pipeline.crop);
    *space = v.model.space;
    *camera = v.scene->views[views[0]].camera;
    cln_open_run_close(&v);
    free(views);
}

static double psnr(const cln_picture *a, const cln_picture *b)
{
    const size_t n = (size_t)a->width * (size_t)a->height * 3;
    double sum = 0;

    for (size_t i = 0; i < n; i++)
        sum += ((double)a->rgb[i] - b->rgb[i]) * ((double)a->rgb[i] - b->rgb[i]);
    return -10 * log10(sum / (double)n);
}

static cln_config config_of_run(void)
{
    cln_open_run v;
    cln_config config;

    assert_ok(cln_open_run_model(fixture_path(run), &v));
    config = v.model.config;
    cln_open_run_close(&v);
    return config;
}

/* The run's picture is nearly that of dense sampling, and nearer than without even samples. */
static void check_dense(double least, double gain)
{
    cln_config dense, steered;
    cln_picture own, even, without;

    dense = steered = config_of_run();
    dense.allocate = CLN_ALLOCATE_CHORD;
    dense.samples_per_leaf = 256;
    dense.uniform_share = 1;
    dense.empty_weight = 0;
    dense.render_min_transmittance = 0;
    steered.uniform_share = 0;
    render(NULL, &own);
    render(&dense, &even);
    render(&steered, &without);
    print_message("%s, against dense sampling: %.2f dB; without even samples: %.2f dB\n", run,
                  psnr(&own, &even), psnr(&without, &even));
    assert_true(psnr(&own, &even) > least);
    assert_true(psnr(&own, &even) > psnr(&without, &even) + gain);
    cln_picture_free(&own);
    cln_picture_free(&even);
    cln_picture_free(&without);
}

static void test_agree_with_dense_sampling(void **state)
{
    NEED_DEVICE();
    check_dense(40, 1);
}

static void test_voxels_agree_with_dense_sampling(void **state)
{
    const cln_config config = fixture_voxels();
    cln_train_result result;

    NEED_DEVICE();
    assert_ok(fixture_train("voxels", false, &config, NULL, &result));
    run = "voxels";
    check_dense(44, 2); /* 47.05; 41.78 without even samples */
}

/* Where a leaf's most samples do not bind, --fast takes at most two thirds of the samples; its
 * picture is nearly the same. */
static void test_fast(void **state)
{
    cln_config many, fast;
    cln_picture own, other;
    size_t samples = 0, fewer = 0;

    (void)state;
    NEED_DEVICE();
    many = config_of_run();
    many.samples_per_leaf = 64;
    many.batch_samples = 1 << 16; /* the picture is one batch */
    fast = many;
    cln_render_faster(&fast);
    samples = render(&many, &own);
    fewer = render(&fast, &other);
    print_message("--fast: %.2f dB from the picture, %zu samples of %zu\n", psnr(&own, &other),
                  fewer, samples);
    assert_true(fewer > 0 && 3 * fewer < 2 * samples);
    assert_true(psnr(&own, &other) > 35);
    cln_picture_free(&own);
    cln_picture_free(&other);
}

/* Pixels of a picture of several squares (view.c), the last ones cut, in many batches: each is its
 * own ray's, whichever rays are beside it. */
static void test_squares(void **state)
{
    enum { WIDTH = 150, HEIGHT = 140 };
    static const int rows[] = {0, 1, 127, 128, HEIGHT - 1};
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_pixel row[WIDTH];
    cln_ray_result results[WIDTH];
    float backgrounds[WIDTH][4] = {{0}};
    cln_open_run v;
    cln_picture picture;
    int batches = 0;

    (void)state;
    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    for (int i = 0; i < v.scene->view_count; i++) {
        cln_camera *c = &v.scene->views[i].camera;
        const double larger = (double)WIDTH / c->width;

        c->width = WIDTH;
        c->height = HEIGHT;
        c->fx *= larger;
        c->fy *= larger;
        c->cx = 0.5 * WIDTH;
        c->cy = 0.5 * HEIGHT;
    }
    v.pipeline.max_samples = 4096;
    v.pipeline.max_rays = 3000;
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_render_view(&v.pipeline, 0, backgrounds[0], 0, NULL, &picture));
    for (size_t k = 0; k < sizeof rows / sizeof *rows; k++) {
        for (int done = 0, some = 0; done < WIDTH; done += some, batches++) {
            const cln_ray_batch batch = {.pixels = row,
                                         .backgrounds = (const float(*)[4])backgrounds,
                                         .n = WIDTH - done,
                                         .sampling = cln_render_sampling(&v.pipeline)};

            for (int i = done; i < WIDTH; i++)
                row[i - done] = (cln_pixel){.x = (cln_u32)i, .y = (cln_u32)rows[k]};
            assert_ok(cln_render_rays(&v.pipeline, &batch, results + done, &some));
        }
        for (int x = 0; x < WIDTH; x++) {
            const size_t at = (size_t)rows[k] * WIDTH + (size_t)x;

            assert_memory_equal(picture.rgb + 3 * at, &results[x].r, 3 * sizeof(float));
            assert_memory_equal(picture.depth + at, &results[x].depth, sizeof(float));
            assert_memory_equal(picture.opacity + at, &results[x].opacity, sizeof(float));
        }
    }
    print_message("%d rows in %d batches\n", (int)(sizeof rows / sizeof *rows), batches);
    cln_picture_free(&picture);
    cln_open_run_close(&v);
}

/* A picture's samples leave no room for those of regularisers, which come in training alone. */
static void test_keeps_to_the_plan(void **state)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    const float background[3] = {0};
    cln_open_run v;
    cln_picture picture;

    (void)state;
    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    v.model.config.sparsity = v.model.config.edge = 0.01;
    assert_ok(cln_open_run_start(&v, &device, false));
    v.pipeline.max_samples = 2048;
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_render_view(&v.pipeline, 0, background, 0, NULL, &picture));
    assert_in_range(v.pipeline.samples.bytes / sizeof(cln_sample), 1024, 2048);
    cln_picture_free(&picture);
    cln_open_run_close(&v);
}

/* A row of pixels whose square has more than 2^31, by the method that takes pixels row by row. */
static void test_wide(void **state)
{
    enum { WIDTH = 65536, SOME = 64 };
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    const float background[1][4] = {{0}};
    cln_pixel some[SOME];
    cln_ray_result results[SOME];
    cln_open_run v;
    cln_picture picture;
    int seen = 0;

    (void)state;
    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    v.model.config.stage1 = CLN_STAGE1_SPLAT;
    assert_ok(cln_open_run_start(&v, &device, false));
    for (int i = 0; i < v.scene->view_count; i++) {
        cln_camera *c = &v.scene->views[i].camera;

        c->width = WIDTH;
        c->height = 1;
        c->cx = 0.5 * WIDTH;
        c->cy = 0.5;
    }
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_render_view(&v.pipeline, 0, background[0], 0, NULL, &picture));
    for (int first = 0; first + SOME <= WIDTH; first += WIDTH / 8 - SOME / 8) {
        const cln_ray_batch batch = {.pixels = some,
                                     .backgrounds = background,
                                     .n = SOME,
                                     .sampling = cln_render_sampling(&v.pipeline)};
        int done = 0;

        for (int i = 0; i < SOME; i++)
            some[i] = (cln_pixel){.x = (cln_u32)(first + i)};
        assert_ok(cln_render_rays(&v.pipeline, &batch, results, &done));
        assert_int_equal(done, SOME);
        for (int i = 0; i < SOME; i++) {
            assert_memory_equal(picture.rgb + 3 * (first + i), &results[i].r, 3 * sizeof(float));
            assert_memory_equal(picture.opacity + first + i, &results[i].opacity, sizeof(float));
            seen += results[i].opacity > 0;
        }
    }
    print_message("a wide row: %d pixels are not empty\n", seen);
    assert_true(seen > 4);
    cln_picture_free(&picture);
    cln_open_run_close(&v);
}

/* A pixel is the mean of a picture of three times the size where edges are, and the ray through its
 * centre elsewhere. Returns how many pixels have the depth of another ray than the centre's. */
static int check_antialias(void)
{
    enum { N = 3 };
    cln_picture own, blocks, plain, fine;
    cln_antialias edges;
    int next = 0, taken = 0;

    render(NULL, &plain);
    render_fine(NULL, N, 1, 0, &own);
    render_fine(NULL, N, 1, 200, &blocks); /* a row of pixels needs more than one batch */
    render_fine(NULL, 1, N, 0, &fine);
    assert_ok(cln_antialias_find(&plain, N, 1024, &edges));
    print_message("edges: %d of %d pixels\n", edges.count, plain.width * plain.height);
    assert_in_range(edges.count, 1, plain.width * plain.height - 1);
    assert_int_equal(own.width, plain.width);
    for (int i = 0; i < plain.width * plain.height; i++) {
        const bool edge = next < edges.count && edges.pixels[next] == i;
        double sum[4] = {0};
        float best[2] = {0, plain.depth[i]}; /* opacity, depth */

        next += edge;
        for (int k = 0; k < N * N; k++) {
            const int at = (i / plain.width * N + k / N) * fine.width + i % plain.width * N + k % N;

            for (int c = 0; c < 3; c++)
                sum[c] += fine.rgb[3 * at + c] / (double)(N * N);
            sum[3] += fine.opacity[at] / (double)(N * N);
            if (edge && plain.opacity[i] == 0 && fine.opacity[at] > best[0]) {
                best[0] = fine.opacity[at];
                best[1] = fine.depth[at];
            }
        }
        taken += best[0] > 0;
        for (int c = 0; c < 3; c++)
            assert_float_equal(own.rgb[3 * i + c], edge ? sum[c] : plain.rgb[3 * i + c], 1e-6);
        assert_float_equal(own.opacity[i], edge ? sum[3] : plain.opacity[i], 1e-6);
        assert_float_equal(own.depth[i], best[1], 1e-6);
        assert_true(own.depth[i] > 0 || own.opacity[i] == 0);
        assert_true(blocks.depth[i] == own.depth[i]);
        assert_memory_equal(blocks.rgb + 3 * i, own.rgb + 3 * i, 3 * sizeof *own.rgb);
        assert_true(blocks.opacity[i] == own.opacity[i]);
    }
    cln_antialias_free(&edges);
    cln_picture_free(&own);
    cln_picture_free(&blocks);
    cln_picture_free(&plain);
    cln_picture_free(&fine);
    return taken;
}

/* Pixels at edges have the mean of n x n rays, and the centre's depth; where that ray meets nothing
 * and others do, the depth of the most opaque one. */
static void test_antialias(void **state)
{
    cln_crop part = {.on = true, .box = {-0.5, -0.5, -0.5, 0.3, 0.6, 0.7}};
    int taken = 0;

    NEED_DEVICE();
    assert_int_equal(check_antialias(), 0); /* the fixture's field is nowhere empty */
    shown = &part;
    taken = check_antialias();
    shown = NULL;
    print_message("depths of another ray than the centre's: %d\n", taken);
    assert_true(taken > 0);
}

/* Edges of a picture, each by one of what makes one: a step of colour, of opacity, of depth; and
 * none of a smaller step, nor of depth where there is hardly anything. */
static void test_edges_alone(void **state)
{
    enum { ACROSS = 8, MIDDLE = 4 };
    static const struct {
        float colour, opacity, depth; /* of the right half; the left: 0.5, `left`, 3 */
        float left;
        bool edge;
    } cases[] = {
        {0.5f, 1, 3, 1, false},    {0.52f, 1, 3, 1, false},      {0.53f, 1, 3, 1, true},
        {0.5f, 0.97f, 3, 1, true}, {0.5f, 1, 3.1f, 1, false},    {0.5f, 1, 3.2f, 1, true},
        {0.5f, 1, 2.8f, 1, true},  {0.5f, 0.4f, 9, 0.4f, false},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        float rgb[3 * ACROSS * ACROSS], opacity[ACROSS * ACROSS], depth[ACROSS * ACROSS];
        const cln_picture picture = {
            .width = ACROSS, .height = ACROSS, .rgb = rgb, .opacity = opacity, .depth = depth};
        cln_antialias edges;

        for (int k = 0; k < ACROSS * ACROSS; k++) {
            const bool right = k % ACROSS >= MIDDLE;

            rgb[3 * k] = rgb[3 * k + 1] = 0.5f;
            rgb[3 * k + 2] = right ? cases[i].colour : 0.5f;
            opacity[k] = right ? cases[i].opacity : cases[i].left;
            depth[k] = right ? cases[i].depth : 3;
        }
        assert_int_equal(cln_antialias_find(&picture, 2, 1024, &edges), CLN_OK);
        if (edges.count != (cases[i].edge ? 2 * ACROSS : 0))
            fail_msg("case %zu: %d pixels at edges", i, edges.count);
        for (int k = 0; k < edges.count; k++)
            assert_true(edges.pixels[k] % ACROSS == MIDDLE - 1 ||
                        edges.pixels[k] % ACROSS == MIDDLE);
        cln_antialias_free(&edges);
    }
}

/* A pixel that differs from all around it: these are at an edge, too, on all sides. */
static void test_edges_around(void **state)
{
    enum { ACROSS = 5 };
    float rgb[3 * ACROSS * ACROSS] = {0}, opacity[ACROSS * ACROSS], depth[ACROSS * ACROSS];
    const cln_picture picture = {
        .width = ACROSS, .height = ACROSS, .rgb = rgb, .opacity = opacity, .depth = depth};
    cln_antialias edges;

    (void)state;
    for (int k = 0; k < ACROSS * ACROSS; k++)
        opacity[k] = depth[k] = 1;
    rgb[3 * (2 * ACROSS + 2)] = 1;
    assert_int_equal(cln_antialias_find(&picture, 2, 1024, &edges), CLN_OK);
    assert_int_equal(edges.count, 9);
    for (int k = 0; k < 9; k++)
        assert_int_equal(edges.pixels[k], (1 + k / 3) * ACROSS + 1 + k % 3);
    cln_antialias_free(&edges);
}

/* Does the scene's ray pass through the box, made larger by `margin`? */
static bool meets(const double box[6], double margin, const double o[3], const double d[3])
{
    double enter = 0, leave = INFINITY;

    for (int a = 0; a < 3; a++) {
        const double t = (box[a] - margin - o[a]) / d[a], u = (box[3 + a] + margin - o[a]) / d[a];

        enter = fmax(enter, fmin(t, u));
        leave = fmin(leave, fmax(t, u));
    }
    return enter < leave;
}

/* Everything that a cropped picture shows is in the box; a box around everything changes
 * nothing. */
static void test_crop(void **state)
{
    static const double part[6] = {-0.2, -0.9, -0.3, 0.9, 0.3, 0.5},
                        all[6] = {-50, -50, -50, 50, 50, 50};
    cln_picture plain, whole, own;
    cln_space space;
    cln_camera camera;
    int seen = 0, gone = 0;

    (void)state;
    NEED_DEVICE();
    render(NULL, &plain);
    render_crop(all, &whole, &space, &camera);
    render_crop(part, &own, &space, &camera);
    for (int i = 0; i < plain.width * plain.height; i++) {
        double o[3], d[3];

        assert_float_equal(whole.opacity[i], plain.opacity[i], 1e-4);
        for (int c = 0; c < 3; c++)
            assert_float_equal(whole.rgb[3 * i + c], plain.rgb[3 * i + c], 1e-4);
        cln_camera_ray(&camera, i % own.width + 0.5, i / own.width + 0.5, o, d);
        if (!meets(part, 1e-5, o, d)) {
            assert_true(own.opacity[i] == 0);
            gone += plain.opacity[i] > 0.5f;
        }
        if (own.opacity[i] > 0) {
            const double depth = cln_space_distance_to_scene(&space, (double)own.depth[i]);

            for (int a = 0; a < 3; a++) {
                const double at = o[a] + depth * d[a];

                assert_true(at > part[a] - 1e-4 && at < part[3 + a] + 1e-4);
            }
            seen += own.opacity[i] > 0.5f;
        }
    }
    print_message("cropped: %d pixels are left, %d are gone\n", seen, gone);
    assert_true(seen > 10 && gone > 10);
    cln_picture_free(&plain);
    cln_picture_free(&whole);
    cln_picture_free(&own);
}

/* Who follows a picture renders the same batches without its arrays, and keeps those of batches. */
static void test_follow(void **state)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_rendering leads = {0}, follows = {0};
    const cln_pixel *kept = NULL;
    cln_open_run v;
    int total = 0, batches = 0;

    (void)state;
    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_render_prepare(&v.pipeline));
    assert_ok(cln_rendering_begin(&v.pipeline, 0, v.scene->background, 0, &leads));
    total = leads.picture.width * leads.picture.height;
    leads.most = leads.next = total / 3;
    for (; leads.done < total; batches++) {
        const int first = leads.done;

        assert_ok(cln_rendering_follow(&v.pipeline, 0, v.scene->background, &follows));
        follows.done = leads.done;
        follows.next = leads.next;
        assert_ok(cln_rendering_step(&v.pipeline, &leads));
        assert_ok(cln_rendering_step(&v.pipeline, &follows));
        assert_int_equal(follows.done, leads.done);
        assert_memory_equal(follows.results, leads.results,
                            (size_t)(leads.done - first) * sizeof *leads.results);
        assert_null(follows.picture.rgb);
        assert_true(batches == 0 || follows.pixels == kept);
        kept = follows.pixels;
    }
    assert_true(batches >= 3);
    cln_rendering_end(&leads);
    cln_rendering_end(&follows);
    cln_open_run_close(&v);
}

/* The viewer's picture as PNG has these colours. */
static void check_painting(cln_painter *painter, const cln_ask *ask, bool finer,
                           const cln_picture *wanted)
{
    cln_painting g = {.ask = *ask};
    uint8_t *got = NULL;
    int width = 0, height = 0, channels = 0;

    while (g.status == 0) {
        assert_ok(cln_painter_step(painter, &g));
        assert_int_equal(painter->pipeline->antialias, 3); /* as it was */
    }
    assert_int_equal(g.status, 200);
    assert_int_equal(g.finer, finer);
    assert_ok(cln_image_decode("picture", g.body, g.bytes, &width, &height, &channels, &got));
    assert_int_equal(width, wanted->width);
    assert_int_equal(height, wanted->height);
    for (int i = 0; i < width * height * channels; i++)
        assert_int_equal(got[i], ask->show == CLN_SHOW_COLOUR
                                     ? cln_to_u8(wanted->rgb[i])
                                     : cln_to_u8(wanted->opacity[i / channels]));
    free(got);
    cln_painting_free(&g);
}

/* Of a model that learnt pixels at edges as means, the viewer has one ray a pixel first, and then,
 * where that shows, the means. */
static void test_viewer_edges(void **state)
{
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_picture plain, means;
    cln_open_run v;
    cln_painter painter = {.pipeline = &v.pipeline, .model = &v.model};
    cln_ask ask = {.kind = CLN_ASK_PICTURE, .view = -1, .png = true};
    int *views = NULL, count = 0;

    (void)state;
    NEED_DEVICE();
    render_fine(NULL, 1, 1, 0, &plain);
    render_fine(NULL, 2, 1, 0, &means);
    assert_memory_not_equal(plain.rgb, means.rgb,
                            3 * sizeof(float) * (size_t)(plain.width * plain.height));
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    v.model.config.antialias = 2;
    assert_ok(cln_open_run_start(&v, &device, false));
    v.pipeline.antialias = 3;
    painter.scene = v.scene;
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    ask.camera = v.scene->views[views[0]].camera;
    free(views);
    memcpy(ask.background, v.scene->background, sizeof ask.background);
    assert_ok(cln_painter_open(&painter, &ask.camera));
    for (int averaged = 0; averaged < 2; averaged++) {
        v.model.averaged = averaged;
        for (int show = 0; show < 2; show++) {
            ask.show = show ? CLN_SHOW_OPACITY : CLN_SHOW_COLOUR;
            ask.edges = false;
            check_painting(&painter, &ask, averaged, &plain);
            ask.edges = true;
            check_painting(&painter, &ask, false, averaged ? &means : &plain);
        }
    }
    cln_picture_free(&plain);
    cln_picture_free(&means);
    cln_open_run_close(&v);
}

/* The viewer's picture of a view, [height][width][channels]; the caller frees it. */
static uint8_t *paint(cln_painter *painter, const cln_ask *ask, int *width, int *height,
                      int *channels)
{
    cln_painting g = {.ask = *ask};
    uint8_t *got = NULL;

    while (g.status == 0)
        assert_ok(cln_painter_step(painter, &g));
    assert_int_equal(g.status, 200);
    assert_ok(cln_image_decode("picture", g.body, g.bytes, width, height, channels, &got));
    assert_true(g.width == *width && g.height == *height);
    cln_painting_free(&g);
    return got;
}

/* Pictures of a view whose photo people see turned are turned with it, and are else the same. */
static void test_viewer_turns(void **state)
{
    static const int orientations[] = {1, 3, 6, 8};
    const bool pixels[CLN_SPLITS] = {false};
    const cln_device_desc device = fixture_device();
    cln_open_run v;
    cln_painter painter = {.pipeline = &v.pipeline, .model = &v.model};
    cln_ask ask = {.kind = CLN_ASK_PICTURE, .view = 0, .png = true};
    cln_view *view = NULL;

    (void)state;
    NEED_DEVICE();
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    painter.scene = v.scene;
    view = &v.scene->views[0];
    view->camera.height = view->camera.height / 4 * 3;
    ask.camera = view->camera;
    assert_ok(cln_painter_open(&painter, &ask.camera));
    for (int show = CLN_SHOW_COLOUR; show <= CLN_SHOW_DEPTH; show++) {
        uint8_t *stored = NULL;

        ask.show = (cln_show)show;
        for (size_t i = 0; i < sizeof orientations / sizeof *orientations; i++) {
            int width = 0, height = 0, channels = 0;
            uint8_t *got = NULL;

            view->orientation = orientations[i];
            got = paint(&painter, &ask, &width, &height, &channels);
            if (i == 0) {
                stored = got;
                continue;
            }
            for (int k = 0; k < width * height; k++) {
                const int x = k % width, y = k / width, wide = ask.camera.width;
                const int high = ask.camera.height, o = orientations[i];
                const int from = o == 3   ? (high - 1 - y) * wide + wide - 1 - x
                                 : o == 6 ? (high - 1 - x) * wide + y
                                          : x * wide + wide - 1 - y;

                assert_memory_equal(got + channels * k, stored + channels * from, channels);
            }
            assert_true(width == (orientations[i] == 3 ? ask.camera.width : ask.camera.height));
            free(got);
        }
        free(stored);
    }
    cln_open_run_close(&v);
}

static void count_warnings(cln_log_level level, const char *line, void *user)
{
    *(int *)user += level == CLN_LOG_WARN && strstr(line, "r_0") && strstr(line, "no SSIM");
}

/* A photo whose mask keeps no whole window has no SSIM: it is left out of the mean, and the rest is
 * measured. */
static void test_no_window(void **state)
{
    const bool pixels[CLN_SPLITS] = {[CLN_SPLIT_TEST] = true};
    const cln_device_desc device = fixture_device();
    uint8_t spots[(SIDE * SIDE + 7) / 8], whole[(SIDE * SIDE + 7) / 8];
    cln_eval_result result = {0};
    cln_open_run v;
    json_t *document = NULL;
    double other = 0;
    int *views = NULL, count = 0, warnings = 0;

    NEED_DEVICE();
    memset(whole, 0xff, sizeof whole);
    memset(spots, 0x7f, sizeof spots); /* every eighth column is left out */
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 0, &views, &count));
    assert_int_equal(count, 2);
    for (int pass = 0; pass < 3; pass++) {
        v.scene->views[views[0]].kept = pass == 0 ? whole : spots;
        v.scene->views[views[1]].kept = pass == 2 ? spots : whole;
        warnings = 0;
        cln_log_to(CLN_LOG_INFO, count_warnings, &warnings);
        assert_ok(cln_quality_check(v.scene, views, count));
        cln_log_to(CLN_LOG_INFO, NULL, NULL);
        assert_int_equal(warnings, pass > 0);
        assert_ok(cln_quality_measure(&v.pipeline, NULL, v.scene, views, count, NULL, NULL, NULL,
                                      &result));
        assert_true(isfinite(result.images[0].psnr) && isfinite(result.psnr));
        assert_ok(cln_quality_json(&result, &document));
        if (pass == 0) {
            other = result.images[1].ssim;
            assert_true(isfinite(result.images[0].ssim) && isfinite(other));
        } else {
            json_t *image = json_array_get(fixture_at(document, "images"), 0);

            assert_true(isnan(result.images[0].ssim));
            assert_true(json_is_null(fixture_at(image, "ssim")));
            assert_true(json_is_real(fixture_at(document, "std.psnr")));
        }
        if (pass == 1) {
            assert_true(result.ssim == other);
            assert_true(json_real_value(fixture_at(document, "std.ssim")) == 0);
        }
        if (pass == 2) {
            assert_true(json_is_null(fixture_at(document, "mean.ssim")));
            assert_true(json_is_null(fixture_at(document, "std.ssim")));
        }
        json_decref(document);
        cln_eval_free(&result);
    }
    v.scene->views[views[0]].kept = v.scene->views[views[1]].kept = NULL;
    cln_open_run_close(&v);
    free(views);
}

/* The picture NAME.ENDING of the first view in `folder`; the caller frees it. */
static uint8_t *read_eval(const char *folder, const cln_view *view, const char *ending)
{
    char path[4096];
    int width = 0, height = 0, channels = 0;
    uint8_t *pixels = NULL;

    snprintf(path, sizeof path, "%s/%s%s", folder, view->file, ending);
    assert_ok(cln_image_load(path, &width, &height, &channels, &pixels));
    assert_int_equal(width, SIDE);
    assert_int_equal(height, SIDE);
    assert_int_equal(channels, 3);
    return pixels;
}

/* What a mask hides is not in pictures of the truth, nor as an error. */
static void test_left_out(void **state)
{
    const bool pixels[CLN_SPLITS] = {[CLN_SPLIT_TEST] = true};
    const cln_device_desc device = fixture_device();
    const char *folder = fixture_path("left-out");
    uint8_t spots[(SIDE * SIDE + 7) / 8], *truth = NULL, *error = NULL, *render = NULL;
    cln_eval_result result = {0};
    cln_open_run v;
    const cln_view *view = NULL;
    int *views = NULL, count = 0, hidden = 0;

    NEED_DEVICE();
    memset(spots, 0x7f, sizeof spots); /* every eighth column is left out */
    assert_int_equal(mkdir(folder, 0777), 0);
    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    view = &v.scene->views[views[0]];
    v.scene->views[views[0]].kept = spots;
    assert_ok(
        cln_quality_measure(&v.pipeline, NULL, v.scene, views, count, folder, NULL, NULL, &result));
    truth = read_eval(folder, view, ".truth.png");
    error = read_eval(folder, view, ".error.png");
    render = read_eval(folder, view, ".png");
    for (int i = 0; i < SIDE * SIDE; i++) {
        float rgb[3], alpha = 0;

        cln_view_pixel(view, i % SIDE, i / SIDE, v.scene->background, rgb, &alpha);
        for (int c = 0; c < 3; c++) {
            const int at = 3 * i + c, photo = (int)lrintf(255 * rgb[c]);

            if (i % 8 == 7) {
                assert_in_range(truth[at], 127, 128);
                assert_int_equal(error[at], 0);
                hidden += abs(photo - 128) > 20 && render[at] != truth[at];
            } else {
                assert_int_equal(truth[at], photo);
                assert_true(abs(error[at] - 4 * abs(render[at] - photo)) <= 3 || error[at] == 255);
            }
        }
    }
    assert_true(hidden > SIDE); /* there was something to hide, which is rendered */
    v.scene->views[views[0]].kept = NULL;
    free(truth);
    free(error);
    free(render);
    cln_eval_free(&result);
    cln_open_run_close(&v);
    free(views);
}

/* Whether a render is empty, and a photo of one colour, is told by pixels that count: those of the
 * first test view are kept by their opacity, from `least` to `most`, or where the photo has
 * none. */
static cln_eval_image measure_kept(const cln_picture *picture, bool air, float least, float most)
{
    const bool pixels[CLN_SPLITS] = {[CLN_SPLIT_TEST] = true};
    const cln_device_desc device = fixture_device();
    uint8_t kept[(SIDE * SIDE + 7) / 8] = {0};
    cln_eval_result result = {0};
    cln_eval_image image;
    cln_open_run v;
    int *views = NULL, count = 0, left = 0;

    assert_ok(cln_open_run_open(fixture_path("whole"), NULL, pixels, NULL, &v));
    assert_ok(cln_open_run_start(&v, &device, false));
    assert_ok(cln_pipeline_scene(&v.pipeline, v.scene, &v.model.space));
    assert_ok(cln_quality_choose(v.scene, CLN_SPLIT_TEST, 1, &views, &count));
    for (int i = 0; i < SIDE * SIDE; i++) {
        float rgb[3], alpha = 0;

        cln_view_pixel(&v.scene->views[views[0]], i % SIDE, i / SIDE, v.scene->background, rgb,
                       &alpha);
        if (picture->opacity[i] >= least && picture->opacity[i] <= most && (!air || alpha == 0)) {
            kept[i / 8] |= (uint8_t)(1 << i % 8);
            left++;
        }
    }
    assert_in_range(left, 1, SIDE * SIDE);
    v.scene->views[views[0]].kept = kept;
    assert_ok(cln_quality_measure(&v.pipeline, NULL, v.scene, views, 1, NULL, NULL, NULL, &result));
    v.scene->views[views[0]].kept = NULL;
    image = result.images[0];
    cln_eval_free(&result);
    cln_open_run_close(&v);
    free(views);
    return image;
}

static void test_what_is_kept_tells(void **state)
{
    cln_eval_image image;
    cln_picture picture;

    (void)state;
    NEED_DEVICE();
    render(NULL, &picture);
    image = measure_kept(&picture, false, 0, 0.24f);
    assert_true(image.empty);
    image = measure_kept(&picture, false, 0, 0.85f);
    assert_false(image.empty);
    assert_true(isfinite(image.psnr_fitted));
    image = measure_kept(&picture, true, 0, 1);
    assert_true(isnan(image.psnr_fitted)); /* the background alone */
    cln_picture_free(&picture);
}

int test_group_pictures(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_agree_with_dense_sampling),
        cmocka_unit_test_teardown(test_voxels_agree_with_dense_sampling, show_all_of_whole),
        cmocka_unit_test(test_follow),
        cmocka_unit_test(test_squares),
        cmocka_unit_test(test_no_window),
        cmocka_unit_test(test_what_is_kept_tells),
        cmocka_unit_test(test_left_out),
        cmocka_unit_test(test_keeps_to_the_plan),
        cmocka_unit_test(test_wide),
        cmocka_unit_test_teardown(test_antialias, show_all_of_whole),
        cmocka_unit_test(test_edges_alone),
        cmocka_unit_test(test_edges_around),
        cmocka_unit_test(test_viewer_edges),
        cmocka_unit_test(test_viewer_turns),
        cmocka_unit_test(test_fast),
        cmocka_unit_test(test_crop)};

    return cmocka_run_group_tests_name("pictures", tests, fixture_setup, fixture_teardown);
}
