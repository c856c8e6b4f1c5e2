/* What a watched training counts: its curve (train/curve.h) stays bounded, in order, even, and
 * keeps its few test PSNRs, however long the training is; viewing stays within its share of the
 * time (train/allowance.h). Oracles: the points that were added; a clock that is made up. */
#include "unit.h"
#include <math.h>
#include "tests.h"
#include "train/allowance.h"
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

/* Steps of 10 ms while somebody always asks for pieces of so many seconds. */
static void viewing_stays_within_its_share(void **state)
{
    static const double pieces[] = {0.001, 0.045, 0.3, 4};

    (void)state;
    for (int share = 1; share <= 90; share += 89 / 3)
        for (size_t k = 0; k < sizeof pieces / sizeof pieces[0]; k++) {
            cln_allowance a = {.share = share / 100.0, .most = 1, .at = 1000};
            double now = 1000, spent = 0;

            assert_true(cln_allowance_pass(&a, now)); /* the first one at once */
            while (now < 2000) {
                while (cln_allowance_pass(&a, now)) {
                    now += pieces[k];
                    spent += pieces[k];
                    cln_allowance_spend(&a, pieces[k]);
                    assert_true(spent <= a.share * (now - 1000) + pieces[k] + 1e-9);
                }
                now += 0.01;
            }
            assert_true(spent >= a.share * 1000 - 2 * pieces[k] - 0.1);
        }
}

static void a_rest_is_not_saved_up(void **state)
{
    cln_allowance a = {.share = 0.2, .most = 1};
    double spent = 0;

    (void)state;
    while (cln_allowance_pass(&a, 1e6)) {
        cln_allowance_spend(&a, 0.1);
        spent += 0.1;
    }
    assert_true(spent > 0.9 && spent < 1.2);
}

int test_group_watch(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(stays_bounded_and_keeps_tests),
        cmocka_unit_test(leaves_out_what_is_near),
        cmocka_unit_test(viewing_stays_within_its_share),
        cmocka_unit_test(a_rest_is_not_saved_up),
    };

    return cmocka_run_group_tests_name("watch", tests, NULL, NULL);
}
