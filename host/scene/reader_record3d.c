/* Reader of Record3D's captures (an iPhone or iPad): the folder of an export as EXR + JPG, which
 * has metadata.json and rgb, also where it lies in a folder EXR_RGBD, or an unpacked .r3d file,
 * which has metadata and rgbd. Of the metadata:
 *   w, h     size of the photos
 *   K        intrinsics, 3x3, column by column
 *   perFrameIntrinsicCoeffs  fx, fy, cx, cy of each photo, if there
 *   poses    of each photo x, y, z, w of a quaternion, then the place, in metres: camera-to-world
 *            with OpenGL's axes
 * Photo N is N.jpg (or .png). Depths, which are EXR or compressed by LZFSE, are not read. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/json.h"
#include "scene/dataset.h"
#include "scene/placing.h"
#include "scene/transforms.h"

static const size_t MAX_BYTES = (size_t)1 << 30; /* of the metadata: 100,000 photos have 40 MB */
enum { MAX_SIDE = 1000000, POSE = 7 };

/* Where the parts of a capture are. */
static const struct {
    const char *metadata, *photos;
} places[] = {
    {"metadata.json", "rgb"},
    {"EXR_RGBD/metadata.json", "EXR_RGBD/rgb"},
    {"metadata", "rgbd"},
};
enum { PLACES = sizeof places / sizeof *places };

/* -1: none. */
static int place_of(const char *path)
{
    for (int i = 0; i < PLACES; i++)
        if (cln_has_file(path, places[i].metadata) && cln_has_dir(path, places[i].photos))
            return i;
    return -1;
}

static bool detect(const char *path, const char **missing)
{
    *missing = NULL;
    if (place_of(path) >= 0)
        return true;
    if (cln_has_dir(path, "EXR_RGBD"))
        *missing = "one of these is not there";
    return false;
}

static cln_status numbers(const char *where, const json_t *array, size_t count, double *out)
{
    for (size_t i = 0; i < count; i++) {
        const json_t *value = json_array_get(array, i);

        if (!json_is_number(value))
            return cln_fail(CLN_INPUT, "%s must have %zu numbers; export the capture again", where,
                            count);
        out[i] = json_number_value(value);
    }
    return CLN_OK;
}

static cln_status read_side(const char *file, const json_t *root, const char *key, int *out)
{
    cln_status st = CLN_OK;
    double side = 0;
    bool found = false;

    CLN_TRY(cln_transforms_number(file, root, key, &side, &found));
    if (!(side >= 1 && side <= MAX_SIDE))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s must be the photos' size in pixels, not %g", file, key,
                         side));
    *out = (int)side;
done:
    return st;
}

/* Position and turn, from seven numbers. */
static cln_status set_pose(const char *where, const double of[POSE], double c2w[12])
{
    const double size = sqrt(of[0] * of[0] + of[1] * of[1] + of[2] * of[2] + of[3] * of[3]);
    const double q[4] = {of[3] / size, of[0] / size, of[1] / size, of[2] / size};

    if (!(fabs(size - 1) <= 1e-2))
        return cln_fail(CLN_INPUT,
                        "%s does not begin with a unit quaternion; export the capture "
                        "again",
                        where);
    cln_pose_turn(q, c2w);
    for (int i = 0; i < 3; i++)
        c2w[4 * i + 3] = of[4 + i];
    cln_dataset_from_opengl(c2w);
    return CLN_OK;
}

/* The camera of photo `number`. */
static cln_status read_camera(const char *file, const json_t *root, size_t number, cln_camera *out)
{
    cln_status st = CLN_OK;
    const json_t *each = json_object_get(root, "perFrameIntrinsicCoeffs");
    double k[9], pose[POSE];
    char *where = NULL;

    CLN_TRY(cln_asprintf(&where, "%s: pose %zu", file, number));
    CLN_TRY(numbers(where, json_array_get(json_object_get(root, "poses"), number), POSE, pose));
    CLN_TRY(set_pose(where, pose, out->c2w));
    free(where);
    where = NULL;
    if (json_array_size(each) > number) {
        CLN_TRY(cln_asprintf(&where, "%s: perFrameIntrinsicCoeffs %zu", file, number));
        CLN_TRY(numbers(where, json_array_get(each, number), 4, k));
        out->fx = k[0];
        out->fy = k[1];
        out->cx = k[2];
        out->cy = k[3];
    } else {
        CLN_TRY(cln_asprintf(&where, "%s: K", file));
        CLN_TRY(numbers(where, json_object_get(root, "K"), 9, k));
        out->fx = k[0];
        out->fy = k[4];
        out->cx = k[6];
        out->cy = k[7];
    }
    CLN_TRY(read_side(file, root, "w", &out->width));
    CLN_TRY(read_side(file, root, "h", &out->height));
done:
    free(where);
    return st;
}

/* "12.jpg" -> 12; -1: another name, or beyond `count`. */
static int number_of(const char *name, size_t count)
{
    char *end = NULL;
    const unsigned long long number = strtoull(name, &end, 10);

    return name[0] >= '0' && name[0] <= '9' && end == strrchr(name, '.') && number < count
               ? (int)number
               : -1;
}

static cln_status read_views(const char *file, const json_t *root, const char *folder,
                             cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const size_t poses = json_array_size(json_object_get(root, "poses"));
    cln_names names = {0};
    int kept = 0, without = 0;

    CLN_TRY(cln_dataset_images(folder, &names));
    for (int i = 0; i < names.count; i++) {
        char *name = names.name[i];

        names.name[i] = names.name[kept];
        names.name[kept] = name;
        kept += number_of(name, poses) >= 0;
    }
    without = names.count - kept;
    cln_dataset_cut_names(&names, kept);
    if (!kept)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: no photo in it has a number with a pose in %s, which has %zu; export "
                         "the capture again",
                         folder, file, poses));
    cln_dataset_tell_without(folder, "pose", without, kept);
    CLN_TRY(cln_dataset_views(file, folder, &names, result));
    for (int i = 0; i < kept; i++)
        CLN_TRY(read_camera(file, root, (size_t)number_of(names.name[i], poses),
                            &result->views[i].camera));
done:
    cln_dataset_free_names(&names);
    return st;
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const int place = place_of(path);
    char *file = NULL, *folder = NULL;
    json_t *root = NULL;

    CLN_TRY(cln_path_join(&file, path, places[place].metadata));
    CLN_TRY(cln_path_join(&folder, path, places[place].photos));
    CLN_TRY(cln_json_read_large(file, MAX_BYTES, &root));
    CLN_TRY(read_views(file, root, folder, result));
    CLN_TRY(cln_dataset_find_masks(path, folder, result));
    result->dialect = "Record3D";
    result->beyond = true;
    result->stored_poses = true;
    CLN_TRY(cln_asprintf(&result->because, "it has %s and %s", places[place].metadata,
                         places[place].photos));
done:
    json_decref(root);
    free(file);
    free(folder);
    return st;
}

const cln_reader cln_reader_record3d = {
    .name = "the Record3D reader",
    .wants = "a folder with metadata.json and rgb, or metadata and rgbd",
    .detect = detect,
    .read = read_scene,
};
