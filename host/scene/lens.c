/* The lens models' maths, in double. See lens.h for the formulas and for how to add one. */
#include "scene/lens.h"

#include <math.h>
#include <string.h>

/* ---- OPENCV ---- */

enum { K1, K2, P1, P2 };

/* (a, b) -> (a', b') of lens.h, and its Jacobian {da'/da, da'/db, db'/da, db'/db} (NULL: not
 * asked). */
static void bend(const double *k, const double p[2], double out[2], double jacobian[4])
{
    const double a = p[0], b = p[1], r2 = a * a + b * b;
    const double radial = 1 + r2 * (k[K1] + r2 * k[K2]);
    const double slope = 2 * (k[K1] + 2 * r2 * k[K2]); /* d radial / da = slope a */

    out[0] = a * radial + 2 * k[P1] * a * b + k[P2] * (r2 + 2 * a * a);
    out[1] = b * radial + k[P1] * (r2 + 2 * b * b) + 2 * k[P2] * a * b;
    if (jacobian) {
        jacobian[0] = radial + slope * a * a + 2 * k[P1] * b + 6 * k[P2] * a;
        jacobian[1] = slope * a * b + 2 * k[P1] * a + 2 * k[P2] * b;
        jacobian[2] = jacobian[1];
        jacobian[3] = radial + slope * b * b + 6 * k[P1] * b + 2 * k[P2] * a;
    }
}

/* Squared radius where r (1 + k1 r2 + k2 r2^2) stops growing: the smallest s > 0 with
 * 1 + 3 k1 s + 5 k2 s^2 = 0. Beyond it the model folds back and pixels would have two rays. */
static double fold_radius2(const double *k)
{
    const double p = 3 * k[K1], q = 5 * k[K2];
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
static double unbend_radius(const double *k, double target, double limit)
{
    double low = 0, high = limit;

    if (!isfinite(high))
        for (high = target + 1; high * (1 + high * high * (k[K1] + high * high * k[K2])) < target;)
            high *= 2;
    for (int i = 0; i < 60; i++) {
        const double r = 0.5 * (low + high), r2 = r * r;

        if (r * (1 + r2 * (k[K1] + r2 * k[K2])) < target)
            low = r;
        else
            high = r;
    }
    return 0.5 * (low + high);
}

/* Newton's method from p, halving steps that do not help; true if it ends at a point before the
 * fold whose image is `target` to 1e-12. */
static bool newton(const double *k, const double target[2], double fold2, double p[2])
{
    double image[2], jacobian[4], error = 0;

    bend(k, p, image, jacobian);
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
            bend(k, next, image, jacobian);
            next_error = hypot(image[0] - target[0], image[1] - target[1]);
            if (next_error < error)
                break;
        }
        if (!(next_error < error))
            break; /* at rounding's floor, or stuck; the test below tells which */
        memcpy(p, next, sizeof next);
        error = next_error;
    }
    bend(k, p, image, jacobian);
    return error <= 1e-12 * (1 + hypot(target[0], target[1])) &&
           p[0] * p[0] + p[1] * p[1] < fold2 &&
           jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2] > 0;
}

static bool opencv_distort(const double *k, const double direction[3], double place[2])
{
    double p[2];

    if (!(direction[2] > 0))
        return false;
    p[0] = direction[0] / direction[2];
    p[1] = direction[1] / direction[2];
    bend(k, p, place, NULL);
    return true;
}

static bool opencv_undistort(const double *k, const double place[2], double direction[3])
{
    const double fold2 = fold_radius2(k), radius = hypot(place[0], place[1]);
    double r = 0;

    direction[2] = 1;
    /* Mild lenses end here after a few steps. */
    memcpy(direction, place, 2 * sizeof *place);
    if (newton(k, place, fold2, direction))
        return true;
    /* Strong ones start from the solution of the radial part, kept off the fold. */
    r = unbend_radius(k, radius, sqrt(fold2)) * (isfinite(fold2) ? 0.999 : 1);
    direction[0] = radius > 0 ? place[0] / radius * r : 0;
    direction[1] = radius > 0 ? place[1] / radius * r : 0;
    return newton(k, place, fold2, direction);
}

/* ---- all of them ---- */

const cln_lens_model cln_lens_models[CLN_LENSES] = {
    [CLN_LENS_OPENCV] = {"OPENCV",
                         {"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"},
                         {"k1", "k2", "p1", "p2"},
                         4,
                         true,
                         opencv_distort,
                         opencv_undistort},
};

cln_lens cln_lens_find(const char *name)
{
    for (int lens = 0; lens < CLN_LENSES; lens++) {
        const cln_lens_model *model = &cln_lens_models[lens];

        if (!strcmp(name, model->name))
            return (cln_lens)lens;
        for (const char *const *c = model->covers; *c; c++)
            if (!strcmp(name, *c))
                return (cln_lens)lens;
    }
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
