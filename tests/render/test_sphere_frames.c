/* Frames of panoramas: whole spheres in pictures of another shape, and orbits about their midst,
 * both of which are told. No device. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/log.h"
#include "render/frames.h"
#include "tests.h"

enum { VIEWS = 3 };

typedef struct walk {
    cln_scene scene;
    cln_view views[VIEWS];
} walk;

/* Photos of this shape along x, the first ones whole spheres, others pinholes' of 90 degrees. */
static void begin(walk *w, int width, int height, int spheres)
{
    memset(w, 0, sizeof *w);
    w->scene.views = w->views;
    w->scene.view_count = VIEWS;
    w->scene.space.half = 10;
    for (int i = 0; i < VIEWS; i++) {
        cln_camera *c = &w->views[i].camera;

        w->views[i].file = (char *)"photo";
        w->views[i].name = (char *)"photo";
        *c = (cln_camera){.width = width,
                          .height = height,
                          .fx = 0.5 * width,
                          .fy = 0.5 * width,
                          .cx = 0.5 * width,
                          .cy = 0.5 * height,
                          .c2w = {1, 0, 0, i, 0, 1, 0, 0, 0, 0, 1, 0}};
        if (i < spheres)
            cln_camera_span_sphere(c);
    }
}

static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN)
        snprintf(user, 512, "%s", line);
}

/* A whole sphere stays whole in any shape, and a word says that it is stretched, unless a field of
 * view makes plain pictures of it; photos of other lenses show more or less above and below. */
static void test_another_shape(void **state)
{
    static const struct {
        int size[2]; /* of the photos */
        bool spheres;
        cln_render_desc desc;
        const char *told; /* NULL: nothing */
    } rows[] = {
        {{80, 40}, true, {.width = 40, .height = 30}, "3 poses are panoramas'"},
        {{80, 40}, true, {.width = 40, .height = 30}, "--interpolate FRAMES --fov 90"},
        {{80, 40}, true, {.width = 40, .height = 30, .interpolate = 2}, "of it, --fov 90"},
        {{80, 40}, true, {.width = 40, .height = 30, .max_images = 1}, "1 pose is a panorama's"},
        {{80, 40}, true, {.width = 40, .height = 30, .interpolate = 2, .fov = 90}, NULL},
        {{80, 40}, true, {.width = 40}, NULL},
        {{80, 40}, true, {.height = 30}, NULL},
        {{80, 40}, true, {.width = 41, .height = 20}, NULL}, /* rounded */
        {{80, 60}, true, {.width = 40, .height = 20}, NULL}, /* as it should be */
        {{80, 60}, true, {.width = 40, .height = 30}, NULL}, /* as it is */
        {{80, 40}, false, {.width = 40, .height = 30}, NULL},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_render_desc desc = rows[i].desc;
        cln_frames f = {0};
        char text[512] = "";
        walk w;

        desc.split = "train";
        begin(&w, rows[i].size[0], rows[i].size[1], rows[i].spheres ? VIEWS : 0);
        cln_log_set_sink(keep_warning, text);
        assert_int_equal(cln_frames_make(&desc, &w.scene, NULL, &f), CLN_OK);
        cln_log_set_sink(NULL, NULL);
        if (rows[i].told ? !strstr(text, rows[i].told) : *text)
            fail_msg("row %d: '%s'", (int)i, text);
        assert_int_equal(f.count, desc.interpolate  ? desc.interpolate
                                  : desc.max_images ? 1
                                                    : VIEWS);
        for (int k = 0; k < f.count; k++)
            assert_int_equal(cln_camera_spans_sphere(&f.frame[k].camera),
                             rows[i].spheres && !(desc.fov > 0));
        cln_frames_free(&f);
    }
}

/* An orbit and a spiral about the midst of panoramas are told of; not those of photos, or of a
 * panorama among them. */
static void test_no_midst(void **state)
{
    const cln_render_desc rows[] = {{.orbit_frames = 2, .orbit_elevation = NAN},
                                    {.spiral_frames = 2, .orbit_elevation = NAN}};

    (void)state;
    for (int i = 0; i < 2 * (VIEWS + 1); i++) {
        const bool most = i / 2 > 1;
        cln_frames f = {0};
        char text[512] = "", want[64];
        walk w;

        begin(&w, 80, 40, i / 2);
        cln_log_set_sink(keep_warning, text);
        assert_int_equal(cln_frames_make(&rows[i % 2], &w.scene, NULL, &f), CLN_OK);
        cln_log_set_sink(NULL, NULL);
        snprintf(want, sizeof want, "--%s: the training photos are panoramas",
                 i % 2 ? "spiral" : "orbit");
        assert_int_equal(strstr(text, want) != NULL, most);
        assert_int_equal(strstr(text, "--interpolate 300 --fov 90") != NULL, most);
        cln_frames_free(&f);
    }
}

int test_group_sphere_frames(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_another_shape),
                                       cmocka_unit_test(test_no_midst)};

    return cmocka_run_group_tests_name("sphere_frames", tests, NULL, NULL);
}
