/* cln_view_run: a run opened for a browser. What is asked of it and how it is painted is
 * host/view's; here is what it is opened with. */
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "io/json.h"
#include "io/run_folder.h"
#include "render/orbit.h"
#include "view/facts.h"
#include "view/server.h"

/* With its scene, for cameras and photos; without them if the scene is not here and the run knows
 * how to look at it. */
static cln_status open_run(const cln_view_desc *desc, cln_open_run *opened, cln_orbit_frame *frame)
{
    cln_status st = CLN_OK;
    const bool pixels[CLN_SPLITS] = {false};
    json_t *document = NULL;
    const json_t *orbit = NULL;

    CLN_TRY(cln_run_read(desc->run, &document));
    orbit = json_object_get(document, "orbit");
    st = cln_open_run_open(desc->run, desc->scene, pixels, opened);
    if (st == CLN_OK) {
        st = cln_orbit_frame_of(opened->scene, frame);
    } else if (st == CLN_INPUT && !desc->scene && orbit) {
        cln_warn("no cameras and photos: %s", cln_error_text());
        cln_clear_error();
        CLN_TRY(cln_open_run_model(desc->run, opened));
        st = cln_orbit_frame_read(orbit, frame);
    }
done:
    json_decref(document);
    return st;
}

/* Where an orbit begins, or the middle of its arc. */
static cln_status first_camera(const cln_orbit_frame *frame, cln_camera *out)
{
    cln_status st = CLN_OK;
    cln_render_desc desc = {.orbit_elevation = frame->elevation};
    cln_orbit orbit;

    CLN_TRY(cln_orbit_make(frame, &desc, &orbit));
    cln_orbit_camera(&orbit, orbit.circle ? 0 : 1, 4, out);
done:
    return st;
}

cln_status cln_view_run(const cln_view_desc *desc)
{
    cln_status st = CLN_OK;
    cln_listener listener = {.socket = -1};
    cln_open_run opened = {0};
    cln_painter painter;
    cln_orbit_frame frame;
    cln_camera first;
    char *facts = NULL;

    CLN_TRY(cln_serve_possible());
    CLN_TRY(cln_listen_open(desc->listen, desc->port, &listener));
    CLN_TRY(open_run(desc, &opened, &frame));
    CLN_TRY(first_camera(&frame, &first));
    CLN_TRY(cln_open_run_start(&opened, &desc->device, opened.scene ? opened.scene->lenses : 0));
    CLN_TRY(cln_painter_open(&opened, &first, &painter));
    CLN_TRY(cln_view_facts(&opened, &frame, &first, &facts));
    st = cln_serve(&listener, &painter, facts, &desc->callbacks, desc->ready, desc->callbacks.user);
done:
    cln_listen_close(&listener);
    cln_open_run_close(&opened);
    free(facts);
    return st;
}
