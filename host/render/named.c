/* Finds views by names. See named.h. */
#include "render/named.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/unicode.h"
#include "render/quality.h"

enum { LISTED = 3, NAME_BYTES = 512 };

/* ---- one name ---- */

/* Is `name` this file, with or without its ending? */
static bool is_file(const char *name, const char *file)
{
    const char *dot = strrchr(cln_last_name(file), '.');

    return strcmp(name, file) == 0 ||
           (dot && dot != cln_last_name(file) && strncmp(name, file, (size_t)(dot - file)) == 0 &&
            name[dot - file] == 0);
}

/* The photo's path from the scene's folder, or the whole one. */
static const char *path_in(const cln_scene *scene, const cln_view *view)
{
    const size_t n = strlen(scene->folder);

    if (!view->path)
        return view->name;
    if (strncmp(view->path, scene->folder, n) != 0 || view->path[n] != '/')
        return view->path;
    return cln_without_dot(view->path + n + 1);
}

static bool is_named(const cln_scene *scene, const cln_view *view, const char *name)
{
    const char *own = cln_without_dot(view->name), *path = path_in(scene, view);

    name = cln_without_dot(name);
    return is_file(name, own) || is_file(name, path) || is_file(name, cln_last_name(own)) ||
           is_file(name, cln_last_name(path)) || strcmp(name, view->file) == 0 ||
           (view->path && strcmp(name, view->path) == 0);
}

/* Whether the view is of the split; CLN_SPLITS: of any. */
static bool is_in(const cln_view *view, cln_split split)
{
    return split == CLN_SPLITS || view->split == split;
}

static const char *name_of(cln_split split)
{
    return split == CLN_SPLITS ? "all" : cln_split_names[split];
}

static int mark_as_written(const cln_scene *scene, cln_split split, const char *name, bool *chosen)
{
    int found = 0;

    for (int i = 0; i < scene->view_count; i++) {
        if (!is_in(&scene->views[i], split) || !is_named(scene, &scene->views[i], name))
            continue;
        found++;
        if (chosen)
            chosen[i] = true;
    }
    return found;
}

/* Marks the split's views of this name, and returns how many it has. Letters with marks may be in
 * another form than in the names. */
static int mark(const cln_scene *scene, cln_split split, const char *name, bool *chosen)
{
    int found = mark_as_written(scene, split, name, chosen);

    for (int composed = 0; composed < 2 && found == 0; composed++) {
        char *form = cln_unicode_form(name, composed);

        found = form ? mark_as_written(scene, split, form, chosen) : 0;
        free(form);
    }
    return found;
}

/* ---- a name that is not there ---- */

/* The edits between a name and a view's: of its file alone, unless the name has a folder, and with
 * the ending only where that is nearer. */
static int distance(const cln_view *view, const char *name)
{
    const char *own = strchr(name, '/') ? cln_without_dot(view->name) : cln_last_name(view->name);
    const char *dot = strrchr(own, '.');
    const int whole = cln_edit_distance(name, own);
    char plain[NAME_BYTES];
    int short_of = 0;

    snprintf(plain, sizeof plain, "%.*s", dot ? (int)(dot - own) : (int)strlen(own), own);
    short_of = cln_edit_distance(name, plain);
    return short_of < whole ? short_of : whole;
}

/* Lists names of the split's views: those nearest to one, or with none the first. */
static void list_names(const cln_scene *scene, cln_split split, const char *name, char *out,
                       size_t bytes)
{
    const size_t length = name ? strlen(name) : 0;
    const int limit = length >= 6 ? 4 : (int)length / 2 + 1; /* as of options' names */
    int listed = 0;

    out[0] = 0;
    for (int edits = name ? 1 : 0; edits < limit; edits++)
        for (int i = 0; i < scene->view_count && listed < LISTED; i++) {
            const cln_view *v = &scene->views[i];
            const size_t used = strlen(out);

            if (is_in(v, split) && (!name || distance(v, name) == edits))
                snprintf(out + used, bytes - used, "%s'%s'", listed++ ? ", " : "",
                         cln_without_dot(v->name));
        }
}

static cln_status fail_name(const cln_scene *scene, cln_split split, const char *name)
{
    char names[LISTED * NAME_BYTES];

    if (!*name)
        return cln_fail(CLN_USAGE, "--views: a name is empty; give names of photos with commas "
                                   "between them");
    for (int s = 0; s < CLN_SPLITS; s++)
        if (mark(scene, (cln_split)s, name, NULL) > 0)
            return cln_fail(CLN_USAGE,
                            "--views: '%s' is in the split %s, not %s; give --split %s with it",
                            name, cln_split_names[s], name_of(split), cln_split_names[s]);
    list_names(scene, split, name, names, sizeof names);
    if (*names)
        return cln_fail(CLN_USAGE,
                        "--views: no view of the split %s is called '%s'; did you mean "
                        "%s?",
                        name_of(split), name, names);
    list_names(scene, split, NULL, names, sizeof names);
    return cln_fail(CLN_USAGE, "--views: no view of the split %s is called '%s'; it has %s%s",
                    name_of(split), name, names,
                    split == CLN_SPLITS || cln_scene_split_count(scene, split) > LISTED ? ", ..."
                                                                                        : "");
}

/* ---- a list of names ---- */

/* Marks the views of the next name, and moves *at behind it. A name may have commas: the longest
 * one that there is counts. */
static cln_status mark_next(const cln_scene *scene, cln_split split, const char **at, bool *chosen)
{
    cln_status st = CLN_OK;
    char *name = NULL;
    size_t length = 0;

    *at += strspn(*at, " ");
    length = strlen(*at);
    CLN_TRY(cln_strdup(&name, *at));
    while (mark(scene, split, name, chosen) == 0) {
        char *comma = strrchr(name, ',');

        if (!comma && cln_turn_slashes(name))
            continue;
        if (!comma)
            CLN_TRY(fail_name(scene, split, name));
        *comma = 0;
        length = (size_t)(comma - name);
    }
    *at += length;
done:
    free(name);
    return st;
}

cln_status cln_views_check(const char *names, int most)
{
    if (names && most > 0)
        return cln_fail(CLN_USAGE, "--max-images cannot be combined with --views, which names the "
                                   "views; give one of them");
    return CLN_OK;
}

cln_status cln_views_choose(const cln_scene *scene, cln_split split, const char *names, int most,
                            int **views, int *count)
{
    cln_status st = CLN_OK;
    bool *chosen = NULL, more = true;

    if (!names)
        return cln_quality_choose(scene, split, most, views, count);
    CLN_TRY(cln_views_check(names, most));
    CLN_TRY(cln_alloc(&chosen, (size_t)scene->view_count, sizeof *chosen, "views"));
    CLN_TRY(cln_alloc(views, (size_t)scene->view_count, sizeof **views, "views"));
    while (more) {
        CLN_TRY(mark_next(scene, split, &names, chosen));
        more = *names == ',';
        names += more;
    }
    *count = 0;
    for (int i = 0; i < scene->view_count; i++)
        if (chosen[i])
            (*views)[(*count)++] = i;
done:
    free(chosen);
    return st;
}
