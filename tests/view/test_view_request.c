/* What a page may ask, and who may (view/request.h): values with their bounds, cameras, the Host,
 * Origin and token of a request, and texts of all kinds. Oracle: literal values, and rules about
 * whatever was accepted. */
#include "unit.h"
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "tests.h"
#include "view/facts.h"
#include "view/request.h"

static const float grey[3] = {0.5f, 0.5f, 0.5f};
static const char level_pose[] = "1,0,0,4,0,1,0,5,0,0,1,6";

/* A query as NAME, VALUE, ..., NULL. */
static const char *of_list(void *query, const char *name)
{
    for (const char *const *at = query; *at; at += 2)
        if (strcmp(*at, name) == 0)
            return at[1];
    return NULL;
}

static cln_status ask(cln_ask_kind kind, const cln_scene *scene, const char *const *query,
                      cln_ask *out)
{
    return cln_ask_read(kind, scene, grey, of_list, (void *)query, out);
}

static void scene_of_two(cln_view views[2], cln_scene *scene)
{
    memset(views, 0, 2 * sizeof *views);
    memset(scene, 0, sizeof *scene);
    for (int i = 0; i < 2; i++)
        views[i].camera = (cln_camera){.c2w = {1, 0, 0, i, 0, 1, 0, 0, 0, 0, 1, 0},
                                       .fx = 100,
                                       .fy = 110,
                                       .cx = 40,
                                       .cy = 30,
                                       .width = 80,
                                       .height = 60};
    scene->views = views;
    scene->view_count = 2;
}

static void read_what_is_asked(void **state)
{
    static const char *const free_camera[] = {
        "pose", level_pose, "focal", "50", "width", "64",         "height",   "32", "ms",
        "45",   "show",     "depth", "x",  "1",     "background", "1,0,0.25", NULL};
    static const char *const of_view[] = {"view", "1", "width", "40", "format", "png", NULL};
    static const char *const point[] = {"view", "0", "x", "79.5", "y", "0", NULL};
    static const char *const photo[] = {"view", "1", "side", "64", NULL};
    static const char *const over_blue[] = {"view", "1", "background", "0,0,1", NULL};
#define NAME "0123456789abcdef0123456789abcdef"
    static const char *const film[] = {"width", "854", "height", "480", "frames",
                                       "96",    "fps", "12.5",   NULL};
    static const char *const frame[] = {
        "film", NAME, "view", "0", "show", "error", "crop", "-1,-2,-3,1,2.5,3", NULL};
    static const char *const end[] = {"film", NAME, NULL};
    cln_view views[2];
    cln_scene scene;
    cln_ask a;

    (void)state;
    scene_of_two(views, &scene);
    assert_int_equal(ask(CLN_ASK_PICTURE, NULL, free_camera, &a), CLN_OK);
    assert_int_equal(a.camera.width, 64);
    assert_int_equal(a.camera.height, 32);
    assert_true(a.camera.fx == 50 && a.camera.fy == 50 && a.camera.cx == 32 && a.camera.cy == 16);
    assert_true(a.camera.c2w[3] == 4 && a.camera.c2w[7] == 5 && a.camera.c2w[11] == 6);
    assert_true(a.budget == 0.045 && a.show == CLN_SHOW_DEPTH && !a.png);
    assert_true(a.background[0] == 1 && a.background[1] == 0 && a.background[2] == 0.25f);
    assert_int_equal(ask(CLN_ASK_PICTURE, &scene, of_view, &a), CLN_OK);
    assert_true(a.camera.width == 40 && a.camera.height == 30 && a.camera.fx == 50 &&
                a.camera.fy == 55 && a.view == 1);
    assert_true(a.camera.c2w[3] == 0); /* the painter takes the pose */
    assert_true(a.png && a.budget == 0 && a.background[1] == 0.5f && !a.edges);
    assert_int_equal(ask(CLN_ASK_POINT, &scene, point, &a), CLN_OK);
    assert_true(a.x == 79.5 && a.y == 0);
    assert_int_equal(ask(CLN_ASK_PHOTO, &scene, photo, &a), CLN_OK);
    assert_true(a.view == 1 && a.side == 64 && a.background[2] == 0.5f);
    assert_int_equal(ask(CLN_ASK_PHOTO, &scene, over_blue, &a), CLN_OK);
    assert_true(a.background[1] == 0 && a.background[2] == 1);
    assert_int_equal(ask(CLN_ASK_FILM_BEGIN, NULL, film, &a), CLN_OK);
    assert_true(a.width == 854 && a.height == 480 && a.frames == 96 && a.fps == 12.5);
    assert_int_equal(ask(CLN_ASK_FILM_FRAME, &scene, frame, &a), CLN_OK);
    assert_string_equal(a.film, NAME);
    assert_true(a.view == 0 && a.camera.width == 80 && a.show == CLN_SHOW_ERROR && a.budget == 0);
    assert_true(a.edges); /* a film takes its time */
    assert_true(a.crop.on && a.crop.box[0] == -1 && a.crop.box[4] == 2.5 && a.crop.box[5] == 3);
    for (int kind = CLN_ASK_FILM_END; kind < CLN_ASK_KINDS; kind++) {
        assert_int_equal(ask((cln_ask_kind)kind, NULL, end, &a), CLN_OK);
        assert_string_equal(a.film, NAME);
    }
#undef NAME
}

/* Sizes and positions are those of the picture as people see its photo; the camera's are those of
 * the stored one. */
static void read_turned_views(void **state)
{
    static const char *const of_width[] = {"view", "1", "width", "30", NULL};
    static const char *const of_height[] = {"view", "1", "height", "160", NULL};
    static const char *const point[] = {"view", "1", "x", "10", "y", "20", NULL};
    static const char *const low[] = {"view", "1", "x", "10", "y", "75", NULL};
    static const char *const right[] = {"view", "1", "x", "75", "y", "10", NULL};
    /* of 80 x 60 stored pixels: where the seen (10, 20) is */
    static const struct {
        int orientation;
        double x, y;
    } turns[] = {{1, 10, 20}, {3, 70, 40}, {6, 20, 50}, {8, 60, 10}};
    cln_view views[2];
    cln_scene scene;
    cln_ask a;

    (void)state;
    scene_of_two(views, &scene);
    for (size_t i = 0; i < sizeof turns / sizeof *turns; i++) {
        const bool lies = turns[i].orientation >= 5;

        views[1].orientation = turns[i].orientation;
        assert_int_equal(ask(CLN_ASK_POINT, &scene, point, &a), CLN_OK);
        assert_true(a.x == turns[i].x && a.y == turns[i].y);
        assert_int_equal(ask(CLN_ASK_POINT, &scene, low, &a), lies ? CLN_OK : CLN_USAGE);
        assert_int_equal(ask(CLN_ASK_POINT, &scene, right, &a), lies ? CLN_USAGE : CLN_OK);
        cln_clear_error();
        assert_int_equal(ask(CLN_ASK_PICTURE, &scene, of_width, &a), CLN_OK);
        assert_true(a.camera.width == (lies ? 40 : 30) && a.camera.height == (lies ? 30 : 23));
        assert_int_equal(ask(CLN_ASK_PICTURE, &scene, of_height, &a), CLN_OK);
        assert_true(a.camera.width == (lies ? 160 : 213) && a.camera.height == (lies ? 120 : 160));
    }
}

/* Of a view one side may be asked for; the other is not longer than a picture's may be, either. */
static void narrow_views_have_limits(void **state)
{
    static const char *const wide[] = {"view", "0", "width", "900", NULL};
    static const char *const high[] = {"view", "0", "height", "900", NULL};
    static const int sides[2] = {8, 80};
    cln_view views[2];
    cln_scene scene;
    cln_ask a;

    (void)state;
    scene_of_two(views, &scene);
    for (int lies = 0; lies < 2; lies++) {
        views[0].camera.width = sides[lies];
        views[0].camera.height = sides[!lies];
        assert_int_equal(ask(CLN_ASK_PICTURE, &scene, lies ? high : wide, &a), CLN_USAGE);
        assert_non_null(strstr(cln_error_text(), "too large"));
        cln_clear_error();
        assert_int_equal(ask(CLN_ASK_PICTURE, &scene, lies ? wide : high, &a), CLN_OK);
        assert_int_equal(lies ? a.camera.height : a.camera.width, 90);
    }
}

static void refuse_what_is_wrong(void **state)
{
#define POSE "pose", level_pose, "focal", "50"
    static const struct {
        cln_ask_kind kind;
        const char *query[16];
        const char *word;
    } cases[] = {
        {CLN_ASK_PICTURE, {NULL}, "width"},
        {CLN_ASK_PICTURE, {"width", "64", "height", "64"}, "pose"},
        {CLN_ASK_PICTURE, {"pose", level_pose, "width", "64", "height", "64"}, "focal"},
        {CLN_ASK_PICTURE, {POSE, "width", "8193", "height", "64"}, "width"},
        {CLN_ASK_PICTURE, {POSE, "width", "8192", "height", "8192"}, "too large"},
        {CLN_ASK_PICTURE, {POSE, "width", "64", "height", "8193"}, "height"},
        {CLN_ASK_PICTURE, {POSE, "width", "64", "height", "0"}, "height"},
        {CLN_ASK_PICTURE, {POSE, "width", "64", "height", "-1"}, "height"},
        {CLN_ASK_PICTURE, {POSE, "width", "64", "height", "6x"}, "height"},
        {CLN_ASK_PICTURE, {"pose", "1,0,0", "focal", "9", "width", "9", "height", "9"}, "pose"},
        {CLN_ASK_PICTURE,
         {"pose", "2,0,0,4,0,2,0,5,0,0,2,6", "focal", "9", "width", "9", "height", "9"},
         "rigid"},
        {CLN_ASK_PICTURE,
         {"pose", "1,0,0,1e300,0,1,0,5,0,0,1,6", "focal", "9", "width", "9", "height", "9"},
         "position"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "show", "../../etc"}, "show"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "format", "gif"}, "format"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "ms", "nan"}, "ms"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "ms", "-5"}, "ms"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "background", "2,0,0"}, "0 to 1"},
        {CLN_ASK_PICTURE, {POSE, "width", "9", "height", "9", "background", "red"}, "background"},
        {CLN_ASK_PICTURE, {"view", "2"}, "view"},
        {CLN_ASK_PICTURE, {"view", "-1"}, "view"},
        {CLN_ASK_PICTURE, {"view", "0", "width", "8000"}, "too large"},
        {CLN_ASK_POINT, {"view", "0", "x", "80.5", "y", "0"}, "x:"},
        {CLN_ASK_POINT, {"view", "0", "x", "3"}, "x, y"},
        {CLN_ASK_PHOTO, {NULL}, "view"},
        {CLN_ASK_PHOTO, {"view", "../scene.png"}, "view"},
        {CLN_ASK_PHOTO, {"view", "0", "side", "4096"}, "side"},
        {CLN_ASK_PICTURE, {"view", "0", "crop", "0,0,0,1,1"}, "crop"},
        {CLN_ASK_PICTURE, {"view", "0", "crop", "0,0,0,1,-1,1"}, "along y"},
        {CLN_ASK_POINT, {"view", "0", "x", "3", "y", "3", "crop", "0,0,0,0,1,1"}, "along x"},
        {CLN_ASK_FILM_BEGIN, {"width", "64", "height", "64"}, "frames"},
        {CLN_ASK_FILM_BEGIN, {"width", "64", "height", "8193", "frames", "9"}, "height"},
        {CLN_ASK_FILM_BEGIN, {"width", "64", "height", "64", "frames", "7201"}, "frames"},
        {CLN_ASK_FILM_BEGIN, {"width", "64", "height", "64", "frames", "9", "fps", "0"}, "fps"},
        {CLN_ASK_FILM_BEGIN, {"width", "3840", "height", "2160", "frames", "7200"}, "too large"},
        {CLN_ASK_FILM_BEGIN, {"width", "8192", "height", "8192", "frames", "1"}, "too large"},
        {CLN_ASK_FILM_FRAME, {"view", "0"}, "film"},
        {CLN_ASK_FILM_END, {"film", "../../etc/passwd"}, "film"},
        {CLN_ASK_FILM_FILE, {"film", "0123456789abcdef0123456789abcde/"}, "film"},
        {CLN_ASK_FILM_DROP, {"film", "0123456789abcdef0123456789abcdef0"}, "film"},
    };
#undef POSE
    static const char *const photo[] = {"view", "0", NULL};
    cln_view views[2];
    cln_scene scene;
    cln_ask a;

    (void)state;
    scene_of_two(views, &scene);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const cln_status st = ask(cases[i].kind, &scene, cases[i].query, &a);

        if (st == CLN_OK || !strstr(cln_error_text(), cases[i].word))
            fail_msg("case %zu: '%s', without '%s'", i, cln_error_text(), cases[i].word);
        cln_clear_error();
    }
    assert_int_equal(ask(CLN_ASK_PHOTO, NULL, photo, &a), CLN_USAGE); /* no scene */
    cln_clear_error();
}

/* Values that are pieces of right ones, joined and damaged, from a fixed seed. What is accepted
 * keeps the bounds. */
static const char *of_noise(void *query, const char *name)
{
    static const char *const words[] = {"1",
                                        "64",
                                        level_pose,
                                        "depth",
                                        "png",
                                        "1,0,0",
                                        "-1,-1,-1,0,1,1",
                                        "1e9",
                                        "0.5",
                                        "20",
                                        ",",
                                        "8192",
                                        "-1",
                                        "0",
                                        "..",
                                        "0123456789abcdef0123456789abcdef"};
    static char text[128];
    uint32_t *seed = query;
    int rounds = 0;

    (void)name;
    *seed = *seed * 1664525u + 1013904223u;
    if ((*seed >> 28) < 6)
        return NULL;
    rounds = 1 + ((*seed >> 24) % 5 == 0);
    text[0] = 0;
    for (int i = 0; i < rounds; i++) {
        *seed = *seed * 1664525u + 1013904223u;
        strncat(text, words[(*seed >> 20) % 16], sizeof text - strlen(text) - 1);
    }
    if ((*seed >> 8) % 7 == 0 && text[0])
        text[(*seed >> 12) % strlen(text)] = (char)(*seed >> 16);
    return text;
}

static void any_text_is_answered(void **state)
{
    cln_view views[2];
    cln_scene scene;
    uint32_t seed = 1;
    int accepted = 0;

    (void)state;
    scene_of_two(views, &scene);
    for (int i = 0; i < 200000; i++) {
        cln_ask a;

        if (cln_ask_read((cln_ask_kind)(i % CLN_ASK_KINDS), &scene, grey, of_noise, &seed, &a) !=
            CLN_OK) {
            assert_true(cln_error_text()[0] != 0);
            cln_clear_error();
            continue;
        }
        accepted++;
        assert_in_range(a.view + 1, 0, 2);
        if (a.kind == CLN_ASK_FILM_BEGIN) {
            assert_in_range(a.frames, 1, CLN_FILM_FRAMES);
            assert_true((int64_t)a.width * a.height <= CLN_ASK_PIXELS && a.fps >= 1);
            continue;
        }
        if (a.kind >= CLN_ASK_FILM_FRAME)
            assert_int_equal(strlen(a.film), CLN_FILM_NAME - 1);
        if (a.kind > CLN_ASK_FILM_FRAME)
            continue;
        if (a.kind == CLN_ASK_PHOTO) {
            assert_in_range(a.side, 16, CLN_ASK_PHOTO_SIDE);
            continue;
        }
        assert_in_range(a.camera.width, 1, CLN_ASK_SIDE);
        assert_in_range(a.camera.height, 1, CLN_ASK_SIDE);
        assert_true((int64_t)a.camera.width * a.camera.height <= CLN_ASK_PIXELS);
        for (int k = 0; k < 12; k++)
            assert_true(isfinite(a.camera.c2w[k]));
        assert_true(a.camera.fx > 0 && isfinite(a.camera.fx));
        assert_true(a.budget >= 0 && a.budget <= 60);
        for (int k = 0; k < 3 && a.crop.on; k++)
            assert_true(a.crop.box[k] < a.crop.box[3 + k]);
    }
    assert_in_range(accepted, 1000, 100000);
}

static void only_its_own_page_may_ask(void **state)
{
    static const struct {
        const char *host, *origin, *site;
        bool far, allowed;
    } cases[] = {
        {"127.0.0.1:7007", NULL, NULL, false, true},
        {"localhost:7007", NULL, NULL, false, true},
        {"LOCALHOST:8080", NULL, NULL, false, true}, /* ssh -L 8080:127.0.0.1:7007 */
        {"[::1]:7007", NULL, NULL, false, true},
        {"localhost", "http://localhost", "same-origin", false, true},
        {"localhost:7007", "http://localhost:7007", "none", false, true},
        {NULL, NULL, NULL, false, false},
        {"", NULL, NULL, false, false},
        {"evil.example:7007", NULL, NULL, false, false}, /* a name that resolves to 127.0.0.1 */
        {"127.0.0.1.evil.example", NULL, NULL, false, false},
        {"localhost.evil.example", NULL, NULL, false, false},
        {"localhost:7007:1", NULL, NULL, false, false},
        {"localhost:700777", NULL, NULL, false, false},
        {"localhost:7007@evil.example", NULL, NULL, false, false},
        {"[::1", NULL, NULL, false, false},
        {"10.0.0.2:7007", NULL, NULL, false, false},
        {"localhost:7007", "http://localhost:7008", NULL, false, false},
        {"localhost:7007", "http://evil.example", NULL, false, false},
        {"localhost:8000", "http://localhost:8000.evil.example", NULL, false, false},
        {"localhost", "http://localhost.evil.example", NULL, false, false},
        {"localhost:7007", "null", NULL, false, false},
        {"localhost:7007", NULL, "cross-site", false, false},
        {"localhost:7007", NULL, "same-site", false, false},
        {"10.0.0.2:7007", NULL, NULL, true, true},
        {"[fe80::1]:7007", NULL, NULL, true, true},
        {"box:7007", NULL, NULL, true, true},
        {"box.home.example:7007", "https://box.home.example:7007", NULL, true, true},
        {"robot.local:8080", NULL, NULL, true, true}, /* a container's port, by another name */
        {"robot.local:8080", "http://robot.local:8080", "same-origin", true, true},
        {"robot.local:8080", "http://evil.example:8080", NULL, true, false},
        {"robot.local:8080", NULL, "cross-site", true, false},
        {"robot.local@evil.example:1", NULL, NULL, true, false},
        {"", NULL, NULL, true, false},
    };

    const char open[8] = "[::1"; /* and no byte behind it that would be refused */

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *reason = NULL;
        const bool allowed =
            cln_ask_allowed(cases[i].host, cases[i].origin, cases[i].site, cases[i].far, &reason);

        if (allowed != cases[i].allowed)
            fail_msg("case %zu, Host %s: %s", i, cases[i].host ? cases[i].host : "none",
                     allowed ? "allowed" : reason);
    }
    assert_true(cln_ask_same_token("0123abcd", "0123abcd"));
    assert_false(cln_ask_allowed(open, NULL, NULL, false, &(const char *){NULL}));
    for (int i = 0; i < 8; i++) { /* a wrong digit at any place */
        char given[] = "0123abcd";

        given[i] ^= 1;
        assert_false(cln_ask_same_token(given, "0123abcd"));
    }
    assert_false(cln_ask_same_token("0123abc", "0123abcd"));
    assert_false(cln_ask_same_token("", "0123abcd"));
    assert_false(cln_ask_same_token(NULL, "0123abcd"));
    assert_false(cln_ask_same_token(NULL, NULL));
}

/* A page looks at a part of a panorama: a quarter of it, across its picture. */
static void facts_have_focal_lengths(void **state)
{
    const cln_model model = {.space = {.half = 1}};
    const cln_orbit_frame frame = {.up = {0, 0, 1}, .distance = 4};
    const cln_camera start = {.width = 4, .height = 3, .fx = 2, .fy = 2};
    cln_view views[2];
    cln_scene scene;
    json_t *document = NULL;
    char *text = NULL;

    (void)state;
    scene_of_two(views, &scene);
    views[0].name = "photo";
    views[1].name = "around";
    views[1].camera.lens = CLN_LENS_EQUIRECTANGULAR;
    assert_int_equal(
        cln_facts_text(
            &(cln_facts){
                .run = "run", .model = &model, .scene = &scene, .frame = &frame, .start = &start},
            &text),
        CLN_OK);
    document = json_loads(text, 0, NULL);
    assert_non_null(document);
    for (int i = 0; i < 2; i++) {
        const json_t *camera = json_array_get(json_object_get(document, "cameras"), (size_t)i);

        assert_int_equal(json_is_true(json_object_get(camera, "around")), i);
        assert_true(json_number_value(json_object_get(camera, "focal")) ==
                    (i ? 0.5 * views[i].camera.width : views[i].camera.fy));
    }
    json_decref(document);
    free(text);
}

int test_group_view_request(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(read_what_is_asked),       cmocka_unit_test(read_turned_views),
        cmocka_unit_test(narrow_views_have_limits), cmocka_unit_test(refuse_what_is_wrong),
        cmocka_unit_test(any_text_is_answered),     cmocka_unit_test(only_its_own_page_may_ask),
        cmocka_unit_test(facts_have_focal_lengths),
    };

    return cmocka_run_group_tests_name("view_request", tests, NULL, NULL);
}
