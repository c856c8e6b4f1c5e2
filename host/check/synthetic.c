/* The synthetic step and samples of synthetic.h. */
#include "check/synthetic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/config.h"
#include "base/memory.h"
#include "base/rng.h"
#include "pipeline/stage1.h"

enum { SIDE = 256, FEWEST_RAYS = 256, MAX_CELLS = 1 << 21, GROWN = 3 };

static const double distance = 3;            /* of the cameras, in halves of the cube */
static const double radius = 0.85;           /* of the ball */
static const uint16_t density_of_4 = 0x4080; /* bfloat16: an opaque object with a soft skin */

/* A camera on a ring around z that looks at the origin (OpenCV's axes). */
static cln_camera camera(int view)
{
    const double yaw = 2 * M_PI * (view + 0.3) / CLN_SYNTHETIC_VIEWS, up = 0.3;
    const double flat = sqrt(1 - up * up);
    const double z[3] = {-flat * cos(yaw), -flat * sin(yaw), -up};
    const double x[3] = {-sin(yaw), cos(yaw), 0};
    const double y[3] = {z[1] * x[2] - z[2] * x[1], z[2] * x[0] - z[0] * x[2],
                         z[0] * x[1] - z[1] * x[0]};
    cln_camera c = {.fx = 1.4 * SIDE,
                    .fy = 1.4 * SIDE,
                    .cx = 0.5 * SIDE,
                    .cy = 0.5 * SIDE,
                    .width = SIDE,
                    .height = SIDE};

    for (int a = 0; a < 3; a++) {
        c.c2w[4 * a] = x[a];
        c.c2w[4 * a + 1] = y[a];
        c.c2w[4 * a + 2] = z[a];
        c.c2w[4 * a + 3] = -distance * z[a];
    }
    return c;
}

static int level_of(const cln_config *config)
{
    double at[CLN_LEVELS];
    int level = config->start_level;

    if (cln_config_levels(config, at) != CLN_OK) {
        cln_clear_error();
        return level;
    }
    while (level < GROWN && at[level + 1] <= 1)
        level++;
    return level;
}

/* Makes the full tree of a level without leaves whose centre is outside the ball; levels 0 and 1
 * keep all leaves. */
static cln_status make_tree(int level, double ball, cln_octree *tree)
{
    cln_status st = CLN_OK;
    cln_octree_change change = {0};
    uint8_t *cull = NULL;

    CLN_TRY(cln_octree_create(level, tree));
    if (level < 2)
        goto done;
    CLN_TRY(cln_alloc(&cull, (size_t)tree->leaf_count, 1, "leaves"));
    for (int s = 0; s < tree->leaf_count; s++) {
        float box[4];
        double square = 0;

        cln_octree_box(tree, tree->leaf[s], box);
        for (int a = 0; a < 3; a++)
            square += pow((double)box[a] + 0.5 * (double)box[3], 2);
        cull[s] = square > ball * ball;
    }
    CLN_TRY(cln_octree_cull(tree, cull, &change));
done:
    cln_octree_change_free(&change);
    free(cull);
    return st;
}

/* Draws pixels, view and row ascending, and random targets. */
void cln_synthetic_draw(cln_synthetic *s, int rays)
{
    const bool by_view = cln_stage1_of(&s->model.config)->by_view;

    s->rays = rays;
    for (int i = 0; i < rays; i++) {
        const int64_t place = (int64_t)i * CLN_SYNTHETIC_VIEWS;
        const uint32_t view = (uint32_t)(place / rays);
        float u[4];

        cln_uniform4(1, CLN_STREAM_SCENE, 1, (uint32_t)i, 0, u);
        s->pixels[i] = (cln_pixel){
            .view = view,
            .x = (cln_u32)(u[0] * SIDE),
            .y = (cln_u32)((place - (int64_t)view * rays) * SIDE / rays),
            .spot = by_view ? view : 0,
        };
        memcpy(s->targets[i], u + 1, 3 * sizeof u[0]);
    }
}

static cln_status make_batch(cln_synthetic *s, int rays)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_alloc(&s->pixels, (size_t)rays, sizeof *s->pixels, "pixels"));
    CLN_TRY(cln_alloc(&s->targets, (size_t)rays, sizeof *s->targets, "targets"));
    CLN_TRY(cln_alloc(&s->results, (size_t)rays, sizeof *s->results, "ray results"));
    cln_synthetic_draw(s, rays);
done:
    return st;
}

static cln_status create(cln_device *device, const cln_config *config, int level, double ball,
                         cln_synthetic *out)
{
    cln_status st = CLN_OK;
    cln_config ours = *config;
    cln_octree tree = {0};
    cln_plan plan;
    cln_pipeline shape; /* only what the plan reads */
    cln_view views[CLN_SYNTHETIC_VIEWS];
    const cln_scene scene = {.views = views, .view_count = CLN_SYNTHETIC_VIEWS};
    size_t cells = 0;

    memset(out, 0, sizeof *out);
    ours.depth_loss = 0; /* no ray shows a known point */
    CLN_TRY(make_tree(level, ball, &tree));
    while (ours.n1 > 2 && (double)tree.leaf_count * pow(ours.n1, 3) > MAX_CELLS)
        ours.n1 /= 2;
    CLN_TRY(cln_model_create_on(&ours, &tree, &out->model));
    cells = (size_t)tree.leaf_count * (size_t)ours.n1 * (size_t)ours.n1 * (size_t)ours.n1;
    for (size_t i = 0; i < cells; i++)
        out->model.density[i] = density_of_4;
    memset(views, 0, sizeof views);
    for (int v = 0; v < CLN_SYNTHETIC_VIEWS; v++)
        views[v].camera = out->cameras[v] = camera(v);
    CLN_TRY(make_batch(out, ours.rays));
    memset(&shape, 0, sizeof shape);
    shape.device = device;
    shape.config = ours;
    shape.net = out->model.net;
    shape.tune = device->tune;
    cln_pipeline_fit(device, &shape.net, &shape.tune);
    cln_plan_device(
        &(cln_plan_desc){
            .pipeline = &shape, .scene = &scene, .leaves = tree.leaf_count, .training = true},
        &plan);
    CLN_TRY(cln_plan_check(device, &plan));
    out->max_entries = plan.max_entries;
    out->sampling = (cln_sampling){.jitter = true,
                                   .min_transmittance = (float)ours.min_transmittance,
                                   .uniform_share = (float)ours.uniform_share,
                                   .empty_weight = (float)ours.empty_weight,
                                   .empty_share = (float)ours.empty_share,
                                   .seed = 1,
                                   .step = 1,
                                   .max_samples = plan.batch_samples};
done:
    cln_octree_free(&tree);
    if (st != CLN_OK)
        cln_synthetic_free(out);
    return st;
}

cln_status cln_synthetic_create(cln_device *device, const cln_config *config, cln_synthetic *out)
{
    return create(device, config, level_of(config), radius, out);
}

cln_status cln_synthetic_create_grown(cln_device *device, const cln_config *config, int leaves,
                                      cln_synthetic *out)
{
    double ball = 0;
    int level = 1;

    do { /* of the cube's 8^level leaves a ball holds pi / 6 of its radius cubed */
        level++;
        ball = cbrt(leaves / (M_PI / 6 * pow(8, level)));
    } while (ball > radius && level < CLN_FULL_LEVELS - 1);
    return create(device, config, level, fmin(ball, radius), out);
}

void cln_synthetic_free(cln_synthetic *s)
{
    cln_model_free(&s->model);
    free(s->pixels);
    free(s->targets);
    free(s->results);
    memset(s, 0, sizeof *s);
}

cln_status cln_synthetic_upload(const cln_synthetic *s, cln_pipeline *p)
{
    cln_status st = CLN_OK;
    const cln_camera *cameras[CLN_SYNTHETIC_VIEWS];

    for (int v = 0; v < CLN_SYNTHETIC_VIEWS; v++)
        cameras[v] = &s->cameras[v];
    p->max_entries = s->max_entries;
    CLN_TRY(cln_pipeline_rebuild(p, s->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(p, &s->model, true));
    CLN_TRY(cln_pipeline_cameras(p, cameras, CLN_SYNTHETIC_VIEWS, &cln_space_unit));
    p->training_views = CLN_SYNTHETIC_VIEWS;
done:
    return st;
}

cln_status cln_synthetic_step(cln_synthetic *s, cln_pipeline *p)
{
    cln_status st = CLN_OK;
    int rays = 0;

    CLN_TRY(cln_pipeline_batch(p, s->pixels, s->rays, s->targets[0], s->targets[0]));
    CLN_TRY(cln_stage_rays(p, s->rays));
    CLN_TRY(cln_stage_sample(p, s->rays, &s->sampling, &rays, &s->samples));
    CLN_TRY(cln_stage_group(p, s->samples, &s->slices));
    CLN_TRY(cln_stage_forward(p, s->samples, s->slices, true, 1));
    CLN_TRY(cln_stage_composite_train(p, rays, s->samples));
    CLN_TRY(cln_stage_update(p, s->samples, s->slices, 1, 1, 1e-12));
    CLN_TRY(cln_stage_measure(p, s->samples));
    CLN_TRY(
        cln_buffer_read(p->device, &p->results, 0, s->results, (size_t)rays * sizeof *s->results));
    CLN_TRY(cln_device_finish(p->device));
    s->used = rays;
done:
    return st;
}

cln_status cln_synthetic_settle(cln_synthetic *s, cln_pipeline *p, double seconds)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_synthetic_step(s, p)); /* compiles, and finds how many rays fit a batch */
    if (s->used < s->rays)
        cln_synthetic_draw(s, s->used);
    for (;;) {
        const double began = cln_now();

        CLN_TRY(cln_synthetic_step(s, p));
        if (cln_now() - began <= seconds || s->rays < 2 * FEWEST_RAYS)
            break;
        cln_synthetic_draw(s, s->rays / 2);
    }
done:
    return st;
}
