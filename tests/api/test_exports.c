/* cln_export of a trained run: points and mesh of a ball of radius 1, the formats of a mesh against
 * each other, a volume against the field, cameras read by the scene's readers, what is refused. */
#include "unit.h"
#include <dlfcn.h>
#include <unistd.h>
#include "comma.h"
#include "export/reduce.h"
#include "glb.h"
#include "io/npy.h"
#include "near.h"
#include "run_fixture.h"
#include "scene/scene.h"
#include "tests.h"

static cln_export_desc export_desc(const char *what, const char *file)
{
    return (cln_export_desc){.run = fixture_path("whole"),
                             .what = what,
                             .file = fixture_path(file),
                             .device = fixture_device()};
}

typedef struct vertex {
    float at[3], normal[3];
    uint8_t colour[3], views;
} __attribute__((packed)) vertex;

/* The vertices of a PLY file with float positions; the caller frees *text. */
static const vertex *read_ply(const char *path, char **text, int *count)
{
    size_t bytes = 0;
    const char *body = NULL;

    *text = scratch_get(path, &bytes);
    assert_int_equal(sscanf(strstr(*text, "element vertex "), "element vertex %d", count), 1);
    assert_non_null(strstr(*text, "property float x\n"));
    body = strstr(*text, "end_header\n") + strlen("end_header\n");
    assert_true((size_t)(body - *text) + (size_t)*count * sizeof(vertex) <= bytes);
    return (const vertex *)body;
}

static void points_are_on_the_ball(void **state)
{
    cln_config config = fixture_config();
    cln_train_result trained;
    cln_export_desc desc = export_desc("points", "points.ply");
    cln_export_result result;
    double distance = 0, cosine = 0, shade = 0, height = 0;
    const vertex *v = NULL;
    char *text = NULL;
    int n = 0;

    NEED_DEVICE();
    config.steps = 200;
    assert_ok(fixture_train("longer", false, &config, NULL, &trained));
    desc.run = fixture_path("longer");
    desc.count = 3000;
    assert_ok(cln_export(&desc, &result));
    assert_int_equal(result.vertices, 3000);
    assert_int_equal(result.faces, 0);
    v = read_ply(desc.file, &text, &n);
    assert_int_equal(n, 3000);
    for (int i = 0; i < n; i++) {
        const double r = sqrt(pow(v[i].at[0], 2) + pow(v[i].at[1], 2) + pow(v[i].at[2], 2));

        distance += fabs(r - 1) / n;
        for (int a = 0; a < 3; a++) {
            cosine += (double)v[i].at[a] * v[i].normal[a] / r / n;
            shade += fabs(v[i].colour[a] / 255.0 - (0.5 + 0.5 * v[i].at[a] / r)) / (3 * n);
        }
        height += v[i].at[2] / n;
    }
    print_message("    distance %.4f, cosine %.4f, colour %.4f, height %.4f\n", distance, cosine,
                  shade, height);
    assert_true(distance < 0.1); /* 24 x 24 pixels, 200 steps */
    assert_true(cosine > 0.9);
    assert_true(shade < 0.15);
    free(text);
}

/* Normals change within a triangle: of two points on one, next to each other in the file, they are
 * not the same. */
static void normals_of_points_are_between(void **state)
{
    cln_export_desc desc = export_desc("mesh", "normals.ply");
    cln_export_result mesh, result;
    const vertex *v = NULL;
    char *text = NULL;
    int n = 0, same = 0;

    NEED_DEVICE();
    assert_ok(cln_export(&desc, &mesh));
    desc.what = "points";
    desc.file = fixture_path("many.ply");
    desc.count = 8 * mesh.faces;
    assert_ok(cln_export(&desc, &result));
    v = read_ply(desc.file, &text, &n);
    assert_int_equal(n, desc.count);
    for (int i = 1; i < n; i++)
        same += memcmp(v[i].normal, v[i - 1].normal, sizeof v[i].normal) == 0;
    print_message("    %d points, %d with the one before's normal\n", n, same);
    assert_true(same < n / 20);
    free(text);
}

static char cut[256]; /* that the hardly trained surface ends at the cube, and is seen through */

static void keep_warning(cln_log_level level, const char *line, void *user)
{
    if (level == CLN_LOG_WARN && (strstr(line, ": it ends at the fac") || strstr(line, "seen thr")))
        snprintf(cut, sizeof cut, "%s", line);
    else if (level == CLN_LOG_WARN)
        snprintf(user, 256, "%s", line);
}

static void formats_of_a_mesh_agree(void **state)
{
    static const char *const files[] = {"mesh.ply", "mesh.obj", "mesh.glb", "mesh.stl"};
    char warning[256] = "";
    cln_export_result results[4];
    const vertex *v = NULL;
    char *text = NULL, *obj = NULL, *stl = NULL, *line = NULL;
    int n = 0, lines = 0;
    size_t bytes = 0;

    NEED_DEVICE();
    cln_log_set_sink(keep_warning, warning);
    for (int i = 0; i < 4; i++) {
        const cln_export_desc desc = export_desc("mesh", files[i]);

        assert_ok(cln_export(&desc, &results[i]));
        assert_true(results[i].faces > 100);
        assert_int_equal(results[i].vertices, results[0].vertices);
        assert_int_equal(results[i].faces, results[0].faces);
    }
    cln_log_set_sink(fixture_no_log, NULL);
    assert_string_equal(warning, ""); /* floats are fine enough here */
    v = read_ply(fixture_path("mesh.ply"), &text, &n);
    assert_int_equal(n, results[0].vertices);
    stl = scratch_get(fixture_path("mesh.stl"), &bytes);
    assert_int_equal(bytes, 84 + 50 * results[0].faces);
    for (int64_t f = 0; f < results[0].faces; f++)
        for (int k = 0; k < 3; k++) {
            const char *face = (const char *)(v + n) + 13 * f + 1;
            uint32_t corner = 0;

            memcpy(&corner, face + 4 * k, sizeof corner);
            assert_memory_equal(stl + 84 + 50 * f + 12 + 12 * k, v[corner].at, sizeof v->at);
        }
    free(stl);
    obj = scratch_get(fixture_path("mesh.obj"), &bytes);
    for (line = strstr(obj, "\nv "); line; line = strstr(line + 1, "\nv "), lines++) {
        double p[3];

        assert_int_equal(sscanf(line, "\nv %lf %lf %lf", &p[0], &p[1], &p[2]), 3);
        for (int a = 0; a < 3; a++)
            assert_near(p[a], v[lines].at[a], 1e-6);
    }
    assert_int_equal(lines, n);
    free(text);
    free(obj);
}

/* The ball is the bluer the higher it is, as its cameras see it: z. In glTF that is y. Other files
 * are turned if up is given, and then the other way round. */
static void a_mesh_stands_upright(void **state)
{
    static const double ups[3][3] = {{0, 0, 0}, {0, 0, -1}, {1, 0, 0}};
    const vertex *plain = NULL, *turned = NULL;
    char *texts[2] = {NULL};
    int n = 0, m = 0;
    cln_export_result result;

    NEED_DEVICE();
    for (int i = 0; i < 3; i++) {
        cln_export_desc desc = export_desc("mesh", "up.glb");
        double blue[2] = {0}, count[2] = {0};
        size_t vertices = 0;
        glb g;

        memcpy(desc.up, ups[i], sizeof desc.up);
        desc.overwrite = true;
        assert_ok(cln_export(&desc, &result));
        vertices = (size_t)result.vertices;
        g = glb_open(desc.file);
        for (size_t k = 0; k < vertices; k++) {
            double v[3];
            uint16_t rgba[4];

            glb_vertex(&g, k, v);
            memcpy(rgba, g.numbers + 24 * vertices + 8 * k, sizeof rgba);
            if (fabs(v[1]) > 0.6) {
                blue[v[1] > 0] += rgba[2] / 65535.0;
                count[v[1] > 0]++;
            }
        }
        for (int side = 0; side < 2; side++)
            blue[side] /= count[side];
        print_message("    blue %.2f below, %.2f above\n", blue[0], blue[1]);
        if (i < 2)
            assert_true(i == 0 ? blue[1] > 1.3 * blue[0] : blue[0] > 1.3 * blue[1]);
        else
            assert_near(blue[0] / blue[1], 1, 0.2);
        glb_close(&g);
        desc.file = fixture_path("up.ply");
        assert_ok(cln_export(&desc, &result));
        if (i == 1)
            continue;
        (*(i ? &turned : &plain)) = read_ply(desc.file, &texts[i != 0], i ? &m : &n);
    }
    assert_int_equal(n, m);
    for (int i = 0; i < n; i++) {
        assert_near(turned[i].at[0], -plain[i].at[2], 1e-6);
        assert_near(turned[i].at[1], plain[i].at[1], 1e-6);
        assert_near(turned[i].at[2], plain[i].at[0], 1e-6);
        assert_near(turned[i].normal[2], plain[i].normal[0], 1e-6);
    }
    free(texts[0]);
    free(texts[1]);
}

/* Everything that is exported is ten times as large; of GLB by the node. */
static void all_lengths_are_scaled(void **state)
{
    const vertex *plain = NULL, *scaled = NULL;
    char *texts[2] = {NULL};
    json_t *about[2] = {NULL};
    float *values[2] = {NULL};
    double first[3], most = 0;
    cln_export_desc desc = export_desc("mesh", "scaled.ply");
    cln_export_result results[2];
    int n = 0, m = 0, shape[4], dims = 0;
    glb g;

    NEED_DEVICE();
    for (int i = 0; i < 2; i++) {
        desc.what = "mesh";
        desc.file = fixture_path(i ? "scaled.ply" : "plain.ply");
        desc.spacing = 0.2;
        desc.triangles = 300;
        desc.scale = i ? 10 : 0;
        if (cln_mesh_reduce_possible() != CLN_OK) {
            desc.triangles = 0;
            cln_clear_error();
        }
        assert_ok(cln_export(&desc, &results[i]));
        (*(i ? &scaled : &plain)) = read_ply(desc.file, &texts[i], i ? &m : &n);
        desc.what = "volume";
        desc.triangles = 0;
        desc.file = fixture_path(i ? "scaled.npy" : "plain.npy");
        assert_ok(cln_export(&desc, &(cln_export_result){0}));
        assert_ok(cln_npy_read_f32(desc.file, &dims, shape, &values[i]));
        about[i] = json_load_file(fixture_path(i ? "scaled.json" : "plain.json"), 0, NULL);
        assert_non_null(about[i]);
    }
    assert_non_null(strstr(texts[1], "; scene units x 10; model "));
    assert_int_equal(n, m);
    for (int i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            assert_near(scaled[i].at[a], 10 * (double)plain[i].at[a], 1e-5);
    for (int a = 0; a < 3; a++) {
        double low = INFINITY, high = -INFINITY;

        for (int i = 0; i < n; i++) {
            low = fmin(low, plain[i].at[a]);
            high = fmax(high, plain[i].at[a]);
        }
        for (int i = 0; i < 2; i++) {
            assert_near(results[i].box[a], low, 1e-6);
            assert_near(results[i].box[3 + a], high, 1e-6);
            assert_near(results[i].size[a], (i ? 10 : 1) * (high - low), 1e-5);
        }
    }
    assert_near(results[1].reduction_error, 10 * results[0].reduction_error, 1e-6);
    for (size_t a = 0; a < 3; a++) {
        first[a] = json_number_value(glb_at(about[1], "first", a));
        assert_near(first[a], 10 * json_number_value(glb_at(about[0], "first", a)), 1e-9);
    }
    assert_near(json_number_value(json_object_get(about[1], "spacing")), 2, 1e-9);
    for (int i = 0; i < 4 * shape[0] * shape[1] * shape[2]; i++) {
        assert_near(values[1][i], (double)values[0][i] * (i % 4 == 3 ? 0.1 : 1), 1e-5);
        most = fmax(most, values[1][i]);
    }
    assert_true(most > 0.1);
    desc.what = "mesh";
    desc.file = fixture_path("scaled.glb");
    desc.up[2] = 1; /* x, y, z to x, z, -y */
    assert_ok(cln_export(&desc, &results[1]));
    g = glb_open(desc.file);
    assert_near(json_number_value(glb_at(glb_at(g.document, "nodes", 0), "scale", 1)), 10, 0);
    most = 0;
    for (int a = 0; a < 3; a++) { /* of the file: y is the scene's z */
        const int from = a == 0 ? 0 : 3 - a;

        assert_near(results[1].size[a], 10 * (results[1].box[3 + from] - results[1].box[from]),
                    1e-6);
    }
    for (int i = 0; i < results[1].vertices; i++) {
        double v[3];

        glb_vertex(&g, (size_t)i, v);
        most = fmax(most, sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
    }
    assert_true(most > 9 && most < 20);
    glb_close(&g);
    for (int i = 0; i < 2; i++) {
        json_decref(about[i]);
        free(texts[i]);
        free(values[i]);
    }
}

static int by_sides(const void *a, const void *b)
{
    return memcmp(a, b, sizeof(uint32_t[2]));
}

/* Sides of triangles of a PLY file that are not in exactly two. */
static int64_t open_sides(const char *path)
{
    uint32_t(*sides)[2] = NULL;
    const char *at = NULL;
    char *text = NULL;
    const vertex *v = NULL;
    int64_t single = 0;
    int vertices = 0, faces = 0, count = 0;

    v = read_ply(path, &text, &vertices);
    assert_int_equal(sscanf(strstr(text, "element face "), "element face %d", &faces), 1);
    sides = calloc(3 * (size_t)faces, sizeof *sides);
    assert_non_null(sides);
    at = (const char *)(v + vertices);
    for (int i = 0; i < faces; i++, at += 1 + sizeof(uint32_t[3])) {
        uint32_t corner[3];

        assert_int_equal(*at, 3);
        memcpy(corner, at + 1, sizeof corner);
        for (int k = 0; k < 3; k++, count++) {
            const uint32_t a = corner[k], b = corner[(k + 1) % 3];

            sides[count][0] = a < b ? a : b;
            sides[count][1] = a < b ? b : a;
        }
    }
    qsort(sides, (size_t)count, sizeof *sides, by_sides);
    for (int i = 0, n; i < count; i += n) {
        for (n = 1; i + n < count && by_sides(sides[i], sides[i + n]) == 0;)
            n++;
        single += n != 2;
    }
    free(sides);
    free(text);
    return single;
}

static void a_coarser_mesh(void **state)
{
    cln_export_desc desc = export_desc("mesh", "coarse.ply");
    cln_export_result fine, coarse;

    NEED_DEVICE();
    desc.spacing = 0.1;
    assert_ok(cln_export(&desc, &fine));
    desc.spacing = 0.2;
    assert_fails(cln_export(&desc, &coarse), CLN_OUTPUT, "--overwrite");
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &coarse));
    print_message("    %lld and %lld triangles\n", (long long)fine.faces, (long long)coarse.faces);
    assert_true(coarse.faces < fine.faces / 2 && coarse.faces > fine.faces / 8);
}

/* The first three training views are in half of the circle about the ball. */
static void closed_keeps_what_no_view_sees(void **state)
{
    const cln_config config = fixture_config();
    const cln_settings settings = {.config = config, .preset = "fast"};
    const cln_train_desc train = {.scene = fixture_path("side"),
                                  .run = fixture_path("half"),
                                  .skip_selftest = true,
                                  .settings = &settings,
                                  .device = fixture_device(),
                                  .command = "test"};
    cln_export_desc desc = export_desc("mesh", "half.ply");
    cln_export_result seen, closed;
    cln_train_result trained;
    json_t *views = NULL, *frames = NULL;
    const char *list = NULL;
    char *text = NULL;
    int64_t open = 0;

    NEED_DEVICE();
    fixture_split(train.scene, "train", TRAIN_VIEWS, 0);
    fixture_split(train.scene, "test", TEST_VIEWS, 0.3);
    list = scratch_path(train.scene, "transforms_train.json");
    views = json_load_file(list, 0, NULL);
    frames = json_object_get(views, "frames");
    while (json_array_size(frames) > TRAIN_VIEWS / 2)
        json_array_remove(frames, json_array_size(frames) - 1);
    text = json_dumps(views, 0);
    scratch_put(list, text, strlen(text));
    free(text);
    json_decref(views);
    assert_ok(cln_train(&train, &trained));
    desc.run = train.run;
    assert_ok(cln_export(&desc, &seen));
    open = open_sides(desc.file);
    desc.closed = true;
    desc.file = fixture_path("closed.ply");
    assert_ok(cln_export(&desc, &closed));
    print_message("    %lld triangles and %lld open sides, %lld and %lld closed\n",
                  (long long)seen.faces, (long long)open, (long long)closed.faces,
                  (long long)open_sides(desc.file));
    assert_true(closed.faces > seen.faces);
    assert_true(open > 0);
    assert_int_equal(open_sides(desc.file), 0);
}

/* meshopt_simplify of this program ends at this number of indices, as the library's does where
 * fewer would tear the surface. */
static size_t least_indices;

size_t meshopt_simplify(unsigned *to, const unsigned *from, size_t indices, const float *at,
                        size_t vertices, size_t stride, size_t target, float error,
                        unsigned options, float *found);

size_t meshopt_simplify(unsigned *to, const unsigned *from, size_t indices, const float *at,
                        size_t vertices, size_t stride, size_t target, float error,
                        unsigned options, float *found)
{
    size_t (*real)(unsigned *, const unsigned *, size_t, const float *, size_t, size_t, size_t,
                   float, unsigned, float *) = NULL;

    *(void **)&real = dlsym(RTLD_NEXT, "meshopt_simplify");
    assert_non_null(real);
    if (target < least_indices)
        target = least_indices;
    return real(to, from, indices, at, vertices, stride, target, error, options, found);
}

static void a_mesh_of_fewer_triangles(void **state)
{
    char warning[256] = "", expected[64];
    cln_export_desc desc = export_desc("mesh", "few.glb");
    cln_export_result all, few;

    NEED_DEVICE();
    if (cln_mesh_reduce_possible() != CLN_OK) {
        cln_clear_error();
        skip();
    }
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &all));
    assert_true(all.faces_before == 0 && all.reduction_error == 0);
    desc.triangles = all.faces / 4;
    assert_ok(cln_export(&desc, &few));
    assert_int_equal(few.faces_before, all.faces);
    assert_in_range(few.faces, 10, desc.triangles);
    assert_true(few.vertices < all.vertices / 2);
    assert_true(few.reduction_error > 0 && few.reduction_error < 0.5);
    cln_log_set_sink(keep_warning, warning);
    desc.triangles = 20;
    assert_ok(cln_export(&desc, &few));
    assert_in_range(few.faces, 1, 20);
    assert_string_equal(warning, "");
    least_indices = 3 * 40;
    assert_ok(cln_export(&desc, &few));
    least_indices = 0;
    assert_in_range(few.faces, 21, 40);
    snprintf(expected, sizeof expected, "--triangles 20: %lld are left", (long long)few.faces);
    assert_non_null(strstr(warning, expected));
    cln_log_set_sink(fixture_no_log, NULL);
    desc.triangles = all.faces;
    assert_ok(cln_export(&desc, &few));
    assert_true(few.faces_before == 0 && few.faces == all.faces);
    desc.what = "points";
    desc.file = fixture_path("few.ply");
    assert_fails(cln_export(&desc, &few), CLN_USAGE, "--triangles");
}

static void volumes_are_the_field(void **state)
{
    cln_export_desc desc = export_desc("volume", "volume.npy");
    const cln_device_desc device = fixture_device();
    cln_export_result result;
    cln_field *field = NULL;
    json_t *about = NULL;
    float *values = NULL, sigma = 0;
    int dims = 0, shape[4];
    double spacing = 0, densest = 0;

    NEED_DEVICE();
    desc.spacing = 0.17;
    assert_ok(cln_export(&desc, &result));
    assert_ok(cln_npy_read_f32(desc.file, &dims, shape, &values));
    about = fixture_json("volume.json");
    assert_int_equal(dims, 4);
    assert_int_equal(shape[3], 4);
    assert_memory_equal(shape, result.shape, sizeof result.shape);
    spacing = json_number_value(fixture_at(about, "spacing"));
    assert_near(spacing, 0.17, 1e-12);
    assert_ok(cln_field_open(desc.run, &device, &field));
    for (int i = 0; i < shape[0] * shape[1] * shape[2]; i += 37) {
        const int cell[3] = {i % shape[2], i / shape[2] % shape[1], i / shape[2] / shape[1]};
        double at[1][3], mean[3] = {0};

        for (int a = 0; a < 3; a++)
            at[0][a] = json_number_value(json_array_get(fixture_at(about, "first"), (size_t)a)) +
                       cell[a] * spacing;
        for (int look = 0; look < 6; look++) {
            float towards[1][3] = {{0}}, rgb[1][3];

            towards[0][look / 2] = look % 2 ? 1 : -1;
            assert_ok(cln_field_at(field, 1, (const double(*)[3])at, (const float(*)[3])towards,
                                   rgb, &sigma));
            for (int c = 0; c < 3; c++)
                mean[c] += rgb[0][c] / 6.0;
        }
        assert_near(values[4 * i + 3], sigma, 1e-3 * (1 + sigma));
        for (int c = 0; c < 3 && sigma * spacing > 1e-3; c++)
            assert_near(values[4 * i + c], mean[c], 2e-3);
        densest = fmax(densest, sigma);
    }
    assert_true(densest > 1);
    cln_field_close(field);
    json_decref(about);
    free(values);
}

/* All with x above 0.1: a box, and one that is turned by a right angle. */
static const double crops[2][9] = {{0.1, -3, -3, 3, 3, 3}, {-2.4, -1.5, -3, 5.6, 1.5, 3, 0, 0, 90}};

static void set_crop(cln_export_desc *desc, const double box[9])
{
    desc->cropped = true;
    memcpy(desc->crop, box, sizeof desc->crop);
    memcpy(desc->crop_turn, box + 6, sizeof desc->crop_turn);
}

static void crops_are_parts(void **state)
{
    cln_export_desc desc = export_desc("mesh", "part.ply");
    cln_export_result whole, part, closed, points;

    NEED_DEVICE();
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &whole));
    for (int i = 0; i < 2; i++) {
        static const char *const files[] = {"part.ply", "part-closed.ply", "part-points.ply"};
        cln_export_result *const results[] = {&part, &closed, &points};

        set_crop(&desc, crops[i]);
        for (int k = 0; k < 3; k++) {
            const vertex *v = NULL;
            char *text = NULL;
            int n = 0;

            desc.what = k == 2 ? "points" : "mesh";
            desc.count = k == 2 ? 500 : 0;
            desc.closed = k == 1;
            desc.file = fixture_path(files[k]);
            assert_ok(cln_export(&desc, results[k]));
            v = read_ply(desc.file, &text, &n);
            assert_int_equal(n, results[k]->vertices);
            for (int j = 0; j < n; j++)
                assert_true(v[j].at[0] > 0.1 - 1e-5);
            free(text);
        }
        assert_in_range(part.faces, whole.faces / 8, whole.faces * 5 / 8);
        assert_int_equal(points.vertices, 500);
        assert_true(open_sides(fixture_path(files[0])) > 0);
        assert_int_equal(open_sides(fixture_path(files[1])), 0);
    }
}

/* A cropped volume has the whole one's cubes, those with their middles in the box; of a turned box
 * the others within what it spans are 0. */
static void a_cropped_volume_is_a_part(void **state)
{
    const double box[2][9] = {{0.13, -3, -3, 3, 3, 3}, {-0.5, -0.4, -0.6, 0.7, 0.5, 0.4, 0, 0, 30}};
    cln_export_desc desc = export_desc("volume", "all.npy");
    const double degree = 3.14159265358979 / 180;
    json_t *about[3];
    float *values[3];
    int dims = 0, shape[3][4];

    NEED_DEVICE();
    desc.spacing = 0.1;
    for (int i = 0; i < 3; i++) {
        static const char *const files[] = {"all.npy", "box.npy", "turned.npy"};
        char name[32];
        cln_export_result result;
        int seen = 0, out = 0;

        desc.file = fixture_path(files[i]);
        if (i > 0)
            set_crop(&desc, box[i - 1]);
        assert_ok(cln_export(&desc, &result));
        assert_ok(cln_npy_read_f32(desc.file, &dims, shape[i], &values[i]));
        snprintf(name, sizeof name, "%.*s.json", (int)strcspn(files[i], "."), files[i]);
        about[i] = fixture_json(name);
        for (int k = 0; k < shape[i][0] * shape[i][1] * shape[i][2]; k++) {
            const int cell[3] = {k % shape[i][2], k / shape[i][2] % shape[i][1],
                                 k / shape[i][2] / shape[i][1]};
            double at[3], in_box[3];
            int there[3];
            bool inside = true;
            const float *mine = values[i] + 4 * k, *theirs = NULL;

            for (int a = 0; a < 3; a++) {
                const double first =
                    json_number_value(json_array_get(fixture_at(about[0], "first"), (size_t)a));

                at[a] =
                    json_number_value(json_array_get(fixture_at(about[i], "first"), (size_t)a)) +
                    0.1 * cell[a];
                there[a] = (int)lround((at[a] - first) / 0.1);
                assert_near(first + 0.1 * there[a], at[a], 1e-9);
                assert_in_range(there[a], 0, shape[0][2 - a] - 1);
                assert_true(i != 1 || cell[a] > 0 || at[a] - 0.1 < fmax(desc.crop[a], first));
            }
            memcpy(in_box, at, sizeof at);
            if (i == 2) { /* turned back about the middle */
                const double x = at[0] - 0.1, y = at[1] - 0.05;

                in_box[0] = 0.1 + cos(30 * degree) * x + sin(30 * degree) * y;
                in_box[1] = 0.05 - sin(30 * degree) * x + cos(30 * degree) * y;
            }
            for (int a = 0; a < 3 && i > 0; a++)
                inside = inside && in_box[a] > desc.crop[a] - 1e-5 &&
                         in_box[a] < desc.crop[3 + a] + 1e-5;
            theirs = values[0] + 4 * ((there[2] * shape[0][1] + there[1]) * shape[0][2] + there[0]);
            for (int c = 0; c < 4; c++)
                assert_true(mine[c] == (inside ? theirs[c] : 0));
            seen += inside && mine[3] > 0;
            out += !inside;
        }
        print_message("    %d x %d x %d, %d cubes seen, %d not in the box\n", shape[i][2],
                      shape[i][1], shape[i][0], seen, out);
        assert_true(seen > 100);
        assert_true((out > 0) == (i == 2));
        assert_true(i == 0 || shape[i][2] < shape[0][2]);
    }
    for (int i = 0; i < 3; i++) {
        json_decref(about[i]);
        free(values[i]);
    }
}

static void crops_of_nothing_are_refused(void **state)
{
    static const struct {
        const char *what, *file;
        double box[9], spacing;
        cln_status st;
        const char *words;
    } rows[] = {
        {"mesh", "x.ply", {9, 9, 9, 10, 10, 10}, 0, CLN_USAGE, "the scene's cube is -"},
        {"volume", "x.npy", {9, 9, 9, 10, 10, 10}, 0, CLN_USAGE, "no leaf of the run reaches"},
        {"points", "x.ply", {1, 1, 1, 0, 2, 2}, 0, CLN_USAGE, "--crop: the minimum 1 is not below"},
        {"mesh",
         "x.ply",
         {-0.1, -0.1, -0.1, 0.1, 0.1, 0.1},
         0,
         CLN_INPUT,
         "larger one; the scene's cube is -"},
        {"volume", "x.npy", {0.01, -1, -1, 0.02, 1, 1}, 0.1, CLN_USAGE, "--crop: no cube of the"},
        {"octree", "x.ply", {-1, -1, -1, 1, 1, 1}, 0, CLN_USAGE, "--crop: has no effect"}};

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        cln_export_desc desc = export_desc(rows[i].what, rows[i].file);
        cln_export_result result;

        set_crop(&desc, rows[i].box);
        desc.spacing = rows[i].spacing;
        assert_fails(cln_export(&desc, &result), rows[i].st, rows[i].words);
        assert_false(cln_is_file(desc.file));
    }
}

static void a_crop_that_holds_all_is_told(void **state)
{
    cln_export_desc desc = export_desc("mesh", "all.ply");
    cln_export_result result;
    char warning[256] = "";

    NEED_DEVICE();
    desc.spacing = 0.2;
    set_crop(&desc, (const double[9]){-500, -500, -500, 500, 500, 500});
    cln_log_set_sink(keep_warning, warning);
    assert_ok(cln_export(&desc, &result));
    assert_non_null(strstr(warning, "--crop: this box cuts nothing off"));
    assert_non_null(strstr(warning, "cube, -"));
    warning[0] = 0;
    desc.crop[0] = -0.5;
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &result));
    assert_string_equal(warning, "");
    assert_near(result.box[0], -0.5, 1e-6);
    cln_log_set_sink(fixture_no_log, NULL);
}

static void keep_loose(cln_log_level level, const char *line, void *user)
{
    (void)level;
    if (strstr(line, " loose piece"))
        snprintf(user, 256, "%s", line);
}

/* Of the triangles in an STL file: their area, and the volume that they enclose. */
static void measure_stl(const char *path, int64_t faces, double *area, double *volume)
{
    char *bytes = NULL;
    size_t size = 0;

    *area = *volume = 0;
    assert_ok(cln_read_file(path, 1 << 26, &bytes, &size));
    assert_int_equal(size, 84 + 50 * faces);
    for (int64_t f = 0; f < faces; f++) {
        float v[4][3]; /* normal, corners */
        double side[2][3], square = 0;

        memcpy(v, bytes + 84 + 50 * f, sizeof v);
        for (int k = 0; k < 2; k++)
            for (int a = 0; a < 3; a++)
                side[k][a] = (double)v[2 + k][a] - v[1][a];
        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, c = (a + 2) % 3;
            const double n = side[0][b] * side[1][c] - side[0][c] * side[1][b];

            square += n * n;
            *volume += v[1][a] * n / 6;
        }
        *area += sqrt(square) / 2;
    }
    free(bytes);
}

static void area_and_volume(void **state)
{
    cln_export_desc desc = export_desc("mesh", "measured.stl");
    cln_export_result open, closed;
    double area = 0, volume = 0;

    NEED_DEVICE();
    desc.overwrite = true;
    desc.spacing = 0.1;
    cln_log_set_sink(keep_warning, (char[256]){0});
    cut[0] = 0;
    desc.scale = 3;
    set_crop(&desc, (const double[9]){-500, -500, -500, 0.05, 500, 500});
    assert_ok(cln_export(&desc, &open)); /* along the box's face */
    assert_non_null(strstr(cut, ": it ends at the faces of the cube (half side 1.5)"));
    cln_log_set_sink(fixture_no_log, NULL);
    measure_stl(desc.file, open.faces, &area, &volume);
    assert_near(open.area, area, 1e-4 * area);
    assert_true(open.open_edges > 4 && open.volume == 0);
    desc.closed = true;
    assert_ok(cln_export(&desc, &closed));
    measure_stl(desc.file, closed.faces, &area, &volume);
    assert_near(closed.area, area, 1e-4 * area);
    assert_near(closed.volume, volume, 1e-4 * volume);
    assert_true(closed.open_edges == 0 && closed.area > open.area);
    assert_in_range(1000 * volume, 1, 1000 * closed.size[0] * closed.size[1] * closed.size[2]);
    desc.file = fixture_path("measured.glb"); /* scaled by its node */
    assert_ok(cln_export(&desc, &open));
    assert_near(open.volume, closed.volume, 1e-9 * volume);
    assert_near(open.area, closed.area, 1e-9 * area);
}

/* The counts of a mesh in parts add up, and points are of the same part. All parts are told of
 * where they stay. */
static void the_largest_part(void **state)
{
    cln_export_desc desc = export_desc("mesh", "largest.ply");
    cln_export_result all, one, points;
    char loose[256] = "", words[96];

    NEED_DEVICE();
    desc.overwrite = true;
    cln_log_set_sink(keep_loose, loose);
    assert_ok(cln_export(&desc, &all));
    assert_true(all.parts == 0 && all.faces_left_out == 0);
    desc.largest = true;
    assert_ok(cln_export(&desc, &one));
    print_message("    %lld triangles, %lld of the largest of %lld parts\n", (long long)all.faces,
                  (long long)one.faces, (long long)one.parts);
    assert_true(one.parts >= 1 && (one.parts == 1) == (one.faces_left_out == 0));
    assert_int_equal(one.faces + one.faces_left_out, all.faces);
    assert_true(one.faces > all.faces / (one.parts + 1));
    cln_log_set_sink(fixture_no_log, NULL);
    assert_true(one.parts > 1 && one.faces_left_out > 0);
    snprintf(words, sizeof words, " %lld loose piece%s beside the largest, with %lld of its %lld ",
             (long long)one.parts - 1, one.parts == 2 ? "" : "s", (long long)one.faces_left_out,
             (long long)all.faces);
    assert_non_null(strstr(loose, words));
    assert_non_null(strstr(loose, "--largest leaves "));
    desc.what = "points";
    desc.count = 100;
    desc.file = fixture_path("largest-points.ply");
    assert_ok(cln_export(&desc, &points));
    assert_true(points.parts == one.parts && points.faces_left_out == one.faces_left_out);
    desc = export_desc("volume", "x.npy");
    desc.largest = true;
    assert_fails(cln_export(&desc, &all), CLN_USAGE, "--largest: has no effect on --volume");
}

/* Is "images/train/r_0.png" the view "train/r_0"? */
static bool same_name(const char *is, const char *was)
{
    is += strncmp(is, "images/", 7) == 0 ? 7 : 0;
    return strncmp(is, was, strlen(was)) == 0 &&
           (is[strlen(was)] == 0 || strcmp(is + strlen(was), ".png") == 0);
}

/* The file has every view of the scene, with the same camera, and in the same split if it has
 * splits. */
static void assert_same_cameras(const char *path, bool has_splits, double scale)
{
    const cln_config config = fixture_config();
    cln_scene_desc desc = {.path = fixture_path("scene"), .config = &config};
    cln_scene *was = NULL, *is = NULL;

    assert_ok(cln_scene_load(&desc, &was));
    desc.path = path;
    assert_ok(cln_scene_load(&desc, &is));
    assert_int_equal(is->view_count, was->view_count);
    for (int i = 0; i < was->view_count; i++) {
        const cln_view *a = &was->views[i], *b = NULL;

        for (int k = 0; k < is->view_count; k++)
            if (same_name(is->views[k].name, a->name) &&
                (!has_splits || is->views[k].split == a->split))
                b = &is->views[k];
        if (!b)
            fail_msg("%s: no %s, but %s", path, a->name, is->views[0].name);
        assert_true(cln_camera_is_like(&a->camera, &b->camera));
        for (int m = 0; m < 12; m++)
            assert_near(b->camera.c2w[m], a->camera.c2w[m] * (m % 4 == 3 ? scale : 1), 1e-12);
    }
    cln_scene_free(was);
    cln_scene_free(is);
}

static void cameras_come_back(void **state)
{
    cln_export_desc desc = export_desc("cameras", "scene/cameras.json");
    cln_export_result result;
    char *text = NULL;
    size_t bytes = 0;

    NEED_DEVICE();
    desc.device.spec = "no such device"; /* needs none */
    assert_ok(cln_export(&desc, &result));
    assert_int_equal(result.views, TRAIN_VIEWS + TEST_VIEWS);
    assert_same_cameras(desc.file, true, 1);
    text = scratch_get(desc.file, &bytes); /* one camera, before the frames */
    assert_true(strstr(text, "camera_model") < strstr(text, "frames"));
    assert_null(strstr(strstr(text, "frames"), "fl_x"));
    assert_non_null(strstr(text, "val_filenames")); /* as nerfstudio asks for it */
    free(text);
    assert_ok(cln_make_dirs(fixture_path("colmap")));
    assert_int_equal(symlink(fixture_path("scene"), fixture_path("colmap/images")), 0);
    desc.file = fixture_path("colmap/sparse/0");
    assert_ok(cln_export(&desc, &result));
    assert_fails(cln_export(&desc, &result), CLN_OUTPUT, "cameras.txt");
    assert_same_cameras(fixture_path("colmap"), false, 1);
    desc.scale = 3;
    desc.overwrite = true;
    assert_ok(cln_export(&desc, &result));
    assert_same_cameras(fixture_path("colmap"), false, 3);
    desc.file = fixture_path("scene/cameras.json");
    assert_ok(cln_export(&desc, &result));
    assert_same_cameras(desc.file, true, 3);
}

static void assert_same_files(const char *a, const char *b)
{
    size_t a_bytes = 0, b_bytes = 0;
    char *a_text = scratch_get(fixture_path(a), &a_bytes);
    char *b_text = scratch_get(fixture_path(b), &b_bytes);

    assert_int_equal(a_bytes, b_bytes);
    assert_memory_equal(a_text, b_text, a_bytes);
    free(a_text);
    free(b_text);
}

/* Kernels get constants as text: a mesh shows that they are right, too. */
static void other_locales_change_no_file(void **state)
{
    static const char *const what[] = {"mesh", "cameras"};
    static const char *const files[2][2] = {{"point.obj", "comma.obj"}, {"point", "comma"}};
    cln_status st[2][2];

    NEED_DEVICE();
    for (int comma = 0; comma < 2; comma++) {
        if (comma)
            comma_locale_begin();
        for (int i = 0; i < 2; i++) {
            const cln_export_desc desc = export_desc(what[i], files[i][comma]);
            cln_export_result result;

            st[i][comma] = cln_export(&desc, &result);
        }
    }
    comma_locale_end();
    for (int i = 0; i < 4; i++)
        assert_ok(st[i / 2][i % 2]);
    assert_same_files("point.obj", "comma.obj");
    assert_same_files("point/cameras.txt", "comma/cameras.txt");
    assert_same_files("point/images.txt", "comma/images.txt");
}

static void mistakes_are_named(void **state)
{
    cln_export_desc desc = export_desc("mesh", "x.xyz");
    cln_export_result result;

    NEED_DEVICE();
    assert_fails(cln_export(&desc, &result), CLN_USAGE, ".ply|.obj|.glb|.stl");
    desc = export_desc("mesh", "x.FBX");
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "Unreal read .glb");
    desc = export_desc("points", "x.fbx");
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "end the name with .ply");
    desc = export_desc("mesh", "x.obj");
    desc.spacing = 1e-5;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "or more");
    desc = export_desc("volume", "x.npy");
    desc.spacing = 1e-5;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "or more");
    desc.spacing = 0.5;
    desc.overwrite = true;
    assert_ok(cln_make_dirs(fixture_path("x.json"))); /* no volume without what tells of it */
    assert_fails(cln_export(&desc, &result), CLN_OUTPUT, "x.json");
    desc = export_desc("points", "x.ply");
    desc.spacing = 1e-5;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "larger --spacing");
    desc.count = 10;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "each sets the number of points");
    desc = export_desc("octree", "x.ply");
    desc.spacing = 1;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "no effect on --octree");
    desc = export_desc("octree", "x.ply");
    desc.scale = -1;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "scale");
    desc = export_desc("octree", "x.ply");
    desc.up[0] = 1;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "--up: has no effect on --octree");
    desc = export_desc("mesh", "x.ply");
    desc.up[0] = 1e-12;
    assert_fails(cln_export(&desc, &result), CLN_USAGE, "up is too short");
    desc = export_desc("mesh", "x.ply");
    desc.scene = fixture_path("nowhere");
    assert_fails(cln_export(&desc, &result), CLN_INPUT, "nowhere");
    assert_false(cln_is_file(fixture_path("x.ply")) || cln_is_file(fixture_path("x.obj")) ||
                 cln_is_file(fixture_path("x.npy")));
}

static void a_signal_leaves_no_file(void **state)
{
    fixture_stop stops[] = {{.signal = SIGINT, .pictures = 3},
                            {.signal = SIGINT, .photos = 1, .photos_seen = 1}}; /* at once */
    cln_export_desc descs[] = {export_desc("mesh", "stopped.ply"), export_desc("copy", "stopped")};
    cln_export_result result;

    NEED_DEVICE();
    for (int i = 0; i < 2; i++) {
        descs[i].callbacks = fixture_callbacks(&stops[i]);
        assert_fails(cln_export(&descs[i], &result), CLN_SIGINT, "signal");
        assert_int_equal(access(descs[i].file, F_OK), -1);
    }
}

int test_group_exports(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(points_are_on_the_ball),
        cmocka_unit_test(normals_of_points_are_between),
        cmocka_unit_test(formats_of_a_mesh_agree),
        cmocka_unit_test(a_mesh_stands_upright),
        cmocka_unit_test(all_lengths_are_scaled),
        cmocka_unit_test(a_coarser_mesh),
        cmocka_unit_test(closed_keeps_what_no_view_sees),
        cmocka_unit_test(a_mesh_of_fewer_triangles),
        cmocka_unit_test(volumes_are_the_field),
        cmocka_unit_test(crops_are_parts),
        cmocka_unit_test(area_and_volume),
        cmocka_unit_test(the_largest_part),
        cmocka_unit_test(a_cropped_volume_is_a_part),
        cmocka_unit_test(crops_of_nothing_are_refused),
        cmocka_unit_test(a_crop_that_holds_all_is_told),
        cmocka_unit_test(cameras_come_back),
        cmocka_unit_test(other_locales_change_no_file),
        cmocka_unit_test(mistakes_are_named),
        cmocka_unit_test(a_signal_leaves_no_file),
    };

    return cmocka_run_group_tests_name("exports", tests, fixture_setup, fixture_teardown);
}
