/* cln_render: pictures of a run as files. Which files, what is there already; which cameras is
 * render/frames.c's, a view itself render/view.c's. Per frame, in this order, each atomically:
 *
 *   NAME.depth.npy  (NAME.depth.pfm  NAME.depth16.png  NAME.normal.npy  NAME.normal.png)
 *   NAME.opacity.png  NAME.png
 *
 * NAME.png goes first and comes back last, so a frame that was cut short is rendered again; the
 * depth pictures follow when all frames are there, on one scale. OUT/render.json tells of every
 * frame what it was made from: a frame of the same model, camera and settings is kept, another one
 * is rendered again. A folder that holds files but no render.json is not written to. */
#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "render/crop.h"
#include "render/depth_picture.h"
#include "render/frames.h"
#include "render/normals.h"
#include "render/open_run.h"
#include "render/view.h"
#include "ranks/ranks.h"
#include "io/depth_file.h"
#include "io/disk.h"
#include "io/film.h"
#include "io/image.h"
#include "io/npy.h"
#include "io/run_folder.h"

#define SCHEMA "cl-nascent.frames/1"

static const char *const suffixes[] = {".depth.npy",  ".depth.pfm",   ".depth16.png", ".normal.npy",
                                       ".normal.png", ".opacity.png", ".png",         ".depth.png"};
enum {
    DEPTH_NPY,
    DEPTH_PFM,
    DEPTH_PNG16,
    NORMAL_NPY,
    NORMAL_PNG,
    OPACITY_PNG,
    COLOUR_PNG,
    FILES,
    DEPTH_PNG = FILES
};

typedef struct frame {
    const char *name;
    cln_camera camera;
    char made_from[17]; /* digest of all that its pictures depend on */
    bool there;
} frame;

typedef struct job {
    const cln_render_desc *desc;
    bool writes; /* rank 0 (ranks/ranks.h) */
    cln_open_run opened;
    cln_frames cameras;
    cln_crop crop;
    frame *frames;
    cln_camera *eyes;           /* [count][1 or 2] what is rendered */
    int count, there, pictured; /* frames; of these rendered, and with a depth picture */
    json_t *run;                /* run.json */
    json_t *before;             /* the folder's render.json; NULL if there is none */
} job;

static cln_status path_of(const job *j, const frame *f, int file, char **path)
{
    return cln_asprintf(path, "%s/%s%s", j->desc->out, f->name, suffixes[file]);
}

/* ---- which frames ---- */

static int eyes_of(const job *j)
{
    return j->desc->stereo > 0 ? 2 : 1;
}

/* Of a frame's pictures. */
static int width_of(const job *j, const frame *f)
{
    return eyes_of(j) * f->camera.width;
}

/* Left and right of the frame's camera, looking the same way. */
static cln_status place_eyes(job *j)
{
    cln_status st = CLN_OK;
    const int each = eyes_of(j);

    CLN_TRY(cln_alloc(&j->eyes, (size_t)(j->count * each), sizeof *j->eyes, "cameras"));
    for (int i = 0; i < j->count * each; i++) {
        const frame *f = &j->frames[i / each];
        cln_camera *eye = &j->eyes[i];

        if (each > 1 && f->camera.lens == CLN_LENS_EQUIRECTANGULAR)
            CLN_TRY(cln_fail(CLN_USAGE,
                             "--stereo: frame %s is a panorama, whose directions have no common "
                             "left and right; leave --stereo out",
                             f->name));
        *eye = f->camera;
        for (int a = 0; a < 3 && each > 1; a++)
            eye->c2w[4 * a + 3] += (i % each - 0.5) * j->desc->stereo * eye->c2w[4 * a];
    }
done:
    return st;
}

static cln_status list_frames(job *j)
{
    cln_status st = CLN_OK;

    j->count = j->cameras.count;
    CLN_TRY(cln_alloc(&j->frames, (size_t)j->count, sizeof *j->frames, "frames"));
    for (int i = 0; i < j->count; i++) {
        j->frames[i].name = j->cameras.frame[i].name;
        j->frames[i].camera = j->cameras.frame[i].camera;
    }
done:
    return st;
}

static void find_identity(const job *j, frame *f)
{
    const cln_model *model = &j->opened.model;
    const cln_camera *c = &f->camera;
    const uint64_t digest = cln_model_digest(model);
    const double lengths[4] = {c->fx, c->fy, c->cx, c->cy};
    /* files from before the median was there have the mean, as 0 or 1 */
    const int32_t kind = j->desc->z_depth | (j->desc->mean_depth ? 0 : 4);
    const int32_t numbers[4] = {c->width, c->height, (int32_t)c->lens, kind};
    uint64_t d = CLN_DIGEST_START;

    d = cln_digest(d, &digest, sizeof digest);
    d = cln_digest(d, model->background, sizeof model->background);
    d = cln_digest(d, numbers, sizeof numbers);
    d = cln_digest(d, c->c2w, sizeof c->c2w);
    d = cln_digest(d, lengths, sizeof lengths);
    d = cln_digest(d, c->distortion, sizeof c->distortion);
    if (j->desc->antialias > 1)
        d = cln_digest(d, &j->desc->antialias, sizeof j->desc->antialias);
    if (j->desc->fast)
        d = cln_digest(d, "fast", 4);
    if (j->desc->depth_unit > 0)
        d = cln_digest(d, &j->desc->depth_unit, sizeof j->desc->depth_unit);
    if (j->crop.on)
        d = cln_digest(d, j->crop.box, sizeof j->crop.box);
    if (j->crop.on && !j->desc->cropped)
        d = cln_digest(d, j->crop.turn, sizeof j->crop.turn);
    if (j->desc->stereo > 0) {
        d = cln_digest(d, "stereo", 6);
        d = cln_digest(d, &j->desc->stereo, sizeof j->desc->stereo);
    }
    snprintf(f->made_from, sizeof f->made_from, "%016llx", (unsigned long long)d);
}

static cln_status has_file(const job *j, const frame *f, int file, bool *there)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(path_of(j, f, file, &path));
    *there = cln_is_file(path);
done:
    free(path);
    return st;
}

static bool is_wanted(const job *j, int file)
{
    switch (file) {
    case DEPTH_PFM:
        return j->desc->pfm;
    case DEPTH_PNG16:
        return j->desc->depth_unit > 0;
    case NORMAL_NPY:
    case NORMAL_PNG:
        return j->desc->normals;
    default:
        return true;
    }
}

/* What all ranks must have in common: they would wait for each other forever. */
static cln_status check_ranks(const job *j)
{
    uint64_t d = CLN_DIGEST_START;

    for (int i = 0; i < j->count; i++)
        d = cln_digest(d, j->frames[i].made_from, sizeof j->frames[i].made_from);
    return cln_ranks_agree(d, "checkpoint or choice of frames");
}

/* Which frames are left as they are: rank 0 looks. */
static cln_status tell_there(job *j)
{
    cln_status st = CLN_OK;
    bool *there = NULL;

    CLN_TRY(cln_alloc(&there, (size_t)j->count, sizeof *there, "frames"));
    for (int i = 0; i < j->count; i++)
        there[i] = j->frames[i].there;
    cln_ranks_tell(there, (size_t)j->count * sizeof *there);
    j->there = 0;
    for (int i = 0; i < j->count; i++) {
        j->frames[i].there = there[i];
        j->there += there[i];
    }
done:
    free(there);
    return st;
}

static cln_status find_there(job *j)
{
    cln_status st = CLN_OK;
    const json_t *known = json_object_get(j->before, "frames");

    for (int i = 0; i < j->count; i++) {
        frame *f = &j->frames[i];
        const char *made_from = json_string_value(json_object_get(known, f->name));
        bool pictured = false;

        f->there = !j->desc->overwrite && made_from && strcmp(made_from, f->made_from) == 0;
        for (int file = 0; file < FILES && f->there; file++)
            if (is_wanted(j, file))
                CLN_TRY(has_file(j, f, file, &f->there));
        CLN_TRY(has_file(j, f, DEPTH_PNG, &pictured));
        j->there += f->there;
        j->pictured += pictured;
    }
done:
    return st;
}

/* ---- the folder ---- */

/* What the newest frames are of, and each of the folder's; nothing that differs between two
 * renderings of the same. */
static json_t *describe(const job *j)
{
    const cln_render_desc *d = j->desc;
    char digest[24];
    json_t *about = NULL, *frames = json_object();

    json_object_update(frames, json_object_get(j->before, "frames"));
    for (int i = 0; i < j->count; i++)
        json_object_set_new(frames, j->frames[i].name, json_string(j->frames[i].made_from));
    snprintf(digest, sizeof digest, "%016llx",
             (unsigned long long)cln_model_digest(&j->opened.model));
    about = json_pack("{s:s, s:s, s:s, s:I, s:s, s:s, s:s, s:o}", "schema", SCHEMA, "tool",
                      "cl-nascent " CLN_VERSION, "model_digest", digest, "step",
                      (json_int_t)j->opened.model.step, "depth", d->z_depth ? "axis" : "ray",
                      "depth_of", d->mean_depth ? "mean" : "median", "poses", j->cameras.poses,
                      "frames", frames);
    if (about && d->depth_unit > 0)
        json_object_set_new(about, "depth_unit", json_real(d->depth_unit));
    if (about && d->antialias > 1)
        json_object_set_new(about, "antialias", json_integer(d->antialias));
    if (about && d->fast)
        json_object_set_new(about, "fast", json_true());
    if (about && d->stereo > 0)
        json_object_set_new(about, "stereo", json_real(d->stereo));
    if (about && j->crop.on)
        json_object_set_new(about, "crop",
                            json_pack("[f,f,f,f,f,f]", j->crop.box[0], j->crop.box[1],
                                      j->crop.box[2], j->crop.box[3], j->crop.box[4],
                                      j->crop.box[5]));
    if (about && cln_crop_is_turned(&j->crop)) {
        json_t *axes = json_array();

        for (int i = 0; i < 9; i++)
            json_array_append_new(axes, json_real(j->crop.turn[i]));
        json_object_set_new(about, "crop_axes", axes);
    }
    if (about && d->poses)
        json_object_set_new(about, "file", json_string(d->poses));
    if (about && (d->split || d->poses) && (d->width > 0 || d->height > 0))
        json_object_set_new(about, "size", json_pack("[i,i]", d->width, d->height));
    if (about && strcmp(j->cameras.poses, "orbit") == 0)
        json_object_set_new(about, "orbit",
                            json_pack("{s:i, s:o, s:f, s:b, s:i, s:i, s:f}", "frames", j->count,
                                      "elevation", cln_json_real(d->orbit_elevation), "radius",
                                      d->orbit_radius, "circle", d->orbit_circle, "width",
                                      j->frames[0].camera.width, "height",
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

/* Pictures of before that are made again go first: what is there is then what render.json says. */
static cln_status drop_stale(const job *j)
{
    static const int marks[] = {COLOUR_PNG, DEPTH_PNG};
    cln_status st = CLN_OK;
    char *path = NULL;
    int dropped = 0;

    for (int i = 0; i < j->count; i++) {
        if (j->frames[i].there)
            continue;
        for (size_t k = 0; k < sizeof marks / sizeof *marks; k++) {
            free(path);
            path = NULL;
            CLN_TRY(path_of(j, &j->frames[i], marks[k], &path));
            if (remove(path) == 0)
                dropped += marks[k] == COLOUR_PNG;
            else if (errno != ENOENT)
                CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", path, strerror(errno)));
        }
    }
    if (dropped > 0)
        cln_info("%s: %d of %d frames are of another model or other settings, or to be replaced: "
                 "they are rendered again",
                 j->desc->out, dropped, j->count);
done:
    free(path);
    return st;
}

/* scale: of the depth pictures, NULL before they are drawn. */
static cln_status write_about(const job *j, const cln_depth_scale *scale)
{
    cln_status st = CLN_OK;
    const double low = scale ? scale->low : 0, high = scale ? scale->high : 0;
    json_t *about = describe(j);

    if (!about)
        CLN_TRY(cln_fail(CLN_MEMORY, "render.json: cannot make JSON"));
    if (scale && low > 0)
        json_object_set_new(about, "depth_picture",
                            json_pack("{s:f, s:f}", "near", 1 / high, "far", 1 / low));
    CLN_TRY(cln_run_write_json(j->desc->out, "render.json", about));
done:
    json_decref(about);
    return st;
}

/* ---- files ---- */

static cln_status write_normals(const job *j, const frame *f, const float *normals)
{
    cln_status st = CLN_OK;
    const int width = width_of(j, f), height = f->camera.height;
    const int shape[3] = {height, width, 3};
    const size_t n = 3 * (size_t)width * (size_t)height;
    char *path = NULL;
    uint8_t *bytes = NULL;

    CLN_TRY(path_of(j, f, NORMAL_NPY, &path));
    CLN_TRY(cln_npy_write_f32(path, 3, shape, normals));
    free(path);
    CLN_TRY(path_of(j, f, NORMAL_PNG, &path));
    CLN_TRY(cln_alloc(&bytes, n, 1, "picture"));
    for (size_t i = 0; i < n; i++)
        bytes[i] = cln_to_u8(0.5f + 0.5f * normals[i]);
    CLN_TRY(cln_image_write_png(path, width, height, 3, bytes));
done:
    free(bytes);
    free(path);
    return st;
}

/* Depths of p: scene units. */
static cln_status write_frame(const job *j, const frame *f, const cln_picture *p,
                              const float *normals)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height;
    const int shape[2] = {p->height, p->width};
    char *path[FILES] = {NULL};
    uint8_t *bytes = NULL;
    int beyond = 0;

    for (int file = 0; file < FILES; file++)
        CLN_TRY(path_of(j, f, file, &path[file]));
    CLN_TRY(cln_alloc(&bytes, n, 3, "picture"));
    CLN_TRY(cln_npy_write_f32(path[DEPTH_NPY], 2, shape, p->depth));
    if (is_wanted(j, DEPTH_PFM))
        CLN_TRY(cln_depth_write_pfm(path[DEPTH_PFM], p->width, p->height, p->depth));
    if (is_wanted(j, DEPTH_PNG16))
        CLN_TRY(cln_depth_write_png16(path[DEPTH_PNG16], p->width, p->height, p->depth,
                                      j->desc->depth_unit, &beyond));
    if (beyond > 0)
        cln_warn("%s: %d pixels are farther than 65535 x %g; give a larger --depth-unit",
                 path[DEPTH_PNG16], beyond, j->desc->depth_unit);
    if (normals)
        CLN_TRY(write_normals(j, f, normals));
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

/* Depth and opacity as written. */
static cln_status read_frame(const job *j, const frame *f, float **depth, uint8_t **opacity)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    int dims = 0, shape[4] = {0}, width = 0, height = 0, channels = 0;
    uint8_t *grey = NULL;

    CLN_TRY(path_of(j, f, DEPTH_NPY, &path));
    CLN_TRY(cln_npy_read_f32(path, &dims, shape, depth));
    free(path);
    CLN_TRY(path_of(j, f, OPACITY_PNG, &path));
    CLN_TRY(cln_image_load(path, &width, &height, &channels, &grey));
    if (dims != 2 || shape[0] != f->camera.height || shape[1] != width_of(j, f) ||
        height != shape[0] || width != shape[1])
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: its depth has not the frame's size; --overwrite renders it again",
                         path));
    for (int i = 0; i < width * height; i++) /* in place: grey has several equal channels */
        grey[i] = grey[i * channels];
    *opacity = grey;
    grey = NULL;
done:
    free(grey);
    free(path);
    return st;
}

/* Twice through the files: for the scale, and to draw. */
static cln_status draw_depths(const job *j)
{
    cln_status st = CLN_OK;
    cln_depth_scale scale = {0};
    float *depth = NULL;
    uint8_t *opacity = NULL;
    char *path = NULL;

    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < j->count; i++) {
            const frame *f = &j->frames[i];
            const size_t n = (size_t)width_of(j, f) * (size_t)f->camera.height;

            CLN_TRY(read_frame(j, f, &depth, &opacity));
            if (pass == 0) {
                CLN_TRY(cln_depth_scale_add(&scale, n, depth, opacity));
            } else {
                CLN_TRY(path_of(j, f, DEPTH_PNG, &path));
                cln_depth_draw(&scale, n, depth, opacity, opacity);
                CLN_TRY(cln_image_write_png(path, width_of(j, f), f->camera.height, 1, opacity));
            }
            free(depth);
            free(opacity);
            free(path);
            depth = NULL;
            opacity = NULL;
            path = NULL;
        }
        if (pass == 0)
            cln_depth_scale_make(&scale);
    }
    CLN_TRY(write_about(j, &scale));
done:
    cln_depth_scale_free(&scale);
    free(depth);
    free(opacity);
    free(path);
    return st;
}

/* ---- the work ---- */

/* As if nothing could be compressed. */
static cln_status check_disk(const job *j)
{
    double bytes = 0;

    for (int i = 0; i < j->count; i++)
        if (!j->frames[i].there)
            bytes += (sizeof(float) + 5.0 + 4.0 * j->desc->pfm + (j->desc->depth_unit > 0 ? 2 : 0) +
                      15.0 * j->desc->normals) *
                     width_of(j, &j->frames[i]) * j->frames[i].camera.height;
    return bytes > 0 ? cln_disk_check(j->desc->out, bytes, "the frames") : CLN_OK;
}

static cln_status start(job *j)
{
    cln_status st = CLN_OK;
    cln_open_run *v = &j->opened;
    const cln_camera **cameras = NULL;
    const int each = eyes_of(j);
    unsigned lenses = 0;

    CLN_TRY(cln_alloc(&cameras, (size_t)(j->count * each), sizeof *cameras, "cameras"));
    for (int i = 0; i < j->count * each; i++) {
        cameras[i] = &j->eyes[i];
        lenses |= cln_camera_lenses(cameras[i]);
    }
    if (j->desc->fast)
        cln_render_faster(&v->model.config);
    CLN_TRY(cln_open_run_start(v, &j->desc->device, lenses));
    v->pipeline.antialias = j->desc->antialias;
    CLN_TRY(cln_crop_use(&v->pipeline, &v->model.space, &j->crop));
    CLN_TRY(cln_pipeline_cameras(&v->pipeline, cameras, j->count * each, &v->model.space));
    CLN_TRY(cln_render_prepare(&v->pipeline));
done:
    free(cameras);
    return st;
}

static cln_status add_frame(cln_film *film, const cln_picture *p)
{
    cln_status st = CLN_OK;
    const size_t n = 3 * (size_t)p->width * (size_t)p->height;
    uint8_t *rgb = NULL;

    CLN_TRY(cln_alloc(&rgb, n, 1, "picture"));
    for (size_t i = 0; i < n; i++)
        rgb[i] = cln_to_u8(p->rgb[i]);
    CLN_TRY(cln_film_add(film, rgb));
done:
    free(rgb);
    return st;
}

/* Columns [at, at + width) of `whole`, `channels` floats a pixel, become `part`. */
static void put_beside(const float *part, int width, int height, int channels, int at, int of,
                       float *whole)
{
    for (int y = 0; y < height; y++)
        memcpy(whole + ((size_t)y * (size_t)of + (size_t)at) * (size_t)channels,
               part + (size_t)y * (size_t)width * (size_t)channels,
               (size_t)width * (size_t)channels * sizeof *part);
}

/* An eye's picture: depths become scene units. normals: NULL or [height][width][3]. */
static cln_status render_eye(job *j, int eye, float *normals, cln_picture *out)
{
    cln_status st = CLN_OK;
    const unsigned depth =
        (j->desc->z_depth ? CLN_DEPTH_AXIS : 0) | (j->desc->mean_depth ? CLN_DEPTH_MEAN : 0);
    const size_t n = (size_t)j->eyes[eye].width * (size_t)j->eyes[eye].height;

    CLN_TRY(cln_render_view(&j->opened.pipeline, eye, j->opened.model.background, depth,
                            &j->desc->callbacks, out));
    for (size_t i = 0; i < n; i++)
        out->depth[i] = out->opacity[i] > 0
                            ? cln_space_depth_to_scene(&j->opened.model.space, out->depth[i])
                            : 0;
    if (normals)
        cln_normals_of_depth(&j->eyes[eye], out->depth, j->desc->z_depth, out->opacity, normals);
done:
    return st;
}

/* A frame's picture, of two eyes side by side. *normals: if they are wanted; the caller frees
 * it. */
static cln_status render_frame(job *j, int i, cln_picture *out, float **normals)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &j->frames[i].camera;
    const int each = eyes_of(j), width = c->width, height = c->height,
              of = width_of(j, &j->frames[i]);
    const size_t n = (size_t)width * (size_t)height;
    cln_picture eye = {0};
    float *own = NULL;

    if (j->desc->normals) {
        CLN_TRY(cln_alloc(normals, n * (size_t)each, 3 * sizeof **normals, "normals"));
        if (each == 1)
            return render_eye(j, i, *normals, out);
        CLN_TRY(cln_alloc(&own, n, 3 * sizeof *own, "normals"));
    } else if (each == 1) {
        return render_eye(j, i, NULL, out);
    }
    out->width = of;
    out->height = height;
    CLN_TRY(cln_alloc(&out->rgb, 2 * n, 3 * sizeof *out->rgb, "picture"));
    CLN_TRY(cln_alloc(&out->depth, 2 * n, sizeof *out->depth, "picture"));
    CLN_TRY(cln_alloc(&out->opacity, 2 * n, sizeof *out->opacity, "picture"));
    for (int e = 0; e < each; e++) {
        CLN_TRY(render_eye(j, i * each + e, own, &eye));
        put_beside(eye.rgb, width, height, 3, e * width, of, out->rgb);
        put_beside(eye.depth, width, height, 1, e * width, of, out->depth);
        put_beside(eye.opacity, width, height, 1, e * width, of, out->opacity);
        if (own)
            put_beside(own, width, height, 3, e * width, of, *normals);
        cln_picture_free(&eye);
    }
done:
    cln_picture_free(&eye);
    free(own);
    return st;
}

/* film: NULL, or what gets the pictures instead of files. */
static cln_status render_frames(job *j, cln_film *film, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const cln_callbacks *callbacks = &j->desc->callbacks;
    cln_picture picture = {0};
    float *normals = NULL;

    for (int i = 0; i < j->count; i++) {
        const double began = cln_now();

        if (j->frames[i].there)
            continue;
        if (callbacks->work)
            callbacks->work("render", result->skipped + result->rendered, j->count,
                            callbacks->user);
        st = render_frame(j, i, &picture, &normals);
        if ((st == CLN_SIGINT || st == CLN_SIGTERM) && film)
            cln_note("rendering %s: %d of %d frames were done; a film is made anew each time",
                     j->desc->out, i, j->count);
        else if (st == CLN_SIGINT || st == CLN_SIGTERM)
            cln_note(
                "rendering into %s: %d of %d frames are there, the same command renders the others",
                j->desc->out, result->skipped + result->rendered, j->count);
        CLN_TRY(st);
        if (film)
            CLN_TRY(add_frame(film, &picture));
        else if (j->writes)
            CLN_TRY(write_frame(j, &j->frames[i], &picture, normals));
        cln_picture_free(&picture);
        free(normals);
        normals = NULL;
        result->rendered++;
        result->seconds += cln_now() - began;
    }
    if (callbacks->work)
        callbacks->work("render", j->count, j->count, callbacks->user);
done:
    cln_picture_free(&picture);
    free(normals);
    return st;
}

static cln_status render_film(job *j, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const cln_camera *first = &j->frames[0].camera;
    const double told = j->desc->fps > 0 ? j->desc->fps : j->cameras.fps;
    cln_film *film = NULL, *finished = NULL;

    for (int i = 1; i < j->count; i++) {
        const cln_camera *c = &j->frames[i].camera;

        if (c->width != first->width || c->height != first->height)
            CLN_TRY(cln_fail(CLN_USAGE,
                             "%s: frame %s has %d x %d pixels, the first one %d x %d; give --width "
                             "and --height for a film",
                             j->desc->out, j->frames[i].name, c->width, c->height, first->width,
                             first->height));
    }
    if (j->writes)
        CLN_TRY(cln_film_begin(j->desc->out, width_of(j, &j->frames[0]), first->height,
                               told > 0 ? told : 24, j->desc->overwrite, &film));
    result->plain_film = film && strcmp(cln_film_path(film), j->desc->out) != 0;
    CLN_TRY(start(j));
    CLN_TRY(render_frames(j, film, result));
    finished = film;
    film = NULL;
    if (finished)
        CLN_TRY(cln_film_end(finished));
done:
    cln_film_abandon(film);
    return st;
}

cln_status cln_render(const cln_render_desc *desc, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const bool pixels[CLN_SPLITS] = {false};
    job j = {.desc = desc, .writes = cln_ranks_me() == 0};

    memset(result, 0, sizeof *result);
    j.crop.on = desc->cropped;
    memcpy(j.crop.box, desc->crop, sizeof j.crop.box);
    if (desc->cropped)
        CLN_TRY(cln_crop_check("--crop", desc->crop));
    CLN_TRY(cln_run_read(desc->run, &j.run));
    if (cln_frames_need_scene(desc, j.run))
        CLN_TRY(cln_open_run_open(desc->run, desc->scene, pixels, &j.opened));
    else
        CLN_TRY(cln_open_run_model(desc->run, &j.opened));
    CLN_TRY(cln_frames_make(desc, j.opened.scene, j.run, &j.cameras));
    if (!desc->cropped && j.cameras.crop.on) { /* the command line goes before the file */
        j.crop = j.cameras.crop;
        memcpy(j.opened.model.background, j.cameras.crop_background,
               sizeof j.opened.model.background);
        cln_info("%s: its crop box is shown alone, on its colour; --crop takes another",
                 desc->poses);
    }
    if (j.crop.on)
        cln_crop_warn(desc->cropped ? "--crop" : desc->poses, &j.opened.model.space, &j.crop);
    CLN_TRY(list_frames(&j));
    CLN_TRY(place_eyes(&j));
    for (int i = 0; i < j.count; i++)
        find_identity(&j, &j.frames[i]);
    CLN_TRY(check_ranks(&j));
    if (cln_film_named(desc->out)) {
        CLN_TRY(render_film(&j, result));
        goto done;
    }
    if (j.writes) {
        CLN_TRY(check_folder(desc->out, &j.before));
        CLN_TRY(find_there(&j));
        CLN_TRY(check_disk(&j));
    }
    CLN_TRY(tell_there(&j));
    result->skipped = j.there;
    if (j.there < j.count) {
        CLN_TRY(start(&j));
        if (j.writes) {
            CLN_TRY(drop_stale(&j));
            CLN_TRY(write_about(&j, NULL));
        }
        CLN_TRY(render_frames(&j, NULL, result));
    }
    if (!j.writes)
        goto done;
    if (j.there < j.count || j.pictured < j.count)
        CLN_TRY(draw_depths(&j));
done:
    free(j.frames);
    free(j.eyes);
    cln_frames_free(&j.cameras);
    json_decref(j.run);
    json_decref(j.before);
    cln_open_run_close(&j.opened);
    return st;
}
