/* Normals from depths (render/normals.h) of a ball before a wall, whose depths and normals are
 * known by geometry. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "render/normals.h"
#include "tests.h"

enum { WIDTH = 120, HEIGHT = 90 };

static const double ball[3] = {0.3, -0.2, 0.1}, wall[3] = {0.6, 0, 0.8}; /* through -2 wall */
static const double RADIUS = 0.9;

/* Distance and normal of a ray's first hit; 0 without a hit. */
static double hit(const double o[3], const double d[3], double normal[3])
{
    double b = 0, c = -RADIUS * RADIUS, along = 0, from = 2, t = 0;

    for (int a = 0; a < 3; a++) {
        b += d[a] * (o[a] - ball[a]);
        c += (o[a] - ball[a]) * (o[a] - ball[a]);
        along += d[a] * wall[a];
        from += o[a] * wall[a];
    }
    if (b * b - c > 0) {
        t = -b - sqrt(b * b - c);
        for (int a = 0; a < 3; a++)
            normal[a] = (o[a] + t * d[a] - ball[a]) / RADIUS;
        return t;
    }
    memcpy(normal, wall, 3 * sizeof *normal);
    return along < -0.05 ? -from / along : 0;
}

/* A camera at a place off the axes, that looks at the ball. */
static cln_camera make_camera(void)
{
    cln_camera c = {.fx = 100, .fy = 110, .cx = 61, .cy = 44, .width = WIDTH, .height = HEIGHT};
    const double at[3] = {1.9, -1.2, 3.4};
    double z[3], x[3], y[3], length = 0;

    for (int a = 0; a < 3; a++) {
        z[a] = ball[a] - at[a];
        length = hypot(length, z[a]);
    }
    for (int a = 0; a < 3; a++)
        z[a] /= length;
    x[0] = z[1];
    x[1] = -z[0];
    x[2] = 0;
    length = hypot(x[0], x[1]);
    for (int a = 0; a < 3; a++)
        x[a] /= length;
    for (int a = 0; a < 3; a++)
        y[a] = z[(a + 1) % 3] * x[(a + 2) % 3] - z[(a + 2) % 3] * x[(a + 1) % 3];
    for (int a = 0; a < 3; a++) {
        c.c2w[4 * a] = x[a];
        c.c2w[4 * a + 1] = y[a];
        c.c2w[4 * a + 2] = z[a];
        c.c2w[4 * a + 3] = at[a];
    }
    return c;
}

/* parallel: all rays along the axis, from a plane that begins left and above. */
static void check(double k1, bool parallel)
{
    static float depth[WIDTH * HEIGHT], opacity[WIDTH * HEIGHT], got[3 * WIDTH * HEIGHT];
    static double want[3 * WIDTH * HEIGHT];
    cln_camera camera = make_camera();
    int known = 0, close = 0, empty = 0;

    camera.k1 = k1;
    if (parallel) {
        camera.fx = camera.fy = 40;
        camera.cx = camera.cy = 0;
        camera.parallel = true;
        for (int a = 0; a < 3; a++)
            camera.c2w[4 * a + 3] -= 1.5 * camera.c2w[4 * a] + 1.1 * camera.c2w[4 * a + 1];
    }
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        double o[3], d[3], t = 0;

        cln_camera_ray(&camera, i % WIDTH + 0.5, i / WIDTH + 0.5, o, d);
        t = hit(o, d, want + 3 * (size_t)i);
        depth[i] = (float)t;
        opacity[i] = t > 0 && i % 97 != 5 ? 0.9f : 0.2f; /* some pixels show nothing */
    }
    cln_normals_of_depth(&camera, depth, opacity, got);
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        const float *n = got + 3 * (size_t)i;
        double dot = 0, square = 0;

        for (int a = 0; a < 3; a++) {
            square += (double)n[a] * (double)n[a];
            dot += (double)n[a] * want[3 * i + a];
        }
        if (square == 0) {
            empty++;
            continue;
        }
        assert_true(opacity[i] > 0.5f);
        assert_true(fabs(square - 1) < 1e-5);
        known++;
        close += dot > 0.995; /* 6 degrees: the ball is 50 pixels wide, and turns within one */
    }
    print_message("normals: %d known, %d of them close, %d pixels without\n", known, close, empty);
    assert_true(known > WIDTH * HEIGHT / 2);
    assert_true(close > 0.97 * known);
    assert_true(empty >= WIDTH * HEIGHT / 97);
}

static void test_known_surfaces(void **state)
{
    (void)state;
    check(0, false);
    check(0.08, false);
    check(0, true);
}

/* Across a step of depth is no surface: a column alone before a wall has no normal. */
static void test_edges(void **state)
{
    enum { COLUMN = WIDTH / 2 };
    static float depth[WIDTH * HEIGHT], opacity[WIDTH * HEIGHT], got[3 * WIDTH * HEIGHT];
    const cln_camera camera = make_camera();

    (void)state;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        depth[i] = i % WIDTH == COLUMN ? 3 : 6;
        opacity[i] = 1;
    }
    cln_normals_of_depth(&camera, depth, opacity, got);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++) {
            const float *n = got + 3 * (y * WIDTH + x);

            assert_true((n[0] == 0 && n[1] == 0 && n[2] == 0) == (x == COLUMN));
        }
}

/* A pixel alone in its picture has no normal. */
static void test_without_neighbours(void **state)
{
    cln_camera camera = make_camera();
    const float depth = 3, opacity = 1;
    float normal[3] = {7, 7, 7};

    (void)state;
    camera.width = camera.height = 1;
    cln_normals_of_depth(&camera, &depth, &opacity, normal);
    assert_true(normal[0] == 0 && normal[1] == 0 && normal[2] == 0);
}

int test_group_normals(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_known_surfaces),
        cmocka_unit_test(test_edges),
        cmocka_unit_test(test_without_neighbours),
    };

    return cmocka_run_group_tests_name("normals", tests, NULL, NULL);
}
