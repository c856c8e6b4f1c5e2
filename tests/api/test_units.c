/* What a run hands back, in the user's frame and units: depth, points, boxes of leaves, a volume
 * and cameras of a trained ball, in units from 1e-4 to 1e6 and far from the origin. Depth and
 * points are the ball's to 1 % of the distance to the camera, in the median over all pixels that
 * show it and over all points. Shorter trainings are farther off, all to one side: the surface
 * begins where it is, but its skin is soft, so half of the opacity lies behind (150 steps: 4.4 %,
 * 400: 2.5 %, 1,500: 0.8 %); what is handed back is the median of the field's density to 0.2 %. In
 * the other frames they are the plain one's: units that are powers of two change no bit of a
 * training, and an offset changes last bits of poses. Under sanitizers trainings are short, with a
 * bound to match. */
#include "unit.h"
#include "base/number.h"
#include "io/npy.h"
#include "near.h"
#include "run_fixture.h"
#include "sanitized.h"
#include "tests.h"

enum { PIXELS = 40, VIEWS = 24, POINTS = 3000, CORNERS = 8, UNIT_STEPS = SANITIZED ? 400 : 1000 };

static const double NEAR = SANITIZED ? 0.04 : 0.015;
static const double DISTANCE = 3; /* from the cameras to the surface, in radii */

/* The ball has the radius `unit` around `offset`; cameras are 4 radii away. */
typedef struct frame {
    const char *name;
    double unit, offset[3];
} frame;

static const frame frames[] = {{"plain", 1, {0, 0, 0}},
                               {"small", 0x1p-13, {0, 0, 0}},
                               {"large", 0x1p20, {0, 0, 0}},
                               {"survey", 1, {500000.3, 4600000.7, 90.1}}};
enum { FRAMES = sizeof frames / sizeof *frames };

static const double focal = 0.5 * PIXELS / 0.36397023426620234, box = 1.25; /* tan 20 degrees */

/* OpenGL's axes; view VIEWS is the test view. */
static void pose(const frame *f, int view, double m[3][4])
{
    const double height = view < VIEWS ? 1.6 * (view + 0.5) / VIEWS - 0.8 : 0.3;

    fixture_pose(2.399963 * view, height, m);
    for (int a = 0; a < 3; a++)
        m[a][3] = f->unit * m[a][3] + f->offset[a];
}

/* Distance along the ray of a pixel's centre to the ball, in radii, and the point there about its
 * middle; 0: passes it. */
static double distance_to_ball(const frame *f, double m[3][4], int pixel, double at[3])
{
    const double u = (pixel % PIXELS + 0.5 - PIXELS / 2) / focal;
    const double v = (pixel / PIXELS + 0.5 - PIXELS / 2) / focal, length = sqrt(u * u + v * v + 1);
    double o[3], d[3], b = 0, c = -1, root = 0;

    for (int a = 0; a < 3; a++) {
        o[a] = (m[a][3] - f->offset[a]) / f->unit;
        d[a] = (u * m[a][0] - v * m[a][1] - m[a][2]) / length;
        b += o[a] * d[a];
        c += o[a] * o[a];
    }
    root = b * b - c;
    if (!(root > 0))
        return 0;
    for (int a = 0; a < 3; a++)
        at[a] = o[a] + (-b - sqrt(root)) * d[a];
    return -b - sqrt(root);
}

static void put_view(const frame *f, const char *folder, int view, json_t *list)
{
    uint8_t rgba[PIXELS * PIXELS * 4] = {0};
    double m[3][4];
    char name[32], path[PATH_MAX + 64];
    json_t *rows = json_array();

    pose(f, view, m);
    for (int i = 0; i < PIXELS * PIXELS; i++) {
        double at[3];

        if (distance_to_ball(f, m, i, at) == 0)
            continue;
        for (int a = 0; a < 3; a++) /* stripes, so that places tell themselves apart */
            rgba[4 * i + a] = cln_to_u8((float)(0.5 + 0.25 * at[a] + 0.2 * sin(15 * at[a])));
        rgba[4 * i + 3] = 255;
    }
    for (int a = 0; a < 3; a++)
        json_array_append_new(rows, json_pack("[f,f,f,f]", m[a][0], m[a][1], m[a][2], m[a][3]));
    json_array_append_new(rows, json_pack("[i,i,i,i]", 0, 0, 0, 1));
    snprintf(name, sizeof name, "./r_%02d", view);
    json_array_append_new(list,
                          json_pack("{s:s, s:o}", "file_path", name, "transform_matrix", rows));
    snprintf(path, sizeof path, "%s/%s.png", folder, name + 2);
    assert_ok(cln_image_write_png(path, PIXELS, PIXELS, 4, rgba));
}

static void put_scene(const frame *f, const char *folder)
{
    assert_ok(cln_make_dirs(folder));
    for (int test = 0; test < 2; test++) {
        json_t *list = json_array(), *document = NULL;
        char path[PATH_MAX + 64], *text = NULL;

        for (int v = test ? VIEWS : 0; v < VIEWS + test; v++)
            put_view(f, folder, v, list);
        document = json_pack("{s:f, s:o}", "camera_angle_x", 2 * atan(0.5 * PIXELS / focal),
                             "frames", list);
        text = json_dumps(document, 0);
        snprintf(path, sizeof path, "%s/transforms_%s.json", folder, test ? "test" : "train");
        scratch_put(path, text, strlen(text));
        free(text);
        json_decref(document);
    }
}

static const char *path_of(const frame *f, const char *name)
{
    char path[64];

    snprintf(path, sizeof path, "%s-%s", f->name, name);
    return fixture_path(path);
}

static void train(const frame *f)
{
    cln_settings settings = {.config = fixture_config(), .preset = "fast"};
    cln_config *config = &settings.config;
    cln_train_result result;
    cln_train_desc desc = {.scene = path_of(f, "scene"),
                           .run = path_of(f, "run"),
                           .skip_selftest = true,
                           .settings = &settings,
                           .device = fixture_device(),
                           .command = "test"};
    size_t used = 0;

    config->start_level = 2;
    config->bands = 4;
    config->view_dependence = false;
    config->n1 = 12;
    config->rays = 1024;
    config->batch_samples = 16384;
    config->steps = UNIT_STEPS;
    for (int i = 0; i < 6; i++)
        used += (size_t)snprintf(config->bbox + used, sizeof config->bbox - used, "%s%.17g",
                                 i ? "," : "", f->offset[i % 3] + (i < 3 ? -box : box) * f->unit);
    assert_true(used < sizeof config->bbox);
    put_scene(f, desc.scene);
    assert_ok(cln_train(&desc, &result));
}

static double median(double *values, int count)
{
    assert_true(count > 0);
    cln_reals_sort(values, count);
    return values[count / 2];
}

static void export(const frame *f, const char *what, const char *file, double spacing)
{
    const cln_export_desc desc = {.run = path_of(f, "run"),
                                  .what = what,
                                  .file = path_of(f, file),
                                  .spacing = spacing * f->unit,
                                  .count = strcmp(what, "points") == 0 ? POINTS : 0,
                                  .device = fixture_device()};
    cln_export_result result;

    assert_ok(cln_export(&desc, &result));
}

/* What the plain frame gave, and what the last frame did, in radii. */
static double plain_depth[PIXELS * PIXELS], plain_points[POINTS][3];

/* The same as in the plain frame: exactly, or far from the origin to 1 % in the median. */
static void compare(const frame *f, int count, const double *plain, const double *here)
{
    double *off = calloc((size_t)count, sizeof *off);

    assert_non_null(off);
    for (int i = 0; i < count; i++)
        off[i] = fabs(here[i] - plain[i]);
    if (f->offset[0] == 0)
        assert_memory_equal(here, plain, (size_t)count * sizeof *here);
    else
        assert_true(median(off, count) < 0.01);
    free(off);
}

/* Depth of a held-out view: how far off it is in the median, over the depth. */
static void depth_is_the_balls(const frame *f)
{
    const cln_render_desc desc = {.run = path_of(f, "run"),
                                  .out = path_of(f, "views"),
                                  .split = "test",
                                  .device = fixture_device()};
    cln_render_result result;
    double m[3][4], off[PIXELS * PIXELS], here[PIXELS * PIXELS];
    char name[64];
    float *depth = NULL;
    int dims = 0, shape[4], both = 0, shown = 0;

    assert_ok(cln_render(&desc, &result));
    snprintf(name, sizeof name, "views/r_%02d.depth.npy", VIEWS);
    assert_ok(cln_npy_read_f32(path_of(f, name), &dims, shape, &depth));
    assert_true(dims == 2 && shape[0] == PIXELS && shape[1] == PIXELS);
    pose(f, VIEWS, m);
    for (int i = 0; i < PIXELS * PIXELS; i++) {
        double at[3];
        const double exact = f->unit * distance_to_ball(f, m, i, at);

        here[i] = depth[i] / f->unit;
        shown += exact > 0;
        if (exact > 0 && depth[i] > 0)
            off[both++] = fabs(depth[i] - exact) / exact;
    }
    free(depth);
    print_message("    %s: %d of %d pixels have a depth, off by %.4f in the median\n", f->name,
                  both, shown, median(off, both));
    assert_true(both > 0.97 * shown);
    assert_true(median(off, both) < NEAR);
    if (f == frames)
        memcpy(plain_depth, here, sizeof here);
    compare(f, PIXELS * PIXELS, plain_depth, here);
}

/* The places of a PLY file's vertices, float or double, less the offset and in radii. */
static int read_places(const frame *f, const char *path, size_t rest, double (**out)[3])
{
    size_t bytes = 0;
    char *text = scratch_get(path, &bytes);
    const char *body = strstr(text, "end_header\n") + strlen("end_header\n");
    const size_t size = strstr(text, "property double x\n") ? 8 : 4;
    int count = 0;

    assert_int_equal(sscanf(strstr(text, "element vertex "), "element vertex %d", &count), 1);
    *out = calloc((size_t)count, sizeof **out);
    assert_non_null(*out);
    assert_true((size_t)(body - text) + (size_t)count * (3 * size + rest) <= bytes);
    for (int i = 0; i < count; i++)
        for (size_t a = 0; a < 3; a++) {
            const char *at = body + (size_t)i * (3 * size + rest) + a * size;
            double wide = 0;
            float narrow = 0;

            memcpy(size == 8 ? (void *)&wide : (void *)&narrow, at, size);
            (*out)[i][a] = ((size == 8 ? wide : (double)narrow) - f->offset[a]) / f->unit;
        }
    free(text);
    return count;
}

static void points_are_the_balls(const frame *f)
{
    enum { NORMAL_COLOUR_VIEWS = 3 * 4 + 3 + 1 };
    double off[POINTS], (*at)[3] = NULL;

    export(f, "points", "points.ply", 0);
    assert_int_equal(read_places(f, path_of(f, "points.ply"), NORMAL_COLOUR_VIEWS, &at), POINTS);
    for (int i = 0; i < POINTS; i++)
        off[i] = fabs(sqrt(at[i][0] * at[i][0] + at[i][1] * at[i][1] + at[i][2] * at[i][2]) - 1);
    if (f == frames)
        memcpy(plain_points, at, sizeof plain_points);
    if (f->offset[0] == 0) /* else another triangle moves all that follow */
        compare(f, 3 * POINTS, plain_points[0], at[0]);
    free(at);
    print_message("    %s: points are off by %.4f of the distance in the median\n", f->name,
                  median(off, POINTS) / DISTANCE);
    assert_true(median(off, POINTS) < NEAR * DISTANCE);
}

/* Every leaf is a cube of a level's side within the box. */
static void boxes_are_the_trees(const frame *f)
{
    enum { COLOUR_LEVEL_AND_ERROR = 3 + 1 + 4 };
    double(*at)[3] = NULL;
    int count = 0;

    export(f, "octree", "tree.ply", 0);
    count = read_places(f, path_of(f, "tree.ply"), COLOUR_LEVEL_AND_ERROR, &at);
    assert_true(count >= CORNERS && count % CORNERS == 0);
    for (int i = 0; i < count; i += CORNERS)
        for (int a = 0; a < 3; a++) {
            const double steps = (at[i][a] + box) / (box / 2), side = at[i + 7][a] - at[i][a];

            assert_near(side, box / 2, 1e-5);
            assert_near(steps, round(steps), 1e-5);
        }
    free(at);
}

/* The volume's places: its density weighs about the ball's middle, and is none far from it. */
static void volume_is_the_balls(const frame *f)
{
    double first[3], middle[3] = {0}, all = 0, outside = 0, spacing = 0;
    float *values = NULL;
    int dims = 0, shape[4];
    char name[64];
    json_t *about = NULL;

    export(f, "volume", "volume.npy", 0.1);
    assert_ok(cln_npy_read_f32(path_of(f, "volume.npy"), &dims, shape, &values));
    snprintf(name, sizeof name, "%s-volume.json", f->name);
    about = fixture_json(name);
    spacing = json_number_value(fixture_at(about, "spacing")) / f->unit;
    assert_near(spacing, 0.1, 1e-12);
    for (size_t a = 0; a < 3; a++)
        first[a] =
            (json_number_value(json_array_get(fixture_at(about, "first"), a)) - f->offset[a]) /
            f->unit;
    for (int i = 0; i < shape[0] * shape[1] * shape[2]; i++) {
        const int cell[3] = {i % shape[2], i / shape[2] % shape[1], i / shape[2] / shape[1]};
        const double share = 1 - exp(-(double)values[4 * i + 3] * f->unit * 0.1);
        double square = 0;

        for (int a = 0; a < 3; a++) {
            const double at = first[a] + cell[a] * spacing;

            middle[a] += share * at;
            square += at * at;
        }
        all += share;
        outside += square > 1.2 * 1.2 ? share : 0;
    }
    print_message("    %s: the volume's middle is %.3f %.3f %.3f, %.4f of it outside\n", f->name,
                  middle[0] / all, middle[1] / all, middle[2] / all, outside / all);
    for (int a = 0; a < 3; a++)
        assert_true(fabs(middle[a] / all) < 0.1);
    assert_true(outside < 0.05 * all);
    json_decref(about);
    free(values);
}

/* Poses to 1e-14 of the largest number in them. */
static void cameras_are_the_given_ones(const frame *f)
{
    const double most = f->offset[1] + 4 * f->unit;
    json_t *document = NULL, *list = NULL;
    char name[64];

    export(f, "cameras", "cameras.json", 0);
    snprintf(name, sizeof name, "%s-cameras.json", f->name);
    document = fixture_json(name);
    list = fixture_at(document, "frames");
    assert_int_equal(json_array_size(list), VIEWS + 1);
    for (size_t i = 0; i <= VIEWS; i++) {
        json_t *one = json_array_get(list, i);
        const int view = atoi(strstr(json_string_value(fixture_at(one, "file_path")), "r_") + 2);
        double m[3][4];

        pose(f, view, m);
        for (size_t a = 0; a < 3; a++)
            for (size_t k = 0; k < 4; k++)
                assert_near(json_number_value(json_array_get(
                                json_array_get(fixture_at(one, "transform_matrix"), a), k)),
                            m[a][k], k < 3 ? 1e-12 : 1e-14 * most);
    }
    json_decref(document);
}

static void all_is_in_the_users_frame(void **state)
{
    NEED_DEVICE();
    for (int i = 0; i < FRAMES; i++) {
        train(&frames[i]);
        depth_is_the_balls(&frames[i]);
        points_are_the_balls(&frames[i]);
        boxes_are_the_trees(&frames[i]);
        volume_is_the_balls(&frames[i]);
        cameras_are_the_given_ones(&frames[i]);
    }
}

int test_group_units(void)
{
    const struct CMUnitTest tests[] = {cmocka_unit_test(all_is_in_the_users_frame)};

    return cmocka_run_group_tests_name("units", tests, fixture_setup_folder, fixture_teardown);
}
