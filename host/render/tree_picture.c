/* Pictures of the octree. See tree_picture.h; the colours are io/palette.h's. */
#include "render/tree_picture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "io/image.h"
#include "io/palette.h"
#include "io/run_folder.h"

_Static_assert(CLN_PALETTE_LEVELS == CLN_MAX_LEVEL + 1, "a colour for each level");

static const float SEEN = 0.5f;       /* from this opacity on, a pixel shows a surface */
static const float LEAF_SHARE = 0.6f; /* of a leaf's colour in a pixel; the rest is the render */
static const float BORDER = 0.45f;    /* brightness of pixels at a border */

void cln_tree_levels(const cln_octree *tree, int count[CLN_MAX_LEVEL + 1])
{
    memset(count, 0, (CLN_MAX_LEVEL + 1) * sizeof *count);
    for (int s = 0; s < tree->leaf_count; s++)
        count[tree->level[tree->leaf[s]]]++;
}

void cln_tree_surface(const cln_model *model, const cln_camera *camera, const cln_picture *picture,
                      int32_t *slots)
{
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const size_t i = (size_t)y * (size_t)picture->width + (size_t)x;
            double origin[3], direction[3], point[3];

            slots[i] = -1;
            if (!(picture->opacity[i] >= SEEN) || !(picture->depth[i] > 0))
                continue;
            if (!cln_camera_ray(camera, x + 0.5, y + 0.5, origin, direction))
                continue;
            cln_space_depth_to_cube(&model->space, origin, direction, (double)picture->depth[i],
                                    point);
            slots[i] = cln_octree_find(&model->tree, point);
        }
}

/* Is the pixel beside or below in another leaf? */
static bool is_border(const cln_picture *picture, const int32_t *slots, int x, int y)
{
    const int32_t *here = slots + (size_t)y * (size_t)picture->width + (size_t)x;
    const int32_t beside = x + 1 < picture->width ? here[1] : -1;
    const int32_t below = y + 1 < picture->height ? here[picture->width] : -1;

    return (beside >= 0 && beside != *here) || (below >= 0 && below != *here);
}

void cln_tree_draw(const cln_picture *picture, const int32_t *slots, const uint8_t *colours,
                   uint8_t *rgb)
{
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++) {
            const size_t i = (size_t)y * (size_t)picture->width + (size_t)x;
            const float *render = picture->rgb + 3 * i;
            const float grey = 0.299f * render[0] + 0.587f * render[1] + 0.114f * render[2];
            const bool border = slots[i] >= 0 && is_border(picture, slots, x, y);

            for (int c = 0; c < 3; c++) {
                float value = render[c];

                if (slots[i] >= 0)
                    value = (1 - LEAF_SHARE) * grey +
                            LEAF_SHARE * (float)colours[3 * (size_t)slots[i] + (size_t)c] / 255.0f;
                rgb[3 * i + (size_t)c] = cln_to_u8(border ? BORDER * value : value);
            }
        }
}

static cln_status write_drawing(const char *folder, const char *name, const char *suffix,
                                const cln_picture *picture, const int32_t *slots,
                                const uint8_t *colours, uint8_t *rgb)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(cln_asprintf(&path, "%s/%s%s", folder, name, suffix));
    cln_tree_draw(picture, slots, colours, rgb);
    CLN_TRY(cln_image_write_png(path, picture->width, picture->height, 3, rgb));
done:
    free(path);
    return st;
}

/* The scale of the leaves' errors; false if none is known. */
static bool error_range(const cln_model *model, double *low, double *high)
{
    return cln_palette_range(model->error ? model->tree.leaf_count : 0, model->error, low, high);
}

void cln_tree_colours(const cln_model *model, bool error, uint8_t *colours, double *low,
                      double *high)
{
    const cln_octree *tree = &model->tree;

    *low = *high = NAN;
    if (error)
        (void)error_range(model, low, high);
    for (int s = 0; s < tree->leaf_count; s++) {
        uint8_t *colour = colours + 3 * (size_t)s;

        if (error)
            cln_palette_error(model->error ? (double)model->error[s] : NAN, *low, *high, colour);
        else
            cln_palette_level(tree->level[tree->leaf[s]], colour);
    }
}

cln_status cln_tree_save(const cln_model *model, const cln_view *view, const cln_picture *picture,
                         const char *folder)
{
    cln_status st = CLN_OK;
    const cln_octree *tree = &model->tree;
    const size_t pixels = (size_t)picture->width * (size_t)picture->height;
    const char *name = view->file;
    int32_t *slots = NULL;
    uint8_t *colours = NULL, *rgb = NULL;
    double low = NAN, high = NAN;

    CLN_TRY(cln_alloc(&slots, pixels, sizeof *slots, "picture of the tree"));
    CLN_TRY(cln_alloc(&rgb, pixels, 3, "picture of the tree"));
    CLN_TRY(cln_alloc(&colours, (size_t)tree->leaf_count, 3, "picture of the tree"));
    cln_tree_surface(model, &view->camera, picture, slots);
    cln_tree_colours(model, false, colours, &low, &high);
    CLN_TRY(write_drawing(folder, name, ".tree.png", picture, slots, colours, rgb));
    cln_tree_colours(model, true, colours, &low, &high);
    if (high > 0)
        CLN_TRY(write_drawing(folder, name, ".tree-error.png", picture, slots, colours, rgb));
done:
    free(slots);
    free(colours);
    free(rgb);
    return st;
}

cln_status cln_tree_describe(const cln_model *model, const json_t *views, const char *folder)
{
    cln_status st = CLN_OK;
    int count[CLN_MAX_LEVEL + 1];
    double low = NAN, high = NAN;
    json_t *levels = json_array(), *about = NULL, *error = NULL;

    cln_tree_levels(&model->tree, count);
    for (int level = 0; level <= CLN_MAX_LEVEL; level++)
        json_array_append_new(levels, json_integer(count[level]));
    error = error_range(model, &low, &high) ? json_pack("{s:f, s:f}", "low", low, "high", high)
                                            : json_null();
    about = json_pack("{s:s, s:I, s:i, s:o, s:o, s:O}", "schema", "cl-nascent.tree/1", "step",
                      (json_int_t)model->step, "leaves", model->tree.leaf_count, "leaves_by_level",
                      levels, "error", error, "views", views);
    if (!about)
        CLN_TRY(cln_fail(CLN_MEMORY, "tree.json: cannot make JSON"));
    CLN_TRY(cln_run_write_json(folder, "tree.json", about));
done:
    json_decref(about);
    return st;
}
