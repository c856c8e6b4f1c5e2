/* Cross products of differences of points. See normals.h. */
#include "render/normals.h"

#include <math.h>
#include <string.h>
#include "render/picture.h"
#include "scene/vectors.h"

static const double EDGE = 0.05; /* a larger step of depth, as a share of it, is an edge */

typedef struct surface {
    const cln_camera *camera;
    const float *depth, *opacity;
} surface;

/* The point that pixel (x, y) shows; false if it shows none. *range: its distance. */
static bool find_point(const surface *s, int x, int y, double point[3], double *range)
{
    const cln_camera *c = s->camera;
    const size_t i = (size_t)y * (size_t)c->width + (size_t)x;
    double direction[3];

    if (x < 0 || y < 0 || x >= c->width || y >= c->height)
        return false;
    if (!(s->opacity[i] >= CLN_SURFACE) || !(s->depth[i] > 0) ||
        !cln_camera_ray(c, x + 0.5, y + 0.5, point, direction))
        return false;
    *range = (double)s->depth[i];
    for (int a = 0; a < 3; a++)
        point[a] += *range * direction[a];
    return true;
}

/* How the point moves from pixel to pixel, from the neighbour whose depth differs least. */
static bool find_slope(const surface *s, int x, int y, int dx, int dy, const double here[3],
                       double range, double out[3])
{
    double least = EDGE * range;
    bool found = false;

    for (int side = -1; side <= 1; side += 2) {
        double there[3], r = 0;

        if (!find_point(s, x + side * dx, y + side * dy, there, &r) || !(fabs(r - range) < least))
            continue;
        least = fabs(r - range);
        found = true;
        for (int a = 0; a < 3; a++)
            out[a] = side * (there[a] - here[a]);
    }
    return found;
}

void cln_normals_of_depth(const cln_camera *camera, const float *depth, const float *opacity,
                          float *normals)
{
    const surface s = {camera, depth, opacity};

    for (int y = 0; y < camera->height; y++)
        for (int x = 0; x < camera->width; x++) {
            float *out = normals + 3 * ((size_t)y * (size_t)camera->width + (size_t)x);
            double here[3], across[3], down[3], n[3], from[3], ray[3], range = 0, length = 0;
            bool away = false;

            memset(out, 0, 3 * sizeof *out);
            if (!find_point(&s, x, y, here, &range) ||
                !find_slope(&s, x, y, 1, 0, here, range, across) ||
                !find_slope(&s, x, y, 0, 1, here, range, down))
                continue;
            cln_cross(across, down, n);
            length = sqrt(cln_dot(n, n));
            away = cln_camera_ray(camera, x + 0.5, y + 0.5, from, ray) && cln_dot(n, ray) > 0;
            for (int a = 0; a < 3 && length > 0; a++)
                out[a] = (float)((away ? -n[a] : n[a]) / length);
        }
}
