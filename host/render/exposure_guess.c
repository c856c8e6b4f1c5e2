/* Gains of photos that training did not see. See exposure_guess.h. */
#include "render/exposure_guess.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

/* A view among those of its folder. */
typedef struct place {
    const cln_view *view;
    int index;                 /* into scene->views */
    double gain[3], around[3]; /* logs: its own, if it was trained on; its neighbours' mean */
} place;

static bool same_folder(const cln_view *a, const cln_view *b)
{
    const size_t length = cln_folder_length(a->name);

    return length == cln_folder_length(b->name) && strncmp(a->name, b->name, length) == 0;
}

/* By folder, then by name. */
static int by_place(const void *a, const void *b)
{
    const cln_view *x = ((const place *)a)->view, *y = ((const place *)b)->view;
    const size_t n = cln_folder_length(x->name), m = cln_folder_length(y->name);
    const int order = strncmp(x->name, y->name, n < m ? n : m);

    if (order != 0 || n != m)
        return order != 0 ? order : n < m ? -1 : 1;
    return cln_natural_compare(x->name, y->name);
}

static bool trained(const place *p)
{
    return p->view->split == CLN_SPLIT_TRAIN;
}

/* Adds to each view's sum of neighbours the last training view that is passed before it: over
 * places from first to end (exclusive), by step 1 or -1. */
static void add_neighbours(place *places, int first, int end, int step, int *counts)
{
    const place *last = NULL;

    for (int i = first; i != end; i += step) {
        place *p = &places[i];

        if (last && !same_folder(last->view, p->view))
            last = NULL;
        for (int c = 0; c < 3 && last; c++)
            p->around[c] += last->gain[c];
        counts[i] += last != NULL;
        if (trained(p))
            last = p;
    }
}

/* How much of their neighbours' gains the training views have. */
static double share_of(const place *places, int count)
{
    double cross = 0, square = 0;

    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3 && trained(&places[i]); c++) {
            cross += places[i].gain[c] * places[i].around[c];
            square += places[i].around[c] * places[i].around[c];
        }
    return square > 0 ? fmin(fmax(cross / square, 0), 1) : 0;
}

/* All views in order, with their logs and their neighbours'; and share_of. */
static cln_status find_places(const cln_model *model, const cln_scene *scene, place **out,
                              double *share)
{
    cln_status st = CLN_OK;
    const int count = scene->view_count;
    place *places = NULL;
    int *counts = NULL;

    CLN_TRY(cln_alloc(out, (size_t)count, sizeof **out, "exposure"));
    CLN_TRY(cln_alloc(&counts, (size_t)count, sizeof *counts, "exposure"));
    places = *out;
    for (int i = 0; i < count; i++)
        places[i] = (place){.view = &scene->views[i], .index = i};
    for (int i = 0; i < model->exposure_views; i++)
        for (int c = 0; c < 3; c++)
            places[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)].gain[c] =
                log(model->exposure[i][c]);
    qsort(places, (size_t)count, sizeof *places, by_place);
    add_neighbours(places, 0, count, 1, counts);
    add_neighbours(places, count - 1, -1, -1, counts);
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3 && counts[i] > 1; c++)
            places[i].around[c] /= counts[i];
    *share = share_of(places, count);
done:
    free(counts);
    return st;
}

cln_status cln_exposure_follow(const cln_model *model, const cln_scene *scene, double *share)
{
    place *places = NULL;
    const cln_status st = find_places(model, scene, &places, share);

    free(places);
    return st;
}

cln_status cln_exposure_guess(const cln_model *model, const cln_scene *scene, float (**gains)[3])
{
    cln_status st = CLN_OK;
    const int count = scene->view_count;
    place *places = NULL;
    double share = 0;

    *gains = NULL;
    if (!model->exposure || !model->exposed ||
        model->exposure_views != cln_scene_split_count(scene, CLN_SPLIT_TRAIN))
        return CLN_OK;
    CLN_TRY(find_places(model, scene, &places, &share));
    CLN_TRY(cln_alloc(gains, (size_t)count, sizeof **gains, "exposure"));
    cln_debug("exposure: photos have %.2f of their neighbours' log gains", share);
    for (int i = 0; i < count; i++)
        for (int c = 0; c < 3; c++)
            (*gains)[places[i].index][c] =
                (float)exp(trained(&places[i]) ? places[i].gain[c] : share * places[i].around[c]);
done:
    free(places);
    return st;
}
