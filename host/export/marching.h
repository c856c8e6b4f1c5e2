/* Marching cubes over the cube [-1,1]^3: the surface where a function is 0, as triangles on a grid
 * whose cells may be wider in places. Only a few slices of the grid are in memory at a time. Knows
 * no field, no tree and no file.
 *
 * The grid's cells come in blocks of CLN_MARCHING_BLOCK along an axis; in a block of level k, 2^k
 * of them along an axis are one cell. Where cells of two widths meet, the wider one takes the
 * narrower ones' points, edges and faces on that side, so that its surface ends where theirs does.
 *
 * Neighbouring cells thus cut their common face in the same way (where a face leaves a choice,
 * corners inside are kept apart), so the mesh is closed, without cracks: every edge is in two
 * triangles, which run along it in opposite directions. */
#ifndef CLN_MARCHING_H
#define CLN_MARCHING_H

#include "export/triangles.h"

/* How a cell is cut. Corner c of a cell has the upper x for bit 0, y for bit 1, z for bit 2; case
 * number: bit c is set if corner c is inside. Edge 4 a + k runs along axis a; bit 0 of k: upper
 * along the first of the other two axes, bit 1: along the second. Triangles are counter-clockwise
 * as seen from outside. */
enum { CLN_MARCHING_TRIANGLES = 5, CLN_MARCHING_EDGES = 12 };
typedef struct cln_marching_case {
    int count;
    uint8_t edge[CLN_MARCHING_TRIANGLES][3];
} cln_marching_case;

void cln_marching_cases(cln_marching_case cases[256]);
int cln_marching_edge_start(int edge); /* the corner that the edge begins at */

enum { CLN_MARCHING_LEVELS = 2, CLN_MARCHING_BLOCK = 1 << CLN_MARCHING_LEVELS };

typedef struct cln_marching {
    int cells; /* of the grid along an axis; its outermost points count as outside, unasked */
    /* [z][y][x] highest level that each block may have; the caller's array. Its levels are lowered
     * where the grid ends within a block, and so that neighbours differ by at most one. NULL: all
     * 0. */
    uint8_t *levels;
    /* values: [n] of the function at these points: above 0 inside. n is at most 65,536. */
    cln_status (*ask)(void *user, size_t n, const float (*at)[4], float *values);
    cln_status (*progress)(void *user, int done, int total); /* may be NULL */
    void *user;
} cln_marching;

static inline int cln_marching_blocks(int cells)
{
    return (cells + CLN_MARCHING_BLOCK - 1) / CLN_MARCHING_BLOCK;
}

/* Adds vertices (at, the others 0) and faces to a zeroed surface. Vertices lie where the function
 * changes its sign, to a 64th of a cell: on edges, and one within each larger piece of surface in
 * a cell that narrower ones are next to. CLN_MEMORY beyond out->most vertices. */
cln_status cln_marching_run(const cln_marching *marching, cln_surface *out);

#endif
