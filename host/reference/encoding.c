/* The frequency encoding (method.md 1), twin of kernels/encoding_frequency.h. See reference.h and
 * model/encoding.h. */
#include <math.h>
#include "reference/reference.h"

void ref_encode(int bands, const double x[3], const double *weights, int pad, double *out)
{
    for (int i = 0; i < pad; i++)
        out[i] = 0;
    for (int a = 0; a < 3; a++)
        out[a] = x[a];
    for (int k = 0; k < bands; k++) {
        double weight = weights ? weights[k] : 1;

        for (int a = 0; a < 3; a++) {
            out[3 + 6 * k + a] = weight * sin(ldexp(x[a], k));
            out[6 + 6 * k + a] = weight * cos(ldexp(x[a], k));
        }
    }
}

/* A corner of the cell that holds a point, and its weight in the value at the point. */
typedef struct corner {
    int vertex;
    double weight;
} corner;

static void corners_at(int cells, const double x[3], corner out[8])
{
    double place[3];
    int cell[3];

    for (int a = 0; a < 3; a++) {
        place[a] = fmin(fmax((x[a] + 1) / 2, 0), 1) * cells;
        cell[a] = (int)fmin(floor(place[a]), cells - 1);
    }
    for (int i = 0; i < 8; i++) {
        out[i] = (corner){0, 1};
        for (int a = 2; a >= 0; a--) {
            const int far = i >> a & 1;
            const double share = place[a] - cell[a];

            out[i].vertex = out[i].vertex * (cells + 1) + cell[a] + far;
            out[i].weight *= far ? share : 1 - share;
        }
    }
}

void ref_grid(int cells, int features, const float *grid, const double x[3], double *out)
{
    corner corners[8];

    corners_at(cells, x, corners);
    for (int f = 0; f < features; f++) {
        out[f] = 0;
        for (int i = 0; i < 8; i++)
            out[f] += corners[i].weight * grid[corners[i].vertex * features + f];
    }
}

void ref_grid_wide(int cells, int features, const double *grid, const double x[3], double *out)
{
    corner corners[8];

    corners_at(cells, x, corners);
    for (int f = 0; f < features; f++) {
        out[f] = 0;
        for (int i = 0; i < 8; i++)
            out[f] += corners[i].weight * grid[corners[i].vertex * features + f];
    }
}

void ref_grid_backward(int cells, int features, const double x[3], const double *dout, double *grad)
{
    corner corners[8];

    corners_at(cells, x, corners);
    for (int i = 0; i < 8; i++)
        for (int f = 0; f < features; f++)
            grad[corners[i].vertex * features + f] += corners[i].weight * dout[f];
}
