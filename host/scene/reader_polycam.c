/* Reader of Polycam's raw data (an iPhone or iPad with LiDAR; Developer mode, export Raw data): the
 * capture's folder, or its folder keyframes. By the specification in github.com/PolyCam/polyform:
 *   cameras/T.json  intrinsics fx, fy, cx, cy of an image of width x height, and camera-to-world
 *                   t_00 .. t_23, row by row, with OpenGL's axes; metres, y is up
 *   images/T.jpg    the photo taken at time T
 *   depth/T.png     16 bits, millimetres along the optical axis, smaller than the photo
 *   confidence/T.png  of these, 0, 127 or 255
 * corrected_cameras and corrected_images, if there, have the poses after a closed loop and the
 * photos without distortion, which are black along their edges. Depths say where the scene is; no
 * loss is made of them. */
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "io/json.h"
#include "scene/dataset.h"
#include "scene/placing.h"
#include "scene/transforms.h"

enum {
    MAX_SIDE = 1000000,
    EDGE = 15, /* pixels along the edges of corrected images, which may be black */
};
static const double FARTHEST = 5; /* metres: of what is farther, the sensor knows nothing */

/* The folder of the keyframes at `path`, which is it or the capture; *out is NULL if there is none.
 */
static cln_status find_keyframes(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *whole = NULL;

    *out = NULL;
    if (cln_has_dir(path, "keyframes")) {
        CLN_TRY(cln_path_join(out, path, "keyframes"));
        goto done;
    }
    if (!cln_is_dir(path))
        goto done;
    CLN_TRY(cln_path_absolute(&whole, path));
    if (strcmp(cln_last_name(whole), "keyframes") == 0)
        CLN_TRY(cln_strdup(out, path));
done:
    free(whole);
    return st;
}

static bool has_pair(const char *keyframes, bool corrected)
{
    return cln_has_dir(keyframes, corrected ? "corrected_cameras" : "cameras") &&
           cln_has_dir(keyframes, corrected ? "corrected_images" : "images");
}

/* Are there corrected photos with cameras? A correction that failed leaves empty folders. */
static cln_status find_corrected(const char *keyframes, bool *found)
{
    cln_status st = CLN_OK;
    char *cameras = NULL, *images = NULL;
    cln_names names = {0};
    int without = 0;

    *found = has_pair(keyframes, true);
    if (!*found || !has_pair(keyframes, false))
        return CLN_OK;
    CLN_TRY(cln_path_join(&cameras, keyframes, "corrected_cameras"));
    CLN_TRY(cln_path_join(&images, keyframes, "corrected_images"));
    CLN_TRY(cln_dataset_images(images, &names));
    CLN_TRY(cln_dataset_keep_with(cameras, ".json", &names, &without));
    *found = names.count > 0;
done:
    cln_dataset_free_names(&names);
    free(cameras);
    free(images);
    return st;
}

static bool detect(const char *path, const char **missing)
{
    char *keyframes = NULL;
    bool found = false;

    *missing = NULL;
    if (find_keyframes(path, &keyframes) != CLN_OK)
        cln_clear_error();
    found = keyframes && (has_pair(keyframes, true) || has_pair(keyframes, false));
    if (keyframes && !found)
        *missing = "one of these is not there; Polycam exports them as Raw data if its Developer "
                   "mode was on before the scan";
    free(keyframes);
    return found;
}

/* ---- cameras ---- */

static cln_status number(const char *file, const json_t *from, const char *key, double *out)
{
    cln_status st = CLN_OK;
    bool found = false;

    CLN_TRY(cln_transforms_number(file, from, key, out, &found));
    if (!found)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no %s; export the capture again, or remove the file to leave its "
                         "photo out",
                         file, key));
done:
    return st;
}

/* photo: whose size counts where the file gives none, as corrected cameras do not any more; one
 * that cannot be read is refused, or left out, later. */
static cln_status read_camera(const char *file, const char *photo, cln_camera *out)
{
    cln_status st = CLN_OK;
    json_t *from = NULL;
    double side[2] = {0};
    bool found[2] = {false};
    int channels = 0;

    CLN_TRY(cln_json_read(file, true, &from));
    CLN_TRY(number(file, from, "fx", &out->fx));
    CLN_TRY(number(file, from, "fy", &out->fy));
    CLN_TRY(number(file, from, "cx", &out->cx));
    CLN_TRY(number(file, from, "cy", &out->cy));
    CLN_TRY(cln_transforms_number(file, from, "width", &side[0], &found[0]));
    CLN_TRY(cln_transforms_number(file, from, "height", &side[1], &found[1]));
    for (int i = 0; i < 2; i++)
        if (found[i] && !(side[i] >= 1 && side[i] <= MAX_SIDE))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: absurd image size %g x %g; correct its width and height", file,
                             side[0], side[1]));
    out->width = (int)side[0];
    out->height = (int)side[1];
    if ((!found[0] || !found[1]) &&
        cln_image_info(photo, &out->width, &out->height, &channels) != CLN_OK)
        cln_clear_error();
    for (int i = 0; i < 12; i++) {
        char key[8];

        snprintf(key, sizeof key, "t_%d%d", i / 4, i % 4);
        CLN_TRY(number(file, from, key, &out->c2w[i]));
    }
    cln_dataset_from_opengl(out->c2w);
done:
    json_decref(from);
    return st;
}

/* The edge of a photo that is smaller than its camera says is narrower. One that cannot be read is
 * refused, or left out, later. */
static void find_edge(cln_view *view)
{
    int width = 0, height = 0, channels = 0;

    view->edge = EDGE;
    if (cln_image_info(view->path, &width, &height, &channels) != CLN_OK)
        cln_clear_error();
    else if (width < view->camera.width)
        view->edge = (EDGE * width + view->camera.width - 1) / view->camera.width;
}

/* The photos that have a camera, as views. */
static cln_status read_views(const char *path, const char *keyframes, bool corrected,
                             cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *cameras = NULL, *images = NULL, *file = NULL;
    cln_names names = {0};
    int without = 0;

    CLN_TRY(cln_path_join(&cameras, keyframes, corrected ? "corrected_cameras" : "cameras"));
    CLN_TRY(cln_path_join(&images, keyframes, corrected ? "corrected_images" : "images"));
    CLN_TRY(cln_dataset_images(images, &names));
    CLN_TRY(cln_dataset_keep_with(cameras, ".json", &names, &without));
    if (names.count == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no photo in it has a .json file of its name in %s; export the "
                         "capture again",
                         images, cameras));
    cln_dataset_tell_without(images, "camera", without, names.count);
    CLN_TRY(cln_dataset_views(keyframes, images, &names, result));
    for (int i = 0; i < names.count; i++) {
        free(file);
        file = NULL;
        CLN_TRY(cln_dataset_beside(cameras, names.name[i], ".json", &file));
        CLN_TRY(read_camera(file, result->views[i].path, &result->views[i].camera));
        if (corrected)
            find_edge(&result->views[i]);
    }
    CLN_TRY(cln_dataset_find_masks(path, images, result));
done:
    cln_dataset_free_names(&names);
    free(cameras);
    free(images);
    free(file);
    return st;
}

/* ---- depths ---- */

static cln_status read_depths(const char *keyframes, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const int step = (result->view_count + CLN_DEPTH_PHOTOS - 1) / CLN_DEPTH_PHOTOS;
    char *folders[2] = {NULL};

    CLN_TRY(cln_path_join(&folders[0], keyframes, "depth"));
    CLN_TRY(cln_path_join(&folders[1], keyframes, "confidence"));
    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];

        view->depth = (cln_depth_image){.unit = 1e-3, .most = FARTHEST};
        CLN_TRY(cln_dataset_beside(folders[0], view->name, ".png", &view->depth.depth));
        CLN_TRY(cln_dataset_beside(folders[1], view->name, ".png", &view->depth.confidence));
        if (i % step == 0)
            CLN_TRY(cln_dataset_depth_points(view, result));
    }
    cln_dataset_tell_depths(keyframes, result);
done:
    for (int k = 0; k < 2; k++) {
        free(folders[k]);
    }
    return st;
}

/* ---- the reader ---- */

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *keyframes = NULL, edge[64] = "";
    bool corrected = false;

    CLN_TRY(find_keyframes(path, &keyframes));
    CLN_TRY(find_corrected(keyframes, &corrected));
    CLN_TRY(read_views(path, keyframes, corrected, result));
    CLN_TRY(read_depths(keyframes, result));
    result->dialect = "Polycam";
    result->up[1] = 1; /* phones are held upright, photos lie as the sensor does */
    result->beyond = true;
    result->stored_poses = true;
    if (corrected)
        snprintf(edge, sizeof edge, "; %d pixels along their edges are left out", EDGE);
    CLN_TRY(cln_asprintf(&result->because, "it has keyframes of Polycam; photos and poses are %s%s",
                         corrected ? "corrected ones" : "as they were taken, not corrected ones",
                         edge));
done:
    free(keyframes);
    return st;
}

const cln_reader cln_reader_polycam = {
    .name = "the Polycam reader",
    .wants = "a folder keyframes with cameras and images, or corrected_cameras and "
             "corrected_images",
    .detect = detect,
    .read = read_scene,
};
