/* The scene generator's geometry, as its pictures and depths serve as ground truth: hits of each
 * shape against its implicit equation marched in small steps (independent of data/), the tree
 * against one shape at a time, and a rendered sphere against its closed form. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "../../data/picture.h"
#include "base/rng.h"
#include "tests.h"

static double uniform(uint32_t index, double low, double high)
{
    float u[4];
    cln_uniform4(7, CLN_STREAM_SCENE, 0, index / 4, 9, u);
    return low + (high - low) * (double)u[index % 4];
}

static vec random_unit(uint32_t index)
{
    double z = uniform(index, -1, 1), angle = uniform(index + 1, -3.1415926, 3.1415926);
    return vec3(sqrt(1 - z * z) * cos(angle), sqrt(1 - z * z) * sin(angle), z);
}

static shape make(shape_kind kind, vec centre, vec w, double a, double b, double c)
{
    shape s = {.kind = kind, .centre = centre, .w = unit(w), .a = a, .b = b, .c = c};
    frame_of(s.w, &s.u, &s.v);
    return s;
}

/* Negative inside, zero on the surface. */
static double implicit(const shape *s, vec point)
{
    vec d = sub(point, s->centre), p = vec3(dot(d, s->u), dot(d, s->v), dot(d, s->w));
    double rho = hypot(p.x, p.y), along_axis = fmax(fabs(p.z) - s->c, 0);

    switch (s->kind) {
    case SHAPE_SPHERE:
        return sqrt(dot(p, p)) - s->a;
    case SHAPE_BOX:
        return fmax(fabs(p.x) - s->a, fmax(fabs(p.y) - s->b, fabs(p.z) - s->c));
    case SHAPE_FRUSTUM:
        return fmax(rho - (s->a + (s->b - s->a) * (p.z + s->c) / (2 * s->c)), fabs(p.z) - s->c);
    case SHAPE_CAPSULE:
        return hypot(rho, along_axis) - s->a;
    case SHAPE_TORUS:
        return hypot(rho - s->a, p.z) - s->b;
    }
    return 0;
}

/* First sign change along the ray, bisected; infinity if none. */
static double march(const shape *s, vec o, vec d)
{
    const double step = 2e-3, far = 7;
    double before = implicit(s, along(o, 1e-9, d));

    for (double t = step; t < far; t += step) {
        double now = implicit(s, along(o, t, d));
        if ((before < 0) != (now < 0)) {
            double a = t - step, b = t;
            for (int i = 0; i < 60; i++) {
                double middle = 0.5 * (a + b);
                if ((implicit(s, along(o, middle, d)) < 0) == (before < 0))
                    a = middle;
                else
                    b = middle;
            }
            return 0.5 * (a + b);
        }
        before = now;
    }
    return INFINITY;
}

static void build_scene(shapes *scene, const shape *list, int count)
{
    memset(scene, 0, sizeof *scene);
    for (int i = 0; i < count; i++)
        assert_int_equal(shapes_add(scene, &list[i]), CLN_OK);
    assert_int_equal(shapes_finish(scene), CLN_OK);
}

/* The ray's hit is on the surface and the first one; the normal is the equation's gradient. Returns
 * whether the ray hits. */
static bool check_ray(const shape *s, const shapes *scene, vec o, vec d)
{
    hit h;
    bool found = shapes_hit(scene, o, d, 0, INFINITY, &h);
    double truth = march(s, o, d);

    assert_int_equal(found, shapes_blocked(scene, o, d, 0, INFINITY));
    if (!found) {
        assert_true(isinf(truth));
        return false;
    }
    vec p = along(o, h.t, d);
    assert_true(h.t > 0 && h.t <= truth + 1e-7);
    assert_true(fabs(implicit(s, p)) < 1e-7);
    assert_true(fabs(dot(h.normal, h.normal) - 1) < 1e-9);
    assert_true(dot(h.normal, d) <= 0);
    const double e = 1e-6;
    vec gradient = vec3(implicit(s, add(p, vec3(e, 0, 0))) - implicit(s, add(p, vec3(-e, 0, 0))),
                        implicit(s, add(p, vec3(0, e, 0))) - implicit(s, add(p, vec3(0, -e, 0))),
                        implicit(s, add(p, vec3(0, 0, e))) - implicit(s, add(p, vec3(0, 0, -e))));
    /* the gradient jumps at edges; no hit of these seeds is within e of one */
    assert_true(fabs(dot(unit(gradient), h.normal)) > 0.999);
    return true;
}

static void test_shapes(void **state)
{
    (void)state;
    const shape cases[] = {
        make(SHAPE_SPHERE, vec3(0.2, -0.1, 0.3), vec3(0, 0, 1), 0.7, 0, 0),
        make(SHAPE_BOX, vec3(0.1, 0.2, 0), vec3(0.3, -0.2, 0.9), 0.5, 0.3, 0.8),
        make(SHAPE_BOX, vec3(0, 0, 0), vec3(0, 0, 1), 0.9, 0.9, 0.004), /* a thin plate */
        make(SHAPE_FRUSTUM, vec3(0, 0.1, 0.2), vec3(0.5, 0.5, 1), 0.6, 0.2, 0.5),
        make(SHAPE_FRUSTUM, vec3(0, 0, 0), vec3(1, 0, 0), 0.4, 0.4, 0.7), /* a cylinder */
        make(SHAPE_FRUSTUM, vec3(0, 0, 0), vec3(0, 1, 0.2), 0.5, 0, 0.6), /* a cone */
        make(SHAPE_CAPSULE, vec3(0.3, 0, -0.1), vec3(0.2, 1, 0.1), 0.3, 0, 0.6),
        make(SHAPE_CAPSULE, vec3(0, 0, 0), vec3(1, 1, 0), 0.01, 0, 0.9), /* a wire */
        make(SHAPE_TORUS, vec3(0.1, 0, 0), vec3(0.3, 0.2, 1), 0.7, 0.25, 0),
        make(SHAPE_TORUS, vec3(0, 0, 0), vec3(0, 1, 0), 0.9, 0.012, 0), /* a hoop */
    };

    for (size_t k = 0; k < sizeof cases / sizeof cases[0]; k++) {
        const shape *s = &cases[k];
        shapes scene;
        int hits = 0;
        build_scene(&scene, s, 1);
        for (uint32_t i = 0; i < 150; i++) {
            uint32_t at = 1000 * (uint32_t)k + 6 * i;
            vec o =
                scale(random_unit(at), 3); /* outside, towards a point near the shape's surface */
            vec near = along(s->centre, uniform(at + 2, 0, 1), random_unit(at + 3));
            hits += check_ray(s, &scene, o, unit(sub(near, o)));
        }
        /* from inside the hole or the body, along an axis, with zeros in the direction */
        hits += check_ray(s, &scene, s->centre, vec3(1, 0, 0));
        hits += check_ray(s, &scene, s->centre, vec3(0, -1, 0));
        hits += check_ray(s, &scene, s->centre, vec3(0, 0, 1));
        assert_true(hits >= 3);
        shapes_free(&scene);
    }
}

static void test_tree_is_brute_force(void **state)
{
    (void)state;
    enum { SHAPES = 120, RAYS = 400 };
    shape list[SHAPES];
    shapes all, one[SHAPES];

    for (uint32_t i = 0; i < SHAPES; i++) {
        uint32_t at = 50000 + 12 * i;
        list[i] = make((shape_kind)(i % 5),
                       vec3(uniform(at, -1, 1), uniform(at + 1, -1, 1), uniform(at + 2, -1, 1)),
                       random_unit(at + 3), uniform(at + 5, 0.05, 0.2), uniform(at + 6, 0.01, 0.05),
                       uniform(at + 7, 0.02, 0.3));
        build_scene(&one[i], &list[i], 1);
    }
    build_scene(&all, list, SHAPES);
    int hits = 0;
    for (uint32_t r = 0; r < RAYS; r++) {
        uint32_t at = 90000 + 8 * r;
        vec o = scale(random_unit(at), uniform(at + 2, 0, 2.5)), d = random_unit(at + 3);
        double nearest = INFINITY;
        hit h;
        for (int i = 0; i < SHAPES; i++)
            if (shapes_hit(&one[i], o, d, 0, INFINITY, &h) && h.t < nearest)
                nearest = h.t;
        bool found = shapes_hit(&all, o, d, 0, INFINITY, &h);
        assert_int_equal(found, nearest < INFINITY);
        assert_int_equal(shapes_blocked(&all, o, d, 0, INFINITY), found);
        if (found) {
            assert_true(h.t == nearest);
            assert_false(shapes_blocked(&all, o, d, 0, nearest));
            hits++;
        }
    }
    assert_in_range(hits, RAYS / 4, RAYS);
    for (int i = 0; i < SHAPES; i++)
        shapes_free(&one[i]);
    shapes_free(&all);
}

static world *new_world(void)
{
    world *w = calloc(1, sizeof *w);
    assert_non_null(w);
    world_noise(w, 1);
    return w;
}

static void free_world(world *w)
{
    shapes_free(&w->shapes);
    free(w);
}

/* A sphere straight ahead: depth of every pixel, and area covered by alpha. */
static void test_sphere_picture(void **state)
{
    (void)state;
    enum { SIDE = 64 };
    static uint8_t rgba[SIDE * SIDE * 4];
    static float depth[SIDE * SIDE];
    const double r = 0.8, distance = 3, f = 70;
    world *w = new_world();
    builder b = {.world = w, .st = CLN_OK};
    cln_camera camera = {.width = SIDE, .height = SIDE, .fx = f, .fy = f, .cx = 32, .cy = 32};
    double covered = 0;

    w->light = vec3(0, 0, 1);
    w->light_colour = w->sky = w->ground = vec3(0.5, 0.5, 0.5);
    add_sphere(&b, add_material(&b, PATTERN_PLAIN, 0x808080, 0x808080, 1), vec3(0, 0, distance), r);
    assert_int_equal(b.st, CLN_OK);
    assert_int_equal(shapes_finish(&w->shapes), CLN_OK);
    camera.c2w[0] = camera.c2w[5] = camera.c2w[10] = 1;
    picture_render(w, &camera, rgba, depth);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++) {
            double px = (x + 0.5 - 32) / f, py = (y + 0.5 - 32) / f;
            double cosine = 1 / sqrt(1 + px * px + py * py), half = distance * cosine;
            double disc = half * half - distance * distance + r * r;
            double truth = disc >= 0 ? half - sqrt(disc) : 0;
            const uint8_t *pixel = rgba + 4 * (y * SIDE + x);
            assert_true(fabs((double)depth[y * SIDE + x] - truth) < 1e-6);
            if (pixel[3] == 0)
                assert_true(depth[y * SIDE + x] == 0 && !pixel[0] && !pixel[1] && !pixel[2]);
            covered += pixel[3] / 255.0;
        }
    /* the outline is a circle of radius f tan(asin(r / distance)) pixels */
    double outline = f * tan(asin(r / distance)), area = 3.14159265358979 * outline * outline;
    assert_true(fabs(covered / area - 1) < 5e-3);
    free_world(w);
}

static void check_inside_cube(const world *w)
{
    const tree_node *root = &w->shapes.nodes[0];

    assert_true(w->shapes.count > 40);
    assert_true(root->low.x >= -1.5 && root->low.y >= -1.5 && root->low.z >= -1.5);
    assert_true(root->high.x <= 1.5 && root->high.y <= 1.5 && root->high.z <= 1.5);
}

static void test_scenes(void **state)
{
    (void)state;
    world *object = new_world(), *room = new_world();

    assert_int_equal(scene_object(object), CLN_OK);
    check_inside_cube(object);
    assert_int_equal(scene_room(room), CLN_OK);
    check_inside_cube(room);
    /* the room is closed: every ray from its middle ends within the cube's diagonal */
    for (uint32_t i = 0; i < 2000; i++) {
        hit h;
        assert_true(shapes_hit(&room->shapes, vec3(0.1, 0.2, 0), random_unit(2 * i), 0, 5.2, &h));
    }
    free_world(object);
    free_world(room);
}

static void test_over_white(void **state)
{
    (void)state;
    uint8_t image[12] = {10, 20, 30, 255, 0, 0, 0, 0, 200, 100, 0, 51};
    const uint8_t expected[9] = {10, 20, 30, 255, 255, 255, 244, 224, 204};

    picture_over_white(3, image);
    assert_memory_equal(image, expected, 9);
}

/* Distances along rays whose ends follow from the scene's own numbers, by hand. */
static void test_depths_of_scenes(void **state)
{
    static const struct {
        cln_status (*build)(world *);
        double from[3], way[3], depth;
        const char *what;
    } cases[] = {
        {scene_terrain, {0.37, -1.3, 4.5}, {0, 0, -1}, 4.697, "the second road, 0.003 high"},
        {scene_terrain, {-0.3, -0.95, 4.5}, {0, 0, -1}, 4.54, "the hall, 0.16 high"},
        {scene_terrain, {-1.25, -0.26, 4.5}, {0, 0, -1}, 4.502, "a ridge, 0.11 + 1.1 * 0.08 high"},
        {scene_terrain, {0.705, -0.28, 5}, {0, 0, -1}, 4.77, "the tower's roof, half way to 0.5"},
        {scene_terrain, {-3.6, -0.5, 4.7}, {0.6, 0, -0.8}, 6.125, "a field, obliquely: 4.9 / 0.8"},
        {scene_forward, {-1.2, -3.3, 1.2}, {0, 1, 0}, 4.3, "the wall at y = 1"},
        {scene_forward, {0.3, -3.3, 0.75}, {0, 1, 0}, 4.79, "the sky at y = 1.49, by the window"},
        {scene_forward, {0.12, -3.3, 0.5}, {0, 1, 0}, 4.27, "the window's frame, 0.03 before it"},
        {scene_forward, {-0.3, -3.3, -0.6}, {0, 1, 0}, 2.1, "the edge of the table"},
        {scene_forward, {-0.2, -2, 0.44}, {0, 0.8, -0.6}, 5. / 3, "the cloth, obliquely: 1 / 0.6"},
    };

    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        world *w = calloc(1, sizeof *w);
        const double *o = cases[i].from, *d = cases[i].way;
        hit h = {0};

        assert_non_null(w);
        assert_int_equal(cases[i].build(w), CLN_OK);
        assert_true(shapes_hit(&w->shapes, vec3(o[0], o[1], o[2]), vec3(d[0], d[1], d[2]), 0,
                               INFINITY, &h));
        if (fabs(h.t - cases[i].depth) > 1e-6)
            fail_msg("%s: %.9g instead of %.9g", cases[i].what, h.t, cases[i].depth);
        shapes_free(&w->shapes);
        free(w);
    }
}

int test_group_trace(void)
{
    static const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shapes),         cmocka_unit_test(test_tree_is_brute_force),
        cmocka_unit_test(test_sphere_picture), cmocka_unit_test(test_scenes),
        cmocka_unit_test(test_over_white),     cmocka_unit_test(test_depths_of_scenes),
    };

    return cmocka_run_group_tests_name("trace", tests, NULL, NULL);
}
