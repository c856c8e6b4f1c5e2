/* What readers share. See dataset.h. */
#include "scene/dataset.h"

#include <ctype.h>
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"

enum { MAX_DEPTH = 4, MAX_NAMES = 10 * CLN_MAX_VIEWS };

const char *const cln_image_folders[CLN_IMAGE_FOLDERS] = {"images", "images_2", "images_4",
                                                          "images_8"};

const char *cln_dataset_within(const char *scene, const char *path)
{
    const size_t length = strlen(scene);

    if (!length || strncmp(path, scene, length) != 0)
        return path;
    path += length;
    if (!*path)
        return "the folder itself";
    return *path == '/' ? path + 1 : scene[length - 1] == '/' ? path : path - length;
}

cln_status cln_dataset_name(const char *where, const char *file_path, char **out)
{
    cln_status st = CLN_OK;
    char *name = NULL;
    size_t used = 0;

    CLN_TRY(cln_alloc(&name, strlen(file_path) + 1, 1, "name"));
    for (const char *p = file_path; *p;) {
        const size_t length = strcspn(p, "/\\");

        if (length && strncmp(p, "..", length) != 0) { /* "." is a prefix of ".." */
            if (used)
                name[used++] = '/';
            memcpy(name + used, p, length);
            used += length;
        }
        p += length;
        p += *p != 0;
    }
    if (!used)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: '%s' names no image file; correct the name", where,
                         file_path));
    if (!cln_utf8_valid(name)) {
        cln_utf8_repair(name);
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: the image name '%s' is not UTF-8, as this file must be: save it in "
                         "UTF-8 (an older editor's files: iconv -f CP1252 -t UTF-8), or rename the "
                         "image",
                         where, name));
    }
    *out = name;
    name = NULL;
done:
    free(name);
    return st;
}

/* ---- image files ---- */

bool cln_dataset_is_image(const char *name)
{
    const char *dot = strrchr(name, '.');

    return dot &&
           (!strcasecmp(dot, ".png") || !strcasecmp(dot, ".jpg") || !strcasecmp(dot, ".jpeg"));
}

typedef enum { IMAGES, UNREAD, VIDEOS, FOLDERS } listed;

bool cln_dataset_is_unread(const char *name)
{
    static const char *const endings[] = {"tif", "tiff", "webp", "heic", "heif", "avif", "bmp",
                                          "gif", "exr",  "dng",  "cr2",  "cr3",  "nef",  "arw",
                                          "raf", "orf",  "rw2",  "jp2",  "insp"};
    const char *dot = strrchr(name, '.');

    for (size_t i = 0; dot && i < sizeof endings / sizeof *endings; i++)
        if (!strcasecmp(dot + 1, endings[i]))
            return true;
    return false;
}

bool cln_dataset_is_video(const char *name)
{
    const char *dot = strrchr(name, '.');
    char word[16];

    if (!dot || strlen(dot) > 6)
        return false;
    snprintf(word, sizeof word, " %s ", dot + 1);
    for (char *c = word; *c; c++)
        *c = (char)tolower((unsigned char)*c);
    return strstr(CLN_VIDEO_ENDINGS, word) != NULL;
}

const char *cln_dataset_converter(const char *name)
{
    const char *dot = strrchr(name, '.');

    if (dot && (!strcasecmp(dot, ".heic") || !strcasecmp(dot, ".heif")))
        return " (heif-convert does; a phone set to \"Most Compatible\" takes JPEG)";
    if (dot && !strcasecmp(dot, ".insp"))
        return " of 2 : 1 (Insta360's own program puts its two circles together)";
    return "";
}

static cln_status keep_name(cln_names *names, const char *within, const char *name)
{
    cln_status st = CLN_OK;
    const int count = names->count;

    if (count >= MAX_NAMES)
        return cln_fail(CLN_INPUT, "%s: more than %d files; give the folder of one scene", within,
                        MAX_NAMES);
    CLN_TRY(cln_grow(&names->name, count, sizeof *names->name, "names"));
    CLN_TRY(cln_path_join(&names->name[count], within, name));
    names->count++;
done:
    return st;
}

static const char THUMBNAILS[] = "@eaDir"; /* of Synology's servers, in each folder */

/* Lists what is wanted of `folder`; `within` is its path from the folder that was asked for. */
static cln_status list(const char *folder, const char *within, int depth, listed wanted,
                       cln_names *out)
{
    cln_status st = CLN_OK;
    DIR *dir = opendir(folder);
    char *path = NULL, *name = NULL;

    if (!dir)
        return cln_fail(CLN_INPUT, "%s: %s", folder, strerror(errno));
    for (struct dirent *entry = NULL; (entry = readdir(dir));) {
        if (entry->d_name[0] == '.' || strcmp(entry->d_name, THUMBNAILS) == 0)
            continue;
        free(path);
        free(name);
        path = name = NULL;
        CLN_TRY(cln_path_join(&path, folder, entry->d_name));
        CLN_TRY(cln_path_join(&name, within, entry->d_name));
        if (cln_is_dir(path)) {
            if (wanted == FOLDERS)
                CLN_TRY(keep_name(out, within, entry->d_name));
            else if (depth < MAX_DEPTH)
                CLN_TRY(list(path, name, depth + 1, wanted, out));
        } else if (((wanted == IMAGES && cln_dataset_is_image(name)) ||
                    (wanted == UNREAD && cln_dataset_is_unread(name)) ||
                    (wanted == VIDEOS && cln_dataset_is_video(name))) &&
                   cln_is_file(path)) { /* no dead link */
            CLN_TRY(keep_name(out, within, entry->d_name));
        }
    }
done:
    closedir(dir);
    free(path);
    free(name);
    return st;
}

static int by_bytes(const void *a, const void *b)
{
    return strcmp(*(char *const *)a, *(char *const *)b);
}

void cln_dataset_sort_names(cln_names *names)
{
    if (names->count)
        qsort(names->name, (size_t)names->count, sizeof *names->name, by_bytes);
}

bool cln_dataset_has_name(const cln_names *names, const char *name)
{
    return names->count &&
           bsearch(&name, names->name, (size_t)names->count, sizeof *names->name, by_bytes) != NULL;
}

static cln_status list_sorted(const char *folder, listed wanted, cln_names *out)
{
    const cln_status st = list(folder, "", 0, wanted, out);

    cln_dataset_sort_names(out);
    return st;
}

cln_status cln_dataset_images(const char *folder, cln_names *out)
{
    return list_sorted(folder, IMAGES, out);
}

cln_status cln_dataset_videos(const char *folder, cln_names *out)
{
    return list_sorted(folder, VIDEOS, out);
}

cln_status cln_dataset_folders(const char *folder, cln_names *out)
{
    return list_sorted(folder, FOLDERS, out);
}

cln_status cln_dataset_images_of(const char *folder, bool shallow, cln_names *out)
{
    return list(folder, "", shallow ? MAX_DEPTH : 0, IMAGES, out);
}

cln_status cln_dataset_unread(const char *folder, const char *name, int *count, char **first)
{
    cln_status st = CLN_OK;
    const char *base = name ? cln_last_name(name) : NULL;
    const size_t stem = !base                        ? 0
                        : cln_dataset_is_image(base) ? (size_t)(strrchr(base, '.') - base)
                                                     : strlen(base);
    cln_names names = {0};

    *first = NULL;
    st = list_sorted(folder, UNREAD, &names);
    if (st == CLN_INPUT) { /* a folder that cannot be looked through has none */
        cln_clear_error();
        st = CLN_OK;
    }
    CLN_TRY(st);
    *count = names.count;
    for (int i = 0; i < names.count && !*first; i++) {
        const char *file = cln_last_name(names.name[i]);
        const size_t length = (size_t)(strrchr(file, '.') - file);

        if (!base || ((length == stem || length == strlen(base)) && /* x.tif, x.jpg.tif of x.jpg */
                      !strncasecmp(file, base, length)))
            CLN_TRY(cln_strdup(first, names.name[i]));
    }
done:
    cln_dataset_free_names(&names);
    return st;
}

static bool has_twin(const char *name, const cln_names *photos)
{
    const size_t stem = (size_t)(strrchr(name, '.') - name);

    for (int i = 0; i < photos->count; i++) {
        const char *photo = photos->name[i], *dot = strrchr(photo, '.');

        if (dot && (size_t)(dot - photo) == stem && strncasecmp(photo, name, stem) == 0)
            return true;
    }
    return false;
}

cln_status cln_dataset_unread_alone(const char *folder, const cln_names *photos, int *count,
                                    char **first)
{
    cln_status st = CLN_OK;
    cln_names names = {0};

    *first = NULL;
    *count = 0;
    CLN_TRY(list_sorted(folder, UNREAD, &names));
    for (int i = 0; i < names.count; i++) {
        if (has_twin(names.name[i], photos))
            continue;
        if ((*count)++ == 0)
            CLN_TRY(cln_strdup(first, names.name[i]));
    }
done:
    cln_dataset_free_names(&names);
    return st;
}

void cln_dataset_free_names(cln_names *names)
{
    for (int i = 0; i < names->count; i++)
        free(names->name[i]);
    free(names->name);
    *names = (cln_names){0};
}

cln_status cln_dataset_beside(const char *folder, const char *image, const char *ending, char **out)
{
    const char *dot = strrchr(image, '.');
    const int stem = dot ? (int)(dot - image) : (int)strlen(image);

    return cln_asprintf(out, "%s/%.*s%s", folder, stem, image, ending);
}

cln_status cln_dataset_keep_with(const char *folder, const char *ending, cln_names *images,
                                 int *without)
{
    cln_status st = CLN_OK;
    char *file = NULL;
    int kept = 0;

    for (int i = 0; i < images->count; i++) {
        char *name = images->name[i];

        free(file);
        CLN_TRY(cln_dataset_beside(folder, name, ending, &file));
        images->name[i] = images->name[kept];
        images->name[kept] = name;
        kept += cln_is_file(file);
    }
    *without = images->count - kept;
    cln_dataset_cut_names(images, kept);
done:
    free(file);
    return st;
}

void cln_dataset_cut_names(cln_names *names, int kept)
{
    while (names->count > kept)
        free(names->name[--names->count]);
}

void cln_dataset_tell_without(const char *folder, const char *what, int without, int kept)
{
    if (without > 0)
        cln_warn("%s: %d of %d photos %s no %s and %s left out", folder, without, kept + without,
                 cln_plural(without, "has", "have"), what, cln_plural(without, "is", "are"));
}

cln_status cln_dataset_views(const char *where, const char *folder, const cln_names *images,
                             cln_reader_result *result)
{
    cln_status st = CLN_OK;

    if (images->count > CLN_MAX_VIEWS)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %d images, more than the %d that are read; leave some out",
                         folder, images->count, CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&result->views, (size_t)images->count, sizeof *result->views, "views"));
    while (result->view_count < images->count) {
        cln_view *view = &result->views[result->view_count];

        CLN_TRY(cln_dataset_name(where, images->name[result->view_count++], &view->name));
        CLN_TRY(cln_path_join(&view->path, folder, images->name[result->view_count - 1]));
    }
done:
    return st;
}

cln_status cln_dataset_image_folder(const char *base, char **out)
{
    *out = NULL;
    for (int i = 0; i < CLN_IMAGE_FOLDERS; i++)
        if (cln_has_dir(base, cln_image_folders[i]))
            return cln_path_join(out, base, cln_image_folders[i]);
    return CLN_OK;
}

/* ---- cameras ---- */

cln_status cln_dataset_lenses(char **out)
{
    cln_status st = CLN_OK;
    char *list = NULL;

    CLN_TRY(cln_strdup(&list, ""));
    for (int lens = 0; lens < CLN_LENSES; lens++) {
        const cln_lens_model *model = &cln_lens_models[lens];

        for (int i = -1; i < model->count; i++) { /* -1: the name */
            const char *comma = i < 0 && lens > 0 ? ", " : i > 0 ? " " : "";

            CLN_TRY(cln_append(&list, "%s%s%s%s", comma, i == 0 ? " (" : "",
                               i < 0 ? model->name : model->params[i],
                               i >= 0 && i == model->count - 1 ? ")" : ""));
        }
    }
    *out = list;
    list = NULL;
done:
    free(list);
    return st;
}

void cln_dataset_from_opengl(double c2w[12])
{
    for (int i = 0; i < 12; i++)
        c2w[i] = i % 4 == 1 || i % 4 == 2 ? -c2w[i] : c2w[i];
}

void cln_dataset_pose(const double rotation[9], const double translation[3], double c2w[12])
{
    for (int i = 0; i < 3; i++) {
        c2w[4 * i + 3] = 0;
        for (int j = 0; j < 3; j++) {
            c2w[4 * i + j] = rotation[3 * j + i];
            c2w[4 * i + 3] -= rotation[3 * j + i] * translation[j];
        }
    }
}
