/* How many training views see what a picture shows. See seen.h. */
#include "render/seen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/memory.h"
#include "render/orbit.h"
#include "render/quality.h"
#include "render/view.h"

enum { MOST_VIEWS = 100, VIEW_WIDTH = 256, GRID = 320 };

/* Depths agree up to this share of the distance, and so many widths of a pixel. */
static const double SHARE = 0.01, PIXELS = 2;

void cln_seen_free(cln_seen *seen)
{
    for (int i = 0; seen->depth && i < seen->count; i++)
        free(seen->depth[i]);
    free(seen->depth);
    free(seen->cameras);
    memset(seen, 0, sizeof *seen);
}

cln_status cln_training_cameras(const cln_scene *scene, int most, int width, cln_camera **cameras,
                                int *count)
{
    cln_status st = CLN_OK;
    int *chosen = NULL;

    *cameras = NULL;
    CLN_TRY(cln_quality_choose(scene, CLN_SPLIT_TRAIN, most, &chosen, count));
    CLN_TRY(cln_alloc(cameras, (size_t)*count, sizeof **cameras, "cameras"));
    for (int i = 0; i < *count; i++) {
        const cln_camera *photo = &scene->views[chosen[i]].camera;

        CLN_TRY(
            cln_orbit_resize(photo, photo->width < width ? photo->width : width, 0, *cameras + i));
    }
done:
    free(chosen);
    return st;
}

cln_status cln_seen_choose(const cln_scene *scene, cln_seen *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_training_cameras(scene, MOST_VIEWS, VIEW_WIDTH, &out->cameras, &out->count));
    CLN_TRY(cln_alloc(&out->depth, (size_t)out->count, sizeof *out->depth, "depths"));
done:
    return st;
}

cln_status cln_seen_make(cln_open_run *opened, const cln_callbacks *callbacks, cln_seen *seen)
{
    cln_status st = CLN_OK;
    const cln_space *space = &opened->model.space;
    const cln_camera **pointers = NULL;
    cln_picture picture = {0};

    CLN_TRY(cln_alloc(&pointers, (size_t)seen->count, sizeof *pointers, "cameras"));
    for (int i = 0; i < seen->count; i++)
        pointers[i] = &seen->cameras[i];
    CLN_TRY(cln_pipeline_cameras(&opened->pipeline, pointers, seen->count, space));
    CLN_TRY(cln_render_prepare(&opened->pipeline));
    for (int i = 0; i < seen->count; i++) {
        cln_show_work(callbacks, "depths", i, seen->count);
        CLN_TRY(cln_render_view(&opened->pipeline, i, opened->model.background, CLN_DEPTH_MEDIAN,
                                callbacks, &picture));
        cln_picture_to_scene(space, &picture);
        for (size_t k = 0; k < (size_t)picture.width * (size_t)picture.height; k++)
            if (picture.opacity[k] < CLN_SURFACE)
                picture.depth[k] = -1;
        seen->depth[i] = picture.depth;
        picture.depth = NULL;
        cln_picture_free(&picture);
    }
    cln_render_release(&opened->pipeline);
    cln_show_work(callbacks, "depths", seen->count, seen->count);
done:
    cln_picture_free(&picture);
    free(pointers);
    return st;
}

/* Does a view show a surface so far away, at a place of its picture or right beside it? */
static bool shows(const cln_camera *camera, const float *depth, int x, int y, double distance)
{
    const double most = distance * (SHARE + PIXELS / fmin(camera->fx, camera->fy));

    for (int v = y - 1; v <= y + 1; v++)
        for (int u = x - 1; u <= x + 1; u++) {
            float at = -1;

            if (u < 0 || v < 0 || u >= camera->width || v >= camera->height)
                continue;
            at = depth[(size_t)v * (size_t)camera->width + (size_t)u];
            if (at >= 0 && fabs((double)at - distance) <= most)
                return true;
        }
    return false;
}

int cln_seen_at(const cln_seen *seen, const double point[3])
{
    int views = 0;

    for (int i = 0; i < seen->count && views < CLN_SEEN_MOST; i++) {
        const cln_camera *c = &seen->cameras[i];
        const double way[3] = {point[0] - c->c2w[3], point[1] - c->c2w[7], point[2] - c->c2w[11]};
        double u = 0, v = 0;

        if (cln_camera_shows(c, point, &u, &v))
            views += shows(c, seen->depth[i], (int)u, (int)v,
                           sqrt(way[0] * way[0] + way[1] * way[1] + way[2] * way[2]));
    }
    return views;
}

/* The number at one pixel. */
static int8_t count_at(const cln_seen *seen, const cln_camera *camera, const cln_picture *picture,
                       int x, int y)
{
    const size_t k = (size_t)y * (size_t)picture->width + (size_t)x;
    double o[3], d[3], point[3];

    if (picture->opacity[k] < CLN_SURFACE || !cln_camera_ray(camera, x + 0.5, y + 0.5, o, d))
        return -1;
    for (int a = 0; a < 3; a++)
        point[a] = o[a] + (double)picture->depth[k] * d[a];
    return (int8_t)cln_seen_at(seen, point);
}

cln_status cln_seen_picture(const cln_seen *seen, const cln_camera *camera, cln_picture *picture)
{
    cln_status st = CLN_OK;
    const int width = picture->width, height = picture->height;
    /* a map's heights that no view sees are left out, one by one */
    const int step = camera->parallel ? 1 : (width + GRID - 1) / GRID;

    CLN_TRY(cln_alloc(&picture->seen, (size_t)width, (size_t)height, "picture"));
    for (int y = 0; y < height; y += step)
        for (int x = 0; x < width; x += step) {
            const int across = width - x < step ? width - x : step;
            const int down = height - y < step ? height - y : step;
            const int8_t views = count_at(seen, camera, picture, x + across / 2, y + down / 2);

            for (int v = y; v < y + down; v++)
                memset(picture->seen + (size_t)v * (size_t)width + x, views, (size_t)across);
        }
done:
    return st;
}

cln_seen_shares cln_seen_share(const cln_picture *picture)
{
    const size_t n = (size_t)picture->width * (size_t)picture->height;
    size_t shown = 0, none = 0, few = 0;

    for (size_t i = 0; i < n; i++) {
        shown += picture->seen[i] >= 0;
        none += picture->seen[i] == 0;
        few += picture->seen[i] >= 0 && picture->seen[i] < CLN_SEEN_FEW;
    }
    return shown ? (cln_seen_shares){(double)none / (double)shown, (double)few / (double)shown}
                 : (cln_seen_shares){NAN, NAN};
}

uint64_t cln_seen_digest(const cln_seen *seen)
{
    uint64_t d = CLN_DIGEST_START;

    for (int i = 0; i < seen->count; i++) {
        const cln_camera *c = &seen->cameras[i];
        const double lengths[4] = {c->fx, c->fy, c->cx, c->cy};
        const int32_t numbers[3] = {c->width, c->height, (int32_t)c->lens};

        d = cln_digest(d, c->c2w, sizeof c->c2w);
        d = cln_digest(d, lengths, sizeof lengths);
        d = cln_digest(d, numbers, sizeof numbers);
        d = cln_digest(d, c->distortion, sizeof c->distortion);
    }
    return d;
}
