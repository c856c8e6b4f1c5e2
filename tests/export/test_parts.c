/* The largest connected part of a surface (host/export/parts.h): balls apart from each other, by
 * marching cubes, against the triangles of each alone; small meshes by hand. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "export/marching.h"
#include "export/parts.h"
#include "tests.h"

typedef struct balls {
    int count;
    double at[3][4]; /* x, y, z, radius */
} balls;

static cln_status ask_balls(void *user, size_t n, const float (*at)[4], float *values)
{
    const balls *b = user;

    for (size_t i = 0; i < n; i++) {
        double most = -1;

        for (int k = 0; k < b->count; k++)
            most = fmax(most, b->at[k][3] - sqrt(pow(at[i][0] - b->at[k][0], 2) +
                                                 pow(at[i][1] - b->at[k][1], 2) +
                                                 pow(at[i][2] - b->at[k][2], 2)));
        values[i] = (float)most;
    }
    return CLN_OK;
}

static void trace(balls *b, cln_surface *s)
{
    const cln_marching marching = {.cells = 32, .ask = ask_balls, .user = b};

    memset(s, 0, sizeof *s);
    assert_int_equal(cln_marching_run(&marching, s), CLN_OK);
}

static void the_largest_ball_stays(void **state)
{
    /* the largest is neither first nor last in the order of slices */
    balls all = {3, {{-0.5, -0.4, -0.6, 0.2}, {0.4, 0.3, 0, 0.45}, {-0.5, 0, 0.6, 0.3}}};
    cln_surface s;
    size_t faces[4] = {0};
    cln_parts found, counted;

    (void)state;
    trace(&all, &s);
    faces[3] = s.faces;
    s.normal = calloc(s.vertices, sizeof *s.normal);
    assert_non_null(s.normal);
    for (size_t v = 0; v < s.vertices; v++)
        memcpy(s.normal[v], s.at[v], sizeof s.at[v]);
    assert_int_equal(cln_surface_count_parts(&s, &counted), CLN_OK);
    assert_int_equal(s.faces, faces[3]); /* all are there still */
    assert_int_equal(cln_surface_keep_largest(&s, &found), CLN_OK);
    assert_memory_equal(&counted, &found, sizeof found);
    for (int k = 0; k < 3; k++) {
        balls one = {1, {{all.at[k][0], all.at[k][1], all.at[k][2], all.at[k][3]}}};
        cln_surface alone;

        trace(&one, &alone);
        faces[k] = alone.faces;
        if (k == 1) { /* bit for bit, in the same order */
            assert_int_equal(s.vertices, alone.vertices);
            assert_memory_equal(s.at, alone.at, s.vertices * sizeof *s.at);
            assert_memory_equal(s.normal, alone.at, s.vertices * sizeof *s.at);
            assert_int_equal(s.faces, alone.faces);
            assert_memory_equal(s.face, alone.face, s.faces * sizeof *s.face);
        }
        cln_surface_free(&alone);
    }
    assert_int_equal(faces[0] + faces[1] + faces[2], faces[3]);
    assert_int_equal(found.parts, 3);
    assert_int_equal(found.left_out, faces[0] + faces[2]);
    assert_true(cln_parts_are_broken(&found, faces[3]));
    assert_false(cln_parts_are_broken(&found, 10 * faces[3]));      /* crumbs */
    assert_int_equal(cln_surface_keep_largest(&s, &found), CLN_OK); /* once more: it is alone */
    assert_true(found.parts == 1 && found.left_out == 0 && s.faces == faces[1]);
    cln_surface_free(&s);
}

/* Faces of a strip that is joined last, of two equal parts, and a vertex of no face. */
static void parts_by_hand(void **state)
{
    static const struct {
        uint32_t face[4][3];
        size_t faces, parts, kept;
        uint32_t first; /* vertex of the part that stays */
        double next, others;
    } rows[] = {
        {{{6, 7, 8}, {3, 4, 5}, {5, 6, 0}, {0, 1, 2}}, 4, 1, 4, 0, 0, 0},
        {{{6, 7, 8}, {3, 4, 5}, {7, 8, 9}, {4, 5, 0}},
         4,
         2,
         2,
         0,
         0.6,
         0.6}, /* equal: the first vertex's */
        {{{6, 7, 8}, {0, 1, 2}, {7, 8, 9}}, 3, 2, 2, 6, 2.0 / 3, 2.0 / 3},
        {{{0, 1, 2}, {1, 2, 3}, {4, 5, 6}, {7, 8, 9}}, 4, 3, 2, 0, 2.0 / 3, 5.0 / 3},
        {{{0}}, 0, 0, 0, 0, 0, 0},
    };

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_surface s = {.vertices = 10, .faces = rows[i].faces};
        cln_parts found, counted;
        bool there = rows[i].kept == 0;

        s.at = calloc(10, sizeof *s.at);
        s.face = calloc(4, sizeof *s.face);
        assert_true(s.at && s.face);
        memcpy(s.face, rows[i].face, sizeof rows[i].face);
        for (int v = 0; v < 10; v++)
            s.at[v][0] = (float)v;
        assert_int_equal(cln_surface_count_parts(&s, &counted), CLN_OK);
        assert_int_equal(cln_surface_keep_largest(&s, &found), CLN_OK);
        assert_memory_equal(&counted, &found, sizeof found);
        assert_int_equal(found.parts, rows[i].parts);
        assert_true(fabs(found.next - rows[i].next) < 1e-12);
        assert_true(fabs(found.others - rows[i].others) < 1e-12);
        assert_int_equal(cln_parts_are_broken(&found, rows[i].faces), rows[i].others > 1);
        assert_int_equal(s.faces, rows[i].kept);
        assert_int_equal(found.left_out, rows[i].faces - rows[i].kept);
        for (size_t v = 0; v < s.vertices; v++)
            there |= s.at[v][0] == (float)rows[i].first;
        assert_true(there);
        cln_surface_free(&s);
    }
}

/* A strip of triangles whose ends have colours, and one that has none: each vertex has the mean of
 * those of its neighbours that are nearer to an end. */
static void colours_bleed(void **state)
{
    enum { COUNT = 12, OTHER = 3 };
    cln_surface s = {.vertices = COUNT + OTHER, .faces = COUNT - 1};
    uint8_t known[COUNT + OTHER] = {0};

    (void)state;
    s.colour = calloc(s.vertices, sizeof *s.colour);
    s.face = calloc(s.faces, sizeof *s.face);
    assert_true(s.colour && s.face);
    for (uint32_t f = 0; f < COUNT - 2; f++)
        for (uint32_t k = 0; k < 3; k++)
            s.face[f][k] = f + k;
    for (uint32_t k = 0; k < 3; k++)
        s.face[COUNT - 2][k] = COUNT + k;
    known[0] = known[COUNT - 1] = 1;
    s.colour[0][0] = 200;
    s.colour[COUNT - 1][1] = 100;
    assert_int_equal(cln_surface_bleed(&s, known), CLN_OK);
    for (int v = 0; v < COUNT + OTHER; v++) {
        const bool left = v < 6, alone = v >= COUNT;

        assert_int_equal(known[v], !alone);
        if (v == 5 || v == 6) /* two on: both ends' come at once */
            continue;
        assert_int_equal(s.colour[v][0], left && !alone ? 200 : 0);
        assert_int_equal(s.colour[v][1], left || alone ? 0 : 100);
    }
    assert_true(s.colour[5][0] > 0 && s.colour[6][1] > 0);
    cln_surface_free(&s);
}

/* Colours between two whole ones: the nearest, the upper one of two. */
static void means_are_rounded(void **state)
{
    static const uint8_t colours[3][3] = {{10, 0, 200}, {11, 0, 201}, {10, 3, 201}};
    static const uint8_t want[2][3] = {{11, 0, 201}, {10, 1, 201}}; /* 10.5, 0, 200.5; 10.25 ... */

    (void)state;
    for (uint32_t faces = 1; faces <= 2; faces++) { /* the second has corner 0, too */
        cln_surface s = {.vertices = 4, .faces = faces};
        uint8_t known[4] = {1, 1, 1, 0};

        s.colour = calloc(s.vertices, sizeof *s.colour);
        s.face = calloc(2, sizeof *s.face);
        assert_true(s.colour && s.face);
        memcpy(s.colour, colours, sizeof colours);
        memcpy(s.face, (const uint32_t[2][3]){{0, 1, 3}, {0, 3, 2}}, 2 * sizeof *s.face);
        assert_int_equal(cln_surface_bleed(&s, known), CLN_OK);
        for (int c = 0; c < 3; c++)
            assert_int_equal(s.colour[3][c], want[faces - 1][c]);
        cln_surface_free(&s);
    }
}

int test_group_parts(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_largest_ball_stays),
        cmocka_unit_test(parts_by_hand),
        cmocka_unit_test(colours_bleed),
        cmocka_unit_test(means_are_rounded),
    };

    return cmocka_run_group_tests_name("parts", tests, NULL, NULL);
}
