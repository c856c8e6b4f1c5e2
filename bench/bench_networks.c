/* Leaf networks: forward and training (forward + backward + Adam) as a share of the FMA ceiling measured in
 * the same run, for several shapes, leaves and samples per leaf. Prints a table and appends one CSV row per
 * case to the file given as second argument.
 *
 *   build/bench-networks [DEVICE [CSV [TUNE [CASE [KERNEL_DIR]]]]]     "" or - leaves one out
 *
 * FLOP counted: 2 per weight and sample forward, twice that again backward, less the input gradient of the
 * encodings, which nobody needs. Padding, encodings and activations are not counted. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/config.h"
#include "base/memory.h"
#include "base/rng.h"
#include "bench.h"

static const struct {
    int width, depth, view, bands, view_bands, level, samples;
} cases[] = {
    {16, 2, 16, 4, 1, 3, 128},   {32, 3, 32, 6, 2, 3, 128},   {32, 3, 32, 6, 2, 4, 16},
    {32, 3, 32, 6, 2, 4, 48},    {32, 3, 32, 6, 2, 3, 512},   {64, 4, 64, 6, 2, 2, 1536},
    {64, 8, 64, 10, 4, 2, 1536}, {64, 8, 256, 10, 4, 2, 512}, {128, 4, 128, 10, 4, 1, 1536},
};

typedef struct bench {
    cln_pipeline p;
    uint32_t samples, slices;
    bool training;
} bench;

static cln_status body(void *context)
{
    cln_status st = CLN_OK;
    bench *b = context;

    CLN_TRY(cln_stage_forward(&b->p, b->samples, b->slices, b->training, 1));
    if (b->training)
        CLN_TRY(cln_stage_backward(&b->p, b->slices, 1));
    CLN_TRY(cln_device_finish(b->p.device));
done:
    return st;
}

static cln_status adam_body(void *context)
{
    cln_status st = CLN_OK;
    bench *b = context;

    CLN_TRY(cln_stage_adam(&b->p, 1e-9));
    CLN_TRY(cln_device_finish(b->p.device));
done:
    return st;
}

/* `per_leaf` samples at random places of every leaf, in random order, on as many rays. */
static cln_status fill(bench *b, const cln_model *model, int per_leaf)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = &b->p;
    const size_t n = (size_t)p->leaves * (size_t)per_leaf, vector = 4 * sizeof(float);
    float(*o)[4] = NULL, (*d)[4] = NULL, *boxes = NULL;
    cln_sample *samples = NULL;

    b->samples = (uint32_t)n;
    CLN_TRY(cln_octree_boxes(&model->tree, &boxes));
    CLN_TRY(cln_alloc(&o, n, sizeof *o, "rays"));
    CLN_TRY(cln_alloc(&d, n, sizeof *d, "rays"));
    CLN_TRY(cln_alloc(&samples, n, sizeof *samples, "samples"));
    for (size_t i = 0; i < n; i++) {
        const int leaf = (int)(i * 7919 % (size_t)p->leaves);
        float u[4];

        cln_uniform4(1, CLN_STREAM_SCENE, 0, (uint32_t)i, 0, u);
        for (int a = 0; a < 3; a++)
            o[i][a] = boxes[4 * leaf + a] + u[a] * boxes[4 * leaf + 3];
        d[i][2] = 1;
        samples[i] = (cln_sample){.ray = (cln_u32)i, .slot = leaf};
    }
    CLN_TRY(cln_buffer_reserve(p->device, &p->ray_o, n * vector, "rays"));
    CLN_TRY(cln_buffer_reserve(p->device, &p->ray_d, n * vector, "rays"));
    CLN_TRY(cln_buffer_reserve(p->device, &p->samples, n * sizeof *samples, "samples"));
    CLN_TRY(cln_buffer_write(p->device, &p->ray_o, 0, o, n * vector));
    CLN_TRY(cln_buffer_write(p->device, &p->ray_d, 0, d, n * vector));
    CLN_TRY(cln_buffer_write(p->device, &p->samples, 0, samples, n * sizeof *samples));
    CLN_TRY(cln_stage_group(p, b->samples, &b->slices));
    CLN_TRY(cln_buffer_reserve(p->device, &p->dout, n * vector, "gradients"));
    for (size_t i = 0; i < n; i++)
        for (int a = 0; a < 4; a++)
            o[i][a] = 1e-3f;
    CLN_TRY(cln_buffer_write(p->device, &p->dout, 0, o, n * vector));
done:
    free(boxes);
    free(o);
    free(d);
    free(samples);
    return st;
}

static cln_status run(cln_device *device, int number, double peak, FILE *csv)
{
    cln_status st = CLN_OK;
    bench b;
    cln_config config;
    cln_model model = {0};
    bench_time forward, train, adam;
    double flop = 0, free_flop = 0;
    char tune[256];

    memset(&b, 0, sizeof b);
    CLN_TRY(cln_config_preset("fast", &config));
    config.width = cases[number].width;
    config.depth = cases[number].depth;
    config.view_width = cases[number].view;
    config.bands = cases[number].bands;
    config.view_bands = cases[number].view_bands;
    config.start_level = cases[number].level;
    config.level_at[0] = 0;
    config.min_leaf_samples = 1;
    CLN_TRY(cln_model_create(&config, &model));
    CLN_TRY(cln_pipeline_create(device, &config, false, false, &b.p));
    CLN_TRY(cln_pipeline_upload(&b.p, &model, true));
    CLN_TRY(fill(&b, &model, cases[number].samples));
    CLN_TRY(bench_run(body, &b, 0.5, &forward));
    b.training = true;
    CLN_TRY(bench_run(body, &b, 0.5, &train));
    CLN_TRY(bench_run(adam_body, &b, 0.2, &adam));
    flop = 2.0 * b.p.net.learned * b.samples;
    free_flop = 2.0 * b.samples * (b.p.net.enc * b.p.net.width + b.p.net.dir * b.p.net.view_width);
    printf("W%d-D%d-V%d L%d/%d %6d leaves x %5d | forward %6.1f GFLOP/s %5.1f %% %6.2f M/s | train "
           "%6.1f GFLOP/s %5.1f %% %6.2f M/s | adam %.2f ms\n",
           config.width, config.depth, config.view_width, config.bands, config.view_bands,
           b.p.leaves, cases[number].samples, flop / forward.min * 1e-9,
           100 * flop / forward.min / peak, b.samples / forward.min * 1e-6,
           (3 * flop - free_flop) / train.min * 1e-9,
           100 * (3 * flop - free_flop) / train.min / peak, b.samples / train.min * 1e-6,
           adam.min * 1e3);
    fflush(stdout);
    cln_tune_text(&b.p.tune, tune);
    if (csv)
        fprintf(csv, "%s,%s,\"%s\",%d,%d,%d,%d,%d,%d,%d,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g\n",
                device->info.name, device->info.driver, tune, config.width, config.depth,
                config.view_width, config.bands, config.view_bands, b.p.leaves,
                cases[number].samples, peak, forward.min, forward.median, forward.max, train.min,
                train.median, train.max, adam.min);
done:
    cln_pipeline_free(&b.p);
    cln_model_free(&model);
    return st;
}

static const char *argument(int argc, char **argv, int i)
{
    return argc > i && argv[i][0] && strcmp(argv[i], "-") != 0 ? argv[i] : NULL;
}

int main(int argc, char **argv)
{
    cln_status st = CLN_OK;
    const cln_device_desc desc = {.spec = argument(argc, argv, 1),
                                  .tune = argument(argc, argv, 3),
                                  .kernel_dir = argument(argc, argv, 5)};
    cln_device *device = NULL;
    FILE *csv = argument(argc, argv, 2) ? fopen(argument(argc, argv, 2), "a") : NULL;
    double peak = 0;
    const int only = argument(argc, argv, 4) ? atoi(argument(argc, argv, 4)) : -1;

    CLN_TRY(cln_device_open(&desc, &device));
    for (int i = 0; i < (int)(sizeof cases / sizeof cases[0]); i++) {
        if (only >= 0 && i != only)
            continue;
        CLN_TRY(bench_peak(device, &peak));
        if (i == 0 || only >= 0)
            printf("%s: FMA ceiling %.0f GFLOP/s\n", device->info.name, peak * 1e-9);
        CLN_TRY(run(device, i, peak, csv));
    }
done:
    if (st != CLN_OK)
        fprintf(stderr, "bench-networks: %s\n", cln_error_text());
    if (csv)
        fclose(csv);
    cln_device_close(device);
    return cln_status_exit_code(st);
}
