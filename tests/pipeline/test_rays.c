/* rays.cl against the double camera of host/scene/camera.c: origin, unit direction and axis
 * scale of rays through pixels of pinholes, parallel ones and of every lens model, alone and in one
 * scene, in scenes of 1e-4 and 1e6 units. tests/check/test_extremes.c has far cameras, pixels
 * beyond a lens' fold, and forward spaces; test_sampling.c tests which leaves a ray meets. */
#include "unit.h"
#include "check/forward_scene.h"
#include "device_test.h"
#include "scene/scene.h"
#include "tests.h"

enum { VIEWS = 22, RAYS = 613, PINHOLE = -1, PARALLEL = CLN_LENSES };

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
    {CLN_LENS_FOV, {0}, 2}, /* beside one that bends */
    {CLN_LENS_FOV, {1e-30}, 2},
    {CLN_LENS_DIVISION, {-0.3}, 4},
    {CLN_LENS_DIVISION, {0.1}, 2},
    {CLN_LENS_EUCM, {0.62, 1.09}, 2.4},
    {CLN_LENS_EUCM, {0.4, 0.9}, 4},
    {CLN_LENS_EQUIRECTANGULAR, {0}, 6.283185},
    {PINHOLE, {0}, 23},                      /* 170 degrees */
    {CLN_LENS_OPENCV, {1, -0.5, 0, 0}, 2.2}, /* Newton's method alone ends beyond the fold */
    {PARALLEL, {0}, 1.7},                    /* halves of the cube, beside all those lenses */
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
    c->parallel = lenses[row].lens == PARALLEL;
    if (c->parallel) {
        c->fx /= space->half;
        c->fy /= space->half;
    }
    c->lens =
        lenses[row].lens == PINHOLE || c->parallel ? CLN_LENS_OPENCV : (cln_lens)lenses[row].lens;
    memcpy(c->distortion, lenses[row].params, sizeof c->distortion);
}

/* Rays of a scene whose cameras have these lens models, in a pipeline that knows no other. */
static void check_rays(int set, unsigned models, double unit)
{
    cln_config config = small_config();
    cln_pipeline *p = NULL;
    const cln_space space = {.centre = {3 * unit, -2 * unit, 0.5 * unit}, .half = 1.5 * unit};
    const float white[4] = {1, 1, 1, 1};
    cln_camera cameras[VIEWS];
    const cln_camera *list[VIEWS];
    cln_pixel pixels[RAYS];
    float(*o)[4] = NULL, (*d)[4] = NULL, got[6 * RAYS];
    double want[6 * RAYS];
    int views = 0;

    config.antialias = 1 + set % 2;
    p = test_pipeline(&tune_sets[set], &config, models, false);
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
        if (p->averaged && r % 3) /* not through the centre */
            pixels[r].spot = CLN_SPOT((int)test_uniform(4, r, -2048, 2048),
                                      (int)test_uniform(5, r, -2048, 2048), r % 4, 4);
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
        const double x = pixels[r].x + 0.5 + CLN_SPOT_X(pixels[r].spot) / 4096.0;
        const double y = pixels[r].y + 0.5 + CLN_SPOT_Y(pixels[r].spot) / 4096.0;
        double origin[3], direction[3], length = 0;

        if (!cln_camera_ray(c, x, y, origin, direction))
            fail_msg("%s has no ray at %u, %u", cln_lens_models[c->lens].name, pixels[r].x,
                     pixels[r].y);
        for (int a = 0; a < 3; a++) {
            want[6 * r + a] = (origin[a] - space.centre[a]) / space.half;
            got[6 * r + a] = o[r][a];
            want[6 * r + 3 + a] = direction[a];
            got[6 * r + 3 + a] = d[r][a];
            length += (double)d[r][a] * d[r][a];
        }
        if (!(fabs(length - 1) < 1e-6))
            fail_msg("ray %d has length %.9g", r, sqrt(length));
    }
    /* 2e-6 of a direction of size 1 is 3e-4 pixels here; Newton's method in float32 leaves less. */
    compare(models ? "rays behind a lens" : "pinhole rays", got, want, 6 * RAYS,
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
    check_rays(0, (1u << PARALLEL) - 1, 1);
    check_rays(0, (2u << PARALLEL) - 1, 1);
    check_rays(1, 1u << PARALLEL, 1e6);              /* and pinholes */
    check_rays(4, 1u << CLN_LENS_OPENCV_FISHEYE, 1); /* and pinholes */
    test_report("rays");
}

/* A forward space seen through fisheyes that see behind themselves: rays that look forward are the
 * host's, the others are outside the cube and away from it. */
static void test_forward_wide(void **state)
{
    enum { VIEWS_HERE = CLN_FORWARD_VIEWS, FISHEYE = 7 };
    const cln_config config = small_config();
    const cln_space space = cln_check_forward_space(1);
    const float white[4] = {1, 1, 1, 1};
    cln_pipeline *p =
        test_pipeline_in(&tune_sets[4], &config, 1u << CLN_LENS_OPENCV_FISHEYE, false, &space);
    const cln_camera *list[VIEWS_HERE];
    cln_camera cameras[VIEWS_HERE];
    cln_pixel pixels[RAYS];
    float o[RAYS][4], d[RAYS][4];
    int behind = 0, ahead = 0;

    (void)state;
    for (int v = 0; v < VIEWS_HERE; v++) {
        cln_camera *c = &cameras[v];

        cln_check_forward_camera(v, &space, 160, 120, c);
        c->lens = CLN_LENS_OPENCV_FISHEYE;
        c->fx = c->fy = c->width / lenses[FISHEYE].wide;
        list[v] = c;
    }
    for (int r = 0; r < RAYS; r++)
        pixels[r] = (cln_pixel){.view = (uint32_t)(r % VIEWS_HERE),
                                .x = (uint32_t)test_uniform(5, r, 0, 160),
                                .y = (uint32_t)test_uniform(6, r, 0, 120)};
    assert_ok(cln_pipeline_cameras(p, list, VIEWS_HERE, &space));
    assert_ok(cln_pipeline_batch(p, pixels, RAYS, NULL, white));
    assert_ok(cln_stage_rays(p, RAYS));
    assert_ok(cln_buffer_read(p->device, &p->ray_o, 0, o, sizeof o));
    assert_ok(cln_buffer_read(p->device, &p->ray_d, 0, d, sizeof d));
    for (int r = 0; r < RAYS; r++) {
        const cln_camera *c = &cameras[pixels[r].view];
        double origin[3], along[3], forward = 0, error = 0;

        assert_true(cln_camera_ray(c, pixels[r].x + 0.5, pixels[r].y + 0.5, origin, along));
        for (int a = 0; a < 3; a++)
            forward += along[a] * space.axes[6 + a];
        if (fabs(forward) < 0.02) /* in the plane: far away sideways, and rounding decides */
            continue;
        cln_space_ray_to_cube(&space, origin, along, origin, along);
        for (int a = 0; a < 3; a++)
            error = fmax(error, fmax(fabs(o[r][a] - origin[a]) / (1 + fabs(origin[a])),
                                     fabs(d[r][a] - along[a])));
        if (!(error < 1e-5))
            fail_msg("view %u, pixel %u, %u, forward %g: %g %g %g instead of %g %g %g",
                     pixels[r].view, pixels[r].x, pixels[r].y, forward, (double)o[r][0],
                     (double)o[r][1], (double)o[r][2], origin[0], origin[1], origin[2]);
        behind += forward < 0;
        ahead += forward > 0;
    }
    assert_true(behind > RAYS / 10 && ahead > RAYS / 10);
}

/* A fisheye far away from the cube: rays that look back do not meet it, they
 * begin where rays.cl has those that see nothing. */
static void test_far_wide(void **state)
{
    enum { SIZE = 24, FISHEYE = 7 };
    const cln_config config = small_config();
    const float white[4] = {1, 1, 1, 1};
    cln_pipeline *p = test_pipeline(&tune_sets[4], &config, 1u << CLN_LENS_OPENCV_FISHEYE, false);
    cln_camera camera;
    const cln_camera *list = &camera;
    cln_pixel pixels[SIZE * SIZE];
    float o[SIZE * SIZE][4], d[SIZE * SIZE][4];
    int back = 0;

    (void)state;
    make_camera(1, FISHEYE, &cln_space_unit, &camera);
    for (int a = 0; a < 3; a++)
        camera.c2w[4 * a + 3] *= 1000;
    camera.width = camera.height = SIZE;
    camera.cx = camera.cy = 0.5 * SIZE + 0.01;
    camera.fx = camera.fy = SIZE / lenses[FISHEYE].wide;
    for (uint32_t i = 0; i < SIZE * SIZE; i++)
        pixels[i] = (cln_pixel){.x = i % SIZE, .y = i / SIZE};
    assert_ok(cln_pipeline_cameras(p, &list, 1, &cln_space_unit));
    assert_ok(cln_pipeline_batch(p, pixels, SIZE * SIZE, NULL, white));
    assert_ok(cln_stage_rays(p, SIZE * SIZE));
    assert_ok(cln_buffer_read(p->device, &p->ray_o, 0, o, sizeof o));
    assert_ok(cln_buffer_read(p->device, &p->ray_d, 0, d, sizeof d));
    for (int i = 0; i < SIZE * SIZE; i++) {
        double from[3], along[3], axis = 0;

        assert_true(cln_camera_ray(&camera, pixels[i].x + 0.5, pixels[i].y + 0.5, from, along));
        for (int a = 0; a < 3; a++) {
            axis += along[a] * camera.c2w[4 * a + 2];
            from[a] = o[i][a];
            along[a] = d[i][a];
        }
        if (axis > -0.01)
            continue;
        back++;
        if (cln_space_met_by(&cln_space_unit, from, along) || from[0] != 3)
            fail_msg("pixel %u, %u looks back, and begins at %g %g %g", pixels[i].x, pixels[i].y,
                     from[0], from[1], from[2]);
    }
    assert_true(back > SIZE);
}

/* Nothing is written behind the last ray of a batch, and nothing at all for 0 rays. */
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
            assert_true(isfinite(d[r][0]) && d[r][3] == 0);
        free(d);
    }
}

/* With a near distance, rays of a plain space begin there, and depths still count from the camera:
 * ray_depth() adds the distance. */
static void test_near(void **state)
{
    const double near = 0.375;
    cln_config config = small_config();
    const float white[4] = {1, 1, 1, 1};
    cln_camera camera;
    const cln_camera *list = &camera;

    (void)state;
    config.near = near;
    make_camera(1, 0, &cln_space_unit, &camera);
    for (int set = 0; set < TUNE_SETS; set += 2) {
        cln_pipeline *p = test_pipeline(&tune_sets[set], &config, false, false);
        cln_pixel pixels[64];
        float o[64][4], d[64][4];

        for (uint32_t i = 0; i < 64; i++)
            pixels[i] = (cln_pixel){.x = 2 * i, .y = i};
        assert_ok(cln_pipeline_cameras(p, &list, 1, &cln_space_unit));
        assert_ok(cln_pipeline_batch(p, pixels, 64, NULL, white));
        assert_ok(cln_stage_rays(p, 64));
        assert_ok(cln_buffer_read(p->device, &p->ray_o, 0, o, sizeof o));
        assert_ok(cln_buffer_read(p->device, &p->ray_d, 0, d, sizeof d));
        for (int i = 0; i < 64; i++) {
            double from[3], along[3];

            assert_true(cln_camera_ray(&camera, pixels[i].x + 0.5, pixels[i].y + 0.5, from, along));
            assert_true(fabs((double)o[i][3] - near) < 1e-7);
            for (int a = 0; a < 3; a++) {
                assert_true(fabs((double)o[i][a] - (from[a] + near * along[a])) < 2e-6);
                assert_true(fabs((double)d[i][a] - along[a]) < 2e-6);
            }
        }
    }
}

/* Is the point in the picture? 1 or 0; -1 if rounding decides, as some places nearby are in it. */
static int in_picture(const cln_camera *c, const double point[3])
{
    int inside = 0;

    for (int k = 0; k < 7; k++) {
        double moved[3] = {point[0], point[1], point[2]}, u = 0, v = 0, z = 0;

        if (k > 0)
            moved[(k - 1) / 2] += k % 2 ? 1e-4 : -1e-4;
        inside += cln_camera_project(c, moved, &u, &v, &z) && u >= 0 && v >= 0 && u < c->width &&
                  v < c->height;
    }
    return inside == 7 ? 1 : inside == 0 ? 0 : -1;
}

/* Points all around a camera in the middle of the cube, through one lens: stats.cl's cells are in
 * view where the host has a place for them, and nowhere else. With a short focal length the model's
 * domain ends within the picture. */
static void check_points(int set, int row, double focal)
{
    enum { N1 = 16, CELLS = N1 * N1 * N1 };
    cln_config config = small_config();
    const unsigned models = lenses[row].lens == PINHOLE ? 0 : 1u << lenses[row].lens;
    cln_pipeline *p = NULL;
    const cln_camera *list = NULL;
    cln_camera camera;
    cln_model model;
    float *boxes = NULL;
    uint8_t *seen = NULL;
    int cells = 0, inside = 0, outside = 0;

    config.n1 = N1;
    p = test_pipeline(&tune_sets[set], &config, models, false);
    make_camera(1, row, &cln_space_unit, &camera);
    for (int a = 0; a < 3; a++)
        camera.c2w[4 * a + 3] *= 0.03;
    if (lenses[row].lens != CLN_LENS_EQUIRECTANGULAR) {
        camera.fx *= focal;
        camera.fy *= focal;
    } else { /* it wraps: a part of the sphere */
        camera.fx *= 1.5;
    }
    list = &camera;
    assert_ok(cln_model_create(&config, &model));
    assert_ok(cln_pipeline_upload(p, &model, false));
    assert_ok(cln_pipeline_cameras(p, &list, 1, &cln_space_unit));
    p->training_views = 1;
    cells = model.tree.leaf_count * CELLS;
    test_fill(p->device, &p->seen, NULL, (size_t)cells);
    assert_ok(cln_stage_seen(p));
    seen = test_read(p->device, &p->seen, (size_t)cells, "seen");
    assert_ok(cln_octree_boxes(&model.tree, &boxes));
    for (int i = 0; i < cells; i++) {
        const int cell = i % CELLS, xyz[3] = {cell % N1, cell / N1 % N1, cell / (N1 * N1)};
        const float *box = boxes + 4 * (i / CELLS);
        double point[3];
        int want;

        for (int a = 0; a < 3; a++)
            point[a] = box[a] + (xyz[a] + 0.5) / N1 * (double)box[3];
        want = in_picture(&camera, point);
        if (want >= 0 && seen[i] != want)
            fail_msg("%s, row %d: %g %g %g is %s the picture", cln_lens_models[camera.lens].name,
                     row, point[0], point[1], point[2], want ? "in" : "not in");
        inside += want == 1;
        outside += want == 0;
    }
    assert_true(inside > 0 && (outside > 0 || focal < 1));
    free(seen);
    free(boxes);
    cln_model_free(&model);
}

static void test_points(void **state)
{
    (void)state;
    for (int row = 0; row < VIEWS; row++)
        for (int wide = 0; wide < 2; wide++)
            check_points(row % 2 ? 4 : 0, row, wide ? 0.05 : 1.5);
}

int test_group_rays(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cameras),      cmocka_unit_test(test_points),
        cmocka_unit_test(test_forward_wide), cmocka_unit_test(test_far_wide),
        cmocka_unit_test(test_few_rays),     cmocka_unit_test(test_near),
    };

    test_wanted = CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(stats);
    return cmocka_run_group_tests_name("rays", tests, NULL, test_device_close);
}
