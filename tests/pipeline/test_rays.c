/* rays.cl against the double camera of host/scene/camera.c: origin, unit direction and axis
 * scale of rays through pixels of pinholes and of every lens model, alone and in one scene, in
 * scenes of 1e-4 and 1e6 units. tests/check/test_extremes.c has far cameras, pixels beyond a lens'
 * fold, and forward spaces; test_sampling.c tests which leaves a ray meets. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "device_test.h"
#include "scene/scene.h"
#include "tests.h"

enum { VIEWS = 18, RAYS = 613, PINHOLE = -1 };

/* Lenses whose models hold over the whole image, with its size in focal lengths. */
static const struct {
    int lens; /* or PINHOLE */
    double params[CLN_LENS_PARAMS], wide;
} lenses[] = {
    {PINHOLE, {0}, 1},
    {CLN_LENS_OPENCV, {0.05, -0.02, 0.002, -0.001}, 1},
    {CLN_LENS_OPENCV, {-0.07, 0.02, 0.006, -0.003}, 1},
    {CLN_LENS_OPENCV, {-0.28, 0.11, 0.0012, -0.0021}, 1.4},
    {CLN_LENS_OPENCV, {2, 0, 0, 0}, 1.5},
    {CLN_LENS_OPENCV, {-0.2, 0, 0, 0}, 1.2}, /* the corners are near the fold */
    {CLN_LENS_FULL_OPENCV, {0.9, 0.35, -0.0007, 0.0004, 0.05, 1.25, 0.4, 0.08}, 1.6},
    {CLN_LENS_OPENCV_FISHEYE, {0}, 4.5}, /* more than half of the sphere */
    {CLN_LENS_OPENCV_FISHEYE, {-0.021, 0.0045, -0.0012, 0.00009}, 3},
    {CLN_LENS_THIN_PRISM_FISHEYE,
     {-0.031, 0.006, 0.0011, -0.0008, -0.0009, 0.00004, 0.0013, -0.0017},
     3},
    {CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     {0.39, -0.37, -0.12, 0.38, -0.24, 0.047, 0.0006, -0.0004, 0.0002, -0.0003, 0.0005, -0.0001},
     1.4},
    {CLN_LENS_FOV, {0.93}, 2},
    {CLN_LENS_DIVISION, {-0.3}, 4},
    {CLN_LENS_DIVISION, {0.1}, 2},
    {CLN_LENS_EUCM, {0.62, 1.09}, 2.4},
    {CLN_LENS_EUCM, {0.4, 0.9}, 4},
    {CLN_LENS_EQUIRECTANGULAR, {0}, 6.283185},
    {PINHOLE, {0}, 23}, /* 170 degrees */
};
_Static_assert(sizeof lenses / sizeof *lenses == VIEWS, "a view of every row");

/* A camera that looks at the centre from somewhere, upright or not. */
static void make_camera(int i, int row, const cln_space *space, cln_camera *c)
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
    c->width = 160 + 7 * i;
    c->height = 120;
    c->fx = c->width / lenses[row].wide;
    c->fy = 0.97 * c->fx;
    c->cx = 0.5 * c->width + (lenses[row].lens == CLN_LENS_EQUIRECTANGULAR ? 0 : 0.1 * i);
    c->cy = 0.5 * c->height - 0.1 * i;
    c->lens = lenses[row].lens == PINHOLE ? CLN_LENS_OPENCV : (cln_lens)lenses[row].lens;
    memcpy(c->distortion, lenses[row].params, sizeof c->distortion);
}

/* Rays of a scene whose cameras have these lens models, in a pipeline that knows no other. */
static void check_rays(int set, unsigned models, double unit)
{
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[set], &config, models, false);
    const cln_space space = {.centre = {3 * unit, -2 * unit, 0.5 * unit}, .half = 1.5 * unit};
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[VIEWS];
    const cln_camera *list[VIEWS];
    cln_pixel pixels[RAYS];
    float(*o)[4] = NULL, (*d)[4] = NULL, got[7 * RAYS];
    double want[7 * RAYS];
    int views = 0;

    for (int row = 0; row < VIEWS; row++)
        if (lenses[row].lens == PINHOLE || models >> lenses[row].lens & 1) {
            make_camera(views, row, &space, &cameras[views]);
            list[views] = &cameras[views];
            views++;
        }
    for (int r = 0; r < RAYS; r++) { /* corners first, then anywhere */
        const int corner = r / views;
        const cln_camera *c = &cameras[r % views];
        const uint32_t w = (uint32_t)c->width, h = (uint32_t)c->height;

        pixels[r] = (cln_pixel){.view = (uint32_t)(r % views)};
        pixels[r].x = corner < 4 ? corner % 2 * (w - 1) : (uint32_t)test_uniform(2, r, 0, w);
        pixels[r].y = corner < 4 ? corner / 2 * (h - 1) : (uint32_t)test_uniform(3, r, 0, h);
    }
    assert_ok(cln_pipeline_cameras(p, list, views, &space));
    assert_ok(cln_pipeline_batch(p, pixels, RAYS, NULL, white));
    test_fill(p->device, &p->ray_o, NULL, sizeof *o * RAYS);
    test_fill(p->device, &p->ray_d, NULL, sizeof *d * RAYS);
    assert_ok(cln_stage_rays(p, RAYS));
    o = test_read(p->device, &p->ray_o, sizeof *o * RAYS, "ray_o");
    d = test_read(p->device, &p->ray_d, sizeof *d * RAYS, "ray_d");
    for (int r = 0; r < RAYS; r++) {
        const cln_camera *c = &cameras[pixels[r].view];
        double origin[3], direction[3], axis = 0, length = 0;

        if (!cln_camera_ray(c, pixels[r].x + 0.5, pixels[r].y + 0.5, origin, direction))
            fail_msg("%s has no ray at %u, %u", cln_lens_models[c->lens].name, pixels[r].x,
                     pixels[r].y);
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
    compare(models ? "rays behind a lens" : "pinhole rays", got, want, 7 * RAYS,
            (bounds){1e-13, 2e-6});
    free(o);
    free(d);
}

static void test_cameras(void **state)
{
    static const double units[] = {1, 1e-4, 1e6};

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++) {
        check_rays(set, 0, units[set % 3]);
        check_rays(set, 1u << CLN_LENS_OPENCV, units[(set + 1) % 3]);
    }
    check_rays(0, (1u << CLN_LENSES) - 1, 1);
    check_rays(4, 1u << CLN_LENS_OPENCV_FISHEYE, 1); /* and pinholes */
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
    make_camera(1, 0, &cln_space_unit, &camera);
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

    test_wanted = CLN_PROGRAM_BIT(rays);
    return cmocka_run_group_tests_name("rays", tests, NULL, test_device_close);
}
