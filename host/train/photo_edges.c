/* Pixels at edges. See photo_edges.h. */
#include "train/photo_edges.h"

#include <limits.h>
#include <stdlib.h>

#include "base/memory.h"
#include "ranks/ranks.h"
#include "scene/dealt.h"
#include "scene/store.h"

/* The largest difference of neighbouring bytes that is no edge: docs/results.md, "Pixels at edges
 * are means". */
enum { EDGE_STEP = 30 };

/* Whether the pixel of a photo that is here differs from one of its eight neighbours. */
static bool differs(const cln_view *view, int x, int y)
{
    const int width = view->camera.width, height = view->camera.height;
    uint8_t here[4], there[4];

    cln_view_bytes(view, x, y, here);
    for (int v = y > 0 ? y - 1 : 0; v <= y + 1 && v < height; v++)
        for (int u = x > 0 ? x - 1 : 0; u <= x + 1 && u < width; u++) {
            cln_view_bytes(view, u, v, there);
            for (int c = view->channels == 4 && !here[3] && !there[3] ? 3 : 0; c < view->channels;
                 c++)
                if (abs(here[c] - there[c]) > EDGE_STEP)
                    return true;
        }
    return false;
}

static int64_t pixel_of(const cln_view *view, int x, int y)
{
    return (int64_t)y * view->camera.width + x;
}

static int64_t words_of(const cln_view *view)
{
    return (pixel_of(view, 0, view->camera.height) + 63) / 64;
}

static void look(const cln_view *view, uint64_t *bits)
{
    int64_t i = 0;

    for (int y = 0; y < view->camera.height; y++)
        for (int x = 0; x < view->camera.width; x++, i++)
            if (differs(view, x, y))
                bits[i / 64] |= UINT64_C(1) << i % 64;
}

cln_status cln_photo_edges_find(const cln_scene *scene, cln_photo_edges *e)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int dealt[CLN_RANKS_MOST + 1];

    if (e->bits || cln_ranks_count() == 1)
        return CLN_OK;
    CLN_TRY(cln_alloc(&e->first, (size_t)views + 1, sizeof *e->first, "pixels at edges"));
    for (int i = 0; i < views; i++)
        e->first[i + 1] = e->first[i] + words_of(cln_scene_training_view(scene, i));
    CLN_TRY(cln_alloc(&e->bits, (size_t)e->first[views], sizeof *e->bits, "pixels at edges"));
    cln_scene_dealt(scene, CLN_SPLIT_TRAIN, dealt);
    for (int i = dealt[cln_ranks_me()]; i < dealt[cln_ranks_me() + 1]; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);

        look(view, e->bits + e->first[i]);
        cln_ranks_answer();
        if (view->store)
            CLN_TRY(cln_store_check(view->store));
    }
    for (int r = 0; r <= cln_ranks_count(); r++) {
        CLN_ASSERT(e->first[dealt[r]] <= INT_MAX);
        dealt[r] = (int)e->first[dealt[r]];
    }
    cln_ranks_gather(e->bits, sizeof *e->bits, dealt, true);
done:
    if (st != CLN_OK)
        cln_photo_edges_free(e);
    return st;
}

void cln_photo_edges_free(cln_photo_edges *e)
{
    free(e->bits);
    free(e->first);
    *e = (cln_photo_edges){NULL, NULL};
}

bool cln_photo_edges_has(const cln_photo_edges *e, const cln_scene *scene, int index, int x, int y)
{
    const cln_view *view = cln_scene_training_view(scene, index);
    const int64_t i = pixel_of(view, x, y);

    if (cln_ranks_count() == 1)
        return differs(view, x, y);
    return e->bits[e->first[index] + i / 64] >> i % 64 & 1;
}

void cln_photo_edges_fetch(const cln_photo_edges *e, const cln_scene *scene, int index, int x,
                           int y)
{
    const cln_view *view = cln_scene_training_view(scene, index);

    if (e->bits) {
        __builtin_prefetch(&e->bits[e->first[index] + pixel_of(view, x, y) / 64]);
        return;
    }
    for (int row = y - 1; row <= y + 1; row++)
        if (row >= 0 && row < view->camera.height)
            cln_view_fetch(view, x, row);
}

double cln_photo_edges_bytes(const cln_scene *scene)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double bytes = 0;

    for (int i = 0; i < views && cln_ranks_count() > 1; i++)
        bytes += (double)words_of(cln_scene_training_view(scene, i)) * sizeof(uint64_t);
    return bytes;
}
