/* cln_train: puts a run together (scene, device, programs, plan, model) and takes it apart again.
 * The loop is train/loop.c. Nothing but the lock of a run that is resumed is written before scene,
 * options and memory plan are known to be good. */
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "api/needs.h"
#include "base/callbacks.h"
#include "base/clock.h"
#include "base/config.h"
#include "base/files.h"
#include "base/given.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/settings.h"
#include "base/text.h"
#include "check/selftest.h"
#include "device/cache.h"
#include "io/disk.h"
#include "io/progress.h"
#include "io/run_folder.h"
#include "model/structure.h"
#include "pipeline/room.h"
#include "pipeline/share.h"
#include "ranks/ranks.h"
#include "render/quality.h"
#include "render/recorded.h"
#include "report/report.h"
#include "scene/inspect.h"
#include "scene/photos.h"
#include "scene/reader.h"
#include "scene/standing.h"
#include "train/begin.h"
#include "train/found_anew.h"
#include "train/loop.h"
#include "train/plans.h"
#include "train/record.h"
#include "train/refine.h"
#include "train/step.h"
#include "train/watch.h"

static const double LONG_CHECK = 5; /* seconds; with cached kernels the check takes less */

/* A number of a run's result, rounded up; 0 without one. */
static int whole(const json_t *number)
{
    return (int)fmax(0, fmin(INT_MAX, ceil(json_number_value(number))));
}

cln_status cln_settings_of_run(const char *run, cln_settings **out)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;
    json_t *document = NULL;
    const json_t *result = NULL;

    CLN_TRY(cln_given("cln_settings_of_run", "out", out));
    *out = NULL;
    CLN_TRY(cln_given("cln_settings_of_run", "run", run));
    CLN_TRY(cln_settings_create(NULL, &settings));
    CLN_TRY(cln_run_config(run, &settings->config));
    CLN_TRY(cln_strdup(&settings->run, run));
    CLN_TRY(cln_reader_run(run, &document));
    result = json_object_get(document, "result");
    settings->used.steps = whole(json_object_get(result, "step"));
    settings->used.time_limit = json_number_value(json_object_get(result, "seconds"));
    settings->used.epochs = whole(json_object_get(result, "epochs"));
    settings->base = settings->config;
    settings->preset[0] = 0;
    *out = settings;
    settings = NULL;
done:
    json_decref(document);
    cln_settings_free(settings);
    return st;
}

/* Returns whether the tree has every level that it is to grow to, by the saved settings and by the
 * present ones. */
static bool is_grown(const cln_trainer *t, const cln_config *saved)
{
    if (cln_leaf_kind_of(saved->encoding)->levels_first && t->model.decisions > 0)
        return true;
    return t->model.level >= cln_structure_level(saved, 1) &&
           t->model.level >= cln_structure_level(&t->model.config, 1);
}

/* Returns whether its time to adapt is over, by both. */
static bool is_frozen(const cln_trainer *t, const cln_config *saved)
{
    const double fraction = cln_step_fraction(t);

    return fraction >= saved->structure_until && fraction >= t->model.config.structure_until;
}

/* Makes the memory plans, and finds the number of rays of the first batch under them. */
static cln_status plan(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    const int wanted = t->desc->resume ? cln_config_most_rays(c) : c->rays;
    cln_plans plans;
    int most = 0, first = 0;

    cln_plans_now(t, &plans);
    t->plan = plans.device;
    t->host_plan = plans.host;
    cln_share_evenly(&t->pipeline, t->model.tree.leaf_count);
    CLN_TRY(cln_plans_deal(t));
    CLN_TRY(cln_plan_check(t->device, &t->plan));
    CLN_TRY(cln_plan_check_host(&t->host_plan));
    cln_plan_apply(&t->plan, &t->pipeline);
    most = wanted < t->plan.max_rays ? wanted : t->plan.max_rays;
    first = t->desc->resume ? t->model.rays : (int)(t->plan.batch_samples / 32);
    t->model.rays = first < CLN_STEP_LEAST_RAYS ? CLN_STEP_LEAST_RAYS : first > most ? most : first;
    t->device->peak = t->device->allocated; /* without the self-test's peak */
done:
    return st;
}

/* Joins the strings of an array, as many as fit. */
static const char *join(const json_t *strings, const char *between, char *out, size_t bytes)
{
    size_t used = 0;

    out[0] = 0;
    for (size_t i = 0; i < json_array_size(strings) && used < bytes; i++)
        used += (size_t)snprintf(out + used, bytes - used, "%s%s", i ? between : "",
                                 json_string_value(json_array_get(strings, i)));
    return out;
}

/* Says how many views show nothing of the cube, as of a part of a scene. */
static void say_apart(const cln_scene *scene)
{
    int all[CLN_SPLITS] = {0}, apart[CLN_SPLITS] = {0};
    const int *train = &apart[CLN_SPLIT_TRAIN], *test = &apart[CLN_SPLIT_TEST];

    for (int i = 0; i < scene->view_count; i++) {
        all[scene->views[i].split]++;
        apart[scene->views[i].split] += !cln_scene_view_counts(scene, i);
    }
    if (*train + *test == 0)
        return;
    cln_info("views: %d of %d train and %d of %d test show nothing of the cube; %s%s", *train,
             all[CLN_SPLIT_TRAIN], *test, all[CLN_SPLIT_TEST],
             scene->space.shell ? "they train only what lies around it"
                                : "they train nothing (--train-views spares their memory)",
             *test == 0                    ? ""
             : *test < all[CLN_SPLIT_TEST] ? ", and figures of test views are of the others"
                                           : ", and test figures tell nothing of it");
}

/* Logs what the run consists of; with -v also details that few people need. */
static void say_what_runs(cln_trainer *t)
{
    const cln_scene *scene = t->scene;
    const char *rows = t->desc->device.tune_file; /* the user's */
    char text[1024], device[32], host[32], device_limit[32], host_limit[32], val[32] = "";
    json_t *list = NULL;
    size_t left_out = 0;

    cln_info("scene: %s, read as %s, because %s", scene->folder, scene->dialect, scene->because);
    if (cln_scene_split_count(scene, CLN_SPLIT_VAL) > 0)
        snprintf(val, sizeof val, "%d val, ", cln_scene_split_count(scene, CLN_SPLIT_VAL));
    cln_info("views: %d train, %s%d test (%s)", cln_scene_split_count(scene, CLN_SPLIT_TRAIN), val,
             cln_scene_split_count(scene, CLN_SPLIT_TEST), scene->split_rule);
    if (scene->downscale > 1) {
        const cln_view *first = cln_scene_training_view(scene, 0);

        cln_info("photos: of %d x %d pixels, trained on at %d x %d (--downscale %d; 1: as they "
                 "are)%s",
                 first->file_width, first->file_height, first->camera.width, first->camera.height,
                 first->downscale,
                 scene->downscale != scene->downscale_least ? "; others are divided by others"
                                                            : "");
    }
    if (scene->masks_rule)
        cln_info("masks: %s", scene->masks_rule);
    cln_info("%s: %s", scene->space.forward ? "space" : "cube", scene->bounds_rule);
    say_apart(scene);
    if (json_array_size(scene->ignored) > 0)
        cln_info("scene: keys of its files that are not used: %s",
                 join(scene->ignored, ", ", text, sizeof text));
    if (t->batch.shown)
        cln_info("depths: of %lld pixel%s of the training views, by %s (--depth-loss %g)",
                 (long long)scene->sight_count, cln_plural((double)scene->sight_count, "", "s"),
                 scene->depth_sights == 0                    ? "sparse points"
                 : scene->depth_sights == scene->sight_count ? "depth images"
                                                             : "sparse points and depth images",
                 t->model.config.depth_loss);
    cln_tune_text(&t->pipeline.tune, text);
    cln_debug("kernel parameters: %s (%s)", text, t->pipeline.tune_from);
    if (rows && *rows && strncmp(t->pipeline.tune_from, rows, strlen(rows)) == 0)
        cln_info("kernels: as tuned in %s", t->pipeline.tune_from);
    if (t->desc->device.tune)
        cln_tune_unmet(t->desc->device.tune, &t->pipeline.tune, text);
    if (t->desc->device.tune && *text)
        cln_warn("--tune: these leaves and this device do not allow %s", text);
    cln_plan_text(&t->plan, text, sizeof text);
    cln_debug("memory plan: %s", text);
    cln_plan_text(&t->host_plan, text, sizeof text);
    cln_debug("host memory, estimated: %s", text);
    if (cln_record_left_out(t, &list) == CLN_OK) {
        left_out = json_array_size(list);
        cln_debug("left out: %s", left_out ? join(list, "; ", text, sizeof text) : "nothing");
    }
    json_decref(list);
    cln_format_bytes(t->plan.total, device);
    cln_format_bytes(t->plan.limit, device_limit);
    cln_format_bytes(t->host_plan.total, host);
    cln_format_bytes(t->host_plan.limit, host_limit);
    cln_info(
        "memory: device %s of %s, more as the tree grows; host about %s of %s; %zu part%s of the "
        "method %s left out, as not needed (details: -v)",
        device, device_limit, host, host_limit, left_out, cln_plural((double)left_out, "", "s"),
        cln_plural((double)left_out, "is", "are"));
    if (t->plan.batch_samples < (size_t)t->model.config.batch_samples ||
        t->plan.max_rays < t->model.config.rays) {
        cln_format_bytes((double)t->device->max_alloc, text);
        cln_info("batches are cut to %zu samples and %d rays: the device's largest buffer has %s",
                 t->plan.batch_samples, t->plan.max_rays, text);
    }
}

/* Bytes of a run's files at most, with another --max-leaves. */
static cln_status most_bytes(const cln_trainer *t, const cln_config *config, int max_leaves,
                             double *bytes)
{
    cln_status st = CLN_OK;
    cln_config c = *config;

    c.max_leaves = max_leaves;
    CLN_TRY(cln_checkpoint_room(t->desc->run, &c, t->scene->space.shell, bytes));
    *bytes += cln_quality_bytes(t->scene, t->eval_views, t->eval_count);
done:
    return st;
}

/* CLN_OUTPUT if the disk has no room for a checkpoint of the first tree, or one more of the resumed
 * one; a warning if it has none for all that a run with the largest tree writes, as few trees
 * become that large. */
static cln_status check_disk(const cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;
    const char *what = t->desc->resume ? "the leaves of its next checkpoint"
                                       : "the leaves of its first checkpoint";
    const double room = cln_disk_room(t->desc->run);
    double least = 0, most = 0, smaller = INFINITY;
    int leaves = config->max_leaves;
    const int first_leaves = cln_config_first_leaves(config, t->scene->space.shell);
    char need[32], have[32], fits[96] = "";

    CLN_TRY(cln_checkpoint_bytes(config, first_leaves, &least));
    if (t->desc->resume) /* its tree may have been carved since */
        least = cln_checkpoint_newest_bytes(t->desc->run);
    CLN_TRY(cln_disk_check_size(t->desc->run, least, what));
    CLN_TRY(cln_disk_check(t->desc->run, least, what));
    CLN_TRY(most_bytes(t, config, leaves, &most));
    if (most <= room)
        goto done;
    while (config->adaptive && smaller > room && leaves - (leaves + 3) / 4 > first_leaves) {
        leaves -= (leaves + 3) / 4;
        CLN_TRY(most_bytes(t, config, leaves, &smaller));
    }
    if (smaller <= room)
        snprintf(fits, sizeof fits, "; with --max-leaves %d it has surely enough", leaves);
    cln_format_bytes(most, need);
    cln_format_bytes(room, have);
    cln_warn("%s: the disk may have too little room: checkpoints and pictures need up to %s%s, %s "
             "are free%s",
             t->desc->run, need, config->adaptive ? ", with all of --max-leaves" : "", have, fits);
done:
    return st;
}

/* Compares by digests what all ranks must have in common. If it differed, training would silently
 * go wrong, or wait forever. */
static cln_status check_ranks(const cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_model *m = &t->model;
    const cln_scene *scene = t->scene;
    char *settings = NULL;
    json_t *config = NULL;
    uint64_t views = scene->digest; /* photos included */

    if (cln_ranks_count() == 1)
        return CLN_OK;
    CLN_TRY(cln_share_agree(&t->pipeline, (size_t[]){t->plan.max_samples, t->plan.batch_samples,
                                                     (size_t)t->plan.max_rays}));
    CLN_TRY(cln_config_to_json(&m->config, &config));
    settings = json_dumps(config, JSON_COMPACT);
    if (!settings)
        CLN_TRY(cln_fail(CLN_MEMORY, "settings: cannot make JSON"));
    CLN_TRY(cln_ranks_agree(cln_digest(CLN_DIGEST_START, settings, strlen(settings)),
                            "choice of settings"));
    for (int i = 0; i < scene->view_count; i++) {
        const cln_camera *c = &scene->views[i].camera;

        views = cln_digest(views, c->c2w, sizeof c->c2w);
    }
    CLN_TRY(cln_ranks_agree(views, "scene"));
    CLN_TRY(cln_ranks_agree(cln_model_digest(m) + (uint64_t)m->step, "checkpoint"));
done:
    json_decref(config);
    free(settings);
    return st;
}

/* Of work before the first step. Several ranks could stop at different parts of it. */
static cln_callbacks early_callbacks(cln_trainer *t)
{
    cln_callbacks callbacks = cln_loop_callbacks(t);

    if (cln_ranks_count() > 1)
        callbacks.interrupted = NULL;
    return callbacks;
}

/* Most of its time is compiling, if the driver has not cached the kernels. */
static cln_status check_kernels(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;
    const cln_callbacks callbacks = early_callbacks(t);
    const double began = cln_now();
    double seconds = 0;
    char took[32];

    cln_info("checking the kernels on %s", t->device->info.name);
    st = cln_selftest_training(t->device, config, &t->scene->space, &callbacks);
    if (st == CLN_CHECK)
        cln_note("checking the device before training; --skip-selftest trains on it anyway, but "
                 "results may be wrong");
    CLN_TRY(st);
    seconds = cln_now() - began - t->device->turn.waited;
    if (seconds > LONG_CHECK) {
        cln_format_duration(seconds, took);
        cln_info("the kernels are correct (checked in %s); most drivers keep compiled kernels, so "
                 "the next start is faster",
                 took);
    }
done:
    return st;
}

/* Stops on a signal before the first step, when there is nothing (more) to save. */
static cln_status stop_early(cln_trainer *t)
{
    cln_loop_poll(t);
    return cln_stopped_by(t->signal, NULL);
}

/* Takes over the run of a training that ended before its first checkpoint, if there is one: its
 * files are replaced as this one writes its own. */
static cln_status take_over(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const char *run = t->desc->run;
    char *path = NULL;
    json_t *document = NULL;
    bool exists = false, empty = false;

    CLN_TRY(cln_path_join(&path, run, "run.json"));
    if (!cln_is_file(path))
        goto done;
    CLN_TRY(cln_run_open(run, true));
    CLN_TRY(cln_run_hold(run, &t->lock));
    CLN_TRY(cln_checkpoint_exists(run, &exists));
    if (exists) { /* refused, and not because we hold it */
        cln_run_release(t->lock);
        t->lock = -1;
        CLN_TRY(cln_run_check(run, false, &empty));
    }
    CLN_TRY(cln_run_read(run, &document));
    if (strcmp(cln_json_text(document, "state"), "done") == 0)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: its run is done, but its checkpoint is gone; put it back, or choose "
                         "a new folder",
                         run));
    cln_info("%s: its run has no checkpoint, so it begins again", run);
done:
    json_decref(document);
    free(path);
    return st;
}

/* Is there a run to resume, or room for a new one? Holds the former until the end, before anything
 * is read that another process could still change. */
static cln_status check_folder(cln_trainer *t)
{
    cln_status st = CLN_OK;
    bool empty = false;

    if (t->desc->restart && !t->desc->resume && t->writes)
        CLN_TRY(take_over(t));
    if (t->lock >= 0)
        goto done;
    if (t->desc->resume) {
        CLN_TRY(cln_run_open(t->desc->run, true));
        if (t->writes)
            CLN_TRY(cln_run_hold(t->desc->run, &t->lock));
    } else if (t->writes) {
        CLN_TRY(cln_run_check(t->desc->run, false, &empty));
    }
done:
    return st;
}

/* Do the settings go together, and with those of the run that is resumed? These go to *saved. A
 * resumed run keeps the level that its tree began with: another would make it grow to that. */
static cln_status check_settings(cln_trainer *t, cln_config *config, cln_config *saved)
{
    cln_status st = CLN_OK;

    if (t->desc->resume) {
        CLN_TRY(cln_run_config(t->desc->run, saved));
        config->start_level = saved->start_level;
    }
    CLN_TRY(cln_config_check(config));
    if (t->desc->resume) { /* cln_begin_model asks the checkpoint, but this is before the photos */
        CLN_TRY(cln_begin_check_saved(saved, config));
    }
    CLN_TRY(cln_config_points("eval-at", config->eval_at, &t->eval_at));
    CLN_TRY(cln_config_points("save-at", config->save_at, &t->save_at));
done:
    return st;
}

/* Of a new training: a smaller batch where memory is short and none is given, which is said and the
 * same on all ranks; epochs, if they are its budget. A resumed run has both in its settings. */
static cln_status fit_budget(cln_trainer *t, cln_config *config)
{
    cln_status st = CLN_OK;
    const cln_room_desc desc =
        cln_room_training(t->device, config, t->scene, &t->model.tree, cln_batch_bytes(t->scene),
                          cln_scene_pixel_bytes(t->scene));
    cln_settings fitted = *t->desc->settings;
    char text[CLN_ROOM_TEXT];
    const bool given = cln_settings_has(t->desc->settings, "batch-samples");
    int samples = config->batch_samples, rays = config->rays;
    double least[2];

    if (!given)
        CLN_TRY(cln_room_fit_batch(&desc, !cln_settings_has(t->desc->settings, "rays"), &samples,
                                   &rays));
    least[0] = -samples;
    least[1] = -rays;
    cln_ranks_largest(least, 2);
    if (!given) {
        cln_room_say_batch(&desc, (int)-least[0], (int)-least[1], text);
        if (*text)
            cln_info("memory: %s", text);
        config->batch_samples = (int)-least[0];
        config->rays = (int)-least[1];
    }
    fitted.config = *config;
    config->epochs = cln_settings_epochs(&fitted, cln_scene_training_pixels(t->scene));
    t->model.config.rays = config->rays;
    t->model.config.batch_samples = config->batch_samples;
    t->model.config.epochs = config->epochs;
done:
    return st;
}

/* Brings the photos' pixels to where memory has room for them; says what becomes of a tree that it
 * has no room for, and of plans beyond what is free now. */
static cln_status place_photos(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;
    const cln_room_desc desc =
        cln_room_training(t->device, config, t->scene, &t->model.tree, cln_batch_bytes(t->scene),
                          cln_scene_pixel_bytes(t->scene));
    cln_room room;
    char text[CLN_ROOM_TEXT];
    bool now = false;

    CLN_TRY(cln_room_place_images(&desc, t->scene, &room));
    if (room.first_host.limit <= CLN_PROGRAM_BYTES) /* sure before plan(): no kernel is checked */
        CLN_TRY(cln_plan_check_host(&room.first_host));
    cln_room_say_tree(&desc, &room, text);
    if (*text && room.leaves > 0 && cln_room_downscale(&desc, &room) > 0)
        cln_warn("memory: %s", text);
    else if (*text && room.leaves > 0)
        cln_info("memory: %s", text);
    cln_room_say_free(&desc, &room, cln_available_memory(""), &now, text);
    if (*text && now)
        cln_warn("memory: %s", text);
    else if (*text)
        cln_info("memory: %s", text);
done:
    return st;
}

/* Opens the device, and reads the scene, a resumed run's own. */
static cln_status load_scene(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;
    const cln_callbacks callbacks = early_callbacks(t);
    const cln_scene_desc desc = {.path = t->desc->scene,
                                 .config = config,
                                 .elsewhere = CLN_PROGRAM_BYTES,
                                 .pixels = {[CLN_SPLIT_TRAIN] = true, [CLN_SPLIT_TEST] = true},
                                 .callbacks = &callbacks};
    bool same = false;

    CLN_TRY(cln_device_open(&t->desc->device, &t->device));
    CLN_TRY(cln_cache_check(t->device->info.platform));
    if (t->desc->resume) {
        CLN_TRY(cln_recorded_tune(t->desc->run, t->device));
        if (!t->desc->device.max_alloc)
            CLN_TRY(cln_recorded_alloc(t->desc->run, t->device));
        CLN_TRY(cln_recorded_resume(t->desc->run, &desc, &t->scene, &same));
        t->other_scene = !same;
        CLN_TRY(cln_recorded_photos(t->desc->run, t->scene));
    } else {
        CLN_TRY(cln_scene_load(&desc, &t->scene));
    }
done:
    return st;
}

/* Chooses the views of evaluations. Is there room for what the training will write, and the tree
 * that it is to begin with? */
static cln_status check_files(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_quality_choose(t->scene, CLN_SPLIT_TEST,
                               config->eval_images > 0 ? config->eval_images : INT_MAX,
                               &t->eval_views, &t->eval_count));
    CLN_TRY(cln_quality_check(t->scene, t->eval_views, t->eval_count));
    if (t->writes)
        CLN_TRY(check_disk(t, config));
    if (t->desc->dump_program)
        CLN_TRY(cln_disk_check_file(t->desc->dump_program, 0, "the integer program"));
    if (config->tree_from[0] && !t->desc->resume)
        CLN_TRY(cln_begin_check_tree(config->tree_from));
done:
    return st;
}

/* Refuses photos and settings that could only change what a finished run says of itself, as its
 * model stays. What is evaluated may change, and the budget, which may not suffice. */
static cln_status check_nothing_left(cln_trainer *t, const cln_config *config,
                                     const cln_config *saved)
{
    char ours[CLN_TEXT_BYTES], its[CLN_TEXT_BYTES];

    if (!cln_loop_used_up(t))
        return CLN_OK;
    if (t->other_scene)
        return cln_fail(CLN_INPUT,
                        "%s: not the scene that %s was trained on, and nothing is left to train, "
                        "so its record stays as it is; with a larger budget (--steps +N) it goes "
                        "on with what is there now",
                        t->scene->path, t->desc->run);
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        cln_config_text(config, row, ours);
        cln_config_text(saved, row, its);
        if (strcmp(ours, its) == 0 || row->flags & CLN_ROW_BUDGET ||
            strncmp(row->option, "eval-", 5) == 0)
            continue;
        return cln_fail(CLN_USAGE,
                        "--%s %s: nothing is left to train, so %s, which was trained with %s, "
                        "stays as it is; leave it out, or give a larger budget, too",
                        row->option, ours, t->desc->run, *its ? its : "none");
    }
    return CLN_OK;
}

/* A run that a smaller budget trains no further keeps the one that it used up. */
static void keep_budget(cln_trainer *t, cln_config *config, const cln_config *saved)
{
    const bool done = (saved->steps > 0 && t->model.step >= saved->steps) ||
                      (saved->time_limit > 0 && t->model.train_seconds >= saved->time_limit);

    if (!cln_loop_used_up(t) || !done)
        return;
    config->steps = saved->steps;
    config->epochs = saved->epochs;
    config->time_limit = saved->time_limit;
    t->steps = config->steps;
    t->model.config.steps = config->steps;
    t->model.config.epochs = config->epochs;
    t->model.config.time_limit = config->time_limit;
}

/* Warns of what is likely wrong with the scene, and of settings that do nothing. */
static void warn(const cln_trainer *t, const cln_config *config, const cln_config *saved)
{
    const bool resume = t->desc->resume;
    cln_settings_facts facts = cln_needs_facts(t->scene, config);

    facts.resume = resume;
    facts.grown = resume && is_grown(t, saved);
    facts.frozen = resume && is_frozen(t, saved);
    facts.past_crop =
        resume && t->model.step >= config->precrop_steps && t->model.step >= saved->precrop_steps;
    facts.ranks = cln_ranks_count();
    cln_scene_warn_doubts(t->scene);
    cln_settings_warn_idle(t->desc->settings, &facts);
    cln_settings_warn_points(config);
}

/* Makes what holds batches, the programs, and the memory plans. */
static cln_status build(cln_trainer *t, const cln_config *config)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_batch_create(t->scene, config, &t->batch));
    CLN_TRY(cln_alloc(&t->results, (size_t)cln_config_most_rays(config), sizeof *t->results,
                      "ray results"));
    CLN_TRY(cln_refine_start(t)); /* before gains, which take over other photos */
    CLN_TRY(cln_exposure_start(t->scene, cln_config_most_rays(config), &t->model, &t->exposure));
    cln_info("device: %s (%s, %d compute unit%s)", t->device->info.name, t->device->info.platform,
             t->device->info.compute_units, cln_plural(t->device->info.compute_units, "", "s"));
    CLN_TRY(
        cln_pipeline_create(t->device, config,
                            &(cln_pipeline_facts){.lenses = t->scene->lenses,
                                                  .alpha = t->scene->has_alpha,
                                                  .no_sights = !cln_batch_knows(t->scene, config),
                                                  .depth = cln_octree_depth(&t->model.tree),
                                                  .in_parts = t->model.in_parts,
                                                  .space = &t->model.space},
                            CLN_PROGRAMS_ALL, &t->pipeline));
    t->pipeline.antialias = cln_model_antialias(&t->model); /* of pictures on the way */
    CLN_TRY(cln_pipeline_share(&t->pipeline));
    CLN_TRY(plan(t));
done:
    return st;
}

/* Begins to write the run, and brings scene and model to the device. */
static cln_status begin(cln_trainer *t)
{
    cln_status st = CLN_OK;

    if (t->writes && !t->desc->resume && t->lock < 0) {
        CLN_TRY(cln_run_open(t->desc->run, false));
        CLN_TRY(cln_run_hold(t->desc->run, &t->lock));
    }
    CLN_TRY(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    CLN_TRY(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(&t->pipeline, &t->model, true));
    CLN_TRY(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
    if (t->writes) {
        CLN_TRY(cln_record_start(t));
        CLN_TRY(cln_run_drop_evals(t->desc->run, t->model.step));
        CLN_TRY(cln_metrics_open(t->desc->run, t->model.step, &t->metrics));
    }
done:
    return st;
}

/* The box that photos tell becomes a setting, so that all that follows has the same. */
static cln_status choose_box(cln_trainer *t, cln_config *config)
{
    const cln_callbacks callbacks = early_callbacks(t);
    cln_status st = CLN_OK;
    cln_config other = {0};
    cln_placed placed;
    char box[CLN_SETTING_BYTES] = "";

    if (config->bbox[0])
        return CLN_OK;
    if (config->tree_from[0]) { /* the tree is of the other run's cube */
        CLN_TRY(cln_run_config(config->tree_from, &other));
        snprintf(box, sizeof box, "%s", other.bbox);
        if (box[0])
            CLN_TRY(cln_scene_take_box(t->scene, box));
        if (box[0] && config->space == CLN_SPACE_AUTO && other.space == CLN_SPACE_SHELL) {
            t->scene->space.shell = t->space_found = true;
            config->space = CLN_SPACE_SHELL;
        }
    } else {
        CLN_TRY(cln_scene_place_cube(t->scene, config, &callbacks, &placed));
        snprintf(box, sizeof box, "%s", placed.box);
        t->space_found = config->space != placed.space;
        config->space = placed.space;
    }
    t->box_found = box[0] != 0;
    if (t->box_found)
        snprintf(config->bbox, sizeof config->bbox, "%s", box);
done:
    return st;
}

/* Settings of a new training that its photos decide, if neither the caller nor another run does.
 * Before their one colour, what differs from it is as sure to be opaque as where alpha says so,
 * unless that is the light on it. */
static void choose_by_photos(const cln_trainer *t, cln_config *config)
{
    const cln_scene *scene = t->scene;
    const cln_settings *settings = t->desc->settings;
    cln_config usual = *config;
    bool given = cln_settings_has(settings, "opaque-loss");
    bool plain = false;
    char blank[CLN_BLANK_BYTES], standing[CLN_STANDING_BYTES];

    if (!scene->store && cln_scene_has_blank(scene, blank)) /* check looks into a file's, too */
        cln_warn("%s: %s", scene->folder, blank);
    if (scene->still)
        cln_warn("%s: %s", scene->folder, CLN_STILL_ADVICE);
    else if (!scene->store && cln_scene_tell_standing(scene, standing, &plain)) {
        if (plain)
            cln_info("%s: %s", scene->folder, standing);
        else
            cln_warn("%s: %s", scene->folder, standing);
    }
    if (!scene->backdrop)
        return;
    if (settings->preset[0] && cln_config_preset(settings->preset, &usual) == CLN_OK)
        given = given || config->opaque_loss != usual.opaque_loss;
    else
        given = true; /* all are another run's */
    if (!given && usual.opaque_loss > 0)
        config->opaque_loss = scene->backdrop_uneven ? 0 : usual.alpha_loss;
    cln_info("photos: they stand before one colour (%g,%g,%g), which is the background%s. What has "
             "nearly that colour may become transparent: for a shape that can be measured, cut the "
             "object out (alpha, or --masks)",
             scene->background[0], scene->background[1], scene->background[2],
             config->opaque_loss > 0  ? "; what differs from it counts as opaque (--opaque-loss)"
             : scene->backdrop_uneven ? " along their borders, and little by little another one "
                                        "further in, so that what differs from it counts for "
                                        "nothing (--opaque-loss)"
                                      : "");
}

/* Everything before the first step. What needs neither photos nor device is checked first. */
static cln_status prepare(cln_trainer *t)
{
    cln_status st = CLN_OK;
    const cln_callbacks callbacks = early_callbacks(t);
    cln_config config = t->desc->settings->config;
    cln_config saved = config; /* of a resumed run: what it had so far */

    CLN_TRY(check_folder(t));
    CLN_TRY(check_settings(t, &config, &saved));
    CLN_TRY(cln_watch_open(t));
    CLN_TRY(load_scene(t, &config));
    t->device->callbacks = &callbacks;
    CLN_TRY(check_files(t, &config));
    if (!t->desc->resume) {
        CLN_TRY(cln_scene_check_shown(t->scene));
        CLN_TRY(choose_box(t, &config));
        choose_by_photos(t, &config);
        CLN_TRY(cln_found_anew_tell(t->scene, t->desc->settings));
    }
    CLN_TRY(cln_begin_model(t, &config));
    if (!t->desc->resume)
        CLN_TRY(fit_budget(t, &config));
    CLN_TRY(place_photos(t, &config));
    t->steps = config.steps;
    CLN_TRY(check_nothing_left(t, &config, &saved));
    keep_budget(t, &config, &saved);
    warn(t, &config, &saved);
    CLN_TRY(stop_early(t)); /* reading the photos may have taken long */
    t->device->turn.due = true;
    if (!cln_loop_used_up(t) && !t->desc->skip_selftest) /* else there is only an evaluation */
        CLN_TRY(check_kernels(t, &config));
    if (cln_ranks_count() > 1) /* from here on they wait for each other */
        cln_cache_end_turn(&t->device->turn);
    CLN_TRY(build(t, &config));
    say_what_runs(t);
    CLN_TRY(check_ranks(t));
    CLN_TRY(stop_early(t));
    CLN_TRY(begin(t));
done:
    if (t->device)
        t->device->callbacks = NULL;
    return st;
}

/* Says of averages that were asked for that they never began. */
static void say_no_averages(const cln_trainer *t)
{
    const cln_config *c = &t->model.config;
    const double drawn = (double)t->model.drawn,
                 pixels = (double)cln_scene_training_pixels(t->scene);

    if (c->antialias > 1 && t->pipeline.averaged && !t->model.averaged && !t->signal)
        cln_warn(
            "--antialias %d did nothing: %.2g rays were drawn per pixel of the training photos; "
            "train for longer, or give a smaller --antialias-after than %g",
            c->antialias, drawn / pixels, c->antialias_after);
}

/* Says of a training whose test views stayed far behind what can be done. */
static void say_doubt(const cln_trainer *t)
{
    const cln_scene *scene = t->scene;
    const cln_doubt of = {.psnr_train = t->psnr_train,
                          .psnr_test = t->psnr_test,
                          .psnr_fitted = t->psnr_fitted,
                          .fitted_gain = t->fitted_gain,
                          .exposed = t->model.exposed || t->model.has_alpha,
                          .alpha = t->model.has_alpha,
                          .cube_guessed = scene->cube_guessed,
                          .masks_doubtful = scene->masks_doubtful,
                          .training_photos = cln_scene_split_count(scene, CLN_SPLIT_TRAIN)};
    /* with gains, photos differ from the model by their exposure, too */
    const double test = t->model.exposed ? t->psnr_fitted : t->psnr_test;
    char doubt[CLN_DOUBT_BYTES], quoted[CLN_QUOTED_BYTES];

    if (t->writes && cln_report_doubt(&of, doubt))
        cln_warn("%s; `cl-nascent check %s` looks for what is wrong", doubt,
                 cln_shell_quote(scene->path, quoted, sizeof quoted));
    else if (t->writes && t->psnr_train - test > cln_overfit_db)
        cln_info("test views are %.1f dB below training views (overfit): more photos of what few "
                 "of them show help, more leaves or steps do not",
                 t->psnr_train - test);
}

static cln_status train(const cln_train_desc *desc, cln_train_result *result)
{
    cln_status st = CLN_OK;
    cln_trainer t = {.desc = desc,
                     .lock = -1,
                     .writes = cln_ranks_me() == 0,
                     .began = cln_now(),
                     .psnr_train = NAN,
                     .psnr_test = NAN,
                     .psnr_fitted = NAN,
                     .fitted_gain = NAN,
                     .psnr_exposed = NAN,
                     .start_seconds = NAN,
                     .eval_seconds = NAN,
                     .saved_step = -1};
    const char *state = "failed";

    cln_warned_open(&t.warned);
    st = prepare(&t);
    if (st == CLN_SIGINT || st == CLN_SIGTERM) {
        cln_clear_error();
        (void)cln_fail(st, desc->resume ? "stopped by a signal before its next step, so nothing "
                                          "more was written: the run is as it was"
                                        : "stopped by a signal before the first step, so nothing "
                                          "was written");
    }
    CLN_TRY(st);
    CLN_TRY(cln_loop_run(&t));
    say_doubt(&t);
    say_no_averages(&t);
done:
    if (t.device) /* after a failure the queue may still use our arrays */
        (void)cln_device_finish(t.device);
    cln_watch_close(&t);
    result->step = t.model.step;
    result->seconds = t.model.train_seconds;
    result->cpu_seconds = t.cpu_seconds;
    result->wall_seconds = cln_now() - t.began;
    result->psnr_train = t.psnr_train;
    result->psnr_train_steps = t.psnr_train_steps;
    result->psnr_test = t.psnr_test;
    result->psnr_exposed = t.psnr_exposed;
    result->eval_step = isfinite(t.psnr_test) ? t.eval_step : -1;
    result->eval_views = isfinite(t.psnr_test) ? t.eval_count : 0;
    result->test_views = t.scene ? cln_scene_split_count(t.scene, CLN_SPLIT_TEST) : 0;
    result->leaves = t.model.tree.leaf_count;
    result->device_peak = cln_record_device_peak(&t);
    result->host_peak = cln_record_host_peak(&t);
    if (t.model.params && t.run)
        result->digest = cln_record_digest(&t);
    state = st == CLN_OK                            ? "done"
            : st == CLN_SIGINT || st == CLN_SIGTERM ? "interrupted"
                                                    : "failed";
    cln_metrics_close(t.metrics);
    if (t.run) {
        const cln_status written = cln_record_end(&t, state);

        st = st == CLN_OK ? written : st;
        if (st == CLN_OUTPUT && t.writes && t.saved_step == t.model.step)
            cln_note("the checkpoint of step %lld is whole: its model can be measured (eval), "
                     "rendered and trained on",
                     (long long)t.model.step);
    }
    json_decref(t.run);
    cln_warned_close(&t.warned);
    free(t.eval_folder);
    free(t.eval_views);
    free(t.results);
    cln_batch_free(&t.batch);
    cln_exposure_free(&t.exposure);
    cln_refine_free(&t.refine);
    cln_pipeline_free(&t.pipeline);
    cln_model_free(&t.model);
    cln_scene_free(t.scene);
    cln_device_close(t.device);
    cln_run_release(t.lock);
    return st;
}

cln_status cln_train(const cln_train_desc *desc, cln_train_result *result)
{
    cln_status st = CLN_OK;
    cln_train_desc whole;
    cln_settings *own = NULL;

    cln_clear_error();
    CLN_TRY(cln_given("cln_train", "result", result));
    memset(result, 0, sizeof *result);
    CLN_TRY(cln_given("cln_train", "desc", desc));
    whole = *desc;
    CLN_TRY(cln_given("cln_train", "run", desc->run));
    if (!desc->resume)
        CLN_TRY(cln_given("cln_train", "scene", desc->scene));
    if (desc->resume && !desc->settings) {
        CLN_TRY(cln_settings_of_run(desc->run, &own));
        whole.settings = own;
    } else {
        CLN_TRY(cln_given_settings(desc->settings, &own, &whole.settings));
    }
    st = train(&whole, result);
done:
    cln_settings_free(own);
    return st;
}
