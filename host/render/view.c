/* A view in batches of rays, top to bottom. See view.h. */
#include "render/view.h"

#include <signal.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "pipeline/plan.h"
#include "render/antialias.h"

cln_status cln_render_prepare(cln_pipeline *p)
{
    return cln_stage_picture_densities(p);
}

void cln_render_release(cln_pipeline *p)
{
    cln_stage_picture_release(p);
}

cln_status cln_rendering_begin(cln_pipeline *p, int view, const float background[3],
                               bool axis_depth, cln_rendering *out)
{
    cln_status st = CLN_OK;
    const cln_device_camera *camera = &p->host_cameras[view];
    const size_t total = (size_t)camera->width * (size_t)camera->height;
    const int most =
        p->max_rays > 0 && p->max_rays < CLN_RENDER_RAYS ? p->max_rays : CLN_RENDER_RAYS;
    cln_picture *picture = &out->picture;

    memset(out, 0, sizeof *out);
    out->view = view;
    out->most = most;
    picture->width = camera->width;
    picture->height = camera->height;
    CLN_TRY(cln_alloc(&picture->rgb, total * 3, sizeof *picture->rgb, "picture"));
    CLN_TRY(cln_alloc(&picture->depth, total, sizeof *picture->depth, "picture"));
    CLN_TRY(cln_alloc(&picture->opacity, total, sizeof *picture->opacity, "picture"));
    CLN_TRY(cln_alloc(&out->pixels, (size_t)most, sizeof *out->pixels, "ray batch"));
    CLN_TRY(cln_alloc(&out->results, (size_t)most, sizeof *out->results, "ray batch"));
    CLN_TRY(cln_alloc(&out->backgrounds, (size_t)most, sizeof *out->backgrounds, "ray batch"));
    for (int i = 0; i < most; i++)
        memcpy(out->backgrounds[i], background, 3 * sizeof(float));
    out->batch = (cln_ray_batch){.pixels = out->pixels,
                                 .backgrounds = (const float(*)[4])out->backgrounds,
                                 .axis_depth = axis_depth,
                                 .sampling = cln_render_sampling(p)};
done:
    if (st != CLN_OK)
        cln_rendering_end(p, out);
    return st;
}

void cln_rendering_end(cln_pipeline *p, cln_rendering *r)
{
    if (r->under_way)
        (void)cln_device_finish(p->device); /* the queue may still have to do with these arrays */
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

cln_status cln_rendering_step(cln_pipeline *p, cln_rendering *r)
{
    cln_status st = CLN_OK;
    cln_picture *out = &r->picture;
    const int first = r->done, left = out->width * out->height - first;
    const int n = left < r->most ? left : r->most;
    int rendered = 0;

    for (int i = 0; i < n; i++)
        r->pixels[i] = (cln_pixel){.view = (cln_u32)r->view,
                                   .x = (cln_u32)((first + i) % out->width),
                                   .y = (cln_u32)((first + i) / out->width)};
    CLN_TRY(render_some(p, r, n, &rendered));
    for (int i = 0; i < rendered; i++) {
        const cln_ray_result *result = &r->results[i];

        out->rgb[3 * (first + i)] = result->r;
        out->rgb[3 * (first + i) + 1] = result->g;
        out->rgb[3 * (first + i) + 2] = result->b;
        out->depth[first + i] = result->depth;
        out->opacity[first + i] = result->opacity;
    }
    r->done += rendered;
done:
    return st;
}

static cln_status poll_signal(const cln_callbacks *callbacks)
{
    const int signal =
        callbacks && callbacks->interrupted ? callbacks->interrupted(callbacks->user) : 0;

    if (signal == SIGINT || signal == SIGTERM)
        return cln_fail(signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM, "stopped by a signal");
    return CLN_OK;
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
static cln_status render_edges(cln_pipeline *p, cln_rendering *f, const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    const int n = p->antialias, each = n * n;
    cln_picture *out = &f->picture;
    int *edges = NULL, count = 0;
    double(*sums)[4] = NULL;
    cln_pixel *rays = NULL;

    CLN_TRY(cln_antialias_edges(out, &edges, &count));
    CLN_TRY(cln_alloc(&sums, (size_t)out->width * (size_t)out->height, sizeof *sums, "edges"));
    CLN_TRY(cln_alloc(&rays, (size_t)count * (size_t)each, sizeof *rays, "edges"));
    for (int i = 0; i < count * each; i++)
        rays[i] = fine_pixel(edges, out->width, n, f->view + p->view_count, i);
    qsort(rays, (size_t)count * (size_t)each, sizeof *rays, by_row);
    for (int first = 0, rendered = 0; first < count * each; first += rendered) {
        const int some = count * each - first < f->most ? count * each - first : f->most;

        memcpy(f->pixels, rays + first, (size_t)some * sizeof *rays);
        CLN_TRY(poll_signal(callbacks));
        CLN_TRY(render_some(p, f, some, &rendered));
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
    cln_rendering r = {0};

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_rendering_begin(p, view, background, axis_depth, &r));
    while (r.done < r.picture.width * r.picture.height) {
        CLN_TRY(poll_signal(callbacks));
        CLN_TRY(cln_rendering_step(p, &r));
    }
    if (p->antialias > 1)
        CLN_TRY(render_edges(p, &r, callbacks));
    *out = r.picture;
    memset(&r.picture, 0, sizeof r.picture);
done:
    cln_rendering_end(p, &r);
    return st;
}
