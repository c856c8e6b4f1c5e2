/* Masks that lie beside photos without being named, where programs for photogrammetry look for
 * them. Black pixels are left out, by each of their documents:
 *   masks/NAME.png    COLMAP, with the photo's name and ending: "Mask image regions" of its FAQ
 *                     (black, 0 in grey, gives no features); OpenSfM has the same names and zeros
 *   STEM_mask.ENDING  OpenDroneMap, beside the photo: "Using Image Masks" of its documentation
 *                     ("Color in black the areas to exclude") */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/dataset.h"
#include "scene/placing.h"

static const char TAIL[] = "_mask";

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

/* Takes the file, if it is there, as the view's mask, unless its sides are others than the photo's,
 * stored or turned. */
static bool take(char *path, cln_view *view, int *other_size)
{
    int size[2] = {0}, photo[2] = {0}, channels = 0;

    if (!path || !cln_is_file(path))
        return false;
    if (cln_image_info(path, &size[0], &size[1], &channels) != CLN_OK ||
        cln_image_info(view->path, &photo[0], &photo[1], &channels) != CLN_OK)
        cln_clear_error(); /* the photo is missing, or the mask damaged: what reads them says so */
    else if (!(size[0] == photo[0] && size[1] == photo[1]) &&
             !(size[0] == photo[1] && size[1] == photo[0])) {
        ++*other_size;
        return false;
    }
    view->mask_path = path;
    return true;
}

static cln_status find_mask(const char *masks, cln_view *view, int *other_size)
{
    static const char *const endings[] = {"", ".JPG", ".jpg", ".PNG", ".png", ".jpeg", ".JPEG"};
    cln_status st = CLN_OK;
    const int stem = stem_of(view->path);
    char *path = NULL;

    if (masks) {
        CLN_TRY(cln_asprintf(&path, "%s/%s.png", masks, view->name));
        if (take(path, view, other_size))
            return CLN_OK;
    }
    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%.*s%s%s", stem, view->path, TAIL,
                             i ? endings[i] : view->path + stem));
        if (take(path, view, other_size))
            return CLN_OK;
    }
done:
    free(path);
    return st;
}

/* `masks` beside the folder of images or in it, or in the scene; NULL if there is none. */
static cln_status find_folder(const char *scene, const char *images, char **out)
{
    cln_status st = CLN_OK;
    char *whole = NULL, *slash = NULL;

    CLN_TRY(cln_path_absolute(&whole, images));
    slash = strrchr(whole, '/');
    if (slash && slash > whole)
        *slash = 0;
    if (cln_has_dir(scene, "masks"))
        CLN_TRY(cln_path_join(out, scene, "masks"));
    else if (cln_has_dir(whole, "masks"))
        CLN_TRY(cln_path_join(out, whole, "masks"));
done:
    free(whole);
    return st;
}

void cln_dataset_tell_masks(const cln_reader_result *result, char text[64])
{
    text[0] = 0;
    if (result->mask_count)
        snprintf(text, 64, ", %d of them with a mask", result->mask_count);
}

cln_status cln_dataset_find_masks(const char *scene, const char *images, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_names there = {0};
    char *masks = NULL;
    int found = 0, other_size = 0;

    CLN_TRY(find_folder(scene, images, &masks));
    for (int i = 0; i < result->view_count; i++) {
        if (!result->views[i].mask_path)
            CLN_TRY(find_mask(masks, &result->views[i], &other_size));
        found += result->views[i].mask_path != NULL;
    }
    result->mask_count = found;
    if (other_size)
        cln_warn("%s: %d mask%s not read, as %s not the size of %s photo%s", masks ? masks : images,
                 other_size, cln_plural(other_size, " is", "s are"),
                 cln_plural(other_size, "it has", "they have"),
                 cln_plural(other_size, "its", "their"), cln_plural(other_size, "", "s"));
    if (found && found + other_size < result->view_count)
        cln_warn("%s: %d of %d photos have a mask, the others are used whole",
                 masks ? masks : images, found, result->view_count);
    if (masks && !found && !other_size)
        CLN_TRY(cln_dataset_images(masks, &there));
    if (there.count)
        cln_warn("%s: it has %d images, for example '%s', but none is called like a photo with "
                 ".png behind, as COLMAP's masks are ('%s.png'): no mask is read",
                 masks, there.count, there.name[0], result->views[0].name);
done:
    cln_dataset_free_names(&there);
    free(masks);
    return st;
}
