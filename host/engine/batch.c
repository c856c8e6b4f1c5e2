/* Random pixels of random views. See batch.h. */
#include "engine/batch.h"

#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "base/rng.h"

cln_status cln_batch_create(const cln_scene *scene, const cln_config *config, cln_batch *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out);
    out->capacity = cln_config_most_rays(config);
    out->train_views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    CLN_TRY(cln_alloc(&out->pixels, (size_t)out->capacity, sizeof *out->pixels, "batch"));
    CLN_TRY(cln_alloc(&out->targets, (size_t)out->capacity, sizeof *out->targets, "batch"));
    CLN_TRY(cln_alloc(&out->backgrounds, (size_t)out->capacity, sizeof *out->backgrounds, "batch"));
    CLN_TRY(cln_alloc(&out->first, (size_t)out->train_views + 1, sizeof *out->first, "batch"));
    for (int i = 0; i < out->train_views; i++) {
        const cln_camera *c = &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)].camera;

        out->first[i + 1] = out->first[i] + (uint64_t)c->width * (uint64_t)c->height;
    }
done:
    if (st != CLN_OK)
        cln_batch_free(out);
    return st;
}

void cln_batch_free(cln_batch *batch)
{
    free(batch->pixels);
    free(batch->targets);
    free(batch->backgrounds);
    free(batch->first);
    memset(batch, 0, sizeof *batch);
}

/* floor(random * n) for 64 random bits. */
static uint64_t bounded64(uint64_t random, uint64_t n)
{
    return (uint64_t)(((unsigned __int128)random * n) >> 64);
}

static void draw_bits(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index,
                      uint32_t bits[4])
{
    const uint32_t counter[4] = {index, stream << 24, step, 0};
    const uint32_t key[2] = {(uint32_t)seed, (uint32_t)(seed >> 32)};

    cln_philox(counter, key, bits);
}

/* The `at`-th pixel of all training pixels. */
static cln_pixel locate(const cln_batch *b, const cln_scene *scene, uint64_t at)
{
    /* views are most often as large as each other */
    int low = (int)((double)at / (double)b->first[b->train_views] * b->train_views);
    cln_pixel pixel = {0};
    const cln_camera *camera = NULL;

    while (b->first[low] > at)
        low--;
    while (b->first[low + 1] <= at)
        low++;
    pixel.view = (cln_u32)cln_scene_split_view(scene, CLN_SPLIT_TRAIN, low);
    camera = &scene->views[pixel.view].camera;
    at -= b->first[low];
    pixel.x = (cln_u32)(at % (uint64_t)camera->width);
    pixel.y = (cln_u32)(at / (uint64_t)camera->width);
    return pixel;
}

static void crop(const cln_scene *scene, cln_pixel *pixel)
{
    const cln_camera *c = &scene->views[pixel->view].camera;

    pixel->x = (cln_u32)c->width / 4 + pixel->x / 2;
    pixel->y = (cln_u32)c->height / 4 + pixel->y / 2;
}

static int by_view_and_row(const void *a, const void *b)
{
    const cln_pixel *p = a, *q = b;

    if (p->pad != q->pad)
        return p->pad < q->pad ? -1 : 1;
    if (p->y != q->y)
        return p->y < q->y ? -1 : 1;
    return p->x < q->x ? -1 : p->x > q->x;
}

enum { FETCH_AHEAD = 16 }; /* pixels lie far from each other */

void cln_batch_draw(cln_batch *b, const cln_scene *scene, const cln_config *config,
                    bool ray_background, uint32_t step, int n)
{
    const bool splat = config->stage1 == CLN_STAGE1_SPLAT;
    const int views = config->views_per_batch < n ? config->views_per_batch : n;
    const uint64_t seed = (uint64_t)config->seed;
    uint32_t bits[4];

    CLN_ASSERT(n <= b->capacity);
    for (int i = 0; i < n; i++) {
        draw_bits(seed, CLN_STREAM_PIXELS, step, (uint32_t)i, bits);
        if (splat) { /* ray i looks through batch view i * views / n */
            const uint32_t slot = (uint32_t)((int64_t)i * views / n);
            uint32_t choice[4];
            const cln_camera *camera = NULL;

            draw_bits(seed, CLN_STREAM_PIXELS, step, 0x80000000u + slot, choice);
            b->pixels[i].view = (cln_u32)cln_scene_split_view(
                scene, CLN_SPLIT_TRAIN, (int)cln_bounded(choice[0], (uint32_t)b->train_views));
            camera = &scene->views[b->pixels[i].view].camera;
            b->pixels[i].x = cln_bounded(bits[0], (uint32_t)camera->width);
            b->pixels[i].y = cln_bounded(bits[1], (uint32_t)camera->height);
            b->pixels[i].pad = slot;
        } else {
            b->pixels[i] = locate(
                b, scene, bounded64((uint64_t)bits[0] << 32 | bits[1], b->first[b->train_views]));
        }
        if (step < (uint32_t)config->precrop_steps)
            crop(scene, &b->pixels[i]);
    }
    if (splat)
        qsort(b->pixels, (size_t)n, sizeof *b->pixels, by_view_and_row);
    memcpy(b->backgrounds[0], scene->background, sizeof scene->background);
    for (int i = 0; i < n; i++) {
        const cln_view *view = &scene->views[b->pixels[i].view];
        const cln_pixel *later = &b->pixels[i + FETCH_AHEAD < n ? i + FETCH_AHEAD : n - 1];
        float *back = b->backgrounds[ray_background ? i : 0], alpha = 1;

        cln_view_fetch(&scene->views[later->view], (int)later->x, (int)later->y);
        if (ray_background)
            cln_uniform4(seed, CLN_STREAM_BACKGROUND, step, (uint32_t)i, 0, back);
        cln_view_pixel(view, (int)b->pixels[i].x, (int)b->pixels[i].y, back, b->targets[i], &alpha);
        b->targets[i][3] = 0;
    }
}
