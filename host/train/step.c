/* One training step. See step.h. */
#include "train/step.h"

#include <math.h>

#include "base/config.h"
#include "base/log.h"
#include "base/rng.h"
#include "pipeline/share.h"
#include "pipeline/stages.h"
#include "pipeline/stretch.h"

double cln_step_fraction(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    double fraction = 0;

    if (t->steps > 0)
        fraction = (double)t->model.step / (double)t->steps;
    if (c->time_limit > 0)
        fraction = fmax(fraction, t->model.train_seconds / c->time_limit);
    return fmin(fraction, 1);
}

/* method.md 11: x0.1 at each third (the paper's every 10 of 30 epochs), or exponential. */
double cln_step_learning_rate(const cln_config *c, double fraction)
{
    if (c->lr_schedule == CLN_SCHEDULE_STEP)
        return c->lr * pow(0.1, floor(fmin(fraction, 0.999999) * 3));
    return c->lr * pow(c->lr_final / c->lr, fraction);
}

double cln_step_harmonic_rate(const cln_config *c, bool has_alpha, double fraction)
{
    const bool rises = !has_alpha && fraction < c->harmonics_rise;

    return c->harmonic_rate * (rises ? fraction / c->harmonics_rise : 1);
}

double cln_step_decoder_rate(const cln_config *c, double fraction)
{
    const double risen = (fraction - c->decoder_after) / CLN_STEP_DECODER_RISE;

    return c->decoder_rate * (c->decoder_after > 0 ? fmin(fmax(risen, 0), 1) : 1);
}

/* Rays of the next step: --rays, more if leaves would meet too few samples, fewer if the batch
 * would have too many. Integers only; a step changes the number by a bounded factor. */
static int adapt_rays(const cln_trainer *t, int rays, uint32_t samples)
{
    const cln_config *c = &t->model.config;
    const int64_t met = samples ? samples : 1, allowed = cln_config_most_rays(c);
    const int64_t most = allowed < t->plan.max_rays ? allowed : t->plan.max_rays;
    const int64_t by_leaf = (int64_t)(c->leaf_samples * t->pipeline.leaves) * rays / met;
    int64_t next = by_leaf > c->rays ? by_leaf : c->rays;

    next = next < most ? next : most;
    if (next * met > (int64_t)t->plan.batch_samples * rays)
        next = (int64_t)t->plan.batch_samples * rays / met;
    if (next > rays + rays / 4)
        next = rays + rays / 4 + 1;
    if (next < rays / 2)
        next = rays / 2;
    return next < CLN_STEP_LEAST_RAYS ? CLN_STEP_LEAST_RAYS : (int)next;
}

/* Adds the results of the step before, which have arrived by now. Its rays also stand for those
 * through pixels that see no leaf: their error is known. */
static cln_status account(cln_trainer *t)
{
    const cln_coverage *cover = &t->batch.coverage;
    double loss = 0, square = 0, pixels = 0, counted = 0, rays = 0;

    if (!t->owed.due)
        return CLN_OK;
    t->owed.due = false;
    for (int i = 0; i < t->owed.rays; i++) {
        const double share = t->results[i].share;

        loss += fabs(share) * t->results[i].loss;
        pixels += fabs(share);
        if (share < 0)
            continue; /* where points are found, there is more to see than elsewhere */
        square += share * t->results[i].square_error;
        counted += share;
    }
    loss /= pixels;
    rays = counted;
    if (cln_batch_skips(&t->batch, &t->model.config, t->owed.step)) {
        rays = round(rays / cover->share);
        loss *= cover->share;
        square += rays * cover->error_other;
    }
    t->model.sum_square += square;
    t->model.sum_rays += (int64_t)rays;
    if (!t->undone)
        cln_exposure_add(&t->exposure, t->results, t->owed.step, t->owed.rays, &t->model);
    if (!isfinite(loss))
        return cln_fail(
            CLN_DIVERGED,
            "training diverged: the loss of step %lld is not finite; the last checkpoint is "
            "kept, resume from it with a lower --lr",
            (long long)t->owed.step);
    t->model.row.steps++;
    t->window.steps++;
    t->model.row.loss += loss;
    t->model.row.square += square / rays;
    t->model.row.rays += t->owed.rays;
    t->model.row.samples += t->owed.samples;
    return CLN_OK;
}

cln_status cln_step_catch_up(cln_trainer *t)
{
    cln_status st = CLN_OK;

    if (t->owed.due)
        CLN_TRY(cln_device_finish(t->device));
    CLN_TRY(account(t));
done:
    return st;
}

void cln_step_cover(cln_trainer *t)
{
    CLN_ASSERT(!t->owed.due);
    t->drawn = false;
    if (t->model.config.skip_uncovered)
        cln_coverage_update(&t->batch.coverage, t->scene, &t->model.tree, &t->model.space);
}

/* What a sparse point's depth counts at this fraction: less and less, then nothing. */
static double depth_share(const cln_trainer *t)
{
    const double until = t->model.config.depth_until;

    return t->batch.shown && until > 0 ? fmax(0, 1 - cln_step_fraction(t) / until) : 0;
}

/* Later than this fraction of the budget the model would not get used to it any more. For
 * --antialias auto: who asks for N has it when it comes. */
static const double LAST_BEGIN = 0.5;

static double rays_to_average(const cln_trainer *t)
{
    return t->model.config.antialias_after * (double)t->batch.first[t->batch.train_views];
}

double cln_steps_to_average(const cln_trainer *t)
{
    const cln_model *m = &t->model;
    const double a_step = (double)m->drawn / fmax(1, (double)m->step);
    const double begun = /* some of the budget is left to decide in */
        0.8 * (m->config.antialias == 0 ? LAST_BEGIN : m->config.structure_until);

    return 10 * ceil(rays_to_average(t) / a_step / begun / 10);
}

/* Pixels at edges become means of several rays once the photos were seen often enough. */
static void begin_averages(cln_trainer *t)
{
    cln_model *m = &t->model;

    if (!t->pipeline.averaged || m->averaged || (double)m->drawn < rays_to_average(t) ||
        (m->config.antialias == 0 && cln_step_fraction(t) > LAST_BEGIN))
        return;
    m->averaged = true;
    t->next_level.finest = false;
    if (!t->undone)
        cln_info("from step %lld on pixels at edges are means of %d rays", (long long)m->step,
                 cln_model_antialias(m) * cln_model_antialias(m));
}

static cln_status draw(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_draw d;

    begin_averages(t);
    if (t->pipeline.averaged && t->model.averaged)
        CLN_TRY(cln_photo_edges_find(t->scene, &t->batch.edges));
    d = (cln_draw){.step = (uint32_t)t->model.step,
                   .n = t->model.rays,
                   .antialias = t->pipeline.averaged ? cln_model_antialias(&t->model) : 1,
                   .ray_background = t->pipeline.ray_background,
                   .covered = cln_batch_skips(&t->batch, &t->model.config, t->model.step),
                   .depth = depth_share(t),
                   .space = &t->model.space};

    cln_batch_begin(&t->batch, t->scene, &t->model.config, &d);
    t->drawn = true;
done:
    return st;
}

/* The host waits once, for the number of samples. It reads a step's results in the next step, and
 * draws the next batch while the device works. */
cln_status cln_step(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    cln_pipeline *p = &t->pipeline;
    const uint32_t number = (uint32_t)t->model.step,
                   key = cln_hash(number + cln_hash((uint32_t)c->seed));
    const size_t extra = (size_t)cln_pipeline_extra_samples(p);
    const cln_sampling sampling = {
        .jitter = true,
        .min_transmittance = fraction >= c->occlusion_from ? (float)c->min_transmittance : 0.0f,
        .uniform_share = (float)c->uniform_share,
        .empty_weight = (float)c->empty_weight,
        .empty_share = (float)c->empty_share,
        .seed = (uint64_t)c->seed,
        .step = number,
        .max_samples = t->plan.max_samples - extra,
        .extra = extra,
        .stretches = cln_stretch_wanted(p)};
    uint32_t samples = 0, measured = 0, here = 0, slices = 0; /* here: made by this rank */
    int rays = 0;

    if (!t->drawn)
        CLN_TRY(draw(t));
    t->drawn = false;
    CLN_TRY(cln_scene_check_pixels(t->scene));
    cln_batch_colour(&t->batch, t->scene);
    if (cln_exposure_due(&t->exposure, number) && !t->undone) {
        CLN_TRY(cln_step_catch_up(t));
        CLN_TRY(cln_exposure_update(&t->exposure, t->scene, number, &t->model));
    }
    cln_exposure_apply(&t->exposure, &t->model, &t->batch, number, t->model.rays);
    CLN_TRY(cln_pipeline_batch(p, t->batch.pixels, t->model.rays, t->batch.targets[0],
                               t->batch.backgrounds[0]));
    if (t->batch.shown)
        CLN_TRY(cln_pipeline_shown(p, t->batch.shown[0], t->model.rays));
    CLN_TRY(cln_stage_rays(p, t->model.rays));
    CLN_TRY(cln_stage_sample(p, t->model.rays, &sampling, &rays, &samples));
    CLN_TRY(account(t));
    measured = here = p->samples_here;
    CLN_TRY(cln_stage_regularise(p, &sampling, rays, &here));
    CLN_TRY(cln_stage_group(p, here, &slices));
    if (sampling.stretches)
        CLN_TRY(cln_share_count(p, here, samples));
    samples += here - measured;
    p->harmonic_rate = cln_step_harmonic_rate(c, t->model.has_alpha, fraction);
    p->decoder_rate = cln_step_decoder_rate(c, fraction);
    CLN_TRY(cln_stage_forward(p, here, slices, true, key));
    CLN_TRY(cln_stage_composite_train(p, rays, here));
    CLN_TRY(cln_stage_regularise_gradient(p, &sampling, here));
    CLN_TRY(cln_stage_update(p, here, slices, (uint32_t)c->min_leaf_samples, key,
                             cln_step_learning_rate(c, fraction)));
    CLN_TRY(cln_stage_measure(p, measured));
    CLN_TRY(
        cln_buffer_fetch(t->device, &p->results, 0, t->results, (size_t)rays * sizeof *t->results));
    CLN_TRY(cln_device_flush(t->device));
    t->owed.due = true;
    t->owed.step = t->model.step;
    t->owed.rays = rays;
    t->owed.samples = samples;
    t->model.drawn += t->batch.drawn;
    t->model.rays = adapt_rays(t, rays, samples);
    t->model.step++;
    CLN_TRY(draw(t));
done:
    return st;
}
