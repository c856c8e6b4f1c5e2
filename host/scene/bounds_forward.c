/* The forward space (space.h: normalised device coordinates) of a scene whose cameras all look one
 * way. The mean camera has their mean position, forward axis and down vector. The near plane lies
 * at NEAR times the depth of the nearest object along the mean axis, which the images' near depths
 * tell, or else the sparse points. The cube's sides hold what every training image shows from there
 * to infinity. */
#include "scene/build.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "scene/vectors.h"

enum { BORDER = 8 }; /* places of an image: its corners and the middles of its sides */
static const double NEAR = 0.9, MARGIN = 1.02;
static const double LEAST_COSINE = 0.2;     /* of a border's ray with the mean axis: 78 degrees */
static const double LEAST_COMMON = 0.7;     /* length of the mean of the forward axes */
static const double NEAREST_POINTS = 0.005; /* that share of the points may be outliers */

/* Sets centre and axes; false if the cameras look into different directions. */
static bool find_mean(const cln_scene *scene, cln_space *space)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double down[3] = {0}, *right = space->axes, *forward = space->axes + 6;

    memset(space, 0, sizeof *space);
    for (int i = 0; i < count; i++) {
        const double *m = cln_scene_training_view(scene, i)->camera.c2w;

        for (int a = 0; a < 3; a++) {
            space->centre[a] += m[4 * a + 3] / count;
            forward[a] += m[4 * a + 2] / count;
            down[a] += m[4 * a + 1] / count;
        }
    }
    if (!(cln_unit(forward) > LEAST_COMMON))
        return false;
    cln_cross(down, forward, right);
    if (!(cln_unit(right) > 1e-3)) { /* cameras are held in all ways: any axis will do */
        down[0] = fabs(forward[0]) < 0.9;
        down[1] = !down[0];
        down[2] = 0;
        cln_cross(down, forward, right);
        cln_unit(right);
    }
    cln_cross(forward, right, space->axes + 3);
    return true;
}

/* The ray at place k of an image's border, in the mean camera's frame, scene units; false if the
 * lens has none there. along: its part along the camera's own axis. */
static bool border_ray(const cln_space *space, const cln_camera *camera, int k, double o[3],
                       double d[3], double *along)
{
    static const double x[BORDER] = {0, 1, 0, 1, 0.5, 0.5, 0, 1};
    static const double y[BORDER] = {0, 0, 1, 1, 0, 1, 0.5, 0.5};
    const double *m = camera->c2w;
    double from[3], towards[3];

    if (!cln_camera_ray(camera, x[k] * camera->width, y[k] * camera->height, from, towards))
        return false;
    *along = towards[0] * m[2] + towards[1] * m[6] + towards[2] * m[10];
    for (int a = 0; a < 3; a++)
        from[a] -= space->centre[a];
    for (int a = 0; a < 3; a++) {
        o[a] = cln_dot(space->axes + 3 * a, from);
        d[a] = cln_dot(space->axes + 3 * a, towards);
    }
    return true;
}

/* The depth of the nearest object along the mean axis, by the images' near depths; NaN if an image
 * has none. *aside: the name of a view with a border that does not look forward, or NULL. */
static double nearest_told(const cln_scene *scene, const cln_space *space, const char **aside)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double nearest = INFINITY;

    *aside = NULL;
    for (int i = 0; i < BORDER * count; i++) {
        const cln_view *view = cln_scene_training_view(scene, i / BORDER);
        double o[3], d[3], along = 0;

        if (!border_ray(space, &view->camera, i % BORDER, o, d, &along))
            continue;
        if (d[2] < LEAST_COSINE)
            *aside = view->name;
        if (!(view->far > 0))
            nearest = NAN;
        else if (along > 0 && !isnan(nearest))
            nearest = fmin(nearest, o[2] + view->near / along * d[2]);
    }
    return nearest;
}

/* The same by the points; NaN if there are none. */
static cln_status nearest_point(const cln_space *space, const cln_reader_result *result,
                                double *nearest)
{
    cln_status st = CLN_OK;
    double *depths = NULL;

    *nearest = NAN;
    if (result->point_count == 0)
        return CLN_OK;
    CLN_TRY(cln_alloc(&depths, (size_t)result->point_count, sizeof *depths, "points"));
    for (int i = 0; i < result->point_count; i++) {
        double from[3];

        for (int a = 0; a < 3; a++)
            from[a] = result->points[i].xyz[a] - space->centre[a];
        depths[i] = cln_dot(space->axes + 6, from);
    }
    cln_reals_sort(depths, result->point_count);
    *nearest = depths[(int)(NEAREST_POINTS * (result->point_count - 1))];
done:
    free(depths);
    return st;
}

/* The sides: a ray's tangents are largest where it begins or at infinity. */
static void find_sides(const cln_scene *scene, cln_space *space)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double most[2] = {0, 0};

    for (int i = 0; i < BORDER * count; i++) {
        double o[3], d[3], along = 0, z = 0;

        if (!border_ray(space, &cln_scene_training_view(scene, i / BORDER)->camera, i % BORDER, o,
                        d, &along))
            continue;
        z = fmax(space->half, o[2]);
        for (int a = 0; a < 2; a++) {
            most[a] = fmax(most[a], fabs(o[a] + (z - o[2]) / d[2] * d[a]) / z);
            most[a] = fmax(most[a], fabs(d[a] / d[2]));
        }
    }
    for (int a = 0; a < 2; a++)
        space->scale[a] = 1 / (MARGIN * most[a]);
}

cln_status cln_scene_find_forward(const cln_scene *scene, const cln_reader_result *result,
                                  cln_space *out, char **because, char refused[CLN_REFUSED_BYTES])
{
    cln_status st = CLN_OK;
    cln_space space;
    const char *aside = NULL, *source = "the images' near depths";
    double nearest = 0;

    refused[0] = 0;
    if (!find_mean(scene, &space)) {
        snprintf(refused, CLN_REFUSED_BYTES, "the training cameras do not look one way");
        goto done;
    }
    nearest = nearest_told(scene, &space, &aside);
    if (aside) {
        snprintf(refused, CLN_REFUSED_BYTES,
                 "a border of '%.*s' looks more than 78 degrees off the mean camera's axis",
                 (int)cln_utf8_whole(aside, 100), aside);
        goto done;
    }
    if (isnan(nearest)) {
        source = "the sparse points";
        CLN_TRY(nearest_point(&space, result, &nearest));
    }
    if (isnan(nearest)) {
        snprintf(refused, CLN_REFUSED_BYTES,
                 "neither depths of the images nor sparse points tell how near the scene begins");
        goto done;
    }
    if (!(nearest > 0 && isfinite(nearest))) {
        snprintf(refused, CLN_REFUSED_BYTES,
                 "by %s the scene begins at depth %.4g, which is not in front of the mean camera",
                 source, nearest);
        goto done;
    }
    space.forward = true;
    space.half = NEAR * nearest;
    find_sides(scene, &space);
    CLN_TRY(cln_asprintf(because,
                         "normalised device coordinates, from a near plane at %.4g before the mean "
                         "camera (by %s) to infinity; --space cube is the other way",
                         space.half, source));
    *out = space;
done:
    return st;
}
