/* Support of tests of parts of training: a trainer on run_fixture.h's scene, without a run folder.
 */
#ifndef CLN_TESTS_TRAINER_FIXTURE_H
#define CLN_TESTS_TRAINER_FIXTURE_H

#include "pipeline/stages.h"
#include "run_fixture.h"
#include "train/step.h"

/* As cln_train does. */
static inline void open_trainer(const cln_config *config, cln_trainer *t)
{
    const cln_scene_desc scene = {
        .path = fixture_path("scene"), .config = config, .pixels = {[CLN_SPLIT_TRAIN] = true}};
    const cln_device_desc device = fixture_device();
    cln_plan_desc plan = {.pipeline = &t->pipeline, .training = true};

    memset(t, 0, sizeof *t);
    assert_ok(cln_device_open(&device, &t->device));
    assert_ok(cln_scene_load(&scene, &t->scene));
    assert_ok(cln_model_create(config, &t->model));
    t->model.space = t->scene->space;
    memcpy(t->model.background, t->scene->background, sizeof t->model.background);
    t->model.has_alpha = t->scene->has_alpha;
    t->steps = config->steps;
    assert_ok(cln_batch_create(t->scene, config, &t->batch));
    assert_ok(
        cln_alloc(&t->results, (size_t)cln_config_most_rays(config), sizeof *t->results, "test"));
    assert_ok(cln_exposure_start(t->scene, cln_config_most_rays(config), &t->model, &t->exposure));
    assert_ok(cln_pipeline_create(t->device, config,
                                  &(cln_pipeline_facts){.lenses = t->scene->lenses,
                                                        .alpha = t->scene->has_alpha,
                                                        .space = &t->model.space},
                                  CLN_PROGRAMS_ALL, &t->pipeline));
    assert_ok(cln_pipeline_share(&t->pipeline));
    plan.scene = t->scene;
    plan.leaves = t->model.tree.leaf_count;
    cln_plan_device(&plan, &t->plan);
    cln_plan_apply(&t->plan, &t->pipeline);
    t->model.rays = config->rays;
    assert_ok(cln_pipeline_scene(&t->pipeline, t->scene, &t->model.space));
    assert_ok(cln_pipeline_rebuild(&t->pipeline, t->model.tree.leaf_count));
    assert_ok(cln_pipeline_upload(&t->pipeline, &t->model, true));
    assert_ok(cln_stage_seen(&t->pipeline));
    cln_step_cover(t);
}

static inline void close_trainer(cln_trainer *t)
{
    free(t->results);
    cln_batch_free(&t->batch);
    cln_exposure_free(&t->exposure);
    cln_pipeline_free(&t->pipeline);
    cln_model_free(&t->model);
    cln_scene_free(t->scene);
    cln_device_close(t->device);
}

#endif
