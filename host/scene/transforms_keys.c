/* Which keys of a transforms JSON document are not read. See transforms.h. Users add keys that
 * other programs read (depth_file_path, near, far): without a message they would think that these
 * are read. */
#include "scene/transforms.h"

#include <string.h>

/* Where keys are read; parameters of lens models are in their own table. */
static const struct {
    const char *key;
    bool of_document, of_frame;
} used[] = {{"frames", true, false},
            {"aabb_scale", true, false},
            {"scale", true, false},
            {"offset", true, false},
            {"aabb", true, false},
            {"train_filenames", true, false},
            {"val_filenames", true, false},
            {"test_filenames", true, false},
            {"ply_file_path", true, false},
            {"file_path", false, true},
            {"transform_matrix", false, true},
            {"mask_path", false, true},
            {"alpha_path", false, true},
            {"camera_angle_x", true, true},
            {"camera_angle_y", true, true},
            {"fl_x", true, true},
            {"fl_y", true, true},
            {"cx", true, true},
            {"cy", true, true},
            {"w", true, true},
            {"h", true, true},
            {"camera_model", true, true},
            {"is_fisheye", true, true},
            {"ftheta_p0", true, true},
            {"distortion_params", true, true},
            {"k3", true, true},
            {"k4", true, true},
            {"k5", true, true},
            {"k6", true, true}};

static bool is_used(const char *key, bool frame)
{
    for (size_t i = 0; i < sizeof used / sizeof *used; i++)
        if (strcmp(key, used[i].key) == 0)
            return frame ? used[i].of_frame : used[i].of_document;
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

cln_status cln_transforms_ignored(const json_t *object, bool frame, json_t **list)
{
    const char *key = NULL;
    json_t *value = NULL;

    if (!*list)
        *list = json_array();
    json_object_foreach((json_t *)object, key, value)
    {
        if (!is_used(key, frame) && !is_listed(*list, key) &&
            json_array_append_new(*list, json_string(key)) != 0)
            return cln_fail(CLN_MEMORY, "scene: no memory for the names of its keys");
    }
    return CLN_OK;
}
