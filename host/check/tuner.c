/* cln_tune_search: coordinate descent over kernel parameters. It begins with the class's defaults
 * and goes through the moves below in rounds; each move changes one parameter, or two that only
 * make sense together, of the best set so far. A set that the network's shape or the device rules
 * out (cln_pipeline_fit) is passed over. Every other one is first held against the float64
 * reference with the very networks that it is for, and refused if it fails; only then is it timed,
 * in turn with the best set, so that whatever else the machine does hits both:
 *
 *   best | candidate | best | candidate | ...   one ratio for each pair
 *   pair 0           | pair 1           | ...
 *
 * The candidate is taken if the median ratio is below GAIN and few pairs speak against it. What is
 * timed is a training step (synthetic.h). Ends when a round has found nothing better, or with the
 * budget. Parameters that trade accuracy for speed are no part of it. */
#include "check/tuner.h"

#include <limits.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/callbacks.h"
#include "base/clock.h"
#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "base/text.h"
#include "device/tune.h"
#include "check/selftest.h"
#include "check/synthetic.h"
#include "io/disk.h"
#include "io/run_folder.h"

enum { PAIRS = 9, FEWEST_PAIRS = 3, AGAINST = 2, ROW_MOST = 4096 };
static const double GAIN = 0.98;     /* taken below this ratio of times; the log says it, too */
static const double HOPELESS = 1.15; /* no more pairs above this one */
static const double PART_SECONDS =
    0.03;                        /* shortest part of a pair: steps are repeated to fill it */
static const double BUDGET = 60; /* seconds, where none is given */
static const double STEP_SHARE = 1 / 60.0; /* longest step, as a share of the budget */

/* What to try, lists separated by blanks, the most promising first: a tile of samples x neurons in
 * registers decides on a CPU, how many work-items share a leaf on a GPU. */
static const struct {
    const char *cpu, *gpu;
} moves[] = {
    {"TS=8 TS=4 TS=12", "TS=4 TS=16 TS=32"},
    {"NV=4,TS=3 NV=1,TS=12 NV=4", "NV=2 NV=4 NV=2,TS=4 NV=1"},
    {NULL, "LS=32 LS=64 LS=128 LS=256 LS=16"},
    {"SL=960 SL=240 SL=1920 SL=480", "SL=64 SL=256 SL=512 SL=1024"},
    {"CHUNK=256 CHUNK=4096 CHUNK=16384", "CHUNK=16 CHUNK=32 CHUNK=128 CHUNK=256"},
    {"VW=16,NV=1 VW=4,NV=4 VW=16", "VW=2 VW=4 VW=1"},
    {"NB=24 NB=96 NB=192 NB=48", "NB=8 NB=32 NB=64 NB=128"},
    {"WG=4 WG=64 WG=1 WG=16", "WG=32 WG=128 WG=256"},
    {"TS=5 TS=6 TS=10", "TS=2 TS=8"},
};
enum { MOVES = sizeof moves / sizeof moves[0] };

typedef struct tuner {
    const cln_tune_desc *desc;
    cln_tune_result *result;
    cln_device *device;
    cln_network net;
    cln_synthetic work;
    cln_pipeline best;      /* device NULL: none yet */
    cln_tune *tried;        /* [result->count] */
    double began, deadline; /* monotonic seconds */
    double longest[2]; /* of a candidate whose kernels: [0] were compiled already, [1] were not */
    bool spent;        /* some sets were not tried, for lack of time */
    cln_callbacks building; /* asked while kernels are built */
    int signal;             /* by which the caller stopped the search */
} tuner;

/* A set whose kernels take longer than the budget is given up, but for the first one. */
static bool is_late(const tuner *t)
{
    return t->best.device && cln_now() > t->deadline;
}

/* The caller's signal; at the deadline SIGINT, to end the building of kernels. */
static int ask(void *user)
{
    tuner *t = user;
    const int signal = cln_poll_signal(&t->desc->callbacks);

    if (signal == SIGINT || signal == SIGTERM)
        t->signal = signal;
    return t->signal ? t->signal : is_late(t) ? SIGINT : 0;
}

static cln_status poll(tuner *t)
{
    cln_show_work(&t->desc->callbacks, "tune: seconds",
                  (int)fmin(cln_now() - t->began, t->desc->budget), (int)ceil(t->desc->budget));
    (void)ask(t);
    return cln_stopped_by(t->signal, "no row was written");
}

/* ---- the list of what was tried ---- */

static bool is_new(const tuner *t, const cln_tune *tune)
{
    for (int i = 0; i < t->result->count; i++)
        if (memcmp(&t->tried[i], tune, sizeof *tune) == 0)
            return false;
    return true;
}

/* 0: its kernels are compiled already. */
static int effort(const tuner *t, const cln_tune *tune)
{
    for (int i = 0; i < t->result->count; i++) {
        cln_tune other = t->tried[i];

        other.sl = tune->sl;
        other.chunk = tune->chunk;
        if (memcmp(&other, tune, sizeof other) == 0)
            return 0;
    }
    return 1;
}

/* Is there time for this set? */
static bool has_time(tuner *t, const cln_tune *tune)
{
    const int kind = effort(t, tune);
    const double likely = t->longest[kind] > 0 ? t->longest[kind] : t->longest[1 - kind];
    const bool enough = cln_now() + likely < t->deadline &&
                        (t->desc->max_tries == 0 || t->result->count < t->desc->max_tries);

    t->spent = t->spent || !enough;
    return enough;
}

static cln_status add_try(tuner *t, const cln_tune *tune, cln_tune_try **out)
{
    cln_status st = CLN_OK;
    cln_tune_result *r = t->result;

    CLN_TRY(cln_grow(&r->tries, r->count, sizeof *r->tries, "tuner"));
    CLN_TRY(cln_grow(&t->tried, r->count, sizeof *t->tried, "tuner"));
    t->tried[r->count] = *tune;
    *out = &r->tries[r->count++];
    **out =
        (cln_tune_try){.seconds = NAN, .against = NAN, .ratio = NAN, .verdict = CLN_SET_UNDECIDED};
    cln_tune_text(tune, (*out)->tune);
done:
    return st;
}

void cln_tune_tell(const cln_tune_try *try)
{
    if (try->verdict == CLN_SET_REFUSED)
        cln_warn("%s: refused, and not timed: %s", try->tune, try->reason);
    else if (try->verdict == CLN_SET_UNDECIDED && try->reason[0])
        cln_info("%s: %s", try->tune, try->reason);
    else if (try->verdict == CLN_SET_UNDECIDED)
        cln_info("%s: correct, but no time is left to time it", try->tune);
    else if (try->pairs == 0)
        cln_info("%s: %.4g ms a step; the search begins here", try->tune, 1e3 * try->seconds);
    else
        cln_info(
            "%s: %.4g ms a step, the best so far %.4g; by turns %.2f times as long (the middle "
            "of %d pair%s), not faster in %d of them: %s",
            try->tune, 1e3 * try->seconds, 1e3 * try->against, try->ratio, try->pairs,
            cln_plural(try->pairs, "", "s"), try->slower,
            try->verdict == CLN_SET_TAKEN ? "taken"
            : try->ratio >= GAIN          ? "not taken, as it must be 2 % faster"
                                          : "not taken, as too many pairs are against it");
}

/* ---- right or wrong ---- */

static void keep_first(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    cln_tune_try *try = user;

    if (!passed && !skipped && !try->reason[0])
        snprintf(try->reason, sizeof try->reason, "%s: %s", name, detail);
}

/* A set that cannot be built, needs too much memory or makes the device fail is refused, as one
 * that computes wrong results is; any other error ends the search. */
static cln_status refuse(cln_tune_try *try, cln_status st)
{
    if (st != CLN_CHECK && st != CLN_BUILD && st != CLN_MEMORY && st != CLN_CL)
        return st;
    if (!try->reason[0])
        snprintf(try->reason, sizeof try->reason, "%s", cln_error_text());
    try->verdict = CLN_SET_REFUSED;
    cln_clear_error();
    return CLN_OK;
}

/* Ends a set that a signal or the deadline stopped: only a signal of the caller ends the search. */
static cln_status give_up(tuner *t, cln_tune_try *try, cln_status st)
{
    if (st != CLN_SIGINT && st != CLN_SIGTERM)
        return st;
    cln_clear_error();
    if (t->signal)
        return cln_stopped_by(t->signal, "no row was written");
    snprintf(try->reason, sizeof try->reason,
             "no time is left to time it, nor to build all of its kernels");
    t->spent = true;
    return CLN_OK;
}

/* ---- time ---- */

static cln_status part_of_pair(tuner *t, cln_pipeline *p, int steps, double *seconds)
{
    cln_status st = CLN_OK;
    const double began = cln_now();

    for (int i = 0; i < steps; i++)
        CLN_TRY(cln_synthetic_step(&t->work, p));
    *seconds = (cln_now() - began) / steps;
done:
    return st;
}

static double median(const double *values, int n)
{
    double sorted[PAIRS];

    memcpy(sorted, values, (size_t)n * sizeof *values);
    cln_reals_sort(sorted, n);
    return sorted[n / 2];
}

void cln_tune_decide(const double *ratios, int pairs, cln_tune_try *try)
{
    const double middle = pairs > 0 ? median(ratios, pairs) : NAN;
    int slower = 0;

    for (int i = 0; i < pairs; i++)
        slower += ratios[i] >= 1;
    if (pairs < FEWEST_PAIRS || (pairs <= 2 * AGAINST && middle < GAIN))
        return; /* too few to tell */
    try->ratio = middle;
    try->pairs = pairs;
    try->slower = slower;
    try->verdict = middle < GAIN && slower <= AGAINST ? CLN_SET_TAKEN : CLN_SET_SLOWER;
}

/* Candidate and best set in turn; the verdict goes to *try. */
static cln_status race(tuner *t, cln_pipeline *candidate, cln_tune_try *try)
{
    cln_status st = CLN_OK;
    cln_tune_result *r = t->result;
    double best[PAIRS], seconds[PAIRS], ratio[PAIRS], once = 0;
    int pairs = 0, steps = 1;

    CLN_TRY(cln_synthetic_step(&t->work, candidate)); /* compiles */
    CLN_TRY(poll(t));
    CLN_TRY(part_of_pair(t, &t->best, 1, &once));
    steps = once >= PART_SECONDS ? 1 : (int)ceil(PART_SECONDS / fmax(once, 1e-5));
    while (pairs < PAIRS) {
        if (pairs >= FEWEST_PAIRS && median(ratio, pairs) > HOPELESS)
            break;
        if (cln_now() > t->deadline) {
            t->spent = true;
            break;
        }
        CLN_TRY(part_of_pair(t, &t->best, steps, &best[pairs]));
        CLN_TRY(part_of_pair(t, candidate, steps, &seconds[pairs]));
        ratio[pairs] = seconds[pairs] / best[pairs];
        pairs++;
        CLN_TRY(poll(t));
    }
    cln_tune_decide(ratio, pairs, try);
    if (try->verdict == CLN_SET_UNDECIDED)
        goto done;
    try->seconds = median(seconds, pairs);
    try->against = median(best, pairs);
    if (try->verdict == CLN_SET_TAKEN) {
        r->gain /= try->ratio;
        r->seconds = try->seconds;
    } else if (try->against < r->seconds) {
        r->seconds = try->against; /* less disturbed than before */
    }
done:
    return st;
}

/* The first set has nothing to be compared with: it only shows how long a step takes. */
static cln_status measure(tuner *t, cln_pipeline *candidate, cln_tune_try *try)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_pipeline_create(t->device, &t->work.model.config,
                                &(cln_pipeline_facts){.space = &cln_space_unit}, CLN_PROGRAMS_ALL,
                                candidate));
    CLN_TRY(cln_synthetic_upload(&t->work, candidate));
    if (t->best.device) {
        CLN_TRY(race(t, candidate, try));
        goto done;
    }
    CLN_TRY(cln_synthetic_settle(&t->work, candidate, fmax(STEP_SHARE * t->desc->budget, 0.02)));
    CLN_TRY(poll(t));
    CLN_TRY(part_of_pair(t, candidate, 1, &try->seconds));
    try->against = t->result->seconds = try->seconds;
    try->verdict = CLN_SET_TAKEN;
done:
    return st;
}

/* Compares a set with the float64 reference, then times it. Does nothing if it was tried already,
 * or if no time is left and another set was taken. */
static cln_status consider(tuner *t, cln_tune tune)
{
    cln_status st = CLN_OK;
    cln_pipeline candidate = {0};
    cln_tune_try *try = NULL;
    const double began = cln_now();
    int kind = 0;

    cln_pipeline_fit(t->device, &t->net, &tune);
    kind = effort(t, &tune);
    if (!is_new(t, &tune) || (t->best.device && !has_time(t, &tune)))
        return CLN_OK;
    CLN_TRY(poll(t));
    CLN_TRY(add_try(t, &tune, &try));
    t->device->tune = tune;
    st = cln_selftest_config(t->device, &t->desc->settings->config, keep_first, try);
    if (st == CLN_OK)
        st = measure(t, &candidate, try);
    st = give_up(t, try, st);
    CLN_TRY(refuse(try, st));
    if (try->verdict == CLN_SET_TAKEN) {
        cln_pipeline_free(&t->best);
        t->best = candidate;
        memset(&candidate, 0, sizeof candidate);
    }
    cln_tune_tell(try);
    t->longest[kind] = fmax(t->longest[kind], cln_now() - began);
done:
    cln_pipeline_free(&candidate);
    return st;
}

/* ---- the search ---- */

/* Vectors, groups and tiles must be as asked for; blocks and slices are rounded to whole tiles. */
static bool possible(const tuner *t, const cln_tune *wanted)
{
    cln_tune fitted = *wanted;

    cln_pipeline_fit(t->device, &t->net, &fitted);
    fitted.nb = wanted->nb;
    fitted.sl = wanted->sl;
    return memcmp(&fitted, wanted, sizeof fitted) == 0;
}

/* Tries all moves of one row, each from the set that is the best by then. */
static cln_status go_through(tuner *t, const char *list)
{
    cln_status st = CLN_OK;
    char move[64];

    while (list && *list) {
        const size_t length = strcspn(list, " ");
        cln_tune tune = t->best.tune;

        snprintf(move, sizeof move, "%.*s", (int)length, list);
        list += length + strspn(list + length, " ");
        CLN_TRY(cln_tune_parse(move, &tune));
        if (possible(t, &tune))
            CLN_TRY(consider(t, tune));
    }
done:
    return st;
}

static cln_status search(tuner *t, const cln_tune *start, const cln_tune *present)
{
    cln_status st = CLN_OK;
    const bool cpu = strcmp(t->device->info.type, "cpu") == 0;
    cln_tune plain, before;

    cln_tune_plain(&plain);
    CLN_TRY(consider(t, *start));
    if (!t->best.device)
        CLN_TRY(consider(t, plain));
    if (!t->best.device) {
        st = cln_fail(CLN_CHECK,
                      "%s: even the plain kernel parameters compute wrong results: %s; "
                      "another driver or device (--device) may do better",
                      t->device->info.name, t->result->tries[t->result->count - 1].reason);
        goto done;
    }
    CLN_TRY(consider(t, *present));
    do {
        before = t->best.tune;
        for (int m = 0; m < MOVES; m++)
            CLN_TRY(go_through(t, cpu ? moves[m].cpu : moves[m].gpu));
    } while (!t->spent && memcmp(&before, &t->best.tune, sizeof before) != 0);
done:
    return st;
}

static cln_status report(tuner *t)
{
    cln_tune_result *r = t->result;
    char now[32], comment[128];

    cln_tune_text(&t->best.tune, r->tune);
    r->rays = t->work.rays;
    r->samples = (int)t->work.samples;
    r->leaves = t->best.leaves;
    r->complete = !t->spent;
    cln_utc_now(now);
    snprintf(comment, sizeof comment, "cl-nascent tune %s, %.10s: %.4g ms a step, gain %.2f",
             CLN_VERSION, now, 1e3 * r->seconds, r->gain);
    cln_tune_row_text(&r->device, r->network, &t->best.tune, comment, r->row);
    return t->desc->file ? cln_tune_row_put(t->desc->file, r->row) : CLN_OK;
}

static cln_status search_for(const cln_tune_desc *desc, cln_tune_result *result)
{
    cln_status st = CLN_OK;
    tuner t = {.desc = desc, .result = result, .began = cln_now()};
    cln_tune start, present;
    char from[CLN_TUNE_FROM];

    memset(result, 0, sizeof *result);
    result->gain = 1;
    t.deadline = t.began + desc->budget;
    t.building = (cln_callbacks){.interrupted = ask, .user = &t};
    CLN_TRY(cln_config_check(&desc->settings->config));
    if (desc->file && cln_is_dir(desc->file))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: is a folder; give the name of a file", desc->file));
    if (desc->file) /* before the search; its folders are made */
        CLN_TRY(cln_disk_check_file(desc->file, ROW_MOST, "kernel parameters"));
    CLN_TRY(cln_device_open(&desc->device, &t.device));
    CLN_TRY(cln_network_layout(&desc->settings->config, &t.net));
    cln_network_text(&t.net, result->network);
    t.device->callbacks = &t.building;
    result->device = t.device->info;
    start = t.device->tune;
    cln_device_tune(t.device, result->network, &present, from);
    t.device->tune_exact = true;
    cln_info("device: %s (%s, %d compute unit%s); %s of %s", t.device->info.name,
             t.device->info.platform, t.device->info.compute_units,
             cln_plural(t.device->info.compute_units, "", "s"),
             cln_leaf_kind_of(desc->settings->config.encoding)->name, result->network);
    CLN_TRY(cln_synthetic_create(t.device, &desc->settings->config, &t.work));
    CLN_TRY(search(&t, &start, &present));
    CLN_TRY(report(&t));
done:
    cln_pipeline_free(&t.best);
    cln_synthetic_free(&t.work);
    free(t.tried);
    cln_device_close(t.device);
    if (st != CLN_OK)
        cln_tune_free(result);
    return st;
}

cln_status cln_tune_search(const cln_tune_desc *desc, cln_tune_result *result)
{
    cln_status st = CLN_OK;
    cln_tune_desc whole;
    cln_settings *own = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_tune_search", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_tune_search", "desc", desc));
    CLN_TRY(cln_given_number("cln_tune_search", "budget", desc->budget, 0, 1e6));
    CLN_TRY(cln_given_number("cln_tune_search", "max_tries", desc->max_tries, 0, INT_MAX));
    whole = *desc;
    whole.budget = desc->budget > 0 ? desc->budget : BUDGET;
    CLN_TRY(cln_given_settings(desc->settings, &own, &whole.settings));
    st = search_for(&whole, result);
done:
    cln_settings_free(own);
    return st;
}

void cln_tune_free(cln_tune_result *result)
{
    if (!result)
        return;
    free(result->tries);
    memset(result, 0, sizeof *result);
}
