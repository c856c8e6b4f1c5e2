/* A view in batches of rays, top to bottom. See view.h. */
#include "render/view.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "pipeline/plan.h"
#include "render/antialias.h"
#include "render/ray_batch.h"

void cln_picture_free(cln_picture *picture)
{
    free(picture->rgb);
    free(picture->depth);
    free(picture->opacity);
    memset(picture, 0, sizeof *picture);
}

cln_status cln_render_prepare(cln_pipeline *p)
{
    return cln_stage_picture_densities(p);
}

void cln_render_release(cln_pipeline *p)
{
    cln_stage_picture_release(p);
}

/* The arrays of one picture's batches. */
typedef struct frame {
    cln_pipeline *p;
    const cln_callbacks *callbacks;
    int most; /* rays of a batch */
    cln_pixel *pixels;
    cln_ray_result *results;
    float (*backgrounds)[4];
    cln_ray_batch batch;
} frame;

static cln_status open_frame(cln_pipeline *p, const float background[3], bool axis_depth,
                             const cln_callbacks *callbacks, frame *f)
{
    cln_status st = CLN_OK;
    const int most =
        p->max_rays > 0 && p->max_rays < CLN_RENDER_RAYS ? p->max_rays : CLN_RENDER_RAYS;

    *f = (frame){.p = p, .callbacks = callbacks, .most = most};
    CLN_TRY(cln_alloc(&f->pixels, (size_t)most, sizeof *f->pixels, "ray batch"));
    CLN_TRY(cln_alloc(&f->results, (size_t)most, sizeof *f->results, "ray batch"));
    CLN_TRY(cln_alloc(&f->backgrounds, (size_t)most, sizeof *f->backgrounds, "ray batch"));
    for (int i = 0; i < most; i++)
        memcpy(f->backgrounds[i], background, 3 * sizeof(float));
    f->batch = (cln_ray_batch){.pixels = f->pixels,
                               .backgrounds = (const float(*)[4])f->backgrounds,
                               .axis_depth = axis_depth,
                               .sampling = cln_render_sampling(p)};
done:
    return st;
}

static void close_frame(frame *f)
{
    free(f->pixels);
    free(f->results);
    free(f->backgrounds);
}

/* Renders the first *rendered of n rays through f->pixels, unless a signal asks to stop. */
static cln_status render_some(frame *f, int n, int *rendered)
{
    const cln_callbacks *callbacks = f->callbacks;
    const int signal =
        callbacks && callbacks->interrupted ? callbacks->interrupted(callbacks->user) : 0;

    if (signal == SIGINT || signal == SIGTERM)
        return cln_fail(signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal");
    f->batch.n = n;
    return cln_render_rays(f->p, &f->batch, f->results, rendered);
}

/* One ray through each pixel's centre. */
static cln_status render_centres(frame *f, int view, cln_picture *out)
{
    cln_status st = CLN_OK;
    const int total = out->width * out->height;

    for (int first = 0, rendered = 0; first < total; first += rendered) {
        const int n = total - first < f->most ? total - first : f->most;

        for (int i = 0; i < n; i++)
            f->pixels[i] = (cln_pixel){.view = (cln_u32)view,
                                       .x = (cln_u32)((first + i) % out->width),
                                       .y = (cln_u32)((first + i) / out->width)};
        CLN_TRY(render_some(f, n, &rendered));
        for (int i = 0; i < rendered; i++) {
            const cln_ray_result *r = &f->results[i];

            out->rgb[3 * (first + i)] = r->r;
            out->rgb[3 * (first + i) + 1] = r->g;
            out->rgb[3 * (first + i) + 2] = r->b;
            out->depth[first + i] = r->depth;
            out->opacity[first + i] = r->opacity;
        }
    }
done:
    return st;
}

/* Ray number i of the edges, n^2 a pixel, by rows of the finer picture within each row of pixels:
 * the order that splatting by view needs. */
static cln_pixel fine_pixel(const int *edges, int width, int n, int view, int i)
{
    const int edge = edges[i / (n * n)], at = i % (n * n);

    return (cln_pixel){.view = (cln_u32)view,
                       .x = (cln_u32)(edge % width * n + at % n),
                       .y = (cln_u32)(edge / width * n + at / n)};
}

static int by_row(const void *a, const void *b)
{
    const cln_pixel *p = a, *q = b;

    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return p->x < q->x ? -1 : p->x > q->x;
}

/* The means of n^2 rays where edges are; depth stays that of the centre, which is a surface's. */
static cln_status render_edges(frame *f, int view, cln_picture *out)
{
    cln_status st = CLN_OK;
    const int n = f->p->antialias, each = n * n;
    int *edges = NULL, count = 0;
    double(*sums)[4] = NULL;
    cln_pixel *rays = NULL;

    CLN_TRY(cln_antialias_edges(out, &edges, &count));
    CLN_TRY(cln_alloc(&sums, (size_t)out->width * (size_t)out->height, sizeof *sums, "edges"));
    CLN_TRY(cln_alloc(&rays, (size_t)count * (size_t)each, sizeof *rays, "edges"));
    for (int i = 0; i < count * each; i++)
        rays[i] = fine_pixel(edges, out->width, n, view + f->p->view_count, i);
    qsort(rays, (size_t)count * (size_t)each, sizeof *rays, by_row);
    for (int first = 0, rendered = 0; first < count * each; first += rendered) {
        const int some = count * each - first < f->most ? count * each - first : f->most;

        memcpy(f->pixels, rays + first, (size_t)some * sizeof *rays);
        CLN_TRY(render_some(f, some, &rendered));
        for (int i = 0; i < rendered; i++) {
            const cln_ray_result *r = &f->results[i];
            const cln_pixel *at = &rays[first + i];
            double *sum =
                sums[(size_t)(at->y / (cln_u32)n) * (size_t)out->width + at->x / (cln_u32)n];

            sum[0] += r->r;
            sum[1] += r->g;
            sum[2] += r->b;
            sum[3] += r->opacity;
        }
    }
    for (int i = 0; i < count; i++) {
        const double *sum = sums[edges[i]];

        for (int c = 0; c < 3; c++)
            out->rgb[3 * edges[i] + c] = (float)(sum[c] / each);
        out->opacity[edges[i]] = (float)(sum[3] / each);
    }
done:
    free(edges);
    free(sums);
    free(rays);
    return st;
}

cln_status cln_render_view(cln_pipeline *p, int view, const float background[3], bool axis_depth,
                           const cln_callbacks *callbacks, cln_picture *out)
{
    cln_status st = CLN_OK;
    const cln_device_camera *camera = &p->host_cameras[view];
    const size_t total = (size_t)camera->width * (size_t)camera->height;
    frame f = {0};

    memset(out, 0, sizeof *out);
    out->width = camera->width;
    out->height = camera->height;
    CLN_TRY(cln_alloc(&out->rgb, total * 3, sizeof *out->rgb, "picture"));
    CLN_TRY(cln_alloc(&out->depth, total, sizeof *out->depth, "picture"));
    CLN_TRY(cln_alloc(&out->opacity, total, sizeof *out->opacity, "picture"));
    CLN_TRY(open_frame(p, background, axis_depth, callbacks, &f));
    CLN_TRY(render_centres(&f, view, out));
    if (p->antialias > 1)
        CLN_TRY(render_edges(&f, view, out));
done:
    if (st != CLN_OK) { /* the queue may still have to do with these arrays */
        (void)cln_device_finish(p->device);
        cln_picture_free(out);
    }
    close_frame(&f);
    return st;
}
