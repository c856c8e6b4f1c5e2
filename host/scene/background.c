/* What lies behind everything: a colour that is given, or one that the photos choose. See
 * scene.h. */
#include <math.h>
#include <string.h>

#include "base/config.h"
#include "ranks/ranks.h"
#include "scene/build.h"

/* At most about so many pixels are looked at, and so many a side of a photo. */
enum { PIXELS = 1 << 18, SIDE = 64 };

/* Adds the view's colours over alpha, at the middles of side x side parts; [3] is the weight. */
static void add(const cln_view *view, int side, uint64_t sums[4])
{
    const int width = view->camera.width, height = view->camera.height;

    for (int j = 0; j < side; j++)
        for (int i = 0; i < side; i++) {
            const int x = (int)((2 * i + 1) * (int64_t)width / (2 * side));
            const int y = (int)((2 * j + 1) * (int64_t)height / (2 * side));
            uint8_t p[4] = {0, 0, 0, 255};

            if (!cln_view_keeps(view, x, y))
                continue;
            cln_view_bytes(view, x, y, p);
            for (int c = 0; c < 3; c++)
                sums[c] += (uint64_t)p[c] * p[3];
            sums[3] += p[3];
        }
}

/* Adds all ranks' sums, of their own photos. */
static void add_ranks(uint64_t sums[4])
{
    uint64_t all[CLN_RANKS_MOST][4];
    int first[CLN_RANKS_MOST + 1];

    for (int r = 0; r <= cln_ranks_count(); r++)
        first[r] = r;
    memcpy(all[cln_ranks_me()], sums, sizeof *all);
    cln_ranks_gather(all, sizeof *all, first, true);
    memset(sums, 0, sizeof *all);
    for (int r = 0; r < cln_ranks_count(); r++)
        for (int c = 0; c < 4; c++)
            sums[c] += all[r][c];
}

cln_status cln_scene_find_background(cln_scene *scene, const cln_config *config)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const int side = (int)fmin(SIDE, fmax(1, sqrt((double)PIXELS / fmax(1, views))));
    cln_background_kind kind = CLN_BACKGROUND_GIVEN;
    uint64_t sums[4] = {0};

    CLN_TRY(cln_config_background(config, &kind, scene->background));
    scene->background_mean =
        kind == CLN_BACKGROUND_MEAN || (kind == CLN_BACKGROUND_AUTO && !scene->has_alpha);
    for (int i = 0; i < views && scene->background_mean; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);

        if (cln_view_is_loaded(view))
            add(view, side, sums);
    }
    add_ranks(sums); /* whatever their settings are: these are compared later */
    scene->background_known = sums[3] > 0;
    for (int c = 0; c < 3 && sums[3] > 0; c++) /* digits that run.json gives back exactly */
        scene->background[c] =
            (float)(round(1000.0 * (double)sums[c] / (255.0 * (double)sums[3])) / 1000);
done:
    return st;
}
