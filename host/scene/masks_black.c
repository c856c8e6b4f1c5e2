/* Masks for programs that look for features: what readers find beside photos (masks.c), and what
 * the photos' own alpha cuts away, as a grey PNG of stored pixels, 0 where nothing is to be looked
 * for. See dataset.h. */
#include <stdlib.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "scene/build.h"
#include "scene/dataset.h"
#include "scene/placing.h"

enum { CUT = 128 }; /* alpha below that shows nothing */

/* Blackens what is black in the view's mask, or cut away by its alpha. */
static cln_status add_mask(const cln_view *view, int64_t count, uint8_t *grey)
{
    cln_status st = CLN_OK;
    int width = 0, height = 0, channels = 0;
    uint8_t *mask = NULL;

    CLN_TRY(cln_image_load(view->mask_path, &width, &height, &channels, &mask));
    CLN_TRY(cln_image_turn(view->mask_turn, &width, &height, channels, &mask));
    CLN_TRY(cln_image_fit(view->file_width, view->file_height, &width, &height, channels, &mask));
    for (int64_t i = 0; i < count; i++) {
        const uint8_t *p = mask + i * channels;

        if ((p[0] < view->mask_least && p[1] < view->mask_least && p[2] < view->mask_least) ||
            (channels == 4 && p[3] == 0))
            grey[i] = 0;
    }
done:
    free(mask);
    return st;
}

/* Blackens what the photo's own alpha cuts away; *cuts: whether that is anything. */
static cln_status add_alpha(const cln_view *view, int64_t count, uint8_t *grey, bool *cuts)
{
    cln_status st = CLN_OK;
    int width = 0, height = 0, channels = 0;
    uint8_t *pixels = NULL;

    CLN_TRY(cln_image_load(view->path, &width, &height, &channels, &pixels));
    if (channels != 4 || width != view->file_width || height != view->file_height)
        goto done;
    for (int64_t i = 0; i < count; i++)
        if (pixels[4 * i + 3] < CUT) {
            grey[i] = 0;
            *cuts = true;
        }
done:
    free(pixels);
    return st;
}

/* Writes it if the view has a mask, or alpha that cuts something away. */
static cln_status write_black(const cln_view *view, const char *path, cln_black_masks *masks)
{
    cln_status st = CLN_OK;
    const int64_t count = (int64_t)view->file_width * view->file_height;
    int64_t black = 0;
    uint8_t *grey = NULL;
    char *slash = NULL, *folder = NULL;
    bool cuts = false;

    if (!view->mask_path && view->channels != 4)
        return CLN_OK;
    CLN_TRY(cln_alloc(&grey, (size_t)count, 1, view->path));
    memset(grey, 255, (size_t)count);
    if (view->channels == 4)
        CLN_TRY(add_alpha(view, count, grey, &cuts));
    if (view->mask_path)
        CLN_TRY(add_mask(view, count, grey));
    else if (!cuts)
        goto done;
    for (int64_t i = 0; i < count; i++)
        black += grey[i] == 0;
    CLN_TRY(cln_strdup(&folder, path));
    slash = strrchr(folder, '/');
    *slash = 0;
    CLN_TRY(cln_make_dirs(folder));
    CLN_TRY(cln_image_write_png(path, view->file_width, view->file_height, 1, grey));
    masks->black += (double)black / (double)count;
    masks->count += view->mask_path != NULL;
    masks->cut += cuts;
    masks->written++;
done:
    free(grey);
    free(folder);
    return st;
}

cln_status cln_dataset_write_black(const char *scene, const char *images, const cln_names *names,
                                   const char *out, const cln_callbacks *callbacks,
                                   cln_black_masks *masks)
{
    cln_status st = CLN_OK;
    cln_reader_result result = {0};
    cln_scene views = {0}; /* as far as turns of masks go */
    char *path = NULL;

    *masks = (cln_black_masks){0};
    CLN_TRY(cln_dataset_views(images, images, names, &result));
    if (scene)
        CLN_TRY(cln_dataset_find_masks(scene, images, &result));
    for (int i = 0; i < result.view_count; i++) {
        cln_view *view = &result.views[i];
        cln_image_head head;

        CLN_TRY(cln_image_read_head(view->path, &head));
        view->file_width = head.width;
        view->file_height = head.height;
        view->orientation = head.orientation;
        view->channels = head.channels;
    }
    views.views = result.views;
    views.view_count = result.view_count;
    CLN_TRY(cln_scene_turn_masks(&views));
    for (int i = 0; i < result.view_count; i++) {
        CLN_TRY(cln_poll_signal(callbacks));
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s/%s.png", out, names->name[i]));
        CLN_TRY(write_black(&result.views[i], path, masks));
    }
    masks->black /= masks->written ? masks->written : 1;
done:
    for (int i = 0; i < result.view_count; i++) {
        free(result.views[i].name);
        free(result.views[i].path);
        free(result.views[i].mask_path);
    }
    free(result.views);
    free(path);
    return st;
}
