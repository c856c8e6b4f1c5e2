/* A view in batches of rays, square by square of its pixels. See view.h. */
#include "render/view.h"

#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/memory.h"
#include "pipeline/plan.h"
#include "pipeline/stage1.h"
#include "ranks/ranks.h"
#include "render/antialias.h"

/* Side of the squares of pixels whose rays are taken together: neighbours meet the same leaves. */
enum { SQUARE = 128 };

cln_status cln_render_prepare(cln_pipeline *p)
{
    return cln_stage_picture_densities(p);
}

void cln_render_release(cln_pipeline *p)
{
    cln_stage_picture_release(p);
}

/* The arrays of its batches, each of room for CLN_RENDER_RAYS, unless they are there. */
static cln_status make_room(cln_rendering *r)
{
    cln_status st = CLN_OK;
    const size_t most = CLN_RENDER_RAYS;

    if (!r->pixels)
        CLN_TRY(cln_alloc(&r->pixels, most, sizeof *r->pixels, "ray batch"));
    if (!r->results)
        CLN_TRY(cln_alloc(&r->results, most, sizeof *r->results, "ray batch"));
    if (!r->backgrounds)
        CLN_TRY(cln_alloc(&r->backgrounds, most, sizeof *r->backgrounds, "ray batch"));
done:
    return st;
}

cln_status cln_rendering_follow(cln_pipeline *p, int view, const float background[3],
                                cln_rendering *r)
{
    cln_status st = CLN_OK;
    const cln_device_camera *camera = &p->host_cameras[view];

    r->view = view;
    r->most = r->next =
        p->max_rays > 0 && p->max_rays < CLN_RENDER_RAYS ? p->max_rays : CLN_RENDER_RAYS;
    r->side = cln_stage1_of(&p->config)->by_view ? 1 : SQUARE; /* 1: row by row */
    r->picture.width = camera->width;
    r->picture.height = camera->height;
    CLN_TRY(make_room(r));
    for (int i = 0; i < r->most; i++)
        memcpy(r->backgrounds[i], background, 3 * sizeof(float));
    r->batch = (cln_ray_batch){.pixels = r->pixels,
                               .backgrounds = (const float(*)[4])r->backgrounds,
                               .sampling = cln_render_sampling(p)};
done:
    return st;
}

cln_status cln_rendering_begin(cln_pipeline *p, int view, const float background[3], unsigned depth,
                               cln_rendering *out)
{
    cln_status st = CLN_OK;
    cln_picture *picture = &out->picture;
    size_t total = 0;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_rendering_follow(p, view, background, out));
    out->batch.depth = depth;
    total = (size_t)picture->width * (size_t)picture->height;
    CLN_TRY(cln_alloc(&picture->rgb, total * 3, sizeof *picture->rgb, "picture"));
    CLN_TRY(cln_alloc(&picture->depth, total, sizeof *picture->depth, "picture"));
    CLN_TRY(cln_alloc(&picture->opacity, total, sizeof *picture->opacity, "picture"));
done:
    if (st != CLN_OK)
        cln_rendering_end(p, out);
    return st;
}

void cln_rendering_end(cln_pipeline *p, cln_rendering *r)
{
    if (r->under_way)
        (void)cln_device_finish(p->device); /* the queue may still use these arrays */
    cln_picture_free(&r->picture);
    free(r->pixels);
    free(r->results);
    free(r->backgrounds);
    memset(r, 0, sizeof *r);
}

/* Renders the first *rendered of n rays through r->pixels. */
static cln_status render_some(cln_pipeline *p, cln_rendering *r, int n, int *rendered)
{
    cln_status st = CLN_OK;

    r->under_way = true;
    r->batch.n = n;
    CLN_TRY(cln_render_rays(p, &r->batch, r->results, rendered));
    r->under_way = false;
done:
    return st;
}

/* Pixel number k of a picture, by bands of r->side rows, their squares from left to right, and rows
 * of pixels in these. */
static cln_pixel pixel_at(const cln_rendering *r, int k)
{
    const int width = r->picture.width, height = r->picture.height, side = r->side;
    const int band = k / width / side * side, rows = side < height - band ? side : height - band;
    const int in_band = k - band * width, column = in_band / (side * rows) * side;
    const int columns = side < width - column ? side : width - column;
    const int in_square = in_band - column * rows;

    return (cln_pixel){.view = (cln_u32)r->view,
                       .x = (cln_u32)(column + in_square % columns),
                       .y = (cln_u32)(band + in_square / columns)};
}

/* Takes as many rays next as have about the samples of a batch, by those of the last n: rays that
 * do not fit are walked in vain. */
static void choose_next(const cln_pipeline *p, cln_rendering *r, int n)
{
    const double each = (double)p->sample_total / n;
    const double room = 0.95 * (double)r->batch.sampling.max_samples;

    r->next = each * r->most > room ? (int)(room / each) : r->most;
    if (r->next < 1)
        r->next = 1;
}

cln_status cln_rendering_step(cln_pipeline *p, cln_rendering *r)
{
    cln_status st = CLN_OK;
    cln_picture *out = &r->picture;
    const int first = r->done, left = out->width * out->height - first;
    const int wanted = r->next < r->most ? r->next : r->most, n = left < wanted ? left : wanted;
    int rendered = 0;

    for (int i = 0; i < n; i++)
        r->pixels[i] = pixel_at(r, first + i);
    CLN_TRY(render_some(p, r, n, &rendered));
    for (int i = 0; out->rgb && i < rendered; i++) {
        const cln_ray_result *result = &r->results[i];
        const size_t at = r->pixels[i].y * (size_t)out->width + r->pixels[i].x;

        out->rgb[3 * at] = result->r;
        out->rgb[3 * at + 1] = result->g;
        out->rgb[3 * at + 2] = result->b;
        out->depth[at] = result->depth;
        out->opacity[at] = result->opacity;
    }
    r->done += rendered;
    choose_next(p, r, n);
done:
    return st;
}

/* All ranks poll at the same places, and each obeys a signal to any of them. */
static cln_status poll_signal(const cln_pipeline *p, const cln_callbacks *callbacks)
{
    double most = cln_poll_signal(callbacks);

    if (p->ranks > 1)
        cln_ranks_largest(&most, 1);
    return cln_stopped_by((int)most, NULL);
}

/* Edge pixels in some whole rows of a picture, and the n x n rays of each. */
typedef struct block {
    int n;
    int *edges; /* [count] of the picture: y width + x */
    int count;
    cln_pixel *rays;   /* [count n n] by rows of the finer picture, as splatting by view needs */
    int *edge_of;      /* [count n n] index into edges */
    double (*sums)[4]; /* [count] r, g, b, opacity */
    float (*best)[2];  /* [count] opacity and depth of the most opaque ray */
} block;

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

static void make_rays(block *b, int width, int view)
{
    int ray = 0;

    for (int begin = 0, end = 0; begin < b->count; begin = end) {
        const int y = b->edges[begin] / width;

        end = begin + count_rows(b->edges + begin, b->count - begin, width, 0);
        for (int row = 0; row < b->n; row++)
            for (int i = begin; i < end; i++)
                for (int column = 0; column < b->n; column++) {
                    b->edge_of[ray] = i;
                    b->rays[ray++] =
                        (cln_pixel){.view = (cln_u32)view,
                                    .x = (cln_u32)(b->edges[i] % width * b->n + column),
                                    .y = (cln_u32)(y * b->n + row)};
                }
    }
}

static cln_status render_block(cln_pipeline *p, cln_rendering *r, block *b,
                               const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    const int each = b->n * b->n, total = b->count * each;
    cln_picture *out = &r->picture;

    memset(b->sums, 0, (size_t)b->count * sizeof *b->sums);
    memset(b->best, 0, (size_t)b->count * sizeof *b->best);
    make_rays(b, out->width, r->view + p->view_count);
    for (int first = 0, rendered = 0; first < total; first += rendered) {
        const int some = total - first < r->most ? total - first : r->most;

        memcpy(r->pixels, b->rays + first, (size_t)some * sizeof *b->rays);
        CLN_TRY(poll_signal(p, callbacks));
        CLN_TRY(render_some(p, r, some, &rendered));
        for (int i = 0; i < rendered; i++) {
            double *sum = b->sums[b->edge_of[first + i]];
            float *best = b->best[b->edge_of[first + i]];

            sum[0] += r->results[i].r;
            sum[1] += r->results[i].g;
            sum[2] += r->results[i].b;
            sum[3] += r->results[i].opacity;
            if (r->results[i].opacity > best[0]) {
                best[0] = r->results[i].opacity;
                best[1] = r->results[i].depth;
            }
        }
    }
    for (int i = 0; i < b->count; i++) {
        for (int c = 0; c < 3; c++)
            out->rgb[3 * b->edges[i] + c] = (float)(b->sums[i][c] / each);
        if (!(out->opacity[b->edges[i]] > 0) && b->best[i][0] > 0)
            out->depth[b->edges[i]] = b->best[i][1];
        out->opacity[b->edges[i]] = (float)(b->sums[i][3] / each);
    }
done:
    return st;
}

/* Gives pixels at edges the means of n x n rays. Depth stays that of the ray through the centre, as
 * a mean of depths is on no surface; if that ray meets nothing, it is that of the most opaque one.
 * Memory is that of a batch of rays or of one row's, however large the picture. */
static cln_status render_edges(cln_pipeline *p, cln_rendering *r, const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    const int n = p->antialias, width = r->picture.width, some = r->most / (n * n);
    const size_t most = (size_t)(some > width ? some : width);
    block b = {.n = n};
    int *edges = NULL, count = 0;

    CLN_TRY(cln_antialias_edges(&r->picture, &edges, &count));
    CLN_TRY(cln_alloc(&b.rays, most * (size_t)(n * n), sizeof *b.rays, "edges"));
    CLN_TRY(cln_alloc(&b.edge_of, most * (size_t)(n * n), sizeof *b.edge_of, "edges"));
    CLN_TRY(cln_alloc(&b.sums, most, sizeof *b.sums, "edges"));
    CLN_TRY(cln_alloc(&b.best, most, sizeof *b.best, "edges"));
    for (int first = 0; first < count; first += b.count) {
        b.edges = edges + first;
        b.count = count_rows(b.edges, count - first, width, some);
        CLN_TRY(render_block(p, r, &b, callbacks));
    }
done:
    free(edges);
    free(b.rays);
    free(b.edge_of);
    free(b.sums);
    free(b.best);
    return st;
}

/* Renders all of a picture that was begun. */
static cln_status render_all(cln_pipeline *p, const cln_callbacks *callbacks, cln_rendering *r)
{
    cln_status st = CLN_OK;

    while (r->done < r->picture.width * r->picture.height) {
        CLN_TRY(poll_signal(p, callbacks));
        CLN_TRY(cln_rendering_step(p, r));
    }
    if (p->antialias > 1)
        CLN_TRY(render_edges(p, r, callbacks));
done:
    return st;
}

cln_status cln_render_view(cln_pipeline *p, int view, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_picture *out)
{
    cln_status st = CLN_OK;
    cln_rendering r = {0};

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_rendering_begin(p, view, background, depth, &r));
    CLN_TRY(render_all(p, callbacks, &r));
    *out = r.picture;
    memset(&r.picture, 0, sizeof r.picture);
done:
    cln_rendering_end(p, &r);
    return st;
}

cln_status cln_render_into(cln_pipeline *p, int view, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_rendering *r)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_rendering_follow(p, view, background, r));
    r->batch.depth = depth;
    r->done = 0;
    CLN_TRY(render_all(p, callbacks, r));
done:
    return st;
}
