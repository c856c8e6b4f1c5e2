/* Checks on the volume instead of rays: sums over leaves, the gradient of distillation, and the
 * regularisers' points. See selftest_checks.h. */
#include "check/selftest_checks.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"
#include "reference/reference.h"

enum { SAMPLES = 999, ROUNDS = 3 };

typedef struct data {
    cln_sample samples[SAMPLES];
    float numbers[SAMPLES * CLN_MEASURES], out[SAMPLES][4], targets[SAMPLES][4], dout[SAMPLES][4];
    float losses[SAMPLES], got[SAMPLES * 4];
    double want[SAMPLES * 4], want_losses[SAMPLES];
} data;

/* Checks the sums of three steps' measures, with samples in all leaves but one. */
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
    cln_check_numbers(c, "samples of leaves", (const uint32_t *)met, (size_t)leaves);
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

/* Checks which cells the first camera of cln_check_rays sees, and mean and peak of their
 * densities. */
static cln_status check_stats(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int n1 = p->config.n1, cells = n1 * n1 * n1, leaves = p->leaves;
    const size_t all = (size_t)(leaves * cells);
    uint16_t *density = NULL;
    uint8_t *seen = NULL;
    uint32_t *numbers = NULL;
    float *got = NULL;
    double *want = NULL;
    int visible = 0;

    CLN_TRY(cln_alloc(&density, all, sizeof *density, "self-test"));
    CLN_TRY(cln_alloc(&seen, all, sizeof *seen, "self-test"));
    CLN_TRY(cln_alloc(&numbers, all, sizeof *numbers, "self-test"));
    CLN_TRY(cln_alloc(&got, 2 * (size_t)leaves, sizeof *got, "self-test"));
    CLN_TRY(cln_alloc(&want, 2 * (size_t)leaves, sizeof *want, "self-test"));
    p->training_views = 1;
    CLN_TRY(cln_check_spoil(p->device, &p->seen, all));
    CLN_TRY(cln_stage_seen(p));
    CLN_TRY(cln_stage_stats(p, got));
    CLN_TRY(cln_buffer_read(p->device, &p->density, 0, density, all * sizeof *density));
    CLN_TRY(cln_buffer_read(p->device, &p->seen, 0, seen, all));
    for (int s = 0; s < leaves; s++) {
        int count = 0;

        for (int i = s * cells; i < (s + 1) * cells; i++) {
            const double sigma = seen[i] ? ref_from_bf16(density[i]) : 0;

            numbers[i] = seen[i];
            count += seen[i] != 0;
            want[2 * s] += sigma;
            want[2 * s + 1] = fmax(want[2 * s + 1], sigma);
        }
        want[2 * s] /= count > 0 ? count : 1;
        visible += count;
    }
    cln_check_say(c, "cells that are seen", visible > 0 && visible < (int)all, "%d of %zu", visible,
                  all);
    cln_check_numbers(c, "cells that are seen", numbers, all);
    cln_check_compare(c, "densities of leaves", got, want, 2 * (size_t)leaves, 1e-12, 1e-5);
done:
    free(density);
    free(seen);
    free(numbers);
    free(got);
    free(want);
    return st;
}

/* ---- regularisers ---- */

typedef struct pairs {
    int points, pairs, extra; /* samples: points, one side of each pair, the other */
    cln_sample *samples;
    float (*boxes)[4], (*places)[4], (*out)[4], *got;
    double *want;
} pairs;

/* The analytic derivatives: of a point, 0.05 lambda exp(-0.05 sigma) / points; of a pair, that of
 * lambda U |f_a - f_b| / 4 with f = (1 - exp(-x)) (r, g, b, 1), x = density times cell side. */
static void differentiate(const cln_checks *c, const cln_sampling *s, const pairs *d)
{
    const cln_config *config = &c->p->config;

    for (int i = 0; i < d->points; i++)
        d->want[4 * i + 3] =
            config->sparsity * 0.05 * exp(-0.05 * (double)d->out[i][3]) / d->points;
    for (int i = d->points; i < d->points + d->pairs; i++) {
        const int at[2] = {i, i + d->pairs};
        const double side = fmin((double)d->boxes[d->samples[at[0]].slot][3],
                                 (double)d->boxes[d->samples[at[1]].slot][3]);
        const double cell = side / config->n1;
        double f[2][4];
        float u[4];

        cln_uniform4(s->seed, CLN_STREAM_POINTS, s->step, (uint32_t)i, 1, u);
        for (int b = 0; b < 2; b++)
            for (int k = 0; k < 4; k++)
                f[b][k] = -expm1(-cell * d->out[at[b]][3]) * (k < 3 ? d->out[at[b]][k] : 1);
        for (int b = 0; b < 2; b++)
            for (int k = 0; k < 4; k++) {
                const double weight = config->edge * u[3] / 4 / d->pairs;
                const double off = f[b][k] - f[1 - b][k], g = off > 0 ? weight : -weight;
                const double through = exp(-cell * d->out[at[b]][3]);

                if (off == 0)
                    continue;
                d->want[4 * at[b] + 3] += cell * through * g * (k < 3 ? d->out[at[b]][k] : 1);
                if (k < 3)
                    d->want[4 * at[b] + k] = g * (1 - through);
            }
    }
}

/* Checks that points and pairs lie in their samples' leaves; outputs them, to compare devices. */
static cln_status check_places(cln_checks *c, const cln_sampling *s, pairs *d)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const size_t rays = (size_t)(d->points + d->pairs), all = (size_t)d->extra;
    uint32_t samples = 0, *numbers = NULL;
    int wrong = 0;

    CLN_TRY(cln_alloc(&numbers, all, sizeof *numbers, "self-test"));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_o, rays * sizeof *d->places));
    CLN_TRY(cln_check_spoil(p->device, &p->ray_d, rays * sizeof *d->places));
    CLN_TRY(cln_check_spoil(p->device, &p->samples, all * sizeof *d->samples));
    CLN_TRY(cln_stage_regularise(p, s, 0, &samples));
    CLN_TRY(cln_buffer_read(p->device, &p->ray_o, 0, d->places, rays * sizeof *d->places));
    CLN_TRY(cln_buffer_read(p->device, &p->samples, 0, d->samples, all * sizeof *d->samples));
    for (size_t i = 0; i < all; i++) {
        const cln_sample *sample = &d->samples[i];
        const bool inside = sample->slot >= 0 && sample->slot < p->leaves && sample->ray < rays;

        for (int a = 0; inside && a < 3; a++) {
            const double part = ((double)d->places[sample->ray][a] - d->boxes[sample->slot][a]) /
                                d->boxes[sample->slot][3];

            wrong += !(part > -1e-5 && part < 1 + 1e-5);
        }
        wrong += !inside;
        numbers[i] = (uint32_t)sample->slot;
    }
    cln_check_say(c, "points of the volume", wrong == 0 && samples == all,
                  "%d of %u outside their leaves", wrong, samples);
    cln_check_numbers(c, "points of the volume: leaves", numbers, all);
    cln_check_values(c, "points of the volume: places", d->places[0], 4 * rays, 1e-12, 1e-5);
    if (wrong > 0)
        d->extra = 0; /* slots are not valid indices */
done:
    free(numbers);
    return st;
}

static cln_status check_regularisers(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const cln_sampling s = {.jitter = true, .seed = 5, .step = 9, .max_samples = 1 << 20};
    pairs d = {.extra = cln_pipeline_extra_samples(p)};

    d.pairs = d.extra - cln_pipeline_extra_rays(p);
    d.points = d.extra - 2 * d.pairs;
    CLN_TRY(cln_octree_boxes(&c->model->tree, (float **)&d.boxes));
    CLN_TRY(cln_alloc(&d.samples, (size_t)d.extra, sizeof *d.samples, "self-test"));
    CLN_TRY(cln_alloc(&d.places, (size_t)d.extra, sizeof *d.places, "self-test"));
    CLN_TRY(cln_alloc(&d.out, (size_t)d.extra, sizeof *d.out, "self-test"));
    CLN_TRY(cln_alloc(&d.got, (size_t)d.extra, sizeof *d.out, "self-test"));
    CLN_TRY(cln_alloc(&d.want, (size_t)d.extra * 4, sizeof *d.want, "self-test"));
    CLN_TRY(check_places(c, &s, &d));
    for (int i = 0; i < 4 * d.extra; i++)
        d.out[i / 4][i % 4] = (float)cln_check_uniform(36, (uint32_t)i, 0, i % 4 == 3 ? 20 : 1);
    CLN_TRY(cln_check_put(p->device, &p->out, d.out, (size_t)d.extra * sizeof *d.out));
    CLN_TRY(cln_check_spoil(p->device, &p->dout, (size_t)d.extra * sizeof *d.out));
    if (d.extra > 0) {
        CLN_TRY(cln_stage_regularise_gradient(p, &s, (uint32_t)d.extra));
        CLN_TRY(cln_buffer_read(p->device, &p->dout, 0, d.got, (size_t)d.extra * sizeof *d.out));
        differentiate(c, &s, &d);
        cln_check_compare(c, "regularisers backward", d.got, d.want, 4 * (size_t)d.extra, 1e-9,
                          1e-3);
    }
done:
    free(d.boxes);
    free(d.samples);
    free(d.places);
    free(d.out);
    free(d.got);
    free(d.want);
    return st;
}

cln_status cln_check_structure(cln_checks *c)
{
    cln_status st = CLN_OK;
    data *d = NULL;

    CLN_TRY(check_stats(c));
    CLN_TRY(cln_alloc(&d, 1, sizeof *d, "self-test"));
    CLN_TRY(check_sums(c, d));
    CLN_TRY(check_distil(c, d));
    if (cln_pipeline_extra_samples(c->p) > 0)
        CLN_TRY(check_regularisers(c));
done:
    free(d);
    return st;
}
