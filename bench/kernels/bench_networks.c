/* Leaf networks: densities, forward, backward, both together, Adam; the same with other arithmetic;
 * the upload that transposes the weights. bench_network_checks.c compares.
 *
 * Samples have exact local coordinates: the encoding multiplies a position's rounding by 2^bands,
 * which would count as an error of the network. Only voxel_samples gets them in runs along rays, as
 * pictures have them. RReLU draws its slopes from a very narrow range. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "bench_network.h"

typedef struct network_shape {
    int width, depth, view, bands, view_bands, leaves,
        samples;                         /* view 0: none; bands 0: a grid; samples per leaf */
    const char *preset, *variant, *tune; /* only for arithmetic */
} network_shape;

/* Widths without V have no view layer. With one band nearly all work is layers of 64 x 64. */
static const network_shape shapes[] = {
    {16, 2, 16, 4, 1, 1, 1, 0, 0, 0},       {16, 2, 16, 4, 1, 512, 128, 0, 0, 0},
    {16, 2, 16, 0, 2, 64, 1536, 0, 0, 0},   {16, 2, 16, 0, 2, 2048, 48, 0, 0, 0},
    {32, 3, 32, 6, 2, 64, 1, 0, 0, 0},      {32, 3, 32, 6, 2, 4096, 16, 0, 0, 0},
    {32, 3, 32, 6, 2, 2048, 48, 0, 0, 0},   {32, 3, 32, 6, 2, 1024, 96, 0, 0, 0},
    {32, 3, 32, 6, 2, 512, 128, 0, 0, 0},   {32, 3, 32, 6, 2, 512, 512, 0, 0, 0},
    {64, 4, 64, 6, 2, 64, 1536, 0, 0, 0},   {64, 8, 0, 1, 0, 64, 1536, 0, 0, 0},
    {64, 8, 0, 1, 0, 1024, 96, 0, 0, 0},    {64, 8, 0, 1, 0, 2048, 48, 0, 0, 0},
    {64, 8, 0, 10, 0, 64, 1536, 0, 0, 0},   {64, 8, 0, 10, 0, 1024, 96, 0, 0, 0},
    {64, 8, 0, 10, 0, 2048, 48, 0, 0, 0},   {64, 8, 64, 10, 4, 64, 1536, 0, 0, 0},
    {64, 8, 256, 10, 4, 64, 512, 0, 0, 0},  {64, 8, 256, 10, 4, 64, 1536, 0, 0, 0},
    {64, 8, 256, 10, 4, 1024, 96, 0, 0, 0}, {128, 4, 128, 10, 4, 8, 1536, 0, 0, 0},
};

/* The presets' own networks. */
static const network_shape arithmetic[] = {
    {0, 0, 0, 0, 0, 512, 128, "fast", "strict", ""},
    {0, 0, 0, 0, 0, 512, 128, "fast", "native", "NATIVE=1"},
    {0, 0, 0, 0, 0, 512, 128, "fast", "half", "HALF=1"},
    {0, 0, 0, 0, 0, 512, 128, "fast", "native and half", "NATIVE=1,HALF=1"},
    {0, 0, 0, 0, 0, 64, 512, "paper", "strict", ""},
    {0, 0, 0, 0, 0, 64, 512, "paper", "native", "NATIVE=1"},
    {0, 0, 0, 0, 0, 64, 512, "paper", "half", "HALF=1"},
    {0, 0, 0, 0, 0, 64, 512, "paper", "native and half", "NATIVE=1,HALF=1"},
};

/* Preset voxel: leaves as in its first seconds and as at its end. */
static const network_shape voxels[] = {
    {0, 0, 0, 0, 0, 64, 512, "voxel", "", 0},
    {0, 0, 0, 0, 0, 2048, 40, "voxel", "", 0},
    {0, 0, 0, 0, 0, 8192, 24, "voxel", "", 0},
};

static const network_shape uploads[] = {
    {32, 3, 32, 6, 2, 1, 1, 0, 0, "LEAF=0"},
    {32, 3, 32, 6, 2, 512, 1, 0, 0, "LEAF=0"},
    {64, 8, 256, 10, 4, 64, 1, 0, 0, "LEAF=0"},
};

enum { ARITHMETIC_PARTS = FORWARD };
static const bench_part parts[] = {
    {"mlp_density", "mlp_density"},
    {"mlp_forward_eval", "mlp_forward_eval"},
    {"mlp_training", "mlp_forward_train roulette mlp_backward"},
    {"mlp_forward_train", "mlp_forward_train"},
    {"roulette", "roulette"},
    {"mlp_backward", "roulette mlp_backward"},
    {"adam", "adam_count adam"},
    {"mlp_update", "adam_count roulette mlp_backward adam"},
};
static const bench_part voxel_parts[] = {
    {"voxel_density", "voxel_density"},
    {"voxel_samples", "voxel_samples"},
    {"voxel_training", "voxel_forward_train roulette decoder_backward voxel_backward"},
    {"voxel_forward_train", "voxel_forward_train"},
    {"voxel_roulette", "roulette"},
    {"voxel_backward", "roulette decoder_backward voxel_backward"},
    {"voxel_adam", "adam_count decoder_update voxel_update"},
    {"voxel_update", "adam_count roulette decoder_backward decoder_update voxel_backward "
                     "voxel_update"},
};
static const bench_part upload_parts[] = {{"transpose", "transpose"}};

static const double SLOPE = -0.2;
enum {
    CELLS = 131072, /* about as many as training refreshes at once */
    ALONG = 4       /* samples that a picture's ray has in a leaf of voxels */
};

/* ---- a model with a given number of leaves, samples in all of them ---- */

static cln_status config_of(const network_shape *s, cln_config *config)
{
    cln_status st = CLN_OK;

    memset(config, 0, sizeof *config);
    CLN_TRY(cln_config_preset(s->preset ? s->preset : "fast", config));
    config->adaptive = false; /* structure kernels are not built */
    config->stage1 = CLN_STAGE1_GATHER;
    config->n1 = 12;
    config->min_leaf_samples = 1;
    config->roulette = 0;                     /* all samples are timed */
    config->rrelu_lower = SLOPE * (1 + 1e-6); /* just wide enough that no compiler folds it */
    config->rrelu_upper = SLOPE;
    config->smooth_density = config->smooth_colour = 0; /* off: they work on some leaves */
    if (s->preset)
        goto done;
    config->width = s->width;
    config->depth = s->depth;
    config->view_dependence = s->view > 0;
    config->view_width = s->view > 0 ? s->view : 16;
    if (s->bands > 0)
        config->bands = s->bands;
    else
        config->encoding = CLN_ENCODING_GRID;
    config->view_bands = s->view_bands;
done:
    return st;
}

static cln_status make_tree(int leaves, cln_octree *tree)
{
    cln_status st = CLN_OK;
    cln_octree_change change = {0};
    uint8_t *cull = NULL;
    int level = 0;

    while (1 << (3 * level) < leaves)
        level++;
    CLN_TRY(cln_octree_create(level, tree));
    if (tree->leaf_count > leaves) {
        CLN_TRY(cln_alloc(&cull, (size_t)tree->leaf_count, 1, "bench"));
        memset(cull + leaves, 1, (size_t)(tree->leaf_count - leaves));
        CLN_TRY(cln_octree_cull(tree, cull, &change));
    }
done:
    cln_octree_change_free(&change);
    free(cull);
    return st;
}

/* All leaves share one random sequence of weights, rotated by the leaf's number. */
static cln_status make_model(const cln_config *config, int leaves, cln_model *model)
{
    cln_status st = CLN_OK;
    cln_octree tree = {0};
    float *base = NULL;
    int *owner = NULL;
    const double scale = sqrt(2.0 / config->width);

    CLN_TRY(make_tree(leaves, &tree));
    CLN_TRY(cln_model_create_on(config, &tree, model));
    const size_t n = (size_t)model->net.params;

    CLN_TRY(cln_alloc(&base, n, sizeof *base, "bench"));
    for (size_t i = 0; i < n; i++)
        base[i] = (float)(scale * cln_check_uniform(1, (uint32_t)i, -1, 1));
    for (size_t s = 0; s < (size_t)leaves; s++)
        for (size_t i = 0; i < n; i++)
            model->params[s * n + i] = base[(i + 16 * s) % n];
    for (int i = 0; i < model->net.decoder_params; i++)
        model->decoder[i] = (float)(0.3 * cln_check_uniform(2, (uint32_t)i, -1, 1));
    CLN_TRY(cln_check_owners(model, &owner));
    for (size_t i = 0; owner && i < (size_t)leaves * n; i++)
        model->params[i] = model->params[owner[i]];
done:
    free(owner);
    cln_octree_free(&tree);
    free(base);
    return st;
}

static void drop_samples(network_run *r)
{
    free(r->samples);
    free(r->ray_o);
    free(r->ray_d);
    free(r->dout);
    free(r->slices);
    r->samples = NULL;
    r->ray_o = r->ray_d = r->dout = NULL;
    r->slices = NULL;
}

/* How far a ray from a point in a box is in it. */
static double way_through(const float o[4], const float d[4], const float box[4])
{
    double way = INFINITY;

    for (int a = 0; a < 3; a++)
        way = fmin(way, (box[a] + (d[a] > 0 ? box[3] : 0.0) - o[a]) / d[a]);
    return way;
}

/* along: samples of a ray, in one leaf; the next ray is in another. */
static cln_status make_samples(network_run *r, int per_leaf, int along)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = r->p;
    const uint32_t leaves = (uint32_t)p->leaves, each = (uint32_t)along;
    const size_t n = (size_t)p->leaves * (size_t)per_leaf;
    float(*boxes)[4] = NULL;

    drop_samples(r);
    r->n = (uint32_t)n;
    r->along = along;
    CLN_TRY(cln_octree_boxes(&r->model.tree, (float **)&boxes));
    CLN_TRY(cln_alloc(&r->ray_o, n, sizeof *r->ray_o, "bench"));
    CLN_TRY(cln_alloc(&r->ray_d, n, sizeof *r->ray_d, "bench"));
    CLN_TRY(cln_alloc(&r->dout, n, sizeof *r->dout, "bench"));
    CLN_TRY(cln_alloc(&r->samples, n, sizeof *r->samples, "bench"));
    for (uint32_t i = 0; i < r->n; i++) {
        const uint32_t ray = i / each, slot = (uint32_t)((uint64_t)ray * 7919 % leaves);
        double length = 0, t = 0;

        for (uint32_t a = 0; a < 3; a++) {
            const double part = floor(cln_check_uniform(2, 3 * ray + a, 0, 1024)) / 1024;

            r->ray_o[ray][a] = (float)(boxes[slot][a] + part * boxes[slot][3]);
            r->ray_d[ray][a] = (float)cln_check_uniform(3, 3 * ray + a, -1, 1);
            length += (double)r->ray_d[ray][a] * r->ray_d[ray][a];
            r->dout[i][a] = (float)cln_check_uniform(4, 3 * i + a, -1e-3, 1e-3);
        }
        for (int a = 0; a < 3; a++)
            r->ray_d[ray][a] = (float)(r->ray_d[ray][a] / sqrt(length));
        r->dout[i][3] = (float)cln_check_uniform(5, i, -1e-5, 1e-5);
        if (along > 1)
            t = (i % each + 0.5) / along * way_through(r->ray_o[ray], r->ray_d[ray], boxes[slot]);
        r->samples[i] = (cln_sample){.t = (float)t, .ray = ray, .slot = (cln_i32)slot};
    }
    network_drop_kinks(r);
    CLN_TRY(cln_pipeline_points(p, r->ray_o[0], r->ray_d[0], NULL, r->n));
    CLN_TRY(cln_pipeline_samples(p, r->samples, r->n));
    CLN_TRY(cln_check_put(p->device, &p->dout, r->dout, n * sizeof *r->dout));
    CLN_TRY(cln_stage_group(p, r->n, &r->slice_count));
    CLN_TRY(cln_stage_slices(p, &r->slice_count));
    CLN_TRY(cln_alloc(&r->slices, r->slice_count, sizeof *r->slices, "bench"));
    CLN_TRY(
        cln_buffer_read(p->device, &p->slices, 0, r->slices, r->slice_count * sizeof *r->slices));
done:
    free(boxes);
    return st;
}

static cln_status start(bench *b, const network_shape *s, network_run *r)
{
    cln_status st = CLN_OK;
    cln_config config;

    CLN_TRY(config_of(s, &config));
    CLN_TRY(make_model(&config, s->leaves, &r->model));
    CLN_TRY(bench_pipeline(b, &config, false, s->tune, &r->p));
    CLN_TRY(cln_pipeline_rebuild(r->p, r->model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(r->p, &r->model, true));
    r->refreshed = CELLS / (config.n1 * config.n1 * config.n1);
    r->refreshed = r->refreshed < s->leaves ? r->refreshed : s->leaves;
    CLN_TRY(make_samples(r, s->samples, 1));
done:
    return st;
}

static void finish(bench *b, network_run *r)
{
    cln_pipeline_free(&b->pipeline); /* its buffers have this shape's size */
    cln_model_free(&r->model);
    drop_samples(r);
}

/* ---- what is timed ---- */

static cln_status body(void *context)
{
    cln_status st = CLN_OK;
    const network_run *r = context;

    switch (r->part) {
    case DENSITY:
        CLN_TRY(cln_stage_refresh(r->p, 0, r->refreshed, false, 0, 0));
        break;
    case EVAL:
        CLN_TRY(cln_stage_forward(r->p, r->n, r->slice_count, false, 1));
        break;
    case FORWARD:
        CLN_TRY(cln_stage_forward(r->p, r->n, r->slice_count, true, 1));
        break;
    case TRAINING:
        CLN_TRY(cln_stage_forward(r->p, r->n, r->slice_count, true, 1));
        CLN_TRY(cln_stage_backward(r->p, r->n, r->slice_count, 1));
        break;
    case ROULETTE:
        CLN_TRY(cln_stage_roulette(r->p, r->n, r->slice_count, 0, ROULETTE_CUTOFF, 1));
        break;
    case BACKWARD:
        CLN_TRY(cln_stage_backward(r->p, r->n, r->slice_count, 1));
        break;
    case UPDATE:
        CLN_TRY(cln_stage_update(r->p, r->n, r->slice_count, 1, 1, 1e-9));
        break;
    default:
        CLN_TRY(cln_stage_adam(r->p, 1, 1e-9));
        break;
    }
done:
    return st;
}

/* Takes samples as they lie along rays, not grouped by leaf? */
static bool in_order(const network_run *r)
{
    return r->part == EVAL && r->p->net.encoding == CLN_ENCODING_VOXEL;
}

static bench_work work_of(const network_run *r)
{
    const cln_network *net = &r->p->net;
    const cln_tune *tune = &r->p->tune;
    const double n = r->n, leaves = r->p->leaves, slices = r->slice_count;
    const double n1 = r->p->config.n1;
    bench_work a, back;

    switch (r->part) {
    case DENSITY:
        return bench_work_density(net, r->refreshed * n1 * n1 * n1, r->refreshed);
    case EVAL:
        if (in_order(r))
            return bench_work_in_order(net, n, n / r->along, leaves);
        return bench_work_forward(net, tune, false, n, leaves, slices);
    case FORWARD:
        return bench_work_forward(net, tune, true, n, leaves, slices);
    case ROULETTE:
        return bench_work_roulette(n);
    case BACKWARD:
        return bench_work_backward(net, tune, n, leaves, slices);
    case TRAINING:
        a = bench_work_forward(net, tune, true, n, leaves, slices);
        back = bench_work_backward(net, tune, n, leaves, slices);
        return (bench_work){a.flop + back.flop, a.bytes + back.bytes};
    case UPDATE:
        return bench_work_update(&r->p->config, net, tune, n, leaves, slices);
    default:
        return bench_work_adam(&r->p->config, net, tune, n, leaves, slices);
    }
}

static cln_status run_network(bench *b, const network_shape *s)
{
    cln_status st = CLN_OK;
    network_run r = {0};

    CLN_TRY(start(b, s, &r));
    for (r.part = 0; r.part < b->family->part_count; r.part++) {
        const int along = in_order(&r) ? ALONG : 1;
        bench_errors errors = {0};

        if (!b->wanted[r.part])
            continue;
        if (r.along != along)
            CLN_TRY(make_samples(&r, s->samples, along));
        CLN_TRY(network_check(&r, body, &errors));
        CLN_TRY(bench_add(b, r.part, body, NULL, &r, CLN_STAGES, work_of(&r), &errors));
    }
done:
    finish(b, &r);
    return st;
}

/* ---- upload ---- */

static cln_status upload_body(void *context)
{
    const network_run *r = context;

    return cln_pipeline_upload(r->p, &r->model, true);
}

static cln_status run_upload(bench *b, int shape)
{
    cln_status st = CLN_OK;
    bench_errors errors = {0};
    network_run r = {0};

    CLN_TRY(start(b, &uploads[shape], &r));
    CLN_TRY(network_check_transposed(&r, &errors));
    CLN_TRY(bench_add(b, 0, upload_body, NULL, &r, CLN_STAGES,
                      bench_work_upload(&r.p->config, &r.p->net, r.p->leaves), &errors));
done:
    finish(b, &r);
    return st;
}

/* ---- families ---- */

static void shape_text(const network_shape *s, char out[64])
{
    char view[16] = "", encoding[16] = "G";

    if (s->view)
        snprintf(view, sizeof view, "-V%d", s->view);
    if (s->bands > 0)
        snprintf(encoding, sizeof encoding, "L%d", s->bands);
    if (s->preset)
        snprintf(out, 64, "%s %dx%d %s", s->preset, s->leaves, s->samples, s->variant);
    else
        snprintf(out, 64, "W%d-D%d%s-%s %dx%d", s->width, s->depth, view, encoding, s->leaves,
                 s->samples);
}

static void network_text(int shape, char out[64])
{
    shape_text(&shapes[shape], out);
}

static void arithmetic_text(int shape, char out[64])
{
    shape_text(&arithmetic[shape], out);
}

static void voxel_text(int shape, char out[64])
{
    snprintf(out, 64, "%dx%d", voxels[shape].leaves, voxels[shape].samples);
}

static void upload_text(int shape, char out[64])
{
    shape_text(&uploads[shape], out);
}

static cln_status run_shape(bench *b, int shape)
{
    return run_network(b, &shapes[shape]);
}

static cln_status run_arithmetic(bench *b, int shape)
{
    return run_network(b, &arithmetic[shape]);
}

static cln_status run_voxels(bench *b, int shape)
{
    return run_network(b, &voxels[shape]);
}

const bench_family bench_networks = {
    "networks", parts, NETWORK_PARTS, sizeof shapes / sizeof shapes[0], network_text, run_shape};
const bench_family bench_arithmetic = {"arithmetic",     parts,
                                       ARITHMETIC_PARTS, sizeof arithmetic / sizeof arithmetic[0],
                                       arithmetic_text,  run_arithmetic};
const bench_family bench_upload = {"upload",    upload_parts, 1, sizeof uploads / sizeof uploads[0],
                                   upload_text, run_upload};
const bench_family bench_voxels = {
    "voxels", voxel_parts, NETWORK_PARTS, sizeof voxels / sizeof voxels[0], voxel_text, run_voxels};
