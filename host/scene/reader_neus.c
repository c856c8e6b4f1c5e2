/* Reader of NeuS's scenes (DTU and others): cameras_sphere.npz with world_mat_I and scale_mat_I for
 * the I-th file of the folder image, by name. The folder mask, if it is there, says which pixels
 * are the object's: white becomes alpha 1, black 0.
 *   world_mat  P = K [R|t], the world's points to pixels, 4x4 (or 3x4); the centre of the top-left
 *              pixel is (0, 0) there
 *   scale_mat  the unit ball, which holds the object, to the world: the cube is around that ball
 * P is taken apart: its left 3x3 is upper triangular times rotation, from the last row up. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/npz.h"
#include "scene/placing.h"
#include "scene/dataset.h"
#include "scene/vectors.h"

static const char *const file_name = "cameras_sphere.npz";
static const double SKEW_LIMIT = 1e-3; /* of the focal length */

/* A 4x4 or 3x4 matrix of the archive, its first three rows. */
static cln_status read_matrix(const char *where, cln_npz *npz, const char *name, int index,
                              double out[12])
{
    cln_status st = CLN_OK;
    char *key = NULL;
    double *data = NULL;
    int dims = 0, shape[4];

    CLN_TRY(cln_asprintf(&key, "%s_%d", name, index));
    CLN_TRY(cln_npz_read(npz, key, &dims, shape, &data));
    if (dims != 2 || (shape[0] != 3 && shape[0] != 4) || shape[1] != 4)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %s is not a matrix of 4 x 4 numbers; export the cameras again", where,
                         key));
    for (int i = 0; i < 12; i++)
        if (!isfinite(data[i]))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: %s has a number that is not finite; export the cameras again",
                             where, key));
    memcpy(out, data, 12 * sizeof *out);
done:
    free(key);
    free(data);
    return st;
}

/* P = s K [R|t]: rows of R from the last one up, each without its part along those below it. P's
 * sign is free; the determinant of R tells it. */
static cln_status take_apart(const char *where, const double p[12], cln_camera *camera)
{
    double r[9], k[9] = {0}, translation[3], sign = 1;

    for (int i = 2; i >= 0; i--) {
        memcpy(r + 3 * i, p + 4 * i, 3 * sizeof *r);
        for (int j = i + 1; j < 3; j++) {
            k[3 * i + j] = cln_dot(r + 3 * i, r + 3 * j);
            for (int a = 0; a < 3; a++)
                r[3 * i + a] -= k[3 * i + j] * r[3 * j + a];
        }
        k[3 * i + i] = cln_unit(r + 3 * i);
        if (!(k[3 * i + i] > 0))
            return cln_fail(CLN_INPUT,
                            "%s: not a projection matrix: its rows are linearly dependent; export "
                            "the cameras again",
                            where);
    }
    if (cln_det3(r) < 0)
        sign = -1;
    for (int i = 2; i >= 0; i--) { /* K t = P's last column, from below */
        translation[i] = sign * p[4 * i + 3];
        for (int j = i + 1; j < 3; j++)
            translation[i] -= k[3 * i + j] * translation[j];
        translation[i] /= k[3 * i + i];
    }
    for (int i = 0; i < 9; i++)
        r[i] *= sign;
    if (fabs(k[1]) > SKEW_LIMIT * k[0])
        return cln_fail(CLN_INPUT,
                        "%s: its pixels are skew, %g of the focal length; export cameras "
                        "without skew",
                        where, k[1] / k[0]);
    camera->fx = k[0] / k[8];
    camera->fy = k[4] / k[8];
    camera->cx = k[2] / k[8] + 0.5; /* our pixel centres */
    camera->cy = k[5] / k[8] + 0.5;
    cln_dataset_pose(r, translation, camera->c2w);
    return CLN_OK;
}

/* The cube around the image of the unit ball: its extent along an axis is the norm of a row. */
static cln_status set_cube(const char *where, cln_npz *npz, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    double m[12];

    CLN_TRY(read_matrix(where, npz, "scale_mat", 0, m));
    result->has_bounds = true;
    result->space.half = 0;
    for (int i = 0; i < 3; i++) {
        result->space.centre[i] = m[4 * i + 3];
        result->space.half = fmax(result->space.half, sqrt(cln_dot(m + 4 * i, m + 4 * i)));
    }
    CLN_TRY(cln_strdup(&result->bounds_rule, "around the unit ball of scale_mat"));
done:
    return st;
}

/* The files of the folder mask become the alpha of the images, in their order. */
static cln_status set_masks(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_names masks = {0};
    char *folder = NULL;

    CLN_TRY(cln_path_join(&folder, path, "mask"));
    if (!cln_is_dir(folder))
        goto done;
    CLN_TRY(cln_dataset_images(folder, &masks));
    if (masks.count != result->view_count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %d masks for %d images; both must be of the same images, or move the "
                         "folder away",
                         folder, masks.count, result->view_count));
    for (int i = 0; i < masks.count; i++)
        CLN_TRY(cln_path_join(&result->views[i].alpha_path, folder, masks.name[i]));
done:
    cln_dataset_free_names(&masks);
    free(folder);
    return st;
}

/* Cameras belong to images by order: if an image were missing, all after it would be wrong. */
static cln_status check_count(const char *file, cln_npz *npz, const char *folder, int images)
{
    cln_status st = CLN_OK;
    char *key = NULL;
    int cameras = 0;

    for (bool more = true; more && cameras <= CLN_MAX_VIEWS; cameras += more) {
        free(key);
        key = NULL;
        CLN_TRY(cln_asprintf(&key, "world_mat_%d", cameras));
        more = cln_npz_has(npz, key);
    }
    if (cameras != images)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: cameras of %d images, but %s has %d; both must be of the same "
                         "images, as these are matched by their order",
                         file, cameras, folder, images));
done:
    free(key);
    return st;
}

static bool detect(const char *path, const char **missing)
{
    *missing = NULL;
    return cln_is_dir(path) && cln_has_file(path, file_name);
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *file = NULL, *folder = NULL, *where = NULL;
    cln_names images = {0};
    cln_npz *npz = NULL;

    CLN_TRY(cln_path_join(&file, path, file_name));
    CLN_TRY(cln_npz_open(file, &npz));
    CLN_TRY(cln_path_join(&folder, path, "image"));
    if (!cln_is_dir(folder))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: there is no folder image beside it; put the images there",
                         file));
    CLN_TRY(cln_dataset_images(folder, &images));
    CLN_TRY(check_count(file, npz, folder, images.count));
    CLN_TRY(cln_dataset_views(file, folder, &images, result));
    for (int i = 0; i < images.count; i++) {
        double p[12];

        free(where);
        CLN_TRY(cln_asprintf(&where, "%s: camera %d (of '%s')", file, i, images.name[i]));
        CLN_TRY(read_matrix(where, npz, "world_mat", i, p));
        CLN_TRY(take_apart(where, p, &result->views[i].camera));
    }
    CLN_TRY(set_cube(file, npz, result));
    CLN_TRY(set_masks(path, result));
    if (!cln_has_dir(path, "mask")) /* masks by name, as elsewhere */
        CLN_TRY(cln_dataset_find_masks(path, folder, result));
    result->dialect = "NeuS";
    CLN_TRY(
        cln_asprintf(&result->because, "it has %s%s", file_name,
                     images.count && result->views[0].alpha_path ? "; mask becomes alpha" : ""));
done:
    cln_npz_close(npz);
    cln_dataset_free_names(&images);
    free(file);
    free(folder);
    free(where);
    return st;
}

const cln_reader cln_reader_neus = {
    .name = "the NeuS reader",
    .wants = "a folder with cameras_sphere.npz",
    .detect = detect,
    .read = read_scene,
};
