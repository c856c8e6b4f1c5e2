/* A training in the browser. See watch.h. Pictures take the densities that training has cached:
 * their own would cost a pass over all leaves for every few steps. */
#include "train/watch.h"

#include <jansson.h>
#include <math.h>
#include <signal.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/memory.h"
#include "device/queue.h"
#include "io/json.h"
#include "ranks/ranks.h"
#include "render/frames.h"
#include "render/orbit.h"
#include "train/allowance.h"
#include "train/curve.h"
#include "view/facts.h"
#include "view/server.h"

static const double STANDARD_SHARE = 0.2, MOST_SHARE = 0.9;
static const double SAY_SECONDS = 0.5;
static const double MOST_CREDIT = 1;    /* seconds of painting that can be saved up */
static const double TURN_SECONDS = 0.2; /* most painting between two steps */
static const double WAIT_SECONDS = 0.1; /* for requests, while the training pauses */

struct cln_watch {
    cln_listener listener;
    cln_painter painter;
    cln_server *server;
    char *facts;
    cln_allowance allowance; /* of painting */
    double began, spent;     /* start; seconds of painting since, without pauses */
    bool paused, stopped;
    const char *state;
    double said_at;
    double test; /* newest test PSNR that is in the curve */
    cln_curve curve;
};

/* ---- how it stands ---- */

static void add_point(cln_trainer *t)
{
    struct cln_watch *w = t->watch;
    const bool tested = isfinite(t->psnr_test) && t->psnr_test != w->test;

    if (!(t->shown.rays_per_s > 0))
        return;
    cln_curve_add(&w->curve, &(cln_curve_point){.seconds = t->model.train_seconds,
                                                .train = t->shown.psnr_train,
                                                .test = tested ? t->psnr_test : NAN,
                                                .leaves = t->pipeline.leaves});
    w->test = tested ? t->psnr_test : w->test;
}

static json_t *curve_json(const cln_curve *c)
{
    json_t *curve = json_array();

    for (int i = 0; i < c->count; i++)
        json_array_append_new(curve,
                              json_pack("[f, o, o, i]", c->points[i].seconds,
                                        cln_json_real(c->points[i].train),
                                        cln_json_real(c->points[i].test), c->points[i].leaves));
    return curve;
}

/* Under the names that the page shows. */
static json_t *stages_json(const cln_trainer *t)
{
    const bool voxels = t->model.config.encoding == CLN_ENCODING_VOXEL;
    json_t *stages = json_object();

    for (int i = 0; i < CLN_STAGES; i++)
        if (t->device->stage_seconds[i] > 0)
            json_object_set_new(stages, cln_stage_text(cln_stage_names[i], voxels),
                                json_real(t->device->stage_seconds[i]));
    return stages;
}

/* If memory is short, viewers keep the previous text. */
static void tell(cln_trainer *t)
{
    struct cln_watch *w = t->watch;
    const cln_train_progress *p = &t->shown;
    const bool known = p->rays_per_s > 0;
    json_t *document = NULL;
    char *text = NULL;

    w->said_at = cln_now();
    add_point(t);
    document = json_pack(
        "{s:s, s:I, s:I, s:f, s:f, s:f, s:o, s:i, s:o, s:o, s:o, s:o, s:o, s:i, s:f, s:f, s:o, "
        "s:f, s:o, s:o}",
        "state", w->state, "step", (json_int_t)t->model.step, "steps", (json_int_t)t->steps,
        "fraction", p->fraction, "seconds", t->model.train_seconds, "wall_seconds",
        cln_now() - t->began, "eta", cln_json_real(known ? p->eta : NAN), "unmeasured",
        p->unmeasured, "rays_per_s", cln_json_real(known ? p->rays_per_s : NAN), "samples_per_ray",
        cln_json_real(known ? p->samples_per_ray : NAN), "loss",
        cln_json_real(known ? p->loss : NAN), "psnr_train",
        cln_json_real(known ? p->psnr_train : NAN), "psnr_test", cln_json_real(t->psnr_test),
        "leaves", t->pipeline.leaves, "params",
        cln_network_learned(&t->pipeline.net, t->pipeline.leaves), "device_bytes",
        (double)t->device->allocated, "saved_step",
        t->saved_step < 0 ? json_null() : json_integer(t->saved_step), "viewing",
        w->spent / fmax(cln_now() - w->began, 1e-9), "stages", stages_json(t), "curve",
        curve_json(&w->curve));
    text = document ? json_dumps(document, JSON_COMPACT | JSON_REAL_PRECISION(9)) : NULL;
    json_decref(document);
    if (text)
        cln_server_tell(w->server, text);
}

void cln_watch_say(cln_trainer *t, const char *state)
{
    struct cln_watch *w = t->watch;

    if (!w || !w->server || w->state == state)
        return;
    w->state = state;
    tell(t);
}

/* ---- orders ---- */

int cln_watch_orders(cln_trainer *t)
{
    struct cln_watch *w = t->watch;
    const unsigned orders = w && w->server ? cln_server_orders(w->server) : 0;

    if (orders & (CLN_ORDER_PAUSE | CLN_ORDER_CONTINUE))
        w->paused = orders & CLN_ORDER_PAUSE;
    if (orders & CLN_ORDER_STOP) {
        w->stopped = true;
        return SIGINT;
    }
    return orders & CLN_ORDER_SAVE ? SIGUSR1 : 0;
}

bool cln_watch_paused(const cln_trainer *t)
{
    return t->watch && t->watch->paused;
}

bool cln_watch_stopped(const cln_trainer *t)
{
    return t->watch && t->watch->stopped;
}

/* ---- painting ---- */

bool cln_watch_due(cln_trainer *t)
{
    struct cln_watch *w = t->watch;
    const double now = cln_now();
    bool asked = false, allowed = false;

    if (!w)
        return false;
    if (now - w->said_at >= SAY_SECONDS)
        tell(t);
    asked = cln_server_asked(w->server);
    allowed = cln_allowance_pass(&w->allowance, now);
    return w->paused || (asked && allowed);
}

cln_status cln_watch_paint(cln_trainer *t)
{
    cln_status st = CLN_OK;
    struct cln_watch *w = t->watch;
    const double began = cln_now();
    double before = began, now = began;
    bool painted = false, any = false, more = true;

    cln_queue_book(t->device, CLN_STAGE_VIEWING);
    while (more) {
        CLN_TRY(cln_server_turn(w->server, w->paused ? WAIT_SECONDS : 0, &painted));
        any |= painted;
        now = cln_now();
        if (painted && !w->paused) {
            cln_allowance_spend(&w->allowance, now - before);
            w->spent += now - before;
        }
        more = painted && now - began < TURN_SECONDS &&
               (cln_allowance_pass(&w->allowance, now) || w->paused);
        before = now;
    }
    if (any)
        CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
done:
    cln_queue_book(t->device, CLN_STAGES);
    return st;
}

/* ---- beginning and end ---- */

cln_status cln_watch_open(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_live_desc *live = t->desc->live;
    struct cln_watch *w = NULL;

    if (!live)
        return CLN_OK;
    CLN_TRY(cln_serve_possible());
    if (cln_ranks_count() > 1)
        CLN_TRY(cln_fail(CLN_USAGE, "--view: a training by several processes cannot be watched; "
                                    "leave it out, and look at its checkpoints with `view`"));
    if (!(live->share >= 0 && live->share <= MOST_SHARE))
        CLN_TRY(cln_fail(CLN_USAGE, "--view-share: %g %% is not from 0 to %g %%", 100 * live->share,
                         100 * MOST_SHARE));
    CLN_TRY(cln_alloc(&w, 1, sizeof *w, "viewer"));
    w->listener.socket = -1;
    t->watch = w;
    w->allowance = (cln_allowance){.share = live->share > 0 ? live->share : STANDARD_SHARE,
                                   .most = MOST_CREDIT};
    w->curve.every = SAY_SECONDS;
    w->state = "training";
    CLN_TRY(cln_listen_open(live->listen, live->port, &w->listener));
done:
    return st;
}

cln_status cln_watch_start(cln_trainer *t)
{
    cln_status st = CLN_OK;
    struct cln_watch *w = t->watch;
    cln_orbit_frame frame;
    cln_camera first;
    char *transforms = NULL;
    cln_facts facts = {.run = t->desc->run,
                       .model = &t->model,
                       .scene = t->scene,
                       .frame = &frame,
                       .start = &first,
                       .training = true};

    if (!w)
        return CLN_OK;
    w->painter = (cln_painter){
        .pipeline = &t->pipeline, .model = &t->model, .scene = t->scene, .training = true};
    CLN_TRY(cln_orbit_frame_of(t->scene, (const double[3]){0}, &frame));
    CLN_TRY(cln_facts_camera(&frame, &first));
    CLN_TRY(cln_frames_transforms(t->desc->run, t->scene->path, t->scene->dialect, &transforms,
                                  &facts.transforms_gone));
    facts.transforms = transforms;
    CLN_TRY(cln_facts_text(&facts, &w->facts));
    cln_queue_book(t->device, CLN_STAGE_VIEWING);
    CLN_TRY(cln_painter_open(&w->painter, &first));
    CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    CLN_TRY(cln_server_open(
        &(cln_server_desc){
            .listener = &w->listener, .painter = &w->painter, .facts = w->facts, .training = true},
        &w->server));
    w->test = t->psnr_test;
    w->began = w->allowance.at = cln_now();
    tell(t);
    cln_listen_say(&w->listener);
    if (t->desc->live->ready)
        t->desc->live->ready(w->listener.address, t->desc->live->user);
done:
    cln_queue_book(t->device, CLN_STAGES);
    free(transforms);
    return st;
}

void cln_watch_close(cln_trainer *t)
{
    struct cln_watch *w = t->watch;

    if (!w)
        return;
    cln_server_close(w->server);
    cln_listen_close(&w->listener);
    free(w->facts);
    free(w);
    t->watch = NULL;
}
