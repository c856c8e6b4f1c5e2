/* Pixels at edges, and their means. See antialias.h. */
#include "render/antialias.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

/* A larger difference of colour or opacity, 0..1, is an edge: about 6 of 255 steps. A smaller
 * threshold gains nothing (docs/results.md, "More rays where edges are"). */
static const float STEP = 0.024f;
static const float DEPTH_STEP = 0.05f; /* the same for depths, as a share of the nearer one */

static bool differ(const cln_picture *p, size_t a, size_t b)
{
    const float nearer = fminf(p->depth[a], p->depth[b]);

    for (size_t c = 0; c < 3; c++)
        if (fabsf(p->rgb[3 * a + c] - p->rgb[3 * b + c]) > STEP)
            return true;
    if (fabsf(p->opacity[a] - p->opacity[b]) > STEP)
        return true;
    return p->opacity[a] > 0.5f && p->opacity[b] > 0.5f &&
           fabsf(p->depth[a] - p->depth[b]) > DEPTH_STEP * nearer;
}

static bool is_edge(const cln_picture *p, int x, int y)
{
    const size_t here = (size_t)y * (size_t)p->width + (size_t)x;

    for (int v = y - 1; v <= y + 1; v++)
        for (int u = x - 1; u <= x + 1; u++)
            if (u >= 0 && v >= 0 && u < p->width && v < p->height &&
                differ(p, here, (size_t)v * (size_t)p->width + (size_t)u))
                return true;
    return false;
}

/* Counts edges in whole rows from the first edge on: at most `most`, but at least one row. */
static int count_rows(const int *edges, int count, int width, int most)
{
    int end = 0;

    while (end < count) {
        int row_end = end;

        while (row_end < count && edges[row_end] / width == edges[end] / width)
            row_end++;
        if (end > 0 && row_end > most)
            break;
        end = row_end;
    }
    return end;
}

static void make_rays(cln_antialias *e, int width)
{
    const int *edges = e->pixels + e->first;
    int ray = 0;

    for (int begin = 0, end = 0; begin < e->some; begin = end) {
        const int y = edges[begin] / width;

        end = begin + count_rows(edges + begin, e->some - begin, width, 0);
        for (int row = 0; row < e->n; row++)
            for (int i = begin; i < end; i++)
                for (int column = 0; column < e->n; column++) {
                    e->edge_of[ray] = i;
                    e->ray[ray++] = (cln_pixel){.x = (cln_u32)(edges[i] % width * e->n + column),
                                                .y = (cln_u32)(y * e->n + row)};
                }
    }
}

/* Takes the rows from e->first on. */
static void take_rows(cln_antialias *e, int width)
{
    e->some = count_rows(e->pixels + e->first, e->count - e->first, width, e->most);
    e->rays = e->some * e->n * e->n;
    e->finished = 0;
    memset(e->sums, 0, (size_t)e->some * sizeof *e->sums);
    memset(e->best, 0, (size_t)e->some * sizeof *e->best);
    make_rays(e, width);
}

cln_status cln_antialias_find(const cln_picture *picture, int n, int batch, cln_antialias *out)
{
    cln_status st = CLN_OK;
    const int width = picture->width, total = width * picture->height;
    size_t most = 0;

    memset(out, 0, sizeof *out);
    out->n = n;
    out->most = batch / (n * n);
    most = (size_t)(out->most > width ? out->most : width);
    CLN_TRY(cln_alloc(&out->pixels, (size_t)total, sizeof *out->pixels, "edges"));
    CLN_TRY(cln_alloc(&out->ray, most * (size_t)(n * n), sizeof *out->ray, "edges"));
    CLN_TRY(cln_alloc(&out->edge_of, most * (size_t)(n * n), sizeof *out->edge_of, "edges"));
    CLN_TRY(cln_alloc(&out->sums, most, sizeof *out->sums, "edges"));
    CLN_TRY(cln_alloc(&out->best, most, sizeof *out->best, "edges"));
    for (int i = 0; i < total; i++)
        if (is_edge(picture, i % width, i / width))
            out->pixels[out->count++] = i;
    take_rows(out, width);
done:
    if (st != CLN_OK)
        cln_antialias_free(out);
    return st;
}

int cln_antialias_rays(const cln_antialias *e, cln_u32 view, int most, cln_pixel *out)
{
    const int left = e->rays - e->finished, n = left < most ? left : most;

    for (int i = 0; i < n; i++) {
        out[i] = e->ray[e->finished + i];
        out[i].view = view;
    }
    return n;
}

static void put_means(const cln_antialias *e, cln_picture *out)
{
    const int each = e->n * e->n;

    for (int i = 0; i < e->some; i++) {
        const int pixel = e->pixels[e->first + i];

        for (int c = 0; c < 3; c++)
            out->rgb[3 * pixel + c] = (float)(e->sums[i][c] / each);
        if (!(out->opacity[pixel] > 0) && e->best[i][0] > 0)
            out->depth[pixel] = e->best[i][1];
        out->opacity[pixel] = (float)(e->sums[i][3] / each);
    }
}

void cln_antialias_add(cln_antialias *e, const cln_ray_result *results, int rendered,
                       cln_picture *picture)
{
    for (int i = 0; i < rendered; i++) {
        double *sum = e->sums[e->edge_of[e->finished + i]];
        float *best = e->best[e->edge_of[e->finished + i]];

        sum[0] += results[i].r;
        sum[1] += results[i].g;
        sum[2] += results[i].b;
        sum[3] += results[i].opacity;
        if (results[i].opacity > best[0]) {
            best[0] = results[i].opacity;
            best[1] = results[i].depth;
        }
    }
    e->finished += rendered;
    if (e->finished < e->rays)
        return;
    put_means(e, picture);
    e->first += e->some;
    take_rows(e, picture->width);
}

bool cln_antialias_done(const cln_antialias *e)
{
    return e->pixels && e->first == e->count;
}

void cln_antialias_free(cln_antialias *e)
{
    free(e->pixels);
    free(e->ray);
    free(e->edge_of);
    free(e->sums);
    free(e->best);
    memset(e, 0, sizeof *e);
}
