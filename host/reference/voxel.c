/* Voxels in float64 (method.md 1), twin of kernels/voxel.cl. See reference.h. */
#include <math.h>
#include "reference/reference.h"

enum { FEATURES = 32, HARMONICS = 9 };

/* The functions of a direction of which colours are weighted sums, each divided by the constant
 * one: real spherical harmonics, as in Sloan, "Efficient Spherical Harmonic Evaluation", JCGT 2(2),
 * 2013. */
static int harmonics(int features, const double d[3], double y[HARMONICS])
{
    const double x = d[0], v = d[1], z = d[2];
    const double all[HARMONICS] = {1,
                                   sqrt(3) * v,
                                   sqrt(3) * z,
                                   sqrt(3) * x,
                                   sqrt(15) * x * v,
                                   sqrt(15) * v * z,
                                   sqrt(5) / 2 * (3 * z * z - 1),
                                   sqrt(15) * x * z,
                                   sqrt(15) / 2 * (x * x - v * v)};

    for (int k = 0; k < HARMONICS; k++)
        y[k] = all[k];
    return features == 4 ? 1 : features == 16 ? 4 : 9;
}

/* Where coefficient k of colour c is among a vertex's numbers. */
static int number_of(int k, int c)
{
    return k == 0 ? c : 4 + 3 * (k - 1) + c;
}

void ref_voxel(const cln_network *net, const float *params, const double local[3],
               const double dir[3], double raw[4])
{
    double at[FEATURES], y[HARMONICS];
    const int count = harmonics(net->features, dir, y);

    ref_grid(net->cells, net->features, params, local, at);
    raw[3] = at[3];
    for (int c = 0; c < 3; c++) {
        raw[c] = 0;
        for (int k = 0; k < count; k++)
            raw[c] += y[k] * at[number_of(k, c)];
    }
}

void ref_voxel_backward(const cln_network *net, const double local[3], const double dir[3],
                        const double draw[4], double *grad)
{
    double d[FEATURES] = {0}, y[HARMONICS];
    const int count = harmonics(net->features, dir, y);

    d[3] = draw[3];
    for (int c = 0; c < 3; c++)
        for (int k = 0; k < count; k++)
            d[number_of(k, c)] = y[k] * draw[c];
    ref_grid_backward(net->cells, net->features, local, d, grad);
}

/* Leaf and vertex of the first leaf around `slot` that has its vertex v, as leaf * vertices +
 * vertex. */
static int first_of(const cln_network *net, const int32_t around[27], int v)
{
    const int side = net->cells + 1;

    for (int i = 0; i < 27; i++) {
        const int x = v % side - (i % 3 - 1) * net->cells;
        const int y = v / side % side - (i / 3 % 3 - 1) * net->cells;
        const int z = v / side / side - (i / 9 - 1) * net->cells;

        if (around[i] >= 0 && x >= 0 && x < side && y >= 0 && y < side && z >= 0 && z < side)
            return ((around[i] * side + z) * side + y) * side + x;
    }
    return -1;
}

void ref_voxel_owners(const cln_network *net, int leaves, const int32_t (*around)[27], int *owner)
{
    const int vertices = (net->cells + 1) * (net->cells + 1) * (net->cells + 1);

    for (int i = 0; i < leaves * vertices; i++)
        owner[i] = first_of(net, around[i / vertices], i % vertices);
}

void ref_voxel_step(double *param, double grad, double *m, double *v, double lr, double beta1,
                    double beta2, double epsilon)
{
    *v = *v == 0 ? 0.1 * grad * grad : beta2 * *v + (1 - beta2) * grad * grad;
    *m = beta1 * *m + (1 - beta1) * grad;
    *param -= lr * *m / (sqrt(*v) + epsilon);
}
