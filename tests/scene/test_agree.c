/* Which photos are compared to see whether their poses fit (scene/agree.h): those of neighbours,
 * which stand near and look the same way, and the next by name. */
#include "unit.h"
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "lit_fixture.h"
#include "sanitized.h"
#include "scene/agree.h"
#include "scene/inspect.h"
#include "tests.h"

enum { SIDE = 64, BLOCK = 4, GROUP = 6, VIEWS = 2 * GROUP };
enum { EACH_CASE = SANITIZED ? 4 : 1 }; /* every fourth of long lists */

static uint8_t *paint(void)
{
    uint8_t *pixels = malloc((size_t)SIDE * SIDE * 3);

    assert_non_null(pixels);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            memset(pixels + 3 * (y * SIDE + x),
                   (int)(255 * cln_uniform_hash(3, 1, 0, (uint32_t)(y / BLOCK), 0,
                                                (uint32_t)(x / BLOCK))),
                   3);
    return pixels;
}

/* Two rows of cameras that look away from each other. Others of the second row are nearer to one of
 * the first than those beside it. */
static void test_neighbours_look_alike(void **state)
{
    uint8_t *pixels = paint();
    cln_view views[VIEWS];
    const cln_scene scene = {.views = views, .view_count = VIEWS};
    cln_agreement a;

    (void)state;
    memset(views, 0, sizeof views);
    for (int i = 0; i < VIEWS; i++) {
        const bool second = i >= GROUP;
        cln_camera *c = &views[i].camera;

        c->width = c->height = SIDE;
        c->fx = c->fy = SIDE;
        c->cx = c->cy = SIDE / 2;
        c->c2w[0] = second ? -1 : 1;
        c->c2w[5] = 1;
        c->c2w[10] = second ? -1 : 1;
        c->c2w[3] = 3 * (i % GROUP) + (second ? 0.5 : 0);
        views[i].channels = 3;
        views[i].pixels = pixels;
    }
    assert_int_equal(cln_agree(&scene, NULL, &a), CLN_OK);
    assert_true(a.tie_count > 50);
    for (int i = 0; i < a.tie_count; i++)
        if ((a.ties[i].a < GROUP) != (a.ties[i].b < GROUP)) /* the next by name */
            assert_true(a.ties[i].a == GROUP - 1 && a.ties[i].b == GROUP);
    cln_agreement_free(&a);
    free(pixels);
}

/* Two photos without anything to compare are one pair, though each is the other's neighbour. */
static void test_pairs_once(void **state)
{
    uint8_t *pixels = calloc((size_t)SIDE * SIDE, 3);
    cln_view views[2];
    const cln_scene scene = {.views = views, .view_count = 2};
    cln_agreement a;

    (void)state;
    assert_non_null(pixels);
    memset(views, 0, sizeof views);
    for (int i = 0; i < 2; i++) {
        cln_camera *c = &views[i].camera;

        c->width = c->height = SIDE;
        c->fx = c->fy = SIDE;
        c->cx = c->cy = SIDE / 2;
        c->c2w[0] = c->c2w[5] = c->c2w[10] = 1;
        c->c2w[3] = i;
        views[i].channels = 3;
        views[i].pixels = pixels;
    }
    assert_int_equal(cln_agree(&scene, NULL, &a), CLN_OK);
    assert_int_equal(a.tie_count, 0);
    assert_int_equal(a.pairs, 1);
    cln_agreement_free(&a);
    free(pixels);
}

/* ---- brightness ---- */

enum { ROW_MOST = 12 };

/* How many photos check names for their brightness; *first: the first of them, or -1 with a remark
 * without any. */
static int faulty_in(const cln_scene *scene, int *first)
{
    json_t *all = NULL, *findings = NULL;
    int found = 0;

    assert_int_equal(cln_scene_inspect(scene, NULL, &all), CLN_OK);
    findings = json_object_get(all, "findings");
    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i), *name = NULL;

        if (strcmp(json_string_value(json_object_get(one, "what")), "exposure") != 0 || found > 0)
            continue; /* remarks stand behind faults, and what has photos before what has none */
        found = (int)json_array_size(json_object_get(one, "views"));
        name = json_array_get(json_object_get(one, "views"), 0);
        *first = found > 0 ? atoi(json_string_value(name)) : -1;
    }
    json_decref(all);
    return found;
}

/* `count` photos of a painted wall from a row of places, each two blocks from the next, with light
 * of `stops` factors of 2. As faulty_in(). */
static int count_faulty(int count, const double *stops, int *first)
{
    enum { STEP = 2 * BLOCK, WIDE = 3 * SIDE / 2, HIGH = SIDE };
    uint8_t *pixels[ROW_MOST];
    char names[ROW_MOST][8];
    cln_view views[ROW_MOST];
    cln_scene scene = {.views = views,
                       .view_count = count,
                       .folder = "photos",
                       .bounds_rule = "a test",
                       .cube_share = 1,
                       .apart_share = NAN,
                       .space = cln_space_unit};
    int found = 0;

    memset(views, 0, sizeof views);
    for (int i = 0; i < count; i++) {
        cln_camera *c = &views[i].camera;
        const double light = pow(2, stops[i] / 2.2);

        pixels[i] = malloc((size_t)WIDE * HIGH * 3);
        assert_non_null(pixels[i]);
        for (int y = 0; y < HIGH; y++)
            for (int x = 0; x < WIDE; x++)
                memset(pixels[i] + 3 * (y * WIDE + x),
                       (int)(light *
                             (60 + 150 * cln_uniform_hash(3, 1, 0, (uint32_t)(y / BLOCK), 0,
                                                          (uint32_t)((x + STEP * i) / BLOCK)))),
                       3);
        snprintf(names[i], sizeof names[i], "%d", i);
        c->width = WIDE;
        c->height = HIGH;
        c->fx = c->fy = WIDE;
        c->cx = WIDE / 2.0;
        c->cy = HIGH / 2.0;
        c->c2w[0] = c->c2w[5] = c->c2w[10] = 1;
        c->c2w[3] = (double)STEP * i / WIDE; /* the wall is at 1 */
        views[i].name = names[i];
        views[i].channels = 3;
        views[i].pixels = pixels[i];
    }
    found = faulty_in(&scene, first);
    for (int i = 0; i < count; i++)
        free(pixels[i]);
    return found;
}

/* A photo that is a stop darker than its neighbours is faulty; the last of a row that gets darker
 * is not, although it differs from them as much. */
static void test_light_that_fades(void **state)
{
    int first = -2;

    (void)state;
    assert_int_equal(count_faulty(6, (const double[]){0, 0, 0, -1, 0, 0}, &first), 1);
    assert_int_equal(first, 3);
    assert_int_equal(count_faulty(6, (const double[]){0, 0, 0, 0, 0, -1}, &first), 1);
    assert_int_equal(first, 5);
    assert_int_equal(count_faulty(6, (const double[]){0, 0, -.1, -.4, -.8, -1.4}, &first), 0);
    assert_int_equal(first, -1); /* but a remark */
}

/* Two faulty photos next to each other do not hide each other, alike or not. */
static void test_faulty_neighbours(void **state)
{
    int first = -2;

    (void)state;
    assert_int_equal(count_faulty(10, (const double[]){0, 0, -1, -1, 0, 0, 0, 0, 0, 0}, &first), 2);
    assert_int_equal(first, 2);
    assert_int_equal(count_faulty(10, (const double[]){0, 0, 0, 0, -.9, -1.8, 0, 0, 0, 0}, &first),
                     2);
    assert_int_equal(first, 4);
}

/* A lamp that goes along with the camera is told from exposures that change along the way, and a
 * darker photo under it from those that are as bright as it makes them. */
static void test_lamp_on_camera(void **state)
{
    enum { COUNT = 9 };
    static const struct {
        double falloff, stops[COUNT], power;
        int faulty, first; /* -2: nothing is said */
    } cases[] = {
        {2, {0}, 2, 0, -1},
        {2, {0, 0, 0, 0, -1}, 2, 1, 4},
        {0, {0, .3, .6, .9, 1.2, 1.5, 1.8, 2.1, 2.4}, 0, 0, -1},
        {0, {0}, 0, 0, -2},
        {0, {0, 0, 0, 0, -1}, 0, 1, 4},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i += EACH_CASE) {
        char folder[16];
        cln_scene *scene = NULL;
        cln_agreement a;
        int first = -2, faulty = 0;

        snprintf(folder, sizeof folder, "lit%zu", i);
        put_folder(*state, folder);
        scene = lit_photos(scratch_path(*state, folder), COUNT, cases[i].falloff, cases[i].stops);
        assert_int_equal(cln_agree(scene, NULL, &a), CLN_OK);
        if (fabs(a.falloff - cases[i].power) > 0.3)
            fail_msg("case %zu: %d marks fade with the power %g", i, a.agreeing, a.falloff);
        faulty = faulty_in(scene, &first);
        if (faulty != cases[i].faulty || (first != cases[i].first && faulty < 2))
            fail_msg("case %zu: %d photos, the first is %d", i, faulty, first);
        cln_agreement_free(&a);
        cln_scene_free(scene);
    }
}

/* ---- poses ---- */

enum { SEEN_WIDE = 96, SEEN_HIGH = 64, SEEN_MOST = 24 };

/* Photos of a painted wall at z = 1 as their cameras see it, each way that these are turned. */
typedef struct seen {
    cln_scene scene;
    cln_view views[SEEN_MOST];
    char names[SEEN_MOST][8];
    uint8_t pixels[SEEN_MOST][SEEN_WIDE * SEEN_HIGH * 3];
} seen;

/* r = R(x) R(y) R(z), angles in radians about the camera's axes. */
static void turned(const double angles[3], double c2w[12])
{
    double r[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};

    for (int a = 0; a < 3; a++) {
        const int i = (a + 1) % 3, k = (a + 2) % 3;
        const double c = cos(angles[a]), s = sin(angles[a]);

        for (int row = 0; row < 9; row += 3) {
            const double one = r[row + i], other = r[row + k];

            r[row + i] = c * one + s * other;
            r[row + k] = c * other - s * one;
        }
    }
    for (int i = 0; i < 9; i++)
        c2w[4 * (i / 3) + i % 3] = r[i];
}

/* The photo as the camera sees it. twin: from 1.2 on, the wall looks as so much before, in `rows`
 * rows of blocks around its middle. */
static void see_wall(seen *s, int view, double twin, int rows)
{
    const cln_camera *c = &s->views[view].camera;

    for (int p = 0; p < SEEN_WIDE * SEEN_HIGH; p++) {
        const double u = (p % SEEN_WIDE + .5 - c->cx) / c->fx,
                     v = (p / SEEN_WIDE + .5 - c->cy) / c->fy;
        double d[3], at[2];

        for (int i = 0; i < 3; i++)
            d[i] = c->c2w[4 * i] * u + c->c2w[4 * i + 1] * v + c->c2w[4 * i + 2];
        for (int i = 0; i < 2; i++)
            at[i] = 1000 + 24 * (c->c2w[4 * i + 3] + d[i] / d[2] * (1 - c->c2w[11]));
        if (at[0] > 1000 + 24 * 1.2 && fabs(at[1] - 1000.5) < 0.5 * rows)
            at[0] -= 24 * twin;
        memset(s->pixels[view] + 3 * p,
               (int)(60 + 150 * cln_uniform_hash(3, 1, 0, (uint32_t)at[1], 0, (uint32_t)at[0])), 3);
    }
}

static void see(seen *s, int view)
{
    see_wall(s, view, 0, 0);
}

/* A row of `count` cameras, `step` apart, turned by up to `turn` radians about each axis. */
static seen *make_seen(int count, double step, double turn)
{
    seen *s = calloc(1, sizeof *s);

    assert_non_null(s);
    s->scene = (cln_scene){.views = s->views,
                           .view_count = count,
                           .folder = "photos",
                           .bounds_rule = "a test",
                           .cube_share = 1,
                           .apart_share = NAN,
                           .space = cln_space_unit};
    for (int i = 0; i < count; i++) {
        cln_view *view = &s->views[i];
        double angles[3];

        for (int a = 0; a < 3; a++)
            angles[a] = turn * (2 * cln_uniform_hash(5, 1, 0, (uint32_t)i, 0, (uint32_t)a) - 1);
        view->camera = (cln_camera){.width = SEEN_WIDE,
                                    .height = SEEN_HIGH,
                                    .fx = SEEN_WIDE,
                                    .fy = SEEN_WIDE,
                                    .cx = SEEN_WIDE / 2.0,
                                    .cy = SEEN_HIGH / 2.0};
        turned(angles, view->camera.c2w);
        view->camera.c2w[3] = step * i;
        view->camera.c2w[7] = 0.05 * (i % 3);
        snprintf(s->names[i], sizeof s->names[i], "%d", i);
        view->name = view->path = s->names[i];
        view->channels = 3;
        view->pixels = s->pixels[i];
        see(s, i);
    }
    return s;
}

/* The text of the first finding of that word, or ""; *fault: is it one? */
static char *told_of(const seen *s, const char *what, bool *fault)
{
    json_t *all = NULL, *findings = NULL;
    char *text = NULL;

    *fault = false;
    assert_int_equal(cln_scene_inspect(&s->scene, NULL, &all), CLN_OK);
    findings = json_object_get(all, "findings");
    for (size_t i = 0; !text && i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i);

        if (strcmp(json_string_value(json_object_get(one, "what")), what) != 0)
            continue;
        *fault = json_is_true(json_object_get(one, "likely_fault"));
        text = strdup(json_string_value(json_object_get(one, "text")));
    }
    json_decref(all);
    return text ? text : strdup("");
}

/* The turn of a quaternion (w, x, y, z), column by column: q e q*, e an axis. */
static void turn_of(const double q[4], double c2w[12])
{
    for (int k = 0; k < 3; k++) {
        double e[3] = {k == 0, k == 1, k == 2}, once[3], twice[3];

        for (int i = 0; i < 3; i++)
            once[i] = q[1 + (i + 1) % 3] * e[(i + 2) % 3] - q[1 + (i + 2) % 3] * e[(i + 1) % 3];
        for (int i = 0; i < 3; i++)
            twice[i] =
                q[1 + (i + 1) % 3] * once[(i + 2) % 3] - q[1 + (i + 2) % 3] * once[(i + 1) % 3];
        for (int i = 0; i < 3; i++)
            c2w[4 * i + k] = e[i] + 2 * q[0] * once[i] + 2 * twice[i];
    }
}

/* Poses of quaternions whose numbers are moved up or down a place are found again, whichever is
 * the largest. */
static void test_moved_w(void **state)
{
    static const double four[4] = {0.1, -0.3, 0.5, 0.806225774829855};

    (void)state;
    for (int first = 0; first < 4; first++)
        for (int sign = -1; sign <= 1; sign += 2) {
            double q[4], up[4], down[4], right[12] = {0}, given[12] = {0}, got[12];

            for (int i = 0; i < 4; i++)
                q[i] = (i == 2 ? sign : 1) * four[(first + i) % 4];
            for (int i = 0; i < 4; i++) {
                up[(i + 1) % 4] = q[i];
                down[i] = q[(i + 1) % 4];
            }
            turn_of(q, right);
            right[3] = given[3] = 7;
            right[11] = given[11] = -2;
            turn_of(down, given); /* as x y z w that are taken for w x y z */
            cln_reading_pose(&cln_readings[10], given, got);
            for (int i = 0; i < 12; i++)
                assert_true(fabs(got[i] - right[i]) < 1e-12);
            turn_of(up, given);
            cln_reading_pose(&cln_readings[11], given, got);
            for (int i = 0; i < 12; i++)
                assert_true(fabs(got[i] - right[i]) < 1e-12);
        }
}

/* Mistakes of those who write poses of a robot, and what check says of them. */
static void test_robots_poses(void **state)
{
    /* body: the camera's columns are, with a sign, these of the matrix; w: places that it moves */
    static const struct {
        int body[3], w;
        const char *text;
    } cases[] = {
        {{3, -1, -2}, 0, "a robot's body (x forward, y left, z up"}, /* forward, left, up */
        {{3, 1, 2}, 0, "a robot's body (x forward, y left, z up"},   /* turned as OpenGL's are */
        {{1, 2, 3}, 1, "read with w first, and have it last"},
        {{1, 2, 3}, -1, "read with w last, and have it first"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        seen *s = make_seen(12, 0.08, 0.3);
        char *text = NULL;
        bool fault = false;

        for (int k = 0; k < s->scene.view_count; k++) {
            double *m = s->views[k].camera.c2w, was[12];

            memcpy(was, m, sizeof was);
            for (int row = 0; row < 12; row += 4)
                for (int a = 0; a < 3; a++)
                    m[row + a] =
                        was[row + abs(cases[i].body[a]) - 1] * (cases[i].body[a] < 0 ? -1 : 1);
            if (cases[i].w) { /* the other reading undoes what this one does */
                memcpy(was, m, sizeof was);
                cln_reading_pose(&cln_readings[cases[i].w > 0 ? 11 : 10], was, m);
            }
        }
        text = told_of(s, "axes", &fault);
        if (!fault || !strstr(text, cases[i].text))
            fail_msg("case %zu: '%s'", i, text);
        free(text);
        free(s);
    }
}

/* Positions that are wrong in a way that can be recognised, with rotations that are right. */
static void test_positions(void **state)
{
    static const struct {
        double factor[3], offset[3]; /* of what is given, along the axes below */
        int axis[3];
        bool in_32_bits;
        const char *text; /* "": no finding; NULL: another */
    } cases[] = {
        {{1, 1, 1}, {0}, {0, 1, 2}, false, ""},
        {{1, 1, 1}, {512336, 5712346, 132}, {0, 1, 2}, false, ""},
        {{1, 1, 1}, {0}, {0, 1, 2}, true, ""},
        {{1, 1, 3.28084}, {0}, {0, 1, 2}, false, "z is multiplied by 0.3048. Likely it is in feet"},
        {{3.28084, 1, 3.28084},
         {0},
         {0, 1, 2},
         false,
         "y is multiplied by 3.28084. Likely it is in metres, and the other two are in feet"},
        {{1, 1, 1}, {0}, {1, 0, 2}, false, "if they are (y, x, z) instead of (x, y, z)"},
        {{1, 1, 1}, {0}, {1, 2, 0}, false, "if they are (z, x, y) instead of (x, y, z)"},
        {{-1, -1, -1}, {0}, {0, 1, 2}, false, "if they are (-x, -y, -z) instead of (x, y, z)"},
        {{1e-4, 1e-4, 10}, {9.18, 51.5, 100}, {0, 1, 2}, false, "(x about 9.18"},
        {{10, 1e-4, 1e-4}, {0, 51.5, 170}, {0, 1, 2}, false, "degrees (y about 51.5"},
        {{1e-4, 1e-4, 10}, {0.001, 0, 100}, {0, 1, 2}, false, NULL},
        {{1, 1, 1}, {5e5, 5712346, 132}, {0, 1, 2}, true, "y, about 5.71e+06, in steps of 0.5"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i += EACH_CASE) {
        seen *s = make_seen(12, 0.08, 0.2);
        char *text = NULL;
        bool fault = false;

        for (int k = 0; k < s->scene.view_count; k++) {
            double *m = s->views[k].camera.c2w, was[12];

            m[7] = 0.15 * (k % 3);
            m[11] = -0.04 * (5 * k % 12); /* all differ */
            see(s, k);
            memcpy(was, m, sizeof was);
            for (int a = 0; a < 3; a++) {
                const double given =
                    cases[i].factor[a] * was[4 * cases[i].axis[a] + 3] + cases[i].offset[a];

                m[4 * a + 3] = cases[i].in_32_bits ? (double)(float)given : given;
            }
        }
        text = told_of(s, "poses", &fault);
        if (cases[i].text ? fault != !!cases[i].text[0] || !strstr(text, cases[i].text)
                          : !fault || strstr(text, "degrees"))
            fail_msg("case %zu: '%s'", i, text);
        free(text);
        free(s);
    }
}

/* Half of the photos fit each other; the others share as much with these, and contradict them and
 * each other: more photos would do so, too. */
static void test_no_more_photos(void **state)
{
    seen *s = make_seen(12, 0.08, 0.2);
    char *text = NULL;
    bool fault = false;

    (void)state;
    for (uint32_t k = 6; k < 12; k++)
        for (uint32_t a = 0; a < 3; a++)
            s->views[k].camera.c2w[4 * a + 3] += 8 * cln_uniform_hash(7, 1, 0, k, 0, a) - 4;
    text = told_of(s, "poses", &fault);
    if (fault || !strstr(text, "of 12 photos share many marks with their neighbours"))
        fail_msg("'%s'", text);
    free(text);
    text = told_of(s, "overlap", &fault);
    assert_string_equal(text, "");
    free(text);
    free(s);
}

/* A photo that does not fit its pose is a fault if the pose is none of a video, between those
 * before and after it, and if it has as many marks as others. */
static void test_bad_pose(void **state)
{
    enum { COUNT = 24, ODD = 12 };
    static const struct {
        double shown, posed; /* how far down the photo was taken, and is by its pose */
        int kept;            /* rows of the photo with something to see */
        bool fault;
    } cases[] = {
        {0.2, -0.2, SEEN_HIGH, true},
        {0.2, 0, SEEN_HIGH, false},
        {0.2, -0.2, 16, false},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i += EACH_CASE) {
        seen *s = make_seen(COUNT, 0.03, 0);
        char *text = NULL;
        bool fault = false;

        for (int k = 0; k < COUNT; k++) {
            s->views[k].camera.c2w[7] = k == ODD ? cases[i].shown : 0;
            see(s, k);
        }
        s->views[ODD].camera.c2w[7] = cases[i].posed;
        memset(s->pixels[ODD] + 3 * cases[i].kept * SEEN_WIDE, 128,
               (size_t)(3 * (SEEN_HIGH - cases[i].kept) * SEEN_WIDE));
        text = told_of(s, "pose", &fault);
        if (fault != cases[i].fault || (fault && !strstr(text, "poses: 12;")))
            fail_msg("case %zu: '%s'", i, text);
        free(text);
        text = told_of(s, "frames", &fault); /* it parts the others, but their frame is one */
        assert_string_equal(text, "");
        free(text);
        free(s);
    }
}

/* Photos that were turned by 180 degrees after their poses were found are named; mirrored: none. */
static void test_upside_down(void **state)
{
    enum { COUNT = 24, BYTES = 3, PIXELS = SEEN_WIDE * SEEN_HIGH };

    (void)state;
    for (int kind = 0; kind < 3; kind += EACH_CASE) {
        const bool mirrored = kind == 1;
        const int every = kind == 2 ? 2 : 4, count = kind == 2 ? COUNT / 2 : COUNT;
        seen *s = make_seen(count, 0.04, 0.1);
        char *text = NULL;
        bool fault = false;

        for (int k = 1; k < count; k += every) {
            uint8_t was[BYTES * PIXELS];

            memcpy(was, s->pixels[k], sizeof was);
            for (int p = 0; p < PIXELS; p++)
                memcpy(s->pixels[k] + BYTES * p,
                       was + BYTES * (mirrored ? p + SEEN_WIDE - 1 - 2 * (p % SEEN_WIDE)
                                               : PIXELS - 1 - p),
                       BYTES);
        }
        text = told_of(s, "upside down", &fault);
        if (fault == mirrored ||
            (fault && !strstr(text, every == 2 ? "found: 1, 3, 5, 7, 9 and 1 more; turn"
                                               : "found: 1, 5, 9, 13, 17 and 1 more; turn")))
            fail_msg("%d: '%s'", kind, text);
        free(text);
        text = told_of(s, "pose", &fault); /* of which not these are told */
        assert_true(mirrored || !fault);
        free(text);
        text = told_of(s, "overlap", &fault); /* sound photos among them have few ties that agree */
        assert_true(mirrored || !*text);
        free(text);
        free(s);
    }
}

/* Photos of one wall in two parts, those of the second upside down: a fault if its frame is
 * another. */
static void test_merged(void **state)
{
    enum { COUNT = 24, PART = 11 };
    static const double upside_down[3] = {0, 0, 3.141592653589793};
    static const struct {
        double scale, angles[3], shift;
        double told;      /* of the scale */
        const char *text; /* NULL: none */
    } cases[] = {
        {1, {0}, 0, 0, NULL},
        {0.001, {0}, 1, 1000, "times as small: they fit"},
        {3, {1.13, 0, 0}, 5, 3, "times as large, turned by 6"},
        {1, {0}, 2, 0, "than the others, with another origin: they"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i += EACH_CASE) {
        seen *s = make_seen(COUNT, 0.04, 0.1);
        char *text = NULL;
        const char *about = NULL;
        bool fault = false;

        for (int k = COUNT - PART; k < COUNT; k++) {
            double *m = s->views[k].camera.c2w, was[12], by[12] = {0}, half[12] = {0};

            memcpy(was, m, sizeof was);
            turned(upside_down, half);
            for (int e = 0; e < 9; e++)
                m[4 * (e / 3) + e % 3] = was[4 * (e / 3) + e % 3] * half[5 * (e % 3)];
            see(s, k);
            memcpy(was, m, sizeof was);
            turned(cases[i].angles, by);
            for (int e = 0; e < 12; e++) {
                m[e] = e % 4 == 3 ? cases[i].shift : 0;
                for (int a = 0; a < 3; a++)
                    m[e] += by[4 * (e / 4) + a] * was[4 * a + e % 4] *
                            (e % 4 == 3 ? cases[i].scale : 1);
            }
        }
        memset(s->pixels[COUNT - PART - 1], 128, sizeof s->pixels[0]); /* what names would join */
        text = told_of(s, "frames", &fault);
        about = strstr(text, "than the others, about ");
        if (fault != !!cases[i].text ||
            (fault && (!strstr(text, cases[i].text) || !strstr(text, "11 of 24 photos (13, 14, "))))
            fail_msg("case %zu: '%s'", i, text);
        if (cases[i].told > 0) {
            assert_non_null(about);
            assert_true(fabs(atof(about + 23) / cases[i].told - 1) < 0.03);
        }
        free(text);
        free(s);
    }
}

/* Three groups of photos along a wall whose end looks like its begin: what the last shows lies
 * elsewhere by the first, but the one between joins both, so that their frames are one. Without it
 * they are taken for two; not if it is a strip alone that comes twice: few places, though marks of
 * 64 pairs of photos. */
static void test_joined(void **state)
{
    enum { GROUPS = 3, EACH = 8 };
    static const struct {
        int rows;
        bool without, fault;
    } cases[] = {{100, false, false}, {100, true, true}, {3, true, false}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        seen *s = make_seen(GROUPS * EACH, 0.04, 0.1);
        char *text = NULL;
        bool fault = false;

        for (int k = 0; k < GROUPS * EACH; k++) {
            const int group = k / EACH;

            s->views[k].camera.c2w[3] = 0.5 * group + 0.04 * (k % EACH);
            see_wall(s, k, 1.5, cases[i].rows);
            if ((group == 1 && cases[i].without) ||
                k % EACH == EACH - 1) /* names would join groups */
                memset(s->pixels[k], 128, sizeof s->pixels[k]);
        }
        text = told_of(s, "frames", &fault);
        if (fault != cases[i].fault)
            fail_msg("case %zu: '%s'", i, text);
        free(text);
        free(s);
    }
}

/* A camera that looks at the middle of what is painted from a distance of 1, by degrees. */
static void stand_around(double azimuth, double elevation, double c2w[12])
{
    const double a = azimuth / 57.29577951308232, e = elevation / 57.29577951308232;
    const double out[3] = {cos(a) * cos(e), sin(a) * cos(e), -sin(e)}; /* the wall's front is -z */
    const double right[3] = {sin(a), -cos(a), 0};

    for (int i = 0; i < 3; i++) {
        const int k = (i + 1) % 3, n = (i + 2) % 3;

        c2w[4 * i] = right[i];
        c2w[4 * i + 1] = right[k] * out[n] - right[n] * out[k];
        c2w[4 * i + 2] = -out[i];
        c2w[4 * i + 3] = out[i] + (i == 2);
    }
}

/* Poses on a circle with another tilt than the camera's are a fault, and it is found. */
static void test_tilt(void **state)
{
    static const struct {
        double shown, given;
        const char *text; /* NULL: none */
    } cases[] = {
        {50, 40, "all stand about 10 degrees higher around what they look at, and look down"},
        {50, 60, "all stand about 10 degrees lower around what they look at, and look up"},
        {50, 50, NULL},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i += EACH_CASE) {
        seen *s = make_seen(SEEN_MOST, 0, 0);
        char *text = NULL;
        bool fault = false;

        for (int k = 0; k < SEEN_MOST; k++) {
            stand_around(10.0 * k, cases[i].shown, s->views[k].camera.c2w);
            see(s, k);
            stand_around(10.0 * k, cases[i].given, s->views[k].camera.c2w);
        }
        text = told_of(s, "tilt", &fault);
        if (fault != !!cases[i].text || (fault && !strstr(text, cases[i].text)))
            fail_msg("case %zu: '%s'", i, text);
        free(text);
        free(s);
    }
}

int test_group_agree(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_neighbours_look_alike),
        cmocka_unit_test(test_pairs_once),
        cmocka_unit_test(test_light_that_fades),
        cmocka_unit_test(test_faulty_neighbours),
        cmocka_unit_test_setup_teardown(test_lamp_on_camera, scratch_make, scratch_remove),
        cmocka_unit_test(test_moved_w),
        cmocka_unit_test(test_robots_poses),
        cmocka_unit_test(test_positions),
        cmocka_unit_test(test_no_more_photos),
        cmocka_unit_test(test_bad_pose),
        cmocka_unit_test(test_upside_down),
        cmocka_unit_test(test_merged),
        cmocka_unit_test(test_joined),
        cmocka_unit_test(test_tilt),
    };

    return cmocka_run_group_tests_name("agree", tests, NULL, NULL);
}
