/* Rendered depths as one function. See fusion.h. */
#include "export/fusion.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/memory.h"
#include "base/number.h"
#include "render/seen.h"
#include "render/view.h"

enum { MOST_VIEWS = 100, VIEW_WIDTH = 800 };

/* A pixel of less opacity than this shows no surface. */
static const float opaque = 0.5f;

/* Seen through is what has less opacity than `solid` where all pixels OUTLINE away show something:
 * the outlines themselves are half covered. */
static const float something = 0.1f, solid = 0.9f;
enum { OUTLINE = 2 };

struct cln_fusion_view {
    cln_camera camera;
    bool plain;    /* a pinhole */
    double eye[3]; /* in the cube; for a forward space in the scene */
    float *depth;  /* [height][width] along the ray, in the cube; below 0: nothing opaque */
};

void cln_fusion_free(cln_fusion *fusion)
{
    for (int i = 0; fusion->views && i < fusion->count; i++)
        free(fusion->views[i].depth);
    free(fusion->views);
    memset(fusion, 0, sizeof *fusion);
}

/* ---- a view and a point ---- */

/* The ray of a view, in the cube, that ends at a point: its direction and length. */
static void aim(const cln_fusion *f, const cln_fusion_view *view, const double cube[3],
                const double scene[3], double direction[3], double *distance)
{
    double towards[3], begin[3], length = 0;

    for (int a = 0; a < 3; a++) {
        towards[a] = scene[a] - view->eye[a];
        length += towards[a] * towards[a];
    }
    for (int a = 0; a < 3; a++)
        towards[a] /= sqrt(length);
    cln_space_ray_to_cube(f->space, view->eye, towards, begin, direction);
    *distance = 0;
    for (int a = 0; a < 3; a++)
        *distance += (cube[a] - begin[a]) * direction[a];
}

/* Finds where a view sees a point, in which direction of the cube, and at what distance; false if
 * the point is not in its image. */
static bool project(const cln_fusion *f, const cln_fusion_view *view, const float at[3], double *u,
                    double *v, double direction[3], double *distance)
{
    const cln_camera *c = &view->camera;
    const double d[3] = {at[0] - view->eye[0], at[1] - view->eye[1], at[2] - view->eye[2]};
    const double cube[3] = {at[0], at[1], at[2]};
    double point[3], z = 0;

    if (f->space->forward) {
        cln_space_point_to_scene(f->space, cube, point);
        if (!cln_camera_project(c, point, u, v, &z))
            return false;
        aim(f, view, cube, point, direction, distance);
        return *u >= 0 && *u < c->width && *v >= 0 && *v < c->height;
    }
    if (view->plain) {
        z = c->c2w[2] * d[0] + c->c2w[6] * d[1] + c->c2w[10] * d[2];
        if (z <= 0)
            return false;
        *u = c->fx * (c->c2w[0] * d[0] + c->c2w[4] * d[1] + c->c2w[8] * d[2]) / z + c->cx;
        *v = c->fy * (c->c2w[1] * d[0] + c->c2w[5] * d[1] + c->c2w[9] * d[2]) / z + c->cy;
    } else {
        cln_space_point_to_scene(f->space, cube, point);
        if (!cln_camera_project(c, point, u, v, &z))
            return false;
    }
    *distance = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int a = 0; a < 3; a++)
        direction[a] = d[a] / *distance;
    return *u >= 0 && *u < c->width && *v >= 0 && *v < c->height;
}

/* Interpolates the depth between the four pixels around a position; if they show different
 * surfaces, takes that of the nearest pixel. */
static double depth_at(const cln_fusion *f, const cln_fusion_view *view, double u, double v)
{
    const int width = view->camera.width, height = view->camera.height;
    const int x = (int)floor(u - 0.5), y = (int)floor(v - 0.5);
    const float nearest = view->depth[(size_t)v * (size_t)width + (size_t)u];
    const float *d = NULL;
    double s = u - 0.5 - x, t = v - 0.5 - y;

    if (x < 0 || y < 0 || x + 1 >= width || y + 1 >= height || nearest < 0)
        return nearest;
    d = view->depth + (size_t)y * (size_t)width + x;
    for (int i = 0; i < 4; i++) {
        const float other = d[(i & 1) + (i & 2 ? width : 0)];

        if (other < 0 || fabsf(other - nearest) > (float)f->band)
            return nearest;
    }
    return (1 - t) * ((1 - s) * d[0] + s * d[1]) + t * ((1 - s) * d[width] + s * d[width + 1]);
}

float cln_fusion_at(const cln_fusion *fusion, const float at[3])
{
    const double point[3] = {fusion->to_tree * at[0], fusion->to_tree * at[1],
                             fusion->to_tree * at[2]};
    double sum = 0, weights = 0;
    bool in_sight = false;

    if (cln_octree_find(fusion->tree, point) < 0)
        return -1;
    for (int i = 0; i < fusion->count; i++) {
        double u, v, direction[3], distance, depth, behind = -1, weight = 1;

        if (!project(fusion, &fusion->views[i], at, &u, &v, direction, &distance))
            continue;
        in_sight = true;
        depth = depth_at(fusion, &fusion->views[i], u, v);
        if (depth >= 0)
            behind = (distance - depth) / fusion->band;
        if (behind >= 1)
            continue;
        if (behind > 0)
            weight = 1 - behind;
        sum += weight * fmax(behind, -1);
        weights += weight;
    }
    return weights > 0 ? (float)(sum / weights) : in_sight ? 1 : -1;
}

int cln_fusion_seen(const cln_fusion *fusion, const float at[3], const float normal[3],
                    float towards[3])
{
    double best = 0;
    int seen = 0;

    for (int i = 0; i < fusion->count; i++) {
        const cln_fusion_view *view = &fusion->views[i];
        double u, v, direction[3], distance, depth, front = 0;

        if (!project(fusion, view, at, &u, &v, direction, &distance))
            continue;
        depth = depth_at(fusion, view, u, v);
        if (depth < 0 || fabs(distance - depth) > fusion->band)
            continue;
        for (int a = 0; a < 3; a++)
            front -= direction[a] * normal[a];
        seen += front > 0;
        if (front <= best)
            continue;
        best = front;
        for (int a = 0; a < 3; a++)
            towards[a] = (float)direction[a];
    }
    return seen;
}

/* ---- rendering ---- */

cln_status cln_fusion_start(const cln_space *space, const cln_octree *tree, int count,
                            cln_fusion *out)
{
    *out = (cln_fusion){.space = space,
                        .core = cln_space_core(space),
                        .to_tree = space->shell ? 0.5 : 1,
                        .tree = tree,
                        .count = count};
    if (space->shell)
        out->space = &out->core;
    return cln_alloc(&out->views, (size_t)count, sizeof *out->views, "views");
}

/* Turns depths of a forward space into lengths in the cube. */
static void bend_depths(const cln_space *space, const cln_camera *camera, float *depth)
{
    for (int k = 0; k < camera->width * camera->height; k++) {
        double o[3], d[3], at[3], begin[3], along[3], length = 0;

        if (depth[k] < 0)
            continue;
        (void)cln_camera_ray(camera, k % camera->width + 0.5, k / camera->width + 0.5, o, d);
        cln_space_depth_to_cube(space, o, d, (double)depth[k], at);
        cln_space_ray_to_cube(space, o, d, begin, along);
        for (int a = 0; a < 3; a++)
            length += (at[a] - begin[a]) * along[a];
        depth[k] = (float)fmax(length, 0);
    }
}

cln_status cln_fusion_set(cln_fusion *fusion, int i, const cln_camera *camera, float *depth,
                          double *pixel)
{
    cln_status st = CLN_OK;
    cln_fusion_view *view = &fusion->views[i];
    const size_t n = (size_t)camera->width * (size_t)camera->height;
    const double eye[3] = {camera->c2w[3], camera->c2w[7], camera->c2w[11]};
    size_t count = 0;
    float *sorted = NULL;

    view->camera = *camera;
    view->plain = cln_camera_lenses(camera) == 0;
    view->depth = depth;
    if (fusion->space->forward) {
        memcpy(view->eye, eye, sizeof eye);
        bend_depths(fusion->space, camera, depth);
    } else {
        cln_space_point_to_cube(fusion->space, eye, view->eye);
    }
    *pixel = 0;
    CLN_TRY(cln_alloc(&sorted, n, sizeof *sorted, "depths"));
    for (size_t k = 0; k < n; k++)
        if (depth[k] >= 0)
            sorted[count++] = depth[k];
    cln_floats_sort(sorted, count);
    if (count > 0)
        *pixel = fusion->space->forward
                     ? sqrt(fusion->space->scale[0] * fusion->space->scale[1]) / camera->fx
                     : sorted[count / 2] / camera->fx;
done:
    free(sorted);
    return st;
}

/* Counts what a picture shows, but at outlines, and what of it is seen through. */
static void count_faint(const cln_picture *p, size_t *shown, size_t *faint)
{
    for (int y = OUTLINE; y < p->height - OUTLINE; y++)
        for (int x = OUTLINE; x < p->width - OUTLINE; x++) {
            const float *at = p->opacity + (size_t)y * (size_t)p->width + x;
            const ptrdiff_t rows = (ptrdiff_t)OUTLINE * p->width;

            if (at[0] < something || at[-OUTLINE] < something || at[OUTLINE] < something ||
                at[-rows] < something || at[rows] < something)
                continue;
            ++*shown;
            *faint += at[0] < solid;
        }
}

static cln_status render(cln_open_run *opened, const cln_camera *cameras,
                         const cln_callbacks *callbacks, cln_fusion *f)
{
    cln_status st = CLN_OK;
    cln_picture picture = {0};
    float *depth = NULL, *pixels = NULL;
    size_t shown = 0, faint = 0;
    int views = 0; /* that show something opaque */

    CLN_TRY(cln_alloc(&pixels, (size_t)f->count, sizeof *pixels, "views"));
    CLN_TRY(cln_render_prepare(&opened->pipeline));
    for (int i = 0; i < f->count; i++) {
        double pixel = 0;

        cln_show_work(callbacks, "depths", i, f->count);
        CLN_TRY(cln_render_view(&opened->pipeline, i, opened->model.background, CLN_DEPTH_MEDIAN,
                                callbacks, &picture));
        count_faint(&picture, &shown, &faint);
        for (size_t k = 0; k < (size_t)picture.width * (size_t)picture.height; k++)
            if (picture.opacity[k] < opaque)
                picture.depth[k] = -1;
        depth = picture.depth;
        picture.depth = NULL;
        cln_picture_free(&picture);
        CLN_TRY(cln_fusion_set(f, i, &cameras[i], depth, &pixel));
        if (pixel > 0)
            pixels[views++] = (float)pixel;
    }
    cln_render_release(&opened->pipeline);
    if (views == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no training view shows anything opaque, so there is no surface; if a "
                         "longer training changes nothing, see what `cl-nascent check` says of its "
                         "photos, and whether --bbox is around the object",
                         opened->run));
    cln_floats_sort(pixels, (size_t)views);
    f->pixel = pixels[views / 2];
    f->faint = shown > 0 ? (double)faint / (double)shown : 0;
    cln_show_work(callbacks, "depths", f->count, f->count);
done:
    cln_picture_free(&picture);
    free(pixels);
    return st;
}

cln_status cln_fusion_make(cln_open_run *opened, const cln_callbacks *callbacks, cln_fusion *out)
{
    cln_status st = CLN_OK;
    const cln_camera **pointers = NULL;
    cln_camera *cameras = NULL;
    int count = 0;

    memset(out, 0, sizeof *out);
    CLN_TRY(cln_training_cameras(opened->scene, MOST_VIEWS, VIEW_WIDTH, &cameras, &count));
    CLN_TRY(cln_fusion_start(&opened->model.space, &opened->model.tree, count, out));
    CLN_TRY(cln_alloc(&pointers, (size_t)count, sizeof *pointers, "cameras"));
    for (int i = 0; i < count; i++)
        pointers[i] = &cameras[i];
    CLN_TRY(cln_pipeline_cameras(&opened->pipeline, pointers, count, out->space));
    CLN_TRY(render(opened, cameras, callbacks, out));
done:
    if (st != CLN_OK)
        cln_fusion_free(out);
    free(cameras);
    free(pointers);
    return st;
}
