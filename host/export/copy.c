/* export --copy: a run of the newest model alone, for pictures, the viewer and exports on another
 * machine. Without the state of training, older checkpoints, curves, evaluations and report. */
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "export/export.h"
#include "io/disk.h"
#include "io/run_folder.h"
#include "render/recorded.h"
#include "scene/cameras_file.h"

/* What run.json says of the run holds for the copy, but where its scene is from it. */
static cln_status write_manifest(const cln_export_desc *desc)
{
    cln_status st = CLN_OK;
    json_t *document = NULL, *dataset = NULL;
    const char *scene = NULL;
    char *path = NULL;

    CLN_TRY(cln_run_read(desc->run, &document));
    if (strcmp(cln_run_state(desc->run, document), "running") == 0) /* which the copy is not */
        json_object_set_new(document, "state", json_string("interrupted"));
    dataset = json_object_get(document, "dataset");
    scene = json_string_value(json_object_get(dataset, "path"));
    if (scene) {
        CLN_TRY(cln_strdup(&path, scene)); /* which is replaced */
        CLN_TRY(cln_recorded_place(desc->file, path, dataset));
    }
    CLN_TRY(cln_run_write(desc->file, document));
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

cln_status cln_export_copy(cln_export_job *job)
{
    cln_status st = CLN_OK;
    const cln_export_desc *desc = job->desc;
    struct stat there;

    if (lstat(desc->file, &there) == 0)
        CLN_TRY(
            cln_fail(CLN_OUTPUT, "%s: already exists; name a new folder for the copy", desc->file));
    CLN_TRY(cln_disk_check(desc->file, cln_checkpoint_newest_bytes(desc->run), "the copy"));
    CLN_TRY(cln_run_open(desc->file, false));
    CLN_TRY(cln_checkpoint_write(desc->file, &job->opened.model)); /* read without that state */
    CLN_TRY(copy_cameras(desc));
    CLN_TRY(write_manifest(desc)); /* last: then it is whole */
done:
    return st;
}
