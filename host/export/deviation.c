/* How far points are from triangles, by a grid of cells that list the triangles whose boxes reach
 * into them: looked through in shells around a point, until no nearer triangle can be beyond. See
 * deviation.h. */
#include "export/deviation.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"

enum { MOST_CELLS = 96 }; /* along an axis */

typedef struct grid {
    const uint32_t (*face)[3];
    const float (*at)[3];
    double low[3], cell;
    int n[3];
    uint32_t *begin; /* [cells + 1] into list */
    uint32_t *list;  /* numbers of triangles */
} grid;

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* The square of a point's distance from a triangle (Ericson, Real-Time Collision Detection, 5.1.5):
 * the nearest place is a corner, on an edge, or within. */
static double square_to(const grid *g, uint32_t f, const double p[3])
{
    double ab[3], ac[3], ap[3], to[3], v = 0, w = 0;

    for (int a = 0; a < 3; a++) {
        const double corner = (double)g->at[g->face[f][0]][a];

        ab[a] = (double)g->at[g->face[f][1]][a] - corner;
        ac[a] = (double)g->at[g->face[f][2]][a] - corner;
        ap[a] = p[a] - corner;
    }
    const double d1 = dot(ab, ap), d2 = dot(ac, ap), bb = dot(ab, ab), bc = dot(ab, ac);
    const double cc = dot(ac, ac), d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc;
    const double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;

    if (d1 <= 0 && d2 <= 0) {
        v = w = 0;
    } else if (d3 >= 0 && d4 <= d3) {
        v = 1;
    } else if (d6 >= 0 && d5 <= d6) {
        w = 1;
    } else if (vc <= 0 && d1 >= 0 && d3 <= 0) {
        v = bb > 0 ? d1 / bb : 0;
    } else if (vb <= 0 && d2 >= 0 && d6 <= 0) {
        w = cc > 0 ? d2 / cc : 0;
    } else if (va <= 0 && d4 >= d3 && d5 >= d6) {
        const double length = d4 - d3 + d5 - d6;

        w = length > 0 ? (d4 - d3) / length : 0;
        v = 1 - w;
    } else {
        v = vb / (va + vb + vc);
        w = vc / (va + vb + vc);
    }
    for (int a = 0; a < 3; a++)
        to[a] = ap[a] - v * ab[a] - w * ac[a];
    return dot(to, to);
}

static int cell_of(const grid *g, double x, int axis)
{
    const double cell = floor((x - g->low[axis]) / g->cell);

    return (int)fmax(0, fmin(cell, g->n[axis] - 1));
}

/* The cells that a triangle's box reaches into. */
static void reach(const grid *g, size_t f, int low[3], int high[3])
{
    for (int a = 0; a < 3; a++) {
        const float x = g->at[g->face[f][0]][a], y = g->at[g->face[f][1]][a],
                    z = g->at[g->face[f][2]][a];

        low[a] = cell_of(g, (double)fminf(x, fminf(y, z)), a);
        high[a] = cell_of(g, (double)fmaxf(x, fmaxf(y, z)), a);
    }
}

static size_t index_of(const grid *g, int x, int y, int z)
{
    return ((size_t)z * (size_t)g->n[1] + (size_t)y) * (size_t)g->n[0] + (size_t)x;
}

/* Counts each cell's triangles, or, with `fill`, lists them. */
static void list_faces(grid *g, size_t faces, bool fill)
{
    for (size_t f = 0; f < faces; f++) {
        int low[3], high[3];

        reach(g, f, low, high);
        for (int z = low[2]; z <= high[2]; z++)
            for (int y = low[1]; y <= high[1]; y++)
                for (int x = low[0]; x <= high[0]; x++) {
                    const size_t i = index_of(g, x, y, z);

                    if (fill)
                        g->list[g->begin[i]++] = (uint32_t)f;
                    else
                        g->begin[i + 1]++;
                }
    }
}

static cln_status make_grid(size_t faces, grid *g)
{
    cln_status st = CLN_OK;
    double high[3], side = 0;
    size_t cells = 1;

    for (int a = 0; a < 3; a++) {
        g->low[a] = INFINITY;
        high[a] = -INFINITY;
        for (size_t i = 0; i < 3 * faces; i++) {
            const double x = (double)g->at[g->face[i / 3][i % 3]][a];

            g->low[a] = fmin(g->low[a], x);
            high[a] = fmax(high[a], x);
        }
        side = fmax(side, high[a] - g->low[a]);
    }
    /* about as many cells along the longest side as a square of so many triangles has */
    g->cell = side / fmax(1, fmin(MOST_CELLS, sqrt((double)faces / 2)));
    for (int a = 0; a < 3; a++) {
        g->n[a] = g->cell > 0 ? (int)floor((high[a] - g->low[a]) / g->cell) + 1 : 1;
        cells *= (size_t)g->n[a];
    }
    g->cell = g->cell > 0 ? g->cell : 1;
    CLN_TRY(cln_alloc(&g->begin, cells + 2, sizeof *g->begin, "cells of triangles"));
    list_faces(g, faces, false);
    for (size_t i = 0; i < cells; i++)
        g->begin[i + 1] += g->begin[i];
    CLN_TRY(cln_alloc(&g->list, g->begin[cells], sizeof *g->list, "cells of triangles"));
    list_faces(g, faces, true);
    memmove(g->begin + 1, g->begin, cells * sizeof *g->begin); /* ends became beginnings */
    g->begin[0] = 0;
done:
    return st;
}

/* The least square of those of a cell and `least`. */
static double nearest_in(const grid *g, const double p[3], int x, int y, int z, double least)
{
    const size_t i = index_of(g, x, y, z);

    for (uint32_t k = g->begin[i]; k < g->begin[i + 1]; k++)
        least = fmin(least, square_to(g, g->list[k], p));
    return least;
}

/* A point outside of the grid counts from the cell that is nearest to it. */
static double nearest(const grid *g, const double p[3])
{
    const int most = g->n[0] + g->n[1] + g->n[2];
    double least = INFINITY;
    int at[3];

    for (int a = 0; a < 3; a++)
        at[a] = cell_of(g, p[a], a);
    for (int ring = 0; ring < most; ring++) {
        const double within = (ring - 1) * g->cell; /* all that is so near has been looked at */

        if (ring > 0 && least <= within * within)
            break;
        for (int z = at[2] - ring; z <= at[2] + ring; z++)
            for (int y = at[1] - ring; y <= at[1] + ring; y++) {
                const bool face = abs(z - at[2]) == ring || abs(y - at[1]) == ring;

                if (z < 0 || y < 0 || z >= g->n[2] || y >= g->n[1])
                    continue;
                for (int x = at[0] - ring; x <= at[0] + ring; x += face || ring == 0 ? 1 : 2 * ring)
                    if (x >= 0 && x < g->n[0])
                        least = nearest_in(g, p, x, y, z, least);
            }
    }
    return sqrt(least);
}

cln_status cln_deviation(size_t points, const float (*point)[3], size_t faces,
                         const uint32_t (*face)[3], const float (*at)[3], double *out)
{
    cln_status st = CLN_OK;
    const size_t step = points / CLN_DEVIATION + 1;
    grid g = {.face = face, .at = at};

    *out = 0;
    if (faces == 0)
        return CLN_OK;
    CLN_TRY(make_grid(faces, &g));
    for (size_t i = 0; i < points; i += step) {
        const double p[3] = {(double)point[i][0], (double)point[i][1], (double)point[i][2]};

        *out = fmax(*out, nearest(&g, p));
    }
done:
    free(g.begin);
    free(g.list);
    return st;
}
