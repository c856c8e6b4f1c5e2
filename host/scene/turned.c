/* Photos whose EXIF data tell viewers to turn them. COLMAP, OpenSfM, nerfstudio and instant-ngp
 * read pixels as they are stored, so poses belong to these, and so does this program. Where only
 * the turned picture has the shape of its camera, poses were made from turned pixels, and they are
 * turned here, too. Mirrors, half turns and squares keep the shape: they follow the other photos,
 * and where none tells, the dataset's format.
 *
 * Masks are drawn on stored or on turned pictures: the one whose size they have, else as other
 * masks of the scene, else stored ones, as which they are turned with their photos.
 *
 * Where pixels stay as stored, people still see the photo turned: which way is up, and how pictures
 * of its view are shown, go by cln_view_turn. */
#include "scene/build.h"

#include <math.h>
#include <string.h>
#include "base/text.h"
#include "io/image.h"
#include "scene/inspect.h"

enum { JPEG_LEAST = 128 };              /* black is not quite black beside white in a JPEG */
static const double NEAR_MIDDLE = 0.05; /* of a side; at 4:3 the middles of both lie 1/8 apart */

bool cln_camera_has_shape(const cln_camera *camera, int width, int height)
{
    return camera->width > 0 && camera->height > 0 &&
           fabs((double)camera->width * height - (double)camera->height * width) <=
               fmax(camera->width, camera->height) + fmax(width, height);
}

/* Is the camera's principal point near the middle of such an image? */
static bool has_middle(const cln_camera *camera, int width, int height)
{
    return fabs(camera->cx - 0.5 * width) <= NEAR_MIDDLE * width &&
           fabs(camera->cy - 0.5 * height) <= NEAR_MIDDLE * height;
}

/* By the sizes of a photo that EXIF turns by a quarter, or where only the file tells these, by its
 * principal point: 1: turned, -1: as stored, 0: both fit, or none. */
static int told_by_size(const cln_view *v)
{
    const cln_camera *c = &v->camera;
    const int wide = v->file_width, high = v->file_height;
    const bool by_middle = v->by_file.size;
    const bool stored = by_middle ? has_middle(c, wide, high) : cln_camera_has_shape(c, wide, high);
    const bool turned = by_middle ? has_middle(c, high, wide) : cln_camera_has_shape(c, high, wide);

    if (v->orientation < 5 || stored == turned ||
        (by_middle &&
         (v->by_file.centre[0] || v->by_file.centre[1] || c->lens == CLN_LENS_EQUIRECTANGULAR)))
        return 0;
    return turned ? 1 : -1;
}

/* Gives a camera that has the stored file's size the turned picture's, and what follows from it. */
static void turn_camera(cln_view *v)
{
    cln_camera *c = &v->camera;
    const bool sphere = cln_camera_spans_sphere(c);
    const int width = c->width;
    const double wider = (double)c->height / c->width;

    c->width = c->height;
    c->height = width;
    if (sphere) {
        cln_camera_span_sphere(c);
        return;
    }
    c->cx = v->by_file.centre[0] ? 0.5 * c->width : c->cx;
    c->cy = v->by_file.centre[1] ? 0.5 * c->height : c->cy;
    c->fx *= v->by_file.angle[0] == 1 ? wider : v->by_file.angle[0] == 2 ? 1 / wider : 1;
    c->fy *= v->by_file.angle[1] == 1 ? wider : v->by_file.angle[1] == 2 ? 1 / wider : 1;
}

void cln_scene_find_turns(cln_scene *scene)
{
    bool turned = false, stored = false;

    for (int i = 0; i < scene->view_count; i++) {
        turned |= told_by_size(&scene->views[i]) > 0;
        stored |= told_by_size(&scene->views[i]) < 0;
    }
    stored |= scene->stored_poses && !turned; /* photos that others' programs wrote count more */
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];
        const int told = told_by_size(v), width = v->file_width;

        if (v->orientation == 1)
            continue;
        v->turn_known = told || turned || stored;
        v->turned = told ? told > 0 : turned && !stored;
        if (v->turned && v->orientation >= 5) {
            v->file_width = v->file_height;
            v->file_height = width;
            if (v->by_file.size)
                turn_camera(v);
        }
    }
}

int cln_view_turn(const cln_view *view)
{
    static const int turns[9] = {1, 1, 1, 3, 3, 6, 6, 8, 8};

    return view->turned ? 1 : turns[view->orientation];
}

bool cln_view_turn_spot(const cln_view *v, float *x, float *y)
{
    const float wide = (float)v->camera.width, high = (float)v->camera.height;
    const float u = *x, w = *y;
    const int o = v->orientation;

    if (o < 2 || v->turned || (o >= 5 && v->camera.width != v->camera.height))
        return false;
    *x = o == 2 || o == 3 ? wide - u : o == 4 ? u : o == 5 || o == 8 ? w : high - w;
    *y = o == 2 ? w : o == 3 || o == 4 ? high - w : o == 5 || o == 6 ? u : wide - u;
    return true;
}

void cln_view_seen(const cln_view *view, cln_camera *out)
{
    const cln_camera *c = &view->camera;
    const int turn = cln_view_turn(view), sign = turn == 6 ? -1 : 1;

    *out = *c;
    if (turn == 1)
        return;
    for (int a = 0; a < 3; a++) {
        const double x = c->c2w[4 * a], y = c->c2w[4 * a + 1];

        out->c2w[4 * a] = turn == 3 ? -x : sign * y;
        out->c2w[4 * a + 1] = turn == 3 ? -y : -sign * x;
    }
    out->lens = CLN_LENS_OPENCV;
    memset(out->distortion, 0, sizeof out->distortion);
    if (turn == 3) {
        out->cx = c->width - c->cx;
        out->cy = c->height - c->cy;
        return;
    }
    out->width = c->height;
    out->height = c->width;
    out->fx = c->fy;
    out->fy = c->fx;
    out->cx = turn == 6 ? c->height - c->cy : c->cy;
    out->cy = turn == 6 ? c->cx : c->width - c->cx;
}

/* Is a mask or alpha file of the turned picture, 1, or of the stored one, -1? 0: perhaps either.
 * *jpeg: is it one? */
static cln_status told_by_mask(const cln_view *v, const char *path, int *told, bool *jpeg)
{
    cln_status st = CLN_OK;
    const bool quarter = v->orientation >= 5;
    const int width = quarter && v->turned ? v->file_height : v->file_width;
    const int height = quarter && v->turned ? v->file_width : v->file_height;
    cln_image_head head;
    bool stored = false, turned = false;
    char other[64] = "";

    CLN_TRY(cln_image_read_head(path, &head));
    stored = cln_image_alike(head.width, head.height, width, height);
    turned = quarter ? cln_image_alike(head.width, head.height, height, width) : stored;
    if (quarter)
        snprintf(other, sizeof other, ", turned as its EXIF data say %d x %d", height, width);
    if (!stored && !turned)
        CLN_TRY(
            cln_fail(CLN_INPUT,
                     "%s: the mask has %d x %d pixels, its image %d x %d%s; give it the same shape",
                     path, head.width, head.height, width, height, other));
    *jpeg = head.jpeg;
    *told = stored != turned ? (turned ? 1 : -1) : head.orientation == v->orientation ? -1 : 0;
done:
    return st;
}

cln_status cln_scene_turn_masks(cln_scene *scene)
{
    cln_status st = CLN_OK;
    bool turned = false, stored = false;

    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];
        const char *const paths[2] = {v->alpha_path, v->mask_path};
        int *const turns[2] = {&v->alpha_turn, &v->mask_turn};
        bool jpeg = false;

        for (int k = 0; k < 2; k++) { /* what is told is kept there until all of it is known */
            *turns[k] = 0;
            if (!paths[k])
                continue;
            CLN_TRY(told_by_mask(v, paths[k], turns[k], &jpeg));
            turned |= v->orientation > 1 && *turns[k] > 0;
            stored |= v->orientation > 1 && *turns[k] < 0;
        }
        v->mask_least = jpeg ? JPEG_LEAST : 1;
    }
    for (int i = 0; i < scene->view_count; i++) {
        cln_view *v = &scene->views[i];
        int *const turns[2] = {&v->alpha_turn, &v->mask_turn};
        const int back = v->orientation == 6 ? 8 : v->orientation == 8 ? 6 : v->orientation;

        v->masks_known = true;
        for (int k = 0; k < 2; k++) {
            /* masks that contradict each other tell nothing about one that does not tell itself */
            if ((k ? v->mask_path : v->alpha_path) && v->orientation > 1 && !*turns[k] &&
                turned == stored)
                v->masks_known = false;
            const bool of_turned = *turns[k] ? *turns[k] > 0 : turned && !stored;

            *turns[k] = of_turned == v->turned ? 1 : v->turned ? v->orientation : back;
        }
    }
done:
    return st;
}

/* Adds a finding, `before` and `after` the number and first name of those photos with an EXIF
 * orientation that are turned or not, and known to belong so or not. wrong: a likely fault. */
static void tell(const cln_scene *scene, json_t *findings, bool known, bool turned, bool wrong,
                 const char *before, const char *after)
{
    json_t *names = json_array();

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (v->orientation > 1 && v->turn_known == known && v->turned == turned)
            json_array_append_new(names, json_string(v->name));
    }
    if (json_array_size(names) > 0)
        cln_found_fault(findings, "orientation", wrong, json_incref(names),
                        "%s %d photo%s ('%s'%s)%s", before, (int)json_array_size(names),
                        cln_plural((double)json_array_size(names), "", "s"),
                        json_string_value(json_array_get(names, 0)),
                        json_array_size(names) > 1 ? ", ..." : "", after);
    json_decref(names);
}

/* Adds a finding of masks that may be of stored or of turned pixels. */
static void tell_masks(const cln_scene *scene, json_t *findings)
{
    json_t *names = json_array();

    for (int i = 0; i < scene->view_count; i++)
        if (!scene->views[i].masks_known)
            json_array_append_new(names, json_string(scene->views[i].name));
    if (json_array_size(names) > 0)
        cln_found_fault(
            findings, "orientation", false, json_incref(names),
            "%d photo%s that EXIF data tell viewers to turn ('%s'%s) %s, and nothing tells whether "
            "masks are of stored or of turned pixels: they are taken to be of stored ones. If they "
            "are not, turn the masks back",
            (int)json_array_size(names), cln_plural((double)json_array_size(names), "", "s"),
            json_string_value(json_array_get(names, 0)), json_array_size(names) > 1 ? ", ..." : "",
            cln_plural((double)json_array_size(names), "has a mask", "have masks"));
    json_decref(names);
}

void cln_scene_doubt_turns(const cln_scene *scene, json_t *findings)
{
    tell(scene, findings, false, false, false, "EXIF data tell viewers to turn",
         ", and nothing tells whether the poses are of turned pixels: they are taken as stored, as "
         "COLMAP, nerfstudio and instant-ngp do. If the poses are of turned ones, turn the pixels "
         "(mogrify -auto-orient)");
    tell_masks(scene, findings);
}

void cln_scene_tell_turns(const cln_scene *scene, const cln_agreement *agreement, json_t *findings)
{
    const int turned = agreement->turned, stored = agreement->stored;
    char after[512];

    if (cln_agree_turned(agreement)) {
        snprintf(
            after, sizeof after,
            ": their pixels are taken as stored, but the poses are of turned ones: %d marks of "
            "theirs lie where both poses put them if they are turned, and %d as they are "
            "stored. Turn the pixels (mogrify -auto-orient)",
            turned, stored);
        tell(scene, findings, true, false, true, "EXIF data tell viewers to turn", after);
        tell(scene, findings, false, false, true, "EXIF data tell viewers to turn", after);
    } else {
        snprintf(after, sizeof after,
                 ": their pixels are taken as stored, as %s; what is up goes by these data",
                 scene->stored_poses && !cln_agree_stored(agreement)
                     ? "poses of such files are of these"
                     : "the poses are of these");
        tell(scene, findings, true, false, false, "EXIF data tell viewers to turn", after);
    }
    tell(scene, findings, true, true, false, "turned as EXIF data say: pixels of",
         ", as the poses are of turned ones");
}
