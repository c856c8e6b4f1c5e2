/* Which photos are compared to see whether their poses fit (scene/agree.h): those of neighbours,
 * which stand near and look the same way, and the next by name. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "scene/agree.h"
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

int test_group_agree(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_neighbours_look_alike),
    };

    return cmocka_run_group_tests_name("agree", tests, NULL, NULL);
}
