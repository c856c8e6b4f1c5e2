/* See photos.h. */
#include "scene/photos.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include "base/text.h"
#include "ranks/ranks.h"

static const float STRONG = 6;       /* gradients that count, of 255 */
enum { ONE_COLOUR = 10, SIDE = 64 }; /* levels, at most; pixels of a side looked at */

static float grey(const cln_view *view, int x, int y)
{
    uint8_t p[4];

    cln_view_bytes(view, x, y, p);
    return 0.299f * p[0] + 0.587f * p[1] + 0.114f * p[2];
}

static double sharpness(const cln_view *view)
{
    const int wide = view->camera.width, high = view->camera.height;
    const int step = wide > 1200 || high > 1200 ? 2 : 1; /* every second row is enough */
    double bends = 0, slopes = 0;

    for (int y = 1; y < high - 1; y += step)
        for (int x = 1; x < wide - 1; x++) {
            const float here = grey(view, x, y);
            const float left = grey(view, x - 1, y), right = grey(view, x + 1, y);
            const float above = grey(view, x, y - 1), below = grey(view, x, y + 1);
            const float slope = .5f * hypotf(right - left, below - above);

            if (slope < STRONG || !cln_view_keeps(view, x, y))
                continue;
            bends += (double)fabsf(left + right + above + below - 4 * here);
            slopes += (double)slope;
        }
    return slopes > 0 ? bends / slopes : NAN;
}

void cln_photo_measure(const cln_view *view, cln_photo *out)
{
    const int wide = view->camera.width, high = view->camera.height;
    float mean = 0, square = 0;

    memset(out, 0, sizeof *out);
    for (int cell = 0; cell < CLN_THUMB * CLN_THUMB; cell++) {
        const int i = cell % CLN_THUMB, k = cell / CLN_THUMB;
        const int x1 = (i + 1) * wide / CLN_THUMB, y1 = (k + 1) * high / CLN_THUMB;
        float sum = 0;
        int count = 0;

        for (int y = k * high / CLN_THUMB; y < y1; y++)
            for (int x = i * wide / CLN_THUMB; x < x1; x++) {
                sum += grey(view, x, y);
                count++;
            }
        out->thumb[cell] = count ? sum / (float)count / 255 : 0;
        mean += out->thumb[cell] / (CLN_THUMB * CLN_THUMB);
        square += out->thumb[cell] * out->thumb[cell] / (CLN_THUMB * CLN_THUMB);
    }
    out->mean = mean;
    out->contrast = sqrtf(fmaxf(square - mean * mean, 0));
    out->sharpness = sharpness(view);
}

bool cln_photo_is_blank(const cln_view *view)
{
    const int wide = view->camera.width, high = view->camera.height;
    uint8_t low[3] = {255, 255, 255}, top[3] = {0};
    int seen = 0;

    if (view->channels == 4 || !cln_view_is_loaded(view))
        return false;
    for (int k = 0; k < SIDE * SIDE; k++) {
        const int x = (int)((2 * (k % SIDE) + 1) * (int64_t)wide / (2 * SIDE));
        const int y = (int)((2 * (k / SIDE) + 1) * (int64_t)high / (2 * SIDE));
        uint8_t p[4];

        if (!cln_view_keeps(view, x, y))
            continue;
        cln_view_bytes(view, x, y, p);
        seen++;
        for (int c = 0; c < 3; c++) {
            low[c] = p[c] < low[c] ? p[c] : low[c];
            top[c] = p[c] > top[c] ? p[c] : top[c];
            if (top[c] - low[c] > ONE_COLOUR)
                return false;
        }
    }
    return seen > 0;
}

bool cln_scene_has_blank(const cln_scene *scene, char text[CLN_BLANK_BYTES])
{
    cln_listed blank = {0};

    for (int i = 0; i < scene->view_count; i++)
        if (cln_photo_is_blank(&scene->views[i]))
            cln_listed_add(&blank, 5, "%s", scene->views[i].name);
    snprintf(text, CLN_BLANK_BYTES,
             "%d of %d photos %s one colour alone, as of a camera that failed: %s. Leave %s out, "
             "as %s that all is of that colour",
             blank.count, scene->view_count, cln_plural(blank.count, "shows", "show"), blank.text,
             cln_plural(blank.count, "it", "them"),
             cln_plural(blank.count, "it teaches", "they teach"));
    return blank.count > 0 &&
           2 * blank.count <= scene->view_count; /* of more, it is what they are to show */
}

/* Widens the range of colours, [3] negated lowest and [3] highest levels, by the view's pixels that
 * count, until it is wider than one colour. */
static void add_colours(const cln_view *view, double range[6])
{
    for (int y = 0; y < view->camera.height; y++)
        for (int x = 0; x < view->camera.width; x++) {
            uint8_t p[4];

            if (!cln_view_keeps(view, x, y))
                continue;
            cln_view_bytes(view, x, y, p);
            for (int c = 0; c < 3; c++) {
                range[c] = fmax(range[c], -p[c]);
                range[3 + c] = fmax(range[3 + c], p[c]);
                if (range[c] + range[3 + c] > ONE_COLOUR)
                    return;
            }
        }
}

cln_status cln_scene_check_shown(const cln_scene *scene)
{
    enum { ALPHA = 6, SHOWN, FOUND };
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double found[FOUND] = {-256, -256, -256, 0, 0, 0, 0, 0}; /* of all ranks */

    for (int i = 0; i < views; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);

        if (!cln_view_is_loaded(view) || found[SHOWN] > 0)
            continue;
        if (view->channels == 4)
            found[ALPHA] = 1;
        if (view->channels == 4 ? view->most_alpha != 1 : scene->has_alpha || view->depth.depth)
            found[SHOWN] = 1; /* depths tell a shape */
        else if (view->channels != 4)
            add_colours(view, found);
        for (int c = 0; c < 3; c++)
            if (found[c] + found[3 + c] > ONE_COLOUR)
                found[SHOWN] = 1;
    }
    cln_ranks_largest(found, FOUND);
    if (found[SHOWN] > 0)
        return CLN_OK;
    if (found[ALPHA] > 0)
        return cln_fail(CLN_INPUT,
                        "%s: alpha is 0 everywhere in all of %d training photos, so there is "
                        "nothing to learn; make their masks anew, or leave alpha out of the photos",
                        scene->folder, views);
    for (int c = 0; c < 3; c++)
        if (found[c] + found[3 + c] < 0 || found[c] + found[3 + c] > ONE_COLOUR)
            return CLN_OK;
    return cln_fail(CLN_INPUT,
                    "%s: all of %d training photos show one colour alone (%.0f,%.0f,%.0f of 255, "
                    "give or take %d), so there is nothing to learn; take them anew, or, if they "
                    "are of 16 bits, stretch all from their lowest to their highest value first, "
                    "(v - low) / (high - low)",
                    scene->folder, views, (found[3] - found[0]) / 2, (found[4] - found[1]) / 2,
                    (found[5] - found[2]) / 2, (ONE_COLOUR + 1) / 2);
}

double cln_photo_difference(const cln_photo *a, const cln_photo *b)
{
    double sum = 0;

    for (int i = 0; i < CLN_THUMB * CLN_THUMB; i++)
        sum += pow((double)a->thumb[i] - (double)b->thumb[i], 2);
    return sqrt(sum / (CLN_THUMB * CLN_THUMB));
}
