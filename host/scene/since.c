/* What has become of the views of a run in its scene, by their names: photos come and go, and poses
 * are found anew. */
#include "scene/build.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

static const double FAR = 0.05;   /* of the cameras' median distance from their middle */
static const double TURNED = 3.0; /* degrees */

static int by_bytes(const void *a, const void *b)
{
    const cln_view *const *x = a, *const *y = b;

    return strcmp((*x)->name, (*y)->name);
}

/* The views of a run by their names. */
static cln_status sort_names(const cln_scene *kept, const cln_view ***sorted)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(sorted, (size_t)kept->view_count, sizeof **sorted, "views"));
    for (int i = 0; i < kept->view_count; i++)
        (*sorted)[i] = &kept->views[i];
    qsort(*sorted, (size_t)kept->view_count, sizeof **sorted, by_bytes);
done:
    return st;
}

static const cln_view *find_view(const cln_view *const *sorted, int count, const cln_view *view)
{
    const cln_view *const *found = bsearch(&view, sorted, (size_t)count, sizeof *sorted, by_bytes);

    return found ? *found : NULL;
}

cln_status cln_scene_keep_counted(cln_scene *scene, const cln_scene *kept)
{
    cln_status st = CLN_OK;
    const cln_view **sorted = NULL;
    char *rule = NULL;
    int known = 0, moved = 0;

    if (strncmp(kept->split_rule, scene->split_rule, strlen(scene->split_rule)) != 0)
        return CLN_OK;
    CLN_TRY(sort_names(kept, &sorted));
    for (int i = 0; i < scene->view_count; i++)
        known += find_view(sorted, kept->view_count, &scene->views[i]) != NULL;
    for (int i = 0; i < scene->view_count && known > 0; i++) {
        const cln_view *was = find_view(sorted, kept->view_count, &scene->views[i]);
        const cln_split split = was ? was->split : CLN_SPLIT_TRAIN;

        moved += scene->views[i].split != split;
        scene->views[i].split = split;
    }
    if (moved == 0)
        goto done;
    CLN_TRY(cln_asprintf(&rule, "%s, of the photos that the run began with", scene->split_rule));
    free(scene->split_rule);
    scene->split_rule = rule;
done:
    free(sorted);
    return st;
}

cln_status cln_scene_tell_trained(const cln_scene *scene, const cln_scene *kept)
{
    cln_status st = CLN_OK;
    const cln_view **sorted = NULL;
    const char *first = NULL;
    int tests = 0, trained = 0;

    CLN_TRY(sort_names(kept, &sorted));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const cln_view *was =
            view->split == CLN_SPLIT_TEST ? find_view(sorted, kept->view_count, view) : NULL;

        tests += view->split == CLN_SPLIT_TEST;
        if (!was || was->split != CLN_SPLIT_TRAIN)
            continue;
        first = first ? first : view->name;
        trained++;
    }
    if (trained > 0)
        cln_warn("%s: the run was trained on %d of its %d test photos ('%s'%s): what is measured "
                 "on them is too good; with the run's own split (%s) it is not",
                 scene->folder, trained, tests, first, trained > 1 ? ", ..." : "",
                 kept->split_rule);
done:
    free(sorted);
    return st;
}

static int by_size(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return (x > y) - (x < y);
}

static double median(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_size);
    return values[count / 2];
}

/* The median distance of these cameras from the mean of their places. */
static cln_status spread_of(const cln_scene *kept, double *spread)
{
    cln_status st = CLN_OK;
    const int count = kept->view_count;
    double middle[3] = {0}, *distance = NULL;

    CLN_TRY(cln_alloc(&distance, (size_t)count, sizeof *distance, "views"));
    for (int i = 0; i < 3 * count; i++)
        middle[i % 3] += kept->views[i / 3].camera.c2w[4 * (i % 3) + 3] / count;
    for (int i = 0; i < count; i++) {
        const double *pose = kept->views[i].camera.c2w;

        distance[i] = hypot(hypot(pose[3] - middle[0], pose[7] - middle[1]), pose[11] - middle[2]);
    }
    *spread = median(distance, count);
done:
    free(distance);
    return st;
}

cln_status cln_scene_moved_since(const cln_scene *scene, const cln_scene *kept, cln_since *out)
{
    cln_status st = CLN_OK;
    const cln_view **sorted = NULL;
    double *shift = NULL, *turn = NULL, spread = 0;

    *out = (cln_since){0};
    CLN_TRY(sort_names(kept, &sorted));
    CLN_TRY(spread_of(kept, &spread));
    CLN_TRY(cln_alloc(&shift, (size_t)scene->view_count, sizeof *shift, "views"));
    CLN_TRY(cln_alloc(&turn, (size_t)scene->view_count, sizeof *turn, "views"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *was = find_view(sorted, kept->view_count, &scene->views[i]);
        const double *from = was ? was->camera.c2w : NULL, *to = scene->views[i].camera.c2w;
        double cosine = -1;

        if (!was)
            continue;
        for (int k = 0; k < 12; k++)
            cosine += k % 4 < 3 ? from[k] * to[k] : 0;
        shift[out->known] =
            hypot(hypot(to[3] - from[3], to[7] - from[7]), to[11] - from[11]) / spread;
        turn[out->known] = acos(fmin(fmax(0.5 * cosine, -1), 1)) * 180 / 3.141592653589793;
        if (!(spread > 0))
            shift[out->known] = 0;
        out->moved += shift[out->known] > FAR || turn[out->known] > TURNED;
        out->known++;
    }
    if (out->known > 0) {
        out->shift = median(shift, out->known);
        out->degrees = median(turn, out->known);
    }
    out->elsewhere = out->shift > FAR || out->degrees > TURNED;
done:
    free(sorted);
    free(shift);
    free(turn);
    return st;
}
