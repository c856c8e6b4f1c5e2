/* Signs of mistakes in poses and lenses: each planted fault gives a number beyond its bound and one
 * warning, good captures of all kinds give none. Cameras are set by hand. The bounds were measured
 * on photos of many kinds: cameras around something have an apart_share of 0, in a room 0.25, in
 * flights over flat land up to 0.6, and 1 where cameras around something are turned. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "scene/build.h"
#include "scene_fixture.h"
#include "tests.h"

enum { CAMERAS = 24 };

static char folder[] = "scene", rule[] = "a test's";

typedef struct capture {
    cln_scene scene;
    cln_view views[CAMERAS];
    cln_reader_result result;
} capture;

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

static void unit(double v[3])
{
    const double length = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);

    for (int i = 0; i < 3; i++)
        v[i] /= length;
}

static void start(capture *c, double half)
{
    memset(c, 0, sizeof *c);
    c->scene.folder = folder;
    c->scene.bounds_rule = rule;
    c->scene.views = c->views;
    c->scene.space.half = half;
}

static void add_camera(capture *c, const double at[3], const double towards[3])
{
    cln_camera *camera = &c->views[c->scene.view_count++].camera;
    double z[3] = {towards[0], towards[1], towards[2]}, x[3], y[3];
    const double up[3] = {0, 0.1, 1};

    unit(z);
    cross(z, up, x);
    unit(x);
    cross(z, x, y);
    for (int i = 0; i < 3; i++) {
        camera->c2w[4 * i] = x[i];
        camera->c2w[4 * i + 1] = y[i];
        camera->c2w[4 * i + 2] = z[i];
        camera->c2w[4 * i + 3] = at[i];
    }
    camera->width = camera->height = 16;
    camera->fx = camera->fy = 20;
    camera->cx = camera->cy = 8;
}

/* In -1..1. */
static double noise(int i, int draw)
{
    return 2 * (double)cln_uniform_hash(7, 1, 0, (uint32_t)i, 0, (uint32_t)draw) - 1;
}

/* Around the origin, at `distance`, over so many degrees. */
static void around(capture *c, double half, double distance, double degrees)
{
    start(c, half);
    for (int i = 0; i < CAMERAS; i++) {
        const double turn = degrees / 57.29577951308232 * i / CAMERAS;
        const double at[3] = {distance * cos(turn), distance * sin(turn), distance * 0.3};
        const double towards[3] = {-at[0] + 0.02 * distance * noise(i, 0), -at[1], -at[2]};

        add_camera(c, at, towards);
    }
}

/* Poses as of a reader that takes OpenCV's axes for OpenGL's. */
static void turn_axes(capture *c)
{
    for (int v = 0; v < c->scene.view_count; v++)
        for (int i = 0; i < 3; i++) {
            c->views[v].camera.c2w[4 * i + 1] *= -1;
            c->views[v].camera.c2w[4 * i + 2] *= -1;
        }
}

static int warnings(capture *c)
{
    int count = 0;

    cln_scene_find_doubts(&c->scene, &c->result);
    cln_log_set_sink(scratch_count_warnings, &count);
    cln_scene_warn_doubts(&c->scene);
    cln_log_set_sink(NULL, NULL);
    return count;
}

static void test_sound_captures(void **state)
{
    capture c;

    (void)state;
    around(&c, 1.5, 4, 360);
    assert_int_equal(warnings(&c), 0);
    assert_true(c.scene.apart_share == 0 && c.scene.cube_share > 0.6);
    around(&c, 1.5, 4, 60);
    assert_int_equal(warnings(&c), 0);
    start(&c, 1.5); /* a room: everywhere, in all directions */
    for (int i = 0; i < CAMERAS; i++)
        add_camera(&c, (const double[3]){noise(i, 1), noise(i, 2), 0.2 * noise(i, 3)},
                   (const double[3]){noise(i, 4), noise(i, 5), 0.3 * noise(i, 6)});
    assert_int_equal(warnings(&c), 0);
    assert_true(c.scene.apart_share > 0 && c.scene.apart_share < 0.6);
    start(&c, 40); /* a flight: down, a little to all sides */
    for (int i = 0; i < CAMERAS; i++)
        add_camera(&c, (const double[3]){10 * (i % 6), 10 * (i / 6), 30},
                   (const double[3]){0.2 * noise(i, 7), 0.2 * noise(i, 8), -1});
    assert_int_equal(warnings(&c), 0);
    start(&c, 4); /* in parallel: nothing to tell by */
    for (int i = 0; i < CAMERAS; i++)
        add_camera(&c, (const double[3]){0.1 * i, 0, -3}, (const double[3]){0, 0.01, 1});
    assert_int_equal(warnings(&c), 0);
    assert_true(isnan(c.scene.apart_share));
    start(&c, 1.5); /* one camera alone has no spread, but is too few */
    for (int i = 0; i < 3; i++) {
        add_camera(&c, (const double[3]){0.1 * i, -4, 0}, (const double[3]){0, 1, 0});
        assert_int_equal(warnings(&c), i < 2);
    }
    start(&c, 1.5);
    add_camera(&c, (const double[3]){0, -4, 0}, (const double[3]){0, 1, 0});
    c.scene.space.half = 50; /* the cube fills a quarter of its image */
    for (int a = 0; a < 3; a++)
        c.scene.space.centre[a] = a == 1 ? 60 : 50;
    cln_scene_find_doubts(&c.scene, NULL);
    assert_true(c.scene.cube_share == 0.25);
}

/* Which cameras stand amid what they see: those within the points, and those that look one way and
 * move further than it is away, or along a path; not those around a thing, or before it. */
static void test_amid(void **state)
{
    static const struct {
        const char *name;
        double step[3], towards[3], turn; /* of the cameras; turn: how far to all sides */
        double low[3], high[3];           /* of the points */
        bool amid, alone, path;           /* with points, and without */
    } cases[] = {
        {"tunnel", {0, 0, 1}, {0, 0, 1}, 0.1, {-1, -1, 0}, {1, 1, 30}, true, true, true},
        {"back", {0, 0, -1}, {0, 0, 1}, 0.1, {-1, -1, -20}, {1, 1, 10}, true, true, true},
        {"flight", {3, 0, 0}, {0, 0, -1}, 0.1, {0, -5, -20}, {70, 5, -19}, true, false, false},
        {"room", {0, 0, 0.1}, {1, 0, 0}, 9, {-3, -3, -3}, {3, 3, 6}, true, false, false},
        {"before a wall", {0.1, 0, 0}, {0, 0, 1}, 0.1, {-3, -3, 8}, {5, 3, 9}, false, false, false},
    };
    capture c;
    cln_point points[64] = {0};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        start(&c, 10);
        for (int k = 0; k < 64; k++)
            for (int a = 0; a < 3; a++)
                points[k].xyz[a] = (cases[i].low[a] + (cases[i].high[a] - cases[i].low[a]) *
                                                          (0.5 + 0.5 * noise(k, a)));
        for (int k = 0; k < CAMERAS; k++) {
            double at[3], towards[3];

            for (int a = 0; a < 3; a++) {
                at[a] = k * cases[i].step[a] + 0.05 * noise(k, 3 + a);
                towards[a] = cases[i].towards[a] + cases[i].turn * noise(k, 6 + a);
            }
            add_camera(&c, at, towards);
        }
        c.result.points = points;
        for (int k = 0; k < 2; k++) {
            c.result.point_count = k ? 0 : 64;
            cln_scene_find_doubts(&c.scene, &c.result);
            if (c.scene.amid != (k ? cases[i].alone : cases[i].amid))
                fail_msg("%s, %d points", cases[i].name, c.result.point_count);
        }
        if (cln_scene_is_path(&c.scene) != cases[i].path)
            fail_msg("%s: a path or none", cases[i].name);
    }
    around(&c, 1.5, 4, 360);
    c.result.points = points; /* of the thing */
    c.result.point_count = 64;
    for (int k = 0; k < 64; k++)
        for (int a = 0; a < 3; a++)
            points[k].xyz[a] = noise(k, a);
    cln_scene_find_doubts(&c.scene, &c.result);
    assert_false(c.scene.amid);
}

static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN)
        snprintf(user, 512, "%s", line);
}

/* A cube by how far the cameras moved may be wrong to both sides, with a shell or without. */
static void a_guess_is_told(void **state)
{
    static const char *const words[] = {"in parallel", "outwards", "outwards"};
    capture c;

    (void)state;
    for (int k = 0; k < 3; k++) {
        char text[512] = "";

        around(&c, 1.5, 4, 360);
        c.scene.cube_guessed = true;
        c.scene.in_parallel = k == 0;
        c.scene.outwards = k > 0;
        c.scene.space.shell = k == 2;
        assert_int_equal(warnings(&c), 1);
        cln_log_set_sink(keep_warning, text);
        cln_scene_warn_doubts(&c.scene);
        cln_log_set_sink(NULL, NULL);
        assert_non_null(strstr(text, words[k]));
        assert_non_null(strstr(text, "far smaller than what the photos show"));
        assert_non_null(strstr(text, "several times as large"));
        assert_non_null(strstr(text, "check` proposes a box"));
        assert_int_equal(strstr(text, "painted") != NULL, k < 2);
    }
}

/* Few photos around an object: what comes of them, and what holds none out. Of more, or of as few
 * from one side, nothing. */
static void few_around_are_told(void **state)
{
    static const struct {
        int count;
        double degrees;
        bool told;
    } cases[] = {{2, 360, true}, {3, 360, true}, {8, 360, true}, {9, 360, false}, {8, 40, false}};
    capture c;

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        for (int held = 0; held < 2; held++) {
            const int step = CAMERAS / cases[i].count;
            char text[512] = "", names[CAMERAS][8];

            around(&c, 1.5, 4, cases[i].degrees);
            for (int v = 0; v <= cases[i].count; v++) {
                c.views[v] = c.views[(v * step) % CAMERAS];
                snprintf(names[v], sizeof names[v], "%d", v);
                c.views[v].name = names[v];
                c.views[v].orientation = c.views[v].alpha_turn = c.views[v].mask_turn = 1;
                c.views[v].masks_known = true;
            }
            c.scene.view_count = cases[i].count + held;
            if (held)
                c.views[cases[i].count].split = CLN_SPLIT_TEST;
            assert_int_equal(warnings(&c), cases[i].told);
            cln_log_set_sink(keep_warning, text);
            cln_scene_warn_doubts(&c.scene);
            cln_log_set_sink(NULL, NULL);
            if (cases[i].told)
                assert_non_null(strstr(text, cases[i].count < 3 ? "at any distance" : "a blend"));
            assert_int_equal(strstr(text, "--holdout 0") != NULL, held && cases[i].told);
        }
    }
}

/* Sparse points decide: before cameras that lean apart, as in a strip over land, nothing is
 * doubted; behind turned ones it is. */
static void test_points(void **state)
{
    enum { COUNT = 200 };
    cln_point points[COUNT];
    capture c;

    (void)state;
    memset(points, 0, sizeof points);
    for (int i = 0; i < COUNT; i++)
        for (int a = 0; a < 3; a++)
            points[i].xyz[a] = (a == 2 ? 0.1 : 20) * noise(i, a);
    for (int turned = 0; turned < 2; turned++) {
        start(&c, 40);
        for (int i = 0; i < CAMERAS; i++)
            add_camera(&c, (const double[3]){i - 0.5 * CAMERAS, 0, 30},
                       (const double[3]){0.06 * (i - 0.5 * CAMERAS), 0, -1});
        if (turned)
            turn_axes(&c);
        assert_int_equal(warnings(&c), !turned); /* without points */
        c.result.points = points;
        c.result.point_count = COUNT;
        assert_int_equal(warnings(&c), 0);
        assert_true(c.scene.before_share == !turned);
    }
    around(&c, 12, 4, 360);
    turn_axes(&c);
    for (int i = 0; i < COUNT; i++)
        for (int a = 0; a < 3; a++)
            points[i].xyz[a] = noise(i, a);
    c.result.points = points;
    c.result.point_count = COUNT;
    assert_int_equal(warnings(&c), 1);
    assert_true(c.scene.before_share == 0);
}

/* A thing that was turned before a camera at a few places; not those of a walk, with some twice. */
static void few_stands_are_told(void **state)
{
    static const struct {
        int places, views, stands;
        double off; /* of every second camera from its place, of 1 between places */
    } cases[] = {{3, 24, 3, 0}, {3, 24, 3, 0.004}, {3, 24, 6, 0.1},
                 {5, 24, 5, 0}, {8, 24, 0, 0}, /* three of each, as exposures */
                 {7, 24, 7, 0}, {24, 24, 0, 0},    {3, 8, 0, 0}};

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        cln_view views[CAMERAS] = {{0}};
        cln_scene scene = {.views = views, .view_count = cases[k].views};

        for (int i = 0; i < cases[k].views; i++) {
            double *m = views[i].camera.c2w;

            m[0] = m[5] = m[10] = 1;
            m[3] = i % cases[k].places;
            m[7] = cases[k].off * (i % 2);
        }
        if (cln_scene_few_stands(&scene) != cases[k].stands)
            fail_msg("case %zu: %d", k, cln_scene_few_stands(&scene));
    }
    {
        cln_view views[CAMERAS] = {{0}}; /* turned about at three places, as panoramas are taken */
        cln_scene scene = {.views = views, .view_count = CAMERAS};

        for (int i = 0; i < CAMERAS; i++) {
            double *m = views[i].camera.c2w, angle = 0.3 * i;

            m[0] = m[10] = cos(angle);
            m[2] = sin(angle);
            m[8] = -sin(angle);
            m[5] = 1;
            m[3] = i % 3;
        }
        assert_int_equal(cln_scene_few_stands(&scene), 0);
    }
}

/* Frames of a film follow each other: along a line, and along a circle. */
static void a_film_has_no_stands(void **state)
{
    enum { FRAMES = 2500 };
    cln_view *views = calloc(FRAMES, sizeof *views);
    cln_scene scene = {.views = views, .view_count = 700};

    (void)state;
    assert_non_null(views);
    for (int i = 0; i < FRAMES; i++) {
        double *m = views[i].camera.c2w;

        m[0] = m[5] = m[10] = 1;
        m[3] = i;
    }
    assert_int_equal(cln_scene_few_stands(&scene), 0);
    scene.view_count = FRAMES;
    for (int i = 0; i < FRAMES; i++) {
        views[i].camera.c2w[3] = cos(2 * M_PI * i / FRAMES);
        views[i].camera.c2w[7] = sin(2 * M_PI * i / FRAMES);
    }
    assert_int_equal(cln_scene_few_stands(&scene), 0);
    free(views);
}

static void test_planted_faults(void **state)
{
    const double degrees[] = {360, 60};
    capture c;

    (void)state;
    for (int i = 0; i < 2; i++) {
        around(&c, 12, 4, degrees[i]); /* the cameras stand in the cube */
        turn_axes(&c);
        assert_int_equal(warnings(&c), 1);
        assert_true(c.scene.apart_share > 0.95 && c.scene.cube_share == 1);
    }
    around(&c, 1.5, 4 * 1000.0, 360);
    assert_int_equal(warnings(&c), 1);
    assert_true(c.scene.cube_share < 0.001);
    around(&c, 1.5, 4 * 10.0, 360);
    assert_int_equal(warnings(&c), 1);
    for (int axis = 0; axis < 2; axis++)
        for (int way = 0; way < 2; way++) { /* a principal point of an image twice as large */
            double *at = NULL;

            around(&c, 1.5, 4, 360);
            at = axis ? &c.views[3].camera.cy : &c.views[3].camera.cx;
            *at = way ? 11 : 5; /* 3 of 16 pixels off: cropped a little */
            assert_int_equal(warnings(&c), 0);
            *at = way ? 16 : 0;
            assert_int_equal(warnings(&c), 1);
            c.views[3].camera.lens = CLN_LENS_EQUIRECTANGULAR; /* has none */
            assert_int_equal(warnings(&c), 0);
        }
    around(&c, 1.5, 4 / 1000.0, 360);
    assert_int_equal(warnings(&c), 1);
    assert_true(c.scene.spread < 0.003 && c.scene.cube_share == 1);
}

/* Colours multiplied by alpha never exceed it; one straight pixel in one photo tells otherwise, and
 * so few half transparent pixels, or so dark ones, tell nothing. */
static void multiplied_colours_are_told(void **state)
{
    static uint8_t pixels[CAMERAS][16 * 16][4];
    capture c;

    (void)state;
    for (int which = 0; which < 4; which++) {
        char text[CLN_EMPTY_BYTES];

        around(&c, 1.5, 4, 360);
        for (int i = 0; i < CAMERAS; i++) {
            for (int k = 0; k < 16 * 16; k++) {
                const uint8_t alpha = k % 16 < 2 ? (uint8_t)(20 + k / 2) : k % 2 ? 255 : 0;
                const uint8_t soft = which == 2 && alpha > 0 ? 255 : alpha;

                pixels[i][k][3] = soft;
                for (int a = 0; a < 3; a++)
                    pixels[i][k][a] = (uint8_t)(which == 3 ? soft / 8 : soft * 3 / 4);
            }
            c.views[i].channels = 4;
            c.views[i].pixels = pixels[i][0];
        }
        if (which == 1)
            pixels[7][2][0] = 1 + pixels[7][2][3];
        assert_int_equal(cln_scene_is_multiplied(&c.scene, text), which == 0);
    }
}

int test_group_doubts(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_amid),
        cmocka_unit_test(test_sound_captures),
        cmocka_unit_test(a_guess_is_told),
        cmocka_unit_test(few_around_are_told),
        cmocka_unit_test(test_points),
        cmocka_unit_test(few_stands_are_told),
        cmocka_unit_test(a_film_has_no_stands),
        cmocka_unit_test(test_planted_faults),
        cmocka_unit_test(multiplied_colours_are_told),
    };

    return cmocka_run_group_tests_name("doubts", tests, NULL, NULL);
}
