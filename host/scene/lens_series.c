/* A radial series of four terms, as nerfstudio's OPENCV and Metashape's frame cameras may have it,
 * by the quotient of FULL_OPENCV, which has three: the coefficients are fitted over the image, by
 * least squares of what the quotient is off by, weighted again by its denominator. See lens.h. */
#include <math.h>
#include <string.h>
#include "scene/lens.h"

enum { POINTS = 64, ROUNDS = 3, STEPS = 4096, CHECKS = 400, TERMS = 3 };
static const double LEAST_BELOW = 0.1; /* of the denominator: else a pole is near */
static const double PI = 3.14159265358979323846;

/* 1 + k1 t + k2 t^2 + ... */
static double sum(const double *k, int count, double t)
{
    double value = 0;

    for (int i = count - 1; i >= 0; i--)
        value = (value + k[i]) * t;
    return 1 + value;
}

/* The radius that the series brings to `place`, or, where it folds before, the one of the fold. */
static double reach(const double k[4], double place)
{
    double last = 0;

    for (int i = 1; i <= STEPS; i++) {
        const double r = 4 * place * i / STEPS, at = r * sum(k, 4, r * r);

        if (at >= place || at <= last)
            return r;
        last = at;
    }
    return 4 * place;
}

/* Solves a symmetric system of n equations by elimination with pivots; false if it has none. */
static bool solve(int n, double m[2 * TERMS][2 * TERMS], double x[2 * TERMS])
{
    for (int k = 0; k < n; k++) {
        int pivot = k;

        for (int i = k + 1; i < n; i++)
            pivot = fabs(m[i][k]) > fabs(m[pivot][k]) ? i : pivot;
        if (!(fabs(m[pivot][k]) > 0))
            return false;
        for (int j = 0; j < n; j++) {
            const double swap = m[k][j];

            m[k][j] = m[pivot][j];
            m[pivot][j] = swap;
        }
        {
            const double swap = x[k];

            x[k] = x[pivot];
            x[pivot] = swap;
        }
        for (int i = k + 1; i < n; i++) {
            const double by = m[i][k] / m[k][k];

            for (int j = k; j < n; j++)
                m[i][j] -= by * m[k][j];
            x[i] -= by * x[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++)
            x[k] -= m[k][j] * x[j];
        x[k] /= m[k][k];
    }
    return true;
}

/* Fits above[3] and `degree` terms of below[3] to the series over 0 to 1. */
static bool fit(const double k[4], int degree, double above[TERMS], double below[TERMS])
{
    const int n = TERMS + degree;

    memset(below, 0, TERMS * sizeof *below);
    for (int round = 0; round < ROUNDS; round++) {
        double m[2 * TERMS][2 * TERMS] = {{0}}, x[2 * TERMS] = {0};

        for (int p = 0; p < POINTS; p++) {
            const double t = 0.5 * (cos(PI * (p + 0.5) / POINTS) + 1), f = sum(k, 4, t);
            const double weight = t / pow(fmax(sum(below, degree, t), 0.05), 2);
            double row[2 * TERMS];

            for (int i = 0; i < n; i++)
                row[i] = i < TERMS ? pow(t, i + 1) : -f * pow(t, i - TERMS + 1);
            for (int i = 0; i < n; i++) {
                for (int j = 0; j < n; j++)
                    m[i][j] += weight * row[i] * row[j];
                x[i] += weight * row[i] * (f - 1);
            }
        }
        if (!solve(n, m, x))
            return false;
        memcpy(above, x, TERMS * sizeof *above);
        memcpy(below, x + TERMS, (size_t)degree * sizeof *below);
    }
    return true;
}

/* What the quotient is off by at most, over 0 to 1; infinite near a pole. */
static double worst_of(const double k[4], const double above[TERMS], const double below[TERMS])
{
    double worst = 0;

    for (int p = 0; p <= CHECKS; p++) {
        const double t = (double)p / CHECKS, divisor = sum(below, TERMS, t);

        if (!(divisor >= LEAST_BELOW))
            return INFINITY;
        worst = fmax(worst, sqrt(t) * fabs(sum(above, TERMS, t) / divisor - sum(k, 4, t)));
    }
    return worst;
}

double cln_lens_from_series(const double k[4], double place, double out[6])
{
    const double radius = reach(k, place), square = radius * radius;
    double scaled[4], best = INFINITY;

    for (int i = 0; i < 4; i++)
        scaled[i] = k[i] * pow(square, i + 1);
    for (int degree = 1; degree <= TERMS; degree++) {
        double above[TERMS], below[TERMS], worst = INFINITY;

        if (!fit(scaled, degree, above, below))
            continue;
        worst = radius * worst_of(scaled, above, below);
        if (!(worst < best))
            continue;
        best = worst;
        for (int i = 0; i < TERMS; i++) {
            out[i] = above[i] / pow(square, i + 1);
            out[TERMS + i] = below[i] / pow(square, i + 1);
        }
    }
    return best;
}
