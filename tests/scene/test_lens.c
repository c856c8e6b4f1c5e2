/* The lens models: numbers from the published formulas with 40 digits, independent of the tested
 * code; round trips over whole images, from telephoto to the sphere; the Jacobian against
 * differences; limits of the models; meaning of COLMAP's lists. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "near.h"
#include "scene/build.h"
#include "tests.h"

static const double PI = 3.14159265358979323846;

/* Parameters of a lens of each model that bends a plane, and of others. */
#define MILD                         \
    {                                \
        -0.28, 0.11, 0.0012, -0.0021 \
    }
#define RATIONAL                                          \
    {                                                     \
        0.9, 0.35, -0.0007, 0.0004, 0.05, 1.25, 0.4, 0.08 \
    }
#define FISHEYE                          \
    {                                    \
        -0.021, 0.0045, -0.0012, 0.00009 \
    }
#define PRISM                                                             \
    {                                                                     \
        -0.031, 0.006, 0.0011, -0.0008, -0.0009, 0.00004, 0.0013, -0.0017 \
    }
#define RAD_TAN                                                                                   \
    {                                                                                             \
        0.39, -0.37, -0.12, 0.38, -0.24, 0.047, 0.0006, -0.0004, 0.0002, -0.0003, 0.0005, -0.0001 \
    }

/* ---- numbers by hand ---- */

static const struct {
    cln_lens lens;
    double params[CLN_LENS_PARAMS], direction[3], place[2];
} known[] = {
    {CLN_LENS_OPENCV, MILD, {0.4, -0.3, 1}, {0.373265, -0.2800425}},
    {CLN_LENS_OPENCV, MILD, {-0.7, 0.55, 1.2}, {-0.5161047820416988169, 0.405263243925620499}},
    {CLN_LENS_FULL_OPENCV,
     RATIONAL,
     {0.4, -0.3, 1},
     {0.3731784463118580766, -0.2799838347338935574}},
    {CLN_LENS_FULL_OPENCV,
     RATIONAL,
     {-0.7, 0.55, 1.2},
     {-0.5143629601209740089, 0.4039300490236224356}},
    {CLN_LENS_OPENCV_FISHEYE,
     FISHEYE,
     {0.4, -0.3, 1},
     {0.3693164157188218252, -0.2769873117891163689}},
    {CLN_LENS_OPENCV_FISHEYE,
     FISHEYE,
     {-1.1, 0.2, -0.8},
     {-1.979373959170188585, 0.3598861743945797428}},
    {CLN_LENS_OPENCV_FISHEYE, {0}, {0.9, 1.3, -0.35}, {1.018113409039930446, 1.470608257502121756}},
    {CLN_LENS_THIN_PRISM_FISHEYE,
     PRISM,
     {-0.7, 0.55, 1.2},
     {-0.4966474720407188246, 0.3901386268514559018}},
    {CLN_LENS_THIN_PRISM_FISHEYE,
     PRISM,
     {-1.1, 0.2, -0.8},
     {-1.971627059930705303, 0.3560318091441553503}},
    {CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     RAD_TAN,
     {0.4, -0.3, 1},
     {0.3959518481734715739, -0.2968122201088476279}},
    {CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     RAD_TAN,
     {-0.7, 0.55, 1.2},
     {-0.549864014253035958, 0.43231263100871806}},
    {CLN_LENS_FOV, {0.93}, {0.4, -0.3, 1}, {0.4, -0.3}}, /* 2 r = 1 is where it does nothing */
    {CLN_LENS_FOV, {0.93}, {-0.7, 0.55, 1.2}, {-0.5410243636138934788, 0.4250905714109163048}},
    {CLN_LENS_DIVISION, {-0.32}, {0.4, -0.3, 1}, {0.3722813232690143299, -0.2792109924517607474}},
    {CLN_LENS_DIVISION, {-0.32}, {-1.1, 0.2, -0.8}, {-3.157911562725667762, 0.5741657386773941386}},
    {CLN_LENS_DIVISION, {0.12}, {-0.7, 0.55, 1.2}, {-0.6279804573205301947, 0.4934132164661308673}},
    {CLN_LENS_EUCM,
     {0.62, 1.09},
     {-0.7, 0.55, 1.2},
     {-0.5010528944207408513, 0.3936844170448678117}},
    {CLN_LENS_EUCM, {0.62, 1.09}, {-1.1, 0.2, -0.8}, {-1.918514597154168954, 0.348820835846212537}},
    {CLN_LENS_EUCM, {0.4, 0.9}, {0.9, 1.3, -0.35}, {2.216110834059544169, 3.201048982530452689}},
    {CLN_LENS_EQUIRECTANGULAR,
     {0},
     {0.4, -0.3, 1},
     {0.3805063771123648863, -0.2716571236775740297}},
    {CLN_LENS_EQUIRECTANGULAR,
     {0},
     {-1.1, 0.2, -0.8},
     {-2.199592613210329574, 0.1459966951253537403}},
};
enum { KNOWN = sizeof known / sizeof *known };

/* Sine of the angle between directions of any length, 2 if they point away from each other. */
static double apart(const double a[3], const double b[3])
{
    const double cross[3] = {a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2],
                             a[0] * b[1] - a[1] * b[0]};
    const double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    const double sine = sqrt(cross[0] * cross[0] + cross[1] * cross[1] + cross[2] * cross[2]);

    return dot > 0 ? sine / hypot(sine, dot) : 2;
}

static void test_by_hand(void **state)
{
    bool tested[CLN_LENSES] = {false};

    (void)state;
    for (int i = 0; i < KNOWN; i++) {
        double place[2], direction[3], longer[3];

        tested[known[i].lens] = true;
        for (int a = 0; a < 3; a++)
            longer[a] = 17 * known[i].direction[a];
        assert_true(cln_lens_distort(known[i].lens, known[i].params, longer, place));
        for (int a = 0; a < 2; a++)
            assert_near(place[a], known[i].place[a], 2e-15 * (1 + fabs(place[a])));
        assert_true(cln_lens_undistort(known[i].lens, known[i].params, known[i].place, direction));
        assert_near(apart(direction, known[i].direction), 0, 1e-12);
    }
    for (int lens = 0; lens < CLN_LENSES; lens++)
        if (!tested[lens])
            fail_msg("no row of `known` is %s's", cln_lens_models[lens].name);
}

/* ---- there and back ---- */

/* Images by the positions of their edges; `share` of a grid over them, including corners, must have
 * rays: all, unless the lens folds inside. */
static const struct {
    const char *what;
    cln_lens lens;
    double params[CLN_LENS_PARAMS], right, down, share;
} images[] = {
    {"0.01 degrees", CLN_LENS_OPENCV, {0.1, -3, 0.001, 0.002}, 8.7e-5, 6.5e-5, 1},
    {"170 degrees, pinhole", CLN_LENS_OPENCV, {0}, 11.43, 11.43, 1},
    {"170 degrees, bent", CLN_LENS_OPENCV, {1e-4, 1e-7, 1e-5, -2e-5}, 11.43, 11.43, 1},
    {"a photograph", CLN_LENS_OPENCV, MILD, 0.6, 0.45, 1},
    {"pincushion", CLN_LENS_OPENCV, {0.8, 0.5, 0.01, -0.02}, 1.5, 1.2, 1},
    {"folds", CLN_LENS_OPENCV, {-0.5}, 0.6, 0.45, 0.75},
    {"folds, tangential", CLN_LENS_OPENCV, {-0.4, 0.05, -0.03, 0.02}, 0.8, 0.6, 0.5},
    {"rational", CLN_LENS_FULL_OPENCV, RATIONAL, 1.4, 1.1, 1},
    {"rational with a pole", CLN_LENS_FULL_OPENCV, {0, 0, 0, 0, 0, -0.2}, 4, 3, 1},
    {"rational, folds", CLN_LENS_FULL_OPENCV, {-0.4, 0, 0, 0, 0, 0.1}, 0.7, 0.6, 0.4},
    {"fisheye, 180 degrees", CLN_LENS_OPENCV_FISHEYE, FISHEYE, 1.1, 1.1, 1},
    {"fisheye, 350 degrees", CLN_LENS_OPENCV_FISHEYE, {0}, 2.15, 2.15, 1},
    {"fisheye, folds", CLN_LENS_OPENCV_FISHEYE, {-0.1}, 1.2, 1.2, 0.6},
    {"prism", CLN_LENS_THIN_PRISM_FISHEYE, PRISM, 1.4, 1.4, 1},
    {"prism, folds", CLN_LENS_THIN_PRISM_FISHEYE, {-0.1, 0, 0.01, 0, 0, 0, 0.01}, 1.2, 1.2, 0.6},
    {"Aria", CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE, RAD_TAN, 0.8, 0.6, 1},
    {"Aria, strong",
     CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     {-0.03, 0, 0, 0, 0, 0, 0.01, -0.02, 0.01, 0.002, -0.01, 0.003},
     1,
     1,
     1},
    {"Tango", CLN_LENS_FOV, {0.93}, 1.1, 0.9, 1},
    {"FOV, hardly bent", CLN_LENS_FOV, {1e-7}, 1.1, 0.9, 1},
    {"FOV, a pinhole", CLN_LENS_FOV, {0}, 1.1, 0.9, 1},
    {"FOV, beyond", CLN_LENS_FOV, {-1.5}, 1, 1, 0.7},
    {"barrel by division", CLN_LENS_DIVISION, {-0.3}, 3, 2, 1},
    {"pincushion by division", CLN_LENS_DIVISION, {0.2}, 2, 2, 0.7},
    {"EUCM", CLN_LENS_EUCM, {0.62, 1.09}, 1.3, 1.2, 1},
    {"EUCM, beyond", CLN_LENS_EUCM, {1, 1}, 1, 1, 0.7},
    {"EUCM, narrow", CLN_LENS_EUCM, {0.3, 0.9}, 3, 2, 1},
    {"the sphere", CLN_LENS_EQUIRECTANGULAR, {0}, PI, PI / 2, 1},
};
enum { IMAGES = sizeof images / sizeof *images, GRID = 41 };

static void test_round_trip(void **state)
{
    (void)state;
    for (int i = 0; i < IMAGES; i++) {
        const double *params = images[i].params;
        int found = 0;

        for (int n = 0; n < GRID * GRID; n++) {
            const double place[2] = {(2.0 * (n % GRID) / (GRID - 1) - 1) * images[i].right,
                                     (2.0 * (n / GRID) / (GRID - 1) - 1) * images[i].down};
            double direction[3], again[2], same[3], wide = 0;

            if (!cln_lens_undistort(images[i].lens, params, place, direction))
                continue;
            found++;
            if (!cln_lens_distort(images[i].lens, params, direction, again))
                fail_msg("%s: (%g, %g) has a direction that has no place", images[i].what, place[0],
                         place[1]);
            /* at the poles and behind the camera any longitude is correct */
            wide = images[i].lens == CLN_LENS_EQUIRECTANGULAR &&
                           (fabs(place[1]) > 1.57 || fabs(place[0]) > 3.14)
                       ? 10
                       : 1e-10;
            assert_near(again[0], place[0], wide);
            assert_near(again[1], place[1], 1e-10);
            assert_true(cln_lens_undistort(images[i].lens, params, again, same));
            assert_near(apart(direction, same), 0, 1e-6); /* a fold is flat */
        }
        if (found < images[i].share * GRID * GRID || (images[i].share < 1 && found == GRID * GRID))
            fail_msg("%s: %d places of %d have a direction", images[i].what, found, GRID * GRID);
    }
}

static void test_jacobian(void **state)
{
    (void)state;
    for (int i = 0; i < IMAGES; i++) {
        const cln_lens_model *model = &cln_lens_models[images[i].lens];
        cln_lens_plane plane = {0};

        if (!model->plane)
            continue;
        model->plane(images[i].params, &plane);
        for (int n = 0; n < 25; n++) {
            const double p[2] = {0.8 * images[i].right * (n % 5 - 2.1) / 3,
                                 0.8 * images[i].down * (n / 5 - 1.9) / 3};
            double place[2], jacobian[4];

            cln_lens_plane_bend(&plane, p, place, jacobian);
            for (int along = 0; along < 2; along++) {
                const double h = 1e-6 * images[i].right;
                double ahead[2] = {p[0], p[1]}, behind[2] = {p[0], p[1]}, far[2], near[2];

                ahead[along] += h;
                behind[along] -= h;
                cln_lens_plane_bend(&plane, ahead, far, NULL);
                cln_lens_plane_bend(&plane, behind, near, NULL);
                for (int of = 0; of < 2; of++)
                    assert_near(jacobian[2 * of + along], (far[of] - near[of]) / (2 * h),
                                1e-6 * (1 + fabs(jacobian[2 * of + along])));
            }
        }
    }
}

/* ---- where models end ---- */

static const struct {
    cln_lens lens;
    double params[CLN_LENS_PARAMS];
    double limit; /* radius in the plane, or of the place where the model has no plane */
} ends[] = {
    {CLN_LENS_OPENCV, {0}, INFINITY},
    {CLN_LENS_OPENCV, {-0.5}, 0.81649658092772603},      /* 1 - 3/2 s = 0 */
    {CLN_LENS_OPENCV, {-0.3, 0.02}, 1.1394901848123027}, /* 1 - 0.9 s + 0.1 s^2 = 0 */
    {CLN_LENS_OPENCV, {0.3, 0.02}, INFINITY},
    {CLN_LENS_FULL_OPENCV, {0, 0, 0, 0, 0, -0.25}, 2}, /* 1 - s/4 below: a pole */
    {CLN_LENS_FULL_OPENCV, {0, 0, 0, 0, 0, 0.25}, 2},  /* r / (1 + r^2/4) */
    {CLN_LENS_OPENCV_FISHEYE, {0}, 3.14159265358979323846},
    {CLN_LENS_OPENCV_FISHEYE, {-0.1}, 1.8257418583505538},           /* 1 - 0.3 s = 0 */
    {CLN_LENS_OPENCV_FISHEYE, {0, 0, 0, -1e-3}, 1.8018543655775816}, /* 1 - 0.009 s^4 = 0 */
    {CLN_LENS_THIN_PRISM_FISHEYE, {-0.1}, 1.8257418583505538},
    {CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     {0, 0, 0, 0, 0, -1e-3},
     1.4360560378830206}, /* 13 s^6 = 1000 */
};

static void test_limit(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof ends / sizeof *ends; i++) {
        const double limit = cln_lens_limit(ends[i].lens, ends[i].params);

        if (isinf(ends[i].limit))
            assert_true(isinf(limit));
        else
            assert_near(limit, ends[i].limit, 1e-10);
    }
}

/* Directions to the right at this angle, and their places. */
static bool seen_at(cln_lens lens, const double *params, double angle, double *place)
{
    double both[2] = {0, 0};
    const bool seen = cln_lens_distort(lens, params, (double[3]){sin(angle), 0, cos(angle)}, both);

    *place = both[0];
    return seen;
}

static bool has_ray(cln_lens lens, const double *params, double right, double down)
{
    double direction[3];

    return cln_lens_undistort(lens, params, (double[2]){right, down}, direction);
}

static void test_beyond(void **state)
{
    const double none[CLN_LENS_PARAMS] = {0}, barrel[CLN_LENS_PARAMS] = {-0.5};
    const double division[CLN_LENS_PARAMS] = {0.25}, sphere[CLN_LENS_PARAMS] = {1, 1};
    const double tango[CLN_LENS_PARAMS] = {1}, fold[CLN_LENS_PARAMS] = {-0.1};
    double place = 0, both[2];

    (void)state;
    /* k1 = -0.5: r - r^3 / 2 grows to 0.5443310539518174 at r = sqrt(2/3) */
    assert_true(has_ray(CLN_LENS_OPENCV, barrel, 0.5443310, 0));
    assert_false(has_ray(CLN_LENS_OPENCV, barrel, 0.5443311, 0));
    assert_false(has_ray(CLN_LENS_OPENCV, barrel, 0.45, 0.34));
    assert_false(has_ray(CLN_LENS_OPENCV, barrel, 0, -3));
    assert_true(seen_at(CLN_LENS_OPENCV, barrel, atan(0.816), &place));
    assert_false(seen_at(CLN_LENS_OPENCV, barrel, atan(0.817), &place));
    assert_false(seen_at(CLN_LENS_OPENCV, none, 0.5 * PI + 1e-9, &place));
    assert_false(seen_at(CLN_LENS_OPENCV, none, 2, &place));

    /* the denominators' poles: 1 - s^2 / 2 and 1 - s^3 / 2, s = r^2, at 2^(1/4) and 2^(1/6) */
    for (int k = 6; k < 8; k++) {
        double pole[CLN_LENS_PARAMS] = {0};
        const double at = k == 6 ? 1.189207115 : 1.122462048;

        pole[k] = -0.5;
        assert_true(seen_at(CLN_LENS_FULL_OPENCV, pole, atan(at - 1e-4), &place));
        assert_false(seen_at(CLN_LENS_FULL_OPENCV, pole, atan(at + 1e-4), &place));
    }

    /* theta - theta^3 / 10, up to 1.8257418583505538: 1.2171612389003692 */
    assert_true(has_ray(CLN_LENS_OPENCV_FISHEYE, fold, 0, 1.2171612));
    assert_false(has_ray(CLN_LENS_OPENCV_FISHEYE, fold, 0, 1.2171613));
    assert_true(seen_at(CLN_LENS_OPENCV_FISHEYE, fold, 1.8257, &place));
    assert_false(seen_at(CLN_LENS_OPENCV_FISHEYE, fold, 1.8258, &place));
    assert_true(has_ray(CLN_LENS_OPENCV_FISHEYE, none, 3.14, 0));
    assert_false(has_ray(CLN_LENS_OPENCV_FISHEYE, none, 3.15, 0));
    assert_false(has_ray(CLN_LENS_OPENCV_FISHEYE, none, 300, 0));
    assert_true(seen_at(CLN_LENS_OPENCV_FISHEYE, none, 0, &place));
    assert_near(place, 0, 0);
    assert_false(cln_lens_distort(CLN_LENS_OPENCV_FISHEYE, none, (double[3]){0, 0, -1}, both));

    /* tan(r' omega) ends at r' = pi / 2 */
    assert_true(has_ray(CLN_LENS_FOV, tango, 1.57, 0));
    assert_false(has_ray(CLN_LENS_FOV, tango, 1.5708, 0));
    assert_false(seen_at(CLN_LENS_FOV, tango, 1.5708, &place));

    /* r' / (1 + r'^2 / 4) grows to 1 at r' = 2: 45 degrees */
    assert_true(has_ray(CLN_LENS_DIVISION, division, 0, 1.9999));
    assert_false(has_ray(CLN_LENS_DIVISION, division, 0, 2.0001));
    assert_true(seen_at(CLN_LENS_DIVISION, division, 0.25 * PI - 1e-6, &place));
    assert_false(seen_at(CLN_LENS_DIVISION, division, 0.25 * PI + 1e-6, &place));
    assert_false(seen_at(CLN_LENS_DIVISION, division, PI, &place));
    assert_false(seen_at(CLN_LENS_DIVISION, none, 0.5 * PI + 1e-9, &place));

    /* alpha = beta = 1: sin of the angle, to 90 degrees */
    assert_true(has_ray(CLN_LENS_EUCM, sphere, 0.9999, 0));
    assert_false(has_ray(CLN_LENS_EUCM, sphere, 1.0001, 0));
    assert_true(seen_at(CLN_LENS_EUCM, sphere, 0.5 * PI - 1e-6, &place));
    assert_false(seen_at(CLN_LENS_EUCM, sphere, 0.5 * PI + 1e-6, &place));

    /* the sphere, and no more */
    assert_true(seen_at(CLN_LENS_EQUIRECTANGULAR, none, PI, &place));
    assert_near(place, PI, 1e-15);
    assert_true(has_ray(CLN_LENS_EQUIRECTANGULAR, none, PI, PI / 2));
    assert_false(has_ray(CLN_LENS_EQUIRECTANGULAR, none, PI + 1e-6, 0));
    assert_false(has_ray(CLN_LENS_EQUIRECTANGULAR, none, 0, PI / 2 + 1e-6));
    for (int lens = 0; lens < CLN_LENSES; lens++)
        assert_false(
            cln_lens_distort((cln_lens)lens, sphere, (double[3]){0, 0, 0}, (double[2]){0}));
}

/* The map of pixels that have rays, by rectangles, against every pixel. */
static void test_kept(void **state)
{
    static const struct {
        cln_lens lens;
        double params[CLN_LENS_PARAMS], f, cx, cy;
    } cameras[] = {
        {CLN_LENS_OPENCV, {0.1}, 60, 45, 30},
        {CLN_LENS_OPENCV, {-0.5}, 60, 45, 30}, /* a disc of radius 33 in 91 x 61 */
        {CLN_LENS_OPENCV, {-0.5}, 60, 45, 30},
        {CLN_LENS_OPENCV, {-0.5}, 60, -10, 40},  /* seen from the side */
        {CLN_LENS_OPENCV, {-0.5}, 4, 50.5, 7.5}, /* some pixels in one rectangle */
        {CLN_LENS_OPENCV, {-0.4, 0.05, -0.03, 0.02}, 60, 45, 30},
        {CLN_LENS_OPENCV_FISHEYE, {-0.1}, 30, 45, 30},
        {CLN_LENS_FOV, {1.5}, 40, 60, 30},
        {CLN_LENS_EUCM, {1, 1}, 30, 45, 30},
    };
    enum { CAMERAS = sizeof cameras / sizeof *cameras };
    cln_view views[CAMERAS];
    cln_scene scene = {.view_count = CAMERAS, .views = views, .folder = "here"};

    (void)state;
    memset(views, 0, sizeof views);
    for (int i = 0; i < CAMERAS; i++) {
        cln_camera *c = &views[i].camera;

        *c = (cln_camera){.c2w = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0},
                          .fx = cameras[i].f,
                          .fy = 0.9 * cameras[i].f,
                          .cx = cameras[i].cx,
                          .cy = cameras[i].cy,
                          .lens = cameras[i].lens,
                          .width = 91,
                          .height = 61};
        memcpy(c->distortion, cameras[i].params, sizeof c->distortion);
        c->c2w[3] = i; /* poses differ, lenses may not */
    }
    assert_int_equal(cln_scene_find_kept(&scene), CLN_OK);
    for (int i = 0; i < CAMERAS; i++) {
        int64_t left_out = 0;

        for (int y = 0; y < 61; y++)
            for (int x = 0; x < 91; x++) {
                double o[3], d[3];
                const bool ray = cln_camera_ray(&views[i].camera, x + 0.5, y + 0.5, o, d);

                if (ray != cln_view_keeps(&views[i], x, y))
                    fail_msg("camera %d: pixel %d, %d has %s ray", i, x, y, ray ? "a" : "no");
                left_out += !ray;
            }
        assert_int_equal(views[i].left_out, left_out);
        assert_true(i == 0 ? left_out == 0 : left_out > 500 && left_out < 91 * 61);
    }
    assert_null(views[0].kept);
    assert_ptr_equal(views[1].kept, views[2].kept);
    assert_ptr_not_equal(views[1].kept, views[3].kept);
    assert_int_equal(cln_scene_fold(&scene).views, CAMERAS - 1);
    for (int i = 0; i < CAMERAS; i++)
        free(scene.maps[i]);
    free(scene.maps);
}

/* ---- names and COLMAP's lists ---- */

static const struct {
    int id;
    const char *name;
    double values[4 + CLN_LENS_PARAMS], pixels[4];
    cln_lens lens;
    double params[CLN_LENS_PARAMS];
} lists[CLN_COLMAP_MODELS] = {
    {0, "SIMPLE_PINHOLE", {9, 5, 4}, {9, 9, 5, 4}, CLN_LENS_OPENCV, {0}},
    {1, "PINHOLE", {9, 8, 5, 4}, {9, 8, 5, 4}, CLN_LENS_OPENCV, {0}},
    {2, "SIMPLE_RADIAL", {9, 5, 4, 0.1}, {9, 9, 5, 4}, CLN_LENS_OPENCV, {0.1}},
    {3, "RADIAL", {9, 5, 4, 0.1, 0.2}, {9, 9, 5, 4}, CLN_LENS_OPENCV, {0.1, 0.2}},
    {4, "OPENCV", {9, 8, 5, 4, 1, 2, 3, 4}, {9, 8, 5, 4}, CLN_LENS_OPENCV, {1, 2, 3, 4}},
    {5,
     "OPENCV_FISHEYE",
     {9, 8, 5, 4, 1, 2, 3, 4},
     {9, 8, 5, 4},
     CLN_LENS_OPENCV_FISHEYE,
     {1, 2, 3, 4}},
    {6,
     "FULL_OPENCV",
     {9, 8, 5, 4, 1, 2, 3, 4, 5, 6, 7, 8},
     {9, 8, 5, 4},
     CLN_LENS_FULL_OPENCV,
     {1, 2, 3, 4, 5, 6, 7, 8}},
    {7, "FOV", {9, 8, 5, 4, 0.9}, {9, 8, 5, 4}, CLN_LENS_FOV, {0.9}},
    {8, "SIMPLE_RADIAL_FISHEYE", {9, 5, 4, 0.1}, {9, 9, 5, 4}, CLN_LENS_OPENCV_FISHEYE, {0.1}},
    {9, "RADIAL_FISHEYE", {9, 5, 4, 1, 2}, {9, 9, 5, 4}, CLN_LENS_OPENCV_FISHEYE, {1, 2}},
    {10,
     "THIN_PRISM_FISHEYE",
     {9, 8, 5, 4, 1, 2, 3, 4, 5, 6, 7, 8},
     {9, 8, 5, 4},
     CLN_LENS_THIN_PRISM_FISHEYE,
     {1, 2, 3, 4, 5, 6, 7, 8}},
    {11,
     "RAD_TAN_THIN_PRISM_FISHEYE",
     {9, 8, 5, 4, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12},
     {9, 8, 5, 4},
     CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE,
     {1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}},
    {12, "SIMPLE_DIVISION", {9, 5, 4, 0.1}, {9, 9, 5, 4}, CLN_LENS_DIVISION, {0.1}},
    {13, "DIVISION", {9, 8, 5, 4, 0.1}, {9, 8, 5, 4}, CLN_LENS_DIVISION, {0.1}},
    {14, "SIMPLE_FISHEYE", {9, 5, 4}, {9, 9, 5, 4}, CLN_LENS_OPENCV_FISHEYE, {0}},
    {15, "FISHEYE", {9, 8, 5, 4}, {9, 8, 5, 4}, CLN_LENS_OPENCV_FISHEYE, {0}},
    {16, "EUCM", {9, 8, 5, 4, 0.6, 1.1}, {9, 8, 5, 4}, CLN_LENS_EUCM, {0.6, 1.1}},
    {17,
     "EQUIRECTANGULAR",
     {200, 100},
     {31.830988618379067, 31.830988618379067, 100, 50},
     CLN_LENS_EQUIRECTANGULAR,
     {0}},
};

static void test_colmap(void **state)
{
    (void)state;
    for (int i = 0; i < CLN_COLMAP_MODELS; i++) {
        const cln_colmap_model *model = &cln_colmap_models[lists[i].id];
        double pixels[4], params[CLN_LENS_PARAMS];
        int count = 0;

        assert_string_equal(model->name, lists[i].name);
        assert_int_equal(model->lens, lists[i].lens);
        assert_int_equal(cln_lens_find(model->name), lists[i].lens);
        while (count < 4 + CLN_LENS_PARAMS && lists[i].values[count] != 0)
            count++;
        assert_int_equal(model->count, count);
        memset(params, 0xFF, sizeof params);
        cln_colmap_split(model, lists[i].values, pixels, params);
        for (int k = 0; k < 4; k++)
            assert_near(pixels[k], lists[i].pixels[k], 1e-14);
        for (int k = 0; k < CLN_LENS_PARAMS; k++)
            assert_near(params[k], lists[i].params[k], 0);
    }
}

static void test_models(void **state)
{
    (void)state;
    for (int lens = 0; lens < CLN_LENSES; lens++) {
        const cln_lens_model *model = &cln_lens_models[lens];

        assert_int_equal(cln_lens_find(model->name), lens);
        assert_in_range(model->count, 0, CLN_LENS_PARAMS);
        for (int i = 0; i < CLN_LENS_PARAMS; i++)
            assert_int_equal(model->params[i] != NULL, i < model->count);
        assert_true(!model->plane != !model->distort && !model->distort == !model->undistort);
    }
    assert_int_equal(cln_lens_find("PERSPECTIVE"), CLN_LENS_OPENCV);
    assert_int_equal(cln_lens_find("plumb_bob"), CLN_LENS_OPENCV);
    assert_int_equal(cln_lens_find("rational_polynomial"), CLN_LENS_FULL_OPENCV);
    assert_int_equal(cln_lens_find("equidistant"), CLN_LENS_OPENCV_FISHEYE);
    assert_int_equal(cln_lens_find("FISHEYE624"), CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE);
    assert_int_equal(cln_lens_find("OMNIDIRECTIONALSTEREO_L"), CLN_LENSES);
    assert_int_equal(cln_lens_find("opencv_Fisheye"), CLN_LENS_OPENCV_FISHEYE);
    assert_int_equal(cln_lens_find(""), CLN_LENSES);
    assert_true(cln_lens_is_pinhole(CLN_LENS_OPENCV, (double[CLN_LENS_PARAMS]){0}));
    assert_true(cln_lens_is_pinhole(CLN_LENS_FULL_OPENCV, (double[CLN_LENS_PARAMS]){0}));
    assert_false(cln_lens_is_pinhole(CLN_LENS_OPENCV_FISHEYE, (double[CLN_LENS_PARAMS]){0}));
    assert_false(cln_lens_is_pinhole(CLN_LENS_EQUIRECTANGULAR, (double[CLN_LENS_PARAMS]){0}));
    for (int i = 0; i < cln_lens_models[CLN_LENS_OPENCV].count; i++) {
        double one[CLN_LENS_PARAMS] = {0};

        one[i] = 1e-9;
        assert_false(cln_lens_is_pinhole(CLN_LENS_OPENCV, one));
    }
    assert_null(cln_lens_models[CLN_LENS_EUCM].refuse((double[]){0, 1}));
    assert_non_null(cln_lens_models[CLN_LENS_EUCM].refuse((double[]){1.1, 1}));
    assert_non_null(cln_lens_models[CLN_LENS_EUCM].refuse((double[]){-0.1, 1}));
    assert_non_null(cln_lens_models[CLN_LENS_EUCM].refuse((double[]){0.5, 0}));
    assert_null(cln_lens_models[CLN_LENS_FOV].refuse((double[]){3.1}));
    assert_non_null(cln_lens_models[CLN_LENS_FOV].refuse((double[]){-3.2}));
}

/* Series of four terms, as of RealityCapture: places by the series itself, over the image. */
static void test_series(void **state)
{
    static const struct {
        double k[4];
        bool near; /* has a quotient */
    } rows[] = {{{-0.05, 0.02, -0.01, 0.02}, true},
                {{0.12, -0.3, 0.25, -0.08}, true},
                {{-0.28, 0.1, -0.02, 0.001}, true},
                {{0, 0, 0, 0.05}, true},
                {{-3, 30, -90, 200}, false}};

    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const double *k = rows[i].k, p1 = 0.001, p2 = -0.0005;
        cln_camera c = {.width = 4000,
                        .height = 3000,
                        .fx = 3000,
                        .fy = 3000,
                        .cx = 2000,
                        .cy = 1500,
                        .lens = CLN_LENS_OPENCV,
                        .distortion = {k[0], k[1], p1, p2}};
        double worst = 0;

        cln_clear_error();
        assert_int_equal(cln_camera_add_terms(&c, k + 2, "frame 3"),
                         rows[i].near ? CLN_OK : CLN_INPUT);
        if (!rows[i].near) {
            assert_non_null(strstr(cln_error_text(), "frame 3: its lens has four terms"));
            continue;
        }
        assert_int_equal(c.lens, CLN_LENS_FULL_OPENCV);
        for (int at = 0; at < 400; at++) {
            const double x = (at % 20 - 9.5) / 15, y = (double)(at / 20 - 9.5) / 20;
            const double t = x * x + y * y;
            const double by = 1 + t * (k[0] + t * (k[1] + t * (k[2] + t * k[3])));
            const double u = x * by + 2 * p1 * x * y + p2 * (t + 2 * x * x);
            const double v = y * by + p1 * (t + 2 * y * y) + 2 * p2 * x * y;
            double place[2];

            assert_true(cln_lens_distort(c.lens, c.distortion, (double[3]){x, y, 1}, place));
            worst = fmax(worst, 3000 * hypot(place[0] - u, place[1] - v));
        }
        if (!(worst < 0.1))
            fail_msg("row %zu: off by %g pixels", i, worst);
    }
    cln_clear_error();
}

int test_group_lens(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_by_hand),  cmocka_unit_test(test_round_trip),
        cmocka_unit_test(test_jacobian), cmocka_unit_test(test_limit),
        cmocka_unit_test(test_beyond),   cmocka_unit_test(test_colmap),
        cmocka_unit_test(test_models),   cmocka_unit_test(test_kept),
        cmocka_unit_test(test_series),
    };

    return cmocka_run_group_tests_name("lens", tests, NULL, NULL);
}
