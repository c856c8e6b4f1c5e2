/* Opens a run for eval and render. See open_run.h. Settings are the checkpoint's, so that pictures
 * have the bits of the training that made it. */
#include "render/open_run.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "pipeline/room.h"
#include "pipeline/share.h"
#include "ranks/ranks.h"
#include "io/run_folder.h"
#include "render/ray_batch.h"
#include "render/recorded.h"
#include "scene/cameras_file.h"
#include "scene/motion.h"
#include "scene/reader.h"

int cln_open_run_antialias(const cln_open_run *opened, int asked)
{
    return asked ? asked : cln_model_antialias(&opened->model);
}

cln_status cln_open_run_split(const cln_scene *scene, const char *name, bool all, cln_split *split)
{
    *split = CLN_SPLITS;
    if (all && strcmp(name, "all") == 0)
        return CLN_OK;
    for (int s = 0; s < CLN_SPLITS; s++) {
        if (strcmp(name, cln_split_names[s]) != 0)
            continue;
        *split = (cln_split)s;
        if (cln_scene_split_count(scene, *split) > 0)
            return CLN_OK;
        return cln_fail(CLN_INPUT,
                        "%s: no view is in the split %s (%s); choose another with --split%s",
                        scene->folder, name, scene->split_rule, all ? ", or all" : "");
    }
    return cln_fail(CLN_USAGE, "--split: '%s' is not one of train|val|test%s", name,
                    all ? "|all" : "");
}

cln_status cln_open_run_model(const char *run, cln_open_run *out)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;

    memset(out, 0, sizeof *out);
    out->run = run;
    out->wanted = CLN_PROGRAMS_PICTURES;
    /* tells a folder that is not a run from a run without checkpoint */
    CLN_TRY(cln_reader_run(run, &document));
    CLN_TRY(cln_checkpoint_read(run, false, &out->model));
done:
    json_decref(document);
    if (st != CLN_OK)
        cln_open_run_close(out);
    return st;
}

/* Brings the scene to what the model was trained with. */
static void adapt_scene(cln_open_run *out)
{
    memcpy(out->scene->background, out->model.background, sizeof out->scene->background);
    out->scene->background_known = true;
    if (out->same_scene)
        out->scene->space = out->model.space; /* as it was found when the run began */
    out->refined = out->same_scene && out->model.motions &&
                   out->model.motion_views == cln_scene_split_count(out->scene, CLN_SPLIT_TRAIN);
    if (out->refined)
        cln_motion_views(out->scene, (const float(*)[CLN_MOTION])out->model.motions);
}

cln_status cln_open_run_open(const char *run, const char *scene, const bool pixels[CLN_SPLITS],
                             const cln_callbacks *callbacks, cln_open_run *out)
{
    cln_status st = CLN_OK;
    cln_callbacks told = callbacks ? *callbacks : (cln_callbacks){0};
    cln_scene_desc desc = {.path = scene,
                           .config = &out->model.config,
                           .elsewhere = CLN_PROGRAM_BYTES,
                           .callbacks = &told};

    if (cln_ranks_count() > 1) /* they could stop at different photos */
        told.interrupted = NULL;
    memset(out, 0, sizeof *out);
    out->run = run;
    memcpy(desc.pixels, pixels, sizeof desc.pixels);
    for (int s = 0; s < CLN_SPLITS && scene; s++)
        desc.measured |= pixels[s];
    CLN_TRY(cln_open_run_model(run, out));
    CLN_TRY(cln_recorded_load(run, &desc, &out->scene, &out->same_scene));
    adapt_scene(out);
    cln_scene_return_splits(out->scene);
done:
    if (st != CLN_OK)
        cln_open_run_close(out);
    return st;
}

/* Of several ranks: whether all find the run's scene, as loading one takes all of them. CLN_INPUT
 * if not. */
static cln_status find_scene(const char *run, bool *found)
{
    cln_status st = CLN_OK;
    double missing = 0;
    char *path = NULL;

    st = cln_recorded_scene(run, &path);
    if (st != CLN_OK && st != CLN_INPUT)
        goto done;
    missing = st == CLN_INPUT;
    cln_ranks_largest(&missing, 1);
    *found = missing == 0;
    if (st == CLN_OK && !*found)
        st = cln_fail(CLN_INPUT,
                      "another rank does not find the scene of %s; --scene tells all "
                      "where it is",
                      run);
done:
    free(path);
    return st;
}

cln_status cln_open_run_cameras(const char *run, const char *scene, const cln_callbacks *callbacks,
                                bool *alike, cln_open_run *out)
{
    cln_status st = CLN_OK;
    const bool alone = cln_ranks_count() == 1, pixels[CLN_SPLITS] = {false};
    bool found = true;
    char *why = NULL;

    memset(out, 0, sizeof *out);
    if (!alone && !scene)
        st = find_scene(run, &found);
    *alike = alone || !found;
    if (st == CLN_OK)
        st = cln_open_run_open(run, scene, pixels, callbacks, out);
    if (st != CLN_INPUT || scene || !*alike || !cln_has_file(run, CLN_CAMERAS_FILE))
        goto done;
    CLN_TRY(cln_strdup(&why, cln_error_text()));
    cln_clear_error();
    *alike = alone; /* the file may be damaged on one of them */
    CLN_TRY(cln_open_run_model(run, out));
    st = cln_recorded_cameras(run, &out->scene);
    if (st == CLN_INPUT)
        cln_note("looking for cameras without the scene: %s", why);
    CLN_TRY(st);
    out->same_scene = true;
    adapt_scene(out);
    if (cln_ranks_me() == 0)
        cln_info("cameras: those that %s keeps, without photos: %s", run, why);
done:
    if (st != CLN_OK)
        cln_open_run_close(out);
    free(why);
    return st;
}

/* Ranks have room for batches of more or fewer samples (their photos take more or less): all take
 * what the one with the least has. */
static void agree_on_batches(cln_plan *plan)
{
    double least[2] = {-(double)plan->max_samples, -(double)plan->batch_samples};

    cln_ranks_largest(least, 2);
    plan->max_samples = (size_t)-least[0];
    plan->batch_samples = (size_t)-least[1];
}

cln_status cln_open_run_plan(cln_open_run *opened)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &opened->pipeline;
    char text[1024];
    const cln_scene none = {0};
    cln_deal deal;
    const cln_plan_desc desc = {.pipeline = p,
                                .scene = opened->scene ? opened->scene : &none,
                                .leaves = opened->model.tree.leaf_count,
                                .depth = cln_octree_depth(&opened->model.tree),
                                .deal = &deal,
                                .view_pixels = opened->view_pixels,
                                .picture_pixels = opened->picture_pixels};
    cln_plan plan, host_plan;

    CLN_TRY(cln_plan_deal(p, &opened->model.tree, &deal));
    cln_plan_device(&desc, &plan);
    cln_plan_host(&desc, &plan, &host_plan);
    CLN_TRY(cln_plan_check(opened->device, &plan));
    CLN_TRY(cln_plan_check_host(&host_plan));
    agree_on_batches(&plan);
    cln_plan_text(&plan, text, sizeof text);
    cln_debug("memory plan: %s", text);
    CLN_TRY(cln_share_agree(
        p, (size_t[]){plan.max_samples, plan.batch_samples, (size_t)plan.max_rays}));
    cln_plan_apply(&plan, p);
done:
    return st;
}

cln_status cln_open_run_start(cln_open_run *opened, const cln_device_desc *device, unsigned lenses)
{
    cln_status st = CLN_OK;
    cln_config config = opened->model.config; /* the pictures' */
    cln_pipeline *p = &opened->pipeline;
    const int leaves = opened->model.tree.leaf_count, depth = cln_octree_depth(&opened->model.tree);
    char text[1024];
    cln_room room;

    if (device->device_mem)
        CLN_TRY(cln_parse_bytes("--device-mem", device->device_mem, &config.device_mem));
    if (opened->fast)
        cln_render_faster(&config);
    CLN_TRY(cln_device_open(device, &opened->device));
    cln_info("device: %s (%s, %d compute unit%s)", opened->device->info.name,
             opened->device->info.platform, opened->device->info.compute_units,
             cln_plural(opened->device->info.compute_units, "", "s"));
    CLN_TRY(cln_recorded_tune(opened->run, opened->device));
    if (opened->scene)
        CLN_TRY(
            cln_room_place_images(&(cln_room_desc){.device = opened->device,
                                                   .config = &config,
                                                   .scene = opened->scene,
                                                   .leaves = leaves,
                                                   .depth = depth,
                                                   .coverage_bytes = -1,
                                                   .photos = cln_scene_pixel_bytes(opened->scene)},
                                  opened->scene, &room));
    cln_debug("building kernels for %s", opened->device->info.name);
    CLN_TRY(cln_pipeline_create(opened->device, &config,
                                &(cln_pipeline_facts){.lenses = lenses,
                                                      .alpha = opened->model.has_alpha,
                                                      .depth = depth,
                                                      .space = &opened->model.space},
                                opened->wanted, p));
    CLN_TRY(cln_pipeline_share(p));
    cln_tune_text(&p->tune, text);
    cln_debug("kernel parameters: %s (%s)", text, p->tune_from);
    cln_share_evenly(p, leaves);
    CLN_TRY(cln_open_run_plan(opened));
    CLN_TRY(cln_pipeline_rebuild(p, leaves));
    CLN_TRY(cln_pipeline_upload(p, &opened->model, false));
done:
    return st;
}

void cln_open_run_close(cln_open_run *opened)
{
    cln_pipeline_free(&opened->pipeline);
    cln_device_close(opened->device);
    cln_scene_free(opened->scene);
    cln_model_free(&opened->model);
    memset(opened, 0, sizeof *opened);
}
