/* Files of poses for `render --poses`. See frames.h. camera_path.json, as nerfstudio and its viewer
 * write it: one size, camera-to-world matrices of 16 numbers row by row with OpenGL's axes,
 * vertical fields of view in degrees. Transforms JSON: read as a scene's. Both in the scene's own
 * frame and units, but for nerfstudio's own paths (pose_frame.c). Stereo panoramas and times are
 * not read. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/film.h"
#include "io/names.h"
#include "render/frames.h"
#include "scene/transforms.h"

static const double PI = 3.14159265358979323846;
enum { MOST = 100000 };

/* ---- camera_path.json ---- */

typedef struct film {
    const char *path;
    cln_camera lens; /* size, centre, lens; not the focal length */
} film;

static cln_status read_film(const json_t *root, int width, int height, film *f, double *fps)
{
    cln_status st = CLN_OK;
    const json_t *type = json_object_get(root, "camera_type");
    const char *word = json_is_string(type) ? json_string_value(type) : "perspective";
    double sides[2] = {width, height};
    bool found = false;

    CLN_TRY(cln_transforms_number(f->path, root, "render_width", &sides[0], &found));
    CLN_TRY(cln_transforms_number(f->path, root, "render_height", &sides[1], &found));
    CLN_TRY(cln_transforms_number(f->path, root, "fps", fps, &found));
    for (int i = 0; i < 2; i++)
        if (!(sides[i] >= 1 && sides[i] <= 1e6))
            CLN_TRY(cln_fail(CLN_INPUT, "%s: %s is %g; it must be a size in pixels", f->path,
                             i ? "render_height" : "render_width", sides[i]));
    if (*fps != 0 && !(*fps >= CLN_FILM_LEAST_FPS && *fps <= 1000))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: fps is %g; it must be %g to 1000", f->path, *fps,
                         CLN_FILM_LEAST_FPS));
    f->lens.width = (int)lround(sides[0]);
    f->lens.height = (int)lround(sides[1]);
    f->lens.cx = 0.5 * f->lens.width;
    f->lens.cy = 0.5 * f->lens.height;
    if (strcmp(word, "perspective") == 0)
        f->lens.lens = CLN_LENS_OPENCV;
    else if (strcmp(word, "fisheye") == 0)
        f->lens.lens = CLN_LENS_OPENCV_FISHEYE;
    else if (strcmp(word, "equirectangular") == 0)
        cln_camera_span_sphere(&f->lens);
    else
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: camera_type '%s' cannot be rendered, only perspective, fisheye and "
                         "equirectangular",
                         f->path, word));
done:
    return st;
}

/* Three numbers of an array. */
static cln_status read_three(const char *where, const json_t *object, const char *key, bool needed,
                             double out[3])
{
    const json_t *array = json_object_get(object, key);

    if (!array && !needed)
        return CLN_OK;
    for (size_t i = 0; i < 3; i++) {
        const json_t *value = json_array_get(array, i);

        if (json_array_size(array) != 3 || !json_is_number(value))
            return cln_fail(CLN_INPUT, "%s: %s must be 3 numbers", where, key);
        out[i] = json_number_value(value);
    }
    return CLN_OK;
}

/* A box with its middle, its sides and, about its middle, angles in radians about x, then y, then
 * z; and the colour around it, 0 to 255. */
static cln_status read_crop(const char *path, const json_t *root, cln_frames *out)
{
    cln_status st = CLN_OK;
    const json_t *crop = json_object_get(root, "crop"), *colour = NULL;
    double middle[3], sides[3], angle[3] = {0}, corners[6];
    char *where = NULL;

    if (!json_is_object(crop))
        return CLN_OK;
    CLN_TRY(cln_asprintf(&where, "%s: crop", path));
    CLN_TRY(read_three(where, crop, "crop_center", true, middle));
    CLN_TRY(read_three(where, crop, "crop_scale", true, sides));
    CLN_TRY(read_three(where, crop, "crop_rot", false, angle));
    for (int a = 0; a < 3; a++) {
        corners[a] = middle[a] - 0.5 * sides[a];
        corners[a + 3] = middle[a] + 0.5 * sides[a];
    }
    if (cln_crop_set("box", corners, angle, &out->crop) != CLN_OK) {
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_INPUT, "%s: crop_scale must be the sides of a box, above 0", where));
    }
    colour = json_object_get(crop, "crop_bg_color");
    if (colour && !json_is_null(colour) && !json_is_object(colour))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: crop_bg_color must be r, g and b, 0 to 255 each", where));
    for (int i = 0; i < 3; i++) {
        static const char *const names[] = {"r", "g", "b"};
        double value = 0;
        bool found = false;

        if (json_is_object(colour))
            CLN_TRY(cln_transforms_number(where, colour, names[i], &value, &found));
        out->crop_background[i] = (float)fmin(fmax(value / 255, 0), 1);
    }
done:
    free(where);
    return st;
}

static cln_status read_station(const film *f, const json_t *entry, int i, cln_camera *camera)
{
    cln_status st = CLN_OK;
    const json_t *matrix = json_object_get(entry, "camera_to_world");
    double m[16], fov = 0;
    bool found = false;
    char *where = NULL;

    CLN_TRY(cln_asprintf(&where, "%s: camera_path[%d]", f->path, i));
    *camera = f->lens;
    for (size_t k = 0; k < 16; k++) { /* flat, or as four rows */
        const json_t *row = json_array_get(matrix, k / 4);
        const json_t *value =
            json_is_array(row) ? json_array_get(row, k % 4) : json_array_get(matrix, k);

        if (!json_is_number(value))
            CLN_TRY(
                cln_fail(CLN_INPUT, "%s: camera_to_world must be 16 numbers, row by row", where));
        m[k] = json_number_value(value);
    }
    for (int k = 0; k < 4; k++)
        if (fabs(m[12 + k] - (k == 3)) > 1e-6)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: the last row of camera_to_world must be 0 0 0 1%s",
                             where,
                             m[3] == 0 && m[7] == 0 && m[11] == 0
                                 ? "; its numbers stand column by column: transpose it"
                                 : ""));
    for (int k = 0; k < 12; k++)
        camera->c2w[k] = k % 4 == 1 || k % 4 == 2 ? -m[k] : m[k];
    if (camera->lens != CLN_LENS_EQUIRECTANGULAR) {
        CLN_TRY(cln_transforms_number(where, entry, "fov", &fov, &found));
        if (!found || !(fov > 0 && fov < 180))
            CLN_TRY(
                cln_fail(CLN_INPUT, "%s: fov must be an angle between 0 and 180 degrees", where));
        camera->fx = camera->fy = 0.5 * camera->height / tan(0.5 * fov * PI / 180);
    }
    CLN_TRY(cln_camera_check(camera, where));
done:
    free(where);
    return st;
}

/* nerfstudio's films last `seconds`; it knows no fps. 0: the file does not say. */
static double rate_by_seconds(const json_t *root, int frames)
{
    const double rate = frames / json_number_value(json_object_get(root, "seconds"));

    return rate >= CLN_FILM_LEAST_FPS && rate <= 1000 ? rate : 0;
}

static cln_status read_path(const char *path, const json_t *root, const json_t *stations, int width,
                            int height, cln_frames *out)
{
    cln_status st = CLN_OK;
    film f = {.path = path};
    json_t *own = json_string("scene");

    CLN_TRY(read_film(root, width, height, &f, &out->fps));
    if (out->fps == 0)
        out->fps = rate_by_seconds(root, out->count);
    CLN_TRY(read_crop(path, root, out));
    /* as our viewer marks its own */
    out->foreign = !json_equal(json_object_get(root, "poses_in"), own);
    for (int i = 0; i < out->count; i++) {
        CLN_TRY(read_station(&f, json_array_get(stations, (size_t)i), i, &out->frame[i].camera));
        CLN_TRY(cln_asprintf(&out->frame[i].name, "path_%04d", i));
    }
done:
    json_decref(own);
    return st;
}

/* ---- transforms JSON ---- */

/* Names frames by their files, if these are named from the root, as programs for films do, without
 * the folder that has all; further frames of a file also get their numbers. */
static cln_status name_frames(const char *path, char *const *names, bool from_root, cln_frames *out)
{
    cln_status st = CLN_OK;
    const size_t within = from_root ? cln_names_folder(out->count, (const char *const *)names) : 0;
    json_t *known = json_object();
    const char **shorter = NULL, *twice = NULL;
    char **files = NULL;
    int count = 0;

    CLN_TRY(cln_alloc(&files, (size_t)out->count, sizeof *files, "poses"));
    CLN_TRY(cln_alloc(&shorter, (size_t)out->count, sizeof *shorter, "poses"));
    for (int i = 0; i < out->count; i++)
        shorter[i] = names[i] + within;
    CLN_TRY(cln_view_file_names(out->count, shorter, files));
    for (int i = 0; i < out->count; i++) {
        if (json_object_get(known, files[i]))
            continue;
        json_object_set_new(known, files[i], json_true());
        out->frame[i].name = files[i];
        files[i] = NULL;
    }
    for (int i = 0; i < out->count; i++) {
        char **name = &out->frame[i].name;

        if (!files[i])
            continue;
        for (int number = i; !*name || json_object_get(known, *name); number++) {
            free(*name);
            *name = NULL;
            CLN_TRY(cln_asprintf(name, "%s-%04d", files[i], number));
        }
        json_object_set_new(known, *name, json_true());
        twice = count++ ? twice : *name;
    }
    if (count > 0)
        cln_warn("%s: %d of its frames %s the name of another one, so %s called like '%s', with %s "
                 "place in the file",
                 path, count, cln_plural(count, "has", "have"),
                 cln_plural(count, "it is", "they are"), twice, cln_plural(count, "its", "their"));
done:
    for (int i = 0; files && i < out->count; i++)
        free(files[i]);
    free(files);
    free(shorter);
    json_decref(known);
    return st;
}

/* Keys that are not read may be of another camera than is rendered. */
static cln_status tell_ignored(const char *path, const json_t *root, const json_t *frames)
{
    cln_status st = CLN_OK;
    json_t *keys = NULL, *frame = NULL, *key = NULL;
    char names[512] = "";
    size_t i = 0;

    CLN_TRY(cln_transforms_ignored(root, false, &keys));
    json_array_foreach((json_t *)frames, i, frame)
        CLN_TRY(cln_transforms_ignored(frame, true, &keys));
    json_array_foreach(keys, i, key)
    {
        const size_t used = strlen(names);

        snprintf(names + used, sizeof names - used, "%s%s", used ? ", " : "",
                 json_string_value(key));
    }
    if (*names)
        cln_info("%s: keys that are not used: %s", path, names);
done:
    json_decref(keys);
    return st;
}

static cln_status read_frames(const char *path, const json_t *root, const cln_frame_sizes *sizes,
                              cln_frames *out)
{
    cln_status st = CLN_OK;
    const json_t *frames = json_object_get(root, "frames");
    bool from_root = true;
    int guessed = 0;
    char **names = NULL, *folder = NULL;

    CLN_TRY(cln_scene_folder(path, &folder));
    CLN_TRY(cln_alloc(&names, (size_t)out->count, sizeof *names, "poses"));
    for (int i = 0; i < out->count; i++) {
        cln_camera *camera = &out->frame[i].camera;
        const json_t *frame = json_array_get(frames, (size_t)i);
        const char *file = json_string_value(json_object_get(frame, "file_path"));
        bool sized = false;

        from_root = from_root && file && *file == '/';
        camera->width = sizes->file_width;
        camera->height = sizes->file_height;
        CLN_TRY(cln_transforms_camera(folder, path, root, i, &names[i], camera, &sized));
        guessed += !sized;
    }
    if (guessed > 0 && sizes->vary)
        cln_warn("%s: %d of its frames %s no w and h, and the photos have several sizes; %d x %d "
                 "is taken, the first training photo's: give w and h of the photos that fl_x, cx "
                 "and cy are of",
                 path, guessed, cln_plural(guessed, "has", "have"), sizes->file_width,
                 sizes->file_height);
    CLN_TRY(name_frames(path, names, from_root, out));
    CLN_TRY(tell_ignored(path, root, frames));
done:
    for (int i = 0; names && i < out->count; i++)
        free(names[i]);
    free(names);
    free(folder);
    return st;
}

cln_status cln_frames_read(const char *path, const cln_frame_sizes *sizes, cln_frames *out)
{
    cln_status st = CLN_OK;
    json_t *root = NULL;
    const json_t *stations = NULL, *frames = NULL;
    size_t count = 0;

    st = cln_transforms_read(path, &root);
    if (st == CLN_INPUT && !cln_ends_with(path, ".json"))
        cln_note("reading it as JSON: --poses takes camera_path.json, as nerfstudio and `view` "
                 "write it, and transforms JSON; docs/formats.md tells how to write one");
    CLN_TRY(st);
    stations = json_object_get(root, "camera_path");
    frames = stations ? stations : json_object_get(root, "frames");
    count = json_array_size(frames);
    if (json_is_object(json_array_get(json_object_get(root, "path"), 0)))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: a camera path of instant-ngp, which is not read: make the path anew "
                         "in `cl-nascent view`",
                         path));
    if (!json_is_array(frames))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: it has neither camera_path, as nerfstudio writes it, nor frames, as "
                         "transforms JSON has",
                         path));
    if (stations && count == 0 && json_array_size(json_object_get(root, "keyframes")) > 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: it has %zu keyframes, but its camera_path is empty: open it in "
                         "`cl-nascent view`, which makes a path of them, or save it in nerfstudio "
                         "again",
                         path, json_array_size(json_object_get(root, "keyframes"))));
    if (count < 1 || count > MOST)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: it has %zu poses; give 1 to %d", path, count, (int)MOST));
    CLN_TRY(cln_frames_room((int)count, out));
    if (stations)
        CLN_TRY(read_path(path, root, stations, sizes->width, sizes->height, out));
    else
        CLN_TRY(read_frames(path, root, sizes, out));
done:
    json_decref(root);
    return st;
}
