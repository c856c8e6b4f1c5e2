/* What `render` shows: files of poses against cameras worked out by hand, and paths by what they
 * must keep: ends, pace, distance, direction. No device. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "render/frames.h"
#include "scene/vectors.h"
#include "scratch.h"
#include "tests.h"

static const double DEGREE = 3.14159265358979323846 / 180;
static const cln_frame_sizes NO_SIZES, SIZES = {40, 30, 80, 61, false}; /* photos are halved */

static const char *put(void **state, const char *text)
{
    const char *path = scratch_path(*state, "poses.json");

    scratch_put(path, text, strlen(text));
    return path;
}

static void refuses(void **state, const char *text, const char *word)
{
    cln_frames frames = {0};
    const cln_status st = cln_frames_read(put(state, text), &SIZES, &frames);

    if (st != CLN_INPUT || !strstr(cln_error_text(), word))
        fail_msg("%s: '%s' does not name '%s'", cln_status_phrase(st), cln_error_text(), word);
    cln_clear_error();
    cln_frames_free(&frames);
}

#define POSE(matrix, rest) "{\"camera_to_world\": [" matrix "]" rest "}"
#define PLAIN              "1,0,0,2, 0,1,0,3, 0,0,1,4, 0,0,0,1"
#define FILM(poses)        "{\"render_width\": 200, \"render_height\": 100, " poses "}"

static void test_camera_path(void **state)
{
    static const double want[12] = {1, 0, 0, 2, 0, -1, 0, 3, 0, 0, -1, 4}; /* OpenCV's axes */
    cln_frames f = {0};

    assert_int_equal(
        cln_frames_read(
            put(state,
                FILM("\"fps\": 30, \"camera_path\": [" POSE(
                    PLAIN, ", \"fov\": 90, "
                           "\"aspect\": 2") "," POSE("[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]",
                                                     ", \"fov\": 60") "]")),
            &NO_SIZES, &f),
        CLN_OK);
    assert_true(f.count == 2 && f.fps == 30);
    assert_string_equal(f.frame[1].name, "path_0001");
    for (int i = 0; i < 2; i++) {
        const cln_camera *c = &f.frame[i].camera;

        assert_memory_equal(c->c2w, want, sizeof want);
        assert_true(c->width == 200 && c->height == 100 && c->cx == 100 && c->cy == 50);
        assert_true(fabs(c->fx - 50 / tan((i ? 30 : 45) * DEGREE)) < 1e-9 && c->fy == c->fx);
        assert_false(cln_camera_is_distorted(c));
    }
    cln_frames_free(&f);
    assert_int_equal(cln_frames_read(put(state, FILM("\"camera_type\": \"fisheye\", \"camera_path\""
                                                     ": [" POSE(PLAIN, ", \"fov\": 90") "]")),
                                     &NO_SIZES, &f),
                     CLN_OK);
    assert_int_equal(f.frame[0].camera.lens, CLN_LENS_OPENCV_FISHEYE);
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_read(put(state, "{\"camera_type\": \"equirectangular\", \"camera_path\": [" POSE(
                                       PLAIN, "") "]}"),
                        &SIZES, &f),
        CLN_OK);
    assert_int_equal(f.frame[0].camera.lens, CLN_LENS_EQUIRECTANGULAR);
    assert_true(f.frame[0].camera.width == 40 && f.fps == 0);
    cln_frames_free(&f);
}

/* Without fps a film lasts the file's seconds, as nerfstudio's. */
static void test_seconds(void **state)
{
    static const struct {
        const char *keys;
        double fps;
    } rows[] = {{"\"seconds\": 0.5, ", 4},
                {"\"seconds\": 0.5, \"fps\": 30, ", 30},
                {"\"seconds\": 0, ", 0}};

    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        char text[1024];
        cln_frames f = {0};

        snprintf(text, sizeof text, "{%s\"camera_path\": [%s, %s]}", rows[i].keys,
                 POSE(PLAIN, ", \"fov\": 90"), POSE(PLAIN, ", \"fov\": 60"));
        assert_int_equal(cln_frames_read(put(state, text), &SIZES, &f), CLN_OK);
        assert_true(f.fps == rows[i].fps);
        cln_frames_free(&f);
    }
}

#define CROPPED(rest) FILM("\"camera_path\": [" POSE(PLAIN, ", \"fov\": 90") "], \"crop\": " rest)

/* A file's crop box: middle, sides, colour; turned about its middle by angles about x, y and z, one
 * after the other. */
static void test_path_with_crop(void **state)
{
    static const double box[6] = {0, -2, 2.5, 2, 6, 3.5}, angle[3] = {0.3, -0.7, 1.9};
    const cln_space space = {.centre = {1, 2, 3}, .half = 5};
    int inside = 0;
    cln_frames f = {0};

    assert_int_equal(cln_frames_read(put(state, CROPPED("null")), &NO_SIZES, &f), CLN_OK);
    assert_false(f.crop.on);
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_read(
            put(state, CROPPED("{\"crop_center\": [1, 2, 3], \"crop_scale\": [2, 8, 1], "
                               "\"crop_bg_color\": {\"r\": 0, \"g\": 51, \"b\": 255}}")),
            &NO_SIZES, &f),
        CLN_OK);
    assert_true(f.crop.on && !cln_crop_is_turned(&f.crop));
    for (int i = 0; i < 6; i++)
        assert_true(f.crop.box[i] == box[i]);
    assert_true(f.crop_background[0] == 0 && fabsf(f.crop_background[1] - 0.2f) < 1e-6f);
    assert_true(f.crop_background[2] == 1);
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_read(
            put(state, CROPPED("{\"crop_center\": [1, 2, 3], \"crop_scale\": [2, 8, 1], "
                               "\"crop_bg_color\": null, \"crop_rot\": [0.3, -0.7, 1.9]}")),
            &NO_SIZES, &f),
        CLN_OK);
    cln_crop_place(&space, &f.crop);
    for (int i = 0; i < 4000; i++) { /* points of the box and around it, before they are turned */
        double at[3], side = 1e9, least = 1e9;

        for (int a = 0; a < 3; a++) {
            const double half = 0.5 * (box[a + 3] - box[a]);

            at[a] = half * (0.003 * ((i * (7 + 12 * a)) % 1000) - 1.5);
            side = fmin(side, half - fabs(at[a]));
        }
        for (int k = 0; k < 3; k++) {
            const int u = (k + 1) % 3, v = (k + 2) % 3;
            const double before = at[u];

            at[u] = cos(angle[k]) * before - sin(angle[k]) * at[v];
            at[v] = sin(angle[k]) * before + cos(angle[k]) * at[v];
        }
        for (int k = 0; k < 6; k++) {
            double here = (double)f.crop.planes[k][3];

            for (int a = 0; a < 3; a++)
                here += (double)f.crop.planes[k][a] * at[a] / 5;
            least = fmin(least, here);
        }
        if (fabs(side) > 1e-4)
            assert_int_equal(least > 0, side > 0);
        inside += side > 0;
    }
    assert_in_range(inside, 500, 3000);
    cln_frames_free(&f);
    refuses(state, CROPPED("{\"crop_center\": [0, 0]}"), "crop_center must be 3 numbers");
    refuses(state, CROPPED("{\"crop_center\": [0, 0, 0], \"crop_scale\": [1, 0, 1]}"),
            "crop_scale");
    refuses(state,
            CROPPED("{\"crop_center\": [0, 0, 0], \"crop_scale\": [1, 1, 1], "
                    "\"crop_rot\": 3}"),
            "crop_rot");
    refuses(state,
            CROPPED("{\"crop_center\": [0, 0, 0], \"crop_scale\": [1, 1, 1], "
                    "\"crop_bg_color\": [0, 9, 0]}"),
            "crop_bg_color must be r, g and b");
}

static void test_broken_paths(void **state)
{
    refuses(state, "{\"a\": 1}", "camera_path");
    refuses(state, "{\"camera_path\": []}", "0 poses");
    refuses(state, "{\"camera_path\": [" POSE("1,0,0", ", \"fov\": 50") "]}", "16 numbers");
    refuses(state, "{\"camera_path\": [" POSE(PLAIN, "") "]}", "fov");
    refuses(state, "{\"camera_path\": [" POSE(PLAIN, ", \"fov\": 180") "]}", "fov");
    refuses(state,
            "{\"camera_path\": [" POSE("2,0,0,2, 0,1,0,3, 0,0,1,4, 0,0,0,1", ", \"fov\": 50") "]}",
            "camera_path[0]: the pose is not rigid");
    refuses(state, "{\"camera_type\": \"vr180\", \"camera_path\": [1]}", "vr180");
    refuses(state, "{\"render_width\": -1, \"camera_path\": [1]}", "render_width");
    refuses(state, "{\"fps\": \"x\", \"camera_path\": [1]}", "fps");
    refuses(state, "{\"fps\": 0.0003, \"camera_path\": [1]}", "fps is 0.0003; it must be 0.001");
    refuses(state, "{\"frames\": [{\"file_path\": \"a\"}]}", "transform_matrix");
    refuses(state, "{\"frames\": [3]}", "not an object");
}

#define FRAME(rest) \
    "{\"transform_matrix\": [[1,0,0,2],[0,1,0,3],[0,0,1,4],[0,0,0,1]], \"fl_x\": 50" rest "}"

/* Each with its own size and lens, without any photo; a lens is of the photos, not of halves. */
static void test_transforms(void **state)
{
    cln_frames f = {0};

    assert_int_equal(
        cln_frames_read(
            put(state, "{\"frames\": [" FRAME("") "," FRAME(
                           ", \"file_path\": \"a/b.png\", \"w\": 64, \"h\": 48, \"camera_model\": "
                           "\"OPENCV_FISHEYE\", \"k1\": 0.1") "," FRAME(", \"file_path\": "
                                                                        "\"./a/b.png\"") "]}"),
            &SIZES, &f),
        CLN_OK);
    assert_int_equal(f.count, 3);
    assert_string_equal(f.frame[0].name, "pose_0000");
    assert_string_equal(f.frame[1].name, "a_b");
    assert_string_equal(f.frame[2].name, "a_b-0002");
    assert_true(f.frame[0].camera.width == 80 && f.frame[0].camera.height == 61);
    assert_true(f.frame[0].camera.cx == 40 && f.frame[0].camera.fx == 50);
    assert_true(f.frame[1].camera.width == 64 && f.frame[1].camera.height == 48);
    assert_int_equal(f.frame[1].camera.lens, CLN_LENS_OPENCV_FISHEYE);
    assert_true(f.frame[1].camera.distortion[0] == 0.1);
    assert_true(f.frame[2].camera.c2w[5] == -1 && f.frame[2].camera.c2w[11] == 4);
    cln_frames_free(&f);
}

/* Files that are named from the root name frames without the folder that has all of them. */
static void test_names_from_root(void **state)
{
    cln_frames f = {0};

    assert_int_equal(
        cln_frames_read(
            put(state,
                "{\"frames\": [" FRAME(", \"file_path\": \"/shot 1/cam.A/1001.exr\"") "," FRAME(
                    ", \"file_path\": \"/shot 1/cam.B/1001.exr\"") "]}"),
            &SIZES, &f),
        CLN_OK);
    assert_string_equal(f.frame[0].name, "cam.A_1001");
    assert_string_equal(f.frame[1].name, "cam.B_1001");
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_read(put(state, "{\"frames\": [" FRAME(", \"file_path\": \"/s/1001.exr\"") "]}"),
                        &SIZES, &f),
        CLN_OK);
    assert_string_equal(f.frame[0].name, "1001");
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_read(put(state, "{\"frames\": [" FRAME(", \"file_path\": \"s/1001.exr\"") "]}"),
                        &SIZES, &f),
        CLN_OK);
    assert_string_equal(f.frame[0].name, "s_1001");
    cln_frames_free(&f);
}

/* Nulls count as absent, as in a scene: of a frame they do not hide the document's values. */
static void test_nulls_of_transforms(void **state)
{
    cln_frames f = {0};

    assert_int_equal(
        cln_frames_read(put(state, "{\"distortion_params\": [0.1,0,0,0,0,0], \"ftheta_p0\": null, "
                                   "\"frames\": [" FRAME(", \"distortion_params\": null, "
                                                         "\"camera_model\": null") "]}"),
                        &SIZES, &f),
        CLN_OK);
    assert_true(f.frame[0].camera.distortion[0] == 0.1);
    cln_frames_free(&f);
}

/* ---- paths ---- */

/* At `at`, looking at `to`, held level about z and then turned around its axis. */
static void aim(const double at[3], const double to[3], double roll, cln_camera *c)
{
    double forward[3], right[3], down[3], turned[2][3];
    const double up[3] = {0, 0, 1};

    for (int a = 0; a < 3; a++)
        forward[a] = to[a] - at[a];
    cln_normalise(forward);
    cln_cross(forward, up, right);
    cln_normalise(right);
    cln_cross(forward, right, down);
    for (int a = 0; a < 3; a++) {
        turned[0][a] = cos(roll) * right[a] + sin(roll) * down[a];
        turned[1][a] = cos(roll) * down[a] - sin(roll) * right[a];
    }
    cln_pose_of_axes(turned[0], turned[1], forward, at, c->c2w);
    c->width = 40;
    c->height = 30;
    c->fx = c->fy = 50;
}

static double distance(const cln_camera *a, const cln_camera *b)
{
    const double d[3] = {a->c2w[3] - b->c2w[3], a->c2w[7] - b->c2w[7], a->c2w[11] - b->c2w[11]};

    return sqrt(cln_dot(d, d));
}

static double most_apart(const cln_camera *a, const cln_camera *b)
{
    double most = 0;

    for (int i = 0; i < 12; i++)
        most = fmax(most, fabs(a->c2w[i] - b->c2w[i]));
    return most;
}

static void assert_rigid(const cln_camera *c)
{
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0;

            for (int k = 0; k < 3; k++)
                sum += c->c2w[4 * k + i] * c->c2w[4 * k + j];
            assert_true(fabs(sum - (i == j)) < 1e-9);
        }
}

/* A straight walk with a turn of the head: the path meets ends, and keys nearly where they are
 * equally far apart; steps are even, focal lengths follow; repeated keys do no harm. */
static void test_through(void **state)
{
    enum { KEYS = 5, COUNT = 41 };
    cln_frame keys[KEYS];
    const cln_frames from = {.count = KEYS, .frame = keys};
    cln_frames f = {0};

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < KEYS; i++) {
        const double at[3] = {i, 0, 0}, to[3] = {i + sin(0.2 * i), cos(0.2 * i), 0};

        aim(at, to, 0.1 * i, &keys[i].camera);
        keys[i].camera.fx = 50 + i;
    }
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    assert_int_equal(f.count, COUNT);
    for (int i = 0; i < KEYS; i++)
        assert_true(most_apart(&f.frame[10 * i].camera, &keys[i].camera) <
                    (i == 0 || i == KEYS - 1 ? 1e-9 : 0.02));
    assert_true(fabs(f.frame[15].camera.fx - 51.5) < 0.02);
    for (int i = 0; i < COUNT; i++) {
        assert_rigid(&f.frame[i].camera);
        if (i > 0)
            assert_true(fabs(distance(&f.frame[i].camera, &f.frame[i - 1].camera) - 0.1) < 0.003);
    }
    assert_string_equal(f.frame[40].name, "path_0040");
    cln_frames_free(&f);
    for (int i = 0; i < KEYS; i++) { /* photos that lie and that stand: one lens, square pixels */
        keys[i].camera.width = i % 2 ? 24 : 32;
        keys[i].camera.height = i % 2 ? 32 : 24;
        keys[i].camera.fx = keys[i].camera.fy = 50;
    }
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++) {
        const cln_camera *c = &f.frame[i].camera;

        assert_true(c->width == 32 && c->height == 24);
        assert_true(fabs(c->fx - 50) < 1e-9 && fabs(c->fy - 50) < 1e-9);
    }
    cln_frames_free(&f);
    keys[2].camera = keys[1].camera;
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++)
        assert_rigid(&f.frame[i].camera);
    cln_frames_free(&f);
    assert_int_equal(
        cln_frames_through(&(cln_frames){.count = 1, .frame = keys}, 5, NULL, NULL, false, &f),
        CLN_USAGE);
    cln_clear_error();
}

/* Once around, by five keys, the head turning with it, so that the quaternion comes back negated:
 * no step differs from the others, also that from the last frame to the first. The same if the
 * first key is given again as the last. */
static void test_loop(void **state)
{
    enum { KEYS = 5, COUNT = 60 };
    cln_frame keys[KEYS + 1];
    cln_frames from = {.count = KEYS, .frame = keys}, f = {0}, again = {0};
    double least = INFINITY, most = 0, sharpest = 0;

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i <= KEYS; i++) {
        const double turn = 72 * (i % KEYS) * DEGREE;

        aim((double[3]){3 * cos(turn), 3 * sin(turn), 1}, (double[3]){0, 0, 0.5}, 0,
            &keys[i].camera);
        keys[i].camera.fx = keys[i].camera.fy = 50 + i % KEYS;
    }
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, true, &f), CLN_OK);
    assert_int_equal(f.count, COUNT);
    for (int i = 0; i < KEYS; i++)
        assert_true(most_apart(&f.frame[12 * i].camera, &keys[i].camera) < 0.02);
    for (int i = 0; i < COUNT; i++) {
        const cln_camera *before = &f.frame[(i + COUNT - 1) % COUNT].camera;
        const cln_camera *now = &f.frame[i].camera, *next = &f.frame[(i + 1) % COUNT].camera;
        double square = 0;

        for (int a = 3; a < 12; a += 4) {
            const double bend = before->c2w[a] - 2 * now->c2w[a] + next->c2w[a];

            square += bend * bend;
        }
        sharpest = fmax(sharpest, sqrt(square));
        least = fmin(least, distance(before, now));
        most = fmax(most, distance(before, now));
        assert_true(most_apart(before, now) < 0.4);
    }
    assert_true(least > 0.25 && most < 1.2 * least);
    assert_true(sharpest < 0.08); /* of a circle it is 0.033; of a corner by 72 degrees 0.37 */
    assert_true(fabs(f.frame[COUNT - 1].camera.fx - 50.3) < 0.3);
    from.count++;
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, true, &again), CLN_OK);
    for (int i = 0; i < COUNT; i++)
        assert_true(most_apart(&f.frame[i].camera, &again.frame[i].camera) < 1e-9);
    cln_frames_free(&f);
    cln_frames_free(&again);
}

/* Turns of the head by 10 and 30 degrees on one spot take 10 and 30 of 40 steps. */
static void test_turns(void **state)
{
    static const double degrees[] = {0, 10, 40}, at[3] = {1, 2, 3};
    enum { KEYS = sizeof degrees / sizeof *degrees, COUNT = 41 };
    cln_frame keys[KEYS];
    const cln_frames from = {.count = KEYS, .frame = keys};
    cln_frames f = {0};

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < KEYS; i++) {
        const double turn = degrees[i] * DEGREE;

        aim(at, (double[3]){at[0] + sin(turn), at[1] + cos(turn), at[2]}, 0, &keys[i].camera);
    }
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    assert_true(most_apart(&f.frame[10].camera, &keys[1].camera) < 1e-9);
    for (int i = 1; i < COUNT; i++) {
        const double *before = f.frame[i - 1].camera.c2w, *now = f.frame[i].camera.c2w;
        const double cosine = before[2] * now[2] + before[6] * now[6] + before[10] * now[10];

        assert_true(fabs(acos(fmin(1, cosine)) - DEGREE) < 0.1 * DEGREE);
    }
    cln_frames_free(&f);
    for (int i = 0; i < KEYS; i++) /* nearly once round: each turn is the shorter way */
        aim(at, (double[3]){at[0] + sin(170 * i * DEGREE), at[1] + cos(170 * i * DEGREE), at[2]}, 0,
            &keys[i].camera);
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 1; i < COUNT; i++) {
        const double *before = f.frame[i - 1].camera.c2w, *now = f.frame[i].camera.c2w;

        assert_true(before[2] * now[6] - before[6] * now[2] < 0); /* all to the right */
    }
    cln_frames_free(&f);
}

/* An orbit's pictures: as wide as --fov says, else as the training views, pixels as they are. */
static void test_orbit_lens(void **state)
{
    const cln_orbit_frame like = {.width = 80, .height = 60, .fx = 100, .fy = 110};
    cln_camera c;

    (void)state;
    assert_int_equal(cln_orbit_lens(&like, &(cln_render_desc){.width = 40}, &c), CLN_OK);
    assert_true(c.width == 40 && c.height == 30 && c.cx == 20 && c.cy == 15);
    assert_true(fabs(c.fx - 50) < 1e-12 && fabs(c.fy - 55) < 1e-12);
    assert_int_equal(cln_orbit_lens(&like, &(cln_render_desc){.fov = 90}, &c), CLN_OK);
    assert_true(c.width == 80 && c.height == 60 && c.cx == 40 && c.cy == 30);
    assert_true(fabs(c.fx - 40) < 1e-12 && fabs(c.fy - 44) < 1e-12);
}

/* A view in another shape has its middle where it was, and is cut or grows above and below. */
static void test_resized_view(void **state)
{
    const cln_camera like = {.width = 80, .height = 60, .fx = 100, .fy = 110, .cx = 35, .cy = 33};
    cln_camera c;

    (void)state;
    assert_int_equal(cln_orbit_resize(&like, 40, 40, &c), CLN_OK);
    assert_true(c.width == 40 && c.height == 40);
    assert_true(fabs(c.cx - 17.5) < 1e-12 && fabs(c.cy - 21.5) < 1e-12); /* 16.5, 5 lower */
    assert_true(fabs(c.fx - 50) < 1e-12 && fabs(c.fy - 55) < 1e-12);
}

/* Whole panoramas stay whole in any shape; one that was cut stays cut as it was. */
static void test_resized_panorama(void **state)
{
    const double f = 40 / M_PI;
    cln_camera like = {.lens = CLN_LENS_EQUIRECTANGULAR, .width = 80, .height = 40}, c;

    (void)state;
    cln_camera_span_sphere(&like);
    assert_true(cln_camera_spans_sphere(&like));
    assert_int_equal(cln_orbit_resize(&like, 160, 160, &c), CLN_OK);
    assert_true(cln_camera_spans_sphere(&c) && fabs(c.fy - 160 / M_PI) < 1e-9);
    like.height = 30; /* the lower quarter is gone */
    assert_false(cln_camera_spans_sphere(&like));
    for (int twice = 0; twice < 2; twice++) {
        assert_int_equal(cln_orbit_resize(&like, 160 * twice, 0, &c), CLN_OK);
        assert_true(c.width == 80 << twice && c.height == 30 << twice);
        assert_true(fabs(c.fy - f * (1 + twice)) < 1e-9 && fabs(c.cy - 20 * (1 + twice)) < 1e-9);
    }
    like.lens = CLN_LENS_OPENCV;
    like.height = 40;
    assert_false(cln_camera_spans_sphere(&like));
}

/* Pictures of another shape than the photos have the field of view of these along the shorter side,
 * so a wide one cuts nothing off above and below. */
static void test_orbit_of_other_shapes(void **state)
{
    static const struct {
        int width, height;
        double scale;
    } rows[] = {{160, 90, 3}, {90, 160, 3}, {60, 60, 2}, {80, 0, 2}, {0, 15, 0.5}, {0, 0, 1}};
    const cln_orbit_frame like = {.width = 40, .height = 30, .fx = 50, .fy = 51};
    cln_camera lens;

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_render_desc desc = {.width = rows[i].width, .height = rows[i].height};

        assert_int_equal(cln_orbit_lens(&like, &desc, &lens), CLN_OK);
        assert_true(fabs(lens.fx - 50 * rows[i].scale) < 1e-9);
        assert_true(fabs(lens.fy - 51 * rows[i].scale) < 1e-9);
        desc.fov = 90;
        assert_int_equal(cln_orbit_lens(&like, &desc, &lens), CLN_OK);
        assert_true(fabs(lens.fx - 0.5 * lens.width) < 1e-9);
    }
}

/* An orbit sweeps the arc of the cameras, there and back, and 10 degrees at least. */
static void test_orbit_arc(void **state)
{
    static const double arcs[][4] = {{-30, 50, -30, 50},
                                     {19, 21, 15, 25}}; /* from, to; the path's */
    const cln_render_desc desc = {.orbit_elevation = 0};

    (void)state;
    for (size_t i = 0; i < sizeof arcs / sizeof *arcs; i++) {
        const cln_orbit_frame seen = {.east = {1, 0, 0},
                                      .north = {0, 1, 0},
                                      .up = {0, 0, 1},
                                      .distance = 4,
                                      .from = arcs[i][0],
                                      .to = arcs[i][1],
                                      .width = 80,
                                      .height = 60,
                                      .fx = 50,
                                      .fy = 50};
        cln_orbit orbit;

        assert_int_equal(cln_orbit_make(&seen, &desc, &orbit), CLN_OK);
        for (int k = 0; k < 2; k++) {
            cln_camera c;

            cln_orbit_camera(&orbit, k, 2, &c);
            assert_true(fabs(atan2(c.c2w[7], c.c2w[3]) / DEGREE - arcs[i][2 + k]) < 1e-9);
        }
    }
}

/* Frames are as far apart, in place and direction together, where keys are far apart and unevenly,
 * and where they look a little past what they stand around. */
static void test_even_pace(void **state)
{
    enum { COUNT = 181 };
    static const double cases[][6] = {/* degrees, how high they look, and units */
                                      {0, 103, 246, 393, 0, 1},
                                      {0, 45, 90, 135, 0, 1},
                                      {0, 45, 90, 135, 0.2, 1},
                                      {0, 45, 90, 135, 0.2, 1e-6},
                                      {0, 10, 100, 110, 0.02, 1e9}};
    const cln_orbit_frame around = {.north = {0, 1, 0}, .up = {0, 0, 1}};

    (void)state;
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        cln_frame keys[4];
        const cln_frames from = {.count = 4, .frame = keys};
        cln_frames f = {0};
        const double unit = cases[k][5];
        double steps[COUNT - 1][2], sum[2] = {0}, least = INFINITY, most = 0;

        memset(keys, 0, sizeof keys);
        for (int i = 0; i < 4; i++)
            aim((double[3]){4 * unit * cos(cases[k][i] * DEGREE),
                            4 * unit * sin(cases[k][i] * DEGREE), unit},
                (double[3]){0, 0, unit * cases[k][4]}, 0, &keys[i].camera);
        assert_int_equal(cln_frames_through(&from, COUNT, &around, around.up, false, &f), CLN_OK);
        for (int i = 0; i < COUNT - 1; i++) {
            const double *a = f.frame[i].camera.c2w, *b = f.frame[i + 1].camera.c2w;
            double trace = 0;

            for (int e = 0; e < 12; e++)
                trace += e % 4 < 3 ? a[e] * b[e] : 0;
            steps[i][0] = distance(&f.frame[i].camera, &f.frame[i + 1].camera);
            steps[i][1] = acos(fmin(1, (trace - 1) / 2));
            sum[0] += steps[i][0];
            sum[1] += steps[i][1];
        }
        for (int i = 0; i < COUNT - 1; i++) {
            const double step = steps[i][0] / sum[0] + steps[i][1] / sum[1];

            least = fmin(least, step);
            most = fmax(most, step);
        }
        if (!(most < 1.1 * least))
            fail_msg("case %zu: steps of %g to %g", k, least, most);
        cln_frames_free(&f);
    }
}

/* At a key, a path goes where the parabola through it and its neighbours does: mostly where the
 * nearer one is. */
static void test_slopes(void **state)
{
    enum { COUNT = 4001 };
    static const double places[3][3] = {{0, 0, 0}, {1, 0, 0}, {1, 3, 0}};
    cln_frame keys[3];
    const cln_frames from = {.count = 3, .frame = keys};
    cln_frames f = {0};
    double nearest = INFINITY;
    int at = 1;

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < 3; i++)
        aim(places[i], (double[3]){places[i][0] + 1, places[i][1], 0}, 0, &keys[i].camera);
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 1; i < COUNT - 1; i++)
        if (distance(&f.frame[i].camera, &keys[1].camera) < nearest) {
            nearest = distance(&f.frame[i].camera, &keys[1].camera);
            at = i;
        }
    assert_true(nearest < 0.002);
    {
        const double *a = f.frame[at - 1].camera.c2w, *b = f.frame[at + 1].camera.c2w;

        assert_true(fabs((b[3] - a[3]) / (b[7] - a[7]) - 3) < 0.1);
    }
    cln_frames_free(&f);
}

/* A path through four views a quarter turn apart comes no nearer to what they stand around, and
 * looks at it; a straight path would cut through it. */
static void test_around(void **state)
{
    enum { KEYS = 4, COUNT = 31 };
    const cln_orbit_frame around = {.target = {1, 2, 3}, .north = {0, 1, 0}, .up = {0, 0, 1}};
    cln_frame keys[KEYS];
    const cln_frames from = {.count = KEYS, .frame = keys};
    cln_camera middle = {0};
    cln_frames f = {0};

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < KEYS; i++) {
        const double at[3] = {1 + 4 * cos(90 * i * DEGREE), 2 + 4 * sin(90 * i * DEGREE), 4};

        aim(at, around.target, 0.2, &keys[i].camera);
    }
    for (int a = 0; a < 3; a++)
        middle.c2w[4 * a + 3] = around.target[a];
    assert_int_equal(cln_frames_through(&from, COUNT, &around, NULL, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++) {
        const cln_camera *c = &f.frame[i].camera;
        const double away[3] = {1 - c->c2w[3], 2 - c->c2w[7], 3 - c->c2w[11]};
        const double axis[3] = {c->c2w[2], c->c2w[6], c->c2w[10]};

        assert_rigid(c);
        assert_true(fabs(distance(c, &middle) - sqrt(17)) < 1e-6);
        assert_true(cln_dot(away, axis) / sqrt(17) > 0.99999);
    }
    assert_true(most_apart(&f.frame[COUNT - 1].camera, &keys[KEYS - 1].camera) < 1e-9);
    cln_frames_free(&f);
}

/* Level cameras that look around in a room, up to 170 degrees apart and up or down: so does the
 * path between them, whose keys it meets; one that is rolled, or looks almost straight down, counts
 * as it is. */
static void test_level(void **state)
{
    static const double turn[] = {0, 150, 280, 110, 100, 90}, rise[] = {20, -30, 25, 0, 0, -89};
    enum { KEYS = sizeof turn / sizeof *turn, COUNT = 101 };
    static const double up[3] = {0, 0, 1};
    cln_frame keys[KEYS];
    cln_frames from = {.count = KEYS - 1, .frame = keys}, f = {0};
    int rolled = 0;

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < KEYS; i++) {
        const double at[3] = {0.1 * i, 0, 1}, out = cos(rise[i] * DEGREE);
        const double to[3] = {at[0] + out * sin(turn[i] * DEGREE), out * cos(turn[i] * DEGREE),
                              at[2] + sin(rise[i] * DEGREE)};

        aim(at, to, 0, &keys[i].camera);
    }
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++) /* without an up it rolls */
        rolled += fabs(f.frame[i].camera.c2w[8]) > 0.2;
    assert_true(rolled > COUNT / 10);
    cln_frames_free(&f);
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, up, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++) {
        const double *c2w = f.frame[i].camera.c2w;

        assert_rigid(&f.frame[i].camera);
        assert_true(fabs(c2w[8]) < 1e-9 || hypot(c2w[2], c2w[6]) < 0.5); /* x is level */
        assert_true(c2w[9] < 0);                                         /* down is down */
    }
    assert_true(most_apart(&f.frame[0].camera, &keys[0].camera) < 1e-9);
    assert_true(most_apart(&f.frame[COUNT - 1].camera, &keys[KEYS - 2].camera) < 1e-9);
    cln_frames_free(&f);
    from.count = KEYS;
    aim((double[3]){0.3, 0, 1}, (double[3]){1.3, 0, 1}, 0.3, &keys[3].camera);
    for (int key = 3; key < KEYS; key += 2) { /* the end of a path */
        from.count = key + 1;
        assert_int_equal(cln_frames_through(&from, COUNT, NULL, up, false, &f), CLN_OK);
        assert_true(most_apart(&f.frame[COUNT - 1].camera, &keys[key].camera) < 1e-9);
        for (int i = 0; i < COUNT; i++)
            assert_rigid(&f.frame[i].camera);
        cln_frames_free(&f);
    }
}

/* Keys of a panorama and of pinholes: the path is of the pinholes' focal length. */
static void test_through_panoramas(void **state)
{
    enum { KEYS = 3, COUNT = 9 };
    cln_frame keys[KEYS];
    const cln_frames from = {.count = KEYS, .frame = keys};
    cln_frames f = {0};

    (void)state;
    memset(keys, 0, sizeof keys);
    for (int i = 0; i < KEYS; i++)
        aim((double[3]){i, 0, 0}, (double[3]){i, 1, 0}, 0, &keys[i].camera);
    keys[0].camera.lens = CLN_LENS_EQUIRECTANGULAR;
    keys[0].camera.width = 240;
    keys[0].camera.height = 120;
    keys[0].camera.fx = keys[0].camera.fy = 240 / (2 * acos(-1));
    keys[1].camera.fx = keys[1].camera.fy = keys[2].camera.fx = keys[2].camera.fy = 70;
    assert_int_equal(cln_frames_through(&from, COUNT, NULL, NULL, false, &f), CLN_OK);
    for (int i = 0; i < COUNT; i++) {
        const cln_camera *c = &f.frame[i].camera;

        assert_int_equal(c->lens, CLN_LENS_OPENCV);
        assert_true(c->width == keys[1].camera.width && c->height == keys[1].camera.height);
        assert_true(fabs(c->fx - 70) < 1e-9 && fabs(c->fy - 70) < 1e-9);
    }
    cln_frames_free(&f);
}

static void put_scene(cln_scene *scene, cln_view *views, int count)
{
    memset(scene, 0, sizeof *scene);
    memset(views, 0, (size_t)count * sizeof *views);
    scene->views = views;
    scene->view_count = count;
    scene->space.half = 8;
}

/* 3 x 3 cameras in a plane: the spiral stays as wide as they stand, in the plane, and all of it
 * looks at one point. */
static void test_spiral_in_front(void **state)
{
    const cln_render_desc desc = {.spiral_frames = 24, .orbit_radius = 1};
    cln_view views[9];
    cln_scene scene;
    cln_frames f = {0};
    double wide = 0, high = 0;

    (void)state;
    put_scene(&scene, views, 9);
    for (int i = 0; i < 9; i++) {
        const double at[3] = {i % 3 - 1, -5, 0.5 * (i / 3 - 1)}, to[3] = {0, 0, 0};

        aim(at, to, 0, &views[i].camera);
    }
    assert_int_equal(cln_frames_spiral(&scene, &desc, &f), CLN_OK);
    assert_int_equal(f.count, 24);
    for (int i = 0; i < f.count; i++) {
        const cln_camera *c = &f.frame[i].camera;
        const double to[3] = {-c->c2w[3], -c->c2w[7], -c->c2w[11]};
        const double axis[3] = {c->c2w[2], c->c2w[6], c->c2w[10]};

        assert_rigid(c);
        assert_true(cln_dot(to, axis) / sqrt(cln_dot(to, to)) > 0.9999);
        assert_true(fabs(c->c2w[7] - -5) < 0.01);
        wide = fmax(wide, fabs(c->c2w[3]));
        high = fmax(high, fabs(c->c2w[11]));
        if (i > 0)
            assert_true(distance(c, &f.frame[i - 1].camera) < 1);
    }
    assert_true(fabs(wide - 1) < 0.02 && fabs(high - 0.5) < 0.02);
    assert_true(distance(&f.frame[0].camera, &f.frame[23].camera) < 1); /* it is closed */
    cln_frames_free(&f);
}

/* Around one camera, or several in one place, it is narrow, but turns. */
static void test_spiral_of_one_place(void **state)
{
    const cln_render_desc desc = {.spiral_frames = 24, .orbit_radius = 1};
    cln_view views[3];
    cln_scene scene;
    cln_frames f = {0};
    double wide = 0, high = 0;

    (void)state;
    put_scene(&scene, views, 3);
    for (int i = 0; i < 3; i++)
        aim((double[3]){0, -5, 0}, (double[3]){0.1 * (i - 1), 0, 0}, 0, &views[i].camera);
    assert_int_equal(cln_frames_spiral(&scene, &desc, &f), CLN_OK);
    for (int i = 0; i < f.count; i++) {
        wide = fmax(wide, fabs(f.frame[i].camera.c2w[3]));
        high = fmax(high, fabs(f.frame[i].camera.c2w[11]));
    }
    assert_true(wide > 0.01 && wide < 1 && high > 0.01 && high < 1);
    cln_frames_free(&f);
}

static void test_spiral_around(void **state)
{
    const cln_render_desc desc = {.spiral_frames = 40, .orbit_radius = 1, .width = 80};
    cln_view views[12];
    cln_scene scene;
    cln_frames f = {0};
    double low = 90, high = -90;

    (void)state;
    put_scene(&scene, views, 12);
    for (int i = 0; i < 12; i++) {
        const double turn = 30 * i * DEGREE, height = 10 * (i % 4) * DEGREE, to[3] = {0, 0, 0};
        const double at[3] = {4 * cos(turn) * cos(height), 4 * sin(turn) * cos(height),
                              4 * sin(height)};

        aim(at, to, 0, &views[i].camera);
    }
    assert_int_equal(cln_frames_spiral(&scene, &desc, &f), CLN_OK);
    for (int i = 0; i < f.count; i++) {
        const double *m = f.frame[i].camera.c2w, at[3] = {m[3], m[7], m[11]};
        const double axis[3] = {-m[2], -m[6], -m[10]};
        const double height = asin(at[2] / 4) / DEGREE;

        assert_rigid(&f.frame[i].camera);
        assert_true(fabs(sqrt(cln_dot(at, at)) - 4) < 1e-6);
        assert_true(cln_dot(at, axis) > 3.9999);
        low = fmin(low, height);
        high = fmax(high, height);
    }
    assert_true(low > -0.5 && low < 5 && high < 30.5 && high > 25);
    assert_true(f.frame[0].camera.width == 80 && f.frame[0].camera.height == 60);
    cln_frames_free(&f);
}

/* Cameras almost above the target: the spiral stays where it still has a direction. */
static void test_spiral_from_above(void **state)
{
    const cln_render_desc desc = {.spiral_frames = 10, .orbit_radius = 1};
    cln_view views[12];
    cln_scene scene;
    cln_frames f = {0};

    (void)state;
    put_scene(&scene, views, 12);
    for (int i = 0; i < 12; i++) {
        const double turn = 30 * i * DEGREE, height = 86 * DEGREE, to[3] = {0, 0, 0};
        const double at[3] = {4 * cos(turn) * cos(height), 4 * sin(turn) * cos(height),
                              4 * sin(height)};

        aim(at, to, 0, &views[i].camera);
    }
    assert_int_equal(cln_frames_spiral(&scene, &desc, &f), CLN_OK);
    for (int i = 0; i < f.count; i++) {
        assert_rigid(&f.frame[i].camera);
        assert_true(fabs(asin(f.frame[i].camera.c2w[11] / 4) - 1.4) < 1e-3);
    }
    cln_frames_free(&f);
}

/* Paths of nerfstudio, in its frame, are brought to the scene's by the file beside them; what
 * ns-process-data had done to the scene's poses comes on top. */
static void test_nerfstudios_frame(void **state)
{
    static const struct {
        const char *file, *scene;
        double place[3], x[3]; /* of the camera, and of its x axis */
    } rows[] = {
        /* p' = 0.5 (R p + t), R a quarter turn about z, t = 1, 2, 3; p' = 2, 3, 4 */
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]], \"scale\": 0.5}",
         NULL,
         {4, -3, 5},
         {0, -1, 0}},
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]], \"scale\": 0.5}",
         "{}",
         {4, -3, 5},
         {0, -1, 0}},
        /* then (x, y, z) -> (y, x, -z) + (1, 0, 0) */
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]], \"scale\": 0.5}",
         "{\"applied_transform\": [[0,1,0,1],[1,0,0,0],[0,0,-1,0]]}",
         {-2, 4, -5},
         {-1, 0, 0}},
        {"{\"transform\": [[1,0,0,0],[0,1,0,0],[0,0,1,0]], \"scale\": 2}",
         "{\"applied_scale\": 4}",
         {4, 6, 8},
         {1, 0, 0}},
    };
    static const char *const wrong[][2] = {
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2]], \"scale\": 0.5}", "transform must"},
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,2,3]], \"scale\": 0.5}", "transform must"},
        {"{\"transform\": [[1,0,0,1],[0,1,0,2],[0,0,-1,3]], \"scale\": 0.5}", "transform must"},
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]], \"scale\": 0}", "scale must"},
        {"{\"transform\": [[0,-1,0,1],[1,0,0,2],[0,0,1,3]]}", "scale must"}};
    const char *beside = scratch_path(*state, "dataparser_transforms.json");
    const char *scene = scratch_path(*state, "transforms.json");
    const char *poses = put(state, CROPPED("{\"crop_center\": [2,3,4], \"crop_scale\": [1,2,3]}"));
    char *path = NULL;
    cln_frames f = {0};

    assert_int_equal(cln_frames_dataparser(poses, &path), CLN_OK);
    assert_null(path);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const cln_camera *c = NULL;

        scratch_put(beside, rows[i].file, strlen(rows[i].file));
        if (rows[i].scene)
            scratch_put(scene, rows[i].scene, strlen(rows[i].scene));
        assert_int_equal(cln_frames_dataparser(poses, &path), CLN_OK);
        assert_string_equal(path, beside);
        assert_int_equal(cln_frames_read(poses, &NO_SIZES, &f), CLN_OK);
        assert_true(f.foreign);
        assert_int_equal(cln_frames_from_nerfstudio(path, poses, rows[i].scene ? *state : NULL, &f),
                         CLN_OK);
        c = &f.frame[0].camera;
        for (int k = 0; k < 3; k++) {
            /* the box is of the same frame: its middle, and its shortest axis */
            const double middle = 0.5 * (f.crop.box[k] + f.crop.box[k + 3]);
            const double side = f.crop.box[k + 3] - f.crop.box[k];

            assert_true(fabs(c->c2w[4 * k + 3] - rows[i].place[k]) < 1e-12);
            assert_true(fabs(c->c2w[4 * k] - rows[i].x[k]) < 1e-12);
            assert_true(fabs(middle - rows[i].place[k]) < 1e-12);
            assert_true(fabs(side - 2 * (k + 1)) < 1e-12);
            assert_true(fabs(f.crop.turn[k] - rows[i].x[k]) < 1e-12);
        }
        cln_frames_free(&f);
        free(path);
    }
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        scratch_put(beside, wrong[i][0], strlen(wrong[i][0]));
        assert_int_equal(cln_frames_read(poses, &NO_SIZES, &f), CLN_OK);
        assert_int_equal(cln_frames_from_nerfstudio(beside, poses, NULL, &f), CLN_INPUT);
        assert_non_null(strstr(cln_error_text(), wrong[i][1]));
        cln_clear_error();
        cln_frames_free(&f);
    }
    /* our viewer's own paths are the scene's */
    poses =
        put(state,
            FILM("\"poses_in\": \"scene\", \"camera_path\": [" POSE(PLAIN, ", \"fov\": 90") "]"));
    assert_int_equal(cln_frames_read(poses, &NO_SIZES, &f), CLN_OK);
    assert_false(f.foreign);
    cln_frames_free(&f);
}

int test_group_frames(void)
{
#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)
    const struct CMUnitTest tests[] = {ON_DISK(test_camera_path),
                                       ON_DISK(test_broken_paths),
                                       ON_DISK(test_transforms),
                                       ON_DISK(test_nulls_of_transforms),
                                       ON_DISK(test_names_from_root),
                                       ON_DISK(test_seconds),
                                       ON_DISK(test_path_with_crop),
                                       ON_DISK(test_nerfstudios_frame),
                                       cmocka_unit_test(test_through),
                                       cmocka_unit_test(test_loop),
                                       cmocka_unit_test(test_level),
                                       cmocka_unit_test(test_through_panoramas),
                                       cmocka_unit_test(test_turns),
                                       cmocka_unit_test(test_even_pace),
                                       cmocka_unit_test(test_slopes),
                                       cmocka_unit_test(test_around),
                                       cmocka_unit_test(test_orbit_lens),
                                       cmocka_unit_test(test_resized_view),
                                       cmocka_unit_test(test_resized_panorama),
                                       cmocka_unit_test(test_orbit_of_other_shapes),
                                       cmocka_unit_test(test_orbit_arc),
                                       cmocka_unit_test(test_spiral_in_front),
                                       cmocka_unit_test(test_spiral_of_one_place),
                                       cmocka_unit_test(test_spiral_around),
                                       cmocka_unit_test(test_spiral_from_above)};

    return cmocka_run_group_tests_name("frames", tests, NULL, NULL);
}
