/* Memory plans on devices without a driver. */
#ifndef CLN_PLAN_FAKE_H
#define CLN_PLAN_FAKE_H

#include <stdio.h>
#include <string.h>
#include "pipeline/plan.h"
#include "run_fixture.h"

static const double MIB = 1 << 20;

/* Four RGBA views of 100 x 50 with pixels; a pipeline without buffers on a device without a
 * driver. */
typedef struct fake {
    cln_device device;
    cln_pipeline pipeline;
    cln_view views[4];
    cln_scene scene;
    cln_plan_desc desc;
} fake;

static inline void make_fake(fake *f, const cln_config *config, double max_alloc, const char *type)
{
    static uint8_t pixel;

    memset(f, 0, sizeof *f);
    f->device.info.max_alloc = max_alloc;
    f->device.info.global_mem = 8192 * MIB;
    f->device.max_alloc = (size_t)max_alloc;
    f->device.unified = strcmp(type, "cpu") == 0;
    snprintf(f->device.info.type, sizeof f->device.info.type, "%s", type);
    snprintf(f->device.info.name, sizeof f->device.info.name, "a device");
    f->device.tune =
        (cln_tune){.vw = 8, .nv = 2, .ls = 1, .ts = 6, .nb = 48, .sl = 480, .wg = 16, .chunk = 64};
    f->pipeline.device = &f->device;
    f->pipeline.config = *config;
    f->pipeline.depth_loss = config->depth_loss;
    f->pipeline.deepest = cln_config_deepest(config);
    f->pipeline.tune = f->device.tune;
    assert_ok(cln_network_layout(config, &f->pipeline.net));
    for (int i = 0; i < 4; i++) {
        f->views[i].camera.width = 100;
        f->views[i].camera.height = 50;
        f->views[i].channels = 4;
        f->views[i].pixels = &pixel;
    }
    f->scene.views = f->views;
    f->scene.view_count = 4;
    f->desc = (cln_plan_desc){
        .pipeline = &f->pipeline, .scene = &f->scene, .leaves = 64, .training = true};
}

static inline cln_config preset(const char *name)
{
    cln_config config;

    assert_ok(cln_config_preset(name, &config));
    return config;
}

static inline double row_bytes(const cln_plan *plan, const char *purpose, bool largest)
{
    for (int i = 0; i < plan->count; i++)
        if (strcmp(plan->rows[i].purpose, purpose) == 0)
            return largest ? plan->rows[i].largest : plan->rows[i].bytes;
    fail_msg("no row %s", purpose);
    return 0;
}

#endif
