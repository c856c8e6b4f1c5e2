/* Which way is up, of cameras whose headings and tilts are known: orbits about an object, flights
 * over land, photos from the front. No device. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "api/place_turn.h"
#include "base/log.h"
#include "draws.h"
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

/* The flight's own up, whatever frame its poses are in, as structure from motion has any. */
static void test_any_frame(void **state)
{
    enum { FRAMES = 40 };

    (void)state;
    for (int seed = 0; seed < FRAMES; seed++) {
        shots s;
        double level[3], up[3], turn[9];
        bool sure = false;

        begin(&s, (uint64_t)seed);
        fly(&s, seed % 2 ? 6 : 3, seed % 4 < 2 ? 0 : 3, seed % 3 * 10);
        sure = cln_up_of_cameras(&s.scene, level);
        for (int a = 0; a < 6; a++)
            turn[a] = scatter(&s, 1);
        cln_cross(turn, turn + 3, turn + 6);
        cln_cross(turn + 6, turn, turn + 3);
        for (int a = 0; a < 9; a += 3)
            assert_true(cln_normalise(turn + a));
        for (int i = 0; i < s.scene.view_count; i++) {
            double *m = s.views[i].camera.c2w;

            for (int c = 0; c < 4; c++) {
                const double column[3] = {m[c], m[4 + c], m[8 + c]};

                for (int a = 0; a < 3; a++)
                    m[4 * a + c] = cln_dot(turn + 3 * a, column);
            }
        }
        assert_int_equal(cln_up_of_cameras(&s.scene, up), sure);
        for (int a = 0; a < 3; a++)
            assert_float_equal(up[a], cln_dot(turn + 3 * a, level), 0.002); /* 0.1 degrees */
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

/* Photo i as a phone stores it that writes this orientation: not turned. */
static void store(shots *s, int i, int orientation)
{
    cln_view *v = &s->views[i];
    cln_camera *c = &v->camera;
    const int width = c->width;

    v->orientation = orientation;
    for (int a = 0; a < 3; a++) {
        const double x = c->c2w[4 * a], y = c->c2w[4 * a + 1];

        /* 6: the stored first row is seen at the right, the first column above */
        c->c2w[4 * a] = orientation == 6 ? y : orientation == 8 ? -y : orientation == 3 ? -x : x;
        c->c2w[4 * a + 1] = orientation == 6   ? -x
                            : orientation == 8 ? x
                            : orientation == 3 ? -y
                                               : y;
    }
    if (orientation < 5)
        return;
    c->width = c->height;
    c->height = width;
}

static void assert_same_frame(const cln_orbit_frame *a, const cln_orbit_frame *b)
{
    for (int k = 0; k < 3; k++) {
        assert_true(a->target[k] == b->target[k] && a->up[k] == b->up[k]);
        assert_true(a->east[k] == b->east[k] && a->north[k] == b->north[k]);
    }
    assert_true(a->distance == b->distance && a->elevation == b->elevation);
    assert_true(a->from == b->from && a->to == b->to && a->guessed == b->guessed);
    assert_true(a->width == b->width && a->height == b->height);
    assert_true(a->fx == b->fx && a->fy == b->fy);
}

/* A phone held upright around an object: its photos lie as they are stored, all of them, or some,
 * and one turned over. Up, orbits and spirals are those of the photos as people see them, to the
 * bit, and a path between their poses does not lie down. */
static void test_phone(void **state)
{
    static const int ways[][4] = {{6, 6, 6, 6}, {8, 8, 8, 8}, {6, 8, 1, 3}, {1, 6, 1, 6}};
    const double none[3] = {0};
    const cln_render_desc spiral = {.spiral_frames = 7, .orbit_radius = 1};
    const cln_render_desc path = {.split = "train", .interpolate = 30};

    (void)state;
    for (size_t w = 0; w < sizeof ways / sizeof *ways; w++) {
        shots seen, stored;
        cln_orbit_frame upright, lying;
        cln_frames a = {0}, b = {0};

        begin(&seen, w);
        for (int k = 0; k < 24; k++) {
            const double heading = 15 * k + scatter(&seen, 2);
            const double at[3] = {-4 * cos(heading * DEGREE), -4 * sin(heading * DEGREE), 1};
            cln_camera *c = &seen.views[k].camera;

            seen.views[k].file = (char *)"photo";
            shoot(&seen, at, heading, -14 + scatter(&seen, 2), scatter(&seen, 1));
            c->width = 9;
            c->height = 16;
            c->cx = 4.5;
            c->cy = 8;
        }
        stored = seen;
        stored.scene.views = stored.views;
        for (int k = 0; k < 24; k++)
            store(&stored, k, ways[w][k % 4]);
        assert_true(off(&stored) < 1);
        assert_int_equal(cln_orbit_frame_of(&seen.scene, none, &upright), CLN_OK);
        assert_int_equal(cln_orbit_frame_of(&stored.scene, none, &lying), CLN_OK);
        assert_true(lying.width == 9 && lying.height == 16);
        assert_same_frame(&upright, &lying);
        for (int k = 0; k < 2; k++) {
            const cln_render_desc *desc = k ? &path : &spiral;

            assert_int_equal(cln_frames_make(desc, &seen.scene, NULL, &a), CLN_OK);
            assert_int_equal(cln_frames_make(desc, &stored.scene, NULL, &b), CLN_OK);
            assert_int_equal(a.count, b.count);
            for (int i = 0; i < a.count; i++) {
                assert_true(b.frame[i].camera.width == 9 && b.frame[i].camera.height == 16);
                for (int m = 0; m < 12; m++)
                    assert_true(a.frame[i].camera.c2w[m] == b.frame[i].camera.c2w[m]);
            }
            cln_frames_free(&a);
            cln_frames_free(&b);
        }
    }
}

/* Pictures of a path have the shape of most photos as people see them, be the first one another;
 * without any tag the first one's, as ever. */
static void test_shapes(void **state)
{
    static const struct {
        int orientation[4]; /* of photos stored 16 x 9 */
        int width, height;
    } sets[] = {{{6, 6, 6, 6}, 9, 16}, {{1, 6, 8, 6}, 9, 16}, {{6, 1, 1, 3}, 16, 9},
                {{1, 6, 1, 6}, 16, 9}, {{6, 1, 6, 1}, 9, 16}, {{1, 1, 1, 1}, 16, 9}};
    cln_orbit_frame frame;
    shots s;

    (void)state;
    for (size_t i = 0; i <= sizeof sets / sizeof *sets; i++) {
        begin(&s, i);
        for (int k = 0; k < 4; k++) {
            cln_camera *c = &s.views[k].camera;

            shoot(&s, (const double[3]){k, 0, 0}, 90, 0, 0);
            c->width = 16;
            c->height = 9;
            c->fx = 12;
            c->fy = 13;
            if (i < sizeof sets / sizeof *sets)
                s.views[k].orientation = sets[i].orientation[k];
            else if (k > 0) /* three upright ones, as they are stored */
                c->height = 20;
        }
        assert_int_equal(cln_orbit_frame_of(&s.scene, (const double[3]){0}, &frame), CLN_OK);
        if (i < sizeof sets / sizeof *sets)
            assert_true(frame.width == sets[i].width && frame.height == sets[i].height);
        else
            assert_true(frame.width == 16 && frame.height == 9);
        assert_true(frame.fx == (frame.width == 16 ? 12 : 13));
        assert_true(frame.fy == (frame.width == 16 ? 13 : 12));
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

/* Cameras all around, in a frame that leans by `lean` degrees from an axis of the scene, to either
 * side: as near as 0.1 degrees the axis itself is up, further away not, nor what is given. */
static void test_at_axis(void **state)
{
    static const double leans[] = {0.002, 0.09, 0.11, 1};

    (void)state;
    for (int i = 0; i < 4 * 6; i++) {
        const double lean = leans[i / 6] * DEGREE, none[3] = {0};
        const int axis = i % 3, sign = i / 3 % 2 ? -1 : 1;
        double leaning[3] = {0};
        cln_orbit_frame own, given;
        shots s;

        begin(&s, 5);
        for (int k = 0; k < 24; k++) {
            const double turn = 15 * k * DEGREE, at[3] = {-4 * cos(turn), -4 * sin(turn), 2};
            double *m = s.views[s.scene.view_count].camera.c2w;

            shoot(&s, at, 15 * k, -26.565051177, 0);
            for (int c = 0; c < 4; c++) { /* z leans towards x, and becomes the axis */
                const double x = m[c], y = m[4 + c], z = m[8 + c];

                m[4 * ((axis + 1) % 3) + c] = sign * (cos(lean) * x + sin(lean) * z);
                m[4 * ((axis + 2) % 3) + c] = y;
                m[4 * axis + c] = sign * (cos(lean) * z - sin(lean) * x);
            }
        }
        leaning[axis] = sign * cos(lean);
        leaning[(axis + 1) % 3] = sign * sin(lean);
        assert_int_equal(cln_orbit_frame_of(&s.scene, none, &own), CLN_OK);
        assert_int_equal(cln_orbit_frame_of(&s.scene, leaning, &given), CLN_OK);
        for (int a = 0; a < 3; a++) {
            const double wanted = i / 6 < 2 ? (a == axis ? sign : 0) : leaning[a];

            if (!(fabs(own.up[a] - wanted) <= (i / 6 < 2 ? 0 : 1e-6)) ||
                !(fabs(given.up[a] - leaning[a]) < 1e-12))
                fail_msg("leaning by %g from axis %d: up has %.9g, not %.9g", leans[i / 6], axis,
                         own.up[a], wanted);
        }
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

/* An orbit leaves a path that its cameras look along: it is told; not where they stand abreast. */
static void test_leaves_path(void **state)
{
    const cln_render_desc orbit = {.orbit_frames = 2, .orbit_elevation = NAN};

    (void)state;
    for (int ahead = 0; ahead < 2; ahead++) {
        shots s;
        cln_frames f = {0};
        char text[512] = "";

        begin(&s, 5);
        for (int k = 0; k < 12; k++)
            shoot(&s, (const double[3]){ahead ? k : 0, ahead ? 0 : k, 0}, scatter(&s, 5), 0, 0);
        cln_log_set_sink(keep_warning, text);
        assert_int_equal(cln_frames_make(&orbit, &s.scene, NULL, &f), CLN_OK);
        cln_log_set_sink(NULL, NULL);
        assert_int_equal(strstr(text, "--split train --interpolate") != NULL, ahead);
        cln_frames_free(&f);
    }
}

/* What cameras tell by themselves, and that they are asked where up is by GPS. */
static void test_told(void **state)
{
    const double lean = 8 * DEGREE;
    double up[3];
    cln_up_told told;
    shots s;

    (void)state;
    for (int seed = 0; seed < TRIES; seed++) {
        begin(&s, (uint64_t)seed);
        fly(&s, 6, 0, 5);
        cln_up_tell(&s.scene, &told);
        assert_int_equal(told.what, CLN_UP_TOLD);
        assert_true(told.up[2] > cos(3 * DEGREE) && told.sd < 2 * DEGREE);
        memcpy(s.scene.up, (const double[3]){0, 0, 1}, sizeof s.scene.up);
        s.scene.up_by_gps = true;
        assert_true(cln_up_of_cameras(&s.scene, up));
        assert_true(up[2] > cos(3 * DEGREE));
        memcpy(s.scene.up, (const double[3]){sin(lean), 0, cos(lean)}, sizeof s.scene.up);
        assert_true(cln_up_of_cameras(&s.scene, up));
        assert_true(up[2] > cos(3 * DEGREE));
        s.scene.up_by_gps = false;
        assert_true(cln_up_of_cameras(&s.scene, up));
        assert_memory_equal(up, s.scene.up, sizeof up);
        begin(&s, (uint64_t)seed); /* one way, which its cameras look along and down */
        for (int k = 0; k < 20; k++)
            shoot(&s, (const double[3]){k, 0, 50}, scatter(&s, 5), -70 + scatter(&s, 3),
                  scatter(&s, 3));
        cln_up_tell(&s.scene, &told);
        assert_int_equal(told.what, CLN_UP_LEVEL);
        assert_true(fabs(told.level[1]) > cos(3 * DEGREE) && told.rough[2] > 0.1);
        memcpy(s.scene.up, (const double[3]){sin(lean), 0, cos(lean)}, sizeof s.scene.up);
        s.scene.up_by_gps = true;
        assert_true(cln_up_of_cameras(&s.scene, up));
        assert_memory_equal(up, s.scene.up, sizeof up);
    }
    begin(&s, 1); /* held anyhow */
    for (int k = 0; k < 12; k++)
        shoot(&s, (const double[3]){k, 0, 0}, scatter(&s, 180), scatter(&s, 60), scatter(&s, 90));
    cln_up_tell(&s.scene, &told);
    assert_int_equal(told.what, CLN_UP_UNTOLD);
}

/* Along one line, which climbs, with cameras that look along it: by GPS and their level x axes they
 * are placed as they stand, or not at all, as where half a turn about the line fits as well. */
static void test_placed_line(void **state)
{
    enum { LINE = 30 };
    static const struct {
        double pitch, climb;
        bool taken;
    } lines[] = {{-90, 0, true},   {-60, 0, true},   {0, 0, true},    {50, 0, true},
                 {60, 0, true},    {66, 0, true},    {72, 0, false},  {-60, 20, true},
                 {-60, 50, false}, {-30, 60, false}, {-20, 70, false}};

    (void)state;
    for (size_t l = 0; l < sizeof lines / sizeof *lines; l++)
        for (int seed = 0; seed < TRIES; seed++) {
            const double c = cos(lines[l].climb * DEGREE), e = sin(lines[l].climb * DEGREE);
            double from[LINE][3], to[LINE][3];
            cln_place_turn turn;
            cln_up_told told;
            bool taken = false;
            shots s;

            begin(&s, (uint64_t)seed);
            for (int k = 0; k < LINE; k++) {
                const double along = -100 + 200.0 * k / (LINE - 1);
                const double at[3] = {along * c, scatter(&s, 0.5), along * e + scatter(&s, 0.5)};

                shoot(&s, at, scatter(&s, 4), lines[l].pitch + scatter(&s, 4), scatter(&s, 2));
                memcpy(from[k], at, sizeof at);
                for (int a = 0; a < 3; a++)
                    to[k][a] = at[a] + scatter(&s, 3.5);
            }
            cln_up_tell(&s.scene, &told);
            assert_int_equal(told.what, CLN_UP_LEVEL);
            assert_int_equal(cln_place_turn_find(LINE, from, to, &told, &turn), CLN_OK);
            taken = turn.up < 10 && turn.north < 10;
            if (taken != lines[l].taken)
                fail_msg("pitch %g, climb %g, seed %d: up to %g, north to %g", lines[l].pitch,
                         lines[l].climb, seed, turn.up, turn.north);
            if (taken) {
                assert_true(turn.to.turn[8] > cos(6 * DEGREE));
                assert_true(fabs(atan2(turn.to.turn[3], turn.to.turn[0])) < 6 * DEGREE);
            }
        }
}

int test_group_up(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_flights),     cmocka_unit_test(test_orbits),
        cmocka_unit_test(test_one_way),     cmocka_unit_test(test_strip),
        cmocka_unit_test(test_at_axis),     cmocka_unit_test(test_given),
        cmocka_unit_test(test_turned_over), cmocka_unit_test(test_texts),
        cmocka_unit_test(test_phone),       cmocka_unit_test(test_shapes),
        cmocka_unit_test(test_any_frame),   cmocka_unit_test(test_leaves_path),
        cmocka_unit_test(test_told),        cmocka_unit_test(test_placed_line)};

    return cmocka_run_group_tests_name("up", tests, NULL, NULL);
}
