/* Pictures, photos and points as bytes for a browser. See painter.h. */
#include "view/painter.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "io/image.h"
#include "render/depth_picture.h"
#include "render/orbit.h"

enum { LEAST_SIDE = 24, MOVING = 85, STILL = 93 }; /* qualities of JPEG */

void cln_painting_say(cln_painting *g, int status, const char *sentence)
{
    char *text = NULL;

    free(g->body);
    g->body = NULL;
    g->bytes = 0;
    g->status = status;
    g->type = "text/plain; charset=utf-8";
    if (cln_asprintf(&text, "%s\n", sentence) == CLN_OK) {
        g->body = (uint8_t *)text;
        g->bytes = strlen(text);
    }
}

void cln_painting_free(cln_painter *painter, cln_painting *g)
{
    cln_rendering_end(painter->pipeline, &g->rendering);
    free(g->body);
    memset(g, 0, sizeof *g);
}

/* ---- pictures ---- */

static cln_status set_camera(cln_painter *painter, const cln_camera *camera)
{
    return cln_pipeline_cameras(painter->pipeline, &camera, 1, &painter->model->space);
}

/* A training has changed since the batch before, and with it its tree and memory plan. */
static cln_status step_rendering(cln_painter *painter, cln_rendering *r)
{
    const cln_pipeline *p = painter->pipeline;

    r->batch.sampling = cln_render_sampling(p);
    r->batch.sampling.pictures = !painter->training;
    if (p->max_rays > 0 && p->max_rays < r->most)
        r->most = p->max_rays;
    return cln_rendering_step(painter->pipeline, r);
}

/* The camera with as many pixels as the device renders in the time. */
static cln_status fit_budget(const cln_painter *painter, const cln_ask *ask, cln_camera *out)
{
    const cln_camera *full = &ask->camera;
    const double pixels = ask->budget / painter->seconds_per_pixel;
    const double share = sqrt(pixels / ((double)full->width * full->height));
    const int width = (int)fmax(LEAST_SIDE, share * full->width);

    *out = *full;
    if (!(ask->budget > 0) || width >= full->width)
        return CLN_OK;
    return cln_orbit_resize(full, width, 0, out);
}

static cln_status draw_depth(const cln_painter *painter, cln_painting *g, uint8_t *grey)
{
    cln_status st = CLN_OK;
    const cln_picture *p = &g->rendering.picture;
    const size_t n = (size_t)p->width * (size_t)p->height;
    cln_depth_scale scale = {0};

    for (size_t i = 0; i < n; i++) {
        grey[i] = cln_to_u8(p->opacity[i]);
        p->depth[i] =
            grey[i] > 0 ? cln_space_depth_to_scene(&painter->model->space, p->depth[i]) : 0;
    }
    CLN_TRY(cln_depth_scale_add(&scale, n, p->depth, grey));
    if (cln_depth_scale_make(&scale)) {
        g->near = 1 / (double)scale.high;
        g->far = 1 / (double)scale.low;
    }
    cln_depth_draw(&scale, n, p->depth, grey, grey);
done:
    cln_depth_scale_free(&scale);
    return st;
}

static cln_status encode(const cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const cln_picture *p = &g->rendering.picture;
    const size_t n = (size_t)p->width * (size_t)p->height;
    const int channels = g->ask.show == CLN_SHOW_COLOUR ? 3 : 1;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_alloc(&pixels, n, (size_t)channels, "picture"));
    if (g->ask.show == CLN_SHOW_DEPTH)
        CLN_TRY(draw_depth(painter, g, pixels));
    for (size_t i = 0; i < n && g->ask.show == CLN_SHOW_OPACITY; i++)
        pixels[i] = cln_to_u8(p->opacity[i]);
    for (size_t i = 0; i < 3 * n && g->ask.show == CLN_SHOW_COLOUR; i++)
        pixels[i] = cln_to_u8(p->rgb[i]);
    if (g->ask.png)
        CLN_TRY(cln_image_encode_png(p->width, p->height, channels, pixels, &g->body, &g->bytes));
    else
        CLN_TRY(cln_image_encode_jpeg(p->width, p->height, channels, pixels,
                                      g->ask.budget > 0 ? MOVING : STILL, &g->body, &g->bytes));
    g->type = g->ask.png ? "image/png" : "image/jpeg";
    g->status = 200;
done:
    free(pixels);
    return st;
}

static cln_status step_picture(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = painter->pipeline;
    cln_rendering *r = &g->rendering;

    if (!g->begun) {
        cln_camera camera;

        CLN_TRY(fit_budget(painter, &g->ask, &camera));
        g->ask.camera = camera; /* from here on the one that is rendered */
        CLN_TRY(set_camera(painter, &camera));
        CLN_TRY(cln_rendering_begin(p, 0, g->ask.background, false, r));
        g->begun = true;
        g->width = camera.width;
        g->height = camera.height;
    } else {
        CLN_TRY(set_camera(painter, &g->ask.camera)); /* another picture may have come between */
    }
    CLN_TRY(step_rendering(painter, r));
    if (r->done == g->width * g->height)
        CLN_TRY(encode(painter, g));
done:
    return st;
}

/* The mean of what was and what is, so that one slow picture does not make the next ones tiny. */
static void learn_speed(cln_painter *painter, const cln_painting *g)
{
    const double now = g->seconds / ((double)g->width * g->height);

    painter->seconds_per_pixel = 0.5 * (painter->seconds_per_pixel + now);
}

/* ---- photos and points ---- */

static void over_background(const float background[3], size_t pixels, uint8_t *data)
{
    for (size_t i = 0; i < pixels; i++) {
        const float alpha = (float)data[4 * i + 3] / 255;

        for (int c = 0; c < 3; c++)
            data[3 * i + (size_t)c] = cln_to_u8((float)data[4 * i + (size_t)c] / 255 * alpha +
                                                background[c] * (1 - alpha));
    }
}

static cln_status paint_photo(const cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const cln_view *view = &painter->scene->views[g->ask.view];
    int width = 0, height = 0, channels = 0, longer = 0;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_image_load(view->path, &width, &height, &channels, &pixels));
    longer = width > height ? width : height;
    if (longer > g->ask.side) {
        const int n = (longer + g->ask.side - 1) / g->ask.side;

        CLN_TRY(cln_image_downscale(n < width && n < height ? n : 1, &width, &height, channels,
                                    &pixels));
    }
    if (channels == 4)
        over_background(painter->model->background, (size_t)width * (size_t)height, pixels);
    CLN_TRY(cln_image_encode_jpeg(width, height, 3, pixels, STILL, &g->body, &g->bytes));
    g->type = "image/jpeg";
    g->status = 200;
done:
    free(pixels);
    return st;
}

/* A picture of one pixel: the one that the position lies in. */
static cln_status paint_point(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const cln_space *space = &painter->model->space;
    cln_camera one = g->ask.camera;
    double origin[3], direction[3], depth = 0;
    char text[256];

    one.cx -= fmin(floor(g->ask.x), one.width - 1);
    one.cy -= fmin(floor(g->ask.y), one.height - 1);
    one.width = one.height = 1;
    CLN_TRY(set_camera(painter, &one));
    CLN_TRY(cln_rendering_begin(painter->pipeline, 0, g->ask.background, false, &g->rendering));
    CLN_TRY(step_rendering(painter, &g->rendering));
    cln_camera_ray(&one, 0.5, 0.5, origin, direction);
    if (g->rendering.picture.opacity[0] > 0)
        depth = cln_space_distance_to_scene(space, g->rendering.picture.depth[0]);
    snprintf(text, sizeof text,
             "{\"opacity\": %.6g, \"depth\": %.9g, \"point\": [%.9g, %.9g, %.9g]}",
             (double)g->rendering.picture.opacity[0], depth, origin[0] + depth * direction[0],
             origin[1] + depth * direction[1], origin[2] + depth * direction[2]);
    cln_painting_say(g, 200, text);
    g->type = "application/json";
done:
    return st;
}

/* ---- the work ---- */

cln_status cln_painter_step(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const double began = cln_now();

    switch (g->ask.kind) {
    case CLN_ASK_PICTURE:
        st = step_picture(painter, g);
        break;
    case CLN_ASK_PHOTO:
        st = paint_photo(painter, g);
        break;
    case CLN_ASK_POINT:
        st = paint_point(painter, g);
        break;
    }
    g->seconds += cln_now() - began;
    if (g->status == 200 && g->ask.kind == CLN_ASK_PICTURE && !g->ask.png)
        learn_speed(painter, g);
    if (st == CLN_OK || st == CLN_CL || st == CLN_BUILD || st == CLN_INTERNAL)
        return st;
    cln_painting_say(g, st == CLN_MEMORY ? 503 : 404, cln_error_text());
    cln_clear_error();
    return CLN_OK;
}

cln_status cln_painter_open(cln_painter *painter, const cln_camera *first)
{
    cln_status st = CLN_OK;
    cln_painting g = {0};

    painter->seconds_per_pixel = 1e-6;
    if (!painter->training)
        CLN_TRY(cln_render_prepare(painter->pipeline));
    for (int i = 0; i < 3; i++) { /* the first one also warms the driver up */
        g.ask = (cln_ask){.kind = CLN_ASK_PICTURE, .view = -1};
        CLN_TRY(cln_orbit_resize(first, 128, 128, &g.ask.camera));
        while (g.status == 0)
            CLN_TRY(cln_painter_step(painter, &g));
        if (g.status != 200)
            CLN_TRY(cln_fail(CLN_MEMORY, "no memory for a picture of 128 x 128"));
        painter->seconds_per_pixel = g.seconds / (128 * 128);
        cln_painting_free(painter, &g);
    }
done:
    cln_painting_free(painter, &g);
    return st;
}
