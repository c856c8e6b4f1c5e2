/* A view in batches of rays, square by square of its pixels. See view.h. */
#include "render/view.h"

#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/memory.h"
#include "pipeline/plan.h"
#include "pipeline/stage1.h"
#include "ranks/ranks.h"

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

    cln_antialias_free(&r->edges);
    r->view = view;
    r->antialias = p->antialias;
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
        cln_rendering_end(out);
    return st;
}

void cln_rendering_end(cln_rendering *r)
{
    cln_picture_free(&r->picture);
    cln_antialias_free(&r->edges);
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

static bool has_centres(const cln_rendering *r)
{
    return r->done == r->picture.width * r->picture.height;
}

bool cln_rendering_whole(const cln_rendering *r)
{
    return has_centres(r) && (r->antialias <= 1 || cln_antialias_done(&r->edges));
}

static cln_status step_centres(cln_pipeline *p, cln_rendering *r)
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

static cln_status step_edges(cln_pipeline *p, cln_rendering *r)
{
    cln_status st = CLN_OK;
    int n = 0, rendered = 0;

    if (!r->edges.pixels)
        CLN_TRY(cln_antialias_find(&r->picture, r->antialias, r->most, &r->edges));
    n = cln_antialias_rays(&r->edges, (cln_u32)(r->view + p->view_count), r->most, r->pixels);
    if (n == 0)
        goto done;
    CLN_TRY(render_some(p, r, n, &rendered));
    cln_antialias_add(&r->edges, r->results, rendered, &r->picture);
done:
    return st;
}

cln_status cln_rendering_step(cln_pipeline *p, cln_rendering *r)
{
    return has_centres(r) ? step_edges(p, r) : step_centres(p, r);
}

/* All ranks poll at the same places, and each obeys a signal to any of them. */
static cln_status poll_signal(const cln_pipeline *p, const cln_callbacks *callbacks)
{
    double most = cln_poll_signal(callbacks);

    if (p->ranks > 1)
        cln_ranks_largest(&most, 1);
    return cln_stopped_by((int)most, NULL);
}

/* Renders all of a picture that was begun; shown: as work. */
static cln_status render_all(cln_pipeline *p, const cln_callbacks *callbacks, bool shown,
                             cln_rendering *r)
{
    cln_status st = CLN_OK;

    while (!cln_rendering_whole(r)) {
        if (shown)
            cln_show_work(callbacks, "pixels", r->done, r->picture.width * r->picture.height);
        CLN_TRY(poll_signal(p, callbacks));
        CLN_TRY(cln_rendering_step(p, r));
    }
done:
    return st;
}

static cln_status render_view(cln_pipeline *p, int view, const float background[3], unsigned depth,
                              const cln_callbacks *callbacks, bool shown, cln_picture *out)
{
    cln_status st = CLN_OK;
    cln_rendering r = {0};

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_rendering_begin(p, view, background, depth, &r));
    CLN_TRY(render_all(p, callbacks, shown, &r));
    *out = r.picture;
    memset(&r.picture, 0, sizeof r.picture);
done:
    cln_rendering_end(&r);
    return st;
}

cln_status cln_render_view(cln_pipeline *p, int view, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_picture *out)
{
    return render_view(p, view, background, depth, callbacks, false, out);
}

cln_status cln_render_large(cln_pipeline *p, int view, const float background[3], unsigned depth,
                            const cln_callbacks *callbacks, cln_picture *out)
{
    return render_view(p, view, background, depth, callbacks, true, out);
}

cln_status cln_render_into(cln_pipeline *p, const float background[3], unsigned depth,
                           const cln_callbacks *callbacks, cln_rendering *r)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_rendering_follow(p, 0, background, r));
    r->batch.depth = depth;
    r->done = 0;
    CLN_TRY(render_all(p, callbacks, false, r));
done:
    return st;
}
