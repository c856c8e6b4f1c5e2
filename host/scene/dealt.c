/* Photos dealt to ranks. See dealt.h. */
#include "scene/dealt.h"

#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/memory.h"
#include "ranks/ranks.h"

static int64_t pixels_of(const cln_view *view)
{
    return (int64_t)view->camera.width * view->camera.height;
}

/* Messages about photos are as long as these tell. */
static cln_status agree(const cln_scene *scene)
{
    uint64_t digest = scene->digest;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];
        const int32_t shape[5] = {v->split, v->camera.width, v->camera.height, v->channels,
                                  v->mask_path != NULL};

        digest = cln_digest(digest, shape, sizeof shape);
    }
    return cln_ranks_agree(digest, "scene");
}

/* All draw the same rays, some of them to sparse points, which are not part of a scene's digest. */
static cln_status agree_on_sights(const cln_scene *scene)
{
    uint64_t digest = cln_digest(CLN_DIGEST_START, &scene->sight_count, sizeof scene->sight_count);

    for (int64_t i = 0; i < scene->sight_count; i++) {
        const cln_sight *s = &scene->sights[i];
        const int32_t pixel[3] = {s->view, s->x, s->y};

        digest = cln_digest(digest, pixel, sizeof pixel);
        digest = cln_digest(digest, &s->trust, sizeof s->trust);
        digest = cln_digest(digest, s->point, sizeof s->point);
    }
    return cln_ranks_agree(digest, "set of sparse points");
}

cln_status cln_scene_deal(cln_scene *scene)
{
    cln_status st = CLN_OK;
    const int64_t ranks = cln_ranks_count();
    int64_t all[CLN_SPLITS] = {0}, before[CLN_SPLITS] = {0};

    CLN_TRY(agree(scene));
    CLN_TRY(agree_on_sights(scene));
    for (int i = 0; i < scene->view_count; i++)
        all[scene->views[i].split] += pixels_of(&scene->views[i]);
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];
        const int64_t own = pixels_of(v); /* by its middle pixel */

        v->rank = (int)((2 * before[v->split] + own) * ranks / (2 * all[v->split]));
        before[v->split] += own;
    }
done:
    return st;
}

void cln_scene_dealt(const cln_scene *scene, cln_split split, int *first)
{
    const int views = cln_scene_split_count(scene, split);
    const cln_view *view = scene->views + cln_scene_split_view(scene, split, 0);
    int i = 0;

    for (int r = 0; r < cln_ranks_count(); r++) {
        first[r] = i;
        while (i < views && view[i].rank == r)
            i++;
    }
    first[cln_ranks_count()] = views;
}

bool cln_view_is_here(const cln_view *view)
{
    return view->rank == cln_ranks_me();
}

cln_status cln_view_borrow(const cln_view *view, cln_view *out)
{
    cln_status st = CLN_OK;
    const size_t channels = (size_t)view->channels, count = (size_t)pixels_of(view);
    const size_t wide = (size_t)view->camera.width;

    *out = *view;
    if (cln_ranks_count() == 1)
        return CLN_OK;
    out->store = NULL;
    if (!view->pixels)
        CLN_TRY(cln_alloc(&out->pixels, count, channels, "a photo"));
    for (size_t i = 0; view->store && i < count; i++) {
        uint8_t pixel[4];

        cln_view_bytes(view, (int)(i % wide), (int)(i / wide), pixel);
        memcpy(out->pixels + i * channels, pixel, channels);
    }
    if (view->store) /* what could not be read is 0 there, and must not count as a photo anywhere */
        CLN_TRY(cln_store_check(view->store));
    cln_ranks_tell_from(view->rank, out->pixels, count * channels);
done:
    return st;
}

void cln_view_give_back(const cln_view *view, cln_view *borrowed)
{
    if (borrowed->pixels != view->pixels)
        free(borrowed->pixels);
    memset(borrowed, 0, sizeof *borrowed);
}
