/* The float64 reference itself, second half: rays through the tree, stage 1 and stage 2 sampling,
 * keys, bfloat16. Oracles: point membership by cln_octree_find, a second implementation of the
 * piecewise-linear distribution function, hand-computed numbers. */
#include "unit.h"
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/rng.h"
#include "draws.h"
#include "near.h"
#include "reference/reference.h"
#include "tests.h"

enum { MAX_INTERVALS = 256 };

/* ---- rays ---- */

/* Full tree at `level`; `mixed`: then a third of its leaves split, and a third of all culled. */
static void make_tree(int level, bool mixed, cln_octree *tree)
{
    uint8_t mark[4096];
    cln_octree_change change = {0};

    assert_int_equal(cln_octree_create(level, tree), CLN_OK);
    if (!mixed)
        return;
    for (int s = 0; s < tree->leaf_count; s++)
        mark[s] = uniform(10, s, 0, 1) < 0.33;
    assert_int_equal(cln_octree_split(tree, mark, &change), CLN_OK);
    cln_octree_change_free(&change);
    assert_true(tree->leaf_count <= (int)sizeof mark);
    for (int s = 0; s < tree->leaf_count; s++)
        mark[s] = uniform(11, s, 0, 1) < 0.33;
    assert_int_equal(cln_octree_cull(tree, mark, &change), CLN_OK);
    cln_octree_change_free(&change);
}

static void point_at(const double o[3], const double d[3], double t, double p[3])
{
    for (int a = 0; a < 3; a++)
        p[a] = o[a] + t * d[a];
}

/* Part of the ray inside the closed cube, t >= 0; false if none. */
static bool cube_chord(const double o[3], const double d[3], double *t_in, double *t_out)
{
    *t_in = 0;
    *t_out = 1e9;
    for (int a = 0; a < 3; a++) {
        if (d[a] == 0) {
            if (fabs(o[a]) > 1)
                return false;
            continue;
        }
        *t_in = fmax(*t_in, (-copysign(1, d[a]) - o[a]) / d[a]);
        *t_out = fmin(*t_out, (copysign(1, d[a]) - o[a]) / d[a]);
    }
    return *t_out > *t_in;
}

/* Checks invariants of one ray's intervals, without slab tests; returns their count. */
static int check_ray(const cln_octree *tree, bool whole, const double o[3], const double d[3])
{
    ref_interval iv[MAX_INTERVALS];
    double t_in = 0, t_out = 0, total = 0, p[3];
    bool inside = cube_chord(o, d, &t_in, &t_out);
    int n = ref_intervals(tree, o, d, iv, MAX_INTERVALS);

    assert_true(n <= MAX_INTERVALS);
    for (int i = 0; i < n; i++) {
        assert_true(iv[i].t_out - iv[i].t_in > 1e-5);
        assert_true(i == 0 ? iv[i].t_in >= 0 : iv[i].t_in >= iv[i - 1].t_out - 1e-12);
        for (int k = 1; k < 4; k++) {
            point_at(o, d, iv[i].t_in + (iv[i].t_out - iv[i].t_in) * k / 4, p);
            assert_int_equal(cln_octree_find(tree, p), iv[i].slot);
        }
        total += iv[i].t_out - iv[i].t_in;
    }
    if (!inside) {
        assert_int_equal(n, 0);
        return 0;
    }
    if (whole)
        assert_near(total, t_out - t_in, 1e-5 * (n + 1));
    /* Points between intervals are in no ACTIVE leaf, except for chords too short to count. */
    for (int i = 0; i <= n; i++) {
        double a = i == 0 ? t_in : iv[i - 1].t_out, b = i == n ? t_out : iv[i].t_in;

        for (int k = 1; k < 8 && b - a > 4e-5; k++) {
            point_at(o, d, a + (b - a) * k / 8, p);
            assert_int_equal(cln_octree_find(tree, p), -1);
        }
    }
    return n;
}

static void random_direction(int i, double d[3])
{
    double length = 0;

    for (int a = 0; a < 3; a++)
        d[a] = uniform(20, 3 * i + a, -1, 1);
    length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int a = 0; a < 3; a++)
        d[a] /= length;
}

static void test_random_rays(void **state)
{
    int hits = 0;

    (void)state;
    for (int level = 0; level <= 3; level++) {
        for (int mixed = 0; mixed < 2; mixed++) {
            cln_octree tree;

            make_tree(level, mixed, &tree);
            for (int i = 0; i < 150; i++) {
                double o[3], d[3];

                random_direction(i, d);
                for (int a = 0; a < 3;
                     a++) /* a third start inside the cube, the others aim at it */
                    o[a] = uniform(21, 3 * i + a, -0.9, 0.9) - (i % 3 ? 4 * d[a] : 0);
                hits += check_ray(&tree, !mixed, o, d) > 0;
            }
            cln_octree_free(&tree);
        }
    }
    assert_true(hits > 800); /* of 1,200: the checks above are not vacuous */
}

/* Rays on which a naive slab test divides by zero, or finds a leaf twice or none at all. */
static void test_awkward_rays(void **state)
{
    const double r2 = sqrt(0.5), r3 = sqrt(1.0 / 3);
    const struct {
        double o[3], d[3];
    } rays[] = {
        {{-3, 0.1, 0.2}, {1, 0, 0}},             /* axis-parallel through leaves */
        {{0.1, 3, 0.2}, {0, -1, 0}},             /* the other way */
        {{-3, 0, 0.3}, {1, 0, 0}},               /* in the plane between leaves */
        {{-3, 0, 0}, {1, 0, 0}},                 /* along an edge of four leaves */
        {{-3, 1, 0.3}, {1, 0, 0}},               /* in the cube's upper face, which belongs to it */
        {{-3, -1, 0.3}, {1, 0, 0}},              /* in its lower face */
        {{-3, 1, 1}, {1, 0, 0}},                 /* along its last edge */
        {{-2, -2, -2}, {r3, r3, r3}},            /* through opposite corners */
        {{2, 2, 2}, {-r3, -r3, -r3}},            /* and back */
        {{-2, -2, 0.3}, {r2, r2, 0}},            /* through edges */
        {{-2, -1, 0.3}, {r2, r2, 0}},            /* hits the cube in an edge of its face */
        {{0, 0, 0}, {1, 0, 0}},                  /* from the centre, a corner of eight leaves */
        {{0, 0, 0}, {-r3, r3, -r3}},             /* */
        {{0.1, 0.2, 0.3}, {0, 0, 1}},            /* from inside */
        {{1, 0.2, 0.3}, {-1, 0, 0}},             /* from a face, inwards */
        {{0.1, 0.2, 0.3}, {-0.0, 1, -0.0}},      /* negative zeros */
        {{0.1, 0.2, 0.3}, {1, 1e-300, -1e-300}}, /* almost parallel */
        {{0.5, -2, 0.25}, {1e-17, 1, 0}},        /* almost in a plane */
        {{-2, 0.999999, 0.3}, {1, 1e-7, 0}},     /* grazes the upper face from inside */
    };

    (void)state;
    for (int level = 0; level <= 3; level++) {
        for (int mixed = 0; mixed < 2; mixed++) {
            cln_octree tree;

            make_tree(level, mixed, &tree);
            for (size_t i = 0; i < sizeof rays / sizeof rays[0]; i++) {
                int n = check_ray(&tree, !mixed, rays[i].o, rays[i].d);

                if (!mixed && n == 0)
                    fail_msg("ray %zu, level %d: meets no leaf", i, level);
            }
            cln_octree_free(&tree);
        }
    }
}

static void test_missing_rays(void **state)
{
    static const double o[][3] = {{-3, 0.1, 0.2}, {-3, 1.01, 0}, {1, 0.2, 0.3},
                                  {3, 3, 3},      {-3, 0, 0},    {0, -5, 2}};
    static const double d[][3] = {{-1, 0, 0}, {1, 0, 0}, {1, 0, 0},
                                  {0, 0, 1},  {0, 1, 0}, {0, 1, 0}};
    cln_octree tree;
    ref_interval iv[4];

    (void)state;
    make_tree(2, false, &tree);
    for (size_t i = 0; i < sizeof o / sizeof o[0]; i++)
        assert_int_equal(ref_intervals(&tree, o[i], d[i], iv, 4), 0);
    cln_octree_free(&tree);
}

static void test_ray_by_hand(void **state)
{
    const double o[3] = {-2, 0.5, 0.5}, d[3] = {1, 0, 0}, back[3] = {-1, 0, 0},
                 inside[3] = {0.5, 0.5, 0.5};
    cln_octree tree;
    ref_interval iv[8];

    (void)state;
    make_tree(1, false, &tree);
    assert_int_equal(ref_intervals(&tree, o, d, iv, 8), 2);
    assert_int_equal(iv[0].slot, 6); /* octants y and z upper: 2 + 4, then x too */
    assert_int_equal(iv[1].slot, 7);
    assert_true(iv[0].t_in == 1 && iv[0].t_out == 2 && iv[1].t_in == 2 && iv[1].t_out == 3);
    assert_int_equal(ref_intervals(&tree, inside, back, iv, 8), 2);
    assert_int_equal(iv[0].slot, 7);
    assert_true(iv[0].t_in == 0 && iv[0].t_out == 0.5 && iv[1].t_out == 1.5);
    cln_octree_free(&tree);

    /* With too little room the nearest are kept; the count still includes all. */
    make_tree(3, false, &tree);
    assert_int_equal(ref_intervals(&tree, o, d, iv, 3), 8);
    for (int i = 0; i < 3; i++)
        assert_true(iv[i].t_in == 1 + 0.25 * i && iv[i].t_out == 1.25 + 0.25 * i);
    assert_int_equal(ref_intervals(&tree, o, d, NULL, 0), 8);
    cln_octree_free(&tree);
}

/* ---- stage 1 ---- */

static void test_gather(void **state)
{
    const float box[4] = {0, 0, 0, 1};
    const double o[3] = {-1, 0.3, 0.6}, d[3] = {1, 0, 0}, corner[3] = {0, 0, 0};
    const double r3 = sqrt(1.0 / 3), diagonal[3] = {r3, r3, r3};
    const ref_interval through = {0, 1, 2}, diagonal_iv = {0, 0, sqrt(3)}, brief = {0, 1.6, 1.6001};
    float cache[64];
    double t[8], sigma[8];

    (void)state;
    for (int i = 0; i < 64; i++)
        cache[i] = (float)i;
    assert_int_equal(ref_gather(o, d, &through, box, cache, 4, t, sigma, 8), 4);
    for (int j = 0; j < 4; j++) { /* cell (j, 1, 2) */
        assert_near(t[j], 1.125 + 0.25 * j, 1e-15);
        assert_true(sigma[j] == (2 * 4 + 1) * 4 + j);
    }
    assert_int_equal(ref_gather(corner, diagonal, &diagonal_iv, box, cache, 4, t, sigma, 8), 7);
    for (int j = 0; j < 7; j++) {
        assert_near(t[j], sqrt(3) * (j + 0.5) / 7, 1e-15);
        if (j != 3) /* that one lies on a corner of cells */
            assert_true(sigma[j] == 21 * floor(4 * (j + 0.5) / 7));
    }
    assert_int_equal(ref_gather(o, d, &brief, box, cache, 4, t, sigma, 8), 1);
    assert_near(t[0], 1.60005, 1e-12);
    assert_true(sigma[0] == (2 * 4 + 1) * 4 + 2);
    t[2] = -7;
    assert_int_equal(ref_gather(o, d, &through, box, cache, 4, t, sigma, 2), 4);
    assert_true(t[2] == -7);
}

static void test_bf16(void **state)
{
    static const struct {
        float value;
        uint16_t bits;
    } known[] = {
        {0.0f, 0x0000},        {-0.0f, 0x8000},         {1.0f, 0x3f80},        {-2.5f, 0xc020},
        {0x1.01p0f, 0x3f80}, /* tie, to even, down */
        {0x1.03p0f, 0x3f82}, /* tie, to even, up */
        {0x1.0101p0f, 0x3f81}, {3.3895314e38f, 0x7f7f}, {FLT_MAX, 0x7f80},     {0x1p-133f, 0x0001},
        {0x1p-134f, 0x0000},   {INFINITY, 0x7f80},      {3.14159265f, 0x4049},
    };
    const uint32_t nan_bits = 0x7f800001; /* its payload is in the dropped half */
    float nan = 0;

    (void)state;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        assert_int_equal(ref_to_bf16(known[i].value), known[i].bits);
    memcpy(&nan, &nan_bits, sizeof nan);
    assert_true(isnan(ref_from_bf16(ref_to_bf16(nan))));
    /* Every finite bfloat16 is preserved; values between two are rounded to the nearer one. */
    for (uint32_t b = 0; b < 0x7f7f; b++) {
        uint16_t bits = (uint16_t)b;
        float low = ref_from_bf16(bits), high = ref_from_bf16((uint16_t)(b + 1));
        float between = low + (high - low) * (float)uniform(30, (int)b, 0, 1);
        double got = ref_from_bf16(ref_to_bf16(between));

        assert_int_equal(ref_to_bf16(low), bits);
        assert_int_equal(ref_to_bf16(-low), bits | 0x8000);
        assert_true(fabs(got - between) <= fmin((double)between - low, (double)high - between));
    }
}

/* Keys are ordered like (list, t), also at the extremes of both. */
static void test_keys(void **state)
{
    static const uint32_t lists[] = {0, 1, 2, 639999, 0x7fffffff, 0x80000000u, 0xffffffffu};
    static const float ts[] = {0, 0x1p-149f,     FLT_MIN, 1e-30f, 0.1f,
                               1, 0x1.000002p0f, 6,       1e30f,  FLT_MAX};
    enum { LISTS = sizeof lists / sizeof lists[0], TS = sizeof ts / sizeof ts[0] };

    (void)state;
    for (int a = 0; a < LISTS * TS; a++) {
        for (int b = 0; b < LISTS * TS; b++) {
            uint64_t ka = ref_key(lists[a / TS], ts[a % TS]),
                     kb = ref_key(lists[b / TS], ts[b % TS]);

            assert_int_equal(ka < kb, a < b); /* both tables are ascending */
            assert_int_equal(ka == kb, a == b);
        }
    }
    assert_true(ref_key(5, -0.0f) == ref_key(5, 0.0f));
}

/* ---- stage 2 ---- */

static void test_sample_count(void **state)
{
    const ref_sampling chord = {false, false, 32, 64, 0.25, 1e-4, 0, 1};
    const ref_sampling weight = {true, true, 8, 16, 0.25, 1e-3, 1e-2, 0.25};
    const double half = log(2), diagonal = sqrt(3) * 0.25;

    (void)state;
    assert_int_equal(ref_sample_count(&chord, diagonal * 0.999, 0.25, 0, 0, 0), 32);
    assert_int_equal(ref_sample_count(&chord, diagonal / 2 * 0.999, 0.25, 0, 0, 0), 16);
    assert_int_equal(ref_sample_count(&chord, diagonal / 2 * 1.001, 0.25, 0, 0, 0), 17);
    assert_int_equal(ref_sample_count(&chord, 1e-5, 0.25, 0, 0, 0), 1);
    assert_int_equal(ref_sample_count(&chord, 0.25, 0.25, 9.2, 0, 0), 19); /* exp(-9.2) = 1.01e-4 */
    assert_int_equal(ref_sample_count(&chord, 0.25, 0.25, 9.3, 0, 0), 0);

    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 0, 80, 0.9), 8);          /* 17, capped */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 2 * half, half, 0.9), 3); /* 1 + 16/8 */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 5 * half, half, 0.9), 1); /* 1 + .25 */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 4.9 * half, 80, 0.9), 2); /* 1 + .536 */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 6 * half, half, 0.9), 0); /* 1/128 */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 6 * half, half, 0.2), 1);
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 6 * half, half, 0.25), 0);
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 10, 80, 0),
                     0); /* occluded: no roulette */
    assert_int_equal(ref_sample_count(&weight, 0.1, 0.25, 0, 0, 0.9), 0);
}

/* All mass in the third of four cells: without a uniform share all samples lie there, evenly. */
static void test_step_density(void **state)
{
    const double t[4] = {2.25, 2.75, 3.25, 3.75}, sigma[4] = {0, 0, 10, 0};
    ref_sampling s = {false, false, 32, 64, 0, 0, 0, 1};
    double xi[200], out[200];

    (void)state;
    for (int k = 0; k < 200; k++)
        xi[k] = 0.5;
    for (int cdf = 0; cdf < 2; cdf++) {
        int inside = 0;

        s.cdf_weight = cdf;
        s.uniform_share = 0;
        ref_sample_positions(&s, 2, 4, (ref_points){4, t, sigma, NULL}, 10, xi, out);
        for (int k = 0; k < 10; k++) {
            double u = (k + 0.5) / 10;

            assert_true(out[k] > 3 && out[k] < 3.5);
            assert_near(out[k], 3 + 0.5 * u, 1e-4);
        }
        /* A quarter uniform: 0.75 + 0.25 / 4 of them in the cell. */
        s.uniform_share = 0.25;
        ref_sample_positions(&s, 2, 4, (ref_points){4, t, sigma, NULL}, 200, xi, out);
        for (int k = 0; k < 200; k++)
            inside += out[k] > 3 && out[k] < 3.5;
        assert_true(inside >= 162 && inside <= 163);
    }
    /* Two equal thick cells: density samples both alike, weight scales the second by e^-5. */
    {
        const double thick[4] = {0, 10, 10, 0};
        int second[2] = {0, 0};

        s.uniform_share = 0;
        for (int cdf = 0; cdf < 2; cdf++) {
            s.cdf_weight = cdf;
            ref_sample_positions(&s, 2, 4, (ref_points){4, t, thick, NULL}, 200, xi, out);
            for (int k = 0; k < 200; k++)
                second[cdf] += out[k] >= 3;
        }
        assert_int_equal(second[0], 100);
        assert_int_equal(second[1], 1); /* 200 e^-5 / (1 + e^-5) = 1.34 */
    }
}

/* The mixed distribution function of method.md 7 at t, from arrays of edges and masses. */
static double distribution(const ref_sampling *s, double t_in, double t_out, int m, const double *t,
                           const double *sigma, double at)
{
    double e[65], p[64], sum = 0, mean = 0, trans = 1, total = 0, length = t_out - t_in;

    e[0] = t_in;
    e[m] = t_out;
    for (int j = 1; j < m; j++)
        e[j] = fmin(fmax((t[j - 1] + t[j]) / 2, t_in), t_out);
    for (int j = 0; j < m; j++)
        mean += sigma[j] * (e[j + 1] - e[j]) / length;
    for (int j = 0; j < m; j++) {
        double width = e[j + 1] - e[j];

        p[j] = (sigma[j] + 1e-5 * (mean > 1 ? mean : 1)) * width;
        if (s->cdf_weight)
            p[j] = trans * (1 - exp(-sigma[j] * width)) + 1e-5 * width / length;
        trans *= exp(-sigma[j] * width);
        sum += p[j];
    }
    for (int j = 0; j < m; j++) {
        double width = e[j + 1] - e[j];
        double q = (1 - s->uniform_share) * p[j] / sum + s->uniform_share * width / length;

        if (at >= e[j + 1])
            total += q;
        else if (at > e[j])
            total += q * (at - e[j]) / width;
    }
    return total;
}

/* The distribution function at each position equals the u that it was drawn for. Densities up to
 * 1e6, points outside the chord, equal points, no points. */
static void test_positions(void **state)
{
    (void)state;
    for (int c = 0; c < 200; c++) {
        ref_sampling s = {false, c % 2, 32, 64, c % 3 * 0.25, 0, 0, 1};
        double t_in = uniform(40, 3 * c, 0, 5), t_out = t_in + uniform(40, 3 * c + 1, 1e-4, 0.5);
        double t[64], sigma[64], xi[40], out[40], scale = pow(10, c % 9 - 2);
        int m = c % 5 == 0 ? c % 2 : 1 + c % 64, n = 1 + c % 40;

        for (int j = 0; j < m; j++) {
            t[j] = t_in + (t_out - t_in) * ((j + uniform(41, 64 * c + j, 0, 1)) / m * 1.2 - 0.1);
            sigma[j] = uniform(42, 64 * c + j, -1, 1) * scale;
            if (sigma[j] < 0)
                sigma[j] = 0;
            if (c % 7 == 0 && j > 0)
                t[j] = t[j - 1];
        }
        for (int k = 0; k < n; k++)
            xi[k] = uniform(43, 40 * c + k, 0, 1);
        ref_sample_positions(&s, t_in, t_out, (ref_points){m, t, sigma, NULL}, n, xi, out);
        for (int k = 0; k < n; k++) {
            double u = (k + xi[k]) / n;

            assert_true(out[k] >= t_in && out[k] <= t_out);
            assert_true(k == 0 || out[k] >= out[k - 1]);
            if (m == 0)
                assert_near(out[k], t_in + u * (t_out - t_in), 1e-12);
            else
                assert_near(distribution(&s, t_in, t_out, m, t, sigma, out[k]), u, 1e-7);
        }
    }
}

static void test_deltas(void **state)
{
    const double three[3] = {1.1, 1.3, 1.8};
    double t[64], delta[64];

    (void)state;
    ref_deltas(1, 2, 3, three, delta);
    assert_near(delta[0], 0.2, 1e-15);
    assert_near(delta[1], 0.35, 1e-15);
    assert_near(delta[2], 0.45, 1e-15);
    ref_deltas(1, 2, 1, three, delta);
    assert_near(delta[0], 1, 0);
    delta[0] = -7;
    ref_deltas(1, 2, 0, three, delta);
    assert_true(delta[0] == -7);
    for (int n = 1; n <= 64; n++) {
        double t_in = uniform(50, n, 0, 4), t_out = t_in + uniform(51, n, 1e-5, 1), sum = 0;

        for (int k = 0; k < n; k++)
            t[k] = t_in + (t_out - t_in) * (k + uniform(52, 64 * n + k, 0, 1)) / n;
        ref_deltas(t_in, t_out, n, t, delta);
        for (int k = 0; k < n; k++) {
            assert_true(delta[k] > 0);
            sum += delta[k];
        }
        assert_near(sum, t_out - t_in, 1e-14);
    }
}

int test_group_reference_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_random_rays),  cmocka_unit_test(test_awkward_rays),
        cmocka_unit_test(test_missing_rays), cmocka_unit_test(test_ray_by_hand),
        cmocka_unit_test(test_gather),       cmocka_unit_test(test_bf16),
        cmocka_unit_test(test_keys),         cmocka_unit_test(test_sample_count),
        cmocka_unit_test(test_step_density), cmocka_unit_test(test_positions),
        cmocka_unit_test(test_deltas),
    };

    return cmocka_run_group_tests_name("reference_rays", tests, NULL, NULL);
}
