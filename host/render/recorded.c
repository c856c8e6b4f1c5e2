/* What run.json records of a run, read back. See recorded.h. */
#include "render/recorded.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/progress.h"
#include "io/run_folder.h"
#include "scene/cameras_file.h"
#include "scene/reader.h"

cln_status cln_run_config(const char *run, cln_config *config)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    CLN_TRY(cln_reader_run(run, &document));
    CLN_TRY(cln_config_from_json(json_object_get(document, "config"), config));
done:
    json_decref(document);
    return st;
}

static bool same_text(const json_t *object, const char *key, const char *text)
{
    const char *saved = json_string_value(json_object_get(object, key));

    return saved && strcmp(saved, text) == 0;
}

static bool is_same_device(const json_t *saved, const cln_device_info *info)
{
    return same_text(saved, "name", info->name) && same_text(saved, "platform", info->platform) &&
           same_text(saved, "driver", info->driver);
}

cln_status cln_recorded_alloc(const char *run, cln_device *device)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *saved = NULL;
    double most = 0;
    char text[32];

    CLN_TRY(cln_reader_run(run, &document));
    saved = json_object_get(document, "device");
    most = json_number_value(json_object_get(saved, "max_alloc"));
    if (!is_same_device(saved, &device->info) || !(most > 0) || most >= device->info.max_alloc)
        goto done;
    cln_format_bytes(most, text);
    cln_info("the largest buffer has %s, as in the run before (--max-alloc sets another)", text);
    device->info.max_alloc = most;
    device->max_alloc = (size_t)most;
done:
    json_decref(document);
    return st;
}

cln_status cln_recorded_tune(const char *run, cln_device *device)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *saved = NULL;
    const char *list = NULL, *from = NULL;
    cln_tune tune = device->tune; /* for what an older program did not know */

    if (device->tune_from[0])
        return CLN_OK;
    CLN_TRY(cln_reader_run(run, &document));
    saved = json_object_get(document, "device");
    list = json_string_value(json_object_get(document, "tune"));
    from = json_string_value(json_object_get(document, "tune_from"));
    if (!list || !is_same_device(saved, &device->info))
        goto done;
    if (cln_tune_parse(list, &tune) != CLN_OK) {
        cln_warn("%s/run.json: tune: its kernel parameters are not understood (%s); others are "
                 "chosen, and results may differ in the last bits",
                 run, cln_error_text());
        cln_clear_error();
        goto done;
    }
    device->tune = tune;
    snprintf(device->tune_from, sizeof device->tune_from, "%.400s", from ? from : "the run");
done:
    json_decref(document);
    return st;
}

/* ---- the scene ---- */

static const char *text_of(const json_t *object, const char *key)
{
    return json_string_value(json_object_get(object, key));
}

cln_status cln_recorded_place(const char *run, const char *scene, json_t *dataset)
{
    cln_status st = CLN_OK;
    char *path = NULL, *folder = NULL, *from_run = NULL;
    json_t *text = NULL;

    CLN_TRY(cln_path_absolute(&path, scene));
    CLN_TRY(cln_path_absolute(&folder, run));
    CLN_TRY(cln_path_relative(&from_run, folder, path));
    text = json_string(path); /* NULL where a folder above has a name that is no UTF-8 */
    json_object_set_new(dataset, "path", text ? text : json_string(scene));
    text = json_string(from_run);
    json_object_set_new(dataset, "path_from_run", text ? text : json_null());
done:
    free(path);
    free(folder);
    free(from_run);
    return st;
}

/* A run of the scene's name, where runs are named after scenes, is not the scene. */
static bool is_there(const char *path)
{
    const bool run = cln_has_file(path, "run.json") && !cln_run_is_of_others(path);

    return (cln_is_dir(path) && !run) || cln_is_file(path);
}

/* Where a run's scene may be: where run.json has it, and in two places that go with the run. */
enum { PLACES = 3 };

/* *path: the place, NULL if the run does not tell it; *how: as words, NULL for the first. */
static cln_status tell_place(const char *run, const json_t *dataset, int which, char **path,
                             const char **how)
{
    const char *saved = text_of(dataset, "path"), *from_run = text_of(dataset, "path_from_run");

    *path = NULL;
    *how = NULL;
    if (which == 0)
        return cln_strdup(path, saved);
    *how = which == 1 ? "where it was, seen from the run" : "beside the run, by its name";
    if (which == 1)
        return from_run ? cln_path_join(path, run, from_run) : CLN_OK;
    return cln_asprintf(path, "%s/../%s", run, cln_last_name(saved));
}

/* The first place where something is, for a training that resumes the run or another command. */
static cln_status find_scene(const char *run, const json_t *dataset, bool resumes, char **path,
                             const char **how)
{
    cln_status st = CLN_OK;
    char quoted[CLN_QUOTED_BYTES];

    if (!text_of(dataset, "path"))
        CLN_TRY(cln_fail(CLN_INPUT, "%s/run.json: dataset.path is missing", run));
    for (int i = 0; i < PLACES; i++) {
        CLN_TRY(tell_place(run, dataset, i, path, how));
        if (*path && is_there(*path))
            goto done;
        free(*path);
        *path = NULL;
    }
    CLN_TRY(cln_fail(CLN_INPUT,
                     "%s: the scene of %s is not there, nor beside the run; say where it is now "
                     "%s%s SCENE",
                     text_of(dataset, "path"), cln_shell_quote(run, quoted, sizeof quoted),
                     resumes ? "by train --resume " : "with --scene", resumes ? quoted : ""));
done:
    return st;
}

cln_status cln_recorded_scene(const char *run, char **path)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const char *place = NULL;

    *path = NULL;
    CLN_TRY(cln_reader_run(run, &document));
    st = find_scene(run, json_object_get(document, "dataset"), false, path, &place);
    if (st != CLN_OK) {
        free(*path);
        *path = NULL;
    }
done:
    json_decref(document);
    return st;
}

cln_status cln_recorded_cameras(const char *run, cln_scene **scene)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const char *saved = NULL;
    char digest[CLN_DIGEST_TEXT];

    *scene = NULL;
    CLN_TRY(cln_reader_run(run, &document));
    CLN_TRY(cln_cameras_read(run, scene));
    saved = text_of(json_object_get(document, "dataset"), "digest");
    cln_digest_text((*scene)->digest, digest);
    if (!saved || strcmp(saved, digest) != 0)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s/" CLN_CAMERAS_FILE ": it is of another scene than the run (digest %s, "
                         "that has %s); copy the run again",
                         run, digest, saved ? saved : "none"));
done:
    if (st != CLN_OK) {
        cln_scene_free(*scene);
        *scene = NULL;
    }
    json_decref(document);
    return st;
}

/* A background by the photos stays what it was when the run began, also where they are not loaded,
 * or have another size. */
static void keep_background(const json_t *document, const cln_config *config, cln_scene *scene)
{
    const json_t *saved = json_object_get(document, "config");
    const json_t *colour = json_object_get(json_object_get(document, "dataset"), "background");

    if (!scene->background_mean || !same_text(saved, "background", config->background))
        return;
    for (size_t c = 0; c < 3 && json_array_size(colour) == 3; c++)
        scene->background[c] = (float)json_number_value(json_array_get(colour, c));
    scene->background_known = json_array_size(colour) == 3;
}

static cln_status refuse(const char *run, const cln_scene *scene, const char *why)
{
    char quoted[CLN_QUOTED_BYTES];

    return cln_fail(
        CLN_INPUT,
        "%s: not the scene that %s began with (%s), so nothing is trained; leave it out, "
        "or train a new run on it from its beginning, as none begins with another "
        "scene's model: -o NEW --settings-of %s",
        scene->folder, run, why, cln_shell_quote(run, quoted, sizeof quoted));
}

/* Another scene than the run's: what was learnt does not fit poses that were found anew, in another
 * frame. One that is named to go on with may be another capture of the same names: it needs a photo
 * that is the same. kept may be NULL. */
static cln_status compare_poses(const char *run, const cln_scene *scene, const cln_scene *kept,
                                bool resumes, bool named)
{
    cln_status st = CLN_OK;
    cln_since since = {0};
    char far[2 * CLN_SINCE_BYTES], text[CLN_SINCE_BYTES], quoted[CLN_QUOTED_BYTES];

    if (!kept)
        return named ? refuse(run, scene, "it keeps no cameras to compare") : CLN_OK;
    CLN_TRY(cln_scene_moved_since(scene, kept, &since));
    if (named && !since.elsewhere && since.changed == since.known)
        CLN_TRY(refuse(run, scene, "no photo is the same"));
    if (!since.elsewhere && since.changed > 1 && since.changed == since.known) {
        cln_warn(
            "%s: all %d photos that %s knows by their names, or their masks, have changed since "
            "it began: if they show another moment, what it learnt of the old ones stays as "
            "ghosts%s%s%s",
            scene->folder, since.known, run,
            resumes ? "; begin anew then (-o NEW --settings-of " : "",
            resumes ? cln_shell_quote(run, quoted, sizeof quoted) : "", resumes ? ")" : "");
        return CLN_OK;
    }
    if (!since.elsewhere) {
        cln_since_text(&since, text);
        if (!*text && since.changed > 0)
            snprintf(text, sizeof text, "%d of %d photos, or their masks, have changed (%.*s%s)",
                     since.changed, since.known, (int)cln_utf8_whole(since.first_changed, 100),
                     since.first_changed, since.changed > 1 ? ", ..." : "");
        if (since.moved > 0)
            cln_warn("%s: since %s began, %s%s%s", scene->folder, run, text,
                     resumes ? "; where the old ones were wrong, what it learnt by them stays: "
                               "train a new run, -o NEW --settings-of "
                             : "",
                     resumes ? cln_shell_quote(run, quoted, sizeof quoted) : "");
        else
            cln_info("scene: since it began %s",
                     *text ? text : "photos, masks or lenses of the same names have changed");
        return CLN_OK;
    }
    if (since.known > 0)
        snprintf(far, sizeof far,
                 "%d of %d photos of %s have other poses than when it began (in the median %.3g "
                 "degrees and %.2g times the cameras' distance from their middle off), as if they "
                 "had been found anew",
                 since.moved, since.known, run, since.degrees, since.shift);
    else
        snprintf(far, sizeof far,
                 "none of its %d photos is one of the %d that %s began with, nor are its cameras "
                 "where those were",
                 scene->view_count, kept->view_count, run);
    if (named)
        CLN_TRY(refuse(run, scene, far));
    if (resumes)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %s, so what it learnt is elsewhere: nothing is trained; restore the "
                         "%s, or train a new run (-o NEW --settings-of %s)",
                         scene->folder, far, since.known > 0 ? "poses" : "scene", run));
    cln_warn("%s: %s, so what it learnt is elsewhere", scene->folder, far);
done:
    return st;
}

static bool is_same(const json_t *dataset, const cln_scene *scene)
{
    const char *saved = text_of(dataset, "digest");
    char digest[CLN_DIGEST_TEXT];

    cln_digest_text(scene->digest, digest);
    return saved && strcmp(saved, digest) == 0;
}

/* Another scene, or none, is at `first`, where the run's was: takes the run's in its stead, if that
 * went with the run. *scene: what is there, NULL if it cannot be read. */
static cln_status look_elsewhere(const char *run, const json_t *dataset,
                                 const cln_scene_desc *given, const char *first, cln_scene **scene)
{
    cln_status st = CLN_OK;
    cln_scene_desc desc = *given;
    cln_scene *other = NULL;
    const char *how = NULL;
    char *path = NULL;
    bool found = *scene && is_same(dataset, *scene);

    for (int i = 1; i < PLACES && !found; i++) {
        free(path);
        CLN_TRY(tell_place(run, dataset, i, &path, &how));
        if (!path || !is_there(path) || cln_is_same_file(path, first))
            continue;
        desc.path = path;
        st = cln_scene_load(&desc, &other);
        if (st == CLN_SIGINT || st == CLN_SIGTERM || st == CLN_MEMORY)
            goto done;
        if (st != CLN_OK)
            cln_clear_error();
        found = st == CLN_OK && is_same(dataset, other);
        st = CLN_OK;
        if (found) {
            cln_warn("%s: %s is there now; %s is the scene that %s began with, and read (%s)",
                     first, *scene ? "another scene" : "no scene that can be read", other->path,
                     run, how);
            cln_scene_free(*scene);
            *scene = other;
        } else {
            cln_scene_free(other);
        }
        other = NULL;
    }
done:
    free(path);
    return st;
}

static cln_status compare(const char *run, const json_t *dataset, const cln_scene *scene,
                          const char *place, bool *same)
{
    const char *saved = text_of(dataset, "digest");
    char digest[CLN_DIGEST_TEXT];

    cln_digest_text(scene->digest, digest);
    *same = is_same(dataset, scene);
    if (*same && place)
        cln_info("scene: %s is not there; %s is the same one, and read (%s)",
                 text_of(dataset, "path"), scene->path, place);
    if (*same)
        return CLN_OK;
    if (place)
        return cln_fail(CLN_INPUT,
                        "%s: the scene of %s is not there, and %s (%s) is another one (digest %s, "
                        "was %s); --scene tells where it is now",
                        text_of(dataset, "path"), run, scene->path, place, digest,
                        saved ? saved : "unknown");
    cln_warn("%s: the scene is not the one that %s was last trained on (digest %s, was %s); "
             "results will not be those of the same photos and poses",
             scene->folder, run, digest, saved ? saved : "unknown");
    return CLN_OK;
}

/* Whether each photo was divided by its own number. All were divided by one in runs of older
 * programs, which do not tell the least. */
static bool divides_each(const json_t *dataset)
{
    const json_t *least = json_object_get(dataset, "downscale_least");

    return least && !json_equal(least, json_object_get(dataset, "downscale"));
}

/* The views that the run keeps, which say what was test and what was trained on: photos may have
 * come or gone since, and a list of test views need not be there any more, or may have other names
 * by now. Where they cannot be read, only such a list is missed. */
static cln_status read_kept(const char *run, const cln_config *config, cln_scene **kept)
{
    cln_status st = CLN_OK;

    if (!cln_has_file(run, CLN_CAMERAS_FILE))
        return CLN_OK;
    st = cln_cameras_read(run, kept);
    if (st == CLN_INPUT && !config->test_views[0]) {
        cln_clear_error();
        return CLN_OK;
    }
    if (st != CLN_OK)
        cln_note("looking for the test views of %s", run);
    return st;
}

static cln_status load(const char *run, const cln_scene_desc *given, bool resumes,
                       cln_scene **scene, bool *same)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *dataset = NULL;
    cln_config config = *given->config;
    cln_scene_desc desc = *given;
    const char *place = NULL;
    char *path = NULL, why[4096] = "";
    cln_since since = {0};
    cln_scene *kept = NULL;

    *scene = NULL;
    CLN_TRY(cln_reader_run(run, &document));
    dataset = json_object_get(document, "dataset");
    if (config.space == CLN_SPACE_AUTO && same_text(dataset, "space", "cube"))
        config.space = CLN_SPACE_CUBE; /* what auto chooses may have changed since the run began */
    for (int m = CLN_MASKS_ALPHA; m <= CLN_MASKS_IGNORE && config.masks == CLN_MASKS_AUTO; m++)
        if (same_text(json_object_get(dataset, "masks"), "as",
                      m == CLN_MASKS_ALPHA ? "alpha" : "ignore"))
            config.masks = m;
    /* nor do these later on, resumed once; another scene's photos may be of other sizes */
    if (config.downscale == 0 && (!json_object_get(dataset, "downscale_least") ||
                                  ((resumes || !given->path) && !divides_each(dataset))))
        config.downscale = (int)json_integer_value(json_object_get(dataset, "downscale"));
    desc.config = &config;
    desc.held_out = cln_json_number(json_object_get(dataset, "splits"), "test") > 0;
    /* nor which masks are found; null: it had none */
    desc.without_masks =
        (resumes || !given->path) && json_is_null(json_object_get(dataset, "masks"));
    desc.keep_alpha = json_is_true(json_object_get(dataset, "alpha"));
    if (json_is_false(json_object_get(dataset, "alpha")) && text_of(dataset, "digest"))
        desc.opaque_digest = strtoull(text_of(dataset, "digest"), NULL, 16);
    if (!desc.path) {
        CLN_TRY(find_scene(run, dataset, resumes, &path, &place));
        desc.path = path;
    }
    CLN_TRY(read_kept(run, &config, &kept));
    desc.kept = kept;
    st = cln_scene_load(&desc, scene);
    if (st != CLN_OK && st != CLN_SIGINT && st != CLN_SIGTERM && !given->path)
        cln_note("reading the scene that %s was trained on (--scene tells where it is now)", run);
    if (!given->path && !place && (st == CLN_OK || st == CLN_INPUT)) {
        if (st != CLN_OK)
            snprintf(why, sizeof why, "%s", cln_error_text());
        cln_clear_error();
        if (*scene && kept)
            CLN_TRY(cln_scene_moved_since(*scene, kept, &since));
        if (!*scene || !kept || since.elsewhere) /* one that grew is the run's */
            CLN_TRY(look_elsewhere(run, dataset, &desc, path, scene));
        if (!*scene)
            CLN_TRY(cln_fail(CLN_INPUT, "%s", why));
    }
    CLN_TRY(st);
    keep_background(document, &config, *scene);
    if (json_is_true(json_object_get(document, "bbox_found")))
        (*scene)->box_given = false;
    CLN_TRY(compare(run, dataset, *scene, place, same));
    if (!*same && (resumes || !given->path)) /* one to look at may be another capture */
        CLN_TRY(compare_poses(run, *scene, kept, resumes, given->path != NULL));
done:
    if (st != CLN_OK) {
        cln_scene_free(*scene);
        *scene = NULL;
    }
    cln_scene_free(kept);
    json_decref(document);
    free(path);
    return st;
}

cln_status cln_recorded_load(const char *run, const cln_scene_desc *desc, cln_scene **scene,
                             bool *same)
{
    return load(run, desc, false, scene, same);
}

cln_status cln_recorded_resume(const char *run, const cln_scene_desc *desc, cln_scene **scene,
                               bool *same)
{
    return load(run, desc, true, scene, same);
}

cln_status cln_recorded_photos(const char *run, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *dataset = NULL, *saved = NULL, *least = NULL, *before = NULL;
    char now[CLN_SPAN_BYTES], then[CLN_SPAN_BYTES];
    bool other = false;

    CLN_TRY(cln_reader_run(run, &document));
    dataset = json_object_get(document, "dataset");
    saved = json_object_get(dataset, "missing");
    if (json_is_integer(saved) && json_integer_value(saved) != scene->missing)
        cln_warn("%s: %d image%s left out now, %d when %s began%s", scene->folder, scene->missing,
                 cln_plural(scene->missing, " is", "s are"), (int)json_integer_value(saved), run,
                 scene->missing > json_integer_value(saved)
                     ? "; it goes on without (--missing fail: it does not)"
                     : "");
    if (json_is_object(json_object_get(dataset, "masks")) && scene->mask_count == 0)
        cln_warn("%s: its photos had masks when %s began, and have none now", scene->folder, run);
    saved = json_object_get(dataset, "downscale");
    least = json_object_get(dataset, "downscale_least");
    least = least ? least : saved;
    if (json_is_integer(saved) && (json_integer_value(saved) != scene->downscale ||
                                   json_integer_value(least) != scene->downscale_least)) {
        cln_format_span(scene->downscale_least, scene->downscale, now);
        cln_format_span((int)json_integer_value(least), (int)json_integer_value(saved), then);
        cln_warn("--downscale: photos are divided by %s now, by %s before; figures of quality do "
                 "not compare with earlier ones, as test photos change in size, too",
                 now, then);
    }
    before = json_object_get(dataset, "background");
    for (size_t i = 0; i < 3 && json_array_size(before) == 3; i++)
        other |= fabs(json_number_value(json_array_get(before, i)) - scene->background[i]) > 1e-6;
    if (other)
        cln_warn("--background: it differs from before, also behind test photos with alpha; "
                 "figures of quality do not compare with earlier ones");
done:
    json_decref(document);
    return st;
}
