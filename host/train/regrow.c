/* Finds places that lack a leaf. See regrow.h. */
#include "train/regrow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "device/queue.h"
#include "model/shell_tree.h"
#include "render/ray_batch.h"
#include "train/probe.h"
#include "train/step.h"

enum {
    ERROR_LEVEL = 5,  /* level of the cells tested for errors */
    MOST_VIEWS = 48,  /* photos looked at, evenly chosen */
    LEAST_ENDS = 3,   /* rays that must end at a face that cuts a surface off */
    LEAST_SEEN = 3,   /* photos that must see a place */
    POINTS = 3,       /* places of a cell along an axis */
    LEAST_POINTS = 2, /* of a cell's POINTS^3 that must show errors */
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
    double least;    /* a larger difference is an error */
    int depth;       /* of the tree, ERROR_LEVEL at least */
    cln_marks *ends; /* a cell of that level for each ray that ends right behind it */
} looks;

static void free_looks(looks *all)
{
    for (int i = 0; i < all->count; i++) {
        free(all->look[i].error);
        free(all->look[i].depth);
    }
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
        cln_exposure_divide(&t->exposure, &t->model, (int)pixel->view, want);
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
static void point_on_ray(const cln_space *space, const double origin[3], const double direction[3],
                         double distance, double cube[3])
{
    double scene[3];

    for (int a = 0; a < 3; a++)
        scene[a] = origin[a] + direction[a] * distance * space->half;
    cln_space_point_to_cube(space, scene, cube);
}

/* Distance from a point of the cube, against a unit direction, to the faces of the cell of
 * a side that holds it. */
static double distance_back(const double at[3], const double direction[3], double side)
{
    double least = INFINITY;

    for (int a = 0; a < 3; a++) {
        const double low = floor((at[a] + 1) / side) * side - 1;
        const double face = direction[a] > 0 ? at[a] - low : low + side - at[a];

        if (direction[a] != 0)
            least = fmin(least, face / fabs(direction[a]));
    }
    return least;
}

/* Marks the cell before it for a ray that ends right behind a leaf's face with no leaf before: the
 * surface that it meets may go on there. */
static cln_status mark_end(const cln_trainer *t, looks *all, const look *l, int ray)
{
    enum { NEARBY = 1024 }; /* a ray of the scene is straight in the cube over a part of so many */
    const cln_space *space = &t->scene->space;
    const cln_octree *tree = &t->model.tree;
    const cln_camera *c = &l->view->camera;
    const double u = middle(ray % l->across, all->stride, c->width) + 0.5;
    const double v = middle(ray / l->across, all->stride, c->height) + 0.5;
    const double depth = l->depth[ray];
    const int n = 1 << all->depth;
    double origin[3], direction[3], at[3], before[3], length = 0, back = 0;
    int slot = 0, cell[3];

    if (!(depth > 0 && isfinite(depth)) || !cln_camera_ray(c, u, v, origin, direction))
        return CLN_OK;
    point_on_ray(space, origin, direction, depth, at);
    point_on_ray(space, origin, direction, depth - depth / NEARBY, before);
    slot = cln_octree_find(tree, at);
    if (slot < 0)
        return CLN_OK;
    for (int a = 0; a < 3; a++) {
        direction[a] = at[a] - before[a];
        length += direction[a] * direction[a];
    }
    length = sqrt(length);
    if (length == 0)
        return CLN_OK;
    const double side = ldexp(2, -tree->level[tree->leaf[slot]]);

    for (int a = 0; a < 3; a++)
        direction[a] /= length;
    back = distance_back(at, direction, side);
    if (back > AT_FACE * side || back > length * NEARBY) /* the latter: the camera is in the leaf */
        return CLN_OK;
    back += side / NEARBY;
    for (int a = 0; a < 3; a++) {
        before[a] = at[a] - direction[a] * back;
        if (!(before[a] >= -1 && before[a] < 1))
            return CLN_OK;
        cell[a] = (int)fmin((before[a] + 1) / 2 * n, n - 1);
    }
    if (cln_octree_find(tree, before) >= 0 || (space->shell && !cln_shell_holds(before)))
        return CLN_OK;
    return cln_marks_add(all->ends, all->depth, cell);
}

static cln_status look_through(cln_trainer *t, looks *all, int view, look *l)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &t->scene->views[view].camera;
    cln_ray_batch batch = {.pixels = t->batch.pixels,
                           .backgrounds = (const float(*)[4])t->batch.backgrounds,
                           .sampling = cln_probe_sampling(t)};
    int rays = 0, used = 0;

    *l = (look){.view = &t->scene->views[view],
                .across = blocks(c->width, all->stride),
                .down = blocks(c->height, all->stride)};
    rays = l->across * l->down;
    CLN_TRY(cln_alloc(&l->error, (size_t)rays, sizeof *l->error, "errors of photos"));
    CLN_TRY(cln_alloc(&l->depth, (size_t)rays, sizeof *l->depth, "errors of photos"));
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
            CLN_TRY(mark_end(t, all, l, i));
    }
done:
    return st;
}

/* A place of the scene: photos that see it, and those of them that have an error there. */
typedef struct place {
    double scene[3];
    int seen, bad;
} place;

static place place_at(const cln_space *space, const double cube[3])
{
    place p = {.seen = 0};

    cln_space_point_to_scene(space, cube, p.scene);
    return p;
}

/* Looks at places in one photo, whose errors stay in the cache meanwhile. most: no more photos may
 * see a place without an error; then it is not missing. */
static void look_at(const looks *all, const look *l, const cln_space *space, double most,
                    place *places, int n)
{
    const cln_camera *c = &l->view->camera;

    for (place *p = places; p < places + n; p++) {
        double u = 0, v = 0, square = 0;
        int x = 0, y = 0, at = 0;

        if (p->seen - p->bad > most || !cln_camera_shows(c, p->scene, &u, &v))
            continue;
        x = (int)(u / all->stride);
        y = (int)(v / all->stride);
        at = (y < l->down ? y : l->down - 1) * l->across + (x < l->across ? x : l->across - 1);
        if (l->depth[at] < INFINITY) { /* hidden, or the pixel does not count? */
            for (int a = 0; a < 3; a++) {
                const double d = (p->scene[a] - c->c2w[4 * a + 3]) / space->half;

                square += d * d;
            }
            if (l->depth[at] < sqrt(square))
                continue;
        }
        p->seen++;
        p->bad += l->error[at] > all->least;
    }
}

/* Looks at places in all photos, where at least `share` of those that see a missing one have an
 * error there. */
static void look_around(const looks *all, const cln_space *space, double share, place *places,
                        int n)
{
    for (int i = 0; i < all->count; i++)
        look_at(all, &all->look[i], space, (1 - share) * all->count, places, n);
}

static bool has_errors(const place *p, double share)
{
    return p->seen >= LEAST_SEEN && p->bad >= share * p->seen;
}

/* Whether enough places of a cell of ERROR_LEVEL are missing: a close look. */
static bool is_missing(const looks *all, const cln_space *space, double share, const int cell[3])
{
    const int n = 1 << ERROR_LEVEL;
    int missing = 0;

    for (int row = 0; row < POINTS * POINTS && missing < LEAST_POINTS; row++) {
        place places[POINTS];

        for (int x = 0; x < POINTS; x++) {
            const int part[3] = {x, row % POINTS, row / POINTS};
            double at[3];

            for (int a = 0; a < 3; a++)
                at[a] = 2 * (cell[a] + (part[a] + 0.5) / POINTS) / n - 1;
            places[x] = place_at(space, at);
        }
        look_around(all, space, share, places, POINTS);
        for (int x = 0; x < POINTS; x++)
            missing += has_errors(&places[x], share);
    }
    return missing >= LEAST_POINTS;
}

/* Marks the cells of ERROR_LEVEL with this z that have no leaf or an empty one, and errors. */
static cln_status mark_errors(const cln_trainer *t, const looks *all, const uint8_t *empty, int z,
                              cln_missing *missing)
{
    enum { N = 1 << ERROR_LEVEL };
    cln_status st = CLN_OK;
    const cln_space *space = &t->scene->space;
    const double share = t->model.config.regrow;
    place middles[N * N];
    int cells[N * N][3], n = 0;

    for (int i = 0; i < N * N; i++) {
        const int cell[3] = {i % N, i / N, z};
        double at[3];
        int slot = 0;

        for (int a = 0; a < 3; a++)
            at[a] = 2 * (cell[a] + 0.5) / N - 1;
        slot = cln_octree_find(&t->model.tree, at);
        if ((slot >= 0 && !empty[slot]) || (space->shell && !cln_shell_holds(at)))
            continue;
        memcpy(cells[n], cell, sizeof cell);
        middles[n++] = place_at(space, at);
    }
    look_around(all, space, share / 2, middles, n); /* cheap, and most need no close look */
    for (int i = 0; i < n; i++) {
        if (!has_errors(&middles[i], share / 2) || !is_missing(all, space, share, cells[i]))
            continue;
        CLN_TRY(cln_marks_add(&missing->marks, ERROR_LEVEL, cells[i]));
        missing->errors++;
    }
done:
    return st;
}

cln_status cln_regrow_find(cln_trainer *t, const uint8_t *empty, cln_missing *missing)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(t->scene, CLN_SPLIT_TRAIN);
    const int depth = cln_octree_depth(&t->model.tree);
    looks all = {.count = views < MOST_VIEWS ? views : MOST_VIEWS,
                 .depth = depth > ERROR_LEVEL ? depth : ERROR_LEVEL,
                 .ends = &missing->marks};

    *missing = (cln_missing){.errors = 0};
    if (t->scene->space.forward)
        return CLN_OK;
    all.stride = cln_scene_spread_stride(t->scene, CLN_SPLIT_TRAIN, all.count, CLN_LOOK_RAYS);
    CLN_TRY(cln_step_catch_up(t));
    cln_queue_book(t->device, CLN_STAGE_PROBE);
    t->drawn = false; /* its batch is overwritten */
    for (int i = 0; i < all.count; i++)
        CLN_TRY(look_through(
            t, &all, cln_scene_spread_view(t->scene, CLN_SPLIT_TRAIN, i, all.count), &all.look[i]));
    all.least = 2 * sqrt(all.square / fmax(1, (double)all.rays));
    all.least = fmin(LARGE_ERROR, fmax(LEAST_ERROR, all.least));
    cln_marks_keep(&missing->marks, LEAST_ENDS);
    missing->cut = missing->marks.count;
    for (int z = 0; z < 1 << ERROR_LEVEL; z++)
        CLN_TRY(mark_errors(t, &all, empty, z, missing));
    cln_marks_order(&missing->marks);
done:
    cln_queue_book(t->device, CLN_STAGES);
    free_looks(&all);
    return st;
}
