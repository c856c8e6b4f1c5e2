/* Marching cubes over the cube [-1,1]^3: the surface where a function is 0, as triangles on a
 * uniform grid, two slices of it in memory at a time. Knows no field and no file.
 *
 * Neighbouring cells cut their common face in the same way (corners of the inside are kept apart
 * where a face leaves a choice), so the mesh is closed, without cracks, every edge in two triangles
 * that run along it in opposite directions. */
#ifndef CLN_MARCHING_H
#define CLN_MARCHING_H

#include "export/triangles.h"

/* How a cell is cut. Corner c of a cell has the upper x for bit 0, y for bit 1, z for bit 2; case
 * number: bit c is set if corner c is inside. Edge 4 a + k runs along axis a; bits of k: upper
 * along the lower, and the higher of the other axes. Triangles are counter-clockwise as seen from
 * outside. */
enum { CLN_MARCHING_TRIANGLES = 5 };
typedef struct cln_marching_case {
    int count;
    uint8_t edge[CLN_MARCHING_TRIANGLES][3];
} cln_marching_case;

void cln_marching_cases(cln_marching_case cases[256]);

typedef struct cln_marching {
    int cells; /* of the grid along an axis; its outermost points count as outside, unasked */
    /* values: [n] of the function at these points: above 0 inside. n is at most 65,536. */
    cln_status (*ask)(void *user, size_t n, const float (*at)[4], float *values);
    cln_status (*progress)(void *user, int done, int total); /* by slices; may be NULL */
    void *user;
} cln_marching;

/* Adds vertices (at, the others 0) and faces to a zeroed surface. Vertices lie where the function
 * changes its sign, to a 64th of a cell. CLN_MEMORY beyond out->most vertices. */
cln_status cln_marching_run(const cln_marching *marching, cln_surface *out);

#endif
