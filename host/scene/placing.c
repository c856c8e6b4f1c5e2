/* Where the images are whose names a dataset tells, but not their folder. See placing.h. */
#include "scene/placing.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/dataset.h"
#include "scene/moved.h"

enum { NAMED = 12 }; /* images without a pose that a warning names */

/* Whether the folder has an image of a view; any_case: also in another case. */
static cln_status has_a_view(const char *folder, const cln_reader_result *result, bool any_case,
                             bool *has)
{
    cln_status st = CLN_OK;
    cln_moved moved = {.folder = folder, .shallow = true};
    char *found = NULL;

    for (int i = 0; i < result->view_count; i++)
        moved.shallow &= !strchr(result->views[i].name, '/');
    *has = false;
    for (int i = 0; i < result->view_count && !*has; i++) {
        if (any_case)
            CLN_TRY(cln_moved_find(&moved, result->views[i].name, false, &found));
        *has = found || (!any_case && cln_dataset_has(folder, result->views[i].name));
    }
done:
    cln_moved_free(&moved);
    free(found);
    return st;
}

/* The first folder of `base` that has an image of a view; NULL if none has. */
static cln_status folder_of_views(const char *base, const cln_reader_result *result, bool any_case,
                                  char **out)
{
    bool has = false;
    cln_status st = CLN_OK;
    cln_names others = {0};

    for (int i = 0; i <= CLN_IMAGE_FOLDERS; i++) {
        free(*out);
        *out = NULL;
        CLN_TRY(i < CLN_IMAGE_FOLDERS ? cln_path_join(out, base, cln_image_folders[i])
                                      : cln_strdup(out, base));
        CLN_TRY(has_a_view(*out, result, any_case, &has));
        if (has)
            goto done;
    }
    CLN_TRY(cln_dataset_folders(base, &others));
    for (int i = 0; i < others.count; i++) {
        free(*out);
        *out = NULL;
        CLN_TRY(cln_path_join(out, base, others.name[i]));
        CLN_TRY(has_a_view(*out, result, any_case, &has));
        if (has)
            goto done;
    }
    free(*out);
    *out = NULL;
done:
    cln_dataset_free_names(&others);
    return st;
}

/* Fills the paths of the views, below the folder or, by their ends, elsewhere in the scene. */
static cln_status place_views(const char *folder, const char *scene, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_moved here = {.folder = folder}, around = {.folder = scene};

    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];

        free(view->path);
        view->path = NULL;
        CLN_TRY(cln_path_join(&view->path, folder, view->name)); /* missing ones: load.c */
    }
    CLN_TRY(cln_moved_views(&here, result));
    CLN_TRY(cln_moved_views(&around, result));
done:
    cln_moved_free(&here);
    cln_moved_free(&around);
    return st;
}

static int by_text(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

/* Warns of images in the folder that are no views, with the first of their names. */
static cln_status warn_unposed(const char *folder, const cln_reader_result *result,
                               const cln_names *there)
{
    cln_status st = CLN_OK;
    const int count = result->view_count, more = there->count - count;
    char **known = NULL, *path = NULL, names[1024] = "";
    size_t used = 0;
    int named = 0;

    CLN_TRY(cln_alloc(&known, (size_t)count, sizeof *known, "views"));
    for (int i = 0; i < count; i++)
        known[i] = result->views[i].path;
    qsort(known, (size_t)count, sizeof *known, by_text);
    for (int i = 0; i < there->count && named <= NAMED && used < sizeof names; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, there->name[i]));
        if (bsearch(&path, known, (size_t)count, sizeof *known, by_text))
            continue;
        used += (size_t)snprintf(names + used, sizeof names - used, "%s%s", named ? ", " : "",
                                 named < NAMED ? there->name[i] : "...");
        named++;
    }
    cln_warn("%s: %d of %d images %s no pose and %s left out: %s", folder, more, there->count,
             cln_plural(more, "has", "have"), cln_plural(more, "is", "are"), names);
done:
    free(known);
    free(path);
    return st;
}

cln_status cln_dataset_find_images(const char *where, const char *scene, const char *const *bases,
                                   int base_count, cln_reader_result *result, char **folder)
{
    cln_status st = CLN_OK;
    cln_names there = {0};

    if (!result->view_count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no image has a pose; find the poses again, or give another scene",
                         where));
    for (int i = 0; i < base_count && !*folder; i++)
        CLN_TRY(folder_of_views(bases[i], result, false, folder));
    for (int i = 0; i < base_count && !*folder; i++)
        CLN_TRY(folder_of_views(bases[i], result, true, folder));
    if (!*folder) {
        CLN_TRY(place_views(scene, scene, result));
        if (result->moved_count)
            CLN_TRY(cln_strdup(folder, scene));
    }
    if (!*folder)
        CLN_TRY(cln_dataset_images(bases[base_count - 1], &there));
    if (!*folder && there.count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there, for example '%s'; the images in %s "
                         "have other names (the first is '%s'): name them as the poses do, also in "
                         "the ending",
                         where, result->view_count, result->views[0].name, bases[base_count - 1],
                         there.name[0]));
    if (!*folder)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there: '%s' was looked for in %s and the "
                         "folders in it; put them into its folder images",
                         where, result->view_count, result->views[0].name, bases[base_count - 1]));
    if (!result->moved_count)
        CLN_TRY(place_views(*folder, scene, result));
    for (int i = 0; i < base_count; i++)
        if (!strcmp(*folder, bases[i]))
            goto done; /* other images there do not belong to this reconstruction */
    CLN_TRY(cln_dataset_images(*folder, &there));
    if (there.count > result->view_count)
        CLN_TRY(warn_unposed(*folder, result, &there));
done:
    cln_dataset_free_names(&there);
    return st;
}
