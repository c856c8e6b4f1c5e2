/* Masks for programs that look for features: what readers find beside photos (masks.c), each as a
 * grey PNG of its photo's stored pixels, 0 where nothing is to be looked for. See dataset.h. */
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

/* Of a mask, the pixels that are black, or cut away by its alpha. */
static int64_t make_black(const cln_view *view, int64_t count, int channels, const uint8_t *mask,
                          uint8_t *grey)
{
    int64_t black = 0;

    for (int64_t i = 0; i < count; i++) {
        const uint8_t *p = mask + i * channels;
        const bool dark =
            p[0] < view->mask_least && p[1] < view->mask_least && p[2] < view->mask_least;

        grey[i] = dark || (channels == 4 && p[3] == 0) ? 0 : 255;
        black += grey[i] == 0;
    }
    return black;
}

/* *share: of its pixels that are black. */
static cln_status write_black(const cln_view *view, const char *path, double *share)
{
    cln_status st = CLN_OK;
    int width = 0, height = 0, channels = 0;
    const int64_t count = (int64_t)view->file_width * view->file_height;
    uint8_t *mask = NULL, *grey = NULL;
    char *slash = NULL, *folder = NULL;

    CLN_TRY(cln_image_load(view->mask_path, &width, &height, &channels, &mask));
    CLN_TRY(cln_image_turn(view->mask_turn, &width, &height, channels, &mask));
    CLN_TRY(cln_image_fit(view->file_width, view->file_height, &width, &height, channels, &mask));
    CLN_TRY(cln_alloc(&grey, (size_t)count, 1, view->mask_path));
    *share = (double)make_black(view, count, channels, mask, grey) / (double)count;
    CLN_TRY(cln_strdup(&folder, path));
    slash = strrchr(folder, '/');
    *slash = 0;
    CLN_TRY(cln_make_dirs(folder));
    CLN_TRY(cln_image_write_png(path, width, height, 1, grey));
done:
    free(mask);
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
    CLN_TRY(cln_dataset_views(scene, images, names, &result));
    CLN_TRY(cln_dataset_find_masks(scene, images, &result));
    for (int i = 0; i < result.view_count; i++) {
        cln_view *view = &result.views[i];
        cln_image_head head;

        CLN_TRY(cln_image_read_head(view->path, &head));
        view->file_width = head.width;
        view->file_height = head.height;
        view->orientation = head.orientation;
    }
    views.views = result.views;
    views.view_count = result.view_count;
    CLN_TRY(cln_scene_turn_masks(&views));
    for (int i = 0; i < result.view_count; i++) {
        double share = 0;

        CLN_TRY(cln_poll_signal(callbacks));
        if (!result.views[i].mask_path)
            continue;
        free(path);
        path = NULL;
        CLN_TRY(cln_asprintf(&path, "%s/%s.png", out, names->name[i]));
        CLN_TRY(write_black(&result.views[i], path, &share));
        masks->black += share;
        masks->count++;
    }
    masks->black /= masks->count ? masks->count : 1;
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
