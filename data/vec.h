/* Vectors of three doubles, for the scene generator in this folder only; the library itself passes
 * double[3]. */
#ifndef DATA_VEC_H
#define DATA_VEC_H

#include <math.h>

typedef struct vec {
    double x, y, z;
} vec;

static inline vec vec3(double x, double y, double z)
{
    vec r = {x, y, z};
    return r;
}

static inline vec add(vec a, vec b)
{
    return vec3(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline vec sub(vec a, vec b)
{
    return vec3(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline vec scale(vec a, double s)
{
    return vec3(a.x * s, a.y * s, a.z * s);
}

static inline vec along(vec a, double s, vec b)
{
    return vec3(a.x + s * b.x, a.y + s * b.y, a.z + s * b.z);
}

static inline vec mul(vec a, vec b)
{
    return vec3(a.x * b.x, a.y * b.y, a.z * b.z);
}

static inline vec mix(vec a, vec b, double s)
{
    return along(scale(a, 1 - s), s, b);
}

static inline double dot(vec a, vec b)
{
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline vec cross(vec a, vec b)
{
    return vec3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline vec unit(vec a)
{
    return scale(a, 1 / sqrt(dot(a, a)));
}

/* Makes two unit vectors that form a right-handed frame with the unit vector w: u x v = w. */
static inline void frame_of(vec w, vec *u, vec *v)
{
    vec helper = fabs(w.z) < 0.9 ? vec3(0, 0, 1) : vec3(1, 0, 0);
    *u = unit(cross(helper, w));
    *v = cross(w, *u);
}

#endif
