/* The forward space and cameras of forward_scene.h. */
#include "check/forward_scene.h"

#include <math.h>
#include <string.h>

cln_space cln_check_forward_space(double unit)
{
    const double a = 0.6, b = -0.4; /* about y, then about x */
    const double axes[9] = {cos(a),  sin(a) * sin(b), sin(a) * cos(b), 0, cos(b), -sin(b),
                            -sin(a), cos(a) * sin(b), cos(a) * cos(b)};
    cln_space space = {{2 * unit, -unit, 0.5 * unit}, 1.5 * unit, true, {0}, {1.25, 1.6}, false};

    memcpy(space.axes, axes, sizeof axes);
    return space;
}

void cln_check_forward_camera(int i, const cln_space *space, int width, int height, cln_camera *c)
{
    static const double places[CLN_FORWARD_VIEWS][3] = {
        {0, 0, 0}, {0.2, -0.1, 0.3}, {-0.25, 0.15, -0.4}, {0.1, 0, 1.2}};
    static const double turns[CLN_FORWARD_VIEWS] = {0, 0.05, -0.06, 0.02};
    const double cosine = cos(turns[i % 4]), sine = sin(turns[i % 4]);
    const double local[9] = {cosine, 0, sine, 0, 1, 0, -sine, 0, cosine}; /* columns: its axes */

    memset(c, 0, sizeof *c);
    for (int a = 0; a < 3; a++) {
        c->c2w[4 * a + 3] = space->centre[a];
        for (int k = 0; k < 3; k++) {
            c->c2w[4 * a + 3] += space->half * places[i % 4][k] * space->axes[3 * k + a];
            for (int m = 0; m < 3; m++)
                c->c2w[4 * a + k] += space->axes[3 * m + a] * local[3 * m + k];
        }
    }
    c->width = width;
    c->height = height;
    c->fx = c->fy = 0.9 * width;
    c->cx = 0.5 * width + 0.13; /* no ray runs along a border of leaves */
    c->cy = 0.5 * height + 0.17;
}
