/* What the alpha of photos tells besides their background.
 *   where the scene is: a point is empty if a training photo that sees it is transparent there.
 *     Looked at on a grid of points of the cube, so it is coarse; it only tells whether a cube that
 *     was guessed from the cameras is much too large. And whether the cube is beside it: then few
 *     rays through opaque pixels meet the cube.
 *   whether colours were multiplied by it: then none exceeds it, in any pixel of any photo. */
#include "scene/build.h"

#include <math.h>
#include <string.h>
#include "base/log.h"
#include "base/number.h"
#include "scene/inspect.h"

enum { GRID = 48, LEAST_VIEWS = 3 }; /* points along an axis; views that must see a point */
/* Half transparent pixels of a photo; a colour of some opaque one. */
enum { SOFT = 8, BRIGHT = 64 };
static const double WIDE = 0.6; /* share of the cube's side, from which it is wide enough */
static const double MET = 0.5;  /* share of the object's rays, from which the cube is not beside */

/* Is the point, in scene units, opaque in all photos that see it, which are enough? */
static bool is_shown(const cln_scene *scene, const double point[3])
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int seen = 0;

    for (int i = 0; i < views; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);
        const cln_camera *c = &view->camera;
        uint8_t rgba[4];
        double u = 0, v = 0, z = 0;

        if (!cln_camera_project(c, point, &u, &v, &z) || z <= 0 ||
            !(u >= 0 && u < c->width && v >= 0 && v < c->height))
            continue;
        cln_view_bytes(view, (int)u, (int)v, rgba);
        if (view->channels == 4 && rgba[3] == 0)
            return false;
        seen++;
    }
    return seen >= LEAST_VIEWS && 4 * seen >= 3 * views;
}

bool cln_scene_silhouette(const cln_scene *scene, double low[3], double high[3])
{
    const cln_space *space = &scene->space;
    const double cell = 2 * space->half / GRID;
    bool any = false;

    for (int a = 0; a < 3; a++) {
        low[a] = INFINITY;
        high[a] = -INFINITY;
    }
    for (int i = 0; i < GRID * GRID * GRID; i++) {
        const int at[3] = {i % GRID, i / GRID % GRID, i / GRID / GRID};
        double point[3];

        for (int a = 0; a < 3; a++)
            point[a] = space->centre[a] - space->half + (at[a] + 0.5) * cell;
        if (!is_shown(scene, point))
            continue;
        any = true;
        for (int a = 0; a < 3; a++) { /* what is thinner than a cell may end one farther */
            low[a] = fmin(low[a], point[a] - 1.5 * cell);
            high[a] = fmax(high[a], point[a] + 1.5 * cell);
        }
    }
    return any;
}

void cln_scene_warn_wide(const cln_scene *scene)
{
    double box[6], side = 0, least = INFINITY;
    int n = 0;

    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++)
        if (!cln_view_is_loaded(cln_scene_training_view(scene, i)))
            return;
    if (!scene->cube_guessed || !scene->has_alpha || scene->space.forward || scene->space.shell ||
        !cln_scene_silhouette(scene, box, box + 3))
        return;
    for (int a = 0; a < 3; a++) {
        side = fmax(side, box[3 + a] - box[a]);
        least = fmin(least, box[3 + a] - box[a]);
    }
    if (side > WIDE * 2 * scene->space.half)
        return;
    n = cln_reals_digits(6, box, least);
    cln_warn("%s: the cube is a guess (half side %g; %s), and what the photos' alpha shows spans "
             "%.0f%% of its side, so most voxels are empty and the others coarse. A tighter box: "
             "--bbox=%.*g,%.*g,%.*g,%.*g,%.*g,%.*g",
             scene->folder, scene->space.half, scene->bounds_rule,
             100 * side / (2 * scene->space.half), n, box[0], n, box[1], n, box[2], n, box[3], n,
             box[4], n, box[5]);
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
    double focus[3], radius = 0;
    int opaque = 0, met = 0, n = 0;

    if (!scene->has_alpha || scene->space.forward || scene->space.shell ||
        !cln_scene_focus(scene, focus))
        return;
    count_met(scene, focus, &opaque, &met, &radius);
    if (opaque == 0 || met >= MET * opaque)
        return;
    const double box[6] = {focus[0] - radius, focus[1] - radius, focus[2] - radius,
                           focus[0] + radius, focus[1] + radius, focus[2] + radius};

    n = cln_reals_digits(6, box, 2 * radius);
    cln_found_fault(findings, "cube", true, NULL,
                    "only %.0f%% of the rays through what the photos' alpha shows meet the cube "
                    "(half side %g; %s): the object lies beside it. A box around the object: "
                    "--bbox=%.*g,%.*g,%.*g,%.*g,%.*g,%.*g",
                    100.0 * met / opaque, scene->space.half, scene->bounds_rule, n, box[0], n,
                    box[1], n, box[2], n, box[3], n, box[4], n, box[5]);
}

bool cln_scene_is_empty(const cln_scene *scene, char text[CLN_EMPTY_BYTES])
{
    enum { LABELS = 16, NAMED = 5 };
    char names[512] = "";
    int views = 0, empty = 0, largest = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const int alpha = view->most_alpha - 1;

        if (view->channels != 4 || alpha < 0)
            continue;
        largest = alpha > largest ? alpha : largest;
        views++;
        if (alpha > 0)
            continue;
        if (empty++ < NAMED)
            snprintf(names + strlen(names), sizeof names - strlen(names), "%s'%s'",
                     names[0] ? ", " : "", view->name);
    }
    if (views > 0 && largest < LABELS)
        snprintf(text, CLN_EMPTY_BYTES,
                 "alpha is at most %d of 255 in all of %d photos, so they show nothing. If it "
                 "is labels, not opacity, write 255 where the object is",
                 largest, views);
    else if (empty > 0)
        snprintf(text, CLN_EMPTY_BYTES,
                 "of %d of %d photos alpha shows nothing: %s%s. If their masks failed, leave "
                 "them out, as they teach that nothing is there",
                 empty, views, names, empty > NAMED ? ", ..." : "");
    return views > 0 && (largest < LABELS || empty > 0);
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

void cln_scene_tell_multiplied(const cln_scene *scene, json_t *findings)
{
    double soft = 0;
    int brightest = 0, views = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        if (view->channels != 4 || !cln_view_is_loaded(view))
            continue;
        views++;
        if (!is_multiplied(view, &soft, &brightest))
            return;
    }
    if (views > 0 && soft >= SOFT * (double)views && brightest >= BRIGHT)
        cln_found_fault(findings, "alpha", false, NULL,
                        "no colour exceeds its pixel's alpha in any of %d photos, as if colours "
                        "were multiplied by it. They are read as straight alpha: edges get dark "
                        "rims if they were. Divide them by alpha, or save them without "
                        "premultiplication",
                        views);
}
