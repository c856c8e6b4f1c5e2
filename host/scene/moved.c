/* See moved.h. */
#include "scene/moved.h"

#include <ctype.h>
#include <dirent.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/unicode.h"

bool cln_path_leads_out(const char *path)
{
    if (*path == '/' || *path == '\\' || (isalpha((unsigned char)*path) && path[1] == ':'))
        return true;
    for (const char *p = path; *p;) {
        const size_t length = strcspn(p, "/\\");

        if (length == 2 && strncmp(p, "..", 2) == 0)
            return true;
        p += length + (p[length] != 0);
    }
    return false;
}

/* Length of a path without the ending of an image file. */
static size_t stem_of(const char *path)
{
    return cln_dataset_is_image(path) ? (size_t)(strrchr(path, '.') - path) : strlen(path);
}

static int compare_stems(const char *a, const char *b)
{
    const size_t x = stem_of(a), y = stem_of(b);
    const int order = strncasecmp(a, b, x < y ? x : y);

    return order ? order : x < y ? -1 : x > y;
}

static int by_stem(const void *a, const void *b)
{
    const char *x = *(char *const *)a, *y = *(char *const *)b;
    const int order = compare_stems(cln_last_name(x), cln_last_name(y));

    return order ? order : strcmp(x, y);
}

void cln_moved_sort(cln_names *names)
{
    if (names->count)
        qsort(names->name, (size_t)names->count, sizeof *names->name, by_stem);
}

void cln_moved_free(cln_moved *moved)
{
    cln_dataset_free_names(&moved->files);
    cln_dataset_free_names(&moved->apart);
    moved->listed = false;
}

cln_status cln_moved_scene(const cln_moved *moved, const char *file, size_t *length)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    *length = 0;
    for (const char *end = file; !*length && (end = strchr(end, '/')); end++) {
        size_t whole = 0;

        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, moved->folder, file));
        whole = strlen(path) - strlen(end);
        path[whole] = 0;
        if (moved->model && strncmp(moved->model, path, whole) == 0 &&
            (moved->model[whole] == '/' || !moved->model[whole]))
            continue;
        if (cln_reader_detects(path))
            *length = (size_t)(end - file);
    }
done:
    free(path);
    return st;
}

static bool in_one_folder(const char *a, const char *b)
{
    const size_t length = (size_t)(cln_last_name(a) - a);

    return length == (size_t)(cln_last_name(b) - b) && strncmp(a, b, length) == 0;
}

/* Puts the files of other scenes into `apart`. Those of a folder mostly follow each other. */
static cln_status take_apart(cln_moved *moved)
{
    cln_status st = CLN_OK;
    cln_names *all = &moved->files, *apart = &moved->apart;
    const char *before = NULL;
    size_t scene = 0;
    int kept = 0;

    CLN_TRY(cln_alloc(&apart->name, (size_t)all->count, sizeof *apart->name, "names"));
    for (int i = 0; i < all->count; i++) {
        char *file = all->name[i];

        if (!before || !in_one_folder(before, file))
            CLN_TRY(cln_moved_scene(moved, file, &scene));
        before = file;
        if (scene)
            apart->name[apart->count++] = file;
        else
            all->name[kept++] = file;
        all->name[i] = i < kept ? all->name[i] : NULL;
    }
    all->count = kept;
done:
    return st;
}

/* Lists the images; a folder that cannot be looked through has none. */
static cln_status list(cln_moved *moved)
{
    cln_status st = CLN_OK;

    if (moved->listed)
        return CLN_OK;
    st = cln_dataset_images_of(moved->folder, moved->shallow, &moved->files);
    if (st == CLN_INPUT) {
        cln_clear_error();
        cln_dataset_free_names(&moved->files);
        st = CLN_OK;
    }
    CLN_TRY(st);
    CLN_TRY(take_apart(moved));
    moved->listed = true;
    cln_moved_sort(&moved->files);
    cln_moved_sort(&moved->apart);
done:
    return st;
}

bool cln_is_no_photos(const char *name)
{
    static const char *const words[] = {"mask", "depth", "normal", "alpha", "matte", "segment"};

    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strncasecmp(name, words[i], strlen(words[i])) == 0)
            return true;
    return false;
}

/* Is one of the folders of the path one of masks or the like? */
static bool lies_beside_photos(const char *file)
{
    for (const char *end = NULL; (end = strchr(file, '/')); file = end + 1)
        if (cln_is_no_photos(file))
            return true;
    return false;
}

/* The first file whose name has at least the stem of this one. */
static int first_like(const cln_names *files, const char *base)
{
    int low = 0, high = files->count;

    while (low < high) {
        const int middle = low + (high - low) / 2;

        if (compare_stems(cln_last_name(files->name[middle]), base) < 0)
            low = middle + 1;
        else
            high = middle;
    }
    return low;
}

/* Is the file called like `base`, but for case, and for the ending if that has none? */
static bool is_like(const char *file, const char *base)
{
    return compare_stems(cln_last_name(file), base) == 0 &&
           (!cln_dataset_is_image(base) || strcasecmp(cln_last_name(file), base) == 0);
}

/* The length of the end of `name` that is the path of the file, but for case; 0 if none is. *same:
 * also in case. */
static size_t common_end(const char *name, const char *file, bool *same)
{
    const size_t length = strlen(name);
    const size_t end = cln_dataset_is_image(name) ? strlen(file) : stem_of(file);
    const char *from = name + length - end;

    if (end > length || (end < length && from[-1] != '/') || strncasecmp(from, file, end) != 0)
        return 0;
    *same = strncmp(from, file, end) == 0;
    return end;
}

/* Copies of photos in other sizes lie in images_2 and so on: the first of these counts. */
static int rank_of(const char *file)
{
    int rank = 0;

    for (; rank < CLN_IMAGE_FOLDERS; rank++) {
        const size_t length = strlen(cln_image_folders[rank]);

        if (strncmp(file, cln_image_folders[rank], length) == 0 && file[length] == '/')
            break;
    }
    return rank;
}

bool cln_moved_is_aside(const char *file)
{
    const int rank = rank_of(file);

    return lies_beside_photos(file) || (rank > 0 && rank < CLN_IMAGE_FOLDERS);
}

/* As cln_moved_find, in this form of the name. */
static cln_status find_form(cln_moved *moved, const char *name, bool leads_out, char **out)
{
    cln_status st = CLN_OK;
    const char *base = cln_last_name(name), *best = NULL, *like = NULL;
    size_t longest = 0;
    bool exact = false, tie = false;
    int likes = 0, first = CLN_IMAGE_FOLDERS;

    *out = NULL;
    CLN_TRY(list(moved));
    for (int i = first_like(&moved->files, base); i < moved->files.count; i++) {
        const char *file = moved->files.name[i];
        bool same = false;
        size_t end = 0;

        if (compare_stems(cln_last_name(file), base) != 0)
            break;
        if (!is_like(file, base))
            continue;
        if (!lies_beside_photos(file) && rank_of(file) <= first) {
            likes = rank_of(file) < first ? 1 : likes + 1;
            first = rank_of(file);
            like = file;
        }
        end = common_end(name, file, &same);
        if (!strchr(file, '/') && strchr(name, '/'))
            end = 0; /* the name alone */
        if (!end || end < longest || (end == longest && exact && !same))
            continue;
        tie = end == longest && exact == same;
        best = file;
        longest = end;
        exact = same;
    }
    if (!best && leads_out && likes == 1)
        best = like;
    if (best && !tie)
        CLN_TRY(cln_path_join(out, moved->folder, best));
done:
    return st;
}

/* Has it letters beyond ASCII? They have Unicode forms, and cases that strcasecmp does not know. */
static bool has_letters_beyond(const char *name)
{
    while (*name && (unsigned char)*name < 0x80)
        name++;
    return *name != 0;
}

/* The only entry of a folder that is called like the first part of `name`, whatever case and
 * Unicode form; NULL if there is none, or more than one. */
static cln_status find_entry(const char *folder, const char *name, char **out)
{
    cln_status st = CLN_OK;
    char *part = NULL, *wanted = NULL;
    DIR *dir = opendir(folder);
    int found = 0;

    *out = NULL;
    CLN_TRY(cln_asprintf(&part, "%.*s", (int)strcspn(name, "/"), name));
    wanted = cln_unicode_fold(part);
    for (struct dirent *e = dir && wanted ? readdir(dir) : NULL; e && found < 2; e = readdir(dir)) {
        char *folded = cln_unicode_fold(e->d_name);

        if (folded && strcmp(folded, wanted) == 0 && ++found == 1)
            st = cln_path_join(out, folder, e->d_name);
        free(folded);
        CLN_TRY(st);
    }
    if (found > 1) {
        free(*out);
        *out = NULL;
    }
done:
    if (dir)
        closedir(dir);
    free(part);
    free(wanted);
    return st;
}

/* The file that `name` leads to from the folder, part by part; NULL if there is none. */
static cln_status find_alike(const char *folder, const char *name, char **out)
{
    cln_status st = CLN_OK;
    char *here = NULL, *next = NULL;

    *out = NULL;
    CLN_TRY(cln_strdup(&here, folder));
    for (const char *part = name; part && here; part = strchr(part, '/')) {
        part += *part == '/';
        CLN_TRY(find_entry(here, part, &next));
        free(here);
        here = next;
        next = NULL;
    }
    if (here && cln_is_file(here)) {
        *out = here;
        here = NULL;
    }
done:
    free(here);
    return st;
}

cln_status cln_moved_find(cln_moved *moved, const char *name, bool leads_out, char **out)
{
    cln_status st = CLN_OK;
    char *form = NULL;

    CLN_TRY(find_form(moved, name, leads_out, out));
    for (int composed = 0; composed < 2 && !*out; composed++) {
        free(form);
        form = cln_unicode_form(name, composed);
        if (form)
            CLN_TRY(find_form(moved, form, leads_out, out));
    }
    if (!*out && cln_dataset_is_unread(name)) { /* the photo was converted since */
        free(form);
        form = NULL;
        CLN_TRY(cln_strdup(&form, name));
        *strrchr(form, '.') = 0;
        CLN_TRY(find_form(moved, form, leads_out, out));
    }
    if (!*out && has_letters_beyond(name)) /* the case of others is looked at above */
        CLN_TRY(find_alike(moved->folder, name, out));
done:
    free(form);
    return st;
}

/* How well two names of an image agree: 0 if they do not; less if one has more folders before it,
 * or if they differ in case. An ending may be lacking in one of them. */
static int agreement(const char *a, const char *b)
{
    const bool ended = cln_dataset_is_image(a) && cln_dataset_is_image(b);
    const size_t x = ended ? strlen(a) : stem_of(a), y = ended ? strlen(b) : stem_of(b);
    const size_t end = x < y ? x : y;
    const char *longer = x < y ? b : a, *rest = longer + (x < y ? y : x) - end;
    const char *shorter = x < y ? a : b;

    if (strncasecmp(rest, shorter, end) != 0 || (x != y && rest[-1] != '/'))
        return 0;
    return (x == y ? 3 : 1) + (strncmp(rest, shorter, end) == 0);
}

void cln_moved_meant(const cln_names *names, const char *name, const char *found[2])
{
    const char *base = cln_last_name(name);
    int best = 0;

    found[0] = found[1] = NULL;
    for (int i = first_like(names, base); i < names->count; i++) {
        const char *candidate = names->name[i];
        const int agrees = agreement(candidate, name);

        if (compare_stems(cln_last_name(candidate), base) != 0)
            break;
        if (!agrees || agrees < best || (found[0] && strcmp(candidate, found[0]) == 0))
            continue;
        found[1] = agrees == best ? candidate : NULL;
        found[0] = agrees == best ? found[0] : candidate;
        best = agrees;
    }
}

/* ---- of all views ---- */

typedef struct place {
    dev_t device;
    ino_t inode;
    int view;
} place;

static int by_place(const void *a, const void *b)
{
    const place *x = a, *y = b;

    if (x->device != y->device)
        return x->device < y->device ? -1 : 1;
    return x->inode < y->inode ? -1 : x->inode > y->inode;
}

/* Takes files back that views of different names would share; old[view] is the path before, NULL
 * if it is not to be changed back. */
static cln_status take_back(cln_reader_result *result, char **old)
{
    cln_status st = CLN_OK;
    cln_view *views = result->views;
    place *places = NULL;
    int count = 0;

    CLN_TRY(cln_alloc(&places, (size_t)result->view_count, sizeof *places, "images"));
    for (int i = 0; i < result->view_count; i++) {
        struct stat info;

        if (stat(views[i].path, &info) == 0)
            places[count++] = (place){info.st_dev, info.st_ino, i};
    }
    qsort(places, (size_t)count, sizeof *places, by_place);
    for (int from = 0, to = 0; from < count; from = to) {
        bool shared = false;

        for (to = from; to < count && by_place(&places[from], &places[to]) == 0; to++)
            shared |= strcmp(views[places[from].view].name, views[places[to].view].name) != 0;
        for (int i = from; i < to && shared; i++) {
            const int v = places[i].view;

            if (!old[v])
                continue;
            free(views[v].path);
            views[v].path = old[v];
            old[v] = NULL;
        }
    }
done:
    free(places);
    return st;
}

typedef enum rule {
    BY_ENDS,  /* of paths alone */
    BY_NAMES, /* or by what a file is called, if the dataset does not say where it is */
    ANYWHERE  /* or by that in any case */
} rule;

static cln_status move_views(cln_moved *moved, rule how, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char **old = NULL;
    bool any = false;

    CLN_TRY(cln_alloc(&old, (size_t)result->view_count, sizeof *old, "images"));
    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];
        char *found = NULL;

        if ((cln_is_file(view->path) && !cln_dataset_is_unread(view->path)) ||
            (how == BY_NAMES && !view->leads_out && !(moved->bare && !strchr(view->name, '/'))))
            continue;
        CLN_TRY(cln_moved_find(moved, view->name, how != BY_ENDS, &found));
        if (!found)
            continue;
        any = true;
        old[i] = view->path;
        view->path = found;
    }
    if (any)
        CLN_TRY(take_back(result, old));
    for (int i = 0; i < result->view_count; i++) {
        if (!old[i])
            continue;
        if (!result->moved_count++) {
            CLN_TRY(cln_strdup(&result->moved_to, result->views[i].path));
            result->moved_from = old[i];
            old[i] = NULL;
        }
    }
done:
    for (int i = 0; old && i < result->view_count; i++)
        free(old[i]);
    free(old);
    return st;
}

/* Is no image where its path leads, and has each one file with its name? */
static cln_status lie_elsewhere(cln_moved *moved, const cln_reader_result *result, bool *all)
{
    cln_status st = CLN_OK;

    *all = true;
    for (int i = 0; i < result->view_count && *all; i++)
        *all = !cln_is_file(result->views[i].path);
    for (int i = 0; i < result->view_count && *all; i++) {
        char *found = NULL;

        CLN_TRY(cln_moved_find(moved, result->views[i].name, true, &found));
        *all = found != NULL;
        free(found);
    }
done:
    return st;
}

cln_status cln_moved_views(cln_moved *moved, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    bool elsewhere = false;

    CLN_TRY(move_views(moved, BY_ENDS, result));
    CLN_TRY(move_views(moved, BY_NAMES, result));
    CLN_TRY(lie_elsewhere(moved, result, &elsewhere));
    if (elsewhere)
        CLN_TRY(move_views(moved, ANYWHERE, result));
done:
    return st;
}

/* The path of this file in the folder, in whichever form of its name it is there; or NULL. */
static cln_status take_file(const char *folder, const char *name, char **out)
{
    cln_status st = CLN_OK;
    char *form = NULL;

    CLN_TRY(cln_path_join(out, folder, name));
    for (int composed = 0; composed < 2 && !cln_is_file(*out); composed++) {
        free(form);
        form = cln_unicode_form(name, composed);
        free(*out);
        *out = NULL;
        CLN_TRY(cln_path_join(out, folder, form ? form : name));
    }
    if (cln_is_file(*out))
        goto done;
    free(*out);
    *out = NULL;
    CLN_TRY(find_alike(folder, name, out));
done:
    free(form);
    return st;
}

cln_status cln_moved_file(const char *folder, const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *name = NULL;

    *out = NULL;
    st = cln_dataset_name(folder, path, &name);
    if (st == CLN_INPUT) { /* no name of a file */
        cln_clear_error();
        return CLN_OK;
    }
    CLN_TRY(st);
    for (const char *end = name; end && !*out; end = strchr(end, '/') ? strchr(end, '/') + 1 : NULL)
        CLN_TRY(take_file(folder, end, out));
done:
    free(name);
    return st;
}

cln_status cln_moved_apart(cln_moved *moved, const char *name, char **out)
{
    cln_status st = CLN_OK;
    const char *base = cln_last_name(name);
    size_t length = 0;
    int i = 0;

    *out = NULL;
    CLN_TRY(list(moved));
    i = first_like(&moved->apart, base);
    if (i < moved->apart.count && compare_stems(cln_last_name(moved->apart.name[i]), base) == 0) {
        CLN_TRY(cln_moved_scene(moved, moved->apart.name[i], &length));
        CLN_TRY(cln_asprintf(out, "%.*s", (int)length, moved->apart.name[i]));
    }
done:
    return st;
}

cln_status cln_moved_hint(cln_moved *moved, const char *name, char **out)
{
    cln_status st = CLN_OK;
    const char *base = cln_last_name(name), *first = NULL, *other = NULL;
    char *unread = NULL, *path = NULL, *apart = NULL;
    int likes = 0, unread_count = 0;

    CLN_TRY(list(moved));
    for (int i = first_like(&moved->files, base); i < moved->files.count; i++) {
        const char *file = moved->files.name[i];

        if (compare_stems(cln_last_name(file), base) != 0)
            break;
        other = other ? other : file;
        if (!is_like(file, base))
            continue;
        first = first ? first : file;
        likes++;
    }
    if (!other)
        CLN_TRY(cln_dataset_unread(moved->folder, name, &unread_count, &unread));
    if (!other && !unread)
        CLN_TRY(cln_moved_apart(moved, name, &apart));
    if (first || other || unread)
        CLN_TRY(cln_path_join(&path, moved->folder, first ? first : other ? other : unread));
    if (likes > 1)
        CLN_TRY(cln_asprintf(out, "; %d files there are called so, one is %s: correct the dataset",
                             likes, path));
    else if (likes)
        CLN_TRY(cln_asprintf(out, "; %s is there: move it, or correct the dataset", path));
    else if (other)
        CLN_TRY(cln_asprintf(out,
                             "; %s is there, with another ending: write '%s' in place of '%s' into "
                             "the scene's file, or convert the photos",
                             path, strrchr(path, '.'),
                             strrchr(base, '.') ? strrchr(base, '.') : ""));
    else if (unread)
        CLN_TRY(cln_asprintf(out,
                             "; %s is there, in a format that is not read: convert it to PNG or "
                             "JPEG%s",
                             path, unread_count > 1 ? ", and the others" : ""));
    else if (apart)
        CLN_TRY(cln_asprintf(out,
                             "; its folder '%s', which has a photo of that name, is a scene of its "
                             "own: give that one",
                             apart));
    else
        CLN_TRY(cln_strdup(out, ""));
done:
    free(unread);
    free(path);
    free(apart);
    return st;
}
