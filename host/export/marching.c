/* Marching cubes. See marching.h. The table of cases is made, not written down: in each face of a
 * cell, seen from outside, the surface runs from where a walk around the face enters the inside to
 * where it leaves it; these pieces join to loops, and the loops are cut into triangles. */
#include "export/marching.h"

#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

enum { EDGES = 12, CHUNK = 65536, ROUNDS = 6 };

/* ---- the cases ---- */

/* Edge from corner `from` along `axis`; `from` has the axis' bit clear. */
static int edge_of(int from, int axis)
{
    const int low = axis == 0 ? 1 : 0, high = axis == 2 ? 1 : 2;

    return 4 * axis + (from >> low & 1) + 2 * (from >> high & 1);
}

static int edge_between(int a, int b)
{
    const int axis = (a ^ b) >> 1; /* 1, 2, 4 -> 0, 1, 2 */

    return edge_of(a & b, axis);
}

static int edge_start(int edge)
{
    const int axis = edge / 4, low = axis == 0 ? 1 : 0, high = axis == 2 ? 1 : 2;

    return (edge & 1) << low | (edge >> 1 & 1) << high;
}

/* Do two edges lie in one face? Then a triangle's inner side must not join them: the cell beyond
 * would have it as well. */
static bool share_face(int a, int b)
{
    const int from_a = edge_start(a), from_b = edge_start(b);

    for (int axis = 0; axis < 3; axis++)
        if (axis != a / 4 && axis != b / 4 && !((from_a ^ from_b) >> axis & 1))
            return true;
    return false;
}

/* next[e]: the edge that the surface runs to from edge e, in the face where a walk around it,
 * counter-clockwise as seen from outside the cell, enters the inside on e; -1: e is not cut. */
static void join_edges(int inside, int next[EDGES])
{
    for (int e = 0; e < EDGES; e++)
        next[e] = -1;
    for (int face = 0; face < 6; face++) {
        const int axis = face / 2, side = face % 2;
        const int b = 1 << (axis + 1) % 3, c = 1 << (axis + 2) % 3;
        const int at = side << axis;
        const int corner[4] = {at, at | (side ? b : c), at | b | c, at | (side ? c : b)};

        for (int i = 0; i < 4; i++) {
            int j = (i + 1) % 4;

            if (inside >> corner[i] & 1 || !(inside >> corner[j] & 1))
                continue;
            while (inside >> corner[(j + 1) % 4] & 1)
                j = (j + 1) % 4;
            next[edge_between(corner[i], corner[(i + 1) % 4])] =
                edge_between(corner[j], corner[(j + 1) % 4]);
        }
    }
}

/* The vertex of a loop from which it is cut, so that no cut lies in a face. */
static int apex_of(const int *loop, int n)
{
    for (int apex = 0; apex < n; apex++) {
        bool free = true;

        for (int k = 2; k < n - 1 && free; k++)
            free = !share_face(loop[apex], loop[(apex + k) % n]);
        if (free)
            return apex;
    }
    CLN_ASSERT(!"a loop that cannot be cut");
    return 0;
}

void cln_marching_cases(cln_marching_case cases[256])
{
    for (int inside = 0; inside < 256; inside++) {
        cln_marching_case *c = &cases[inside];
        int next[EDGES];

        memset(c, 0, sizeof *c);
        join_edges(inside, next);
        for (int e = 0; e < EDGES; e++) {
            int loop[EDGES], n = 0, apex = 0;

            for (int at = e; next[at] >= 0;) {
                const int following = next[at];

                loop[n++] = at;
                next[at] = -1;
                at = following;
            }
            if (n == 0)
                continue;
            apex = apex_of(loop, n);
            for (int k = 1; k < n - 1; k++, c->count++) {
                CLN_ASSERT(c->count < CLN_MARCHING_TRIANGLES);
                c->edge[c->count][0] = (uint8_t)loop[apex];
                c->edge[c->count][1] = (uint8_t)loop[(apex + k) % n];
                c->edge[c->count][2] = (uint8_t)loop[(apex + k + 1) % n];
            }
        }
    }
}

/* ---- the sweep ---- */

typedef struct crossing {
    float in, out; /* coordinates along the axis: the function is above 0 at the first one */
    float value_in, value_out;
    int axis;
} crossing;

typedef struct sweep {
    const cln_marching *m;
    size_t side;               /* points of the grid along an axis */
    float *values[2];          /* [y][x] of the lower and the upper slice */
    uint32_t *edges[2][2];     /* [slice][x, y][y][x] vertex on the edge from this point */
    uint32_t *up;              /* [y][x] the same for z */
    crossing *crossings;       /* of vertices that are not yet in their places */
    size_t count, room, first; /* crossings; vertex of the first one */
    float (*at)[4];            /* [CHUNK] */
    float *answers;            /* [CHUNK] */
    size_t *asked;             /* [CHUNK] */
    cln_marching_case cases[256];
    cln_surface *out;
} sweep;

static float place(const sweep *s, size_t i)
{
    return (float)(-1 + 2 * (double)i / s->m->cells);
}

static cln_status start(sweep *s)
{
    cln_status st = CLN_OK;
    const size_t area = s->side * s->side;

    for (int k = 0; k < 2; k++) {
        CLN_TRY(cln_alloc(&s->values[k], area, sizeof *s->values[k], "slices of the grid"));
        for (int axis = 0; axis < 2; axis++)
            CLN_TRY(cln_alloc(&s->edges[k][axis], area, sizeof(uint32_t), "slices of the grid"));
    }
    CLN_TRY(cln_alloc(&s->up, area, sizeof *s->up, "slices of the grid"));
    CLN_TRY(cln_alloc(&s->at, CHUNK, sizeof *s->at, "points"));
    CLN_TRY(cln_alloc(&s->answers, CHUNK, sizeof *s->answers, "points"));
    CLN_TRY(cln_alloc(&s->asked, CHUNK, sizeof *s->asked, "points"));
    cln_marching_cases(s->cases);
done:
    return st;
}

static void finish(sweep *s)
{
    for (int k = 0; k < 2; k++) {
        free(s->values[k]);
        for (int axis = 0; axis < 2; axis++)
            free(s->edges[k][axis]);
    }
    free(s->up);
    free(s->crossings);
    free(s->at);
    free(s->answers);
    free(s->asked);
}

static cln_status flush(sweep *s, size_t n, float *to)
{
    cln_status st = CLN_OK;

    if (n > 0)
        CLN_TRY(s->m->ask(s->m->user, n, (const float(*)[4])s->at, s->answers));
    for (size_t i = 0; i < n; i++)
        to[s->asked[i]] = s->answers[i];
done:
    return st;
}

static cln_status ask_slice(sweep *s, size_t z, float *to)
{
    cln_status st = CLN_OK;
    const size_t last = s->side - 1;
    size_t n = 0;

    for (size_t y = 0; y < s->side; y++)
        for (size_t x = 0; x < s->side; x++) {
            const size_t point = y * s->side + x;

            to[point] = -1;
            if (x == 0 || y == 0 || z == 0 || x == last || y == last || z == last)
                continue;
            memcpy(s->at[n], (const float[4]){place(s, x), place(s, y), place(s, z), 0},
                   sizeof s->at[n]);
            s->asked[n++] = point;
            if (n == CHUNK) {
                CLN_TRY(flush(s, n, to));
                n = 0;
            }
        }
    CLN_TRY(flush(s, n, to));
done:
    return st;
}

/* A vertex on the edge along `axis` between points with these values, if it is cut. */
static cln_status cut(sweep *s, int axis, const size_t from[3], float low, float high,
                      uint32_t *vertex)
{
    cln_status st = CLN_OK;
    cln_surface *out = s->out;
    const float here = place(s, from[axis]), there = place(s, from[axis] + 1);

    if ((low > 0) == (high > 0))
        return CLN_OK;
    if (s->count == s->room) {
        const size_t room = s->room ? 2 * s->room : 4096;
        crossing *more = realloc(s->crossings, room * sizeof *more);

        if (!more)
            return cln_fail(CLN_MEMORY, "surface: no memory for %zu vertices of a slice", room);
        s->crossings = more;
        s->room = room;
    }
    CLN_TRY(cln_surface_grow_vertices(out));
    for (int a = 0; a < 3; a++)
        out->at[out->vertices][a] = place(s, from[a]);
    *vertex = (uint32_t)out->vertices++;
    s->crossings[s->count++] = low > 0 ? (crossing){here, there, low, high, axis}
                                       : (crossing){there, here, high, low, axis};
done:
    return st;
}

/* The edges within a slice, and up to it from the one below (NULL: none is there). */
static cln_status cut_slice(sweep *s, size_t z, int slice, const float *below)
{
    cln_status st = CLN_OK;
    const float *values = s->values[slice];

    for (size_t y = 0; y < s->side; y++)
        for (size_t x = 0; x < s->side; x++) {
            const size_t point = y * s->side + x;
            const float here = values[point];

            if (x + 1 < s->side)
                CLN_TRY(cut(s, 0, (const size_t[3]){x, y, z}, here, values[point + 1],
                            &s->edges[slice][0][point]));
            if (y + 1 < s->side)
                CLN_TRY(cut(s, 1, (const size_t[3]){x, y, z}, here, values[point + s->side],
                            &s->edges[slice][1][point]));
            if (below)
                CLN_TRY(
                    cut(s, 2, (const size_t[3]){x, y, z - 1}, below[point], here, &s->up[point]));
        }
done:
    return st;
}

static uint32_t vertex_of(const sweep *s, int edge, size_t corner, int lower)
{
    const int from = edge_start(edge), axis = edge / 4;
    const size_t point = corner + (size_t)(from & 1) + (from & 2 ? s->side : 0);

    return axis == 2 ? s->up[point] : s->edges[from & 4 ? !lower : lower][axis][point];
}

static cln_status fill_cells(sweep *s, int lower)
{
    cln_status st = CLN_OK;
    const float *low = s->values[lower], *high = s->values[!lower];

    for (size_t y = 0; y + 1 < s->side; y++)
        for (size_t x = 0; x + 1 < s->side; x++) {
            const size_t at = y * s->side + x, above = at + s->side;
            const int inside = (low[at] > 0) | (low[at + 1] > 0) << 1 | (low[above] > 0) << 2 |
                               (low[above + 1] > 0) << 3 | (high[at] > 0) << 4 |
                               (high[at + 1] > 0) << 5 | (high[above] > 0) << 6 |
                               (high[above + 1] > 0) << 7;
            const cln_marching_case *c = &s->cases[inside];

            for (int t = 0; t < c->count; t++) {
                CLN_TRY(cln_surface_grow_faces(s->out));
                for (int k = 0; k < 3; k++)
                    s->out->face[s->out->faces][k] = vertex_of(s, c->edge[t][k], at, lower);
                s->out->faces++;
            }
        }
done:
    return st;
}

/* Halves the piece of an edge that has the change of sign, some times, and ends by a straight
 * line. */
static cln_status put_in_place(sweep *s)
{
    cln_status st = CLN_OK;
    float(*at)[3] = s->out->at + s->first;

    for (size_t first = 0; first < s->count; first += CHUNK) {
        const size_t n = s->count - first < CHUNK ? s->count - first : CHUNK;

        for (int round = 0; round < ROUNDS; round++) {
            for (size_t i = 0; i < n; i++) {
                const crossing *c = &s->crossings[first + i];

                memcpy(s->at[i], at[first + i], sizeof at[0]);
                s->at[i][3] = 0;
                s->at[i][c->axis] = 0.5f * (c->in + c->out);
            }
            CLN_TRY(s->m->ask(s->m->user, n, (const float(*)[4])s->at, s->answers));
            for (size_t i = 0; i < n; i++) {
                crossing *c = &s->crossings[first + i];
                const bool inside = s->answers[i] > 0;

                *(inside ? &c->in : &c->out) = s->at[i][c->axis];
                *(inside ? &c->value_in : &c->value_out) = s->answers[i];
            }
        }
        for (size_t i = 0; i < n; i++) {
            const crossing *c = &s->crossings[first + i];

            at[first + i][c->axis] =
                c->in + (c->out - c->in) * (c->value_in / (c->value_in - c->value_out));
        }
    }
    s->first += s->count;
    s->count = 0;
done:
    return st;
}

cln_status cln_marching_run(const cln_marching *marching, cln_surface *out)
{
    cln_status st = CLN_OK;
    sweep s = {.m = marching, .side = (size_t)marching->cells + 1, .out = out};

    CLN_TRY(start(&s));
    for (size_t z = 0; z < s.side; z++) {
        const int slice = (int)(z % 2);

        CLN_TRY(ask_slice(&s, z, s.values[slice]));
        CLN_TRY(cut_slice(&s, z, slice, z > 0 ? s.values[!slice] : NULL));
        CLN_TRY(put_in_place(&s));
        if (z > 0)
            CLN_TRY(fill_cells(&s, !slice));
        if (marching->progress)
            CLN_TRY(marching->progress(marching->user, (int)z + 1, (int)s.side));
    }
done:
    finish(&s);
    return st;
}
