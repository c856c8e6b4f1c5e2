/* What the alpha of photos tells besides their background.
 *   where the scene is (silhouette.c): whether a cube that was guessed from the cameras is much too
 *     large. And whether the cube is beside it or cuts it: then rays through opaque pixels miss it.
 *   whether colours were multiplied by it: then none exceeds it, in any pixel of any photo. */
#include "scene/build.h"
#include "scene/dealt.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "scene/inspect.h"

enum { GRID = 48 }; /* rays of a photo along an axis */
/* Half transparent pixels of a photo; a colour of some opaque one. */
enum { SOFT = 8, BRIGHT = 64 };
static const double WIDE = 0.6; /* share of the cube's side, from which it is wide enough */
static const double MET = 0.5;  /* share of the object's rays, from which the cube is not beside */
static const double LOST = 0.005;  /* share of them that may miss it: masks have specks */
static const double MARGIN = 0.01; /* of a box, to either side */
static const double SPARE = 0.1;   /* likewise, where it is taken unasked: a mask may lack a part */

/* The box that photos' silhouettes leave of this one, a little wider; false: there is none. */
static bool narrow(const cln_scene *scene, const double within[6], double box[6])
{
    bool any = false;

    if (cln_scene_silhouette(scene, within, box, box + 3, &any) != CLN_OK)
        cln_clear_error(); /* a sentence less */
    for (int a = 0; a < 3 && any; a++) {
        const double more = MARGIN * (box[3 + a] - box[a]);

        box[a] -= more;
        box[3 + a] += more;
    }
    return any;
}

bool cln_scene_shown_box(const cln_scene *scene, double box[6])
{
    const cln_space *space = &scene->space;
    double cube[6];

    if (!scene->has_alpha || space->forward || space->shell)
        return false;
    for (int a = 0; a < 3; a++) {
        cube[a] = space->centre[a] - space->half;
        cube[3 + a] = space->centre[a] + space->half;
    }
    return narrow(scene, cube, box);
}

cln_status cln_scene_narrow_cube(cln_scene *scene, char text[CLN_BOX_BYTES])
{
    cln_status st = CLN_OK;
    const double before = scene->space.half;
    double box[6], side = 0, least = INFINITY;

    text[0] = 0;
    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++)
        if (cln_view_is_here(cln_scene_training_view(scene, i)) &&
            !cln_view_is_loaded(cln_scene_training_view(scene, i)))
            goto done;
    if (!scene->cube_guessed || !cln_scene_shown_box(scene, box))
        goto done;
    for (int a = 0; a < 3; a++) {
        const double more = SPARE * (box[3 + a] - box[a]);

        box[a] -= more;
        box[3 + a] += more;
        side = fmax(side, box[3 + a] - box[a]);
        least = fmin(least, box[3 + a] - box[a]);
    }
    if (side > WIDE * 2 * before)
        goto done;
    cln_box_write(box, least, text);
    CLN_TRY(cln_scene_take_box(scene, text));
    cln_info("%s: a box around what the photos' alpha shows, and a tenth more, as cameras alone "
             "tell a cube %.*f times as wide: --bbox=%s",
             scene->folder, before < 10 * scene->space.half ? 1 : 0, before / scene->space.half,
             text);
done:
    return st;
}

/* Of grid pixels of loaded training photos that are opaque: how many, and how many of their rays
 * meet the cube; the largest distance of one from `focus`. */
static void count_met(const cln_scene *scene, const double focus[3], int *opaque, int *met,
                      double *radius)
{
    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        const cln_camera *c = &view->camera;

        if (view->channels != 4 || !cln_view_is_loaded(view))
            continue;
        for (int k = 0; k < GRID * GRID; k++) {
            const int x = (2 * (k % GRID) + 1) * c->width / (2 * GRID);
            const int y = (2 * (k / GRID) + 1) * c->height / (2 * GRID);
            double o[3], d[3], along = 0, square = 0;
            uint8_t rgba[4];

            cln_view_bytes(view, x, y, rgba);
            if (rgba[3] < 128 || !cln_camera_ray(c, x + 0.5, y + 0.5, o, d))
                continue;
            (*opaque)++;
            *met += cln_space_met_by(&scene->space, o, d);
            for (int a = 0; a < 3; a++)
                along += (focus[a] - o[a]) * d[a];
            for (int a = 0; a < 3; a++)
                square += pow(o[a] + along * d[a] - focus[a], 2);
            *radius = fmax(*radius, sqrt(square));
        }
    }
}

void cln_scene_tell_missed(const cln_scene *scene, json_t *findings)
{
    double focus[3], around[6], narrowed[6], box[6], radius = 0;
    int opaque = 0, met = 0;
    char text[512], box_text[CLN_BOX_BYTES];

    if (!scene->has_alpha || scene->space.forward || scene->space.shell ||
        !cln_scene_focus(scene, focus))
        return;
    count_met(scene, focus, &opaque, &met, &radius);
    if (opaque == 0 || opaque - met <= LOST * opaque)
        return;
    for (int a = 0; a < 3; a++) { /* rays pass a point nearer than it is, if none is square to it */
        around[a] = focus[a] - 2 * radius;
        around[3 + a] = focus[a] + 2 * radius;
        box[a] = focus[a] - radius;
        box[3 + a] = focus[a] + radius;
    }
    if (narrow(scene, around, narrowed))
        memcpy(box, narrowed, sizeof box);
    cln_box_write(box, box[3] - box[0], box_text);
    if (met < MET * opaque)
        snprintf(text, sizeof text,
                 "only %.0f%% of the rays through what the photos' alpha shows meet the cube "
                 "(half side %g; %s): the object lies beside it. A box around the object",
                 100.0 * met / opaque, scene->space.half, scene->bounds_rule);
    else
        snprintf(text, sizeof text,
                 "%.1f%% of the rays through what the photos' alpha shows miss the cube (half side "
                 "%g; %s), so what they show is cut off. A box around all of it",
                 100.0 * (opaque - met) / opaque, scene->space.half, scene->bounds_rule);
    cln_found_fault(findings, "cube", met < MET * opaque, NULL, "%s: --bbox=%s", text, box_text);
}

enum { NAMED = 5 };

bool cln_scene_is_empty(const cln_scene *scene, char text[CLN_EMPTY_BYTES])
{
    enum { LABELS = 16 };
    cln_listed empty = {0};
    int views = 0, largest = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const int alpha = view->most_alpha - 1;

        if (view->channels != 4 || alpha < 0)
            continue;
        largest = alpha > largest ? alpha : largest;
        views++;
        if (alpha == 0)
            cln_listed_add(&empty, NAMED, "'%s'", view->name);
    }
    if (views > 0 && largest < LABELS)
        snprintf(text, CLN_EMPTY_BYTES,
                 "alpha is at most %d of 255 in all of %d photos, so they show nothing. If it "
                 "is labels, not opacity, write 255 where the object is",
                 largest, views);
    else if (empty.count > 0)
        snprintf(text, CLN_EMPTY_BYTES,
                 "of %d of %d photos alpha shows nothing: %s. If their masks failed, leave "
                 "them out, as they teach that nothing is there",
                 empty.count, views, empty.text);
    return views > 0 && (largest < LABELS || empty.count > 0);
}

/* Share of the view's pixels that its mask leaves. */
static double left_by_mask(const cln_view *view)
{
    const size_t count = (size_t)view->camera.width * (size_t)view->camera.height;
    double left = 0;

    for (size_t k = 0; k < (count + 7) / 8; k++)
        left += __builtin_popcount(view->masked[k]);
    return left / (double)count;
}

bool cln_scene_is_whole(const cln_scene *scene, char text[CLN_EMPTY_BYTES])
{
    const double few = 0.25; /* of the photos: more are as they should be */
    cln_listed whole = {0};
    double left = 0; /* by the masks that are not whole */
    int views = 0, masks = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const double share = view->masked ? left_by_mask(view) : 0;

        if (!view->masked && (view->channels != 4 || view->most_alpha == 0))
            continue;
        views++;
        if (view->masked ? share == 1 : !view->hides) {
            cln_listed_add(&whole, NAMED, "'%s'", view->name);
            continue;
        }
        masks += view->masked != NULL;
        left += share;
    }
    if (whole.count == 0 || whole.count > few * views || left > CLN_MASKS_LEAVE * masks)
        return false;
    if (masks && !scene->masks_doubtful)
        return false; /* of what is to be ignored: many a photo has none of it */
    snprintf(text, CLN_EMPTY_BYTES,
             "of %d of %d photos %s hides nothing: %s. If %s failed, leave them out, as they teach "
             "that what is around the object is part of it%s",
             whole.count, views, masks ? "the mask" : "alpha", whole.text,
             masks ? "the masks are of an object, these" : "their masks",
             masks ? "; if masks hide what is to be ignored, all is well" : "");
    return true;
}

cln_status cln_scene_find_reversed(const cln_scene *scene, char text[CLN_EMPTY_BYTES])
{
    cln_status st = CLN_OK;
    const double few = 0.25, most = 0.5; /* of the photos: reversed ones, and sound ones */
    const double all = 0.9, known = 0.75;
    cln_listed reversed = {0}, straight = {0};
    uint8_t *shapes = NULL;
    int views = 0, sound = 0;

    text[0] = 0;
    if (!scene->has_alpha || scene->store)
        return CLN_OK;
    CLN_TRY(cln_alloc(&shapes, (size_t)scene->view_count, sizeof *shapes, "masks"));
    CLN_TRY(cln_alpha_shapes(scene, shapes));
    for (int i = 0; i < scene->view_count; i++) {
        views += shapes[i] != CLN_ALPHA_NONE;
        sound += shapes[i] == CLN_ALPHA_OBJECT;
        if (shapes[i] == CLN_ALPHA_OBJECT)
            cln_listed_add(&straight, NAMED, "'%s'", scene->views[i].name);
        if (shapes[i] == CLN_ALPHA_REVERSED)
            cln_listed_add(&reversed, NAMED, "'%s'", scene->views[i].name);
    }
    if (reversed.count > 0 &&
        ((reversed.count <= few * views && sound >= most * views) ||
         (reversed.count <= sound && reversed.count + sound >= known * views)))
        snprintf(text, CLN_EMPTY_BYTES,
                 "of %d of %d photos %s the object and shows what is around it: %s. Likely black "
                 "and white are exchanged there: invert %s",
                 reversed.count, views, scene->masks_alpha ? "the mask hides" : "alpha hides",
                 reversed.text, scene->masks_alpha ? "these masks" : "it");
    else if (sound > 0 && reversed.count > sound && reversed.count < all * views &&
             reversed.count + sound >= known * views)
        snprintf(text, CLN_EMPTY_BYTES,
                 "%s what is around the object in %d of %d photos, and the object in %d: %s. "
                 "Likely black and white are exchanged in the former: invert %s",
                 scene->masks_alpha ? "the mask shows" : "alpha shows", reversed.count, views,
                 sound, straight.text,
                 scene->masks_alpha ? "them, or the latter and read all with --masks inverted"
                                    : "it there");
    else if (views > 2 && reversed.count >= all * views)
        snprintf(text, CLN_EMPTY_BYTES,
                 "%s one part around the middle of %s %d photos, and shows what is around it. "
                 "Likely black and white are exchanged: invert %s",
                 scene->masks_alpha ? "the mask hides" : "alpha hides",
                 reversed.count == views ? "all" : "nearly all", views,
                 scene->masks_alpha ? "the masks (--masks inverted reads them so)"
                                    : "alpha (mogrify -channel A -negate, of ImageMagick)");
done:
    free(shapes);
    return st;
}

/* Counts a loaded view's half transparent pixels; false at one with a colour above its alpha. */
static bool is_multiplied(const cln_view *view, double *soft, int *brightest)
{
    for (int y = 0; y < view->camera.height; y++)
        for (int x = 0; x < view->camera.width; x++) {
            uint8_t p[4];

            cln_view_bytes(view, x, y, p);
            for (int c = 0; c < 3; c++) {
                if (p[c] > p[3])
                    return false;
                *brightest = p[c] > *brightest ? p[c] : *brightest;
            }
            *soft += p[3] > 0 && p[3] < 255;
        }
    return true;
}

bool cln_scene_is_multiplied(const cln_scene *scene, char text[CLN_EMPTY_BYTES])
{
    double soft = 0;
    int brightest = 0, views = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        if (view->channels != 4 || !cln_view_is_loaded(view))
            continue;
        views++;
        if (!is_multiplied(view, &soft, &brightest))
            return false;
    }
    snprintf(text, CLN_EMPTY_BYTES,
             "no colour exceeds its pixel's alpha in any of %d photos, as if colours were "
             "multiplied by it. They are read as straight alpha: edges get dark rims if they were. "
             "--multiplied-alpha divides them by it",
             views);
    return views > 0 && soft >= SOFT * (double)views && brightest >= BRIGHT;
}
