/* See timing.h. */
#include "peers/timing.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/rng.h"

enum { REPEATS = 5 };

cln_status bench_run(bench_body *body, void *context, double budget, bench_time *out)
{
    cln_status st = CLN_OK;
    double times[REPEATS], start = 0, probe = 0;

    CLN_TRY(body(context));
    start = cln_now();
    CLN_TRY(body(context));
    probe = cln_now() - start;
    out->calls = probe > 0 ? (int)(budget / REPEATS / probe) : 1;
    out->calls = out->calls < 1 ? 1 : out->calls;
    for (int r = 0; r < REPEATS; r++) {
        start = cln_now();
        for (int i = 0; i < out->calls; i++)
            CLN_TRY(body(context));
        times[r] = (cln_now() - start) / out->calls;
    }
    cln_reals_sort(times, REPEATS);
    out->min = times[0];
    out->median = times[REPEATS / 2];
    out->max = times[REPEATS - 1];
done:
    return st;
}

typedef struct peak {
    cln_device *device;
    cl_kernel kernel;
    cln_buffer out;
    cl_int rounds;
    size_t groups, local;
} peak;

static cln_status peak_body(void *context)
{
    cln_status st = CLN_OK;
    peak *p = context;
    const cl_float factor = 0.999999f;

    CLN_TRY(CLN_LAUNCH(p->device, p->kernel, CLN_STAGE_OTHER, p->groups, p->local,
                       CLN_ARG(p->out.mem), CLN_ARG(factor), CLN_ARG(p->rounds)));
    CLN_TRY(cln_device_finish(p->device));
done:
    return st;
}

cln_status bench_peak(cln_device *device, double *flops)
{
    cln_status st = CLN_OK;
    const bool cpu = device->tune.ls == 1;
    peak p = {.device = device,
              .rounds = cpu ? 200000 : 20000,
              .groups = (size_t)device->info.compute_units * (cpu ? 8 : 32),
              .local = cpu ? 1 : 256};
    cln_program program = {0};
    bench_time time;
    char defines[32];

    snprintf(defines, sizeof defines, "#define VW %d\n", device->tune.vw);
    CLN_TRY(cln_program_build(device, "peak", defines, &program));
    CLN_TRY(cln_kernel_create(&program, "peak_fma", &p.kernel));
    CLN_TRY(cln_buffer_reserve(device, &p.out, p.groups * p.local * sizeof(float), "peak"));
    CLN_TRY(bench_run(peak_body, &p, 0.5, &time));
    *flops =
        2.0 * 12 * device->tune.vw * (double)p.rounds * (double)(p.groups * p.local) / time.min;
done:
    cln_kernel_free(&p.kernel);
    cln_program_free(&program);
    cln_buffer_free(device, &p.out);
    return st;
}

static cln_status put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(device, buffer, bytes, "bench"));
    CLN_TRY(cln_buffer_write(device, buffer, 0, data, bytes));
done:
    return st;
}

cln_status bench_fill_leaves(cln_pipeline *p, const cln_model *model, int leaves, int per_leaf,
                             uint32_t *slices, float (**origins)[4])
{
    cln_status st = CLN_OK;
    const size_t n = (size_t)leaves * (size_t)per_leaf;
    float(*o)[4] = NULL, (*d)[4] = NULL, *boxes = NULL;
    cln_sample *samples = NULL;

    CLN_TRY(cln_octree_boxes(&model->tree, &boxes));
    CLN_TRY(cln_alloc(&o, n, sizeof *o, "rays"));
    CLN_TRY(cln_alloc(&d, n, sizeof *d, "rays"));
    CLN_TRY(cln_alloc(&samples, n, sizeof *samples, "samples"));
    for (size_t i = 0; i < n; i++) {
        const int leaf = (int)(i * 7919 % (size_t)leaves); /* a prime: all leaves, mixed order */
        float u[4];

        cln_uniform4(1, CLN_STREAM_SCENE, 0, (uint32_t)i, 0, u);
        for (int a = 0; a < 3; a++)
            o[i][a] = boxes[4 * leaf + a] + u[a] * boxes[4 * leaf + 3];
        d[i][2] = 1;
        samples[i] = (cln_sample){.ray = (cln_u32)i, .slot = leaf};
    }
    CLN_TRY(put(p->device, &p->ray_o, o, n * sizeof *o));
    CLN_TRY(put(p->device, &p->ray_d, d, n * sizeof *d));
    CLN_TRY(put(p->device, &p->samples, samples, n * sizeof *samples));
    CLN_TRY(cln_stage_group(p, (uint32_t)n, slices));
    for (size_t i = 0; i < n; i++)
        for (int a = 0; a < 4; a++)
            d[i][a] = 1e-3f;
    CLN_TRY(put(p->device, &p->dout, d, n * sizeof *d));
    if (origins) {
        *origins = o;
        o = NULL;
    }
done:
    free(boxes);
    free(o);
    free(d);
    free(samples);
    return st;
}
