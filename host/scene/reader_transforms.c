/* Reader of transforms JSON, in its dialects:
 *   blender      transforms_train.json with _val and _test beside it, one camera_angle_x, file_path
 *                without extension, RGBA images; the cube is 0 +- 1.5
 *   instant-ngp  one transforms.json; intrinsics shared or per frame (fl_x fl_y cx cy w h k1 k2 p1
 *                p2, or camera_angle_x/y); aabb_scale, scale, offset, aabb say where the scene is
 *   nerfstudio   the same without those; camera_model; train/val/test_filenames name the splits
 * Poses are camera-to-world with OpenGL axes (x right, y up, z backwards); transforms_frame.c turns
 * them. Comments and trailing commas are allowed. Lens models that lens.h lacks are refused,
 * depth images are left out. */
#include "scene/reader.h"

#include <dirent.h>
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "scene/build.h"
#include "scene/dataset.h"
#include "scene/found.h"
#include "scene/moved.h"
#include "scene/placing.h"
#include "scene/transforms.h"

/* Appends the frames of one document to the result, as `split`; finish_frames follows. */
static cln_status read_frames(const char *folder, const char *file, const json_t *root,
                              cln_split split, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const json_t *frames = json_object_get(root, "frames");
    const char *schema = json_string_value(json_object_get(root, "schema"));
    cln_view *views = NULL;
    size_t count = 0;

    if (json_object_get(json_array_get(root, 0), "shots"))
        CLN_TRY(
            cln_fail(CLN_INPUT,
                     "%s: it is a reconstruction of OpenSfM's; give the folder around it, where "
                     "it is called reconstruction.json",
                     file));
    if (json_object_get(root, "sfm_data_version"))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: a scene of OpenMVG; " CLN_OPENMVG, file));
    if (!json_is_object(root))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: not a JSON object with frames; give the file that has them", file));
    if (!frames && schema && strncmp(schema, "cl-nascent.run/", 15) == 0)
        CLN_TRY(
            cln_fail(CLN_INPUT, "%s: it is a run's, not a scene's; give the run's folder", file));
    if (!frames)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: it has no frames, so it is not a scene; give the folder of one, or "
                         "write the poses that it has as one: docs/formats.md, \"Your own poses\"",
                         file));
    if (!json_is_array(frames))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: frames must be an array", file));
    count = json_array_size(frames);
    if (count > (size_t)(CLN_MAX_VIEWS - result->view_count))
        CLN_TRY(
            cln_fail(CLN_INPUT, "%s: more than %d frames; leave some out", file, CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&views, (size_t)result->view_count + count, sizeof *views, "views"));
    if (result->view_count)
        memcpy(views, result->views, (size_t)result->view_count * sizeof *views);
    free(result->views);
    result->views = views;
    CLN_TRY(cln_transforms_ignored(root, false, &result->ignored));
    for (size_t i = 0; i < count; i++) {
        cln_view *view = &views[result->view_count++];

        view->split = split;
        CLN_TRY(cln_transforms_ignored(json_array_get(frames, i), true, &result->ignored));
        CLN_TRY(cln_transforms_frame(folder, file, root, (int)i, view));
    }
done:
    return st;
}

/* One camera_angle_x for photos of which none has another focal length counts over each one's
 * width: what was cut off at a side, or stands upright, had another angle there. Was that told? */
static bool tell_angle(const char *file, const json_t *root, const cln_view *views, int count)
{
    static const char *const others[] = {"fl_x", "fl_y", "camera_angle_y", "w", "h"};
    const cln_view *differs = NULL;
    int upright = 0;

    for (size_t i = 0; i < sizeof others / sizeof *others; i++)
        for (int k = -1; k < count; k++)
            if (json_object_get(k < 0 ? root
                                      : json_array_get(json_object_get(root, "frames"), (size_t)k),
                                others[i]))
                return false;
    for (int i = 0; i < count && json_object_get(root, "camera_angle_x"); i++) {
        const cln_camera *c = &views[i].camera;

        if (!differs && views[0].camera.width > 0 && c->width > 0 &&
            !cln_camera_has_shape(&views[0].camera, c->width, c->height))
            differs = &views[i];
        upright += c->height > c->width;
    }
    if (differs)
        cln_warn("%s: its photos have several shapes ('%s' has %d x %d pixels, '%s' %d x %d), but "
                 "one camera_angle_x, which counts over each one's width; give each frame its own, "
                 "or fl_x, cx and cy",
                 file, views[0].name, views[0].camera.width, views[0].camera.height, differs->name,
                 differs->camera.width, differs->camera.height);
    else if (count > 0 && upright == count)
        cln_warn(
            "%s: its photos are upright, and camera_angle_x counts over their width; Blender's "
            "angle (sensor fit Auto) is over the longer side: if it is that, call it "
            "camera_angle_y",
            file);
    return differs || (count > 0 && upright == count);
}

/* Finds images that are elsewhere, then what is read with them of the frames of each document, in
 * the order in which they were appended. */
static cln_status finish_frames(const char *folder, char *const *files, json_t *const *roots,
                                int count, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_moved moved = {.folder = folder};
    const char *first = NULL; /* frame with an alpha file that is not read */
    int view = 0, unread = 0;

    CLN_TRY(cln_moved_views(&moved, result));
    for (int d = 0; d < count; d++) {
        const size_t frames = json_array_size(json_object_get(roots[d], "frames"));

        for (size_t i = 0; i < frames; i++) {
            cln_view *v = &result->views[view++];
            bool found = false;

            CLN_TRY(cln_transforms_finish(folder, files[d], roots[d], (int)i, &moved, v));
            CLN_TRY(cln_transforms_unread_alpha(roots[d], (int)i, v, &found));
            first = found && !first ? v->name : first;
            unread += found;
        }
    }
    if (unread)
        cln_warn(
            "%s: instant-ngp's alpha files beside %d images ('%s'%s) are not read; name each as "
            "its frame's alpha_path, whose brightness is alpha as it stands",
            folder, unread, first, unread > 1 ? ", ..." : "");
    view = 0;
    for (int d = 0; d < count; d++) { /* of several alike, one is told */
        const int frames = (int)json_array_size(json_object_get(roots[d], "frames"));

        if (tell_angle(files[d], roots[d], result->views + view, frames))
            break;
        view += frames;
    }
done:
    cln_moved_free(&moved);
    return st;
}

/* Of a document that names no mask: those in a folder, or beside the photos, as elsewhere. */
static cln_status find_masks(const char *folder, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *images = NULL, *slash = NULL;
    int first = 0; /* that is there */

    for (int i = 0; i < result->view_count; i++)
        if (result->views[i].mask_path || result->views[i].alpha_path)
            return CLN_OK;
    while (first < result->view_count && !cln_is_file(result->views[first].path))
        first++;
    if (first == result->view_count)
        return CLN_OK;
    CLN_TRY(cln_strdup(&images, result->views[first].path));
    slash = strrchr(images, '/');
    if (slash)
        *slash = 0;
    CLN_TRY(cln_dataset_find_masks(folder, images, result));
done:
    free(images);
    return st;
}

static void free_view(cln_view *view)
{
    free(view->name);
    free(view->path);
    free(view->alpha_path);
    free(view->mask_path);
    free(view->depth.depth);
    free(view->depth.confidence);
    memset(view, 0, sizeof *view);
}

/* The frames of a document, by name. */
typedef struct frames {
    const char *file;
    cln_view *views;
    int count;
    json_t *index;   /* positions in views, by name */
    cln_names names; /* of all of them, sorted by cln_moved_sort */
    int meant;       /* names in lists that are written otherwise than the frame's */
} frames;

static cln_status index_frames(frames *f)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&f->names.name, (size_t)f->count, sizeof *f->names.name, "names"));
    for (; f->names.count < f->count; f->names.count++) {
        const char *name = f->views[f->names.count].name;

        if (json_object_get(f->index, name))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: two frames have the file_path '%s', so lists of splits do not "
                             "tell which is meant; remove one of them",
                             f->file, name));
        CLN_TRY(cln_strdup(&f->names.name[f->names.count], name));
        json_object_set_new(f->index, name, json_integer(f->names.count));
    }
    cln_moved_sort(&f->names);
done:
    return st;
}

/* Finds the frame that a list means: by its name, or by one that differs from it in folders before
 * it, in the ending or in case, if no other frame can be meant. */
static cln_status find_listed(frames *f, const char *key, const char *entry, const char *name,
                              const cln_view **out)
{
    cln_status st = CLN_OK;
    const char *found[2] = {name, NULL};
    const json_t *position = json_object_get(f->index, name);

    if (!position) {
        cln_moved_meant(&f->names, name, found);
        if (!found[0])
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: %s names '%s', which no frame has (the first frame is '%s'); "
                             "name a frame as its file_path does, or remove the name",
                             f->file, key, entry, f->count ? f->views[0].name : ""));
        if (found[1])
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: %s names '%s', which may be the frame '%s' or '%s'; name the one "
                             "that is meant as its file_path does",
                             f->file, key, entry, found[0], found[1]));
        if (f->meant++ == 0)
            cln_info("%s: its %s has other names than its frames: '%s' is taken for '%s', and "
                     "others like it",
                     f->file, key, entry, found[0]);
        position = json_object_get(f->index, found[0]);
    }
    *out = &f->views[json_integer_value(position)];
done:
    return st;
}

/* Adds views for the frames that one list names. */
static cln_status take_listed(frames *f, const char *key, const json_t *list, cln_split split,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const json_t *entry = NULL;
    const cln_view *frame = NULL;
    char *name = NULL;
    size_t i = 0;

    if (list && !json_is_array(list))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s must be an array of file names", f->file, key));
    json_array_foreach(list, i, entry)
    {
        cln_view *view = &result->views[result->view_count];

        if (!json_is_string(entry))
            CLN_TRY(cln_fail(CLN_INPUT, "%s: %s[%zu] must be a string", f->file, key, i));
        CLN_TRY(cln_dataset_name(f->file, json_string_value(entry), &name));
        CLN_TRY(find_listed(f, key, json_string_value(entry), name, &frame));
        free(name);
        name = NULL;
        *view = *frame;
        view->name = view->path = view->alpha_path = view->mask_path = NULL;
        view->depth.depth = view->depth.confidence = NULL;
        view->split = split;
        result->view_count++;
        CLN_TRY(cln_strdup(&view->name, frame->name));
        CLN_TRY(cln_strdup(&view->path, frame->path));
        CLN_TRY(cln_strdup(&view->alpha_path, frame->alpha_path));
        CLN_TRY(cln_strdup(&view->mask_path, frame->mask_path));
        CLN_TRY(cln_strdup(&view->depth.depth, frame->depth.depth));
        CLN_TRY(cln_strdup(&view->depth.confidence, frame->depth.confidence));
    }
done:
    free(name);
    return st;
}

/* Whether a list repeats views for other programs' sake (listed_again, export/cameras.c). */
static bool is_repeated(const json_t *root, const char *key)
{
    const json_t *again = json_object_get(root, "listed_again");

    for (size_t i = 0; i < json_array_size(again); i++) {
        const char *name = json_string_value(json_array_get(again, i));

        if (name && strcmp(name, key) == 0)
            return true;
    }
    return false;
}

/* Applies train_filenames, val_filenames and test_filenames: views become exactly what these list
 * (a frame may be in two lists); frames in no list are left out with a warning. */
static cln_status apply_lists(const char *file, const json_t *root, cln_reader_result *result)
{
    static const char *const keys[CLN_SPLITS] = {"train_filenames", "val_filenames",
                                                 "test_filenames"};
    cln_status st = CLN_OK;
    frames f = {.file = file, .views = result->views, .count = result->view_count};
    size_t listed = 0;

    for (int s = 0; s < CLN_SPLITS; s++) {
        result->named_splits |= json_object_get(root, keys[s]) != NULL;
        listed += json_array_size(json_object_get(root, keys[s]));
    }
    if (!result->named_splits)
        return CLN_OK;
    result->views = NULL;
    result->view_count = 0;
    if (listed > CLN_MAX_VIEWS)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: more than %d names in the lists of splits; leave some out",
                         file, CLN_MAX_VIEWS));
    CLN_TRY(cln_alloc(&result->views, listed, sizeof *result->views, "views"));
    f.index = json_object();
    CLN_TRY(index_frames(&f));
    for (int s = 0; s < CLN_SPLITS; s++) {
        if (!is_repeated(root, keys[s]))
            CLN_TRY(take_listed(&f, keys[s], json_object_get(root, keys[s]), (cln_split)s, result));
    }
    for (int i = 0; i < result->view_count; i++)
        json_object_del(f.index, result->views[i].name);
    if (json_object_size(f.index))
        cln_warn("%s: %zu of %d frames %s in none of its lists of file names and left out", file,
                 json_object_size(f.index), f.count,
                 cln_plural((double)json_object_size(f.index), "is", "are"));
done:
    for (int i = 0; i < f.count; i++)
        free_view(&f.views[i]);
    free(f.views);
    cln_dataset_free_names(&f.names);
    json_decref(f.index);
    return st;
}

static cln_status read_vector3(const char *file, const char *key, const json_t *value,
                               double out[3])
{
    for (size_t i = 0; i < 3; i++) {
        const json_t *entry = json_is_array(value) ? json_array_get(value, i) : value;

        if (!json_is_number(entry) || (json_is_array(value) && json_array_size(value) != 3))
            return cln_fail(CLN_INPUT, "%s: %s must be three numbers", file, key);
        out[i] = json_number_value(entry);
    }
    return CLN_OK;
}

/* The box of `aabb`, its sides times aabb_scale, and the cube around it. A flat one is no box. */
static cln_status read_aabb(const char *file, const json_t *aabb, double aabb_scale,
                            cln_reader_result *result)
{
    cln_status st = CLN_OK;
    double low[3], high[3], longest = 1e-6; /* instant-ngp's floor */

    CLN_TRY(read_vector3(file, "aabb[0]", json_array_get(aabb, 0), low));
    CLN_TRY(read_vector3(file, "aabb[1]", json_array_get(aabb, 1), high));
    result->has_box = true;
    for (int i = 0; i < 3; i++) {
        const double side = fabs(high[i] - low[i]), middle = 0.5 * (low[i] + high[i]);

        longest = fmax(longest, side);
        result->space.centre[i] = middle;
        result->box[i] = middle - 0.5 * aabb_scale * side;
        result->box[i + 3] = middle + 0.5 * aabb_scale * side;
        result->has_box &= side > 0;
    }
    result->space.half = 0.5 * aabb_scale * longest;
done:
    return st;
}

/* An aabb_scale up to that is somebody's choice: instant-ngp's fox has 4. Its script colmap2nerf
 * writes 32 by itself, as its grid has finer levels in the middle. */
static const double NARROW = 4;

/* Keys that nerfstudio writes and instant-ngp does not. */
static bool of_nerfstudio(const json_t *root)
{
    static const char *const keys[] = {"applied_transform", "applied_scale", "train_filenames",
                                       "ply_file_path"};

    for (size_t i = 0; i < sizeof keys / sizeof *keys; i++)
        if (json_object_get(root, keys[i]))
            return true;
    return false;
}

/* instant-ngp maps a point p of the file to p * scale + offset, in a box of side aabb_scale around
 * 0.5; its change of axes after that leaves a cube where it is. In the file's own coordinates:
 *   centre = (0.5 - offset) / scale, half = aabb_scale / (2 scale)
 * `aabb` gives scale and offset such that its longest side becomes 1 and its centre 0.5. */
static cln_status read_bounds(const char *file, const json_t *root, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const json_t *offset = json_object_get(root, "offset"), *aabb = json_object_get(root, "aabb");
    double aabb_scale = 1, scale = 0.33, shift[3] = {0.5, 0.5, 0.5};
    bool has_size = false, has_scale = false;

    CLN_TRY(cln_transforms_number(file, root, "aabb_scale", &aabb_scale, &has_size));
    CLN_TRY(cln_transforms_number(file, root, "scale", &scale, &has_scale));
    if (!has_size && !offset && !aabb && (!has_scale || of_nerfstudio(root))) {
        if (has_scale)
            cln_info("%s: scale %g is not used: of a file with nerfstudio's keys it is no cube of "
                     "instant-ngp's, which has aabb_scale beside it",
                     file, scale);
        goto done;
    }
    if (offset)
        CLN_TRY(read_vector3(file, "offset", offset, shift));
    if (!(aabb_scale > 0) || !(scale > 0))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: aabb_scale %g and scale %g must be above zero", file,
                         aabb_scale, scale));
    for (int i = 0; i < 3; i++)
        result->space.centre[i] = (0.5 - shift[i]) / scale;
    result->space.half = 0.5 * aabb_scale / scale;
    if (aabb)
        CLN_TRY(read_aabb(file, aabb, aabb_scale, result));
    result->has_bounds = true;
    result->wide = !aabb && aabb_scale > NARROW;
    CLN_TRY(cln_asprintf(&result->bounds_rule, "the file's %s, times aabb_scale %g",
                         aabb                  ? "aabb"
                         : has_scale || offset ? "scale and offset in instant-ngp's unit box"
                                               : "frame in instant-ngp's unit box (scale 0.33)",
                         aabb_scale));
done:
    return st;
}

/* Warns of files that look like a split that is missing, under another name:
 * transforms_testing.json. Others of training views are choices of somebody's. */
static void warn_other_names(const char *folder)
{
    const bool val = cln_has_file(folder, "transforms_val.json");
    const bool test = cln_has_file(folder, "transforms_test.json");
    DIR *dir = val && test ? NULL : opendir(folder);

    for (struct dirent *e = dir ? readdir(dir) : NULL; e; e = readdir(dir)) {
        const char *split = strncmp(e->d_name, "transforms_", 11) == 0 ? e->d_name + 11 : "train";

        if (strncmp(split, "train", 5) == 0 || !cln_ends_with(split, ".json") ||
            strcmp(split, "val.json") == 0 || strcmp(split, "test.json") == 0 ||
            (test && strncmp(split, "val", 3) != 0))
            continue;
        cln_warn("%s/%s is not read: splits are transforms_train.json, transforms_val.json and "
                 "transforms_test.json; rename it if it is one of them",
                 folder, e->d_name);
    }
    if (dir)
        closedir(dir);
}

/* Warns of a split's folder, as of a scene that is not copied in full. */
static cln_status warn_folder_alone(const char *folder, const char *split, const char *file)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(cln_path_join(&path, folder, split));
    if (cln_is_dir(path))
        cln_warn("%s is there, but no %s; frames of the other files alone are read", path, file);
done:
    free(path);
    return st;
}

/* given: the folder, or one of its files. */
static cln_status read_blender(const char *folder, const char *given, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    json_t *roots[CLN_SPLITS] = {NULL};
    char *files[CLN_SPLITS] = {NULL}, *name = NULL;

    result->dialect = "blender";
    if (cln_is_dir(given))
        CLN_TRY(cln_asprintf(&result->because, "it has transforms_train.json"));
    else
        CLN_TRY(cln_asprintf(&result->because,
                             "%s is one of the files of its splits, which are read together",
                             cln_last_name(given)));
    warn_other_names(folder);
    for (int s = 0; s < CLN_SPLITS; s++) {
        free(name);
        name = NULL;
        CLN_TRY(cln_asprintf(&name, "transforms_%s.json", cln_split_names[s]));
        CLN_TRY(cln_path_join(&files[s], folder, name));
        if (!cln_is_file(files[s]) && s == CLN_SPLIT_TRAIN)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: No such file or directory; put it beside the others",
                             files[s]));
        if (!cln_is_file(files[s])) {
            CLN_TRY(warn_folder_alone(folder, cln_split_names[s], name));
            continue;
        }
        CLN_TRY(cln_transforms_read(files[s], &roots[s]));
        CLN_TRY(read_frames(folder, files[s], roots[s], (cln_split)s, result));
        if (s == CLN_SPLIT_TRAIN)
            CLN_TRY(read_bounds(files[s], roots[s], result));
        else
            result->named_splits = true;
    }
    CLN_TRY(finish_frames(folder, files, roots, CLN_SPLITS, result));
    CLN_TRY(find_masks(folder, result));
    if (!result->has_bounds) {
        result->has_bounds = true;
        result->space.half = 1.5;
        CLN_TRY(cln_strdup(&result->bounds_rule, "the Blender scenes' convention, 0 +- 1.5"));
    }
done:
    for (int s = 0; s < CLN_SPLITS; s++) {
        json_decref(roots[s]);
        free(files[s]);
    }
    free(name);
    return st;
}

/* The points of structure from motion that nerfstudio keeps beside the file, in its frame. */
static cln_status read_points(const char *folder, const char *file, const json_t *root,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    const json_t *name = json_object_get(root, "ply_file_path");
    char *path = NULL, *found = NULL;

    if (!name)
        return CLN_OK;
    if (!json_is_string(name))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: ply_file_path must be a string", file));
    CLN_TRY(cln_path_join(&path, folder, json_string_value(name)));
    if (!cln_is_file(path) && *json_string_value(name))
        CLN_TRY(cln_moved_file(folder, json_string_value(name), &found));
    if (!cln_is_file(path) && !found) {
        cln_warn("%s: there is no %s, which its ply_file_path names: no sparse points are read",
                 file, path);
        goto done;
    }
    if (found) {
        free(path);
        path = found;
        found = NULL;
    }
    st = cln_dataset_read_ply(path, result);
    if (st == CLN_INPUT)
        cln_note("reading the sparse points of %s (without ply_file_path, its cameras alone "
                 "are read)",
                 file);
done:
    free(path);
    free(found);
    return st;
}

/* Depth images: nerfstudio's, in thousandths of the poses' units if depth_unit_scale_factor does
 * not say otherwise, or instant-ngp's. Without other points, theirs are the scene's. */
static cln_status read_depths(const char *folder, const char *file, const json_t *root,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    static const char *const used[] = {"depth_file_path", "depth_unit_scale_factor", "depth_path",
                                       "integer_depth_scale"};
    const json_t *listed = json_object_get(root, "frames");
    const int step = (result->view_count + CLN_DEPTH_PHOTOS - 1) / CLN_DEPTH_PHOTOS;
    const bool points = result->point_count == 0 && (!result->has_bounds || result->wide);
    double unit = 1e-3;
    int images = 0;
    bool found = false;

    CLN_TRY(cln_transforms_number(file, root, "integer_depth_scale", &unit, &found));
    if (!found)
        CLN_TRY(cln_transforms_number(file, root, "depth_unit_scale_factor", &unit, &found));
    for (int i = 0; i < result->view_count; i++) {
        cln_view *view = &result->views[i];
        const json_t *frame = json_array_get(listed, (size_t)i);
        const char *name = json_string_value(json_object_get(frame, "depth_file_path"));

        name = name ? name : json_string_value(json_object_get(frame, "depth_path"));
        if (!name)
            continue;
        view->depth = (cln_depth_image){.unit = unit, .most = INFINITY};
        CLN_TRY(cln_path_join(&view->depth.depth, folder, name));
        images += cln_is_file(view->depth.depth);
        if (points && i % step == 0)
            CLN_TRY(cln_dataset_depth_points(view, result));
    }
    cln_dataset_tell_depths(file, result);
    for (size_t i = json_array_size(result->ignored);
         i-- > 0 && (points ? result->depth_points : images > 0);) {
        const char *key = json_string_value(json_array_get(result->ignored, i));

        for (size_t k = 0; k < sizeof used / sizeof *used; k++)
            if (strcmp(key, used[k]) == 0) {
                json_array_remove(result->ignored, i);
                break;
            }
    }
done:
    return st;
}

/* whole: the file is the folder's, so photos that it does not name are told. */
static cln_status read_single(const char *folder, const char *file, bool whole,
                              cln_reader_result *result)
{
    cln_status st = CLN_OK;
    json_t *root = NULL;

    CLN_TRY(cln_transforms_read(file, &root));
    CLN_TRY(read_frames(folder, file, root, CLN_SPLIT_TRAIN, result));
    CLN_TRY(finish_frames(folder, (char *const[1]){(char *)file}, &root, 1, result));
    CLN_TRY(find_masks(folder, result));
    CLN_TRY(read_bounds(file, root, result));
    CLN_TRY(read_points(folder, file, root, result));
    CLN_TRY(read_depths(folder, file, root, result));
    if (whole)
        CLN_TRY(cln_dataset_tell_unposed(folder, result));
    CLN_TRY(apply_lists(file, root, result));
    result->beyond = true;
    result->dialect = result->has_bounds ? "instant-ngp" : "nerfstudio";
    CLN_TRY(cln_asprintf(&result->because, "%s %s%s",
                         strrchr(file, '/') ? strrchr(file, '/') + 1 : file,
                         result->has_bounds ? "has aabb_scale, scale, offset or aabb"
                                            : "has frames and no aabb_scale",
                         cln_has_file(folder, "transforms_train.json")
                             ? "; transforms_train.json beside it is not read"
                             : ""));
done:
    json_decref(root);
    return st;
}

static bool is_split_file(const char *path)
{
    return cln_ends_with(path, "transforms_train.json") ||
           cln_ends_with(path, "transforms_val.json") ||
           cln_ends_with(path, "transforms_test.json");
}

static bool detect(const char *path, const char **missing)
{
    if (!cln_is_dir(path)) {
        *missing = NULL;
        return cln_is_file(path) && cln_ends_with(path, ".json");
    }
    *missing =
        cln_has_file(path, "transforms_val.json") || cln_has_file(path, "transforms_test.json")
            ? "transforms_train.json is missing beside the others"
            : NULL;
    return cln_has_file(path, "transforms.json") || cln_has_file(path, "transforms_train.json");
}

static cln_status read_scene(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    char *folder = NULL, *file = NULL;

    CLN_TRY(cln_scene_folder(path, &folder));
    if (!cln_is_dir(path) && !is_split_file(path)) {
        CLN_TRY(read_single(folder, path, false, result));
    } else if (cln_is_dir(path) && cln_has_file(folder, "transforms.json")) {
        CLN_TRY(cln_path_join(&file, folder, "transforms.json"));
        CLN_TRY(read_single(folder, file, true, result));
    } else {
        CLN_TRY(read_blender(folder, path, result));
    }
done:
    free(folder);
    free(file);
    return st;
}

const cln_reader cln_reader_transforms = {
    .name = "the transforms reader",
    .wants = "a folder with transforms.json or transforms_train.json, or a .json file",
    .detect = detect,
    .read = read_scene,
};
