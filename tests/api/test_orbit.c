/* Orbits: their cameras, the arc that they keep to where training cameras cover only one, and a
 * render of one from a run. */
#include "unit.h"
#include <math.h>
#include "run_fixture.h"
#include "io/image.h"
#include "render/orbit.h"
#include "tests.h"

static double dot(const double *c2w, int a, int b)
{
    return c2w[a] * c2w[b] + c2w[4 + a] * c2w[4 + b] + c2w[8 + a] * c2w[8 + b];
}

/* Each camera has a right-handed rotation, is at its distance and elevation, and shows the target
 * upright in the middle of its picture. */
static void check_orbit(const cln_orbit_frame *frame, const cln_render_desc *desc, double elevation)
{
    cln_orbit orbit;
    const double above[3] = {0, 0, 0.1}, middle[3] = {0, 0, 0};

    assert_ok(cln_orbit_make(frame, desc, &orbit));
    for (int i = 0; i < 7; i++) {
        cln_camera c;
        double u = 0, v = 0, z = 0, distance = 0;

        cln_orbit_camera(&orbit, i, 7, &c);
        for (int a = 0; a < 3; a++) {
            for (int b = 0; b < 3; b++)
                assert_true(fabs(dot(c.c2w, a, b) - (a == b)) < 1e-12);
            distance += c.c2w[4 * a + 3] * c.c2w[4 * a + 3];
        }
        assert_true(fabs(c.c2w[0] * (c.c2w[5] * c.c2w[10] - c.c2w[6] * c.c2w[9]) -
                         c.c2w[1] * (c.c2w[4] * c.c2w[10] - c.c2w[6] * c.c2w[8]) +
                         c.c2w[2] * (c.c2w[4] * c.c2w[9] - c.c2w[5] * c.c2w[8]) - 1) < 1e-12);
        assert_true(fabs(sqrt(distance) - 4 * desc->orbit_radius) < 1e-6);
        assert_true(fabs(c.c2w[11] - 4 * desc->orbit_radius * sin(elevation)) < 1e-6);
        assert_true(cln_camera_project(&c, middle, &u, &v, &z));
        assert_true(fabs(u - 0.5 * c.width) < 1e-6 && fabs(v - 0.5 * c.height) < 1e-6);
        assert_true(cln_camera_project(&c, above, &u, &v, &z));
        assert_true(v < 0.5 * c.height - (elevation < 1.5 ? 0.1 : -1e-6));
    }
}

static void test_orbit_cameras(void **state)
{
    const cln_config config = fixture_config();
    const cln_scene_desc scene_desc = {.path = fixture_path("scene"), .config = &config};
    cln_render_desc desc = {.orbit_frames = 7, .orbit_elevation = 25, .orbit_radius = 1.25};
    cln_scene *scene = NULL;
    cln_orbit_frame frame;
    cln_orbit orbit;

    (void)state;
    assert_ok(cln_scene_load(&scene_desc, &scene));
    assert_ok(cln_orbit_frame_of(scene, (const double[3]){0}, &frame));
    assert_true(frame.to - frame.from == 360); /* six cameras all around */
    check_orbit(&frame, &desc, 25 * 3.14159265358979 / 180);
    desc.orbit_elevation = 90;
    check_orbit(&frame, &desc, 3.14159265358979 / 2);
    assert_ok(cln_orbit_make(&frame, &desc, &orbit));
    assert_int_equal(orbit.lens.width, SIDE);
    assert_true(fabs(orbit.lens.fx - scene->views[0].camera.fx) < 1e-9);
    desc.width = 3 * SIDE; /* keeps the aspect ratio and the field of view */
    assert_ok(cln_orbit_make(&frame, &desc, &orbit));
    assert_int_equal(orbit.lens.height, 3 * SIDE);
    assert_true(fabs(orbit.lens.fx - 3 * scene->views[0].camera.fx) < 1e-9);
    desc.height = 50;
    desc.fov = 90;
    assert_ok(cln_orbit_make(&frame, &desc, &orbit));
    assert_int_equal(orbit.lens.height, 50);
    assert_true(fabs(orbit.lens.fx - 1.5 * SIDE) < 1e-9);
    desc.width = desc.height = 30000;
    assert_fails(cln_orbit_make(&frame, &desc, &orbit), CLN_USAGE, "30000");
    cln_scene_free(scene);
}

/* Cameras at these azimuths, 10 degrees above the horizon and 4 from the origin. */
static void put_ring(cln_scene *scene, cln_view *views, int count, const double *degrees)
{
    memset(scene, 0, sizeof *scene);
    memset(views, 0, (size_t)count * sizeof *views);
    scene->views = views;
    scene->view_count = count;
    scene->space.half = 5;
    for (int i = 0; i < count; i++) {
        double m[3][4];
        cln_camera *c = &views[i].camera;

        fixture_pose(degrees[i] * 0.017453292519943295, sin(10 * 0.017453292519943295), m);
        for (int a = 0; a < 3; a++) { /* OpenGL's axes to OpenCV's */
            c->c2w[4 * a] = m[a][0];
            c->c2w[4 * a + 1] = -m[a][1];
            c->c2w[4 * a + 2] = -m[a][2];
            c->c2w[4 * a + 3] = m[a][3];
        }
        c->width = c->height = SIDE;
        c->fx = c->fy = SIDE;
    }
}

/* Azimuth and elevation of a camera of the orbit, degrees; east is at the first of the ring. */
static double azimuth_of(const cln_camera *c, double east, double *elevation)
{
    const double turn = atan2(c->c2w[7], c->c2w[3]) / 0.017453292519943295 - east;

    *elevation = asin(c->c2w[11] / 4) / 0.017453292519943295;
    return turn - 360 * floor((turn + 180) / 360);
}

static int warnings_of_orbit(const cln_orbit_frame *frame, const cln_render_desc *desc,
                             cln_orbit *orbit)
{
    int count = 0;

    cln_log_set_sink(scratch_count_warnings, &count);
    assert_ok(cln_orbit_make(frame, desc, orbit));
    cln_log_set_sink(fixture_no_log, NULL);
    return count;
}

/* Where cameras stand in an arc, the path swings through it, from end to end, and leaves it only
 * when told; a frame read back from JSON gives the same bits. */
static void test_orbit_keeps_to_the_arc(void **state)
{
    const double degrees[] = {150, 90, 120, 180, 200}; /* the gap, 250 degrees, is behind */
    cln_render_desc desc = {.orbit_elevation = NAN};
    cln_view views[5];
    cln_scene scene;
    cln_orbit_frame frame, again;
    cln_orbit orbit;
    json_t *saved = NULL;
    char *text = NULL;
    double low = 1e9, high = -1e9, elevation = 0;

    (void)state;
    put_ring(&scene, views, 5, degrees);
    assert_ok(cln_orbit_frame_of(&scene, (const double[3]){0}, &frame));
    assert_true(fabs(frame.from - -60) < 0.5 && fabs(frame.to - 50) < 0.5);
    assert_true(fabs(frame.elevation - 10) < 0.5 && fabs(frame.distance - 4) < 1e-9);
    assert_int_equal(warnings_of_orbit(&frame, &desc, &orbit), 0);
    for (int i = 0; i < 8; i++) {
        cln_camera c, back;
        double at = 0;

        cln_orbit_camera(&orbit, i, 8, &c);
        cln_orbit_camera(&orbit, (8 - i) % 8, 8, &back);
        assert_memory_equal(&c, &back, sizeof c);
        at = azimuth_of(&c, 150, &elevation);
        low = fmin(low, at);
        high = fmax(high, at);
        assert_true(fabs(elevation - 10) < 0.5);
    }
    assert_true(fabs(low - -60) < 0.5 && fabs(high - 50) < 0.5);
    saved = cln_orbit_frame_json(&frame);
    text = json_dumps(saved, JSON_REAL_PRECISION(17));
    json_decref(saved);
    saved = fixture_parse(text);
    assert_ok(cln_orbit_frame_read(saved, &again));
    assert_memory_equal(&frame, &again, sizeof frame);
    json_object_del(saved, "up");
    assert_fails(cln_orbit_frame_read(saved, &again), CLN_INPUT, "orbit");
    json_decref(saved);
    desc.orbit_circle = true;
    assert_int_equal(warnings_of_orbit(&frame, &desc, &orbit), 1);
    low = 0;
    for (int i = 0; i < 8; i++) {
        cln_camera c;

        cln_orbit_camera(&orbit, i, 8, &c);
        low = fmax(low, fabs(azimuth_of(&c, 150, &elevation)));
    }
    assert_true(low > 179);
}

static void test_orbit_renders(void **state)
{
    cln_render_desc desc = {
        .run = fixture_path("whole"), .out = fixture_path("orbit"), .device = fixture_device()};
    cln_render_result result;
    int width = 0, height = 0, channels = 0;

    NEED_DEVICE();
    desc.orbit_frames = 2;
    desc.orbit_elevation = 20;
    desc.orbit_radius = 1;
    desc.width = 20;
    desc.height = 12;
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.rendered, 2);
    assert_ok(cln_image_info(fixture_path("orbit/orbit_0001.png"), &width, &height, &channels));
    assert_int_equal(width, 20);
    assert_int_equal(height, 12);
    assert_ok(cln_render(&desc, &result));
    assert_int_equal(result.skipped, 2);
}

int test_group_orbit(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_orbit_cameras),
        cmocka_unit_test(test_orbit_keeps_to_the_arc),
        cmocka_unit_test(test_orbit_renders),
    };

    return cmocka_run_group_tests_name("orbit", tests, fixture_setup, fixture_teardown);
}
