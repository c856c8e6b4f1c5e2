/* Self-test of what the structure optimisation needs of a device: sums of measures over leaves, and the
 * gradient that merged leaves learn by. See selftest_checks.h. */
#include "engine/selftest_checks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

enum { SAMPLES = 999, ROUNDS = 3 };

typedef struct data {
    cln_sample samples[SAMPLES];
    float numbers[SAMPLES * CLN_MEASURES], out[SAMPLES][4], targets[SAMPLES][4], dout[SAMPLES][4];
    float losses[SAMPLES], got[SAMPLES * 4];
    double want[SAMPLES * 4], want_losses[SAMPLES];
} data;

/* Three steps' measures, the samples in all leaves but one. */
static cln_status check_sums(cln_checks *c, data *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int numbers = cln_pipeline_measures(&p->config), leaves = p->leaves;
    float *sums = NULL;
    int32_t *met = NULL;
    uint32_t slices = 0;
    bool counted = true;

    CLN_TRY(cln_alloc(&sums, (size_t)leaves * CLN_MEASURES * 2, sizeof *sums, "self-test"));
    CLN_TRY(cln_alloc(&met, (size_t)leaves, sizeof *met, "self-test"));
    memset(d->want, 0, sizeof d->want);
    for (int i = 0; i < SAMPLES; i++)
        d->samples[i] = (cln_sample){.slot = i * 7 % (leaves - 1)};
    for (int i = 0; i < SAMPLES * numbers; i++) {
        d->numbers[i] = (float)pow(10, cln_check_uniform(31, (uint32_t)i, -6, 0));
        d->want[d->samples[i / numbers].slot] +=
            i % numbers == 0 ? ROUNDS * (double)d->numbers[i] : 0;
    }
    CLN_TRY(cln_check_put(p->device, &p->samples, d->samples, sizeof d->samples));
    CLN_TRY(cln_check_put(p->device, &p->measures, d->numbers,
                          SAMPLES * (size_t)numbers * sizeof *d->numbers));
    CLN_TRY(cln_stage_group(p, SAMPLES, &slices));
    CLN_TRY(cln_stage_measure_reset(p));
    for (int i = 0; i < ROUNDS; i++)
        CLN_TRY(cln_stage_measure(p, SAMPLES));
    CLN_TRY(cln_buffer_read(p->device, &p->leaf_sums, 0, sums,
                            (size_t)leaves * CLN_MEASURES * 2 * sizeof *sums));
    CLN_TRY(cln_buffer_read(p->device, &p->leaf_met, 0, met, (size_t)leaves * sizeof *met));
    for (int i = 0; i < leaves; i++) {
        int samples = 0;

        for (int s = 0; s < SAMPLES; s++)
            samples += d->samples[s].slot == i;
        counted = counted && met[i] == ROUNDS * samples;
        d->got[i] = sums[(size_t)i * CLN_MEASURES * 2];
    }
    cln_check_say(c, "samples of leaves", counted, "%d leaves", leaves);
    cln_check_compare(c, "measures of leaves", d->got, d->want, (size_t)leaves, 1e-11, 1e-5);
done:
    free(sums);
    free(met);
    return st;
}

static cln_status check_distil(cln_checks *c, data *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;

    for (uint32_t i = 0; i < SAMPLES; i++) {
        const double delta = cln_check_uniform(32, i, 0.01, 0.1);
        const double depth = i % 9 == 0 ? 0 : pow(10, cln_check_uniform(33, i, -6, 1));

        d->samples[i] = (cln_sample){.delta = (float)delta, .ray = i * 5 % SAMPLES};
        for (uint32_t k = 0; k < 4; k++) {
            d->out[i][k] = (float)cln_check_uniform(34, 4 * i + k, 0, 1);
            d->targets[i][k] = (float)cln_check_uniform(35, 4 * i + k, 0, 1);
        }
        d->out[i][3] = (float)(depth / delta);
    }
    for (uint32_t i = 0; i < SAMPLES; i++) {
        const float *target = d->targets[d->samples[i].ray], *out = d->out[i];
        double wide_out[4], wide_target[4];

        for (int k = 0; k < 4; k++) {
            wide_out[k] = out[k];
            wide_target[k] = target[k];
        }
        d->want_losses[i] =
            ref_distil(wide_out, wide_target, d->samples[i].delta, d->want + 4 * (size_t)i);
    }
    CLN_TRY(cln_check_put(p->device, &p->samples, d->samples, sizeof d->samples));
    CLN_TRY(cln_check_put(p->device, &p->out, d->out, sizeof d->out));
    CLN_TRY(cln_check_put(p->device, &p->targets, d->targets, sizeof d->targets));
    CLN_TRY(cln_check_spoil(p->device, &p->dout, sizeof d->dout));
    CLN_TRY(cln_check_spoil(p->device, &p->losses, sizeof d->losses));
    CLN_TRY(cln_stage_distil_gradient(p, SAMPLES, 1));
    CLN_TRY(cln_buffer_read(p->device, &p->dout, 0, d->got, sizeof d->dout));
    CLN_TRY(cln_buffer_read(p->device, &p->losses, 0, d->losses, sizeof d->losses));
    cln_check_compare(c, "distillation loss", d->losses, d->want_losses, SAMPLES, 1e-10, 1e-4);
    cln_check_compare(c, "distillation backward", d->got, d->want, (size_t)SAMPLES * 4, 1e-9, 1e-3);
done:
    return st;
}

cln_status cln_check_structure(cln_checks *c)
{
    cln_status st = CLN_OK;
    data *d = NULL;

    CLN_TRY(cln_alloc(&d, 1, sizeof *d, "self-test"));
    CLN_TRY(check_sums(c, d));
    CLN_TRY(check_distil(c, d));
done:
    free(d);
    return st;
}
