/* Finds places that lack a leaf. See regrow.h. */
#include "train/regrow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "device/queue.h"
#include "model/shell_tree.h"
#include "render/ray_batch.h"
#include "train/step.h"

enum {
    ERROR_LEVEL = 5,     /* level of the cells tested for errors */
    MOST_VIEWS = 48,     /* photos looked at, evenly chosen */
    MOST_RAYS = 1 << 18, /* rays in all of them */
    LEAST_ENDS = 3,      /* rays that must end at a face that cuts a surface off */
    LEAST_SEEN = 3,      /* photos that must see a place */
    POINTS = 3,          /* places of a cell along an axis */
    LEAST_POINTS = 2,    /* of a cell's POINTS^3 that must show errors */
};

/* A ray ends at a face if it does within this share of the leaf's side behind it. */
static const double AT_FACE = 0.125;

/* A difference counts as an error above twice the root mean square, within these bounds. */
static const double LEAST_ERROR = 0.1, LARGE_ERROR = 0.25;

/* Differences from one photo, at the middle pixel of each block of stride x stride; where the
 * middle is outside the image, at its last pixel. */
typedef struct look {
    const cln_view *view;
    int across, down;
    float *error; /* [down][across] largest difference of colour, or of opacity from alpha */
    float *depth; /* cube units along the ray; INFINITY: none, 0: the pixel does not count */
} look;

typedef struct looks {
    int count, stride;
    look look[MOST_VIEWS];
    double square; /* sum of errors' squares */
    int64_t rays;
    double least;  /* a larger difference is an error */
    int depth;     /* of the tree, ERROR_LEVEL at least */
    uint8_t *ends; /* [cell of that level] rays that end right behind it, up to LEAST_ENDS */
} looks;

static void free_looks(looks *all)
{
    for (int i = 0; i < all->count; i++) {
        free(all->look[i].error);
        free(all->look[i].depth);
    }
    free(all->ends);
}

/* Number of blocks along a side of `pixels` whose middle is in the image, at least one. */
static int blocks(int pixels, int stride)
{
    const int whole = (pixels - stride / 2 + stride - 1) / stride;

    return whole > 1 ? whole : 1;
}

static cln_u32 middle(int block, int stride, int pixels)
{
    const int at = block * stride + stride / 2;

    return (cln_u32)(at < pixels ? at : pixels - 1);
}

/* Compares n rendered rays with the batch's stored pixels; the first is ray `first` of the look. */
static void compare(cln_trainer *t, looks *all, look *l, int first, int n)
{
    const bool has_alpha = l->view->channels == 4;

    for (int i = 0; i < n; i++) {
        const cln_ray_result *got = &t->results[i];
        const cln_pixel *pixel = &t->batch.pixels[i];
        const float rgb[3] = {got->r, got->g, got->b};
        float want[3], alpha = 1, error = 0;

        if (!cln_view_keeps(l->view, (int)pixel->x, (int)pixel->y))
            continue;
        l->depth[first + i] = got->opacity >= 0.5f ? got->depth : INFINITY;
        cln_pixel_over(t->batch.stored[i], l->view->channels, t->scene->background, want, &alpha);
        for (int k = 0; k < 3; k++)
            error = fmaxf(error, fabsf(rgb[k] - want[k]));
        if (has_alpha)
            error = fmaxf(error, fabsf(got->opacity - alpha));
        l->error[first + i] = error;
        all->square += (double)error * error;
        all->rays++;
    }
}

/* The point of the cube at `distance` (cube units) along a ray of the scene. */
static void point_on_ray(const cln_space *space, const double origin[3], const double way[3],
                         double distance, double cube[3])
{
    double scene[3];

    for (int a = 0; a < 3; a++)
        scene[a] = origin[a] + way[a] * distance * space->half;
    cln_space_point_to_cube(space, scene, cube);
}

/* Distance from a point of the cube, against the unit direction `way`, to the faces of the cell of
 * a side that holds it. */
static double way_back(const double at[3], const double way[3], double side)
{
    double least = INFINITY;

    for (int a = 0; a < 3; a++) {
        const double low = floor((at[a] + 1) / side) * side - 1;
        const double face = way[a] > 0 ? at[a] - low : low + side - at[a];

        if (way[a] != 0)
            least = fmin(least, face / fabs(way[a]));
    }
    return least;
}

/* Counts, in the cell before it, a ray that ends right behind a leaf's face with no leaf before:
 * the surface that it meets may go on there. */
static void count_end(const cln_trainer *t, looks *all, const look *l, int ray)
{
    enum { NEARBY = 1024 }; /* a ray of the scene is straight in the cube over a part of so many */
    const cln_space *space = &t->scene->space;
    const cln_octree *tree = &t->model.tree;
    const cln_camera *c = &l->view->camera;
    const double u = middle(ray % l->across, all->stride, c->width) + 0.5;
    const double v = middle(ray / l->across, all->stride, c->height) + 0.5;
    const double depth = l->depth[ray];
    const int n = 1 << all->depth;
    double origin[3], way[3], at[3], before[3], length = 0, back = 0;
    int slot = 0, cell[3];

    if (!(depth > 0 && isfinite(depth)) || !cln_camera_ray(c, u, v, origin, way))
        return;
    point_on_ray(space, origin, way, depth, at);
    point_on_ray(space, origin, way, depth - depth / NEARBY, before);
    slot = cln_octree_find(tree, at);
    if (slot < 0)
        return;
    for (int a = 0; a < 3; a++) {
        way[a] = at[a] - before[a];
        length += way[a] * way[a];
    }
    length = sqrt(length);
    if (length == 0)
        return;
    const double side = ldexp(2, -tree->level[tree->leaf[slot]]);

    for (int a = 0; a < 3; a++)
        way[a] /= length;
    back = way_back(at, way, side);
    if (back > AT_FACE * side || back > length * NEARBY) /* the latter: the camera is in the leaf */
        return;
    back += side / NEARBY;
    for (int a = 0; a < 3; a++) {
        before[a] = at[a] - way[a] * back;
        if (!(before[a] >= -1 && before[a] < 1))
            return;
        cell[a] = (int)fmin((before[a] + 1) / 2 * n, n - 1);
    }
    if (cln_octree_find(tree, before) >= 0 || (space->shell && !cln_shell_holds(before)))
        return;
    uint8_t *ends = &all->ends[cln_cell_at(cell[0], cell[1], cell[2], n)];

    *ends += *ends < LEAST_ENDS;
}

static cln_status look_through(cln_trainer *t, looks *all, int view, look *l)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &t->scene->views[view].camera;
    cln_ray_batch batch = {.pixels = t->batch.pixels,
                           .backgrounds = (const float(*)[4])t->batch.backgrounds,
                           .sampling = cln_render_sampling(&t->pipeline)};
    int rays = 0, used = 0;

    *l = (look){.view = &t->scene->views[view],
                .across = blocks(c->width, all->stride),
                .down = blocks(c->height, all->stride)};
    rays = l->across * l->down;
    CLN_TRY(cln_alloc(&l->error, (size_t)rays, sizeof *l->error, "errors of photos"));
    CLN_TRY(cln_alloc(&l->depth, (size_t)rays, sizeof *l->depth, "errors of photos"));
    batch.sampling.pictures = false; /* training's densities */
    batch.sampling.max_samples = t->plan.max_samples;
    for (int first = 0; first < rays; first += used) {
        const int most =
            t->batch.capacity < t->plan.max_rays ? t->batch.capacity : t->plan.max_rays;

        batch.n = rays - first < most ? rays - first : most;
        for (int i = 0; i < batch.n; i++) {
            const int x = (first + i) % l->across, y = (first + i) / l->across;

            t->batch.pixels[i] = (cln_pixel){.view = (cln_u32)view,
                                             .x = middle(x, all->stride, c->width),
                                             .y = middle(y, all->stride, c->height)};
            memcpy(t->batch.backgrounds[i], t->scene->background, sizeof t->scene->background);
        }
        CLN_TRY(cln_render_rays(&t->pipeline, &batch, t->results, &used));
        cln_batch_look(&t->batch, t->scene, used);
        compare(t, all, l, first, used);
        for (int i = first; i < first + used; i++)
            count_end(t, all, l, i);
    }
done:
    return st;
}

/* Whether at least `share` of the photos that see a point of the cube have an error there. */
static bool has_errors(const looks *all, const cln_space *space, const double cube[3], double share)
{
    double scene[3];
    int seen = 0, bad = 0;

    cln_space_point_to_scene(space, cube, scene);
    for (int i = 0; i < all->count && seen - bad <= (1 - share) * all->count; i++) {
        const look *l = &all->look[i];
        double u = 0, v = 0, z = 0, square = 0;
        int at = 0;

        if (!cln_camera_project(&l->view->camera, scene, &u, &v, &z) ||
            !(u >= 0 && u < l->view->camera.width && v >= 0 && v < l->view->camera.height))
            continue;
        at = (int)fmin(floor(v / all->stride), l->down - 1) * l->across +
             (int)fmin(floor(u / all->stride), l->across - 1);
        for (int a = 0; a < 3; a++) {
            const double d = (scene[a] - l->view->camera.c2w[4 * a + 3]) / space->half;

            square += d * d;
        }
        if (l->depth[at] < sqrt(square)) /* hidden, or the pixel does not count */
            continue;
        seen++;
        bad += l->error[at] > all->least;
    }
    return seen >= LEAST_SEEN && bad >= share * seen;
}

static bool is_missing(const cln_trainer *t, const looks *all, const uint8_t *empty, int cell)
{
    const cln_space *space = &t->scene->space;
    const double share = t->model.config.regrow;
    const int n = 1 << ERROR_LEVEL, corner[3] = {cell % n, cell / n % n, cell / n / n};
    double at[3];
    int slot = 0, missing = 0;

    for (int a = 0; a < 3; a++)
        at[a] = 2 * (corner[a] + 0.5) / n - 1;
    slot = cln_octree_find(&t->model.tree, at);
    if (space->shell && !cln_shell_holds(at))
        return false;
    if ((slot >= 0 && !empty[slot]) || !has_errors(all, space, at, share / 2))
        return false; /* a cheap test that leaves few cells for the close look */
    for (int p = 0; p < POINTS * POINTS * POINTS && missing < LEAST_POINTS; p++) {
        const int part[3] = {p % POINTS, p / POINTS % POINTS, p / POINTS / POINTS};

        for (int a = 0; a < 3; a++)
            at[a] = 2 * (corner[a] + (part[a] + 0.5) / POINTS) / n - 1;
        missing += has_errors(all, space, at, share);
    }
    return missing >= LEAST_POINTS;
}

/* Marks the cells [2^depth an axis] of one of ERROR_LEVEL. */
static void mark_under(cln_missing *missing, int cell)
{
    const int n = 1 << ERROR_LEVEL, wide = 1 << (missing->depth - ERROR_LEVEL);
    const int from[3] = {cell % n * wide, cell / n % n * wide, cell / n / n * wide};

    for (int z = from[2]; z < from[2] + wide; z++)
        for (int y = from[1]; y < from[1] + wide; y++)
            for (int x = from[0]; x < from[0] + wide; x++)
                missing->cells[cln_cell_at(x, y, z, 1 << missing->depth)] = 1;
}

cln_status cln_regrow_find(cln_trainer *t, const uint8_t *empty, cln_missing *missing)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN);
    const int depth = cln_octree_depth(&t->model.tree);
    looks all = {.count = views < MOST_VIEWS ? views : MOST_VIEWS,
                 .depth = depth > ERROR_LEVEL ? depth : ERROR_LEVEL};
    const size_t cells = (size_t)1 << (3 * all.depth);

    *missing = (cln_missing){.depth = all.depth};
    CLN_TRY(cln_alloc(&missing->cells, cells, 1, "marks of cells"));
    if (t->scene->space.forward)
        goto done;
    CLN_TRY(cln_alloc(&all.ends, cells, 1, "marks of cells"));
    all.stride = cln_scene_spread_stride(t->scene, CLN_SPLIT_TRAIN, all.count, MOST_RAYS);
    CLN_TRY(cln_step_catch_up(t));
    cln_queue_book(t->device, CLN_STAGE_PROBE);
    t->drawn = false; /* its batch is overwritten */
    for (int i = 0; i < all.count; i++)
        CLN_TRY(look_through(
            t, &all, cln_scene_spread_view(t->scene, CLN_SPLIT_TRAIN, i, all.count), &all.look[i]));
    all.least = 2 * sqrt(all.square / fmax(1, (double)all.rays));
    all.least = fmin(LARGE_ERROR, fmax(LEAST_ERROR, all.least));
    for (size_t i = 0; i < cells; i++) {
        missing->cells[i] = all.ends[i] == LEAST_ENDS;
        missing->cut += missing->cells[i];
    }
    for (int i = 0; i < 1 << (3 * ERROR_LEVEL); i++)
        if (is_missing(t, &all, empty, i)) {
            mark_under(missing, i);
            missing->errors++;
        }
done:
    cln_queue_book(t->device, CLN_STAGES);
    free_looks(&all);
    return st;
}
