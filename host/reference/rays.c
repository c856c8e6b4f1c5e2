/* Rays through the tree by brute force: a slab test on every ACTIVE leaf, then order by distance.
 * The kernels walk the tree instead, so a mistake in one is not in the other. See reference.h. */
#include <math.h>
#include "reference/reference.h"

static const double min_chord = 1e-5;

/* Cuts [*t_in, *t_out] to the part where the ray is inside [low, high) along an axis; the cube's
 * upper face counts as inside. False if nothing is left. */
static bool cut_slab(double origin, double direction, double low, double high, double *t_in,
                     double *t_out)
{
    double a = 0, b = 0;

    if (direction == 0)
        return origin >= low && (origin < high || (high == 1 && origin == 1));
    a = (low - origin) / direction;
    b = (high - origin) / direction;
    *t_in = fmax(*t_in, fmin(a, b));
    *t_out = fmin(*t_out, fmax(a, b));
    return *t_in < *t_out;
}

int ref_intervals(const cln_octree *tree, const double origin[3], const double direction[3],
                  ref_interval *out, int max)
{
    int count = 0;

    for (int slot = 0; slot < tree->leaf_count; slot++) {
        int node = tree->leaf[slot];
        double side = 2.0 / (1 << tree->level[node]);
        double t_in = 0, t_out = INFINITY;
        bool hit = true;
        int at = 0;

        for (int a = 0; a < 3 && hit; a++) {
            double low = -1 + side * tree->pos[node][a];
            hit = cut_slab(origin[a], direction[a], low, low + side, &t_in, &t_out);
        }
        if (!hit || !(t_out - t_in > min_chord))
            continue;
        /* insertion sort; of more than max, the farthest are dropped */
        at = count < max ? count : max;
        count++;
        while (at > 0 && out[at - 1].t_in > t_in) {
            if (at < max)
                out[at] = out[at - 1];
            at--;
        }
        if (at < max)
            out[at] = (ref_interval){slot, t_in, t_out};
    }
    return count;
}
