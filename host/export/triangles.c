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
    free(surface->views);
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

cln_status cln_faces_renumber(size_t faces, uint32_t (*face)[3], size_t vertices, size_t *kept,
                              uint32_t **to)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(to, vertices, sizeof **to, "vertices"));
    memset(*to, 0xff, vertices * sizeof **to);
    for (size_t f = 0; f < faces; f++)
        for (int k = 0; k < 3; k++)
            (*to)[face[f][k]] = 0;
    *kept = 0;
    for (size_t v = 0; v < vertices; v++)
        if ((*to)[v] != CLN_NO_VERTEX)
            (*to)[v] = (uint32_t)(*kept)++;
    for (size_t f = 0; f < faces; f++)
        for (int k = 0; k < 3; k++)
            face[f][k] = (*to)[face[f][k]];
done:
    return st;
}

void cln_keep_vertices(size_t vertices, const uint32_t *to, size_t bytes, void *values)
{
    char *at = values;

    for (size_t v = 0; v < vertices && at; v++)
        if (to[v] != CLN_NO_VERTEX)
            memmove(at + to[v] * bytes, at + v * bytes, bytes);
}

cln_status cln_surface_drop_unused(cln_surface *surface)
{
    cln_status st = CLN_OK;
    cln_surface *s = surface;
    uint32_t *to = NULL;
    size_t kept = 0;

    CLN_TRY(cln_faces_renumber(s->faces, s->face, s->vertices, &kept, &to));
    cln_keep_vertices(s->vertices, to, sizeof s->at[0], s->at);
    cln_keep_vertices(s->vertices, to, sizeof s->normal[0], s->normal);
    cln_keep_vertices(s->vertices, to, sizeof s->towards[0], s->towards);
    cln_keep_vertices(s->vertices, to, sizeof s->colour[0], s->colour);
    cln_keep_vertices(s->vertices, to, sizeof s->views[0], s->views);
    s->vertices = kept;
done:
    free(to);
    return st;
}

cln_status cln_surface_keep(cln_surface *surface, const uint8_t *keep)
{
    size_t faces = 0;

    for (size_t f = 0; f < surface->faces; f++) {
        const uint32_t *v = surface->face[f];

        if (keep[v[0]] || keep[v[1]] || keep[v[2]])
            memmove(surface->face[faces++], v, sizeof surface->face[0]);
    }
    surface->faces = faces;
    return cln_surface_drop_unused(surface);
}
