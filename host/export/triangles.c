/* The arrays of a surface. See triangles.h. */
#include "export/triangles.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

void cln_surface_free(cln_surface *surface)
{
    free(surface->at);
    free(surface->normal);
    free(surface->towards);
    free(surface->colour);
    free(surface->face);
    memset(surface, 0, sizeof *surface);
}

cln_status cln_surface_grow(void *pointer, size_t *room, size_t count, size_t row, const char *what)
{
    const size_t more = *room ? *room + *room / 2 : 4096;
    void *old, *new;

    if (count < *room)
        return CLN_OK;
    memcpy(&old, pointer, sizeof old);
    new = realloc(old, more * row);
    if (!new)
        return cln_fail(CLN_MEMORY, "surface: no memory for %zu %s; give a larger --spacing", more,
                        what);
    memcpy(pointer, &new, sizeof new);
    *room = more;
    return CLN_OK;
}

cln_status cln_surface_grow_vertices(cln_surface *surface)
{
    const size_t most = surface->most ? surface->most : UINT32_MAX;

    if (surface->vertices >= most && most == UINT32_MAX)
        return cln_fail(CLN_OUTPUT,
                        "surface: its vertices are more than the %zu that a mesh can number; give "
                        "a larger --spacing",
                        most);
    if (surface->vertices >= most)
        return cln_fail(CLN_MEMORY,
                        "surface: its vertices are more than the %zu that have room in half of "
                        "this machine's memory; give a larger --spacing, or export it on a "
                        "machine with more",
                        most);
    return cln_surface_grow(&surface->at, &surface->vertex_room, surface->vertices,
                            sizeof *surface->at, "vertices");
}

cln_status cln_surface_grow_faces(cln_surface *surface)
{
    return cln_surface_grow(&surface->face, &surface->face_room, surface->faces,
                            sizeof *surface->face, "triangles");
}

cln_status cln_surface_keep(cln_surface *surface, const uint8_t *keep)
{
    cln_status st = CLN_OK;
    uint32_t *to = NULL;
    size_t faces = 0, vertices = 0;

    CLN_TRY(cln_alloc(&to, surface->vertices, sizeof *to, "vertices"));
    for (size_t f = 0; f < surface->faces; f++) {
        const uint32_t *v = surface->face[f];

        if (!keep[v[0]] && !keep[v[1]] && !keep[v[2]])
            continue;
        for (int k = 0; k < 3; k++)
            to[v[k]] = 1;
        memmove(surface->face[faces++], v, sizeof surface->face[0]);
    }
    for (size_t v = 0; v < surface->vertices; v++) {
        if (!to[v])
            continue;
        memmove(surface->at[vertices], surface->at[v], sizeof surface->at[0]);
        memmove(surface->normal[vertices], surface->normal[v], sizeof surface->normal[0]);
        memmove(surface->towards[vertices], surface->towards[v], sizeof surface->towards[0]);
        to[v] = (uint32_t)vertices++;
    }
    for (size_t f = 0; f < faces; f++)
        for (int k = 0; k < 3; k++)
            surface->face[f][k] = to[surface->face[f][k]];
    surface->faces = faces;
    surface->vertices = vertices;
done:
    free(to);
    return st;
}
