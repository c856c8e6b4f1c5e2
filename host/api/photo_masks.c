/* Masks of photos for COLMAP. See photo_masks.h. */
#include "api/photo_masks.h"

#include <stdlib.h>
#include <string.h>
#include "api/photo_folder.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"

cln_status cln_photo_masks_among(const char *photos, const cln_names *among, char **out)
{
    cln_status st = CLN_OK;
    char *top = NULL;

    CLN_TRY(cln_asprintf(&top, "%.*s", (int)strcspn(among->name[0], "/"), among->name[0]));
    if (strchr(among->name[0], '/') && cln_dataset_has_masks(top))
        CLN_TRY(cln_path_join(out, photos, top));
    else
        CLN_TRY(cln_strdup(out, photos));
done:
    free(top);
    return st;
}

/* The folder of photos as that of their masks: these lie beside them. */
static cln_status check_among(const char *masks, const cln_names *among)
{
    cln_status st = CLN_OK;
    char *folder = NULL;

    if (among->count == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--mask-path %s: is the folder of the photos, and no photo has a mask "
                         "beside it (IMG_1_mask.png of IMG_1.jpg); give the folder of the masks",
                         masks));
    CLN_TRY(cln_photo_masks_among(masks, among, &folder));
    if (strcmp(folder, masks) != 0)
        CLN_TRY(cln_fail(
            CLN_INPUT, "--mask-path %s: is the folder of the photos; give %s, which has the masks",
            masks, folder));
done:
    free(folder);
    return st;
}

cln_status cln_photo_masks_check(const char *masks, const char *photos, const cln_names *among)
{
    cln_status st = CLN_OK;
    cln_names names = {0};
    char *there = NULL, *around = NULL;
    size_t length = 0;

    if (cln_is_file(masks)) {
        CLN_TRY(cln_image_check_ends(masks));
        goto done;
    }
    if (!cln_is_dir(masks))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--mask-path %s: it is not there; give a folder of masks, or one picture "
                         "for all photos",
                         masks));
    if (cln_is_same_file(masks, photos)) {
        CLN_TRY(check_among(masks, among));
        goto done;
    }
    CLN_TRY(cln_path_absolute(&there, photos));
    CLN_TRY(cln_path_absolute(&around, masks));
    length = strlen(around);
    if (cln_is_dir(photos) && strncmp(there, around, length) == 0 && there[length] == '/')
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--mask-path %s: the photos are in it, too, and would be taken for masks; "
                         "give a folder that has the masks alone",
                         masks));
    CLN_TRY(cln_dataset_images(masks, &names));
    if (names.count == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--mask-path %s: has no PNG or JPEG file; masks are called as the photos, "
                         "with any ending, or with .png behind (IMG_1.jpg.png)",
                         masks));
done:
    cln_dataset_free_names(&names);
    free(there);
    free(around);
    return st;
}

cln_status cln_photo_masks_link(const char *masks, const char *photos, const cln_names *among,
                                const char *out)
{
    cln_status st = CLN_OK;
    char *folder = NULL, *file = NULL;
    const char *dot = strrchr(masks, '.');
    cln_names names = {0};

    CLN_TRY(cln_path_join(&folder, out, "masks"));
    CLN_TRY(cln_make_dirs(folder));
    if (cln_is_dir(masks)) {
        CLN_TRY(cln_dataset_images(masks, &names));
        CLN_TRY(
            cln_photos_link(masks, cln_is_same_file(masks, photos) ? among : &names, folder, true));
        goto done;
    }
    /* called like no photo, it is that of all */
    CLN_TRY(cln_asprintf(&file, "%s/of_all_photos%s", folder, dot ? dot : ".png"));
    CLN_TRY(cln_dataset_images(folder, &names));
    if (names.count > (cln_is_file(file) ? 1 : 0))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: has masks already; give that folder, move it away, or give an empty "
                         "one with -o",
                         folder));
    CLN_TRY(cln_photos_link_file(masks, file, true));
done:
    cln_dataset_free_names(&names);
    free(folder);
    free(file);
    return st;
}

cln_status cln_photo_masks_write(const cln_colmap *c, char **folder)
{
    const char *given = c->desc->masks;
    cln_status st = CLN_OK;
    cln_black_masks masks = {0};
    char *out = NULL;

    *folder = NULL;
    CLN_TRY(cln_path_join(&out, c->desc->out, "colmap.masks"));
    CLN_TRY(cln_colmap_remove(out));
    CLN_TRY(cln_dataset_write_black(given ? c->desc->out : NULL, c->images, &c->photos, out,
                                    &c->desc->callbacks, &masks));
    if (given && masks.count == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--mask-path %s: none of its pictures is the mask of a photo; they are "
                         "called as the photos, with any ending, or with .png behind "
                         "(IMG_1.jpg.png), and have their shape",
                         given));
    if (masks.count)
        cln_info("masks: of %d of %d photos; COLMAP looks at nothing where they are black",
                 masks.count, c->photos.count);
    if (masks.cut)
        cln_info("alpha: COLMAP looks at nothing that it cuts away, in %d of %d photos", masks.cut,
                 c->photos.count);
    if (given && masks.black > 0.9)
        cln_warn("--mask-path %s: leaves %.3g %% of the photos to find poses by; if white is what "
                 "does not count, turn the masks over (mogrify -negate, of ImageMagick)",
                 given, 100 - 100 * masks.black);
    if (masks.written) {
        *folder = out;
        out = NULL;
    }
done:
    free(out);
    return st;
}
