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

/* `count` photos of a painted wall from a row of places, each two blocks from the next, with light
 * of `stops` factors of 2. Returns how many check takes for faulty; *first: the first of them, or
 * -1 with a remark. */
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
    json_t *all = NULL, *findings = NULL;
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
    assert_int_equal(cln_scene_inspect(&scene, NULL, &all), CLN_OK);
    findings = json_object_get(all, "findings");
    for (size_t i = 0; i < json_array_size(findings); i++) {
        const json_t *one = json_array_get(findings, i), *name = NULL;

        if (strcmp(json_string_value(json_object_get(one, "what")), "exposure") != 0)
            continue;
        if (json_is_true(json_object_get(one, "likely_fault")))
            found = (int)json_array_size(json_object_get(one, "views"));
        name = json_array_get(json_object_get(one, "views"), 0);
        *first = found > 0 ? atoi(json_string_value(name)) : -1;
    }
    json_decref(all);
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

int test_group_agree(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_neighbours_look_alike),
        cmocka_unit_test(test_pairs_once),
        cmocka_unit_test(test_light_that_fades),
        cmocka_unit_test(test_faulty_neighbours),
    };

    return cmocka_run_group_tests_name("agree", tests, NULL, NULL);
}
