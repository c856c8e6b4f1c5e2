/* Runs the stages of a batch of rays without training. See ray_batch.h. */
#include "render/ray_batch.h"

#include <math.h>

#include "pipeline/plan.h"

/* Halves the samples of a ray or, if chords allocate them, of a leaf. An interval gets none if it
 * adds less than a hundredth of the ray's light, or if less reaches it. */
void cln_render_faster(cln_config *config)
{
    static const double LITTLE = 0.01;

    if (config->allocate == CLN_ALLOCATE_WEIGHT)
        config->samples_per_ray = (config->samples_per_ray + 1) / 2;
    else
        config->samples_per_leaf = (config->samples_per_leaf + 1) / 2;
    config->empty_weight = fmax(config->empty_weight, LITTLE);
    config->render_min_transmittance = fmax(config->render_min_transmittance, LITTLE);
}

cln_sampling cln_render_sampling(const cln_pipeline *p)
{
    const cln_config *c = &p->config;
    const size_t wanted = CLN_RENDER_BATCHES * (size_t)c->batch_samples;

    return (cln_sampling){
        .jitter = false,
        .pictures = true,
        .min_transmittance = (float)c->render_min_transmittance,
        .uniform_share = (float)c->uniform_share,
        .empty_weight = (float)c->empty_weight,
        .empty_share = c->empty_weight > 0 ? 0 : 1,
        .max_samples = p->max_samples > 0 && p->max_samples < wanted ? p->max_samples : wanted,
        .crop = p->crop};
}

cln_status cln_render_rays(cln_pipeline *p, const cln_ray_batch *b, cln_ray_result *results,
                           int *rendered)
{
    cln_status st = CLN_OK;
    uint32_t samples = 0;

    CLN_TRY(cln_pipeline_batch(p, b->pixels, b->n, NULL, b->backgrounds[0]));
    CLN_TRY(cln_stage_rays(p, b->n));
    CLN_TRY(cln_stage_sample(p, b->n, &b->sampling, rendered, &samples));
    CLN_TRY(cln_stage_evaluate(p, samples));
    CLN_TRY(cln_stage_composite(p, *rendered, b->depth));
    CLN_TRY(
        cln_buffer_read(p->device, &p->results, 0, results, (size_t)*rendered * sizeof *results));
    CLN_TRY(cln_device_finish(p->device));
done:
    if (st != CLN_OK)
        clFinish(p->device->queue); /* what was put on it before still reads the caller's arrays */
    return st;
}
