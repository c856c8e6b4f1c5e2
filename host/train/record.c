/* Writes the record of a run. See record.h; docs/formats.md has the schemas. */
#include "train/record.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/commit.h"
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "io/run_history.h"
#include "ranks/ranks.h"
#include "render/orbit.h"
#include "render/quality.h"
#include "render/recorded.h"
#include "report/report.h"
#include "scene/cameras_file.h"
#include "scene/scene.h"

static double tenths(double value)
{
    return round(10 * value) / 10;
}

/* Share of the cube outside all leaves. */
static double empty_share(const cln_octree *tree)
{
    double empty = 1;

    for (int s = 0; s < tree->leaf_count; s++)
        empty -= 1.0 / (1 << (3 * tree->level[tree->leaf[s]]));
    return empty;
}

/* "regularisers: sparsity, edge" of those that would have an effect and are 0; false if none is. */
static bool name_regularisers(const cln_config *c, char *text, size_t size)
{
    const cln_settings_facts facts = {0};
    int used = 0;

    text[0] = 0;
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];

        if ((row->flags & CLN_ROW_REGULARISER) &&
            *(const double *)((const char *)c + row->offset) == 0 &&
            !cln_settings_why_idle(c, &facts, row) && used < (int)size)
            used += snprintf(text + used, size - (size_t)used, "%s%s",
                             used ? ", " : "regularisers: ", row->option);
    }
    return used > 0;
}

cln_status cln_record_left_out(const cln_trainer *t, json_t **out)
{
    const cln_config *c = &t->model.config;
    const cln_pipeline *p = &t->pipeline;
    const bool network = cln_leaf_kind_of(c->encoding)->network;
    const bool alpha = t->scene->has_alpha, gather = c->stage1 == CLN_STAGE1_GATHER;
    const bool by_weight = c->allocate == CLN_ALLOCATE_WEIGHT && c->empty_weight > 0;
    const double uncovered = 1 - t->batch.coverage.share, empty = empty_share(&t->model.tree);
    const cln_fold fold = cln_scene_fold(t->scene);
    char regularisers[200];
    const bool unregularised = name_regularisers(c, regularisers, sizeof regularisers);
    const bool skips = uncovered > 0 && cln_batch_skips(&t->batch, c, INT64_MAX);
    const struct {
        bool left_out;
        const char *what; /* with a %g for each number */
        double first, second;
    } rows[] = {
#define ROW(condition, text, ...) {.left_out = condition, .what = text, __VA_ARGS__}
        ROW(!p->lenses, "lens distortion (pinhole cameras)"),
        ROW(!p->space.forward && !p->space.shell,
            "normalised device coordinates (an ordinary cube)"),
        ROW(p->space.shell, "normalised device coordinates (a cube and a shell)"),
        ROW(!p->space.shell, "parts of rays beyond the cube (the scene ends there)"),
        ROW(!(c->near > 0), "a near distance (rays begin at the camera)"),
        ROW(fold.views > 0,
            "%g%% of the pixels of %g views (beyond the fold of the lens model, where no ray goes)",
            .first = tenths(100 * fold.share), .second = fold.views),
        ROW(!alpha, "alpha (images have none)"),
        ROW(!p->ray_background, "background per ray (one background for all)"),
        ROW(!c->view_dependence, "dependence of colours on the direction (--no-view-dependence)"),
        ROW(!network, "networks (leaves are voxels)"),
        ROW(network && p->net.skip_layer < 0, "skip connection"),
        ROW(network && c->rrelu_scope == CLN_RRELU_MEAN, "random slopes (mean slope instead)"),
        ROW(gather, "projection and sort of stage-1 samples (read along the rays instead)"),
        ROW(c->density_noise <= 0, "density noise"),
        ROW(cln_first_moment_bytes(c) == 0, "Adam's first moments (--beta1 0)"),
        ROW(unregularised, regularisers),
        ROW(c->min_transmittance > 0,
            "leaves of a ray where less transmittance than %g is left (from %g%% of the budget)",
            .first = c->min_transmittance, .second = 100 * c->occlusion_from),
        ROW(c->empty_share < 1 && by_weight,
            "%g%% of the intervals in leaves that stage 1 finds empty",
            .first = 100 * (1 - c->empty_share)),
        ROW(skips, "%g%% of the training pixels (their rays meet no leaf)",
            .first = tenths(100 * uncovered)),
        ROW(!c->adaptive, "the structure optimisation (whole levels only)"),
        ROW(c->adaptive && !cln_config_merges(c) && !c->tree_from[0],
            "merges and their distillation (voxels only split)"),
        ROW(c->adaptive && c->tree_from[0],
            "the structure optimisation (the tree is that of --tree-from)"),
        ROW(empty > 0, "%g%% of the cube (empty leaves)", .first = tenths(100 * empty)),
#undef ROW
    };
    char text[256];

    *out = json_array();
    if (!*out)
        return cln_fail(CLN_MEMORY, "record: cannot make JSON");
    for (size_t i = 0; i < sizeof rows / sizeof rows[0]; i++) {
        if (!rows[i].left_out)
            continue;
        cln_format(text, sizeof text, rows[i].what, rows[i].first, rows[i].second);
        json_array_append_new(*out, json_string(text));
    }
    return CLN_OK;
}

static cln_status add_left_out(cln_trainer *t)
{
    cln_status st = CLN_OK;
    json_t *list = NULL;

    CLN_TRY(cln_record_left_out(t, &list));
    json_object_set_new(t->run, "left_out", list);
done:
    return st;
}

static json_t *device_json(const cln_device_info *info)
{
    return json_pack("{s:s, s:s, s:s, s:s, s:s, s:s, s:o, s:o, s:i}", "name", info->name, "vendor",
                     info->vendor, "platform", info->platform, "driver", info->driver, "version",
                     info->version, "type", info->type, "global_mem",
                     cln_json_whole(info->global_mem), "max_alloc", cln_json_whole(info->max_alloc),
                     "compute_units", info->compute_units);
}

static const char *text_of(const json_t *object, const char *key, const char *otherwise)
{
    const char *text = json_string_value(json_object_get(object, key));

    return text ? text : otherwise;
}

/* The run's figures so far: the newest in metrics.jsonl up to the checkpoint, which a killed
 * process leaves, too; of a run without these rows, those of run.json. */
static cln_status take_result(cln_trainer *t, const json_t *result)
{
    cln_status st = CLN_OK;
    json_t *trained = NULL, *tested = NULL;
    const json_t *step = NULL;

    CLN_TRY(cln_metrics_last(t->desc->run, t->model.step, "psnr_train", &trained));
    CLN_TRY(cln_metrics_last(t->desc->run, t->model.step, "psnr_test", &tested));
    t->psnr_train = cln_json_number(trained ? trained : result, "psnr_train");
    t->psnr_test = cln_json_number(tested ? tested : result, "psnr_test");
    step = json_object_get(tested ? tested : result, tested ? "step" : "eval_step");
    t->eval_step = json_is_integer(step) ? json_integer_value(step) : -1; /* of older programs */
    if (cln_json_number(result, "eval_step") == (double)t->eval_step) {
        t->psnr_fitted = cln_json_number(result, "psnr_fitted");
        t->fitted_gain = cln_json_number(result, "fitted_gain");
    }
done:
    json_decref(trained);
    json_decref(tested);
    return st;
}

/* Takes over the processors' seconds of the starts before: of run.json if it is of the checkpoint's
 * step, else of the newest row up to there. A run of an older program tells none. */
static cln_status take_processor_seconds(cln_trainer *t, const json_t *result)
{
    cln_status st = CLN_OK;
    json_t *row = NULL;

    if (!(cln_json_number(result, "step") == (double)t->model.step)) {
        CLN_TRY(cln_metrics_last(t->desc->run, t->model.step, NULL, &row));
        result = row;
    }
    t->cpu_seconds = cln_json_number(result, "cpu_seconds");
done:
    json_decref(row);
    return st;
}

/* Likewise the most bytes of device and host: of run.json, whose result a start removes, but not
 * its earlier_peaks, and of the newest row, which a killed process leaves. */
static cln_status take_peaks(cln_trainer *t, const json_t *before)
{
    cln_status st = CLN_OK;
    const json_t *earlier = json_object_get(before, "earlier_peaks");
    const json_t *result = json_object_get(before, "result");
    json_t *row = NULL;

    CLN_TRY(cln_metrics_last(t->desc->run, t->model.step, NULL, &row));
    t->device_peak = fmax(fmax(cln_json_number(earlier, "device"), cln_json_number(row, "dev_mem")),
                          cln_json_number(result, "device_peak"));
    t->host_peak = fmax(fmax(cln_json_number(earlier, "host"), cln_json_number(row, "host_mem")),
                        cln_json_number(result, "host_peak"));
done:
    json_decref(row);
    return st;
}

static cln_status add_peaks(const cln_trainer *t)
{
    json_t *peaks = json_pack("{s:o, s:o}", "device", cln_json_whole(t->device_peak), "host",
                              cln_json_whole(t->host_peak));

    if (!peaks || json_object_set_new(t->run, "earlier_peaks", peaks) != 0)
        return cln_fail(CLN_MEMORY, "run.json: cannot make JSON");
    return CLN_OK;
}

double cln_record_device_peak(const cln_trainer *t)
{
    return fmax(t->device_peak, t->device ? (double)t->device->peak : 0);
}

double cln_record_host_peak(const cln_trainer *t)
{
    return fmax(t->host_peak, cln_peak_rss());
}

enum { PROGRAM_BYTES = 128 };

static void write_program(const char *version, const char *commit, char out[PROGRAM_BYTES])
{
    snprintf(out, PROGRAM_BYTES, "%.60s%s%.50s", version, *commit ? " of commit " : "", commit);
}

/* A resumed run keeps its preset and its first start's time from run.json. */
cln_status cln_record_start(cln_trainer *t)
{
    cln_status st = CLN_OK;
    json_t *history = NULL;
    json_t *config = NULL, *scene = NULL, *plan = NULL, *host_plan = NULL, *before = NULL;
    const char *preset = t->desc->resume ? NULL : t->desc->settings->preset;
    const char *was = NULL;
    char now[32], tune[CLN_TUNE_TEXT], digest[CLN_DIGEST_TEXT];
    char newest[PROGRAM_BYTES], us[PROGRAM_BYTES];
    cln_orbit_frame frame;

    if (t->desc->resume)
        CLN_TRY(cln_run_read(t->desc->run, &before));
    if (t->desc->resume)
        CLN_TRY(take_result(t, json_object_get(before, "result")));
    write_program(text_of(before, "version", ""), text_of(before, "commit", ""), newest);
    write_program(CLN_VERSION, cln_commit(), us);
    was = text_of(json_object_get(before, "dataset"), "digest", NULL);
    cln_digest_text(t->scene->digest, digest);
    if (!preset)
        preset = text_of(before, "preset", "");
    CLN_TRY(cln_config_to_json(&t->model.config, &config));
    CLN_TRY(cln_scene_describe(t->scene, &scene));
    CLN_TRY(cln_plan_json(&t->plan, &plan));
    CLN_TRY(cln_plan_json(&t->host_plan, &host_plan));
    json_object_del(scene, "cameras"); /* lists of all views are long */
    json_object_del(scene, "intrinsics");
    CLN_TRY(cln_recorded_place(t->desc->run, t->scene->path, scene));
    CLN_TRY(cln_orbit_frame_of(t->scene, (const double[3]){0}, &frame));
    cln_utc_now(now);
    CLN_TRY(cln_history_add(json_object_get(before, "history"), t->model.step,
                            t->desc->command ? t->desc->command : "", now,
                            t->desc->resume ? &t->trained : NULL, &t->model.config,
                            (const char *const[2]){was, digest},
                            (const char *const[2]){before ? newest : NULL, us}, &history));
    if (cln_history_other_program(history))
        cln_info("so far it was trained by another program, %s: from here on numbers may be a "
                 "little different from those of either alone",
                 cln_history_other_program(history));
    if (t->desc->resume)
        CLN_TRY(take_processor_seconds(t, json_object_get(before, "result")));
    if (t->desc->resume)
        CLN_TRY(take_peaks(t, before));
    cln_tune_text(&t->pipeline.tune, tune);
    t->run =
        json_pack("{s:s, s:s, s:s, s:s, s:s, s:o, s:o, s:o, s:s, s:s, s:n, s:o, s:o, s:s, "
                  "s:s, s:n, s:o, s:o}",
                  "schema", "cl-nascent.run/1", "version", CLN_VERSION, "commit", cln_commit(),
                  "command", t->desc->command ? t->desc->command : "", "preset", preset, "config",
                  config, "device", device_json(&t->device->info), "dataset", scene, "state",
                  "running", "started", text_of(before, "started", now), "ended", "plan", plan,
                  "host_plan", host_plan, "tune", tune, "tune_from", t->pipeline.tune_from,
                  "result", "orbit", cln_orbit_frame_json(&frame), "history", history);
    config = scene = plan = host_plan = history = NULL;
    if (!t->run) {
        st = cln_fail(CLN_MEMORY, "run.json: cannot make JSON");
        goto done;
    }
    CLN_TRY(add_left_out(t));
    if (t->desc->resume)
        CLN_TRY(add_peaks(t));
    if (t->box_found || json_is_true(json_object_get(before, "bbox_found")))
        json_object_set_new(t->run, "bbox_found", json_true());
    if (t->space_found || json_is_true(json_object_get(before, "space_found")))
        json_object_set_new(t->run, "space_found", json_true());
    if (json_object_get(before, "held_back"))
        json_object_set(t->run, "held_back", json_object_get(before, "held_back"));
    if (json_object_get(before, "warnings")) /* of the starts before */
        json_object_set(t->run, "warnings", json_object_get(before, "warnings"));
    cln_json_add_warned(t->run, &t->warned);
    CLN_TRY(cln_run_write(t->desc->run, t->run));
    CLN_TRY(cln_cameras_write(t->desc->run, t->scene, (const double(*)[12])t->refine.given));
done:
    json_decref(config);
    json_decref(scene);
    json_decref(plan);
    json_decref(host_plan);
    json_decref(before);
    json_decref(history);
    return st;
}

uint64_t cln_record_digest(const cln_trainer *t)
{
    return t->parts_digest ? t->parts_digest : cln_model_digest(&t->model);
}

cln_status cln_record_held(cln_trainer *t)
{
    json_t *held = NULL;

    if (!t->run || t->undone || json_object_get(t->run, "held_back"))
        return CLN_OK;
    held = json_pack("{s:I, s:i}", "step", (json_int_t)t->model.step, "leaves",
                     t->model.tree.leaf_count);
    if (!held || json_object_set_new(t->run, "held_back", held) != 0)
        return cln_fail(CLN_MEMORY, "run.json: cannot make JSON");
    return cln_run_write(t->desc->run, t->run);
}

/* How the run stands now, into its document. */
static void put_result(const cln_trainer *t, const char *state, json_t *run)
{
    char now[32], digest[CLN_DIGEST_TEXT];

    cln_utc_now(now);
    cln_digest_text(cln_record_digest(t), digest);
    json_object_set_new(run, "state", json_string(state));
    json_object_set_new(run, "ended", json_string(now));
    json_object_set_new(
        run, "result",
        json_pack(
            "{s:I, s:f, s:f, s:o, s:f, s:o, s:o, s:o, s:o, s:o, s:o, s:o, s:i, s:i, s:o, s:o, s:o, "
            "s:s}",
            "step", (json_int_t)t->model.step, "epochs",
            cln_config_step_epochs(&t->model.config, (double)t->batch.first[t->batch.train_views],
                                   t->model.step),
            "seconds", t->model.train_seconds, "cpu_seconds", cln_json_real(t->cpu_seconds),
            "wall_seconds", cln_now() - t->began, "start_seconds", cln_json_real(t->start_seconds),
            "eval_seconds", cln_json_real(t->eval_seconds), "psnr_train",
            cln_json_real(t->psnr_train), "psnr_test", cln_json_real(t->psnr_test), "psnr_fitted",
            cln_json_real(t->psnr_fitted), "fitted_gain", cln_json_real(t->fitted_gain),
            "eval_step",
            isfinite(t->psnr_test) && t->eval_step >= 0 ? json_integer((json_int_t)t->eval_step)
                                                        : json_null(),
            "eval_views", isfinite(t->psnr_test) ? t->eval_count : 0, "leaves",
            t->model.tree.leaf_count, "params",
            cln_json_whole(cln_network_learned(&t->model.net, t->model.tree.leaf_count)),
            "device_peak", cln_json_whole(cln_record_device_peak(t)), "host_peak",
            cln_json_whole(cln_record_host_peak(t)), "model_digest", digest));
    if (t->model.exposed)
        json_object_set_new(json_object_get(run, "result"), "exposed", json_true());
    cln_json_add_warned(run, &t->warned);
}

/* The newest checkpoint's files under the names that they have in another run. */
static cln_status keep_checkpoint(const char *from, int64_t step, const char *run)
{
    static const char *const parts[] = {".safetensors", ".json"};
    cln_status st = CLN_OK;
    char *here = NULL, *there = NULL, *name = NULL;

    CLN_TRY(cln_path_join(&there, run, "checkpoint"));
    CLN_TRY(cln_make_dirs(there));
    for (int i = 0; i < 2; i++) {
        free(name);
        free(here);
        free(there);
        name = here = there = NULL;
        CLN_TRY(cln_asprintf(&name, "checkpoint/%08lld%s", (long long)step, parts[i]));
        CLN_TRY(cln_path_join(&here, from, name));
        CLN_TRY(cln_path_join(&there, run, name));
        (void)unlink(there); /* of an attempt that ended before run.json */
        CLN_TRY(cln_link_or_copy(here, there));
    }
    free(name);
    free(there);
    name = there = NULL;
    CLN_TRY(cln_asprintf(&name, "%08lld\n", (long long)step));
    CLN_TRY(cln_path_join(&there, run, "checkpoint/latest"));
    CLN_TRY(cln_write_file(there, name, strlen(name)));
done:
    free(name);
    free(here);
    free(there);
    return st;
}

cln_status cln_record_keep(const cln_trainer *t, const char *run)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    char *rows = NULL, *copy = NULL;

    document = json_deep_copy(t->run);
    if (!document)
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: cannot make JSON", run));
    CLN_TRY(keep_checkpoint(t->desc->run, t->model.step, run));
    put_result(t, "interrupted", document);
    CLN_TRY(cln_recorded_place(run, t->scene->path, json_object_get(document, "dataset")));
    CLN_TRY(cln_path_join(&rows, t->desc->run, "metrics.jsonl"));
    CLN_TRY(cln_path_join(&copy, run, "metrics.jsonl"));
    (void)unlink(copy);
    if (cln_is_file(rows))
        CLN_TRY(cln_copy_file(rows, copy)); /* both go on */
    CLN_TRY(cln_cameras_write(run, t->scene, (const double(*)[12])t->refine.given));
    CLN_TRY(cln_run_write(run, document)); /* last: then it is whole */
done:
    json_decref(document);
    free(rows);
    free(copy);
    return st;
}

cln_status cln_record_end(cln_trainer *t, const char *state)
{
    cln_status st = CLN_OK;
    json_t *plan = NULL;

    if (!t->run)
        return CLN_OK;
    put_result(t, state, t->run);
    CLN_TRY(cln_plan_json(&t->plan, &plan));
    json_object_set_new(t->run, "plan", plan);
    CLN_TRY(cln_plan_json(&t->host_plan, &plan));
    json_object_set_new(t->run, "host_plan", plan);
    CLN_TRY(add_left_out(t));
    CLN_TRY(cln_run_write(t->desc->run, t->run));
    CLN_TRY(cln_report_write(t->desc->run, t->model.step));
done:
    return st;
}

/* Adds how evenly the ranks shared the samples since the previous row. */
static void add_balance(cln_trainer *t, json_t *row)
{
    const cln_pipeline *p = &t->pipeline;
    const double all = p->samples_all - t->window.samples_all;

    if (all > 0) {
        json_object_set_new(row, "own_share",
                            json_real((p->samples_own - t->window.samples_own) / all));
        json_object_set_new(
            row, "balance",
            json_real((p->samples_busiest - t->window.samples_busiest) * p->ranks / all));
    }
    json_object_set_new(row, "own_leaves", json_integer(p->own));
    if (p->stretches_all > t->window.stretches_all) {
        const double stretches = p->stretches_all - t->window.stretches_all;

        json_object_set_new(row, "stretches", json_real(stretches / t->window.steps));
        json_object_set_new(row, "own_stretches",
                            json_real((p->stretches_own - t->window.stretches_own) / stretches));
    }
    if (p->intervals_all > t->window.intervals_all)
        json_object_set_new(
            row, "intervals",
            json_real((p->intervals_all - t->window.intervals_all) / t->window.steps));
    t->window.intervals_all = p->intervals_all;
    t->window.stretches_own = p->stretches_own;
    t->window.stretches_all = p->stretches_all;
    t->window.samples_own = p->samples_own;
    t->window.samples_busiest = p->samples_busiest;
    t->window.samples_all = p->samples_all;
}

/* Each stage's seconds of the idlest and of the busiest rank since the previous row, and the same
 * for messages: all ranks call it. The least and the most of a rank's bytes: photos: of host memory
 * that its photos take; device: of device memory, so far. NULL without memory. */
static json_t *find_ends(cln_trainer *t, double photos[2], double device[2])
{
    double now[CLN_STAGES + 1], ends[2][CLN_STAGES + 3];
    json_t *stages = json_object();

    memcpy(now, t->device->stage_seconds, sizeof t->device->stage_seconds);
    now[CLN_STAGES] = cln_ranks_sent().seconds;
    for (int i = 0; i <= CLN_STAGES; i++) {
        ends[0][i] = t->window.ranked_seconds[i] - now[i];
        ends[1][i] = now[i] - t->window.ranked_seconds[i];
    }
    memcpy(t->window.ranked_seconds, now, sizeof now);
    ends[1][CLN_STAGES + 1] = cln_scene_pixel_bytes(t->scene);
    ends[1][CLN_STAGES + 2] = (double)t->device->peak;
    for (int i = 1; i < 3; i++)
        ends[0][CLN_STAGES + i] = 0 - ends[1][CLN_STAGES + i];
    cln_ranks_largest(ends[0], 2 * (CLN_STAGES + 3));
    photos[0] = 0 - ends[0][CLN_STAGES + 1];
    photos[1] = ends[1][CLN_STAGES + 1];
    device[0] = 0 - ends[0][CLN_STAGES + 2];
    device[1] = ends[1][CLN_STAGES + 2];
    for (int i = 0; i <= CLN_STAGES; i++)
        if (ends[1][i] > 0)
            json_object_set_new(stages, i < CLN_STAGES ? cln_stage_names[i] : "messages",
                                json_pack("[f, f]", 0 - ends[0][i], ends[1][i]));
    return stages;
}

cln_status cln_record_row(cln_trainer *t, double lr, bool evaluated, bool unfinished)
{
    cln_status st = CLN_OK;
    const double spent = t->model.train_seconds - t->model.row.began;
    const double waits = (double)(t->device->waits - t->window.waits);
    double leaf_samples = 0, padding = 0, photos[2] = {0}, device[2] = {0};
    json_t *stages = NULL, *row = NULL;
    json_t *ends = cln_ranks_count() > 1 ? find_ends(t, photos, device) : NULL;

    if (!t->writes)
        goto done;
    if (!evaluated && !t->signal) /* else the newest grouping may be a picture's */
        CLN_TRY(cln_stage_fill(&t->pipeline, &leaf_samples, &padding));
    stages = json_object();
    for (int i = 0; i < CLN_STAGES; i++) {
        const double seconds = t->device->stage_seconds[i] - t->window.stage_seconds[i];

        if (seconds > 0)
            json_object_set_new(stages, cln_stage_names[i], json_real(seconds));
    }
    row = json_pack(
        "{s:I, s:f, s:o, s:f, s:I, s:o, s:o, s:f, s:o, s:o, s:i, s:o, s:o, s:o, s:f, s:o}", "step",
        (json_int_t)t->model.step, "seconds", t->model.train_seconds, "cpu_seconds",
        cln_json_real(t->cpu_seconds), "wall_seconds", cln_now() - t->began, "from_step",
        (json_int_t)t->from_step, "loss", cln_json_real(t->model.row.loss / t->model.row.steps),
        "psnr_train", cln_json_real(t->psnr_train), "lr", lr, "rays_per_s",
        cln_json_real((double)t->model.row.rays / spent), "samples_per_ray",
        cln_json_real((double)t->model.row.samples / (double)t->model.row.rays), "leaves",
        t->pipeline.leaves, "params",
        cln_json_whole(cln_network_learned(&t->pipeline.net, t->pipeline.leaves)), "host_mem",
        cln_json_whole(cln_peak_rss()), "dev_mem", cln_json_whole((double)t->device->allocated),
        "host_waits", waits, "stages", stages);
    if (!row) {
        st = cln_fail(CLN_MEMORY, "metrics: cannot make JSON");
        goto done;
    }
    if (cln_ranks_count() > 1) {
        json_object_set_new(row, "ranks", json_integer(cln_ranks_count()));
        json_object_set_new(row, "sent_bytes", cln_json_whole(cln_ranks_sent().bytes));
        json_object_set_new(row, "message_seconds", json_real(cln_ranks_sent().seconds));
        if (cln_leaf_kind_of(t->model.config.encoding)->joined)
            json_object_set_new(row, "vertex_bytes", cln_json_whole(t->pipeline.common.bytes));
        json_object_set(row, "ranks_stages", ends);
        json_object_set_new(
            row, "photo_bytes",
            json_pack("[o, o]", cln_json_whole(photos[0]), cln_json_whole(photos[1])));
        json_object_set_new(
            row, "device_peaks",
            json_pack("[o, o]", cln_json_whole(device[0]), cln_json_whole(device[1])));
        add_balance(t, row);
    }
    if (evaluated) {
        json_object_set_new(row, "psnr_test", cln_json_real(t->psnr_test));
    } else if (!t->signal) {
        json_object_set_new(row, "leaf_samples", json_real(leaf_samples));
        json_object_set_new(row, "padding", json_real(padding));
    }
    if (unfinished)
        json_object_set_new(row, "unfinished", json_true());
    CLN_TRY(cln_metrics_add(t->metrics, row));
    memcpy(t->window.stage_seconds, t->device->stage_seconds, sizeof t->window.stage_seconds);
    t->window.waits = t->device->waits;
    t->window.steps = 0;
done:
    json_decref(ends);
    json_decref(row);
    return st;
}

/* Adds a row and frees it. NULL: there was no memory to make it. */
static cln_status add_row(const cln_trainer *t, json_t *row)
{
    cln_status st = CLN_OK;

    if (!row)
        return cln_fail(CLN_MEMORY, "metrics: cannot make JSON");
    if (t->writes)
        CLN_TRY(cln_metrics_add(t->metrics, row));
done:
    json_decref(row);
    return st;
}

cln_status cln_record_decision(cln_trainer *t, const cln_decision *d)
{
    json_t *row = json_pack(
        "{s:s, s:I, s:f, s:f, s:i, s:i, s:i, s:i, s:i, s:i, s:b, s:o, s:o, s:o, s:o, s:o, s:i, "
        "s:f}",
        "event", "structure", "step", (json_int_t)t->model.step, "seconds", t->model.train_seconds,
        "wall_seconds", cln_now() - t->began, "leaves_before", d->leaves_before, "leaves",
        d->leaves, "split", d->splits, "merged", d->merges, "kept", d->keeps, "budget", d->budget,
        "infeasible", d->infeasible, "objective", cln_json_real(d->objective), "objective_before",
        cln_json_real(d->objective_before), "psnr_before", cln_json_real(d->psnr_before),
        "psnr_after", cln_json_real(d->psnr_after), "psnr_pretrained",
        cln_json_real(d->psnr_pretrained), "distil_steps", d->distil_steps, "work_seconds",
        d->work_seconds);

    return add_row(t, row);
}

cln_status cln_record_move(cln_trainer *t, const cln_share_move *move)
{
    json_t *row = json_pack("{s:s, s:I, s:f, s:f, s:i, s:f, s:f}", "event", "balance", "step",
                            (json_int_t)t->model.step, "seconds", t->model.train_seconds,
                            "wall_seconds", cln_now() - t->began, "moved", move->leaves, "before",
                            move->before, "after", move->after);

    cln_debug("step %lld: %d leaves moved to other ranks: the busiest had %.2f times the mean, "
              "has %.2f",
              (long long)t->model.step, move->leaves, move->before, move->after);
    return add_row(t, row);
}

cln_status cln_record_place(const char *in, int64_t step, const char *split, int count, int total,
                            char **place)
{
    if (count < total)
        return cln_asprintf(place, "%s/%08lld-%s-%d", in, (long long)step, split, count);
    return cln_asprintf(place, "%s/%08lld-%s", in, (long long)step, split);
}

cln_status cln_record_eval(const char *place, const cln_eval_result *result)
{
    cln_status st = CLN_OK;
    char *name = NULL, *dropped = NULL;
    json_t *document = NULL;

    CLN_TRY(cln_quality_json(result, &document));
    CLN_TRY(cln_asprintf(&name, "%s.json", place));
    CLN_TRY(cln_run_write_json("", name, document));
    CLN_TRY(cln_asprintf(&dropped, "%s" CLN_DROPPED, name));
    (void)unlink(dropped); /* of a model that the run went back from */
done:
    json_decref(document);
    free(dropped);
    free(name);
    return st;
}
