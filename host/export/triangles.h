/* Triangles that share vertices, as they grow: the arrays of a surface. Knows no field. */
#ifndef CLN_TRIANGLES_H
#define CLN_TRIANGLES_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

typedef struct cln_surface {
    size_t vertices, faces, vertex_room, face_room;
    size_t most;          /* vertices at most; 0 = as many as an index can name */
    float (*at)[3];       /* [vertex] in the cube */
    float (*normal)[3];   /* [vertex] unit, outwards */
    float (*towards)[3];  /* [vertex] unit, from the eye that saw it best; 0: none did */
    uint8_t (*colour)[3]; /* [vertex] sRGB */
    uint8_t *views;       /* [vertex] how many of the views (fusion.h) see it */
    uint32_t (*face)[3];  /* [face] counter-clockwise as seen from outside */
    double fine;          /* finest cell, or a pixel of the views if that is wider; in the cube */
    double faint;         /* share of what the views show that is seen through (fusion.h) */
} cln_surface;

void cln_surface_free(cln_surface *surface); /* accepts a zeroed one */

/* Make room for one more row; CLN_MEMORY. The first takes any array: pointer is the address of its
 * pointer, row the bytes of a row, what the name of rows in the sentence. */
cln_status cln_surface_grow(void *pointer, size_t *room, size_t count, size_t row,
                            const char *what);
cln_status cln_surface_grow_vertices(cln_surface *surface);
cln_status cln_surface_grow_faces(cln_surface *surface);

/* Numbers the vertices that faces have, in their order, from 0 on, in the faces, too: (*to)[v] is
 * the new number of vertex v, of `kept`, or CLN_NO_VERTEX. The caller frees *to, also after a
 * failure. CLN_MEMORY. */
#define CLN_NO_VERTEX UINT32_MAX
cln_status cln_faces_renumber(size_t faces, uint32_t (*face)[3], size_t vertices, size_t *kept,
                              uint32_t **to);
/* Moves the values of such vertices, of so many bytes each, to their places, unless it is NULL. */
void cln_keep_vertices(size_t vertices, const uint32_t *to, size_t bytes, void *values);

/* Drops vertices that no face has; the others keep their order. Arrays may be NULL. */
cln_status cln_surface_drop_unused(cln_surface *surface);

/* bleed.c: gives vertices that are not known the mean colour of their neighbours, from those that
 * are on outwards; what no known one is connected to stays as it is. known: [vertex], becomes 1.
 * CLN_MEMORY. */
cln_status cln_surface_bleed(cln_surface *surface, uint8_t *known);

/* Keeps the faces that have a vertex with keep[vertex] != 0, and the vertices of these. */
cln_status cln_surface_keep(cln_surface *surface, const uint8_t *keep);

#endif
