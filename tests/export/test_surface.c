/* The surface that exports write, without training: marching cubes of functions whose surface is
 * known (closed, oriented, in its place), and exact depths of generated shapes, fused and traced,
 * against these shapes: distances both ways, normals, what is hidden. */
#include "unit.h"
#include <stdio.h>
#include <string.h>
#include "base/rng.h"
#include "export/marching.h"
#include "export/surface.h"
#include "model/octree.h"
#include "check/forward_scene.h"
#include "near.h"
#include "sanitized.h"
#include "tests.h"
#include "truth.h"

/* ---- marching cubes ---- */

static const double ball = 0.61;

static cln_status ask_ball(void *user, size_t n, const float (*at)[4], float *values)
{
    size_t *asked = user;

    assert_in_range(n, 1, 65536);
    *asked += n;
    for (size_t i = 0; i < n; i++)
        values[i] = (float)(ball - sqrt((double)at[i][0] * at[i][0] + at[i][1] * at[i][1] +
                                        at[i][2] * at[i][2]));
    return CLN_OK;
}

/* Another sign in every cell of 1/7: all the cases, and all pairs of neighbouring ones. */
static cln_status ask_noise(void *user, size_t n, const float (*at)[4], float *values)
{
    const uint32_t *seed = user;

    for (size_t i = 0; i < n; i++) {
        uint32_t hash = *seed;

        for (int a = 0; a < 3; a++)
            hash = cln_hash(hash ^ (uint32_t)(int)floor(7 * (double)at[i][a] + 100.5));
        values[i] = (hash >> 8 & 3) == 0 ? 0.5f : -0.5f;
        if (*seed % 2)
            values[i] = -values[i];
    }
    return CLN_OK;
}

static int by_edge(const void *a, const void *b)
{
    const uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

    return x < y ? -1 : x > y;
}

/* Each side of a triangle has exactly one opposite in another triangle: no crack, no side of more
 * than two. */
static void assert_closed(const cln_surface *s)
{
    const size_t n = 3 * s->faces;
    uint64_t *edges = malloc(2 * n * sizeof *edges), *back = edges + n;

    assert_non_null(edges);
    for (size_t f = 0; f < s->faces; f++)
        for (int k = 0; k < 3; k++) {
            const uint64_t a = s->face[f][k], b = s->face[f][(k + 1) % 3];

            assert_true(a < s->vertices && b < s->vertices && a != b);
            edges[3 * f + (size_t)k] = a << 32 | b;
            back[3 * f + (size_t)k] = b << 32 | a;
        }
    qsort(edges, n, sizeof *edges, by_edge);
    qsort(back, n, sizeof *back, by_edge);
    for (size_t i = 0; i < n; i++) {
        if (edges[i] != back[i])
            fail_msg("side %zu of %zu has no other triangle", i, n);
        if (i > 0 && edges[i] == edges[i - 1])
            fail_msg("side %zu of %zu is in two triangles of one direction", i, n);
    }
    free(edges);
}

static double volume_of(const cln_surface *s)
{
    double sum = 0;

    for (size_t f = 0; f < s->faces; f++) {
        const float *a = s->at[s->face[f][0]], *b = s->at[s->face[f][1]], *c = s->at[s->face[f][2]];

        for (int k = 0; k < 3; k++)
            sum += (double)a[k] * ((double)b[(k + 1) % 3] * c[(k + 2) % 3] -
                                   (double)b[(k + 2) % 3] * c[(k + 1) % 3]);
    }
    return sum / 6;
}

static void a_ball_is_a_ball(void **state)
{
    size_t asked = 0;
    const cln_marching marching = {.cells = 20, .ask = ask_ball, .user = &asked};
    cln_surface s = {0};

    (void)state;
    assert_int_equal(cln_marching_run(&marching, &s), CLN_OK);
    assert_in_range(s.vertices, 500, 2000);
    assert_closed(&s);
    for (size_t i = 0; i < s.vertices; i++) {
        const float *p = s.at[i];

        assert_near(sqrt((double)p[0] * p[0] + p[1] * p[1] + p[2] * p[2]), ball, 1e-5);
    }
    /* outwards; triangles cut off what bends, about (cell / r)^2 / 2 */
    assert_near(volume_of(&s) / (4 * 3.14159265 / 3 * ball * ball * ball), 1, 0.02);
    assert_int_equal(s.vertices + s.faces, 3 * s.faces / 2 + 2); /* Euler's 2: one ball */
    cln_surface_free(&s);
}

static void whatever_the_signs_there_is_no_crack(void **state)
{
    (void)state;
    for (uint32_t seed = 0; seed < 4; seed++) {
        const cln_marching marching = {.cells = 14, .ask = ask_noise, .user = &seed};
        cln_surface s = {0};

        assert_int_equal(cln_marching_run(&marching, &s), CLN_OK);
        assert_true(s.faces > 1000);
        assert_closed(&s);
        cln_surface_free(&s);
    }
}

/* Levels at random, of all blocks of a grid; the caller frees them. A block is lowered by those
 * around it, so the lowest are rare. */
static uint8_t *random_levels(int cells, uint32_t seed)
{
    const size_t n = (size_t)cln_marching_blocks(cells);
    uint8_t *levels = malloc(n * n * n);

    assert_non_null(levels);
    for (size_t i = 0; i < n * n * n; i++) {
        const uint32_t h = cln_hash(seed ^ cln_hash((uint32_t)i));

        levels[i] = (uint8_t)(h % 40 == 0 ? 0 : 1 + h / 40 % (CLN_MARCHING_LEVELS + 1));
    }
    return levels;
}

/* The levels, as lowered, have all widths. */
static void assert_all_widths(const uint8_t *levels, int cells)
{
    const size_t n = (size_t)cln_marching_blocks(cells);
    size_t count[CLN_MARCHING_LEVELS + 1] = {0};

    for (size_t i = 0; i < n * n * n; i++)
        count[levels[i]]++;
    for (int level = 0; level <= CLN_MARCHING_LEVELS; level++)
        assert_true(count[level] > n * n * n / 50);
}

/* The same where cells of all widths meet; grids that end in the middle of a block, too. */
static void nor_between_wide_and_narrow_cells(void **state)
{
    static const int cells[] = {64, 75, 80, 41};

    (void)state;
    for (uint32_t seed = 0; seed < 8; seed++) {
        uint8_t *levels = random_levels(cells[seed % 4], seed);
        cln_marching marching = {.cells = cells[seed % 4], .ask = ask_noise, .user = &seed};
        cln_surface even = {0}, s = {0};

        assert_int_equal(cln_marching_run(&marching, &even), CLN_OK);
        marching.levels = levels;
        assert_int_equal(cln_marching_run(&marching, &s), CLN_OK);
        assert_true(s.faces > 1000);
        assert_true(s.faces < even.faces * 9 / 10);
        assert_all_widths(levels, cells[seed % 4]);
        assert_closed(&s);
        cln_surface_free(&even);
        cln_surface_free(&s);
        free(levels);
    }
}

/* A ball whose lower half has cells that are up to four times as wide: closed, round, one ball;
 * where nothing wide is near, the triangles of the even grid. */
static void a_ball_with_wide_cells(void **state)
{
    enum { CELLS = 96, BLOCKS = CELLS / CLN_MARCHING_BLOCK };
    size_t asked = 0, above[2] = {0};
    uint8_t levels[BLOCKS * BLOCKS * BLOCKS] = {0};
    cln_marching marching = {.cells = CELLS, .ask = ask_ball, .user = &asked};
    cln_surface s[2] = {{0}};
    double worst = 0;

    (void)state;
    assert_int_equal(cln_marching_run(&marching, &s[0]), CLN_OK);
    memset(levels, CLN_MARCHING_LEVELS, sizeof levels / 2);
    marching.levels = levels;
    assert_int_equal(cln_marching_run(&marching, &s[1]), CLN_OK);
    for (int k = 0; k < 2; k++)
        for (size_t f = 0; f < s[k].faces; f++)
            above[k] += s[k].at[s[k].face[f][0]][2] > 0;
    for (size_t i = 0; i < s[1].vertices; i++) {
        const float *p = s[1].at[i];
        const double off = sqrt((double)p[0] * p[0] + p[1] * p[1] + p[2] * p[2]) - ball;

        worst = fmax(worst, fabs(off));
    }
    print_message("    %zu and %zu triangles, above %zu and %zu; at most %.6f off, volume %.4f\n",
                  s[0].faces, s[1].faces, above[0], above[1], worst,
                  volume_of(&s[1]) / (4 * 3.14159265 / 3 * ball * ball * ball));
    assert_closed(&s[1]);
    assert_int_equal(s[1].vertices + s[1].faces, 3 * s[1].faces / 2 + 2);
    assert_int_equal(above[0], above[1]);
    assert_true(s[1].faces < s[0].faces * 2 / 3);
    assert_true(worst < 1e-3);
    assert_near(volume_of(&s[1]) / (4 * 3.14159265 / 3 * ball * ball * ball), 1, 0.02);
    cln_surface_free(&s[0]);
    cln_surface_free(&s[1]);
}

static void cases_cut_what_they_must(void **state)
{
    static cln_marching_case cases[256];
    int triangles = 0;

    (void)state;
    cln_marching_cases(cases);
    assert_int_equal(cases[0].count + cases[255].count, 0);
    for (int inside = 0; inside < 256; inside++) {
        bool used[12] = {false};

        for (int t = 0; t < cases[inside].count; t++)
            for (int k = 0; k < 3; k++)
                used[cases[inside].edge[t][k]] = true;
        for (int e = 0; e < 12; e++) {
            const int axis = e / 4, low = axis == 0 ? 1 : 0, high = axis == 2 ? 1 : 2;
            const int from = (e & 1) << low | (e >> 1 & 1) << high;
            const bool cut = (inside >> from & 1) != (inside >> (from | 1 << axis) & 1);

            assert_int_equal(used[e], cut);
        }
        triangles += cases[inside].count;
    }
    assert_int_equal(cases[1].count, 1);
    assert_int_equal(cases[15].count, 2);
    assert_in_range(triangles, 700, 900);
}

static void too_many_vertices_are_refused(void **state)
{
    size_t asked = 0;
    const cln_marching marching = {.cells = 20, .ask = ask_ball, .user = &asked};
    cln_surface s = {.most = 100};

    (void)state;
    assert_int_equal(cln_marching_run(&marching, &s), CLN_MEMORY);
    assert_non_null(strstr(cln_error_text(), "the 100 that have room in half of this machine's"));
    assert_non_null(strstr(cln_error_text(), "--spacing"));
    cln_clear_error();
    cln_surface_free(&s);
    for (int i = 0; i < 2; i++) { /* an index of 32 bits ends the growth before memory does */
        const cln_surface full = {.vertices = UINT32_MAX, .most = i ? UINT32_MAX : 0};

        s = full;
        assert_int_equal(cln_surface_grow_vertices(&s), CLN_OUTPUT);
        assert_non_null(strstr(cln_error_text(), "the 4294967295 that a mesh can number"));
        assert_null(strstr(cln_error_text(), "memory"));
        cln_clear_error();
    }
}

static void what_is_not_kept_goes(void **state)
{
    size_t asked = 0;
    const cln_marching marching = {.cells = 10, .ask = ask_ball, .user = &asked};
    cln_surface s = {0};
    uint8_t *keep = NULL;
    size_t before = 0;

    (void)state;
    assert_int_equal(cln_marching_run(&marching, &s), CLN_OK);
    before = s.vertices;
    keep = calloc(s.vertices, 1);
    s.normal = calloc(s.vertices, sizeof *s.normal);
    s.towards = calloc(s.vertices, sizeof *s.towards);
    s.views = calloc(s.vertices, sizeof *s.views);
    for (size_t i = 0; i < s.vertices; i++) {
        keep[i] = s.at[i][2] > 0;
        s.normal[i][0] = s.at[i][0];
        s.towards[i][1] = s.at[i][1];
        s.views[i] = keep[i];
    }
    assert_int_equal(cln_surface_keep(&s, keep), CLN_OK);
    assert_in_range(s.vertices, before / 2, before * 2 / 3);
    for (size_t i = 0; i < s.vertices; i++) {
        assert_true(s.at[i][2] > -0.3f);
        assert_true(s.normal[i][0] == s.at[i][0] && s.towards[i][1] == s.at[i][1]);
        assert_int_equal(s.views[i], s.at[i][2] > 0);
    }
    for (size_t f = 0; f < s.faces; f++)
        assert_true(s.at[s.face[f][0]][2] > 0 || s.at[s.face[f][1]][2] > 0 ||
                    s.at[s.face[f][2]][2] > 0);
    free(keep);
    cln_surface_free(&s);
}

/* ---- generated shapes ---- */

enum { VIEWS = 30, WIDTH = 100 };

/* A ball on a block, with a ring, and a small ball inside the block that nothing sees. */
static void make_shapes(shapes *scene)
{
    static world w;
    builder b = {.world = &w};

    memset(&w, 0, sizeof w);
    add_box(&b, 0, vec3(-0.7, -0.6, -0.6), vec3(0.7, 0.6, 0));
    add_sphere(&b, 0, vec3(-0.2, 0.1, 0.35), 0.4);
    add_torus(&b, 0, vec3(0.45, -0.2, 0.12), vec3(0, 0.3, 1), 0.25, 0.08);
    assert_int_equal(b.st, CLN_OK);
    assert_int_equal(shapes_finish(&w.shapes), CLN_OK);
    *scene = w.shapes;
}

static void make_camera(int i, const cln_space *space, cln_camera *c)
{
    const double height = -0.95 + 1.9 * (i + 0.5) / VIEWS, yaw = 2.399963 * i;
    const double r = sqrt(1 - height * height);
    const double z[3] = {-r * cos(yaw), -r * sin(yaw), -height}; /* forward */
    const double x[3] = {-sin(yaw), cos(yaw), 0};
    const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                         z[0] * x[1] - z[1] * x[0]};

    *c = (cln_camera){.width = WIDTH, .height = WIDTH, .cx = WIDTH / 2, .cy = WIDTH / 2};
    c->fx = c->fy = 1.3 * WIDTH;
    for (int a = 0; a < 3; a++) {
        c->c2w[4 * a] = x[a];
        c->c2w[4 * a + 1] = y[a];
        c->c2w[4 * a + 2] = z[a];
        c->c2w[4 * a + 3] = space->centre[a] - 3.2 * space->half * z[a];
    }
}

/* Exact depths, through the middle of each pixel; rays are traced in the cube. */
static void fuse(const shapes *scene, const cln_space *space, const cln_octree *tree,
                 cln_fusion *fusion)
{
    double pixel = 0;

    assert_int_equal(cln_fusion_start(space, tree, VIEWS, fusion), CLN_OK);
    for (int i = 0; i < VIEWS; i++) {
        float *depth = malloc(sizeof(float) * WIDTH * WIDTH);
        cln_camera camera;

        make_camera(i, space, &camera);
        for (int k = 0; k < WIDTH * WIDTH; k++) {
            double o[3], d[3], origin[3], direction[3];
            hit h;

            assert_true(cln_camera_ray(&camera, k % WIDTH + 0.5, k / WIDTH + 0.5, o, d));
            cln_space_ray_to_cube(space, o, d, origin, direction);
            depth[k] = shapes_hit(scene, vec3(origin[0], origin[1], origin[2]),
                                  vec3(direction[0], direction[1], direction[2]), 0, 100, &h)
                           ? (float)h.t
                           : -1;
        }
        assert_int_equal(cln_fusion_set(fusion, i, &camera, depth, &pixel), CLN_OK);
    }
    fusion->pixel = pixel;
}

/* Least distance from a point to a surface's vertices. */
static double nearest(const cln_surface *s, vec p)
{
    double best = DBL_MAX;

    for (size_t i = 0; i < s->vertices; i++) {
        const vec d = sub(vec3(s->at[i][0], s->at[i][1], s->at[i][2]), p);

        best = fmin(best, dot(d, d));
    }
    return sqrt(best);
}

/* How many of the cameras see a point of the shapes from its front. */
static int seen_by(const shapes *scene, vec p, vec normal)
{
    const cln_space unit_cube = {.half = 1};
    int seen = 0;

    for (int i = 0; i < VIEWS; i++) {
        cln_camera c;
        vec eye, ray;
        hit h;

        make_camera(i, &unit_cube, &c);
        eye = vec3(c.c2w[3], c.c2w[7], c.c2w[11]);
        ray = sub(p, eye);
        seen += dot(ray, normal) < 0 && shapes_hit(scene, eye, unit(ray), 0, 100, &h) &&
                fabs(h.t - sqrt(dot(ray, ray))) < 0.05;
    }
    return seen;
}

static void check_views(const shapes *scene, const cln_surface *s)
{
    double off = 0, most = 0;
    int n = 0;

    for (size_t i = 0; i < s->vertices; i += 17, n++) {
        const vec p = vec3(s->at[i][0], s->at[i][1], s->at[i][2]);
        const vec normal = vec3(s->normal[i][0], s->normal[i][1], s->normal[i][2]);
        const int seen = seen_by(scene, p, normal);

        off += abs(seen - s->views[i]);
        most = fmax(most, seen);
    }
    print_message("    seen by up to %.0f views, %.3f off in the mean of %d\n", most, off / n, n);
    assert_true(most > 8);
    assert_true(off / n < 1);
}

static void check_surface(const shapes *scene, const cln_surface *s, double pixel)
{
    double sum = 0, cosines = 0, missing = 0;
    size_t far = 0;
    int hits = 0, bare = 0;

    for (size_t i = 0; i < s->vertices; i++) {
        const vec p = vec3(s->at[i][0], s->at[i][1], s->at[i][2]);
        const vec n = vec3(s->normal[i][0], s->normal[i][1], s->normal[i][2]);
        const double distance = fabs(truth_distance(scene, p));

        sum += distance;
        far += distance > 0.02; /* a hundredth of the cube */
        cosines += dot(n, truth_normal(scene, p));
    }
    for (int i = 0; i < 300; i++) { /* what is seen from new places */
        const double height = -0.9 + 1.8 * (i + 0.5) / 300, yaw = 2.4 * i,
                     r = sqrt(1 - height * height);
        const vec from = scale(vec3(r * cos(yaw), r * sin(yaw), height), 3);
        const vec to = vec3(0.6 * sin(1.7 * i), 0.5 * sin(2.3 * i), 0.4 * sin(3.1 * i));
        const vec direction = unit(sub(to, from));
        double distance = 0;
        hit h;

        if (!shapes_hit(scene, from, direction, 0, 100, &h))
            continue;
        distance = nearest(s, add(from, scale(direction, h.t)));
        missing += distance;
        hits++;
        bare += distance > 0.03;
    }
    print_message("    %zu vertices, pixel %.4f: distance %.5f, far %.4f, cosine %.4f; back %.5f, "
                  "bare %d of %d\n",
                  s->vertices, pixel, sum / (double)s->vertices, (double)far / (double)s->vertices,
                  cosines / (double)s->vertices, missing / hits, bare, hits);
    assert_true(hits > 200);
    assert_true(sum / (double)s->vertices < 0.2 * pixel);
    assert_true((double)far / (double)s->vertices < 0.002);
    assert_true(cosines / (double)s->vertices > 0.96);
    assert_true(missing / hits < pixel);
    assert_true(bare <= hits / 50);
}

static void depths_give_the_surface_back(void **state)
{
    static const cln_space spaces[] = {{.half = 1},
                                       {.centre = {500000, 4100000, 120}, .half = 250}};
    const cln_callbacks none = {0};
    cln_octree tree;
    shapes scene;

    (void)state;
    make_shapes(&scene);
    assert_int_equal(cln_octree_create(0, &tree), CLN_OK);
    for (int i = SANITIZED; i < 2; i++) { /* there the second alone */
        cln_fusion fusion = {0};
        cln_surface s = {0}, whole = {0};

        fuse(&scene, &spaces[i], &tree, &fusion);
        assert_near(fusion.pixel, 3 / (1.3 * WIDTH), 0.005);
        assert_int_equal(cln_surface_trace(&fusion, 0, 0.01, false, NULL, &none, &s), CLN_OK);
        check_surface(&scene, &s, fusion.pixel);
        check_views(&scene, &s);
        assert_int_equal(cln_surface_trace(&fusion, 60, 0, true, NULL, &none, &whole), CLN_OK);
        assert_closed(&whole);
        cln_surface_free(&s);
        cln_surface_free(&whole);
        cln_fusion_free(&fusion);
    }
    cln_octree_free(&tree);
    shapes_free(&scene);
}

/* A crop box, straight and turned. Open, it has the vertices of the whole surface that are in it,
 * others only in its faces, and their normals; closed, it is what it cuts off the ball. */
static void a_crop_is_a_part_of_the_surface(void **state)
{
    static const cln_space space = {.centre = {30, -20, 10}, .half = 5};
    static const double boxes[2][CLN_CROP_NUMBERS] = {{25.5, -23, 11.75, 31, -16, 15},
                                                      {28, -22, 11, 34, -18, 14, 10, -20, 35}};
    const double half_ball = 2 * 3.14159265 / 3 * 0.4 * 0.4 * 0.4;
    const cln_callbacks none = {0};
    cln_fusion fusion = {0};
    cln_surface whole = {0};
    cln_octree tree;
    shapes scene;

    (void)state;
    make_shapes(&scene);
    assert_int_equal(cln_octree_create(0, &tree), CLN_OK);
    fuse(&scene, &space, &tree, &fusion);
    assert_int_equal(cln_surface_trace(&fusion, 60, 0, false, NULL, &none, &whole), CLN_OK);
    for (int i = 0; i < 2; i++) {
        cln_surface open = {0}, closed = {0};
        size_t inside = 0, same = 0, alike = 0, at_face = 0;
        const float(*planes)[4] = NULL;
        cln_crop crop;

        assert_int_equal(cln_crop_from_numbers("box", boxes[i], &crop), CLN_OK);
        cln_crop_place(&space, &crop);
        planes = (const float(*)[4])crop.planes;
        assert_int_equal(cln_surface_trace(&fusion, 60, 0, false, planes, &none, &open), CLN_OK);
        assert_int_equal(cln_surface_trace(&fusion, 60, 0, true, planes, &none, &closed), CLN_OK);
        for (size_t v = 0; v < whole.vertices; v++)
            inside += cln_crop_depth(planes, whole.at[v]) > 1e-6;
        for (size_t v = 0; v < open.vertices; v++) {
            const double depth = cln_crop_depth(planes, open.at[v]);
            size_t k = 0;

            assert_true(depth > -1e-6);
            at_face += depth < 1e-6;
            if (depth < 1e-6)
                continue;
            while (k < whole.vertices && memcmp(whole.at[k], open.at[v], sizeof open.at[v]) != 0)
                k++;
            same += k < whole.vertices;
            alike += k < whole.vertices &&
                     memcmp(whole.normal[k], open.normal[v], sizeof open.normal[v]) == 0;
        }
        for (size_t v = 0; v < closed.vertices; v++)
            assert_true(cln_crop_depth(planes, closed.at[v]) > -1e-6);
        print_message("    %zu vertices of %zu, %zu in faces of the box; closed %zu, volume %.4f\n",
                      open.vertices, whole.vertices, at_face, closed.vertices, volume_of(&closed));
        assert_true(inside > 200 && at_face > 20);
        assert_int_equal(same, open.vertices - at_face);
        assert_int_equal(alike, same);
        assert_true(same <= inside && same > inside * 98 / 100);
        assert_closed(&closed);
        if (i == 0)
            assert_near(volume_of(&closed), half_ball, 0.05 * half_ball);
        cln_surface_free(&open);
        cln_surface_free(&closed);
    }
    cln_surface_free(&whole);
    cln_fusion_free(&fusion);
    cln_octree_free(&tree);
    shapes_free(&scene);
}

/* Between two pixels of one surface the depth is between theirs; of two surfaces, it is that of the
 * pixel where the point is. */
static void depths_do_not_mix_surfaces(void **state)
{
    enum { ACROSS = 8 };
    static const cln_space space = {.half = 1};
    /* the column, how far off, what the fusion says there; surfaces are 0.01 and 0.5 apart */
    static const struct {
        double u, distance, value;
    } cases[] = {{1.5, 3.02, 0.4}, {2.5, 3.03, 0.4},  {1.9, 3.024, 0.4},
                 {3.9, 3.03, 0.4}, {4.1, 3.49, -0.4}, {3.9, 3.49, 1}};
    const cln_camera camera = {.width = ACROSS,
                               .height = ACROSS,
                               .fx = 20,
                               .fy = 20,
                               .cx = 4,
                               .cy = 4,
                               .c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -3}};
    float *depth = malloc(sizeof(float) * ACROSS * ACROSS);
    cln_fusion fusion = {0};
    cln_octree tree;
    double pixel = 0;

    (void)state;
    assert_non_null(depth);
    for (int k = 0; k < ACROSS * ACROSS; k++)
        depth[k] = k % ACROSS < 2 ? 3 : k % ACROSS < 4 ? 3.01f : 3.51f;
    assert_int_equal(cln_octree_create(0, &tree), CLN_OK);
    assert_int_equal(cln_fusion_start(&space, &tree, 1, &fusion), CLN_OK);
    fusion.band = 0.05;
    assert_int_equal(cln_fusion_set(&fusion, 0, &camera, depth, &pixel), CLN_OK);
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double o[3], d[3];
        float at[3];

        assert_true(cln_camera_ray(&camera, cases[i].u, 4.25, o, d));
        for (int a = 0; a < 3; a++)
            at[a] = (float)(o[a] + cases[i].distance * d[a]);
        assert_near(cln_fusion_at(&fusion, at), cases[i].value, 1e-3);
    }
    cln_fusion_free(&fusion);
    cln_octree_free(&tree);
}

/* ---- finer where leaves are finer ---- */

/* A ball on a large block. */
static void make_block(shapes *scene)
{
    static world w;
    builder b = {.world = &w};

    memset(&w, 0, sizeof w);
    add_box(&b, 0, vec3(-0.85, -0.83, -0.62), vec3(0.84, 0.86, -0.11));
    add_sphere(&b, 0, vec3(0.3, 0.25, 0.05), 0.2);
    assert_int_equal(b.st, CLN_OK);
    assert_int_equal(shapes_finish(&w.shapes), CLN_OK);
    *scene = w.shapes;
}

/* Are the surfaces inside a leaf flat? Tests 9^3 places of it. */
static bool is_flat(const shapes *scene, const float box[4])
{
    const double near = 0.1 * (double)box[3];
    vec first = {0, 0, 0};
    bool any = false;

    for (int k = 0; k < 729; k++) {
        const vec p = vec3(box[0] + box[3] * (k % 9) / 8.0, box[1] + box[3] * (k / 9 % 9) / 8.0,
                           box[2] + box[3] * (k / 81) / 8.0);
        vec n;

        if (fabs(truth_distance(scene, p)) > near)
            continue;
        n = truth_normal(scene, p);
        if (!any)
            first = n;
        any = true;
        if (dot(n, first) < 0.95)
            return false;
    }
    return true;
}

/* A tree as training would make it: deeper where the surface bends. */
static void grow_tree(const shapes *scene, cln_octree *tree)
{
    assert_int_equal(cln_octree_create(2, tree), CLN_OK);
    for (int level = 2; level < 4; level++) {
        uint8_t *split = calloc((size_t)tree->leaf_count, 1);
        cln_octree_change change = {0};

        assert_non_null(split);
        for (int i = 0; i < tree->leaf_count; i++) {
            float box[4];

            cln_octree_box(tree, tree->leaf[i], box);
            split[i] = tree->level[tree->leaf[i]] == level && !is_flat(scene, box);
        }
        assert_int_equal(cln_octree_split(tree, split, &change), CLN_OK);
        cln_octree_change_free(&change);
        free(split);
    }
}

/* The longest side of a triangle at its first corner, of all triangles. */
static double longest_side(const cln_surface *s)
{
    double longest = 0;

    for (size_t f = 0; f < s->faces; f++)
        for (int k = 1; k < 3; k++) {
            const float *a = s->at[s->face[f][0]], *b = s->at[s->face[f][k]];
            const vec side = vec3(b[0] - (double)a[0], b[1] - (double)a[1], b[2] - (double)a[2]);

            longest = fmax(longest, dot(side, side));
        }
    return sqrt(longest);
}

static double distance_to_face(const cln_surface *s, size_t f, vec p)
{
    vec v[3], n, d;
    double best = DBL_MAX;
    bool within = true;

    for (int k = 0; k < 3; k++) {
        const float *at = s->at[s->face[f][k]];

        v[k] = vec3(at[0], at[1], at[2]);
    }
    n = cross(sub(v[1], v[0]), sub(v[2], v[0]));
    for (int k = 0; k < 3; k++) {
        const vec side = sub(v[(k + 1) % 3], v[k]), to = sub(p, v[k]);
        const double length = dot(side, side);
        const double t = length > 0 ? fmin(fmax(dot(to, side) / length, 0), 1) : 0;

        d = sub(to, scale(side, t));
        best = fmin(best, sqrt(dot(d, d)));
        within = within && dot(cross(n, side), to) >= 0;
    }
    return within && dot(n, n) > 0 ? fabs(dot(sub(p, v[0]), n)) / sqrt(dot(n, n)) : best;
}

/* Mean distances: of the triangles' middles, by area, to the shapes, and of places on the shapes
 * that are seen from around to the triangles. */
static void chamfer(const shapes *scene, const cln_surface *s, double *to, double *back)
{
    const double longest = longest_side(s);
    double area = 0;
    int hits = 0;

    *to = *back = 0;
    for (size_t f = 0; f < s->faces; f++) {
        vec v[3], n;
        double here;

        for (int k = 0; k < 3; k++) {
            const float *at = s->at[s->face[f][k]];

            v[k] = vec3(at[0], at[1], at[2]);
        }
        n = cross(sub(v[1], v[0]), sub(v[2], v[0]));
        here = sqrt(dot(n, n));
        area += here;
        *to += here * fabs(truth_distance(scene, scale(add(v[0], add(v[1], v[2])), 1.0 / 3)));
    }
    *to /= area;
    for (int i = 0; i < 400; i++) {
        const double height = -0.9 + 1.8 * (i + 0.5) / 400, yaw = 2.4 * i,
                     r = sqrt(1 - height * height);
        const vec from = scale(vec3(r * cos(yaw), r * sin(yaw), height), 3);
        const vec towards = vec3(0.6 * sin(1.7 * i), 0.5 * sin(2.3 * i), 0.4 * sin(3.1 * i));
        const vec direction = unit(sub(towards, from));
        double best = DBL_MAX;
        hit h;

        if (!shapes_hit(scene, from, direction, 0, 100, &h))
            continue;
        for (size_t f = 0; f < s->faces; f++) {
            const vec p = add(from, scale(direction, h.t));
            const float *at = s->at[s->face[f][0]];
            const vec d = sub(p, vec3(at[0], at[1], at[2]));

            if (dot(d, d) < (best + longest) * (best + longest)) /* else it is farther off */
                best = fmin(best, distance_to_face(s, f, p));
        }
        *back += best;
        hits++;
    }
    assert_true(hits > 200);
    *back /= hits;
}

/* Against the uniform grid of the narrowest cells: equally closed and near to the shapes, with far
 * fewer triangles, all of which are missing where leaves are not the deepest. */
static void cells_follow_the_tree(void **state)
{
    static const cln_space space = {.half = 1};
    const cln_callbacks none = {0};
    const int cells = SANITIZED ? 64 : 128; /* a quarter or an eighth of the deepest leaves' side */
    const double cell = 2.0 / cells;
    cln_fusion fusion = {0};
    cln_surface s[2] = {{0}};
    double to[2], back[2];
    int counts[2][5] = {{0}};
    cln_octree tree;
    shapes scene;

    (void)state;
    make_block(&scene);
    grow_tree(&scene, &tree);
    assert_int_equal(cln_octree_depth(&tree), 4);
    fuse(&scene, &space, &tree, &fusion);
    fusion.pixel = cell; /* as if the views were sharper */
    assert_int_equal(cln_surface_trace(&fusion, cells, 0, true, NULL, &none, &s[0]), CLN_OK);
    assert_int_equal(cln_surface_trace(&fusion, 0, cell, true, NULL, &none, &s[1]), CLN_OK);
    for (int k = 0; k < 2; k++) {
        chamfer(&scene, &s[k], &to[k], &back[k]);
        for (size_t f = 0; f < s[k].faces; f++) {
            const float *p = s[k].at[s[k].face[f][0]];
            const int slot = cln_octree_find(&tree, (const double[3]){p[0], p[1], p[2]});

            assert_true(slot >= 0);
            counts[k][tree.level[tree.leaf[slot]]]++;
        }
        print_message("    %zu triangles (by level of leaf %d %d %d), %.5f from the shapes, "
                      "these %.5f from it\n",
                      s[k].faces, counts[k][2], counts[k][3], counts[k][4], to[k], back[k]);
        assert_closed(&s[k]);
    }
    assert_true(s[1].faces < s[0].faces * (SANITIZED ? 7 : 6) / 8);
    assert_true(counts[1][2] < counts[0][2] / 2);
    assert_true(counts[1][4] > counts[0][4] * 9 / 10);
    assert_true(to[1] < 1.1 * to[0]);
    assert_true(back[1] < 1.1 * back[0]);
    cln_surface_free(&s[0]);
    cln_surface_free(&s[1]);
    cln_fusion_free(&fusion);
    cln_octree_free(&tree);
    shapes_free(&scene);
}

/* ---- a forward space ---- */

enum { FRONT_VIEWS = 9, FRONT_WIDTH = 120, FRONT_HEIGHT = 90, FRONT_CELLS = 80 };

/* A ball two near planes away, before a larger one at four to seven. */
static void make_front(const cln_space *space, shapes *scene)
{
    static world w;
    builder b = {.world = &w};
    vec at[2];

    for (int k = 0; k < 2; k++) {
        const double far = k ? 12 : 3.5;
        const double *z = space->axes + 6, *c = space->centre;

        at[k] = vec3(c[0] + far * z[0], c[1] + far * z[1], c[2] + far * z[2]);
    }
    memset(&w, 0, sizeof w);
    add_sphere(&b, 0, at[0], 0.5);
    add_sphere(&b, 0, at[1], 6);
    assert_int_equal(b.st, CLN_OK);
    assert_int_equal(shapes_finish(&w.shapes), CLN_OK);
    *scene = w.shapes;
}

static void fuse_front(const shapes *scene, const cln_space *space, const cln_octree *tree,
                       cln_fusion *fusion)
{
    double pixel = 0;

    assert_int_equal(cln_fusion_start(space, tree, FRONT_VIEWS, fusion), CLN_OK);
    for (int i = 0; i < FRONT_VIEWS; i++) {
        float *depth = malloc(sizeof(float) * FRONT_WIDTH * FRONT_HEIGHT);
        cln_camera camera;

        cln_check_forward_camera(0, space, FRONT_WIDTH, FRONT_HEIGHT, &camera);
        for (int a = 0; a < 3; a++)
            camera.c2w[4 * a + 3] +=
                0.4 * ((i % 3 - 1) * space->axes[a] + (i / 3 - 1) * space->axes[3 + a]);
        for (int k = 0; k < FRONT_WIDTH * FRONT_HEIGHT; k++) {
            double o[3], d[3];
            hit h;

            assert_true(
                cln_camera_ray(&camera, k % FRONT_WIDTH + 0.5, k / FRONT_WIDTH + 0.5, o, d));
            depth[k] = shapes_hit(scene, vec3(o[0], o[1], o[2]), vec3(d[0], d[1], d[2]), 0, 1e3, &h)
                           ? (float)(h.t / space->half)
                           : -1;
        }
        assert_int_equal(cln_fusion_set(fusion, i, &camera, depth, &pixel), CLN_OK);
    }
    fusion->pixel = pixel;
}

/* Vertices lie on the balls, to a part of a cell's depth there, with the balls' normals. */
static void forward_depths_give_the_surface_back(void **state)
{
    const cln_space space = cln_check_forward_space(1);
    const cln_callbacks none = {0};
    cln_fusion fusion = {0};
    cln_surface s = {0};
    cln_octree tree;
    shapes scene;
    int on[2] = {0}, off = 0, turned = 0;

    (void)state;
    make_front(&space, &scene);
    assert_int_equal(cln_octree_create(0, &tree), CLN_OK);
    fuse_front(&scene, &space, &tree, &fusion);
    assert_int_equal(cln_surface_trace(&fusion, FRONT_CELLS, 0, false, NULL, &none, &s), CLN_OK);
    for (size_t i = 0; i < s.vertices; i++) {
        const double cube[3] = {s.at[i][0], s.at[i][1], s.at[i][2]};
        const double z = 2 / (1 - cube[2]), cell = space.half * z * z / FRONT_CELLS;
        double at[3];
        float normal[3];
        vec p, exact;

        cln_space_point_to_scene(&space, cube, at);
        cln_space_normal_to_scene(&space, cube, s.normal[i], normal);
        p = vec3(at[0], at[1], at[2]);
        exact = truth_normal(&scene, p);
        on[truth_shape(&scene.list[0], p) > truth_shape(&scene.list[1], p)]++;
        off += fabs(truth_distance(&scene, p)) > 0.3 * cell;
        turned += !(dot(vec3(normal[0], normal[1], normal[2]), exact) > 0.9);
    }
    print_message("    %zu vertices, %d and %d of the balls; %d are off, %d turned\n", s.vertices,
                  on[0], on[1], off, turned);
    assert_true(on[0] > 300 && on[1] > 1500);
    assert_true(off < (int)s.vertices / 20);
    assert_true(turned < (int)s.vertices / 8);
    cln_surface_free(&s);
    cln_fusion_free(&fusion);
    cln_octree_free(&tree);
    shapes_free(&scene);
}

int test_group_surface(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cases_cut_what_they_must),
        cmocka_unit_test(a_ball_is_a_ball),
        cmocka_unit_test(whatever_the_signs_there_is_no_crack),
        cmocka_unit_test(nor_between_wide_and_narrow_cells),
        cmocka_unit_test(a_ball_with_wide_cells),
        cmocka_unit_test(too_many_vertices_are_refused),
        cmocka_unit_test(what_is_not_kept_goes),
        cmocka_unit_test(depths_give_the_surface_back),
        cmocka_unit_test(a_crop_is_a_part_of_the_surface),
        cmocka_unit_test(depths_do_not_mix_surfaces),
        cmocka_unit_test(cells_follow_the_tree),
        cmocka_unit_test(forward_depths_give_the_surface_back),
    };

    return cmocka_run_group_tests_name("surface", tests, NULL, NULL);
}
