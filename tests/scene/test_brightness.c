/* How bright photos are beside others, of ties that are made up (brightness.h). test_agree.c has
 * photos. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include "near.h"
#include "scene/agreement.h"
#include "scene/brightness.h"
#include "scene/features.h"
#include "tests.h"

enum { VIEWS = 12, TIES = 400 };

/* A pair has ties of what is kept and of what is cut away, of each as many as a photo has marks. */
static void test_most_ties(void **state)
{
    enum { MOST = 2 * CLN_FEATURES_MOST };
    cln_view views[3] = {{.camera = {.width = 8, .height = 8, .fx = 8, .fy = 8}}};
    cln_agree_view seen[3] = {{0}};
    cln_tie *ties = calloc(MOST + 3, sizeof *ties);
    cln_scene scene = {.views = views, .view_count = 3};
    cln_agreement agreement = {
        .views = seen, .ties = ties, .tie_count = MOST + 3, .pairs = 2, .focal = 1};

    (void)state;
    assert_non_null(ties);
    views[1] = views[2] = views[0];
    for (int i = 0; i < MOST; i++)
        ties[i] = (cln_tie){.a = 0, .b = 1, .value_a = 0.99f, .value_b = 0.49f, .agrees = true};
    for (int i = MOST; i < MOST + 3; i++)
        ties[i] = (cln_tie){.a = 1, .b = 2, .value_a = 0.5f, .value_b = 0.5f, .agrees = true};
    assert_int_equal(cln_agree_brightness(&scene, &agreement), CLN_OK);
    assert_near(seen[0].exposure - seen[1].exposure, 2.2, 1e-3);
    assert_near(seen[1].exposure - seen[2].exposure, 0, 1e-3);
    free(ties);
}

/* Views on a way along z, and what their marks have told so far. */
typedef struct lit {
    cln_view views[VIEWS];
    cln_agree_view seen[VIEWS];
    cln_tie ties[TIES];
    int tie_count, pairs;
} lit;

static lit *make_lit(void)
{
    lit *l = calloc(1, sizeof *l);

    assert_non_null(l);
    for (int i = 0; i < VIEWS; i++) {
        cln_camera *c = &l->views[i].camera;

        c->width = c->height = 64;
        c->fx = c->fy = 64;
        c->cx = c->cy = 32;
        c->c2w[0] = c->c2w[5] = c->c2w[10] = 1;
        c->c2w[11] = 0.25 * i;
    }
    return l;
}

static void tell(lit *l, int views, cln_agreement *out)
{
    const cln_scene scene = {.views = l->views, .view_count = views};

    *out = (cln_agreement){.views = l->seen,
                           .ties = l->ties,
                           .tie_count = l->tie_count,
                           .pairs = l->pairs,
                           .focal = 1};
    assert_int_equal(cln_agree_brightness(&scene, out), CLN_OK);
}

/* One mark more of a and b, so many factors of 2 brighter in a; where it lies is not known. */
static cln_tie *add_tie(lit *l, int a, int b, double stops)
{
    assert_true(l->tie_count < TIES);
    l->ties[l->tie_count] = (cln_tie){.a = a,
                                      .b = b,
                                      .value_a = (float)(0.25 * pow(2, stops / 2.2) - 0.01),
                                      .value_b = 0.24f,
                                      .agrees = true};
    return &l->ties[l->tie_count++];
}

static void add_pair(lit *l, int a, int b, int marks, double stops)
{
    l->pairs++;
    for (int i = 0; i < marks; i++)
        add_tie(l, a, b, stops);
}

static double between(const lit *l, int a, int b)
{
    return l->seen[a].exposure - l->seen[b].exposure;
}

/* Three marks of a pair tell something, two do not. */
static void test_few_marks(void **state)
{
    lit *l = make_lit();
    cln_agreement out;

    (void)state;
    add_pair(l, 0, 1, 8, 1);
    add_pair(l, 1, 2, 3, -0.5);
    add_pair(l, 2, 3, 7, 0.25);
    add_pair(l, 3, 4, 2, 1);
    tell(l, 5, &out);
    assert_near(between(l, 0, 1), 1, 1e-3);
    assert_near(between(l, 1, 2), -0.5, 1e-3);
    assert_near(between(l, 2, 3), 0.25, 1e-3);
    assert_true(isnan(l->seen[4].exposure));
    free(l);
}

/* Three pairs that contradict each other: those of 8 and 16 marks weigh alike, one of 4 half as
 * much. Of the difference d of the first and last, d^2 / 2 + weight (d - 1)^2 is least. */
static void test_weights(void **state)
{
    static const struct {
        int marks;
        double difference;
    } cases[] = {{3, 3 / 7.0}, {4, 0.5}, {6, 0.6}, {8, 2 / 3.0}, {16, 2 / 3.0}};

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        lit *l = make_lit();
        cln_agreement out;

        add_pair(l, 0, 1, 8, 0);
        add_pair(l, 0, 2, cases[i].marks, 1);
        add_pair(l, 1, 2, 16, 0);
        tell(l, 3, &out);
        assert_near(between(l, 0, 2), cases[i].difference, 1e-3);
        free(l);
    }
}

/* A single photo is told to be darker by pairs of 8 marks, not by more pairs of fewer. */
static void test_jumps_by_many_marks(void **state)
{
    (void)state;
    for (int marks = 7; marks <= 8; marks++) {
        lit *l = make_lit();
        cln_agreement out;

        for (int v = 0; v < 4; v++)
            add_pair(l, v, v + 1, 20, 0);
        for (int v = 0; v < 3; v++)
            add_pair(l, v, 4, marks, 2);
        add_pair(l, 0, 5, 7, 1); /* nothing else tells of it */
        tell(l, 6, &out);
        assert_near(l->seen[4].jump, marks < 8 ? 0 : -2, 1e-3);
        assert_near(l->seen[2].jump, 0, 1e-3);
        assert_true(isnan(l->seen[5].jump));
        assert_near(between(l, 0, 5), 1, 1e-3);
        free(l);
    }
}

/* One mark more of views a and a + 1, at x, 0, z, with light that falls by a power of the distance
 * from the camera, and `stops` brighter in a. Its place goes with it. */
static void add_lit(lit *l, int a, double x, double z, double power, double stops)
{
    const double from_a = hypot(x, z - l->views[a].camera.c2w[11]);
    const double from_b = hypot(x, z - l->views[a + 1].camera.c2w[11]);
    cln_tie *t = add_tie(l, a, a + 1, stops + power * log2(from_b / from_a));

    t->ua = (float)(32 + 64 * x / (z - l->views[a].camera.c2w[11]));
    t->ub = (float)(32 + 64 * x / (z - l->views[a + 1].camera.c2w[11]));
    t->va = t->vb = 32;
}

/* Nine photos on a way forward, of things at 20 distances: a light that goes along with the camera
 * is told from exposures that fall along the way, and from these where things of two photos that
 * are nearer look brighter by chance: one each of four pairs. */
static void test_light_goes_along(void **state)
{
    enum { COUNT = 9, MARKS = 20 };
    static const struct {
        double power, stops, falloff;
        bool alike; /* all marks of two photos at one distance, but one */
    } cases[] = {
        {2, 0, 2, false}, {1.5, 0, 1.5, false}, {0, -0.5, 0, false},
        {0, 0, 0, false}, {0, -0.5, 0, true},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        lit *l = make_lit();
        cln_agreement out;

        for (int a = 0; a + 1 < COUNT; a++) {
            l->pairs++;
            for (int k = 0; k < MARKS; k++) {
                const double x = k % 2 ? 0.3 : -0.3, z = 0.25 * (a + 1) + 0.8;

                if (!cases[i].alike)
                    add_lit(l, a, x, z + (7 * k % MARKS) * 0.1, cases[i].power, cases[i].stops);
                else if (a < 4 && k == 0)
                    add_lit(l, a, x, z, 0, 2 * cases[i].stops);
                else
                    add_lit(l, a, x, z + 1, 0, cases[i].stops);
            }
        }
        tell(l, COUNT, &out);
        if (!(fabs(out.falloff - cases[i].falloff) < 0.02))
            fail_msg("case %zu: marks fade with the power %g", i, out.falloff);
        for (int a = 0; a + 1 < COUNT && !cases[i].alike; a++)
            assert_near(between(l, a, a + 1), cases[i].stops, 0.02);
        free(l);
    }
}

int test_group_brightness(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_most_ties),        cmocka_unit_test(test_few_marks),
        cmocka_unit_test(test_weights),          cmocka_unit_test(test_jumps_by_many_marks),
        cmocka_unit_test(test_light_goes_along),
    };

    return cmocka_run_group_tests_name("brightness", tests, NULL, NULL);
}
