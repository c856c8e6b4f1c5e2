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

enum { NAMED = 12, ALIKE = 5 }; /* images without a pose, folders that a warning names */

/* The file of a view in the folder: of OpenSfM's undistorted photos with one more ending than its
 * name has. NULL if there is none. */
static cln_status file_of(const char *folder, const cln_reader_result *result, const char *name,
                          char **out)
{
    static const char *const tails[] = {"", ".jpg", ".png"};
    const size_t count = result->tailed ? sizeof tails / sizeof *tails : 1;
    cln_status st = CLN_OK;
    char *path = NULL;

    *out = NULL;
    for (size_t i = 0; i < count && !*out; i++) {
        CLN_TRY(cln_asprintf(&path, "%s/%s%s", folder, name, tails[i]));
        if (cln_is_file(path)) {
            *out = path;
            path = NULL;
        }
        free(path);
        path = NULL;
    }
done:
    return st;
}

/* Counts the views that the folder has an image of, up to `most`; any_case: also those in another
 * case. */
static cln_status count_views(const char *folder, const cln_reader_result *result, bool any_case,
                              int most, int *count)
{
    cln_status st = CLN_OK;
    cln_moved moved = {.folder = folder, .shallow = true};
    char *found = NULL;

    for (int i = 0; i < result->view_count; i++)
        moved.shallow &= !strchr(result->views[i].name, '/');
    *count = 0;
    for (int i = 0; i < result->view_count && *count < most; i++) {
        if (any_case)
            CLN_TRY(cln_moved_find(&moved, result->views[i].name, false, &found));
        else
            CLN_TRY(file_of(folder, result, result->views[i].name, &found));
        *count += found != NULL;
        free(found);
        found = NULL;
    }
done:
    cln_moved_free(&moved);
    free(found);
    return st;
}

/* Of the folders in `base`, the one with images of the most views: one of masks or the like only
 * where no other has any. NULL if none has. Not one with other poses (moved.h); those of `model`
 * are the views'. */
static cln_status fullest_folder(const char *base, const char *model,
                                 const cln_reader_result *result, bool any_case, char **out)
{
    cln_status st = CLN_OK;
    cln_names names = {0};
    char *path = NULL;
    cln_listed alike = {0};
    int best = 0;

    CLN_TRY(cln_dataset_folders(base, &names));
    for (int i = 0; i < names.count; i++) {
        int worth = 0;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, base, names.name[i]));
        if (strcmp(path, model) != 0 && cln_reader_detects(path))
            continue;
        CLN_TRY(count_views(path, result, any_case, result->view_count, &worth));
        if (worth > 0 && !cln_is_no_photos(names.name[i]))
            worth += result->view_count;
        if (worth > best) {
            free(*out);
            *out = path;
            path = NULL;
            best = worth;
            alike = (cln_listed){0};
        } else if (worth > 0 && worth == best) {
            cln_listed_add(&alike, ALIKE, "'%s'", names.name[i]);
        }
    }
    if (alike.count > 0)
        cln_warn("%s: the images are taken from '%s', but %s %s as many of their names; if another "
                 "folder has the photos, rename it to images",
                 base, cln_dataset_within(base, *out), alike.text,
                 cln_plural(alike.count, "has", "have"));
    else if (best > 0 && best <= result->view_count)
        cln_warn("%s: the images are taken from '%s', which is the name of a folder of masks or "
                 "the like; if it has no photos, put them into a folder images",
                 base, cln_dataset_within(base, *out));
done:
    cln_dataset_free_names(&names);
    free(path);
    return st;
}

/* The folder of `base`, or `base`, that has images of views; NULL if none has. */
static cln_status folder_of_views(const char *base, const char *model,
                                  const cln_reader_result *result, bool any_case, char **out)
{
    cln_status st = CLN_OK;
    int count = 0;

    for (int i = 0; i <= CLN_IMAGE_FOLDERS; i++) {
        free(*out);
        *out = NULL;
        CLN_TRY(i < CLN_IMAGE_FOLDERS ? cln_path_join(out, base, cln_image_folders[i])
                                      : cln_strdup(out, base));
        CLN_TRY(count_views(*out, result, any_case, 1, &count));
        if (count > 0)
            goto done;
    }
    free(*out);
    *out = NULL;
    CLN_TRY(fullest_folder(base, model, result, any_case, out));
done:
    return st;
}

/* The folder in `around` with images of half of the views or more: fewer may be called alike by
 * chance, as cameras count from 1. NULL if there is none. */
static cln_status find_beside(const char *around, const char *model,
                              const cln_reader_result *result, char **out)
{
    cln_status st = CLN_OK;
    int count = 0;

    CLN_TRY(fullest_folder(around, model, result, true, out));
    if (*out)
        CLN_TRY(count_views(*out, result, true, result->view_count, &count));
    if (*out && 2 * count < result->view_count) {
        free(*out);
        *out = NULL;
    }
done:
    return st;
}

/* Fills the paths of the views, below the folder or, by their ends, elsewhere in the scene. */
static cln_status place_views(const char *folder, const char *scene, const char *model,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_moved here = {.folder = folder, .model = model, .bare = true};
    cln_moved around = {.folder = scene, .model = model};

    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];

        free(view->path);
        view->path = NULL;
        CLN_TRY(file_of(folder, result, view->name, &view->path));
        if (!view->path)
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

/* The same but for separators that stand twice, as programs of Windows write them. */
static int by_path(const void *a, const void *b)
{
    const char *x = *(char *const *)a, *y = *(char *const *)b;

    for (;; x++, y++) {
        while (x[0] == '/' && x[1] == '/')
            x++;
        while (y[0] == '/' && y[1] == '/')
            y++;
        if (*x != *y || !*x)
            return (unsigned char)*x - (unsigned char)*y;
    }
}

/* Warns of images in the folder that are no views, nor a view's depths, mask or alpha, with the
 * first of their names. *unposed: how many. */
static cln_status warn_unposed(const char *folder, const cln_reader_result *result,
                               const cln_names *there, int *unposed)
{
    cln_status st = CLN_OK;
    char **known = NULL, *path = NULL;
    cln_listed names = {0};
    size_t count = 0;

    CLN_TRY(cln_alloc(&known, (size_t)result->view_count * 5, sizeof *known, "files"));
    for (int i = 0; i < result->view_count; i++) {
        const cln_view *v = &result->views[i];
        char *const files[5] = {v->path, v->depth.depth, v->depth.confidence, v->mask_path,
                                v->alpha_path};

        for (int k = 0; k < 5; k++)
            if (files[k])
                known[count++] = files[k];
    }
    qsort(known, count, sizeof *known, by_path);
    for (int i = 0; i < there->count; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, folder, there->name[i]));
        if (bsearch(&path, known, count, sizeof *known, by_path))
            continue;
        cln_listed_add(&names, NAMED, "%s", there->name[i]);
    }
    if (names.count > 0)
        cln_warn("%s: %d of %d images %s no pose and %s left out: %s", folder, names.count,
                 there->count, cln_plural(names.count, "has", "have"),
                 cln_plural(names.count, "is", "are"), names.text);
    *unposed = names.count;
done:
    free(known);
    free(path);
    return st;
}

/* Leaves out the names that are so. */
static void drop_names(cln_names *names, bool (*is)(const char *name))
{
    int kept = 0;

    for (int i = 0; i < names->count; i++) {
        if (is(names->name[i]))
            free(names->name[i]);
        else
            names->name[kept++] = names->name[i];
    }
    names->count = kept;
}

/* The folders of the first two images that are called like this one: lists of poses may name the
 * files of several flights without their folders. Returns how many there are. */
static int folders_with(const cln_names *there, const char *name, char folders[2][256])
{
    const char *base = cln_last_name(name);
    int found = 0;

    for (int i = 0; i < there->count; i++) {
        const char *file = there->name[i], *end = strrchr(file, '/');

        if (!end || strcmp(end + 1, base) != 0 || cln_moved_is_aside(file))
            continue;
        if (found < 2)
            snprintf(folders[found], 256, "%.*s", (int)(end - file), file);
        found++;
    }
    return found;
}

cln_status cln_dataset_find_images(const char *where, const char *scene, const char *const *bases,
                                   int base_count, const char *around, cln_reader_result *result,
                                   char **folder)
{
    cln_status st = CLN_OK;
    const char *top = bases[base_count - 1];
    const char *model = strlen(top) > strlen(bases[0]) ? top : bases[0]; /* the innermost */
    cln_moved within = {.folder = scene, .model = model}, at_top = {.folder = top, .model = model};
    cln_names there = {0};
    char *unread = NULL, *apart = NULL;
    size_t other_scene = 0;
    char folders[2][256];
    int others = 0;

    if (!result->view_count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no image has a pose; find the poses again, or give another scene",
                         where));
    for (int i = 0; i < base_count && !*folder; i++)
        CLN_TRY(folder_of_views(bases[i], model, result, false, folder));
    for (int i = 0; i < base_count && !*folder; i++)
        CLN_TRY(folder_of_views(bases[i], model, result, true, folder));
    if (!*folder) {
        CLN_TRY(place_views(scene, scene, model, result));
        if (result->moved_count)
            CLN_TRY(cln_strdup(folder, scene));
    }
    if (!*folder && around)
        CLN_TRY(find_beside(around, model, result, folder));
    if (!*folder)
        CLN_TRY(cln_moved_apart(&within, result->views[0].name, &apart));
    if (apart)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there, for example '%s'; photos of the same "
                         "names in %s have their own poses, and may have another lens: its folder "
                         "'%s' is a scene: give that one",
                         where, result->view_count, result->views[0].name, scene, apart));
    if (!*folder)
        CLN_TRY(cln_dataset_unread(top, result->views[0].name, &others, &unread));
    if (unread)
        CLN_TRY(cln_moved_scene(&at_top, unread, &other_scene));
    if (other_scene)
        CLN_TRY(
            cln_fail(CLN_INPUT,
                     "%s: none of its %d images is there; the folder '%.*s' in %s is a scene of "
                     "its own, but of photos in formats that are not read, as '%s'; convert "
                     "them to PNG or JPEG and give that folder",
                     where, result->view_count, (int)other_scene, unread, top, unread));
    if (unread)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there; for '%s', %s has '%s', one of %d "
                         "photo%s in formats that are not read: convert %s to PNG or JPEG",
                         where, result->view_count, result->views[0].name, top, unread, others,
                         cln_plural(others, "", "s"), cln_plural(others, "it", "them")));
    if (!*folder)
        CLN_TRY(cln_dataset_images(top, &there));
    if (!*folder && folders_with(&there, result->views[0].name, folders) > 1)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: '%s' and its other images are in several folders, as '%s' and '%s': "
                         "write their folder into the names, or leave only one of them there",
                         where, result->views[0].name, folders[0], folders[1]));
    if (!*folder && there.count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there, for example '%s'; the images in %s "
                         "have other names (the first is '%s'): name them as the poses do, also in "
                         "the ending",
                         where, result->view_count, result->views[0].name, top, there.name[0]));
    if (!*folder)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: none of its %d images is there: '%s' was looked for in %s and the "
                         "folders in it; put them into its folder images",
                         where, result->view_count, result->views[0].name, top));
    if (!result->moved_count)
        CLN_TRY(place_views(*folder, scene, model, result));
    CLN_TRY(cln_dataset_find_masks(scene, *folder, result));
    for (int i = 0; i < base_count; i++)
        if (!strcmp(*folder, bases[i]))
            goto done; /* other images there do not belong to this reconstruction */
    CLN_TRY(cln_dataset_images(*folder, &there));
    drop_names(&there, cln_dataset_is_mask); /* nobody expects these to have poses */
    if (there.count > result->view_count)
        CLN_TRY(warn_unposed(*folder, result, &there, &result->unposed));
done:
    cln_dataset_free_names(&there);
    cln_moved_free(&within);
    free(unread);
    free(apart);
    return st;
}

/* Is it by its name another picture of a view than the photo, as Blender and instant-ngp have them
 * beside photos: r_0_depth.png? */
static bool is_beside(const char *name)
{
    bool is = cln_is_no_photos(name);

    for (const char *at = name; (at = strpbrk(at, "_-. ")) && !is; at++)
        is = cln_is_no_photos(at + 1);
    return is;
}

cln_status cln_dataset_tell_unposed(const char *scene, const cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const char *first = result->view_count ? result->views[0].path : NULL;
    const char *slash = first ? strrchr(first, '/') : NULL;
    const size_t length = slash ? (size_t)(slash - first) : 0;
    cln_names there = {0};
    char *folder = NULL;
    int unposed = 0;

    for (int i = 0; i < result->view_count && slash; i++) {
        const char *path = result->views[i].path, *end = path ? strrchr(path, '/') : NULL;

        if (!end || (size_t)(end - path) != length || strncmp(path, first, length) != 0)
            slash = NULL;
    }
    if (!slash)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&folder, "%.*s", (int)length, first));
    if (cln_is_same_file(folder, scene))
        goto done;
    st = cln_dataset_images_of(folder, true, &there);
    if (st == CLN_INPUT) { /* what cannot be listed is not told */
        cln_clear_error();
        st = CLN_OK;
        goto done;
    }
    CLN_TRY(st);
    drop_names(&there, is_beside);
    if (there.count > 0)
        qsort(there.name, (size_t)there.count, sizeof *there.name, by_text);
    CLN_TRY(warn_unposed(folder, result, &there, &unposed));
done:
    cln_dataset_free_names(&there);
    free(folder);
    return st;
}
