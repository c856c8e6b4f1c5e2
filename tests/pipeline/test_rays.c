/* rays.cl against the double camera of host/scene/camera.c: origin, unit direction and axis
 * scale of rays through pixels of pinholes and of every lens model, alone and in one scene, in
 * scenes of 1e-4 and 1e6 units; pixels beyond a lens' fold; forward spaces. test_sampling.c tests
 * which leaves a ray meets. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include "device_test.h"
#include "forward_fixture.h"
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

/* Lenses whose image holds pixels beyond the fold. Near it host and device may differ: it is where
 * the place of a direction stands still. */
static void test_beyond_fold(void **state)
{
    static const struct {
        cln_lens lens;
        double params[CLN_LENS_PARAMS], wide, share; /* of the pixels that have rays: about */
    } folds[] = {
        {CLN_LENS_OPENCV, {-0.5}, 1.6, 0.363},
        {CLN_LENS_OPENCV, {-0.4, 0.05, -0.03, 0.02}, 1.8, 0.41},
        {CLN_LENS_FULL_OPENCV, {-0.4, 0, 0, 0, 0, 0.1}, 1.5, 0.444},
        {CLN_LENS_OPENCV_FISHEYE, {-0.1}, 3, 0.517},
        {CLN_LENS_FOV, {1.5}, 2.5, 0.551},
        {CLN_LENS_DIVISION, {0.25}, 4.5, 0.62},
        {CLN_LENS_EUCM, {1, 1}, 2.2, 0.649},
    };
    enum { FOLDS = sizeof folds / sizeof *folds, SIDE = 48, PIXELS = FOLDS * SIDE * SIDE };
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, (1u << CLN_LENSES) - 1, false);
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[FOLDS];
    const cln_camera *list[FOLDS];
    cln_pixel *pixels = test_alloc(PIXELS, sizeof *pixels);
    float(*o)[4] = NULL, (*d)[4] = NULL;

    (void)state;
    for (int i = 0; i < FOLDS; i++) {
        make_camera(i, 0, &cln_space_unit, &cameras[i]);
        cameras[i].lens = folds[i].lens;
        memcpy(cameras[i].distortion, folds[i].params, sizeof cameras[i].distortion);
        cameras[i].width = cameras[i].height = SIDE;
        cameras[i].fx = cameras[i].fy = SIDE / folds[i].wide;
        cameras[i].cx = cameras[i].cy = SIDE / 2;
        list[i] = &cameras[i];
    }
    for (uint32_t r = 0; r < PIXELS; r++)
        pixels[r] = (cln_pixel){r / (SIDE * SIDE), r % SIDE, r / SIDE % SIDE, 0};
    assert_ok(cln_pipeline_cameras(p, list, FOLDS, &cln_space_unit));
    assert_ok(cln_pipeline_batch(p, pixels, PIXELS, NULL, white));
    test_fill(p->device, &p->ray_o, NULL, sizeof *o * PIXELS);
    test_fill(p->device, &p->ray_d, NULL, sizeof *d * PIXELS);
    assert_ok(cln_stage_rays(p, PIXELS));
    o = test_read(p->device, &p->ray_o, sizeof *o * PIXELS, "ray_o");
    d = test_read(p->device, &p->ray_d, sizeof *d * PIXELS, "ray_d");
    for (int i = 0; i < FOLDS; i++) {
        int rays = 0, differ = 0;

        for (int r = i * SIDE * SIDE; r < (i + 1) * SIDE * SIDE; r++) {
            double origin[3], direction[3];
            const bool found = cln_camera_ray(&cameras[i], pixels[r].x + 0.5, pixels[r].y + 0.5,
                                              origin, direction);
            const bool sees = o[r][0] != 3;
            double off = 0;

            /* marked so that it meets nothing */
            assert_true(sees || (o[r][1] == 3 && d[r][0] == 1 && d[r][1] == 0 && d[r][2] == 0));
            rays += found;
            for (int a = 0; a < 3; a++)
                off = fmax(off, fabs((double)d[r][a] - direction[a]));
            differ += found != sees || (found && off > 1e-3);
        }
        if (differ > 8 || fabs((double)rays / (SIDE * SIDE) - folds[i].share) > 0.03)
            fail_msg("fold %d: %d rays of %d, %d differ", i, rays, SIDE * SIDE, differ);
    }
    free(pixels);
    free(o);
    free(d);
}

/* Cameras 10 to 10^6 half-cubes away, in the middle of the image and off its axis, with a pinhole
 * and behind lenses: near the cube, rays are where the double camera's are, to a fraction of the
 * deepest leaf and of a pixel; depths are right; points project to their pixels. */
static void test_far_cameras(void **state)
{
    enum { FAR = 12, EACH = 60 };
    const cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, (1u << CLN_LENSES) - 1, false);
    static const cln_lens kinds[] = {CLN_LENS_OPENCV, CLN_LENS_OPENCV_FISHEYE, CLN_LENS_EUCM};
    const cln_space space = {.centre = {4.5e5, 5.4e6, 120}, .half = 0.5}; /* metres of UTM */
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[FAR];
    const cln_camera *list[FAR];
    cln_pixel pixels[FAR * EACH];
    float(*o)[4] = NULL, (*d)[4] = NULL;

    (void)state;
    for (int i = 0; i < FAR; i++) {
        const double distance = pow(10, 1 + i / 2), aside = i % 2 ? 0.6 : 0;
        cln_camera *c = &cameras[i];
        double axis[3], x[3];

        make_camera(1, 0, &cln_space_unit, c);
        for (int a = 0; a < 3; a++) {
            axis[a] = c->c2w[4 * a + 2];
            x[a] = c->c2w[4 * a];
        }
        for (int a = 0; a < 3; a++)
            c->c2w[4 * a + 3] = space.centre[a] - space.half * distance * (axis[a] + aside * x[a]);
        c->width = c->height = 500;
        c->fx = c->fy = 100 * distance; /* the cube has 200 to 350 pixels */
        c->cx = c->cy = 250;
        c->lens = kinds[i % 3];
        memset(c->distortion, 0, sizeof c->distortion);
        if (c->lens == CLN_LENS_EUCM) {
            c->distortion[0] = 0.5;
            c->distortion[1] = 1;
        }
        if (aside > 0) { /* the image is a part of a larger one */
            double u = 0, v = 0, z = 0;

            assert_true(cln_camera_project(c, space.centre, &u, &v, &z));
            c->cx += 250 - u;
            c->cy += 250 - v;
        }
        list[i] = c;
    }
    for (int r = 0; r < FAR * EACH; r++) {
        pixels[r] = (cln_pixel){.view = (uint32_t)(r / EACH)};
        pixels[r].x = (uint32_t)test_uniform(4, r, 150, 350);
        pixels[r].y = (uint32_t)test_uniform(5, r, 150, 350);
    }
    assert_ok(cln_pipeline_cameras(p, list, FAR, &space));
    assert_ok(cln_pipeline_batch(p, pixels, FAR * EACH, NULL, white));
    test_fill(p->device, &p->ray_o, NULL, sizeof *o * FAR * EACH);
    test_fill(p->device, &p->ray_d, NULL, sizeof *d * FAR * EACH);
    assert_ok(cln_stage_rays(p, FAR * EACH));
    o = test_read(p->device, &p->ray_o, sizeof *o * FAR * EACH, "ray_o");
    d = test_read(p->device, &p->ray_d, sizeof *d * FAR * EACH, "ray_d");
    for (int r = 0; r < FAR * EACH; r++) {
        const int i = (int)pixels[r].view;
        const double distance = pow(10, 1 + i / 2);
        /* of positions of size 4; and the pixel's own place, which float32 has to 6e-8 of its
         * distance from the principal point */
        const double most = 2e-6 + 2e-7 * fabs(cameras[i].cx) / 100;
        double origin[3], direction[3], near = 0, t = 0, lateral = 0;

        assert_true(
            cln_camera_ray(&cameras[i], pixels[r].x + 0.5, pixels[r].y + 0.5, origin, direction));
        for (int a = 0; a < 3; a++) {
            origin[a] = (origin[a] - space.centre[a]) / space.half;
            near -= (double)o[r][a] * (double)d[r][a]; /* t where the ray is nearest the centre */
        }
        for (int a = 0; a < 3; a++)
            t += (o[r][a] + near * (double)d[r][a] - origin[a]) * direction[a];
        for (int a = 0; a < 3; a++)
            lateral =
                hypot(lateral, o[r][a] + near * (double)d[r][a] - origin[a] - t * direction[a]);
        if (!(lateral < most))
            fail_msg("%g half-cubes away, view %d: a ray is off by %.3g, allowed %.3g", distance, i,
                     lateral, most);
        if (!(fabs(near + (double)o[r][3] - t) < 1e-6 * distance))
            fail_msg("%g half-cubes away: depth %.9g, not %.9g", distance, near + (double)o[r][3],
                     t);
        if (distance > 40) /* t begins at the cube */
            assert_true(near > 0 && near < 8);
    }
    free(o);
    free(d);
}

/* A forward space: rays are those of the host's map, and a sample at the cube's t of a point comes
 * back as the point's depth, from the near plane to 300 of them away. */
static void check_forward(int set, unsigned models, double unit)
{
    enum { FORWARD = 4 };
    const cln_config config = small_config();
    const cln_space space = forward_space(unit);
    cln_pipeline *p = test_pipeline_in(&tune_sets[set], &config, models, false, &space);
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[FORWARD];
    const cln_camera *list[FORWARD];
    cln_pixel pixels[RAYS];
    cln_sample samples[RAYS];
    uint32_t starts[RAYS + 1];
    float(*o)[4] = NULL, (*d)[4] = NULL, (*out)[4] = test_alloc(RAYS, sizeof *out), got[6 * RAYS];
    double want[6 * RAYS], depths[RAYS], axis[RAYS], worst = 0;

    for (int i = 0; i < FORWARD; i++) {
        forward_camera(i, &space, 160, 120, &cameras[i]);
        if (models)
            cameras[i].k1 = 0.05 * (i - 1);
        list[i] = &cameras[i];
    }
    for (int r = 0; r < RAYS; r++)
        pixels[r] = (cln_pixel){.view = (uint32_t)(r % FORWARD),
                                .x = (uint32_t)test_uniform(6, r, 0, 160),
                                .y = (uint32_t)test_uniform(7, r, 0, 120)};
    assert_ok(cln_pipeline_cameras(p, list, FORWARD, &space));
    assert_ok(cln_pipeline_batch(p, pixels, RAYS, NULL, white));
    test_fill(p->device, &p->ray_o, NULL, sizeof *o * RAYS);
    test_fill(p->device, &p->ray_d, NULL, sizeof *d * RAYS);
    assert_ok(cln_stage_rays(p, RAYS));
    o = test_read(p->device, &p->ray_o, sizeof *o * RAYS, "ray_o");
    d = test_read(p->device, &p->ray_d, sizeof *d * RAYS, "ray_d");
    for (int r = 0; r < RAYS; r++) {
        const cln_camera *c = &cameras[pixels[r].view];
        double origin[3], direction[3], begin[3], along[3], at[3], t = 0;

        assert_true(cln_camera_ray(c, pixels[r].x + 0.5, pixels[r].y + 0.5, origin, direction));
        cln_space_ray_to_cube(&space, origin, direction, begin, along);
        axis[r] = 0;
        for (int a = 0; a < 3; a++) {
            want[6 * r + a] = begin[a];
            got[6 * r + a] = o[r][a];
            want[6 * r + 3 + a] = along[a];
            got[6 * r + 3 + a] = d[r][a];
            axis[r] += direction[a] * c->c2w[4 * a + 2];
        }
        depths[r] = (double)o[r][3] + pow(10, test_uniform(8, r, -2, 2.5));
        cln_space_depth_to_cube(&space, origin, direction, depths[r], at);
        for (int a = 0; a < 3; a++)
            t += (at[a] - (double)o[r][a]) * (double)d[r][a];
        starts[r] = (uint32_t)r;
        samples[r] = (cln_sample){.t = (float)t, .delta = 0.01f, .ray = (uint32_t)r};
        out[r][3] = 1e4f;
    }
    starts[RAYS] = RAYS;
    compare("rays of a forward space", got, want, 6 * RAYS, (bounds){1e-13, 2e-6});
    for (unsigned kind = CLN_DEPTH_MEAN; kind <= (CLN_DEPTH_MEAN | CLN_DEPTH_AXIS); kind++) {
        cln_ray_result *results = NULL;

        if (!(kind & CLN_DEPTH_MEAN))
            continue;
        test_fill(p->device, &p->sample_starts, starts, sizeof starts);
        test_fill(p->device, &p->samples, samples, sizeof samples);
        test_fill(p->device, &p->out, out, sizeof *out * RAYS);
        test_fill(p->device, &p->results, NULL, sizeof *results * RAYS);
        assert_ok(cln_stage_composite(p, RAYS, kind));
        results = test_read(p->device, &p->results, sizeof *results * RAYS, "results");
        for (int r = 0; r < RAYS; r++) {
            const double exact = depths[r] * (kind & CLN_DEPTH_AXIS ? axis[r] : 1);

            worst = fmax(worst, fabs((double)results[r].depth / exact - 1));
        }
        free(results);
    }
    if (!(worst < 1e-4))
        fail_msg("a depth is off by %.3g of itself", worst);
    free(o);
    free(d);
    free(out);
}

static void test_forward(void **state)
{
    (void)state;
    check_forward(0, 1u << CLN_LENS_OPENCV, 1e-4);
}

int test_group_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cameras),     cmocka_unit_test(test_few_rays),
        cmocka_unit_test(test_beyond_fold), cmocka_unit_test(test_far_cameras),
        cmocka_unit_test(test_forward),
    };

    test_wanted = CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(composite);
    return cmocka_run_group_tests_name("rays", tests, NULL, test_device_close);
}
