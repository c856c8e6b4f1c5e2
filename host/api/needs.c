/* See needs.h. Times are measured on synthetic steps and pictures (check/synthetic.h) with the
 * settings' networks: on the first tree, and on one of as many leaves as the tree may grow to, with
 * the samples that steps have there (train/step.c, adapt_rays). A training's time follows from the
 * fractions of the budget at which its tree grows. Not measured: the host's work, growth itself,
 * refreshes of densities, stage 1's full grid on large trees (check/synthetic.h has fewer cells),
 * and how much of the scene is empty. */
#include "api/needs.h"

#include <math.h>
#include <string.h>
#include "base/callbacks.h"
#include "base/clock.h"
#include "base/config.h"
#include "base/memory.h"
#include "base/number.h"
#include "check/synthetic.h"
#include "io/disk.h"
#include "io/json.h"
#include "pipeline/room.h"
#include "render/ray_batch.h"
#include "train/batch.h"
#include "train/grow.h"

enum { LEAST_STEPS = 3, MOST_STEPS = 64, SMALL = 64 }; /* SMALL: leaves */
static const double MOST_BYTES = 256e6; /* of weights; a larger tree is measured on fewer leaves */

/* Real trainings took 0.6 to 2 times as long (docs/cl-nascent.1 has the cases); some more. */
static const double LEAST = 0.5, MOST = 2.2;
/* A share of the processors that other programs have, from which it is told. */
static const double BUSY = 0.25;
static const char *const how_good =
    "rough: measured on a synthetic object, on this device as busy as it is now; real trainings "
    "took 0.6 to 2 times as long, the least where much of the scene is empty; evaluations come "
    "on top";

/* What steps on a tree take, seconds: median, least and most; and a ray of a picture that shows
 * something, 0 if that was not measured. */
typedef struct timing {
    double median, least, most;
    int steps;
    double ray;
} timing;

/* Samples of a step on such a tree, by the rule of the training. */
static double step_samples(const cln_config *c, double leaves, double per_ray)
{
    const double wanted = fmax(c->rays, c->leaf_samples * leaves / per_ray);

    return fmin(fmin(wanted, cln_config_most_rays(c)) * per_ray, c->batch_samples);
}

static int count_hits(const cln_ray_result *results, int rays)
{
    int hits = 0;

    for (int i = 0; i < rays; i++)
        hits += results[i].opacity > 0;
    return hits > 0 ? hits : 1;
}

/* Times steps for about `budget` seconds. leaves: of the tree that it stands for. */
static cln_status time_steps(cln_synthetic *work, cln_pipeline *p, const cln_config *config,
                             double leaves, double budget, const cln_callbacks *callbacks,
                             timing *out)
{
    cln_status st = CLN_OK;
    double taken[MOST_STEPS], began = 0, per_ray = 0, samples = 0;

    CLN_TRY(cln_synthetic_step(work, p)); /* compiles, and tells how many samples a ray has */
    per_ray = fmax(1, (double)work->samples / count_hits(work->results, work->used));
    samples = step_samples(config, leaves, per_ray);
    if (samples < work->samples)
        cln_synthetic_draw(work, (int)fmax(1, work->used * samples / work->samples));
    CLN_TRY(cln_synthetic_settle(work, p, budget / LEAST_STEPS));
    began = cln_now();
    while (out->steps < MOST_STEPS && (out->steps < LEAST_STEPS || cln_now() < began + budget)) {
        const double start = cln_now();

        CLN_TRY(cln_tell_work(callbacks, NULL, 0, 0));
        CLN_TRY(cln_synthetic_step(work, p));
        taken[out->steps++] = (cln_now() - start) * samples / fmax(1, work->samples);
    }
    cln_reals_sort(taken, out->steps);
    out->median = taken[out->steps / 2];
    out->least = taken[0];
    out->most = taken[out->steps - 1];
done:
    return st;
}

/* Times the second of two batches of rays of a picture; the first warms up. */
static cln_status time_picture(cln_synthetic *work, cln_pipeline *p, timing *out)
{
    cln_status st = CLN_OK;
    cln_ray_batch batch = {.pixels = work->pixels,
                           .n = work->rays,
                           .backgrounds = (const float(*)[4])work->targets,
                           .sampling = cln_render_sampling(p)};
    double start = 0;
    int rendered = 0;

    batch.sampling.pictures = false; /* the training's cache serves as well */
    for (int i = 0; i < 2; i++) {
        start = cln_now();
        CLN_TRY(cln_render_rays(p, &batch, work->results, &rendered));
    }
    out->ray = (cln_now() - start) / count_hits(work->results, rendered);
done:
    return st;
}

/* Times a tree, the first one (leaves 0) or one of `leaves` leaves, and pictures on it. */
static cln_status time_tree(cln_device *device, const cln_config *config, int leaves, bool pictures,
                            double budget, const cln_callbacks *callbacks, timing *out)
{
    cln_status st = CLN_OK;
    cln_config ours = *config;
    cln_synthetic work = {0};
    cln_pipeline p = {0};
    cln_network net;
    int fewer = leaves;

    *out = (timing){0};
    ours.rays = cln_config_most_rays(config);
    if (leaves > 0) {
        CLN_TRY(cln_network_layout(&ours, &net));
        fewer = (int)fmax(SMALL, fmin(leaves, MOST_BYTES / (4.0 * net.params)));
        CLN_TRY(cln_synthetic_create_grown(device, &ours, fewer, &work));
    } else {
        ours.level_at[0] = 0; /* the tree of --start-level */
        CLN_TRY(cln_synthetic_create(device, &ours, &work));
    }
    CLN_TRY(cln_pipeline_create(device, &work.model.config,
                                &(cln_pipeline_facts){.space = &cln_space_unit}, CLN_PROGRAMS_ALL,
                                &p));
    CLN_TRY(cln_synthetic_upload(&work, &p));
    CLN_TRY(time_steps(&work, &p, config, leaves > 0 ? leaves : work.model.tree.leaf_count, budget,
                       callbacks, out));
    if (pictures)
        CLN_TRY(time_picture(&work, &p, out));
done:
    cln_pipeline_free(&p);
    cln_synthetic_free(&work);
    return st;
}

/* Seconds of a step on a tree of voxels, by those on the first one and on the largest, the mean
 * over a budget of steps (0: of seconds). grows: single leaves split. */
static double mean_of_voxels(const cln_config *c, const timing *first, const timing *last,
                             bool shell, double steps, bool grows)
{
    enum { MOMENTS = 200 };
    const double begins = cln_config_first_leaves(c, shell),
                 most = cln_config_most_leaves(c, shell);
    double sum = 0;

    for (int i = 0; i < MOMENTS; i++) {
        const double leaves = cln_grow_foresee(c, begins, most, grows, (i + 0.5) / MOMENTS, steps);
        const double share = most > begins ? fmax(0, (leaves - begins) / (most - begins)) : 1;
        const double step = first->median + share * (last->median - first->median);

        sum += steps > 0 ? step : 1 / step;
    }
    return steps > 0 ? sum / MOMENTS : MOMENTS / sum;
}

/* Seconds of a step over a budget in steps, or of one in seconds (harmonic). Networks: trees before
 * the last level count as the first one, as they have few leaves, so batches are no larger yet. */
static double mean_of_networks(const cln_config *c, const timing *first, const timing *last,
                               bool harmonic)
{
    double at[CLN_LEVELS], early = 0;

    if (cln_config_levels(c, at) != CLN_OK)
        cln_clear_error();
    else
        for (int level = c->start_level + 1; level < CLN_LEVELS; level++)
            if (at[level] <= 1)
                early = at[level];
    return harmonic ? 1 / (early / first->median + (1 - early) / last->median)
                    : early * first->median + (1 - early) * last->median;
}

/* Pixels of the training photos, the mean. */
static double picture_pixels(const cln_scene *scene)
{
    return cln_scene_training_pixels(scene) / cln_scene_split_count(scene, CLN_SPLIT_TRAIN);
}

static double mean_step(const cln_config *c, const timing *first, const timing *last, bool shell,
                        double steps, bool grows)
{
    return cln_leaf_kind_of(c->encoding)->levels_first
               ? mean_of_voxels(c, first, last, shell, steps, grows)
               : mean_of_networks(c, first, last, steps <= 0);
}

static void add_time(json_t *about, cln_device *device, const cln_scene *scene, const cln_config *c,
                     double steps, double budget, const cln_callbacks *callbacks)
{
    const int most = cln_config_most_leaves(c, scene->space.shell), trees = most > SMALL ? 2 : 1;
    const bool shell = scene->space.shell;
    cln_status st = CLN_OK;
    timing first = {0}, last = {0};
    double step = 0, least = 0, others = 0;
    json_t *time = NULL;
    const cln_load before = cln_load_now();
    cln_load after;

    st = cln_tell_work(callbacks, "timing", 0, trees);
    if (st == CLN_OK)
        st = time_tree(device, c, 0, most <= SMALL, budget / 2, callbacks, &first);
    if (st == CLN_OK)
        st = cln_tell_work(callbacks, "timing", 1, trees);
    if (st == CLN_OK && trees > 1)
        st = time_tree(device, c, most, true, budget / 2, callbacks, &last);
    else if (st == CLN_OK)
        last = first; /* a tree that stays small is the first one */
    if (st == CLN_OK && trees > 1)
        st = cln_tell_work(callbacks, "timing", trees, trees);
    if (st != CLN_OK) {
        json_object_set_new(about, "no_time", json_string(cln_error_text()));
        cln_clear_error();
        return;
    }
    after = cln_load_now();
    others = strcmp(device->info.type, "cpu") == 0 ? cln_load_of_others(&before, &after) : NAN;
    step = mean_step(c, &first, &last, shell, steps, true);
    least = mean_step(c, &first, &last, shell, steps, false);
    time = json_pack("{s:f, s:f, s:f, s:f, s:f, s:i, s:f, s:f, s:s}", "step_seconds", step,
                     "step_seconds_first", first.median, "step_seconds_last", last.median,
                     "step_seconds_least", fmin(first.least, last.least), "step_seconds_most",
                     fmax(first.most, last.most), "steps_timed",
                     first.steps + (trees > 1 ? last.steps : 0), "picture_seconds",
                     last.ray * picture_pixels(scene), "picture_pixels", picture_pixels(scene),
                     "how_good", how_good);
    json_object_set_new(time, "seconds", steps > 0 ? json_real(steps * step) : json_null());
    json_object_set_new(time, "others", cln_json_real(others));
    if (others > BUSY) {
        least *= 1 - others;
        json_object_set_new(time, "others_note",
                            json_sprintf("other programs had %.0f %% of the processors meanwhile: "
                                         "alone it takes less, as the lower end says",
                                         100 * others));
    }
    json_object_set_new(time, "seconds_least",
                        steps > 0 ? json_real(LEAST * steps * least) : json_null());
    json_object_set_new(time, "seconds_most",
                        steps > 0 ? json_real(MOST * steps * step) : json_null());
    if (c->time_limit > 0)
        json_object_set_new(
            time, "steps_in_time_limit",
            json_real(floor(c->time_limit / mean_step(c, &first, &last, shell, 0, true))));
    json_object_set_new(about, "time", time);
}

cln_settings_facts cln_needs_facts(const cln_scene *scene, const cln_config *config)
{
    return (cln_settings_facts){.has_alpha = scene->has_alpha,
                                .forward = scene->space.forward,
                                .shell = scene->space.shell,
                                .ranks = 2,
                                .no_sights = scene->sight_count == 0,
                                .no_box = !scene->has_box,
                                .has_splits = scene->has_splits,
                                .no_masks = scene->mask_count == 0,
                                .no_tests = cln_scene_split_count(scene, CLN_SPLIT_TEST) == 0,
                                .few_views = cln_scene_split_count(scene, CLN_SPLIT_TRAIN) <
                                             config->seen_by};
}

/* Bytes of the pixels that a training keeps. */
static double photo_bytes(const cln_scene *scene)
{
    double bytes = 0;

    for (int i = 0; i < scene->view_count; i++) {
        const cln_view *v = &scene->views[i];

        if (v->split == CLN_SPLIT_TRAIN || v->split == CLN_SPLIT_TEST)
            bytes += (double)v->camera.width * v->camera.height * v->channels;
    }
    return bytes;
}

static void add_text(json_t *about, const char *key, const char *text)
{
    if (*text)
        json_object_set_new(about, key, json_string(text));
}

/* The batch that a training would have by itself. */
static cln_status fit_batch(json_t *about, cln_device *device, const cln_scene *scene,
                            const cln_settings *settings, cln_config *c)
{
    cln_status st = CLN_OK;
    const cln_room_desc desc =
        cln_room_training(device, c, scene, NULL, cln_batch_bytes(scene), photo_bytes(scene));
    char text[CLN_ROOM_TEXT];
    int samples = 0, rays = 0;

    if (cln_settings_has(settings, "batch-samples"))
        return CLN_OK;
    CLN_TRY(cln_room_fit_batch(&desc, !cln_settings_has(settings, "rays"), &samples, &rays));
    cln_room_say_batch(&desc, samples, rays, text);
    add_text(about, "batch_note", text);
    c->batch_samples = samples;
    c->rays = rays;
done:
    return st;
}

/* Adds what the largest tree needs of memory and disk, what there is, and what becomes of it. */
static cln_status add_memory(json_t *about, cln_device *device, const cln_scene *scene,
                             const cln_config *c)
{
    cln_status st = CLN_OK;
    const double available = cln_available_memory(""), disk_free = cln_disk_room(".");
    const cln_room_desc desc =
        cln_room_training(device, c, scene, NULL, cln_batch_bytes(scene), photo_bytes(scene));
    char text[CLN_ROOM_TEXT];
    double disk = 0;
    bool now = false;
    cln_room room;

    CLN_TRY(cln_room_find(&desc, &room));
    json_object_set_new(about, "device", json_string(device->info.name));
    json_object_set_new(about, "most_leaves", json_integer(desc.leaves));
    json_object_set_new(about, "leaves_that_fit", json_integer(room.leaves));
    json_object_set_new(about, "device_memory", cln_json_whole(room.device.total));
    json_object_set_new(about, "device_memory_limit", cln_json_whole(room.device.limit));
    json_object_set_new(about, "host_memory", cln_json_whole(room.host.total));
    json_object_set_new(about, "host_memory_limit", cln_json_whole(room.host.limit));
    json_object_set_new(about, "host_memory_needed", cln_json_whole(room.needed));
    if (isfinite(available))
        json_object_set_new(about, "host_memory_free", cln_json_whole(available));
    json_object_set_new(about, "photo_memory", cln_json_whole(desc.photos));
    json_object_set_new(about, "photos_in", json_string(room.in_memory ? "memory" : "file"));
    if (cln_checkpoint_room(NULL, c, scene->space.shell, &disk) == CLN_OK)
        json_object_set_new(about, "disk", cln_json_whole(disk));
    else
        cln_clear_error();
    if (isfinite(disk_free))
        json_object_set_new(about, "disk_free", cln_json_whole(disk_free));
    cln_room_say_tree(&desc, &room, text);
    add_text(about, "tree_note", text);
    cln_room_say_photos(&desc, &room, text);
    add_text(about, "photos_note", text);
    cln_room_say_free(&desc, &room, available, &now, text);
    add_text(about, "free_note", text);
done:
    return st;
}

json_t *cln_needs_describe(const cln_scene *scene, const cln_settings *settings,
                           const cln_device_desc *wanted, double probe,
                           const cln_callbacks *callbacks)
{
    cln_settings fitted = *settings;
    cln_config *c = &fitted.config;
    const double pixels = cln_scene_training_pixels(scene);
    double steps = 0;
    cln_device *device = NULL;
    json_t *about = json_pack("{s:s}", "preset", settings->preset);
    const bool there = cln_device_open(wanted, &device) == CLN_OK &&
                       fit_batch(about, device, scene, settings, c) == CLN_OK &&
                       add_memory(about, device, scene, c) == CLN_OK;

    if (!there) {
        json_object_set_new(about, "device", json_null());
        json_object_set_new(about, "no_device", json_string(cln_error_text()));
        cln_clear_error();
    }
    steps = c->steps;
    if (c->steps == 0 && c->time_limit == 0) {
        c->epochs = cln_settings_epochs(&fitted, pixels);
        steps = (double)cln_config_epoch_steps(c, pixels);
        json_object_set_new(about, "epochs", json_integer(c->epochs));
    }
    if (steps > 0)
        json_object_set_new(about, "steps", json_integer((json_int_t)steps));
    if (c->time_limit > 0)
        json_object_set_new(about, "time_limit", json_real(c->time_limit));
    if (there && probe > 0)
        add_time(about, device, scene, c, steps, probe, callbacks);
    cln_device_close(device);
    return about;
}
