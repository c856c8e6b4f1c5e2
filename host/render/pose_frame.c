/* Poses from nerfstudio's frame to the scene's. nerfstudio turns, centres and scales a scene before
 * it trains, and writes paths in that frame: p' = s (R p + t), with R | t and s in its
 * dataparser_transforms.json (nerfstudio: dataparsers/base_dataparser.py). There p is as it was
 * before `applied_transform` and `applied_scale` of the scene's transforms JSON, which
 * ns-process-data has put into the poses there; where only colmap/sparse/0 lies beside that,
 * nerfstudio takes an older version's to be meant. See frames.h. */
#include "render/frames.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/json.h"
#include "scene/scene.h"
#include "scene/vectors.h"

#define NAME "dataparser_transforms.json"

/* p -> linear p + shift */
typedef struct affine {
    double linear[9], shift[3];
} affine;

static affine product(const affine *a, const affine *b)
{
    affine out = {0};

    for (int i = 0; i < 3; i++) {
        out.shift[i] = a->shift[i];
        for (int k = 0; k < 3; k++) {
            out.shift[i] += a->linear[3 * i + k] * b->shift[k];
            for (int j = 0; j < 3; j++)
                out.linear[3 * i + j] += a->linear[3 * i + k] * b->linear[3 * k + j];
        }
    }
    return out;
}

/* Of one whose determinant is not 0. */
static affine inverse(const affine *a)
{
    affine out = {0};
    const double *m = a->linear;
    double det = 0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            const int r = (j + 1) % 3, q = (j + 2) % 3, c = (i + 1) % 3, d = (i + 2) % 3;

            out.linear[3 * i + j] = m[3 * r + c] * m[3 * q + d] - m[3 * r + d] * m[3 * q + c];
        }
    for (int i = 0; i < 3; i++)
        det += m[i] * out.linear[3 * i];
    for (int i = 0; i < 9; i++)
        out.linear[i] /= det;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            out.shift[i] -= out.linear[3 * i + k] * a->shift[k];
    return out;
}

/* Is the linear part a rotation to 1e-3, as poses must be? */
static bool turns(const affine *a)
{
    const double *m = a->linear;
    double worst = 0;

    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double dot = 0;

            for (int k = 0; k < 3; k++)
                dot += m[3 * i + k] * m[3 * j + k];
            worst = fmax(worst, fabs(dot - (i == j)));
        }
    return worst < 1e-3 && cln_det3(m) > 0;
}

/* Three rows of four numbers that turn and shift. */
static cln_status read_affine(const char *path, const json_t *root, const char *key, affine *out)
{
    const json_t *rows = json_object_get(root, key);
    bool right = json_array_size(rows) >= 3;

    for (size_t i = 0; i < 12 && right; i++) {
        const json_t *value = json_array_get(json_array_get(rows, i / 4), i % 4);

        right = json_is_number(value);
        *(i % 4 < 3 ? &out->linear[3 * (i / 4) + i % 4] : &out->shift[i / 4]) =
            json_number_value(value);
    }
    if (!right || !turns(out) || !isfinite(out->shift[0] + out->shift[1] + out->shift[2]))
        return cln_fail(CLN_INPUT, "%s: %s must be a rotation and a shift, 3 rows of 4 numbers",
                        path, key);
    return CLN_OK;
}

static cln_status read_scale(const char *path, const json_t *root, const char *key, double *scale)
{
    const json_t *value = json_object_get(root, key);

    *scale = json_number_value(value);
    if (!json_is_number(value) || !(*scale > 0) || !isfinite(*scale))
        return cln_fail(CLN_INPUT, "%s: %s must be a number above 0", path, key);
    return CLN_OK;
}

/* What ns-process-data did to the scene's poses: nothing, but for transforms JSON that says so. */
static cln_status read_applied(const char *scene, affine *applied, double *scale)
{
    static const affine older = {.linear = {0, 1, 0, 1, 0, 0, 0, 0, -1}};
    cln_status st = CLN_OK;
    char *path = NULL, *folder = NULL;
    json_t *root = NULL;

    *applied = (affine){.linear = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    *scale = 1;
    CLN_TRY(cln_scene_folder(scene, &folder));
    CLN_TRY(cln_is_dir(scene) ? cln_path_join(&path, scene, "transforms.json")
                              : cln_strdup(&path, scene));
    if (!cln_is_file(path))
        goto done;
    CLN_TRY(cln_json_read(path, true, &root));
    if (json_object_get(root, "applied_transform"))
        CLN_TRY(read_affine(path, root, "applied_transform", applied));
    else if (cln_has_dir(folder, "colmap/sparse/0"))
        *applied = older;
    if (json_object_get(root, "applied_scale"))
        CLN_TRY(read_scale(path, root, "applied_scale", scale));
done:
    json_decref(root);
    free(path);
    free(folder);
    return st;
}

cln_status cln_frames_applied(const char *scene, double applied[12], double *scale)
{
    cln_status st = CLN_OK;
    affine own;

    CLN_TRY(read_applied(scene, &own, scale));
    for (int k = 0; k < 12; k++)
        applied[k] = k % 4 < 3 ? own.linear[3 * (k / 4) + k % 4] : own.shift[k / 4];
done:
    return st;
}

/* Takes a crop's box along: its middle, its sides and its axes. */
static void move_crop(const affine *back, double scale, cln_crop *crop)
{
    double axes[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, middle[3];

    if (cln_crop_is_turned(crop))
        memcpy(axes, crop->turn, sizeof axes);
    for (int i = 0; i < 3; i++) {
        const double *row = back->linear + (size_t)3 * (size_t)i;

        middle[i] = back->shift[i];
        for (int k = 0; k < 3; k++) {
            middle[i] += row[k] * scale * 0.5 * (crop->box[k] + crop->box[k + 3]);
            crop->turn[3 * k + i] =
                row[0] * axes[3 * k] + row[1] * axes[3 * k + 1] + row[2] * axes[3 * k + 2];
        }
    }
    for (int i = 0; i < 3; i++) {
        const double half = 0.5 * scale * (crop->box[i + 3] - crop->box[i]);

        crop->box[i] = middle[i] - half;
        crop->box[i + 3] = middle[i] + half;
    }
}

cln_status cln_frames_dataparser(const char *poses, char **path)
{
    cln_status st = CLN_OK;
    char *folder = NULL;

    *path = NULL;
    CLN_TRY(cln_scene_folder(poses, &folder));
    CLN_TRY(cln_path_join(path, folder, NAME));
    if (cln_is_file(*path))
        goto done;
    free(*path);
    *path = NULL;
    cln_info(
        "poses: %s counts as in the scene's own frame and units; if nerfstudio wrote it, which "
        "turns and scales scenes, put its " NAME " beside it",
        poses);
done:
    free(folder);
    return st;
}

cln_status cln_frames_from_nerfstudio(const char *path, const char *poses, const char *scene,
                                      cln_frames *out)
{
    cln_status st = CLN_OK;
    json_t *root = NULL;
    affine theirs, applied, back;
    double scale = 1, before = 1;

    CLN_TRY(cln_json_read(path, false, &root));
    CLN_TRY(read_affine(path, root, "transform", &theirs));
    CLN_TRY(read_scale(path, root, "scale", &scale));
    if (scene)
        CLN_TRY(read_applied(scene, &applied, &before));
    back = inverse(&theirs);
    if (scene)
        back = product(&applied, &back);
    for (int i = 0; i < out->count; i++) {
        cln_camera *c = &out->frame[i].camera;
        affine pose, moved;

        for (int k = 0; k < 12; k++)
            *(k % 4 < 3 ? &pose.linear[3 * (k / 4) + k % 4] : &pose.shift[k / 4]) =
                k % 4 < 3 ? c->c2w[k] : c->c2w[k] * before / scale;
        moved = product(&back, &pose);
        for (int k = 0; k < 12; k++)
            c->c2w[k] = k % 4 < 3 ? moved.linear[3 * (k / 4) + k % 4] : moved.shift[k / 4];
        CLN_TRY(cln_camera_check(c, poses));
    }
    if (out->crop.on)
        move_crop(&back, before / scale, &out->crop);
    cln_info(
        "poses: %s is beside %s, so this path is brought from nerfstudio's frame (scale %g) to "
        "the scene's",
        path, poses, scale / before);
done:
    json_decref(root);
    return st;
}
