/* Reader of LLFF scenes: poses_bounds.npy with a row of 17 numbers for each image in the folder
 * images (or images_2, _4, _8, the first there is), by name. A row is a 3 x 5 matrix, row-major,
 * whose columns are the camera's axes in the world, down, right and backwards, its position, and
 * (height, width, focal length) of the originals; then the depths of the nearest and the farthest
 * object. No distortion; the principal point is the centre; masks may lie beside (masks.c). Such
 * scenes are mostly forward-facing: bounds_forward.c puts them into normalised device
 * coordinates. */
#include <math.h>
#include <stdlib.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/npy.h"
#include "scene/dataset.h"
#include "scene/placing.h"

enum { ROW = 17, MAX_SIDE = 1000000 };
static const size_t MAX_BYTES = (size_t)1 << 28;

static cln_status set_view(const char *where, const double row[ROW], cln_view *view)
{
    static const int column[3] = {1, 0, 2}; /* of right, down, backwards */
    cln_camera *camera = &view->camera;

    for (int i = 0; i < ROW; i++)
        if (!isfinite(row[i]))
            return cln_fail(CLN_INPUT, "%s: number %d is not finite; make the file again", where,
                            i + 1);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++)
            camera->c2w[4 * i + j] = (j == 2 ? -1 : 1) * row[5 * i + column[j]];
        camera->c2w[4 * i + 3] = row[5 * i + 3];
    }
    if (!(row[4] >= 1 && row[4] <= MAX_SIDE && row[9] >= 1 && row[9] <= MAX_SIDE))
        return cln_fail(CLN_INPUT, "%s: absurd image size %g x %g; make the file again", where,
                        row[9], row[4]);
    camera->height = (int)lround(row[4]);
    camera->width = (int)lround(row[9]);
    camera->fx = camera->fy = row[14];
    camera->cx = 0.5 * camera->width;
    camera->cy = 0.5 * camera->height;
    if (!(row[15] >= 0 && row[15] < row[16]))
        return cln_fail(CLN_INPUT,
                        "%s: its depths %g and %g are not 0 <= near < far; correct them, or make "
                        "the file again",
                        where, row[15], row[16]);
    view->near = row[15];
    view->far = row[16];
    return CLN_OK;
}

static cln_status read_poses(const char *path, int *count, double **rows)
{
    cln_status st = CLN_OK;
    char *file = NULL;
    size_t bytes = 0;
    int dims = 0, shape[4];

    CLN_TRY(cln_read_file(path, MAX_BYTES, &file, &bytes));
    CLN_TRY(cln_npy_decode(path, file, bytes, &dims, shape, rows));
    if (dims != 2 || shape[1] != ROW)
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: not an array of %d numbers for each image; make it with LLFF's imgs2poses.py",
            path, ROW));
    *count = shape[0];
done:
    free(file);
    return st;
}

static bool detect(const char *path, const char **missing)
{
    *missing = NULL;
    return cln_is_dir(path) && cln_has_file(path, "poses_bounds.npy");
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *file = NULL, *folder = NULL, *where = NULL, masks[64];
    cln_names images = {0};
    double *rows = NULL;
    int count = 0;

    CLN_TRY(cln_path_join(&file, path, "poses_bounds.npy"));
    CLN_TRY(read_poses(file, &count, &rows));
    CLN_TRY(cln_dataset_image_folder(path, &folder));
    if (!folder)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: there is no folder images (nor images_2, _4 or _8) beside it; put "
                         "the images into one",
                         file));
    CLN_TRY(cln_dataset_images(folder, &images));
    if (images.count != count)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: poses of %d images, but %s has %d; both must be of the same images, "
                         "as these are matched by their order",
                         file, count, folder, images.count));
    CLN_TRY(cln_dataset_views(file, folder, &images, result));
    for (int i = 0; i < count; i++) {
        free(where);
        CLN_TRY(cln_asprintf(&where, "%s: row %d (of '%s')", file, i + 1, images.name[i]));
        CLN_TRY(set_view(where, rows + ROW * (size_t)i, &result->views[i]));
    }
    CLN_TRY(cln_dataset_find_masks(path, folder, result));
    cln_dataset_tell_masks(result, masks);
    result->dialect = "LLFF";
    result->forward = true;
    CLN_TRY(cln_asprintf(&result->because, "it has poses_bounds.npy; images are from %s%s",
                         cln_dataset_within(path, folder), masks));
done:
    cln_dataset_free_names(&images);
    free(file);
    free(folder);
    free(where);
    free(rows);
    return st;
}

const cln_reader cln_reader_llff = {
    .name = "the LLFF reader",
    .wants = "a folder with poses_bounds.npy",
    .detect = detect,
    .read = read_scene,
};
