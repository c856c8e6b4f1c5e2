/* Connected parts of a surface, by union and find over the vertices that triangles share (Tarjan
 * 1975; paths are halved). See parts.h. */
#include "export/parts.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

static const double CRUMBS = 0.1; /* share of the triangles that crumbs have at most */

/* The first vertex of a vertex's part, as far as parts have been joined. */
static uint32_t find(uint32_t *to, uint32_t v)
{
    while (to[v] != v) {
        to[v] = to[to[v]];
        v = to[v];
    }
    return v;
}

/* A part's root is its least vertex, so the outcome does not depend on the order of joins. */
static void join(uint32_t *to, uint32_t a, uint32_t b)
{
    a = find(to, a);
    b = find(to, b);
    if (a < b)
        to[b] = a;
    else
        to[a] = b;
}

/* The diagonal of the box of a part, or of all others, in the cube. */
static double length_of(const cln_surface *s, uint32_t *to, uint32_t part, bool others)
{
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double square = 0;

    for (size_t k = 0; k < 3 * s->faces; k++) {
        const uint32_t v = s->face[k / 3][k % 3];

        for (int a = 0; a < 3 && (find(to, v) == part) != others; a++) {
            low[a] = fmin(low[a], (double)s->at[v][a]);
            high[a] = fmax(high[a], (double)s->at[v][a]);
        }
    }
    for (int a = 0; a < 3; a++)
        square += (high[a] - low[a]) * (high[a] - low[a]);
    return sqrt(square);
}

/* to: [vertex], the first vertex of its part, if asked by find(). *largest: that of the largest. */
static cln_status find_parts(const cln_surface *s, uint32_t *to, uint32_t *largest,
                             cln_parts *found)
{
    cln_status st = CLN_OK;
    uint32_t *count = NULL, next = 0;

    *found = (cln_parts){0};
    *largest = 0;
    CLN_TRY(cln_alloc(&count, s->vertices, sizeof *count, "vertices"));
    for (size_t v = 0; v < s->vertices; v++)
        to[v] = (uint32_t)v;
    for (size_t f = 0; f < s->faces; f++) {
        join(to, s->face[f][0], s->face[f][1]);
        join(to, s->face[f][0], s->face[f][2]);
    }
    for (size_t f = 0; f < s->faces; f++)
        count[find(to, s->face[f][0])]++;
    for (size_t v = 0; v < s->vertices; v++) {
        found->parts += count[v] > 0;
        if (count[v] > count[*largest])
            *largest = (uint32_t)v;
    }
    found->left_out = s->faces - (s->vertices > 0 ? count[*largest] : 0);
    next = *largest == 0 ? 1 : 0; /* any other */
    for (size_t v = 0; v < s->vertices && found->parts > 1; v++)
        if (v != *largest && count[v] > count[next])
            next = (uint32_t)v;
    if (found->parts > 1) {
        const double whole = length_of(s, to, *largest, false);

        found->next = length_of(s, to, next, false) / whole;
        found->others = length_of(s, to, *largest, true) / whole;
    }
done:
    free(count);
    return st;
}

cln_status cln_surface_count_parts(const cln_surface *surface, cln_parts *found)
{
    cln_status st = CLN_OK;
    uint32_t *to = NULL, largest = 0;

    CLN_TRY(cln_alloc(&to, surface->vertices, sizeof *to, "vertices"));
    CLN_TRY(find_parts(surface, to, &largest, found));
done:
    free(to);
    return st;
}

bool cln_parts_are_broken(const cln_parts *parts, size_t faces)
{
    return parts->others > 1 && (double)parts->left_out > CRUMBS * (double)faces;
}

cln_status cln_surface_keep_largest(cln_surface *surface, cln_parts *found)
{
    cln_status st = CLN_OK;
    cln_surface *s = surface;
    uint32_t *to = NULL, largest = 0;
    size_t kept = 0;

    CLN_TRY(cln_alloc(&to, s->vertices, sizeof *to, "vertices"));
    CLN_TRY(find_parts(s, to, &largest, found));
    for (size_t f = 0; f < s->faces; f++)
        if (find(to, s->face[f][0]) == largest)
            memmove(s->face[kept++], s->face[f], sizeof s->face[0]);
    s->faces = kept;
    CLN_TRY(cln_surface_drop_unused(s));
done:
    free(to);
    return st;
}
