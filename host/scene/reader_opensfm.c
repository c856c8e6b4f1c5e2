/* Reader of OpenSfM's reconstruction.json, in the folder or in its folder opensfm, where
 * OpenDroneMap has it. Images are found by the names of the shots (dataset.h), mostly in images, of
 * a folder opensfm also in that beside it.
 *   camera  projection_type, width, height; focal lengths and the principal point from the image's
 *           centre are in units of the longer side
 *   shot    world to camera, with our axes: rotation, a vector along the axis as long as the angle,
 *           and translation
 *   points  coordinates and color; they say where the cube is
 * tracks.csv beside it, if it is there, has a row for each image that a point was found in: image,
 * point, feature, ..., separated by tabs; except in old files, a line with the version comes first.
 * Of several reconstructions, the one with the most shots is read. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/cursor.h"
#include "io/json.h"
#include "scene/dataset.h"
#include "scene/placing.h"
#include "scene/transforms.h"

static const size_t MAX_BYTES = (size_t)1 << 34; /* of each file */
enum { MAX_PARAMS = 5, MAX_SIDE = 1000000, MAX_POINTS = 100000000 };

/* Projection types, with their parameters in the order of the lens model. */
static const struct {
    const char *name;
    cln_lens lens;
    const char *params[MAX_PARAMS];
} types[] = {
    {"perspective", CLN_LENS_OPENCV, {"k1", "k2"}},
    {"simple_radial", CLN_LENS_OPENCV, {"k1"}},
    {"radial", CLN_LENS_OPENCV, {"k1", "k2"}},
    {"brown", CLN_LENS_FULL_OPENCV, {"k1", "k2", "p1", "p2", "k3"}},
    {"fisheye", CLN_LENS_OPENCV_FISHEYE, {"k1", "k2"}},
    {"fisheye_opencv", CLN_LENS_OPENCV_FISHEYE, {"k1", "k2", "k3", "k4"}},
    {"spherical", CLN_LENS_EQUIRECTANGULAR, {NULL}},
    {"equirectangular", CLN_LENS_EQUIRECTANGULAR, {NULL}},
};
enum { TYPES = sizeof types / sizeof *types };

static cln_status number(const char *where, const json_t *object, const char *key, double otherwise,
                         double *out)
{
    bool found = false;

    *out = otherwise;
    return cln_transforms_number(where, object, key, out, &found);
}

static cln_status vector3(const char *where, const json_t *object, const char *key, double out[3])
{
    const json_t *array = json_object_get(object, key);

    for (size_t i = 0; i < 3; i++) {
        const json_t *value = json_array_get(array, i);

        if (json_array_size(array) != 3 || !json_is_number(value))
            return cln_fail(CLN_INPUT, "%s: %s must be three numbers", where, key);
        out[i] = json_number_value(value);
    }
    return CLN_OK;
}

static cln_status unknown_type(const char *where, const char *name)
{
    char list[256] = "";

    for (int i = 0; i < TYPES; i++)
        snprintf(list + strlen(list), sizeof list - strlen(list), "%s%s", i ? ", " : "",
                 types[i].name);
    return cln_fail(CLN_INPUT,
                    "%s: cameras of the projection_type %s are not read, only %s; undistort the "
                    "images",
                    where, name ? name : "(no text)", list);
}

static cln_status set_camera(const char *where, const json_t *from, cln_camera *to)
{
    cln_status st = CLN_OK;
    const char *name = json_string_value(json_object_get(from, "projection_type"));
    double side[2], focal = 0, fx = 0, fy = 0, cx = 0, cy = 0, longest = 0;
    int type = 0;

    while (type < TYPES && (!name || strcmp(types[type].name, name) != 0))
        type++;
    if (type == TYPES)
        CLN_TRY(unknown_type(where, name));
    CLN_TRY(number(where, from, "width", 0, &side[0]));
    CLN_TRY(number(where, from, "height", 0, &side[1]));
    for (int i = 0; i < 2; i++)
        if (!(side[i] >= 1 && side[i] <= MAX_SIDE))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: absurd image size %g x %g; correct its width and height", where,
                             side[0], side[1]));
    to->width = (int)side[0];
    to->height = (int)side[1];
    to->lens = types[type].lens;
    if (to->lens == CLN_LENS_EQUIRECTANGULAR) {
        cln_camera_span_sphere(to);
        goto done;
    }
    longest = fmax(side[0], side[1]);
    CLN_TRY(number(where, from, "focal", 0, &focal));
    CLN_TRY(number(where, from, "focal_x", focal, &fx));
    CLN_TRY(number(where, from, "focal_y", fx, &fy));
    CLN_TRY(number(where, from, "c_x", 0, &cx));
    CLN_TRY(number(where, from, "c_y", 0, &cy));
    if (!(fx > 0 && fy > 0))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: its camera has no focal length: focal, or focal_x and focal_y, in "
                         "units of the longer side; add it, or export the reconstruction again",
                         where));
    to->fx = fx * longest;
    to->fy = fy * longest;
    to->cx = cx * longest + 0.5 * side[0];
    to->cy = cy * longest + 0.5 * side[1];
    for (int i = 0; i < MAX_PARAMS && types[type].params[i]; i++)
        CLN_TRY(number(where, from, types[type].params[i], 0, &to->distortion[i]));
    if (to->lens == CLN_LENS_FULL_OPENCV && to->distortion[4] == 0)
        to->lens = CLN_LENS_OPENCV;
done:
    return st;
}

/* A turn by |v| around v (Rodrigues): cos I + (1 - cos) a a^T + sin [a]x. */
static void rotation_of(const double v[3], double r[9])
{
    const double angle = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    double a[3] = {1, 0, 0};

    for (int i = 0; i < 3 && angle > 0; i++)
        a[i] = v[i] / angle;
    for (int i = 0; i < 3; i++) {
        const int j = (i + 1) % 3, k = (i + 2) % 3;

        r[3 * i + i] = cos(angle) + (1 - cos(angle)) * a[i] * a[i];
        r[3 * i + j] = (1 - cos(angle)) * a[i] * a[j] - sin(angle) * a[k];
        r[3 * i + k] = (1 - cos(angle)) * a[i] * a[k] + sin(angle) * a[j];
    }
}

static cln_status add_view(const char *file, const char *name, const json_t *shot,
                           const json_t *cameras, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_view *view = &result->views[result->view_count++];
    const char *id = json_string_value(json_object_get(shot, "camera"));
    const json_t *camera = id ? json_object_get(cameras, id) : NULL;
    double axis[3], translation[3], rotation[9];
    char *where = NULL;

    CLN_TRY(cln_asprintf(&where, "%s: shot '%s'", file, name));
    CLN_TRY(cln_dataset_name(where, name, &view->name));
    if (!camera)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: its camera '%s' is not among the cameras; add it, or remove the shot",
                         where, id ? id : ""));
    CLN_TRY(set_camera(where, camera, &view->camera));
    CLN_TRY(vector3(where, shot, "rotation", axis));
    CLN_TRY(vector3(where, shot, "translation", translation));
    rotation_of(axis, rotation);
    cln_dataset_pose(rotation, translation, view->camera.c2w);
done:
    free(where);
    return st;
}

static cln_status read_points(const char *file, const json_t *points, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const char *id = NULL;
    json_t *entry = NULL;
    char *where = NULL;

    if (json_object_size(points) > MAX_POINTS)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: more than %d points; leave some out", file, MAX_POINTS));
    CLN_TRY(cln_alloc(&result->points, json_object_size(points), sizeof *result->points, "points"));
    json_object_foreach((json_t *)points, id, entry)
    {
        cln_point *point = &result->points[result->point_count++];
        double colour[3] = {0};

        free(where);
        CLN_TRY(cln_asprintf(&where, "%s: point '%s'", file, id));
        CLN_TRY(vector3(where, entry, "coordinates", point->xyz));
        if (json_object_get(entry, "color"))
            CLN_TRY(vector3(where, entry, "color", colour));
        for (int i = 0; i < 3; i++)
            point->rgb[i] = (uint8_t)lround(fmax(0, fmin(255, colour[i])));
    }
done:
    free(where);
    return st;
}

/* The next field of a row of tracks.csv; NULL after the last. */
static const char *next_field(char **at)
{
    char *field = *at;

    if (!field)
        return NULL;
    *at = strchr(field, '\t');
    if (*at)
        *(*at)++ = 0;
    return field;
}

/* {key: index} of an object's entries, in their order. The caller decrefs it. */
static json_t *index_of(const json_t *object)
{
    json_t *index = json_object(), *entry = NULL;
    const char *key = NULL;
    json_int_t count = 0;

    json_object_foreach((json_t *)object, key, entry)
        json_object_set_new(index, key, json_integer(count++));
    return index;
}

/* Reads from tracks.csv which image shows which point, and counts the images of each; skips rows of
 * other images or points. */
static cln_status read_tracks(const char *path, const json_t *shots, const json_t *points,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_cursor c = {.path = path};
    json_t *views = index_of(shots), *numbers = index_of(points);

    CLN_TRY(cln_read_text(path, MAX_BYTES, &c.data, &c.size));
    for (char *line = NULL; (line = cln_cursor_line(&c));) {
        char *rest = line;
        const char *image = next_field(&rest), *point = next_field(&rest);
        const json_t *view = json_object_get(views, image);
        const json_t *number = point ? json_object_get(numbers, point) : NULL;

        if (!view || !number)
            continue;
        CLN_TRY(cln_grow(&result->observations, result->observation_count,
                         sizeof *result->observations, "images of points"));
        result->observations[result->observation_count++] = (cln_observation){
            (int32_t)json_integer_value(number), (int32_t)json_integer_value(view)};
        result->points[json_integer_value(number)].views++;
    }
done:
    free(c.data);
    json_decref(views);
    json_decref(numbers);
    return st;
}

/* The reconstruction with the most shots. */
static const json_t *largest(const json_t *root)
{
    const json_t *best = NULL;

    for (size_t i = 0; i < json_array_size(root); i++) {
        const json_t *one = json_array_get(root, i);

        if (!best || json_object_size(json_object_get(one, "shots")) >
                         json_object_size(json_object_get(best, "shots")))
            best = one;
    }
    return best;
}

static cln_status read_reconstruction(const char *file, const json_t *root, const char *tracks,
                                      cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const json_t *one = largest(root);
    const json_t *shots = json_object_get(one, "shots"), *cameras = json_object_get(one, "cameras");
    const char *name = NULL;
    json_t *shot = NULL;

    if (!json_is_object(shots) || !json_is_object(cameras))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: not an array of reconstructions with cameras and shots; export it "
                         "from OpenSfM again",
                         file));
    if (json_array_size(root) > 1)
        cln_warn("%s: it has %zu reconstructions, only the one with the most shots, %zu, is read",
                 file, json_array_size(root), json_object_size(shots));
    if (json_object_size(shots) > CLN_MAX_VIEWS)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %zu shots, more than the %d that are read; leave some out",
                         file, json_object_size(shots), CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&result->views, json_object_size(shots), sizeof *result->views, "views"));
    json_object_foreach((json_t *)shots, name, shot)
        CLN_TRY(add_view(file, name, shot, cameras, result));
    CLN_TRY(read_points(file, json_object_get(one, "points"), result));
    if (cln_is_file(tracks))
        CLN_TRY(read_tracks(tracks, shots, json_object_get(one, "points"), result));
    if (json_object_get(one, "reference_lla"))
        result->ignored = json_pack("[s]", "reference_lla");
done:
    return st;
}

static bool detect(const char *path, const char **missing)
{
    *missing = NULL;
    return cln_is_dir(path) && (cln_has_file(path, "reconstruction.json") ||
                                cln_has_file(path, "opensfm/reconstruction.json"));
}

/* Of OpenDroneMap's folder opensfm the one that it is in, which has the photos; else NULL. */
static cln_status project_of(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *whole = NULL, *last = NULL;

    CLN_TRY(cln_path_absolute(&whole, path));
    last = strrchr(whole, '/');
    if (last && last > whole && strcmp(last, "/opensfm") == 0) {
        *last = 0;
        *out = whole;
        whole = NULL;
    }
done:
    free(whole);
    return st;
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const bool inner = !cln_has_file(path, "reconstruction.json");
    char *file = NULL, *folder = NULL, *images = NULL, *tracks = NULL, *project = NULL, masks[64];
    json_t *root = NULL;

    CLN_TRY(cln_path_join(&folder, path, "opensfm"));
    if (!inner)
        CLN_TRY(project_of(path, &project));
    CLN_TRY(cln_path_join(&file, inner ? folder : path, "reconstruction.json"));
    CLN_TRY(cln_json_read_large(file, MAX_BYTES, &root));
    CLN_TRY(cln_path_join(&tracks, inner ? folder : path, "tracks.csv"));
    CLN_TRY(read_reconstruction(file, root, tracks, result));
    result->tailed = true;
    CLN_TRY(cln_dataset_find_images(file, path,
                                    (const char *const[2]){path, inner ? folder : project},
                                    1 + (inner || project), NULL, result, &images));
    result->dialect = "OpenSfM";
    result->beyond = true;
    result->stored_poses = true;
    cln_dataset_tell_masks(result, masks);
    CLN_TRY(cln_asprintf(&result->because, "it has %sreconstruction.json%s%s; images are from %s%s",
                         inner ? "opensfm/" : "",
                         result->observation_count ? ", with depths by tracks.csv" : "",
                         result->ignored ? "; coordinates are the reconstruction's own, "
                                           "reference_lla is not applied"
                                         : "",
                         cln_dataset_within(path, images), masks));
done:
    json_decref(root);
    free(file);
    free(folder);
    free(images);
    free(tracks);
    free(project);
    return st;
}

const cln_reader cln_reader_opensfm = {
    .name = "the OpenSfM reader",
    .wants = "a folder with reconstruction.json, or with it in opensfm",
    .detect = detect,
    .read = read_scene,
};
