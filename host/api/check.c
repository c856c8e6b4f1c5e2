/* cln_check: reports on a scene, as JSON and as a page. Decodes all images. Needs a device only for
 * the figures of memory and time. */
#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "api/needs.h"
#include "base/callbacks.h"
#include "base/files.h"
#include "base/given.h"
#include "base/memory.h"
#include "cl_nascent.h"
#include "device/kernel_dir.h"
#include "io/disk.h"
#include "report/scene_page.h"
#include "scene/inspect.h"
#include "scene/standing.h"

static cln_status check_page(const cln_check_desc *desc)
{
    const char *ending = desc->page ? strrchr(desc->page, '.') : NULL;

    if (!desc->page)
        return CLN_OK;
    if (!ending || strcasecmp(ending, ".html") != 0)
        return cln_fail(CLN_USAGE, "%s: the page is HTML; end the name with .html", desc->page);
    return cln_disk_check_new(desc->page, desc->overwrite);
}

/* Its folder need not be there: `masks` is none of most scenes. */
static cln_status check_mask(const cln_check_desc *desc)
{
    cln_status st = CLN_OK;
    const char *ending = strrchr(desc->mask, '.'), *slash = strrchr(desc->mask, '/');
    char *folder = NULL;

    if (!ending || strcasecmp(ending, ".png") != 0)
        CLN_TRY(cln_fail(CLN_USAGE, "%s: the mask is a PNG; end the name with .png", desc->mask));
    CLN_TRY(cln_asprintf(&folder, "%.*s", slash ? (int)(slash - desc->mask) : 1,
                         slash ? desc->mask : "."));
    CLN_TRY(cln_is_dir(folder) ? cln_disk_check_new(desc->mask, desc->overwrite)
                               : cln_disk_check(folder, 0, "the mask"));
done:
    free(folder);
    return st;
}

static cln_status check(const cln_check_desc *desc, const cln_settings *settings, char **json)
{
    cln_status st = CLN_OK;
    cln_config config = settings->config;
    const cln_scene_desc wanted = {.path = desc->scene,
                                   .config = &config,
                                   .pixels = {true, true, true},
                                   .unseen = true,
                                   .all_told = settings->config.missing == CLN_MISSING_AUTO,
                                   .callbacks = &desc->callbacks};
    cln_settings_facts facts;
    cln_scene *scene = NULL;
    json_t *document = NULL, *about = NULL, *inspected = NULL;
    cln_placed placed;

    *json = NULL;
    if (config.missing == CLN_MISSING_AUTO)
        config.missing = CLN_MISSING_SKIP; /* a finding, however many they are */
    CLN_TRY(check_page(desc));
    if (desc->mask)
        CLN_TRY(check_mask(desc));
    CLN_TRY(cln_kernel_dir_check(desc->device.kernel_dir));
    CLN_TRY(cln_scene_load(&wanted, &scene));
    CLN_TRY(cln_scene_place_cube(scene, &config, &desc->callbacks, &placed)); /* as train does */
    if (desc->mask)
        CLN_TRY(cln_scene_write_standing(scene, desc->mask));
    facts = cln_needs_facts(scene, &settings->config);
    cln_settings_warn_idle(settings, &facts);
    cln_settings_warn_points(&settings->config);
    CLN_TRY(cln_scene_describe(scene, &about));
    json_object_del(about, "cameras"); /* "views" says more about them */
    CLN_TRY(cln_scene_inspect(scene, &desc->callbacks, &inspected));
    document = json_pack(
        "{s:s, s:O, s:O, s:O, s:o, s:O, s:O}", "schema", "cl-nascent.check/1", "findings",
        json_object_get(inspected, "findings"), "measures", json_object_get(inspected, "measures"),
        "scene", about, "training",
        cln_needs_describe(scene, settings, &desc->device, desc->probe, &desc->callbacks), "views",
        json_object_get(inspected, "views"), "points", json_object_get(inspected, "points"));
    CLN_TRY(cln_tell_work(&desc->callbacks, NULL, 0, 0)); /* interrupted, it lacks times */
    *json = document ? json_dumps(document, JSON_INDENT(2) | JSON_REAL_PRECISION(17)) : NULL;
    if (!*json)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot make JSON", desc->scene));
    if (desc->page)
        CLN_TRY(cln_scene_page(desc->page, scene, document));
done:
    json_decref(document);
    json_decref(about);
    json_decref(inspected);
    cln_scene_free(scene);
    if (st != CLN_OK) {
        free(*json);
        *json = NULL;
    }
    return st;
}

cln_status cln_check(const cln_check_desc *desc, char **json)
{
    cln_status st = CLN_OK;
    const cln_settings *settings = NULL;
    cln_settings *own = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_check", "json", json));
    *json = NULL;
    CLN_TRY(cln_given("cln_check", "desc", desc));
    CLN_TRY(cln_given("cln_check", "scene", desc->scene));
    CLN_TRY(cln_given_number("cln_check", "probe", desc->probe, 0, 600));
    CLN_TRY(cln_given_settings(desc->settings, &own, &settings));
    st = check(desc, settings, json);
done:
    cln_settings_free(own);
    return st;
}
