/* Reader of NSVF scenes: rgb/NAME.png (or .jpg) with pose/NAME.txt, a camera-to-world matrix with
 * our axes; intrinsics.txt, either a matrix (3x3, or 4x4 in rows or in one line) or a line "f cx cy
 * _", the rest of which is left out; bbox.txt, the box of the scene. A name that begins with 0_, 1_
 * or 2_ is of training, validation or test; where none begins with 2_, 1_ is test. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/cursor.h"
#include "scene/dataset.h"
#include "scene/placing.h"

enum { MOST = 16, LINES = 4, MAX_BYTES = 1 << 20 };

/* Numbers of a small text file: all of them, and their count in each of the first lines. */
typedef struct numbers {
    int count, lines, in_line[LINES];
    double value[MOST];
} numbers;

/* Reads the first LINES lines of numbers, MOST at most; anything else in them is an error. Blank
 * lines do not count. */
static cln_status read_numbers(const char *path, numbers *out)
{
    cln_status st = CLN_OK;
    cln_cursor cursor = {.path = path};
    char *line = NULL;

    *out = (numbers){0};
    CLN_TRY(cln_read_text(path, MAX_BYTES, &cursor.data, &cursor.size));
    while (out->lines < LINES && (line = cln_cursor_line(&cursor))) {
        double value = 0;

        for (; out->count < MOST && cln_field_number(&line, &value); out->in_line[out->lines]++)
            out->value[out->count++] = value;
        if (line[strspn(line, " \t")])
            CLN_TRY(cln_fail(
                CLN_INPUT,
                "%s: line %d: '%.20s' is not a number, or is one number too many; correct the line",
                path, cursor.line, line));
        out->lines += out->in_line[out->lines] > 0;
    }
done:
    free(cursor.data);
    return st;
}

static cln_status read_intrinsics(const char *path, cln_camera *out)
{
    cln_status st = CLN_OK;
    numbers n;
    int columns = 0;

    CLN_TRY(read_numbers(path, &n));
    if (n.in_line[0] == 16)
        columns = 4;
    else if (n.in_line[0] >= 3 && n.in_line[0] <= 4 && n.in_line[1] == n.in_line[0] &&
             n.in_line[2] == n.in_line[0])
        columns = n.in_line[0];
    else if (n.in_line[0] != 4)
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: neither a matrix of 3x3 or 4x4 numbers nor a line f cx cy; write one of these",
            path));
    out->fx = n.value[0];
    out->fy = columns ? n.value[columns + 1] : n.value[0];
    out->cx = columns ? n.value[2] : n.value[1];
    out->cy = columns ? n.value[columns + 2] : n.value[2];
done:
    return st;
}

static cln_status read_pose(const char *path, double c2w[12])
{
    cln_status st = CLN_OK;
    numbers n;

    CLN_TRY(read_numbers(path, &n));
    if (n.count != 12 && n.count != 16)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: not a matrix of 4x4 numbers: it has %d; correct it, or remove it to "
                         "leave its image out",
                         path, n.count));
    memcpy(c2w, n.value, 12 * sizeof *c2w);
done:
    return st;
}

/* bbox.txt: lowest corner, highest corner, size of a voxel. */
static cln_status read_box(const char *folder, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    numbers n;

    CLN_TRY(cln_path_join(&path, folder, "bbox.txt"));
    if (!cln_is_file(path))
        goto done;
    CLN_TRY(read_numbers(path, &n));
    for (int a = 0; a < 3; a++) {
        if (n.count < 6 || !(n.value[a] < n.value[a + 3]))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: it must have six numbers, the lowest corner and the highest",
                             path));
        result->space.centre[a] = 0.5 * (n.value[a] + n.value[a + 3]);
        result->space.half = fmax(result->space.half, 0.5 * (n.value[a + 3] - n.value[a]));
    }
    memcpy(result->box, n.value, sizeof result->box);
    result->has_box = result->has_bounds = true;
    CLN_TRY(cln_strdup(&result->bounds_rule, "the cube around bbox.txt"));
done:
    free(path);
    return st;
}

/* "0_x" -> 0; -1 for another name. */
static int prefix_of(const char *name)
{
    name = cln_last_name(name);
    return name[0] >= '0' && name[0] <= '2' && name[1] == '_' ? name[0] - '0' : -1;
}

static void name_splits(cln_reader_result *result)
{
    static const cln_split splits[3] = {CLN_SPLIT_TRAIN, CLN_SPLIT_VAL, CLN_SPLIT_TEST};
    int count[3] = {0};

    for (int i = 0; i < result->view_count; i++) {
        const int prefix = prefix_of(result->views[i].name);

        if (prefix < 0)
            return;
        count[prefix]++;
    }
    if (!count[1] && !count[2])
        return;
    result->named_splits = true;
    for (int i = 0; i < result->view_count; i++) {
        const int prefix = prefix_of(result->views[i].name);

        result->views[i].split = splits[prefix == 1 && !count[2] ? 2 : prefix];
    }
}

/* Leaves out images without a pose file, with a warning. */
static cln_status read_poses(const char *path, cln_names *images, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *file = NULL, *poses = NULL;
    int kept = 0, without = 0;

    CLN_TRY(cln_path_join(&poses, path, "pose"));
    CLN_TRY(cln_dataset_keep_with(poses, ".txt", images, &without));
    kept = images->count;
    if (!kept)
        CLN_TRY(cln_fail(
            CLN_INPUT,
            "%s: no file in rgb has a .txt file of its name in pose; give both the same names",
            path));
    CLN_TRY(cln_path_join(&file, path, "rgb"));
    cln_dataset_tell_without(file, "pose", without, kept);
    CLN_TRY(cln_dataset_views(path, file, images, result));
    for (int i = 0; i < kept; i++) {
        free(file);
        file = NULL;
        CLN_TRY(cln_dataset_beside(poses, images->name[i], ".txt", &file));
        CLN_TRY(read_pose(file, result->views[i].camera.c2w));
    }
done:
    free(file);
    free(poses);
    return st;
}

static bool detect(const char *path, const char **missing)
{
    const bool one = cln_has_file(path, "intrinsics.txt");
    const bool poses = cln_has_dir(path, "pose");
    const bool images = cln_has_dir(path, "rgb");

    *missing = one && (poses || images) ? "it lacks one of them" : NULL;
    return cln_is_dir(path) && one && poses && images;
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *file = NULL, *folder = NULL;
    cln_names images = {0};
    cln_camera camera = {0};

    CLN_TRY(cln_path_join(&file, path, "intrinsics.txt"));
    CLN_TRY(read_intrinsics(file, &camera));
    CLN_TRY(cln_path_join(&folder, path, "rgb"));
    CLN_TRY(cln_dataset_images(folder, &images));
    CLN_TRY(read_poses(path, &images, result));
    for (int i = 0; i < result->view_count; i++) {
        cln_camera *own = &result->views[i].camera;

        own->fx = camera.fx;
        own->fy = camera.fy;
        own->cx = camera.cx;
        own->cy = camera.cy;
    }
    name_splits(result);
    CLN_TRY(read_box(path, result));
    CLN_TRY(cln_dataset_find_masks(path, folder, result));
    result->dialect = "NSVF";
    CLN_TRY(cln_strdup(&result->because, "it has intrinsics.txt, pose and rgb"));
done:
    cln_dataset_free_names(&images);
    free(file);
    free(folder);
    return st;
}

const cln_reader cln_reader_nsvf = {
    .name = "the NSVF reader",
    .wants = "a folder with intrinsics.txt, pose and rgb",
    .detect = detect,
    .read = read_scene,
};
