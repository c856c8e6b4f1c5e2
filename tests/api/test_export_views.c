/* How many views see a surface, as exports tell it: the share that few see, of surfaces that are
 * made up and of a mesh's file; numbers of points and of fewer triangles beside the mesh's; shares
 * that no view sees, and that is seen through. */
#include "unit.h"
#include "export/mesh.h"
#include "export/reduce.h"
#include "near.h"
#include "run_fixture.h"
#include "tests.h"

/* ---- made up ---- */

/* A triangle with a right angle in the plane z = 0, and its corners' views. */
typedef struct piece {
    double area;
    uint8_t views[3];
} piece;

static double few_of(const piece *pieces, size_t count)
{
    cln_export_result result = {0};
    cln_export_job job = {.opened.model.space = cln_space_unit, .scale = 1, .result = &result};
    cln_surface s = {.vertices = 3 * count, .faces = count};

    s.at = calloc(s.vertices, sizeof *s.at);
    s.face = calloc(s.faces, sizeof *s.face);
    s.views = calloc(s.vertices, 1);
    assert_true(s.at && s.face && s.views);
    for (uint32_t i = 0; i < 3 * count; i++) {
        s.face[i / 3][i % 3] = i;
        s.views[i] = pieces[i / 3].views[i % 3];
    }
    for (size_t f = 0; f < count; f++) {
        s.at[3 * f + 1][0] = (float)pieces[f].area;
        s.at[3 * f + 2][1] = 2;
    }
    cln_export_tell_surface(&job, &s);
    cln_surface_free(&s);
    return result.few_views;
}

/* A triangle is seen by as many views as the corner that most of them see. Few are one or two, and
 * what none sees does not count. */
static void a_share_is_seen_by_few(void **state)
{
    static const piece none[] = {{1, {0, 0, 0}}};
    static const piece half[] = {{1, {2, 2, 2}}, {1, {5, 5, 5}}};
    static const piece least[] = {{1, {3, 0, 0}}, {2, {0, 3, 0}}, {4, {0, 0, 3}}};
    static const piece many[] = {{1, {2, 0, 1}}, {2, {1, 1, 5}}, {4, {0, 0, 0}},
                                 {3, {1, 3, 0}}, {6, {0, 0, 1}}, {8, {100, 2, 2}}};

    (void)state;
    cln_log_set_sink(fixture_no_log, NULL);
    assert_near(few_of(none, 1), 0, 0);
    assert_near(few_of(half, 2), 0.5, 1e-6);
    assert_near(few_of(least, 3), 0, 0);
    assert_near(few_of(many, 6), 7 / 20.0, 1e-6);
}

/* One part is not the largest of several. */
static void one_part_is_no_choice(void **state)
{
    (void)state;
    for (int parts = 1; parts <= 2; parts++) {
        const cln_export_desc desc = {.what = "mesh"};
        cln_export_result result = {.parts = parts};
        cln_export_job job = {.desc = &desc, .scale = 1, .result = &result};
        char *text = NULL;

        assert_ok(cln_export_comment(&job, "the surface", &text));
        assert_true(!strstr(text, "the largest of 2 parts") == (parts < 2));
        assert_true(!strstr(text, "largest") == (parts < 2));
        free(text);
    }
}

/* ---- of files ---- */

typedef struct vertex {
    float at[3], normal[3];
    uint8_t colour[3], views;
} __attribute__((packed)) vertex;

typedef struct ply {
    char *text;
    const vertex *vertices;
    int count, faces;
} ply;

/* File and device are set here, and the run, if it has none. */
static ply export_desc(cln_export_desc desc, const char *name, cln_export_result *result)
{
    const char *faces = NULL;
    size_t bytes = 0;
    ply p = {0};

    desc.run = desc.run ? desc.run : fixture_path("whole");
    desc.file = strdup(fixture_path(name));
    desc.device = fixture_device();
    assert_ok(cln_export(&desc, result));
    p.text = scratch_get(desc.file, &bytes);
    assert_int_equal(sscanf(strstr(p.text, "element vertex "), "element vertex %d", &p.count), 1);
    faces = strstr(p.text, "element face ");
    assert_true(!faces || sscanf(faces, "element face %d", &p.faces) == 1);
    p.vertices = (const vertex *)(strstr(p.text, "end_header\n") + strlen("end_header\n"));
    free((void *)desc.file);
    return p;
}

static ply export_ply(const char *what, const char *name, int64_t triangles, int64_t count,
                      cln_export_result *result)
{
    return export_desc((cln_export_desc){.what = what, .triangles = triangles, .count = count},
                       name, result);
}

static const vertex *corner(const ply *p, int face, int k)
{
    uint32_t at = 0;

    memcpy(&at, (const char *)(p->vertices + p->count) + 13 * face + 1 + 4 * k, sizeof at);
    assert_in_range(at, 0, p->count - 1);
    return &p->vertices[at];
}

/* A triangle's normal times twice its area. */
static void normal_of(const vertex *u, const vertex *v, const vertex *w, double n[3])
{
    float a[3], b[3], c[3];

    memcpy(a, u->at, sizeof a);
    memcpy(b, v->at, sizeof b);
    memcpy(c, w->at, sizeof c);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;

        n[i] = ((double)b[j] - a[j]) * ((double)c[k] - a[k]) -
               ((double)b[k] - a[k]) * ((double)c[j] - a[j]);
    }
}

static double size_of(const double n[3])
{
    return sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
}

/* What a mesh's file has at its vertices tells the same share as the result: by some triangles few
 * views look at, others more. */
static void a_file_tells_the_share(void **state)
{
    cln_export_result result;
    double few = 0, all = 0;
    ply mesh;

    NEED_DEVICE();
    mesh = export_ply("mesh", "mesh.ply", 0, 0, &result);
    for (int f = 0; f < mesh.faces; f++) {
        double n[3];
        int most = 0;

        for (int k = 0; k < 3; k++)
            most = corner(&mesh, f, k)->views > most ? corner(&mesh, f, k)->views : most;
        assert_in_range(most, 1, TRAIN_VIEWS); /* no triangle that no view sees is kept */
        normal_of(corner(&mesh, f, 0), corner(&mesh, f, 1), corner(&mesh, f, 2), n);
        all += size_of(n);
        few += most < 3 ? size_of(n) : 0;
    }
    print_message("    %.4f of %d triangles\n", few / all, mesh.faces);
    assert_true(few > 0.05 * all && few < 0.95 * all);
    assert_near(result.few_views, few / all, 1e-4);
    free(mesh.text);
}

static bool is_in(const ply *mesh, int f, const vertex *at)
{
    double n[3], part[3], all = 0, sum = 0;

    normal_of(corner(mesh, f, 0), corner(mesh, f, 1), corner(mesh, f, 2), n);
    all = size_of(n);
    for (int k = 0; k < 3; k++) {
        normal_of(at, corner(mesh, f, k), corner(mesh, f, (k + 1) % 3), part);
        sum += size_of(part);
    }
    return sum < all * (1 + 1e-4);
}

/* A point has the least of the numbers at the corners of its triangle. */
static void points_have_the_least(void **state)
{
    cln_export_result result;
    int mixed = 0, found = 0;
    ply mesh, points;

    NEED_DEVICE();
    mesh = export_ply("mesh", "whole.ply", 0, 0, &result);
    points = export_ply("points", "points.ply", 0, 500, &result);
    assert_int_equal(points.count, 500);
    for (int i = 0; i < points.count; i++) {
        int in = 0, at = 0, least = 255, most = 0;

        for (int f = 0; f < mesh.faces; f++)
            if (is_in(&mesh, f, &points.vertices[i])) {
                at = f;
                in++;
            }
        if (in != 1) /* on an edge */
            continue;
        for (int k = 0; k < 3; k++) {
            least = corner(&mesh, at, k)->views < least ? corner(&mesh, at, k)->views : least;
            most = corner(&mesh, at, k)->views > most ? corner(&mesh, at, k)->views : most;
        }
        assert_int_equal(points.vertices[i].views, least);
        mixed += least < most;
        found++;
    }
    print_message("    %d of %d points, %d where numbers differ\n", found, points.count, mixed);
    assert_true(found > points.count * 3 / 4 && mixed > 20);
    free(mesh.text);
    free(points.text);
}

/* Vertices of fewer triangles are some of the mesh's, with their numbers. */
static void fewer_triangles_keep_them(void **state)
{
    cln_export_result result;
    int found = 0;
    ply mesh, fewer;

    NEED_DEVICE();
    if (cln_mesh_reduce_possible() != CLN_OK) {
        cln_clear_error();
        skip();
    }
    mesh = export_ply("mesh", "all.ply", 0, 0, &result);
    fewer = export_ply("mesh", "fewer.ply", mesh.faces / 3, 0, &result);
    assert_in_range(fewer.faces, 10, mesh.faces / 3);
    for (int v = 0; v < fewer.count; v++)
        for (int m = 0; m < mesh.count; m++)
            if (memcmp(mesh.vertices[m].at, fewer.vertices[v].at, sizeof mesh.vertices->at) == 0) {
                assert_int_equal(fewer.vertices[v].views, mesh.vertices[m].views);
                found++;
                break;
            }
    assert_true(found > fewer.count * 9 / 10); /* others part edges */
    free(mesh.text);
    free(fewer.text);
}

/* A run that has learnt the ball, and which parts of it are nothing: trained by the first test. */
static const char *solid_run(void)
{
    cln_config config = fixture_voxels();
    cln_train_result trained;

    config.steps = 200;
    if (!cln_is_dir(fixture_path("solid")))
        assert_ok(fixture_train("solid", false, &config, NULL, &trained));
    return fixture_path("solid");
}

/* So many points that each has a square of --spacing's side, in lengths of the scene. */
static void a_spacing_is_a_number_of_points(void **state)
{
    const double spacing = 0.05;
    cln_export_result result;
    double area = 0;
    ply mesh, points;

    NEED_DEVICE();
    mesh = export_ply("mesh", "area.ply", 0, 0, &result);
    for (int f = 0; f < mesh.faces; f++) {
        double n[3];

        normal_of(corner(&mesh, f, 0), corner(&mesh, f, 1), corner(&mesh, f, 2), n);
        area += 0.5 * size_of(n);
    }
    points =
        export_desc((cln_export_desc){.what = "points", .spacing = spacing}, "spaced.ply", &result);
    print_message("    an area of %.2f has %d points\n", area, points.count);
    assert_near(points.count * spacing * spacing / area, 1, 1e-3);
    free(mesh.text);
    free(points.text);
}

/* What is told of a closed surface that no view sees is not what a box cut: that is as it is to
 * be. */
static void cuts_are_not_unseen(void **state)
{
    static const double box[6] = {0.1, -3, -3, 3, 3, 3};
    cln_export_desc desc = {.what = "mesh", .closed = true, .cropped = true};
    cln_export_result result;
    double all = 0, unseen = 0, cut = 0;
    ply mesh;

    NEED_DEVICE();
    memcpy(desc.crop, box, sizeof box);
    desc.run = solid_run();
    mesh = export_desc(desc, "cut.ply", &result);
    for (int f = 0; f < mesh.faces; f++) {
        double n[3];
        int most = 0, flat = 0;

        for (int k = 0; k < 3; k++) {
            const vertex *v = corner(&mesh, f, k);
            float at[3];

            memcpy(at, v->at, sizeof at);
            flat += fabs((double)at[0] - box[0]) < 1e-5;
            most = v->views > most ? v->views : most;
        }
        normal_of(corner(&mesh, f, 0), corner(&mesh, f, 1), corner(&mesh, f, 2), n);
        all += size_of(n);
        cut += flat == 3 ? size_of(n) : 0;
        unseen += flat < 3 && most == 0 ? size_of(n) : 0;
    }
    print_message("    %.4f is cut, %.4f unseen\n", cut / all, unseen / all);
    assert_true(cut > 0.05 * all && unseen > 0);
    assert_near(result.unseen, unseen / all, 1e-4);
    free(mesh.text);
}

/* The share of what the training views show that is seen through leaves outlines out, which are
 * half covered: pixels that have something at two pixels' distance on all sides count. */
static void outlines_are_not_faint(void **state)
{
    static const int outlines[2] = {2, 0};
    cln_render_desc desc = {.out = fixture_path("training views"),
                            .split = "train",
                            .antialias = 1,
                            .device = fixture_device()};
    cln_export_result result;
    double share[2];
    int shown[2] = {0}, faint[2] = {0};
    ply mesh;

    NEED_DEVICE();
    desc.run = solid_run();
    fixture_rendered(&desc, TRAIN_VIEWS, 0);
    for (int i = 0; i < TRAIN_VIEWS; i++) {
        uint8_t *p = NULL;
        int width = 0, height = 0, channels = 0;
        char name[64];

        snprintf(name, sizeof name, "training views/train_r_%d.opacity.png", i);
        assert_ok(cln_image_load(fixture_path(name), &width, &height, &channels, &p));
        assert_true(width == SIDE && height == SIDE);
        for (int k = 0; k < 2; k++)
            for (int y = outlines[k]; y < SIDE - outlines[k]; y++)
                for (int x = outlines[k]; x < SIDE - outlines[k]; x++) {
                    const int by = outlines[k], at = y * SIDE + x;
                    const int around[5] = {at, at - by, at + by, at - by * SIDE, at + by * SIDE};
                    bool all = true;

                    for (int j = 0; j < 5; j++)
                        all = all && p[channels * around[j]] > 25.5;
                    shown[k] += all;
                    faint[k] += all && p[channels * at] < 229.5;
                }
        free(p);
    }
    for (int k = 0; k < 2; k++)
        share[k] = (double)faint[k] / shown[k];
    mesh = export_desc((cln_export_desc){.run = desc.run, .what = "mesh"}, "faint.ply", &result);
    print_message("    %.4f, with outlines %.4f\n", share[0], share[1]);
    assert_true(fabs(share[1] - share[0]) > 0.03);
    assert_near(result.faint, share[0], 0.005);
    free(mesh.text);
}

int test_group_export_views(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_share_is_seen_by_few),
        cmocka_unit_test(one_part_is_no_choice),
        cmocka_unit_test(a_file_tells_the_share),
        cmocka_unit_test(points_have_the_least),
        cmocka_unit_test(fewer_triangles_keep_them),
        cmocka_unit_test(a_spacing_is_a_number_of_points),
        cmocka_unit_test(cuts_are_not_unseen),
        cmocka_unit_test(outlines_are_not_faint),
    };

    return cmocka_run_group_tests_name("export_views", tests, fixture_setup, fixture_teardown);
}
