/* A hash table of the vertices on a grid's edges, by the edge's number. */
#ifndef CLN_MARCHING_EDGES_H
#define CLN_MARCHING_EDGES_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_edges {
    uint64_t *key; /* [room] the edge's number; 0: free */
    uint32_t *vertex;
    size_t room, count;
} cln_edges;

void cln_edges_free(cln_edges *edges); /* accepts a zeroed one */

/* *vertex: the place of an edge's vertex in the table, until the next call. *fresh: it is new, and
 * the caller writes it. key: above 0. CLN_MEMORY. */
cln_status cln_edges_find(cln_edges *edges, uint64_t key, uint32_t **vertex, bool *fresh);

/* Forgets the edges for which keep() is false. CLN_MEMORY. */
cln_status cln_edges_keep(cln_edges *edges, bool (*keep)(const void *user, uint64_t key),
                          const void *user);

#endif
