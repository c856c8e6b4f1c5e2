/* Random pixels of random views. See batch.h. */
#include "train/batch.h"

#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "base/rng.h"
#include "pipeline/stage1.h"
#include "scene/dealt.h"

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    out->capacity = cln_config_most_rays(config);
    out->train_views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    CLN_TRY(cln_alloc(&out->pixels, (size_t)out->capacity, sizeof *out->pixels, "batch"));
    CLN_TRY(cln_alloc(&out->stored, (size_t)out->capacity, sizeof *out->stored, "batch"));
    CLN_TRY(cln_rows_create(out->capacity, sizeof *out->stored, &out->asked));
    CLN_TRY(cln_alloc(&out->targets, (size_t)out->capacity, sizeof *out->targets, "batch"));
    CLN_TRY(cln_alloc(&out->backgrounds, (size_t)out->capacity, sizeof *out->backgrounds, "batch"));
    if (cln_batch_knows(scene, config))
        CLN_TRY(cln_alloc(&out->shown, (size_t)out->capacity, sizeof *out->shown, "batch"));
    CLN_TRY(cln_alloc(&out->first, (size_t)out->train_views + 1, sizeof *out->first, "batch"));
    CLN_TRY(cln_coverage_create(scene, &out->coverage));
    for (int i = 0; i < out->train_views; i++) {
        const cln_camera *c = &cln_scene_training_view(scene, i)->camera;

        out->first[i + 1] = out->first[i] + (uint64_t)c->width * (uint64_t)c->height;
    }
done:
    if (st != CLN_OK)
        cln_batch_free(out);
    return st;
}

double cln_batch_bytes(const cln_scene *scene)
{
    return cln_coverage_bytes(scene) + cln_photo_edges_bytes(scene);
}

void cln_batch_free(cln_batch *batch)
{
    free(batch->pixels);
    free(batch->stored);
    cln_rows_free(&batch->asked);
    free(batch->targets);
    free(batch->backgrounds);
    free(batch->shown);
    free(batch->first);
    cln_coverage_free(&batch->coverage);
    cln_photo_edges_free(&batch->edges);
    memset(batch, 0, sizeof *batch);
}

/* floor(random * n) for 64 random bits. */
static uint64_t bounded64(uint64_t random, uint64_t n)
{
    return (uint64_t)(((unsigned __int128)random * n) >> 64);
}

static void draw_bits(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index,
                      uint32_t attempt, uint32_t bits[4])
{
    const uint32_t counter[4] = {index, stream << 24, step, attempt};
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};

    cln_philox(counter, key, bits);
}

/* The pixel of a ray: index among the training views, column, row. */
typedef struct place {
    int index, x, y;
} place;

static const cln_camera *camera_of(const cln_scene *scene, int index)
{
    return &cln_scene_training_view(scene, index)->camera;
}

/* Pixel number `at` of all training pixels. */
static place locate(const cln_batch *b, const cln_scene *scene, uint64_t at)
{
    /* mostly right at once: views tend to have one size */
    int low = (int)((double)at / (double)b->first[b->train_views] * b->train_views);
    uint64_t width = 0;

    while (b->first[low] > at)
        low--;
    while (b->first[low + 1] <= at)
        low++;
    at -= b->first[low];
    width = (uint64_t)camera_of(scene, low)->width;
    return (place){low, (int)(at % width), (int)(at / width)};
}

static place crop(const cln_scene *scene, place p)
{
    const cln_camera *c = camera_of(scene, p.index);

    return (place){p.index, c->width / 4 + p.x / 2, c->height / 4 + p.y / 2};
}

static bool keeps(const cln_scene *scene, place p)
{
    return cln_view_keeps(cln_scene_training_view(scene, p.index), p.x, p.y);
}

/* Draws a pixel of the covered tiles by 64 random bits. False if the tile reaches beyond the
 * image's edge there; *out is then the nearest pixel. */
static bool locate_covered(const cln_coverage *c, const cln_scene *scene, const uint32_t bits[2],
                           place *out)
{
    const uint64_t side = (uint64_t)c->side, tiles = (uint64_t)c->start[c->views];
    const uint64_t at = bounded64((uint64_t)bits[0] << 32 | bits[1], tiles * side * side);
    const cln_tile *tile = &c->tiles[at / (side * side)];
    const cln_camera *camera = camera_of(scene, (int)tile->view);
    const int x = tile->column * c->side + (int)(at % side);
    const int y = tile->row * c->side + (int)(at / side % side);

    *out = (place){(int)tile->view, x < camera->width ? x : camera->width - 1,
                   y < camera->height ? y : camera->height - 1};
    return x < camera->width && y < camera->height;
}

bool cln_batch_skips(const cln_batch *b, const cln_config *config, int64_t step)
{
    return config->skip_uncovered && !cln_stage1_of(config)->by_view && !b->coverage.whole &&
           b->coverage.share > 0 && step >= config->precrop_steps;
}

/* What pixels are drawn from. */
typedef struct source {
    const cln_batch *batch;
    const cln_scene *scene;
    const cln_config *config;
    const cln_draw *draw;
} source;

/* Any pixel, or any of the covered ones: false if it falls outside the image. */
static bool draw_place(const source *from, const uint32_t bits[4], place *out)
{
    const cln_batch *b = from->batch;

    if (from->draw->covered)
        return locate_covered(&b->coverage, from->scene, bits, out);
    *out = locate(b, from->scene,
                  bounded64((uint64_t)bits[0] << 32 | bits[1], b->first[b->train_views]));
    return true;
}

/* Draws a pixel of the batch's view number `slot`. */
static bool draw_in_slot(const source *from, const uint32_t bits[4], uint32_t slot, place *out)
{
    uint32_t choice[4];
    const cln_camera *camera = NULL;

    draw_bits((uint64_t)from->config->seed, CLN_STREAM_PIXELS, from->draw->step, 0x80000000u + slot,
              0, choice);
    out->index = (int)cln_bounded(choice[0], (uint32_t)from->batch->train_views);
    camera = camera_of(from->scene, out->index);
    out->x = (int)cln_bounded(bits[0], (uint32_t)camera->width);
    out->y = (int)cln_bounded(bits[1], (uint32_t)camera->height);
    return true;
}

/* Of which all would have to fall outside the image, or on pixels left out: with a mask that keeps
 * half a percent, once in 10^9 rays. */
enum { DRAWS = 4096 };

/* False if no draw found a pixel that counts. */
static bool draw(const source *from, uint32_t ray, uint32_t slot, place *out)
{
    const cln_config *config = from->config;
    const bool by_view = cln_stage1_of(config)->by_view;

    for (uint32_t k = 0; k < DRAWS; k++) {
        uint32_t bits[4];
        bool found = false;

        draw_bits((uint64_t)config->seed, CLN_STREAM_PIXELS, from->draw->step, ray, k, bits);
        found = by_view ? draw_in_slot(from, bits, slot, out) : draw_place(from, bits, out);
        if (from->draw->step < (uint32_t)config->precrop_steps)
            *out = crop(from->scene, *out);
        if (found && keeps(from->scene, *out))
            return true;
    }
    return false;
}

bool cln_batch_knows(const cln_scene *scene, const cln_config *config)
{
    return config->depth_loss > 0 && scene->sight_count > 0 && !cln_stage1_of(config)->by_view;
}

/* Whether some rays of this draw do: not while --precrop-steps keep them in the images' middle. */
static bool has_sights(const cln_batch *b, const cln_config *config, const cln_draw *d)
{
    return b->shown && d->depth > 0 && d->step >= (uint32_t)config->precrop_steps;
}

/* Makes a ray go through a pixel that shows a sparse point, drawn by the pixel's number. */
static void draw_sight(cln_batch *b, const source *from, uint32_t number, int ray)
{
    const cln_scene *scene = from->scene;
    uint32_t bits[4];
    const cln_sight *sight = NULL;
    double cube[3];

    draw_bits((uint64_t)from->config->seed, CLN_STREAM_SIGHTS, from->draw->step, number, 0, bits);
    sight =
        &scene->sights[bounded64((uint64_t)bits[0] << 32 | bits[1], (uint64_t)scene->sight_count)];
    if (sight->x < 0 || !cln_view_keeps(&scene->views[sight->view], sight->x, sight->y))
        return; /* what it shows does not count: the ray stays what it was */
    b->pixels[ray] = (cln_pixel){(cln_u32)sight->view, (cln_u32)sight->x, (cln_u32)sight->y, 0};
    cln_space_point_to_cube(from->draw->space, sight->point, cube);
    for (int k = 0; k < 3; k++)
        b->shown[ray][k] = (float)cube[k];
    b->shown[ray][3] = (float)(sight->trust * from->draw->depth);
}

static int by_view_and_row(const void *a, const void *b)
{
    const cln_pixel *p = a, *q = b;

    if (p->spot != q->spot)
        return p->spot < q->spot ? -1 : 1;
    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return p->x < q->x ? -1 : p->x > q->x;
}

enum { FETCH_AHEAD = 16 }; /* pixels to prefetch: drawn ones lie far apart in memory */

static bool is_unlike(const cln_scene *scene, const cln_view *view, int x, int y)
{
    uint8_t p[4] = {0};

    if (x < 0 || y < 0 || x >= view->camera.width || y >= view->camera.height)
        return true;
    cln_view_bytes(view, x, y, p);
    return cln_scene_off_background(scene, p) > CLN_UNLIKE_BACKDROP;
}

/* Before a backdrop, what differs from it stands before it, and what does not may be either. A
 * pixel beside one that does not may be covered in part. */
static bool is_before(const cln_scene *scene, const cln_view *view, int x, int y)
{
    return is_unlike(scene, view, x, y) && is_unlike(scene, view, x - 1, y) &&
           is_unlike(scene, view, x + 1, y) && is_unlike(scene, view, x, y - 1) &&
           is_unlike(scene, view, x, y + 1);
}

/* Reads the pixels whose photos are here. Of photos without alpha before a backdrop, the fourth
 * channel is whether a pixel stands before it. */
static void read_own(cln_batch *b, const cln_scene *scene, int n)
{
    for (int i = 0; i < n; i++) {
        const cln_view *view = &scene->views[b->pixels[i].view];
        const cln_pixel *later = &b->pixels[i + FETCH_AHEAD < n ? i + FETCH_AHEAD : n - 1];

        b->asked.rank[i] = (uint16_t)view->rank;
        if (cln_view_is_here(&scene->views[later->view]))
            cln_view_fetch(&scene->views[later->view], (int)later->x, (int)later->y);
        if (!cln_view_is_here(view))
            continue;
        cln_view_bytes(view, (int)b->pixels[i].x, (int)b->pixels[i].y, b->stored[i]);
        if (scene->backdrop && view->channels == 3)
            b->stored[i][3] = is_before(scene, view, (int)b->pixels[i].x, (int)b->pixels[i].y);
    }
}

void cln_batch_forget(cln_batch *b)
{
    cln_rows_end(&b->asked, NULL);
}

void cln_batch_look(cln_batch *b, const cln_scene *scene, int n)
{
    cln_batch_forget(b);
    read_own(b, scene, n);
    cln_rows_share(&b->asked, n, b->stored);
}

/* The spot of a pixel's ray `index`, one in each of side x side parts of the pixel. */
static uint32_t draw_spot(const source *from, uint32_t number, int index, int side)
{
    const int part = 4096 / side; /* 4096, or 1 less with three, are a pixel's side */
    uint32_t bits[4];

    draw_bits((uint64_t)from->config->seed, CLN_STREAM_SPOTS, from->draw->step, number,
              (uint32_t)index, bits);
    return CLN_SPOT(index % side * part + (int)cln_bounded(bits[0], (uint32_t)part) - 2048,
                    index / side * part + (int)cln_bounded(bits[1], (uint32_t)part) - 2048, index,
                    side * side);
}

/* The drawn place of a pixel, and whether it counts. */
typedef struct candidate {
    place at;
    bool found;
} candidate;

static candidate draw_candidate(const source *from, uint32_t number, uint32_t slot)
{
    candidate c = {{0}, false};

    c.found = draw(from, number, slot, &c.at);
    if (from->draw->antialias > 1)
        cln_photo_edges_fetch(&from->batch->edges, from->scene, c.at.index, c.at.x, c.at.y);
    return c;
}

/* Puts a pixel and its rays from number `ray` on. Returns how many. */
static int put_pixel(cln_batch *b, const source *from, candidate c, uint32_t number, uint32_t slot,
                     int ray)
{
    const cln_draw *d = from->draw;
    const bool by_view = cln_stage1_of(from->config)->by_view;
    const bool sight = cln_batch_is_sight((int)number) && has_sights(b, from->config, d);
    const place p = c.at;
    int rays = 1;

    if (!c.found && ray > 0 && (!by_view || b->pixels[ray - 1].spot == slot)) {
        b->pixels[ray] = b->pixels[ray - 1]; /* one left out would teach that nothing is there */
        b->pixels[ray].spot = slot;
    } else {
        const int view = cln_scene_split_view(from->scene, CLN_SPLIT_TRAIN, p.index);

        if (d->antialias > 1 && !sight &&
            cln_photo_edges_has(&b->edges, from->scene, p.index, p.x, p.y))
            rays = d->antialias * d->antialias;
        for (int k = 0; k < rays && ray + k < d->n; k++)
            b->pixels[ray + k] =
                (cln_pixel){(cln_u32)view, (cln_u32)p.x, (cln_u32)p.y,
                            rays > 1 ? draw_spot(from, number, k, d->antialias) : slot};
    }
    if (sight)
        draw_sight(b, from, number, ray);
    return rays;
}

void cln_batch_begin(cln_batch *b, const cln_scene *scene, const cln_config *config,
                     const cln_draw *d)
{
    const bool by_view = cln_stage1_of(config)->by_view;
    const int n = d->n, views = config->views_per_batch < n ? config->views_per_batch : n;
    const source from = {b, scene, config, d};
    const uint32_t ahead = d->antialias > 1 ? FETCH_AHEAD : 0;
    candidate next[FETCH_AHEAD];

    CLN_ASSERT(n <= b->capacity);
    cln_batch_forget(b);
    for (uint32_t i = 0; i < ahead; i++)
        next[i] = draw_candidate(&from, i, 0);
    if (b->shown)
        memset(b->shown, 0, (size_t)n * sizeof *b->shown);
    b->drawn = 0;
    for (int ray = 0; ray < n; b->drawn++) {
        /* by view: ray i looks through batch view i * views / n */
        const uint32_t slot = by_view ? (uint32_t)((int64_t)ray * views / n) : 0;
        const uint32_t number = (uint32_t)b->drawn;
        candidate *c = &next[number % FETCH_AHEAD], now;

        now = ahead ? *c : draw_candidate(&from, number, slot);
        if (ahead)
            *c = draw_candidate(&from, number + ahead, 0);
        ray += put_pixel(b, &from, now, number, slot, ray);
    }
    if (by_view)
        qsort(b->pixels, (size_t)n, sizeof *b->pixels, by_view_and_row);
    b->n = n;
    b->ray_background = d->ray_background;
    memcpy(b->backgrounds[0], scene->background, sizeof scene->background);
    for (int i = 0; i < n && d->ray_background; i++)
        if (!by_view && CLN_SPOT_INDEX(b->pixels[i].spot) > 0)
            memcpy(b->backgrounds[i], b->backgrounds[i - 1], sizeof *b->backgrounds);
        else
            cln_uniform4((uint64_t)config->seed, CLN_STREAM_BACKGROUND, d->step, (uint32_t)i, 0,
                         b->backgrounds[i]);
    read_own(b, scene, n);
    cln_rows_begin(&b->asked, n, b->stored);
}

void cln_batch_colour(cln_batch *b, const cln_scene *scene)
{
    cln_rows_end(&b->asked, b->stored);
    for (int i = 0; i < b->n; i++) {
        const cln_view *view = &scene->views[b->pixels[i].view];
        const float *back = b->backgrounds[b->ray_background ? i : 0];
        float alpha = 1;

        cln_pixel_over(b->stored[i], view->channels, back, b->targets[i], &alpha);
        b->targets[i][3] = alpha;
        if (scene->backdrop && !b->ray_background && view->channels == 3 && !b->stored[i][3])
            b->targets[i][3] = CLN_ALPHA_UNTOLD;
        if (!cln_view_keeps(view, (int)b->pixels[i].x, (int)b->pixels[i].y)) {
            memcpy(b->targets[i], back, 3 * sizeof *back); /* its ray sees the background */
            b->targets[i][3] = 0;
        }
    }
}

void cln_batch_draw(cln_batch *b, const cln_scene *scene, const cln_config *config,
                    const cln_draw *d)
{
    cln_batch_begin(b, scene, config, d);
    cln_batch_colour(b, scene);
}
