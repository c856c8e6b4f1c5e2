/* Connected parts of a surface. Knows no run and no scene. */
#ifndef CLN_PARTS_H
#define CLN_PARTS_H

#include "export/triangles.h"

typedef struct cln_parts {
    size_t parts;    /* that there were */
    size_t left_out; /* triangles of all but the largest */
    double next;     /* length of the next one over the largest's, by their boxes; 0: none */
} cln_parts;

/* Counts the parts; left_out: what cln_surface_keep_largest would leave out. CLN_MEMORY. */
cln_status cln_surface_count_parts(const cln_surface *surface, cln_parts *found);

/* Keeps the part with the most triangles, of equal ones that of the first vertex; what is connected
 * shares vertices. CLN_MEMORY. */
cln_status cln_surface_keep_largest(cln_surface *surface, cln_parts *found);

#endif
