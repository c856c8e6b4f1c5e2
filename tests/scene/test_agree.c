/* Which photos are compared to see whether their poses fit (scene/agree.h): those of neighbours,
 * which stand near and look the same way, and the next by name. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <jansson.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "scene/agree.h"
#include "scene/inspect.h"
#include "tests.h"

enum { SIDE = 64, BLOCK = 4, GROUP = 6, VIEWS = 2 * GROUP };

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

/* ---- brightness ---- */

/* Photos of a painted wall from a row of places, each two blocks from the next, with light of
 * `stops` factors of 2. Returns whether check takes one for faulty. */
static bool a_photo_is_faulty(const double stops[GROUP], int *faulty)
{
    enum { STEP = 2 * BLOCK, WIDE = 3 * SIDE / 2, HIGH = SIDE };
    uint8_t *pixels[GROUP];
    char names[GROUP][8];
    cln_view views[GROUP];
    cln_scene scene = {.views = views,
                       .view_count = GROUP,
                       .folder = "photos",
                       .bounds_rule = "a test",
                       .cube_share = 1,
                       .apart_share = NAN,
                       .space = cln_space_unit};
    json_t *all = NULL, *findings = NULL;
    bool found = false;

    memset(views, 0, sizeof views);
    for (int i = 0; i < GROUP; i++) {
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
    assert_int_equal(cln_scene_inspect(&scene, NULL, &all), CLN_OK);
    findings = json_object_get(all, "findings");
    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i), *name = NULL;

        if (strcmp(json_string_value(json_object_get(one, "what")), "exposure") != 0)
            continue;
        found = json_is_true(json_object_get(one, "likely_fault"));
        name = json_array_get(json_object_get(one, "views"), 0);
        *faulty = found ? atoi(json_string_value(name)) : -1;
        assert_true(!found || json_array_size(json_object_get(one, "views")) == 1);
    }
    json_decref(all);
    for (int i = 0; i < GROUP; i++)
        free(pixels[i]);
    return found;
}

/* A photo that is a stop darker than its neighbours is faulty; the last of a row that gets darker
 * is not, although it differs from them as much. */
static void test_light_that_fades(void **state)
{
    int faulty = -2;

    (void)state;
    assert_true(a_photo_is_faulty((const double[GROUP]){0, 0, 0, -1, 0, 0}, &faulty));
    assert_int_equal(faulty, 3);
    assert_true(a_photo_is_faulty((const double[GROUP]){0, 0, 0, 0, 0, -1}, &faulty));
    assert_int_equal(faulty, 5);
    assert_false(a_photo_is_faulty((const double[GROUP]){0, 0, -.1, -.4, -.8, -1.4}, &faulty));
    assert_int_equal(faulty, -1); /* but a remark */
}

int test_group_agree(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_neighbours_look_alike),
        cmocka_unit_test(test_light_that_fades),
    };

    return cmocka_run_group_tests_name("agree", tests, NULL, NULL);
}
