/* Masks that lie beside photos without being named, where programs for photogrammetry look for
 * them. Black pixels are left out, by each of their documents:
 *   masks/NAME.png    COLMAP, with the photo's name and ending: "Mask image regions" of its FAQ
 *                     (black, 0 in grey, gives no features); OpenSfM has the same names and zeros
 *   masks/NAME        with the photo's ending or another one, beside LLFF's images (NeRD)
 *   masks/STEM_mask.ENDING  Metashape's export
 *   STEM_mask.ENDING  OpenDroneMap, beside the photo: "Using Image Masks" of its documentation
 *                     ("Color in black the areas to exclude")
 * The folder may be called mask, too, both in any case; in it, two photos never share a mask, but a
 * single image is that of all photos of its shape, unless it is called like one. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/dataset.h"
#include "scene/moved.h"
#include "scene/placing.h"

#define TAIL "_mask"

/* Of a mask or photo whose stem is known; "": the ending that it has. */
static const char *const endings[] = {"", ".JPG", ".jpg", ".PNG", ".png", ".jpeg", ".JPEG"};

static int stem_of(const char *path)
{
    const char *dot = strrchr(path, '.');

    return dot && !strchr(dot, '/') ? (int)(dot - path) : (int)strlen(path);
}

bool cln_dataset_is_mask(const char *name)
{
    const int stem = stem_of(name), tail = (int)sizeof TAIL - 1;

    return stem > tail && strncmp(name + stem - tail, TAIL, (size_t)tail) == 0;
}

cln_status cln_dataset_is_mask_of(const char *name, const cln_names *images, bool *is)
{
    cln_status st = CLN_OK;
    const int bare = stem_of(name) - (int)sizeof TAIL + 1;

    *is = false;
    for (size_t i = 1; i < sizeof endings / sizeof *endings && !*is; i++) {
        char *photo = NULL;

        if (!cln_dataset_is_mask(name))
            break;
        CLN_TRY(cln_asprintf(&photo, "%.*s%s", bare, name, endings[i]));
        *is = cln_dataset_has_name(images, photo);
        free(photo);
    }
done:
    return st;
}

bool cln_dataset_has_masks(const char *folder)
{
    return !strcasecmp(folder, "masks") || !strcasecmp(folder, "mask");
}

/* Masks with another shape than their photo's; the first, as a clause. */
typedef struct other_sizes {
    int count;
    char first[320];
} other_sizes;

/* Takes the file, if it is there, as the view's mask, unless its shape is another than the photo's,
 * stored or turned: one that is smaller or larger alone is brought to its size. */
static bool take(char *path, cln_view *view, other_sizes *other)
{
    int size[2] = {0}, photo[2] = {0}, channels = 0;

    if (!path || !cln_is_file(path))
        return false;
    if (cln_image_info(path, &size[0], &size[1], &channels) != CLN_OK ||
        cln_image_info(view->path, &photo[0], &photo[1], &channels) != CLN_OK)
        cln_clear_error(); /* the photo is missing, or the mask damaged: what reads them says so */
    else if (!cln_image_alike(size[0], size[1], photo[0], photo[1]) &&
             !cln_image_alike(size[0], size[1], photo[1], photo[0])) {
        if (!other->count++)
            snprintf(other->first, sizeof other->first, "%s has %d x %d pixels, its photo %d x %d",
                     path, size[0], size[1], photo[0], photo[1]);
        return false;
    }
    view->mask_path = path;
    return true;
}

/* Names of a photo's mask in their folder, the surest first; `loose` ones stand for any ending, and
 * count where one file has them, for one photo. */
static const struct {
    const char *behind;
    bool stem, loose;
} forms[] = {{".png", false, false}, {"", false, false}, {"", true, true}, {TAIL, true, true}};

/* What a photo is called from the folder of images, or, elsewhere, by the dataset. */
static const char *name_in(const char *images, const cln_view *view)
{
    const size_t length = strlen(images);

    return strncmp(view->path, images, length) == 0 && view->path[length] == '/'
               ? view->path + length + 1
               : view->name;
}

static cln_status find_in_folder(cln_moved *masks, const char *images, cln_view *view,
                                 other_sizes *other, bool *loose)
{
    cln_status st = CLN_OK;
    const char *called = name_in(images, view);
    char *name = NULL, *path = NULL;
    const int before = other->count;
    const bool out = view->leads_out || cln_path_leads_out(view->name); /* of another machine */

    for (size_t i = 0; i < sizeof forms / sizeof *forms && other->count == before; i++) {
        free(name);
        free(path);
        name = path = NULL;
        CLN_TRY(cln_asprintf(&name, "%.*s%s", forms[i].stem ? stem_of(called) : (int)strlen(called),
                             called, forms[i].behind));
        CLN_TRY(cln_moved_find(masks, name, out, &path));
        if (!path || strcmp(path, view->path) == 0 || !take(path, view, other))
            continue;
        path = NULL;
        *loose = forms[i].loose;
        break;
    }
done:
    free(name);
    free(path);
    return st;
}

static cln_status find_beside(cln_view *view, other_sizes *other)
{
    cln_status st = CLN_OK;
    const int stem = stem_of(view->path), before = other->count;
    char *path = NULL;

    for (size_t i = 0; i < sizeof endings / sizeof *endings && other->count == before; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%.*s%s%s", stem, view->path, TAIL,
                             i ? endings[i] : view->path + stem));
        if (take(path, view, other))
            return CLN_OK;
    }
done:
    free(path);
    return st;
}

/* May a folder of this name have masks, although none are looked for there? As mask_sam and
 * people_masks, not as photos_masked. */
static bool is_nearly_called(const char *name)
{
    const char *at = strcasestr(name, "mask");

    return (at && (at == name || strchr("_- .", at[-1])) && strncasecmp(at, "masked", 6) != 0) ||
           strncasecmp(name, "masque", 6) == 0;
}

/* The only folder of `base` that is called so; `masks` as it stands goes first. NULL if there is
 * none, or no telling which. */
static cln_status find_called(const char *base, char **out)
{
    cln_status st = CLN_OK;
    cln_names names = {0};
    const char *found = NULL, *nearly = NULL;
    int count = 0;

    if (cln_has_dir(base, "masks"))
        return cln_path_join(out, base, "masks");
    st = cln_dataset_folders(base, &names);
    if (st == CLN_INPUT) { /* a folder that may not be read has none */
        cln_clear_error();
        st = CLN_OK;
    }
    CLN_TRY(st);
    for (int i = 0; i < names.count; i++)
        if (cln_dataset_has_masks(names.name[i])) {
            found = names.name[i];
            count++;
        } else if (is_nearly_called(names.name[i])) {
            nearly = names.name[i];
        }
    if (count == 0 && nearly)
        cln_warn("%s/%s: is not read; if it has masks, call it masks", base, nearly);
    if (count == 1)
        CLN_TRY(cln_path_join(out, base, found));
    else if (count > 1)
        cln_warn("%s: %d folders may have masks, '%s' among them: none is read; call the one that "
                 "has them masks",
                 base, count, found);
done:
    cln_dataset_free_names(&names);
    return st;
}

/* In the scene, else beside the folder of images; NULL if there is none. */
static cln_status find_folder(const char *scene, const char *images, char **out)
{
    cln_status st = CLN_OK;
    char *beside = NULL, *whole = NULL, *slash = NULL;

    CLN_TRY(find_called(scene, out));
    CLN_TRY(cln_path_absolute(&beside, images));
    CLN_TRY(cln_path_absolute(&whole, scene));
    if (strcmp(beside, whole) == 0) /* what is beside a scene is not the scene's */
        goto done;
    slash = strrchr(beside, '/');
    if (slash && slash > beside)
        *slash = 0;
    if (!*out && strcmp(beside, whole) != 0)
        CLN_TRY(find_called(beside, out));
done:
    free(beside);
    free(whole);
    return st;
}

typedef struct found_mask {
    const char *path;
    int view;
    bool loose;
} found_mask;

static int by_path(const void *a, const void *b)
{
    const found_mask *x = a, *y = b;
    const int order = strcmp(x->path, y->path);

    return order ? order : x->loose - y->loose;
}

/* Takes masks back that several photos have by a loose name, as x.png of x.jpg and x.png. */
static void part(found_mask *found, int count, cln_reader_result *result)
{
    int next = 0;

    if (count)
        qsort(found, (size_t)count, sizeof *found, by_path);
    for (int i = 0; i < count; i = next) {
        for (next = i + 1; next < count && strcmp(found[i].path, found[next].path) == 0;)
            next++;
        for (int k = next - 1; k >= i && next > i + 1; k--) {
            cln_view *view = &result->views[found[k].view];

            if (!found[k].loose)
                continue;
            free(view->mask_path);
            view->mask_path = NULL;
        }
    }
}

void cln_dataset_tell_masks(const cln_reader_result *result, char text[64])
{
    text[0] = 0;
    if (result->mask_count)
        snprintf(text, 64, ", %d of them with a mask", result->mask_count);
}

/* Masks in formats that are not read. */
static cln_status tell_unread(const char *masks)
{
    cln_status st = CLN_OK;
    char *first = NULL;
    int count = 0;

    CLN_TRY(cln_dataset_unread(masks, NULL, &count, &first));
    if (first)
        cln_warn("%s: %d mask%s not read, as %s neither PNG nor JPEG, for example '%s': convert "
                 "%s to PNG (mogrify -format png, of ImageMagick)",
                 masks, count, cln_plural(count, " is", "s are"),
                 cln_plural(count, "it is", "they are"), first, cln_plural(count, "it", "them"));
done:
    free(first);
    return st;
}

/* Is a mask called like a photo in the folder of images, which the scene may leave out? */
static cln_status is_of_a_photo(const char *images, const char *mask, bool *is)
{
    cln_status st = CLN_OK;
    const int stem = stem_of(mask);
    const int bare = cln_dataset_is_mask(mask) ? stem - (int)sizeof TAIL + 1 : stem;

    *is = cln_has_file(images, mask);
    for (size_t i = 0; i < sizeof endings / sizeof *endings && !*is; i++) {
        char *name = NULL;

        CLN_TRY(cln_asprintf(&name, "%.*s%s", bare, mask, endings[i]));
        *is = cln_has_file(images, name);
        free(name);
    }
done:
    return st;
}

/* Gives all photos of its shape the only image in the folder, unless it is a single one's. */
static cln_status take_for_all(const cln_moved *masks, const char *images,
                               cln_reader_result *result, int *count)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    other_sizes other = {0};
    bool single = false;

    CLN_TRY(is_of_a_photo(images, masks->files.name[0], &single));
    if (single)
        goto done;
    CLN_TRY(cln_path_join(&path, masks->folder, masks->files.name[0]));
    for (int i = 0; i < result->view_count; i++) {
        char *own = NULL;

        CLN_TRY(cln_strdup(&own, path));
        if (take(own, &result->views[i], &other))
            (*count)++;
        else
            free(own);
    }
    if (*count)
        cln_info("%s: the only image there, so it is the mask of %d of %d photos", path, *count,
                 result->view_count);
done:
    free(path);
    return st;
}

cln_status cln_dataset_find_masks(const char *scene, const char *images, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_moved in_folder = {0};
    char *masks = NULL;
    found_mask *loose = NULL;
    int found = 0, taken = 0;
    other_sizes other = {0};

    CLN_TRY(find_folder(scene, images, &masks));
    CLN_TRY(cln_alloc(&loose, (size_t)result->view_count, sizeof *loose, "masks"));
    in_folder.folder = masks;
    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];
        found_mask *mask = &loose[taken];

        if (!view->mask_path && masks)
            CLN_TRY(find_in_folder(&in_folder, images, view, &other, &mask->loose));
        if (!view->mask_path)
            CLN_TRY(find_beside(view, &other));
        if (!view->mask_path)
            continue;
        mask->path = view->mask_path;
        mask->view = i;
        taken++;
    }
    part(loose, taken, result);
    for (int i = 0; i < result->view_count; i++)
        found += result->views[i].mask_path != NULL;
    if (masks && !found && !other.count && in_folder.files.count == 1)
        CLN_TRY(take_for_all(&in_folder, images, result, &found));
    result->mask_count = found;
    if (other.count)
        cln_warn("%s: %d mask%s not read, as %s not the shape of %s photo%s: %s",
                 masks ? masks : images, other.count, cln_plural(other.count, " is", "s are"),
                 cln_plural(other.count, "it has", "they have"),
                 cln_plural(other.count, "its", "their"), cln_plural(other.count, "", "s"),
                 other.first);
    if (masks && found + other.count < result->view_count)
        CLN_TRY(tell_unread(masks));
    if (found && found + other.count < result->view_count)
        cln_warn("%s: %d of %d photos have a mask, the others are used whole",
                 masks ? masks : images, found, result->view_count);
    if (masks && !found && !other.count && in_folder.files.count)
        cln_warn(
            "%s: it has %d images, for example '%s', but none is called like one photo alone "
            "('%s', with any ending, or with _mask before it, or with .png behind, as COLMAP's "
            "masks are): no mask is read",
            masks, in_folder.files.count, in_folder.files.name[0], result->views[0].name);
done:
    cln_moved_free(&in_folder);
    free(loose);
    free(masks);
    return st;
}
