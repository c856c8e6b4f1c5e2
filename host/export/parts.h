/* Connected parts of a surface. Knows no run and no scene. */
#ifndef CLN_PARTS_H
#define CLN_PARTS_H

#include <stdbool.h>
#include "export/triangles.h"

typedef struct cln_parts {
    size_t parts;    /* that there were */
    size_t left_out; /* triangles of all but the largest */
    double next;     /* length of the next one over the largest's, by their boxes; 0: none */
    double others;   /* likewise of the box around all but the largest */
} cln_parts;

/* Counts the parts; left_out: what cln_surface_keep_largest would leave out. CLN_MEMORY. */
cln_status cln_surface_count_parts(const cln_surface *surface, cln_parts *found);

/* Do all but the largest, of so many triangles in all, reach farther than it, and are they too many
 * for crumbs? Then they are of the object: what is thinner than the cells breaks into pieces. */
bool cln_parts_are_broken(const cln_parts *parts, size_t faces);

/* Keeps the part with the most triangles, of equal ones that of the first vertex; what is connected
 * shares vertices. CLN_MEMORY. */
cln_status cln_surface_keep_largest(cln_surface *surface, cln_parts *found);

#endif
