/* Writes and reads RUN/cameras.json. See cameras_file.h. One line for each view, and one for each
 * camera that differs from that of the view before. */
#include "scene/cameras_file.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/image.h"
#include "io/json.h"
#include "scene/build.h"
#include "scene/dataset.h"

#define SCHEMA "cl-nascent.cameras/1"
static const size_t TEXT = JSON_COMPACT | JSON_ENCODE_ANY | JSON_REAL_PRECISION(17);

/* ---- writing ---- */

static json_t *list_of(const double *values, int count)
{
    json_t *list = json_array();

    for (int i = 0; i < count; i++)
        json_array_append_new(list, json_real(values[i]));
    return list;
}

/* Paths may be anything. */
static cln_status text_of(const char *text, json_t **out)
{
    cln_status st = CLN_OK;
    char *copy = NULL;

    CLN_TRY(cln_strdup(&copy, text));
    cln_utf8_repair(copy);
    *out = json_string(copy);
done:
    free(copy);
    return st;
}

/* Writes a value behind `before` and drops it. What the disk refuses, the commit reports. */
static cln_status put(FILE *to, const char *before, json_t *value)
{
    bool made = false;

    fputs(before, to);
    made = value && (json_dumpf(value, to, TEXT) == 0 || ferror(to));
    json_decref(value);
    return made ? CLN_OK : cln_fail(CLN_MEMORY, CLN_CAMERAS_FILE ": cannot make JSON");
}

static cln_status put_text(FILE *to, const char *before, const char *text)
{
    cln_status st = CLN_OK;
    json_t *value = NULL;

    CLN_TRY(text_of(text, &value));
    st = put(to, before, value);
done:
    return st;
}

static json_t *camera_json(const cln_view *v)
{
    const cln_camera *c = &v->camera;
    const cln_lens_model *lens = &cln_lens_models[c->lens];

    return json_pack("{s:i, s:i, s:i, s:i, s:i, s:f, s:f, s:f, s:f, s:s, s:o}", "width", c->width,
                     "height", c->height, "file_width", v->file_width, "file_height",
                     v->file_height, "downscale", v->downscale, "fx", c->fx, "fy", c->fy, "cx",
                     c->cx, "cy", c->cy, "lens", lens->name, "params",
                     list_of(c->distortion, lens->count));
}

static cln_status add_path(const cln_scene *scene, const char *key, const char *path,
                           const char *unless, json_t *row)
{
    cln_status st = CLN_OK;
    char *from = NULL;
    json_t *text = NULL;

    if (!path)
        return CLN_OK;
    CLN_TRY(cln_scene_path_from(scene, path, &from));
    if (unless && strcmp(from, unless) == 0)
        goto done;
    CLN_TRY(text_of(from, &text));
    json_object_set_new(row, key, text);
done:
    free(from);
    return st;
}

static cln_status put_view(FILE *to, const char *before, const cln_scene *scene,
                           const cln_view *view, int camera, const double pose[12])
{
    cln_status st = CLN_OK;
    char digest[CLN_DIGEST_TEXT];
    json_t *row =
        json_pack("{s:s, s:s, s:i, s:o}", "name", view->name, "split", cln_split_names[view->split],
                  "camera", camera, "pose", list_of(pose, 12));
    const struct {
        const char *key;
        bool set;
    } flags[] = {{"leads_out", view->leads_out},
                 {"alpha_mask", view->alpha_mask},
                 {"alpha_black", view->alpha_mask && view->alpha_black},
                 {"turned", view->turned},
                 {"multiplied", view->multiplied},
                 {"mask_black", view->mask_path && view->mask_black},
                 {"trained", view->trained && view->split != CLN_SPLIT_TRAIN}};

    CLN_TRY(add_path(scene, "file", view->path, view->name, row));
    CLN_TRY(add_path(scene, "alpha", view->alpha_path, NULL, row));
    CLN_TRY(add_path(scene, "mask", view->mask_path, NULL, row));
    for (size_t i = 0; i < sizeof flags / sizeof *flags; i++)
        if (flags[i].set)
            json_object_set_new(row, flags[i].key, json_true());
    if (view->digest) {
        cln_digest_text(view->digest, digest);
        json_object_set_new(row, "digest", json_string(digest));
    }
    if (view->orientation > 1)
        json_object_set_new(row, "orientation", json_integer(view->orientation));
    if (view->edge > 0)
        json_object_set_new(row, "edge", json_integer(view->edge));
    if (view->disc > 0)
        json_object_set_new(row, "disc", json_real(view->disc));
    st = put(to, before, row);
    row = NULL;
done:
    json_decref(row);
    return st;
}

static bool has_camera_of(const cln_view *a, const cln_view *b)
{
    return a->file_width == b->file_width && a->file_height == b->file_height &&
           a->downscale == b->downscale && cln_camera_is_like(&a->camera, &b->camera);
}

static cln_status put_head(FILE *to, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    char digest[CLN_DIGEST_TEXT], *folder = NULL;

    cln_digest_text(scene->digest, digest);
    CLN_TRY(cln_path_absolute(&folder, scene->folder));
    CLN_TRY(put_text(to, "{\"schema\": ", SCHEMA));
    CLN_TRY(put_text(to, ",\n\"digest\": ", digest));
    CLN_TRY(put_text(to, ",\n\"folder\": ", folder));
    CLN_TRY(put_text(to, ",\n\"split_rule\": ", scene->split_rule));
    if (scene->has_box)
        CLN_TRY(put(to, ",\n\"box\": ", list_of(scene->box, 6)));
done:
    free(folder);
    return st;
}

static cln_status put_views(FILE *to, const cln_scene *scene, const double (*given)[12])
{
    cln_status st = CLN_OK;
    const cln_view *v = scene->views;
    int camera = -1;

    for (int i = 0; i < scene->view_count; i++)
        if (i == 0 || !has_camera_of(&v[i], &v[i - 1]))
            CLN_TRY(put(to, i ? ",\n" : ",\n\"cameras\": [\n", camera_json(&v[i])));
    for (int i = 0, trained = 0; i < scene->view_count; i++) {
        const bool moved = given && v[i].split == CLN_SPLIT_TRAIN;

        camera += i == 0 || !has_camera_of(&v[i], &v[i - 1]);
        CLN_TRY(put_view(to, i ? ",\n" : "\n],\n\"views\": [\n", scene, &v[i], camera,
                         moved ? given[trained] : v[i].camera.c2w));
        trained += v[i].split == CLN_SPLIT_TRAIN;
    }
    fputs("\n]}\n", to);
done:
    return st;
}

cln_status cln_cameras_write(const char *run, const cln_scene *scene, const double (*given)[12])
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    char *path = NULL;

    CLN_TRY(cln_path_join(&path, run, CLN_CAMERAS_FILE));
    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(put_head(cln_atomic_stream(file), scene));
    CLN_TRY(put_views(cln_atomic_stream(file), scene, given));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    free(path);
    return st;
}

/* ---- reading ---- */

static cln_status fail_row(const char *path, const char *what, size_t row, const char *key)
{
    return cln_fail(CLN_INPUT,
                    "%s: %s[%zu]: '%s' is missing, or is not what it must be; copy the run again",
                    path, what, row, key);
}

static bool get_numbers(const json_t *list, size_t count, double *out)
{
    bool right = json_array_size(list) == count;

    for (size_t i = 0; i < count && right; i++) {
        right = json_is_number(json_array_get(list, i));
        out[i] = json_number_value(json_array_get(list, i));
    }
    return right;
}

static bool get_whole(const json_t *row, const char *key, json_int_t least, json_int_t most,
                      int *out)
{
    const json_t *value = json_object_get(row, key);
    const json_int_t number = json_integer_value(value);

    *out = (int)number;
    return json_is_integer(value) && number >= least && number <= most;
}

/* Fills in a view's camera, but for its pose, and the sizes of its file. */
static cln_status read_camera(const char *path, const json_t *row, size_t i, cln_view *out)
{
    cln_camera *c = &out->camera;
    const struct {
        const char *key;
        int *value, most;
    } sizes[] = {{"width", &c->width, CLN_IMAGE_MAX_SIDE},
                 {"height", &c->height, CLN_IMAGE_MAX_SIDE},
                 {"file_width", &out->file_width, CLN_IMAGE_MAX_SIDE},
                 {"file_height", &out->file_height, CLN_IMAGE_MAX_SIDE},
                 {"downscale", &out->downscale, CLN_MOST_DOWNSCALE}};
    const struct {
        const char *key;
        double *value;
    } lengths[] = {{"fx", &c->fx}, {"fy", &c->fy}, {"cx", &c->cx}, {"cy", &c->cy}};

    for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++)
        if (!get_whole(row, sizes[k].key, 1, sizes[k].most, sizes[k].value))
            return fail_row(path, "cameras", i, sizes[k].key);
    for (size_t k = 0; k < sizeof lengths / sizeof *lengths; k++) {
        *lengths[k].value = cln_json_number(row, lengths[k].key);
        if (!isfinite(*lengths[k].value))
            return fail_row(path, "cameras", i, lengths[k].key);
    }
    c->lens = cln_lens_find(cln_json_text(row, "lens"));
    if (c->lens == CLN_LENSES)
        return fail_row(path, "cameras", i, "lens");
    if (!get_numbers(json_object_get(row, "params"), (size_t)cln_lens_models[c->lens].count,
                     c->distortion))
        return fail_row(path, "cameras", i, "params");
    return CLN_OK;
}

/* A file of the scene, by its path from the folder; *out NULL if the row names none. */
static cln_status read_path(const cln_scene *scene, const char *from, char **out)
{
    return *from ? cln_path_join(out, scene->folder, from) : CLN_OK;
}

/* Fills in a view of the scene, which then owns what is in it. cameras: those that are read. */
static cln_status read_view(const char *path, const json_t *row, int i, const cln_view *cameras,
                            int camera_count, cln_scene *scene)
{
    cln_status st = CLN_OK;
    cln_view *view = &scene->views[i];
    const char *name = cln_json_text(row, "name"), *split = cln_json_text(row, "split");
    const char *file = cln_json_text(row, "file");
    int camera = 0, s = 0;
    cln_camera checked;

    if (!get_whole(row, "camera", 0, camera_count - 1, &camera))
        return fail_row(path, "views", (size_t)i, "camera");
    while (s < CLN_SPLITS && strcmp(split, cln_split_names[s]) != 0)
        s++;
    if (s == CLN_SPLITS || (i == 0 ? s != CLN_SPLIT_TRAIN : s < (int)view[-1].split))
        return fail_row(path, "views", (size_t)i, "split");
    *view = cameras[camera];
    view->split = (cln_split)s;
    view->number = i;
    view->channels = 3;
    view->alpha_turn = view->mask_turn = 1;
    if (!get_whole(row, "orientation", 1, 8, &view->orientation))
        view->orientation = 1; /* none, or of an older run */
    if (!get_whole(row, "edge", 1, CLN_IMAGE_MAX_SIDE, &view->edge))
        view->edge = 0;
    view->disc = json_number_value(json_object_get(row, "disc"));
    if (!(view->disc > 0 && view->disc < 1e6))
        view->disc = 0;
    view->leads_out = json_is_true(json_object_get(row, "leads_out"));
    view->turned = json_is_true(json_object_get(row, "turned"));
    view->multiplied = json_is_true(json_object_get(row, "multiplied"));
    view->mask_black = json_is_true(json_object_get(row, "mask_black"));
    view->alpha_mask = json_is_true(json_object_get(row, "alpha_mask"));
    view->alpha_black = json_is_true(json_object_get(row, "alpha_black"));
    view->trained = json_is_true(json_object_get(row, "trained"));
    view->digest = strtoull(cln_json_text(row, "digest"), NULL, 16); /* 0: of an older run */
    if (!*name)
        return fail_row(path, "views", (size_t)i, "name");
    if (!get_numbers(json_object_get(row, "pose"), 12, view->camera.c2w))
        return fail_row(path, "views", (size_t)i, "pose");
    checked = view->camera; /* the check may change the last bits of the pose */
    st = cln_camera_check(&checked, name);
    if (st != CLN_OK)
        cln_note("reading %s; copy the run again", path);
    CLN_TRY(st);
    CLN_TRY(cln_strdup(&view->name, name));
    CLN_TRY(read_path(scene, *file ? file : name, &view->path));
    CLN_TRY(read_path(scene, cln_json_text(row, "alpha"), &view->alpha_path));
    CLN_TRY(read_path(scene, cln_json_text(row, "mask"), &view->mask_path));
done:
    return st;
}

static cln_status read_head(const char *path, const json_t *document, cln_scene *scene)
{
    cln_status st = CLN_OK;
    const char *schema = cln_json_text(document, "schema"), *folder = NULL, *digest = NULL;
    const json_t *box = json_object_get(document, "box");

    if (strcmp(schema, SCHEMA) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: its schema is %s, not %s; another program wrote it", path,
                         *schema ? schema : "not named", SCHEMA));
    folder = cln_json_text(document, "folder");
    digest = cln_json_text(document, "digest");
    scene->digest = strtoull(digest, NULL, 16);
    scene->has_box = box != NULL;
    if (!*folder || strspn(digest, "0123456789abcdef") != CLN_DIGEST_TEXT - 1 ||
        digest[CLN_DIGEST_TEXT - 1] || (box && !get_numbers(box, 6, scene->box)))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: its folder, digest or box is damaged; copy the run again",
                         path));
    CLN_TRY(cln_strdup(&scene->path, folder));
    CLN_TRY(cln_strdup(&scene->folder, folder));
    CLN_TRY(cln_strdup(&scene->split_rule, cln_json_text(document, "split_rule")));
done:
    return st;
}

static cln_status read_views(const char *path, const json_t *document, cln_scene *scene)
{
    cln_status st = CLN_OK;
    const json_t *cameras = json_object_get(document, "cameras");
    const json_t *views = json_object_get(document, "views");
    const size_t camera_count = json_array_size(cameras), count = json_array_size(views);
    cln_view *list = NULL;

    if (count < 1 || count > CLN_MAX_VIEWS || camera_count < 1 || camera_count > count)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: it has %zu views and %zu cameras; copy the run again",
                         path, count, camera_count));
    CLN_TRY(cln_alloc(&list, camera_count, sizeof *list, "cameras"));
    CLN_TRY(cln_alloc(&scene->views, count, sizeof *scene->views, "views"));
    scene->downscale_least = CLN_MOST_DOWNSCALE;
    for (size_t i = 0; i < camera_count; i++) {
        CLN_TRY(read_camera(path, json_array_get(cameras, i), i, &list[i]));
        scene->lenses |= cln_camera_lenses(&list[i].camera);
        if (list[i].downscale > scene->downscale)
            scene->downscale = list[i].downscale;
        if (list[i].downscale < scene->downscale_least)
            scene->downscale_least = list[i].downscale;
    }
    for (size_t i = 0; i < count; i++) {
        scene->view_count = (int)i + 1;
        CLN_TRY(read_view(path, json_array_get(views, i), (int)i, list, (int)camera_count, scene));
    }
    CLN_TRY(cln_scene_name_files(scene));
done:
    free(list);
    return st;
}

cln_status cln_cameras_read(const char *run, cln_scene **out)
{
    cln_status st = CLN_OK;
    cln_scene *scene = NULL;
    json_t *document = NULL;
    char *path = NULL;

    *out = NULL;
    CLN_TRY(cln_path_join(&path, run, CLN_CAMERAS_FILE));
    CLN_TRY(cln_json_read(path, false, &document));
    CLN_TRY(cln_alloc(&scene, 1, sizeof *scene, "scene"));
    scene->dialect = "a run's cameras";
    CLN_TRY(read_head(path, document, scene));
    CLN_TRY(read_views(path, document, scene));
    *out = scene;
    scene = NULL;
done:
    cln_scene_free(scene);
    json_decref(document);
    free(path);
    return st;
}
