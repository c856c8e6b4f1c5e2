/* rays.cl against the double camera of host/scene/camera.c: origin, unit direction and axis
 * scale of rays through pixels of pinhole and distorted cameras, in scenes of 1e-4 and 1e6
 * units. test_sampling.c tests which leaves a ray meets. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "device_test.h"
#include "scene/scene.h"
#include "tests.h"

enum { VIEWS = 5, RAYS = 331 };

/* A camera that looks at the centre from somewhere, upright or not. */
static void make_camera(int i, bool distorted, const cln_space *space, cln_camera *c)
{
    double back[3], right[3], down[3], length = 0;

    memset(c, 0, sizeof *c);
    for (int a = 0; a < 3; a++) {
        back[a] = test_uniform(1, 3 * i + a, -1, 1);
        length += back[a] * back[a];
    }
    for (int a = 0; a < 3; a++)
        back[a] /= sqrt(length);
    if (i == 0) { /* straight along an axis: zeros in the rotation */
        back[0] = back[1] = 0;
        back[2] = 1;
    }
    right[0] = -back[2];
    right[1] = 0;
    right[2] = back[0];
    length = sqrt(right[0] * right[0] + right[2] * right[2]);
    right[0] /= length;
    right[2] /= length;
    down[0] = -(back[1] * right[2] - back[2] * right[1]);
    down[1] = -(back[2] * right[0] - back[0] * right[2]);
    down[2] = -(back[0] * right[1] - back[1] * right[0]);
    for (int a = 0; a < 3; a++) {
        c->c2w[4 * a] = right[a];
        c->c2w[4 * a + 1] = down[a];
        c->c2w[4 * a + 2] = -back[a];
        c->c2w[4 * a + 3] = space->centre[a] + space->half * (2 + i) * back[a];
    }
    c->width = 160 + 17 * i;
    c->height = 120;
    c->fx = 150 + 10 * i;
    c->fy = 145 + 12 * i;
    c->cx = 0.5 * c->width + i;
    c->cy = 0.5 * c->height - i;
    if (distorted) {
        c->k1 = 0.05 - 0.04 * i;
        c->k2 = 0.01 * i - 0.02;
        c->p1 = 0.002 * i;
        c->p2 = -0.001 * i;
    }
}

static void check_rays(int set, bool distorted, double unit)
{
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[set], &config, distorted, false);
    const cln_space space = {{3 * unit, -2 * unit, 0.5 * unit}, 1.5 * unit};
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[VIEWS];
    const cln_camera *list[VIEWS];
    cln_pixel pixels[RAYS];
    float(*o)[4] = NULL, (*d)[4] = NULL, got[7 * RAYS];
    double want[7 * RAYS];

    for (int i = 0; i < VIEWS; i++) {
        make_camera(i, distorted, &space, &cameras[i]);
        list[i] = &cameras[i];
    }
    for (int r = 0; r < RAYS; r++) { /* corners first, then anywhere */
        const cln_camera *c = &cameras[r % VIEWS];
        const uint32_t w = (uint32_t)c->width, h = (uint32_t)c->height;

        pixels[r] = (cln_pixel){.view = (uint32_t)(r % VIEWS)};
        pixels[r].x = r < 20 ? (r / 5 % 2) * (w - 1) : (uint32_t)test_uniform(2, r, 0, w);
        pixels[r].y = r < 20 ? (r / 10) * (h - 1) : (uint32_t)test_uniform(3, r, 0, h);
    }
    assert_ok(cln_pipeline_cameras(p, list, VIEWS, &space));
    assert_ok(cln_pipeline_batch(p, pixels, RAYS, NULL, white));
    test_fill(p->device, &p->ray_o, NULL, sizeof *o * RAYS);
    test_fill(p->device, &p->ray_d, NULL, sizeof *d * RAYS);
    assert_ok(cln_stage_rays(p, RAYS));
    o = test_read(p->device, &p->ray_o, sizeof *o * RAYS, "ray_o");
    d = test_read(p->device, &p->ray_d, sizeof *d * RAYS, "ray_d");
    for (int r = 0; r < RAYS; r++) {
        const cln_camera *c = &cameras[pixels[r].view];
        double origin[3], direction[3], axis = 0, length = 0;

        assert_true(cln_camera_ray(c, pixels[r].x + 0.5, pixels[r].y + 0.5, origin, direction));
        for (int a = 0; a < 3; a++) {
            want[7 * r + a] = (origin[a] - space.centre[a]) / space.half;
            got[7 * r + a] = o[r][a];
            want[7 * r + 3 + a] = direction[a];
            got[7 * r + 3 + a] = d[r][a];
            axis += direction[a] * c->c2w[4 * a + 2];
            length += (double)d[r][a] * d[r][a];
        }
        want[7 * r + 6] = axis;
        got[7 * r + 6] = d[r][3];
        if (!(fabs(length - 1) < 1e-6))
            fail_msg("ray %d has length %.9g", r, sqrt(length));
    }
    /* 2e-6 of a direction of size 1 is 3e-4 pixels here; Newton's method in float32 leaves less. */
    compare(distorted ? "distorted rays" : "pinhole rays", got, want, 7 * RAYS,
            (bounds){1e-13, 2e-6});
    free(o);
    free(d);
}

static void test_cameras(void **state)
{
    static const double units[] = {1, 1e-4, 1e6};

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        for (int distorted = 0; distorted < 2; distorted++)
            check_rays(set, distorted, units[(set + distorted) % 3]);
    }
    test_report("rays");
}

/* The last pixel of a batch is the last that is written; no rays are none. */
static void test_few_rays(void **state)
{
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[4], &config, false, false);
    const float white[4] = {1, 1, 1, 1};
    cln_camera camera;
    const cln_camera *list = &camera;

    (void)state;
    make_camera(1, false, &cln_space_unit, &camera);
    assert_ok(cln_pipeline_cameras(p, &list, 1, &cln_space_unit));
    for (int n = 0; n < 3; n++) {
        const cln_pixel pixels[3] = {{0, 1, 2, 0}, {0, 3, 4, 0}, {0, 5, 6, 0}};
        float(*d)[4] = NULL;

        assert_ok(cln_pipeline_batch(p, pixels, n, NULL, white));
        test_fill(p->device, &p->ray_o, NULL, (size_t)n * sizeof *d);
        test_fill(p->device, &p->ray_d, NULL, (size_t)n * sizeof *d);
        assert_ok(cln_stage_rays(p, n));
        free(test_read(p->device, &p->ray_o, (size_t)n * sizeof *d, "ray_o"));
        d = test_read(p->device, &p->ray_d, (size_t)n * sizeof *d, "ray_d");
        for (int r = 0; r < n; r++)
            assert_true(isfinite(d[r][0]) && d[r][3] > 0);
        free(d);
    }
}

int test_group_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cameras),
        cmocka_unit_test(test_few_rays),
    };

    return cmocka_run_group_tests_name("rays", tests, NULL, test_device_close);
}
