/* Which view is train, val or test, and the order of views. Where a dataset names no test views,
 * every Nth image by name is held out, from the first on, as evaluations on COLMAP scenes do, or
 * from another one (--holdout-from), for folds, but none of two or three; for that, names are
 * ordered byte by byte, as Python sorts them, so that results compare. Or a list names them
 * (test_list.c). The views themselves stand in an order for people: by split, then by name in
 * natural order. */
#include "scene/build.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/text.h"

enum { LEAST_TO_HOLD = 4 }; /* of fewer photos --holdout takes none, if it is above their number */

const char *const cln_split_names[CLN_SPLITS] = {"train", "val", "test"};

static int by_bytes(const void *a, const void *b)
{
    const cln_view *const *x = a, *const *y = b;

    return strcmp((*x)->name, (*y)->name);
}

static int by_split_and_name(const void *a, const void *b)
{
    const cln_view *x = a, *y = b;

    if (x->split != y->split)
        return x->split < y->split ? -1 : 1;
    return cln_natural_compare(x->name, y->name);
}

static cln_status hold_out(cln_scene *scene, int holdout, int first)
{
    cln_status st = CLN_OK;
    const cln_view **sorted = NULL;

    CLN_TRY(cln_alloc(&sorted, (size_t)scene->view_count, sizeof *sorted, "views"));
    for (int i = 0; i < scene->view_count; i++)
        sorted[i] = &scene->views[i];
    qsort(sorted, (size_t)scene->view_count, sizeof *sorted, by_bytes);
    for (int i = 0; i < scene->view_count; i++) {
        if (i > 0 && !strcmp(sorted[i - 1]->name, sorted[i]->name))
            CLN_TRY(
                cln_fail(CLN_INPUT,
                         "%s: image '%s' appears twice; remove one of the two frames or, if they "
                         "are photos of two folders, write the folders into their names",
                         scene->folder, sorted[i]->name));
        scene->views[sorted[i] - scene->views].split =
            holdout > 0 && i % holdout == first ? CLN_SPLIT_TEST : CLN_SPLIT_TRAIN;
    }
done:
    free(sorted);
    return st;
}

/* The test views of config.test_views, or of the run that had them from there. */
static cln_status take_list(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    const char *file = desc->config->test_views;
    int count = 0;

    CLN_TRY(hold_out(scene, 0, 0));
    CLN_TRY(cln_scene_list_tests(scene, file, desc->kept));
    count = cln_scene_split_count(scene, CLN_SPLIT_TEST);
    CLN_TRY(cln_asprintf(&scene->split_rule, "%d image%s that %s names %s test (--test-views)",
                         count, cln_plural(count, "", "s"), file, cln_plural(count, "is", "are")));
done:
    return st;
}

/* Of the training views those of config.train_views stay, or those of the run. */
static cln_status leave_listed(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    const char *file = desc->config->train_views;
    char *rule = NULL;
    int count = 0;

    CLN_TRY(cln_scene_list_trained(scene, file, desc->kept));
    count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    CLN_TRY(cln_asprintf(&rule,
                         "%s; of the others %d that %s names %s train, the rest val "
                         "(--train-views)",
                         scene->split_rule, count, file, cln_plural(count, "is", "are")));
    free(scene->split_rule);
    scene->split_rule = rule;
done:
    return st;
}

/* Of two or three photos none can be spared, unless the run that is read for held one out. */
static bool is_spare(const cln_scene *scene, const cln_scene_desc *desc)
{
    const cln_config *config = desc->config;

    return scene->view_count < 2 || scene->view_count >= LEAST_TO_HOLD ||
           config->holdout <= scene->view_count || config->holdout_from > 0 || desc->held_out;
}

/* Every Nth view, or none, by config. */
static cln_status take_every(cln_scene *scene, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    const int holdout = desc->config->holdout, first = desc->config->holdout_from;
    const bool spare = is_spare(scene, desc);

    CLN_TRY(hold_out(scene, spare ? holdout : 0, first));
    if (holdout > 0 && first > 0)
        CLN_TRY(cln_asprintf(&scene->split_rule,
                             "1 in %d images by name, from number %d on (the first is 0), is test "
                             "(--holdout, --holdout-from)",
                             holdout, first));
    else if (holdout > 0)
        CLN_TRY(cln_asprintf(&scene->split_rule,
                             "1 in %d images by name, from the first, is test (--holdout)%s",
                             holdout, spare ? "" : ", but of 2 or 3 none"));
    else
        CLN_TRY(cln_strdup(&scene->split_rule, "all images are train (--holdout 0)"));
done:
    return st;
}

cln_status cln_scene_split_views(cln_scene *scene, bool named_splits, const cln_scene_desc *desc)
{
    cln_status st = CLN_OK;
    const bool listed = desc->config->test_views[0] && !named_splits;

    scene->has_splits = named_splits;
    if (named_splits && desc->config->test_views[0] && !desc->kept)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the dataset says itself which views train and which are test, so "
                         "--test-views %s would have no effect; leave it out, or take the splits "
                         "out of the dataset's files",
                         scene->folder, desc->config->test_views));
    if (named_splits)
        CLN_TRY(cln_strdup(&scene->split_rule, "as the dataset names them"));
    else if (listed)
        CLN_TRY(take_list(scene, desc));
    else
        CLN_TRY(take_every(scene, desc));
    if (desc->kept)
        CLN_TRY(cln_scene_keep_split(scene, desc->kept, !named_splits && !listed));
    if (desc->config->train_views[0])
        CLN_TRY(leave_listed(scene, desc));
    qsort(scene->views, (size_t)scene->view_count, sizeof *scene->views, by_split_and_name);
    for (int i = 1; i < scene->view_count; i++) {
        const cln_view *a = &scene->views[i - 1], *b = &scene->views[i];

        if (a->split == b->split && !strcmp(a->name, b->name))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: image '%s' appears twice in the %s split; remove one of "
                             "the two frames",
                             scene->folder, a->name, cln_split_names[a->split]));
    }
    scene->lent = desc->measured && cln_scene_split_count(scene, CLN_SPLIT_TRAIN) == 0;
    for (int i = 0; i < scene->view_count && scene->lent; i++) { /* keeps their order */
        scene->views[i].named = scene->views[i].split;
        scene->views[i].split = CLN_SPLIT_TRAIN;
    }
    if (cln_scene_split_count(scene, CLN_SPLIT_TRAIN) == 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: no training view among %d (%s)%s", scene->folder,
                         scene->view_count, scene->split_rule,
                         named_splits ? "; make some training views"
                         : listed     ? "; name fewer, as all others train"
                                      : "; with --holdout 0 all of them are training views"));
done:
    return st;
}

void cln_scene_return_splits(cln_scene *scene)
{
    for (int i = 0; i < scene->view_count && scene->lent; i++)
        scene->views[i].split = scene->views[i].named;
    scene->lent = false;
}

int cln_scene_split_count(const cln_scene *scene, cln_split split)
{
    int count = 0;

    for (int i = 0; i < scene->view_count; i++)
        count += scene->views[i].split == split;
    return count;
}

int cln_scene_split_view(const cln_scene *scene, cln_split split, int i)
{
    /* Views are ordered by split. */
    for (int s = 0; s < (int)split; s++)
        i += cln_scene_split_count(scene, (cln_split)s);
    return i;
}

cln_view *cln_scene_training_view(const cln_scene *scene, int i)
{
    return &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)];
}

double cln_scene_training_pixels(const cln_scene *scene)
{
    const int views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double pixels = 0;

    for (int i = 0; i < views; i++) {
        const cln_camera *camera = &cln_scene_training_view(scene, i)->camera;

        pixels += (double)camera->width * camera->height;
    }
    return pixels;
}

int cln_scene_spread_view(const cln_scene *scene, cln_split split, int i, int count)
{
    const int views = cln_scene_split_count(scene, split);

    return cln_scene_split_view(scene, split, (int)((int64_t)i * views / count));
}

int cln_scene_spread_stride(const cln_scene *scene, cln_split split, int count, double most)
{
    double pixels = 0;

    for (int i = 0; i < count; i++) {
        const cln_camera *c = &scene->views[cln_scene_spread_view(scene, split, i, count)].camera;

        pixels += (double)c->width * c->height;
    }
    return (int)fmax(1, ceil(sqrt(pixels / most)));
}
