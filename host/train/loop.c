/* Training: the step loop, evaluations and checkpoints. What happens to the tree between steps is in
 * maintain.c, the stages of a step are in sampling.c, splat.c and networks.c; what the run folder gets is
 * in record.c. Every decision is a function of the seed, the step and the model, so that a run
 * interrupted and resumed equals one that was not, bit for bit (budgets in time excepted). */
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/rng.h"
#include "train/batch.h"
#include "train/maintain.h"
#include "train/record.h"
#include "train/trainer.h"
#include "io/progress.h"

/* ---- budgets and schedules ---- */

double cln_trainer_fraction(const cln_trainer *t)
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
static double learning_rate(const cln_config *c, double fraction)
{
    if (c->lr_schedule == CLN_SCHEDULE_STEP)
        return c->lr * pow(0.1, floor(fmin(fraction, 0.999999) * 3));
    return c->lr * pow(c->lr_final / c->lr, fraction);
}

/* An epoch draws a tenth of all training pixels (method.md 11). */
static int64_t steps_of_epochs(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const double pixels = (double)t->batch.first[t->batch.train_views];

    return (int64_t)fmax(1, ceil(c->epochs * pixels / 10 / c->rays));
}

/* ---- one step ---- */

/* Rays for the next step: --rays, more where leaves would meet too few samples, fewer where samples would pass
 * what is aimed at. Integers only, bounded change. */
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
    return next < 16 ? 16 : (int)next;
}

/* Adds the results of the step before, which the host has by now. Its rays stand for more: those through pixels
 * without a leaf before them, whose error is known. */
static cln_status account(cln_trainer *t)
{
    const cln_coverage *cover = &t->batch.coverage;
    double loss = 0, square = 0, rays = t->owed.rays;

    if (!t->owed.due)
        return CLN_OK;
    t->owed.due = false;
    for (int i = 0; i < t->owed.rays; i++) {
        loss += t->results[i].loss;
        square += t->results[i].square_error;
    }
    loss /= rays;
    if (cln_batch_skips(&t->batch, &t->model.config, t->owed.step)) {
        rays = round(rays / cover->share);
        loss *= cover->share;
        square += rays * cover->error_other;
    }
    t->model.sum_square += square;
    t->model.sum_rays += (int64_t)rays;
    if (!isfinite(loss))
        return cln_fail(
            CLN_DIVERGED,
            "training diverged: the loss of step %lld is not finite; the last checkpoint is "
            "kept, resume from it with a lower --lr",
            (long long)t->owed.step);
    t->window.steps++;
    t->window.loss += loss;
    t->window.square += square / rays;
    t->window.rays += t->owed.rays;
    t->window.samples += t->owed.samples;
    return CLN_OK;
}

cln_status cln_trainer_catch_up(cln_trainer *t)
{
    cln_status st = CLN_OK;

    if (t->owed.due)
        CLN_TRY(cln_device_finish(t->device));
    CLN_TRY(account(t));
done:
    return st;
}

void cln_trainer_cover(cln_trainer *t)
{
    CLN_ASSERT(!t->owed.due);
    t->drawn = false;
    if (t->model.config.skip_uncovered)
        cln_coverage_update(&t->batch.coverage, t->scene, &t->model.tree, &t->model.space);
}

static void draw(cln_trainer *t)
{
    const cln_draw d = {.step = (uint32_t)t->model.step,
                        .n = t->model.rays,
                        .ray_background = t->pipeline.ray_background,
                        .covered = cln_batch_skips(&t->batch, &t->model.config, t->model.step)};

    cln_batch_draw(&t->batch, t->scene, &t->model.config, &d);
    t->drawn = true;
}

/* The host waits once, for the number of samples; the results of a step are looked at in the next one, and the
 * next batch is drawn while the device works. */
static cln_status step(cln_trainer *t, double fraction)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    cln_pipeline *p = &t->pipeline;
    const uint32_t number = (uint32_t)t->model.step,
                   key = cln_hash(number + cln_hash((uint32_t)c->seed));
    const cln_sampling sampling = {.jitter = true,
                                   .t_min = fraction >= c->occlusion_from ? (float)c->t_min : 0.0f,
                                   .uniform_share = (float)c->uniform_share,
                                   .empty_weight = (float)c->empty_weight,
                                   .empty_share = (float)c->empty_share,
                                   .seed = (uint64_t)c->seed,
                                   .step = number,
                                   .max_samples =
                                       t->plan.max_samples - (size_t)cln_pipeline_extra_samples(p)};
    uint32_t samples = 0, measured = 0, slices = 0;
    int rays = 0;

    if (!t->drawn)
        draw(t);
    t->drawn = false;
    CLN_TRY(cln_pipeline_batch(p, t->batch.pixels, t->model.rays, t->batch.targets[0],
                               t->batch.backgrounds[0]));
    CLN_TRY(cln_stage_rays(p, t->model.rays));
    CLN_TRY(cln_stage_sample(p, t->model.rays, &sampling, &rays, &samples));
    CLN_TRY(account(t));
    measured = samples;
    CLN_TRY(cln_stage_regularise(p, &sampling, rays, &samples));
    CLN_TRY(cln_stage_group(p, samples, &slices));
    CLN_TRY(cln_stage_forward(p, samples, slices, true, key));
    CLN_TRY(cln_stage_composite_train(p, rays, samples));
    CLN_TRY(cln_stage_regularise_gradient(p, &sampling, samples));
    CLN_TRY(cln_stage_update(p, samples, slices, key, learning_rate(c, fraction)));
    CLN_TRY(cln_stage_measure(p, measured));
    CLN_TRY(
        cln_buffer_fetch(t->device, &p->results, 0, t->results, (size_t)rays * sizeof *t->results));
    CLN_TRY(cln_device_flush(t->device));
    t->owed.due = true;
    t->owed.step = t->model.step;
    t->owed.rays = rays;
    t->owed.samples = samples;
    t->model.rays = adapt_rays(t, rays, samples);
    t->model.step++;
    draw(t);
done:
    return st;
}

/* ---- evaluation, checkpoints ---- */

/* Polls the caller. What comes while a picture is under way is kept for the loop. */
static int poll_signal(void *user)
{
    cln_trainer *t = user;
    const cln_callbacks *callbacks = &t->desc->callbacks;
    const int signal = callbacks->interrupted ? callbacks->interrupted(callbacks->user) : 0;

    if (signal == SIGUSR1)
        t->save_wanted = true;
    else if (signal == SIGINT || signal == SIGTERM)
        t->signal = signal;
    return signal;
}

static void show_work(const char *what, int done, int total, void *user)
{
    const cln_callbacks *callbacks = &((const cln_trainer *)user)->desc->callbacks;

    if (callbacks->work)
        callbacks->work(what, done, total, callbacks->user);
}

/* *done = false if there is nothing to evaluate, or if a signal (t->signal) ended it. */
static cln_status evaluate(cln_trainer *t, const char *folder, bool *done)
{
    cln_status st = CLN_OK, rendered = CLN_OK;
    cln_eval_result result = {0};
    const cln_callbacks callbacks = {.work = show_work, .interrupted = poll_signal, .user = t};
    const size_t n1 = (size_t)t->model.config.n1;
    const size_t bytes = (size_t)t->pipeline.leaves * n1 * n1 * n1 * sizeof(uint16_t);

    *done = false;
    if (t->eval_count == 0)
        return CLN_OK;
    /* the pictures' densities are not training's: put those back afterwards */
    CLN_TRY(cln_buffer_read(t->device, &t->pipeline.density, 0, t->model.density, bytes));
    rendered = cln_quality_measure(&t->pipeline, &t->model, t->scene, t->eval_views, t->eval_count,
                                   folder, &callbacks, &result);
    if ((rendered == CLN_SIGINT || rendered == CLN_SIGTERM) && t->signal)
        cln_clear_error();
    else
        CLN_TRY(rendered);
    CLN_TRY(cln_buffer_write(t->device, &t->pipeline.density, 0, t->model.density, bytes));
    if (rendered != CLN_OK)
        goto done;
    *done = true;
    t->psnr_test = result.psnr;
    if (folder) {
        CLN_TRY(cln_pipeline_download(&t->pipeline, &t->model, false));
        result.digest = cln_model_digest(&t->model);
        result.step = t->model.step;
        result.train_seconds = t->model.train_seconds;
        CLN_TRY(cln_record_eval(t->desc->run, &result));
    }
done:
    cln_eval_free(&result);
    return st;
}

static cln_status checkpoint(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const size_t weights = (size_t)t->pipeline.leaves * (size_t)t->pipeline.net.params;
    const bool measured = cln_pipeline_measures(&t->model.config) > 0;

    CLN_TRY(cln_pipeline_download(&t->pipeline, &t->model, true));
    for (size_t i = 0; i < weights; i++)
        if (!isfinite(t->model.params[i])) {
            st = cln_fail(CLN_DIVERGED,
                          "training diverged: weights of step %lld are not finite; the checkpoint "
                          "before is kept, resume from it with a lower --lr",
                          (long long)t->model.step);
            goto done;
        }
    /* for those who look at the tree: the error since the last decision; decisions measure their own */
    for (int s = 0; s < t->model.tree.leaf_count && measured && t->model.sum_rays > 0; s++)
        t->model.error[s] = t->model.sums[(size_t)s * CLN_MEASURES * 2] / (float)t->model.sum_rays;
    CLN_TRY(cln_checkpoint_write(t->desc->run, &t->model));
    t->saved_at = cln_now();
done:
    return st;
}

/* Is a test PSNR due at this step? Points by seconds or steps, every N steps, and for a target. */
static bool evaluation_due(cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const double before = t->looked_seconds, now = t->model.train_seconds;
    bool due = c->eval_every > 0 && t->model.step % c->eval_every == 0;

    for (int i = 0; i < t->point_count; i++)
        due |= t->point_steps[i] > 0 ? t->model.step == t->point_steps[i]
                                     : before < t->point_seconds[i] && now >= t->point_seconds[i];
    if (c->target_psnr > 0 && c->eval_every == 0 && t->point_count == 0)
        due |= floor(before / 15) < floor(now / 15);
    t->looked_seconds = now;
    return due;
}

static void report_progress(const cln_trainer *t, double fraction)
{
    const cln_callbacks *callbacks = &t->desc->callbacks;
    const double spent = t->model.train_seconds - t->window.began_seconds;
    cln_train_progress progress = {
        .step = t->model.step,
        .steps = t->steps,
        .fraction = fraction,
        .seconds = t->model.train_seconds,
        .eta = fraction > 0.001 ? (t->model.train_seconds) * (1 - fraction) / fraction : NAN,
        .rays_per_s = spent > 0 ? (double)t->window.rays / spent : 0,
        .samples_per_ray = t->window.rays ? (double)t->window.samples / (double)t->window.rays : 0,
        .loss = t->window.steps ? t->window.loss / t->window.steps : NAN,
        .psnr_train =
            t->window.steps ? -10 * log10(fmax(t->window.square / t->window.steps, 1e-10)) : NAN,
        .psnr_test = t->psnr_test,
        .leaves = t->pipeline.leaves,
        .params = (double)t->pipeline.leaves * t->pipeline.net.learned,
        .device_bytes = (double)t->device->allocated};

    if (callbacks->train)
        callbacks->train(&progress, callbacks->user);
}

/* Rows of metrics.jsonl; afterwards a new interval begins. */
static cln_status log_row(cln_trainer *t, double fraction, bool evaluated)
{
    cln_status st = CLN_OK;
    char peak[32], limit[32];

    t->psnr_train = -10 * log10(fmax(t->window.square / t->window.steps, 1e-10));
    CLN_TRY(cln_record_row(t, learning_rate(&t->model.config, fraction), evaluated));
    if (!t->host_full && cln_peak_rss() > t->host_plan.limit) {
        cln_format_bytes(cln_peak_rss(), peak);
        cln_format_bytes(t->host_plan.limit, limit);
        cln_warn("host memory: %s at its peak, more than the %s of --host-mem", peak, limit);
        t->host_full = true;
    }
    t->window.steps = 0;
    t->window.rays = t->window.samples = 0;
    t->window.loss = t->window.square = 0;
    t->window.began_seconds = t->model.train_seconds;
done:
    return st;
}

static cln_status stopped(const cln_trainer *t, const char *when)
{
    return cln_fail(
        t->signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM,
        "stopped by a signal %s at step %lld; go on with `cl-nascent train --resume %s`", when,
        (long long)t->model.step, t->desc->run);
}

/* The rest of the newest step, as training time. */
static cln_status wait_for_step(cln_trainer *t)
{
    const double began = cln_now();
    const cln_status st = cln_trainer_catch_up(t);

    t->model.train_seconds += cln_now() - began;
    return st;
}

/* A step that is taken back: drivers compile a kernel when it is first launched, which may take seconds and
 * is no training. */
static cln_status warm_up(cln_trainer *t)
{
    cln_status st = CLN_OK;
    double psnr = 0;
    const cln_model before = t->model; /* its numbers; the arrays are not touched by a step */

    CLN_TRY(cln_stage_refresh(&t->pipeline, 0, 1, true, 0, 0));
    CLN_TRY(step(t, 0));
    CLN_TRY(cln_trainer_catch_up(t));
    if (t->model.config.adaptive)
        CLN_TRY(cln_maintain_probe(t, &psnr));
    t->model = before;
    t->drawn = false;
    memset(&t->window, 0, sizeof t->window);
    memset(t->device->stage_seconds, 0, sizeof t->device->stage_seconds);
    CLN_TRY(cln_pipeline_upload(&t->pipeline, &t->model, true));
    CLN_TRY(cln_stage_seen(&t->pipeline));
done:
    return st;
}

cln_status cln_trainer_run(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    bool evaluated = false;

    if (c->steps <= 0 && c->time_limit <= 0)
        t->steps = steps_of_epochs(t);
    CLN_TRY(warm_up(t));
    t->window.began_seconds = t->looked_seconds = t->model.train_seconds;
    t->window.waits = t->device->waits;
    t->saved_at = cln_now();
    while (cln_trainer_fraction(t) < 1 && t->signal == 0) {
        const double began = cln_now();
        const double fraction = cln_trainer_fraction(t);
        bool row = false;

        CLN_TRY(cln_maintain(t, fraction));
        CLN_TRY(step(t, fraction));
        t->model.train_seconds += cln_now() - began;
        report_progress(t, fraction);
        evaluated = false;
        row = t->model.step % c->log_every == 0 || cln_trainer_fraction(t) >= 1;
        if (evaluation_due(t)) {
            CLN_TRY(wait_for_step(t));
            CLN_TRY(evaluate(t, NULL, &evaluated));
        }
        if (evaluated || row) {
            CLN_TRY(wait_for_step(t));
            CLN_TRY(log_row(t, fraction, evaluated));
        }
        if (evaluated && c->target_psnr > 0 && t->psnr_test >= c->target_psnr) {
            cln_info("target reached: %.2f dB test PSNR at %.0f s", t->psnr_test,
                     t->model.train_seconds);
            break;
        }
        poll_signal(t);
        if (t->save_wanted || cln_now() - t->saved_at >= c->save_every) {
            CLN_TRY(wait_for_step(t));
            CLN_TRY(checkpoint(t));
            t->save_wanted = false;
        }
    }
    CLN_TRY(wait_for_step(t));
    CLN_TRY(checkpoint(t));
    if (t->signal)
        CLN_TRY(stopped(t, "after a checkpoint"));
    CLN_TRY(cln_record_folder(t->desc->run, t->model.step, "test", &t->eval_folder));
    CLN_TRY(evaluate(t, t->eval_folder, &evaluated));
    if (t->signal && !evaluated)
        CLN_TRY(stopped(t, "in the last evaluation, after a checkpoint"));
done:
    return st;
}
