/* Cameras: pixel to ray, point to pixel, and the checks that every reader's cameras pass through.
 * Lenses are lens.c's. The device's twin of the ray function is tested against this one. */
#include "scene/build.h"

#include <math.h>
#include <string.h>
#include "io/image.h"
#include "scene/vectors.h"

static const double ROTATION_LIMIT = 1e-3; /* largest entry of R minus the nearest rotation */
static const double POSITION_LIMIT = 1e12; /* squares of it must stay far from overflow */

bool cln_camera_is_distorted(const cln_camera *camera)
{
    return !cln_lens_is_pinhole(camera->lens, camera->distortion);
}

bool cln_camera_is_like(const cln_camera *a, const cln_camera *b)
{
    return a->width == b->width && a->height == b->height && a->fx == b->fx && a->fy == b->fy &&
           a->cx == b->cx && a->cy == b->cy && a->lens == b->lens && a->parallel == b->parallel &&
           memcmp(a->distortion, b->distortion, sizeof a->distortion) == 0;
}

unsigned cln_camera_lenses(const cln_camera *camera)
{
    return camera->parallel                  ? 1u << CLN_LENSES
           : cln_camera_is_distorted(camera) ? 1u << camera->lens
                                             : 0;
}

void cln_camera_span_sphere(cln_camera *camera)
{
    const double list[2] = {camera->width, camera->height};
    double pixels[4];

    camera->lens = CLN_LENS_EQUIRECTANGULAR;
    cln_colmap_split(&cln_colmap_models[CLN_COLMAP_EQUIRECTANGULAR], list, pixels,
                     camera->distortion);
    camera->fx = pixels[0];
    camera->fy = pixels[1];
    camera->cx = pixels[2];
    camera->cy = pixels[3];
}

cln_status cln_camera_add_terms(cln_camera *camera, const double terms[2], const char *frame)
{
    const double most = 0.1; /* pixels */
    const double series[4] = {camera->distortion[0], camera->distortion[1], terms[0], terms[1]};
    const double x = fmax(camera->cx, camera->width - camera->cx) / camera->fx;
    const double y = fmax(camera->cy, camera->height - camera->cy) / camera->fy;
    double lens[6] = {0}, off = INFINITY;

    if (hypot(x, y) > 0 && isfinite(hypot(x, y)))
        off = cln_lens_from_series(series, hypot(x, y), lens) * fmax(camera->fx, camera->fy);
    if (!(off <= most))
        return cln_fail(CLN_INPUT,
                        "%s: its lens has four terms, k1 to k4 = %g, %g, %g, %g, to which no lens "
                        "model here comes nearer than %.2g pixels; calibrate it with three (k4 = "
                        "0), or undistort the photos",
                        frame, series[0], series[1], series[2], series[3], off);
    camera->lens = CLN_LENS_FULL_OPENCV;
    memcpy(camera->distortion, lens, 2 * sizeof *lens);
    memcpy(camera->distortion + 4, lens + 2, 4 * sizeof *lens);
    return CLN_OK;
}

bool cln_camera_spans_sphere(const cln_camera *camera)
{
    cln_camera whole = *camera;

    cln_camera_span_sphere(&whole);
    return camera->lens == CLN_LENS_EQUIRECTANGULAR && fabs(camera->cx - whole.cx) < 1 &&
           fabs(camera->cy - whole.cy) < 1 && fabs(camera->fx - whole.fx) < 0.01 * whole.fx &&
           fabs(camera->fy - whole.fy) < 0.01 * whole.fy;
}

bool cln_camera_ray(const cln_camera *camera, double u, double v, double origin[3],
                    double direction[3])
{
    const double *m = camera->c2w;
    const double place[2] = {(u - camera->cx) / camera->fx, (v - camera->cy) / camera->fy};
    const double pinhole[3] = {place[0], place[1], 1};
    double p[3], length = 0;
    bool found = true;

    for (int i = 0; i < 3 && camera->parallel; i++) {
        origin[i] = m[4 * i + 3] + m[4 * i] * place[0] + m[4 * i + 1] * place[1];
        direction[i] = m[4 * i + 2];
    }
    if (camera->parallel)
        return true;
    memcpy(p, pinhole, sizeof p);
    if (cln_camera_is_distorted(camera) &&
        !cln_lens_undistort(camera->lens, camera->distortion, place, p)) {
        found = false;
        memcpy(p, pinhole, sizeof p);
    }
    length = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
    for (int i = 0; i < 3; i++) {
        origin[i] = m[4 * i + 3];
        direction[i] = (m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2] * p[2]) / length;
    }
    return found;
}

bool cln_camera_project(const cln_camera *camera, const double point[3], double *u, double *v,
                        double *z)
{
    const double *m = camera->c2w;
    double local[3] = {0}, place[2];

    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 3; i++)
            local[axis] += m[4 * i + axis] * (point[i] - m[4 * i + 3]);
    *u = *v = 0;
    *z = local[2];
    place[0] = camera->parallel ? local[0] : local[0] / local[2];
    place[1] = camera->parallel ? local[1] : local[1] / local[2];
    if (cln_camera_is_distorted(camera)) {
        if (!cln_lens_distort(camera->lens, camera->distortion, local, place))
            return false;
    } else if (!(local[2] > 0 && isfinite(place[0] * place[0] + place[1] * place[1]))) {
        return false; /* as by the lens models, whose checks for folds take far longer */
    }
    *u = camera->fx * place[0] + camera->cx;
    *v = camera->fy * place[1] + camera->cy;
    return true;
}

bool cln_camera_shows(const cln_camera *camera, const double point[3], double *u, double *v)
{
    double z = 0; /* may be negative: panoramas show what is behind them */

    return cln_camera_project(camera, point, u, v, &z) && *u >= 0 && *v >= 0 &&
           *u < camera->width && *v < camera->height;
}

void cln_camera_resize(cln_camera *camera, int width, int height, double x, double y)
{
    camera->width = width;
    camera->height = height;
    camera->fx /= x;
    camera->cx /= x; /* pixel centres at .5: no half-pixel shift */
    camera->fy /= y;
    camera->cy /= y;
}

/* Finds the largest of the four first, so that nothing is divided by a small number. */
void cln_pose_quaternion(const double c2w[12], double q[4])
{
    const double m[3] = {c2w[0], c2w[5], c2w[10]};
    double sums[4] = {m[0] + m[1] + m[2], 0, 0, 0}, most = 0;
    int k = 0;

    for (int i = 1; i < 4; i++)
        sums[i] = 2 * m[i - 1] - sums[0];
    for (int i = 1; i < 4; i++)
        k = sums[i] > sums[k] ? i : k;
    most = sqrt(1 + sums[k]) / 2;
    q[k] = most;
    for (int a = 0; a < 3; a++) {
        const int b = (a + 1) % 3, c = (a + 2) % 3;
        const double odd = c2w[4 * c + b] - c2w[4 * b + c];  /* 4 q0 q(a + 1) */
        const double even = c2w[4 * b + c] + c2w[4 * c + b]; /* 4 q(b + 1) q(c + 1) */

        if (k == 0)
            q[a + 1] = odd / (4 * most);
        else if (k == a + 1)
            q[0] = odd / (4 * most);
        else
            q[k == b + 1 ? c + 1 : b + 1] = even / (4 * most);
    }
}

void cln_pose_turn(const double q[4], double c2w[12])
{
    const double *v = q + 1;

    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;

        c2w[4 * i + i] = 1 - 2 * (v[j] * v[j] + v[k] * v[k]);
        c2w[4 * i + j] = 2 * (v[i] * v[j] - q[0] * v[k]);
        c2w[4 * i + k] = 2 * (v[i] * v[k] + q[0] * v[j]);
    }
}

/* The rotation nearest to r (row-major 3x3), by Newton's iteration for the polar decomposition,
 * X <- (X + X^-T) / 2. Needs det(r) > 0. */
static void nearest_rotation(double r[9])
{
    for (int step = 0; step < 60; step++) {
        double inverse_t[9], det = 0, change = 0;

        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                const int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;

                inverse_t[3 * i + j] =
                    r[3 * i1 + j1] * r[3 * i2 + j2] - r[3 * i1 + j2] * r[3 * i2 + j1];
            }
        det = r[0] * inverse_t[0] + r[1] * inverse_t[1] + r[2] * inverse_t[2];
        for (int i = 0; i < 9; i++) {
            const double next = 0.5 * (r[i] + inverse_t[i] / det);

            change = fmax(change, fabs(next - r[i]));
            r[i] = next;
        }
        if (change < 1e-15)
            break;
    }
}

static cln_status check_pose(cln_camera *camera, const char *frame)
{
    double *m = camera->c2w;
    double r[9], exact[9], det = 0, off = 0;

    for (int i = 0; i < 12; i++)
        if (!isfinite(m[i]))
            return cln_fail(CLN_INPUT,
                            "%s: the pose has a value that is not finite (row %d column "
                            "%d); remove the frame or repair its matrix",
                            frame, i / 4 + 1, i % 4 + 1);
    for (int i = 0; i < 3; i++) {
        memcpy(r + 3 * i, m + 4 * i, 3 * sizeof *r);
        if (fabs(m[4 * i + 3]) > POSITION_LIMIT)
            return cln_fail(CLN_INPUT, "%s: camera position %g is beyond %g; rescale the scene",
                            frame, m[4 * i + 3], POSITION_LIMIT);
        for (int j = 0; j < 3; j++) /* also keeps the determinant from overflowing */
            if (fabs(r[3 * i + j]) > 1 + 2 * ROTATION_LIMIT)
                return cln_fail(
                    CLN_INPUT,
                    "%s: the pose is not rigid: its rotation part has the entry %g; export "
                    "camera-to-world matrices without scale",
                    frame, r[3 * i + j]);
    }
    det = cln_det3(r);
    if (det < 0.5)
        return cln_fail(CLN_INPUT,
                        "%s: the pose is not rigid: the determinant of its rotation part is "
                        "%g instead of 1%s; export camera-to-world matrices of right-handed axes, "
                        "without scale",
                        frame, det, det < -0.5 ? " (one axis is mirrored)" : "");
    memcpy(exact, r, sizeof exact);
    nearest_rotation(exact);
    for (int i = 0; i < 9; i++)
        off = fmax(off, fabs(r[i] - exact[i]));
    if (!(off <= ROTATION_LIMIT))
        return cln_fail(
            CLN_INPUT,
            "%s: the pose is not rigid: its rotation part is off by %g from the nearest "
            "rotation (limit %g, determinant %g); export camera-to-world matrices without "
            "scale or shear",
            frame, off, ROTATION_LIMIT, det);
    for (int i = 0; i < 3; i++)
        memcpy(m + 4 * i, exact + 3 * i, 3 * sizeof *exact);
    return CLN_OK;
}

cln_status cln_camera_check(cln_camera *camera, const char *frame)
{
    const cln_lens_model *lens = &cln_lens_models[camera->lens];
    const double pixels[4] = {camera->fx, camera->fy, camera->cx, camera->cy};
    static const char *const names[4] = {"fl_x", "fl_y", "cx", "cy"};

    if (camera->width < 1 || camera->height < 1 || camera->width > CLN_IMAGE_MAX_SIDE ||
        camera->height > CLN_IMAGE_MAX_SIDE ||
        (int64_t)camera->width * camera->height > CLN_IMAGE_MAX_PIXELS)
        return cln_fail(CLN_INPUT,
                        "%s: absurd image size %d x %d; the limits are 1 to %d a side and %d in "
                        "all; correct it, or make smaller copies of the images",
                        frame, camera->width, camera->height, CLN_IMAGE_MAX_SIDE,
                        CLN_IMAGE_MAX_PIXELS);
    for (int i = 0; i < 4 + lens->count; i++) {
        const double value = i < 4 ? pixels[i] : camera->distortion[i - 4];
        /* Focal length: 1e-3 to 1e5 image sides. Distortion: far more than lenses have. */
        const double largest = i < 4 ? 1e5 * fmax(camera->width, camera->height) : 1e3;

        if (!isfinite(value) || fabs(value) > largest || (i < 2 && value < 1e-3 * camera->width))
            return cln_fail(CLN_INPUT,
                            "%s: absurd %s = %g for an image of %d x %d pixels; correct the camera "
                            "in the dataset, or remove the frame",
                            frame, i < 4 ? names[i] : lens->params[i - 4], value, camera->width,
                            camera->height);
    }
    if (lens->refuse && lens->refuse(camera->distortion))
        return cln_fail(CLN_INPUT,
                        "%s: the lens model %s has no meaning with these parameters: %s; correct "
                        "the camera in the dataset",
                        frame, lens->name, lens->refuse(camera->distortion));
    return check_pose(camera, frame);
}
