/* Cameras: pixel to ray, point to pixel, and the checks that every reader's cameras pass through.
 * See scene.h for the model; the device's twin of the ray function is tested against this one. */
#include "scene/build.h"

#include <math.h>
#include <string.h>
#include "io/image.h"

static const double ROTATION_LIMIT = 1e-3; /* largest entry of R minus the nearest rotation */
static const double POSITION_LIMIT = 1e12; /* squares of it must stay far from overflow */

bool cln_camera_is_distorted(const cln_camera *camera)
{
    return camera->k1 != 0 || camera->k2 != 0 || camera->p1 != 0 || camera->p2 != 0;
}

/* (a, b) -> (a', b') of scene.h, and its Jacobian {da'/da, da'/db, db'/da, db'/db} (NULL: not
 * asked). */
static void distort(const cln_camera *c, const double p[2], double out[2], double jacobian[4])
{
    const double a = p[0], b = p[1], r2 = a * a + b * b;
    const double radial = 1 + r2 * (c->k1 + r2 * c->k2);
    const double slope = 2 * (c->k1 + 2 * r2 * c->k2); /* d radial / da = slope a */

    out[0] = a * radial + 2 * c->p1 * a * b + c->p2 * (r2 + 2 * a * a);
    out[1] = b * radial + c->p1 * (r2 + 2 * b * b) + 2 * c->p2 * a * b;
    if (jacobian) {
        jacobian[0] = radial + slope * a * a + 2 * c->p1 * b + 6 * c->p2 * a;
        jacobian[1] = slope * a * b + 2 * c->p1 * a + 2 * c->p2 * b;
        jacobian[2] = jacobian[1];
        jacobian[3] = radial + slope * b * b + 6 * c->p1 * b + 2 * c->p2 * a;
    }
}

/* Squared radius where r (1 + k1 r2 + k2 r2^2) stops growing: the smallest s > 0 with
 * 1 + 3 k1 s + 5 k2 s^2 = 0. Beyond it the model folds back and pixels would have two rays. */
static double fold_radius2(const cln_camera *c)
{
    const double p = 3 * c->k1, q = 5 * c->k2;
    const double discriminant = p * p - 4 * q;

    if (discriminant < 0)
        return INFINITY;
    /* 2 / (-p +- sqrt): the form of the roots that survives q = 0. */
    for (int sign = 1; sign >= -1; sign -= 2) {
        const double below = -p + sign * sqrt(discriminant);

        if (below > 0)
            return 2 / below;
    }
    return INFINITY;
}

/* Radius r in [0, limit] with r (1 + k1 r2 + k2 r2^2) = target, by bisection: slow and certain. */
static double undistort_radius(const cln_camera *c, double target, double limit)
{
    double low = 0, high = limit;

    if (!isfinite(high))
        for (high = target + 1; high * (1 + high * high * (c->k1 + high * high * c->k2)) < target;)
            high *= 2;
    for (int i = 0; i < 60; i++) {
        const double r = 0.5 * (low + high), r2 = r * r;

        if (r * (1 + r2 * (c->k1 + r2 * c->k2)) < target)
            low = r;
        else
            high = r;
    }
    return 0.5 * (low + high);
}

/* Newton from p, halving steps that do not help; true if it ends at a point before the fold whose
 * image is `target` to 1e-12. */
static bool newton(const cln_camera *c, const double target[2], double fold2, double p[2])
{
    double image[2], jacobian[4], error = 0;

    distort(c, p, image, jacobian);
    error = hypot(image[0] - target[0], image[1] - target[1]);
    for (int i = 0; i < 60 && error > 1e-15; i++) {
        const double det = jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2];
        const double ea = target[0] - image[0], eb = target[1] - image[1];
        const double step[2] = {(jacobian[3] * ea - jacobian[1] * eb) / det,
                                (jacobian[0] * eb - jacobian[2] * ea) / det};
        double next[2], next_error = INFINITY, share = 1;

        if (!isfinite(step[0]) || !isfinite(step[1]))
            return false;
        for (; share > 1e-4; share *= 0.5) {
            next[0] = p[0] + share * step[0];
            next[1] = p[1] + share * step[1];
            distort(c, next, image, jacobian);
            next_error = hypot(image[0] - target[0], image[1] - target[1]);
            if (next_error < error)
                break;
        }
        if (!(next_error < error))
            break; /* at rounding's floor, or stuck; the test below tells which */
        memcpy(p, next, sizeof next);
        error = next_error;
    }
    distort(c, p, image, jacobian);
    return error <= 1e-12 * (1 + hypot(target[0], target[1])) &&
           p[0] * p[0] + p[1] * p[1] < fold2 &&
           jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2] > 0;
}

static bool undistort(const cln_camera *c, const double target[2], double p[2])
{
    const double fold2 = fold_radius2(c), radius = hypot(target[0], target[1]);
    double r = 0;

    /* Mild lenses end here after a few steps. */
    memcpy(p, target, 2 * sizeof *p);
    if (newton(c, target, fold2, p))
        return true;
    /* Strong ones start from the solution of the radial part, kept off the fold. */
    r = undistort_radius(c, radius, sqrt(fold2)) * (isfinite(fold2) ? 0.999 : 1);
    p[0] = radius > 0 ? target[0] / radius * r : 0;
    p[1] = radius > 0 ? target[1] / radius * r : 0;
    return newton(c, target, fold2, p);
}

bool cln_camera_ray(const cln_camera *camera, double u, double v, double origin[3],
                    double direction[3])
{
    const double *m = camera->c2w;
    const double target[2] = {(u - camera->cx) / camera->fx, (v - camera->cy) / camera->fy};
    double p[2] = {target[0], target[1]}, length = 0;
    bool found = true;

    if (cln_camera_is_distorted(camera) && !undistort(camera, target, p)) {
        found = false;
        memcpy(p, target, sizeof p);
    }
    length = sqrt(p[0] * p[0] + p[1] * p[1] + 1);
    for (int i = 0; i < 3; i++) {
        origin[i] = m[4 * i + 3];
        direction[i] = (m[4 * i] * p[0] + m[4 * i + 1] * p[1] + m[4 * i + 2]) / length;
    }
    return found;
}

bool cln_camera_project(const cln_camera *camera, const double point[3], double *u, double *v,
                        double *z)
{
    const double *m = camera->c2w;
    double local[3] = {0}, p[2], image[2];

    for (int axis = 0; axis < 3; axis++)
        for (int i = 0; i < 3; i++)
            local[axis] += m[4 * i + axis] * (point[i] - m[4 * i + 3]);
    *u = *v = 0;
    *z = local[2];
    if (!(local[2] > 0))
        return false;
    p[0] = local[0] / local[2];
    p[1] = local[1] / local[2];
    distort(camera, p, image, NULL);
    *u = camera->fx * image[0] + camera->cx;
    *v = camera->fy * image[1] + camera->cy;
    return true;
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

/* The rotation nearest to r (row-major 3x3), by Newton's iteration for the polar decomposition:
 * X <- (X + X^-T) / 2. Wants det(r) > 0. */
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
    det = r[0] * (r[4] * r[8] - r[5] * r[7]) - r[1] * (r[3] * r[8] - r[5] * r[6]) +
          r[2] * (r[3] * r[7] - r[4] * r[6]);
    if (det < 0.5)
        return cln_fail(CLN_INPUT,
                        "%s: the pose is not rigid: the determinant of its rotation part is "
                        "%g instead of 1%s",
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
    const double numbers[8] = {camera->fx, camera->fy, camera->cx, camera->cy,
                               camera->k1, camera->k2, camera->p1, camera->p2};
    static const char *const names[8] = {"fl_x", "fl_y", "cx", "cy", "k1", "k2", "p1", "p2"};

    if (camera->width < 1 || camera->height < 1 || camera->width > CLN_IMAGE_MAX_SIDE ||
        camera->height > CLN_IMAGE_MAX_SIDE ||
        (int64_t)camera->width * camera->height > CLN_IMAGE_MAX_PIXELS)
        return cln_fail(
            CLN_INPUT, "%s: absurd image size %d x %d; the limits are 1 to %d a side and %d in all",
            frame, camera->width, camera->height, CLN_IMAGE_MAX_SIDE, CLN_IMAGE_MAX_PIXELS);
    for (int i = 0; i < 8; i++) {
        /* Pixels: a focal length of 1e-3 to 1e5 image sides; distortion: far more than lenses have.
         */
        const double largest = i < 4 ? 1e5 * fmax(camera->width, camera->height) : 1e3;

        if (!isfinite(numbers[i]) || fabs(numbers[i]) > largest ||
            (i < 2 && numbers[i] < 1e-3 * camera->width))
            return cln_fail(CLN_INPUT, "%s: absurd %s = %g for an image of %d x %d pixels", frame,
                            names[i], numbers[i], camera->width, camera->height);
    }
    return check_pose(camera, frame);
}
