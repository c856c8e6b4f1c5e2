/* cln_info_scene, cln_info_run: the output of `info`, as JSON text. Reads files but decodes no
 * image; for a scene it also asks a device, if there is one, how much memory a training would
 * need. */
#include <stdlib.h>
#include <string.h>

#include "api/needs.h"
#include "base/files.h"
#include "base/given.h"
#include "base/memory.h"
#include "base/settings.h"
#include "cl_nascent.h"
#include "io/run_folder.h"
#include "model/model.h"
#include "scene/reader.h"
#include "scene/scene.h"

static cln_status to_text(const json_t *document, const char *what, char **json)
{
    *json = json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(17));
    return *json ? CLN_OK : cln_fail(CLN_MEMORY, "%s: cannot make JSON", what);
}

/* Photos are not decoded here, so that the cube is the one before what their alpha shows. */
static cln_status say_alpha(const cln_scene *scene, json_t *described)
{
    cln_status st = CLN_OK;
    char *rule = NULL;

    if (!scene->cube_guessed || !scene->has_alpha || scene->space.shell)
        return CLN_OK;
    CLN_TRY(cln_asprintf(&rule,
                         "%s; train takes a box around what the photos' alpha shows, if "
                         "that spans less than half of it",
                         scene->bounds_rule));
    json_object_set_new(described, "bounds_rule", json_string(rule));
done:
    free(rule);
    return st;
}

static cln_status info_scene(const char *path, const cln_settings *settings, char **json)
{
    cln_status st = CLN_OK;
    const cln_scene_desc desc = {.path = path, .config = &settings->config};
    cln_settings_facts facts;
    cln_scene *scene = NULL;
    json_t *document = json_object(), *described = NULL, *cameras = NULL;

    *json = NULL;
    CLN_TRY(cln_scene_load(&desc, &scene));
    cln_scene_warn_doubts(scene);
    facts = cln_needs_facts(scene, &settings->config);
    facts.no_sights = false; /* not looked for, without photos */
    cln_settings_warn_idle(settings, &facts);
    cln_settings_warn_points(&settings->config);
    CLN_TRY(cln_scene_describe(scene, &described));
    CLN_TRY(say_alpha(scene, described));
    json_object_set_new(document, "schema", json_string("cl-nascent.scene/1"));
    json_object_update(document, described);
    cameras = json_incref(json_object_get(document, "cameras"));
    json_object_del(document, "cameras");
    json_object_set_new(document, "training",
                        cln_needs_describe(scene, settings, &(cln_device_desc){0}, 0, NULL));
    json_object_set_new(document, "cameras", cameras); /* the longest list comes last */
    CLN_TRY(to_text(document, path, json));
done:
    json_decref(document);
    json_decref(described);
    cln_scene_free(scene);
    return st;
}

cln_status cln_info_scene(const char *scene, const cln_settings *settings, char **json)
{
    cln_status st = CLN_OK;
    const cln_settings *use = NULL;
    cln_settings *own = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_info_scene", "json", json));
    *json = NULL;
    CLN_TRY(cln_given("cln_info_scene", "scene", scene));
    CLN_TRY(cln_given_settings(settings, &own, &use));
    st = info_scene(scene, use, json);
done:
    cln_settings_free(own);
    return st;
}

/* Adds what the newest checkpoint says; all null while there is none. */
static cln_status add_checkpoint(const char *run, json_t *about)
{
    static const char *const keys[] = {"step",   "train_seconds", "leaves",    "leaves_by_level",
                                       "params", "model_digest",  "checkpoint"};
    cln_status st = CLN_OK;
    cln_model model = {0};
    char digest[CLN_DIGEST_TEXT];
    json_t *levels = NULL;
    int count[CLN_MAX_LEVEL + 1] = {0};

    if (cln_checkpoint_newest(run) < 0) {
        for (size_t i = 0; i < sizeof keys / sizeof keys[0]; i++)
            json_object_set_new(about, keys[i], json_null());
        goto done;
    }
    CLN_TRY(cln_checkpoint_read(run, false, &model));
    levels = json_array();
    for (int s = 0; s < model.tree.leaf_count; s++)
        count[model.tree.level[model.tree.leaf[s]]]++;
    for (int level = 0; level <= CLN_MAX_LEVEL; level++)
        json_array_append_new(levels, json_integer(count[level]));
    cln_digest_text(cln_model_digest(&model), digest);
    json_object_set_new(about, "step", json_integer(model.step));
    json_object_set_new(about, "train_seconds", json_real(model.train_seconds));
    json_object_set_new(about, "leaves", json_integer(model.tree.leaf_count));
    json_object_set_new(about, "leaves_by_level", levels);
    json_object_set_new(
        about, "params",
        json_integer((json_int_t)cln_network_learned(&model.net, model.tree.leaf_count)));
    json_object_set_new(about, "model_digest", json_string(digest));
    json_object_set_new(about, "checkpoint",
                        json_pack("{s:i, s:[f,f,f], s:f, s:s}", "params_per_leaf", model.net.params,
                                  "centre", model.space.centre[0], model.space.centre[1],
                                  model.space.centre[2], "half", model.space.half, "space",
                                  cln_space_name(&model.space)));
done:
    cln_model_free(&model);
    return st;
}

cln_status cln_info_run(const char *run, char **json)
{
    cln_status st = CLN_OK;
    json_t *about = json_object(), *document = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_info_run", "json", json));
    *json = NULL;
    CLN_TRY(cln_given("cln_info_run", "run", run));
    CLN_TRY(cln_reader_run(run, &document));
    json_object_set_new(about, "schema", json_string("cl-nascent.info/1"));
    json_object_set_new(about, "run", json_string(run));
    CLN_TRY(add_checkpoint(run, about));
    if (json_object_get(document, "state"))
        json_object_set_new(document, "state", json_string(cln_run_state(run, document)));
    if (json_is_integer(json_object_get(about, "step")) &&
        !cln_run_is_held(run)) /* a training's checkpoint is behind it */
        (void)cln_run_drop_result(document, json_integer_value(json_object_get(about, "step")));
    json_object_update_missing(about, document); /* keeps the keys above: they are newer */
    CLN_TRY(to_text(about, run, json));
done:
    json_decref(about);
    json_decref(document);
    return st;
}
