/* The lens models: which there are, by which names, and the maths of those with closed forms. */
#include "scene/lens.h"

#include <math.h>
#include <string.h>
#include <strings.h>

static const double PI = 3.14159265358979323846;

/* ---- those that bend a plane: where their parameters belong ---- */

static void opencv(const double *k, cln_lens_plane *out)
{
    memcpy(out->above, k, 2 * sizeof *k);
    out->p1 = k[2];
    out->p2 = k[3];
}

static void full_opencv(const double *k, cln_lens_plane *out)
{
    opencv(k, out);
    out->above[2] = k[4];
    memcpy(out->below, k + 5, 3 * sizeof *k);
}

static void opencv_fisheye(const double *k, cln_lens_plane *out)
{
    out->fisheye = true;
    memcpy(out->above, k, 4 * sizeof *k);
}

static void thin_prism_fisheye(const double *k, cln_lens_plane *out)
{
    opencv(k, out);
    out->fisheye = true;
    memcpy(out->above + 2, k + 4, 2 * sizeof *k);
    out->prism[0] = k[6];
    out->prism[2] = k[7];
}

static void rad_tan_thin_prism_fisheye(const double *k, cln_lens_plane *out)
{
    out->fisheye = out->after = true;
    memcpy(out->above, k, 6 * sizeof *k);
    out->p2 = k[6]; /* p0 goes with a, p1 with b */
    out->p1 = k[7];
    memcpy(out->prism, k + 8, 4 * sizeof *k);
}

/* ---- FOV: r' = atan(2 r tan(omega / 2)) / omega ---- */

static bool fov_distort(const double *k, const double direction[3], double place[2])
{
    const double x = direction[0], y = direction[1], z = direction[2], across = hypot(x, y);
    const double r = across / z;
    double scale = 1;

    if (!(z > 0))
        return false;
    if (k[0] != 0)
        scale = r > 0 ? atan(2 * r * tan(0.5 * k[0])) / (k[0] * r) : 2 * tan(0.5 * k[0]) / k[0];
    place[0] = scale * x / z;
    place[1] = scale * y / z;
    return true;
}

static bool fov_undistort(const double *k, const double place[2], double direction[3])
{
    const double r = hypot(place[0], place[1]), angle = r * fabs(k[0]);
    double scale = 1;

    if (!(angle < 0.5 * PI))
        return false;
    if (k[0] != 0)
        scale = r > 0 ? tan(r * k[0]) / (2 * tan(0.5 * k[0]) * r) : k[0] / (2 * tan(0.5 * k[0]));
    direction[0] = scale * place[0];
    direction[1] = scale * place[1];
    direction[2] = 1;
    return true;
}

static const char *fov_refuse(const double *k)
{
    return fabs(k[0]) < PI ? NULL : "omega must lie between -pi and pi";
}

/* ---- DIVISION: direction (a', b', 1 + k r'^2) ---- */

static bool division_distort(const double *k, const double direction[3], double place[2])
{
    const double x = direction[0], y = direction[1], z = direction[2];
    const double bent = -4 * k[0] * (x * x + y * y), root = sqrt(fmax(z * z + bent, 0));
    const double below = z > 0 ? z + root : bent / (root - z); /* the same, without cancellation */

    if (!(z * z + bent >= 0) || !(below > 0)) /* for k < 0 it is above 0 for z <= 0, too */
        return false;
    place[0] = 2 * x / below;
    place[1] = 2 * y / below;
    return true;
}

static bool division_undistort(const double *k, const double place[2], double direction[3])
{
    const double bent = k[0] * (place[0] * place[0] + place[1] * place[1]);

    if (!(bent < 1)) /* z / r falls up to there */
        return false;
    direction[0] = place[0];
    direction[1] = place[1];
    direction[2] = 1 + bent;
    return true;
}

/* ---- EUCM: (x, y) / (alpha d + (1 - alpha) z), d^2 = beta (x^2 + y^2) + z^2 ---- */

static bool eucm_distort(const double *k, const double direction[3], double place[2])
{
    const double x = direction[0], y = direction[1], z = direction[2], alpha = k[0];
    const double d = sqrt(k[1] * (x * x + y * y) + z * z);
    const double below = alpha * d + (1 - alpha) * z;

    if (!(below > 0) || !(alpha <= 0.5 || alpha * z > (alpha - 1) * d))
        return false;
    place[0] = x / below;
    place[1] = y / below;
    return true;
}

static bool eucm_undistort(const double *k, const double place[2], double direction[3])
{
    const double s = k[1] * (place[0] * place[0] + place[1] * place[1]), alpha = k[0];
    const double square = 1 - (2 * alpha - 1) * s;

    if (!(square > 0))
        return false;
    direction[0] = place[0];
    direction[1] = place[1];
    direction[2] = (1 - alpha * alpha * s) / (alpha * sqrt(square) + 1 - alpha);
    return true;
}

static const char *eucm_refuse(const double *k)
{
    return k[0] >= 0 && k[0] <= 1 && k[1] > 0 ? NULL
                                              : "alpha must be 0 to 1, and beta greater than 0";
}

/* ---- EQUIRECTANGULAR: longitude and latitude ---- */

static bool equirectangular_distort(const double *k, const double direction[3], double place[2])
{
    const double across = hypot(direction[0], direction[2]);

    (void)k;
    place[0] = atan2(direction[0], direction[2]);
    place[1] = atan2(direction[1], across);
    return across > 0 || direction[1] != 0;
}

static bool equirectangular_undistort(const double *k, const double place[2], double direction[3])
{
    const double slack = 1e-12; /* the image's edges count */

    (void)k;
    direction[0] = cos(place[1]) * sin(place[0]);
    direction[1] = sin(place[1]);
    direction[2] = cos(place[1]) * cos(place[0]);
    return fabs(place[0]) <= PI + slack && fabs(place[1]) <= 0.5 * PI + slack;
}

/* ---- all of them ---- */

const cln_lens_model cln_lens_models[CLN_LENSES] = {
    [CLN_LENS_OPENCV] = {.name = "OPENCV",
                         .params = {"k1", "k2", "p1", "p2"},
                         .count = 4,
                         .pinhole_at_zero = true,
                         .plane = opencv},
    [CLN_LENS_FULL_OPENCV] = {.name = "FULL_OPENCV",
                              .params = {"k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"},
                              .count = 8,
                              .pinhole_at_zero = true,
                              .plane = full_opencv},
    [CLN_LENS_OPENCV_FISHEYE] = {.name = "OPENCV_FISHEYE",
                                 .params = {"k1", "k2", "k3", "k4"},
                                 .count = 4,
                                 .plane = opencv_fisheye},
    [CLN_LENS_THIN_PRISM_FISHEYE] = {.name = "THIN_PRISM_FISHEYE",
                                     .params = {"k1", "k2", "p1", "p2", "k3", "k4", "sx1", "sy1"},
                                     .count = 8,
                                     .plane = thin_prism_fisheye},
    [CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE] = {.name = "RAD_TAN_THIN_PRISM_FISHEYE",
                                             .params = {"k0", "k1", "k2", "k3", "k4", "k5", "p0",
                                                        "p1", "s0", "s1", "s2", "s3"},
                                             .count = 12,
                                             .plane = rad_tan_thin_prism_fisheye},
    [CLN_LENS_FOV] = {.name = "FOV",
                      .params = {"omega"},
                      .count = 1,
                      .pinhole_at_zero = true,
                      .distort = fov_distort,
                      .undistort = fov_undistort,
                      .refuse = fov_refuse},
    [CLN_LENS_DIVISION] = {.name = "DIVISION",
                           .params = {"k"},
                           .count = 1,
                           .pinhole_at_zero = true,
                           .distort = division_distort,
                           .undistort = division_undistort},
    [CLN_LENS_EUCM] = {.name = "EUCM",
                       .params = {"alpha", "beta"},
                       .count = 2,
                       .distort = eucm_distort,
                       .undistort = eucm_undistort,
                       .refuse = eucm_refuse},
    [CLN_LENS_EQUIRECTANGULAR] = {.name = "EQUIRECTANGULAR",
                                  .distort = equirectangular_distort,
                                  .undistort = equirectangular_undistort},
};

/* Ids and lists of parameters: colmap/src/colmap/sensor/models.h. */
const cln_colmap_model cln_colmap_models[CLN_COLMAP_MODELS] = {
    {"SIMPLE_PINHOLE", CLN_LENS_OPENCV, 1, 3},
    {"PINHOLE", CLN_LENS_OPENCV, 2, 4},
    {"SIMPLE_RADIAL", CLN_LENS_OPENCV, 1, 4},
    {"RADIAL", CLN_LENS_OPENCV, 1, 5},
    {"OPENCV", CLN_LENS_OPENCV, 2, 8},
    {"OPENCV_FISHEYE", CLN_LENS_OPENCV_FISHEYE, 2, 8},
    {"FULL_OPENCV", CLN_LENS_FULL_OPENCV, 2, 12},
    {"FOV", CLN_LENS_FOV, 2, 5},
    {"SIMPLE_RADIAL_FISHEYE", CLN_LENS_OPENCV_FISHEYE, 1, 4},
    {"RADIAL_FISHEYE", CLN_LENS_OPENCV_FISHEYE, 1, 5},
    {"THIN_PRISM_FISHEYE", CLN_LENS_THIN_PRISM_FISHEYE, 2, 12},
    {"RAD_TAN_THIN_PRISM_FISHEYE", CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE, 2, 16},
    {"SIMPLE_DIVISION", CLN_LENS_DIVISION, 1, 4},
    {"DIVISION", CLN_LENS_DIVISION, 2, 5},
    {"SIMPLE_FISHEYE", CLN_LENS_OPENCV_FISHEYE, 1, 3},
    {"FISHEYE", CLN_LENS_OPENCV_FISHEYE, 2, 4},
    {"EUCM", CLN_LENS_EUCM, 2, 6},
    {"EQUIRECTANGULAR", CLN_LENS_EQUIRECTANGULAR, 0, 2},
};

bool cln_lens_is_fisheye(cln_lens lens)
{
    return lens == CLN_LENS_OPENCV_FISHEYE || lens == CLN_LENS_THIN_PRISM_FISHEYE ||
           lens == CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE;
}

const cln_colmap_model *cln_colmap_find(const char *name)
{
    for (int i = 0; i < CLN_COLMAP_MODELS; i++)
        if (!strcasecmp(name, cln_colmap_models[i].name))
            return &cln_colmap_models[i];
    return NULL;
}

void cln_colmap_split(const cln_colmap_model *model, const double *values, double pixels[4],
                      double params[CLN_LENS_PARAMS])
{
    const int n = model->focals;

    memset(params, 0, CLN_LENS_PARAMS * sizeof *params);
    if (n == 0) {
        pixels[0] = values[0] / (2 * PI);
        pixels[1] = values[1] / PI;
        pixels[2] = 0.5 * values[0];
        pixels[3] = 0.5 * values[1];
        return;
    }
    pixels[0] = values[0];
    pixels[1] = values[n - 1];
    memcpy(pixels + 2, values + n, 2 * sizeof *pixels);
    memcpy(params, values + n + 2, (size_t)(model->count - n - 2) * sizeof *params);
}

cln_lens cln_lens_find(const char *name)
{
    static const struct {
        const char *name;
        cln_lens lens;
    } others[] = {{"PERSPECTIVE", CLN_LENS_OPENCV},
                  {"FISHEYE624", CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE},
                  /* ROS's distortion_model, whose parameters have the same order; Kalibr's */
                  {"plumb_bob", CLN_LENS_OPENCV},
                  {"rational_polynomial", CLN_LENS_FULL_OPENCV},
                  {"equidistant", CLN_LENS_OPENCV_FISHEYE},
                  {"pinhole-radtan", CLN_LENS_OPENCV},
                  {"pinhole-equi", CLN_LENS_OPENCV_FISHEYE}};
    const cln_colmap_model *model = cln_colmap_find(name);

    if (model)
        return model->lens;
    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        if (!strcasecmp(name, others[i].name))
            return others[i].lens;
    return CLN_LENSES;
}

bool cln_lens_is_pinhole(cln_lens lens, const double *params)
{
    const cln_lens_model *model = &cln_lens_models[lens];

    for (int i = 0; i < model->count; i++)
        if (params[i] != 0)
            return false;
    return model->pinhole_at_zero;
}

bool cln_lens_distort(cln_lens lens, const double *params, const double direction[3],
                      double place[2])
{
    const cln_lens_model *model = &cln_lens_models[lens];
    cln_lens_plane plane = {0};

    if (!model->plane)
        return model->distort(params, direction, place);
    model->plane(params, &plane);
    return cln_lens_plane_distort(&plane, direction, place);
}

bool cln_lens_undistort(cln_lens lens, const double *params, const double place[2],
                        double direction[3])
{
    const cln_lens_model *model = &cln_lens_models[lens];
    cln_lens_plane plane = {0};

    if (!model->plane)
        return model->undistort(params, place, direction);
    model->plane(params, &plane);
    return cln_lens_plane_undistort(&plane, place, direction);
}

double cln_lens_limit(cln_lens lens, const double *params)
{
    const cln_lens_model *model = &cln_lens_models[lens];
    cln_lens_plane plane = {0};

    if (!model->plane)
        return INFINITY;
    model->plane(params, &plane);
    return cln_lens_plane_limit(&plane);
}
