/* At how many places do the cameras stand? A thing that is turned before a camera on a tripod has
 * as many poses as the tripod had places, where structure from motion held on to what stood still
 * behind it. See scene.h. */
#include <math.h>
#include <stdlib.h>
#include "base/memory.h"
#include "scene/scene.h"

enum { LEAST = 9, MOST = 5000, FEW = 5 };
static const double NEAR = 0.01, ALIKE = 0.99985; /* of how far they stand apart; cos 1 degree */
static const double APART =
    0.05; /* likewise: of stands; a film's frames follow each other closer */

static double distance(const double a[12], const double b[12])
{
    return hypot(hypot(a[3] - b[3], a[7] - b[7]), a[11] - b[11]);
}

/* Do two cameras look the same way, the same side up? */
static bool look_alike(const double a[12], const double b[12])
{
    for (int k = 1; k < 3; k++)
        if (a[k] * b[k] + a[4 + k] * b[4 + k] + a[8 + k] * b[8 + k] < ALIKE)
            return false;
    return true;
}

/* Does half of the stands have another one nearby, as along a film's way? */
static bool follow_each_other(const cln_scene *scene, const int *stand, int stands, double apart)
{
    int close = 0;

    for (int i = 0; i < stands; i++) {
        bool has = false;

        for (int k = 0; k < stands && !has; k++)
            has = k != i && distance(scene->views[stand[i]].camera.c2w,
                                     scene->views[stand[k]].camera.c2w) < apart;
        close += has;
    }
    return 2 * close >= stands;
}

int cln_scene_few_stands(const cln_scene *scene)
{
    const int count = scene->view_count;
    double middle[12] = {0}, far = 0;
    int *stand = NULL; /* views that are the first of theirs */
    int stands = 0;

    if (count < LEAST || count > MOST ||
        cln_alloc(&stand, (size_t)count, sizeof *stand, "cameras") != CLN_OK) {
        cln_clear_error();
        return 0;
    }
    for (int i = 0; i < count; i++)
        for (int a = 3; a < 12; a += 4)
            middle[a] += scene->views[i].camera.c2w[a] / count;
    for (int i = 0; i < count; i++)
        far = fmax(far, distance(middle, scene->views[i].camera.c2w));
    for (int i = 0; i < count && 2 * stands <= count; i++) {
        const double *m = scene->views[i].camera.c2w;
        int k = 0;

        while (k < stands && !(distance(m, scene->views[stand[k]].camera.c2w) <= NEAR * far &&
                               look_alike(m, scene->views[stand[k]].camera.c2w)))
            k++;
        if (k == stands)
            stand[stands++] = i;
    }
    if (2 * stands > count ||
        (stands > FEW &&
         (3 * stands >= count || follow_each_other(scene, stand, stands, APART * far))))
        stands = 0;
    free(stand);
    return stands;
}
