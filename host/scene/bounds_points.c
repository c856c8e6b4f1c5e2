/* The box of a scene whose sparse points are known: the middle 98 % of the points along each axis,
 * of those that three or more images show, and a tenth more; and the middle 90 % of what the
 * corners of the images show, at the depth of the points near them. So it holds what pixels are
 * trained on; cameras may be outside, and a few points far away, or images that see the horizon,
 * change little. */
#include <math.h>
#include <stdlib.h>
#include "base/memory.h"
#include "base/number.h"
#include "scene/build.h"

/* Shares left out and added at either end of an axis; the fewest points that tell something; the
 * most points and views that are used, and the points that tell a corner's depth. */
static const double OUTLIERS = 0.01, MARGIN = 0.1, CORNERS_LEFT_OUT = 0.05;
static const double STEEPEST = 0.3; /* cosine to the optical axis */
enum { LEAST_POINTS = 20, MOST_POINTS = 10000, MOST_VIEWS = 200, NEAREST = 5 };

/* The value below which this share of the sorted values lies. */
static double share_of(const double *sorted, int count, double share)
{
    return sorted[(int)(share * (count - 1) + 0.5)];
}

/* The middle 98 % of the points along each axis, and a tenth of that on either side. */
static void box_of_points(const cln_point *const *points, int count, double *values, double low[3],
                          double high[3])
{
    for (int a = 0; a < 3; a++) {
        double margin = 0;

        for (int i = 0; i < count; i++)
            values[i] = points[i]->xyz[a];
        cln_reals_sort(values, count);
        low[a] = share_of(values, count, OUTLIERS);
        high[a] = share_of(values, count, 1 - OUTLIERS);
        margin = MARGIN * (high[a] - low[a]);
        low[a] -= margin;
        high[a] += margin;
    }
}

/* Median depth of the NEAREST points that are nearest to (u, v) in the image; 0 if it shows
 * fewer. */
static double depth_near(const cln_point *const *points, int count, const cln_camera *camera,
                         double u, double v)
{
    double depths[NEAREST], distances[NEAREST];
    int found = 0;

    for (int i = 0; i < count; i++) {
        double at[2], z, distance = 0;
        int place = found;

        if (!cln_camera_project(camera, points[i]->xyz, &at[0], &at[1], &z) || z <= 0 ||
            at[0] < 0 || at[1] < 0 || at[0] >= camera->width || at[1] >= camera->height)
            continue;
        distance = hypot(at[0] - u, at[1] - v);
        for (; place > 0 && distances[place - 1] > distance; place--) /* insertion */
            if (place < NEAREST) {
                distances[place] = distances[place - 1];
                depths[place] = depths[place - 1];
            }
        if (place < NEAREST) {
            distances[place] = distance;
            depths[place] = z;
            found += found < NEAREST;
        }
    }
    if (found < NEAREST)
        return 0;
    cln_reals_sort(depths, NEAREST);
    return depths[NEAREST / 2];
}

/* Widens the box by what the corners of the training images show. */
static cln_status hold_corners(const cln_scene *scene, const cln_point *const *points, int count,
                               double low[3], double high[3])
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    const int step = (views + MOST_VIEWS - 1) / MOST_VIEWS;
    double *places[3] = {0};
    int found = 0;

    for (int a = 0; a < 3; a++)
        CLN_TRY(cln_alloc(&places[a], 4 * MOST_VIEWS, sizeof *places[a], "corners"));
    for (int corner = 0; corner < 4 * views; corner += corner % 4 == 3 ? 4 * step - 3 : 1) {
        const cln_camera *camera = &scene->views[corner / 4].camera;
        const double u = corner % 2 ? camera->width : 0, v = corner / 2 % 2 ? camera->height : 0;
        double o[3], d[3], along = 0, depth = 0;

        if (!cln_camera_ray(camera, u, v, o, d))
            continue;
        for (int a = 0; a < 3; a++)
            along += d[a] * camera->c2w[4 * a + 2];
        if (along > STEEPEST) /* else a wide lens, whose corners look past the scene */
            depth = depth_near(points, count, camera, u, v);
        if (depth > 0) {
            for (int a = 0; a < 3; a++)
                places[a][found] = o[a] + d[a] * depth / along;
            found++;
        }
    }
    for (int a = 0; a < 3 && found; a++) {
        cln_reals_sort(places[a], found);
        low[a] = fmin(low[a], share_of(places[a], found, CORNERS_LEFT_OUT));
        high[a] = fmax(high[a], share_of(places[a], found, 1 - CORNERS_LEFT_OUT));
    }
done:
    for (int a = 0; a < 3; a++)
        free(places[a]);
    return st;
}

static bool counts(const cln_reader_result *result, int i, int least)
{
    return result->points[i].views >= least && !(result->dropped && result->dropped[i]);
}

/* Of the points that three images show, or of all where these are few: every n-th, so that there
 * are at most MOST_POINTS. Returns their number. */
static int choose_points(const cln_reader_result *result, const cln_point **out)
{
    int sure = 0, met = 0, count = 0, least = 3;

    for (int i = 0; i < result->point_count; i++)
        sure += counts(result, i, least);
    if (sure < LEAST_POINTS) {
        least = 0;
        sure = result->point_count - result->dropped_count;
    }
    for (int i = 0; i < result->point_count; i++)
        if (counts(result, i, least) && met++ % (sure / MOST_POINTS + 1) == 0)
            out[count++] = &result->points[i];
    return count;
}

cln_status cln_scene_box_of_points(const cln_scene *scene, const cln_reader_result *result,
                                   double low[3], double high[3], bool *found)
{
    cln_status st = CLN_OK;
    const cln_point **points = NULL;
    double *values = NULL;
    int count = 0;

    *found = result->point_count - result->dropped_count >= LEAST_POINTS;
    if (!*found)
        return CLN_OK;
    CLN_TRY(cln_alloc(&points, MOST_POINTS, sizeof *points, "points"));
    CLN_TRY(cln_alloc(&values, MOST_POINTS, sizeof *values, "points"));
    count = choose_points(result, points);
    box_of_points(points, count, values, low, high);
    CLN_TRY(hold_corners(scene, points, count, low, high));
done:
    free(points);
    free(values);
    return st;
}
