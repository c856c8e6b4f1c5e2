/* What a viewer renders (view/painter.h), of a trained ball: the point at a pixel against the
 * picture's, the depth scale of films, better pictures at edges, the speed that it learns, memory
 * that runs out. */
#include "unit.h"
#include <unistd.h>
#include "near.h"
#include "render/open_run.h"
#include "run_fixture.h"
#include "tests.h"
#include "view/painter.h"

enum { WIDTH = 40, HEIGHT = 30 };

/* The solid ball's run, with a painter that nothing was asked of yet. */
typedef struct viewer {
    cln_open_run run;
    cln_painter painter;
} viewer;

static void open_viewer(viewer *v)
{
    const cln_device_desc device = fixture_device();
    const cln_callbacks none = {0};
    cln_config config = fixture_voxels();
    cln_train_result trained;
    bool alike = false;

    config.steps = 200;
    if (!cln_is_dir(fixture_path("solid")))
        assert_ok(fixture_train("solid", false, &config, NULL, &trained));
    memset(v, 0, sizeof *v);
    assert_ok(cln_open_run_cameras(fixture_path("solid"), NULL, &none, &alike, &v->run));
    assert_ok(cln_open_run_start(&v->run, &device, 0));
    assert_ok(cln_render_prepare(&v->run.pipeline));
    v->painter = (cln_painter){.pipeline = &v->run.pipeline,
                               .model = &v->run.model,
                               .scene = v->run.scene,
                               .seconds_per_pixel = 1};
}

static void close_viewer(viewer *v)
{
    cln_reel_drop(&v->painter.reel);
    cln_open_run_close(&v->run);
}

/* So many radii from the ball's middle, which it looks at; the ball is not in the picture's. */
static cln_ask ask_of(cln_ask_kind kind, double away)
{
    cln_ask ask = {.kind = kind, .view = -1, .background = {1, 1, 1}};
    double m[3][4];

    fixture_pose(0.3, 0.2, m);
    ask.camera = (cln_camera){
        .width = WIDTH, .height = HEIGHT, .fx = 50, .fy = 50, .cx = WIDTH / 2.0, .cy = 13};
    for (int a = 0; a < 3; a++) { /* from OpenGL's axes */
        ask.camera.c2w[4 * a] = m[a][0];
        ask.camera.c2w[4 * a + 1] = -m[a][1];
        ask.camera.c2w[4 * a + 2] = -m[a][2];
        ask.camera.c2w[4 * a + 3] = m[a][3] * away / 4;
    }
    return ask;
}

/* The caller frees the painting. */
static cln_painting paint(viewer *v, const cln_ask *ask)
{
    cln_painting g = {.ask = *ask};

    while (g.status == 0)
        assert_ok(cln_painter_step(&v->painter, &g));
    if (g.status != 200)
        fail_msg("%d: %.*s", g.status, (int)g.bytes, (const char *)g.body);
    return g;
}

/* The point at a position has the depth of the picture's pixel there, by the ray of its middle. */
static void points_are_of_their_pixel(void **state)
{
    static const double places[][2] = {{17.2, 9.9}, {20, 13}, {24.99, 19}, {15, 6.5}};
    const cln_ask whole = ask_of(CLN_ASK_PICTURE, 4);
    const cln_camera *pointer = &whole.camera;
    cln_picture picture = {0};
    viewer v;

    NEED_DEVICE();
    open_viewer(&v);
    assert_ok(cln_pipeline_cameras(&v.run.pipeline, &pointer, 1, &v.run.model.space));
    v.run.pipeline.antialias = 1;
    assert_ok(
        cln_render_view(&v.run.pipeline, 0, whole.background, CLN_DEPTH_MEDIAN, NULL, &picture));
    cln_picture_to_scene(&v.run.model.space, &picture);
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        const int x = (int)places[i][0], y = (int)places[i][1];
        const double depth = (double)picture.depth[y * WIDTH + x];
        cln_ask ask = ask_of(CLN_ASK_POINT, 4);
        double o[3], d[3];
        cln_painting g;
        json_t *told = NULL;

        ask.x = places[i][0];
        ask.y = places[i][1];
        g = paint(&v, &ask);
        told = json_loadb((const char *)g.body, g.bytes, 0, NULL);
        assert_non_null(told);
        assert_true(cln_camera_ray(&whole.camera, x + 0.5, y + 0.5, o, d));
        assert_near(json_number_value(fixture_at(told, "depth")), depth, 1e-5);
        for (int a = 0; a < 3; a++)
            assert_near(json_number_value(json_array_get(fixture_at(told, "point"), (size_t)a)),
                        o[a] + depth * d[a], 1e-5);
        json_decref(told);
        cln_painting_free(&g);
    }
    cln_picture_free(&picture);
    close_viewer(&v);
}

/* A picture by single rays tells that it would be better by several at edges, where the model
 * learnt these and colours mix; with `edges` it has them. */
static void edges_can_be_finer(void **state)
{
    cln_ask ask = ask_of(CLN_ASK_PICTURE, 4);
    viewer v;

    NEED_DEVICE();
    open_viewer(&v);
    for (int i = 0; i < 8; i++) {
        const bool averaged = i & 1, edges = i & 2, depth = i & 4;
        cln_painting g;

        v.run.model.averaged = averaged;
        v.run.model.config.antialias = 2;
        ask.edges = edges;
        ask.show = depth ? CLN_SHOW_DEPTH : CLN_SHOW_COLOUR;
        g = paint(&v, &ask);
        assert_int_equal(g.finer, averaged && !edges && !depth);
        cln_painting_free(&g);
    }
    close_viewer(&v);
}

/* The speed is the mean of the old one and the new; pictures of better edges do not tell it. */
static void speeds_are_averaged(void **state)
{
    cln_ask ask = ask_of(CLN_ASK_PICTURE, 4);
    viewer v;
    cln_painting g;

    NEED_DEVICE();
    open_viewer(&v);
    v.painter.seconds_per_pixel = 1e3;
    g = paint(&v, &ask);
    assert_near(v.painter.seconds_per_pixel, 0.5 * (1e3 + g.seconds / (WIDTH * HEIGHT)), 1e-9);
    cln_painting_free(&g);
    v.painter.seconds_per_pixel = 1e3;
    ask.edges = true;
    g = paint(&v, &ask);
    assert_true(v.painter.seconds_per_pixel == 1e3);
    cln_painting_free(&g);
    close_viewer(&v);
}

/* Without memory for a picture, that is its answer; where other ranks may be in the middle of its
 * batch, it is the end. */
static void memory_runs_out(void **state)
{
    const cln_ask ask = ask_of(CLN_ASK_PICTURE, 4);
    const cln_camera *pointer = &ask.camera;
    viewer v;

    NEED_DEVICE();
    open_viewer(&v);
    assert_ok(cln_pipeline_cameras(&v.run.pipeline, &pointer, 1, &v.run.model.space));
    v.run.device->limit = 1;
    for (int leads = 0; leads < 2; leads++) {
        cln_painting g = {.ask = ask};

        v.painter.leads = leads;
        assert_int_equal(cln_painter_step(&v.painter, &g), leads ? CLN_MEMORY : CLN_OK);
        assert_int_equal(g.status, leads ? 0 : 503);
        assert_true(g.rendering.under_way);
        cln_clear_error();
        cln_painting_free(&g);
    }
    close_viewer(&v);
}

/* ---- films ---- */

static char *own_path, *own_tmpdir;

/* Without ffmpeg, so that films are y4m. */
static int hide_ffmpeg(void **state)
{
    (void)state;
    own_path = strdup(getenv("PATH"));
    own_tmpdir = getenv("TMPDIR") ? strdup(getenv("TMPDIR")) : NULL;
    return setenv("TMPDIR", fixture_folder, 1) || setenv("PATH", fixture_folder, 1);
}

static int show_ffmpeg(void **state)
{
    (void)state;
    setenv("PATH", own_path, 1);
    if (own_tmpdir)
        setenv("TMPDIR", own_tmpdir, 1);
    else
        unsetenv("TMPDIR");
    free(own_path);
    free(own_tmpdir);
    return 0;
}

/* All frames of a film of depth have the first one's scale: the ball grows darker as it goes away;
 * by scales of their own each would be as bright. */
static void films_do_not_flicker(void **state)
{
    enum { FRAMES = 3, FRAME = 6 + WIDTH * HEIGHT * 3 }; /* FRAME\n and three planes */
    static const double away[FRAMES] = {3, 3.3, 3.6};
    cln_ask ask = {
        .kind = CLN_ASK_FILM_BEGIN, .width = WIDTH, .height = HEIGHT, .frames = FRAMES, .fps = 24};
    uint8_t *film = NULL;
    int brightest[FRAMES] = {0};
    char name[CLN_FILM_NAME];
    float low = 0, high = 0;
    viewer v;
    cln_painting g;

    NEED_DEVICE();
    open_viewer(&v);
    g = paint(&v, &ask);
    cln_painting_free(&g);
    memcpy(name, v.painter.reel.name, sizeof name);
    for (int i = 0; i < FRAMES; i++) {
        ask = ask_of(CLN_ASK_FILM_FRAME, away[i]);
        ask.show = CLN_SHOW_DEPTH;
        memcpy(ask.film, name, sizeof name);
        g = paint(&v, &ask);
        assert_true((g.far > g.near && g.near > 0) == (i == 0)); /* its own scale */
        cln_painting_free(&g);
        if (i == 0) {
            low = v.painter.reel.low;
            high = v.painter.reel.high;
        }
        assert_true(v.painter.reel.low == low && v.painter.reel.high == high && low > 0);
    }
    ask.kind = CLN_ASK_FILM_END;
    g = paint(&v, &ask);
    cln_painting_free(&g);
    assert_true(v.painter.reel.whole && v.painter.reel.bytes > FRAMES * FRAME);
    film = malloc(FRAMES * FRAME);
    assert_non_null(film);
    assert_int_equal(
        pread(v.painter.reel.file, film, FRAMES * FRAME, v.painter.reel.bytes - FRAMES * FRAME),
        FRAMES * FRAME);
    for (int i = 0; i < FRAMES; i++) {
        assert_memory_equal(film + i * FRAME, "FRAME\n", 6);
        for (int k = 0; k < WIDTH * HEIGHT; k++)
            if (film[i * FRAME + 6 + k] > brightest[i])
                brightest[i] = film[i * FRAME + 6 + k];
    }
    print_message("    brightest %d, %d, %d\n", brightest[0], brightest[1], brightest[2]);
    assert_true(brightest[0] > brightest[1] + 20 && brightest[1] > brightest[2]);
    free(film);
    close_viewer(&v);
}

int test_group_painter_pictures(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_of_their_pixel),
        cmocka_unit_test(edges_can_be_finer),
        cmocka_unit_test(speeds_are_averaged),
        cmocka_unit_test(memory_runs_out),
        cmocka_unit_test_setup_teardown(films_do_not_flicker, hide_ffmpeg, show_ffmpeg),
    };

    return cmocka_run_group_tests_name("painter_pictures", tests, fixture_setup, fixture_teardown);
}
