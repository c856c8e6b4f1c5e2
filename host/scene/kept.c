/* Which pixels of a view count: not those beyond the fold of its lens, which no direction maps to,
 * nor those along the edges of its file, or beyond the disc of a fisheye, that show nothing. Views
 * whose maps are the same share one. */
#include "scene/build.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"

enum { SMALL = 8 }; /* rectangles up to this side are tested pixel by pixel */

/* The camera, its map, and the pixel that holds its principal point, which has a ray if any has. */
typedef struct search {
    const cln_camera *camera;
    uint8_t *map;
    int x, y;
} search;

static bool has_ray(const search *s, int x, int y)
{
    double o[3], d[3];

    return cln_camera_ray(s->camera, x + 0.5, y + 0.5, o, d);
}

static void keep(search *s, int x, int y)
{
    const size_t at = (size_t)y * (size_t)s->camera->width + (size_t)x;

    s->map[at / 8] |= (uint8_t)(1 << at % 8);
}

typedef struct rectangle {
    int x, y, wide, high;
} rectangle;

/* Counts the pixels along a rectangle's border, and those of them with a ray. */
static void look_around(const search *s, const rectangle *r, int *pixels, int *rays)
{
    *pixels = *rays = 0;
    for (int y = r->y; y < r->y + r->high; y++)
        for (int x = r->x; x < r->x + r->wide; x++) {
            *rays += has_ray(s, x, y);
            ++*pixels;
            if (y > r->y && y < r->y + r->high - 1 && x == r->x && r->wide > 1)
                x = r->x + r->wide - 2; /* on to the right edge */
        }
}

/* Marks the pixels of a rectangle that have rays. All such pixels are the image of a disc, without
 * holes: if a whole border has rays, so has all within; if none of it has, either none within has,
 * or the whole disc is within. */
static void search_rectangle(search *s, const rectangle *r)
{
    const bool small = r->wide <= SMALL && r->high <= SMALL, across = r->wide >= r->high;
    const bool middle =
        s->x >= r->x && s->y >= r->y && s->x < r->x + r->wide && s->y < r->y + r->high;
    rectangle first = *r, second = *r;
    int pixels, rays;

    look_around(s, r, &pixels, &rays);
    if (rays == 0 && !middle)
        return;
    if (rays == pixels || small) {
        for (int y = r->y; y < r->y + r->high; y++)
            for (int x = r->x; x < r->x + r->wide; x++)
                if (rays == pixels || has_ray(s, x, y))
                    keep(s, x, y);
        return;
    }
    if (across) {
        first.wide /= 2;
        second.x += first.wide;
        second.wide -= first.wide;
    } else {
        first.high /= 2;
        second.y += first.high;
        second.high -= first.high;
    }
    search_rectangle(s, &first);
    search_rectangle(s, &second);
}

static int64_t count_bits(const uint8_t *map, size_t bytes)
{
    int64_t count = 0;

    for (size_t i = 0; i < bytes; i++)
        count += __builtin_popcount(map[i]);
    return count;
}

/* *map is NULL if all pixels have rays. */
static cln_status map_rays(const cln_camera *camera, uint8_t **map)
{
    cln_status st = CLN_OK;
    const rectangle image = {0, 0, camera->width, camera->height};
    const int64_t all = (int64_t)camera->width * camera->height;
    /* one beyond the image is in no rectangle */
    search s = {camera, NULL, (int)fmax(-1, fmin(camera->cx, camera->width)),
                (int)fmax(-1, fmin(camera->cy, camera->height))};
    int pixels, rays;

    *map = NULL;
    look_around(&s, &image, &pixels, &rays);
    if (rays == pixels)
        return CLN_OK;
    CLN_TRY(cln_alloc(map, (size_t)(all + 7) / 8, 1, "pixels that have rays"));
    s.map = *map;
    search_rectangle(&s, &image);
done:
    return st;
}

/* Pixels along the edge that hold some of the file's. */
static int edge_of(const cln_view *view)
{
    return view->edge > 0 ? (view->edge + view->downscale - 1) / view->downscale : 0;
}

/* Does all of the pixel lie in the file's disc? */
static bool is_on_disc(const cln_view *view, int x, int y)
{
    const double n = view->downscale, wide = view->file_width, high = view->file_height;
    const double across = fabs((x + 0.5) * n - 0.5 * wide) + 0.5 * (n - 1);
    const double down = fabs((y + 0.5) * n - 0.5 * high) + 0.5 * (n - 1);

    return view->disc == 0 || hypot(across, down) <= view->disc * fmax(wide, high);
}

/* *map is NULL if all pixels count. */
static cln_status make_map(const cln_view *view, uint8_t **map, int64_t *left_out)
{
    cln_status st = CLN_OK;
    const int wide = view->camera.width, high = view->camera.height, edge = edge_of(view);
    const size_t all = (size_t)wide * (size_t)high, bytes = (all + 7) / 8;
    const bool cut = edge > 0 || view->disc > 0;

    *map = NULL;
    *left_out = 0;
    if (cln_camera_is_distorted(&view->camera))
        CLN_TRY(map_rays(&view->camera, map));
    if (cut && !*map) {
        CLN_TRY(cln_alloc(map, bytes, 1, "pixels that count"));
        memset(*map, 0xFF, bytes);
        (*map)[bytes - 1] = (uint8_t)(0xFF >> (8 * bytes - all));
    }
    for (size_t at = 0; cut && at < all; at++) {
        const int x = (int)(at % (size_t)wide), y = (int)(at / (size_t)wide);

        if (x < edge || y < edge || x >= wide - edge || y >= high - edge || !is_on_disc(view, x, y))
            (*map)[at / 8] &= (uint8_t) ~(1 << at % 8);
    }
    if (*map)
        *left_out = (int64_t)all - count_bits(*map, bytes);
done:
    return st;
}

/* Whether two views have the same map. */
static bool is_like(const cln_view *a, const cln_view *b)
{
    const bool distorted = cln_camera_is_distorted(&a->camera);

    return a->camera.width == b->camera.width && a->camera.height == b->camera.height &&
           edge_of(a) == edge_of(b) && a->disc == b->disc &&
           distorted == cln_camera_is_distorted(&b->camera) &&
           (!distorted || cln_camera_is_like(&a->camera, &b->camera));
}

/* Writes the name and parameters of a lens: "OPENCV: k1 = -0.5, k2 = 0". */
static void say_lens(const cln_camera *camera, char *text, size_t size)
{
    const cln_lens_model *lens = &cln_lens_models[camera->lens];
    size_t used = (size_t)snprintf(text, size, "%s", lens->name);

    for (int i = 0; i < lens->count && used < size; i++)
        used += (size_t)snprintf(text + used, size - used, "%s%s = %g", i ? ", " : ": ",
                                 lens->params[i], camera->distortion[i]);
}

cln_status cln_scene_find_kept(cln_scene *scene)
{
    cln_status st = CLN_OK;
    int *looked = NULL, count = 0; /* views whose cameras differ */
    char lens[256];

    CLN_TRY(cln_alloc(&looked, (size_t)scene->view_count, sizeof *looked, "cameras"));
    CLN_TRY(cln_alloc(&scene->maps, (size_t)scene->view_count, sizeof *scene->maps, "cameras"));
    for (int v = 0; v < scene->view_count; v++) {
        cln_view *view = &scene->views[v];
        int same = 0;

        if (!cln_camera_is_distorted(&view->camera) && view->edge == 0 && view->disc == 0)
            continue;
        while (same < count && !is_like(view, &scene->views[looked[same]]))
            same++;
        if (same == count) {
            looked[count++] = v;
            CLN_TRY(make_map(view, &scene->maps[same], &view->left_out));
        }
        view->kept = scene->maps[same];
        view->left_out = scene->views[looked[same]].left_out;
        if (view->left_out == (int64_t)view->camera.width * view->camera.height) {
            if (view->disc > 0)
                CLN_TRY(cln_fail(CLN_INPUT,
                                 "%s: frame '%s': no pixel is within its fisheye_crop_radius; "
                                 "correct that",
                                 scene->folder, view->name));
            if (view->edge > 0)
                CLN_TRY(cln_fail(CLN_INPUT,
                                 "%s: frame '%s': %d x %d pixels are all edge; give larger images",
                                 scene->folder, view->name, view->file_width, view->file_height));
            say_lens(&view->camera, lens, sizeof lens);
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: frame '%s': no pixel of the image has a direction by its lens "
                             "model %s; correct its parameters, focal length or principal point",
                             scene->folder, view->name, lens));
        }
    }
    if (scene->view_count > 0 && scene->views[0].disc > 0)
        cln_info("%s: fisheye_crop_radius: %.3g %% of the pixels of '%s' count", scene->folder,
                 100 - 100.0 * (double)scene->views[0].left_out /
                           ((double)scene->views[0].camera.width * scene->views[0].camera.height),
                 scene->views[0].name);
done:
    free(looked);
    return st;
}

bool cln_view_keeps(const cln_view *view, int x, int y)
{
    const size_t at = (size_t)y * (size_t)view->camera.width + (size_t)x;

    return !view->kept || (view->kept[at / 8] >> at % 8 & 1);
}

bool cln_view_cut(const cln_view *view)
{
    return view->masked || view->channels == 4;
}

cln_fold cln_scene_fold(const cln_scene *scene)
{
    cln_fold fold = {0};
    double left_out = 0, all = 0;

    for (int v = 0; v < scene->view_count; v++) {
        const cln_view *view = &scene->views[v];

        if (!view->left_out || view->edge > 0 || view->disc > 0)
            continue;
        fold.views++;
        left_out += (double)view->left_out;
        all += (double)view->camera.width * view->camera.height;
    }
    fold.share = all > 0 ? left_out / all : 0;
    return fold;
}
