/* Depths of training pixels by points from structure from motion: each training view in which a
 * point was found gets a sight, at the point's projection. A point counts only if it was found in
 * two training views or more, so none comes from held-out views alone. A point's trust is that of
 * DS-NeRF (arXiv 2107.02791): exp(-(e / m)^2), with its reprojection error e and the mean m of all
 * errors. */
#include <math.h>
#include <stdlib.h>
#include "base/memory.h"
#include "ranks/ranks.h"
#include "scene/build.h"

enum { RANKS_COUNT = 1 << 16 };      /* numbers that processes compare at once */
enum { NO_VIEW = -1, SEVERAL = -2 }; /* in place of a point's only training view */

/* Maps the reader's numbers of views to indices of training views; other views get NO_VIEW. The
 * caller frees *out. */
static cln_status number_views(const cln_scene *scene, int **out)
{
    cln_status st = CLN_OK;
    const int all = scene->view_count + scene->missing;

    CLN_TRY(cln_alloc(out, (size_t)all, sizeof **out, "views"));
    for (int i = 0; i < all; i++)
        (*out)[i] = NO_VIEW;
    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++) {
        const int view = cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i);

        (*out)[scene->views[view].number] = view;
    }
done:
    return st;
}

/* Finds the pixel that shows the sight's point; false, and -1, if there is none. */
static bool place(const cln_scene *scene, cln_sight *sight)
{
    const cln_view *view = &scene->views[sight->view];
    double u, v;

    if (sight->z > 0) {
        double o[3], d[3], along = 0;

        if (!cln_camera_ray(&view->camera, sight->x + 0.5, sight->y + 0.5, o, d))
            return false;
        for (int a = 0; a < 3; a++)
            along += d[a] * view->camera.c2w[4 * a + 2];
        for (int a = 0; a < 3; a++)
            sight->point[a] = o[a] + d[a] * (double)sight->z / along;
        return true;
    }
    sight->x = sight->y = -1;
    if (!cln_camera_shows(&view->camera, sight->point, &u, &v))
        return false;
    sight->x = (int)u;
    sight->y = (int)v;
    return true;
}

void cln_scene_place_sights(cln_scene *scene)
{
    for (int64_t i = 0; i < scene->sight_count; i++)
        (void)place(scene, &scene->sights[i]);
}

/* Which sights' pixels show something, by every process's own photos; *shown [sights], 1: it does.
 */
static cln_status find_shown(const cln_scene *scene, double **shown)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(shown, (size_t)scene->sight_count, sizeof **shown, "depths of points"));
    for (int64_t i = 0; i < scene->sight_count; i++) {
        const cln_sight *sight = &scene->sights[i];
        const cln_view *view = &scene->views[sight->view];
        uint8_t p[4] = {0, 0, 0, 255};

        if (!cln_view_is_loaded(view) ||
            (sight->x >= 0 && !cln_view_keeps(view, sight->x, sight->y)))
            continue;
        if (sight->x >= 0)
            cln_view_bytes(view, sight->x, sight->y, p);
        (*shown)[i] = view->channels < 4 || p[3] >= 128;
    }
    for (int64_t from = 0; from < scene->sight_count; from += RANKS_COUNT)
        cln_ranks_largest(*shown + from,
                          (int)fmin(RANKS_COUNT, (double)(scene->sight_count - from)));
done:
    return st;
}

cln_status cln_scene_clear_sights(cln_scene *scene)
{
    cln_status st = CLN_OK;
    double *shown = NULL;
    int64_t left = 0, by_images = scene->sight_count - scene->depth_sights;

    if (scene->sight_count == 0)
        return CLN_OK;
    CLN_TRY(find_shown(scene, &shown));
    scene->depth_sights = 0;
    for (int64_t i = 0; i < scene->sight_count; i++) {
        if (shown[i] <= 0)
            continue;
        scene->depth_sights += i >= by_images;
        scene->sights[left++] = scene->sights[i];
    }
    scene->sight_count = left;
done:
    free(shown);
    return st;
}

static double mean_error(const cln_reader_result *result)
{
    double sum = 0;
    int count = 0;

    for (int i = 0; i < result->point_count; i++) {
        sum += (double)result->points[i].error;
        count += result->points[i].error > 0;
    }
    return count ? sum / count : 1;
}

cln_status cln_scene_find_sights(cln_scene *scene, const cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const double mean = mean_error(result);
    int *view_of = NULL, *only = NULL;

    if (result->observation_count == 0)
        return CLN_OK;
    CLN_TRY(number_views(scene, &view_of));
    CLN_TRY(cln_alloc(&only, (size_t)result->point_count, sizeof *only, "points"));
    CLN_TRY(cln_alloc(&scene->sights, (size_t)result->observation_count, sizeof *scene->sights,
                      "depths of points"));
    for (int i = 0; i < result->point_count; i++)
        only[i] = NO_VIEW;
    for (int64_t i = 0; i < result->observation_count; i++) {
        const cln_observation *o = &result->observations[i];
        const int view = view_of[o->view];

        if (view != NO_VIEW && only[o->point] != view)
            only[o->point] = only[o->point] == NO_VIEW ? view : SEVERAL;
    }
    for (int64_t i = 0; i < result->observation_count; i++) {
        const cln_observation *o = &result->observations[i];
        const cln_point *point = &result->points[o->point];
        const double share = (double)point->error / mean;
        cln_sight sight = {.view = view_of[o->view],
                           .trust = (float)exp(-share * share),
                           .point = {point->xyz[0], point->xyz[1], point->xyz[2]}};

        if (sight.view != NO_VIEW && only[o->point] == SEVERAL && place(scene, &sight))
            scene->sights[scene->sight_count++] = sight;
    }
done:
    free(view_of);
    free(only);
    return st;
}
