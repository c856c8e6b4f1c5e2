/* Edges that more than two triangles have. See crowded.h. */
#include "export/crowded.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

enum { MOST = 32, ROUNDS = 8 }; /* sides of an edge that are told apart */

/* How far a middle stands off, of the least width there. */
static const double OFF = 0.02;

/* A side of a triangle as an edge, its lower vertex first. */
typedef struct side {
    uint64_t edge;
    uint32_t face, corner; /* the one that it begins at */
    bool turned;           /* it runs from the higher vertex to the lower */
} side;

static int by_edge(const void *a, const void *b)
{
    const side *x = a, *y = b;

    if (x->edge != y->edge)
        return x->edge < y->edge ? -1 : 1;
    return x->face < y->face ? -1 : x->face > y->face;
}

/* *out: the sides of all triangles, in the order of their edges. */
static cln_status sort_sides(const cln_mesh *mesh, side **out)
{
    cln_status st = CLN_OK;
    side *s = NULL;

    CLN_TRY(cln_alloc(&s, 3 * mesh->faces, sizeof *s, "sides of triangles"));
    for (size_t f = 0; f < mesh->faces; f++)
        for (uint32_t k = 0; k < 3; k++) {
            const uint32_t a = mesh->face[f][k], b = mesh->face[f][(k + 1) % 3];

            s[3 * f + k] =
                (side){(uint64_t)(a < b ? a : b) << 32 | (a < b ? b : a), (uint32_t)f, k, a > b};
        }
    qsort(s, 3 * mesh->faces, sizeof *s, by_edge);
    *out = s;
done:
    return st;
}

/* Sides of the same edge from s on, of n. */
static size_t run_of(const side *s, size_t n)
{
    size_t run = 1;

    while (run < n && s[run].edge == s->edge)
        run++;
    return run;
}

cln_status cln_mesh_count_edges(const cln_mesh *mesh, cln_mesh_edges *out)
{
    cln_status st = CLN_OK;
    side *sides = NULL;
    const size_t n = 3 * mesh->faces;

    memset(out, 0, sizeof *out);
    CLN_TRY(sort_sides(mesh, &sides));
    for (size_t i = 0, run = 0; i < n; i += run) {
        size_t turned = 0;

        run = run_of(sides + i, n - i);
        for (size_t k = i; k < i + run; k++)
            turned += sides[k].turned;
        out->open += 2 * turned != run;
        out->crowded += run > 2;
        out->pairs += run > 2 ? run / 2 - 1 + run % 2 : 0;
    }
done:
    free(sides);
    return st;
}

/* ---- around an edge ---- */

typedef struct wing {
    double angle, width; /* of the triangle about the edge, and across it */
    int side;            /* of the edge's */
    bool turned;
} wing;

static int by_angle(const void *a, const void *b)
{
    const wing *x = a, *y = b;

    if (x->angle != y->angle)
        return x->angle < y->angle ? -1 : 1;
    return x->side - y->side;
}

typedef struct edge {
    double middle[3], length, across[2][3]; /* two directions at right angles to it */
} edge;

static void place_edge(const cln_mesh *mesh, const side *s, edge *e)
{
    const double *a = mesh->at[s->edge >> 32], *b = mesh->at[s->edge & UINT32_MAX];
    double along[3], size = 0;
    int least = 0;

    e->length = 0;
    for (int i = 0; i < 3; i++) {
        e->middle[i] = 0.5 * (a[i] + b[i]);
        along[i] = b[i] - a[i];
        e->length += along[i] * along[i];
    }
    e->length = sqrt(e->length);
    for (int i = 0; i < 3; i++) {
        along[i] /= e->length > 0 ? e->length : 1;
        least = fabs(along[i]) < fabs(along[least]) ? i : least;
    }
    for (int i = 0; i < 3; i++) {
        e->across[0][i] = (i == least) - along[i] * along[least];
        size += e->across[0][i] * e->across[0][i];
    }
    for (int i = 0; i < 3; i++)
        e->across[0][i] /= sqrt(size);
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;

        e->across[1][i] = along[j] * e->across[0][k] - along[k] * e->across[0][j];
    }
}

/* The corner of a side's triangle that is not on it. */
static uint32_t across(const cln_mesh *mesh, const side *s)
{
    return mesh->face[s->face][(s->corner + 2) % 3];
}

/* Sorts the edge's triangles by their angle about it. */
static void find_wings(const cln_mesh *mesh, const edge *e, const side *s, int n, wing *wings)
{
    for (int i = 0; i < n; i++) {
        const double *at = mesh->at[across(mesh, &s[i])];
        double x = 0, y = 0;

        for (int a = 0; a < 3; a++) {
            x += (at[a] - e->middle[a]) * e->across[0][a];
            y += (at[a] - e->middle[a]) * e->across[1][a];
        }
        wings[i] = (wing){atan2(y, x), hypot(x, y), i, s[i].turned};
    }
    qsort(wings, (size_t)n, sizeof *wings, by_angle);
}

/* Pairs of wings with the inside between them: as the angle grows, a turned one enters it and the
 * next of the others leaves it. Like brackets, all around. Returns the number of pairs. */
static int pair_wings(const wing *wings, int n, int (*pair)[2])
{
    int open[MOST], opened = 0, count = 0;
    bool paired[MOST] = {false};

    for (int turn = 0; turn < 2; turn++)
        for (int i = 0; i < n; i++) {
            if (paired[i])
                continue;
            if (wings[i].turned) {
                if (turn == 0)
                    open[opened++] = i;
            } else if (opened > 0) {
                pair[count][0] = open[--opened];
                pair[count][1] = i;
                paired[open[opened]] = paired[i] = true;
                count++;
            }
        }
    return count;
}

/* A new vertex beside the edge's middle, inside of the wings that it parts from the others. */
static void add_middle(cln_mesh *mesh, const edge *e, const side *s, const wing *enters,
                       const wing *leaves)
{
    const uint32_t ends[2] = {(uint32_t)(s->edge >> 32), (uint32_t)s->edge};
    const size_t v = mesh->vertices++;
    const double between = leaves->angle - enters->angle;
    const double angle = enters->angle + 0.5 * (between < 0 ? between + 2 * M_PI : between);
    const double off = OFF * fmin(e->length, fmin(enters->width, leaves->width));
    double size = 0;

    for (int a = 0; a < 3; a++) {
        mesh->at[v][a] =
            e->middle[a] + off * (cos(angle) * e->across[0][a] + sin(angle) * e->across[1][a]);
        mesh->normal[v][a] = mesh->normal[ends[0]][a] + mesh->normal[ends[1]][a];
        mesh->colour[v][a] =
            (uint8_t)((mesh->colour[ends[0]][a] + mesh->colour[ends[1]][a] + 1) / 2);
        size += (double)mesh->normal[v][a] * mesh->normal[v][a];
    }
    if (mesh->views)
        mesh->views[v] = mesh->views[ends[mesh->views[ends[1]] < mesh->views[ends[0]]]];
    for (int a = 0; a < 3; a++)
        mesh->normal[v][a] =
            size > 1e-12 ? (float)(mesh->normal[v][a] / sqrt(size)) : mesh->normal[ends[0]][a];
}

/* Cuts a triangle in two at its side: at the last vertex. */
static void cut(cln_mesh *mesh, const side *s)
{
    uint32_t *old = mesh->face[s->face], *fresh = mesh->face[mesh->faces++];

    memcpy(fresh, old, sizeof mesh->face[0]);
    old[(s->corner + 1) % 3] = fresh[s->corner] = (uint32_t)(mesh->vertices - 1);
}

/* Parts the pairs at one edge: all but one get a middle of their own, unless triangles are left
 * over that keep the edge. Two triangles back to back cannot be parted. */
static void part_edge(cln_mesh *mesh, const side *s, int n)
{
    wing wings[MOST];
    int pair[MOST / 2][2], count = 0;
    edge e;

    place_edge(mesh, s, &e);
    find_wings(mesh, &e, s, n, wings);
    count = pair_wings(wings, n, pair);
    for (int i = 2 * count == n; i < count; i++) {
        const wing *enters = &wings[pair[i][0]], *leaves = &wings[pair[i][1]];

        if (across(mesh, &s[enters->side]) == across(mesh, &s[leaves->side]))
            continue;
        add_middle(mesh, &e, s, enters, leaves);
        for (int k = 0; k < 2; k++)
            cut(mesh, &s[wings[pair[i][k]].side]);
    }
}

/* One round: of edges that have a triangle in common only one. */
static cln_status part_some(cln_mesh *mesh, size_t vertex_room, size_t face_room, size_t *crowded)
{
    cln_status st = CLN_OK;
    const size_t n = 3 * mesh->faces;
    side *sides = NULL;
    bool *cut_already = NULL;

    *crowded = 0;
    CLN_TRY(sort_sides(mesh, &sides));
    CLN_TRY(cln_alloc(&cut_already, mesh->faces, sizeof *cut_already, "triangles"));
    for (size_t i = 0, run = 0; i < n; i += run) {
        bool free_to = true;

        run = run_of(sides + i, n - i);
        if (run <= 2)
            continue;
        (*crowded)++;
        for (size_t k = 0; k < run; k++)
            free_to = free_to && !cut_already[sides[i + k].face];
        if (!free_to || run > MOST || mesh->vertices + run / 2 > vertex_room ||
            mesh->faces + run > face_room)
            continue;
        for (size_t k = 0; k < run; k++)
            cut_already[sides[i + k].face] = true;
        part_edge(mesh, sides + i, (int)run);
    }
done:
    free(sides);
    free(cut_already);
    return st;
}

cln_status cln_mesh_part_crowded(cln_mesh *mesh, size_t vertex_room, size_t face_room, size_t *left)
{
    cln_status st = CLN_OK;
    cln_mesh_edges edges;

    for (int round = 0; round < ROUNDS; round++) {
        CLN_TRY(part_some(mesh, vertex_room, face_room, left));
        if (*left == 0)
            return CLN_OK;
    }
    CLN_TRY(cln_mesh_count_edges(mesh, &edges));
    *left = edges.crowded;
done:
    return st;
}
