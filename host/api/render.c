/* cln_render: renders frames of a run into files. This file orders the work and places the eyes of
 * stereo pairs; render/frames.c chooses the cameras, render/view.c renders a view, render_folder.c
 * has the files. A frame's files, in the order in which they are written, each atomically:
 *
 *   NAME.depth.npy  (NAME.depth.pfm  NAME.metric.png  NAME.normal.npy  NAME.normal.png
 *   NAME.seen.png)  NAME.opacity.png  NAME.png
 *
 * An old NAME.png is removed first and the new one written last, so a frame that was cut short is
 * rendered again. Depth pictures follow when all frames are there, as they share a scale.
 * OUT/render.json has a digest of what each frame was made from: a frame of the same model, camera
 * and settings is kept, another one replaced only where desc.overwrite asks for it. A folder that
 * holds files but no render.json is not written to. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "api/frame_writer.h"
#include "api/render_folder.h"
#include "base/callbacks.h"
#include "base/clock.h"
#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "render/map.h"
#include "render/named.h"
#include "render/normals.h"
#include "render/view.h"
#include "ranks/ranks.h"
#include "io/disk.h"
#include "io/film.h"
#include "io/image.h"
#include "io/npy.h"
#include "io/run_folder.h"
#include "scene/reader.h"
#include "scene/vectors.h"

static const double MOST_KEPT = 512 << 20; /* bytes of a film's pictures that come again */

/* ---- which frames ---- */

/* Places the eyes: left and right of the frame's camera, looking the same way. */
static cln_status place_eyes(cln_render_job *j)
{
    cln_status st = CLN_OK;
    const int each = cln_render_eyes(j);

    CLN_TRY(cln_alloc(&j->eyes, (size_t)(j->count * each), sizeof *j->eyes, "cameras"));
    for (int i = 0; i < j->count * each; i++) {
        const cln_render_frame *f = &j->frames[i / each];
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

static cln_status list_frames(cln_render_job *j)
{
    cln_status st = CLN_OK;

    j->count = j->cameras.count;
    CLN_TRY(cln_alloc(&j->frames, (size_t)j->count, sizeof *j->frames, "frames"));
    for (int i = 0; i < j->count; i++) {
        j->frames[i].name = j->cameras.frame[i].name;
        j->frames[i].camera = j->cameras.frame[i].camera;
        j->frames[i].seen = (cln_seen_shares){NAN, NAN};
    }
done:
    return st;
}

/* Files that cannot be written, or read for the depth pictures, are refused before the work. */
static cln_status check_sizes(const cln_render_job *j)
{
    const bool normals = j->desc->normals && !cln_film_named(j->desc->out);

    for (int i = 0; i < j->count; i++) {
        const cln_render_frame *f = &j->frames[i];
        const int64_t width = cln_render_width(j, f), pixels = width * f->camera.height;

        if (width > CLN_IMAGE_MAX_SIDE || pixels > CLN_IMAGE_MAX_PIXELS)
            return cln_fail(CLN_USAGE,
                            "--stereo: frame %s has %lld x %d pixels with both eyes, more than "
                            "the %d a side or %d in all that are possible; give less --width",
                            f->name, (long long)width, f->camera.height, CLN_IMAGE_MAX_SIDE,
                            CLN_IMAGE_MAX_PIXELS);
        if (normals && (size_t)pixels > CLN_NPY_MAX_BYTES / (3 * sizeof(float)))
            return cln_fail(CLN_USAGE,
                            "--normals: frame %s has %lld x %d pixels, whose normals are more "
                            "than the 2^31 bytes of a file; give less --width, or leave it out",
                            f->name, (long long)width, f->camera.height);
    }
    return CLN_OK;
}

/* Poses of another scene, or in other units, would give pictures of the background alone. A shell
 * is seen by all. */
static void warn_unseen(const cln_render_job *j)
{
    const cln_space *space = &j->opened.model.space;

    for (int i = 0; i < j->count; i++)
        if (cln_camera_sees(&j->frames[i].camera, space))
            return;
    cln_warn("%s: none of its poses (%d) looks at the run's cube, centre (%.9g, %.9g, %.9g), half "
             "side %.9g; are they of this scene, in its units and axes?",
             j->desc->poses, j->count, space->centre[0], space->centre[1], space->centre[2],
             space->half);
}

static void find_identity(const cln_render_job *j, cln_render_frame *f)
{
    const cln_model *model = &j->opened.model;
    const cln_camera *c = &f->camera;
    const double lengths[4] = {c->fx, c->fy, c->cx, c->cy};
    /* 0 is the mean, as in files from before there was a median; 1 was along the axis, with other
     * normals and edges */
    const int32_t kind = (j->desc->z_depth ? 2 : 0) | (j->desc->mean_depth ? 0 : 4);
    const int32_t numbers[4] = {c->width, c->height, (int32_t)c->lens, kind};
    uint64_t d = CLN_DIGEST_START;

    d = cln_digest(d, &j->model_digest, sizeof j->model_digest);
    d = cln_digest(d, model->background, sizeof model->background);
    d = cln_digest(d, numbers, sizeof numbers);
    d = cln_digest(d, c->c2w, sizeof c->c2w);
    d = cln_digest(d, lengths, sizeof lengths);
    d = cln_digest(d, c->distortion, sizeof c->distortion);
    if (j->antialias > 1)
        d = cln_digest(d, &j->antialias, sizeof j->antialias);
    if (j->desc->fast)
        d = cln_digest(d, "fast", 4);
    if (j->desc->depth_unit > 0)
        d = cln_digest(d, &j->desc->depth_unit, sizeof j->desc->depth_unit);
    if (j->crop.on)
        d = cln_digest(d, j->crop.box, sizeof j->crop.box);
    if (j->crop.on && (!j->desc->cropped || cln_crop_is_turned(&j->crop)))
        d = cln_digest(d, j->crop.turn, sizeof j->crop.turn);
    if (j->desc->transparent)
        d = cln_digest(d, "transparent", 11);
    if (j->desc->bits == 16)
        d = cln_digest(d, "bits16", 6);
    if (c->parallel) {
        d = cln_digest(d, "map", 3);
        d = cln_digest(d, j->desc->offset, sizeof j->desc->offset);
        d = cln_digest(d, &j->desc->seen, sizeof j->desc->seen); /* which heights are known */
    }
    if (j->desc->stereo > 0) {
        d = cln_digest(d, "stereo", 6);
        d = cln_digest(d, &j->desc->stereo, sizeof j->desc->stereo);
    }
    cln_digest_text(d, f->made_from);
}

/* Checks what all ranks must have in common; if it differed, they would wait for each other
 * forever. */
static cln_status check_ranks(const cln_render_job *j)
{
    uint64_t d = CLN_DIGEST_START;

    for (int i = 0; i < j->count; i++)
        d = cln_digest(d, j->frames[i].made_from, sizeof j->frames[i].made_from);
    return cln_ranks_agree(d, "checkpoint or choice of frames");
}

/* Tells all ranks which frames rank 0 found in the folder; these are kept. */
static cln_status tell_there(cln_render_job *j)
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

/* ---- the work ---- */

static cln_status start(cln_render_job *j)
{
    cln_status st = CLN_OK;
    cln_open_run *v = &j->opened;
    const cln_camera **cameras = NULL;
    const int each = cln_render_eyes(j);
    unsigned lenses = 0;

    for (int i = 0; i < j->seen.count; i++) {
        const cln_camera *c = &j->seen.cameras[i];

        lenses |= cln_camera_lenses(c);
        v->view_pixels = fmax(v->view_pixels, (double)c->width * c->height);
    }
    CLN_TRY(cln_alloc(&cameras, (size_t)(j->count * each), sizeof *cameras, "cameras"));
    for (int i = 0; i < j->count * each; i++) {
        cameras[i] = &j->eyes[i];
        lenses |= cln_camera_lenses(cameras[i]);
    }
    for (int i = 0; i < j->count; i++) {
        const cln_camera *c = &j->frames[i].camera;
        const double pixels = (double)c->width * c->height;

        v->view_pixels = fmax(v->view_pixels, j->antialias * j->antialias * pixels);
        v->picture_pixels = fmax(v->picture_pixels, each * pixels);
    }
    v->fast = j->desc->fast;
    CLN_TRY(cln_open_run_start(v, &j->desc->device, lenses));
    if (j->desc->seen)
        CLN_TRY(cln_seen_make(v, &j->desc->callbacks, &j->seen));
    v->pipeline.antialias = j->antialias;
    CLN_TRY(cln_crop_use(&v->pipeline, &v->model.space, &j->crop));
    CLN_TRY(cln_pipeline_cameras(&v->pipeline, cameras, j->count * each, &v->model.space));
    CLN_TRY(cln_render_prepare(&v->pipeline));
done:
    free(cameras);
    return st;
}

/* Copies `part` to columns [at, at + width) of `whole`, which has `of` columns; a pixel has
 * `channels` floats. */
static void put_beside(const float *part, int width, int height, int channels, int at, int of,
                       float *whole)
{
    for (int y = 0; y < height; y++)
        memcpy(whole + ((size_t)y * (size_t)of + (size_t)at) * (size_t)channels,
               part + (size_t)y * (size_t)width * (size_t)channels,
               (size_t)width * (size_t)channels * sizeof *part);
}

/* Renders an eye's picture, its depths in scene units. normals: NULL or [height][width][3]. */
static cln_status render_eye(cln_render_job *j, int eye, float *normals, cln_picture *out)
{
    cln_status st = CLN_OK;
    const cln_camera *camera = &j->eyes[eye];

    CLN_TRY((j->desc->map ? cln_render_large : cln_render_view)(
        &j->opened.pipeline, eye, j->opened.model.background,
        j->desc->mean_depth ? CLN_DEPTH_MEAN : CLN_DEPTH_MEDIAN, &j->desc->callbacks, out));
    cln_picture_to_scene(&j->opened.model.space, out);
    if (j->desc->seen)
        CLN_TRY(cln_seen_picture(&j->seen, camera, out));
    if (j->desc->transparent)
        cln_picture_straight(j->opened.model.background, out);
    if (normals)
        cln_normals_of_depth(camera, out->depth, out->opacity, normals);
    if (j->desc->z_depth) /* after all that depths along the ray decide */
        cln_picture_along_axis(camera, out);
done:
    return st;
}

/* Renders a frame's picture, two eyes side by side. *normals is set if they are wanted; the caller
 * frees it. */
static cln_status render_frame(cln_render_job *j, int i, cln_picture *out, float **normals)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &j->frames[i].camera;
    const int each = cln_render_eyes(j), width = c->width, height = c->height,
              of = cln_render_width(j, &j->frames[i]);
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
    if (j->desc->seen)
        CLN_TRY(cln_alloc(&out->seen, 2 * n, sizeof *out->seen, "picture"));
    for (int e = 0; e < each; e++) {
        CLN_TRY(render_eye(j, i * each + e, own, &eye));
        put_beside(eye.rgb, width, height, 3, e * width, of, out->rgb);
        put_beside(eye.depth, width, height, 1, e * width, of, out->depth);
        put_beside(eye.opacity, width, height, 1, e * width, of, out->opacity);
        for (int y = 0; y < height && eye.seen; y++)
            memcpy(out->seen + (size_t)y * (size_t)of + (size_t)(e * width),
                   eye.seen + (size_t)y * (size_t)width, (size_t)width);
        if (own)
            put_beside(own, width, height, 3, e * width, of, *normals);
        cln_picture_free(&eye);
    }
done:
    cln_picture_free(&eye);
    free(own);
    return st;
}

/* What the device's time of all frames was spent on. */
static void tell_stages(const cln_device *device, bool voxels)
{
    char text[1024] = "";
    size_t used = 0;

    for (int i = 0; i < CLN_STAGES; i++)
        if (device->stage_seconds[i] > 0 && used < sizeof text)
            used += (size_t)snprintf(
                text + used, sizeof text - used, "%s%s %.3f", used > 0 ? ", " : "",
                cln_stage_text(cln_stage_names[i], voxels), device->stage_seconds[i]);
    cln_debug("seconds of the device: %s", text);
}

static int by_picture(const void *a, const void *b)
{
    const cln_render_frame *const *one = a, *const *other = b;
    const int order = strcmp((*one)->made_from, (*other)->made_from);

    return order != 0 ? order : (*one > *other) - (*one < *other);
}

/* Joins the frames to be made that are made from the same; of a film, which keeps their pictures,
 * as many as may be kept. */
static cln_status find_doubles(cln_render_job *j)
{
    cln_status st = CLN_OK;
    const double pixel = !cln_film_named(j->desc->out) ? 0 : j->desc->transparent ? 4 : 3;
    cln_render_frame **sorted = NULL;
    double kept = 0;
    int count = 0;

    CLN_TRY(cln_alloc(&sorted, (size_t)j->count, sizeof(cln_render_frame *), "frames"));
    for (int i = 0; i < j->count; i++) {
        j->frames[i].first = i;
        j->frames[i].next = -1;
        if (!j->frames[i].there)
            sorted[count++] = &j->frames[i];
    }
    qsort(sorted, (size_t)count, sizeof(cln_render_frame *), by_picture);
    for (int k = 1; k < count; k++) {
        cln_render_frame *before = sorted[k - 1], *f = sorted[k];
        const double bytes = pixel * cln_render_width(j, f) * f->camera.height;

        if (strcmp(before->made_from, f->made_from) != 0)
            continue;
        if (before->first == before - j->frames) {
            if (kept + bytes > MOST_KEPT)
                continue;
            kept += bytes;
        }
        f->first = before->first;
        before->next = (int)(f - j->frames);
    }
done:
    free(sorted);
    return st;
}

/* Notes what of a picture training views see for all frames that have it. Returns their count. */
static int share_seen(cln_render_job *j, int frame, const cln_picture *picture)
{
    int count = 0;

    for (int i = frame; i >= 0; i = j->frames[i].next) {
        if (picture->seen)
            j->frames[i].seen = cln_seen_share(picture);
        count++;
    }
    return count;
}

/* Renders all frames but those that are kept. film: gets the pictures instead of files, or NULL. */
static cln_status render_frames(cln_render_job *j, cln_film *film, cln_render_result *result)
{
    cln_status st = CLN_OK, written = CLN_OK;
    const cln_callbacks *callbacks = &j->desc->callbacks;
    const double began = cln_now();
    const bool of_film = cln_film_named(j->desc->out);
    cln_frame_writer writer = {0};
    cln_picture picture = {0};
    float *normals = NULL;
    int begun = 0, done = 0;

    CLN_TRY(cln_frame_writer_begin(j, film, &writer));
    CLN_TRY(find_doubles(j));
    for (int i = 0; i < j->count; i++) {
        const bool again = j->frames[i].first != i;
        int frames = 0;

        if (j->frames[i].there || (again && !of_film))
            continue;
        cln_show_work(callbacks, "render", result->skipped + begun, j->count);
        if (!again)
            CLN_TRY(render_frame(j, i, &picture, &normals));
        CLN_TRY(cln_frame_writer_wait(&writer, &done));
        result->rendered += done;
        frames = share_seen(j, i, &picture);
        if (of_film)
            frames = 1;
        begun += frames;
        if (again && film)
            CLN_TRY(cln_frame_writer_again(&writer, i));
        if (!again && (film || j->writes)) {
            cln_frame_writer_give(&writer, i, &picture, &normals);
            continue;
        }
        cln_picture_free(&picture);
        free(normals);
        normals = NULL;
        result->rendered += frames;
    }
done:
    written = cln_frame_writer_wait(&writer, &done);
    cln_frame_writer_release(&writer);
    result->rendered += done;
    result->seconds += cln_now() - began;
    if ((st == CLN_SIGINT || st == CLN_SIGTERM) && film)
        cln_note("rendering %s: %d of %d frames were done; a film is made anew each time",
                 j->desc->out, result->rendered, j->count);
    else if (st == CLN_SIGINT || st == CLN_SIGTERM)
        cln_note(
            "rendering into %s: %d of %d frames are there, the same command %srenders the others",
            j->desc->out, result->skipped + result->rendered, j->count,
            j->desc->overwrite ? "without --overwrite " : "");
    if (st == CLN_OK)
        st = written;
    if (st == CLN_OK) {
        cln_show_work(callbacks, "render", j->count, j->count);
        tell_stages(j->opened.device, j->opened.model.config.encoding == CLN_ENCODING_VOXEL);
    }
    cln_picture_free(&picture);
    free(normals);
    return st;
}

static cln_status render_film(cln_render_job *j, cln_render_result *result)
{
    cln_status st = CLN_OK;
    const cln_camera *first = &j->frames[0].camera;
    const double told = j->desc->fps > 0 ? j->desc->fps : j->cameras.fps;
    const cln_film_form form = {.width = cln_render_width(j, &j->frames[0]),
                                .height = first->height,
                                .frames = j->count,
                                .fps = told > 0 ? told : 24,
                                .alpha = j->desc->transparent,
                                .overwrite = j->desc->overwrite};
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
    CLN_TRY(check_sizes(j));
    if (j->writes)
        CLN_TRY(cln_film_begin(j->desc->out, &form, &film));
    if (film && cln_film_is_plain(film))
        CLN_TRY(cln_disk_check_file(cln_film_path(film), 3.0 * form.width * form.height * j->count,
                                    "uncompressed frames"));
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

/* Means over the frames that show something, kept ones too; names the one that shows most that no
 * training view sees. */
static void sum_up_seen(const cln_render_job *j, cln_render_result *result)
{
    const cln_render_frame *most = NULL;
    double none = 0, few = 0;
    int count = 0;

    for (int i = 0; i < j->count; i++) {
        const cln_seen_shares *seen = &j->frames[i].seen;

        if (isnan(seen->none))
            continue;
        none += seen->none;
        few += seen->few;
        count++;
        if (!most || seen->none > most->seen.none)
            most = &j->frames[i];
    }
    if (!count)
        return;
    result->unseen = none / count;
    result->hardly_seen = few / count;
    if (count > 1 && most->seen.none > 0.01)
        cln_info("%s: the frame with most that no training view sees is %s (%.3g %%)", j->desc->out,
                 most->name, 100 * most->seen.none);
}

/* Refuses what would change nothing; not orbit_elevation and orbit_radius, which callers have set
 * where they are not used. */
static cln_status check_unused(const cln_render_desc *d)
{
    const bool keys = d->poses || d->split, path = !keys && !d->map;
    const char *source = d->spiral_frames > 0 ? "spiral" : "orbit";

    if (d->map && (d->max_images || d->first_frame || d->frame_count))
        return cln_fail(CLN_USAGE, "--%s cannot be combined with --map, which is one picture",
                        d->max_images ? "max-images" : "frames");
    if (path && d->max_images)
        return cln_fail(CLN_USAGE, "--max-images cannot be combined with --%s; give --%s N", source,
                        source);
    if (path && d->interpolate)
        return cln_fail(CLN_USAGE,
                        "--interpolate cannot be combined with --%s; give --split or --poses",
                        source);
    if (d->loop && !d->interpolate)
        return cln_fail(CLN_USAGE, "--loop requires --interpolate%s",
                        path ? "; an orbit or spiral is closed as it is" : "");
    if (d->fov > 0 && !path && !d->interpolate)
        return cln_fail(CLN_USAGE, "--fov requires --orbit, --spiral or --interpolate");
    if (cln_up_given(d->up) && keys && !d->interpolate)
        return cln_fail(CLN_USAGE, "--up requires --orbit, --spiral, --map or --interpolate");
    if (d->orbit_circle && (!path || d->spiral_frames > 0))
        return cln_fail(CLN_USAGE, "--circle requires --orbit");
    if (d->fps > 0 && !cln_film_named(d->out))
        return cln_fail(CLN_USAGE, "--fps requires a film: -o FILE.mp4");
    return CLN_OK;
}

static cln_status check_given(const cln_render_desc *d)
{
    cln_status st = CLN_OK;
    const struct {
        const char *what;
        double value, least, most; /* as of the command's options */
    } rows[] = {
        {"spiral_frames", d->spiral_frames, 0, 100000},
        {"orbit_frames", d->orbit_frames, 0, 100000},
        {"orbit_elevation", isnan(d->orbit_elevation) ? 0 : d->orbit_elevation, -90, 90},
        {"orbit_radius", d->orbit_radius, 0, 1e3},
        {"interpolate", d->interpolate, 0, 100000},
        {"width", d->width, 0, 32768},
        {"height", d->height, 0, 32768},
        {"fov", d->fov, 0, 175},
        {"max_images", d->max_images, 0, INT_MAX},
        {"antialias", d->antialias, 0, 8},
        {"first_frame", d->first_frame, 0, INT_MAX},
        {"frame_count", d->frame_count, 0, INT_MAX},
        {"stereo", d->stereo, 0, 1e12},
        {"fps", d->fps, 0, 1000},
        {"depth_unit", d->depth_unit, 0, 1e12},
        {"bits", d->bits, 0, 16},
        {"spacing", d->spacing, 0, 1e12},
    };

    CLN_TRY(cln_given("cln_render", "run", d->run));
    CLN_TRY(cln_given("cln_render", "out", d->out));
    CLN_TRY(cln_up_check("cln_render", d->up));
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
        CLN_TRY(cln_given_number("cln_render", rows[i].what, rows[i].value, rows[i].least,
                                 rows[i].most));
    if (d->views && (!d->split || d->poses))
        CLN_TRY(
            cln_fail(CLN_USAGE, "--views: names views of a split; give it, without other poses"));
    CLN_TRY(cln_views_check(d->views, d->max_images));
    if (d->bits != 0 && d->bits != 8 && d->bits != 16)
        CLN_TRY(cln_fail(CLN_USAGE, "cln_render: bits: %d is neither 8 nor 16", d->bits));
    if (d->transparent && cln_film_named(d->out) && !cln_film_takes_alpha(d->out))
        CLN_TRY(cln_fail(CLN_USAGE, CLN_FILM_NO_ALPHA, d->out));
    for (int c = 0; c < 3 && d->background; c++)
        CLN_TRY(cln_given_number("cln_render", "background", (double)d->background[c], 0, 1));
    if (d->fps > 0 && d->fps < CLN_FILM_LEAST_FPS)
        CLN_TRY(
            cln_fail(CLN_USAGE, "fps is %g; give %g or more, or 0", d->fps, CLN_FILM_LEAST_FPS));
    if (!d->poses && !d->split && d->spiral_frames == 0 && d->orbit_frames == 0 && !d->map)
        CLN_TRY(cln_fail(CLN_USAGE, "cln_render: it is not said which poses; give poses, split, "
                                    "spiral_frames, orbit_frames or map"));
    if (d->map && (d->poses || d->split || d->spiral_frames || d->orbit_frames || d->interpolate))
        CLN_TRY(cln_fail(CLN_USAGE, "--map is a picture from above; give no other poses"));
    if (d->map && (d->width || d->height))
        CLN_TRY(cln_fail(CLN_USAGE, "--map: give the size of its pixels by --spacing, in place of "
                                    "--width or --height"));
    if (d->seen && d->mean_depth)
        CLN_TRY(cln_fail(CLN_USAGE, "--seen asks which views see a surface, and --depth mean is "
                                    "between surfaces at edges; leave one of the two out"));
    if (d->map && d->stereo > 0)
        CLN_TRY(cln_fail(CLN_USAGE, "--map: its rays are parallel, so both eyes of --stereo would "
                                    "see the same; leave --stereo out"));
    if (d->map && cln_film_named(d->out))
        CLN_TRY(cln_fail(CLN_USAGE, "--map: %s is a film, and a map is one picture; give a folder",
                         d->out));
    for (int a = 0; a < 3; a++)
        CLN_TRY(cln_given_number("cln_render", "offset", d->offset[a], -1e12, 1e12));
    if (!d->map && (d->spacing > 0 || d->offset[0] || d->offset[1] || d->offset[2]))
        CLN_TRY(cln_fail(CLN_USAGE, "--%s requires --map", d->spacing > 0 ? "spacing" : "offset"));
    CLN_TRY(check_unused(d));
done:
    return st;
}

/* Without --crop, that of the file of poses, with its background; a background that is given counts
 * more. */
static void choose_crop(cln_render_job *j)
{
    const cln_render_desc *desc = j->desc;
    cln_model *model = &j->opened.model;

    if (!desc->cropped && j->cameras.crop.on) {
        j->crop = j->cameras.crop;
        memcpy(model->background, j->cameras.crop_background, sizeof model->background);
        cln_info("%s: only what is in its crop box is shown, on its background colour; --crop "
                 "gives another box",
                 desc->poses);
    }
    if (desc->background)
        memcpy(model->background, desc->background, sizeof model->background);
    if (j->crop.on)
        cln_crop_warn(desc->cropped ? "--crop"
                      : desc->map   ? "--map"
                                    : desc->poses,
                      &model->space, &model->tree, &j->crop);
}

/* A map's up: the one given, else what map.h makes of the training cameras'. */
static void map_up(const cln_render_job *j, double up[3])
{
    cln_orbit_frame seen;
    const bool known = cln_orbit_frame_read(json_object_get(j->run, "orbit"), &seen) == CLN_OK;

    if (!known)
        cln_clear_error(); /* of an older run */
    memcpy(up, j->desc->up, 3 * sizeof *up);
    if (!cln_up_given(up))
        cln_map_up(known ? &seen : NULL, up);
}

/* The map's camera. */
static cln_status make_map(cln_render_job *j)
{
    cln_status st = CLN_OK;
    const cln_space *space = &j->opened.model.space;
    cln_camera *c = NULL;
    double up[3], axes[9], corner[3], box[6];

    CLN_TRY(cln_frames_room(1, &j->cameras));
    j->cameras.poses = "map";
    c = &j->cameras.frame[0].camera;
    map_up(j, up);
    cln_map_axes(up, axes);
    for (int i = 0; i < 6; i++)
        box[i] = space->centre[i % 3] + (i < 3 ? -space->half : space->half);
    if (space->shell && !j->crop.on) /* what lies beyond the cube is no part of the map */
        CLN_TRY(cln_crop_set("--map", box, (const double[3]){0}, &j->crop));
    CLN_TRY(cln_map_camera(space, &j->crop, axes, j->desc->spacing, c));
    CLN_TRY(cln_strdup(&j->cameras.frame[0].name, "map"));
    cln_map_corner(c, j->desc->offset, corner);
    cln_info("map: %d x %d pixels of %.9g; x from %.9g to %.9g, y from %.9g to %.9g, from height "
             "%.9g down",
             c->width, c->height, 1 / c->fx, corner[0], corner[0] + c->width / c->fx,
             corner[1] - c->height / c->fx, corner[1], corner[2]);
done:
    return st;
}

/* Renders what is not in the folder yet. */
static cln_status render_folder(cln_render_job *j, cln_render_result *result)
{
    cln_status st = CLN_OK;
    int told = 0; /* frames of earlier renders, by render.json */
    cln_render_hold hold = {.lock = -1};

    CLN_TRY(check_sizes(j));
    if (j->writes) {
        CLN_TRY(cln_render_check_folder(j->desc->out, &j->before));
        CLN_TRY(cln_render_hold_folder(j->desc->out, &hold));
        json_decref(j->before); /* as another process may have left it just now */
        j->before = NULL;
        CLN_TRY(cln_render_check_folder(j->desc->out, &j->before));
        told = (int)json_integer_value(json_object_get(j->before, "earlier_frames"));
        CLN_TRY(cln_render_find_there(j));
        CLN_TRY(cln_render_refuse_others(j));
        CLN_TRY(cln_render_check_disk(j));
    }
    CLN_TRY(tell_there(j));
    result->skipped = j->there;
    if (j->there < j->count) {
        CLN_TRY(start(j));
        if (j->writes) {
            CLN_TRY(cln_render_drop_stale(j));
            CLN_TRY(cln_render_write_about(j, NULL));
        }
        CLN_TRY(render_frames(j, NULL, result));
    }
    if (j->writes && (j->there < j->count || j->pictured < j->count))
        CLN_TRY(cln_render_draw_depths(j));
    else if (j->writes && j->earlier != told)
        CLN_TRY(cln_render_write_about(j, NULL));
done:
    cln_render_release_folder(j->desc->out, &hold);
    return st;
}

/* Opens the cameras, of the scene or as the run keeps them. If there are none and only --up asked
 * for them, the orbit in run.json is enough. */
static cln_status open_cameras(cln_render_job *j)
{
    const cln_render_desc *desc = j->desc;
    bool alike = false;
    cln_status st =
        cln_open_run_cameras(desc->run, desc->scene, &desc->callbacks, &alike, &j->opened);

    if (st != CLN_INPUT || !alike || desc->seen || !cln_frames_have_orbit(desc, j->run))
        return st;
    cln_clear_error();
    return cln_open_run_model(desc->run, &j->opened);
}

cln_status cln_render(const cln_render_desc *desc, cln_render_result *result)
{
    cln_status st = CLN_OK;
    cln_render_job j = {.desc = desc, .writes = cln_ranks_me() == 0};

    cln_clear_error();
    CLN_TRY(cln_given("cln_render", "result", result));
    *result = (cln_render_result){.unseen = NAN, .hardly_seen = NAN};
    CLN_TRY(cln_given("cln_render", "desc", desc));
    CLN_TRY(check_given(desc));
    CLN_TRY(cln_crop_of_desc(desc->cropped, desc->crop, desc->crop_turn, &j.crop));
    CLN_TRY(cln_reader_run(desc->run, &j.run));
    CLN_TRY(cln_device_check(&desc->device));
    if (desc->seen || (!desc->map && cln_frames_need_scene(desc, j.run)))
        CLN_TRY(open_cameras(&j));
    else
        CLN_TRY(cln_open_run_model(desc->run, &j.opened));
    CLN_TRY(desc->map ? make_map(&j) : cln_frames_make(desc, j.opened.scene, j.run, &j.cameras));
    choose_crop(&j);
    CLN_TRY(list_frames(&j));
    CLN_TRY(place_eyes(&j));
    j.model_digest = cln_model_digest(&j.opened.model);
    j.antialias = cln_open_run_antialias(&j.opened, desc->antialias);
    for (int i = 0; i < j.count; i++)
        find_identity(&j, &j.frames[i]);
    if (desc->seen) {
        CLN_TRY(cln_seen_choose(j.opened.scene, &j.seen));
        cln_digest_text(cln_seen_digest(&j.seen), j.seen_by);
    }
    if (desc->poses)
        warn_unseen(&j);
    CLN_TRY(check_ranks(&j));
    CLN_TRY(cln_film_named(desc->out) ? render_film(&j, result) : render_folder(&j, result));
    sum_up_seen(&j, result);
done:
    cln_seen_free(&j.seen);
    free(j.frames);
    free(j.eyes);
    cln_frames_free(&j.cameras);
    json_decref(j.run);
    json_decref(j.before);
    cln_open_run_close(&j.opened);
    return st;
}
