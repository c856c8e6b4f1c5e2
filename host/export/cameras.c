/* export --cameras: the scene's cameras, in its frame and at the size of its image files, as a
 * transforms JSON file in nerfstudio's form, or as a folder with COLMAP's three text files. */
#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "export/export.h"
#include "io/disk.h"
#include "render/frames.h"
#include "scene/transforms_write.h"

enum { FRAME_BYTES = 2048 }; /* of a view in either form, at most */

/* A view's camera at the size of its image file. --downscale N had divided it by N, and left out
 * columns and rows that did not fill a pixel. */
static cln_camera camera_of(const cln_view *view)
{
    cln_camera c = view->camera;

    c.fx *= view->downscale;
    c.cx *= view->downscale;
    c.fy *= view->downscale;
    c.cy *= view->downscale;
    c.width = view->file_width;
    c.height = view->file_height;
    return c;
}

static bool same_camera(const cln_view *a, const cln_view *b)
{
    return a->file_width == b->file_width && a->file_height == b->file_height &&
           a->disc == b->disc && cln_camera_is_like(&a->camera, &b->camera);
}

/* Was this photo there before, as one that is in two splits is? */
static bool is_again(const cln_scene *scene, int view)
{
    const cln_view *v = &scene->views[view];

    for (int i = 0; i < view; i++)
        if (strcmp(scene->views[i].path, v->path) == 0 &&
            memcmp(scene->views[i].camera.c2w, v->camera.c2w, sizeof v->camera.c2w) == 0)
            return true;
    return false;
}

/* ---- transforms JSON ---- */

static bool put_intrinsics(json_t *to, const cln_view *view)
{
    const cln_camera c = camera_of(view);

    const double radius = view->disc * (c.width > c.height ? c.width : c.height);

    return cln_transforms_put_camera(to, &c) &&
           (radius == 0 || json_object_set_new(to, "fisheye_crop_radius", json_real(radius)) == 0);
}

static const char *lens_name(const cln_view *view)
{
    return cln_lens_models[view->camera.lens].name;
}

/* Whether all views have one camera; *lens: whether all have one lens model. */
static bool have_one_camera(const cln_scene *scene, bool *lens)
{
    bool one = true;

    *lens = true;
    for (int i = 1; i < scene->view_count; i++) {
        one = one && same_camera(&scene->views[0], &scene->views[i]);
        *lens = *lens && scene->views[i].camera.lens == scene->views[0].camera.lens;
    }
    return one;
}

/* Adds the path of a file, if there is one. */
static cln_status put_path(const cln_scene *scene, json_t *frame, const char *key, const char *path)
{
    cln_status st = CLN_OK;
    char *name = NULL;

    if (!path)
        return CLN_OK;
    CLN_TRY(cln_scene_path_from(scene, path, &name));
    if (json_object_set_new(frame, key, json_string(name)) != 0)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot be put into JSON", path));
done:
    free(name);
    return st;
}

/* nerfstudio refuses a file that has some of the three lists: a split without views gets those of
 * another one, which our reader is told (listed_again). */
static bool fill_lists(json_t *document, const char *const keys[CLN_SPLITS],
                       json_t *const lists[CLN_SPLITS])
{
    static const cln_split instead[CLN_SPLITS][2] = {
        [CLN_SPLIT_TRAIN] = {CLN_SPLIT_TRAIN, CLN_SPLIT_TRAIN},
        [CLN_SPLIT_VAL] = {CLN_SPLIT_TEST, CLN_SPLIT_TRAIN},
        [CLN_SPLIT_TEST] = {CLN_SPLIT_VAL, CLN_SPLIT_TRAIN}};
    json_t *again = json_array();
    int lost = again == NULL;

    for (int split = 0; split < CLN_SPLITS; split++) {
        int from = split;

        for (int i = 0; i < 2 && json_array_size(lists[from]) == 0; i++)
            from = instead[split][i];
        if (from != split)
            lost |= json_array_append_new(again, json_string(keys[split]));
        lost |= json_object_set(document, keys[split], lists[from]);
    }
    if (json_array_size(again) > 0)
        lost |= json_object_set(document, "listed_again", again);
    json_decref(again);
    return lost == 0;
}

/* Has the view a depth image that transforms JSON can name? It knows no confidence. */
static bool has_plain_depth(const cln_view *view)
{
    return view->depth.depth && !view->depth.confidence && isinf(view->depth.most);
}

static cln_status put_depth_unit(const cln_export_job *job, const cln_scene *scene,
                                 json_t *document)
{
    for (int i = 0; i < scene->view_count; i++)
        if (has_plain_depth(&scene->views[i]))
            return json_object_set_new(document, "depth_unit_scale_factor",
                                       json_real(scene->views[i].depth.unit * job->scale)) == 0
                       ? CLN_OK
                       : cln_fail(CLN_MEMORY, "%s: cannot make JSON", job->desc->file);
    return CLN_OK;
}

/* What ns-process-data did to the poses of the scene's file, by which nerfstudio's paths are
 * brought to them, holds for the same poses in this one; not for scaled ones
 * (render/pose_frame.c). */
static cln_status put_applied(const cln_export_job *job, const cln_scene *scene, json_t *document)
{
    static const double none[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};
    cln_status st = CLN_OK;
    char *path = NULL;
    double applied[12], scale = 1;
    bool gone = false;
    json_t *rows = NULL;
    int lost = 0;

    CLN_TRY(cln_frames_transforms(job->desc->run, job->desc->scene, scene->dialect, &path, &gone));
    if (!path)
        goto done;
    st = cln_frames_applied(path, applied, &scale);
    if (st == CLN_INPUT) { /* then it brings no path either */
        cln_clear_error();
        st = CLN_OK;
        goto done;
    }
    CLN_TRY(st);
    if (memcmp(applied, none, sizeof none) == 0 && scale == 1)
        goto done;
    if (job->scale != 1) {
        cln_info("cameras: nerfstudio's camera paths of the scene do not fit what is scaled");
        goto done;
    }
    rows = json_array();
    for (int r = 0; r < 3; r++)
        lost |=
            json_array_append_new(rows, json_pack("[f,f,f,f]", applied[4 * r], applied[4 * r + 1],
                                                  applied[4 * r + 2], applied[4 * r + 3]));
    lost |= json_object_set_new(document, "applied_transform", rows);
    if (scale != 1)
        lost |= json_object_set_new(document, "applied_scale", json_real(scale));
    if (lost)
        st = cln_fail(CLN_MEMORY, "%s: cannot make JSON", job->desc->file);
done:
    free(path);
    return st;
}

static cln_status write_transforms(const cln_export_job *job, const cln_scene *scene)
{
    static const char *const keys[CLN_SPLITS] = {"train_filenames", "val_filenames",
                                                 "test_filenames"};
    cln_status st = CLN_OK;
    json_t *frames = json_array(), *lists[CLN_SPLITS] = {NULL};
    json_t *document = json_object();
    char *text = NULL, *name = NULL;
    bool one_lens = false;
    const bool one_camera = have_one_camera(scene, &one_lens);
    int lost = 0;

    for (int split = 0; split < CLN_SPLITS; split++)
        lists[split] = json_array();
    if (one_lens && scene->view_count > 0) /* nerfstudio looks for it nowhere else */
        lost |=
            json_object_set_new(document, "camera_model", json_string(lens_name(&scene->views[0])));
    if (one_camera && scene->view_count > 0)
        lost |= !put_intrinsics(document, &scene->views[0]);
    lost |= json_object_set_new(document, "frames", frames);
    CLN_TRY(put_applied(job, scene, document));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        json_t *frame = NULL;

        free(name);
        name = NULL;
        CLN_TRY(cln_scene_path_from(scene, view->path, &name));
        if (!cln_utf8_valid(name))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: its name is no UTF-8, which JSON needs: rename it, or export to "
                             "COLMAP's files",
                             view->path));
        lost |= json_array_append_new(lists[view->split], json_string(name));
        if (is_again(scene, i))
            continue;
        frame = cln_transforms_new_frame(name, &view->camera, job->scale);
        if (!one_lens)
            lost |= json_object_set_new(frame, "camera_model", json_string(lens_name(view)));
        if (!one_camera)
            lost |= !put_intrinsics(frame, view);
        lost |= json_array_append_new(frames, frame);
        if (lost)
            break;
        CLN_TRY(put_path(scene, frame, view->alpha_mask ? "mask_path" : "alpha_path",
                         view->alpha_path));
        if (has_plain_depth(view))
            CLN_TRY(put_path(scene, frame, "depth_file_path", view->depth.depth));
        if (!view->mask_black) /* where black counts, no key says so */
            CLN_TRY(put_path(scene, frame, "mask_path", view->mask_path));
    }
    CLN_TRY(put_depth_unit(job, scene, document));
    lost |= !fill_lists(document, keys, lists);
    text = lost ? NULL : json_dumps(document, JSON_INDENT(1));
    if (!text)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot make JSON", job->desc->file));
    CLN_TRY(cln_write_file(job->desc->file, text, strlen(text)));
done:
    for (int split = 0; split < CLN_SPLITS; split++)
        json_decref(lists[split]);
    json_decref(document);
    free(text);
    free(name);
    return st;
}

/* ---- COLMAP ---- */

enum { CAMERAS, IMAGES, POINTS, FILES };
static const char *const names[FILES] = {"cameras.txt", "images.txt", "points3D.txt"};

/* What a view's file is called from the folder of images; the view's name may lack the ending, and
 * be a path of another machine. */
static cln_status name_of(const cln_scene *scene, const cln_view *view, char **name)
{
    const char *last = cln_last_name(view->name), *file = cln_last_name(view->path);
    size_t bytes = 0;

    if (view->leads_out)
        return cln_scene_path_from(scene, view->path, name);
    bytes = strlen(last);
    return cln_asprintf(name, "%s%s", view->name,
                        strncmp(last, file, bytes) == 0 ? file + bytes : "");
}

/* Finds the COLMAP model with the fewest parameters that describes a camera, and their values;
 * CLN_INPUT if COLMAP has none. */
static cln_status list_of(const cln_view *view, const cln_camera *c, const cln_colmap_model **model,
                          double values[CLN_COLMAP_PARAMS])
{
    const cln_colmap_model *best = NULL;
    int used = CLN_LENS_PARAMS;

    while (used > 0 && c->distortion[used - 1] == 0)
        used--;
    for (int i = 0; i < CLN_COLMAP_MODELS; i++) {
        const cln_colmap_model *m = &cln_colmap_models[i];

        if (m->lens != c->lens || (m->focals == 1 && c->fx != c->fy) ||
            (m->focals > 0 && m->count - m->focals - 2 < used) || (best && best->count <= m->count))
            continue;
        best = m;
    }
    if (c->lens == CLN_LENS_EQUIRECTANGULAR && !cln_camera_spans_sphere(c))
        return cln_fail(CLN_INPUT,
                        "%s: a panorama that was cut, and COLMAP has whole ones alone; write "
                        "transforms JSON (--cameras FILE.json)",
                        view->name);
    if (!best)
        return cln_fail(CLN_INPUT,
                        "%s: none of COLMAP's camera models has its lens %s; write transforms JSON "
                        "(--cameras FILE.json)",
                        view->name, cln_lens_models[c->lens].name);
    *model = best;
    if (best->focals == 0) {
        values[0] = c->width;
        values[1] = c->height;
        return CLN_OK;
    }
    values[0] = c->fx;
    values[best->focals - 1] = best->focals == 1 ? c->fx : c->fy;
    values[best->focals] = c->cx;
    values[best->focals + 1] = c->cy;
    memcpy(values + best->focals + 2, c->distortion,
           (size_t)(best->count - best->focals - 2) * sizeof *values);
    return CLN_OK;
}

static void put_number(FILE *to, double value)
{
    char text[32];

    cln_format(text, sizeof text, " %.17g", value);
    fputs(text, to);
}

static cln_status put_camera(FILE *to, int id, const cln_view *view)
{
    cln_status st = CLN_OK;
    const cln_camera c = camera_of(view);
    const cln_colmap_model *model = NULL;
    double values[CLN_COLMAP_PARAMS] = {0};

    CLN_TRY(list_of(view, &c, &model, values));
    fprintf(to, "%d %s %d %d", id, model->name, c.width, c.height);
    for (int i = 0; i < model->count; i++)
        put_number(to, values[i]);
    fprintf(to, "\n");
done:
    return st;
}

/* The pose from the world to the camera: unit quaternion w, x, y, z and translation. */
static void pose_of(const double c2w[12], double q[4], double t[3])
{
    cln_pose_quaternion(c2w, q);
    for (int i = 0; i < 3; i++) {
        q[i + 1] = -q[i + 1];
        t[i] = 0;
        for (int j = 0; j < 3; j++)
            t[i] -= c2w[4 * j + i] * c2w[4 * j + 3];
    }
}

/* The number of a view's camera, from 1 on, and whether it is new. `first`: the first views of the
 * first cameras, by which those of a rig, which take turns, are found again; of a set with more the
 * newest one, too. */
typedef struct camera_list {
    int count, newest;
    const cln_view *first[256], *last;
} camera_list;

static int number_of(camera_list *list, const cln_view *view, bool *new)
{
    const int known = list->count < 256 ? list->count : 256;

    *new = false;
    for (int i = 0; i < known; i++)
        if (same_camera(view, list->first[i]))
            return i + 1;
    if (!list->last || !same_camera(view, list->last)) {
        *new = true;
        list->newest = ++list->count;
        if (list->count <= 256)
            list->first[list->count - 1] = view;
    }
    list->last = view;
    return list->newest;
}

/* Writes all three files. */
static cln_status put_views(const cln_scene *scene, double scale, FILE *const to[FILES])
{
    cln_status st = CLN_OK;
    camera_list cameras = {0};
    char *name = NULL;

    fprintf(to[CAMERAS], "# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]\n");
    fprintf(to[IMAGES], "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n"
                        "# POINTS2D[] as (X, Y, POINT3D_ID): none\n");
    fprintf(to[POINTS], "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]: none\n");
    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];
        double q[4], t[3];
        bool new = false;
        int camera = 0;

        if (is_again(scene, i))
            continue;
        free(name);
        name = NULL;
        CLN_TRY(name_of(scene, view, &name));
        camera = number_of(&cameras, view, &new);
        if (new)
            CLN_TRY(put_camera(to[CAMERAS], camera, view));
        pose_of(view->camera.c2w, q, t);
        fprintf(to[IMAGES], "%d", i + 1);
        for (int k = 0; k < 4; k++)
            put_number(to[IMAGES], q[k]);
        for (int k = 0; k < 3; k++)
            put_number(to[IMAGES], t[k] * scale);
        fprintf(to[IMAGES], " %d %s\n\n", camera, name);
    }
done:
    free(name);
    return st;
}

static cln_status write_colmap(const cln_export_job *job, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    cln_atomic_file *files[FILES] = {NULL};
    FILE *streams[FILES] = {NULL};
    char *paths[FILES] = {NULL};

    for (int i = 0; i < FILES; i++) {
        CLN_TRY(cln_path_join(&paths[i], job->desc->file, names[i]));
        if (cln_is_file(paths[i]) && !job->desc->overwrite)
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s: already exists; choose another folder, or give --overwrite",
                             paths[i]));
    }
    for (int i = 0, told = 0; i < scene->view_count && !told; i++) {
        told = scene->views[i].turned;
        if (told)
            cln_warn("%s: the pose is of '%s' as its EXIF data turn it, which COLMAP does not; "
                     "turn such photos first: mogrify -auto-orient",
                     job->desc->file, scene->views[i].name);
    }
    CLN_TRY(cln_make_dirs(job->desc->file));
    for (int i = 0; i < FILES; i++) {
        CLN_TRY(cln_atomic_open(paths[i], &files[i]));
        streams[i] = cln_atomic_stream(files[i]);
    }
    CLN_TRY(put_views(scene, job->scale, streams));
    CLN_TRY(cln_atomic_commit_all(
        (cln_atomic_file **const[]){&files[CAMERAS], &files[POINTS], &files[IMAGES]}, FILES));
done:
    for (int i = 0; i < FILES; i++) {
        cln_atomic_abandon(files[i]);
        free(paths[i]);
    }
    return st;
}

/* ---- either ---- */

/* Says where the cameras are a scene, if they are not where they are written. */
static cln_status say_where(const char *file, bool json, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    char *path = NULL, *folder = NULL, *end = NULL;
    size_t bytes = 0;

    CLN_TRY(cln_path_absolute(&path, file));
    CLN_TRY(cln_is_dir(scene->folder) ? cln_path_absolute(&folder, scene->folder)
                                      : cln_strdup(&folder, scene->folder));
    end = strrchr(path, '/');
    if (json && end)
        *end = 0;
    bytes = strlen(folder);
    if (strncmp(path, folder, bytes) != 0 || (json ? path[bytes] != 0 : path[bytes] != '/'))
        cln_info("cameras: photos are named as %s has them; to train with these, put the %s there",
                 scene->folder, json ? "file" : "folder");
done:
    free(path);
    free(folder);
    return st;
}

/* Says what of the scene a training on these cameras would lack. */
static void say_left_out(bool json, double scale, const cln_scene *scene)
{
    const cln_space *space = &scene->space;
    /* a shell may be around another cube than the box's */
    const bool boxed = scene->has_box && !space->shell;
    char box[6][CLN_NUMBER_BYTES]; /* far from the origin, as many digits as it takes */
    bool masks = false, held_out = false, edges = false, depths = false, inverted = false;
    int black = 0;
    /* what takes most of a scene's quality away, where only a split was wanted */
    const char *points = scene->has_sights
                             ? ". Without these points --depth-loss has nothing to work on: only "
                               "to choose test photos, train on the scene itself with --test-views"
                             : "";

    for (int i = 0; i < scene->view_count; i++)
        depths = depths ||
                 (scene->views[i].depth.depth && (!json || !has_plain_depth(&scene->views[i])));
    if (depths)
        cln_info("cameras: depth images are left out%s",
                 json ? ", as the file has no place for their confidence" : "; FILE.json has them");
    for (int i = 0; i < scene->view_count; i++)
        edges = edges || scene->views[i].edge > 0 || (scene->views[i].disc > 0 && !json);
    if (edges)
        cln_warn("cameras: photos are black along their edges, which other readers than that of "
                 "this scene do not know; give them masks");
    for (int i = 0; i < scene->view_count && !json; i++) {
        masks = masks || scene->views[i].alpha_path || scene->views[i].mask_path;
        held_out = held_out || scene->views[i].split != CLN_SPLIT_TRAIN;
    }
    if (held_out)
        cln_info("cameras: COLMAP's files do not say which views are held out; FILE.json does");
    if (masks)
        cln_warn("cameras: COLMAP's files have no masks of photos; FILE.json has them");
    for (int i = 0; i < scene->view_count && json; i++) {
        black += scene->views[i].mask_path && scene->views[i].mask_black;
        inverted = inverted || (scene->views[i].alpha_mask && scene->views[i].alpha_black);
    }
    if (black)
        cln_warn("cameras: the mask%s of %d photo%s, of which black counts, %s left out, as the "
                 "file cannot say so: a training on it needs masks whose black does not count",
                 cln_plural(black, "", "s"), black, cln_plural(black, "", "s"),
                 cln_plural(black, "is", "are"));
    if (inverted)
        cln_warn("cameras: black is the object in these masks, which the file cannot say: train "
                 "on it with --masks inverted, and exchange black and white for other programs");
    if (space->forward) {
        cln_info("cameras: what the scene tells of depths (near and far, sparse points) is left "
                 "out%s",
                 points);
        return;
    }
    for (int i = 0; i < 3; i++) {
        cln_number_write(scale * (boxed ? scene->box[i] : space->centre[i] - space->half), box[i]);
        cln_number_write(scale * (boxed ? scene->box[i + 3] : space->centre[i] + space->half),
                         box[i + 3]);
    }
    cln_info("cameras: the scene's cube and sparse points are left out; to train with these in "
             "that cube: --bbox=%s,%s,%s,%s,%s,%s%s%s",
             box[0], box[1], box[2], box[3], box[4], box[5], space->shell ? " --space shell" : "",
             points);
}

cln_status cln_export_cameras(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_scene *scene = job->opened.scene;
    const double bytes = (double)FRAME_BYTES * scene->view_count;
    const bool json = cln_export_ends(job->desc->file, ".json");

    CLN_TRY(cln_disk_check_file(job->desc->file, bytes, "the cameras"));
    CLN_TRY(json ? write_transforms(job, scene) : write_colmap(job, scene));
    CLN_TRY(say_where(job->desc->file, json, scene));
    say_left_out(json, job->scale, scene);
    for (int i = 0; i < scene->view_count; i++)
        job->result->views += !is_again(scene, i);
    job->result->refined = job->opened.refined;
done:
    return st;
}
