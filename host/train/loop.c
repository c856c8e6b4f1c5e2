/* The training loop: budgets, evaluations, checkpoints and signals. See loop.h. Calls go one way:
 * loop -> maintain, refine -> step, loop and maintain -> record, loop -> watch; maintain.h has
 * those below maintain. Every decision is a function of the seed, the step and the model, so a
 * resumed run equals an uninterrupted one bit for bit (except with a budget in time). */
#include "train/loop.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "device/queue.h"
#include "io/progress.h"
#include "ranks/ranks.h"
#include "render/metrics_image.h"
#include "render/quality.h"
#include "train/advice.h"
#include "train/decide.h"
#include "train/maintain.h"
#include "train/probe.h"
#include "train/record.h"
#include "train/refine.h"
#include "train/step.h"
#include "train/watch.h"

enum { TARGET_STEP = 64 }; /* of the first evaluation for --target-psnr */

/* ---- budgets ---- */

/* Names the option that extends a resumed run whose budget is used up. */
static void say_used_up(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const bool timed = c->time_limit > 0 && t->model.train_seconds >= c->time_limit;
    /* by the clock it ends a little later than its budget says */
    const bool less = timed ? c->time_limit < 0.8 * t->model.train_seconds
                            : t->steps > 0 && t->steps < t->model.step;
    char budget[64], more[64], run[CLN_QUOTED_BYTES];

    if (timed)
        snprintf(budget, sizeof budget, "%g s", c->time_limit);
    else
        snprintf(budget, sizeof budget, "%lld step%s", (long long)t->steps,
                 cln_plural((double)t->steps, "", "s"));
    if (timed)
        snprintf(more, sizeof more, "--time-limit +%gs", c->time_limit);
    else if (c->steps > 0)
        snprintf(more, sizeof more, "--steps +%d", c->steps);
    else
        snprintf(more, sizeof more, "--epochs +%d", c->epochs);
    /* less than it had is a mistake: who wants so many more has to say + */
    cln_log(less ? CLN_LOG_WARN : CLN_LOG_INFO,
            "nothing is left to train: the budget of %s is used up; to go on: `cl-nascent train "
            "--resume %s %s`",
            budget, cln_shell_quote(t->desc->run, run, sizeof run), more);
}

bool cln_loop_used_up(cln_trainer *t)
{
    const bool used_up = t->desc->resume && cln_step_fraction(t) >= 1;

    if (used_up && !t->said.used_up)
        say_used_up(t);
    t->said.used_up |= used_up;
    return used_up;
}

/* ---- evaluation, checkpoints ---- */

/* In order of precedence: of several signals, all ranks obey the last one here. */
static const int signals[] = {0, SIGUSR1, SIGINT, SIGTERM};
enum { SIGNALS = sizeof signals / sizeof signals[0] };

/* Index in `signals` of a signal to this rank, 0 without one. */
static int poll_here(cln_trainer *t)
{
    int signal = cln_poll_signal(&t->desc->callbacks), i = SIGNALS;

    if (signal == 0)
        signal = cln_watch_orders(t);
    while (--i > 0 && signals[i] != signal)
        ;
    return i;
}

/* Keeps the signal for the loop, as it may come during an evaluation. */
static int obey(cln_trainer *t, double place)
{
    const int signal = signals[(int)place];

    if (signal == SIGUSR1)
        t->save_wanted = true;
    else if (signal == SIGINT || signal == SIGTERM)
        t->signal = signal;
    return signal;
}

int cln_loop_poll(void *user)
{
    cln_trainer *t = user;
    double place = poll_here(t);

    cln_ranks_largest(&place, 1);
    return obey(t, place);
}

static void show_work(const char *what, int done, int total, void *user)
{
    cln_show_work(&((const cln_trainer *)user)->desc->callbacks, what, done, total);
}

cln_callbacks cln_loop_callbacks(cln_trainer *t)
{
    return (cln_callbacks){.work = show_work, .interrupted = cln_loop_poll, .user = t};
}

/* Evaluates the test views. *done: false without test views, or if a signal (t->signal) ended it.
 * folder: for the pictures of the final evaluation; NULL: none are written. */
static cln_status evaluate(cln_trainer *t, const char *folder, bool *done)
{
    cln_status st = CLN_OK, rendered = CLN_OK;
    cln_eval_result result = {0};
    const double began = cln_now();
    const cln_callbacks callbacks = cln_loop_callbacks(t);

    *done = false;
    if (t->eval_count == 0)
        return CLN_OK;
    cln_watch_say(t, "evaluating");
    cln_queue_book(t->device, CLN_STAGE_EVALUATION);
    if (t->pipeline.antialias != cln_model_antialias(&t->model)) {
        t->pipeline.antialias = cln_model_antialias(&t->model);
        CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    }
    rendered = cln_quality_measure(&t->pipeline, &t->model, t->scene, t->eval_views, t->eval_count,
                                   t->writes ? folder : NULL, NULL, &callbacks, &result);
    if ((rendered == CLN_SIGINT || rendered == CLN_SIGTERM) && t->signal)
        cln_clear_error();
    else
        CLN_TRY(rendered);
    if (rendered != CLN_OK)
        goto done;
    *done = true;
    result.antialias = t->pipeline.antialias;
    t->psnr_test = result.psnr;
    t->psnr_fitted = result.psnr_fitted;
    t->fitted_gain = result.fitted_gain;
    t->psnr_exposed = result.psnr_exposed;
    t->eval_step = t->model.step;
    t->eval_seconds = cln_now() - began;
    if (folder) {
        CLN_TRY(cln_pipeline_download(&t->pipeline, &t->model, false));
        result.digest = cln_model_digest(&t->model);
        result.step = t->model.step;
        result.train_seconds = t->model.train_seconds;
        if (t->writes)
            CLN_TRY(cln_record_eval(folder, &result));
    }
done:
    cln_queue_book(t->device, CLN_STAGES);
    cln_watch_say(t, "training");
    cln_eval_free(&result);
    return st;
}

static cln_status diverged(const cln_trainer *t)
{
    return cln_fail(CLN_DIVERGED,
                    "training diverged: weights of step %lld are not finite; the checkpoint "
                    "before it is kept: resume from that with a lower --lr",
                    (long long)t->model.step);
}

static bool are_finite(const float *values, size_t count)
{
    for (size_t i = 0; i < count; i++)
        if (!isfinite(values[i]))
            return false;
    return true;
}

static cln_status checkpoint(cln_trainer *t)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &t->pipeline;
    const size_t each = (size_t)p->net.params;
    const bool measured = cln_pipeline_measures(&t->model.config) > 0;
    uint64_t digest = 0;
    bool written = false;

    cln_watch_say(t, "saving");
    CLN_TRY(cln_pipeline_download_own(p, &t->model, true));
    if (!are_finite(t->model.params + (size_t)p->first * each, (size_t)p->own * each) ||
        !are_finite(t->model.decoder, (size_t)t->model.net.decoder_params))
        CLN_TRY(diverged(t));
    /* the error since the last decision, for exports and reports; decisions measure it again */
    for (int s = 0; s < t->model.tree.leaf_count && measured && t->model.sum_rays > 0; s++)
        t->model.error[s] = t->model.sums[(size_t)s * CLN_MEASURES * 2] / (float)t->model.sum_rays;
    t->model.in_parts = p->parts > 1;
    if (p->ranks > 1)
        CLN_TRY(
            cln_checkpoint_write_parts(t->desc->run, &t->model, p->rank_first, &digest, &written));
    t->parts_digest = written ? digest : 0;
    if (!written && p->ranks > 1)
        cln_pipeline_collect(p, &t->model, true);
    if (!written && t->writes)
        CLN_TRY(cln_checkpoint_write(t->desc->run, &t->model));
    t->checkpoint_at = cln_now();
    t->saved_step = t->model.step;
    cln_watch_say(t, "training");
done:
    return st;
}

/* Does --target-psnr need its own evaluations, because no other setting requests any? */
static bool watches_target(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;

    return c->target_psnr > 0 && c->eval_every == 0 && t->eval_at.count == 0;
}

/* Number of evaluations for --target-psnr up to a step: the first one is after TARGET_STEP steps,
 * the next after a quarter more, and so on. Steps, not seconds, so that a run ends at the same one
 * again; ever farther apart, so that all of them take a fair share of the time. */
static int target_looks(double step)
{
    int count = 0;

    for (int64_t at = TARGET_STEP; (double)at <= step && at < INT64_MAX / 2; at += at / 4)
        count++;
    return count;
}

/* Returns whether the newest step came to one of the points. */
static bool come_to(const cln_trainer *t, const cln_points *at)
{
    const double before = t->looked_seconds, now = t->model.train_seconds;
    bool due = false;

    for (int i = 0; i < at->count; i++)
        due |= at->steps[i] > 0 ? t->model.step == at->steps[i]
                                : before < at->seconds[i] && now >= at->seconds[i];
    return due;
}

/* Returns whether an evaluation is due: at points in seconds or steps, every N steps, or, for a
 * target PSNR, as target_looks has it. */
static bool evaluation_due(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    bool due = (c->eval_every > 0 && t->model.step % c->eval_every == 0) || come_to(t, &t->eval_at);

    if (watches_target(t))
        due |= target_looks((double)t->model.step - 1) < target_looks((double)t->model.step);
    return due;
}

/* Number of evaluations to come, including the last, at the present speed. */
static int evaluations_left(const cln_trainer *t, double fraction)
{
    const cln_config *c = &t->model.config;
    const double step = (double)t->model.step, seconds = t->model.train_seconds;
    const double end_step = step / fraction, end_seconds = seconds / fraction;
    double count = 1;

    if (t->eval_count == 0)
        return 0;
    for (int i = 0; i < t->eval_at.count; i++)
        count += t->eval_at.steps[i] > 0
                     ? t->eval_at.steps[i] > step && t->eval_at.steps[i] <= end_step
                     : t->eval_at.seconds[i] > seconds && t->eval_at.seconds[i] <= end_seconds;
    if (c->eval_every > 0)
        count += floor(end_step / c->eval_every) - floor(step / c->eval_every);
    if (watches_target(t))
        count += target_looks(end_step) - target_looks(step);
    return (int)fmin(count, 1e6);
}

/* Estimates the seconds of an evaluation before one was measured: in nine trainings on real scenes
 * a pixel took 0.25 to 0.86 times as long as a training ray. A machine that stands still for a
 * while makes the newest rays slow, not all of them. */
static double guess_evaluation(const cln_trainer *t)
{
    const double pace = (double)t->model.drawn / t->model.train_seconds;
    double pixels = 0;

    for (int i = 0; i < t->eval_count; i++) {
        const cln_camera *c = &t->scene->views[t->eval_views[i]].camera;

        pixels += (double)c->width * c->height;
    }
    return 0.5 * pixels / fmax(pace, t->shown.rays_per_s);
}

/* Says once, as soon as the pace is known, that the evaluation at the end takes longer than the
 * training may. */
static void say_long_evaluation(cln_trainer *t)
{
    const double early = 0.05, limit = t->model.config.time_limit;
    const double seconds = t->eval_count > 0 ? guess_evaluation(t) : 0;
    char takes[32], budget[32], fewer[64] = "";

    if (t->said.long_evaluation || cln_step_fraction(t) < early || !(t->shown.rays_per_s > 0))
        return;
    t->said.long_evaluation = true;
    if (cln_ranks_me() > 0 || !(limit > 0) || !(seconds > limit))
        return;
    cln_format_duration(seconds, takes);
    cln_format_duration(limit, budget);
    if (t->eval_count > 1)
        snprintf(fewer, sizeof fewer, "--eval-images %d or ",
                 (int)fmax(1, t->eval_count * limit / seconds));
    cln_warn("the evaluation at the end, of %d test photo%s, may take %s, longer than the training "
             "with its %s: %sa larger --downscale than %d makes it shorter",
             t->eval_count, cln_plural(t->eval_count, "", "s"), takes, budget, fewer,
             t->scene->downscale);
}

/* Keeps the rates and means of the rays since the last row. A step's results arrive one step later:
 * directly after a row there are none. */
static void keep_window(cln_trainer *t)
{
    const double spent = t->model.train_seconds - t->model.row.began;

    if (t->model.row.steps == 0 || t->model.row.rays == 0 || !(spent > 0))
        return;
    t->shown.rays_per_s = (double)t->model.row.rays / spent;
    t->shown.samples_per_ray = (double)t->model.row.samples / (double)t->model.row.rays;
    t->shown.loss = t->model.row.loss / t->model.row.steps;
    t->shown.psnr_train = cln_psnr(t->model.row.square / t->model.row.steps);
}

static void report_progress(cln_trainer *t, double fraction)
{
    const cln_callbacks *callbacks = &t->desc->callbacks;
    cln_train_progress *p = &t->shown;

    keep_window(t);
    if (!callbacks->train && !t->watch)
        return;
    if (!(p->rays_per_s > 0)) /* after the first step, whose results arrive with the second */
        p->rays_per_s = p->samples_per_ray = p->loss = p->psnr_train = NAN;
    p->step = t->model.step;
    p->steps = t->steps;
    p->fraction = fraction;
    p->seconds = t->model.train_seconds;
    p->eta = NAN;
    p->unmeasured = 0;
    p->unmeasured_seconds = 0;
    if (fraction > 0.001) {
        const int left = evaluations_left(t, fraction);

        p->eta = p->seconds * (1 - fraction) / fraction;
        if (isfinite(t->eval_seconds))
            p->eta += left * t->eval_seconds;
        else
            p->unmeasured = left;
        p->unmeasured_seconds = p->unmeasured > 0 ? p->unmeasured * guess_evaluation(t) : 0;
    }
    p->psnr_test = t->psnr_test;
    p->leaves = t->pipeline.leaves;
    p->params = cln_network_learned(&t->pipeline.net, t->pipeline.leaves);
    p->device_bytes = (double)t->device->allocated;
    if (callbacks->train)
        callbacks->train(p, callbacks->user);
}

/* Writes a row of metrics.jsonl of the interval so far, which may go on when the run is resumed. */
static cln_status put_row(cln_trainer *t, double fraction, bool evaluated, bool unfinished)
{
    keep_window(t);
    t->psnr_train = cln_psnr(t->model.row.square / t->model.row.steps);
    t->psnr_train_steps = (int)t->model.row.steps;
    return cln_record_row(t, cln_step_learning_rate(&t->model.config, fraction), evaluated,
                          unfinished);
}

/* Does, and begins a new interval. */
static cln_status log_row(cln_trainer *t, double fraction, bool evaluated)
{
    cln_status st = CLN_OK;
    char peak[32], limit[32];

    CLN_TRY(put_row(t, fraction, evaluated, false));
    if (!t->said.host_full && cln_peak_rss() > t->host_plan.limit) {
        cln_format_bytes(cln_peak_rss(), peak);
        cln_format_bytes(t->host_plan.limit, limit);
        cln_warn("host memory: %s at its peak, more than the %s of --host-mem", peak, limit);
        t->said.host_full = true;
    }
    t->model.row = (cln_row_sums){.began = t->model.train_seconds};
done:
    return st;
}

/* Says at the end whether --target-psnr was reached. */
static void say_target(const cln_trainer *t, bool evaluated)
{
    const double target = t->model.config.target_psnr;

    if (!(target > 0) || !(evaluated || t->hit_target))
        return;
    cln_info("target of %g dB test PSNR %s: %.2f dB after %lld step%s and %.0f s", target,
             t->psnr_test >= target ? "reached" : "not reached", t->psnr_test,
             (long long)t->model.step, cln_plural((double)t->model.step, "", "s"),
             t->model.train_seconds);
}

static cln_status stopped(const cln_trainer *t, const char *when)
{
    char run[CLN_QUOTED_BYTES];

    return cln_fail(t->signal == SIGINT ? CLN_SIGINT : CLN_SIGTERM,
                    "stopped %s %s at step %lld; go on with `cl-nascent train --resume %s`",
                    cln_watch_stopped(t) ? "from the browser" : "by a signal", when,
                    (long long)t->model.step, cln_shell_quote(t->desc->run, run, sizeof run));
}

/* After a failed write: says what is saved, and how to continue. */
static void say_how_to_keep(const cln_trainer *t)
{
    const int64_t kept = cln_checkpoint_newest(t->desc->run);
    double size = 0;
    char bytes[32], run[CLN_QUOTED_BYTES];

    (void)cln_checkpoint_bytes(&t->model.config, t->pipeline.leaves, &size);
    cln_format_bytes(size, bytes);
    cln_shell_quote(t->desc->run, run, sizeof run);
    if (kept < 0)
        cln_note(
            "training; nothing of it is saved, as no checkpoint was written yet (one takes %s): "
            "make room and train again",
            bytes);
    else if (kept < t->model.step)
        cln_note(
            "training; the checkpoint of step %lld is intact: make room (a checkpoint takes %s), "
            "then continue from it with `cl-nascent train --resume %s`",
            (long long)kept, bytes, run);
    else
        cln_note("finishing; the newest checkpoint, of step %lld, is intact: make room, then "
                 "`cl-nascent eval %s` makes pictures and report",
                 (long long)kept, run);
}

/* Seconds that a device has worked; 0 of processors, whose threads are this process's. */
static double device_seconds(const cln_trainer *t)
{
    double sum = 0;

    for (int i = 0; i < CLN_STAGES && strcmp(t->device->info.type, "cpu") != 0; i++)
        sum += t->device->stage_seconds[i];
    return sum;
}

/* The moment from which on time is spent on training. */
static double start_clock(cln_trainer *t)
{
    t->cpu_began = cln_processor_seconds();
    t->device_began = device_seconds(t);
    return cln_now();
}

/* Of so many seconds of a step, in which processors or the device worked for some: those that this
 * process stood still, as after Ctrl-Z or in a container that was paused. The clock goes on then,
 * but what takes so much longer than the steps before, without work, was none of them. */
static double stood_still(const cln_trainer *t, double seconds, double worked)
{
    const double least = 10, steps = (double)(t->model.step - t->from_step) - 1; /* before it */
    const double usual = steps > 0 ? (t->clock - t->from_clock) / steps : 0;

    if (seconds < least || seconds < 20 * usual || seconds < 2 * worked)
        return 0;
    return seconds - fmax(usual, worked);
}

/* Adds the time since `began` to this rank's clock, and what processors worked. With several ranks
 * train_seconds is rank 0's clock, once that was told. */
static void spend(cln_trainer *t, double began)
{
    const double seconds = cln_now() - began, worked = cln_processor_seconds() - t->cpu_began;
    const double still = stood_still(t, seconds, fmax(worked, device_seconds(t) - t->device_began));

    if (still > 0)
        cln_info("the process stood still for %.0f s at step %lld (stopped, or its machine was): "
                 "they are not counted as training",
                 still, (long long)t->model.step);
    t->clock += seconds - still;
    t->cpu_seconds += worked;
    if (cln_ranks_count() == 1)
        t->model.train_seconds = t->clock;
}

/* Waits for the newest step to end, which counts as training time. */
static cln_status wait_for_step(cln_trainer *t)
{
    const double began = start_clock(t);
    const cln_status st = cln_step_catch_up(t);

    spend(t, began);
    return st;
}

/* Keeps the model as a run of its own, with which all commands do what they do with any. What is
 * there already may have gone on since. */
static cln_status keep_model(cln_trainer *t)
{
    cln_status st = CLN_OK;
    char *run = NULL;

    CLN_TRY(cln_asprintf(&run, "%s/at/%08lld", t->desc->run, (long long)t->model.step));
    CLN_TRY(wait_for_step(t));
    CLN_TRY(checkpoint(t));
    if (t->writes && cln_has_file(run, "run.json")) {
        cln_info("%s is there already, and stays as it is", run);
    } else if (t->writes) {
        st = cln_record_keep(t, run);
        if (st == CLN_OK) {
            cln_info("step %lld stays as %s", (long long)t->model.step, run);
        } else if (st == CLN_OUTPUT) { /* the training is worth more */
            cln_warn("--save-at: step %lld is not kept: %s", (long long)t->model.step,
                     cln_error_text());
            cln_clear_error();
            st = CLN_OK;
        }
        CLN_TRY(st);
    }
done:
    free(run);
    return st;
}

/* Runs a step as the last one will be, with all that begins later, and undoes it: drivers compile a
 * kernel at its first launch, and those seconds are not training time. */
static cln_status warm_up(cln_trainer *t)
{
    cln_status st = CLN_OK;
    double psnr = 0;
    const cln_model before = t->model; /* scalars only: a step does not touch the arrays */

    t->undone = true;
    CLN_TRY(cln_stage_refresh(&t->pipeline, 0, 1, true, 0, 0));
    CLN_TRY(cln_step(t, 1));
    CLN_TRY(cln_step_catch_up(t));
    if (t->model.config.adaptive || t->model.config.refine_poses)
        CLN_TRY(cln_probe_psnr(t, &psnr));
    t->model = before;
    t->undone = t->drawn = false;
    memset(&t->window, 0, sizeof t->window);
    memset(t->device->stage_seconds, 0, sizeof t->device->stage_seconds);
    CLN_TRY(cln_pipeline_upload(&t->pipeline, &t->model, true));
    CLN_TRY(cln_stage_seen(&t->pipeline));
done:
    return st;
}

static cln_status save_if_wanted(cln_trainer *t)
{
    cln_status st = CLN_OK;

    if (t->save_wanted) {
        CLN_TRY(wait_for_step(t));
        CLN_TRY(checkpoint(t));
        t->save_wanted = false;
    }
done:
    return st;
}

/* Paints for the browser, and pauses if it asks for that; neither counts as training time. */
static cln_status let_watch(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const bool paused = cln_watch_paused(t);

    if (!cln_watch_due(t))
        return CLN_OK;
    CLN_TRY(wait_for_step(t));
    if (!paused) {
        CLN_TRY(cln_watch_paint(t));
        return CLN_OK;
    }
    cln_info("paused from the browser at step %lld", (long long)t->model.step);
    while (cln_watch_paused(t) && t->signal == 0) {
        cln_watch_say(t, "paused");
        CLN_TRY(cln_watch_paint(t));
        cln_loop_poll(t);
        CLN_TRY(save_if_wanted(t));
    }
    if (t->signal == 0)
        cln_info("continued from the browser");
    cln_watch_say(t, "training");
done:
    return st;
}

/* Fills in what the ranks tell each other with the next step: rank 0's clock, which decides about
 * budgets and saving for all, and signals, which all ranks obey. */
static void tell(cln_trainer *t)
{
    double *told = t->pipeline.told;

    told[CLN_TOLD_CLOCK] = t->writes ? t->clock : 0;
    told[CLN_TOLD_SAVE] = t->writes && cln_now() - t->checkpoint_at >= t->model.config.save_every;
    told[CLN_TOLD_SIGNAL] = cln_ranks_count() > 1 ? poll_here(t) : 0;
}

/* Takes over what was told with that step. */
static void heed(cln_trainer *t)
{
    t->save_wanted |= t->pipeline.told[CLN_TOLD_SAVE] > 0;
    if (cln_ranks_count() > 1)
        t->model.train_seconds = t->pipeline.told[CLN_TOLD_CLOCK];
}

cln_status cln_loop_run(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    bool evaluated = false;
    char *evals = NULL;

    if (c->steps <= 0 && c->time_limit <= 0)
        t->steps = cln_config_epoch_steps(c, (double)t->batch.first[t->batch.train_views]);
    cln_decide_recount(t);
    (void)cln_loop_used_up(t);
    if (t->model.step == 0)
        cln_advise_first_tree(t);
    CLN_TRY(warm_up(t));
    cln_cache_end_turn(&t->device->turn);
    t->start_seconds = cln_now() - t->began;
    t->from_step = t->model.step;
    CLN_TRY(cln_watch_start(t));
    t->looked_seconds = t->model.train_seconds;
    if (t->model.row.steps == 0)
        t->model.row.began = t->model.train_seconds;
    t->window.waits = t->device->waits;
    t->window.ranked_seconds[CLN_STAGES] = cln_ranks_sent().seconds;
    t->checkpoint_at = cln_now();
    t->clock = t->from_clock = t->model.train_seconds;
    while (cln_step_fraction(t) < 1 && t->signal == 0) {
        double began = start_clock(t);
        const double fraction = cln_step_fraction(t);
        bool row = false, due = false, keep = false;

        CLN_TRY(cln_maintain(t, fraction));
        CLN_TRY(cln_refine_poses(t, fraction));
        spend(t, began);
        began = start_clock(t);
        tell(t);
        CLN_TRY(cln_step(t, fraction));
        spend(t, began);
        heed(t);
        report_progress(t, cln_step_fraction(t));
        say_long_evaluation(t);
        evaluated = false;
        row = t->model.step % c->log_every == 0 || cln_step_fraction(t) >= 1;
        keep = come_to(t, &t->save_at);
        due = evaluation_due(t);
        t->looked_seconds = t->model.train_seconds;
        if (due) {
            CLN_TRY(wait_for_step(t));
            CLN_TRY(evaluate(t, NULL, &evaluated));
        }
        if (evaluated || row) {
            CLN_TRY(wait_for_step(t));
            CLN_TRY(log_row(t, fraction, evaluated));
        }
        if (keep)
            CLN_TRY(keep_model(t));
        if (evaluated && c->target_psnr > 0 && t->psnr_test >= c->target_psnr) {
            t->hit_target = true;
            break;
        }
        (void)obey(t, cln_ranks_count() > 1 ? t->pipeline.told[CLN_TOLD_SIGNAL] : poll_here(t));
        CLN_TRY(save_if_wanted(t));
        CLN_TRY(let_watch(t));
    }
    CLN_TRY(wait_for_step(t));
    cln_batch_forget(&t->batch); /* nobody takes the next step */
    cln_ranks_tell(&t->clock, sizeof t->clock);
    t->model.train_seconds = t->clock;
    if (t->model.row.rays > 0) /* stopped, now or by the start before, which no step followed */
        CLN_TRY(put_row(t, cln_step_fraction(t), false, true));
    cln_exposure_say(&t->exposure, &t->model);
    cln_refine_say(t);
    CLN_TRY(checkpoint(t));
    if (t->signal)
        CLN_TRY(stopped(t, "after a checkpoint"));
    CLN_TRY(cln_path_join(&evals, t->desc->run, "eval"));
    CLN_TRY(cln_record_place(evals, t->model.step, "test", t->eval_count,
                             cln_scene_split_count(t->scene, CLN_SPLIT_TEST), &t->eval_folder));
    CLN_TRY(evaluate(t, t->eval_folder, &evaluated));
    if (t->signal && !evaluated)
        CLN_TRY(stopped(t, "in the last evaluation, after a checkpoint"));
    if (evaluated && t->writes)
        CLN_TRY(cln_metrics_amend(t->metrics, t->model.step, "psnr_test", t->psnr_test));
    say_target(t, evaluated);
done:
    if (st == CLN_OUTPUT)
        say_how_to_keep(t);
    free(evals);
    return st;
}
