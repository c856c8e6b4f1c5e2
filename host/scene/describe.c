/* A loaded scene as a JSON object, for `info` and run.json: what was read and chosen, and why. */
#include "scene/scene.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "io/json.h"

enum { MISSING_NAMED = 8 };
static const double NEARLY = 0.01; /* pixels */

static double distance_to_centre(const cln_scene *scene, const cln_view *view)
{
    double sum = 0;

    for (int i = 0; i < 3; i++) {
        const double difference = view->camera.c2w[4 * i + 3] - scene->space.centre[i];

        sum += difference * difference;
    }
    return sqrt(sum);
}

/* Distinct sizes in the order of their first views, with the number of views of each. */
static json_t *describe_sizes(const cln_scene *scene)
{
    json_t *sizes = json_array();

    for (int i = 0; i < scene->view_count; i++) {
        const cln_camera *camera = &scene->views[i].camera;
        json_t *row = NULL;
        size_t k = 0;

        for (; (row = json_array_get(sizes, k)); k++)
            if (json_integer_value(json_object_get(row, "width")) == camera->width &&
                json_integer_value(json_object_get(row, "height")) == camera->height)
                break;
        if (row)
            json_object_set_new(
                row, "views", json_integer(json_integer_value(json_object_get(row, "views")) + 1));
        else
            json_array_append_new(sizes, json_pack("{s:i, s:i, s:i}", "width", camera->width,
                                                   "height", camera->height, "views", 1));
    }
    return sizes;
}

/* Are two cameras alike to within NEARLY? They may differ by rounding only, as of a matrix that was
 * taken apart: a list of 49 such cameras would tell nothing. */
static bool is_nearly_like(const cln_camera *a, const cln_camera *b)
{
    cln_camera rest = *b;

    if (fabs(a->fx - b->fx) > NEARLY || fabs(a->fy - b->fy) > NEARLY ||
        fabs(a->cx - b->cx) > NEARLY || fabs(a->cy - b->cy) > NEARLY)
        return false;
    rest.fx = a->fx;
    rest.fy = a->fy;
    rest.cx = a->cx;
    rest.cy = a->cy;
    return cln_camera_is_like(a, &rest);
}

/* Views whose intrinsics agree to within NEARLY, in pixels of the images as they are trained on,
 * each row with those of its first view: cameras of a rig take turns, and come again among the test
 * views. Behind ROWS of them, views are compared with the newest row alone; if every view has its
 * own, this is as long as the list of views. */
static json_t *describe_intrinsics(const cln_scene *scene)
{
    enum { ROWS = 256 };
    json_t *list = json_array();
    const cln_camera *first[ROWS + 1]; /* of each row; the last: of the newest */
    int rows = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_camera *c = &scene->views[i].camera;
        const cln_lens_model *lens = &cln_lens_models[c->lens];
        json_t *params = NULL, *row = NULL;
        int k = 0;

        while (k < rows && !is_nearly_like(first[k], c))
            k++;
        if (k < rows) {
            row = json_array_get(list, k < ROWS ? (size_t)k : json_array_size(list) - 1);
            json_object_set_new(
                row, "views", json_integer(json_integer_value(json_object_get(row, "views")) + 1));
            continue;
        }
        params = json_object();
        for (int n = 0; n < lens->count && cln_camera_lenses(c); n++)
            json_object_set_new(params, lens->params[n], cln_json_real(c->distortion[n]));
        json_array_append_new(
            list,
            json_pack("{s:i, s:i, s:i, s:o, s:o, s:o, s:o, s:s, s:o}", "views", 1, "width",
                      c->width, "height", c->height, "fx", cln_json_real(c->fx), "fy",
                      cln_json_real(c->fy), "cx", cln_json_real(c->cx), "cy", cln_json_real(c->cy),
                      "lens", cln_camera_lenses(c) ? lens->name : "PINHOLE", "params", params));
        rows = rows < ROWS ? rows + 1 : ROWS + 1;
        first[rows - 1] = c;
    }
    return list;
}

static json_t *describe_views(const cln_scene *scene)
{
    json_t *views = json_array();

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *view = &scene->views[i];

        json_array_append_new(views, json_pack("{s:s, s:s, s:i, s:i}", "name", view->name, "split",
                                               cln_split_names[view->split], "width",
                                               view->camera.width, "height", view->camera.height));
    }
    return views;
}

/* Names of the first frames that were left out. */
static json_t *describe_missing(const cln_scene *scene)
{
    json_t *names = json_array();

    for (int i = 0; i < scene->missing && i < MISSING_NAMED; i++)
        json_array_append_new(names, json_string(scene->views[scene->view_count + i].name));
    return names;
}

/* Photos that are not in the scene's folder, as named there or by links: they are not copied with
 * it, and a scene of someone else's can so name any picture. JSON null: there are none. */
static json_t *describe_outside(const cln_scene *scene)
{
    char *folder = realpath(scene->folder, NULL), *first = NULL;
    const size_t length = folder ? strlen(folder) : 0;
    json_t *outside = NULL;
    int count = 0;

    for (int i = 0; i < scene->view_count && length > 1; i++) {
        char *photo = realpath(scene->views[i].path, NULL);

        if (photo && (strncmp(photo, folder, length) != 0 || photo[length] != '/')) {
            count++;
            if (!first) {
                first = photo;
                photo = NULL;
            }
        }
        free(photo);
    }
    if (count)
        outside = json_pack("{s:i, s:s}", "views", count, "first", first);
    free(folder);
    free(first);
    return outside ? outside : json_null(); /* a path that is not UTF-8, too */
}

static json_t *describe_masks(const cln_scene *scene)
{
    if (!scene->mask_count)
        return json_null();
    return json_pack("{s:i, s:s, s:s, s:b}", "views", scene->mask_count, "as",
                     scene->masks_alpha ? "alpha" : "ignore", "because", scene->masks_rule,
                     "doubtful", scene->masks_doubtful);
}

static json_t *describe_origin(const cln_scene *scene)
{
    if (!scene->on_earth)
        return NULL;
    return json_pack("{s:f, s:f, s:f, s:o}", "latitude", scene->origin[0], "longitude",
                     scene->origin[1], "height", scene->origin[2], "gps_distance",
                     cln_json_real(scene->gps_distance));
}

static cln_status describe(const cln_scene *scene, json_t **out)
{
    json_t *splits = json_object(), *centre = json_array(), *background = json_array();
    const cln_fold fold = cln_scene_fold(scene);
    double distance = 0;
    int channels = 3;
    char digest[CLN_DIGEST_TEXT], test_digest[CLN_DIGEST_TEXT];

    cln_digest_text(scene->digest, digest);
    cln_digest_text(scene->test_digest, test_digest);
    for (int s = 0; s < CLN_SPLITS; s++)
        json_object_set_new(splits, cln_split_names[s],
                            json_integer(cln_scene_split_count(scene, (cln_split)s)));
    for (int i = 0; i < 3; i++) {
        json_array_append_new(centre, cln_json_real(scene->space.centre[i]));
        json_array_append_new(background, cln_json_real(cln_json_digits(scene->background[i])));
    }
    if (scene->background_mean && !scene->background_known) {
        json_decref(background);
        background = json_string("mean"); /* of photos that are not loaded */
    }
    for (int i = 0; i < scene->view_count; i++) {
        distance += distance_to_centre(scene, &scene->views[i]) / scene->view_count;
        if (scene->views[i].channels > channels)
            channels = scene->views[i].channels;
    }
    *out = json_pack(
        "{s:s, s:s, s:s, s:i, s:i, s:i, s:o, s:o, s:s, s:o, s:o, s:i, s:b, s:o, s:b, s:{s:i, s:f}, "
        "s:i, "
        "s:i, s:o, s:o, s:s, s:s, s:b, s:o, s:s, s:s*, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:o*}",
        "dialect", scene->dialect, "because", scene->because, "folder", scene->folder, "views",
        scene->view_count, "missing", scene->missing, "unreadable", scene->unreadable,
        "missing_names", describe_missing(scene), "splits", splits, "split_rule", scene->split_rule,
        "ignored_keys", scene->ignored ? json_incref(scene->ignored) : json_array(), "sizes",
        describe_sizes(scene), "channels", channels, "alpha", scene->has_alpha, "masks",
        describe_masks(scene), "distortion", scene->lenses != 0, "beyond_fold", "views", fold.views,
        "share", fold.share, "downscale", scene->downscale, "downscale_least",
        scene->downscale_least, "centre", centre, "half", cln_json_real(scene->space.half), "space",
        cln_space_name(&scene->space), "bounds_rule", scene->bounds_rule, "cube_guessed",
        scene->cube_guessed, "background", background, "digest", digest, "test_digest",
        cln_scene_split_count(scene, CLN_SPLIT_TEST) ? test_digest : NULL, "camera_distance",
        cln_json_real(distance), "cube_share", cln_json_real(scene->cube_share), "spread",
        cln_json_real(scene->spread), "apart_share", cln_json_real(scene->apart_share), "outside",
        describe_outside(scene), "intrinsics", describe_intrinsics(scene), "cameras",
        describe_views(scene), "origin", describe_origin(scene));
    if (!*out)
        return cln_fail(CLN_MEMORY, "%s: cannot describe the scene as JSON", scene->folder);
    return CLN_OK;
}

/* Views are named in JSON, so their names are UTF-8; a folder's name may be anything. */
cln_status cln_scene_describe(const cln_scene *scene, json_t **out)
{
    json_t *folder = json_string(scene->folder);

    *out = NULL;
    if (!folder)
        return cln_fail(CLN_INPUT, "%s: the folder's name is not UTF-8, as JSON must be; rename it",
                        scene->folder);
    json_decref(folder);
    return describe(scene, out);
}
