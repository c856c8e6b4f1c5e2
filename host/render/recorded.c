/* What run.json records of a run, read back. See recorded.h. */
#include "render/recorded.h"

#include <stdio.h>
#include <string.h>

#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/run_folder.h"

cln_status cln_run_config(const char *run, cln_config *config, char **scene)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *dataset = NULL;

    if (scene)
        *scene = NULL;
    CLN_TRY(cln_run_read(run, &document));
    CLN_TRY(cln_config_from_json(json_object_get(document, "config"), config));
    dataset = json_object_get(document, "dataset");
    if (scene)
        CLN_TRY(cln_strdup(scene, json_string_value(json_object_get(dataset, "path"))));
    if (scene && !*scene)
        st = cln_fail(CLN_INPUT, "%s/run.json: dataset.path is missing", run);
done:
    json_decref(document);
    return st;
}

static bool same_text(const json_t *object, const char *key, const char *text)
{
    const char *saved = json_string_value(json_object_get(object, key));

    return saved && strcmp(saved, text) == 0;
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
    CLN_TRY(cln_run_read(run, &document));
    saved = json_object_get(document, "device");
    list = json_string_value(json_object_get(document, "tune"));
    from = json_string_value(json_object_get(document, "tune_from"));
    if (!list || !same_text(saved, "name", device->info.name) ||
        !same_text(saved, "platform", device->info.platform) ||
        !same_text(saved, "driver", device->info.driver))
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

cln_status cln_recorded_compare(const char *run, const cln_scene *scene)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const char *saved = NULL;
    char digest[24];

    CLN_TRY(cln_run_read(run, &document));
    saved = json_string_value(json_object_get(json_object_get(document, "dataset"), "digest"));
    snprintf(digest, sizeof digest, "%016llx", (unsigned long long)scene->digest);
    if (!saved || strcmp(saved, digest) != 0)
        cln_warn(
            "%s: the scene is not the one that %s began with (digest %s, was %s); results will "
            "not be those of the same photos and poses",
            scene->folder, run, digest, saved ? saved : "unknown");
done:
    json_decref(document);
    return st;
}
