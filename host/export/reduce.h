/* Fewer triangles for nearly the same surface. Knows no run and no file. */
#ifndef CLN_REDUCE_H
#define CLN_REDUCE_H

#include "io/mesh.h"

/* CLN_FAILED in a program that was built without meshoptimizer; names the missing package. */
cln_status cln_mesh_reduce_possible(void);

/* Leaves out vertices until the mesh has at most `most` triangles, first those that change it least
 * (edge collapse by quadric error; Garland and Heckbert 1997). What stays keeps its place, normal
 * and colour. No crack opens, so there may be more triangles than `most`; small parts may vanish,
 * and faces back to back over the same corners do. Edges where four or more triangles would meet
 * are parted by vertices of their own (crowded.h); *crowded: those that could not be.
 * plane: [face] which of several planes it lies in, 1 to CLN_REDUCE_PLANES, or 0; NULL: in none.
 * What lies in one stays there, outline and all, if that takes no more than a quarter of the
 * triangles; *bent: how many it would take, if it takes more; else 0.
 * *error: the largest distance by which the surface moved, in the mesh's units (deviation.h). Rows
 * of mesh->at, normal, colour and face are moved, none is freed. CLN_MEMORY. */
enum { CLN_REDUCE_PLANES = 6 };
cln_status cln_mesh_reduce(cln_mesh *mesh, size_t most, const uint8_t *plane, double *error,
                           size_t *crowded, size_t *bent);

#endif
