/* cln_render: pictures of a run from the poses of a split or from an orbit, as files. Which
 * cameras, which files, what is there already; a view itself is render/view.c's. Per frame, in this
 * order, each atomically:
 *
 *   NAME.depth.npy  NAME.depth.png  NAME.opacity.png  NAME.png
 *
 * A frame is there when all four are. NAME.png goes first and comes back last, so a frame that was
 * cut short is rendered again. OUT/render.json tells what the frames are of; a folder that holds
 * files but no render.json is not written to. */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "render/quality.h"
#include "render/orbit.h"
#include "render/open_run.h"
#include "io/image.h"
#include "io/npy.h"
#include "io/run_folder.h"

#define SCHEMA "cl-nascent.frames/1"

static const char *const suffixes[] = {".depth.npy", ".depth.png", ".opacity.png", ".png"};
enum { DEPTH_NPY, DEPTH_PNG, OPACITY_PNG, COLOUR_PNG, FILES };

typedef struct frame {
    char *name;
    cln_camera camera;
    bool there;
} frame;

typedef struct job {
    const cln_render_desc *desc;
    cln_open_run opened;
    frame *frames;
    int count, there;
    json_t *run;    /* run.json */
    json_t *before; /* the folder's render.json; NULL if there is none */
} job;

static cln_status path_of(const job *j, const frame *f, int file, char **path)
{
    return cln_asprintf(path, "%s/%s%s", j->desc->out, f->name, suffixes[file]);
}

/* ---- which frames ---- */

static cln_status frames_of_split(job *j)
{
    cln_status st = CLN_OK;
    const cln_scene *scene = j->opened.scene;
    cln_split split = CLN_SPLIT_TEST;
    int *views = NULL;

    CLN_TRY(cln_open_run_split(scene, j->desc->split, &split));
    CLN_TRY(cln_quality_choose(scene, split, j->desc->max_images, &views, &j->count));
    CLN_TRY(cln_alloc(&j->frames, (size_t)j->count, sizeof *j->frames, "frames"));
    for (int i = 0; i < j->count; i++) {
        CLN_TRY(cln_orbit_resize(&scene->views[views[i]].camera, j->desc->width, j->desc->height,
                                 &j->frames[i].camera));
        CLN_TRY(cln_strdup(&j->frames[i].name, scene->views[views[i]].file));
    }
done:
    free(views);
    return st;
}

static cln_status frames_of_orbit(job *j)
{
    cln_status st = CLN_OK;
    const int count = j->desc->orbit_frames;
    cln_orbit_frame seen;
    cln_orbit orbit;

    if (count < 1)
        CLN_TRY(cln_fail(CLN_USAGE, "--orbit: %d frames are too few; give 1 or more", count));
    if (j->opened.scene)
        CLN_TRY(cln_orbit_frame_of(j->opened.scene, &seen));
    else
        CLN_TRY(cln_orbit_frame_read(json_object_get(j->run, "orbit"), &seen));
    CLN_TRY(cln_orbit_make(&seen, j->desc, &orbit));
    CLN_TRY(cln_alloc(&j->frames, (size_t)count, sizeof *j->frames, "frames"));
    j->count = count;
    for (int i = 0; i < count; i++) {
        cln_orbit_camera(&orbit, i, count, &j->frames[i].camera);
        CLN_TRY(cln_asprintf(&j->frames[i].name, "orbit_%04d", i));
    }
done:
    return st;
}

static cln_status find_there(job *j)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    for (int i = 0; i < j->count && !j->desc->overwrite; i++) {
        frame *f = &j->frames[i];

        f->there = true;
        for (int file = 0; file < FILES && f->there; file++) {
            CLN_TRY(path_of(j, f, file, &path));
            f->there = cln_is_file(path);
            free(path);
            path = NULL;
        }
        j->there += f->there;
    }
done:
    return st;
}

/* ---- the folder ---- */

/* What the frames are of; nothing that differs between two renderings of the same. */
static json_t *describe(const job *j)
{
    const cln_render_desc *d = j->desc;
    char digest[24];
    json_t *about = NULL;

    snprintf(digest, sizeof digest, "%016llx",
             (unsigned long long)cln_model_digest(&j->opened.model));
    about = json_pack("{s:s, s:s, s:s, s:I, s:s, s:s}", "schema", SCHEMA, "tool",
                      "cl-nascent " CLN_VERSION, "model_digest", digest, "step",
                      (json_int_t)j->opened.model.step, "depth", d->z_depth ? "axis" : "ray",
                      "poses", d->split ? d->split : "orbit");
    if (about && d->split && (d->width > 0 || d->height > 0))
        json_object_set_new(about, "size", json_pack("[i,i]", d->width, d->height));
    if (about && !d->split)
        json_object_set_new(about, "orbit",
                            json_pack("{s:i, s:f, s:f, s:i, s:i, s:f}", "frames", j->count,
                                      "elevation", d->orbit_elevation, "radius", d->orbit_radius,
                                      "width", j->frames[0].camera.width, "height",
                                      j->frames[0].camera.height, "fx", j->frames[0].camera.fx));
    return about;
}

/* CLN_OUTPUT if the folder holds files of others; *before: its render.json, NULL if there is
 * none. */
static cln_status check_folder(const char *out, json_t **before)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    const char *schema = NULL;
    DIR *dir = NULL;
    bool empty = true;

    CLN_TRY(cln_path_join(&path, out, "render.json"));
    if (cln_is_file(path)) {
        CLN_TRY(cln_json_read(path, false, before));
        schema = json_string_value(json_object_get(*before, "schema"));
        if (!schema || strcmp(schema, SCHEMA) != 0)
            st = cln_fail(CLN_OUTPUT, "%s: its schema is %s, not %s; choose another folder with -o",
                          path, schema ? schema : "not named", SCHEMA);
        goto done;
    }
    dir = opendir(out);
    if (!dir && errno == ENOENT)
        goto done;
    if (!dir)
        CLN_TRY(
            cln_fail(CLN_OUTPUT, "%s: %s; choose another folder with -o", out, strerror(errno)));
    for (struct dirent *e = readdir(dir); e; e = readdir(dir))
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0 &&
            strncmp(e->d_name, "render.json.tmp.", 16) != 0)
            empty = false;
    if (!empty)
        st = cln_fail(CLN_OUTPUT,
                      "%s: holds other files (there is no render.json), so nothing is written to "
                      "it; choose a "
                      "new folder with -o",
                      out);
done:
    if (dir)
        closedir(dir);
    free(path);
    return st;
}

/* render.json tells of all frames or stays as it was. */
static cln_status write_about(const job *j)
{
    cln_status st = CLN_OK;
    json_t *about = describe(j);

    if (!about)
        CLN_TRY(cln_fail(CLN_MEMORY, "render.json: cannot make JSON"));
    if (json_equal(j->before, about))
        goto done;
    if (j->there > 0)
        cln_warn(
            "%s: %d of the frames exist already, from another model or with other settings, and "
            "stay as they are; --overwrite renders them again",
            j->desc->out, j->there);
    else
        CLN_TRY(cln_run_write_json(j->desc->out, "render.json", about));
done:
    json_decref(about);
    return st;
}

/* ---- files ---- */

static int ascending(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;

    return x < y ? -1 : x > y;
}

/* Grey by inverse depth, near is bright; ends of the scale: 2nd and 98th percentile of what is
 * mostly opaque. What is transparent fades to black. */
static cln_status draw_depth(const cln_picture *p, uint8_t *grey)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height;
    size_t count = 0;
    float *inverse = NULL, low = 0, high = 0;

    CLN_TRY(cln_alloc(&inverse, n, sizeof *inverse, "picture"));
    for (size_t i = 0; i < n; i++)
        if (p->opacity[i] >= 0.5f && p->depth[i] > 0)
            inverse[count++] = 1 / p->depth[i];
    if (count > 0) {
        qsort(inverse, count, sizeof *inverse, ascending);
        low = inverse[count / 50];
        high = inverse[count - 1 - count / 50];
    }
    for (size_t i = 0; i < n; i++) {
        const float near = p->depth[i] > 0 ? 1 / p->depth[i] : 0;
        const float share = high > low ? fminf(fmaxf((near - low) / (high - low), 0), 1) : 1;

        grey[i] = cln_to_u8(p->opacity[i] * (0.15f + 0.85f * share));
    }
done:
    free(inverse);
    return st;
}

static cln_status write_frame(const job *j, const frame *f, const cln_picture *p)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height;
    const int shape[2] = {p->height, p->width};
    char *path[FILES] = {NULL};
    uint8_t *bytes = NULL;

    for (int file = 0; file < FILES; file++)
        CLN_TRY(path_of(j, f, file, &path[file]));
    CLN_TRY(cln_alloc(&bytes, n, 3, "picture"));
    if (remove(path[COLOUR_PNG]) != 0 && errno != ENOENT)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", path[COLOUR_PNG], strerror(errno)));
    for (size_t i = 0; i < n; i++)
        p->depth[i] =
            p->opacity[i] > 0 ? cln_space_depth_to_scene(&j->opened.model.space, p->depth[i]) : 0;
    CLN_TRY(cln_npy_write_f32(path[DEPTH_NPY], 2, shape, p->depth));
    CLN_TRY(draw_depth(p, bytes));
    CLN_TRY(cln_image_write_png(path[DEPTH_PNG], p->width, p->height, 1, bytes));
    for (size_t i = 0; i < n; i++)
        bytes[i] = cln_to_u8(p->opacity[i]);
    CLN_TRY(cln_image_write_png(path[OPACITY_PNG], p->width, p->height, 1, bytes));
    for (size_t i = 0; i < 3 * n; i++)
        bytes[i] = cln_to_u8(p->rgb[i]);
    CLN_TRY(cln_image_write_png(path[COLOUR_PNG], p->width, p->height, 3, bytes));
done:
    for (int file = 0; file < FILES; file++)
        free(path[file]);
    free(bytes);
    return st;
}

/* ---- the work ---- */

static cln_status start(job *j)
{
    cln_status st = CLN_OK;
    cln_open_run *v = &j->opened;
    const cln_camera **cameras = NULL;
    unsigned lenses = 0;

    CLN_TRY(cln_alloc(&cameras, (size_t)j->count, sizeof *cameras, "cameras"));
    for (int i = 0; i < j->count; i++) {
        cameras[i] = &j->frames[i].camera;
        lenses |= cln_camera_lenses(cameras[i]);
    }
    CLN_TRY(cln_open_run_start(v, &j->desc->device, lenses));
    CLN_TRY(cln_pipeline_cameras(&v->pipeline, cameras, j->count, &v->model.space));
    CLN_TRY(write_about(j));
    CLN_TRY(cln_render_prepare(&v->pipeline));
done:
    free(cameras);
    return st;
}

static cln_status render_frames(job *j, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const cln_callbacks *callbacks = &j->desc->callbacks;
    cln_picture picture = {0};

    for (int i = 0; i < j->count; i++) {
        const double began = cln_now();

        if (j->frames[i].there)
            continue;
        if (callbacks->work)
            callbacks->work("render", result->skipped + result->rendered, j->count,
                            callbacks->user);
        st = cln_render_view(&j->opened.pipeline, i, j->opened.model.background, j->desc->z_depth,
                             callbacks, &picture);
        if (st == CLN_SIGINT || st == CLN_SIGTERM)
            cln_note(
                "rendering into %s: %d of %d frames are there, the same command renders the others",
                j->desc->out, result->skipped + result->rendered, j->count);
        CLN_TRY(st);
        CLN_TRY(write_frame(j, &j->frames[i], &picture));
        cln_picture_free(&picture);
        result->rendered++;
        result->seconds += cln_now() - began;
    }
    if (callbacks->work)
        callbacks->work("render", j->count, j->count, callbacks->user);
done:
    cln_picture_free(&picture);
    return st;
}

cln_status cln_render(const cln_render_desc *desc, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const bool pixels[CLN_SPLITS] = {false};
    job j = {.desc = desc};

    memset(result, 0, sizeof *result);
    CLN_TRY(cln_run_read(desc->run, &j.run));
    if (desc->split || desc->scene || !json_object_get(j.run, "orbit"))
        CLN_TRY(cln_open_run_open(desc->run, desc->scene, pixels, &j.opened));
    else
        CLN_TRY(cln_open_run_model(desc->run, &j.opened));
    if (desc->split)
        CLN_TRY(frames_of_split(&j));
    else
        CLN_TRY(frames_of_orbit(&j));
    CLN_TRY(check_folder(desc->out, &j.before));
    CLN_TRY(find_there(&j));
    result->skipped = j.there;
    if (j.there < j.count) {
        CLN_TRY(start(&j));
        CLN_TRY(render_frames(&j, result));
    } else {
        CLN_TRY(write_about(&j)); /* for its warning */
    }
done:
    for (int i = 0; j.frames && i < j.count; i++)
        free(j.frames[i].name);
    free(j.frames);
    json_decref(j.run);
    json_decref(j.before);
    cln_open_run_close(&j.opened);
    return st;
}
