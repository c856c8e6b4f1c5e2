/* Which way is up, of cameras whose headings and tilts are known: orbits about an object, flights
 * over land, photos from the front. No device. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <cmocka.h>
#include "draws.h"
#include "base/log.h"
#include "render/frames.h"
#include "render/orbit.h"
#include "scene/vectors.h"
#include "tests.h"

static const double DEGREE = 3.14159265358979323846 / 180;
enum { MOST = 128, TRIES = 20 };

typedef struct shots {
    cln_scene scene;
    cln_view views[MOST];
    uint64_t seed;
    int draw;
} shots;

/* Within +-most degrees, evenly. */
static double scatter(shots *s, double most)
{
    return uniform(s->seed, s->draw++, -most, most);
}

static void begin(shots *s, uint64_t seed)
{
    memset(s, 0, sizeof *s);
    s->seed = seed;
    s->scene.views = s->views;
    s->scene.space.half = 10;
}

/* A camera that faces `heading` (degrees from x to y), looks `pitch` degrees up from the horizon,
 * and is rolled about its axis. */
static void shoot(shots *s, const double at[3], double heading, double pitch, double roll)
{
    const double ch = cos(heading * DEGREE), sh = sin(heading * DEGREE), cp = cos(pitch * DEGREE),
                 sp = sin(pitch * DEGREE), cr = cos(roll * DEGREE), sr = sin(roll * DEGREE);
    const double forward[3] = {cp * ch, cp * sh, sp}, right[3] = {sh, -ch, 0};
    double down[3], x[3], y[3];
    cln_camera *c = &s->views[s->scene.view_count++].camera;

    cln_cross(forward, right, down);
    for (int a = 0; a < 3; a++) {
        x[a] = cr * right[a] + sr * down[a];
        y[a] = cr * down[a] - sr * right[a];
    }
    cln_pose_of_axes(x, y, forward, at, c->c2w);
    c->width = c->height = 10;
    c->fx = c->fy = 10;
}

/* Degrees between up and the zenith. */
static double off(const shots *s)
{
    double up[3];

    cln_up_of_cameras(&s->scene, up);
    assert_true(fabs(cln_dot(up, up) - 1) < 1e-9);
    return acos(fmax(-1, fmin(1, up[2]))) / DEGREE;
}

/* Lines to and fro, and then across, 13 photos each, with the scatter of a flight in wind. tilt:
 * how far before the nadir the camera looks. */
static void fly(shots *s, int lines, int across, double tilt)
{
    for (int line = 0; line < lines + across; line++) {
        const double heading = 180.0 * (line % 2) + (line < lines ? 0 : 90);

        for (int k = 0; k < 13; k++)
            shoot(s, (const double[3]){k, line, 50}, heading + scatter(s, 5),
                  -90 + tilt + scatter(s, 3), scatter(s, 3));
    }
}

static void test_flights(void **state)
{
    static const struct {
        int lines, across;
        double tilt, most; /* degrees */
    } flights[] = {{6, 0, 0, 5},  {5, 0, 0, 5},  {3, 0, 0, 5},   {2, 0, 0, 5},   {4, 4, 0, 5},
                   {3, 3, 0, 5},  {6, 0, 5, 5},  {6, 0, 15, 5},  {5, 0, 15, 5},  {5, 0, 45, 5},
                   {4, 4, 15, 5}, {4, 4, 45, 5}, {6, 0, -5, 5},  {4, 4, -5, 5},  {3, 0, 30, 5},
                   {5, 0, 60, 5}, {4, 4, 60, 5}, {6, 0, -10, 5}, {4, 4, -10, 5}, {3, 3, 25, 5}};

    (void)state;
    for (size_t i = 0; i < sizeof flights / sizeof *flights; i++) {
        for (int seed = 0; seed < TRIES; seed++) {
            shots s;

            begin(&s, (uint64_t)seed);
            fly(&s, flights[i].lines, flights[i].across, flights[i].tilt);
            if (!(off(&s) < flights[i].most))
                fail_msg("%d lines, %d across, tilt %g, seed %d: up is off by %g degrees",
                         flights[i].lines, flights[i].across, flights[i].tilt, seed, off(&s));
        }
    }
}

/* Around an object or in a room, in circles and arcs, also from below; a dome of all heights. */
static void test_orbits(void **state)
{
    static const double pitches[] = {-80, -60, -30, 0, 30, 60, 70};

    (void)state;
    for (size_t i = 0; i < sizeof pitches / sizeof *pitches; i++) {
        for (int arc = 90; arc <= 360; arc += 90) {
            shots level, held;

            begin(&level, 1);
            begin(&held, 2);
            for (int k = 0; k < 24; k++) {
                const double heading = arc * k / 24.0;
                const double at[3] = {-5 * cos(heading * DEGREE), -5 * sin(heading * DEGREE), 0};

                shoot(&level, at, heading, pitches[i], 0);
                shoot(&held, at, heading + scatter(&held, 5), pitches[i] + scatter(&held, 5),
                      scatter(&held, 3));
            }
            if (!(off(&level) < 2 && off(&held) < 6))
                fail_msg("pitch %g, arc %d: up is off by %g and %g degrees", pitches[i], arc,
                         off(&level), off(&held));
        }
    }
}

/* A strip of land whose photos are level but for a degree: the zenith or what lies ahead, but never
 * the nadir. */
static void test_strip(void **state)
{
    (void)state;
    for (int seed = 0; seed < TRIES; seed++) {
        shots s;

        begin(&s, (uint64_t)seed);
        for (int k = 0; k < 10; k++)
            shoot(&s, (const double[3]){k, 0, 50}, scatter(&s, 30), -90 + scatter(&s, 2),
                  scatter(&s, 1));
        assert_true(off(&s) < 120);
    }
}

/* Photos that all face one way: up is about that of the pictures, whichever way they are tilted;
 * how level they are held tells little. */
static void test_one_way(void **state)
{
    static const double pitches[] = {-90, -40, 0, 40};

    (void)state;
    for (size_t i = 0; i < sizeof pitches / sizeof *pitches; i++) {
        shots s;
        double up[3];

        begin(&s, 3);
        for (int k = 0; k < 20; k++)
            shoot(&s, (const double[3]){0, k % 5, 0.1 * k}, scatter(&s, 3),
                  pitches[i] + scatter(&s, 3), scatter(&s, 2));
        cln_up_of_cameras(&s.scene, up);
        assert_true(up[0] * -sin(pitches[i] * DEGREE) + up[2] * cos(pitches[i] * DEGREE) >
                    cos(30 * DEGREE));
    }
}

/* A given up, and a frame of an older run that is turned to it: upside down, it becomes the one of
 * the cameras themselves. */
static void test_given(void **state)
{
    const double none[3] = {0}, z[3] = {0, 0, 2}, nadir[3] = {0, 0, -1};
    cln_orbit_frame own, told, turned;
    shots s;

    (void)state;
    begin(&s, 4);
    for (int k = 0; k < 10; k++) {
        const double turn = 12 * k * DEGREE, at[3] = {-4 * cos(turn), -4 * sin(turn), 2};

        shoot(&s, at, 12 * k, -26.565051177, 0);
    }
    assert_int_equal(cln_orbit_frame_of(&s.scene, none, &own), CLN_OK);
    assert_int_equal(cln_orbit_frame_of(&s.scene, z, &told), CLN_OK);
    assert_true(own.elevation > 20 && told.up[2] == 1);
    assert_true(fabs(own.elevation - told.elevation) < 0.1 && fabs(own.to - told.to) < 0.1);
    assert_int_equal(cln_orbit_frame_of(&s.scene, nadir, &turned), CLN_OK);
    assert_true(turned.up[2] == -1 && turned.elevation < -20);
    cln_orbit_frame_turn(none, &turned);
    assert_true(turned.up[2] == -1);
    cln_orbit_frame_turn(z, &turned);
    assert_true(fabs(turned.elevation - told.elevation) < 1e-9);
    assert_true(fabs(turned.from - told.from) < 1e-9 && fabs(turned.to - told.to) < 1e-9);
    for (int a = 0; a < 3; a++) {
        assert_true(fabs(turned.up[a] - told.up[a]) < 1e-12);
        assert_true(fabs(turned.north[a] - told.north[a]) < 1e-12);
        assert_true(fabs(turned.east[a] - told.east[a]) < 1e-12);
    }
}

static void test_texts(void **state)
{
    static const struct {
        const char *text;
        double up[3];
    } good[] = {{"z", {0, 0, 1}}, {"-x", {-1, 0, 0}}, {"0.5,-2,1e3", {0.5, -2, 1e3}}};
    static const char *const bad[] = {"",    "-",       "w",        "zz",        "-z,", "0,0,0",
                                      "1,2", "1,2,3,4", "1e99,0,0", "1e-12,0,0", "+z",  "nan,0,1"};
    double up[3];

    (void)state;
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        assert_int_equal(cln_up_read("--up", good[i].text, up), CLN_OK);
        assert_memory_equal(up, good[i].up, sizeof up);
    }
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        if (cln_up_read("--up", bad[i], up) != CLN_USAGE || !strstr(cln_error_text(), "--up"))
            fail_msg("'%s' is taken, or not refused by name", bad[i]);
        cln_clear_error();
    }
}

static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN)
        snprintf(user, 512, "%s", line);
}

/* What `render --orbit` warns of, by the frame in run.json. */
static void warning_of_orbit(const cln_orbit_frame *frame, char text[512])
{
    const cln_render_desc desc = {.orbit_frames = 3, .orbit_elevation = NAN};
    json_t *run = json_pack("{s:o}", "orbit", cln_orbit_frame_json(frame));
    cln_frames frames;

    text[0] = 0;
    cln_log_set_sink(keep_warning, text);
    assert_int_equal(cln_frames_make(&desc, NULL, run, &frames), CLN_OK);
    cln_log_set_sink(NULL, NULL);
    cln_frames_free(&frames);
    json_decref(run);
}

/* Two rounds about an object that was turned over for the second: if they are about as many,
 * nothing tells which way is up; it is that of the first photo. */
static void test_turned_over(void **state)
{
    static const struct {
        int upright, turned; /* photos, in this order or the other */
        bool sure;
    } passes[] = {{18, 18, false}, {20, 18, false}, {18, 20, false}, {24, 8, true}, {8, 24, true}};

    (void)state;
    for (size_t i = 0; i < sizeof passes / sizeof *passes; i++) {
        const int n[2] = {passes[i].upright, passes[i].turned};
        const double wanted = passes[i].sure && n[1] > n[0] ? -1 : 1;
        char text[512] = "";
        cln_orbit_frame frame, again;
        json_t *saved = NULL;
        double up[3];
        shots s;

        begin(&s, i);
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < n[pass]; k++) {
                const double heading = 360.0 * k / n[pass] + scatter(&s, 2);
                const double high = pass ? -3 : 3;
                const double at[3] = {-5 * cos(heading * DEGREE), -5 * sin(heading * DEGREE), high};

                shoot(&s, at, heading, pass ? 31 : -31, pass ? 180 : 0);
            }
        if (cln_up_of_cameras(&s.scene, up) != passes[i].sure || up[2] * wanted < 0.99)
            fail_msg("%d and %d photos: up is %g,%g,%g", n[0], n[1], up[0], up[1], up[2]);
        assert_int_equal(cln_orbit_frame_of(&s.scene, (const double[3]){0}, &frame), CLN_OK);
        assert_int_equal(frame.guessed, !passes[i].sure);
        saved = cln_orbit_frame_json(&frame);
        assert_int_equal(cln_orbit_frame_read(saved, &again), CLN_OK);
        assert_memory_equal(&frame, &again, sizeof frame);
        json_decref(saved);
        warning_of_orbit(&again, text);
        assert_int_equal(passes[i].sure, !strstr(text, "is a guess"));
        if (!passes[i].sure) {
            assert_int_equal(
                sscanf(strstr(text, "--up="), "--up=%lf,%lf,%lf", &up[0], &up[1], &up[2]), 3);
            assert_true(up[2] * wanted < -0.9);
        }
        cln_orbit_frame_turn((const double[3]){0, 0, 1}, &again);
        warning_of_orbit(&again, text);
        assert_null(strstr(text, "is a guess"));
        assert_int_equal(cln_orbit_frame_of(&s.scene, (const double[3]){0, 0, 1}, &again), CLN_OK);
        assert_false(again.guessed);
    }
}

int test_group_up(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_flights), cmocka_unit_test(test_orbits),
        cmocka_unit_test(test_one_way), cmocka_unit_test(test_strip),
        cmocka_unit_test(test_given),   cmocka_unit_test(test_turned_over),
        cmocka_unit_test(test_texts)};

    return cmocka_run_group_tests_name("up", tests, NULL, NULL);
}
