/* A training's curve (train/curve.h) stays bounded, in order, even, and keeps its few test PSNRs,
 * however long the training is. Oracle: the points that were added. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include "tests.h"
#include "train/curve.h"

static void stays_bounded_and_keeps_tests(void **state)
{
    cln_curve curve = {.every = 0.5};
    const int total = 200000, each = total / 10;
    int tests = 0;

    (void)state;
    for (int i = 0; i < total; i++) {
        const cln_curve_point point = {.seconds = 0.1 * i,
                                       .train = i,
                                       .test = i % each == each / 2 ? 20 + i / each : NAN,
                                       .leaves = i};

        cln_curve_add(&curve, &point);
        assert_true(curve.count <= CLN_CURVE_POINTS);
    }
    assert_true(curve.count >= CLN_CURVE_POINTS / 2);
    for (int i = 0; i < curve.count; i++) {
        const cln_curve_point *p = &curve.points[i];

        assert_true(p->seconds == 0.1 * p->leaves && p->train == p->leaves);
        if (i > 0) {
            assert_true(p->seconds > p[-1].seconds);
            assert_true(p->seconds < p[-1].seconds + 3 * curve.every);
        }
        if (isfinite(p->test))
            assert_true(p->test == 20 + tests++);
    }
    assert_int_equal(tests, 10);
    assert_true(curve.points[0].seconds == 0);
    assert_true(curve.points[curve.count - 1].seconds > 0.1 * total - 2 * curve.every);
}

static void leaves_out_what_is_near(void **state)
{
    cln_curve curve = {.every = 1};

    (void)state;
    cln_curve_add(&curve, &(cln_curve_point){.seconds = 3, .test = NAN});
    cln_curve_add(&curve, &(cln_curve_point){.seconds = 3.9, .test = NAN});
    assert_int_equal(curve.count, 1);
    cln_curve_add(&curve, &(cln_curve_point){.seconds = 3.9, .test = 30});
    assert_int_equal(curve.count, 2);
}

int test_group_curve(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stays_bounded_and_keeps_tests),
        cmocka_unit_test(leaves_out_what_is_near),
    };

    return cmocka_run_group_tests_name("curve", tests, NULL, NULL);
}
