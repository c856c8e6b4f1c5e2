/* Surfaces cut to half-spaces (host/export/clip.h): a ball of triangles against the areas of a
 * sphere's zones, which go as their heights (Archimedes); what is inside stays bit for bit, new
 * sides lie in the planes, and triangles that shared a side still do. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "export/clip.h"
#include "export/marching.h"
#include "export/triangles.h"
#include "near.h"
#include "tests.h"

static const double ball = 0.61;

static cln_status ask_ball(void *user, size_t n, const float (*at)[4], float *values)
{
    (void)user;
    for (size_t i = 0; i < n; i++)
        values[i] = (float)(ball - sqrt((double)at[i][0] * at[i][0] + at[i][1] * at[i][1] +
                                        at[i][2] * at[i][2]));
    return CLN_OK;
}

static void make_ball(int cells, cln_surface *s)
{
    const cln_marching marching = {.cells = cells, .ask = ask_ball};

    memset(s, 0, sizeof *s);
    assert_int_equal(cln_marching_run(&marching, s), CLN_OK);
}

static double area_of(const cln_surface *s)
{
    double area = 0;

    for (size_t f = 0; f < s->faces; f++) {
        const float *a = s->at[s->face[f][0]], *b = s->at[s->face[f][1]], *c = s->at[s->face[f][2]];
        double n[3];

        for (int k = 0; k < 3; k++) {
            const int i = (k + 1) % 3, j = (k + 2) % 3;

            n[k] = ((double)b[i] - a[i]) * ((double)c[j] - a[j]) -
                   ((double)b[j] - a[j]) * ((double)c[i] - a[i]);
        }
        area += 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
    return area;
}

static double depth(const float planes[6][4], const float *p, int *nearest)
{
    double least = INFINITY;

    for (int i = 0; i < 6; i++) {
        const double d = (double)planes[i][0] * p[0] + (double)planes[i][1] * p[1] +
                         (double)planes[i][2] * p[2] + planes[i][3];

        if (d < least)
            *nearest = i;
        least = fmin(least, d);
    }
    return least;
}

static int by_side(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(uint32_t[2]));
}

/* Sides in one triangle alone have both ends in one of the planes; no side is in more than two. */
static size_t check_sides(const cln_surface *s, const float planes[6][4])
{
    uint32_t(*sides)[2] = calloc(3 * s->faces + 1, sizeof *sides);
    size_t n = 0, open = 0;

    assert_non_null(sides);
    for (size_t f = 0; f < s->faces; f++)
        for (int k = 0; k < 3; k++, n++) {
            const uint32_t a = s->face[f][k], b = s->face[f][(k + 1) % 3];

            assert_true(a < s->vertices && b < s->vertices && a != b);
            sides[n][0] = a < b ? a : b;
            sides[n][1] = a < b ? b : a;
        }
    qsort(sides, n, sizeof *sides, by_side);
    for (size_t i = 0, same; i < n; i += same) {
        for (same = 1; i + same < n && by_side(sides[i], sides[i + same]) == 0;)
            same++;
        assert_true(same <= 2);
        if (same == 1) {
            const float *a = s->at[sides[i][0]], *b = s->at[sides[i][1]];
            bool in_one = false;

            for (int k = 0; k < 6; k++) {
                const float *p = planes[k];
                const double da = (double)p[0] * a[0] + (double)p[1] * a[1] + (double)p[2] * a[2],
                             db = (double)p[0] * b[0] + (double)p[1] * b[1] + (double)p[2] * b[2];

                in_one |= fabs(da + p[3]) < 1e-6 && fabs(db + p[3]) < 1e-6;
            }
            assert_true(in_one);
            open++;
        }
    }
    free(sides);
    return open;
}

/* A slab across a direction, the other four planes far away. */
static void make_slab(const double axis[3], double low, double high, float planes[6][4])
{
    for (int i = 0; i < 6; i++)
        memcpy(planes[i], (const float[4]){i % 2 ? 1 : -1, 0, 0, 9}, sizeof planes[i]);
    for (int a = 0; a < 3; a++) {
        planes[1][a] = (float)axis[a];
        planes[4][a] = (float)-axis[a];
    }
    planes[1][3] = (float)-low;
    planes[4][3] = (float)high;
}

static void zones_of_a_ball(void **state)
{
    static const struct {
        double axis[3], low, high;
    } slabs[] = {{{0, 0, 1}, 0, 1}, /* through vertices: 0 is a plane of the grid */
                 {{0, 0, 1}, -0.31, 0.2},
                 {{0.6, 0, 0.8}, 0.1, 0.5},
                 {{0.48, -0.6, 0.64}, -0.02, 0.02}, /* thinner than a cell */
                 {{1, 0, 0}, -0.7, 0.7},            /* all of it */
                 {{1, 0, 0}, 0.7, 0.8}};

    (void)state;
    for (size_t i = 0; i < sizeof slabs / sizeof *slabs; i++) {
        cln_surface whole, s;
        float planes[6][4];
        double height = fmin(slabs[i].high, ball) - fmax(slabs[i].low, -ball), off = 0;
        size_t kept = 0, inside = 0, open = 0;
        int nearest = 0;

        make_ball(40, &whole);
        make_ball(40, &s);
        make_slab(slabs[i].axis, slabs[i].low, slabs[i].high, planes);
        assert_int_equal(cln_surface_clip(&s, (const float(*)[4])planes), CLN_OK);
        for (size_t v = 0; v < s.vertices; v++)
            assert_true(depth((const float(*)[4])planes, s.at[v], &nearest) > -1e-6);
        for (size_t v = 0; v < whole.vertices; v++)
            inside += depth((const float(*)[4])planes, whole.at[v], &nearest) >= 0;
        for (size_t v = 0; v < whole.vertices && kept < s.vertices; v++) /* in the same order */
            kept += memcmp(whole.at[v], s.at[kept], sizeof s.at[0]) == 0;
        open = check_sides(&s, (const float(*)[4])planes);
        off = height > 0 ? area_of(&s) / (2 * 3.14159265 * ball * height) - 1 : area_of(&s);
        print_message("    %zu of %zu vertices, %zu new; %zu open sides, area off by %.4f\n", kept,
                      whole.vertices, s.vertices - kept, open, off);
        assert_int_equal(kept, inside);
        assert_near(off, 0, 0.01);
        assert_true((open > 0) == (i < 4));
        cln_surface_free(&whole);
        cln_surface_free(&s);
    }
}

/* A vertex on a plane is a corner of what stays, once. */
static void vertex_on_a_plane(void **state)
{
    static const float at[4][3] = {{0, 0, 0}, {1, 0, 1}, {0, 1, -1}, {1, 1, -2}};
    static const uint32_t face[2][3] = {{0, 1, 2}, {0, 2, 3}};
    cln_surface s = {0};
    float planes[6][4];

    (void)state;
    for (int v = 0; v < 4; v++) {
        assert_int_equal(cln_surface_grow_vertices(&s), CLN_OK);
        memcpy(s.at[s.vertices++], at[v], sizeof at[v]);
    }
    for (int f = 0; f < 2; f++) {
        assert_int_equal(cln_surface_grow_faces(&s), CLN_OK);
        memcpy(s.face[s.faces++], face[f], sizeof face[f]);
    }
    make_slab((const double[3]){0, 0, 1}, 0, 5, planes);
    assert_int_equal(cln_surface_clip(&s, (const float(*)[4])planes), CLN_OK);
    assert_int_equal(s.vertices, 3);
    assert_int_equal(s.faces, 1);
    assert_memory_equal(s.at, at, 2 * sizeof at[0]);
    assert_true(s.at[2][0] == 0.5f && s.at[2][1] == 0.5f && s.at[2][2] == 0);
    cln_surface_free(&s);
}

int test_group_clip(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(zones_of_a_ball),
        cmocka_unit_test(vertex_on_a_plane),
    };

    return cmocka_run_group_tests_name("clip", tests, NULL, NULL);
}
