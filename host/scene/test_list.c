/* The views that a list names (--test-views, --train-views), or those that a run had by such a
 * list. What a photo may be called stands in one sorted table, as lists and scenes may have 100,000
 * names:
 *
 *   level 0  its name in the scene; level 1: its path from the scene's folder, or the whole
 *   level 2  that name without the ending; level 3: that path without it
 *   level 4  the file's name alone; level 5: that without the ending
 *
 * Of a name that several views have, those count that have it at the lowest level. */
#include "scene/build.h"

#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "base/unicode.h"

enum { MOST_BYTES = 1 << 26, NAMED = 3, ALIASES = 8 };

typedef struct alias {
    const char *text;
    size_t length;
    int level, view;
} alias;

typedef struct table {
    size_t count;
    alias *row; /* [count] by text, then by level, then by view */
} table;

/* ---- the table ---- */

static int compare_text(const alias *a, const alias *b)
{
    const int order = memcmp(a->text, b->text, a->length < b->length ? a->length : b->length);

    return order ? order : (a->length > b->length) - (a->length < b->length);
}

static int by_text(const void *a, const void *b)
{
    const alias *x = a, *y = b;
    const int order = compare_text(x, y);

    if (order)
        return order;
    return x->level != y->level ? x->level - y->level : x->view - y->view;
}

/* The path from the folder, if it is one into it, without "./". */
static const char *path_in(const char *folder, const char *path)
{
    const size_t length = strlen(folder);

    return cln_without_dot(
        strncmp(path, folder, length) == 0 && path[length] == '/' ? path + length + 1 : path);
}

/* Adds a path at `level`, and without its ending at `without`. */
static void add(table *t, const char *path, int level, int without, int view)
{
    const char *base = cln_last_name(path), *dot = strrchr(base, '.');

    t->row[t->count++] = (alias){path, strlen(path), level, view};
    if (dot && dot != base)
        t->row[t->count++] = (alias){path, (size_t)(dot - path), without, view};
}

static cln_status make_table(const cln_scene *scene, table *t)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&t->row, ALIASES * (size_t)scene->view_count, sizeof *t->row, "views"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        const char *path = view->path ? view->path : view->name;

        add(t, cln_without_dot(view->name), 0, 2, i);
        add(t, path_in(scene->folder, path), 1, 3, i);
        add(t, cln_last_name(view->name), 4, 5, i);
        add(t, cln_last_name(path), 4, 5, i);
    }
    qsort(t->row, t->count, sizeof *t->row, by_text);
done:
    return st;
}

/* How many views have this name, at the lowest level that has it; the first NAMED of them. */
static int find(const table *t, const char *name, int *level, int views[NAMED])
{
    const alias wanted = {.text = name, .length = strlen(name)};
    size_t low = 0, high = t->count;
    int count = 0, last = -1;

    while (low < high) { /* the first row that is not before it */
        const size_t middle = low + (high - low) / 2;

        if (compare_text(&t->row[middle], &wanted) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    *level = low < t->count ? t->row[low].level : 0;
    for (; low < t->count && compare_text(&t->row[low], &wanted) == 0; low++) {
        if (t->row[low].level != *level || t->row[low].view == last)
            continue;
        last = t->row[low].view;
        if (count < NAMED)
            views[count] = last;
        count++;
    }
    return count;
}

/* The same of a name as it stands in a list: from Windows, or from a system that writes letters
 * with marks in another form. */
static int find_written(const cln_scene *scene, const table *t, char *name, int *level,
                        int views[NAMED])
{
    int found = find(t, path_in(scene->folder, name), level, views);

    if (found == 0 && cln_turn_slashes(name))
        found = find(t, path_in(scene->folder, name), level, views);
    for (int composed = 0; composed < 2 && found == 0; composed++) {
        char *form = cln_unicode_form(name, composed);

        if (form)
            found = find(t, path_in(scene->folder, form), level, views);
        free(form);
    }
    return found;
}

/* ---- the list ---- */

/* Adds "'NAME' (line N)". */
static void add_trouble(cln_listed *t, char *name, int line)
{
    cln_utf8_repair(name);
    cln_listed_add(t, NAMED, "'%.*s' (line %d)", (int)cln_utf8_whole(name, 130), name, line);
}

/* The names of these views, or of the scene's first. */
static cln_listed list_views(const cln_scene *scene, const int *views, int count)
{
    cln_listed listed = {0};

    for (int i = 0; i < count && i <= NAMED; i++)
        cln_listed_add(&listed, NAMED, "'%s'",
                       i < NAMED ? scene->views[views ? views[i] : i].name : "");
    return listed;
}

/* The name in a line that a program for tables wrote: without its quotes and the commas or
 * semicolons of empty columns behind it. */
static char *without_table(char *name)
{
    size_t length = strlen(name);

    while (length && strchr(",;", name[length - 1]))
        name[--length] = 0;
    name = cln_trim_blanks(name);
    length = strlen(name);
    if (length > 1 && name[0] == '"' && name[length - 1] == '"') {
        name[length - 1] = 0;
        name++;
    }
    return name;
}

/* Sets named[view] of the views of all lines; *names: how many names there are. */
static cln_status take_lines(const cln_scene *scene, const table *t, const char *file, char *text,
                             bool *named, int *names)
{
    cln_listed none = {0}, several = {0}, views_of;
    int line = 0, views[NAMED], of_first[NAMED], first = 0, level = 0;

    *names = 0;
    /* skips the byte order mark of Windows editors */
    for (char *at = text + (strncmp(text, "\xEF\xBB\xBF", 3) == 0 ? 3 : 0), *next = NULL; at;
         at = next) {
        char *name = NULL;
        int found = 0;

        next = strchr(at, '\n');
        if (next)
            *next++ = 0;
        line++;
        name = cln_trim_blanks(at);
        found = find_written(scene, t, name, &level, views); /* names may have a # */
        if (found == 0)
            name = cln_trim(name);
        if (!*name)
            continue;
        ++*names;
        if (found == 0)
            found = find_written(scene, t, name, &level, views);
        if (found == 0) { /* as a table of one column is saved */
            name = without_table(name);
            found = find_written(scene, t, name, &level, views);
        }
        if (found == 1)
            named[views[0]] = true;
        if (found > 1 && several.count == 0) {
            first = found;
            memcpy(of_first, views, sizeof views);
        }
        if (found != 1)
            add_trouble(found ? &several : &none, name, line);
    }
    if (none.count) {
        views_of = list_views(scene, NULL, scene->view_count);
        return cln_fail(CLN_INPUT,
                        "%s: %d of its %d names %s of no photo of %s: %s; its photos are called "
                        "%s: write the names so, or leave these out",
                        file, none.count, *names, cln_plural(none.count, "is", "are"),
                        scene->folder, none.text, views_of.text);
    }
    if (several.count) {
        views_of = list_views(scene, of_first, first);
        return cln_fail(CLN_INPUT,
                        "%s: %d of its %d names %s of several photos of %s: %s; the first may be "
                        "%s: write the name with the folder",
                        file, several.count, *names, cln_plural(several.count, "is", "are"),
                        scene->folder, several.text, views_of.text);
    }
    return CLN_OK;
}

/* Marks the views that a file names, for this option, which makes them `what`. */
static cln_status read_list(const cln_scene *scene, const char *file, const char *option,
                            const char *what, bool *named)
{
    cln_status st = CLN_OK;
    table t = {0};
    char *text = NULL;
    size_t bytes = 0;
    int names = 0;

    st = cln_read_text(file, MOST_BYTES, &text, &bytes);
    if (st != CLN_OK)
        cln_note("reading the names of %s photos (%s)", what, option);
    CLN_TRY(st);
    if (strlen(text) != bytes)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: holds a zero byte; %s takes text, a name a line", file,
                         option));
    CLN_TRY(make_table(scene, &t));
    CLN_TRY(take_lines(scene, &t, file, text, named, &names));
    if (names == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: it names no %s photo; write one name a line, or leave %s out (with "
                         "--holdout 0 all photos train)",
                         file, what, option));
done:
    free(t.row);
    free(text);
    return st;
}

/* Marks those that have this split in `kept`, by their names; names that are not there do not
 * matter. */
static cln_status mark_kept(const cln_scene *scene, const cln_scene *kept, cln_split split,
                            bool *named)
{
    cln_status st = CLN_OK;
    table t = {0};
    int views[NAMED], level = 0;

    CLN_TRY(make_table(scene, &t));
    for (int i = 0; i < kept->view_count; i++)
        if (kept->views[i].split == split &&
            find(&t, cln_without_dot(kept->views[i].name), &level, views) == 1 && level == 0)
            named[views[0]] = true;
done:
    free(t.row);
    return st;
}

cln_status cln_scene_list_tests(cln_scene *scene, const char *file, const cln_scene *kept)
{
    cln_status st = CLN_OK;
    bool *named = NULL;

    CLN_TRY(cln_alloc(&named, (size_t)scene->view_count, sizeof *named, "views"));
    CLN_TRY(kept ? mark_kept(scene, kept, CLN_SPLIT_TEST, named)
                 : read_list(scene, file, "--test-views", "test", named));
    for (int i = 0; i < scene->view_count; i++)
        if (named[i])
            scene->views[i].split = CLN_SPLIT_TEST;
done:
    free(named);
    return st;
}

cln_status cln_scene_list_trained(cln_scene *scene, const char *file, const cln_scene *kept)
{
    cln_status st = CLN_OK;
    bool *named = NULL, any = false;

    CLN_TRY(cln_alloc(&named, (size_t)scene->view_count, sizeof *named, "views"));
    CLN_TRY(kept ? mark_kept(scene, kept, CLN_SPLIT_TRAIN, named)
                 : read_list(scene, file, "--train-views", "training", named));
    for (int i = 0; i < scene->view_count; i++)
        any = any || named[i];
    if (!any) /* another scene than the run's */
        goto done;
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *view = &scene->views[i];

        if (named[i] && view->split != CLN_SPLIT_TRAIN && !kept)
            CLN_TRY(
                cln_fail(CLN_INPUT,
                         "%s: it names '%s', which is a %s view (%s); leave it out of the list, "
                         "or name other views by --test-views",
                         file, view->name, cln_split_names[view->split], scene->split_rule));
        if (!named[i] && view->split == CLN_SPLIT_TRAIN)
            view->split = CLN_SPLIT_VAL;
    }
done:
    free(named);
    return st;
}
