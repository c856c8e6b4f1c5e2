/* Makes frames in the way that is asked for. See frames.h. */
#include "render/frames.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "render/named.h"
#include "render/open_run.h"
#include "render/recorded.h"

static const double BELOW = -30; /* degrees: few cameras look up so steeply */

cln_status cln_frames_room(int count, cln_frames *out)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&out->frame, (size_t)count, sizeof *out->frame, "frames"));
    out->count = count;
done:
    return st;
}

void cln_frames_free(cln_frames *frames)
{
    for (int i = 0; i < frames->count; i++)
        free(frames->frame[i].name);
    free(frames->frame);
    memset(frames, 0, sizeof *frames);
}

/* Without a split, a file of poses or a spiral, frames are an orbit. */
static bool is_orbit(const cln_render_desc *desc)
{
    return !desc->split && !desc->poses && desc->spiral_frames == 0;
}

bool cln_frames_have_orbit(const cln_render_desc *desc, const json_t *run)
{
    return !desc->split && !desc->scene && desc->spiral_frames == 0 &&
           json_object_get(run, "orbit");
}

bool cln_frames_need_scene(const cln_render_desc *desc, const json_t *run)
{
    return cln_up_given(desc->up) || !cln_frames_have_orbit(desc, run);
}

static cln_status of_split(const cln_render_desc *desc, const cln_scene *scene, cln_frames *out)
{
    cln_status st = CLN_OK;
    cln_split split = CLN_SPLIT_TEST;
    int *views = NULL, count = 0;

    CLN_TRY(cln_open_run_split(scene, desc->split, false, &split));
    CLN_TRY(cln_views_choose(scene, split, desc->views, desc->max_images, &views, &count));
    CLN_TRY(cln_frames_room(count, out));
    for (int i = 0; i < count; i++) {
        out->frame[i].camera = scene->views[views[i]].camera;
        if (desc->interpolate > 0) /* keys of a free camera, which does not lie on its side */
            cln_view_seen(&scene->views[views[i]], &out->frame[i].camera);
        CLN_TRY(cln_strdup(&out->frame[i].name, scene->views[views[i]].file));
    }
done:
    free(views);
    return st;
}

cln_status cln_frames_transforms(const char *run, const char *scene, const char *dialect,
                                 char **path, bool *gone)
{
    cln_status st = CLN_OK;

    *path = NULL;
    *gone = false;
    if (!dialect || (strcmp(dialect, "nerfstudio") != 0 && strcmp(dialect, "instant-ngp") != 0))
        return CLN_OK;
    if (scene)
        return cln_strdup(path, scene);
    st = cln_recorded_scene(run, path);
    if (st != CLN_INPUT)
        return st;
    cln_clear_error();
    *gone = true;
    return CLN_OK;
}

/* That of the scene that was read (NULL: none), or of the run. */
static cln_status find_transforms(const cln_render_desc *desc, const cln_scene *scene,
                                  const json_t *run, char **path)
{
    cln_status st = CLN_OK;
    const char *own =
        json_string_value(json_object_get(json_object_get(run, "dataset"), "dialect"));
    bool gone = false;

    CLN_TRY(cln_frames_transforms(desc->run, desc->scene,
                                  desc->scene && scene ? scene->dialect : own, path, &gone));
    if (gone)
        cln_warn("--poses: the scene is not there, so whether its transforms.json has an "
                 "applied_transform, which nerfstudio's frame does not count, is not known");
done:
    return st;
}

/* Where the scene was not read (NULL), sizes are those that the run keeps. */
static cln_status find_sizes(const cln_render_desc *desc, const cln_scene *scene, const json_t *run,
                             const cln_orbit_frame *seen, cln_frame_sizes *out)
{
    cln_status st = CLN_OK;
    const json_t *dataset = json_object_get(run, "dataset");
    const int divided = (int)json_integer_value(json_object_get(dataset, "downscale"));
    cln_scene *kept = NULL;
    const cln_view *first = NULL;

    *out = (cln_frame_sizes){.width = seen->width, .height = seen->height};
    if (!scene)
        st = cln_recorded_cameras(desc->run, &kept);
    if (st == CLN_INPUT) { /* an older run: all but the pixels that the division left over */
        cln_clear_error();
        out->file_width = seen->width * (divided > 1 ? divided : 1);
        out->file_height = seen->height * (divided > 1 ? divided : 1);
        return CLN_OK;
    }
    CLN_TRY(st);
    scene = scene ? scene : kept;
    first = cln_scene_training_view(scene, 0);
    out->file_width = first->file_width;
    out->file_height = first->file_height;
    for (int i = 0; i < scene->view_count; i++)
        out->vary |= scene->views[i].file_width != first->file_width ||
                     scene->views[i].file_height != first->file_height;
done:
    cln_scene_free(kept);
    return st;
}

/* The poses of a file, or max_images of them, evenly chosen. */
static cln_status of_file(const cln_render_desc *desc, const cln_scene *scene, const json_t *run,
                          const cln_orbit_frame *seen, cln_frames *out)
{
    cln_status st = CLN_OK;
    char *transforms = NULL, *dataparser = NULL;
    cln_frame_sizes sizes;
    int kept = 0;

    CLN_TRY(find_sizes(desc, scene, run, seen, &sizes));
    CLN_TRY(cln_frames_read(desc->poses, &sizes, out));
    if (out->foreign)
        CLN_TRY(cln_frames_dataparser(desc->poses, &dataparser));
    if (dataparser) {
        CLN_TRY(find_transforms(desc, scene, run, &transforms));
        CLN_TRY(cln_frames_from_nerfstudio(dataparser, desc->poses, transforms, out));
    }
    if (desc->max_images <= 0 || desc->max_images >= out->count)
        goto done;
    for (int i = 0; i < out->count; i++) {
        cln_frame *f = &out->frame[i];

        if (kept < desc->max_images && i == (int)((int64_t)kept * out->count / desc->max_images)) {
            const cln_frame chosen = *f;

            f->name = NULL;
            out->frame[kept++] = chosen;
        } else {
            free(f->name);
            f->name = NULL;
        }
    }
    out->count = kept;
done:
    free(transforms);
    free(dataparser);
    return st;
}

/* What run.json keeps, with a word where its up may point down, as older versions had it of flights
 * that look down. */
static cln_status read_frame(const cln_render_desc *desc, const json_t *saved,
                             cln_orbit_frame *seen)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_orbit_frame_read(saved, seen));
    if (is_orbit(desc) && !cln_up_given(desc->up) && seen->elevation < BELOW)
        cln_warn("by the run's own frame, its cameras stand %.0f degrees below what they look at: "
                 "if the pictures are upside down, say which way is up, as in --up z",
                 -seen->elevation);
    cln_orbit_frame_turn(desc->up, seen);
done:
    return st;
}

static cln_status of_orbit(const cln_render_desc *desc, const cln_orbit_frame *seen,
                           cln_frames *out)
{
    cln_status st = CLN_OK;
    const int count = desc->orbit_frames;
    cln_orbit orbit;

    if (count < 1)
        CLN_TRY(cln_fail(CLN_USAGE, "--orbit: %d frames are too few; give 1 or more", count));
    if (seen->guessed)
        cln_up_warn("the orbit", seen->up);
    CLN_TRY(cln_orbit_make(seen, desc, &orbit));
    if (!orbit.circle && count > 2)
        cln_info(
            "orbit: to and fro in an arc of %.0f degrees, where the training cameras stand, so "
            "most frames come twice (and are rendered once); --circle goes around",
            2 * orbit.swing * 180 / M_PI);
    CLN_TRY(cln_frames_room(count, out));
    for (int i = 0; i < count; i++) {
        cln_orbit_camera(&orbit, i, count, &out->frame[i].camera);
        CLN_TRY(cln_asprintf(&out->frame[i].name, "orbit_%04d", i));
    }
done:
    return st;
}

/* Are most training photos panoramas? */
static bool shows_all_around(const cln_scene *scene)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    int spheres = 0;

    for (int i = 0; i < count; i++)
        spheres += cln_scene_training_view(scene, i)->camera.lens == CLN_LENS_EQUIRECTANGULAR;
    return 2 * spheres > count;
}

/* Around what they look at, or about their middle, cameras along a path leave it: what was filmed
 * within walls would be seen from behind them. Panoramas look at nothing. */
static void warn_of_path(const cln_render_desc *desc, const cln_scene *scene)
{
    const char *way = is_orbit(desc) ? "orbit" : "spiral";
    cln_scene *kept = NULL;

    if (!scene && desc->run && cln_recorded_cameras(desc->run, &kept) != CLN_OK)
        cln_clear_error(); /* a sentence less */
    scene = scene ? scene : kept;
    if (scene && shows_all_around(scene))
        cln_warn("--%s: the training photos are panoramas, which show what is around them, not "
                 "what is in their midst; this leads about the midst, maybe through walls. A film "
                 "from place to place: --split train --interpolate 300 --fov 90",
                 way);
    else if (scene && cln_scene_is_path(scene))
        cln_warn("--%s: the training cameras stand along a path and look along it; this leaves it, "
                 "to where no photo was taken, maybe behind walls. A film along the path: --split "
                 "train --interpolate",
                 way);
    cln_scene_free(kept);
}

/* Does another size stretch a whole sphere, which is neither 2 : 1 then nor of the shape that it
 * had, to a pixel? */
static bool is_stretched(const cln_camera *own, const cln_camera *resized)
{
    const double height = (double)resized->width * own->height / own->width;

    return cln_camera_spans_sphere(own) && fabs(resized->height - height) > 1 &&
           fabs(resized->height - 0.5 * resized->width) > 1;
}

/* Gives the frames desc's width and height. */
static cln_status resize(const cln_render_desc *desc, cln_frames *frames)
{
    cln_status st = CLN_OK;
    int stretched = 0;

    for (int i = 0; i < frames->count; i++) {
        const cln_camera own = frames->frame[i].camera;

        CLN_TRY(cln_orbit_resize(&own, desc->width, desc->height, &frames->frame[i].camera));
        stretched += is_stretched(&own, &frames->frame[i].camera);
    }
    if (stretched > 0 && !(desc->fov > 0)) /* which makes plain pictures of them */
        cln_warn("--width, --height: %d %s, of another shape than %d x %d, to which the whole "
                 "sphere is stretched; give one of the two alone or, for plain pictures of a part "
                 "of it, %s--fov 90",
                 stretched, cln_plural(stretched, "pose is a panorama's", "poses are panoramas'"),
                 desc->width, desc->height, desc->interpolate > 0 ? "" : "--interpolate FRAMES ");
done:
    return st;
}

/* Leaves desc's range of the frames. */
static cln_status cut(const cln_render_desc *desc, cln_frames *frames)
{
    const int all = frames->count, first = desc->first_frame;
    const int count = desc->frame_count > 0 ? desc->frame_count : all - first;

    if (first >= all || count > all - first)
        return cln_fail(CLN_USAGE, "--frames: there are %d, numbered from 0 to %d%s", all, all - 1,
                        desc->orbit_frames > 0    ? "; for another number of them: --orbit N"
                        : desc->spiral_frames > 0 ? "; for another number of them: --spiral N"
                                                  : "");
    if (count == 1 && first > 1 && desc->orbit_frames + desc->spiral_frames > 0)
        cln_info("--frames %d: picture number %d alone; for %d pictures: --%s %d", first, first,
                 first, desc->orbit_frames > 0 ? "orbit" : "spiral", first);
    for (int i = 0; i < all; i++) {
        const cln_frame frame = frames->frame[i];

        frames->frame[i].name = NULL;
        if (i >= first && i < first + count)
            frames->frame[i - first] = frame;
        else
            free(frame.name);
    }
    frames->count = count;
    return CLN_OK;
}

/* Makes pinholes of this horizontal field of view of them. */
static void take_fov(double fov, cln_frames *frames)
{
    for (int i = 0; i < frames->count; i++) {
        cln_camera *c = &frames->frame[i].camera;

        c->lens = CLN_LENS_OPENCV;
        memset(c->distortion, 0, sizeof c->distortion);
        c->fx = c->fy = 0.5 * c->width / tan(fov * M_PI / 360);
        c->cx = 0.5 * c->width;
        c->cy = 0.5 * c->height;
    }
}

cln_status cln_frames_make(const cln_render_desc *desc, const cln_scene *scene, const json_t *run,
                           cln_frames *out)
{
    cln_status st = CLN_OK;
    cln_orbit_frame seen;
    cln_frames keys = {0};

    memset(out, 0, sizeof *out);
    if (scene)
        CLN_TRY(cln_orbit_frame_of(scene, desc->up, &seen));
    else
        CLN_TRY(read_frame(desc, json_object_get(run, "orbit"), &seen));
    if (desc->poses)
        CLN_TRY(of_file(desc, scene, run, &seen, out));
    else if (desc->split)
        CLN_TRY(of_split(desc, scene, out));
    else if (desc->spiral_frames > 0)
        CLN_TRY(cln_frames_spiral(scene, desc, out));
    else
        CLN_TRY(of_orbit(desc, &seen, out));
    if (desc->poses || desc->split)
        CLN_TRY(resize(desc, out));
    else
        warn_of_path(desc, scene);
    out->poses = desc->poses      ? "file"
                 : desc->split    ? desc->split
                 : is_orbit(desc) ? "orbit"
                                  : "spiral";
    if (desc->interpolate > 0) {
        keys = *out;
        memset(out, 0, sizeof *out);
        CLN_TRY(cln_frames_through(&keys, desc->interpolate,
                                   seen.to - seen.from >= 360 ? &seen : NULL, seen.up, desc->loop,
                                   out));
        if (desc->fov > 0)
            take_fov(desc->fov, out);
        out->poses = "path";
        out->fps = keys.fps;
        out->crop = keys.crop;
        memcpy(out->crop_background, keys.crop_background, sizeof out->crop_background);
    }
    CLN_TRY(cut(desc, out));
done:
    cln_frames_free(&keys);
    return st;
}
