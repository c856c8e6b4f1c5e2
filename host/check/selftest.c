/* The self-test: pipelines of a few shapes, every check on each. See selftest.h. It shows that a
 * device and its compiler compute the kernels correctly; tests/ covers the kernels' corner
 * cases. */
#include "check/selftest.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/config.h"
#include "base/memory.h"
#include "check/forward_scene.h"
#include "check/selftest_checks.h"

/* ---- shapes ---- */

typedef struct shape {
    const char *name, *preset, *tune; /* tune NULL: the device's */
    bool small;                       /* the smallest network instead of the preset's */
    bool splat, distortion;
    bool forward, shell, crop;    /* checks only rays and samples, as the rest is the same */
    bool in[CLN_SHAPES_TINY + 1]; /* sets of shapes that have it */
} shape;

/* clang-format off */
#define QUICK {[CLN_SHAPES_QUICK] = true, [CLN_SHAPES_ALL] = true}
#define FULL {[CLN_SHAPES_ALL] = true}
#define TINY {[CLN_SHAPES_TINY] = true}
/* clang-format on */

/* Tiny ones are small in every respect: a simulator is a million times slower than a device. */
static const shape shapes[] = {
    {"voxels", "voxel", .in = QUICK},
    {"fast preset", "fast", .in = FULL},
    {"width 16", "fast", .small = true, .splat = true, .distortion = true, .in = QUICK},
    {"work-groups of 64", "fast", "VW=1,NV=1,LS=64,TS=8,NB=16,SL=128,WG=64,SG=64,DB=8,CHUNK=64",
     .small = true, .distortion = true, .in = FULL},
    {"paper preset", "paper", .splat = true, .in = FULL},
    {"forward space", "fast", .small = true, .forward = true, .in = FULL},
    {"shell space", "fast", .small = true, .shell = true, .in = FULL},
    {"cropped", "fast", .small = true, .crop = true, .in = FULL},
    {"tiny, splatting", "fast", "VW=1,NV=1,LS=16,TS=4,NB=8,SL=24,WG=16,SG=16,DB=4,CHUNK=64",
     .small = true, .splat = true, .distortion = true, .in = TINY},
    {"tiny, voxels", "voxel", "VW=1,NV=1,LS=16,TS=4,NB=8,SL=24,WG=16,SG=16,DB=4,CHUNK=64",
     .small = true, .in = TINY},
    {"voxels, work-groups of 16", "voxel",
     "VW=1,NV=1,LS=16,TS=4,NB=8,SL=24,WG=16,SG=16,DB=4,CHUNK=64", .in = FULL},
    {"tiny, gathering", "fast", "VW=1,NV=1,LS=16,TS=4,NB=8,SL=24,WG=16,SG=16,DB=4,CHUNK=64",
     .small = true, .in = TINY},
};

/* A crop box whose faces are not those of leaves; one face is aslant. */
static const float box[6][4] = {{1, 0, 0, 0.61f},  {0, 0.8f, 0.6f, 0.33f}, {0, 0, 1, 0.71f},
                                {-1, 0, 0, 0.57f}, {0, -1, 0, 0.83f},      {0, 0, -1, 0.29f}};

static const double SMOOTH = 1e-5; /* of whose gradients others do not hide errors */

/* Adapts settings to the checks: little work, and slopes that the reference can follow. */
static void prepare(cln_config *config)
{
    config->start_level = 1;
    config->n1 = 5; /* odd: no midpoint between opposite faces lies on a border of cells */
    config->splat_min_alpha = 0;
    config->roulette = 0; /* has its own check */
    if (config->antialias == 0)
        config->antialias = 2; /* whatever the photos are */
    if (config->smooth_density > 0)
        config->smooth_density = SMOOTH;
    if (config->smooth_colour > 0)
        config->smooth_colour = SMOOTH;
    /* runs the code of random slopes with equal bounds, so that the reference needs no hash */
    if (config->rrelu_scope != CLN_RRELU_MEAN)
        config->rrelu_lower = config->rrelu_upper = -0.2;
}

static cln_status config_of(const shape *s, cln_config *config)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_config_preset(s->preset, config));
    config->stage1 = s->splat ? CLN_STAGE1_SPLAT : CLN_STAGE1_GATHER;
    config->rrelu_scope = s->small ? CLN_RRELU_NEURON : config->rrelu_scope;
    prepare(config);
    if (s->in[CLN_SHAPES_TINY])
        config->n1 = 3;
    if (config->encoding == CLN_ENCODING_VOXEL && s->tune)
        config->decoder_width = 16;
    if (s->small) {
        config->width = config->view_width = 16;
        config->depth = config->bands = 2;
        config->view_bands = 1;
        if (config->encoding != CLN_ENCODING_VOXEL)
            config->encoding = CLN_ENCODING_GRID;
        config->grid_cells = 4;
        config->lists = CLN_LISTS_PADDED;
        config->cdf = CLN_CDF_SIGMA;
        config->allocate = CLN_ALLOCATE_CHORD;
        config->loss = CLN_LOSS_HUBER;
        config->opacity_entropy = 0.05;
        config->alpha_loss = 0.1;
        config->depth_loss = 0.2;
        config->random_background = true;
        config->distortion_loss = 0.1;
        config->sparsity = config->edge = 0.1;
    }
done:
    return st;
}

/* Makes a model with leaves of two levels and different weights. */
static cln_status make_model(const cln_config *config, bool shell, cln_model *model)
{
    cln_status st = CLN_OK;
    uint8_t *split = NULL;
    int *owner = NULL;
    cln_octree_change change = {0};
    const double scale = sqrt(2.0 / config->width);

    CLN_TRY(shell ? cln_model_create_shell(config, model) : cln_model_create(config, model));
    CLN_TRY(cln_alloc(&split, (size_t)model->tree.leaf_count, 1, "self-test"));
    split[0] = 1;
    CLN_TRY(cln_octree_split(&model->tree, split, &change));
    CLN_TRY(cln_model_apply(model, &change));
    for (int i = 0; i < model->tree.leaf_count * model->net.params; i++)
        model->params[i] = (float)(scale * cln_check_uniform(1, (uint32_t)i, -1, 1));
    for (int i = 0; i < model->net.decoder_params; i++)
        model->decoder[i] = (float)(0.5 * cln_check_uniform(2, (uint32_t)i, -1, 1));
    CLN_TRY(cln_check_owners(model, &owner));
    for (int i = 0; owner && i < model->tree.leaf_count * model->net.params; i++)
        model->params[i] = model->params[owner[i]];
done:
    free(owner);
    free(split);
    cln_octree_change_free(&change);
    return st;
}

/* Each check compiles the kernels that it runs. */
static cln_status poll(const cln_checks *c)
{
    return cln_stopped_by(cln_poll_signal(c->p->device->callbacks), NULL);
}

static cln_status run_checks(cln_checks *c, bool rays_only)
{
    cln_status st = CLN_OK;
    const int before = c->failed;

    CLN_TRY(cln_check_scan(c));
    if (c->failed > before)
        goto done;
    CLN_TRY(cln_check_sort(c, false));
    if (c->p->config.stage1 == CLN_STAGE1_SPLAT)
        CLN_TRY(cln_check_sort(c, true));
    if (c->failed > before) /* with wrong offsets the others would write anywhere */
        goto done;
    if (!rays_only)
        CLN_TRY(cln_check_densities(c));
    CLN_TRY(poll(c));
    CLN_TRY(cln_check_rays(c));
    if (rays_only)
        goto done;
    CLN_TRY(poll(c));
    CLN_TRY(cln_check_networks(c));
    CLN_TRY(poll(c));
    CLN_TRY(cln_check_composite(c));
    if (cln_pipeline_measures(&c->p->config) > 0)
        CLN_TRY(cln_check_structure(c));
    CLN_TRY(poll(c));
    CLN_TRY(cln_check_carry(c));
done:
    return st;
}

static cln_status run_pipeline(cln_pipeline *p, bool rays_only, cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_model model = {0};

    p->max_entries = 1 << 20;
    CLN_TRY(make_model(&p->config, p->space.shell, &model));
    CLN_TRY(cln_pipeline_rebuild(p, model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(p, &model, !rays_only));
    c->p = p;
    c->model = &model;
    CLN_TRY(run_checks(c, rays_only));
    CLN_TRY(cln_device_finish(p->device));
done:
    cln_model_free(&model);
    return st;
}

static cln_status run_shape(cln_device *device, const shape *s, cln_checks *c)
{
    cln_status st = CLN_OK;
    const cln_tune kept = device->tune;
    const bool exact = device->tune_exact;
    const cln_space shell = {.half = 0.73, .shell = true};
    const cln_space space = s->forward ? cln_check_forward_space(1)
                            : s->shell ? shell
                                       : cln_space_unit;
    const bool rays_only = s->forward || s->shell || s->crop;
    const uint32_t rays_and_samples = CLN_PROGRAM_BIT(rays) | CLN_PROGRAM_BIT(scan) |
                                      CLN_PROGRAM_BIT(sampling) | CLN_PROGRAM_BIT(sort64) |
                                      (s->crop ? CLN_PROGRAM_BIT(sampling_crop) : 0);
    size_t largest = 0;
    cln_config config;
    cln_pipeline pipeline = {0};

    c->shape = s->name;
    c->tiny = s->in[CLN_SHAPES_TINY];
    c->crop = s->crop ? box : NULL;
    CLN_TRY(config_of(s, &config));
    if (s->tune) {
        CLN_TRY(cln_tune_parse(s->tune, &device->tune));
        device->tune_exact = true;
    }
    clGetDeviceInfo(device->id, CL_DEVICE_MAX_WORK_GROUP_SIZE, sizeof largest, &largest, NULL);
    if (s->tune && ((size_t)device->tune.ls > largest || (size_t)device->tune.wg > largest)) {
        cln_check_report(c, s->name, false, true, "the device allows no work-groups of this size");
        goto done;
    }
    st = cln_pipeline_create(
        device, &config,
        &(cln_pipeline_facts){.lenses = s->distortion ? 1u << CLN_LENS_OPENCV : 0,
                              .alpha = s->small,
                              .space = &space},
        rays_only ? rays_and_samples : CLN_PROGRAMS_ALL, &pipeline);
    if (st == CLN_MEMORY && !s->in[CLN_SHAPES_QUICK]) {
        /* training would refuse this network, too */
        cln_check_report(c, s->name, false, true, cln_error_text());
        cln_clear_error();
        st = CLN_OK;
        goto done;
    }
    CLN_TRY(st);
    CLN_TRY(run_pipeline(&pipeline, rays_only, c));
done:
    device->tune = kept;
    device->tune_exact = exact;
    cln_pipeline_free(&pipeline);
    return st;
}

/* Checks that long loops reach their end. In networks and voxels, how many turns a work-item takes
 * depends on the scene, so shapes as small as these may not show it. */
static cln_status check_loops(cln_device *device, cln_checks *c)
{
    cln_status st = CLN_OK;
    const uint32_t n = c->tiny ? 16 : 1024;
    uint32_t got = 0, want = 1;

    c->shape = "loops";
    for (uint32_t i = 0; i < n * n; i++)
        want = want * 1664525u + 1013904223u;
    CLN_TRY(cln_turns(device, n, &got));
    cln_check_say(c, "turns", got == want, got == want ? "%u turns" : "it ends before %u turns",
                  n * n);
done:
    return st;
}

static cln_status verdict(const cln_device *device, const cln_checks *c)
{
    if (c->failed == 0)
        return CLN_OK;
    if (device->kernel_dir)
        return cln_fail(
            CLN_CHECK,
            "%s does not compute correctly with the kernels of %s: %s%s; mend these, or "
            "leave --kernel-dir out, for those of the program",
            device->info.name, device->kernel_dir, c->first, c->failed > 1 ? ", and more" : "");
    return cln_fail(CLN_CHECK,
                    "%s does not compute correctly: %s%s; another driver or device (--device) "
                    "may do better",
                    device->info.name, c->first, c->failed > 1 ? ", and more" : "");
}

/* ---- progress ---- */

typedef struct progress {
    const cln_callbacks *callbacks;
    int done, total, signal;
} progress;

static void poll_callbacks(progress *p)
{
    const int signal = cln_poll_signal(p->callbacks);

    if (signal == SIGINT || signal == SIGTERM)
        p->signal = signal;
}

/* Polls after each check, so that a signal is answered at once. */
static void on_check(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    (void)name, (void)passed, (void)skipped, (void)detail;
    poll_callbacks(user);
}

/* Shows progress and polls between two pipelines. */
static cln_status advance(progress *p, const cln_checks *c)
{
    cln_show_work(p->callbacks, "checking kernels", p->done++, p->total);
    poll_callbacks(p);
    return cln_stopped_by(c->failed == 0 ? p->signal : 0, NULL);
}

/* ---- sets of shapes ---- */

cln_status cln_selftest_loops(cln_device *device, cln_check_sink *sink, void *user)
{
    cln_status st = CLN_OK;
    cln_checks c = {.verdicts = {.sink = sink, .user = user}};

    CLN_TRY(check_loops(device, &c));
    CLN_TRY(verdict(device, &c));
done:
    return st;
}

cln_status cln_selftest_device(cln_device *device, const cln_selftest_plan *plan)
{
    cln_status st = CLN_OK;
    progress p = {.callbacks = plan->callbacks};
    cln_checks c = {.verdicts = {plan->sink, plan->outputs, plan->user},
                    .tiny = plan->shapes == CLN_SHAPES_TINY};
    const size_t most = device->max_alloc;

    device->max_alloc = device->own_alloc; /* as below */
    if (!plan->sink && plan->callbacks)
        c.verdicts = (cln_verdicts){.sink = on_check, .user = &p};
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        p.total += shapes[i].in[plan->shapes];
    CLN_TRY(advance(&p, &c));
    CLN_TRY(check_loops(device, &c));
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        if (shapes[i].in[plan->shapes] &&
            (plan->sink || c.failed == 0)) { /* without a sink the first failure suffices */
            CLN_TRY(run_shape(device, &shapes[i], &c));
            CLN_TRY(advance(&p, &c));
        }
    CLN_TRY(verdict(device, &c));
done:
    device->max_alloc = most;
    return st;
}

static cln_status run_config(cln_device *device, const cln_config *config, cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline pipeline = {0};
    cln_config small = *config;

    c->shape = "these networks";
    prepare(&small);
    CLN_TRY(cln_pipeline_create(device, &small, &(cln_pipeline_facts){.space = &cln_space_unit},
                                CLN_PROGRAMS_ALL, &pipeline));
    CLN_TRY(run_pipeline(&pipeline, false, c));
done:
    cln_pipeline_free(&pipeline);
    return st;
}

cln_status cln_selftest_config(cln_device *device, const cln_config *config, cln_check_sink *sink,
                               void *user)
{
    cln_status st = CLN_OK;
    cln_checks c = {.verdicts = {.sink = sink, .user = user}};

    CLN_TRY(run_config(device, config, &c));
    CLN_TRY(verdict(device, &c));
done:
    return st;
}

/* ---- before a training ---- */

/* Returns whether a shape is checked before a training in this space. */
static bool is_due(const shape *s, const cln_space *space)
{
    return s->in[CLN_SHAPES_QUICK] || (space->forward && s->forward) || (space->shell && s->shell);
}

cln_status cln_selftest_training(cln_device *device, const cln_config *config,
                                 const cln_space *space, const cln_callbacks *callbacks)
{
    cln_status st = CLN_OK;
    progress p = {.callbacks = callbacks};
    cln_checks c = {.verdicts = {.sink = on_check, .user = &p}};
    cln_config usual;
    const size_t most = device->max_alloc;
    bool others = false;

    device->max_alloc = device->own_alloc; /* checks take each array as one buffer */
    CLN_TRY(cln_config_preset(CLN_DEFAULT_PRESET, &usual));
    others = cln_config_differs(&usual, config, CLN_ROW_SHAPE) != NULL;
    p.total = others;
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0]; i++)
        p.total += is_due(&shapes[i], space);
    CLN_TRY(check_loops(device, &c));
    for (size_t i = 0; i < sizeof shapes / sizeof shapes[0] && c.failed == 0; i++) {
        if (!is_due(&shapes[i], space))
            continue;
        CLN_TRY(advance(&p, &c));
        CLN_TRY(run_shape(device, &shapes[i], &c));
    }
    if (others && c.failed == 0) {
        CLN_TRY(advance(&p, &c));
        CLN_TRY(run_config(device, config, &c));
    }
    CLN_TRY(verdict(device, &c));
    CLN_TRY(advance(&p, &c));
done:
    device->max_alloc = most;
    return st;
}

cln_status cln_selftest(const cln_device_desc *desc, bool quick, cln_check_sink *sink, void *user)
{
    cln_status st = CLN_OK;
    cln_device *device = NULL;
    const cln_device_desc any = {0};
    const cln_selftest_plan plan = {
        .shapes = quick ? CLN_SHAPES_QUICK : CLN_SHAPES_ALL, .sink = sink, .user = user};

    cln_clear_error();
    CLN_TRY(cln_device_open(desc ? desc : &any, &device));
    CLN_TRY(cln_selftest_device(device, &plan));
done:
    cln_device_close(device);
    return st;
}
