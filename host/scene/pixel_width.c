/* How much of the scene a pixel of the photos shows, which says what is too fine to be seen. See
 * scene.h. */
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include "base/memory.h"
#include "base/number.h"

cln_status cln_scene_pixel_width(const cln_scene *scene, const double (*poses)[12],
                                 const cln_space *space, double *width)
{
    cln_status st = CLN_OK;
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double *each = NULL;
    int count = 0;

    *width = 0;
    if (space->forward)
        return CLN_OK;
    CLN_TRY(cln_alloc(&each, (size_t)views, sizeof *each, "views"));
    for (int i = 0; i < views; i++) {
        const cln_camera *c = &cln_scene_training_view(scene, i)->camera;
        const double *pose = poses ? poses[i] : c->c2w;
        double square = 0;

        for (int a = 0; a < 3; a++)
            square += pow(pose[4 * a + 3] - space->centre[a], 2);
        if (c->fx > 0)
            each[count++] = sqrt(square) / c->fx / space->half;
    }
    cln_reals_sort(each, count);
    *width = count > 0 ? each[count / 2] : 0;
done:
    free(each);
    return st;
}

/* ---- of a cell ---- */

/* A camera's view of a point. */
typedef struct sight {
    double toward[3]; /* from the camera to the point, unit */
    double pixels;    /* an angle of 1 has so many, at the point */
} sight;

/* Whether the camera sees the point. */
static bool sees(const cln_camera *c, const double point[3], sight *out)
{
    double rel[3], far = 0, u = 0, v = 0;

    for (int a = 0; a < 3; a++) {
        rel[a] = point[a] - c->c2w[4 * a + 3];
        far += rel[a] * rel[a];
    }
    if (!(far > 0) || !(c->fx > 0) || !cln_camera_shows(c, point, &u, &v))
        return false;
    for (int a = 0; a < 3; a++)
        out->toward[a] = rel[a] / sqrt(far);
    out->pixels = c->fx / sqrt(far);
    return true;
}

double cln_scene_cell_pixels(const cln_scene *scene, const cln_space *space, const double centre[3],
                             double cell, double *each)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double point[3], edge[3][3];
    int count = 0;

    cln_space_point_to_scene(space, centre, point);
    for (int a = 0; a < 3; a++) {
        double end[3] = {centre[0], centre[1], centre[2]};

        end[a] += cell;
        cln_space_point_to_scene(space, end, edge[a]);
    }
    for (int i = 0; i < views; i++) {
        const int view = cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i);
        double widest = 0;
        sight s;

        if (!sees(&scene->views[view].camera, point, &s))
            continue;
        for (int a = 0; a < 3; a++) {
            double square = 0, along = 0;

            for (int k = 0; k < 3; k++) {
                square += pow(edge[a][k] - point[k], 2);
                along += (edge[a][k] - point[k]) * s.toward[k];
            }
            widest = fmax(widest, square - along * along);
        }
        each[count++] = sqrt(widest) * s.pixels;
    }
    cln_reals_sort(each, count);
    return count > 0 ? each[count / 2] : INFINITY;
}
