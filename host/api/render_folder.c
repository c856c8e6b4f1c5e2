/* The files of a render's folder. See render_folder.h; render.c has their order. */
#include "api/render_folder.h"

#include <dirent.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/commit.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/depth_file.h"
#include "io/disk.h"
#include "io/hold.h"
#include "io/image.h"
#include "io/npy.h"
#include "io/png16.h"
#include "io/run_folder.h"
#include "ranks/ranks.h"
#include "render/map.h"
#include "scene/transforms_write.h"

#define SCHEMA "cl-nascent.frames/1"

static const char *const suffixes[] = {
    ".depth.npy",  ".depth.pfm", ".height.asc",  ".pgw", ".metric.png", ".normal.npy",
    ".normal.png", ".seen.png",  ".opacity.png", ".png", ".depth.png",  ".depth16.png"};
enum {
    DEPTH_NPY,
    DEPTH_PFM,
    HEIGHT_ASC,
    WORLD,
    DEPTH_PNG16,
    NORMAL_NPY,
    NORMAL_PNG,
    SEEN_PNG,
    OPACITY_PNG,
    COLOUR_PNG,
    FILES,
    DEPTH_PNG = FILES,
    OLD_PNG16 /* that older programs wrote for .metric.png */
};

static const double FEW_STEPS = 64; /* of a depth PNG, in which a shape is hardly seen */

int cln_render_eyes(const cln_render_job *j)
{
    return j->desc->stereo > 0 ? 2 : 1;
}

int cln_render_width(const cln_render_job *j, const cln_render_frame *f)
{
    return cln_render_eyes(j) * f->camera.width;
}

static cln_status path_of(const cln_render_job *j, const cln_render_frame *f, int file, char **path)
{
    return cln_asprintf(path, "%s/%s%s", j->desc->out, f->name, suffixes[file]);
}

/* ---- what is there ---- */

static cln_status has_file(const cln_render_job *j, const cln_render_frame *f, int file,
                           bool *there)
{
    cln_status st = CLN_OK;
    char *path = NULL;

    CLN_TRY(path_of(j, f, file, &path));
    *there = cln_is_file(path);
done:
    free(path);
    return st;
}

/* Has a text file so many lines, the last one to its end? */
static bool has_lines(const char *path, long lines)
{
    FILE *file = fopen(path, "r");
    char block[1 << 16];
    size_t bytes = 0;
    long ends = 0;
    bool ended = false;

    while (file && (bytes = fread(block, 1, sizeof block, file)) > 0) {
        for (size_t i = 0; i < bytes; i++)
            ends += block[i] == '\n';
        ended = block[bytes - 1] == '\n';
    }
    if (file)
        fclose(file);
    return ended && ends == lines;
}

/* Whether a frame's file is there and looks whole: it has been written at once, but a copy of the
 * folder may have been cut short. */
static cln_status has_whole_file(const cln_render_job *j, const cln_render_frame *f, int file,
                                 bool *there)
{
    cln_status st = CLN_OK;
    const double values = (double)cln_render_width(j, f) * f->camera.height;
    const bool text = file == HEIGHT_ASC || file == WORLD;
    const bool picture = !text && file != DEPTH_NPY && file != DEPTH_PFM && file != NORMAL_NPY;
    char *path = NULL;
    struct stat about;

    CLN_TRY(path_of(j, f, file, &path));
    *there = stat(path, &about) == 0 && S_ISREG(about.st_mode);
    if (*there && picture)
        *there = cln_image_check_ends(path) == CLN_OK;
    else if (*there && text)
        *there = has_lines(path, 6 + (file == HEIGHT_ASC ? f->camera.height : 0));
    else if (*there)
        *there = (double)about.st_size >= (file == DEPTH_PFM ? 0 : CLN_NPY_HEAD) +
                                              values * sizeof(float) * (file == NORMAL_NPY ? 3 : 1);
    cln_clear_error();
done:
    free(path);
    return st;
}

static bool is_wanted(const cln_render_job *j, int file)
{
    switch (file) {
    case DEPTH_PFM:
        return j->desc->pfm;
    case HEIGHT_ASC:
    case WORLD:
        return j->desc->map;
    case DEPTH_PNG16:
        return j->desc->depth_unit > 0;
    case NORMAL_NPY:
    case NORMAL_PNG:
        return j->desc->normals;
    case SEEN_PNG:
        return j->desc->seen;
    default:
        return true;
    }
}

/* Frames of earlier renders that stay: counts those with pictures, forgets the others. */
static cln_status find_earlier(cln_render_job *j)
{
    cln_status st = CLN_OK;
    json_t *known = json_object_get(j->before, "frames"), *now = json_object();
    const char *name = NULL;
    json_t *digest = NULL;
    void *next = NULL;
    bool there = false;

    for (int i = 0; i < j->count; i++)
        json_object_set_new(now, j->frames[i].name, json_true());
    json_object_foreach_safe(known, next, name, digest)
    {
        const cln_render_frame frame = {.name = name};

        if (json_object_get(now, name))
            continue;
        CLN_TRY(has_file(j, &frame, COLOUR_PNG, &there));
        if (there)
            j->earlier++;
        else {
            json_object_del(known, name);
            json_object_del(json_object_get(j->before, "seen"), name);
        }
    }
    if (j->earlier > 0)
        cln_info("%s: %d other frame%s of an earlier render stay%s in it beside the %d of this "
                 "one; for these alone, choose another folder with -o",
                 j->desc->out, j->earlier, cln_plural(j->earlier, "", "s"),
                 cln_plural(j->earlier, "s", ""), j->count);
done:
    json_decref(now);
    return st;
}

/* ---- the folder ---- */

/* As in --background: of floats, what they were meant as. */
static json_t *background_json(const cln_render_job *j)
{
    json_t *rgb = json_array();

    for (int c = 0; c < 3; c++)
        json_array_append_new(rgb, json_real(round(1e6 * j->opened.model.background[c]) / 1e6));
    return rgb;
}

/* By which training views the shares of a frame in the folder were counted. */
static const char *seen_by(const cln_render_job *j, const char *name)
{
    const json_t *row = json_object_get(json_object_get(j->before, "seen"), name);
    const char *by = json_string_value(json_array_get(row, 2));

    return by ? by : cln_json_text(j->before, "seen_by"); /* older programs tell the newest's */
}

/* "seen" of the folder's frames: those of this render, which are null until they are counted, and
 * of others that have it. */
static int put_seen(const cln_render_job *j, json_t *about)
{
    json_t *seen = json_object(), *row = NULL;
    const char *by = j->seen_by[0] ? j->seen_by : cln_json_text(j->before, "seen_by");
    const char *name = NULL;
    int lost = 0;

    json_object_foreach(json_object_get(j->before, "seen"), name, row) lost |= json_object_set_new(
        seen, name,
        json_pack("[O?, O?, s]", json_array_get(row, 0), json_array_get(row, 1), seen_by(j, name)));
    for (int i = 0; i < j->count; i++) {
        const cln_render_frame *f = &j->frames[i];

        if (j->desc->seen && cln_utf8_valid(f->name))
            lost |= json_object_set_new(seen, f->name,
                                        json_pack("[o, o, s]", cln_json_real(f->seen.none),
                                                  cln_json_real(f->seen.few), by));
        else if (!f->there)
            json_object_del(seen, f->name);
    }
    if (json_object_size(seen) > 0)
        lost |= json_object_set(about, "seen", seen);
    if (*by)
        lost |= json_object_set_new(about, "seen_by", json_string(by));
    json_decref(seen);
    return lost;
}

static json_t *map_json(const cln_camera *c, const double offset[3])
{
    const double *m = c->c2w;
    double corner[3];

    cln_map_corner(c, offset, corner);
    return json_pack("{s:f, s:[f,f,f], s:i, s:i, s:[[f,f,f],[f,f,f],[f,f,f]]}", "spacing",
                     1 / c->fx, "corner", corner[0], corner[1], corner[2], "width", c->width,
                     "height", c->height, "axes", m[0], m[4], m[8], -m[1], -m[5], -m[9], -m[2],
                     -m[6], -m[10]);
}

/* Makes render.json: what this rendering is of, and the digest of every frame in the folder.
 * Nothing in it differs between two renderings of the same. */
static json_t *describe(const cln_render_job *j)
{
    const cln_render_desc *d = j->desc;
    char digest[CLN_DIGEST_TEXT];
    json_t *about = NULL, *frames = json_object();
    json_t *before = json_object_get(j->before, "frames");
    int lost = before ? json_object_update(frames, before) : 0;

    for (int i = 0; i < j->count; i++)
        if (cln_utf8_valid(j->frames[i].name)) /* else it has no place in JSON */
            lost |=
                json_object_set_new(frames, j->frames[i].name, json_string(j->frames[i].made_from));
    cln_digest_text(j->model_digest, digest);
    about = json_pack("{s:s, s:s, s:s, s:s, s:I, s:s, s:s, s:s, s:o}", "schema", SCHEMA, "tool",
                      "cl-nascent " CLN_VERSION, "commit", cln_commit(), "model_digest", digest,
                      "step", (json_int_t)j->opened.model.step, "depth",
                      d->z_depth ? "axis" : "ray", "depth_of", d->mean_depth ? "mean" : "median",
                      "poses", j->cameras.poses, "frames", frames);
    if (about)
        lost |= json_object_set_new(about, "background", background_json(j));
    if (about)
        lost |= put_seen(j, about);
    if (about && j->earlier > 0)
        lost |= json_object_set_new(about, "earlier_frames", json_integer(j->earlier));
    if (about && d->depth_unit > 0)
        lost |= json_object_set_new(about, "depth_unit", json_real(d->depth_unit));
    if (about && j->antialias > 1)
        lost |= json_object_set_new(about, "antialias", json_integer(j->antialias));
    if (about && d->fast)
        lost |= json_object_set_new(about, "fast", json_true());
    if (about && d->transparent)
        lost |= json_object_set_new(about, "transparent", json_true());
    if (about && d->bits == 16)
        lost |= json_object_set_new(about, "bits", json_integer(16));
    if (about && d->stereo > 0)
        lost |= json_object_set_new(about, "stereo", json_real(d->stereo));
    if (about && j->crop.on)
        lost |= json_object_set_new(about, "crop",
                                    json_pack("[f,f,f,f,f,f]", j->crop.box[0], j->crop.box[1],
                                              j->crop.box[2], j->crop.box[3], j->crop.box[4],
                                              j->crop.box[5]));
    if (about && cln_crop_is_turned(&j->crop)) {
        json_t *axes = json_array();

        for (int i = 0; i < 9; i++)
            lost |= json_array_append_new(axes, json_real(j->crop.turn[i]));
        lost |= json_object_set_new(about, "crop_axes", axes);
    }
    if (about && cln_up_given(d->up))
        lost |=
            json_object_set_new(about, "up", json_pack("[f,f,f]", d->up[0], d->up[1], d->up[2]));
    if (about && (d->first_frame > 0 || d->frame_count > 0))
        lost |= json_object_set_new(
            about, "range", json_pack("[i,i]", d->first_frame, d->first_frame + j->count - 1));
    if (about && d->poses)
        (void)json_object_set_new(about, "file", json_string(d->poses)); /* UTF-8 alone */
    if (about && (d->split || d->poses) && (d->width > 0 || d->height > 0))
        lost |= json_object_set_new(about, "size", json_pack("[i,i]", d->width, d->height));
    if (about && d->map)
        lost |= json_object_set_new(about, "map", map_json(&j->frames[0].camera, d->offset));
    if (about && strcmp(j->cameras.poses, "orbit") == 0)
        lost |= json_object_set_new(
            about, "orbit",
            json_pack("{s:i, s:o, s:f, s:b, s:i, s:i, s:f}", "frames", d->orbit_frames, "elevation",
                      cln_json_real(d->orbit_elevation), "radius", d->orbit_radius, "circle",
                      d->orbit_circle, "width", j->frames[0].camera.width, "height",
                      j->frames[0].camera.height, "fx", j->frames[0].camera.fx));
    if (lost) {
        json_decref(about);
        about = NULL;
    }
    return about;
}

/* Whether the folder's newest render was of the same poses as this one, perhaps of another --frames
 * range of them. */
static bool is_of_path(const cln_render_job *j, bool range)
{
    static const char *const others[] = {"tool", "commit",  "frames",        "earlier_frames",
                                         "seen", "seen_by", "depth_picture", "range"};
    const size_t count = sizeof others / sizeof *others - !range;
    json_t *now = describe(j), *before = json_copy(j->before);
    bool same = false;

    for (size_t i = 0; i < count && now && before; i++) {
        json_object_del(now, others[i]);
        json_object_del(before, others[i]);
    }
    same = now && before && json_equal(now, before);
    json_decref(now);
    json_decref(before);
    return same;
}

/* Whether it was of these very frames, so that its depth pictures are on the scale that render.json
 * tells. */
static bool is_of_before(const cln_render_job *j)
{
    return is_of_path(j, false) &&
           json_integer_value(json_object_get(j->before, "earlier_frames")) == j->earlier;
}

/* The scale of the depth pictures of other frames of this path, which stay: a film must not
 * flicker. False if there is none. */
static bool take_scale(const cln_render_job *j, cln_depth_scale *scale)
{
    const json_t *picture = json_object_get(j->before, "depth_picture");
    const double near = json_number_value(json_object_get(picture, "near"));
    const double far = json_number_value(json_object_get(picture, "far"));

    if (j->earlier == 0 || !(near > 0 && far > near) || !is_of_path(j, true))
        return false;
    scale->low = (float)(1 / far);
    scale->high = (float)(1 / near);
    return true;
}

/* Of a frame that is kept: as render.json tells, or where that was not written any more, as its
 * picture does. */
static cln_status read_seen(const cln_render_job *j, const cln_render_frame *f,
                            cln_seen_shares *seen)
{
    cln_status st = CLN_OK;
    const json_t *row = json_object_get(json_object_get(j->before, "seen"), f->name);
    const json_t *none = json_array_get(row, 0), *few = json_array_get(row, 1);
    cln_picture picture = {0};
    char *path = NULL;
    uint8_t *grey = NULL;
    int channels = 0;

    if (json_is_number(none) && json_is_number(few)) {
        *seen = (cln_seen_shares){json_number_value(none), json_number_value(few)};
        return CLN_OK;
    }
    CLN_TRY(path_of(j, f, SEEN_PNG, &path));
    CLN_TRY(cln_image_load(path, &picture.width, &picture.height, &channels, &grey));
    CLN_TRY(cln_alloc(&picture.seen, (size_t)picture.width, (size_t)picture.height, "picture"));
    for (size_t i = 0; i < (size_t)picture.width * (size_t)picture.height; i++) {
        const uint8_t value = grey[i * (size_t)channels];

        picture.seen[i] = (int8_t)(value == 255 ? -1 : value / CLN_SEEN_STEP);
    }
    *seen = cln_seen_share(&picture);
done:
    cln_picture_free(&picture);
    free(grey);
    free(path);
    return st;
}

cln_status cln_render_find_there(cln_render_job *j)
{
    cln_status st = CLN_OK;
    const json_t *known = json_object_get(j->before, "frames");

    for (int i = 0; i < j->count; i++) {
        cln_render_frame *f = &j->frames[i];
        const char *made_from = json_string_value(json_object_get(known, f->name));
        bool pictured = false;

        f->alike = made_from && strcmp(made_from, f->made_from) == 0;
        f->there = !j->desc->overwrite && f->alike;
        for (int file = 0; file < FILES && f->there; file++)
            if (is_wanted(j, file))
                CLN_TRY(has_whole_file(j, f, file, &f->there));
        f->recounted = f->there && j->desc->seen && strcmp(j->seen_by, seen_by(j, f->name)) != 0;
        f->there = f->there && !f->recounted;
        CLN_TRY(has_file(j, f, DEPTH_PNG, &pictured));
        if (f->there && j->desc->seen)
            CLN_TRY(read_seen(j, f, &f->seen));
        j->there += f->there;
        j->pictured += pictured;
    }
    CLN_TRY(find_earlier(j));
    if (!is_of_before(j))
        j->pictured = 0;
done:
    return st;
}

/* What the picture at `path`, another than frame f would be, differs in. */
static const char *word_of(const cln_render_job *j, const cln_render_frame *f, const char *path)
{
    const char *model = json_string_value(json_object_get(j->before, "model_digest"));
    char digest[CLN_DIGEST_TEXT];
    int width = 0, height = 0, channels = 0;
    const bool read = cln_image_info(path, &width, &height, &channels) == CLN_OK;

    cln_clear_error();
    cln_digest_text(j->model_digest, digest);
    if (read && (width != cln_render_width(j, f) || height != f->camera.height))
        return "of another size";
    if (!model || json_object_get(j->before, "earlier_frames")) /* it tells only the newest's */
        return "of other settings or another model";
    return strcmp(model, digest) != 0 ? "of another model" : "of other settings";
}

cln_status cln_render_refuse_others(const cln_render_job *j)
{
    cln_status st = CLN_OK;
    const char *word = NULL;
    char *path = NULL;
    cln_listed others = {0};
    int right = 0;

    for (int i = 0; i < j->count && !j->desc->overwrite; i++) {
        const cln_render_frame *f = &j->frames[i];

        right += f->there;
        if (f->alike)
            continue;
        free(path);
        path = NULL;
        CLN_TRY(path_of(j, f, COLOUR_PNG, &path));
        if (!cln_is_file(path))
            continue;
        if (!word)
            word = word_of(j, f, path);
        cln_listed_add(&others, 3, "%s", f->name);
    }
    if (others.count > 0 && right == 0)
        st = cln_fail(CLN_OUTPUT,
                      "%s: has %d of these frames already, but %s; --overwrite replaces %s, -o "
                      "names another folder",
                      j->desc->out, others.count, word, cln_plural(others.count, "it", "them"));
    else if (others.count > 0)
        st = cln_fail(CLN_OUTPUT,
                      "%s: has %d of these %d frames already (%s), but %s; remove %s to have %s "
                      "rendered alone, --overwrite renders all again, -o names another folder",
                      j->desc->out, others.count, j->count, others.text, word,
                      cln_plural(others.count, "its .png", "their .png"),
                      cln_plural(others.count, "it", "these"));
done:
    free(path);
    return st;
}

cln_status cln_render_check_folder(const char *out, json_t **before)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    const char *schema = NULL;
    DIR *dir = NULL;
    bool empty = true;

    CLN_TRY(cln_path_join(&path, out, "render.json"));
    if (cln_is_file(path)) {
        st = cln_json_read(path, false, before);
        if (st != CLN_OK)
            cln_note("reading what an earlier render left; choose another folder with -o");
        CLN_TRY(st);
        schema = json_string_value(json_object_get(*before, "schema"));
        if (!schema || strcmp(schema, SCHEMA) != 0)
            st = cln_fail(CLN_OUTPUT, "%s: its schema is %s, not %s; choose another folder with -o",
                          path, schema ? schema : "not named", SCHEMA);
        goto done;
    }
    dir = opendir(out);
    if (!dir && (errno == ENOENT || errno == ENAMETOOLONG)) {
        st = cln_disk_check(out, 0, "");
        goto done;
    }
    if (!dir)
        CLN_TRY(
            cln_fail(CLN_OUTPUT, "%s: %s; choose another folder with -o", out, strerror(errno)));
    for (struct dirent *e = readdir(dir); e; e = readdir(dir))
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0 &&
            strcmp(e->d_name, "lock") != 0 && strncmp(e->d_name, "render.json.tmp.", 16) != 0)
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

cln_status cln_render_hold_folder(const char *out, cln_render_hold *hold)
{
    cln_status st = CLN_OK;

    *hold = (cln_render_hold){.lock = -1, .made = !cln_is_dir(out)};
    if (!hold->made && access(out, W_OK) != 0)
        return CLN_OK; /* all frames may be there */
    CLN_TRY(cln_make_dirs(out));
    CLN_TRY(cln_hold(out, "renders into this folder", ", or choose another folder with -o",
                     &hold->lock));
done:
    return st;
}

void cln_render_release_folder(const char *out, const cln_render_hold *hold)
{
    cln_hold_remove(out, hold->lock);
    if (hold->made)
        (void)rmdir(out); /* does nothing if it has files */
}

cln_status cln_render_drop_stale(const cln_render_job *j)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    int dropped = 0, recounted = 0;

    for (int i = 0; i < j->count; i++) {
        recounted += j->frames[i].recounted;
        if (j->frames[i].there)
            continue;
        for (int file = OLD_PNG16; file >= 0; file--) { /* first those that say it is there */
            free(path);
            path = NULL;
            CLN_TRY(path_of(j, &j->frames[i], file, &path));
            if (remove(path) == 0)
                dropped += file == COLOUR_PNG && !j->frames[i].recounted;
            else if (errno != ENOENT)
                CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", path, strerror(errno)));
        }
    }
    if (recounted > 0)
        cln_info("%s: of %d of %d frames other training views were counted: %s rendered again",
                 j->desc->out, recounted, j->count, cln_plural(recounted, "it is", "they are"));
    if (dropped > 0)
        cln_info("%s: %d of %d frames %s: %s rendered again", j->desc->out, dropped, j->count,
                 j->desc->overwrite
                     ? cln_plural(dropped, "is to be replaced", "are to be replaced")
                     : cln_plural(dropped, "lacks a file, or has one that was cut short",
                                  "lack files, or have some that were cut short"),
                 cln_plural(dropped, "it is", "they are"));
done:
    free(path);
    return st;
}

/* Adds the cameras of frames of other names that stay in the folder, each with its lens. */
static cln_status add_earlier_cameras(const cln_render_job *j, json_t *frames)
{
    cln_status st = CLN_OK;
    json_t *document = NULL, *frame = NULL, *model = NULL, *staying = NULL;
    char *path = NULL, *name = NULL;
    size_t at = 0;
    int lost = 0;

    staying = json_copy(json_object_get(j->before, "frames"));
    for (int i = 0; i < j->count; i++)
        json_object_del(staying, j->frames[i].name);
    CLN_TRY(cln_path_join(&path, j->desc->out, "transforms.json"));
    if (!cln_is_file(path) || cln_json_read(path, false, &document) != CLN_OK) {
        cln_clear_error(); /* of stereo pairs there is none */
        goto done;
    }
    model = json_object_get(document, "camera_model");
    json_array_foreach(json_object_get(document, "frames"), at, frame)
    {
        const char *file = json_string_value(json_object_get(frame, "file_path"));

        if (!file || !cln_ends_with(file, suffixes[COLOUR_PNG]) ||
            !json_is_array(json_object_get(frame, "transform_matrix")))
            continue;
        free(name);
        name = NULL;
        CLN_TRY(
            cln_asprintf(&name, "%.*s", (int)(strlen(file) - strlen(suffixes[COLOUR_PNG])), file));
        if (!json_object_get(staying, name))
            continue;
        if (model && !json_object_get(frame, "camera_model"))
            lost |= json_object_set(frame, "camera_model", model);
        lost |= json_array_append(frames, frame);
    }
    if (lost)
        CLN_TRY(cln_fail(CLN_MEMORY, "transforms.json: cannot make JSON"));
done:
    json_decref(document);
    json_decref(staying);
    free(path);
    free(name);
    return st;
}

static int by_file(const void *a, const void *b)
{
    const json_t *const *x = a, *const *y = b;

    return cln_natural_compare(cln_json_text(*x, "file_path"), cln_json_text(*y, "file_path"));
}

/* Brings frames of several renders into the order of their names. */
static cln_status sort_cameras(json_t *frames)
{
    cln_status st = CLN_OK;
    const size_t count = json_array_size(frames);
    json_t **list = NULL;
    int lost = 0;

    CLN_TRY(cln_alloc(&list, count, sizeof *list, "cameras"));
    for (size_t i = 0; i < count; i++)
        list[i] = json_incref(json_array_get(frames, i));
    qsort(list, count, sizeof *list, by_file);
    for (size_t i = 0; i < count; i++)
        lost |= json_array_set_new(frames, i, list[i]);
    if (lost)
        CLN_TRY(cln_fail(CLN_MEMORY, "transforms.json: cannot make JSON"));
done:
    free(list);
    return st;
}

/* The cameras of the folder's frames as a scene of these pictures; none of stereo pairs, which have
 * two each, and of a map, which has no place that rays begin at. */
static cln_status write_cameras(const cln_render_job *j)
{
    cln_status st = CLN_OK;
    json_t *document = json_object(), *frames = json_array();
    char *name = NULL, *path = NULL;
    bool one_lens = j->earlier == 0;
    int lost = json_object_set_new(document, "frames", frames);

    CLN_TRY(cln_path_join(&path, j->desc->out, "transforms.json"));
    if (j->desc->map && j->earlier > 0) /* theirs stay */
        goto done;
    if (cln_render_eyes(j) > 1 || j->desc->map) {
        (void)unlink(path); /* of single pictures that these may have replaced */
        goto done;
    }
    if (j->earlier > 0)
        CLN_TRY(add_earlier_cameras(j, frames));
    for (int i = 1; i < j->count; i++)
        one_lens = one_lens && j->frames[i].camera.lens == j->frames[0].camera.lens;
    if (one_lens)
        lost |= json_object_set_new(document, "camera_model",
                                    json_string(cln_lens_models[j->frames[0].camera.lens].name));
    for (int i = 0; i < j->count && !lost; i++) {
        const cln_camera *c = &j->frames[i].camera;
        json_t *frame = NULL;

        free(name);
        name = NULL;
        CLN_TRY(cln_asprintf(&name, "%s.png", j->frames[i].name));
        if (!cln_utf8_valid(name))
            continue;
        frame = cln_transforms_new_frame(name, c, 1);
        if (!one_lens)
            lost |= json_object_set_new(frame, "camera_model",
                                        json_string(cln_lens_models[c->lens].name));
        lost |= !cln_transforms_put_camera(frame, c);
        lost |= json_array_append_new(frames, frame);
    }
    if (lost)
        CLN_TRY(cln_fail(CLN_MEMORY, "transforms.json: cannot make JSON"));
    if (j->earlier > 0)
        CLN_TRY(sort_cameras(frames));
    CLN_TRY(cln_run_write_json(j->desc->out, "transforms.json", document));
done:
    json_decref(document);
    free(name);
    free(path);
    return st;
}

cln_status cln_render_write_about(const cln_render_job *j, const cln_depth_scale *scale)
{
    cln_status st = CLN_OK;
    const double low = scale ? scale->low : 0, high = scale ? scale->high : 0;
    json_t *about = describe(j);
    int lost = !about;

    if (scale && low > 0)
        lost |= json_object_set_new(about, "depth_picture",
                                    json_pack("{s:f, s:f}", "near", 1 / high, "far", 1 / low));
    if (!scale && j->there == j->count && json_object_get(j->before, "depth_picture"))
        lost |=
            json_object_set(about, "depth_picture", json_object_get(j->before, "depth_picture"));
    if (lost)
        CLN_TRY(cln_fail(CLN_MEMORY, "render.json: cannot make JSON"));
    CLN_TRY(cln_run_write_json(j->desc->out, "render.json", about));
    CLN_TRY(write_cameras(j));
done:
    json_decref(about);
    return st;
}

/* ---- files ---- */

/* The colours, with alpha if the background is taken out of them. */
static cln_status write_colours(const cln_render_job *j, const char *path, const cln_picture *p)
{
    cln_status st = CLN_OK;
    const bool alpha = j->desc->transparent;
    const int channels = alpha ? 4 : 3;
    uint8_t *bytes = NULL;
    uint16_t *words = NULL;

    if (j->desc->bits == 16) {
        CLN_TRY(cln_picture_to_words(p, alpha, &words));
        CLN_TRY(cln_png16_write(path, p->width, p->height, channels, words));
    } else {
        CLN_TRY(cln_picture_to_bytes(p, alpha, &bytes));
        CLN_TRY(cln_image_write_png(path, p->width, p->height, channels, bytes));
    }
done:
    free(bytes);
    free(words);
    return st;
}

static cln_status write_opacity(const cln_render_job *j, const char *path, const cln_picture *p)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height;
    const bool deep = j->desc->bits == 16;
    uint8_t *bytes = NULL;
    uint16_t *words = NULL;

    CLN_TRY(cln_alloc(&bytes, deep ? 0 : n, sizeof *bytes, "picture"));
    CLN_TRY(cln_alloc(&words, deep ? n : 0, sizeof *words, "picture"));
    for (size_t i = 0; i < n && !deep; i++)
        bytes[i] = cln_to_u8(p->opacity[i]);
    for (size_t i = 0; i < n && deep; i++)
        words[i] = cln_to_u16(p->opacity[i]);
    CLN_TRY(deep ? cln_png16_write(path, p->width, p->height, 1, words)
                 : cln_image_write_png(path, p->width, p->height, 1, bytes));
done:
    free(bytes);
    free(words);
    return st;
}

static cln_status write_normals(const cln_render_job *j, const cln_render_frame *f,
                                const float *normals)
{
    cln_status st = CLN_OK;
    const int width = cln_render_width(j, f), height = f->camera.height;
    const int shape[3] = {height, width, 3};
    const size_t n = 3 * (size_t)width * (size_t)height;
    char *path = NULL;
    uint8_t *bytes = NULL;

    CLN_TRY(path_of(j, f, NORMAL_NPY, &path));
    CLN_TRY(cln_npy_write_f32(path, 3, shape, normals));
    free(path);
    path = NULL;
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

static cln_status write_seen(const char *path, const cln_picture *p)
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)p->width * (size_t)p->height;
    uint8_t *bytes = NULL;

    CLN_TRY(cln_alloc(&bytes, n, 1, "picture"));
    for (size_t i = 0; i < n; i++)
        bytes[i] = (uint8_t)(p->seen[i] < 0 ? 255 : CLN_SEEN_STEP * p->seen[i]);
    CLN_TRY(cln_image_write_png(path, p->width, p->height, 1, bytes));
done:
    free(bytes);
    return st;
}

/* From the nearest to the farthest that is seen; infinite where nothing is. */
static double depth_range(const cln_picture *p)
{
    double near = INFINITY, far = -INFINITY;

    for (size_t i = 0; i < (size_t)p->width * (size_t)p->height; i++)
        if (p->opacity[i] > 0.5f) {
            near = fmin(near, (double)p->depth[i]);
            far = fmax(far, (double)p->depth[i]);
        }
    return far >= near ? far - near : INFINITY;
}

cln_status cln_render_write_frame(const cln_render_job *j, const cln_render_frame *f,
                                  const cln_picture *p, const float *normals, char **warning)
{
    cln_status st = CLN_OK;
    const int shape[2] = {p->height, p->width};
    char *path[FILES] = {NULL};
    int beyond = 0, behind = 0;
    char far[128] = "";

    *warning = NULL;
    for (int file = 0; file < FILES; file++)
        CLN_TRY(path_of(j, f, file, &path[file]));
    CLN_TRY(cln_npy_write_f32(path[DEPTH_NPY], 2, shape, p->depth));
    if (is_wanted(j, DEPTH_PFM))
        CLN_TRY(cln_depth_write_pfm(path[DEPTH_PFM], p->width, p->height, p->depth));
    if (is_wanted(j, HEIGHT_ASC)) {
        CLN_TRY(cln_map_write_heights(path[HEIGHT_ASC], &f->camera, j->desc->offset, p));
        CLN_TRY(cln_map_write_world(path[WORLD], &f->camera, j->desc->offset));
    }
    if (is_wanted(j, DEPTH_PNG16))
        CLN_TRY(cln_depth_write_png16(path[DEPTH_PNG16], p->width, p->height, p->depth,
                                      j->desc->depth_unit, &beyond, &behind));
    if (beyond > 0)
        snprintf(far, sizeof far,
                 "%d pixel%s farther than 65535 x %g; give a larger --depth-unit, or --pfm", beyond,
                 cln_plural(beyond, " is", "s are"), j->desc->depth_unit);
    if (behind > 0)
        CLN_TRY(cln_asprintf(warning,
                             "%s: %d pixel%s behind the camera, where depths along its axis are "
                             "negative: the file has 0 there; leave out --z-depth or "
                             "--depth-unit%s%s",
                             path[DEPTH_PNG16], behind, cln_plural(behind, " is", "s are"),
                             beyond > 0 ? "; " : "", far));
    else if (beyond > 0)
        CLN_TRY(cln_asprintf(warning, "%s: %s", path[DEPTH_PNG16], far));
    else if (is_wanted(j, DEPTH_PNG16) && f == j->frames && /* which tells for all */
             depth_range(p) < FEW_STEPS * j->desc->depth_unit)
        CLN_TRY(cln_asprintf(warning,
                             "%s: all that is seen lies within %.0f steps of --depth-unit %g; give "
                             "a smaller one, or --pfm, which has none",
                             path[DEPTH_PNG16], ceil(depth_range(p) / j->desc->depth_unit),
                             j->desc->depth_unit));
    if (normals)
        CLN_TRY(write_normals(j, f, normals));
    if (p->seen)
        CLN_TRY(write_seen(path[SEEN_PNG], p));
    CLN_TRY(write_opacity(j, path[OPACITY_PNG], p));
    CLN_TRY(write_colours(j, path[COLOUR_PNG], p));
done:
    for (int file = 0; file < FILES; file++)
        free(path[file]);
    return st;
}

/* Reads a frame's depth, along the ray, and opacity from its files. */
static cln_status read_frame(const cln_render_job *j, const cln_render_frame *f, float **depth,
                             uint8_t **opacity)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    int dims = 0, shape[4] = {0}, width = 0, height = 0, channels = 0;
    uint8_t *grey = NULL;

    CLN_TRY(path_of(j, f, DEPTH_NPY, &path));
    CLN_TRY(cln_npy_read_f32(path, &dims, shape, depth));
    free(path);
    path = NULL;
    CLN_TRY(path_of(j, f, OPACITY_PNG, &path));
    CLN_TRY(cln_image_load(path, &width, &height, &channels, &grey));
    if (dims != 2 || shape[0] != f->camera.height || shape[1] != cln_render_width(j, f) ||
        height != shape[0] || width != shape[1])
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: its size is not the frame's; --overwrite renders the frame again",
                         path));
    for (int i = 0; i < width * height && j->desc->z_depth; i++)
        (*depth)[i] = cln_depth_along_axis(&f->camera, i % width % f->camera.width, i / width, true,
                                           (*depth)[i]);
    for (int i = 0; i < width * height; i++) /* in place: grey has several equal channels */
        grey[i] = grey[i * channels];
    *opacity = grey;
    grey = NULL;
done:
    free(grey);
    free(path);
    return st;
}

/* Reads the files twice: to find the scale, then to draw. */
cln_status cln_render_draw_depths(const cln_render_job *j)
{
    cln_status st = CLN_OK;
    cln_depth_scale scale = {0};
    float *depth = NULL;
    uint8_t *opacity = NULL;
    char *path = NULL;
    const bool taken = take_scale(j, &scale);

    for (int pass = 0; pass < 2; pass++) {
        for (int i = 0; i < j->count && !(taken && pass == 0); i++) {
            const cln_render_frame *f = &j->frames[i];
            const size_t n = (size_t)cln_render_width(j, f) * (size_t)f->camera.height;

            cln_ranks_answer(); /* the others wait while this one draws */
            CLN_TRY(read_frame(j, f, &depth, &opacity));
            if (pass == 0) {
                CLN_TRY(cln_depth_scale_add(&scale, n, depth, opacity));
            } else {
                CLN_TRY(path_of(j, f, DEPTH_PNG, &path));
                cln_depth_draw(&scale, n, depth, opacity, opacity);
                CLN_TRY(cln_image_write_png(path, cln_render_width(j, f), f->camera.height, 1,
                                            opacity));
            }
            free(depth);
            free(opacity);
            free(path);
            depth = NULL;
            opacity = NULL;
            path = NULL;
        }
        if (pass == 0) { /* while a picture is missing, the next rendering draws them again */
            if (!taken)
                cln_depth_scale_make(&scale);
            CLN_TRY(cln_render_write_about(j, &scale));
        }
    }
done:
    cln_depth_scale_free(&scale);
    free(depth);
    free(opacity);
    free(path);
    return st;
}

/* ---- room ---- */

/* Assumes that nothing can be compressed. */
cln_status cln_render_check_disk(const cln_render_job *j)
{
    double bytes = 0;

    for (int i = 0; i < j->count; i++)
        if (!j->frames[i].there)
            bytes += (sizeof(float) + (4.0 + j->desc->transparent) * (j->desc->bits == 16 ? 2 : 1) +
                      1 + 4.0 * j->desc->pfm + (j->desc->depth_unit > 0 ? 2 : 0) +
                      15.0 * j->desc->normals + j->desc->seen + 12.0 * j->desc->map) *
                     cln_render_width(j, &j->frames[i]) * j->frames[i].camera.height;
    return bytes > 0 ? cln_disk_check(j->desc->out, bytes, "the frames") : CLN_OK;
}
