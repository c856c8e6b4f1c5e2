/* Edges of a mesh that other than two triangles have: of an open one, and where fewer triangles
 * made parts touch. What prints takes such a mesh for torn. Knows no run and no file. */
#ifndef CLN_CROWDED_H
#define CLN_CROWDED_H

#include "io/mesh.h"

typedef struct cln_mesh_edges {
    size_t open;    /* edges whose triangles are not in pairs that run along it both ways */
    size_t crowded; /* with more than two */
    size_t pairs;   /* of triangles too many, of all these */
} cln_mesh_edges;

/* CLN_MEMORY. */
cln_status cln_mesh_count_edges(const cln_mesh *mesh, cln_mesh_edges *out);

/* Parts them: at such an edge triangles are paired that have the inside between them, and each pair
 * but one is cut in two at a vertex of its own, beside the edge's middle by a fiftieth of what is
 * least there, on the inside, so that places differ, too. A pair takes one vertex and two triangles
 * more, of the rows that there is room for. *left: edges that are still crowded: of
 * triangles back to back, or for want of room. CLN_MEMORY. */
cln_status cln_mesh_part_crowded(cln_mesh *mesh, size_t vertex_room, size_t face_room,
                                 size_t *left);

#endif
