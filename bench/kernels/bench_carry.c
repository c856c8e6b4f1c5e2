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
static const int levels[] = {0, 1, 3, 4};

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

/* The fast preset's networks. */
static cln_status start(bench *b, int level, carry *c)
{
    cln_status st = CLN_OK;
    cln_config config;

    CLN_TRY(cln_config_preset("fast", &config));
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
    }
done:
    return st;
}

static cln_status run(bench *b, int shape)
{
    cln_status st = CLN_OK;
    carry c = {0};
    bench_errors errors = {0};
    size_t count = 0, wrong = 0;
    float *before = NULL;

    CLN_TRY(start(b, levels[shape], &c));
    count = (size_t)c.change.count * (size_t)c.model.net.params;
    for (size_t i = 0; i < count; i++)
        c.model.params[i] = (float)cln_check_uniform(61, (uint32_t)i, -1, 1);
    CLN_TRY(cln_alloc(&before, count, sizeof *before, "bench"));
    memcpy(before, c.model.params, count * sizeof *before);
    CLN_TRY(cln_pipeline_rebuild(c.p, c.change.count));
    CLN_TRY(cln_pipeline_upload(c.p, &c.model, true));
    CLN_TRY(body(&c));
    CLN_TRY(cln_pipeline_download(c.p, &c.model, true));
    for (size_t i = 0; i < count; i++)
        wrong += c.model.params[i] != before[i];
    bench_equal(&errors, wrong, count);
    CLN_TRY(bench_add(b, 0, body, NULL, &c, CLN_STAGE_STRUCTURE,
                      bench_work_carry(&c.p->config, &c.p->net, c.change.count), &errors));
done:
    cln_octree_change_free(&c.change);
    cln_model_free(&c.model);
    free(before);
    return st;
}

static void text(int shape, char out[64])
{
    snprintf(out, 64, "%d leaves", 1 << (3 * levels[shape]));
}

const bench_family bench_carry = {"carry", parts, 1, sizeof levels / sizeof levels[0], text, run};
