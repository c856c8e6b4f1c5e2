/* `cl-nascent train`: settings -> cln_train, then the result, also of an interrupted training. */
#include "cli/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/settings.h"
#include "base/text.h"
#include "cli/browser.h"
#include "cli/console.h"
#include "io/json.h"
#include "io/run_folder.h"
#include "model/model.h"
#include "ranks/ranks.h"
#include "render/recorded.h"

static const char *state_of(cln_status st)
{
    return st == CLN_OK ? "done" : "interrupted";
}

static cln_status print_result(const cln_options *options, const char *run, cln_status trained,
                               const cln_train_result *r)
{
    char digest[32], step[32], training[32], wall[32], train[32], test[32], leaves[32], device[32];
    char host[32], quoted[CLN_QUOTED_BYTES];

    cln_digest_text(r->digest, digest);
    if (options->json)
        return cln_print_json(json_pack(
            "{s:s s:s s:s s:I s:o s:o s:o s:o s:o s:o s:o s:i s:i s:i s:o s:o s:s}", "schema",
            "cl-nascent.train/1", "run", run, "state", state_of(trained), "step",
            (json_int_t)r->step, "seconds", cln_json_real(r->seconds), "cpu_seconds",
            cln_json_real(r->cpu_seconds), "wall_seconds", cln_json_real(r->wall_seconds),
            "psnr_train", cln_json_real(r->psnr_train), "psnr_test", cln_json_real(r->psnr_test),
            "psnr_exposed", cln_json_real(r->psnr_exposed), "eval_step",
            r->eval_step >= 0 ? json_integer((json_int_t)r->eval_step) : json_null(), "eval_views",
            r->eval_views, "test_views", r->test_views, "leaves", r->leaves, "device_peak",
            cln_json_whole(r->device_peak), "host_peak", cln_json_whole(r->host_peak),
            "model_digest", digest));
    cln_format_count((double)r->step, step);
    cln_format_duration(r->seconds, training);
    cln_format_duration(r->wall_seconds, wall);
    cln_format_real(r->psnr_train, 2, train);
    cln_format_real(r->psnr_test, 2, test);
    cln_format_count(r->leaves, leaves);
    printf("run           %s (%s)\n", run, state_of(trained));
    printf("steps         %s\n", step);
    if (options->resume)
        printf("time          %s of training since the run began; %s from this start to the end\n",
               training, wall);
    else
        printf("time          %s of training; %s in all, with start, evaluation and checkpoints\n",
               training, wall);
    if (isfinite(r->cpu_seconds)) {
        cln_format_duration(r->cpu_seconds, training);
        printf("processors    %s for that training, all threads together\n", training);
    }
    if (!isfinite(r->psnr_train) && !isfinite(r->psnr_test))
        printf("PSNR          not measured yet");
    else
        printf("PSNR          %s train", train);
    if (isfinite(r->psnr_train) && r->psnr_train_steps > 1)
        printf(" (mean of the last %d steps)", r->psnr_train_steps);
    if (isfinite(r->psnr_test) && r->eval_views < r->test_views)
        printf(", %s test (over %d of %d test views; of all: `cl-nascent eval %s`)", test,
               r->eval_views, r->test_views, cln_shell_quote(run, quoted, sizeof quoted));
    else if (isfinite(r->psnr_test))
        printf(", %s test (over %s%d test view%s)", test, r->test_views > 1 ? "all " : "",
               r->test_views, r->test_views > 1 ? "s" : "");
    if (isfinite(r->psnr_test) && r->eval_step >= 0 && r->eval_step < r->step) {
        cln_format_count((double)r->eval_step, step);
        printf(", at step %s", step);
    }
    putchar('\n');
    if (isfinite(r->psnr_exposed))
        printf(
            "              %.2f test at the exposure that photos before and after each one tell\n",
            r->psnr_exposed);
    printf("leaves        %s\n", leaves);
    cln_format_bytes(r->device_peak, device);
    cln_format_bytes(r->host_peak, host);
    printf("peak memory   %s device, %s host\n", device, host);
    printf("model digest  %s\n", digest);
    if (cln_has_file(run, "report.html"))
        printf("report        %s/report.html\n", run);
    return CLN_OK;
}

/* Shows the address on standard error, as standard output has the result. */
static void show_address(const char *address, void *user)
{
    const cln_options *options = user;

    if (options->quiet)
        fprintf(stderr, "%s\n", address);
    else
        cln_info("watch it in a browser: %s", address);
    if (options->open)
        cln_open_browser(address);
}

/* Is that the scene of the run, by its path? */
static bool is_scene_of(const json_t *run, const char *scene)
{
    char *path = scene ? realpath(scene, NULL) : NULL;
    const bool same =
        path && strcmp(path, cln_json_text(json_object_get(run, "dataset"), "path")) == 0;

    free(path);
    return same;
}

/* Is the scene still what the run was trained on? Its files are read, nothing is decoded. */
static cln_status check_scene(const cln_options *options)
{
    cln_status st = CLN_OK;
    const cln_scene_desc desc = {.path = options->operand, .config = &options->settings->config};
    cln_scene *scene = NULL;
    bool same = false;

    CLN_TRY(cln_recorded_resume(options->resume, &desc, &scene, &same));
    if (!same)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: not the scene that %s, which is done, was trained on, so its figures "
                         "are of others; with a larger budget it goes on with what is there now",
                         options->operand, options->resume));
done:
    cln_scene_free(scene);
    return st;
}

/* Are the settings the run's, and its steps and seconds as many as another budget asks for? */
static bool asks_no_more(const cln_config *now, const cln_config *its, const json_t *result)
{
    const double budgets[3][3] = {
        {now->steps, its->steps, cln_json_number(result, "step")},
        {now->epochs, its->epochs, cln_json_number(result, "epochs")},
        {now->time_limit, its->time_limit, cln_json_number(result, "seconds")}};
    cln_config alike = *now;

    alike.steps = its->steps;
    alike.epochs = its->epochs;
    alike.time_limit = its->time_limit;
    if (cln_config_differs(&alike, its, 0))
        return false;
    for (int i = 0; i < 3; i++)
        if (budgets[i][0] != budgets[i][1] &&
            !(budgets[i][0] > 0 && budgets[i][2] >= budgets[i][0]))
            return false;
    return true;
}

/* *is_done: --resume-or-start finds a run of this scene that is, and no setting is another. Says
 * so, and prints its result as it was. */
static cln_status finish_early(const cln_options *options, bool *is_done)
{
    cln_status st = CLN_OK;
    const cln_settings *settings = options->settings;
    const char *run = options->resume, *state = NULL, *digest = NULL;
    json_t *document = NULL;
    const json_t *r = NULL;
    cln_train_result result = {.psnr_exposed = NAN, .eval_step = -1};

    *is_done = false;
    CLN_TRY(cln_run_read(run, &document));
    (void)cln_run_drop_result(document, cln_checkpoint_newest_whole(run));
    state = cln_json_text(document, "state");
    *is_done =
        strcmp(state, "done") == 0 && json_is_object(json_object_get(document, "result")) &&
        is_scene_of(document, options->operand) &&
        asks_no_more(&settings->config, &settings->base, json_object_get(document, "result"));
    CLN_TRY(cln_ranks_agree(*is_done, "copy of the run"));
    if (!*is_done)
        goto done;
    CLN_TRY(check_scene(options));
    if (cln_ranks_me() > 0)
        goto done;
    cln_info("%s is done, so nothing is trained; with a larger budget it goes on", run);
    r = json_object_get(document, "result");
    digest = cln_json_text(r, "model_digest");
    result.step = json_integer_value(json_object_get(r, "step"));
    result.seconds = cln_json_number(r, "seconds");
    result.cpu_seconds = cln_json_number(r, "cpu_seconds");
    result.wall_seconds = cln_json_number(r, "wall_seconds");
    result.psnr_train = cln_json_number(r, "psnr_train");
    result.psnr_test = cln_json_number(r, "psnr_test");
    if (json_is_integer(json_object_get(r, "eval_step")))
        result.eval_step = json_integer_value(json_object_get(r, "eval_step"));
    result.eval_views = (int)json_integer_value(json_object_get(r, "eval_views"));
    result.test_views = (int)json_integer_value(
        json_object_get(json_object_get(json_object_get(document, "dataset"), "splits"), "test"));
    result.leaves = (int)json_integer_value(json_object_get(r, "leaves"));
    result.device_peak = cln_json_number(r, "device_peak");
    result.host_peak = cln_json_number(r, "host_peak");
    result.digest = strtoull(digest, NULL, 16);
    CLN_TRY(print_result(options, run, CLN_OK, &result));
done:
    json_decref(document);
    return st;
}

cln_status cln_cmd_train(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_status trained = CLN_OK;
    cln_console console = {0};
    cln_train_result result = {.cpu_seconds = NAN,
                               .psnr_train = NAN,
                               .psnr_test = NAN,
                               .psnr_exposed = NAN,
                               .eval_step = -1};
    const char *run = options->resume ? options->resume : options->output;
    const cln_live_desc live = {.listen = options->listen,
                                .port = options->port,
                                .share = options->view_share / 100,
                                .ready = show_address,
                                .user = (void *)options};
    char quoted[CLN_QUOTED_BYTES];
    bool is_done = false;
    cln_train_desc desc = {.scene = options->operand,
                           .run = run,
                           .resume = options->resume != NULL,
                           .restart = options->resume_or_start,
                           .skip_selftest = options->skip_selftest,
                           .dump_program = options->dump_program,
                           .live = options->watch ? &live : NULL,
                           .settings = options->settings,
                           .device = options->device,
                           .command = options->line};

    if (options->conf_said)
        cln_info("%s%s", options->resume ? "" : "settings ", options->conf_said);
    if (options->resume_or_start)
        CLN_TRY(cln_ranks_have(options->resume != NULL, run));
    if (options->resume_or_start && options->resume)
        CLN_TRY(finish_early(options, &is_done));
    if (is_done)
        goto done;
    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    trained = cln_train(&desc, &result);
    cln_console_close(&console);
    if (trained != CLN_OK && trained != CLN_SIGINT && trained != CLN_SIGTERM)
        return trained;
    if (trained != CLN_OK && result.digest == 0) /* stopped before the first step */
        return trained;
    if (options->watch)
        cln_info("the viewer ends with the training; `cl-nascent view %s` shows the run again",
                 cln_shell_quote(run, quoted, sizeof quoted));
    if (cln_ranks_me() == 0)
        CLN_TRY(print_result(options, run, trained, &result));
    st = trained;
done:
    cln_console_close(&console);
    return st;
}
