/* Views of an octree: the PLY file of cln_export (host/api/export.c, io/ply.h) and the pictures of
 * the tree (render/tree_picture.h), on a small tree: level 1 without its first leaf, its second
 * leaf split. Oracle: literal boxes, slots and colours; faces must close a box and point
 * outwards. */
#include "unit.h"
#include <dirent.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "cl_nascent.h"
#include "render/tree_picture.h"
#include "io/image.h"
#include "io/palette.h"
#include "io/run_folder.h"
#include "near.h"
#include "outcome.h"
#include "scratch.h"
#include "tests.h"

enum { LEAVES = 14, VERTEX_BYTES = 20, WIDE_VERTEX_BYTES = 32, FACE_BYTES = 17 };

/* ---- the tree ---- */

/* Slots 0..7: the level-2 children of the root's child 1; 8..13: the root's children 2..7. Errors
 * are unknown. The cube is (1, 2, 3) +- 4. */
static void make_tree(cln_model *model)
{
    const uint8_t first[8] = {1};
    cln_config config;
    cln_octree_change change;

    assert_ok(cln_config_preset("fast", &config));
    config.start_level = 1;
    config.width = config.view_width = 16;
    config.depth = config.bands = 2;
    config.n1 = 3;
    assert_ok(cln_model_create(&config, model));
    assert_ok(cln_octree_cull(&model->tree, first, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    assert_ok(cln_octree_split(&model->tree, first, &change));
    assert_ok(cln_model_apply(model, &change));
    cln_octree_change_free(&change);
    assert_int_equal(model->tree.leaf_count, LEAVES);
    assert_non_null(model->error);
    for (int s = 0; s < LEAVES; s++)
        model->error[s] = NAN;
    model->space.centre[0] = 1;
    model->space.centre[1] = 2;
    model->space.centre[2] = 3;
    model->space.half = 4;
    model->step = 321;
}

/* A run folder with a checkpoint of this model; without a checkpoint if it is NULL. */
static const char *make_run(const char *folder, const cln_model *model)
{
    const char *run = scratch_path(folder, "run");
    json_t *document = json_pack("{s:s}", "schema", "cl-nascent.run/1");

    assert_ok(cln_make_dirs(run));
    assert_ok(cln_run_write(run, document));
    json_decref(document);
    if (model)
        assert_ok(cln_checkpoint_write(run, model));
    return run;
}

/* ---- the file ---- */

typedef struct vertex {
    double at[3];
    float error;
    uint8_t colour[3], level;
} vertex;

typedef struct mesh {
    char *text; /* the file */
    size_t bytes;
    const char *data; /* after its header */
    size_t row;       /* bytes of a vertex */
    int vertices, faces;
} mesh;

static mesh read_mesh(const char *path)
{
    mesh m = {0};
    const char *end = NULL;

    m.text = scratch_get(path, &m.bytes);
    end = strstr(m.text, "end_header\n");
    assert_non_null(end);
    m.data = end + strlen("end_header\n");
    m.row = strstr(m.text, "property double x\n") ? WIDE_VERTEX_BYTES : VERTEX_BYTES;
    assert_int_equal(sscanf(strstr(m.text, "element vertex"), "element vertex %d", &m.vertices), 1);
    assert_int_equal(sscanf(strstr(m.text, "element face"), "element face %d", &m.faces), 1);
    assert_int_equal(m.bytes, (size_t)(m.data - m.text) + (size_t)m.vertices * m.row +
                                  (size_t)m.faces * FACE_BYTES);
    return m;
}

static vertex vertex_of(const mesh *m, int i)
{
    const char *from = m->data + (size_t)i * m->row, *rest = from + m->row - 8;
    vertex v;

    assert_in_range(i, 0, m->vertices - 1);
    for (int a = 0; a < 3; a++) {
        float narrow = 0;

        memcpy(&narrow, from + 4 * a, 4);
        memcpy(&v.at[a], from + 8 * a, 8);
        v.at[a] = m->row == VERTEX_BYTES ? narrow : v.at[a];
    }
    memcpy(v.colour, rest, 3);
    memcpy(&v.level, rest + 3, 1);
    memcpy(&v.error, rest + 4, 4);
    return v;
}

static void face_of(const mesh *m, int f, int32_t corner[4])
{
    const char *from = m->data + (size_t)m->vertices * m->row + (size_t)f * FACE_BYTES;

    assert_int_equal(from[0], 4);
    memcpy(corner, from + 1, 16);
}

static void assert_colour(const vertex *v, int r, int g, int b)
{
    assert_int_equal(v->colour[0], r);
    assert_int_equal(v->colour[1], g);
    assert_int_equal(v->colour[2], b);
}

/* The eight corners of box s. */
static void assert_box(const mesh *m, int s, int level, const double min[3], const double max[3])
{
    for (int i = 0; i < 8; i++) {
        const vertex v = vertex_of(m, 8 * s + i);

        for (int a = 0; a < 3; a++)
            assert_true(v.at[a] == ((i >> a) & 1 ? max[a] : min[a]));
        assert_int_equal(v.level, level);
    }
}

static cln_export_desc export_desc(const char *run, const char *file)
{
    return (cln_export_desc){.run = run, .what = "octree", .file = file};
}

/* The file of that model's boxes, whose numbers are multiplied by scale; the caller frees .text. */
static mesh exported(void **state, const cln_model *model, const char *colour, double scale)
{
    const char *file = scratch_path(*state, "tree.ply");
    cln_export_desc desc = export_desc(make_run(*state, model), file);
    cln_export_result result;

    desc.colour = colour;
    desc.scale = scale;
    assert_ok(cln_export(&desc, &result));
    return read_mesh(file);
}

static void boxes_are_the_active_leaves(void **state)
{
    static const char format[] =
        "ply\nformat binary_little_endian 1.0\n"
        "comment cl-nascent " CLN_VERSION ": leaves of the octree, coloured by level, at step 321; "
        "scene units; model %016llx\n"
        "element vertex 112\nproperty float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\n"
        "property uchar level\nproperty float error\n"
        "element face 84\nproperty list uchar int vertex_indices\nend_header\n";
    const char *file = scratch_path(*state, "tree.ply");
    cln_export_result result;
    cln_export_desc desc;
    char header[1024];
    cln_model model;
    mesh m;

    make_tree(&model);
    model.error[0] = 0.25f;
    snprintf(header, sizeof header, format, (unsigned long long)cln_model_digest(&model));
    desc = export_desc(make_run(*state, &model), file);
    assert_ok(cln_export(&desc, &result));
    assert_int_equal(result.step, 321);
    assert_int_equal(result.leaves, LEAVES);
    for (int level = 0; level < CLN_LEVELS; level++)
        assert_int_equal(result.levels[level], level == 1 ? 6 : level == 2 ? 8 : 0);
    m = read_mesh(file);
    assert_memory_equal(m.text, header, strlen(header));
    assert_int_equal(m.vertices, 8 * LEAVES);
    assert_int_equal(m.faces, 6 * LEAVES);
    assert_box(&m, 0, 2, (double[]){1, -2, -1}, (double[]){3, 0, 1});
    assert_box(&m, 7, 2, (double[]){3, 0, 1}, (double[]){5, 2, 3});
    assert_box(&m, 8, 1, (double[]){-3, 2, -1}, (double[]){1, 6, 3});
    assert_box(&m, 13, 1, (double[]){1, 2, 3}, (double[]){5, 6, 7});
    for (int i = 0; i < m.vertices; i++) {
        const vertex v = vertex_of(&m, i);

        if (v.level == 2)
            assert_colour(&v, 0, 158, 115);
        else
            assert_colour(&v, 86, 180, 233);
        assert_true(i < 8 ? v.error == 0.25f : isnan(v.error));
    }
    free(m.text);
    cln_model_free(&model);
}

static void boxes_are_scaled(void **state)
{
    cln_model model;
    mesh m;

    make_tree(&model);
    m = exported(state, &model, NULL, 0.25);
    assert_non_null(strstr(m.text, "at step 321; scene units x 0.25; model "));
    assert_box(&m, 0, 2, (double[]){0.25, -0.5, -0.25}, (double[]){0.75, 0, 0.25});
    assert_box(&m, 13, 1, (double[]){0.25, 0.5, 0.75}, (double[]){1.25, 1.5, 1.75});
    free(m.text);
    cln_model_free(&model);
}

/* Coordinates of a survey, where floats are half a unit apart: boxes keep their sides. */
static void boxes_far_away_keep_their_sides(void **state)
{
    cln_model model;
    mesh m;

    make_tree(&model);
    model.space.centre[0] = 500000.1875;
    model.space.centre[1] = 4600000.3125;
    model.space.centre[2] = 90.0625;
    model.space.half = 0.5;
    m = exported(state, &model, NULL, 1);
    assert_non_null(strstr(m.text, "property double y\n"));
    assert_box(&m, 0, 2, (double[]){500000.1875, 4599999.8125, 89.5625},
               (double[]){500000.4375, 4600000.0625, 89.8125});
    assert_box(&m, 13, 1, (double[]){500000.1875, 4600000.3125, 90.0625},
               (double[]){500000.6875, 4600000.8125, 90.5625});
    free(m.text);
    cln_model_free(&model);
}

/* Six faces per box, one in each of its planes, normals outwards. */
static void faces_look_outwards(void **state)
{
    cln_model model;
    mesh m;

    make_tree(&model);
    m = exported(state, &model, NULL, 1);
    for (int f = 0; f < m.faces; f++) {
        const int s = f / 6;
        const vertex low = vertex_of(&m, 8 * s), high = vertex_of(&m, 8 * s + 7);
        int32_t corner[4];
        double edge[2][3], normal[3], out[3] = {0, 0, 0};
        int sides = 0;

        face_of(&m, f, corner);
        for (int k = 0; k < 4; k++) {
            const vertex v = vertex_of(&m, corner[k]);

            assert_in_range(corner[k], 8 * s, 8 * s + 7);
            for (int a = 0; a < 3; a++)
                out[a] += (v.at[a] - 0.5 * (low.at[a] + high.at[a])) / 4;
        }
        for (int e = 0; e < 2; e++)
            for (int a = 0; a < 3; a++)
                edge[e][a] = vertex_of(&m, corner[e + 1]).at[a] - vertex_of(&m, corner[e]).at[a];
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;

            normal[a] = edge[0][b] * edge[1][c] - edge[0][c] * edge[1][b];
            sides += out[a] != 0;
        }
        assert_int_equal(sides, 1);
        assert_true(normal[0] * out[0] + normal[1] * out[1] + normal[2] * out[2] > 0);
        for (int g = s * 6; g < f; g++) { /* two faces of a box share at most an edge */
            int32_t other[4];
            int shared = 0;

            face_of(&m, g, other);
            for (int k = 0; k < 16; k++)
                shared += corner[k / 4] == other[k % 4];
            assert_in_range(shared, 0, 2);
        }
    }
    free(m.text);
    cln_model_free(&model);
}

static void errors_are_coloured_on_a_log_scale(void **state)
{
    cln_model model;
    vertex v;
    mesh m;

    make_tree(&model);
    model.error[0] = 1e-3f;
    model.error[1] = 3.1622777e-5f; /* half-way down three decades */
    model.error[2] = 1e-9f;         /* below the scale */
    model.error[3] = 0;
    m = exported(state, &model, "error", 1);
    assert_non_null(strstr(m.text, "coloured by error"));
    v = vertex_of(&m, 0);
    assert_colour(&v, 240, 249, 33);
    assert_true(v.error == 1e-3f);
    v = vertex_of(&m, 8);
    assert_colour(&v, 204, 71, 120);
    v = vertex_of(&m, 16);
    assert_colour(&v, 13, 8, 135);
    v = vertex_of(&m, 24);
    assert_colour(&v, 13, 8, 135);
    v = vertex_of(&m, 32);
    assert_colour(&v, 128, 128, 128);
    free(m.text);
    cln_model_free(&model);
}

/* Unknown errors are drawn grey and reported. */
static void unknown_errors_are_grey(void **state)
{
    const char *file = scratch_path(*state, "tree.ply");
    cln_export_result result;
    cln_export_desc desc;
    cln_model model;
    int warnings = 0;
    mesh m;

    make_tree(&model);
    desc = export_desc(make_run(*state, &model), file);
    desc.colour = "error";
    cln_log_set_sink(scratch_count_warnings, &warnings);
    assert_ok(cln_export(&desc, &result));
    assert_int_equal(warnings, 1);
    m = read_mesh(file);
    for (int i = 0; i < m.vertices; i++) {
        const vertex v = vertex_of(&m, i);
        assert_colour(&v, 128, 128, 128);
    }
    free(m.text);
    cln_model_free(&model);
}

static int entries(const char *folder)
{
    DIR *dir = opendir(folder);
    int count = 0;

    assert_non_null(dir);
    while (readdir(dir))
        count++;
    closedir(dir);
    return count - 2; /* . and .. */
}

static void nothing_is_replaced_unasked(void **state)
{
    const char *folder = scratch_path(*state, "out"), *file = scratch_path(folder, "tree.ply");
    cln_export_result result;
    cln_export_desc desc;
    cln_model model;
    size_t bytes = 0;
    char *text = NULL;
    mesh m;

    make_tree(&model);
    desc = export_desc(make_run(*state, &model), file);
    assert_ok(cln_make_dirs(folder));
    scratch_put(file, "mine", 4);
    assert_fails(cln_export(&desc, &result), CLN_OUTPUT, "--overwrite");
    text = scratch_get(file, &bytes);
    assert_string_equal(text, "mine");
    free(text);
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &result));
    m = read_mesh(file);
    assert_int_equal(m.vertices, 8 * LEAVES);
    free(m.text);
    desc.file = folder;
    assert_fails(cln_export(&desc, &result), CLN_OUTPUT, "not a plain file");
    desc.file = scratch_path(folder, "nowhere/tree.ply");
    assert_fails(cln_export(&desc, &result), CLN_OUTPUT, "nowhere");
    assert_int_equal(entries(folder), 1);
    cln_model_free(&model);
}

static void what_cannot_be_exported_is_said(void **state)
{
    const char *file = scratch_path(*state, "tree.ply");
    cln_export_result result;
    cln_export_desc desc = export_desc(*state, file);

    assert_fails(cln_export(&desc, &result), CLN_INPUT, "run.json");
    desc.run = make_run(*state, NULL);
    assert_fails(cln_export(&desc, &result), CLN_CHECKPOINT, "no checkpoint");
    desc.colour = "red";
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "'red'");
    desc.what = "trees";
    assert_fails(cln_export(&desc, &result), CLN_USAGE,
                 "'trees' is not one of points|mesh|volume|cameras|octree");
    desc.what = NULL;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "not one of points");
    assert_false(cln_is_file(file));
}

/* ---- pictures ---- */

enum { SIDE = 4 };

/* Looks from (0, 0, -3) of the cube along z; sees the plane z = -0.75, x and y at -0.5625, -0.1875,
 * 0.1875, 0.5625 and `aside` pixels (of 0.375) from there. */
static void make_picture(double aside, cln_camera *camera, cln_picture *picture)
{
    memset(camera, 0, sizeof *camera);
    memset(picture, 0, sizeof *picture);
    camera->c2w[0] = camera->c2w[5] = camera->c2w[10] = 1;
    camera->c2w[3] = 1;
    camera->c2w[7] = 2;
    camera->c2w[11] = 3 - 3 * 4;
    camera->fx = camera->fy = 6;
    camera->cx = camera->cy = SIDE / 2 - aside;
    camera->width = camera->height = picture->width = picture->height = SIDE;
    picture->rgb = calloc(SIDE * SIDE * 3, sizeof(float));
    picture->depth = calloc(SIDE * SIDE, sizeof(float));
    picture->opacity = calloc(SIDE * SIDE, sizeof(float));
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double a = (i % SIDE + 0.5 - camera->cx) / 6;
        const double b = (i / SIDE + 0.5 - camera->cy) / 6;

        picture->depth[i] = (float)(2.25 * sqrt(1 + a * a + b * b));
        picture->opacity[i] = 1;
        for (int c = 0; c < 3; c++)
            picture->rgb[3 * i + c] = 0.2f;
    }
    picture->depth[12] = 0; /* empty */
    picture->depth[13] = 9; /* beyond the cube */
    picture->opacity[15] = 0.4f;
}

static void surfaces_lie_in_their_leaves(void **state)
{
    static const struct {
        double aside;
        int32_t slots[SIDE * SIDE];
    } cases[] = {
        {0,
         {-1, -1, 0, 1, /* the first leaf is culled */
          -1, -1, 2, 3, /* the second one is split */
          8, 8, 9, 9, -1, -1, 9, -1}},
        {0.45, /* places at -0.394, -0.019, 0.356, 0.731: a twentieth of a pixel before 0 */
         {-1, -1, 2, 3, -1, -1, 2, 3, 8, 8, 9, 9, -1, -1, 9, -1}}};
    int32_t slots[SIDE * SIDE];
    cln_camera camera;
    cln_picture picture;
    cln_model model;

    (void)state;
    make_tree(&model);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        make_picture(cases[k].aside, &camera, &picture);
        cln_tree_surface(&model, &camera, &picture, slots);
        for (int i = 0; i < SIDE * SIDE; i++) {
            if (slots[i] != cases[k].slots[i])
                fail_msg("%g aside, pixel %d %d: slot %d, not %d", cases[k].aside, i % SIDE,
                         i / SIDE, slots[i], cases[k].slots[i]);
        }
        cln_picture_free(&picture);
    }
    cln_model_free(&model);
}

static void drawings_show_leaves_and_borders(void **state)
{
    static const int32_t slots[SIDE * SIDE] = {-1, -1, 0, 1, -1, -1, 2, 3,
                                               8,  8,  9, 9, -1, -1, 9, -1};
    uint8_t colours[LEAVES * 3] = {0}, rgb[SIDE * SIDE * 3];
    cln_camera camera;
    cln_picture picture;

    (void)state;
    make_picture(0, &camera, &picture);
    memset(colours + 3 * 8, 255, 6); /* leaves 8 and 9 white, the others black; 0.6 of it each */
    cln_tree_draw(&picture, slots, colours, rgb);
    for (int c = 0; c < 3; c++) {
        assert_int_equal(rgb[3 * 0 + c], 51); /* as rendered */
        assert_int_equal(rgb[3 * 15 + c], 51);
        assert_near(rgb[3 * 8 + c], 255 * 0.68, 1);        /* 8 beside 8 */
        assert_near(rgb[3 * 9 + c], 0.45 * 255 * 0.68, 1); /* 8 beside 9 */
        assert_near(rgb[3 * 10 + c], 255 * 0.68, 1);
        assert_near(rgb[3 * 11 + c], 255 * 0.68, 1); /* no leaf below */
        assert_near(rgb[3 * 2 + c], 0.45 * 255 * 0.08, 1);
        assert_near(rgb[3 * 7 + c], 0.45 * 255 * 0.08, 1); /* 3 above 9 */
    }
    cln_picture_free(&picture);
}

/* The picture by level is always saved, that by error only if an error is known. */
static void pictures_and_their_description_are_saved(void **state)
{
    const char *folder = *state;
    char name[] = "test/r_0.png", file[] = "test_r_0";
    cln_view view = {.name = name, .file = file};
    cln_picture picture;
    cln_model model;
    json_t *views = json_pack("[s]", name), *about = NULL;
    uint8_t *pixels = NULL;
    int width = 0, height = 0, channels = 0;

    make_tree(&model);
    make_picture(0, &view.camera, &picture);
    assert_ok(cln_tree_save(&model, &view, &picture, folder));
    assert_ok(cln_tree_describe(&model, views, folder));
    assert_ok(cln_image_load(scratch_path(folder, "test_r_0.tree.png"), &width, &height, &channels,
                             &pixels));
    assert_int_equal(width, SIDE);
    assert_int_equal(height, SIDE);
    assert_near(pixels[3 * 10 + 2], 0.4 * 51 + 0.6 * 233, 1); /* leaf 9, of level 1: blue */
    free(pixels);
    assert_false(cln_is_file(scratch_path(folder, "test_r_0.tree-error.png")));
    assert_ok(cln_json_read(scratch_path(folder, "tree.json"), false, &about));
    assert_int_equal(json_integer_value(json_object_get(about, "leaves")), LEAVES);
    assert_int_equal(json_integer_value(json_object_get(about, "step")), 321);
    assert_true(json_is_null(json_object_get(about, "error")));
    assert_true(json_equal(json_object_get(about, "views"), views));
    assert_int_equal(
        json_integer_value(json_array_get(json_object_get(about, "leaves_by_level"), 2)), 8);
    json_decref(about);

    model.error[9] = 0.5f;
    model.error[8] = 0.125f;
    assert_ok(cln_tree_save(&model, &view, &picture, folder));
    assert_ok(cln_tree_describe(&model, views, folder));
    assert_true(cln_is_file(scratch_path(folder, "test_r_0.tree-error.png")));
    assert_ok(cln_json_read(scratch_path(folder, "tree.json"), false, &about));
    assert_near(json_real_value(json_object_get(json_object_get(about, "error"), "low")), 0.125, 0);
    assert_near(json_real_value(json_object_get(json_object_get(about, "error"), "high")), 0.5, 0);
    json_decref(about);
    json_decref(views);
    cln_picture_free(&picture);
    cln_model_free(&model);
}

static void palettes_are_told_apart(void **state)
{
    const float values[] = {NAN, 0, -1, 2e-3f, INFINITY, 1e-7f}, nothing[] = {NAN, 0};
    double low = 0, high = 0;
    uint8_t a[3], b[3];

    (void)state;
    assert_true(cln_palette_range(6, values, &low, &high));
    assert_near(high, 2e-3, 1e-9);
    assert_near(low, 2e-6, 1e-12); /* three decades */
    assert_false(cln_palette_range(2, nothing, &low, &high));
    assert_false(cln_palette_range(0, NULL, &low, &high));
    assert_true(isnan(low) && isnan(high));
    for (int i = 0; i < CLN_PALETTE_LEVELS; i++)
        for (int j = 0; j < i; j++) {
            int distance = 0;

            cln_palette_level(i, a);
            cln_palette_level(j, b);
            for (int c = 0; c < 3; c++)
                distance += abs(a[c] - b[c]);
            assert_true(distance > 80);
        }
    cln_palette_error(1, 1, 1, a); /* a scale of one value */
    cln_palette_ramp(1, b);
    assert_memory_equal(a, b, 3);
}

#define ON_DISK(test) cmocka_unit_test_setup_teardown(test, scratch_make, scratch_remove)

int test_group_export(void)
{
    const struct CMUnitTest tests[] = {
        ON_DISK(boxes_are_the_active_leaves),
        ON_DISK(boxes_are_scaled),
        ON_DISK(boxes_far_away_keep_their_sides),
        ON_DISK(faces_look_outwards),
        ON_DISK(errors_are_coloured_on_a_log_scale),
        ON_DISK(unknown_errors_are_grey),
        ON_DISK(nothing_is_replaced_unasked),
        ON_DISK(what_cannot_be_exported_is_said),
        cmocka_unit_test(surfaces_lie_in_their_leaves),
        cmocka_unit_test(drawings_show_leaves_and_borders),
        ON_DISK(pictures_and_their_description_are_saved),
        cmocka_unit_test(palettes_are_told_apart),
    };

    return cmocka_run_group_tests_name("export", tests, NULL, NULL);
}
