/* What has become of the views of a run in its scene, by their names: photos come and go, and poses
 * are found anew. */
#include "scene/build.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "base/unicode.h"

static const double FAR = 0.01;   /* of the cameras' median distance from their middle */
static const double TURNED = 1.0; /* degrees */
static const double SAME = 0.01;  /* of these: as they were, but for digits */
static const double GROWN = 0.5;  /* of the fewer views that both have, for a scene that grew */

uint64_t cln_scene_training_names(const cln_scene *scene)
{
    uint64_t names = CLN_DIGEST_START;

    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++) {
        const char *name = cln_scene_training_view(scene, i)->name;

        names = cln_digest(names, name, strlen(name) + 1);
    }
    return names;
}

/* ---- the run's views by name ---- */

typedef struct row {
    char *name; /* composed, as names of files come in two forms */
    const cln_view *view;
} row;

static int by_name(const void *a, const void *b)
{
    const row *x = a, *y = b;

    return strcmp(x->name, y->name);
}

/* Of a name that is in several splits, that of training is the first. */
static int by_name_and_split(const void *a, const void *b)
{
    const row *x = a, *y = b;
    const int order = by_name(a, b);

    return order ? order : (int)x->view->split - (int)y->view->split;
}

static cln_status make_row(const cln_view *view, row *out)
{
    out->view = view;
    out->name = cln_unicode_form(view->name, true);
    return out->name ? CLN_OK : cln_strdup(&out->name, view->name);
}

static void free_rows(row *rows, int count)
{
    for (int i = 0; i < count && rows; i++)
        free(rows[i].name);
    free(rows);
}

/* *was: for each view of the scene that of the run with its name, or NULL. */
static cln_status find_views(const cln_scene *scene, const cln_scene *kept, const cln_view ***was)
{
    cln_status st = CLN_OK;
    const int count = kept->view_count;
    row *rows = NULL, wanted = {0};

    CLN_TRY(cln_alloc(&rows, (size_t)count, sizeof *rows, "views"));
    CLN_TRY(cln_alloc(was, (size_t)scene->view_count, sizeof **was, "views"));
    for (int i = 0; i < count; i++)
        CLN_TRY(make_row(&kept->views[i], &rows[i]));
    qsort(rows, (size_t)count, sizeof *rows, by_name_and_split);
    for (int i = 0; i < scene->view_count; i++) {
        const row *found = NULL;

        free(wanted.name);
        wanted.name = NULL;
        CLN_TRY(make_row(&scene->views[i], &wanted));
        found = bsearch(&wanted, rows, (size_t)count, sizeof *rows, by_name);
        while (found && found > rows && by_name(found - 1, found) == 0)
            found--;
        (*was)[i] = found ? found->view : NULL;
    }
done:
    free(wanted.name);
    free_rows(rows, count);
    return st;
}

/* ---- poses ---- */

static double distance(const double a[12], const double b[12])
{
    return hypot(hypot(a[3] - b[3], a[7] - b[7]), a[11] - b[11]);
}

static double degrees_between(const double a[12], const double b[12])
{
    double trace = 0;

    for (int k = 0; k < 12; k++)
        trace += k % 4 < 3 ? a[k] * b[k] : 0;
    return acos(fmin(fmax(0.5 * (trace - 1), -1), 1)) * 180 / 3.141592653589793;
}

/* The median distance of these cameras from the mean of their places. */
static cln_status spread_of(const cln_scene *kept, double *spread)
{
    cln_status st = CLN_OK;
    const int count = kept->view_count;
    double middle[12] = {0}, *away = NULL;

    CLN_TRY(cln_alloc(&away, (size_t)count, sizeof *away, "views"));
    for (int i = 0; i < 3 * count; i++)
        middle[4 * (i % 3) + 3] += kept->views[i / 3].camera.c2w[4 * (i % 3) + 3] / count;
    for (int i = 0; i < count; i++)
        away[i] = distance(kept->views[i].camera.c2w, middle);
    cln_reals_sort(away, count);
    *spread = away[count / 2];
done:
    free(away);
    return st;
}

/* How many of the scene's cameras are where the run had one: photos may have other names. */
static int count_in_place(const cln_scene *scene, const cln_scene *kept, double spread)
{
    int count = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const double *to = scene->views[i].camera.c2w;
        bool found = false;

        for (int k = 0; k < kept->view_count && !found; k++) {
            const double *from = kept->views[k].camera.c2w;

            found = distance(from, to) <= FAR * spread && degrees_between(from, to) <= TURNED;
        }
        count += found;
    }
    return count;
}

cln_status cln_scene_moved_since(const cln_scene *scene, const cln_scene *kept, cln_since *out)
{
    cln_status st = CLN_OK;
    const cln_view **was = NULL;
    const int fewer = kept->view_count < scene->view_count ? kept->view_count : scene->view_count;
    double *shift = NULL, *turn = NULL, spread = 0;

    *out = (cln_since){0};
    CLN_TRY(find_views(scene, kept, &was));
    CLN_TRY(spread_of(kept, &spread));
    CLN_TRY(cln_alloc(&shift, (size_t)scene->view_count, sizeof *shift, "views"));
    CLN_TRY(cln_alloc(&turn, (size_t)scene->view_count, sizeof *turn, "views"));
    for (int i = 0; i < scene->view_count; i++) {
        const double *to = scene->views[i].camera.c2w;
        const int k = out->known;

        if (!was[i])
            continue;
        shift[k] = spread > 0 ? distance(was[i]->camera.c2w, to) / spread : 0;
        turn[k] = degrees_between(was[i]->camera.c2w, to);
        if ((shift[k] > FAR || turn[k] > TURNED) && out->moved++ == 0)
            out->first_moved = scene->views[i].name;
        out->told += scene->views[i].digest && was[i]->digest;
        if (scene->views[i].digest && was[i]->digest && scene->views[i].digest != was[i]->digest &&
            out->changed++ == 0)
            out->first_changed = scene->views[i].name;
        out->known++;
    }
    if (out->known > 0) {
        cln_reals_sort(shift, out->known);
        cln_reals_sort(turn, out->known);
        out->shift = shift[out->known / 2];
        out->degrees = turn[out->known / 2];
    }
    out->fresh = scene->view_count - out->known;
    out->gone = kept->view_count - out->known > 0 ? kept->view_count - out->known : 0;
    out->elsewhere = out->shift > FAR || out->degrees > TURNED ||
                     (out->known == 0 && count_in_place(scene, kept, spread) < GROWN * fewer);
done:
    free(was);
    free(shift);
    free(turn);
    return st;
}

void cln_since_text(const cln_since *since, char out[CLN_SINCE_BYTES])
{
    char fresh[64] = "", gone[64] = "";

    if (since->fresh > 0)
        snprintf(fresh, sizeof fresh, "%d photo%s new", since->fresh,
                 cln_plural(since->fresh, " is", "s are"));
    if (since->gone > 0)
        snprintf(gone, sizeof gone, "%s%d%s gone", *fresh ? ", " : "", since->gone,
                 *fresh ? cln_plural(since->gone, " is", " are")
                        : cln_plural(since->gone, " photo is", " photos are"));
    snprintf(out, CLN_SINCE_BYTES, "%s%s", fresh, gone);
    if (since->shift > SAME * FAR || since->degrees > SAME * TURNED)
        snprintf(out + strlen(out), CLN_SINCE_BYTES - strlen(out),
                 "%sthe %d that it knows have other poses, in the median %.3g degrees and %.2g "
                 "times the cameras' distance from their middle off",
                 *out ? ", and " : "", since->known, since->degrees, since->shift);
    else if (since->moved > 0)
        snprintf(out + strlen(out), CLN_SINCE_BYTES - strlen(out),
                 "%s%d of the %d photos that it knows %s ('%.*s'%s)", *out ? ", and " : "",
                 since->moved, since->known,
                 cln_plural(since->moved, "has another pose", "have other poses"),
                 (int)cln_utf8_whole(since->first_moved, 100), since->first_moved,
                 since->moved > 1 ? ", ..." : "");
}

/* ---- the split ---- */

/* New photos train; those that the run had stay what they were. */
static cln_status keep_counted(cln_scene *scene, const cln_view *const *was)
{
    cln_status st = CLN_OK;
    char *rule = NULL;
    bool trains = false, moved = false;

    for (int i = 0; i < scene->view_count; i++)
        trains = trains || !was[i] || was[i]->split != CLN_SPLIT_TEST;
    for (int i = 0; i < scene->view_count && trains; i++) {
        cln_view *view = &scene->views[i];
        /* val are what --train-views left out, which is looked at later */
        const cln_split split =
            was[i] && was[i]->split == CLN_SPLIT_TEST ? CLN_SPLIT_TEST : CLN_SPLIT_TRAIN;

        /* one that is not there is left out later on, and was not in the run for that */
        moved = moved || (view->split != split && (was[i] || cln_is_file(view->path)));
        view->split = split;
    }
    if (!moved)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&rule, "%s, of the photos that the run began with", scene->split_rule));
    free(scene->split_rule);
    scene->split_rule = rule;
done:
    return st;
}

/* Test views that the run was trained on cannot tell how good it is. */
static void tell_trained(const cln_scene *scene)
{
    const char *first = NULL;
    int tests = 0, trained = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        tests += view->split == CLN_SPLIT_TEST;
        if (view->split != CLN_SPLIT_TEST || !view->trained)
            continue;
        first = first ? first : view->name;
        trained++;
    }
    if (trained > 0)
        cln_warn(
            "%s: the run was trained on %d of its %d test photos ('%s'%s), so what is measured "
            "on them is too good",
            scene->folder, trained, tests, first, trained > 1 ? ", ..." : "");
}

cln_status cln_scene_keep_split(cln_scene *scene, const cln_scene *kept, bool counted)
{
    cln_status st = CLN_OK;
    const int fewer = kept->view_count < scene->view_count ? kept->view_count : scene->view_count;
    const size_t length = strlen(scene->split_rule);
    const cln_view **was = NULL;
    cln_since since;

    CLN_TRY(cln_scene_moved_since(scene, kept, &since));
    if (since.elsewhere || since.known < GROWN * fewer)
        return CLN_OK; /* another scene, or other poses, which a run that goes on refuses */
    CLN_TRY(find_views(scene, kept, &was));
    if (counted && strncmp(kept->split_rule, scene->split_rule, length) == 0)
        CLN_TRY(keep_counted(scene, was));
    for (int i = 0; i < scene->view_count; i++)
        scene->views[i].trained = was[i] && (was[i]->trained || was[i]->split == CLN_SPLIT_TRAIN);
    tell_trained(scene);
done:
    free(was);
    return st;
}
