/* Pictures, photos, points and films for a browser. See painter.h. */
#include "view/painter.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/image.h"
#include "ranks/ranks.h"
#include "render/depth_picture.h"
#include "render/orbit.h"
#include "render/tree_picture.h"

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

void cln_painting_free(cln_painting *g)
{
    cln_rendering_end(&g->rendering);
    free(g->body);
    if (g->is_file)
        close(g->file);
    memset(g, 0, sizeof *g);
}

void cln_painter_forget(cln_painter *painter, const cln_painting *g)
{
    if (g->ask.kind == CLN_ASK_FILM_FRAME && cln_reel_is(&painter->reel, g->ask.film))
        cln_reel_drop(&painter->reel);
}

/* ---- pictures ---- */

/* crop: the request's. */
static cln_status set_up(cln_painter *painter, const cln_camera *camera, cln_crop *crop)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_cameras(painter->pipeline, &camera, 1, &painter->model->space));
    CLN_TRY(cln_crop_use(painter->pipeline, &painter->model->space, crop));
done:
    return st;
}

/* What a batch of rays depends on, besides the model: rank 0 tells it the others. */
typedef struct order {
    bool last; /* there are no more batches */
    bool poll; /* no batch either: a signal is looked for */
    cln_camera camera;
    cln_crop crop;
    float background[3];
    int done, next; /* as in cln_rendering */
} order;

static void lead(const cln_painter *painter, const cln_ask *ask, const cln_camera *camera,
                 const cln_rendering *r)
{
    order o = {.camera = *camera, .crop = ask->crop, .done = r->done, .next = r->next};

    memcpy(o.background, ask->background, sizeof o.background);
    if (painter->leads)
        cln_ranks_tell(&o, sizeof o);
}

void cln_painter_end(cln_painter *painter)
{
    order o = {.last = true};

    if (painter->leads)
        cln_ranks_tell(&o, sizeof o);
    painter->leads = false;
}

int cln_painter_signal(cln_painter *painter, const cln_callbacks *callbacks)
{
    const double now = cln_now(), pause = 1;
    double signal = cln_poll_signal(callbacks);
    order o = {.poll = true};

    if (!painter->leads || signal > 0 || now - painter->polled < pause)
        return (int)signal;
    painter->polled = now;
    cln_ranks_tell(&o, sizeof o);
    cln_ranks_largest(&signal, 1);
    return (int)signal;
}

/* A training may have changed the tree and the memory plan since the last batch. */
static cln_status step_rendering(cln_painter *painter, cln_rendering *r)
{
    const cln_pipeline *p = painter->pipeline;

    r->batch.sampling = cln_render_sampling(p);
    r->batch.sampling.pictures = !painter->training;
    if (p->max_rays > 0 && p->max_rays < r->most)
        r->most = p->max_rays;
    return cln_rendering_step(painter->pipeline, r);
}

/* Renders a batch; the picture is rank 0's. */
static cln_status follow(cln_painter *painter, order *o, cln_rendering *r)
{
    cln_status st = CLN_OK;

    CLN_TRY(set_up(painter, &o->camera, &o->crop));
    CLN_TRY(cln_rendering_follow(painter->pipeline, 0, o->background, r));
    r->done = o->done;
    r->next = o->next;
    CLN_TRY(step_rendering(painter, r));
done:
    return st;
}

cln_status cln_painter_follow(cln_painter *painter, const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    order o = {0};
    cln_rendering r = {0};

    CLN_TRY(cln_render_prepare(painter->pipeline));
    for (cln_ranks_tell(&o, sizeof o); !o.last; cln_ranks_tell(&o, sizeof o)) {
        double signal = o.poll ? cln_poll_signal(callbacks) : 0;

        if (o.poll)
            cln_ranks_largest(&signal, 1);
        else
            CLN_TRY(follow(painter, &o, &r));
    }
done:
    cln_rendering_end(&r);
    return st;
}

/* Reduces the picture to as many pixels as the device renders within the budget. */
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

/* All frames of a film have the first one's scale. */
static cln_status draw_depth(cln_painter *painter, cln_painting *g, uint8_t *grey)
{
    cln_status st = CLN_OK;
    cln_reel *reel = g->ask.kind == CLN_ASK_FILM_FRAME ? &painter->reel : NULL;
    const cln_picture *p = &g->rendering.picture;
    const size_t n = (size_t)p->width * (size_t)p->height;
    cln_depth_scale scale = {0};

    for (size_t i = 0; i < n; i++) {
        grey[i] = cln_to_u8(p->opacity[i]);
        p->depth[i] =
            grey[i] > 0 ? cln_space_depth_to_scene(&painter->model->space, p->depth[i]) : 0;
    }
    if (reel && reel->scaled) {
        scale.low = reel->low;
        scale.high = reel->high;
    } else {
        CLN_TRY(cln_depth_scale_add(&scale, n, p->depth, grey));
        if (cln_depth_scale_make(&scale)) {
            g->near = 1 / (double)scale.high;
            g->far = 1 / (double)scale.low;
        }
    }
    if (reel && scale.low > 0) {
        reel->scaled = true;
        reel->low = scale.low;
        reel->high = scale.high;
    }
    cln_depth_draw(&scale, n, p->depth, grey, grey);
done:
    cln_depth_scale_free(&scale);
    return st;
}

static cln_status draw_leaves(const cln_painter *painter, cln_painting *g, uint8_t *rgb)
{
    cln_status st = CLN_OK;
    const cln_model *model = painter->model;
    const cln_picture *p = &g->rendering.picture;
    const bool error = g->ask.show == CLN_SHOW_ERROR;
    int32_t *slots = NULL;
    uint8_t *colours = NULL;
    double low = NAN, high = NAN;

    CLN_TRY(cln_alloc(&slots, (size_t)p->width * (size_t)p->height, sizeof *slots, "leaves"));
    CLN_TRY(cln_alloc(&colours, (size_t)model->tree.leaf_count, 3, "leaves"));
    cln_tree_surface(model, &g->ask.camera, p, slots);
    cln_tree_colours(model, error, colours, &low, &high);
    cln_tree_draw(p, slots, colours, rgb);
    if (high > 0) {
        g->near = low;
        g->far = high;
    }
done:
    free(slots);
    free(colours);
    return st;
}

/* pixels [height][width][3 or 1] */
static cln_status draw(cln_painter *painter, cln_painting *g, uint8_t *pixels, int *channels)
{
    const cln_picture *p = &g->rendering.picture;
    const size_t n = (size_t)p->width * (size_t)p->height;

    *channels = 3;
    switch (g->ask.show) {
    case CLN_SHOW_LEVEL:
    case CLN_SHOW_ERROR:
        return draw_leaves(painter, g, pixels);
    case CLN_SHOW_DEPTH:
        *channels = 1;
        return draw_depth(painter, g, pixels);
    case CLN_SHOW_OPACITY:
        *channels = 1;
        for (size_t i = 0; i < n; i++)
            pixels[i] = cln_to_u8(p->opacity[i]);
        break;
    case CLN_SHOW_COLOUR:
    case CLN_SHOWS:
        for (size_t i = 0; i < 3 * n; i++)
            pixels[i] = cln_to_u8(p->rgb[i]);
    }
    return CLN_OK;
}

/* How a picture of the camera that is asked for is turned to be seen: as its photo. */
static int turn_of(const cln_painter *painter, const cln_ask *ask)
{
    return ask->view >= 0 && painter->scene ? cln_view_turn(&painter->scene->views[ask->view]) : 1;
}

static cln_status add_frame(cln_painter *painter, cln_painting *g, const uint8_t *pixels)
{
    cln_status st = CLN_OK;
    cln_reel *reel = &painter->reel;
    char text[64];

    CLN_TRY(cln_reel_add(reel, pixels));
    snprintf(text, sizeof text, "{\"done\": %d, \"frames\": %d}", reel->done, reel->frames);
    cln_painting_say(g, 200, text);
    g->type = "application/json";
done:
    return st;
}

static cln_status deliver(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const cln_picture *p = &g->rendering.picture;
    const size_t n = (size_t)p->width * (size_t)p->height;
    int channels = 3;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_alloc(&pixels, n, 3, "picture"));
    CLN_TRY(draw(painter, g, pixels, &channels));
    if (g->ask.kind == CLN_ASK_FILM_FRAME) {
        for (size_t i = n; channels == 1 && i-- > 0;)
            pixels[3 * i] = pixels[3 * i + 1] = pixels[3 * i + 2] = pixels[i];
        channels = 3;
    }
    CLN_TRY(cln_image_turn(turn_of(painter, &g->ask), &g->width, &g->height, channels, &pixels));
    if (g->ask.kind == CLN_ASK_FILM_FRAME) {
        CLN_TRY(add_frame(painter, g, pixels));
        goto done;
    }
    if (g->ask.png)
        CLN_TRY(cln_image_encode_png(g->width, g->height, channels, pixels, &g->body, &g->bytes));
    else
        CLN_TRY(cln_image_encode_jpeg(g->width, g->height, channels, pixels,
                                      g->ask.budget > 0 ? MOVING : STILL, &g->body, &g->bytes));
    g->type = g->ask.png ? "image/png" : "image/jpeg";
    g->status = 200;
done:
    free(pixels);
    return st;
}

/* n x n rays that a pixel at an edge gets. Other ranks follow batches of whole pictures alone. */
static int rays_at_edges(const cln_painter *painter, const cln_ask *ask)
{
    const bool mixes = ask->show == CLN_SHOW_COLOUR || ask->show == CLN_SHOW_OPACITY;

    return mixes && !painter->leads ? cln_model_antialias(painter->model) : 1;
}

static cln_status step_picture(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = painter->pipeline;
    cln_rendering *r = &g->rendering;

    p->antialias = g->begun ? r->antialias : 1;
    if (!g->begun && g->ask.edges)
        p->antialias = rays_at_edges(painter, &g->ask);
    if (!g->begun) {
        cln_camera camera;

        CLN_TRY(fit_budget(painter, &g->ask, &camera));
        g->ask.camera = camera; /* from now on at the rendered size */
        CLN_TRY(set_up(painter, &camera, &g->ask.crop));
        CLN_TRY(cln_rendering_begin(p, 0, g->ask.background, CLN_DEPTH_MEDIAN, r));
        g->begun = true;
        g->width = camera.width;
        g->height = camera.height;
    } else {
        /* another picture may have come between */
        CLN_TRY(set_up(painter, &g->ask.camera, &g->ask.crop));
    }
    lead(painter, &g->ask, &g->ask.camera, r);
    CLN_TRY(step_rendering(painter, r));
    if (cln_rendering_whole(r)) {
        g->finer = r->antialias < rays_at_edges(painter, &g->ask);
        CLN_TRY(deliver(painter, g));
    }
done:
    return st;
}

/* Averages the old speed and the new, so that one slow picture does not make the next ones tiny. */
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
    if (view->turned)
        CLN_TRY(cln_image_turn(view->orientation, &width, &height, channels, &pixels));
    if (view->multiplied && channels == 4)
        cln_image_divide_alpha(pixels, (size_t)width * (size_t)height);
    if (view->alpha_path)
        CLN_TRY(cln_view_add_alpha(view, width, height, NULL, &channels, &pixels));
    longer = width > height ? width : height;
    if (longer > g->ask.side) {
        const int n = (longer + g->ask.side - 1) / g->ask.side;

        CLN_TRY(cln_image_downscale(n < width && n < height ? n : 1, &width, &height, channels,
                                    &pixels));
    }
    CLN_TRY(cln_image_turn(cln_view_turn(view), &width, &height, channels, &pixels));
    if (channels == 4)
        over_background(g->ask.background, (size_t)width * (size_t)height, pixels);
    CLN_TRY(cln_image_encode_jpeg(width, height, 3, pixels, STILL, &g->body, &g->bytes));
    g->type = "image/jpeg";
    g->status = 200;
done:
    free(pixels);
    return st;
}

/* Renders a picture of one pixel, which contains the position. */
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
    CLN_TRY(set_up(painter, &one, &g->ask.crop));
    CLN_TRY(cln_rendering_begin(painter->pipeline, 0, g->ask.background, CLN_DEPTH_MEDIAN,
                                &g->rendering));
    lead(painter, &g->ask, &one, &g->rendering);
    CLN_TRY(step_rendering(painter, &g->rendering));
    cln_camera_ray(&one, 0.5, 0.5, origin, direction);
    if (g->rendering.picture.opacity[0] > 0)
        depth = cln_space_distance_to_scene(space, g->rendering.picture.depth[0]);
    cln_format(text, sizeof text,
               "{\"opacity\": %.6g, \"depth\": %.9g, \"point\": [%.15g, %.15g, %.15g]}",
               (double)g->rendering.picture.opacity[0], depth, origin[0] + depth * direction[0],
               origin[1] + depth * direction[1], origin[2] + depth * direction[2]);
    cln_painting_say(g, 200, text);
    g->type = "application/json";
done:
    return st;
}

/* ---- films ---- */

static cln_status begin_film(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    cln_reel *reel = &painter->reel;
    char text[128];

    CLN_TRY(cln_reel_begin(reel, &g->ask));
    snprintf(text, sizeof text, "{\"film\": \"%s\", \"file\": \"%s\"}", reel->name,
             cln_reel_file(reel));
    cln_painting_say(g, 200, text);
    g->type = "application/json";
done:
    return st;
}

/* Is the picture so large, as it is seen? */
static bool has_size(const cln_painter *painter, const cln_ask *ask, int width, int height)
{
    const bool lies = turn_of(painter, ask) >= 5;

    return ask->camera.width == (lies ? height : width) &&
           ask->camera.height == (lies ? width : height);
}

static cln_status step_film(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    cln_reel *reel = &painter->reel;
    char text[128];

    if (!cln_reel_is(reel, g->ask.film)) {
        cln_painting_say(g, 404, "this film does not exist any more");
        return CLN_OK;
    }
    reel->silent = 0;
    if (g->ask.kind == CLN_ASK_FILM_DROP) {
        cln_reel_drop(reel);
        cln_painting_say(g, 200, "the film is dropped");
    } else if (g->ask.kind == CLN_ASK_FILM_FILE) {
        if (!reel->whole) {
            cln_painting_say(g, 409, "the film is not finished yet");
            return CLN_OK;
        }
        g->file = fcntl(reel->file, F_DUPFD_CLOEXEC, 0);
        if (g->file < 0)
            CLN_TRY(cln_fail(CLN_FAILED, "the film: %s", strerror(errno)));
        g->is_file = true;
        g->bytes = (size_t)reel->bytes;
        g->file_name = cln_reel_file(reel);
        g->type = cln_reel_type(reel);
        g->status = 200;
    } else if (reel->whole) {
        cln_painting_say(g, 409, "the film is finished already");
    } else if (g->ask.kind == CLN_ASK_FILM_END) {
        CLN_TRY(cln_reel_end(reel));
        snprintf(text, sizeof text, "{\"file\": \"%s\", \"bytes\": %lld}", cln_reel_file(reel),
                 (long long)reel->bytes);
        cln_painting_say(g, 200, text);
        g->type = "application/json";
    } else if (reel->done == reel->frames) {
        cln_painting_say(g, 409, "the film has all its frames already");
    } else if (!has_size(painter, &g->ask, reel->width, reel->height)) {
        cln_painting_say(g, 400, "width, height: must be the film's");
    } else {
        CLN_TRY(step_picture(painter, g));
    }
done:
    return st;
}

/* ---- the work ---- */

/* The HTTP status of an error that ends one painting only. */
static int status_of(cln_status st)
{
    return st == CLN_MEMORY ? 503 : st == CLN_INPUT ? 404 : st == CLN_USAGE ? 409 : 500;
}

/* The pose of a view that is asked for, as it is now: a training on this thread may refine it. */
static void take_pose(const cln_painter *painter, cln_ask *ask)
{
    if (ask->view >= 0 && painter->scene)
        memcpy(ask->camera.c2w, painter->scene->views[ask->view].camera.c2w,
               sizeof ask->camera.c2w);
}

cln_status cln_painter_step(cln_painter *painter, cln_painting *g)
{
    cln_status st = CLN_OK;
    const double began = cln_now();
    const int antialias = painter->pipeline->antialias;

    painter->pipeline->antialias = 1;
    if (!g->begun)
        take_pose(painter, &g->ask);
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
    case CLN_ASK_FILM_BEGIN:
        st = begin_film(painter, g);
        break;
    case CLN_ASK_FILM_FRAME:
    case CLN_ASK_FILM_END:
    case CLN_ASK_FILM_DROP:
    case CLN_ASK_FILM_FILE:
        st = step_film(painter, g);
        break;
    case CLN_ASK_KINDS:
        break;
    }
    painter->pipeline->crop = NULL;
    painter->pipeline->antialias = antialias;
    g->seconds += cln_now() - began;
    if (g->status == 200 && g->ask.kind == CLN_ASK_PICTURE && !g->ask.png && !g->ask.edges)
        learn_speed(painter, g);
    if (st == CLN_OK || st == CLN_CL || st == CLN_BUILD || st == CLN_INTERNAL)
        return st;
    if (painter->leads && g->rendering.under_way)
        return st;
    cln_painting_say(g, status_of(st), cln_error_text());
    cln_clear_error();
    return CLN_OK;
}

cln_status cln_painter_open(cln_painter *painter, const cln_camera *first)
{
    cln_status st = CLN_OK;
    cln_painting g = {0};

    painter->seconds_per_pixel = 1e-6;
    painter->leads = painter->pipeline->ranks > 1;
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
        cln_painting_free(&g);
    }
done:
    cln_painting_free(&g);
    return st;
}
