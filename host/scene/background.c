/* What lies behind everything: a colour that is given, or one that the photos choose. See
 * scene.h. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "ranks/ranks.h"
#include "scene/build.h"

/* At most about so many pixels are looked at, and so many a side of a photo. */
enum { PIXELS = 1 << 18, SIDE = 64 };
/* Photos stand before one colour if so many of the pixels that are looked at along their borders,
 * so many a photo, have it, but for so much of a channel. Lenses that see further to the sides than
 * this cosine may have a border that shows nothing. */
enum { BORDER = 256, BACKDROP_OFF = 3 };
/* They stand before one picture that does not move if so many of these pixels differ by so little
 * from photo to photo, of so many at least, while the mean of the cameras' axes is as short. */
enum { STILL_VIEWS = 8 };
#define STILL_SHARE     0.9
#define STILL_DEVIATION 8.0
#define STILL_AXES      0.95
#define BACKDROP_SHARE  0.95
#define BACKDROP_AHEAD  0.4
/* It is lit unevenly if, where rows of so many photos, so many of each, leave its colour, as many
 * do so over more than RAMP pixels, or a RAMP_SIDE of the row. */
enum { UNEVEN_VIEWS = 32, UNEVEN_ROWS = 64, RAMP = 4, RAMP_SIDE = 100, NEARLY = 8 };
#define UNEVEN_SHARE 0.5

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

/* Adds all ranks' sums [count], of their own photos. */
static cln_status add_ranks(uint64_t *sums, int count)
{
    cln_status st = CLN_OK;
    const size_t row = (size_t)count * sizeof *sums;
    int first[CLN_RANKS_MOST + 1];
    uint64_t *all = NULL;

    CLN_TRY(cln_alloc(&all, (size_t)(cln_ranks_count() * count), sizeof *all, "background"));
    for (int r = 0; r <= cln_ranks_count(); r++)
        first[r] = r;
    memcpy(all + cln_ranks_me() * count, sums, row);
    cln_ranks_gather(all, row, first, true);
    memset(sums, 0, row);
    for (int i = 0; i < cln_ranks_count() * count; i++)
        sums[i % count] += all[i];
done:
    free(all);
    return st;
}

/* Does no photo look outwards, or far to the sides? */
static bool looks_ahead(const cln_scene *scene)
{
    double o[3], d[3], along = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_camera *c = &scene->views[i].camera;

        for (int k = 0; k < 4; k++) { /* corners */
            if (!cln_camera_ray(c, k & 1 ? c->width - 0.5 : 0.5, k & 2 ? c->height - 0.5 : 0.5, o,
                                d))
                return false;
            along = 0;
            for (int a = 0; a < 3; a++)
                along += d[a] * c->c2w[4 * a + 2];
            if (along < BACKDROP_AHEAD)
                return false;
        }
    }
    return !scene->outwards;
}

/* Pixel k of BORDER along a view's border: false if it does not count. */
static bool border_pixel(const cln_view *view, int k, uint8_t p[4])
{
    const int w = view->camera.width, h = view->camera.height, side = k % 4;
    const double along = (k / 4 + 0.5) / (BORDER / 4);
    const int x = side == 0 ? 0 : side == 1 ? w - 1 : (int)(along * w);
    const int y = side == 2 ? 0 : side == 3 ? h - 1 : (int)(along * h);

    if (!cln_view_keeps(view, x, y))
        return false;
    cln_view_bytes(view, x, y, p);
    return true;
}

/* Finds the one colour that the photos stand before, if there is one: the medians of their borders,
 * if nearly all of these have it, and if it is `colour` where that is given. looked: whether this
 * rank's settings ask. */
static cln_status find_backdrop(const cln_scene *scene, bool looked, bool given, float colour[3],
                                bool *found)
{
    cln_status st = CLN_OK;
    const int views = looked ? cln_scene_split_count(scene, CLN_SPLIT_TRAIN) : 0;
    uint64_t counts[3 * 256] = {0}, near[2] = {0};
    uint8_t p[4] = {0};
    int median[3] = {0};

    *found = false;
    for (int i = 0; i < views * BORDER; i++) {
        const cln_view *view = cln_scene_training_view(scene, i / BORDER);

        if (cln_view_is_loaded(view) && border_pixel(view, i % BORDER, p))
            for (int c = 0; c < 3; c++)
                counts[256 * c + p[c]]++;
    }
    CLN_TRY(add_ranks(counts, 3 * 256));
    for (int c = 0; c < 3; c++) {
        uint64_t all = 0, below = 0;

        for (int v = 0; v < 256; v++)
            all += counts[256 * c + v];
        while (median[c] < 255 && 2 * (below += counts[256 * c + median[c]]) < all)
            median[c]++;
    }
    for (int i = 0; i < views * BORDER; i++) {
        const cln_view *view = cln_scene_training_view(scene, i / BORDER);
        bool is = true;

        if (!cln_view_is_loaded(view) || !border_pixel(view, i % BORDER, p))
            continue;
        for (int c = 0; c < 3; c++)
            is = is && abs(p[c] - median[c]) <= BACKDROP_OFF;
        near[0] += is;
        near[1]++;
    }
    CLN_TRY(add_ranks(near, 2));
    *found = near[1] > 0 && (double)near[0] >= BACKDROP_SHARE * (double)near[1];
    for (int c = 0; c < 3 && given; c++)
        *found = *found && fabs(255 * (double)colour[c] - median[c]) <= BACKDROP_OFF;
    for (int c = 0; c < 3 && *found && !given; c++)
        colour[c] = (float)(round(1000.0 * median[c] / 255) / 1000);
done:
    return st;
}

float cln_scene_off_background(const cln_scene *scene, const uint8_t rgb[3])
{
    float off = 0;

    for (int c = 0; c < 3; c++)
        off = fmaxf(off, fabsf((float)rgb[c] - 255 * scene->background[c]));
    return off;
}

/* From the side of a row inwards to where it differs from the backdrop: 1 if at once, 2 if little
 * by little, 0 if nowhere. */
static int leaves_backdrop(const cln_scene *scene, const cln_view *view, int y, bool from_right)
{
    const int width = view->camera.width;
    const int ramp = RAMP * RAMP_SIDE < width ? width / RAMP_SIDE : RAMP;
    int near = 0;

    for (int i = 0; i < width; i++) {
        const int x = from_right ? width - 1 - i : i;
        uint8_t p[4] = {0};
        float off = 0;

        if (!cln_view_keeps(view, x, y))
            return 0;
        cln_view_bytes(view, x, y, p);
        off = cln_scene_off_background(scene, p);
        if (off > CLN_UNLIKE_BACKDROP)
            return i - near > ramp ? 2 : 1;
        if (off <= NEARLY)
            near = i;
    }
    return 0;
}

static cln_status find_uneven(cln_scene *scene)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const int step = (views + UNEVEN_VIEWS - 1) / UNEVEN_VIEWS;
    uint64_t counts[3] = {0};

    for (int i = 0; i < views && scene->backdrop; i += step) {
        const cln_view *view = cln_scene_training_view(scene, i);

        for (int k = 0; k < UNEVEN_ROWS && cln_view_is_loaded(view); k++)
            counts[leaves_backdrop(scene, view,
                                   (2 * k + 1) * view->camera.height / (2 * UNEVEN_ROWS), k % 2)]++;
    }
    CLN_TRY(add_ranks(counts, 3));
    scene->backdrop_uneven = (double)counts[2] > UNEVEN_SHARE * (double)(counts[1] + counts[2]);
done:
    return st;
}

/* Do the cameras turn by so much that what lies around cannot look alike to all? */
static bool turn_much(const cln_scene *scene)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double sum[3] = {0};

    for (int i = 0; i < views; i++)
        for (int a = 0; a < 3; a++)
            sum[a] += cln_scene_training_view(scene, i)->camera.c2w[4 * a + 2] / views;
    return views >= STILL_VIEWS && hypot(hypot(sum[0], sum[1]), sum[2]) < STILL_AXES;
}

/* Is what is along the photos' borders one picture in all of them, as of a backdrop that stands
 * still while the object turns before a camera? */
static cln_status find_still(cln_scene *scene, bool looked)
{
    cln_status st = CLN_OK;
    const int views = looked ? cln_scene_split_count(scene, CLN_SPLIT_TRAIN) : 0;
    uint64_t *sums = NULL; /* [BORDER] number, sum and sum of squares of grey */
    int still = 0;

    CLN_TRY(cln_alloc(&sums, 3 * BORDER, sizeof *sums, "borders"));
    for (int i = 0; i < views * BORDER; i++) {
        const cln_view *view = cln_scene_training_view(scene, i / BORDER);
        uint64_t *sum = sums + (size_t)3 * (size_t)(i % BORDER);
        uint8_t p[4] = {0};

        if (!cln_view_is_loaded(view) || !border_pixel(view, i % BORDER, p))
            continue;
        for (int c = 0; c < 3; c++) {
            sum[0]++;
            sum[1] += p[c];
            sum[2] += (uint64_t)p[c] * p[c];
        }
    }
    CLN_TRY(add_ranks(sums, 3 * BORDER));
    for (int k = 0; k < BORDER; k++) {
        const double n = (double)sums[3 * k], mean = (double)sums[3 * k + 1] / n;

        still += n >= 3 * STILL_VIEWS &&
                 (double)sums[3 * k + 2] / n - mean * mean < STILL_DEVIATION * STILL_DEVIATION;
    }
    scene->still = still >= STILL_SHARE * BORDER;
done:
    free(sums);
    return st;
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
    CLN_TRY(add_ranks(sums, 4)); /* whatever their settings are: these are compared later */
    scene->background_known = sums[3] > 0;
    for (int c = 0; c < 3 && sums[3] > 0; c++) /* digits that run.json gives back exactly */
        scene->background[c] =
            (float)(round(1000.0 * (double)sums[c] / (255.0 * (double)sums[3])) / 1000);
    CLN_TRY(find_backdrop(scene, /* amid things, one colour is bars or a round field */
                          kind != CLN_BACKGROUND_MEAN && !scene->has_alpha && !scene->amid &&
                              looks_ahead(scene),
                          kind == CLN_BACKGROUND_GIVEN, scene->background, &scene->backdrop));
    CLN_TRY(find_uneven(scene));
    CLN_TRY(find_still(scene, !scene->has_alpha && !scene->backdrop && looks_ahead(scene) &&
                                  turn_much(scene)));
done:
    return st;
}
