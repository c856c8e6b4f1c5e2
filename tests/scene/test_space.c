/* Scene space and cube, against numbers calculated by hand and against each other. Tested: points,
 * rays, poses, distances and boxes agree on one map; being in the cube, or meeting it, is the same
 * on both sides of the map; boxes of neighbours share their faces to the bit. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <math.h>
#include "base/rng.h"
#include "near.h"
#include "scene/space.h"
#include "tests.h"

static const cln_space space = {{10, -20, 0.5}, 4};

static void test_by_hand(void **state)
{
    const double c2w[12] = {0, 0, 1, 14, 1, 0, 0, -20, 0, 1, 0, -1.5};
    const float posed[12] = {0, 0, 1, 1, 1, 0, 0, 0, 0, 1, 0, -0.5f};
    const float cube[4] = {-1, 0, 0.5f, 0.5f};
    double p[3], o[3], d[3];
    float out[12], low[3], high[3];

    (void)state;
    cln_space_point_to_cube(&space, (double[3]){12, -24, 0.5}, p);
    assert_near(p[0], 0.5, 0);
    assert_near(p[1], -1, 0);
    assert_near(p[2], 0, 0);
    cln_space_point_to_scene(&space, (double[3]){-1, 0.25, 1}, p);
    assert_near(p[0], 6, 0);
    assert_near(p[1], -19, 0);
    assert_near(p[2], 4.5, 0);
    cln_space_ray_to_cube(&space, (double[3]){6, -20, 8.5}, (double[3]){0, 0.6, -0.8}, o, d);
    assert_near(o[0], -1, 0);
    assert_near(o[1], 0, 0);
    assert_near(o[2], 2, 0);
    assert_near(d[1], 0.6, 0);
    assert_near(d[2], -0.8, 0);
    cln_space_pose_to_cube(&space, c2w, out);
    assert_memory_equal(out, posed, sizeof posed);
    assert_near(cln_space_distance_to_scene(&space, 0.75), 3, 0);
    assert_near(cln_space_depth_to_scene(&space, 0.75f), 3, 0);
    assert_near(cln_space_density_to_scene(&space, 6), 1.5, 0);
    cln_space_box_to_scene(&space, cube, low, high);
    assert_near(low[0], 6, 0);
    assert_near(high[0], 8, 0);
    assert_near(low[1], -20, 0);
    assert_near(high[1], -18, 0);
    assert_near(low[2], 2.5, 0);
    assert_near(high[2], 4.5, 0);
}

/* A point at distance t along a ray is the same point on both sides. */
static void test_one_map(void **state)
{
    int inside = 0, met = 0;

    (void)state;
    for (uint32_t i = 0; i < 2000; i++) {
        double o[3], d[3], q[3], e[3], at[3], back[3], length = 0, most = 0, steps = 0;
        float r[4], s[4];
        bool hit = false;

        cln_uniform4(1, CLN_STREAM_SCENE, 0, i, 0, r);
        cln_uniform4(1, CLN_STREAM_SCENE, 1, i, 0, s);
        for (int a = 0; a < 3; a++) {
            o[a] = space.centre[a] + 10 * ((double)r[a] - 0.5);
            d[a] = (double)s[a] - 0.5;
            length += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(length);
        cln_space_ray_to_cube(&space, o, d, q, e);
        for (int a = 0; a < 3; a++)
            at[a] = q[a] + (double)r[3] * e[a];
        cln_space_point_to_scene(&space, at, back);
        for (int a = 0; a < 3; a++)
            assert_near(back[a], o[a] + cln_space_distance_to_scene(&space, (double)r[3]) * d[a],
                        1e-13);
        cln_space_point_to_cube(&space, back, back);
        for (int a = 0; a < 3; a++) {
            assert_near(back[a], at[a], 1e-14);
            most = fmax(most, fabs(q[a]));
        }
        assert_int_equal(cln_space_holds(&space, o), most <= 1);
        inside += most <= 1;
        /* If small steps along the ray find the cube, the ray meets it. */
        for (steps = 0; steps < 5 && !hit; steps += 0.01) {
            most = 0;
            for (int a = 0; a < 3; a++)
                most = fmax(most, fabs(q[a] + steps * e[a]));
            hit = most < 1;
        }
        if (hit)
            assert_true(cln_space_met_by(&space, o, d));
        met += hit;
    }
    assert_in_range(inside, 700, 1300);
    assert_in_range(met, inside + 1, 1900);
    /* Outside a face: parallel to it, away from it. */
    assert_false(cln_space_met_by(&space, (double[3]){15, -20, 0}, (double[3]){0, 0, 1}));
    assert_true(cln_space_met_by(&space, (double[3]){13, -20, -50}, (double[3]){0, 0, 1}));
    assert_false(cln_space_met_by(&space, (double[3]){13, -20, -50}, (double[3]){0, 0, -1}));
}

static void test_faces_and_equality(void **state)
{
    const cln_space odd = {{1.0 / 3, -2.0 / 7, 1e-3}, 0.1 / 0.33};
    const float left[4] = {-0.5f, 0.25f, 0, 0.125f}, right[4] = {-0.375f, 0.25f, 0, 0.0625f};
    float low[2][3], high[2][3];
    cln_space other = odd;

    (void)state;
    cln_space_box_to_scene(&odd, left, low[0], high[0]);
    cln_space_box_to_scene(&odd, right, low[1], high[1]);
    assert_memory_equal(&high[0][0], &low[1][0], sizeof high[0][0]);
    assert_memory_equal(&low[0][1], &low[1][1], sizeof low[0][1]);
    assert_true(cln_space_equal(&odd, &other));
    other.half *= 1 + 1e-7;
    other.centre[1] += 1e-8;
    assert_true(cln_space_equal(&odd, &other));
    other.half *= 1.00001;
    assert_false(cln_space_equal(&odd, &other));
    other = odd;
    other.centre[2] += 1e-5;
    assert_false(cln_space_equal(&odd, &other));
}

int test_group_space(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_hand),
        cmocka_unit_test(test_one_map),
        cmocka_unit_test(test_faces_and_equality),
    };

    return cmocka_run_group_tests_name("space", tests, NULL, NULL);
}
