/* Vectors of three doubles: what the geometry of cameras shares. */
#ifndef CLN_VECTORS_H
#define CLN_VECTORS_H

#include <math.h>
#include <stdbool.h>

static inline double cln_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void cln_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* The length of v, which becomes a unit vector unless that is 0. */
static inline double cln_unit(double v[3])
{
    const double length = sqrt(cln_dot(v, v));

    for (int a = 0; a < 3 && length > 0; a++)
        v[a] /= length;
    return length;
}

/* Makes v a unit vector; false if it is too short to have a direction (1e-9). */
static inline bool cln_normalise(double v[3])
{
    const double length = sqrt(cln_dot(v, v));

    if (!(length > 1e-9))
        return false;
    for (int a = 0; a < 3; a++)
        v[a] /= length;
    return true;
}

/* The determinant of a row-major matrix. */
static inline double cln_det3(const double m[9])
{
    return m[0] * (m[4] * m[8] - m[5] * m[7]) - m[1] * (m[3] * m[8] - m[5] * m[6]) +
           m[2] * (m[3] * m[7] - m[4] * m[6]);
}

/* Solves m x = b by Cramer's rule; x is 0 if m has no positive determinant. */
static inline void cln_solve3(const double m[9], const double b[3], double x[3])
{
    const double det = cln_det3(m);

    for (int k = 0; k < 3; k++) { /* column k replaced */
        double n[9];

        for (int i = 0; i < 9; i++)
            n[i] = i % 3 == k ? b[i / 3] : m[i];
        x[k] = !(det > 0) ? 0 : cln_det3(n) / det;
    }
}

/* A camera's pose (OpenCV axes) from its unit axes and position. */
static inline void cln_pose_of_axes(const double right[3], const double down[3],
                                    const double forward[3], const double at[3], double c2w[12])
{
    for (int a = 0; a < 3; a++) {
        c2w[4 * a] = right[a];
        c2w[4 * a + 1] = down[a];
        c2w[4 * a + 2] = forward[a];
        c2w[4 * a + 3] = at[a];
    }
}

#endif
