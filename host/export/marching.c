/* Marching cubes. See marching.h. Works on one slab of the grid at a time, a block thick: asks for
 * the values at its points, then cuts its cells. A cell whose edges all have its own width is cut
 * by the table of marching_cases.c; any other by the same rule, applied to each of the narrower
 * faces on its sides. */
#include "export/marching.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "export/marching_edges.h"

enum {
    CHUNK = 65536,
    ROUNDS = 6,
    RING = 8,      /* points around a face at most: its sides may be halved */
    PIECES = 6 * 8 /* of surface in a cell's faces at most: two in each quarter of a face */
};

static const float unasked = FLT_MAX;

/* A vertex to be placed on a line from inside, where the function is above 0, to outside. */
typedef struct crossing {
    float in[3], out[3], value_in, value_out;
    uint32_t vertex;
} crossing;

/* The vertex in the middle of a fan of faces; it is placed where the function is 0. */
typedef struct hub {
    uint32_t vertex;
    float reach;         /* how far it may be from the mean of the fan's other vertices */
    size_t first, count; /* faces */
} hub;

typedef struct sweep {
    const cln_marching *m;
    size_t side;         /* points of the grid along an axis */
    int blocks;          /* along an axis */
    uint8_t *levels;     /* [z][y][x]; NULL: all 0 */
    float *values;       /* [slice][y][x] of a slab, from `bottom` up */
    int bottom, top;     /* slices */
    cln_edges edges;     /* of the slab, those with a vertex */
    crossing *crossings; /* of vertices that are not yet in their places */
    hub *hubs;           /* that are not yet in their places */
    size_t count, room, hub_count, hub_room;
    float (*at)[4]; /* [CHUNK] */
    float *answers; /* [CHUNK] */
    size_t *asked;  /* [CHUNK] */
    size_t waiting; /* of CHUNK */
    cln_marching_case cases[256];
    cln_surface *out;
} sweep;

static float place(const sweep *s, int i)
{
    return (float)(-1 + 2 * (double)i / s->m->cells);
}

static int least(int a, int b)
{
    return a < b ? a : b;
}

static int level_of(const sweep *s, int x, int y, int z)
{
    const size_t n = (size_t)s->blocks;

    return !s->levels ? 0 : s->levels[((size_t)z * n + (size_t)y) * n + (size_t)x];
}

/* ---- levels ---- */

/* Lowers a block to level `to` if a block around it has a lower level than that. */
static void lower(sweep *s, int x, int y, int z, int to)
{
    uint8_t *level =
        &s->levels[((size_t)z * (size_t)s->blocks + (size_t)y) * (size_t)s->blocks + (size_t)x];
    int lowest = *level;

    for (int k = 0; k < 27 && lowest >= to; k++) {
        const int at[3] = {x + k % 3 - 1, y + k / 3 % 3 - 1, z + k / 9 - 1};
        bool there = true;

        for (int a = 0; a < 3; a++)
            there = there && at[a] >= 0 && at[a] < s->blocks;
        if (there)
            lowest = least(lowest, level_of(s, at[0], at[1], at[2]));
    }
    if (lowest < to)
        *level = (uint8_t)to;
}

static void make_levels(sweep *s)
{
    const int last = s->m->cells % CLN_MARCHING_BLOCK ? s->blocks - 1 : s->blocks;
    const size_t n = (size_t)s->blocks;

    if (!s->levels)
        return;
    for (size_t i = 0; i < n * n * n; i++) {
        const int most = least(s->levels[i], CLN_MARCHING_LEVELS);
        const bool cut =
            i % n == (size_t)last || i / n % n == (size_t)last || i / n / n == (size_t)last;

        s->levels[i] = (uint8_t)(cut ? 0 : most);
    }
    for (int to = 1; to < CLN_MARCHING_LEVELS; to++)
        for (int z = 0; z < s->blocks; z++)
            for (int y = 0; y < s->blocks; y++)
                for (int x = 0; x < s->blocks; x++)
                    if (level_of(s, x, y, z) > to)
                        lower(s, x, y, z, to);
}

/* Level of the block that a cell of the grid is in; beyond the grid the highest. */
static int level_at(const sweep *s, const int cell[3])
{
    for (int a = 0; a < 3; a++)
        if (cell[a] < 0 || cell[a] >= s->m->cells)
            return CLN_MARCHING_LEVELS;
    return level_of(s, cell[0] / CLN_MARCHING_BLOCK, cell[1] / CLN_MARCHING_BLOCK,
                    cell[2] / CLN_MARCHING_BLOCK);
}

/* Length of the edge along `axis` that begins at a point: that of the narrowest cell around it. */
static int edge_length(const sweep *s, int axis, const int from[3])
{
    int level = CLN_MARCHING_LEVELS;

    for (int k = 0; k < 4; k++) {
        int cell[3] = {from[0], from[1], from[2]};

        cell[(axis + 1) % 3] -= k & 1;
        cell[(axis + 2) % 3] -= k >> 1;
        level = least(level, level_at(s, cell));
    }
    return 1 << level;
}

/* Width of the face across `axis` with its lowest corner at a point: that of the narrower cell. */
static int face_width(const sweep *s, int axis, const int from[3])
{
    int before[3] = {from[0], from[1], from[2]};

    before[axis]--;
    return 1 << least(level_at(s, from), level_at(s, before));
}

/* ---- begin and end ---- */

static cln_status start(sweep *s)
{
    cln_status st = CLN_OK;
    const size_t slices = CLN_MARCHING_BLOCK + 1;

    CLN_TRY(
        cln_alloc(&s->values, slices * s->side * s->side, sizeof *s->values, "slices of the grid"));
    CLN_TRY(cln_alloc(&s->at, CHUNK, sizeof *s->at, "points"));
    CLN_TRY(cln_alloc(&s->answers, CHUNK, sizeof *s->answers, "points"));
    CLN_TRY(cln_alloc(&s->asked, CHUNK, sizeof *s->asked, "points"));
    cln_marching_cases(s->cases);
    make_levels(s);
done:
    return st;
}

static void finish(sweep *s)
{
    free(s->values);
    cln_edges_free(&s->edges);
    free(s->crossings);
    free(s->hubs);
    free(s->at);
    free(s->answers);
    free(s->asked);
}

/* ---- values ---- */

static size_t index_of(const sweep *s, const int at[3])
{
    return ((size_t)(at[2] - s->bottom) * s->side + (size_t)at[1]) * s->side + (size_t)at[0];
}

static bool is_inside(const sweep *s, const int at[3])
{
    return s->values[index_of(s, at)] > 0;
}

static cln_status ask_these(sweep *s, size_t n)
{
    return s->m->ask(s->m->user, n, (const float(*)[4])s->at, s->answers);
}

static cln_status flush(sweep *s)
{
    cln_status st = CLN_OK;

    if (s->waiting > 0)
        CLN_TRY(ask_these(s, s->waiting));
    for (size_t i = 0; i < s->waiting; i++)
        s->values[s->asked[i]] = s->answers[i];
    s->waiting = 0;
done:
    return st;
}

/* Asks for a point's value, once. */
static cln_status want(sweep *s, const int at[3])
{
    float *value = &s->values[index_of(s, at)];

    if (*value != unasked)
        return CLN_OK;
    *value = -1;
    for (int a = 0; a < 3; a++)
        if (at[a] == 0 || at[a] == s->m->cells)
            return CLN_OK;
    for (int a = 0; a < 3; a++)
        s->at[s->waiting][a] = place(s, at[a]);
    s->asked[s->waiting++] = (size_t)(value - s->values);
    return s->waiting == CHUNK ? flush(s) : CLN_OK;
}

/* Asks for the points of a block's cells that are in the slab. */
static cln_status want_block(sweep *s, int x, int y, int z)
{
    cln_status st = CLN_OK;
    const int from[3] = {CLN_MARCHING_BLOCK * x, CLN_MARCHING_BLOCK * y, CLN_MARCHING_BLOCK * z};
    const int step = 1 << level_of(s, x, y, z);
    int end[3], at[3];

    for (int a = 0; a < 3; a++)
        end[a] = least(from[a] + CLN_MARCHING_BLOCK, a == 2 ? s->top : s->m->cells);
    for (at[2] = from[2]; at[2] <= end[2]; at[2] += step)
        for (at[1] = from[1]; at[1] <= end[1]; at[1] += step)
            for (at[0] = from[0]; at[0] <= end[0]; at[0] += step)
                CLN_TRY(want(s, at));
done:
    return st;
}

/* Asks for the points of slab z, with those that the next slab has on their common slice. Values on
 * the slice in common with the slab before are there already. */
static cln_status ask_slab(sweep *s, int z)
{
    cln_status st = CLN_OK;
    const size_t area = s->side * s->side, slices = (size_t)(s->top - s->bottom) + 1;

    for (size_t i = z > 0 ? area : 0; i < slices * area; i++)
        s->values[i] = unasked;
    for (int up = z; up <= z + 1 && up < s->blocks; up++)
        for (int y = 0; y < s->blocks; y++)
            for (int x = 0; x < s->blocks; x++)
                CLN_TRY(want_block(s, x, y, up));
    CLN_TRY(flush(s));
done:
    return st;
}

/* ---- vertices ---- */

/* The vertex on the edge along `axis` from one point to another, whose values differ in sign. */
static cln_status vertex_on(sweep *s, int axis, const int from[3], int length, uint32_t *vertex)
{
    cln_status st = CLN_OK;
    cln_surface *out = s->out;
    const uint64_t point =
        ((uint64_t)from[2] * s->side + (uint64_t)from[1]) * s->side + (uint64_t)from[0];
    const uint64_t key = 3 * point + (uint64_t)axis + 1;
    int to[3] = {from[0], from[1], from[2]};
    float low = 0, high = 0;
    crossing *c = NULL;
    uint32_t *there = NULL;
    bool fresh = false;

    CLN_TRY(cln_edges_find(&s->edges, key, &there, &fresh));
    *vertex = *there;
    if (!fresh)
        return CLN_OK;
    CLN_TRY(cln_surface_grow_vertices(out));
    CLN_TRY(cln_surface_grow(&s->crossings, &s->room, s->count, sizeof *s->crossings,
                             "vertices of a slab"));
    *vertex = *there = (uint32_t)out->vertices++;
    to[axis] += length;
    low = s->values[index_of(s, from)];
    high = s->values[index_of(s, to)];
    c = &s->crossings[s->count++];
    *c = (crossing){
        .vertex = *vertex, .value_in = low > 0 ? low : high, .value_out = low > 0 ? high : low};
    for (int a = 0; a < 3; a++) {
        c->in[a] = place(s, low > 0 ? from[a] : to[a]);
        c->out[a] = place(s, low > 0 ? to[a] : from[a]);
    }
done:
    return st;
}

/* Returns whether the next slab has this edge, too. */
static bool is_on_top(const void *user, uint64_t key)
{
    const sweep *s = user;
    const uint64_t area = (uint64_t)s->side * s->side;

    return (key - 1) / 3 / area == (uint64_t)s->top && (key - 1) % 3 != 2;
}

/* Places vertices: ROUNDS times halves the part of a line where the sign changes, then interpolates
 * linearly. */
static cln_status put_in_place(sweep *s)
{
    cln_status st = CLN_OK;

    for (size_t first = 0; first < s->count; first += CHUNK) {
        const size_t n = s->count - first < CHUNK ? s->count - first : CHUNK;
        crossing *these = s->crossings + first;

        for (int round = 0; round < ROUNDS; round++) {
            for (size_t i = 0; i < n; i++)
                for (int a = 0; a < 3; a++)
                    s->at[i][a] = 0.5f * (these[i].in[a] + these[i].out[a]);
            CLN_TRY(ask_these(s, n));
            for (size_t i = 0; i < n; i++) {
                crossing *c = &these[i];
                const bool inside = s->answers[i] > 0;

                memcpy(inside ? c->in : c->out, s->at[i], sizeof c->in);
                *(inside ? &c->value_in : &c->value_out) = s->answers[i];
            }
        }
        for (size_t i = 0; i < n; i++) {
            const crossing *c = &these[i];
            const float share = c->value_in / (c->value_in - c->value_out);

            for (int a = 0; a < 3; a++)
                s->out->at[c->vertex][a] = c->in[a] + (c->out[a] - c->in[a]) * share;
        }
    }
    s->count = 0;
done:
    return st;
}

/* Puts a hub in the mean of its fan's other vertices, and makes the line to search for its place:
 * through that mean, along the fan's normal. */
static void aim(sweep *s, const hub *h, crossing *c)
{
    float(*at)[3] = s->out->at, (*middle)[3] = &s->out->at[h->vertex];
    double sum[3] = {0}, normal[3] = {0}, length = 0;

    for (size_t f = h->first; f < h->first + h->count; f++)
        for (int a = 0; a < 3; a++)
            sum[a] += at[s->out->face[f][1]][a];
    for (int a = 0; a < 3; a++)
        (*middle)[a] = (float)(sum[a] / (double)h->count);
    for (size_t f = h->first; f < h->first + h->count; f++) {
        const float *p = at[s->out->face[f][1]], *q = at[s->out->face[f][2]];

        for (int a = 0; a < 3; a++) {
            const int b = (a + 1) % 3, d = (a + 2) % 3;

            normal[a] += ((double)p[b] - (*middle)[b]) * ((double)q[d] - (*middle)[d]) -
                         ((double)p[d] - (*middle)[d]) * ((double)q[b] - (*middle)[b]);
        }
    }
    for (int a = 0; a < 3; a++)
        length += normal[a] * normal[a];
    *c = (crossing){.vertex = h->vertex};
    for (int a = 0; a < 3; a++) {
        const double step = length > 0 ? h->reach * normal[a] / sqrt(length) : 0;

        c->in[a] = (float)((*middle)[a] - step);
        c->out[a] = (float)((*middle)[a] + step);
    }
}

/* Places hubs, after the other vertices; a hub whose line does not cross the surface stays in the
 * mean. */
static cln_status place_hubs(sweep *s)
{
    cln_status st = CLN_OK;
    const size_t half = CHUNK / 2;

    for (size_t first = 0; first < s->hub_count; first += half) {
        const size_t n = s->hub_count - first < half ? s->hub_count - first : half;

        for (size_t i = 0; i < n; i++) {
            CLN_TRY(cln_surface_grow(&s->crossings, &s->room, s->count, sizeof *s->crossings,
                                     "vertices of a slab"));
            aim(s, &s->hubs[first + i], &s->crossings[s->count++]);
            for (int a = 0; a < 3; a++) {
                s->at[2 * i][a] = s->crossings[i].in[a];
                s->at[2 * i + 1][a] = s->crossings[i].out[a];
            }
        }
        CLN_TRY(ask_these(s, 2 * n));
        s->count = 0;
        for (size_t i = 0; i < n; i++) {
            crossing c = s->crossings[i];

            c.value_in = s->answers[2 * i];
            c.value_out = s->answers[2 * i + 1];
            if (c.value_in > 0 && !(c.value_out > 0))
                s->crossings[s->count++] = c;
        }
        CLN_TRY(put_in_place(s));
    }
    s->hub_count = 0;
done:
    return st;
}

/* ---- cells ---- */

static cln_status add_face(sweep *s, uint32_t a, uint32_t b, uint32_t c)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_surface_grow_faces(s->out));
    memcpy(s->out->face[s->out->faces++], (const uint32_t[3]){a, b, c}, sizeof s->out->face[0]);
done:
    return st;
}

/* A cell's corner: bit 0 of its number is high along x, 1 along y, 2 along z. */
static void corner_of(const int from[3], int width, int corner, int at[3])
{
    for (int a = 0; a < 3; a++)
        at[a] = from[a] + width * (corner >> a & 1);
}

/* Cuts a cell by the table. */
static cln_status cut_plain(sweep *s, const int from[3], int width)
{
    cln_status st = CLN_OK;
    const cln_marching_case *c = NULL;
    int inside = 0;

    for (int corner = 0; corner < 8; corner++) {
        int at[3];

        corner_of(from, width, corner, at);
        inside |= is_inside(s, at) << corner;
    }
    c = &s->cases[inside];
    for (int t = 0; t < c->count; t++) {
        uint32_t v[3];

        for (int k = 0; k < 3; k++) {
            const int edge = c->edge[t][k];
            int at[3];

            corner_of(from, width, cln_marching_edge_start(edge), at);
            CLN_TRY(vertex_on(s, edge / 4, at, width, &v[k]));
        }
        CLN_TRY(add_face(s, v[0], v[1], v[2]));
    }
done:
    return st;
}

/* Pieces of surface in a cell's faces, from vertex to vertex. */
typedef struct pieces {
    uint32_t from[PIECES], to[PIECES];
    int count;
} pieces;

/* Points around a face in the order of a walk, and whether the function is above 0 there. */
typedef struct ring {
    int at[RING][3], count;
    bool inside[RING];
} ring;

static cln_status vertex_after(sweep *s, const ring *r, int i, uint32_t *vertex)
{
    const int *a = r->at[i], *b = r->at[(i + 1) % r->count];
    int axis = 0, length = 0;

    while (a[axis] == b[axis])
        axis++;
    length = b[axis] - a[axis];
    return length > 0 ? vertex_on(s, axis, a, length, vertex)
                      : vertex_on(s, axis, b, -length, vertex);
}

/* Adds the pieces of surface in a face across `axis`, seen from above or below, by the rule of
 * join_edges in marching_cases.c. `width` is that of the narrower cell at the face. */
static cln_status walk_face(sweep *s, int axis, bool above, const int corner[3], int width,
                            pieces *p)
{
    cln_status st = CLN_OK;
    const int b = (axis + 1) % 3, c = (axis + 2) % 3;
    ring r = {.count = 0};
    int at[3] = {corner[0], corner[1], corner[2]};

    for (int side = 0; side < 4; side++) {
        const int along = (side % 2 == 0) == above ? b : c, sign = side < 2 ? 1 : -1;
        int low[3] = {at[0], at[1], at[2]}, length = 0;

        low[along] -= sign < 0 ? width : 0;
        length = edge_length(s, along, low);
        for (int step = 0; step < width; step += length) {
            CLN_ASSERT(r.count < RING);
            memcpy(r.at[r.count], at, sizeof at);
            r.inside[r.count++] = is_inside(s, at);
            at[along] += sign * length;
        }
    }
    for (int i = 0; i < r.count; i++) {
        int j = (i + 1) % r.count;

        if (r.inside[i] || !r.inside[j])
            continue;
        while (r.inside[(j + 1) % r.count])
            j = (j + 1) % r.count;
        CLN_ASSERT(p->count < PIECES);
        CLN_TRY(vertex_after(s, &r, i, &p->from[p->count]));
        CLN_TRY(vertex_after(s, &r, j, &p->to[p->count]));
        p->count++;
    }
done:
    return st;
}

/* Fills a loop of vertices with a triangle, or with a fan around a new vertex, as sides to a new
 * vertex are in no other cell. A loop of two pieces goes to and fro and encloses nothing. */
static cln_status fill_loop(sweep *s, const uint32_t *loop, int n, int width)
{
    cln_status st = CLN_OK;
    uint32_t middle = 0;

    if (n == 3)
        return add_face(s, loop[0], loop[1], loop[2]);
    if (n < 3)
        return CLN_OK;
    CLN_TRY(cln_surface_grow_vertices(s->out));
    middle = (uint32_t)s->out->vertices++;
    CLN_TRY(
        cln_surface_grow(&s->hubs, &s->hub_room, s->hub_count, sizeof *s->hubs, "rows of faces"));
    s->hubs[s->hub_count++] =
        (hub){middle, 0.5f * (float)width / (float)s->m->cells, s->out->faces, (size_t)n};
    for (int k = 0; k < n; k++)
        CLN_TRY(add_face(s, middle, loop[k], loop[(k + 1) % n]));
done:
    return st;
}

/* Cuts a cell that is next to narrower ones. */
static cln_status cut_joint(sweep *s, const int from[3], int width)
{
    cln_status st = CLN_OK;
    pieces p = {.count = 0};
    uint32_t loop[PIECES];

    for (int face = 0; face < 6; face++) {
        const int axis = face / 2, b = (axis + 1) % 3, c = (axis + 2) % 3;
        int corner[3] = {from[0], from[1], from[2]}, part = 0;

        corner[axis] += face % 2 ? width : 0;
        part = face_width(s, axis, corner);
        for (int v = 0; v < width; v += part)
            for (int u = 0; u < width; u += part) {
                corner[b] = from[b] + u;
                corner[c] = from[c] + v;
                CLN_TRY(walk_face(s, axis, face % 2, corner, part, &p));
            }
    }
    while (p.count > 0) {
        uint32_t next = p.to[--p.count];
        int n = 0;

        loop[n++] = p.from[p.count];
        while (next != loop[0]) {
            int k = 0;

            while (k < p.count && p.from[k] != next)
                k++;
            CLN_ASSERT(k < p.count);
            loop[n++] = next;
            next = p.to[k];
            p.from[k] = p.from[--p.count];
            p.to[k] = p.to[p.count];
        }
        CLN_TRY(fill_loop(s, loop, n, width));
    }
done:
    return st;
}

/* Returns whether all edges of a cell are as long as it is wide. */
static bool is_plain(const sweep *s, const int from[3], int width)
{
    for (int edge = 0; edge < CLN_MARCHING_EDGES; edge++) {
        int at[3];

        corner_of(from, width, cln_marching_edge_start(edge), at);
        if (edge_length(s, edge / 4, at) < width)
            return false;
    }
    return true;
}

static cln_status cut_block(sweep *s, int x, int y, int z)
{
    cln_status st = CLN_OK;
    const int from[3] = {CLN_MARCHING_BLOCK * x, CLN_MARCHING_BLOCK * y, CLN_MARCHING_BLOCK * z};
    const int width = 1 << level_of(s, x, y, z);
    int end[3], at[3];

    for (int a = 0; a < 3; a++)
        end[a] = least(from[a] + CLN_MARCHING_BLOCK, s->m->cells);
    for (at[2] = from[2]; at[2] < end[2]; at[2] += width)
        for (at[1] = from[1]; at[1] < end[1]; at[1] += width)
            for (at[0] = from[0]; at[0] < end[0]; at[0] += width) {
                if (width == 1 || is_plain(s, at, width))
                    CLN_TRY(cut_plain(s, at, width));
                else
                    CLN_TRY(cut_joint(s, at, width));
            }
done:
    return st;
}

/* ---- the sweep ---- */

cln_status cln_marching_run(const cln_marching *marching, cln_surface *out)
{
    cln_status st = CLN_OK;
    sweep s = {.m = marching,
               .side = (size_t)marching->cells + 1,
               .blocks = cln_marching_blocks(marching->cells),
               .levels = marching->levels,
               .out = out};
    const size_t area = s.side * s.side;

    CLN_TRY(start(&s));
    for (int z = 0; z < s.blocks; z++) {
        if (z > 0)
            memcpy(s.values, s.values + (size_t)(s.top - s.bottom) * area, area * sizeof *s.values);
        s.bottom = CLN_MARCHING_BLOCK * z;
        s.top = least(s.bottom + CLN_MARCHING_BLOCK, marching->cells);
        CLN_TRY(ask_slab(&s, z));
        for (int y = 0; y < s.blocks; y++)
            for (int x = 0; x < s.blocks; x++)
                CLN_TRY(cut_block(&s, x, y, z));
        CLN_TRY(put_in_place(&s));
        CLN_TRY(place_hubs(&s));
        CLN_TRY(cln_edges_keep(&s.edges, is_on_top, &s));
        if (marching->progress)
            CLN_TRY(marching->progress(marching->user, z + 1, s.blocks));
    }
done:
    finish(&s);
    return st;
}
