/* Lens models that bend a plane: a direction's point in an ideal plane, and that point moved by
 * radial, tangential and thin-prism terms. Used by lens.c alone, and by its tests.
 *
 * The point (a, b) of a direction (x, y, z):
 *   perspective   (x, y) / z, for z > 0
 *   fisheye       (x, y) theta / hypot(x, y), theta = the angle to the axis: equidistant
 * It moves, with s = a^2 + b^2:
 *   radial        (a, b) R(s),  R = (1 + above[0] s + above[1] s^2 + ..) / (1 + below[0] s + ..)
 *   tangential    + (2 p1 a b + p2 (s + 2 a^2), p1 (s + 2 b^2) + 2 p2 a b)
 *   thin prism    + (prism[0] s + prism[1] s^2, prism[2] s + prism[3] s^2)
 * The last two take the point before the radial part or, with `after`, the point after it. */
#ifndef CLN_LENS_PLANE_H
#define CLN_LENS_PLANE_H

#include <stdbool.h>

enum { CLN_LENS_ABOVE = 6, CLN_LENS_BELOW = 3 };

typedef struct cln_lens_plane {
    bool fisheye, after;
    double above[CLN_LENS_ABOVE], below[CLN_LENS_BELOW];
    double p1, p2, prism[4];
} cln_lens_plane;

/* The point's place, and its Jacobian {da'/da, da'/db, db'/da, db'/db} (may be NULL). */
void cln_lens_plane_bend(const cln_lens_plane *plane, const double point[2], double place[2],
                         double jacobian[4]);

/* Radius up to which r R(r^2) grows: its fold, or pi for a fisheye; INFINITY if there is no end. */
double cln_lens_plane_limit(const cln_lens_plane *plane);

/* As cln_lens_distort and cln_lens_undistort. */
bool cln_lens_plane_distort(const cln_lens_plane *plane, const double direction[3],
                            double place[2]);
bool cln_lens_plane_undistort(const cln_lens_plane *plane, const double place[2],
                              double direction[3]);

#endif
