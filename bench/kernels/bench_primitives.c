/* Scan, sort and grouping by leaf: discrete results, compared with those of plain loops. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "bench.h"
#include "device/cl_error.h"

static const bench_part scan_parts[] = {{"scan", "scan_sums scan_write"}};
static const bench_part sort_parts[] = {{"sort", "sort_count sort_scatter scan_sums scan_write"}};
static const bench_part sort64_parts[] = {
    {"sort64", "sort64_varying sort64_count sort64_scatter sort64_buckets scan_sums scan_write"}};
static const bench_part group_parts[] = {
    {"group", "group_keys group_bounds group_slice_counts group_slices sort_count sort_scatter "
              "scan_sums scan_write"}};

static uint32_t bits_of(uint32_t stream, uint32_t index)
{
    return (uint32_t)cln_check_uniform(stream, index, 0, 16777216);
}

static cln_status pipeline_of(bench *b, cln_pipeline **p)
{
    cln_status st = CLN_OK;
    cln_config config;

    CLN_TRY(bench_small_config(&config));
    config.stage1 = CLN_STAGE1_SPLAT; /* only splatting builds the 64-bit sort */
    config.n1 = 2;
    CLN_TRY(bench_pipeline(b, &config, false, NULL, p));
done:
    return st;
}

/* ---- scan ---- */

static const uint32_t scans[] = {1, 64, 4096, 1000000, 16000000};

typedef struct scan {
    cln_pipeline *p;
    uint32_t n;
    cln_buffer in, out;
} scan;

static cln_status scan_body(void *context)
{
    scan *s = context;

    return cln_stage_scan(s->p, &s->in, &s->out, s->n, CLN_STAGE_OTHER, NULL);
}

static cln_status run_scan(bench *b, int shape)
{
    cln_status st = CLN_OK;
    scan s = {.n = scans[shape]};
    bench_errors errors = {0};
    uint32_t *values = NULL, *got = NULL, sum = 0;
    size_t wrong = 0;

    CLN_TRY(pipeline_of(b, &s.p));
    CLN_TRY(cln_alloc(&values, s.n, sizeof *values, "bench"));
    CLN_TRY(cln_alloc(&got, (size_t)s.n + 1, sizeof *got, "bench"));
    for (uint32_t i = 0; i < s.n; i++)
        values[i] = bits_of(2, i) >> 16;
    CLN_TRY(cln_check_put(b->device, &s.in, values, s.n * sizeof *values));
    CLN_TRY(cln_check_spoil(b->device, &s.out, ((size_t)s.n + 1) * sizeof *got));
    CLN_TRY(scan_body(&s));
    CLN_TRY(cln_buffer_read(b->device, &s.out, 0, got, ((size_t)s.n + 1) * sizeof *got));
    for (uint32_t i = 0; i <= s.n; i++) {
        wrong += got[i] != sum;
        sum += i < s.n ? values[i] : 0;
    }
    bench_equal(&errors, wrong, (size_t)s.n + 1);
    CLN_TRY(bench_add(b, 0, scan_body, NULL, &s, CLN_STAGES, bench_work_scan(s.n), &errors));
done:
    cln_buffer_free(b->device, &s.in);
    cln_buffer_free(b->device, &s.out);
    free(values);
    free(got);
    return st;
}

static void scan_text(int shape, char out[64])
{
    snprintf(out, 64, "%u", scans[shape]);
}

const bench_family bench_scan = {"scan",    scan_parts, 1, sizeof scans / sizeof scans[0],
                                 scan_text, run_scan};

/* ---- sort ---- */

typedef struct sort_shape {
    uint32_t n;
    int bits;
} sort_shape;

/* 12 bits: the slots of 4,096 leaves; 48 bits: the lists of some views and a float. */
static const sort_shape sorts[] = {{1, 12}, {64, 12}, {4096, 12}, {1000000, 12}, {1000000, 32}};
static const sort_shape sorts64[] = {{1, 48}, {64, 48}, {4096, 48}, {1000000, 48}, {16000000, 48}};

typedef struct sort {
    cln_pipeline *p;
    sort_shape shape;
    bool wide;
    size_t key_bytes;
    cln_buffer start_keys, start_values; /* before sorting */
    cln_buffer keys[2], values[2];
} sort;

/* Restores the unsorted keys: sorting sorted ones takes a different time. */
static cln_status sort_before(void *context)
{
    cln_status st = CLN_OK;
    sort *s = context;
    cl_command_queue queue = s->p->device->queue;

    CLN_CL(clEnqueueCopyBuffer(queue, s->start_keys.mem, s->keys[0].mem, 0, 0,
                               s->shape.n * s->key_bytes, 0, NULL, NULL));
    CLN_CL(clEnqueueCopyBuffer(queue, s->start_values.mem, s->values[0].mem, 0, 0,
                               s->shape.n * sizeof(uint32_t), 0, NULL, NULL));
done:
    return st;
}

static cln_status sort_body(void *context)
{
    sort *s = context;

    return cln_stage_sort(s->p, s->keys, s->values, s->shape.n, s->shape.bits, s->wide,
                          CLN_STAGE_OTHER);
}

static cln_status check_sort(sort *s, const uint64_t *keys, bench_errors *errors)
{
    cln_status st = CLN_OK;
    cln_device *device = s->p->device;
    const uint32_t n = s->shape.n;
    uint64_t *got = NULL;
    uint32_t *narrow = NULL, *values = NULL, wrong = 0;

    CLN_TRY(cln_alloc(&got, n, sizeof *got, "bench"));
    CLN_TRY(cln_alloc(&narrow, n, sizeof *narrow, "bench"));
    CLN_TRY(cln_alloc(&values, n, sizeof *values, "bench"));
    CLN_TRY(sort_before(s));
    CLN_TRY(sort_body(s));
    CLN_TRY(
        cln_buffer_read(device, &s->keys[0], 0, s->wide ? (void *)got : narrow, n * s->key_bytes));
    CLN_TRY(cln_buffer_read(device, &s->values[0], 0, values, n * sizeof *values));
    for (uint32_t i = 0; i < n && !s->wide; i++)
        got[i] = narrow[i];
    CLN_TRY(cln_check_sorted(keys, got, values, n, &wrong));
    bench_equal(errors, wrong, n);
done:
    free(got);
    free(narrow);
    free(values);
    return st;
}

static cln_status run_sort_of(bench *b, sort_shape shape, bool wide)
{
    cln_status st = CLN_OK;
    const size_t n = shape.n, words = n * sizeof(uint32_t);
    sort s = {.shape = shape, .wide = wide, .key_bytes = wide ? 8 : 4};
    bench_errors errors = {0};
    uint64_t *keys = NULL;
    uint32_t *narrow = NULL, *values = NULL;

    CLN_TRY(pipeline_of(b, &s.p));
    CLN_TRY(cln_alloc(&keys, n, sizeof *keys, "bench"));
    CLN_TRY(cln_alloc(&narrow, n, sizeof *narrow, "bench"));
    CLN_TRY(cln_alloc(&values, n, sizeof *values, "bench"));
    for (uint32_t i = 0; i < shape.n; i++) {
        keys[i] = ((uint64_t)bits_of(3, i) << 24 | bits_of(4, i)) >> (48 - shape.bits);
        narrow[i] = (uint32_t)keys[i];
        values[i] = i;
    }
    CLN_TRY(cln_check_put(b->device, &s.start_keys, wide ? (void *)keys : narrow, n * s.key_bytes));
    CLN_TRY(cln_check_put(b->device, &s.start_values, values, words));
    for (int k = 0; k < 2; k++) {
        CLN_TRY(cln_buffer_reserve(b->device, &s.keys[k], n * s.key_bytes, "bench"));
        CLN_TRY(cln_buffer_reserve(b->device, &s.values[k], words, "bench"));
    }
    CLN_TRY(check_sort(&s, keys, &errors));
    CLN_TRY(bench_add(b, 0, sort_body, sort_before, &s, CLN_STAGES,
                      bench_work_sort((double)n, wide), &errors));
done:
    for (int k = 0; k < 2; k++) {
        cln_buffer_free(b->device, &s.keys[k]);
        cln_buffer_free(b->device, &s.values[k]);
    }
    cln_buffer_free(b->device, &s.start_keys);
    cln_buffer_free(b->device, &s.start_values);
    free(keys);
    free(narrow);
    free(values);
    return st;
}

static cln_status run_sort(bench *b, int shape)
{
    return run_sort_of(b, sorts[shape], false);
}

static cln_status run_sort64(bench *b, int shape)
{
    return run_sort_of(b, sorts64[shape], true);
}

static void sort_text(int shape, char out[64])
{
    snprintf(out, 64, "%u of %d bits", sorts[shape].n, sorts[shape].bits);
}

static void sort64_text(int shape, char out[64])
{
    snprintf(out, 64, "%u of %d bits", sorts64[shape].n, sorts64[shape].bits);
}

const bench_family bench_sort = {"sort",    sort_parts, 1, sizeof sorts / sizeof sorts[0],
                                 sort_text, run_sort};
const bench_family bench_sort64 = {"sort64",    sort64_parts, 1, sizeof sorts64 / sizeof sorts64[0],
                                   sort64_text, run_sort64};

/* ---- group ---- */

static const struct {
    uint32_t n;
    int level;
} groups[] = {{1, 0}, {64, 1}, {32768, 3}, {1000000, 4}};

typedef struct group {
    cln_pipeline *p;
    uint32_t n, slices;
} group;

static cln_status group_body(void *context)
{
    group *g = context;

    return cln_stage_group(g->p, g->n, &g->slices);
}

/* Samples must be in order of slot, then number; slices must cover every leaf's run in order. */
static cln_status check_group(group *g, const cln_sample *samples, bench_errors *errors)
{
    cln_status st = CLN_OK;
    cln_device *device = g->p->device;
    uint32_t *order = NULL, wrong = 0;
    uint64_t *keys = NULL, *got = NULL;
    cln_slice *slices = NULL;
    uint32_t at = 0;

    CLN_TRY(cln_alloc(&order, g->n, sizeof *order, "bench"));
    CLN_TRY(cln_alloc(&keys, g->n, sizeof *keys, "bench"));
    CLN_TRY(cln_alloc(&got, g->n, sizeof *got, "bench"));
    CLN_TRY(cln_stage_slices(g->p, &g->slices));
    CLN_TRY(cln_alloc(&slices, g->slices, sizeof *slices, "bench"));
    CLN_TRY(cln_buffer_read(device, &g->p->values[0], 0, order, g->n * sizeof *order));
    CLN_TRY(cln_buffer_read(device, &g->p->slices, 0, slices, g->slices * sizeof *slices));
    for (uint32_t i = 0; i < g->n; i++)
        keys[i] = (uint64_t)samples[i].slot;
    for (uint32_t i = 0; i < g->n; i++)
        got[i] = order[i] < g->n ? keys[order[i]] : UINT64_MAX;
    CLN_TRY(cln_check_sorted(keys, got, order, g->n, &wrong));
    for (uint32_t s = 0; s < g->slices; s++) {
        const bool short_slice = slices[s].count < (uint32_t)g->p->tune.sl;

        wrong += slices[s].start != at || slices[s].count < 1 || slices[s].count > g->n - at;
        for (uint32_t i = at; i < g->n && i < at + slices[s].count; i++)
            wrong += got[i] != (uint64_t)slices[s].slot;
        at += slices[s].count;
        wrong += short_slice && at < g->n && got[at] == (uint64_t)slices[s].slot;
    }
    wrong += at != g->n;
    bench_equal(errors, wrong, g->n + g->slices);
done:
    free(order);
    free(keys);
    free(got);
    free(slices);
    return st;
}

static cln_status run_group(bench *b, int shape)
{
    cln_status st = CLN_OK;
    group g = {.n = groups[shape].n};
    bench_errors errors = {0};
    cln_sample *samples = NULL;
    cln_model model = {0};
    cln_config config;

    CLN_TRY(pipeline_of(b, &g.p));
    config = g.p->config;
    config.start_level = groups[shape].level;
    CLN_TRY(cln_model_create(&config, &model));
    CLN_TRY(cln_pipeline_rebuild(g.p, model.tree.leaf_count));
    CLN_TRY(cln_pipeline_upload(g.p, &model, false));
    CLN_TRY(cln_alloc(&samples, g.n, sizeof *samples, "bench"));
    for (uint32_t i = 0; i < g.n; i++)
        samples[i].slot = (cln_i32)(bits_of(5, i) % (uint32_t)g.p->leaves);
    CLN_TRY(cln_pipeline_samples(g.p, samples, g.n));
    CLN_TRY(group_body(&g));
    CLN_TRY(check_group(&g, samples, &errors));
    CLN_TRY(bench_add(b, 0, group_body, NULL, &g, CLN_STAGES,
                      bench_work_group(g.n, g.p->leaves, g.slices), &errors));
done:
    cln_model_free(&model);
    free(samples);
    return st;
}

static void group_text(int shape, char out[64])
{
    snprintf(out, 64, "%u samples %d leaves", groups[shape].n, 1 << (3 * groups[shape].level));
}

const bench_family bench_group = {"group",    group_parts, 1, sizeof groups / sizeof groups[0],
                                  group_text, run_group};
