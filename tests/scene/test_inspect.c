/* The findings of check (scene/inspect.h) that captures of the command line do not reach, on photos
 * of a painted wall that are made by hand. */
#include "unit.h"
#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/memory.h"
#include "base/rng.h"
#include "base/text.h"
#include "scene/inspect.h"
#include "tests.h"

enum { VIEWS = 12, BLOCK = 4, STEP = 2 * BLOCK, WIDE = 96, HIGH = 64, NAME_BYTES = 400 };

static char rule[] = "a test's", folder[] = "photos";

/* `count` views of a wall at distance 1, from a row of places. */
typedef struct wall {
    cln_scene scene;
    cln_view views[VIEWS];
    char names[VIEWS][NAME_BYTES];
    uint8_t pixels[VIEWS][WIDE * HIGH * 3];
    json_t *all;
} wall;

static wall *make_wall(int count)
{
    wall *w = calloc(1, sizeof *w);

    assert_non_null(w);
    w->scene = (cln_scene){.views = w->views,
                           .view_count = count,
                           .folder = folder,
                           .bounds_rule = rule,
                           .cube_share = 1,
                           .apart_share = NAN,
                           .space = cln_space_unit};
    for (int i = 0; i < count; i++) {
        cln_camera *c = &w->views[i].camera;

        for (int p = 0; p < WIDE * HIGH; p++)
            memset(w->pixels[i] + 3 * p,
                   (int)(60 + 150 * cln_uniform_hash(3, 1, 0, (uint32_t)(p / WIDE / BLOCK), 0,
                                                     (uint32_t)((p % WIDE + STEP * i) / BLOCK))),
                   3);
        snprintf(w->names[i], NAME_BYTES, "%d", i);
        *c = (cln_camera){.fx = WIDE, .fy = WIDE, .cx = WIDE / 2.0, .cy = HIGH / 2.0};
        c->width = WIDE;
        c->height = HIGH;
        c->c2w[0] = c->c2w[5] = c->c2w[10] = 1;
        c->c2w[3] = (double)STEP * i / WIDE;
        w->views[i].name = w->views[i].path = w->names[i];
        w->views[i].channels = 3;
        w->views[i].pixels = w->pixels[i];
    }
    return w;
}

/* The first finding of that word in what was told last; NULL: none. */
static const json_t *told_of(const wall *w, const char *what)
{
    const json_t *findings = json_object_get(w->all, "findings");

    for (size_t i = 0; i < json_array_size(findings); i++)
        if (!strcmp(json_string_value(json_object_get(json_array_get(findings, i), "what")), what))
            return json_array_get(findings, i);
    return NULL;
}

/* The same of a new inspection. */
static const json_t *inspect(wall *w, const char *what)
{
    json_decref(w->all);
    w->all = NULL;
    assert_int_equal(cln_scene_inspect(&w->scene, NULL, &w->all), CLN_OK);
    return told_of(w, what);
}

static const char *text_of(const json_t *finding)
{
    return finding ? json_string_value(json_object_get(finding, "text")) : "";
}

static void free_wall(wall *w)
{
    json_decref(w->all);
    free(w);
}

/* ---- names ---- */

/* A text that is too long ends before a character that does not fit. */
static void test_long_findings(void **state)
{
    char text[4001];

    (void)state;
    for (int i = 0; i < 2000; i++)
        memcpy(text + 2 * i, "\xc3\xa9", 2);
    text[4000] = 0;
    for (int odd = 0; odd < 2; odd++) {
        json_t *findings = json_array();
        const char *got = NULL;

        cln_found_fault(findings, "test", true, NULL, "%s%s", odd ? "a" : "", text);
        cln_found_fault(findings, "test", true, NULL, "caf\xe9, %s", odd ? "a" : "b");
        assert_int_equal(json_array_size(findings), 2);
        got = text_of(json_array_get(findings, 0));
        assert_in_range(strlen(got), 2045, 2047);
        assert_true(cln_utf8_valid(got));
        assert_string_equal(text_of(json_array_get(findings, 1)), odd ? "caf?, a" : "caf?, b");
        json_decref(findings);
    }
}

/* Three far cameras, two of them at one place, with long names of characters of three bytes. */
static void test_long_names(void **state)
{
    enum { COUNT = 7 };

    (void)state;
    for (int letters = 0; letters < 2; letters++) {
        wall *w = make_wall(COUNT);
        const json_t *far = NULL;

        for (int i = 0; i < COUNT; i++) {
            char *end = w->names[i] + sprintf(w->names[i], "%.*s", letters, "abc");

            for (int k = 0; k < 100; k++, end += 3)
                strcpy(end, "\xe2\x82\xac");
            snprintf(end, 8, "%d", i);
        }
        for (int i = COUNT - 3; i < COUNT; i++)
            w->views[i].camera.c2w[7] = i < COUNT - 1 ? 1000 : 2000;
        w->views[COUNT - 2].camera.c2w[3] = w->views[COUNT - 3].camera.c2w[3];
        far = inspect(w, "far camera");
        assert_non_null(far);
        assert_true(cln_utf8_valid(text_of(far)));
        assert_non_null(strstr(text_of(far), "leave such frames out"));
        assert_non_null(strstr(text_of(inspect(w, "duplicates")), "One of each pair is wrong"));
        free_wall(w);
    }
}

/* ---- copies ---- */

/* Makes view b show what a shows, from the same place; same_file: it is the same frame. */
static void copy_view(wall *w, int a, int b, bool same_file)
{
    memcpy(w->pixels[b], w->pixels[a], sizeof w->pixels[a]);
    w->views[b].camera = w->views[a].camera;
    if (same_file)
        w->views[b].path = w->views[a].path;
}

/* A frame in the val and the test set is common; one in the train set, too, spoils its score. */
static void test_copies(void **state)
{
    enum { COUNT = 3 };
    static const struct {
        cln_split a, b;
        bool same_file, found, spoils;
    } cases[] = {
        {CLN_SPLIT_VAL, CLN_SPLIT_TEST, true, false, false},
        {CLN_SPLIT_VAL, CLN_SPLIT_TEST, false, true, false},
        {CLN_SPLIT_TRAIN, CLN_SPLIT_TEST, true, true, true},
        {CLN_SPLIT_TRAIN, CLN_SPLIT_TRAIN, true, true, false},
        {CLN_SPLIT_TRAIN, CLN_SPLIT_VAL, false, true, true},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        wall *w = make_wall(COUNT);
        const char *text = NULL;

        w->views[COUNT - 2].split = cases[i].a;
        w->views[COUNT - 1].split = cases[i].b;
        copy_view(w, COUNT - 2, COUNT - 1, cases[i].same_file);
        text = text_of(inspect(w, "duplicates"));
        if ((*text != 0) != cases[i].found || !strstr(text, "held out") == cases[i].spoils)
            fail_msg("case %zu: '%s'", i, text);
        free_wall(w);
    }
}

/* A camera that stood still takes photos that differ by noise: no fault, nor are those of one place
 * that are one photo; copies are one, and photos that are alike far apart. */
static void test_stood_still(void **state)
{
    static const struct {
        double way; /* half sides */
        int noise;  /* grey levels, of one side or the other */
        bool fault;
    } cases[] = {{0.01, 3, false}, {0, 3, false}, {0.01, 0, true}, {0.1, 3, true}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        wall *w = make_wall(6);
        const json_t *found = NULL;

        copy_view(w, 2, 3, false);
        w->views[3].camera.c2w[3] += cases[i].way * w->scene.space.half;
        for (int p = 0; p < WIDE * HIGH; p++)
            memset(w->pixels[3] + 3 * p,
                   w->pixels[2][3 * p] + (p * 7 / 5 % 2 ? 1 : -1) * cases[i].noise, 3);
        found = inspect(w, "duplicates");
        if (!found || json_is_true(json_object_get(found, "likely_fault")) != cases[i].fault ||
            !strstr(text_of(found), cases[i].fault ? "Leave the copies out" : "stood still there"))
            fail_msg("case %zu: '%s'", i, text_of(found));
        free_wall(w);
    }
}

/* Photos of an array of cameras that hardly differ are no copies. */
static void test_light_field(void **state)
{
    static const double shift = 0.16; /* pixels from photo to photo */
    wall *w = make_wall(6);

    (void)state;
    for (int v = 0; v < 6; v++) {
        w->views[v].camera.c2w[3] = shift * v / WIDE;
        for (int p = 0; p < WIDE * HIGH; p++) {
            const double x = p % WIDE + shift * v, y = p / WIDE;

            memset(w->pixels[v] + 3 * p,
                   (int)(128 + 30 * sin(x / 4.1) * cos(y / 5.3) + 20 * sin(x / 7 + y / 4.7) +
                         20 * cos(x / 9.3 - y / 6.1) + 40 * sin(y / 11)),
                   3);
        }
    }
    w->scene.space.half = 0.05;
    assert_string_equal(text_of(inspect(w, "duplicates")), "");
    free_wall(w);
}

/* ---- the cube ---- */

/* The photos show -0.5 to 1.42, and a third to either side in height; two of them most of that. */
static void check_box_of_wall(const json_t *box)
{
    static const double least[6] = {-0.5, -0.4, 0.99, 0.9, 0.2, 0.99};
    static const double most[6] = {0, -0.2, 1.01, 1.42, 0.4, 1.01};

    for (size_t i = 0; i < 6; i++) {
        const double at = json_number_value(json_array_get(box, i));

        if (!(at >= least[i] && at <= most[i]))
            fail_msg("number %zu of the box is %g", i, at);
    }
}

/* The box that is advised around what no camera stands in is a third wider to either side. */
static void check_spare(const char *advised, const json_t *box)
{
    for (size_t i = 0; i < 2; i++) {
        const double low = json_number_value(json_array_get(box, i));
        const double high = json_number_value(json_array_get(box, 3 + i));
        char *end = NULL;

        assert_true(fabs(strtod(advised, &end) - (low - (high - low) / 3)) < 0.01 * (high - low));
        advised = end + 1;
    }
}

/* What the wall's photos show is 1.4 wide and at a distance of 1. */
static void test_box(void **state)
{
    static const struct {
        double half;
        bool shell, outwards;
        const char *has, *has_not;
    } cases[] = {
        {2, false, false, "tighter box: --bbox=", "--space"},
        {2, true, false, "tighter box: --space shell --bbox=", "around"},
        {0.6, false, false, "box around all of that: --bbox=", "tighter"},
        {0.6, true, false, "the cube is a guess", "--bbox"},
        {0.6, true, true, "box around all of that: --space shell --bbox=", "tighter"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        wall *w = make_wall(VIEWS);
        const char *text = NULL;

        w->scene.cube_guessed = true;
        w->scene.space.half = cases[i].half;
        w->scene.space.shell = cases[i].shell;
        w->scene.outwards = cases[i].outwards;
        w->scene.space.centre[0] = 0.45;
        w->scene.space.centre[2] = 1;
        text = text_of(inspect(w, "cube"));
        if (!strstr(text, cases[i].has) || strstr(text, cases[i].has_not))
            fail_msg("case %zu: '%s'", i, text);
        check_box_of_wall(json_object_get(json_object_get(w->all, "measures"), "points_box"));
        if (strstr(text, "--bbox=-"))
            check_spare(strstr(text, "--bbox=") + 7,
                        json_object_get(json_object_get(w->all, "measures"), "points_box"));
        free_wall(w);
    }
}

/* A shell is seen from everywhere, but not everything is in its cube. */
static void test_inside(void **state)
{
    enum { COUNT = 6 };
    wall *w = make_wall(COUNT);
    int inside = 0;

    (void)state;
    w->scene.space.shell = true;
    w->scene.space.half = 0.2;
    inspect(w, "cube");
    for (size_t i = 0; i < COUNT; i++)
        inside += json_is_true(
            json_object_get(json_array_get(json_object_get(w->all, "views"), i), "inside_cube"));
    assert_int_equal(inside, 3); /* at 0, 1/12 and 2/12 */
    assert_true(json_number_value(json_object_get(json_object_get(w->all, "measures"),
                                                  "cameras_inside")) == inside);
    free_wall(w);
}

/* ---- what can be compared ---- */

static void test_nothing_to_compare(void **state)
{
    static const char *const unknown[] = {"points",     "points_inside", "points_span",
                                          "points_box", "kept",          "agreeing_kept"};
    wall *w = make_wall(1);
    const char *text = NULL;

    (void)state;
    text = text_of(inspect(w, "overlap"));
    assert_non_null(strstr(text, "no two photos stand apart"));
    assert_null(strstr(text, "texture"));
    free_wall(w);
    w = make_wall(4);
    for (int i = 0; i < 4; i++)
        w->views[i].camera.c2w[3] = 0;
    assert_non_null(strstr(text_of(inspect(w, "overlap")), "no two photos stand apart"));
    free_wall(w);
    w = make_wall(2); /* compared, without much in common */
    w->views[1].camera.c2w[3] = 0.5;
    memset(w->pixels[1], 128, sizeof w->pixels[1]);
    assert_non_null(strstr(text_of(inspect(w, "overlap")), "texture"));
    for (size_t i = 0; i < sizeof unknown / sizeof *unknown; i++)
        if (!json_is_null(json_object_get(json_object_get(w->all, "measures"), unknown[i])))
            fail_msg("%s is not null", unknown[i]);
    free_wall(w);
}

/* Cameras that look apart, as a rig's do or those with wrong axes: a fault where photos or sparse
 * points tell, else a remark. */
static void test_cameras_apart(void **state)
{
    static const struct {
        int views, flat; /* rows that show nothing */
        bool turned;
        double before;
        int fault; /* -1: not even a remark */
    } cases[] = {{3, HIGH, false, NAN, 0},     {3, HIGH, false, 0.2, 1},    {12, 0, false, NAN, -1},
                 {2, HIGH / 2, false, NAN, 0}, {2, HIGH / 2, true, NAN, 1}, {12, 0, true, NAN, 1}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        wall *w = make_wall(cases[i].views);
        const json_t *found = NULL;

        w->scene.apart_share = 1;
        w->scene.before_share = cases[i].before;
        for (int v = 0; v < cases[i].views; v++) {
            double *m = w->views[v].camera.c2w;

            memset(w->pixels[v], 128, (size_t)(3 * WIDE * cases[i].flat));
            if (cases[i].turned) { /* by a quarter, around the cameras' axes */
                m[0] = m[5] = 0;
                m[1] = -1;
                m[4] = 1;
            }
        }
        found = inspect(w, "axes");
        print_message(
            "%d views, %g ties: %s\n", cases[i].views,
            json_number_value(json_object_get(json_object_get(w->all, "measures"), "ties")),
            text_of(found));
        if (!found != (cases[i].fault < 0))
            fail_msg("case %zu: %s", i, text_of(found));
        if (found && json_is_true(json_object_get(found, "likely_fault")) != cases[i].fault)
            fail_msg("case %zu: %s", i, text_of(found));
        free_wall(w);
    }
}

/* A narrow field of view is a likely fault if marks do not fit the poses, no finding if they do,
 * and a remark if it is as narrow as that of a microscope, which any marks fit. */
static void test_long_lens(void **state)
{
    static const struct {
        double focal; /* times the wall's */
        bool turned;
        int fault; /* -1: no finding */
        const char *said;
    } cases[] = {{1, false, -1, ""},
                 {30, false, -1, ""},
                 {600, false, 0, "is 0.0955 degrees along the longer side: a long lens"},
                 {30, true, 1, "is 1.91 degrees along the longer side: unusual"}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        wall *w = make_wall(6);
        const json_t *found = NULL;

        for (int v = 0; v < 6; v++) {
            double *m = w->views[v].camera.c2w;

            w->views[v].camera.fx = w->views[v].camera.fy = cases[i].focal * WIDE;
            if (cases[i].turned) { /* by a quarter, around the cameras' axes */
                m[0] = m[5] = 0;
                m[1] = -1;
                m[4] = 1;
            }
        }
        found = inspect(w, "focal length");
        if (!found != (cases[i].fault < 0) || !strstr(text_of(found), cases[i].said))
            fail_msg("case %zu: %s", i, text_of(found));
        if (found)
            assert_int_equal(json_is_true(json_object_get(found, "likely_fault")), cases[i].fault);
        free_wall(w);
    }
}

/* Masks that keep all pixels of 10 photos: tenths do not add up to 1. */
static void test_masks_without_effect(void **state)
{
    enum { COUNT = 10 };
    wall *w = make_wall(COUNT);
    static uint8_t all[WIDE * HIGH / 8];

    (void)state;
    memset(all, 255, sizeof all);
    for (int i = 0; i < COUNT; i++)
        w->views[i].kept = w->views[i].masked = all;
    assert_non_null(strstr(text_of(inspect(w, "masks")), "masks of 10 photos leave 100% of their"));
    free_wall(w);
}

/* Photos that do not fit their poses: causes that poses and masks tell come with the usual ones. */
static void test_causes(void **state)
{
    static uint8_t most[WIDE * HIGH / 8];
    static const struct {
        bool turned, masks;
        const char *has, *lacks;
    } cases[] = {
        {false, false, "Likely the object turned before cameras that stood still (give", "masks"},
        {true, false, "Likely names and poses are in", "turned before"},
        {true, true, "or masks have black and white exchanged, or what they show repeats", "none"},
    };

    (void)state;
    memset(most, 255, sizeof most);
    memset(most, 0, sizeof most * 9 / 16);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        wall *w = make_wall(VIEWS);
        const char *text = NULL;

        w->scene.in_parallel = true;
        for (int v = 0; v < VIEWS; v++) {
            double *m = w->views[v].camera.c2w;

            for (uint32_t a = 0; a < 3; a++) /* of anything else */
                m[4 * a + 3] = 0.3 * cln_uniform_hash(9, a, 0, (uint32_t)v, 0, 0);
            m[0] = m[10] = cos(0.15 * (v % 3 - 1));
            m[2] = sin(0.15 * (v % 3 - 1));
            m[8] = -m[2];
            if (cases[i].turned && v % 2) { /* half of the cameras look along x */
                m[0] = m[10] = 0;
                m[2] = 1;
                m[8] = -1;
            }
            if (cases[i].masks && v < 3) /* of the others enough is left to compare */
                w->views[v].kept = w->views[v].masked = most;
        }
        text = text_of(inspect(w, "poses"));
        assert_non_null(strstr(text, cases[i].has));
        assert_null(strstr(text, cases[i].lacks));
        assert_non_null(strstr(text, "or what they show repeats, as tiles do"));
        free_wall(w);
    }
}

/* ---- what stands still ---- */

static uint8_t grey_of(uint32_t field, double x, double y)
{
    return (uint8_t)(60 + 150 * cln_uniform_hash(3, field, 0, (uint32_t)(int)floor(y / BLOCK), 0,
                                                 (uint32_t)(int)floor(x / BLOCK)));
}

/* Cameras that also roll before the wall, by `degrees` from one to the next, and above row `still`
 * something that all see at one place. */
static wall *make_turning(double degrees, int still)
{
    wall *w = make_wall(VIEWS);

    for (int i = 0; i < VIEWS; i++) {
        cln_camera *c = &w->views[i].camera;
        const double roll = degrees * i / 57.29577951308232;

        c->c2w[0] = c->c2w[5] = cos(roll);
        c->c2w[4] = sin(roll);
        c->c2w[1] = -sin(roll);
        for (int p = 0; p < WIDE * HIGH; p++) {
            const double x = p % WIDE + .5 - c->cx, y = p / WIDE + .5 - c->cy;
            const double at[2] = {c->c2w[0] * x + c->c2w[1] * y + WIDE * c->c2w[3],
                                  c->c2w[4] * x + c->c2w[5] * y};

            memset(w->pixels[i] + 3 * p,
                   p / WIDE < still ? grey_of(2, x, y) : grey_of(1, at[0] + 1000, at[1] + 1000), 3);
        }
    }
    return w;
}

static double measured(const wall *w, const char *name)
{
    return json_number_value(json_object_get(json_object_get(w->all, "measures"), name));
}

/* Found, and no reason to take poses for wrong; masks that drop it leave nothing to find. */
static void test_backdrop(void **state)
{
    static uint8_t lower[WIDE * HIGH / 8];
    wall *w = make_turning(8, HIGH / 2);
    double sound = 0;

    (void)state;
    assert_non_null(strstr(text_of(inspect(w, "backdrop")), "stands at one place in both"));
    assert_true(measured(w, "still_share") > 0.3);
    assert_true(measured(w, "agreeing_share") > 0.6);
    assert_null(told_of(w, "poses"));
    sound = measured(w, "agreeing_share");
    memset(lower + sizeof lower / 2, 255, sizeof lower / 2);
    for (int i = 0; i < VIEWS; i++)
        w->views[i].kept = w->views[i].masked = lower;
    assert_null(inspect(w, "backdrop"));
    assert_null(told_of(w, "poses"));
    assert_null(told_of(w, "masks"));
    assert_true(measured(w, "still_share") == 0 && measured(w, "ties") >= 100);
    assert_true(measured(w, "agreeing_share") > sound - 0.1);
    assert_true(measured(w, "agreeing_kept") > 0.6);
    memset(lower, 255, sizeof lower / 2); /* the other half */
    memset(lower + sizeof lower / 2, 0, sizeof lower / 2);
    assert_non_null(strstr(text_of(inspect(w, "masks")), "--masks ignore-white reads them so"));
    for (int i = 0; i < VIEWS; i++)
        w->views[i].mask_black = true; /* by that option */
    assert_non_null(strstr(text_of(inspect(w, "masks")), "or leave --masks ignore-white out"));
    free_wall(w);
}

/* Some photos have no mask: shares are of those that have one, and of what these show. */
static void test_masks_of_some(void **state)
{
    wall *w = make_turning(8, 0);
    static uint8_t some[WIDE * HIGH / 8];
    double kept = 0;

    (void)state;
    for (int y = 0; y < HIGH / 4; y++)
        memset(some + ((HIGH / 2 + y) * WIDE + WIDE / 4) / 8, 255, WIDE / 4 / 8);
    for (int i = 0; i < VIEWS / 2; i++)
        w->views[i].kept = w->views[i].masked = some;
    assert_non_null(strstr(text_of(inspect(w, "masks")), "of 6 photos leave 6.25% of their"));
    assert_true(fabs(measured(w, "kept") - 0.0625) < 1e-9);
    memset(some, 255, sizeof some / 2); /* half of the photos keep what others show otherwise */
    memset(some + sizeof some / 2, 0, sizeof some / 2);
    for (int i = 0; i < VIEWS; i++)
        for (int p = 0; p < WIDE * HIGH / 2; p++)
            memset(w->pixels[i] + 3 * p, grey_of(10 + (uint32_t)i, p % WIDE, p / WIDE), 3);
    for (int i = 0; i < VIEWS; i++)
        w->views[i].kept = w->views[i].masked = i < VIEWS / 2 ? some : NULL;
    assert_non_null(strstr(text_of(inspect(w, "masks")), "--masks ignore-white"));
    assert_true(fabs(measured(w, "kept") - 0.5) < 1e-9);
    kept = measured(w, "agreeing_kept");
    for (int i = 0; i < VIEWS; i++)
        w->views[i].kept = w->views[i].masked = some;
    assert_non_null(strstr(text_of(inspect(w, "masks")), "--masks ignore-white"));
    assert_true(fabs(measured(w, "agreeing_kept") - kept) < 0.1);
    free_wall(w);
}

/* Nothing stands still: all moves; poses are wrong; copies of a photo; a wall far off. */
static void test_no_backdrop(void **state)
{
    wall *w = make_turning(8, 0);

    (void)state;
    assert_null(inspect(w, "backdrop"));
    assert_true(measured(w, "agreeing_share") > 0.8);
    for (int i = 0; i + 1 < VIEWS; i += 2) {
        const cln_camera kept = w->views[i].camera;

        w->views[i].camera = w->views[i + 1].camera;
        w->views[i + 1].camera = kept;
    }
    assert_null(inspect(w, "backdrop"));
    assert_non_null(told_of(w, "poses"));
    free_wall(w);
    w = make_turning(8, 0);
    w->scene.view_count = 5;
    memcpy(w->pixels[1], w->pixels[0], sizeof w->pixels[0]);
    assert_null(inspect(w, "backdrop"));
    free_wall(w);
    w = make_turning(0, HIGH);
    w->scene.view_count = 5;
    assert_null(inspect(w, "backdrop"));
    free_wall(w);
}

/* What is told of the work; a stop is asked for once photos are compared. */
typedef struct told {
    int measured, compared;
} told;

static void tell_work(const char *what, int done, int total, void *user)
{
    told *t = user;

    t->measured += !strcmp(what, "measured") && done == total;
    t->compared += !strcmp(what, "compared") && done == total;
}

static int stop_behind_comparing(void *user)
{
    return ((const told *)user)->compared ? SIGINT : 0;
}

/* Long sets are told while their photos are measured, and can be stopped while copies are looked
 * for. */
static void test_stopped(void **state)
{
    wall *w = make_wall(6);
    told t = {0};
    cln_callbacks callbacks = {.work = tell_work, .user = &t};

    (void)state;
    assert_int_equal(cln_scene_inspect(&w->scene, &callbacks, &w->all), CLN_OK);
    assert_int_equal(t.measured, 1);
    assert_true(t.compared > 0);
    json_decref(w->all);
    t = (told){0};
    callbacks.interrupted = stop_behind_comparing;
    assert_int_equal(cln_scene_inspect(&w->scene, &callbacks, &w->all), CLN_SIGINT);
    assert_null(w->all);
    assert_true(t.compared > 0);
    cln_clear_error();
    free_wall(w);
}

/* The cube of cameras that look in parallel, if it is a guess, goes where photos show something: a
 * wall at distance 1. */
static void test_placed(void **state)
{
    cln_config config;

    (void)state;
    assert_int_equal(cln_config_preset(CLN_DEFAULT_PRESET, &config), CLN_OK);
    for (int i = 0; i < 4; i++) {
        wall *w = make_wall(VIEWS);
        cln_placed placed;

        w->scene.in_parallel = i != 1;
        w->scene.cube_guessed = i != 2;
        w->scene.space.half = 0.01;
        assert_int_equal(cln_strdup(&w->scene.bounds_rule, rule), CLN_OK);
        config.space = i == 3 ? CLN_SPACE_CUBE : CLN_SPACE_AUTO;
        assert_int_equal(cln_scene_place_cube(&w->scene, &config, NULL, &placed), CLN_OK);
        assert_int_equal(placed.box[0] != 0, i == 0 || i == 3);
        assert_int_equal(placed.space, i == 0 ? CLN_SPACE_SHELL : config.space);
        assert_int_equal(w->scene.space.shell, i == 0);
        if (placed.box[0]) {
            assert_true(fabs(w->scene.space.centre[2] - 1) < 0.05);
            assert_true(w->scene.space.half > 0.2 && w->scene.space.half < 1);
            assert_false(w->scene.cube_guessed);
        }
        free(w->scene.bounds_rule);
        free_wall(w);
    }
}

int test_group_inspect(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_long_findings), cmocka_unit_test(test_long_names),
        cmocka_unit_test(test_copies),        cmocka_unit_test(test_box),
        cmocka_unit_test(test_inside),        cmocka_unit_test(test_nothing_to_compare),
        cmocka_unit_test(test_cameras_apart), cmocka_unit_test(test_masks_without_effect),
        cmocka_unit_test(test_masks_of_some), cmocka_unit_test(test_causes),
        cmocka_unit_test(test_backdrop),      cmocka_unit_test(test_no_backdrop),
        cmocka_unit_test(test_stopped),       cmocka_unit_test(test_stood_still),
        cmocka_unit_test(test_light_field),   cmocka_unit_test(test_placed),
        cmocka_unit_test(test_long_lens),
    };

    return cmocka_run_group_tests_name("inspect", tests, NULL, NULL);
}
