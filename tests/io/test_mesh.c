/* Meshes as files (host/io/mesh.h): PLY, OBJ, GLB and STL read back by the formats' own rules;
 * large coordinates keep their digits in each but STL. */
#include "unit.h"
#include "glb.h"
#include "io/mesh.h"
#include "near.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

/* A triangle and a lone vertex, about a place 4,100 km from the origin. */
static double at[4][3] = {{500000.125, 4100000.5, 90.0625},
                          {500001.375, 4100000.5, 90.0625},
                          {500000.125, 4100002.75, 90.0625},
                          {500000.125, 4100000.5, 93.001953125}};
static float normal[4][3] = {{0, 0, 1}, {0, 0, 1}, {0, 0, 1}, {1, 0, 0}};
static uint8_t colour[4][3] = {{255, 0, 128}, {0, 255, 0}, {10, 20, 30}, {1, 2, 3}};
static uint32_t face[1][3] = {{0, 1, 2}};

static cln_mesh make(double x, double y)
{
    static double moved[4][3];
    cln_mesh mesh = {.vertices = 4,
                     .faces = 1,
                     .at = moved,
                     .normal = normal,
                     .colour = colour,
                     .face = face,
                     .origin = {500000 - x, 4100000 - y, 90},
                     .fine = 0.01,
                     .comment = "a test; scene units",
                     .turn = {0, 0, 0, 1},
                     .scale = 1};

    for (int i = 0; i < 4; i++) {
        moved[i][0] = at[i][0] - x;
        moved[i][1] = at[i][1] - y;
        moved[i][2] = at[i][2];
    }
    return mesh;
}

static void ply_is_wide_where_it_must_be(void **state)
{
    const char *file = scratch_path(*state, "x.ply");
    size_t bytes = 0;

    for (int k = 0; k < 4; k++) {
        const bool wide = k % 2, views = k / 2;
        cln_mesh mesh = wide ? make(0, 0) : make(500000, 4100000);
        const size_t row = (wide ? 24u : 12u) + 15 + views;
        char *text = NULL, *body = NULL;
        uint32_t index = 0;

        mesh.views = views ? (uint8_t[]){0, 1, 17, 100} : NULL;
        assert_int_equal(cln_mesh_fits_floats(&mesh), !wide);
        assert_int_equal(cln_mesh_write_ply(file, &mesh), CLN_OK);
        text = scratch_get(file, &bytes);
        assert_non_null(strstr(text, "comment a test; scene units\nelement vertex 4\n"));
        assert_non_null(strstr(text, wide ? "property double x\n" : "property float x\n"));
        assert_int_equal(strstr(text, "property uchar views\n") != NULL, views);
        assert_non_null(strstr(text, "element face 1\nproperty list uchar int vertex_indices\n"));
        body = strstr(text, "end_header\n") + strlen("end_header\n");
        assert_int_equal(bytes - (size_t)(body - text), 4 * row + 13);
        for (size_t i = 0; i < 4; i++) {
            for (size_t a = 0; a < 3; a++) {
                double value = 0;
                float narrow = 0;

                memcpy(&value, body + i * row + 8 * a, 8);
                memcpy(&narrow, body + i * row + 4 * a, 4);
                assert_true((wide ? value : (double)narrow) == mesh.at[i][a]);
            }
            assert_memory_equal(body + i * row + row - 15 - views, normal[i], 12);
            assert_memory_equal(body + i * row + row - 3 - views, colour[i], 3);
            if (views)
                assert_memory_equal(body + i * row + row - 1, &mesh.views[i], 1);
        }
        assert_int_equal(body[4 * row], 3);
        memcpy(&index, body + 4 * row + 9, 4);
        assert_int_equal(index, 2);
        free(text);
    }
}

static void points_have_no_faces(void **state)
{
    const char *file = scratch_path(*state, "x.ply");
    cln_mesh mesh = make(500000, 4100000);
    size_t bytes = 0;
    char *text = NULL;

    mesh.faces = 0;
    assert_int_equal(cln_mesh_write_ply(file, &mesh), CLN_OK);
    text = scratch_get(file, &bytes);
    assert_null(strstr(text, "element face"));
    free(text);
}

static void obj_has_digits_and_colours(void **state)
{
    const char *file = scratch_path(*state, "x.obj");
    const cln_mesh mesh = make(0, 0);
    size_t bytes = 0;
    char *text = NULL, *line = NULL;

    assert_int_equal(cln_mesh_write_obj(file, &mesh), CLN_OK);
    text = scratch_get(file, &bytes);
    line = strstr(text, "v ");
    for (int i = 0; i < 4; i++, line = strstr(line + 1, "\nv ")) {
        double p[3], c[3];

        line += line[0] == '\n';
        assert_int_equal(
            sscanf(line, "v %lf %lf %lf %lf %lf %lf", &p[0], &p[1], &p[2], &c[0], &c[1], &c[2]), 6);
        for (int a = 0; a < 3; a++) {
            assert_near(p[a], at[i][a], 1e-8);
            assert_near(c[a], colour[i][a] / 255.0, 1e-4);
        }
    }
    assert_non_null(strstr(text, "\nf 1//1 2//2 3//3\n"));
    free(text);
}

/* Of the first of a list; programs that find none make one up. */
static const char *name_of(const glb *g, const char *list)
{
    const char *name = json_string_value(json_object_get(glb_at(g->document, list, 0), "name"));

    return name ? name : "";
}

static json_int_t mode_of(const glb *g)
{
    const json_t *primitive = glb_at(glb_at(g->document, "meshes", 0), "primitives", 0);

    return json_integer_value(json_object_get(primitive, "mode"));
}

static void glb_is_gltf(void **state)
{
    const char *file = scratch_path(*state, "x.glb");
    const cln_mesh mesh = make(0, 0);
    const json_t *accessors = NULL;
    glb g;

    assert_int_equal(cln_mesh_write_glb(file, &mesh), CLN_OK);
    g = glb_open(file);
    assert_int_equal(g.count, 4 * (12 + 12 + 8) + 12);
    accessors = json_object_get(g.document, "accessors");
    assert_int_equal(json_array_size(accessors), 4);
    for (size_t i = 0; i < 4; i++) {
        double v[3];

        glb_vertex(&g, i, v);
        for (int a = 0; a < 3; a++)
            assert_near(v[a], at[i][a], 1e-7);
    }
    for (size_t a = 0; a < 3; a++) {
        static const double low[3] = {0.125, 0.5, 0.0625}, high[3] = {1.375, 2.75, 3.001953125};
        const json_t *places = json_array_get(accessors, 0);

        assert_near(json_number_value(glb_at(places, "min", a)), low[a], 1e-6);
        assert_near(json_number_value(glb_at(places, "max", a)), high[a], 1e-6);
        assert_int_equal(json_is_true(json_object_get(json_array_get(accessors, a), "normalized")),
                         a == 2); /* else colours of 16 bits are white */
    }
    /* colours are linear: of 128, (128 / 255 + 0.055)^2.4 / 1.055^2.4 */
    assert_int_equal(glb_word(g.numbers + 96) & 0xffff, 65535);
    assert_near((double)(glb_word(g.numbers + 100) & 0xffff), 0.2158605 * 65535, 1);
    assert_near((double)(glb_word(g.numbers + 112) & 0xffff), 10 / 255.0 / 12.92 * 65535, 1);
    assert_int_equal(mode_of(&g), 4); /* triangles */
    assert_int_equal(glb_word(g.numbers + g.count - 4), 2);
    assert_string_equal(name_of(&g, "meshes"), "surface");
    assert_string_equal(name_of(&g, "materials"), "colours");
    glb_close(&g);
}

/* Without faces they are points; more than its 32 bits can count are refused. */
static void glb_has_points_and_an_end(void **state)
{
    const char *file = scratch_path(*state, "x.glb");
    cln_mesh mesh = make(0, 0);
    glb g;

    mesh.faces = 0;
    assert_int_equal(cln_mesh_write_glb(file, &mesh), CLN_OK);
    g = glb_open(file);
    assert_int_equal(mode_of(&g), 0);
    assert_int_equal(g.count, 4 * (12 + 12 + 8));
    assert_int_equal(json_array_size(json_object_get(g.document, "accessors")), 3);
    glb_close(&g);
    assert_int_equal(remove(file), 0);
    mesh.faces = UINT32_MAX / 12; /* which are not looked at */
    assert_fails(cln_mesh_write_glb(file, &mesh), CLN_OUTPUT, "more than a GLB file can hold");
    assert_false(cln_is_file(file));
}

/* Where a turn that makes `up` the y (or z) axis brings x, y and z, by hand. */
static const struct {
    double up[3];
    int axis;
    double is[3][3];
} turns[] = {
    {{0, 0, 0}, 1, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
    {{0, 2, 0}, 1, {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}},
    {{0, 0, 5}, 1, {{1, 0, 0}, {0, 0, -1}, {0, 1, 0}}},  /* as Blender turns it back */
    {{0, 0, -1}, 1, {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}}, /* cameras that look along z */
    {{0, -1, 0}, 1, {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}},
    {{-3, 0, 0}, 1, {{0, -1, 0}, {1, 0, 0}, {0, 0, 1}}},
    {{0, 1, 0}, 2, {{1, 0, 0}, {0, 0, 1}, {0, -1, 0}}},
    {{0, 0, -1}, 2, {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}},
    {{1, 0, 0}, 2, {{0, 0, 1}, {0, 1, 0}, {-1, 0, 0}}},
    {{-1e-12, 0, -1}, 2, {{1, 0, 0}, {0, -1, 0}, {0, 0, -1}}}, /* nearly upside down */
};

/* The numbers stay the scene's: the root node places them. */
static void glb_stands_upright(void **state)
{
    const char *file = scratch_path(*state, "x.glb");
    const double scale = 0.001;

    for (size_t t = 0; t < sizeof turns / sizeof *turns; t++) {
        cln_mesh mesh = make(0, 0), plain = make(0, 0);
        glb g, before;

        assert_int_equal(cln_mesh_write_glb(file, &plain), CLN_OK);
        before = glb_open(file);
        cln_mesh_upright(turns[t].up, turns[t].axis, mesh.turn);
        mesh.scale = scale;
        assert_int_equal(cln_mesh_write_glb(file, &mesh), CLN_OK);
        g = glb_open(file);
        assert_int_equal(g.count, before.count);
        assert_memory_equal(g.numbers, before.numbers, g.count);
        for (size_t i = 0; i < 4; i++) {
            double v[3];

            glb_vertex(&g, i, v);
            for (int a = 0; a < 3; a++)
                assert_near(v[a],
                            scale * (at[i][0] * turns[t].is[0][a] + at[i][1] * turns[t].is[1][a] +
                                     at[i][2] * turns[t].is[2][a]),
                            1e-8);
        }
        glb_close(&before);
        glb_close(&g);
    }
}

/* Other files have the turned numbers themselves. */
static void places_turn_and_grow(void **state)
{
    (void)state;
    for (size_t t = 0; t < sizeof turns / sizeof *turns; t++) {
        float kept[4][3];
        double turn[4];
        cln_mesh mesh = make(0, 0);

        memcpy(kept, normal, sizeof kept);
        mesh.normal = kept;
        cln_mesh_upright(turns[t].up, turns[t].axis, turn);
        cln_mesh_place(&mesh, turn, 1000);
        for (int i = 0; i < 4; i++)
            for (int a = 0; a < 3; a++) {
                double where = 0, facing = 0;

                for (int k = 0; k < 3; k++) {
                    where += 1000 * at[i][k] * turns[t].is[k][a];
                    facing += (double)normal[i][k] * turns[t].is[k][a];
                }
                assert_near(mesh.at[i][a], where, 0.01);
                assert_near(kept[i][a], facing, 1e-6);
            }
        assert_near(mesh.fine, 10, 1e-9);
    }
}

static double float_at(const char *bytes, size_t offset)
{
    const uint32_t word =
        (uint32_t)(uint8_t)bytes[offset] | (uint32_t)(uint8_t)bytes[offset + 1] << 8 |
        (uint32_t)(uint8_t)bytes[offset + 2] << 16 | (uint32_t)(uint8_t)bytes[offset + 3] << 24;
    float value = 0;

    memcpy(&value, &word, sizeof value);
    return (double)value;
}

/* A triangle with two corners in one place is left out: its edges would have one triangle, or two
 * more. */
static void stl_is_what_slicers_read(void **state)
{
    static uint32_t faces[3][3] = {{0, 1, 2}, {0, 3, 1}, {0, 1, 1}};
    static const double normals[2][3] = {{0, 0, 1}, {0, 1, 0}};
    const char *file = scratch_path(*state, "x.stl");

    for (int far = 0; far < 2; far++) {
        cln_mesh mesh = far ? make(0, 0) : make(500000, 4100000);
        size_t bytes = 0;
        char *data = NULL;

        mesh.faces = 3;
        mesh.face = faces;
        mesh.comment = far ? "solid as a rock" : "a test; scene units";
        assert_near(cln_mesh_rounding(&mesh), far ? 0.25 : 0, far ? 0.01 : 1e-5);
        assert_int_equal(cln_mesh_write_stl(file, &mesh), CLN_OK);
        data = scratch_get(file, &bytes);
        assert_int_equal(bytes, 84 + 2 * 50);
        assert_true(strncmp(data, "solid", 5) != 0); /* such files are text */
        assert_non_null(strstr(data, far ? "rock" : "a test; scene units"));
        assert_memory_equal(data + 80, "\2\0\0", 4);
        for (size_t f = 0; f < 2; f++) {
            const size_t row = 84 + 50 * f;

            for (size_t a = 0; a < 3; a++)
                assert_near(float_at(data, row + 4 * a), normals[f][a], 1e-6);
            for (size_t k = 0; k < 3; k++)
                for (size_t a = 0; a < 3; a++)
                    assert_true(float_at(data, row + 12 + 12 * k + 4 * a) ==
                                (double)(float)mesh.at[faces[f][k]][a]);
            assert_memory_equal(data + row + 48, "\0", 2);
        }
        free(data);
    }
}

#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)

/* The place that small numbers are told from moves with the vertices. */
static void what_moves_keeps_its_digits(void **state)
{
    static const double far[3] = {500000, 4100000, 90};
    cln_mesh mesh = make(0, 0);
    double before[4][3];

    (void)state;
    memcpy(before, mesh.at, sizeof before);
    for (int a = 0; a < 3; a++)
        mesh.origin[a] = a;
    cln_mesh_move(&mesh, far);
    for (int a = 0; a < 3; a++) {
        assert_near(mesh.origin[a], a + far[a], 1e-12);
        for (int i = 0; i < 4; i++)
            assert_near(mesh.at[i][a], before[i][a] + far[a], 1e-9);
    }
}

int test_group_mesh(void)
{
    const struct CMUnitTest tests[] = {
        ON_DISK(ply_is_wide_where_it_must_be),  ON_DISK(points_have_no_faces),
        ON_DISK(obj_has_digits_and_colours),    ON_DISK(glb_is_gltf),
        ON_DISK(glb_has_points_and_an_end),     ON_DISK(glb_stands_upright),
        cmocka_unit_test(places_turn_and_grow), cmocka_unit_test(what_moves_keeps_its_digits),
        ON_DISK(stl_is_what_slicers_read),
    };

    return cmocka_run_group_tests_name("mesh", tests, NULL, NULL);
}
