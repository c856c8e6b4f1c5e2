/* Support of the tests of exports: how far points are from the surfaces of a generated scene, whose
 * shapes are known in closed form, and how much of these surfaces points cover. */
#ifndef CLN_TESTS_TRUTH_H
#define CLN_TESTS_TRUTH_H

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include "../../data/scenes.h"

/* Signed distance to a shape: exact except in the corners between the side and the cap of a cone
 * whose radii differ, where it is too small. */
static inline double truth_shape(const shape *s, vec point)
{
    const vec d = sub(point, s->centre);
    const double x = dot(d, s->u), y = dot(d, s->v), z = dot(d, s->w), rho = hypot(x, y);
    const double qx = fabs(x) - s->a, qy = fabs(y) - s->b, qz = fabs(z) - s->c;
    double side = 0, slope = 0;

    switch (s->kind) {
    case SHAPE_SPHERE:
        return sqrt(dot(d, d)) - s->a;
    case SHAPE_BOX:
        return sqrt(pow(fmax(qx, 0), 2) + pow(fmax(qy, 0), 2) + pow(fmax(qz, 0), 2)) +
               fmin(fmax(qx, fmax(qy, qz)), 0);
    case SHAPE_FRUSTUM:
        slope = (s->b - s->a) / (2 * s->c);
        side = (rho - (s->a + slope * (z + s->c))) / sqrt(1 + slope * slope);
        return hypot(fmax(side, 0), fmax(qz, 0)) + fmin(fmax(side, qz), 0);
    case SHAPE_CAPSULE:
        return hypot(rho, fmax(qz, 0)) - s->a;
    case SHAPE_TORUS:
        return hypot(rho - s->a, z) - s->b;
    }
    return 0;
}

/* Distance from a point to the nearest of the shapes. */
static inline double truth_distance(const shapes *scene, vec point)
{
    double least = DBL_MAX;

    for (int i = 0; i < scene->count; i++)
        least = fmin(least, truth_shape(&scene->list[i], point));
    return least;
}

/* The surface's normal near p, outward: the slope of the distance. */
static inline vec truth_normal(const shapes *scene, vec p)
{
    const double h = 1e-4;

    return unit(vec3(truth_distance(scene, vec3(p.x + h, p.y, p.z)) -
                         truth_distance(scene, vec3(p.x - h, p.y, p.z)),
                     truth_distance(scene, vec3(p.x, p.y + h, p.z)) -
                         truth_distance(scene, vec3(p.x, p.y - h, p.z)),
                     truth_distance(scene, vec3(p.x, p.y, p.z + h)) -
                         truth_distance(scene, vec3(p.x, p.y, p.z - h))));
}

#endif
