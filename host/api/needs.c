/* See needs.h. The time is measured on synthetic steps (check/synthetic.h) with the settings'
 * networks, on a tree of at most 512 leaves: the time per sample times the samples of the training.
 * Real steps on the demo took three times as long: its tree has 4,096 leaves and changes, and the
 * host works, too. So the figure tells minutes from hours, no more. */
#include "api/needs.h"

#include <math.h>
#include <string.h>
#include "base/config.h"
#include "base/number.h"
#include "check/synthetic.h"
#include "pipeline/plan.h"
#include "train/coverage.h"

enum { LEAST_STEPS = 3, MOST_STEPS = 64 };
static const double LONGER = 4; /* a real step takes at most so many synthetic ones; see how_good */

static double training_pixels(const cln_scene *scene)
{
    double pixels = 0;

    for (int i = 0; i < cln_scene_split_count(scene, CLN_SPLIT_TRAIN); i++) {
        const cln_camera *camera =
            &scene->views[cln_scene_split_view(scene, CLN_SPLIT_TRAIN, i)].camera;

        pixels += (double)camera->width * camera->height;
    }
    return pixels;
}

/* Times *count steps, scaled to batch-samples samples. seconds: their median, least and most. */
static cln_status time_steps(cln_device *device, const cln_config *config, double budget,
                             double seconds[3], int *count)
{
    cln_status st = CLN_OK;
    cln_synthetic work = {0};
    cln_pipeline p = {0};
    double taken[MOST_STEPS], began = 0;

    *count = 0;
    CLN_TRY(cln_synthetic_create(device, config, &work));
    CLN_TRY(cln_pipeline_create(device, &work.model.config,
                                &(cln_pipeline_facts){.space = &cln_space_unit}, CLN_PROGRAMS_ALL,
                                &p));
    CLN_TRY(cln_synthetic_upload(&work, &p));
    CLN_TRY(cln_synthetic_step(&work, &p)); /* compiles */
    CLN_TRY(cln_synthetic_settle(&work, &p, budget / LEAST_STEPS));
    began = cln_now();
    while (*count < MOST_STEPS && (*count < LEAST_STEPS || cln_now() < began + budget)) {
        const double start = cln_now();

        CLN_TRY(cln_synthetic_step(&work, &p));
        taken[*count] = (cln_now() - start) * config->batch_samples / fmax(1, work.samples);
        ++*count;
    }
    cln_reals_sort(taken, *count);
    seconds[0] = taken[*count / 2];
    seconds[1] = taken[0];
    seconds[2] = taken[*count - 1];
done:
    cln_pipeline_free(&p);
    cln_synthetic_free(&work);
    return st;
}

static void add_time(json_t *about, cln_device *device, const cln_config *c, double steps,
                     double budget)
{
    double seconds[3];
    int count = 0;

    if (time_steps(device, c, budget, seconds, &count) != CLN_OK) {
        json_object_set_new(about, "no_time", json_string(cln_error_text()));
        cln_clear_error();
        return;
    }
    json_object_set_new(
        about, "time",
        json_pack(
            "{s:f, s:f, s:f, s:i, s:o, s:o, s:s}", "step_seconds", seconds[0], "step_seconds_least",
            seconds[1], "step_seconds_most", seconds[2], "steps_timed", count, "seconds_least",
            steps > 0 ? json_real(steps * seconds[0]) : json_null(), "seconds_most",
            steps > 0 ? json_real(LONGER * steps * seconds[0]) : json_null(), "how_good",
            "rough: measured on a synthetic object, on this device as busy as it is now; real "
            "steps take up to 4 times as long, as their tree is larger and changes and the host "
            "works, too; evaluations come on top"));
    if (c->time_limit > 0)
        json_object_set_new(json_object_get(about, "time"), "steps_in_time_limit",
                            json_real(floor(c->time_limit / seconds[0])));
}

json_t *cln_needs_describe(const cln_scene *scene, const cln_settings *settings,
                           const cln_device_desc *wanted, double probe)
{
    const cln_config *c = &settings->config;
    const bool timed = c->steps > 0 || c->time_limit > 0;
    double steps = c->steps;
    cln_device *device = NULL;
    cln_pipeline pipeline;
    cln_plan plan, host;
    json_t *about = json_pack("{s:s}", "preset", settings->preset);

    if (!timed) {
        steps = (double)cln_config_epoch_steps(c, training_pixels(scene));
        json_object_set_new(about, "epochs", json_integer(c->epochs));
    }
    if (steps > 0)
        json_object_set_new(about, "steps", json_integer((json_int_t)steps));
    if (c->time_limit > 0)
        json_object_set_new(about, "time_limit", json_real(c->time_limit));
    if (cln_device_open(wanted, &device) == CLN_OK &&
        cln_pipeline_outline(device, c,
                             &(cln_pipeline_facts){.lenses = scene->lenses,
                                                   .alpha = scene->has_alpha,
                                                   .space = &scene->space},
                             &pipeline) == CLN_OK) {
        const cln_plan_desc desc = {
            &pipeline, scene, cln_config_most_leaves(c), true, cln_coverage_bytes(scene), 0};

        cln_plan_device(&desc, &plan);
        cln_plan_host(&desc, &plan, &host);
        json_object_set_new(about, "device", json_string(device->info.name));
        json_object_set_new(about, "most_leaves", json_integer(desc.leaves));
        json_object_set_new(about, "device_memory", json_real(plan.total));
        json_object_set_new(about, "device_memory_limit", json_real(plan.limit));
        json_object_set_new(about, "host_memory", json_real(host.total));
        json_object_set_new(about, "host_memory_limit", json_real(host.limit));
        if (probe > 0)
            add_time(about, device, c, steps, probe);
    } else {
        json_object_set_new(about, "device", json_null());
        json_object_set_new(about, "no_device", json_string(cln_error_text()));
        cln_clear_error();
    }
    cln_device_close(device);
    return about;
}
