/* The geometry of `render --orbit`. See orbit.h; the rendering is api/render.c's. */
#include "render/orbit.h"

#include <math.h>
#include <string.h>

#include "io/image.h"

static const double PI = 3.14159265358979323846;

static double dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* False if there is nothing to normalise. */
static bool normalise(double v[3])
{
    const double length = sqrt(dot(v, v));

    if (!(length > 1e-9))
        return false;
    for (int a = 0; a < 3; a++)
        v[a] /= length;
    return true;
}

/* v without its part along the unit vector `up`, normalised. */
static bool flatten(const double up[3], double v[3])
{
    const double height = dot(v, up);

    for (int a = 0; a < 3; a++)
        v[a] -= height * up[a];
    return normalise(v);
}

static void find_target(const cln_scene *scene, double target[3])
{
    double focus[3];

    memcpy(target, scene->space.centre, 3 * sizeof *target);
    if (cln_scene_focus(scene, focus) && cln_space_holds(&scene->space, focus))
        memcpy(target, focus, sizeof focus);
}

/* Up, distance, and east towards the first training camera. Cameras whose up vectors cancel out, or
 * that all stand on the axis, leave it open: then z is up, and any direction is east. */
static void find_frame(const cln_scene *scene, cln_orbit *out)
{
    const int count = cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
    double distance = 0;

    for (int i = 0; i < count; i++) {
        const double *c2w =
            scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)].camera.c2w;
        double away[3];

        for (int a = 0; a < 3; a++) {
            away[a] = c2w[4 * a + 3] - out->target[a];
            out->up[a] -= c2w[4 * a + 1] / count; /* the camera's y points down */
            if (i == 0)
                out->east[a] = away[a];
        }
        distance += sqrt(dot(away, away)) / count;
    }
    out->distance = distance > 1e-6 * scene->space.half ? distance : scene->space.half;
    if (!normalise(out->up))
        memcpy(out->up, (const double[3]){0, 0, 1}, sizeof out->up);
    if (!flatten(out->up, out->east)) {
        const int least = fabs(out->up[0]) < 0.9 ? 0 : 1;

        memset(out->east, 0, sizeof out->east);
        out->east[least] = 1;
        flatten(out->up, out->east);
    }
    cross(out->up, out->east, out->north);
}

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
    return CLN_OK;
}

/* Of the training view, without its lens and with its axis in the middle. */
static cln_status find_lens(const cln_camera *like, const cln_render_desc *desc, cln_camera *out)
{
    cln_status st = CLN_OK;
    cln_camera resized;

    CLN_TRY(cln_orbit_resize(like, desc->width, desc->height, &resized));
    out->width = resized.width;
    out->height = resized.height;
    out->fx = desc->fov > 0 ? 0.5 * resized.width / tan(desc->fov * PI / 360) : resized.fx;
    out->fy = out->fx * like->fy / like->fx;
    out->cx = 0.5 * resized.width;
    out->cy = 0.5 * resized.height;
done:
    return st;
}

cln_status cln_orbit_make(const cln_scene *scene, const cln_render_desc *desc, cln_orbit *out)
{
    const int first = cln_scene_split_view(scene, CLN_SPLIT_TRAIN, 0);

    memset(out, 0, sizeof *out);
    find_target(scene, out->target);
    find_frame(scene, out);
    out->distance *= desc->orbit_radius > 0 ? desc->orbit_radius : 1;
    out->elevation = desc->orbit_elevation * PI / 180;
    return find_lens(&scene->views[first].camera, desc, &out->lens);
}

void cln_orbit_camera(const cln_orbit *o, int i, int count, cln_camera *out)
{
    const double angle = 2 * PI * i / count, c = cos(angle), s = sin(angle);
    double away[3], right[3], down[3], forward[3];

    for (int a = 0; a < 3; a++) {
        away[a] =
            cos(o->elevation) * (c * o->east[a] + s * o->north[a]) + sin(o->elevation) * o->up[a];
        right[a] =
            c * o->north[a] - s * o->east[a]; /* along the circle: defined at the pole, too */
        forward[a] = -away[a];
    }
    cross(forward, right, down);
    *out = o->lens;
    for (int a = 0; a < 3; a++) {
        out->c2w[4 * a] = right[a];
        out->c2w[4 * a + 1] = down[a];
        out->c2w[4 * a + 2] = forward[a];
        out->c2w[4 * a + 3] = o->target[a] + o->distance * away[a];
    }
}
