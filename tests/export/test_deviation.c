/* Distances of points from triangles by a grid (host/export/deviation.h), against every triangle by
 * another formula: balls, thin and large triangles, points far outside; one triangle; none. */
#include "unit.h"
#include <math.h>
#include "base/rng.h"
#include "export/deviation.h"
#include "near.h"
#include "tests.h"

enum { MOST = 400, CORNERS = 3 * MOST };

static double draw(uint32_t *seed) /* 0 to 1 */
{
    *seed = cln_hash(*seed + 1);
    return (*seed >> 8) / 16777216.0;
}

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double from_edge(const double p[3], const double a[3], const double b[3])
{
    double ab[3], ap[3], along = 0, square = 0;

    for (int i = 0; i < 3; i++) {
        ab[i] = b[i] - a[i];
        ap[i] = p[i] - a[i];
    }
    along = dot(ab, ab) > 0 ? fmax(0, fmin(1, dot(ab, ap) / dot(ab, ab))) : 0;
    for (int i = 0; i < 3; i++)
        square += (ap[i] - along * ab[i]) * (ap[i] - along * ab[i]);
    return sqrt(square);
}

/* From the plane if the point is above the triangle, else from the nearest edge. */
static double from_triangle(const double p[3], double corner[3][3])
{
    double least = INFINITY, normal[3], side[3][3];
    bool above = true;

    for (int k = 0; k < 3; k++) {
        least = fmin(least, from_edge(p, corner[k], corner[(k + 1) % 3]));
        for (int i = 0; i < 3; i++)
            side[k][i] = corner[(k + 1) % 3][i] - corner[k][i];
    }
    for (int i = 0; i < 3; i++)
        normal[i] = side[0][(i + 1) % 3] * side[1][(i + 2) % 3] -
                    side[0][(i + 2) % 3] * side[1][(i + 1) % 3];
    for (int k = 0; k < 3; k++) {
        double inwards[3], to[3];

        for (int i = 0; i < 3; i++) {
            inwards[i] = normal[(i + 1) % 3] * side[k][(i + 2) % 3] -
                         normal[(i + 2) % 3] * side[k][(i + 1) % 3];
            to[i] = p[i] - corner[k][i];
        }
        above = above && dot(inwards, to) > 0;
    }
    if (above) {
        double to[3];

        for (int i = 0; i < 3; i++)
            to[i] = p[i] - corner[0][i];
        return fabs(dot(to, normal)) / sqrt(dot(normal, normal));
    }
    return least;
}

static void test_distances(void **state)
{
    static float at[CORNERS][3];
    static uint32_t face[MOST][3];
    uint32_t seed = 1;

    (void)state;
    for (int round = 0; round < 60; round++) {
        const int faces = round < 3 ? round + 1 : (int)(draw(&seed) * (MOST - 1)) + 1;
        const double size = round % 3 == 0 ? 0.05 : round % 3 == 1 ? 0.4 : 3;

        for (int v = 0; v < 3 * faces; v++)
            for (int i = 0; i < 3; i++) /* every fifth round is flat */
                at[v][i] = (float)((v % 3 ? (double)at[v - v % 3][i] : 2 * draw(&seed) - 1) +
                                   (round % 5 == 4 && i == 2 ? 0 : size * (draw(&seed) - 0.5)));
        for (int k = 0; k < 3 * faces; k++)
            face[k / 3][k % 3] = (uint32_t)k;
        for (int n = 0; n < 40; n++) {
            const double far = n % 4 == 3 ? 20 : 1.2;
            float point[1][3];
            double p[3], least = INFINITY, got = 0;

            for (int i = 0; i < 3; i++) {
                point[0][i] = (float)(far * (2 * draw(&seed) - 1));
                p[i] = (double)point[0][i];
            }
            for (int f = 0; f < faces; f++) {
                double corner[3][3];

                for (int k = 0; k < 9; k++)
                    corner[k / 3][k % 3] = (double)at[face[f][k / 3]][k % 3];
                least = fmin(least, from_triangle(p, corner));
            }
            assert_int_equal(cln_deviation(1, (const float(*)[3])point, (size_t)faces,
                                           (const uint32_t(*)[3])face, (const float(*)[3])at, &got),
                             CLN_OK);
            assert_near(got, least, 1e-9);
        }
    }
}

/* The largest of several points, which one of very many may miss; without triangles there is none.
 */
static void test_largest(void **state)
{
    static const float at[3][3] = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
    static const uint32_t face[1][3] = {{0, 1, 2}};
    static const float points[4][3] = {{0.2f, 0.2f, 0.5f}, {0, 0, -2}, {0.3f, 0.3f, 0}, {0, -1, 0}};
    double got = 0;

    (void)state;
    assert_int_equal(cln_deviation(4, points, 1, face, at, &got), CLN_OK);
    assert_near(got, 2, 1e-12);
    assert_int_equal(cln_deviation(4, points, 0, face, at, &got), CLN_OK);
    assert_true(got == 0);
}

int test_group_deviation(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_distances),
        cmocka_unit_test(test_largest),
    };

    return cmocka_run_group_tests_name("deviation of surfaces", tests, NULL, NULL);
}
