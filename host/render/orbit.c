/* The geometry of `render --orbit`. See orbit.h; the rendering is api/render.c's. */
#include "render/orbit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "io/image.h"
#include "scene/vectors.h"

static const double PI = 3.14159265358979323846, DEGREE = 3.14159265358979323846 / 180;
static const double POLE = 80;    /* degrees: above, an azimuth says nothing */
static const double GAP = 120;    /* degrees: three cameras all around still make a circle */
static const double ARC_MIN = 10; /* degrees: a path around a single camera moves, too */

/* v without its part along the unit vector `up`, normalised. */
static bool flatten(const double up[3], double v[3])
{
    const double height = cln_dot(v, up);

    for (int a = 0; a < 3; a++)
        v[a] -= height * up[a];
    return cln_normalise(v);
}

static void find_target(const cln_scene *scene, double target[3])
{
    const cln_space core = cln_space_core(&scene->space);
    double focus[3];

    /* the cube's centre: of a forward space, two near planes before the mean camera */
    cln_space_point_to_scene(&scene->space, (const double[3]){0, 0, 0}, target);
    if (cln_scene_focus(scene, focus) && cln_space_holds(&core, focus))
        memcpy(target, focus, sizeof focus);
}

/* From the target to training camera i. */
static void find_away(const cln_scene *scene, const cln_orbit_frame *f, int i, double away[3])
{
    const double *c2w = cln_scene_training_view(scene, i)->camera.c2w;

    for (int a = 0; a < 3; a++)
        away[a] = c2w[4 * a + 3] - f->target[a];
}

/* East, about where it is already, and north. Of cameras that all stand on the axis, any direction
 * is east. */
static void find_level(cln_orbit_frame *f)
{
    if (!flatten(f->up, f->east)) {
        const int least = fabs(f->up[0]) < 0.9 ? 0 : 1;

        memset(f->east, 0, sizeof f->east);
        f->east[least] = 1;
        flatten(f->up, f->east);
    }
    cln_cross(f->up, f->east, f->north);
}

/* Up, distance, and east towards the first training camera. */
static void find_axes(const cln_scene *scene, int count, const double up[3], cln_orbit_frame *out)
{
    double distance = 0, away[3];

    memcpy(out->up, up, sizeof out->up);
    if (!cln_normalise(out->up))
        out->guessed = !cln_up_of_cameras(scene, out->up);
    for (int i = 0; i < count; i++) {
        find_away(scene, out, i, away);
        distance += sqrt(cln_dot(away, away)) / count;
    }
    find_away(scene, out, 0, out->east);
    out->distance = distance > 1e-6 * scene->space.half ? distance : scene->space.half;
    find_level(out);
}

/* The arc leaves out the widest gap between neighbours. Cameras near the pole have no azimuth. */
static cln_status find_arc(const cln_scene *scene, int count, cln_orbit_frame *out)
{
    cln_status st = CLN_OK;
    double *azimuth = NULL, gap = 0;
    int n = 0;

    out->from = -180;
    out->to = 180;
    CLN_TRY(cln_alloc(&azimuth, (size_t)count + 1, sizeof *azimuth, "orbit"));
    for (int i = 0; i < count; i++) {
        double away[3], height = 0;

        find_away(scene, out, i, away);
        if (!cln_normalise(away))
            continue;
        height = asin(fmax(-1, fmin(1, cln_dot(away, out->up)))) / DEGREE;
        out->elevation += height / count;
        if (fabs(height) < POLE)
            azimuth[n++] = atan2(cln_dot(away, out->north), cln_dot(away, out->east)) / DEGREE;
    }
    if (n == 0)
        goto done;
    cln_reals_sort(azimuth, n);
    azimuth[n] = azimuth[0] + 360;
    for (int i = 0; i < n; i++) {
        if (azimuth[i + 1] - azimuth[i] <= fmax(gap, GAP))
            continue;
        gap = azimuth[i + 1] - azimuth[i];
        out->from = azimuth[i + 1] - 360;
        out->to = azimuth[i];
    }
done:
    free(azimuth);
    return st;
}

/* The first training view; where people see photos turned, the first that stands or lies as most
 * do. */
static void find_shape(const cln_scene *scene, int count, cln_orbit_frame *out)
{
    cln_camera like, other;
    bool turned = false;
    int stand = 0; /* those that do, less those that lie */

    cln_view_seen(cln_scene_training_view(scene, 0), &like);
    for (int i = 0; i < count; i++) {
        const cln_view *view = cln_scene_training_view(scene, i);

        cln_view_seen(view, &other);
        turned |= cln_view_turn(view) != 1;
        stand += other.height > other.width ? 1 : -1;
    }
    for (int i = 0; i < count && turned && stand != 0; i++) {
        cln_view_seen(cln_scene_training_view(scene, i), &other);
        if ((other.height > other.width) == (stand > 0)) {
            like = other;
            break;
        }
    }
    if (like.lens == CLN_LENS_EQUIRECTANGULAR) /* all of it is no picture to look at: 90 degrees */
        like.fx = like.fy = 0.5 * like.width;
    out->width = like.width;
    out->height = like.height;
    out->fx = like.fx;
    out->fy = like.fy;
}

cln_status cln_orbit_frame_of(const cln_scene *scene, const double up[3], cln_orbit_frame *out)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);

    memset(out, 0, sizeof *out);
    find_target(scene, out->target);
    find_axes(scene, count, up, out);
    find_shape(scene, count, out);
    return find_arc(scene, count, out);
}

/* ---- in run.json ---- */

static json_t *vector_json(const double v[3])
{
    return json_pack("[f,f,f]", v[0], v[1], v[2]);
}

json_t *cln_orbit_frame_json(const cln_orbit_frame *f)
{
    json_t *saved = json_pack("{s:o, s:o, s:o, s:o, s:f, s:f, s:[f,f], s:i, s:i, s:f, s:f}",
                              "target", vector_json(f->target), "east", vector_json(f->east),
                              "north", vector_json(f->north), "up", vector_json(f->up), "distance",
                              f->distance, "elevation", f->elevation, "azimuth", f->from, f->to,
                              "width", f->width, "height", f->height, "fx", f->fx, "fy", f->fy);

    if (saved && f->guessed)
        json_object_set_new(saved, "up_guessed", json_true());
    return saved;
}

cln_status cln_orbit_frame_read(const json_t *saved, cln_orbit_frame *f)
{
    memset(f, 0, sizeof *f);
    f->guessed = json_is_true(json_object_get(saved, "up_guessed"));
    if (json_unpack(
            (json_t *)saved,
            "{s:[F,F,F], s:[F,F,F], s:[F,F,F], s:[F,F,F], s:F, s:F, s:[F,F], s:i, s:i, s:F, "
            "s:F}",
            "target", &f->target[0], &f->target[1], &f->target[2], "east", &f->east[0], &f->east[1],
            &f->east[2], "north", &f->north[0], &f->north[1], &f->north[2], "up", &f->up[0],
            &f->up[1], &f->up[2], "distance", &f->distance, "elevation", &f->elevation, "azimuth",
            &f->from, &f->to, "width", &f->width, "height", &f->height, "fx", &f->fx, "fy",
            &f->fy) == 0 &&
        f->distance > 0 && f->width > 0 && f->height > 0 && f->fx > 0 && f->fy > 0)
        return CLN_OK;
    return cln_fail(CLN_INPUT, "its orbit was not written by this program");
}

void cln_orbit_frame_turn(const double up[3], cln_orbit_frame *f)
{
    const double before[3] = {f->up[0], f->up[1], f->up[2]};
    double given[3] = {up[0], up[1], up[2]};

    if (!cln_normalise(given))
        return;
    memcpy(f->up, given, sizeof given);
    f->guessed = false;
    if (cln_dot(before, given) < 0) {
        const double from = f->from;

        f->elevation = -f->elevation;
        f->from = -f->to;
        f->to = -from;
    }
    find_level(f);
}

/* ---- a path ---- */

cln_status cln_orbit_resize(const cln_camera *like, int wanted_width, int wanted_height,
                            cln_camera *out)
{
    const double aspect = (double)like->height / like->width;
    double width = wanted_width, height = wanted_height, scale = 1;

    *out = *like;
    if (wanted_width <= 0)
        width = wanted_height > 0 ? fmax(1, round(height / aspect)) : like->width;
    if (wanted_height <= 0)
        height = wanted_width > 0 ? fmax(1, round(width * aspect)) : like->height;
    if (width > CLN_IMAGE_MAX_SIDE || height > CLN_IMAGE_MAX_SIDE ||
        width * height > CLN_IMAGE_MAX_PIXELS)
        return cln_fail(CLN_USAGE,
                        "a picture of %.0f x %.0f is too large: at most %d pixels a side and %d in "
                        "all; lower --width or --height",
                        width, height, CLN_IMAGE_MAX_SIDE, CLN_IMAGE_MAX_PIXELS);
    scale = width / like->width;
    out->width = (int)width;
    out->height = (int)height;
    out->fx = like->fx * scale;
    out->fy = like->fy * scale;
    out->cx = like->cx * scale;
    out->cy = like->cy * scale + 0.5 * (height - like->height * scale);
    if (cln_camera_spans_sphere(like))
        cln_camera_span_sphere(out);
    return CLN_OK;
}

cln_status cln_orbit_lens(const cln_orbit_frame *like, const cln_render_desc *desc, cln_camera *out)
{
    cln_status st = CLN_OK;
    const cln_camera view = {
        .width = like->width, .height = like->height, .fx = like->fx, .fy = like->fy};
    cln_camera resized;
    double scale = 0;

    CLN_TRY(cln_orbit_resize(&view, desc->width, desc->height, &resized));
    memset(out, 0, sizeof *out);
    out->width = resized.width;
    out->height = resized.height;
    /* what the photos frame is in pictures of other shapes, too, as in the viewer */
    scale = desc->width > 0 && desc->height > 0
                ? fmin(resized.width, resized.height) / fmin(like->width, like->height)
                : (double)resized.width / like->width;
    out->fx = desc->fov > 0 ? 0.5 * resized.width / tan(desc->fov * PI / 360) : like->fx * scale;
    out->fy = out->fx * like->fy / like->fx;
    out->cx = 0.5 * resized.width;
    out->cy = 0.5 * resized.height;
done:
    return st;
}

cln_status cln_orbit_make(const cln_orbit_frame *frame, const cln_render_desc *desc, cln_orbit *out)
{
    const double arc = frame->to - frame->from;

    memset(out, 0, sizeof *out);
    out->frame = *frame;
    out->distance = frame->distance * (desc->orbit_radius > 0 ? desc->orbit_radius : 1);
    out->elevation =
        DEGREE * (isnan(desc->orbit_elevation) ? frame->elevation : desc->orbit_elevation);
    out->circle = desc->orbit_circle || arc >= 360;
    out->middle = DEGREE * (frame->from + 0.5 * arc);
    out->swing = DEGREE * 0.5 * fmax(arc, ARC_MIN);
    if (arc < 360 && desc->orbit_circle)
        cln_warn("the training cameras stand in an arc of %.0f degrees: a whole circle also shows "
                 "what no photo saw",
                 arc);
    return cln_orbit_lens(frame, desc, &out->lens);
}

void cln_orbit_camera(const cln_orbit *o, int i, int count, cln_camera *out)
{
    const cln_orbit_frame *f = &o->frame;
    /* on the way back the very cameras of the way there: their pictures need no second rendering */
    const double turn = 2 * PI * (o->circle ? i : fmin(i, count - i)) / count;
    const double angle = o->circle ? turn : o->middle - o->swing * cos(turn);
    const double c = cos(angle), s = sin(angle);
    double away[3], right[3], down[3], forward[3], at[3];

    for (int a = 0; a < 3; a++) {
        away[a] =
            cos(o->elevation) * (c * f->east[a] + s * f->north[a]) + sin(o->elevation) * f->up[a];
        right[a] =
            c * f->north[a] - s * f->east[a]; /* along the circle: defined at the pole, too */
        forward[a] = -away[a];
    }
    cln_cross(forward, right, down);
    for (int a = 0; a < 3; a++)
        at[a] = f->target[a] + o->distance * away[a];
    *out = o->lens;
    cln_pose_of_axes(right, down, forward, at, out->c2w);
}
