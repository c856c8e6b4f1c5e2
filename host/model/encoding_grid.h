/* The grid encoding (method.md section 1): a network reads features of a position, interpolated
 * linearly between the vertices of a grid over its leaf. The grid's parameters follow those of the
 * layers, at net->grid_w: [cells + 1]^3 vertices (z, y, x) of `features` numbers. Forward and
 * backward: kernels/encoding_grid.h; float64 twin: host/reference/encoding.c. */
#ifndef CLN_ENCODING_GRID_H
#define CLN_ENCODING_GRID_H

#include "model/network.h"

/* Makes child `octant`, which computes what its parent computes there, but for rounding: the
 * child's vertices are the parent's and the points midway (`cells` is even), and the parent is
 * linear between its vertices. parent, child: [params], may not overlap. */
void cln_grid_split(const cln_network *net, int octant, const float *parent, float *child);

/* Makes the parent from which a merge starts: inside child `octant` it has every other vertex of
 * the child, and beyond it the child's outermost values. */
void cln_grid_merge(const cln_network *net, int octant, const float *child, float *parent);

#endif
