/* Points of a surface against its mesh: each is on the face that is due by area, and they are drawn
 * evenly within faces. And from which size on coordinates of an STL begin elsewhere. Oracle: the
 * triangles of the mesh; moments of even draws. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "near.h"
#include "run_fixture.h"
#include "tests.h"

enum { POINTS = 20000, POINT_BYTES = 28, FACE_BYTES = 50 };

static cln_export_desc desc_of(const char *what, const char *file)
{
    return (cln_export_desc){.run = fixture_path("whole"),
                             .what = what,
                             .file = fixture_path(file),
                             .device = fixture_device()};
}

/* A point's shares of the corners of a triangle, and how far it is from its plane. */
static double shares_of(const double corner[3][3], const double p[3], double share[3])
{
    double side[2][3], from[3], g[3] = {0}, r[2] = {0}, off = 0;

    for (int a = 0; a < 3; a++) {
        side[0][a] = corner[1][a] - corner[0][a];
        side[1][a] = corner[2][a] - corner[0][a];
        from[a] = p[a] - corner[0][a];
        g[0] += side[0][a] * side[0][a];
        g[1] += side[0][a] * side[1][a];
        g[2] += side[1][a] * side[1][a];
        r[0] += side[0][a] * from[a];
        r[1] += side[1][a] * from[a];
    }
    share[1] = (r[0] * g[2] - r[1] * g[1]) / (g[0] * g[2] - g[1] * g[1]);
    share[2] = (r[1] * g[0] - r[0] * g[1]) / (g[0] * g[2] - g[1] * g[1]);
    share[0] = 1 - share[1] - share[2];
    for (int a = 0; a < 3; a++)
        off += pow(from[a] - share[1] * side[0][a] - share[2] * side[1][a], 2);
    return sqrt(off);
}

/* Face f of a binary STL; its area. */
static double read_face(const char *stl, size_t f, double corner[3][3])
{
    float at[3][3];
    double area = 0;

    memcpy(at, stl + 84 + FACE_BYTES * f + 12, sizeof at);
    for (int k = 0; k < 9; k++)
        corner[k / 3][k % 3] = (double)at[k / 3][k % 3];
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;

        area += pow((corner[1][b] - corner[0][b]) * (corner[2][c] - corner[0][c]) -
                        (corner[1][c] - corner[0][c]) * (corner[2][b] - corner[0][b]),
                    2);
    }
    return 0.5 * sqrt(area);
}

static void points_are_even(void **state)
{
    cln_export_desc desc = desc_of("mesh", "drawn.stl");
    cln_export_result mesh, points;
    char *stl = NULL, *ply = NULL, *body = NULL;
    double *until = NULL, mean[3] = {0}, square[3] = {0}, corner[3][3], share[3];
    size_t bytes = 0, face = 0;
    int well = 0;

    NEED_DEVICE();
    assert_ok(cln_export(&desc, &mesh));
    stl = scratch_get(desc.file, &bytes);
    assert_int_equal(bytes, 84 + FACE_BYTES * mesh.faces);
    desc = desc_of("points", "drawn.ply");
    desc.count = POINTS;
    assert_ok(cln_export(&desc, &points));
    ply = scratch_get(desc.file, &bytes);
    body = strstr(ply, "end_header\n") + strlen("end_header\n");
    assert_int_equal(bytes - (size_t)(body - ply), POINTS * POINT_BYTES);
    until = calloc((size_t)mesh.faces, sizeof *until);
    assert_non_null(until);
    for (size_t f = 0; f < (size_t)mesh.faces; f++)
        until[f] = (f ? until[f - 1] : 0) + read_face(stl, f, corner);
    for (int i = 0; i < POINTS; i++) {
        const double all = until[mesh.faces - 1];
        double p[3];
        bool on = false;

        for (int a = 0; a < 3; a++) {
            float at = 0;

            memcpy(&at, body + (size_t)i * POINT_BYTES + 4 * (size_t)a, sizeof at);
            p[a] = (double)at;
        }
        while (until[face] < (i - 0.01) / POINTS * all)
            face++;
        for (size_t f = face; !on && f < (size_t)mesh.faces; f++) {
            const double area = read_face(stl, f, corner);

            if (area > 1e-6)
                on = shares_of((const double(*)[3])corner, p, share) < 1e-5 &&
                     fmin(fmin(share[0], share[1]), share[2]) > -0.01;
            if (until[f] > (i + 1.01) / POINTS * all)
                break;
        }
        well += on;
        for (int k = 0; k < 3 && on; k++) {
            mean[k] += share[k];
            square[k] += share[k] * share[k];
        }
    }
    print_message("    %d of %d points on the face that is due; of corners %.4f %.4f %.4f\n", well,
                  POINTS, mean[0] / well, mean[1] / well, mean[2] / well);
    assert_true(well > 0.99 * POINTS); /* but for the thinnest faces */
    for (int k = 0; k < 3; k++) {
        assert_near(mean[k] / well, 1.0 / 3, 0.01);
        assert_near(square[k] / well, 1.0 / 6, 0.01);
    }
    free(until);
    free(stl);
    free(ply);
}

/* Moves the scene so far towards x. */
static void move_scene(double way)
{
    static const char *const names[] = {"scene/transforms_train.json",
                                        "scene/transforms_test.json"};

    for (int i = 0; i < 2; i++) {
        json_t *document = fixture_json(names[i]), *frame = NULL;
        char *text = NULL;
        size_t k = 0;

        json_array_foreach(json_object_get(document, "frames"), k, frame)
        {
            json_t *row = json_array_get(json_object_get(frame, "transform_matrix"), 0);

            json_array_set_new(row, 3, json_real(json_number_value(json_array_get(row, 3)) + way));
        }
        text = json_dumps(document, 0);
        scratch_put(fixture_path(names[i]), text, strlen(text));
        free(text);
        json_decref(document);
    }
}

/* Where 32 bits move coordinates by a thousandth of a finest cell: these are 2 x 1.5 / (2 x 6). */
static void large_numbers_begin_elsewhere(void **state)
{
    static const double east[] = {2000, 8000};
    cln_config config = fixture_config();

    NEED_DEVICE();
    for (int i = 0; i < 2; i++) {
        cln_export_desc desc = desc_of("mesh", "east.stl");
        cln_export_result result;
        cln_train_result trained;
        char name[16];

        snprintf(name, sizeof name, "east %d", i);
        snprintf(config.bbox, sizeof config.bbox, "%g,-1.5,-1.5,%g,1.5,1.5", east[i] - 1.5,
                 east[i] + 1.5);
        move_scene(i ? east[1] - east[0] : east[0]);
        assert_ok(fixture_train(name, false, &config, NULL, &trained));
        desc.run = fixture_path(name);
        desc.overwrite = true;
        assert_ok(cln_export(&desc, &result));
        assert_true((result.taken_off[0] != 0) == (east[i] * 0x1p-24 > 0.25 / 1000));
    }
}

int test_group_export_points(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_even),
        cmocka_unit_test(large_numbers_begin_elsewhere),
    };

    return cmocka_run_group_tests_name("export_points", tests, fixture_setup, fixture_teardown);
}
