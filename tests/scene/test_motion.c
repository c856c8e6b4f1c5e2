/* Motions of cameras (scene/motion.h): by numbers computed by hand, there and back, and what a set
 * of poses has in common. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "scene/motion.h"
#include "tests.h"

enum { POSES = 12 };

static double random_number(int i, int k)
{
    return cln_hash((uint32_t)(64 * i + k) + 7) / 2147483648.0 - 1;
}

/* A rotation by three planes' turns, and a place. */
static void make_pose(int i, double out[12])
{
    memset(out, 0, 12 * sizeof *out);
    out[0] = out[5] = out[10] = 1;
    for (int plane = 0; plane < 3; plane++) {
        const double c = cos(3 * random_number(i, plane)), s = sin(3 * random_number(i, plane));

        for (int row = 0; row < 3; row++) {
            double *m = out + 4 * row, a = m[plane], b = m[(plane + 1) % 3];

            m[plane] = c * a - s * b;
            m[(plane + 1) % 3] = s * a + c * b;
        }
    }
    for (int a = 0; a < 3; a++)
        out[4 * a + 3] = 100 + 4 * random_number(i, 3 + a);
}

static void assert_near(const double *got, const double *want, int n, double bound)
{
    for (int i = 0; i < n; i++)
        if (!(fabs(got[i] - want[i]) <= bound))
            fail_msg("number %d is %.12g, not %.12g", i, got[i], want[i]);
}

/* A camera that looks along the scene's x, its right being -y: turned a quarter to the left, then
 * moved one to its right, two down, three ahead of where it looked before. */
static void test_by_hand(void **state)
{
    const double c2w[12] = {0, 0, 1, 10, -1, 0, 0, 20, 0, -1, 0, 30};
    const double motion[6] = {0, -M_PI / 2, 0, 1, 2, 3};
    const double want[12] = {1, 0, 0, 13, 0, 0, 1, 19, 0, -1, 0, 28};
    double got[12], back[6];

    (void)state;
    cln_motion_apply(c2w, motion, got);
    assert_near(got, want, 12, 1e-12);
    cln_motion_between(c2w, want, back);
    assert_near(back, motion, 6, 1e-12);
}

static void test_there_and_back(void **state)
{
    static const double sizes[] = {0, 1e-12, 1e-8, 1e-6, 1e-3, 0.1, 1, 3};

    (void)state;
    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++)
        for (int i = 0; i < POSES; i++) {
            double from[12], to[12], motion[6], got[6], length = 0;

            make_pose(i, from);
            for (int a = 0; a < 6; a++)
                motion[a] = random_number(i, 10 + a);
            for (int a = 0; a < 3; a++)
                length = hypot(length, motion[a]);
            for (int a = 0; a < 6; a++)
                motion[a] *= sizes[k] / length;
            cln_motion_apply(from, motion, to);
            for (int a = 0; a < 3; a++) /* a rotation it stays */
                for (int b = 0; b < 3; b++) {
                    double dot = 0;

                    for (int row = 0; row < 3; row++)
                        dot += to[4 * row + a] * to[4 * row + b];
                    assert_true(fabs(dot - (a == b)) < 1e-12);
                }
            cln_motion_between(from, to, got);
            assert_near(got, motion, 6, 1e-15 + 1e-12 * sizes[k] + 5e-14); /* places are at 100 */
        }
}

/* A common motion is removed except what the linear fit leaves of it; a second pass removes all of
 * it. */
static void test_hold_a_common_motion(void **state)
{
    double from[POSES][12], to[POSES][12];
    const double c = cos(0.01), s = sin(0.01), scale = 1.02;

    (void)state;
    for (int i = 0; i < POSES; i++) {
        make_pose(i, from[i]);
        for (int k = 0; k < 4; k++) { /* about z through the origin, 100 away from the middle */
            const double grown = k == 3 ? scale : 1;

            to[i][k] = grown * (c * from[i][k] - s * from[i][4 + k]);
            to[i][4 + k] = grown * (s * from[i][k] + c * from[i][4 + k]);
            to[i][8 + k] = grown * from[i][8 + k] + (k == 3 ? 0.5 : 0);
        }
    }
    for (int round = 0; round < 3; round++)
        cln_motion_hold(POSES, (const double(*)[12])from, 2, to);
    for (int i = 0; i < POSES; i++)
        assert_near(to[i], from[i], 12, 1e-9);
}

/* One camera's own motion stays its own: of 12 poses, the others follow by a twelfth or so. */
static void test_hold_one(void **state)
{
    double from[POSES][12], to[POSES][12], again[POSES][12], own[6];
    const double motion[6] = {1e-3, -2e-3, 5e-4, 0.01, -0.02, 0.015};

    (void)state;
    for (int i = 0; i < POSES; i++)
        make_pose(i, from[i]);
    memcpy(to, from, sizeof to);
    cln_motion_apply(from[3], motion, to[3]);
    cln_motion_hold(POSES, (const double(*)[12])from, 2, to);
    cln_motion_between(from[3], to[3], own);
    for (int k = 0; k < 6; k++)
        assert_true(fabs(own[k] - motion[k]) < 0.4 * fabs(motion[k < 3 ? 1 : 4]));
    for (int a = 0; a < 3; a++) { /* the middle stays */
        double sum = 0;

        for (int i = 0; i < POSES; i++)
            sum += to[i][4 * a + 3] - from[i][4 * a + 3];
        assert_true(fabs(sum) < 1e-5);
    }
    memcpy(again, to, sizeof again);
    cln_motion_hold(POSES, (const double(*)[12])from, 2, again);
    for (int i = 0; i < POSES; i++)
        assert_near(again[i], to[i], 12, 1e-5);
}

/* With one camera, or with cameras at one place, only their motion is common. */
static void test_hold_few(void **state)
{
    double from[2][12], to[2][12];
    const double motion[6] = {0.01, 0.02, 0.03, 0.1, 0.2, 0.3};

    (void)state;
    make_pose(0, from[0]);
    memcpy(from[1], from[0], sizeof from[1]);
    for (int count = 1; count <= 2; count++) {
        for (int i = 0; i < 2; i++)
            cln_motion_apply(from[i], motion, to[i]);
        cln_motion_hold(count, (const double(*)[12])from, 1, to);
        for (int i = 0; i < count; i++)
            assert_near(to[i], from[i], 12, 1e-9);
    }
}

int test_group_motion(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_hand),
        cmocka_unit_test(test_there_and_back),
        cmocka_unit_test(test_hold_a_common_motion),
        cmocka_unit_test(test_hold_one),
        cmocka_unit_test(test_hold_few),
    };

    return cmocka_run_group_tests_name("motion", tests, NULL, NULL);
}
