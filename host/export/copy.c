/* export --copy: a run of the newest model alone, for pictures, the viewer and exports on another
 * machine. Without the state of training, older checkpoints, curves, evaluations and report. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/files.h"
#include "base/log.h"
#include "export/export.h"
#include "io/disk.h"
#include "io/run_folder.h"
#include "render/recorded.h"
#include "scene/cameras_file.h"
#include "scene/origin.h"
#include "scene/reader.h"

/* What run.json says of the run holds for the copy, but where its scene is from it. If it is
 * nowhere, the copy may find it where it was, or beside itself. */
static cln_status make_manifest(const cln_export_desc *desc, int64_t step, json_t **out)
{
    cln_status st = CLN_OK;
    json_t *document = NULL, *dataset = NULL;
    char *path = NULL;

    CLN_TRY(cln_reader_run(desc->run, &document));
    if (strcmp(cln_json_text(document, "state"), "running") == 0) /* which the copy is not */
        json_object_set_new(document, "state", json_string("interrupted"));
    (void)cln_run_drop_result(document, step);
    dataset = json_object_get(document, "dataset");
    CLN_TRY(cln_origin_hide(dataset));
    st = cln_recorded_scene(desc->run, &path);
    if (st == CLN_INPUT) {
        cln_clear_error();
        json_object_set_new(dataset, "path_from_run", json_null());
        st = CLN_OK;
    } else if (st == CLN_OK) {
        st = cln_recorded_place(desc->file, path, dataset);
    }
    CLN_TRY(st);
    *out = json_incref(document);
done:
    json_decref(document);
    free(path);
    return st;
}

static cln_status copy_cameras(const cln_export_desc *desc)
{
    cln_status st = CLN_OK;
    char *from = NULL, *to = NULL;

    CLN_TRY(cln_path_join(&from, desc->run, CLN_CAMERAS_FILE));
    CLN_TRY(cln_path_join(&to, desc->file, CLN_CAMERAS_FILE));
    if (cln_is_file(from))
        CLN_TRY(cln_copy_file(from, to));
    else
        cln_warn("%s: it keeps no cameras, as older programs did not: the copy is rendered, viewed "
                 "and exported where its scene is found",
                 desc->run);
done:
    free(from);
    free(to);
    return st;
}

/* After a failure: a copy is whole or not there. */
static void remove_copy(const char *folder, int64_t step)
{
    char document[64], tensors[64];
    const char *const names[] = {
        "run.json", CLN_CAMERAS_FILE, "checkpoint/latest", document, tensors, "checkpoint", ""};

    snprintf(document, sizeof document, "checkpoint/%08lld.json", (long long)step);
    snprintf(tensors, sizeof tensors, "checkpoint/%08lld.safetensors", (long long)step);
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        char *path = NULL;

        if (cln_path_join(&path, folder, names[i]) == CLN_OK)
            (void)remove(path); /* a folder only if it is empty */
        free(path);
    }
}

cln_status cln_export_copy(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    json_t *manifest = NULL;
    struct stat there;
    bool begun = false;

    if (lstat(desc->file, &there) == 0)
        CLN_TRY(
            cln_fail(CLN_OUTPUT, "%s: already exists; name a new folder for the copy", desc->file));
    CLN_TRY(cln_disk_check(desc->file, cln_checkpoint_newest_bytes(desc->run), "the copy"));
    CLN_TRY(cln_export_poll(&desc->callbacks));
    CLN_TRY(cln_run_open(desc->file, false));
    begun = true;
    CLN_TRY(make_manifest(desc, job->opened.model.step,
                          &manifest)); /* paths are told from the folder */
    CLN_TRY(cln_checkpoint_write(desc->file, &job->opened.model)); /* read without that state */
    CLN_TRY(copy_cameras(desc));
    CLN_TRY(cln_export_poll(&desc->callbacks));
    CLN_TRY(cln_run_write(desc->file, manifest)); /* last: then it is whole */
done:
    if (st != CLN_OK && begun)
        remove_copy(desc->file, job->opened.model.step);
    json_decref(manifest);
    return st;
}
