/* The self-test at extremes: its table of subjects, their pipelines, and its rows. See extremes.h;
 * the subjects are in extremes_*.c. */
#include "check/extremes.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "base/config.h"
#include "check/forward_scene.h"
#include "check/selftest.h"

/* ---- rows ---- */

cln_extreme cln_extreme_row(cln_checks *c, const char *name, const char *range)
{
    return (cln_extreme){.checks = c, .name = name, .range = range};
}

void cln_extreme_meet(cln_extreme *e, double got, double want, double scale, double bound,
                      const char *fmt, ...)
{
    const double off = fabs(got - want) <= 1e-36 ? 0 : fabs(got - want);
    const double error = off == 0 ? 0 : off / fabs(scale); /* infinite for a scale of 0 */
    double share = error == 0 ? 0 : error / bound;
    va_list args;

    e->n++;
    if (!isfinite(got)) {
        e->not_finite++;
        share = INFINITY;
    }
    if (isnan(share)) /* of a wanted value, scale or bound */
        share = INFINITY;
    if (!(share > e->share) && e->compared)
        return;
    e->compared = true;
    e->share = share;
    e->error = error;
    e->bound = bound;
    va_start(args, fmt);
    vsnprintf(e->where, sizeof e->where, fmt, args);
    va_end(args);
}

void cln_extreme_finite(cln_extreme *e, double got, const char *fmt, ...)
{
    va_list args;

    e->n++;
    if (isfinite(got))
        return;
    e->share = INFINITY;
    if (e->not_finite++ > 0)
        return;
    va_start(args, fmt);
    vsnprintf(e->where, sizeof e->where, fmt, args);
    va_end(args);
}

void cln_extreme_report(cln_extreme *e)
{
    char worst[160] = "";
    const bool passed = e->n > 0 && e->share <= 1;

    if (e->not_finite > 0)
        snprintf(worst, sizeof worst, "%zu not finite, the first at %s", e->not_finite, e->where);
    else if (e->compared)
        snprintf(worst, sizeof worst, "worst %-7.2g of %-7.2g%s%s, all finite", e->error, e->bound,
                 e->share > 0 ? " at " : "", e->share > 0 ? e->where : "");
    else
        snprintf(worst, sizeof worst, "all finite");
    cln_check_say(e->checks, e->name, passed, "%s; %zu numbers; %s", worst, e->n, e->range);
}

/* ---- subjects ---- */

/* Gives the fast preset the smallest network and no options; a subject then changes it. */
static void plain(cln_config *config)
{
    config->width = config->view_width = 16;
    config->depth = config->bands = 2;
    config->view_bands = 1;
    config->start_level = 1;
    config->level_at[0] = 0;
    config->n1 = 4;
    config->encoding = CLN_ENCODING_FREQUENCY;
    config->roulette = 0;
    config->loss = CLN_LOSS_L2;
    config->alpha_loss = config->opaque_loss = 0;
    config->opacity_entropy = config->cauchy = config->distortion_loss = config->depth_loss = 0;
    config->random_background = false;
    config->stage1 = CLN_STAGE1_GATHER;
}

static void with_cauchy(cln_config *config)
{
    config->cauchy = 1e-3;
}

static void with_regularisers(cln_config *config)
{
    config->loss = CLN_LOSS_HUBER;
    config->huber_delta = 0.2;
    config->alpha_loss = 0.1;
    config->opacity_entropy = 0.05;
    config->distortion_loss = 0.2;
    config->depth_loss = 0.3;
    config->random_background = true;
}

static void with_dead_slopes(cln_config *config)
{
    config->rrelu_scope = CLN_RRELU_MEAN;
    config->rrelu_lower = config->rrelu_upper = 0;
    config->min_leaf_samples = 1;
    config->view_l2 = 0;
}

static void with_grid(cln_config *config)
{
    with_dead_slopes(config);
    config->encoding = CLN_ENCODING_GRID;
    config->grid_cells = 4;
    config->grid_features = 4;
}

static void with_voxels(cln_config *config)
{
    config->encoding = CLN_ENCODING_VOXEL;
    config->grid_cells = 4;
    config->harmonics = 2;
    config->density_rate = 4;
    config->harmonic_rate = 0.2;
}

static void with_decoder(cln_config *config)
{
    with_voxels(config);
    config->decoder_width = 16;
    config->moments = CLN_MOMENTS_FLOAT32;
    config->beta1 = 0;
}

static void with_exponential(cln_config *config)
{
    config->density = CLN_DENSITY_EXP;
    config->density_scale = 1e4;
}

static void with_wide_moments(cln_config *config)
{
    with_dead_slopes(config);
    config->moments = CLN_MOMENTS_FLOAT32;
}

static void with_points(cln_config *config)
{
    config->sparsity = config->edge = 0.1;
}

static void with_measures(cln_config *config)
{
    config->adaptive = true;
}

static void with_many_cells(cln_config *config)
{
    with_measures(config);
    config->n1 = 16;
}

static void with_splatting(cln_config *config)
{
    config->stage1 = CLN_STAGE1_SPLAT;
}

static void with_faint_samples(cln_config *config)
{
    with_splatting(config);
    config->splat_min_alpha = 0;
    config->splat_per_ray = 0.1; /* lists of few pixels */
    config->cdf = CLN_CDF_SIGMA; /* intervals keep their optical depth */
    config->allocate = CLN_ALLOCATE_CHORD;
}

static void with_dense_samples(cln_config *config)
{
    with_faint_samples(config);
    config->splat_min_alpha = 0x1p-13; /* a density can be just at it */
    config->splat_per_ray = 16;        /* samples are near to each other: gaps show */
}

/* Of every encoding: the passes, also with large weights. */
static cln_status all_passes(cln_checks *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_extremes_networks(c));
    CLN_TRY(cln_extremes_large_weights(c));
done:
    return st;
}

static cln_status all_networks(cln_checks *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(all_passes(c));
    CLN_TRY(cln_extremes_adam(c));
done:
    return st;
}

static cln_status all_voxels(cln_checks *c)
{
    cln_status st = CLN_OK;

    CLN_TRY(all_passes(c));
    CLN_TRY(cln_extremes_voxels(c));
done:
    return st;
}

static cln_status sort_quick(cln_checks *c)
{
    return cln_extremes_sort(c, true);
}

static cln_status sort_all(cln_checks *c)
{
    return cln_extremes_sort(c, false);
}

typedef struct subject {
    const char *name, *tune; /* tune: added to the device's; NULL: nothing */
    void (*change)(cln_config *config);
    cln_status (*run)(cln_checks *c);
    cln_status (*quick)(cln_checks *c); /* NULL: run */
    uint32_t programs;
    unsigned lenses;
    bool alpha, forward, shell;
} subject;

#define BIT(program) CLN_PROGRAM_BIT(program)
#define RAYS         (BIT(rays) | BIT(scan) | BIT(sampling))
#define SPLATTING    (RAYS | BIT(sort64) | BIT(splat) | BIT(stats))
#define VOXELS \
    (BIT(scan) | BIT(group) | BIT(voxel_train) | BIT(voxel_eval) | BIT(roulette) | BIT(carry))
#define NETWORKS                                                                           \
    (BIT(scan) | BIT(group) | BIT(mlp_forward_train) | BIT(roulette) | BIT(mlp_backward) | \
     BIT(adam))

#define PASSES (NETWORKS | BIT(mlp_density) | BIT(mlp_forward_eval))

static const subject subjects[] = {
    {"composite", .run = cln_extremes_composite, .programs = BIT(composite)},
    {"composite, mixed rays", .run = cln_extremes_regularised, .programs = BIT(composite)},
    {"composite, cauchy", .change = with_cauchy, .run = cln_extremes_composite,
     .programs = BIT(composite)},
    {"composite, every loss", .change = with_regularisers, .run = cln_extremes_regularised,
     .programs = BIT(composite), .alpha = true},
    {"composite, stretches", .change = with_regularisers, .run = cln_extremes_stretches,
     .programs = BIT(scan) | BIT(composite), .alpha = true},
    {"cameras", .run = cln_extremes_cameras, .programs = BIT(rays),
     .lenses = (1u << CLN_LENSES) - 1},
    {"rays", .run = cln_extremes_intervals, .programs = BIT(scan) | BIT(sampling)},
    {"cropped rays", .run = cln_extremes_cropped,
     .programs = BIT(scan) | BIT(sampling) | BIT(sampling_crop)},
    {"forward space", .run = cln_extremes_forward, .programs = RAYS | BIT(composite),
     .lenses = 1u << CLN_LENS_OPENCV, .forward = true},
    {"shell space", .run = cln_extremes_shell, .programs = RAYS, .shell = true},
    {"networks", .change = with_dead_slopes, .run = all_networks, .programs = PASSES},
    {"networks, exp, HALF=1", .tune = "HALF=1", .change = with_exponential,
     .run = cln_extremes_large_weights, .programs = NETWORKS},
    {"roulette", .run = cln_extremes_roulette, .programs = BIT(roulette)},
    {"roulette, exp", .change = with_exponential, .run = cln_extremes_roulette,
     .programs = BIT(roulette)},
    {"change of the tree", .run = cln_extremes_carry, .programs = BIT(carry) | BIT(adam)},
    {"shared samples", .run = cln_extremes_share, .programs = BIT(scan) | BIT(group)},
    {"networks, HALF=1", .tune = "HALF=1", .change = with_dead_slopes, .run = all_passes,
     .programs = PASSES},
    {"grid, HALF=1", .tune = "HALF=1", .change = with_grid, .run = all_passes, .programs = PASSES},
    {"grid", .change = with_grid, .run = all_passes, .programs = PASSES},
    {"voxels", .change = with_voxels, .run = all_voxels, .programs = VOXELS},
    {"decoder", .change = with_decoder, .run = all_voxels, .programs = VOXELS | BIT(decoder)},
    {"Adam, float moments", .change = with_wide_moments, .run = cln_extremes_adam,
     .programs = BIT(adam)},
    {"distillation", .change = with_measures, .run = cln_extremes_distil, .programs = BIT(distil)},
    {"regularisers", .change = with_points, .run = cln_extremes_regularisers,
     .programs = BIT(regularise)},
    {"sums over leaves", .change = with_many_cells, .run = cln_extremes_leaves,
     .programs = BIT(scan) | BIT(group) | BIT(stats)},
    {"splatting", .change = with_dense_samples, .run = cln_extremes_splat, .programs = SPLATTING,
     .lenses = (1u << CLN_LENSES) - 1},
    {"splatting, faint samples", .change = with_faint_samples, .run = cln_extremes_splat,
     .programs = SPLATTING, .lenses = (1u << CLN_LENSES) - 1},
    {"scan and sort", .change = with_splatting, .run = sort_all, .quick = sort_quick,
     .programs = BIT(scan) | BIT(sort64)},
};

static cln_status run_subject(cln_device *device, const subject *s, bool quick, cln_checks *c)
{
    cln_status st = CLN_OK;
    const cln_tune kept = device->tune;
    const bool exact = device->tune_exact;
    const cln_space shell = {.half = 1, .shell = true};
    const cln_space space = s->forward ? cln_check_forward_space(1)
                            : s->shell ? shell
                                       : cln_space_unit;
    cln_pipeline pipeline = {0};
    cln_config config;

    CLN_TRY(cln_config_preset("fast", &config));
    plain(&config);
    if (s->change)
        s->change(&config);
    if (s->tune) {
        CLN_TRY(cln_tune_parse(s->tune, &device->tune));
        device->tune_exact = true;
    }
    CLN_TRY(cln_pipeline_create(
        device, &config,
        &(cln_pipeline_facts){.lenses = s->lenses, .alpha = s->alpha, .space = &space}, s->programs,
        &pipeline));
    c->p = &pipeline;
    c->shape = s->name;
    CLN_TRY(quick && s->quick ? s->quick(c) : s->run(c));
    CLN_TRY(cln_device_finish(device));
done:
    device->tune = kept;
    device->tune_exact = exact;
    cln_pipeline_free(&pipeline);
    return st;
}

cln_status cln_extremes_device(cln_device *device, const cln_extremes_plan *plan)
{
    cln_status st = CLN_OK;
    cln_checks c = {.verdicts = {.sink = plan->sink, .user = plan->user}};

    for (size_t i = 0; i < sizeof subjects / sizeof subjects[0]; i++)
        if (!plan->only || strcmp(subjects[i].name, plan->only) == 0)
            CLN_TRY(run_subject(device, &subjects[i], plan->quick, &c));
    if (c.failed > 0)
        st = cln_fail(CLN_CHECK,
                      "%s is out of bounds at extremes: %s%s; docs/stability.md explains the "
                      "bounds, another driver or device (--device) may do better",
                      device->info.name, c.first, c.failed > 1 ? ", and more" : "");
done:
    return st;
}

cln_status cln_selftest_extremes(const cln_device_desc *desc, bool quick, cln_check_sink *sink,
                                 void *user)
{
    cln_status st = CLN_OK;
    cln_device *device = NULL;
    const cln_device_desc any = {0};
    const cln_extremes_plan plan = {.quick = quick, .sink = sink, .user = user};

    cln_clear_error();
    CLN_TRY(cln_device_open(desc ? desc : &any, &device));
    CLN_TRY(cln_selftest_loops(device, sink, user));
    CLN_TRY(cln_extremes_device(device, &plan));
done:
    cln_device_close(device);
    return st;
}
