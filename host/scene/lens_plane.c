/* Bent planes, and their inverse by a damped Newton's method with a check. See lens_plane.h. */
#include "scene/lens_plane.h"

#include <math.h>
#include <string.h>

/* The most terms of a polynomial here: of `above` times `below`. */
enum { TERMS = CLN_LENS_ABOVE + CLN_LENS_BELOW + 1 };

static const double PI = 3.14159265358979323846;

/* Where a perspective model counts as endless: 89.994 degrees from the axis. */
static const double FARTHEST = 1e4;

/* ---- the radial part ---- */

/* 1 + c[0] s + c[1] s^2 + .., and its derivative. */
static double one_plus(const double *c, int count, double s, double *slope)
{
    double value = 0;

    *slope = 0;
    for (int i = count - 1; i >= 0; i--) {
        *slope = *slope * s + (i + 1) * c[i];
        value = value * s + c[i];
    }
    return 1 + s * value;
}

/* R(s), and dR/ds. */
static double radial(const cln_lens_plane *plane, double s, double *slope)
{
    double up, down;
    const double n = one_plus(plane->above, CLN_LENS_ABOVE, s, &up);
    const double d = one_plus(plane->below, CLN_LENS_BELOW, s, &down);

    *slope = (up - n / d * down) / d;
    return n / d;
}

static double radius_of(const cln_lens_plane *plane, double r)
{
    double slope;

    return r * radial(plane, r * r, &slope);
}

static double polynomial(const double *c, int terms, double s)
{
    double value = 0;

    for (int i = terms - 1; i >= 0; i--)
        value = value * s + c[i];
    return value;
}

/* Roots of a polynomial in (0, end), ascending, where it changes its sign: one at most between two
 * of its extremes, which are the roots of its derivative. */
static int find_roots(const double *c, int terms, double end, double *roots)
{
    double derivative[TERMS], extremes[TERMS + 1] = {0};
    int found = 0, pieces = 0;

    while (terms > 0 && c[terms - 1] == 0)
        terms--;
    if (terms < 2)
        return 0;
    for (int i = 1; i < terms; i++)
        derivative[i - 1] = i * c[i];
    pieces = 1 + find_roots(derivative, terms - 1, end, extremes + 1);
    for (int k = 0; k < pieces; k++) {
        double low = extremes[k], high = k + 1 < pieces ? extremes[k + 1] : end;
        const bool sign = polynomial(c, terms, low) > 0;

        if ((polynomial(c, terms, high) > 0) == sign)
            continue;
        for (int i = 0; i < 100; i++) {
            const double middle = 0.5 * (low + high);

            if ((polynomial(c, terms, middle) > 0) == sign)
                low = middle;
            else
                high = middle;
        }
        roots[found++] = low;
    }
    return found;
}

/* Is 1 + c[1] s + .. positive on all of [0, end]? */
static bool stays_positive(const double *c, int terms, double end)
{
    double roots[TERMS], most = 0;

    for (int i = terms - 1; i > 0; i--)
        most = (most + fabs(c[i])) * end;
    return most < 1 || find_roots(c, terms, end, roots) == 0;
}

/* With n and d above and below: (d r R / dr) d^2 = n d + 2 s (n' d - n d'), by powers of s; and d.
 * Both are 1 at 0, and the model's fold is where the first of them turns negative. */
static void slope_terms(const cln_lens_plane *plane, double slope[TERMS],
                        double below[CLN_LENS_BELOW + 1])
{
    double above[CLN_LENS_ABOVE + 1] = {1};

    below[0] = 1;
    memcpy(above + 1, plane->above, sizeof plane->above);
    memcpy(below + 1, plane->below, sizeof plane->below);
    memset(slope, 0, TERMS * sizeof *slope);
    for (int i = 0; i <= CLN_LENS_ABOVE; i++)
        for (int j = 0; j <= CLN_LENS_BELOW; j++)
            slope[i + j] += above[i] * below[j] * (1 + 2 * (i - j));
}

double cln_lens_plane_limit(const cln_lens_plane *plane)
{
    const double end = plane->fisheye ? PI : FARTHEST;
    double slope[TERMS], below[CLN_LENS_BELOW + 1], roots[TERMS], limit = end * end;

    slope_terms(plane, slope, below);
    if (find_roots(slope, TERMS, end * end, roots))
        limit = fmin(limit, roots[0]);
    if (find_roots(below, CLN_LENS_BELOW + 1, end * end, roots))
        limit = fmin(limit, roots[0]);
    return plane->fisheye || limit < end * end ? sqrt(limit) : INFINITY;
}

/* Is a point before the fold? */
static bool is_inside(const cln_lens_plane *plane, const double p[2])
{
    const double s = p[0] * p[0] + p[1] * p[1];
    double slope[TERMS], below[CLN_LENS_BELOW + 1];

    slope_terms(plane, slope, below);
    return s < (plane->fisheye ? PI * PI : INFINITY) && stays_positive(slope, TERMS, s) &&
           stays_positive(below, CLN_LENS_BELOW + 1, s);
}

/* Radius r below `limit` with r R(r^2) = target, by bisection: slow and certain. */
static double unbend_radius(const cln_lens_plane *plane, double target, double limit)
{
    double low = 0, high = limit;

    if (!isfinite(high))
        for (high = target + 1; high < FARTHEST && radius_of(plane, high) < target;)
            high *= 2;
    for (int i = 0; i < 60; i++) {
        const double r = 0.5 * (low + high);

        if (radius_of(plane, r) < target)
            low = r;
        else
            high = r;
    }
    return 0.5 * (low + high);
}

/* ---- all terms ---- */

void cln_lens_plane_bend(const cln_lens_plane *plane, const double point[2], double place[2],
                         double jacobian[4])
{
    const double a = point[0], b = point[1];
    const double p1 = plane->p1, p2 = plane->p2, *prism = plane->prism;
    double slope, factor = radial(plane, a * a + b * b, &slope);
    const double x = plane->after ? a * factor : a, y = plane->after ? b * factor : b;
    const double s = x * x + y * y;

    place[0] = a * factor + 2 * p1 * x * y + p2 * (s + 2 * x * x) + s * (prism[0] + s * prism[1]);
    place[1] = b * factor + p1 * (s + 2 * y * y) + 2 * p2 * x * y + s * (prism[2] + s * prism[3]);
    if (jacobian) {
        const double radials[3] = {factor + 2 * slope * a * a, 2 * slope * a * b,
                                   factor + 2 * slope * b * b};
        const double first = 2 * (prism[0] + 2 * s * prism[1]);
        const double second = 2 * (prism[2] + 2 * s * prism[3]);
        const double others[4] = {
            2 * p1 * y + (6 * p2 + first) * x, 2 * p1 * x + (2 * p2 + first) * y,
            2 * p2 * y + (2 * p1 + second) * x, 2 * p2 * x + (6 * p1 + second) * y};

        for (int row = 0; row < 2; row++)
            for (int column = 0; column < 2; column++) {
                const double *o = others + 2 * row;

                jacobian[2 * row + column] =
                    radials[row + column] +
                    (plane->after ? o[0] * radials[column] + o[1] * radials[column + 1]
                                  : o[column]);
            }
    }
}

static double determinant(const double jacobian[4])
{
    return jacobian[0] * jacobian[3] - jacobian[1] * jacobian[2];
}

/* Newton's method from p, halving steps that do not help; true if it ends at a point before the
 * fold whose image is `target` to 1e-12. */
static bool newton(const cln_lens_plane *plane, const double target[2], int steps, double p[2])
{
    double image[2], jacobian[4], error = 0;

    cln_lens_plane_bend(plane, p, image, jacobian);
    error = hypot(image[0] - target[0], image[1] - target[1]);
    for (int i = 0; i < steps && error > 1e-15; i++) {
        const double det = determinant(jacobian);
        const double ea = target[0] - image[0], eb = target[1] - image[1];
        const double step[2] = {(jacobian[3] * ea - jacobian[1] * eb) / det,
                                (jacobian[0] * eb - jacobian[2] * ea) / det};
        double next[2], next_error = INFINITY, share = 1;

        if (!isfinite(step[0]) || !isfinite(step[1]))
            return false;
        for (; share > 1e-4; share *= 0.5) {
            next[0] = p[0] + share * step[0];
            next[1] = p[1] + share * step[1];
            cln_lens_plane_bend(plane, next, image, jacobian);
            next_error = hypot(image[0] - target[0], image[1] - target[1]);
            if (next_error < error)
                break;
        }
        if (!(next_error < error))
            break; /* at rounding's floor, or stuck; the test below tells which */
        memcpy(p, next, sizeof next);
        error = next_error;
    }
    cln_lens_plane_bend(plane, p, image, jacobian);
    return error <= 1e-12 * (1 + hypot(target[0], target[1])) && determinant(jacobian) > 0 &&
           is_inside(plane, p);
}

static bool is_radial(const cln_lens_plane *plane)
{
    bool others = plane->p1 != 0 || plane->p2 != 0;

    for (int i = 0; i < 4; i++)
        others = others || plane->prism[i] != 0;
    return !others;
}

static bool unbend(const cln_lens_plane *plane, const double place[2], double p[2])
{
    const double radius = hypot(place[0], place[1]);
    double limit = 0, r = 0;

    /* Mild lenses end here after a few steps. */
    memcpy(p, place, 2 * sizeof *p);
    if (newton(plane, place, 12, p))
        return true;
    /* Strong ones start from the solution of the radial part, kept off the fold. */
    limit = cln_lens_plane_limit(plane);
    if (is_radial(plane) && isfinite(limit) && radius >= radius_of(plane, limit))
        return false;
    r = unbend_radius(plane, radius, limit) * (isfinite(limit) ? 0.999 : 1);
    p[0] = radius > 0 ? place[0] / radius * r : 0;
    p[1] = radius > 0 ? place[1] / radius * r : 0;
    return newton(plane, place, 60, p);
}

/* ---- directions ---- */

bool cln_lens_plane_distort(const cln_lens_plane *plane, const double direction[3], double place[2])
{
    const double x = direction[0], y = direction[1], z = direction[2], across = hypot(x, y);
    double point[2];

    if (!plane->fisheye && !(z > 0))
        return false;
    if (plane->fisheye && !(across > 0 || z > 0)) /* no direction, or straight back */
        return false;
    for (int i = 0; i < 2; i++)
        point[i] = !plane->fisheye ? direction[i] / z
                   : across > 0    ? direction[i] * (atan2(across, z) / across)
                                   : 0;
    if (!is_inside(plane, point))
        return false;
    cln_lens_plane_bend(plane, point, place, NULL);
    return true;
}

bool cln_lens_plane_undistort(const cln_lens_plane *plane, const double place[2],
                              double direction[3])
{
    double p[2], theta = 0;

    if (!unbend(plane, place, p))
        return false;
    theta = hypot(p[0], p[1]);
    for (int i = 0; i < 2; i++)
        direction[i] = plane->fisheye && theta > 0 ? p[i] * (sin(theta) / theta) : p[i];
    direction[2] = plane->fisheye ? cos(theta) : 1;
    return true;
}
