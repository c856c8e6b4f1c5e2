/* See eigen.h. */
#include "base/eigen.h"

#include <math.h>
#include <string.h>

enum { SWEEPS = 12 }; /* plenty for so few */

/* One of Jacobi's turns: of rows and columns p and q of m, and of the vectors. */
static void turn(int n, double m[CLN_EIGEN_MOST][CLN_EIGEN_MOST],
                 double v[CLN_EIGEN_MOST][CLN_EIGEN_MOST], int p, int q)
{
    const double gap = m[p][p] - m[q][q], twice = 2 * m[p][q];
    /* 45 degrees at most: larger turns also swap values, again and again, without an end */
    const double angle = 0.5 * atan2(gap < 0 ? -twice : twice, fabs(gap));
    const double c = cos(angle), s = sin(angle);

    for (int k = 0; k < n; k++) {
        const double a = m[p][k], b = m[q][k], x = v[p][k], y = v[q][k];

        m[p][k] = c * a + s * b;
        m[q][k] = c * b - s * a;
        v[p][k] = c * x + s * y;
        v[q][k] = c * y - s * x;
    }
    for (int k = 0; k < n; k++) {
        const double a = m[k][p], b = m[k][q];

        m[k][p] = c * a + s * b;
        m[k][q] = c * b - s * a;
    }
}

void cln_eigen(int n, const double *matrix, double *value, double *vector)
{
    double m[CLN_EIGEN_MOST][CLN_EIGEN_MOST] = {{0}}, v[CLN_EIGEN_MOST][CLN_EIGEN_MOST] = {{0}};

    for (int i = 0; i < n; i++) {
        memcpy(m[i], matrix + (size_t)i * n, (size_t)n * sizeof *matrix);
        v[i][i] = 1;
    }
    for (int sweep = 0; sweep < SWEEPS; sweep++)
        for (int apart = 1; apart <= n / 2; apart++)
            for (int p = 0; p < n; p++)
                turn(n, m, v, p, (p + apart) % n);
    for (int i = 0; i < n; i++) {
        int rank = 0;

        for (int k = 0; k < n; k++)
            rank += m[k][k] < m[i][i] || (m[k][k] == m[i][i] && k < i);
        value[rank] = m[i][i];
        memcpy(vector + (size_t)rank * n, v[i], (size_t)n * sizeof *vector);
    }
}

void cln_eigen_invert(const double m[9], double least, double out[9])
{
    double value[3], axis[3][3];

    cln_eigen(3, m, value, axis[0]);
    memset(out, 0, 9 * sizeof *out);
    for (int e = 0; e < 3; e++)
        for (int k = 0; k < 9; k++)
            out[k] +=
                axis[e][k / 3] * axis[e][k % 3] / fmax(value[e], fmax(least * value[2], 1e-30));
}
