/* The box of what the alpha of training photos shows: of their visual hull. A cell of space is
 * empty if two photos that have all of it in the picture are transparent wherever the cell is seen
 * (of few photos one: one of many may have a wrong pose, or a mask that lacks a part), so
 * nothing thin falls between points that are looked at, or if most photos do not see it, or only
 * transparent parts of it. Cells are halved until they are small; those inside what is known to
 * belong to the box are not looked at again. A box of few cells is divided anew: a long lens shows
 * less than one of those out to the cameras. */
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "ranks/ranks.h"
#include "scene/dealt.h"

/* Blocks of a photo along its longer side; pixels looked at along the side of a block; halvings of
 * the space; photos that must see a cell; photos from which on
 * one alone does not tell that it is empty. */
enum { BLOCKS = 128, LOOKS = 8, HALVINGS = 9, LEAST_VIEWS = 3, MANY = 8 };
static const double BOWED =
    0.1; /* of a cell's size in the picture, by which lenses bend its edges */
static const double COARSE = 1.0 / 8; /* of the space, below which a box has too few cells */

typedef struct silhouette {
    const cln_camera *camera;
    int across, down; /* blocks */
    double block;     /* pixels along the side of one */
    uint32_t *sums;   /* [down + 1][across + 1] opaque blocks left of and above */
} silhouette;

typedef struct hull {
    silhouette *views;          /* that have alpha, and show something */
    int count, all;             /* of these; of all training photos */
    int sure;                   /* photos that see through a cell, from which on it is empty */
    cln_camera const **cameras; /* [all] */
    double low[3], high[3];     /* what was found to be shown */
} hull;

/* Is a pixel of the block not quite transparent? In large photos every few pixels are looked at. */
static bool is_opaque(const cln_view *view, const silhouette *s, int bx, int by)
{
    const int step = (int)fmax(1, s->block / LOOKS);
    const int right = (int)fmin(view->camera.width, ceil((bx + 1) * s->block));
    const int bottom = (int)fmin(view->camera.height, ceil((by + 1) * s->block));
    uint8_t rgba[4];

    for (int y = (int)(by * s->block); y < bottom; y += step)
        for (int x = (int)(bx * s->block); x < right; x += step) {
            cln_view_bytes(view, x, y, rgba);
            if (rgba[3] > 0)
                return true;
        }
    return false;
}

/* Of several processes the one that has the photo tells the others. */
static cln_status sum_up(const cln_view *view, silhouette *s)
{
    cln_status st = CLN_OK;
    const int w = view->camera.width, h = view->camera.height;

    s->camera = &view->camera;
    s->block = fmax(1, (double)(w > h ? w : h) / BLOCKS);
    s->across = (int)ceil(w / s->block);
    s->down = (int)ceil(h / s->block);
    CLN_TRY(cln_alloc(&s->sums, (size_t)(s->across + 1) * (size_t)(s->down + 1), sizeof *s->sums,
                      "silhouettes"));
    for (int y = 0; y < s->down && cln_view_is_here(view); y++) {
        uint32_t *above = s->sums + (size_t)y * (size_t)(s->across + 1);
        uint32_t *row = above + s->across + 1, line = 0;

        for (int x = 0; x < s->across; x++) {
            line += is_opaque(view, s, x, y);
            row[x + 1] = above[x + 1] + line;
        }
    }
    if (cln_ranks_count() > 1)
        cln_ranks_tell_from(view->rank, s->sums,
                            (size_t)(s->across + 1) * (size_t)(s->down + 1) * sizeof *s->sums);
done:
    return st;
}

static uint32_t opaque_blocks(const silhouette *s, int left, int top, int right, int bottom)
{
    const size_t row = (size_t)s->across + 1;

    return s->sums[(size_t)bottom * row + (size_t)right] -
           s->sums[(size_t)top * row + (size_t)right] -
           s->sums[(size_t)bottom * row + (size_t)left] + s->sums[(size_t)top * row + (size_t)left];
}

/* Where a point is in the picture; false if it is behind the camera. Beyond the lens's fold: where
 * a pinhole would have it, which is outside, too. */
static bool place(const cln_camera *c, const double point[3], double at[2])
{
    double z = 0, x[2] = {0, 0};

    if (cln_camera_project(c, point, &at[0], &at[1], &z))
        return true;
    if (z <= 0)
        return false;
    for (int a = 0; a < 3; a++)
        for (int k = 0; k < 2; k++)
            x[k] += c->c2w[4 * a + k] * (point[a] - c->c2w[4 * a + 3]);
    at[0] = c->cx + c->fx * x[0] / z;
    at[1] = c->cy + c->fy * x[1] / z;
    return true;
}

/* Where the cell is in the picture, rather too large; false if not all of it is before the camera.
 * *behind: none of it is. */
static bool find_place(const cln_camera *c, const double centre[3], const double half[3],
                       double low[2], double high[2], bool *behind)
{
    int before = 0;

    for (int a = 0; a < 2; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
    }
    for (int corner = 0; corner < 8; corner++) {
        double point[3], at[2] = {0, 0};

        for (int a = 0; a < 3; a++)
            point[a] = centre[a] + (corner >> a & 1 ? half[a] : -half[a]);
        before += place(c, point, at);
        for (int a = 0; a < 2; a++) {
            low[a] = fmin(low[a], at[a]);
            high[a] = fmax(high[a], at[a]);
        }
    }
    for (int a = 0; a < 2; a++) {
        const double more = BOWED * (high[a] - low[a]);

        low[a] -= more;
        high[a] += more;
    }
    *behind = before == 0;
    return before == 8;
}

typedef enum sight { AIR, OUTSIDE, SOMETHING } sight;

/* What the photo tells of the cell: that it is transparent there; that no part of the cell is in
 * the picture, or a part that is transparent; or that there may be something. */
static sight look_at(const silhouette *s, const double centre[3], const double half[3])
{
    const cln_camera *c = s->camera;
    double low[2], high[2];
    bool behind = false, whole = false;

    if (!find_place(c, centre, half, low, high, &behind))
        return behind ? OUTSIDE : SOMETHING;
    if (high[0] < 0 || high[1] < 0 || low[0] > c->width || low[1] > c->height)
        return OUTSIDE;
    whole = low[0] >= 0 && low[1] >= 0 && high[0] < c->width && high[1] < c->height;
    if (opaque_blocks(s, (int)(fmax(low[0], 0) / s->block), (int)(fmax(low[1], 0) / s->block),
                      (int)fmin(high[0] / s->block + 1, s->across),
                      (int)fmin(high[1] / s->block + 1, s->down)))
        return SOMETHING;
    return whole ? AIR : OUTSIDE;
}

/* Adds what is shown of a cell to the box. */
static void add_cell(hull *h, const double centre[3], const double half[3], int halvings)
{
    const double quarter[3] = {half[0] / 2, half[1] / 2, half[2] / 2};
    bool known = true;
    int outside = 0, air = 0;

    for (int a = 0; a < 3; a++)
        known = known && centre[a] - half[a] >= h->low[a] && centre[a] + half[a] <= h->high[a];
    if (known)
        return;
    for (int i = 0; i < h->count; i++)
        switch (look_at(&h->views[i], centre, half)) {
        case AIR:
            if (++air >= h->sure)
                return;
            break;
        case OUTSIDE:
            outside++;
            break;
        case SOMETHING:
            break;
        }
    if (h->count - outside < LEAST_VIEWS || 2 * outside > h->count)
        return;
    if (halvings > 0) {
        for (int child = 0; child < 8; child++) {
            double at[3];

            for (int a = 0; a < 3; a++)
                at[a] = centre[a] + (child >> a & 1 ? quarter[a] : -quarter[a]);
            add_cell(h, at, quarter, halvings - 1);
        }
        return;
    }
    for (int a = 0; a < 3; a++) {
        h->low[a] = fmin(h->low[a], centre[a] - half[a]);
        h->high[a] = fmax(h->high[a], centre[a] + half[a]);
    }
}

cln_status cln_scene_silhouette(const cln_scene *scene, const double box[6], double low[3],
                                double high[3], bool *any)
{
    cln_status st = CLN_OK;
    const int all = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    hull h = {.low = {INFINITY, INFINITY, INFINITY}, .high = {-INFINITY, -INFINITY, -INFINITY}};
    double within[6], was = 0, is = INFINITY;

    *any = false;
    memcpy(within, box, sizeof within);
    CLN_TRY(cln_alloc(&h.views, (size_t)all + 1, sizeof *h.views, "silhouettes"));
    for (int i = 0; i < all; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        silhouette *s = &h.views[h.count];

        if (view->channels != 4 || (cln_view_is_here(view) && !cln_view_is_loaded(view)))
            continue;
        CLN_TRY(sum_up(view, s));
        if (opaque_blocks(s, 0, 0, s->across, s->down) > 0)
            h.count++;
        else { /* its mask failed */
            free(s->sums);
            s->sums = NULL;
        }
    }
    h.sure = h.count >= MANY ? 2 : 1;
    do {
        double centre[3], half[3];

        was = is = 0;
        for (int a = 0; a < 3; a++) {
            centre[a] = 0.5 * (within[a] + within[3 + a]);
            half[a] = 0.5 * (within[3 + a] - within[a]);
            was = fmax(was, half[a]);
            h.low[a] = INFINITY;
            h.high[a] = -INFINITY;
        }
        if (h.count >= LEAST_VIEWS)
            add_cell(&h, centre, half, HALVINGS);
        if (!(h.low[0] < h.high[0]))
            break;
        *any = true;
        for (int a = 0; a < 3; a++) {
            within[a] = h.low[a];
            within[3 + a] = h.high[a];
            is = fmax(is, 0.5 * (h.high[a] - h.low[a]));
        }
    } while (is < COARSE * was);
    memcpy(low, within, 3 * sizeof *low);
    memcpy(high, within + 3, 3 * sizeof *high);
done:
    for (int i = 0; i < all && h.views; i++)
        free(h.views[i].sums);
    free(h.views);
    return st;
}
