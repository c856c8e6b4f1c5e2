/* Ceilings, timing and comparison for the kernel benches. See bench.h. */
#include "bench.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/config.h"
#include "base/memory.h"
#include "base/number.h"
#include "device/tune.h"

enum { REPEATS = 5, LONG_REPEATS = 3, MORE_PROBES = 5, ROWS = 1024 };

/* ---- ceilings ---- */

/* Bytes of each buffer of the copy probe, more than the caches hold. */
static size_t copy_bytes(const bench *b)
{
    return (size_t)(b->usual.ls == 1 ? 64 : 256) << 20;
}

/* Builds the shapes of the FMA probe. The usual width is first; half of it needs fewer registers
 * for as many chains, twice of it fewer instructions. */
static cln_status build_probes(bench *b)
{
    static const struct {
        int numerator, denominator, chains; /* of the usual vector width */
    } shapes[BENCH_PROBES] = {{1, 1, 12}, {1, 1, 8},  {1, 1, 16}, {1, 1, 24},
                              {1, 2, 12}, {1, 2, 24}, {2, 1, 6},  {2, 1, 12}};
    cln_status st = CLN_OK;

    for (int i = 0; i < BENCH_PROBES; i++) {
        bench_probe *probe = &b->probes[b->probe_count];
        const int vw = b->usual.vw * shapes[i].numerator / shapes[i].denominator;
        char defines[64];

        if (vw < 1 || vw > 16)
            continue;
        probe->vw = vw;
        probe->chains = shapes[i].chains;
        b->probe_count++; /* before what may fail, for bench_close */
        snprintf(defines, sizeof defines, "#define VW %d\n#define CHAINS %d\n", vw, probe->chains);
        CLN_TRY(cln_program_build(b->device, "peak", defines, &probe->program));
        CLN_TRY(cln_kernel_create(&probe->program, "peak_fma", &probe->kernel));
    }
    CLN_TRY(cln_kernel_create(&b->probes[0].program, "peak_copy", &b->peak_copy));
done:
    return st;
}

/* Device seconds of all launches so far that count for no stage of the method. */
static double other_seconds(const bench *b)
{
    return b->device->stage_seconds[CLN_STAGE_OTHER];
}

/* Launches each probe once and raises *fma and *copy to the best rates. By events, like the rows:
 * the time of a launch itself would lower the ceiling. */
static cln_status probe_ceilings(bench *b, double *fma, double *copy)
{
    cln_status st = CLN_OK;
    const bool cpu = b->usual.ls == 1;
    const cl_float factor = 0.999999f;
    const size_t local = cpu ? 1 : 256;
    const size_t groups = (size_t)b->device->info.compute_units * (cpu ? 8 : 32);
    const size_t vector = (size_t)b->usual.vw * sizeof(float);
    const cl_int copies = cpu ? 2048 : 16;
    const size_t copy_groups = copy_bytes(b) / (vector * local * (size_t)copies);
    double before = 0;

    for (int i = 0; i < b->probe_count; i++) {
        const bench_probe *probe = &b->probes[i];
        const int width = probe->vw * probe->chains; /* floats in flight */
        const cl_int rounds = (cpu ? 1 << 25 : 1 << 18) / width;

        before = other_seconds(b);
        CLN_TRY(CLN_LAUNCH(b->device, probe->kernel, CLN_STAGE_OTHER, groups, local,
                           CLN_ARG(b->out.mem), CLN_ARG(factor), CLN_ARG(rounds)));
        CLN_TRY(cln_device_finish(b->device));
        *fma = fmax(*fma, 2.0 * width * (double)rounds * (double)(groups * local) /
                              (other_seconds(b) - before));
    }
    before = other_seconds(b);
    CLN_TRY(CLN_LAUNCH(b->device, b->peak_copy, CLN_STAGE_OTHER, copy_groups, local,
                       CLN_ARG(b->in.mem), CLN_ARG(b->out.mem), CLN_ARG(copies)));
    CLN_TRY(cln_device_finish(b->device));
    *copy = fmax(*copy, 2.0 * (double)(copy_groups * local * (size_t)copies * vector) /
                            (other_seconds(b) - before));
done:
    return st;
}

cln_status bench_open(bench *b, const cln_device_desc *desc)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_device_open(&(cln_device_desc){.spec = desc->spec, .kernel_dir = desc->kernel_dir},
                            &b->device));
    b->usual = b->device->tune;
    CLN_TRY(cln_tune_parse(desc->tune ? desc->tune : "", &b->device->tune));
    CLN_TRY(cln_alloc(&b->rows, ROWS, sizeof *b->rows, "rows"));
    CLN_TRY(build_probes(b));
    CLN_TRY(cln_buffer_reserve(b->device, &b->in, copy_bytes(b), "copy probe"));
    CLN_TRY(cln_buffer_reserve(b->device, &b->out, copy_bytes(b), "copy probe"));
    CLN_TRY(cln_buffer_zero(b->device, &b->in, copy_bytes(b)));
done:
    return st;
}

void bench_close(bench *b)
{
    cln_pipeline_free(&b->pipeline);
    cln_kernel_free(&b->peak_copy);
    for (int i = 0; i < b->probe_count; i++) {
        cln_kernel_free(&b->probes[i].kernel);
        cln_program_free(&b->probes[i].program);
    }
    if (b->device) {
        cln_buffer_free(b->device, &b->in);
        cln_buffer_free(b->device, &b->out);
    }
    cln_device_close(b->device);
    free(b->rows);
}

/* ---- pipelines ---- */

cln_status bench_small_config(cln_config *out)
{
    cln_status st = CLN_OK;

    memset(out, 0, sizeof *out); /* also clears padding: settings are compared as bytes */
    CLN_TRY(cln_config_preset("fast", out));
    out->width = out->view_width = 16;
    out->depth = out->bands = 2;
    out->view_bands = 1;
    out->level_at[0] = 0;
    out->min_leaf_samples = 1;
    out->roulette = 0; /* networks are timed on all samples */
done:
    return st;
}

cln_status bench_pipeline(bench *b, const cln_config *config, bool distortion, const char *tune,
                          cln_pipeline **out)
{
    cln_status st = CLN_OK;
    const cln_tune kept = b->device->tune;
    const bool exact = b->device->tune_exact;
    cln_tune wanted;
    cln_network net;
    char network[32], from[CLN_TUNE_FROM];

    *out = &b->pipeline;
    CLN_TRY(cln_network_layout(config, &net));
    cln_network_text(&net, network);
    cln_device_tune(b->device, network, &wanted, from);
    CLN_TRY(cln_tune_parse(tune ? tune : "", &wanted));
    if (b->pipeline.device && memcmp(config, &b->config, sizeof *config) == 0 &&
        memcmp(&wanted, &b->tune, sizeof wanted) == 0 && distortion == b->distortion)
        goto done;
    cln_pipeline_free(&b->pipeline);
    b->config = *config;
    b->tune = b->device->tune = wanted;
    b->device->tune_exact = true; /* exactly these, ignoring tuned rows */
    b->distortion = distortion;
    st = cln_pipeline_create(b->device, config,
                             &(cln_pipeline_facts){.lenses = distortion, .space = &cln_space_unit},
                             CLN_PROGRAMS_ALL, &b->pipeline);
    b->device->tune = kept;
    b->device->tune_exact = exact;
    CLN_TRY(st);
    b->pipeline.max_entries = (size_t)1 << 26;
done:
    return st;
}

cln_status bench_measuring(bench *b, cln_config *config, cln_pipeline **p)
{
    cln_status st = CLN_OK;

    CLN_TRY(bench_small_config(config));
    config->adaptive = true;
    config->density_weight = CLN_WEIGHT_MASK;
    config->n1 = 2;
    CLN_TRY(bench_pipeline(b, config, false, NULL, p));
done:
    return st;
}

/* ---- timing ---- */

/* Seconds of `calls` calls. */
static cln_status time_calls(bench *b, bench_body *body, bench_body *before, void *context,
                             cln_stage stage, int calls, double *seconds)
{
    cln_status st = CLN_OK;

    *seconds = 0;
    for (int i = 0; i < calls; i++) {
        double start = 0;

        if (before) {
            CLN_TRY(before(context));
            CLN_TRY(cln_device_finish(b->device));
        }
        start = stage < CLN_STAGES ? b->device->stage_seconds[stage] : cln_now();
        CLN_TRY(body(context));
        CLN_TRY(cln_device_finish(b->device));
        *seconds += (stage < CLN_STAGES ? b->device->stage_seconds[stage] : cln_now()) - start;
    }
done:
    return st;
}

static double fma_share(const bench_row *row)
{
    return row->work.flop / row->fma / row->time.min;
}

/* Fills the times of `row`, probing the ceilings around each series. A row above the FMA ceiling
 * gets further probes before that counts: the machine may have been slow in the earlier ones. */
static cln_status measure(bench *b, bench_body *body, bench_body *before, void *context,
                          cln_stage stage, bench_row *row)
{
    cln_status st = CLN_OK;
    double times[REPEATS], probed = 0;
    int calls = 1, repeats = REPEATS;

    CLN_TRY(probe_ceilings(b, &row->fma, &row->copy));
    CLN_TRY(time_calls(b, body, before, context, stage, 1, &probed));
    CLN_TRY(time_calls(b, body, before, context, stage, 1, &probed));
    if (probed > b->budget)
        repeats = LONG_REPEATS;
    else if (probed > 0)
        calls = (int)fmin(fmax(1, b->budget / REPEATS / probed), 100000);
    row->fma = row->copy = 0; /* warm-up */
    CLN_TRY(probe_ceilings(b, &row->fma, &row->copy));
    for (int r = 0; r < repeats; r++) {
        CLN_TRY(time_calls(b, body, before, context, stage, calls, &times[r]));
        CLN_TRY(probe_ceilings(b, &row->fma, &row->copy));
        times[r] /= calls;
    }
    cln_reals_sort(times, repeats);
    row->time = (bench_time){times[0], times[repeats / 2], times[repeats - 1]};
    for (int i = 0; i < MORE_PROBES && fma_share(row) > 1; i++)
        CLN_TRY(probe_ceilings(b, &row->fma, &row->copy));
    row->above = !(fma_share(row) <= BENCH_MOST_SHARE);
done:
    return st;
}

/* ---- comparison ---- */

void bench_compare(bench_errors *errors, const float *got, const double *want, size_t n,
                   double nmse, double worst)
{
    const cln_error e = cln_check_error(got, want, n);

    errors->compared += n;
    errors->nmse = fmax(errors->nmse, e.nmse);
    errors->worst = fmax(errors->worst, e.worst);
    errors->failed = errors->failed || !(e.nmse <= nmse && e.worst <= worst);
}

void bench_equal(bench_errors *errors, size_t wrong, size_t n)
{
    errors->compared += n;
    errors->exact = true;
    errors->failed = errors->failed || wrong > 0;
    if (wrong > 0)
        errors->nmse = errors->worst = (double)wrong / (double)(n ? n : 1);
}

/* ---- rows ---- */

void bench_name(const bench_family *family, int part, const char *shape, char out[BENCH_NAME])
{
    snprintf(out, BENCH_NAME, "%s/%s", family->parts[part].kernel, shape);
    for (char *c = out; *c; c++)
        *c = *c == ' ' ? '-' : *c;
}

cln_status bench_add(bench *b, int part, bench_body *body, bench_body *before, void *context,
                     cln_stage stage, bench_work work, const bench_errors *errors)
{
    cln_status st = CLN_OK;
    bench_row *row = &b->rows[b->row_count];

    CLN_ASSERT(b->row_count < ROWS);
    memset(row, 0, sizeof *row);
    row->family = b->family->name;
    row->kernel = b->family->parts[part].kernel;
    row->kernels = b->family->parts[part].kernels;
    memcpy(row->shape, b->shape, sizeof row->shape);
    bench_name(b->family, part, b->shape, row->name);
    row->work = work;
    row->errors = *errors;
    cln_tune_text(&b->pipeline.tune, row->tune);
    CLN_TRY(measure(b, body, before, context, stage, row));
    b->row_count++;
    b->report(b, row);
done:
    if (st != CLN_OK)
        cln_note("timing %s", row->name);
    return st;
}

bool bench_ok(const bench_row *row)
{
    return !row->errors.failed && !row->above;
}

double bench_share(const bench_row *row, const char **bound)
{
    const double compute = row->work.flop / row->fma, move = row->work.bytes / row->copy;

    *bound = compute > move ? "fma" : "copy";
    return fmax(compute, move) / row->time.min;
}
