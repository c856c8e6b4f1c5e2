/* How much of the scene a pixel of the photos shows, which says what is too fine to be seen. See
 * scene.h. */
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>

#include "base/memory.h"

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

cln_status cln_scene_pixel_width(const cln_scene *scene, const cln_space *space, double *width)
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
        const cln_camera *c = &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)].camera;
        double square = 0;

        for (int a = 0; a < 3; a++)
            square += pow(c->c2w[4 * a + 3] - space->centre[a], 2);
        if (c->fx > 0)
            each[count++] = sqrt(square) / c->fx / space->half;
    }
    qsort(each, (size_t)count, sizeof *each, by_value);
    *width = count > 0 ? each[count / 2] : 0;
done:
    free(each);
    return st;
}
