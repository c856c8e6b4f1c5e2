/* The PSNR of a fixed batch. See probe.h. */
#include "train/probe.h"

#include "device/queue.h"
#include "render/metrics_image.h"
#include "render/ray_batch.h"
#include "train/step.h"

enum { PROBE_RAYS = 2048 };

cln_sampling cln_probe_sampling(const cln_trainer *t)
{
    cln_sampling sampling = cln_render_sampling(&t->pipeline);

    sampling.pictures = false; /* training's densities, as the next step reads them */
    sampling.max_samples = t->plan.max_samples;
    return sampling;
}

cln_status cln_probe_psnr(cln_trainer *t, double *psnr)
{
    cln_status st = CLN_OK;
    const cln_config *c = &t->model.config;
    cln_pipeline *p = &t->pipeline;
    const int wanted = c->rays < PROBE_RAYS ? c->rays : PROBE_RAYS;
    const int rays = wanted < t->plan.max_rays ? wanted : t->plan.max_rays;
    cln_ray_batch batch = {.pixels = t->batch.pixels,
                           .n = rays,
                           .backgrounds = (const float(*)[4])t->batch.backgrounds,
                           .sampling = cln_probe_sampling(t)};
    /* of all pixels, so that they are the same before and after a change */
    const cln_draw draw = {.step = UINT32_MAX, .n = rays, .ray_background = p->ray_background};
    int used = 0;
    double square = 0;

    CLN_TRY(cln_step_catch_up(t));
    cln_queue_book(t->device, CLN_STAGE_PROBE);
    t->drawn = false;
    cln_batch_draw(&t->batch, t->scene, c, &draw);
    cln_exposure_divide_batch(&t->exposure, &t->model, &t->batch, rays);
    CLN_TRY(cln_render_rays(p, &batch, t->results, &used));
    for (int i = 0; i < used; i++) {
        const float got[3] = {t->results[i].r, t->results[i].g, t->results[i].b};

        for (int k = 0; k < 3; k++)
            square += ((double)got[k] - t->batch.targets[i][k]) *
                      ((double)got[k] - t->batch.targets[i][k]);
    }
    *psnr = cln_psnr(square / (3.0 * used));
done:
    cln_queue_book(t->device, CLN_STAGES);
    return st;
}
