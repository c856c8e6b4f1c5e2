/* cln_view_run: opens a run for a browser. host/view answers the requests and paints. */
#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "io/json.h"
#include "io/run_folder.h"
#include "render/frames.h"
#include "render/open_run.h"
#include "ranks/ranks.h"
#include "render/orbit.h"
#include "scene/reader.h"
#include "view/facts.h"
#include "view/server.h"

static const double LOOK_SECONDS = 2; /* how often a newer model is looked for */

/* Opens the run with its cameras, and photos where the scene is here. If it is not, and the run is
 * so old that it keeps no cameras, the orbit in run.json is enough to look at it. */
static cln_status open_run(const cln_view_desc *desc, cln_open_run *opened, cln_orbit_frame *frame)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    const json_t *orbit = NULL;
    bool alike = false;

    CLN_TRY(cln_reader_run(desc->run, &document));
    orbit = json_object_get(document, "orbit");
    st = cln_open_run_cameras(desc->run, desc->scene, &desc->callbacks, &alike, opened);
    if (st == CLN_OK) {
        st = cln_orbit_frame_of(opened->scene, desc->up, frame);
    } else if (st == CLN_INPUT && !desc->scene && orbit && alike) {
        if (cln_ranks_me() == 0)
            cln_warn("no cameras and photos: %s", cln_error_text());
        cln_clear_error();
        CLN_TRY(cln_open_run_model(desc->run, opened));
        CLN_TRY(cln_orbit_frame_read(orbit, frame));
        cln_orbit_frame_turn(desc->up, frame);
    }
    if (st == CLN_OK && frame->guessed && cln_ranks_me() == 0)
        cln_up_warn("the first view", frame->up);
done:
    json_decref(document);
    return st;
}

/* The run's newest checkpoint when its model was read, or pages were told of it. */
typedef struct newest {
    char *path; /* of `latest`, which each checkpoint writes as a new file */
    struct stat file;
    double looked;
} newest;

typedef enum { AS_IT_WAS, REPLACED, GONE } fate;

/* What has become of the file since the last look. */
static fate look(newest *n)
{
    const struct stat before = n->file;

    if (stat(n->path, &n->file) != 0) {
        n->file = (struct stat){0}; /* if it comes back, it is another one */
        return errno == ENOENT || errno == ENOTDIR ? GONE : AS_IT_WAS;
    }
    return n->file.st_ino != before.st_ino || n->file.st_mtim.tv_sec != before.st_mtim.tv_sec ||
                   n->file.st_mtim.tv_nsec != before.st_mtim.tv_nsec
               ? REPLACED
               : AS_IT_WAS;
}

/* Pages are told of a newer model, or that the run's files are gone; the model that is shown stays.
 * newer: its step; negative: none. */
static cln_status tell(cln_server *server, bool gone, int64_t newer)
{
    cln_status st = CLN_OK;
    char *text = NULL;

    if (newer < 0)
        CLN_TRY(cln_asprintf(&text, "{\"newer\": null, \"gone\": %s}", gone ? "true" : "false"));
    else
        CLN_TRY(cln_asprintf(&text, "{\"newer\": %lld, \"gone\": false}", (long long)newer));
    cln_server_tell(server, text);
done:
    return st;
}

/* Until a signal ends it. */
static cln_status serve(const cln_view_desc *desc, newest *n, cln_server *server,
                        cln_painter *painter)
{
    cln_status st = CLN_OK;
    bool painted = false;

    for (;;) {
        CLN_TRY(cln_stopped_by(cln_painter_signal(painter, &desc->callbacks), NULL));
        if (cln_now() - n->looked > LOOK_SECONDS) {
            n->looked = cln_now();
            switch (look(n)) {
            case AS_IT_WAS:
                break;
            case REPLACED:
                CLN_TRY(tell(server, false, cln_checkpoint_newest(desc->run)));
                break;
            case GONE:
                CLN_TRY(tell(server, true, -1));
            }
        }
        CLN_TRY(cln_server_turn(server, 0.1, &painted));
    }
done:
    return st;
}

/* The transforms JSON that a path in nerfstudio's frame is brought by. */
static cln_status find_transforms(const cln_view_desc *desc, const cln_scene *scene, char **path,
                                  bool *gone)
{
    cln_status st = CLN_OK;
    const char *dialect = scene ? scene->dialect : NULL;
    json_t *document = NULL;

    CLN_TRY(cln_reader_run(desc->run, &document));
    if (!dialect || !desc->scene)
        dialect = cln_json_text(json_object_get(document, "dataset"), "dialect");
    CLN_TRY(cln_frames_transforms(desc->run, desc->scene, dialect, path, gone));
done:
    json_decref(document);
    return st;
}

/* By ranks: rank 0 serves, and the others render their part of each batch. */
static cln_status check_ranks(const cln_model *model)
{
    return cln_ranks_count() > 1 ? cln_ranks_agree(cln_model_digest(model), "checkpoint") : CLN_OK;
}

cln_status cln_view_run(const cln_view_desc *desc)
{
    cln_status st = CLN_OK;
    const bool serves = cln_ranks_me() == 0;
    cln_listener listener = {.socket = -1};
    cln_open_run opened = {0};
    cln_painter painter = {.pipeline = &opened.pipeline, .model = &opened.model};
    cln_server *server = NULL;
    cln_orbit_frame frame;
    cln_camera first;
    char *text = NULL, *transforms = NULL;
    newest last = {0};
    cln_facts facts = {.model = &opened.model, .frame = &frame, .start = &first};

    cln_clear_error();
    CLN_TRY(cln_given("cln_view_run", "desc", desc));
    CLN_TRY(cln_given("cln_view_run", "run", desc->run));
    CLN_TRY(cln_up_check("cln_view_run", desc->up));
    facts.run = desc->run;
    CLN_TRY(cln_serve_possible());
    CLN_TRY(cln_device_check(&desc->device));
    if (serves)
        CLN_TRY(cln_listen_open(desc->listen, desc->port, &listener));
    CLN_TRY(open_run(desc, &opened, &frame));
    CLN_TRY(cln_path_join(&last.path, desc->run, "checkpoint/latest"));
    (void)look(&last);
    CLN_TRY(check_ranks(&opened.model));
    facts.scene = painter.scene = opened.scene;
    CLN_TRY(cln_facts_camera(&frame, &first));
    CLN_TRY(cln_open_run_start(&opened, &desc->device, opened.scene ? opened.scene->lenses : 0));
    if (!serves) {
        st = cln_painter_follow(&painter, &desc->callbacks);
        goto done;
    }
    CLN_TRY(cln_painter_open(&painter, &first));
    CLN_TRY(find_transforms(desc, opened.scene, &transforms, &facts.transforms_gone));
    facts.transforms = transforms;
    CLN_TRY(cln_facts_text(&facts, &text));
    CLN_TRY(cln_server_open(
        &(cln_server_desc){.listener = &listener, .painter = &painter, .facts = text}, &server));
    CLN_TRY(tell(server, false, -1));
    cln_listen_say(&listener);
    if (desc->ready)
        desc->ready(listener.address, desc->callbacks.user);
    st = serve(desc, &last, server, &painter);
done:
    if (st == CLN_OK || st == CLN_SIGINT || st == CLN_SIGTERM) /* else it ends all */
        cln_painter_end(&painter);
    cln_server_close(server);
    cln_listen_close(&listener);
    cln_open_run_close(&opened);
    free(last.path);
    free(text);
    free(transforms);
    return st;
}
