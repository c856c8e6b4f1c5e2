/* Reader of COLMAP's sparse models (colmap_model.c has the files): in the folder given, or in its
 * sparse, sparse/0, colmap/sparse/0 or distorted/sparse/0. Images lie in `images` beside it or
 * above it, smaller copies in images_2, _4, _8 (dataset.h); cameras follow the images' size. Poses
 * are world-to-camera with our axes; the centre of the top-left pixel is (0.5, 0.5) there, too.
 * Points say where the cube is; a file beside the model, on which place of the earth its origin is
 * (origin.h). One camera and several are the same case. */
#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "scene/colmap.h"
#include "scene/dataset.h"
#include "scene/origin.h"
#include "scene/placing.h"

/* Where a model lies in a scene, in this order, and how far below the scene. */
static const struct {
    const char *folder;
    int depth;
} places[] = {{"", 0},
              {"sparse", 1},
              {"sparse/0", 2},
              {"colmap/sparse/0", 3},
              {"distorted/sparse/0", 3}}; /* the last: before photos are undistorted for splats */
enum { PLACES = sizeof places / sizeof *places, BASES = 4 };

static cln_status place_folder(const char *path, int place, char **out)
{
    return places[place].depth ? cln_path_join(out, path, places[place].folder)
                               : cln_strdup(out, path);
}

/* Index of the place; PLACES if there is no model. */
static int find_place(const char *path, const char **missing)
{
    *missing = NULL;
    for (int i = 0; i < PLACES; i++) {
        char *folder = NULL;
        const bool found =
            place_folder(path, i, &folder) == CLN_OK && cln_colmap_is_model(folder, missing);

        free(folder);
        if (found)
            return i;
    }
    return PLACES;
}

cln_status cln_colmap_read_from(const char *scene, char **folder)
{
    const char *missing = NULL;
    const int place = find_place(scene, &missing);

    *folder = NULL;
    return place < PLACES ? place_folder(scene, place, folder) : CLN_OK;
}

/* Finds the folder that `path` is in, from its text if that is enough, else from the whole path of
 * it. The caller frees *out. */
static cln_status parent(const char *path, char **out)
{
    cln_status st = CLN_OK;
    size_t length = strlen(path);
    const char *last = NULL;

    while (length > 1 && path[length - 1] == '/')
        length--;
    CLN_TRY(cln_asprintf(out, "%.*s", (int)length, path));
    last = cln_last_name(*out);
    if (!strcmp(last, ".") || !strcmp(last, "..") || last == *out) {
        free(*out);
        *out = realpath(path, NULL);
        if (!*out)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: its whole path cannot be found: %s; give that instead",
                             path, strerror(errno)));
        last = cln_last_name(*out);
    }
    (*out)[last - *out - (last - *out > 1)] = 0; /* "/x" is in "/" */
done:
    return st;
}

/* ---- cameras ---- */

static int by_id(const void *a, const void *b)
{
    const cln_colmap_camera *x = a, *y = b;

    return x->id < y->id ? -1 : x->id > y->id;
}

static cln_status sort_cameras(cln_colmap *model)
{
    if (model->camera_count)
        qsort(model->cameras, (size_t)model->camera_count, sizeof *model->cameras, by_id);
    for (int i = 1; i < model->camera_count; i++)
        if (model->cameras[i].id == model->cameras[i - 1].id)
            return cln_fail(
                CLN_INPUT,
                "%s: camera %u appears twice; remove one of the two, or export the model again",
                model->camera_file, model->cameras[i].id);
    return CLN_OK;
}

static const cln_colmap_camera *find_camera(const cln_colmap *model, uint32_t id)
{
    const cln_colmap_camera key = {.id = id};

    return model->camera_count ? bsearch(&key, model->cameras, (size_t)model->camera_count,
                                         sizeof *model->cameras, by_id)
                               : NULL;
}

static void set_camera(const cln_colmap_camera *from, cln_camera *to)
{
    double pixels[4];

    cln_colmap_split(from->model, from->params, pixels, to->distortion);
    to->lens = from->model->lens;
    to->width = from->width;
    to->height = from->height;
    to->fx = pixels[0];
    to->fy = pixels[1];
    to->cx = pixels[2];
    to->cy = pixels[3];
}

static cln_status set_pose(const char *where, const double pose[7], double c2w[12])
{
    double q[4], rotation[9], length = 0;

    for (int i = 0; i < 4; i++)
        length += pose[i] * pose[i];
    length = sqrt(length);
    if (!(fabs(length - 1) <= 0.01)) /* texts are rounded; also false for NaN */
        return cln_fail(CLN_INPUT,
                        "%s: its quaternion has the length %g instead of 1; export the model again",
                        where, length);
    for (int i = 0; i < 4; i++)
        q[i] = pose[i] / length;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;

        rotation[3 * i + i] = 1 - 2 * (q[j + 1] * q[j + 1] + q[k + 1] * q[k + 1]);
        rotation[3 * i + j] = 2 * (q[i + 1] * q[j + 1] - q[0] * q[k + 1]);
        rotation[3 * i + k] = 2 * (q[i + 1] * q[k + 1] + q[0] * q[j + 1]);
    }
    cln_dataset_pose(rotation, pose + 4, c2w);
    return CLN_OK;
}

static cln_status make_views(cln_colmap *model, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *where = NULL;

    CLN_TRY(cln_alloc(&result->views, (size_t)model->image_count, sizeof *result->views, "views"));
    for (int i = 0; i < model->image_count; i++) {
        cln_colmap_image *image = &model->images[i];
        cln_view *view = &result->views[result->view_count++];
        const cln_colmap_camera *camera = find_camera(model, image->camera);

        view->name = image->name;
        image->name = NULL;
        free(where);
        CLN_TRY(cln_asprintf(&where, "%s: image '%s'", model->image_file, view->name));
        if (!camera)
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: its camera %u is not in %s; put files of one model there", where,
                             image->camera, model->camera_file));
        set_camera(camera, &view->camera);
        CLN_TRY(set_pose(where, image->pose, view->camera.c2w));
    }
done:
    free(where);
    return st;
}

cln_status cln_colmap_places(const char *folder, cln_names *names, double (**at)[3])
{
    cln_status st = CLN_OK;
    cln_colmap model = {0};
    char *where = NULL;

    CLN_TRY(cln_colmap_read(folder, &model));
    CLN_TRY(cln_alloc(&names->name, (size_t)model.image_count + 1, sizeof *names->name, "names"));
    CLN_TRY(cln_alloc(at, (size_t)model.image_count + 1, sizeof **at, "cameras"));
    for (int i = 0; i < model.image_count; i++) {
        double c2w[12];

        names->name[names->count++] = model.images[i].name;
        model.images[i].name = NULL;
        free(where);
        where = NULL;
        CLN_TRY(cln_asprintf(&where, "%s: image '%s'", model.image_file, names->name[i]));
        CLN_TRY(set_pose(where, model.images[i].pose, c2w));
        for (int a = 0; a < 3; a++)
            (*at)[i][a] = c2w[4 * a + 3];
    }
done:
    free(where);
    cln_colmap_free(&model);
    return st;
}

/* ---- points and observations ---- */

typedef struct image_index {
    uint32_t id;
    int32_t index;
} image_index;

static int by_image_id(const void *a, const void *b)
{
    const image_index *x = a, *y = b;

    return x->id < y->id ? -1 : x->id > y->id;
}

/* Hands over points and observations, which then have the images' indices instead of their ids;
 * observations in unknown images are dropped. */
static cln_status give_points(cln_colmap *model, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const size_t images = (size_t)model->image_count;
    image_index *ids = NULL;
    int64_t kept = 0;

    CLN_TRY(cln_alloc(&ids, images, sizeof *ids, "images"));
    for (size_t i = 0; i < images; i++)
        ids[i] = (image_index){model->images[i].id, (int32_t)i};
    if (images)
        qsort(ids, images, sizeof *ids, by_image_id);
    for (int64_t i = 0; i < model->observation_count && images; i++) {
        const image_index key = {.id = (uint32_t)model->observations[i].view};
        const image_index *at = bsearch(&key, ids, images, sizeof *ids, by_image_id);

        if (at)
            model->observations[kept++] =
                (cln_observation){model->observations[i].point, at->index};
    }
    result->points = model->points;
    result->point_count = model->point_count;
    result->observations = model->observations;
    result->observation_count = kept;
    model->points = NULL;
    model->observations = NULL;
done:
    free(ids);
    return st;
}

/* ---- the reader ---- */

static bool detect(const char *path, const char **missing)
{
    if (cln_is_dir(path))
        return find_place(path, missing) < PLACES;
    *missing = NULL;
    return false;
}

/* Images are looked for beside the model and in the folders above it: up to the scene's folder, if
 * that is known. */
static cln_status find_images(const char *scene, const char *model, int depth, const char *where,
                              cln_reader_result *result, char **images)
{
    cln_status st = CLN_OK;
    char *bases[BASES] = {0};
    const int count = depth ? depth + 1 : BASES;

    CLN_TRY(cln_strdup(&bases[0], model));
    for (int i = 1; i < count; i++)
        CLN_TRY(parent(bases[i - 1], &bases[i]));
    CLN_TRY(cln_dataset_find_images(where, scene, (const char *const *)bases, count, NULL, result,
                                    images));
done:
    for (int i = 0; i < BASES; i++)
        free(bases[i]);
    return st;
}

/* COLMAP writes a model for each group of photos that overlap, mostly the largest first. */
static cln_status tell_others(const char *read, int images)
{
    enum { MODELS = 100 };
    cln_status st = CLN_OK;
    char *around = NULL, *other = NULL, *largest = NULL;
    const char *unused = NULL;
    int others = 0, most = 0;

    CLN_TRY(parent(read, &around));
    for (int i = 1; i < MODELS; i++) {
        char name[16];
        int count = 0;

        snprintf(name, sizeof name, "%d", i);
        free(other);
        other = NULL;
        CLN_TRY(cln_path_join(&other, around, name));
        count = cln_colmap_images(other);
        others += count > 0 || cln_colmap_is_model(other, &unused);
        if (count <= most)
            continue;
        most = count;
        free(largest);
        largest = other;
        other = NULL;
    }
    if (most > images)
        cln_warn("%s is read, which has %d images; %s has %d: give that folder in place of the "
                 "scene's, if those are the ones",
                 read, images, largest, most);
    else if (others)
        cln_info("%s: %d other model%s beside it %s not read", read, others,
                 cln_plural(others, "", "s"), cln_plural(others, "is", "are"));
done:
    free(around);
    free(other);
    free(largest);
    return st;
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_colmap model = {0};
    const char *missing = NULL;
    const int place = find_place(path, &missing);
    char *folder = NULL, *images = NULL, masks[64], earth[256] = "", within[64] = "";
    cln_origin_doubt doubt;
    double origin[3];

    CLN_TRY(place_folder(path, place, &folder));
    CLN_TRY(cln_colmap_read(folder, &model));
    CLN_TRY(sort_cameras(&model));
    CLN_TRY(make_views(&model, result));
    CLN_TRY(find_images(path, folder, places[place].depth, model.image_file, result, &images));
    CLN_TRY(give_points(&model, result));
    result->beyond = true;
    result->stored_poses = true;
    result->dialect = "COLMAP";
    cln_dataset_tell_masks(result, masks);
    if (cln_origin_read(folder, origin, &doubt)) {
        result->up[2] = 1;
        result->up_by_gps = isnan(doubt.up);
        result->on_earth = true;
        result->gps_distance = doubt.distance;
        memcpy(result->origin, origin, sizeof origin);
        if (!isnan(result->gps_distance))
            cln_format(within, sizeof within, " (half of them within %.2f m)",
                       result->gps_distance);
        cln_format(earth, sizeof earth,
                   "; coordinates are metres east, north and up from the middle of the cameras, "
                   "latitude %.8f, longitude %.8f, height %.3f, by the photos' GPS%s",
                   origin[0], origin[1], origin[2], within);
    }
    CLN_TRY(cln_asprintf(&result->because, "%s has cameras and images; images are from %s%s%s",
                         cln_dataset_within(path, folder), cln_dataset_within(path, images), masks,
                         earth));
    if (places[place].depth > 1)
        CLN_TRY(tell_others(folder, model.image_count));
done:
    free(folder);
    free(images);
    cln_colmap_free(&model);
    return st;
}

const cln_reader cln_reader_colmap = {
    .name = "the COLMAP reader",
    .wants = "a folder with cameras and images, .bin or .txt, or with such a model in sparse, "
             "sparse/0 or colmap/sparse/0",
    .detect = detect,
    .read = read_scene,
};
