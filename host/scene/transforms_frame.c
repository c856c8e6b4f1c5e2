/* One frame of a transforms JSON document -> a view: name, image file, camera. Values are looked up
 * in the frame first, then in the document, so shared and per-frame intrinsics are one case. The
 * pose changes from OpenGL's camera axes to ours. Ranges are checked by camera.c, for every format.
 * Used by reader_transforms.c, and for poses to render, which need no image
 * (render/pose_file.c). */
#include "scene/transforms.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "io/json.h"
#include "scene/dataset.h"
#include "scene/moved.h"

/* Endings tried after a file_path, in this order. */
static const char *const extensions[] = {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};

static const double PI = 3.14159265358979323846;

/* One frame being read: values are looked up in the frame, then in the whole document. */
typedef struct source {
    const char *folder; /* of the JSON document */
    const char *file;   /* the document */
    const json_t *root, *frame;
    char *where;     /* "file: frame 3 ('images/0003.jpg')" */
    bool read_later; /* the image itself will be read */
} source;

cln_status cln_transforms_number(const char *where, const json_t *object, const char *key,
                                 double *out, bool *found)
{
    const json_t *value = json_object_get(object, key);

    *found = value && !json_is_null(value);
    if (!*found)
        return CLN_OK;
    if (cln_json_not_finite(value))
        return cln_fail(CLN_INPUT, "%s: %s must be a finite number, not %s", where, key,
                        cln_json_not_finite(value));
    if (json_is_string(value))
        return cln_fail(CLN_INPUT, "%s: %s must be a number, not a text in quotes (\"%s\")", where,
                        key, json_string_value(value));
    if (!json_is_number(value))
        return cln_fail(CLN_INPUT, "%s: %s must be a number", where, key);
    *out = json_number_value(value);
    return CLN_OK;
}

/* The same in the frame, then in the document; `otherwise` if in neither. */
static cln_status number_of(const source *src, const char *key, double otherwise, double *out)
{
    cln_status st = CLN_OK;
    bool found = false;

    *out = otherwise;
    CLN_TRY(cln_transforms_number(src->where, src->frame, key, out, &found));
    if (!found)
        CLN_TRY(cln_transforms_number(src->file, src->root, key, out, &found));
done:
    return st;
}

static const json_t *value_of(const source *src, const char *key)
{
    const json_t *value = json_object_get(src->frame, key);

    return value ? value : json_object_get(src->root, key);
}

/* Focal lengths from the first of frame and document that has any. */
static cln_status read_focal(const source *src, cln_camera *camera, int angle[2])
{
    cln_status st = CLN_OK;
    const json_t *const objects[2] = {src->frame, src->root};
    const char *const keys[4] = {"fl_x", "fl_y", "camera_angle_x", "camera_angle_y"};
    const char *type = json_string_value(value_of(src, "camera_type"));
    double value[4] = {0};
    bool found[4] = {false};

    for (int i = 0; i < 2 && !(found[0] || found[1] || found[2] || found[3]); i++)
        for (int k = 0; k < 4; k++)
            CLN_TRY(cln_transforms_number(i ? src->file : src->where, objects[i], keys[k],
                                          &value[k], &found[k]));
    for (int k = 0; k < 2; k++) {
        const double side = k ? camera->height : camera->width;

        if (found[k] || !found[k + 2])
            continue;
        if (!(value[k + 2] > 0 && value[k + 2] < PI))
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: %s = %g is not an angle between 0 and pi; give it in radians",
                             src->where, keys[k + 2], value[k + 2]));
        value[k] = 0.5 * side / tan(0.5 * value[k + 2]);
        found[k] = true;
        angle[k] = k + 1;
    }
    if (type && strncasecmp(type, "ortho", 5) == 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: camera_type is %s: orthographic cameras are not traced; give a "
                         "perspective from far away",
                         src->where, type));
    if (!found[0] && !found[1])
        CLN_TRY(cln_fail(CLN_INPUT, "%s: no focal length; add fl_x or camera_angle_x", src->where));
    camera->fx = found[0] ? value[0] : value[1];
    camera->fy = found[1] ? value[1] : value[0];
    angle[0] = found[0] ? angle[0] : angle[1];
    angle[1] = found[1] ? angle[1] : angle[0];
done:
    return st;
}

/* nerfstudio's distortion_params: numbers without names. */
typedef struct listed {
    const char *const *names; /* NULL: there is no list */
    double values[CLN_LENS_PARAMS];
    int count;
} listed;

/* Names are those that nerfstudio gives the numbers: FISHEYE624 has its own, all others share
 * theirs. Numbers that are all 0 are right in any number. */
static cln_status read_list(const source *src, cln_lens lens, listed *out)
{
    static const char *const shared[] = {"k1", "k2", "k3", "k4", "p1", "p2"};
    const bool own = lens == CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE;
    const json_t *list = value_of(src, "distortion_params");
    const size_t length = json_array_size(list);
    bool any = false;

    *out = (listed){.count =
                        own ? cln_lens_models[lens].count : (int)(sizeof shared / sizeof *shared)};
    if (!list || json_is_null(list))
        return CLN_OK;
    out->names = own ? cln_lens_models[lens].params : shared;
    for (size_t i = 0; i < length || !json_is_array(list); i++) {
        const json_t *value = json_array_get(list, i);

        if (!json_is_number(value))
            return cln_fail(CLN_INPUT, "%s: distortion_params must be a list of numbers",
                            src->where);
        any = any || json_number_value(value) != 0;
        if (i < (size_t)out->count)
            out->values[i] = json_number_value(value);
    }
    if (any && length != (size_t)out->count)
        return cln_fail(CLN_INPUT,
                        "%s: distortion_params has %zu numbers, of the lens model %s it has %d "
                        "(%s to %s); correct it, or give them by their names",
                        src->where, length, cln_lens_models[lens].name, out->count, out->names[0],
                        out->names[out->count - 1]);
    return CLN_OK;
}

/* A parameter of the lens: the list has precedence, as in nerfstudio. */
static cln_status parameter_of(const source *src, const listed *list, const char *key, double *out)
{
    for (int i = 0; i < list->count && list->names; i++)
        if (!strcmp(list->names[i], key)) {
            *out = list->values[i];
            return CLN_OK;
        }
    return number_of(src, key, 0, out);
}

static bool has_parameter(const cln_lens_model *model, const char *key)
{
    for (int i = 0; i < model->count; i++)
        if (!strcmp(model->params[i], key))
            return true;
    return false;
}

/* A parameter of other models by its name: of the frame, or of the document unless the frame names
 * a model of its own, whose parameters the document's need not be. What is no number is another
 * program's. */
static double stray_parameter(const source *src, const listed *list, const char *key)
{
    const json_t *own = json_object_get(src->frame, key);
    const json_t *model = json_object_get(src->frame, "camera_model");

    for (int i = 0; i < list->count && list->names; i++)
        if (!strcmp(list->names[i], key))
            return 0; /* the list has precedence, and its numbers are looked at */
    if (!own && (!model || json_is_null(model)))
        own = json_object_get(src->root, key);
    return json_number_value(own);
}

/* What other programs call a panorama; "" and NULL are none. */
static bool is_panorama(const char *name)
{
    static const char *const names[] = {"SPHERICAL", "EQUIRECT", "PANO", "PANORAMA", "360"};

    for (size_t i = 0; i < sizeof names / sizeof *names && name; i++)
        if (strncasecmp(name, names[i], strlen(names[i])) == 0)
            return true;
    return false;
}

/* Reads the lens model, OPENCV if none is named, and its parameters; refuses parameters that the
 * model lacks. k, alpha and beta are not looked for: other programs' keys may have these names.
 * series: k3 and k4 of OPENCV's series, if it has so many terms. */
static cln_status read_lens(const source *src, cln_camera *camera, double series[2])
{
    static const char *const others[] = {"k3", "k4", "k5", "k6"};
    static const char *const strays[] = {"k0", "k1", "k2", "p0",  "p1",  "p2",   "s0",
                                         "s1", "s2", "s3", "sx1", "sy1", "omega"};
    enum {
        OTHERS = sizeof others / sizeof *others,
        STRAYS = sizeof strays / sizeof *strays,
        NAMED = OTHERS + STRAYS
    };
    cln_status st = CLN_OK;
    const json_t *named = value_of(src, "camera_model");
    const cln_lens_model *model = NULL;
    listed list;
    char *known = NULL;
    double k3 = 0, k4 = 0;

    CLN_TRY(cln_dataset_lenses(&known));
    camera->lens = CLN_LENS_OPENCV;
    if (named && !json_is_null(named)) {
        if (!json_is_string(named))
            CLN_TRY(cln_fail(CLN_INPUT, "%s: camera_model must be a string", src->where));
        camera->lens = cln_lens_find(json_string_value(named));
    }
    if (camera->lens == CLN_LENSES && is_panorama(json_string_value(named)))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: camera_model %s is not known; that of a panorama is EQUIRECTANGULAR: "
                         "write that in its place",
                         src->where, json_string_value(named)));
    if (camera->lens == CLN_LENSES || value_of(src, "ftheta_p0"))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: cameras of camera_model %s are not read, only %s; undistort the "
                         "images to such a camera",
                         src->where,
                         camera->lens == CLN_LENSES ? json_string_value(named) : "F-theta", known));
    CLN_TRY(read_list(src, camera->lens, &list));
    CLN_TRY(parameter_of(src, &list, "k3", &k3));
    CLN_TRY(parameter_of(src, &list, "k4", &k4));
    if (camera->lens == CLN_LENS_OPENCV && json_is_true(value_of(src, "is_fisheye")))
        camera->lens = CLN_LENS_OPENCV_FISHEYE; /* instant-ngp's way to say it */
    /* Of a file that does not say OPENCV, k4 is ambiguous: it may belong to OpenCV's divisor. To
     * nerfstudio it is the fourth term of the series. */
    if (camera->lens == CLN_LENS_OPENCV && k4 != 0 && json_is_string(named)) {
        series[0] = k3;
        series[1] = k4;
    } else if (camera->lens == CLN_LENS_OPENCV && k3 != 0 && k4 == 0) {
        camera->lens = CLN_LENS_FULL_OPENCV; /* OPENCV with more terms */
    }
    model = &cln_lens_models[camera->lens];
    for (int k = 0; k < NAMED + (list.names ? list.count : 0); k++) {
        const char *key = k < OTHERS  ? others[k]
                          : k < NAMED ? strays[k - OTHERS]
                                      : list.names[k - NAMED];
        double value = 0;

        if (series[1] != 0 && (strcmp(key, "k3") == 0 || strcmp(key, "k4") == 0))
            continue;
        if (k >= OTHERS && k < NAMED && !has_parameter(model, key))
            value = stray_parameter(src, &list, key);
        else if (!has_parameter(model, key))
            CLN_TRY(parameter_of(src, &list, key, &value));
        if (value != 0)
            CLN_TRY(cln_fail(CLN_INPUT,
                             "%s: %s = %g is not a parameter of the lens model %s; remove it, or "
                             "name another as camera_model: %s",
                             src->where, key, value, model->name, known));
    }
    for (int i = 0; i < model->count; i++)
        CLN_TRY(parameter_of(src, &list, model->params[i], &camera->distortion[i]));
done:
    free(known);
    return st;
}

/* Width or height: whole numbers that may be written as 540.0; 0 if absent. */
static cln_status read_side(const source *src, const char *key, int *out)
{
    cln_status st = CLN_OK;
    double value = 0;

    CLN_TRY(number_of(src, key, 0, &value));
    if (!(value >= 0 && value <= 1e6) || fabs(value - round(value)) > 1e-6)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: absurd image size %s = %g; give whole pixels, or leave w and h out",
                         src->where, key, value));
    *out = (int)lround(value);
done:
    return st;
}

/* One side alone says which size focal length and centre are of only if it is the image's. */
static cln_status check_lone_side(const source *src, const int given[2], const cln_camera *camera)
{
    const int i = given[0] ? 0 : 1, sides[2] = {camera->width, camera->height};

    if (!given[0] == !given[1] || given[i] == sides[i])
        return CLN_OK;
    return cln_fail(CLN_INPUT,
                    "%s: %s is %d without %s, but the image has %d x %d pixels; add %s, or leave "
                    "both out",
                    src->where, i ? "h" : "w", given[i], i ? "w" : "h", sides[0], sides[1],
                    i ? "w" : "h");
}

/* The size that is given, or the image's. If there is neither, the camera keeps its own. */
static cln_status read_size(const source *src, const char *image, cln_camera *camera,
                            cln_by_file *by)
{
    cln_status st = CLN_OK;
    const int own[2] = {camera->width, camera->height};
    int given[2] = {0}, channels = 0;

    CLN_TRY(read_side(src, "w", &given[0]));
    CLN_TRY(read_side(src, "h", &given[1]));
    if (given[0] && given[1]) {
        camera->width = given[0];
        camera->height = given[1];
        goto done;
    }
    by->size = !own[0] || cln_is_file(image);
    by->none = !by->size;
    if (by->size)
        st = cln_image_info(image, &camera->width, &camera->height, &channels);
    if (st == CLN_INPUT && src->read_later && cln_is_file(image)) {
        /* broken: refused together with others like it, when it is read (images.c) */
        cln_clear_error();
        st = CLN_OK;
        camera->width = camera->height = 1;
        goto done;
    }
    CLN_TRY(st);
    CLN_TRY(check_lone_side(src, given, camera));
done:
    return st;
}

static bool is_near(double value, double wanted)
{
    return fabs(value - wanted) <= 0.01 * wanted;
}

/* A panorama's image spans the whole sphere, unless focal lengths and a centre say where it was cut
 * above and below. Focal lengths of neither mean nothing: programs write any. */
static cln_status read_sphere(const source *src, cln_camera *camera, cln_by_file *by)
{
    cln_status st = CLN_OK;
    double focal[2], centre[2];

    CLN_TRY(number_of(src, "fl_x", NAN, &focal[0]));
    CLN_TRY(number_of(src, "fl_y", focal[0], &focal[1]));
    CLN_TRY(number_of(src, "cx", 0.5 * camera->width, &centre[0]));
    CLN_TRY(number_of(src, "cy", NAN, &centre[1]));
    cln_camera_span_sphere(camera);
    by->cut = is_near(focal[0], camera->fx) &&
              (is_near(focal[1], focal[0]) || is_near(focal[1], camera->fy)) &&
              isfinite(centre[0]) && isfinite(centre[1]);
    if (by->cut) {
        camera->fx = focal[0];
        camera->fy = focal[1];
        camera->cx = centre[0];
        camera->cy = centre[1];
    }
done:
    return st;
}

/* How far from the middle a fisheye's photos show something, as nerfstudio has it: in pixels, of
 * such lenses alone. */
static cln_status read_disc(const source *src, cln_view *view)
{
    cln_status st = CLN_OK;
    const cln_camera *c = &view->camera;
    const cln_lens lens = c->lens;
    double radius = 0;

    if (lens != CLN_LENS_OPENCV_FISHEYE && lens != CLN_LENS_THIN_PRISM_FISHEYE &&
        lens != CLN_LENS_RAD_TAN_THIN_PRISM_FISHEYE)
        return CLN_OK;
    CLN_TRY(number_of(src, "fisheye_crop_radius", NAN, &radius));
    if (isnan(radius))
        return CLN_OK;
    if (!(radius > 0 && isfinite(radius)))
        return cln_fail(CLN_INPUT, "%s: fisheye_crop_radius must be pixels above 0; correct it",
                        src->where);
    if (radius < 0.5 * hypot(c->width, c->height)) /* else all is shown */
        view->disc = radius / (c->width > c->height ? c->width : c->height);
done:
    return st;
}

/* Reads the intrinsics. If no size is given anywhere, the camera keeps its own, if it has one. */
static cln_status read_intrinsics(const source *src, const char *image, cln_camera *camera,
                                  cln_by_file *by)
{
    cln_status st = CLN_OK;
    double series[2] = {0};

    CLN_TRY(read_lens(src, camera, series));
    CLN_TRY(read_size(src, image, camera, by));
    if (camera->lens == CLN_LENS_EQUIRECTANGULAR) {
        st = read_sphere(src, camera, by);
        goto done;
    }
    CLN_TRY(read_focal(src, camera, by->angle));
    CLN_TRY(number_of(src, "cx", NAN, &camera->cx));
    CLN_TRY(number_of(src, "cy", NAN, &camera->cy));
    by->centre[0] = isnan(camera->cx);
    by->centre[1] = isnan(camera->cy);
    camera->cx = by->centre[0] ? 0.5 * camera->width : camera->cx;
    camera->cy = by->centre[1] ? 0.5 * camera->height : camera->cy;
    if (series[1] != 0)
        CLN_TRY(cln_camera_add_terms(camera, series, src->where));
done:
    return st;
}

/* Rows of 4 numbers, or all numbers in one list, row by row. */
static cln_status read_pose(const source *src, double c2w[12])
{
    static const double last_row[4] = {0, 0, 0, 1};
    const json_t *matrix = json_object_get(src->frame, "transform_matrix");
    const size_t length = json_array_size(matrix);
    const bool flat = json_is_number(json_array_get(matrix, 0));
    const size_t rows = !flat ? length : length % 4 == 0 ? length / 4 : 0;

    if (!matrix)
        return cln_fail(CLN_INPUT, "%s: no transform_matrix; add it, or remove the frame",
                        src->where);
    if (rows != 3 && rows != 4)
        return cln_fail(CLN_INPUT,
                        "%s: transform_matrix must be 3 or 4 rows of 4 numbers, or these 12 or 16 "
                        "numbers in one list, row by row",
                        src->where);
    for (size_t i = 0; i < rows; i++) {
        const json_t *row = json_array_get(matrix, i);

        if (!flat && json_array_size(row) != 4)
            return cln_fail(CLN_INPUT, "%s: row %zu of transform_matrix must have 4 numbers",
                            src->where, i + 1);
        for (size_t j = 0; j < 4; j++) {
            const json_t *value = flat ? json_array_get(matrix, 4 * i + j) : json_array_get(row, j);
            const double number = json_number_value(value);

            if (!json_is_number(value))
                return cln_fail(CLN_INPUT,
                                "%s: transform_matrix row %zu column %zu is not a number; correct "
                                "it, or remove the frame",
                                src->where, i + 1, j + 1);
            if (i == 3 && !(fabs(number - last_row[j]) <= 1e-3))
                return cln_fail(
                    CLN_INPUT,
                    "%s: the last row of transform_matrix must be 0 0 0 1, column %zu is "
                    "%g: the pose is not rigid; correct it, or remove the frame",
                    src->where, j + 1, number);
            if (i < 3)
                c2w[4 * i + j] = number;
        }
    }
    cln_dataset_from_opengl(c2w);
    return CLN_OK;
}

/* Finds the file, with the extension that it has on disk; if it is missing, *out is its likely
 * name. */
static cln_status find_image(const source *src, const char *file_path, char **out)
{
    cln_status st = CLN_OK;
    char *base = NULL, *path = NULL, *dot = NULL;

    CLN_TRY(cln_path_join(&base, src->folder, file_path));
    for (int slashes = 0; slashes < 2; slashes++) {
        for (size_t i = 0; i < sizeof extensions / sizeof *extensions; i++) {
            CLN_TRY(cln_asprintf(&path, "%s%s", base, extensions[i]));
            if (cln_is_file(path)) {
                *out = path;
                path = NULL;
                goto done;
            }
            free(path);
            path = NULL;
        }
        (void)cln_turn_slashes(base);
    }
    /* load.c deals with missing frames. */
    dot = strrchr(base, '.');
    CLN_TRY(cln_asprintf(out, "%s%s", base, dot && !strchr(dot, '/') ? "" : ".png"));
done:
    free(base);
    free(path);
    return st;
}

/* A path of Windows with single backslashes, which JSON reads as line breaks and the like. */
static cln_status check_escapes(const char *file, int index, const char *name, const char *path)
{
    static const char letters[] = "btn?fr"; /* of characters 8 to 13 */
    cln_status st = CLN_OK;
    char *written = NULL;
    size_t used = 0;

    if (!strpbrk(name, "\b\t\n\f\r") || cln_is_file(path))
        return CLN_OK;
    CLN_TRY(cln_alloc(&written, 2 * strlen(name) + 1, 1, "name"));
    for (const char *p = name; *p; p++) {
        const bool escape = *p >= '\b' && *p <= '\r';

        if (escape)
            written[used++] = '\\';
        written[used++] = escape ? letters[*p - '\b'] : *p;
    }
    CLN_TRY(cln_fail(CLN_INPUT,
                     "%s: frame %d: file_path is '%s' with single backslashes, which JSON reads as "
                     "line breaks and the like; write each twice, or / instead",
                     file, index, written));
done:
    free(written);
    return st;
}

/* The file that is `named` under `key`, in *out; NULL if `named` is. otherwise: what holds without
 * the key, after "remove KEY". */
static cln_status find_named(const source *src, cln_moved *moved, const char *key,
                             const json_t *named, const char *otherwise, char **out)
{
    cln_status st = CLN_OK;
    char *path = NULL, *name = NULL;

    *out = NULL;
    if (!named || json_is_null(named))
        return CLN_OK;
    if (!json_is_string(named) || !json_string_length(named))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s must be a string", src->where, key));
    CLN_TRY(find_image(src, json_string_value(named), out));
    if (!cln_is_file(*out)) {
        CLN_TRY(cln_dataset_name(src->where, json_string_value(named), &name));
        CLN_TRY(cln_moved_find(moved, name, false, &path));
    }
    if (path) {
        free(*out);
        *out = path;
    }
    if (!cln_is_file(*out))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: there is no mask %s; restore it, or remove %s%s",
                         src->where, *out, key, otherwise));
done:
    free(name);
    return st;
}

/* The frame's mask_path, or the document's, which is that of all frames without one, black where
 * pixels do not count; or instant-ngp's dynamic_mask_NAME.png beside the image, black where they
 * do. And the frame's alpha_path, whose brightness is alpha, which export --cameras writes. */
static cln_status find_masks(const source *src, cln_moved *moved, cln_view *view)
{
    cln_status st = CLN_OK;
    const char *name = cln_last_name(view->path), *dot = strrchr(name, '.');
    const int folder = (int)(name - view->path),
              stem = (int)(dot ? dot - name : (long)strlen(name));
    char *path = NULL;

    CLN_TRY(find_named(src, moved, "alpha_path", json_object_get(src->frame, "alpha_path"),
                       " (then all of the photo is opaque, background included)",
                       &view->alpha_path));
    CLN_TRY(find_named(src, moved, "mask_path", value_of(src, "mask_path"), "", &view->mask_path));
    if (view->mask_path)
        goto done;
    CLN_TRY(cln_asprintf(&path, "%.*sdynamic_mask_%.*s.png", folder, view->path, stem, name));
    if (cln_is_file(path)) {
        view->mask_path = path;
        view->mask_black = true;
        path = NULL;
    }
done:
    free(path);
    return st;
}

cln_status cln_transforms_unread_alpha(const json_t *root, int index, const cln_view *view,
                                       bool *found)
{
    cln_status st = CLN_OK;
    const json_t *frame = json_array_get(json_object_get(root, "frames"), (size_t)index);
    const char *named = json_string_value(json_object_get(frame, "file_path"));
    const char *slash = strrchr(view->path, '/'), *dot = strrchr(slash ? slash : view->path, '.');
    const bool has_ending = named && dot && strlen(named) >= strlen(dot) &&
                            !strcmp(named + strlen(named) - strlen(dot), dot);
    char *path = NULL;

    *found = false;
    if (view->alpha_path || !dot)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&path, "%.*s.alpha%s",
                         (int)(has_ending ? strlen(view->path) : (size_t)(dot - view->path)),
                         view->path, dot));
    *found = cln_is_file(path);
done:
    free(path);
    return st;
}

cln_status cln_transforms_frame(const char *folder, const char *file, const json_t *root, int index,
                                cln_view *view)
{
    cln_status st = CLN_OK;
    source src = {.folder = folder, .file = file, .root = root};
    const json_t *file_path = NULL;

    src.frame = json_array_get(json_object_get(root, "frames"), (size_t)index);
    file_path = json_object_get(src.frame, "file_path");
    if (!json_is_object(src.frame))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: frame %d is not an object; remove it", file, index));
    if (!json_is_string(file_path) || !json_string_length(file_path))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: frame %d has no file_path (a string); add it, or remove the frame",
                         file, index));
    CLN_TRY(
        cln_asprintf(&src.where, "%s: frame %d ('%s')", file, index, json_string_value(file_path)));
    CLN_TRY(cln_dataset_name(src.where, json_string_value(file_path), &view->name));
    CLN_TRY(read_pose(&src, view->camera.c2w));
    CLN_TRY(find_image(&src, json_string_value(file_path), &view->path));
    CLN_TRY(check_escapes(file, index, json_string_value(file_path), view->path));
    view->leads_out = cln_path_leads_out(json_string_value(file_path));
done:
    free(src.where);
    return st;
}

cln_status cln_transforms_finish(const char *folder, const char *file, const json_t *root,
                                 int index, cln_moved *moved, cln_view *view)
{
    cln_status st = CLN_OK;
    source src = {.folder = folder, .file = file, .root = root, .read_later = true};

    if (!cln_is_file(view->path))
        return CLN_OK;
    src.frame = json_array_get(json_object_get(root, "frames"), (size_t)index);
    CLN_TRY(cln_asprintf(&src.where, "%s: frame %d ('%s')", file, index,
                         json_string_value(json_object_get(src.frame, "file_path"))));
    CLN_TRY(find_masks(&src, moved, view));
    CLN_TRY(read_intrinsics(&src, view->path, &view->camera, &view->by_file));
    CLN_TRY(read_disc(&src, view));
done:
    free(src.where);
    return st;
}

cln_status cln_transforms_camera(const char *folder, const char *file, const json_t *root,
                                 int index, char **name, cln_camera *camera, bool *sized)
{
    cln_status st = CLN_OK;
    source src = {.folder = folder, .file = file, .root = root};
    const json_t *file_path = NULL;
    cln_by_file by_file = {0}; /* of a camera without a photo */
    char *image = NULL;

    src.frame = json_array_get(json_object_get(root, "frames"), (size_t)index);
    file_path = json_object_get(src.frame, "file_path");
    if (!json_is_object(src.frame))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: frame %d is not an object; remove it", file, index));
    CLN_TRY(cln_asprintf(&src.where, "%s: frame %d", file, index));
    if (json_string_length(file_path) > 0) {
        CLN_TRY(cln_dataset_name(src.where, json_string_value(file_path), name));
        CLN_TRY(find_image(&src, json_string_value(file_path), &image));
    } else {
        CLN_TRY(cln_asprintf(name, "pose_%04d", index));
        CLN_TRY(cln_strdup(&image, ""));
    }
    CLN_TRY(read_pose(&src, camera->c2w));
    CLN_TRY(read_intrinsics(&src, image, camera, &by_file));
    *sized = !by_file.none;
    CLN_TRY(cln_camera_check(camera, src.where));
done:
    free(src.where);
    free(image);
    return st;
}
