/* The grid encoding (method.md section 1): what a network reads of a position are features, linear
 * between the vertices of a grid over its leaf. Its parameters stand behind the layers':
 * net->grid_w, [cells + 1]^3 vertices (z, y, x) of `features` numbers. Forward and backward:
 * kernels/encoding_grid.h; float64 twin: host/reference/encoding.c. */
#ifndef CLN_ENCODING_GRID_H
#define CLN_ENCODING_GRID_H

#include "model/network.h"

/* Child `octant` computes what its parent computes there, but for rounding: the child's vertices
 * are the parent's and the points midway, and the parent is linear between its own, as `cells` is
 * even. parent, child: [params], may not overlap. */
void cln_grid_split(const cln_network *net, int octant, const float *parent, float *child);

/* A parent with every other vertex of child `octant`, whose outermost values go on beyond it: what
 * a merge starts from. */
void cln_grid_merge(const cln_network *net, int octant, const float *child, float *parent);

#endif
