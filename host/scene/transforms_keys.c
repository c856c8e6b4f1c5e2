/* Which keys of a transforms JSON document are not read. See transforms.h. Users add keys that
 * other programs read (depth_file_path, near, far): without a message they would think that these
 * are read. */
#include "scene/transforms.h"

#include <string.h>

/* Keys of the document or of a frame that are read; parameters of lens models are in their own
 * table. */
static const char *const used[] = {"frames",
                                   "file_path",
                                   "transform_matrix",
                                   "mask_path",
                                   "alpha_path",
                                   "camera_angle_x",
                                   "fl_x",
                                   "camera_angle_y",
                                   "fl_y",
                                   "cx",
                                   "cy",
                                   "w",
                                   "h",
                                   "camera_model",
                                   "is_fisheye",
                                   "ftheta_p0",
                                   "distortion_params",
                                   "aabb_scale",
                                   "scale",
                                   "offset",
                                   "aabb",
                                   "train_filenames",
                                   "k3",
                                   "k4",
                                   "k5",
                                   "k6",
                                   "val_filenames",
                                   "test_filenames",
                                   "ply_file_path"};

static bool is_used(const char *key)
{
    for (size_t i = 0; i < sizeof used / sizeof *used; i++)
        if (strcmp(key, used[i]) == 0)
            return true;
    for (int lens = 0; lens < CLN_LENSES; lens++)
        for (int i = 0; i < cln_lens_models[lens].count; i++)
            if (strcmp(key, cln_lens_models[lens].params[i]) == 0)
                return true;
    return false;
}

static bool is_listed(const json_t *list, const char *key)
{
    for (size_t i = 0; i < json_array_size(list); i++)
        if (strcmp(json_string_value(json_array_get(list, i)), key) == 0)
            return true;
    return false;
}

cln_status cln_transforms_ignored(const json_t *object, json_t **list)
{
    const char *key = NULL;
    json_t *value = NULL;

    if (!*list)
        *list = json_array();
    json_object_foreach((json_t *)object, key, value)
    {
        if (!is_used(key) && !is_listed(*list, key) &&
            json_array_append_new(*list, json_string(key)) != 0)
            return cln_fail(CLN_MEMORY, "scene: no memory for the names of its keys");
    }
    return CLN_OK;
}
