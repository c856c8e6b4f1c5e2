/* The box of what alpha shows (host/scene/silhouette.c): photos of an ellipsoid, from two rings of
 * cameras around it, against its sides. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/status.h"
#include "comma.h"
#include "scene/scene.h"
#include "scene/vectors.h"
#include "tests.h"

enum { SIDE = 64, RING = 12, VIEWS = 2 * RING };

static const double radii[3] = {1, 0.8, 0.3};

typedef struct photos {
    cln_scene scene;
    cln_view views[VIEWS];
    uint8_t pixels[VIEWS][SIDE * SIDE * 4];
} photos;

static bool is_hit(const cln_camera *c, int x, int y)
{
    double o[3], d[3], oo = -1, od = 0, dd = 0;

    assert_true(cln_camera_ray(c, x + 0.5, y + 0.5, o, d));
    for (int a = 0; a < 3; a++) {
        oo += o[a] * o[a] / (radii[a] * radii[a]);
        od += o[a] * d[a] / (radii[a] * radii[a]);
        dd += d[a] * d[a] / (radii[a] * radii[a]);
    }
    return od * od > oo * dd;
}

/* 15 and 50 degrees above the middle, which all look at from so far; every second photo shows so
 * much around it, the others `wide` of it. */
static void take(photos *p, double far, double shown, double wide)
{
    p->scene = (cln_scene){.views = p->views, .view_count = VIEWS, .has_alpha = true};
    for (int i = 0; i < VIEWS; i++) {
        const double up = (i < RING ? 15 : 50) / 57.29577951308232;
        const double round = 6.283185307179586 * i / RING;
        cln_camera *c = &p->views[i].camera;
        double *m = c->c2w;

        *c = (cln_camera){.width = SIDE, .height = SIDE, .cx = SIDE / 2.0, .cy = SIDE / 2.0};
        c->fx = c->fy = SIDE / 2.0 * far / (i % 2 ? wide : shown);
        m[0] = -sin(round); /* columns: right, down, ahead */
        m[4] = cos(round);
        m[1] = sin(up) * cos(round);
        m[5] = sin(up) * sin(round);
        m[9] = -cos(up);
        m[2] = -cos(up) * cos(round);
        m[6] = -cos(up) * sin(round);
        m[10] = -sin(up);
        for (int a = 0; a < 3; a++)
            m[4 * a + 3] = -far * m[4 * a + 2];
        p->views[i].channels = 4;
        p->views[i].pixels = p->pixels[i];
        for (int k = 0; k < SIDE * SIDE; k++)
            p->pixels[i][4 * k + 3] = is_hit(c, k % SIDE, k / SIDE) ? 255 : 0;
    }
}

/* From near and from very far, where few of the space's cells are in the photos at all; and of some
 * photos that show a part alone. */
static void test_box(void **state)
{
    static const struct {
        double far, shown, wide;
    } rows[] = {{10, 1.3, 1.3}, {10, 1.3, 0.6}, {500, 1.3, 1.3}, {5e4, 1.3, 1.3}};
    photos *p = calloc(1, sizeof *p);

    (void)state;
    assert_non_null(p);
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const double far = rows[i].far;
        const double space[6] = {-far, -far, -far, far, far, far};
        double low[3], high[3];
        bool any = false;

        take(p, far, rows[i].shown, rows[i].wide);
        assert_int_equal(cln_scene_silhouette(&p->scene, space, low, high, &any), CLN_OK);
        assert_true(any);
        for (int a = 0; a < 3; a++) {
            const double most = (a < 2 ? 1.25 : 1.7) * radii[a]; /* no photo is from the side */

            assert_true(low[a] <= -radii[a] && low[a] >= -most);
            assert_true(high[a] >= radii[a] && high[a] <= most);
        }
    }
    free(p);
}

/* A cube that was guessed becomes a box around that, whatever the caller's decimal point. */
static void test_narrowed(void **state)
{
    photos *p = calloc(1, sizeof *p);
    char text[CLN_BOX_BYTES];
    cln_status st;
    double box[6];

    (void)state;
    assert_non_null(p);
    take(p, 10, 1.3, 1.3);
    p->scene.cube_guessed = true;
    p->scene.space.half = 10;
    p->scene.folder = "scene";
    comma_locale_begin();
    st = cln_scene_narrow_cube(&p->scene, text);
    comma_locale_end();
    assert_int_equal(st, CLN_OK);
    assert_true(cln_reals_read(text, 6, box));
    for (int a = 0; a < 3; a++)
        assert_true(box[a] < -radii[a] && box[3 + a] > radii[a] && box[3 + a] < 2);
    assert_true(p->scene.space.half < 2);
    free(p->scene.bounds_rule);
    free(p);
}

int test_group_silhouette(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_box),
        cmocka_unit_test(test_narrowed),
    };

    return cmocka_run_group_tests_name("silhouette", tests, NULL, NULL);
}
