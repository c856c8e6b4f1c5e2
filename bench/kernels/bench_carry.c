/* A change of the tree on the device: rows of all leaves move from their old slots to their new
 * ones. The timed change keeps every leaf: it can be repeated, and the host folds nothing. The rows
 * must arrive bit for bit. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "bench.h"
#include "pipeline/carry.h"

static const bench_part parts[] = {{"carry_rows", "carry_rows carry_densities"}};
static const bench_part voxel_parts[] = {
    {"voxel_join", "carry_rows carry_densities voxel_split voxel_join"}};
static const int levels[] = {0, 1, 3, 4};
enum { VOXEL_LEVEL = 3 };

typedef struct carry {
    cln_pipeline *p;
    cln_model model;
    cln_octree_change change;
} carry;

static cln_status body(void *context)
{
    const carry *c = context;

    return cln_pipeline_carry(c->p, &c->model.tree, &c->change);
}

/* With voxels every other leaf is new, half of these begun anew and half of them a child; they take
 * their neighbours' numbers at shared vertices. */
static cln_status start(bench *b, const char *preset, int level, carry *c)
{
    cln_status st = CLN_OK;
    cln_config config;

    CLN_TRY(cln_config_preset(preset, &config));
    config.start_level = level;
    CLN_TRY(bench_pipeline(b, &config, false, NULL, &c->p));
    CLN_TRY(cln_model_create(&config, &c->model));
    c->change.count = c->model.tree.leaf_count;
    CLN_TRY(cln_alloc(&c->change.from, (size_t)c->change.count, sizeof *c->change.from, "bench"));
    CLN_TRY(
        cln_alloc(&c->change.octant, (size_t)c->change.count, sizeof *c->change.octant, "bench"));
    for (int i = 0; i < c->change.count; i++) {
        c->change.from[i] = i;
        c->change.octant[i] = CLN_COPIED;
        if (config.encoding == CLN_ENCODING_VOXEL && i % 2)
            c->change.octant[i] = i % 4 == 1 ? CLN_FRESH : (int8_t)(i / 4 % 8);
    }
done:
    return st;
}

static cln_status run_level(bench *b, const char *preset, int level)
{
    cln_status st = CLN_OK;
    carry c = {0};
    bench_errors errors = {0};
    size_t count = 0, wrong = 0;
    float *want = NULL;

    CLN_TRY(start(b, preset, level, &c));
    count = (size_t)c.change.count * (size_t)c.model.net.params;
    for (size_t i = 0; i < count; i++)
        c.model.params[i] = (float)cln_check_uniform(61, (uint32_t)i, -1, 1);
    CLN_TRY(cln_alloc(&want, count, sizeof *want, "bench"));
    CLN_TRY(cln_pipeline_rebuild(c.p, c.change.count));
    CLN_TRY(cln_pipeline_upload(c.p, &c.model, true));
    CLN_TRY(cln_model_apply(&c.model, &c.change)); /* the host's twin */
    memcpy(want, c.model.params, count * sizeof *want);
    CLN_TRY(body(&c));
    CLN_TRY(cln_pipeline_download(c.p, &c.model, true));
    for (size_t i = 0; i < count; i++)
        wrong += c.model.params[i] != want[i];
    bench_equal(&errors, wrong, count);
    CLN_TRY(bench_add(b, 0, body, NULL, &c, CLN_STAGE_STRUCTURE,
                      bench_work_carry(&c.p->config, &c.p->net, c.change.count), &errors));
done:
    cln_octree_change_free(&c.change);
    cln_model_free(&c.model);
    free(want);
    return st;
}

static cln_status run(bench *b, int shape)
{
    return run_level(b, "fast", levels[shape]);
}

static cln_status run_voxels(bench *b, int shape)
{
    (void)shape;
    return run_level(b, "voxel", VOXEL_LEVEL);
}

static void text(int shape, char out[64])
{
    snprintf(out, 64, "%d leaves", 1 << (3 * levels[shape]));
}

const bench_family bench_carry = {"carry", parts, 1, sizeof levels / sizeof levels[0], text, run};

static void voxel_text(int shape, char out[64])
{
    (void)shape;
    snprintf(out, 64, "%d leaves", 1 << (3 * VOXEL_LEVEL));
}

const bench_family bench_carry_voxels = {"carry_voxels", voxel_parts, 1, 1, voxel_text, run_voxels};
