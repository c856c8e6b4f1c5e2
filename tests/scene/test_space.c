/* Scene space and cube, against numbers calculated by hand and against each other. Tested: points,
 * rays, poses, distances and boxes agree on one map; being in the cube, or meeting it, is the same
 * on both sides of the map; boxes of neighbours share their faces to the bit. Of forward spaces
 * also: lines stay lines; a box is the same on both sides; depths, directions, normals and
 * densities are those of the point's map. */
#include "unit.h"
#include <math.h>
#include <string.h>
#include "base/rng.h"
#include "check/forward_scene.h"
#include "near.h"
#include "scene/scene.h"
#include "scene/space.h"
#include "tests.h"

static const cln_space space = {.centre = {10, -20, 0.5}, .half = 4};

static void test_by_hand(void **state)
{
    const double c2w[12] = {0, 0, 1, 14, 1, 0, 0, -20, 0, 1, 0, -1.5};
    const float posed[12] = {0, 0, 1, 1, 1, 0, 0, 0, 0, 1, 0, -0.5f};
    const float cube[4] = {-1, 0, 0.5f, 0.5f};
    double p[3], o[3], d[3];
    double low[3], high[3];
    float out[12];

    (void)state;
    cln_space_point_to_cube(&space, (double[3]){12, -24, 0.5}, p);
    assert_near(p[0], 0.5, 0);
    assert_near(p[1], -1, 0);
    assert_near(p[2], 0, 0);
    cln_space_point_to_scene(&space, (double[3]){-1, 0.25, 1}, p);
    assert_near(p[0], 6, 0);
    assert_near(p[1], -19, 0);
    assert_near(p[2], 4.5, 0);
    cln_space_ray_to_cube(&space, (double[3]){6, -20, 8.5}, (double[3]){0, 0.6, -0.8}, o, d);
    assert_near(o[0], -1, 0);
    assert_near(o[1], 0, 0);
    assert_near(o[2], 2, 0);
    assert_near(d[1], 0.6, 0);
    assert_near(d[2], -0.8, 0);
    cln_space_pose_to_cube(&space, c2w, out);
    assert_memory_equal(out, posed, sizeof posed);
    assert_near(cln_space_distance_to_scene(&space, 0.75), 3, 0);
    assert_near(cln_space_depth_to_scene(&space, 0.75f), 3, 0);
    assert_near(cln_space_density_to_scene(&space, NULL, NULL, 6), 1.5, 0);
    cln_space_box_to_scene(&space, cube, low, high);
    assert_near(low[0], 6, 0);
    assert_near(high[0], 8, 0);
    assert_near(low[1], -20, 0);
    assert_near(high[1], -18, 0);
    assert_near(low[2], 2.5, 0);
    assert_near(high[2], 4.5, 0);
}

/* A point at distance t along a ray is the same point on both sides. */
static void test_one_map(void **state)
{
    int inside = 0, met = 0;

    (void)state;
    for (uint32_t i = 0; i < 2000; i++) {
        double o[3], d[3], q[3], e[3], at[3], back[3], length = 0, most = 0, steps = 0;
        float r[4], s[4];
        bool hit = false;

        cln_uniform4(1, CLN_STREAM_SCENE, 0, i, 0, r);
        cln_uniform4(1, CLN_STREAM_SCENE, 1, i, 0, s);
        for (int a = 0; a < 3; a++) {
            o[a] = space.centre[a] + 10 * ((double)r[a] - 0.5);
            d[a] = (double)s[a] - 0.5;
            length += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(length);
        cln_space_ray_to_cube(&space, o, d, q, e);
        for (int a = 0; a < 3; a++)
            at[a] = q[a] + (double)r[3] * e[a];
        cln_space_point_to_scene(&space, at, back);
        for (int a = 0; a < 3; a++)
            assert_near(back[a], o[a] + cln_space_distance_to_scene(&space, (double)r[3]) * d[a],
                        1e-13);
        cln_space_point_to_cube(&space, back, back);
        for (int a = 0; a < 3; a++) {
            assert_near(back[a], at[a], 1e-14);
            most = fmax(most, fabs(q[a]));
        }
        assert_int_equal(cln_space_holds(&space, o), most <= 1);
        inside += most <= 1;
        /* If small steps along the ray find the cube, the ray meets it. */
        for (steps = 0; steps < 5 && !hit; steps += 0.01) {
            most = 0;
            for (int a = 0; a < 3; a++)
                most = fmax(most, fabs(q[a] + steps * e[a]));
            hit = most < 1;
        }
        if (hit)
            assert_true(cln_space_met_by(&space, o, d));
        met += hit;
    }
    assert_in_range(inside, 700, 1300);
    assert_in_range(met, inside + 1, 1900);
    /* Outside a face: parallel to it, away from it. */
    assert_false(cln_space_met_by(&space, (double[3]){15, -20, 0}, (double[3]){0, 0, 1}));
    assert_true(cln_space_met_by(&space, (double[3]){13, -20, -50}, (double[3]){0, 0, 1}));
    assert_false(cln_space_met_by(&space, (double[3]){13, -20, -50}, (double[3]){0, 0, -1}));
}

static void test_faces_and_equality(void **state)
{
    const cln_space odd = {.centre = {1.0 / 3, -2.0 / 7, 1e-3}, .half = 0.1 / 0.33};
    const float left[4] = {-0.5f, 0.25f, 0, 0.125f}, right[4] = {-0.375f, 0.25f, 0, 0.0625f};
    double low[2][3], high[2][3];
    cln_space other = odd;

    (void)state;
    cln_space_box_to_scene(&odd, left, low[0], high[0]);
    cln_space_box_to_scene(&odd, right, low[1], high[1]);
    assert_memory_equal(&high[0][0], &low[1][0], sizeof high[0][0]);
    assert_memory_equal(&low[0][1], &low[1][1], sizeof low[0][1]);
    assert_true(cln_space_equal(&odd, &other));
    other.half *= 1 + 1e-7;
    other.centre[1] += 1e-8;
    assert_true(cln_space_equal(&odd, &other));
    other.half *= 1.00001;
    assert_false(cln_space_equal(&odd, &other));
    other = odd;
    other.centre[2] += 1e-5;
    assert_false(cln_space_equal(&odd, &other));
}

/* ---- forward ---- */

static void test_forward_by_hand(void **state)
{
    const cln_space plain = {{1, 2, 3}, 2, true, {1, 0, 0, 0, 1, 0, 0, 0, 1}, {0.5, 0.25}, false};
    /* right is the scene's y, down its z, forward its x */
    const cln_space turned = {{1, 2, 3}, 2, true, {0, 1, 0, 0, 0, 1, 1, 0, 0}, {0.5, 0.25}, false};
    const double c2w[12] = {0, 0, 1, 5, 1, 0, 0, 2, 0, 1, 0, 3}; /* turned's mean camera, moved */
    const float posed[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 2};
    double p[3], o[3], d[3], v[4];
    float out[12];

    (void)state;
    cln_space_point_to_cube(&plain, (double[3]){5, 0, 11}, p); /* q = 2, -1, 4 */
    assert_near(p[0], 0.25, 0);
    assert_near(p[1], -0.0625, 0);
    assert_near(p[2], 0.5, 0);
    cln_space_point_to_cube(&turned, (double[3]){9, 6, 1}, p); /* q = 2, -1, 4 */
    assert_near(p[0], 0.25, 0);
    assert_near(p[1], -0.0625, 0);
    assert_near(p[2], 0.5, 0);
    cln_space_point_to_scene(&turned, p, p);
    assert_near(p[0], 9, 1e-14);
    assert_near(p[1], 6, 1e-14);
    assert_near(p[2], 1, 1e-14);
    cln_space_point_to_view(&turned, (double[3]){0.25, -0.0625, 0.5}, v);
    assert_near(v[0], 0.5, 0);
    assert_near(v[1], -0.25, 0);
    assert_near(v[3], 0.25, 0);
    /* from the mean camera every ray runs along z, from the near plane */
    cln_space_ray_to_cube(&plain, plain.centre, (double[3]){0.6, 0, 0.8}, o, d);
    assert_near(o[0], 0.375, 1e-15);
    assert_near(o[1], 0, 0);
    assert_near(o[2], -1, 0);
    assert_near(d[0], 0, 0);
    assert_near(d[2], 1, 0);
    /* straight ahead from 2 to the right: to the middle at infinity */
    cln_space_ray_to_cube(&plain, (double[3]){5, 2, 3}, (double[3]){0, 0, 1}, o, d);
    assert_near(o[0], 1, 1e-15);
    assert_near(d[0] / d[2], -0.5, 1e-15);
    cln_space_pose_to_cube(&turned, c2w, out);
    assert_memory_equal(out, posed, sizeof posed);
    assert_near(cln_space_depth_to_scene(&plain, 0.75f), 1.5, 0);
    /* backwards: nothing; beside and behind: nowhere */
    assert_false(cln_space_met_by(&plain, plain.centre, (double[3]){0, 0, -1}));
    assert_false(cln_space_met_by(&plain, plain.centre, (double[3]){1, 0, 0}));
    assert_true(cln_space_met_by(&plain, plain.centre, (double[3]){0.6, 0, 0.8}));
    assert_false(cln_space_holds(&plain, (double[3]){1, 2, 4.9}));
    assert_true(cln_space_holds(&plain, (double[3]){1, 2, 5.1}));
    assert_false(cln_space_holds(&plain, (double[3]){1, 2, -5}));
    assert_true(cln_space_holds(&plain, (double[3]){1, 2, 1e5}));
}

static void add_scaled(const double o[3], double t, const double d[3], double out[3])
{
    for (int a = 0; a < 3; a++)
        out[a] = o[a] + t * d[a];
}

static double length_between(const double a[3], const double b[3])
{
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

/* Rays of four cameras, one of them beyond the near plane, and points along them from there to 500
 * near planes away. */
static void test_forward_map(void **state)
{
    static const double units[] = {1, 1e-4, 1e6};

    (void)state;
    for (int i = 0; i < 1200; i++) {
        const cln_space forward = cln_check_forward_space(units[i % 3]);
        double o[3], d[3], q[3], e[3], at[3], cube[3], back[3], before[3], after[3], along[3];
        double depth = 0, t = 0, mass = 0, cosine = 0;
        float u[4], normal[3], turned[3];
        cln_camera c;

        cln_check_forward_camera(i / 3, &forward, 40, 30, &c);
        cln_uniform4(3, CLN_STREAM_SCENE, 0, (uint32_t)i, 0, u);
        assert_true(cln_camera_ray(&c, 40 * (double)u[0], 30 * (double)u[1], o, d));
        cln_space_ray_to_cube(&forward, o, d, q, e);
        assert_true(cln_space_met_by(&forward, o, d));
        assert_near(e[0] * e[0] + e[1] * e[1] + e[2] * e[2], 1, 1e-14);
        /* it begins at the near plane, or at the camera */
        cln_space_point_to_scene(&forward, q, back);
        depth = length_between(o, back) / forward.half;
        if (i / 3 % 4 == 3)
            assert_near(depth, 0, 1e-13);
        else
            assert_near(q[2], -1, 1e-15);
        depth += 0.01 * pow(5e4, (double)u[2]);
        add_scaled(o, forward.half * depth, d, at);
        cln_space_point_to_cube(&forward, at, cube);
        cln_space_depth_to_cube(&forward, o, d, depth, back);
        assert_near(length_between(cube, back), 0, 1e-15);
        /* on the ray of the cube, ahead */
        for (int a = 0; a < 3; a++)
            t += (cube[a] - q[a]) * e[a];
        assert_true(t > 0);
        add_scaled(q, t, e, back);
        assert_near(length_between(cube, back), 0, 1e-14);
        cln_space_point_to_scene(&forward, cube, back);
        assert_true(length_between(at, back) < 1e-12 * depth * forward.half);
        /* the direction there is the ray's, whatever the point of it */
        cln_space_direction_to_cube(&forward, at, d, along);
        assert_near(length_between(e, along), 0, 1e-13);
        /* sigma ds is the same on both sides */
        add_scaled(o, forward.half * depth * (1 - 1e-6), d, before);
        add_scaled(o, forward.half * depth * (1 + 1e-6), d, after);
        mass = cln_space_density_to_scene(&forward, at, d, 7) * length_between(before, after);
        cln_space_point_to_cube(&forward, before, before);
        cln_space_point_to_cube(&forward, after, after);
        assert_true(fabs(mass / (7 * length_between(before, after)) - 1) < 1e-5);
        /* a plane's normal stays at right angles to what lies in the plane */
        for (int a = 0; a < 3; a++)
            normal[a] = u[a] - 0.5f;
        for (int a = 0; a < 3; a++) /* a direction in the plane */
            along[a] = (double)normal[(a + 1) % 3] * e[(a + 2) % 3] -
                       (double)normal[(a + 2) % 3] * e[(a + 1) % 3];
        cln_space_normal_to_scene(&forward, cube, normal, turned);
        add_scaled(cube, -1e-7, along, before);
        add_scaled(cube, 1e-7, along, after);
        cln_space_point_to_scene(&forward, before, before);
        cln_space_point_to_scene(&forward, after, after);
        for (int a = 0; a < 3; a++)
            cosine += (after[a] - before[a]) * (double)turned[a] / length_between(before, after);
        assert_near(cosine, 0, 2e-5);
        /* and on its side */
        add_scaled(cube, 1e-7, (double[3]){normal[0], normal[1], normal[2]}, after);
        cln_space_point_to_scene(&forward, after, after);
        cosine = 0;
        for (int a = 0; a < 3; a++)
            cosine += (after[a] - at[a]) * (double)turned[a];
        assert_true(cosine > 0);
    }
}

/* A point is in a box if it is inside of all of its planes. */
static void test_boxes(void **state)
{
    static const double box[6] = {8.5, -22.5, -1, 12, -19.5, 1e30};
    const cln_space forward = cln_check_forward_space(2);
    int inside = 0, outside = 0;

    (void)state;
    for (int i = 0; i < 2000; i++) {
        const cln_space *of = i % 2 ? &forward : &space;
        /* before and behind the points that the forward space sees */
        double bounds[6] = {-6, -6, 4, 3, 0, 1e30}, at[3], cube[3];
        float planes[6][4], u[4];
        bool in = true, found = true, near = false;

        if (of == &space)
            memcpy(bounds, box, sizeof bounds);
        cln_uniform4(4, CLN_STREAM_SCENE, 0, (uint32_t)i, 0, u);
        for (int a = 0; a < 3; a++)
            cube[a] = 2 * (double)u[a] - 1;
        cln_space_point_to_scene(of, cube, at);
        cln_space_box_to_planes(of, bounds, planes);
        for (int k = 0; k < 6; k++) {
            const double here = (double)planes[k][0] * cube[0] + (double)planes[k][1] * cube[1] +
                                (double)planes[k][2] * cube[2] + (double)planes[k][3];

            near = near || fabs(here) < 1e-5;
            found = found && here >= 0;
            in = in && (k < 3 ? at[k] >= bounds[k] : at[k - 3] <= bounds[k]);
        }
        if (near)
            continue;
        if (in != found)
            fail_msg("%g, %g, %g: in the box %d, inside its planes %d", at[0], at[1], at[2], in,
                     found);
        inside += in;
        outside += !in;
    }
    assert_true(inside > 100 && outside > 100);
}

static void test_forward_equality(void **state)
{
    const cln_space forward = cln_check_forward_space(1),
                    cube = {.centre = {2, -1, 0.5}, .half = 1.5};
    cln_space other = forward;

    (void)state;
    assert_true(cln_space_equal(&forward, &other));
    other.axes[4] += 1e-5;
    assert_false(cln_space_equal(&forward, &other));
    other = forward;
    other.scale[1] *= 1.00001;
    assert_false(cln_space_equal(&forward, &other));
    assert_false(cln_space_equal(&forward, &cube));
    assert_false(cln_space_equal(&cube, &forward));
}

/* Three photos for training and one for tests: a pixel is distance / (fx half) wide, the median
 * counts, and focal lengths of the middle one decide. A forward space has no middle. */
static void test_pixel_width(void **state)
{
    cln_view views[4] = {{0}};
    const cln_scene scene = {.views = views, .view_count = 4};
    const cln_space cube = {.centre = {1, 2, 3}, .half = 2};
    const cln_space ahead = {.half = 1, .forward = true};
    const double distance[4] = {10, 4, 60, 1000}, fx[4] = {100, 200, 300, 1};
    double width = -1, poses[3][12] = {{0}};

    (void)state;
    for (int v = 0; v < 4; v++) {
        views[v].split = v < 3 ? CLN_SPLIT_TRAIN : CLN_SPLIT_TEST;
        views[v].camera.fx = fx[v];
        for (int a = 0; a < 3; a++)
            views[v].camera.c2w[4 * a + 3] = cube.centre[a] + (a == v % 3 ? distance[v] : 0);
    }
    assert_int_equal(cln_scene_pixel_width(&scene, NULL, &cube, &width), CLN_OK);
    assert_true(fabs(width - 0.05) < 1e-15); /* of 0.05, 0.01, 0.1 */
    for (int v = 0; v < 3; v++) {
        memcpy(poses[v], views[v].camera.c2w, sizeof poses[v]);
        poses[v][4 * (v % 3) + 3] += distance[v]; /* twice as far */
    }
    assert_int_equal(cln_scene_pixel_width(&scene, (const double(*)[12])poses, &cube, &width),
                     CLN_OK);
    assert_true(fabs(width - 0.1) < 1e-15);
    assert_int_equal(cln_scene_pixel_width(&scene, NULL, &ahead, &width), CLN_OK);
    assert_true(width == 0);
}

/* Of four photos for training one looks away and one past the point: the larger of the other two
 * counts. A cell's edge along the line of sight has no width; far out in a shell a cell is
 * wider. */
static void test_cell_pixels(void **state)
{
    cln_view views[4] = {{0}};
    const cln_scene scene = {.views = views, .view_count = 4};
    const cln_space cube = {.centre = {1, 2, 3}, .half = 2};
    const cln_space shell = {.centre = {1, 2, 3}, .half = 2, .shell = true};
    const double middle[3] = {0, 0, 0}, out[3] = {0, 0, 0.9}, distance[4] = {10, 5, 5, 5};
    double each[4];

    (void)state;
    for (int v = 0; v < 4; v++) {
        cln_camera *c = &views[v].camera;

        views[v].split = CLN_SPLIT_TRAIN;
        c->fx = c->fy = 100;
        c->width = c->height = 80;
        c->cx = c->cy = 40;
        for (int a = 0; a < 3; a++) /* looks along z, the second one back */
            c->c2w[5 * a] = a == 0 || v != 1 ? 1 : -1;
        for (int a = 0; a < 3; a++)
            c->c2w[4 * a + 3] = cube.centre[a] - (a == 2 ? distance[v] : 0);
        if (v == 2)
            c->c2w[3] += 4.1;
    }
    /* 0.1 of a half side is 0.2 units: 4 and 2 pixels */
    assert_float_equal(cln_scene_cell_pixels(&scene, &cube, middle, 0.1, each), 4, 1e-12);
    views[3].split = CLN_SPLIT_TEST;
    assert_float_equal(cln_scene_cell_pixels(&scene, &cube, middle, 0.1, each), 2, 1e-12);
    assert_true(cln_scene_cell_pixels(&scene, &shell, out, 0.1, each) >
                1.1 * cln_scene_cell_pixels(&scene, &cube, out, 0.1, each));
    views[0].camera.c2w[10] = -1;
    assert_true(isinf(cln_scene_cell_pixels(&scene, &cube, middle, 0.1, each)));
}

int test_group_space(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_hand),
        cmocka_unit_test(test_one_map),
        cmocka_unit_test(test_faces_and_equality),
        cmocka_unit_test(test_forward_by_hand),
        cmocka_unit_test(test_forward_map),
        cmocka_unit_test(test_boxes),
        cmocka_unit_test(test_forward_equality),
        cmocka_unit_test(test_pixel_width),
        cmocka_unit_test(test_cell_pixels),
    };

    return cmocka_run_group_tests_name("space", tests, NULL, NULL);
}
