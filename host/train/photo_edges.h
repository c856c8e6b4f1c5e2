/* Which pixels of the training photos are at edges: differ from a neighbour by more than a noise.
 * They may be the means of several rays (batch.h). With one rank a pixel is looked at when it is
 * asked for. With several, which all draw the same rays and have each its photos, each looks at all
 * pixels of its own once, and tells the others: a bit a pixel is on all of them. */
#ifndef CLN_PHOTO_EDGES_H
#define CLN_PHOTO_EDGES_H

#include "scene/scene.h"

typedef struct cln_photo_edges {
    uint64_t *bits; /* [word]; NULL: not looked for, or one rank */
    int64_t *first; /* [training view] its first word; pixels by row */
} cln_photo_edges;

/* With several ranks, which call it together, looks at all pixels, unless it has; the scene's
 * training photos are loaded. CLN_MEMORY, CLN_OUTPUT. */
cln_status cln_photo_edges_find(const cln_scene *scene, cln_photo_edges *edges);
void cln_photo_edges_free(cln_photo_edges *edges);

/* Is this pixel at an edge? index: among the training views. Found, or with one rank. */
bool cln_photo_edges_has(const cln_photo_edges *edges, const cln_scene *scene, int index, int x,
                         int y);

/* Asks the processor or the system to read ahead what the same pixel's answer needs. */
void cln_photo_edges_fetch(const cln_photo_edges *edges, const cln_scene *scene, int index, int x,
                           int y);

/* Host bytes for the training views of a scene. */
double cln_photo_edges_bytes(const cln_scene *scene);

#endif
