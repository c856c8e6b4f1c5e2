/* Cuts a surface to half-spaces, plane by plane: a triangle with a corner outside becomes the one
 * or two that are left of it. See clip.h. */
#include "export/clip.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "export/marching_edges.h"

typedef struct cut {
    cln_surface *s;
    double *side; /* [vertex] of those that were there: distance from the plane, above 0 inside */
    cln_edges edges; /* sides of triangles that have a new vertex */
    uint32_t (*face)[3];
    size_t faces, room;
} cut;

static cln_status keep_face(cut *c, uint32_t i, uint32_t j, uint32_t k)
{
    cln_status st = CLN_OK;

    if (i == j || j == k || k == i)
        return CLN_OK;
    CLN_TRY(cln_surface_grow(&c->face, &c->room, c->faces, sizeof *c->face, "triangles"));
    memcpy(c->face[c->faces++], (const uint32_t[3]){i, j, k}, sizeof *c->face);
done:
    return st;
}

/* The vertex where the side from a corner inside to one outside meets the plane. */
static cln_status cross(cut *c, uint32_t in, uint32_t out, uint32_t *vertex)
{
    cln_status st = CLN_OK;
    cln_surface *s = c->s;
    const uint64_t low = in < out ? in : out, high = in < out ? out : in;
    const double share = c->side[in] / (c->side[in] - c->side[out]);
    uint32_t *there = NULL;
    bool fresh = false;

    *vertex = in;
    if (c->side[in] == 0)
        return CLN_OK;
    CLN_TRY(cln_edges_find(&c->edges, low << 32 | high, &there, &fresh));
    if (fresh) {
        CLN_TRY(cln_surface_grow_vertices(s));
        for (int a = 0; a < 3; a++)
            s->at[s->vertices][a] =
                (float)(s->at[in][a] + share * ((double)s->at[out][a] - s->at[in][a]));
        *there = (uint32_t)s->vertices++;
    }
    *vertex = *there;
done:
    return st;
}

static cln_status cut_face(cut *c, const uint32_t v[3])
{
    cln_status st = CLN_OK;
    uint32_t ring[4];
    int n = 0;

    for (int k = 0; k < 3; k++) {
        const uint32_t a = v[k], b = v[(k + 1) % 3];

        if (c->side[a] >= 0)
            ring[n++] = a;
        if (c->side[a] >= 0 && c->side[b] < 0)
            CLN_TRY(cross(c, a, b, &ring[n++]));
        if (c->side[a] < 0 && c->side[b] >= 0)
            CLN_TRY(cross(c, b, a, &ring[n++]));
    }
    for (int k = 2; k < n; k++)
        CLN_TRY(keep_face(c, ring[0], ring[k - 1], ring[k]));
done:
    return st;
}

static cln_status cut_by(cln_surface *s, const float plane[4])
{
    cln_status st = CLN_OK;
    cut c = {.s = s};
    bool any = false;

    CLN_TRY(cln_alloc(&c.side, s->vertices, sizeof *c.side, "vertices"));
    for (size_t i = 0; i < s->vertices; i++) {
        c.side[i] = plane[3];
        for (int a = 0; a < 3; a++)
            c.side[i] += (double)plane[a] * s->at[i][a];
        any |= c.side[i] < 0;
    }
    if (!any)
        goto done;
    for (size_t f = 0; f < s->faces; f++)
        CLN_TRY(cut_face(&c, s->face[f]));
    free(s->face);
    s->face = c.face;
    s->faces = c.faces;
    s->face_room = c.room;
    c.face = NULL;
done:
    free(c.face);
    free(c.side);
    cln_edges_free(&c.edges);
    return st;
}

cln_status cln_surface_clip(cln_surface *surface, const float planes[6][4])
{
    cln_status st = CLN_OK;

    for (int i = 0; i < 6; i++)
        CLN_TRY(cut_by(surface, planes[i]));
    CLN_TRY(cln_surface_drop_unused(surface));
done:
    return st;
}
