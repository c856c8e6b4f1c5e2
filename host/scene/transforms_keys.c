/* Reads a transforms JSON document, and tells which of its keys count. See transforms.h. Users add
 * keys that other programs read (depth_file_path, near, far): without a message they would think
 * that these are read. */
#include "scene/transforms.h"

#include <string.h>

#include "io/json.h"

static void drop_nulls(json_t *object)
{
    const char *key = NULL;
    json_t *value = NULL;
    void *next = NULL;

    json_object_foreach_safe(object, next, key, value)
    {
        if (json_is_null(value))
            json_object_del(object, key);
    }
}

cln_status cln_transforms_read(const char *file, json_t **root)
{
    cln_status st = CLN_OK;
    const json_t *frames = NULL;

    CLN_TRY(cln_json_read(file, true, root));
    drop_nulls(*root);
    frames = json_object_get(*root, "frames");
    for (size_t i = 0; i < json_array_size(frames); i++)
        drop_nulls(json_array_get(frames, i));
done:
    return st;
}

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
            {"listed_again", true, false},
            {"ply_file_path", true, false},
            {"file_path", false, true},
            {"transform_matrix", false, true},
            {"mask_path", true, true},
            {"alpha_path", false, true},
            {"camera_type", true, true},
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
            {"fisheye_crop_radius", true, true},
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
