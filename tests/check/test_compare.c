/* The comparison that every check of a kernel rests on: errors by hand, and verdicts on both sides
 * of each bound. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "check/compare.h"
#include "near.h"
#include "tests.h"

enum { N = 4 };
static const double want[N] = {2, -2, 2, -2}; /* rms 2 */

static void test_error(void **state)
{
    const float same[N] = {2, -2, 2, -2}, off[N] = {2, -2.25f, 1, -2};
    const float infinite[N] = {2, -2, 2, -INFINITY}, unknown[N] = {NAN, -2, 2, -2};
    const double zero[N] = {0};
    const float none[N] = {0};
    cln_error e = cln_check_error(same, want, N);

    (void)state;
    assert_true(e.nmse == 0 && e.worst == 0);
    e = cln_check_error(off, want, N);
    assert_near(e.nmse, (1 + 0.0625) / 16, 1e-12);
    assert_near(e.worst, 0.5, 1e-12);
    assert_int_equal((int)e.at, 2);
    e = cln_check_error(infinite, want, N);
    assert_true(isinf(e.nmse) && isinf(e.worst) && e.at == 3);
    e = cln_check_error(unknown, want, N);
    assert_true(isinf(e.nmse) && isinf(e.worst) && e.at == 0);
    e = cln_check_error(none, zero, N);
    assert_true(e.nmse == 0 && e.worst == 0);
    e = cln_check_error(same, zero, N);
    assert_true(isinf(e.nmse) && isinf(e.worst));
}

/* An NMSE of 0.0664, and a worst error of half of the rms. */
static void test_verdict(void **state)
{
    const float off[N] = {2, -2.25f, 1, -2}, unknown[N] = {NAN, -2, 2, -2};
    char text[256];

    (void)state;
    assert_true(cln_compare_values(off, want, N, 0.07, 0.51, text));
    assert_non_null(strstr(text, "98.0 % of the bound, 4 elements"));
    assert_false(cln_compare_values(off, want, N, 0.07, 0.49, text));
    assert_non_null(strstr(text, "element 2 of 4 is 1, should be 2"));
    assert_false(cln_compare_values(off, want, N, 0.06, 0.51, text));
    assert_false(cln_compare_values(off, want, 0, 0.07, 0.51, text)); /* nothing was compared */
    assert_false(cln_compare_values(unknown, want, N, 1e9, 1e9, text));
}

int test_group_compare(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_error),
                                       cmocka_unit_test(test_verdict)};

    return cmocka_run_group_tests_name("compare", tests, NULL, NULL);
}
