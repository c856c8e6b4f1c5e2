/* The grid's change of coordinates at a split and at a merge. See encoding_grid.h. */
#include "model/encoding_grid.h"

#include <math.h>
#include <string.h>
#include "model/encoding.h"

/* Feature f at grid coordinates g, 0 .. cells per axis; a g beyond the grid is moved to its
 * edge. */
static double grid_value(const cln_network *net, const float *grid, const double g[3], int f)
{
    const int side = net->cells + 1;
    int cell[3];
    double share[3], sum = 0;

    for (int a = 0; a < 3; a++) {
        const double x = fmin(fmax(g[a], 0), net->cells);

        cell[a] = x < net->cells ? (int)x : net->cells - 1;
        share[a] = x - cell[a];
    }
    for (int corner = 0; corner < 8; corner++) {
        double weight = 1;
        int at[3];

        for (int a = 0; a < 3; a++) {
            at[a] = cell[a] + (corner >> a & 1);
            weight *= corner >> a & 1 ? share[a] : 1 - share[a];
        }
        if (weight != 0)
            sum += weight * grid[((at[2] * side + at[1]) * side + at[0]) * net->features + f];
    }
    return sum;
}

/* Copies the layers and resamples the grid: vertex i takes the value of the grid of `from` at
 * coordinate scale i + offset. */
static void resample(const cln_network *net, double scale, const double offset[3],
                     const float *from, float *to)
{
    const int side = net->cells + 1;

    memcpy(to, from, (size_t)net->grid_w * sizeof *to);
    for (int v = 0; v < cln_encoding_vertices(net->cells); v++) {
        const double g[3] = {scale * (v % side) + offset[0], scale * (v / side % side) + offset[1],
                             scale * (v / side / side) + offset[2]};

        for (int f = 0; f < net->features; f++)
            to[net->grid_w + v * net->features + f] =
                (float)grid_value(net, from + net->grid_w, g, f);
    }
}

void cln_grid_split(const cln_network *net, int octant, const float *parent, float *child)
{
    double offset[3];

    for (int a = 0; a < 3; a++)
        offset[a] = octant >> a & 1 ? 0.5 * net->cells : 0;
    resample(net, 0.5, offset, parent, child);
}

void cln_grid_merge(const cln_network *net, int octant, const float *child, float *parent)
{
    double offset[3];

    for (int a = 0; a < 3; a++)
        offset[a] = octant >> a & 1 ? -net->cells : 0;
    resample(net, 2, offset, child, parent);
}
