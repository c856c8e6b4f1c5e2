/* Sums over leaves at extremes: mean and largest density of the cells that a view sees, sums of
 * measures over samples and steps, numbers of samples. See extremes.h. */
#include "check/extremes.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>

#include "base/memory.h"
#include "reference/reference.h"

enum { LEAVES = 8, SAMPLES = 999, STEPS = 2000 };

/* A float32 sum of n numbers, added one after the other: a twelfth of its worst case. */
static double bound_of(int n)
{
    return 1e-6 + 5e-9 * n;
}

/* ---- densities ---- */

static const char *const names[LEAVES] = {"no cell seen",
                                          "one cell seen",
                                          "equal ones",
                                          "the largest density",
                                          "1e-30 to 1e34",
                                          "faint ones",
                                          "half seen, others not a number",
                                          "one dense among faint"};

/* Density and visibility of a cell; densities that no view sees are not a number in leaf 6. */
static uint16_t density_of(int leaf, int cell, int cells, uint8_t *seen)
{
    const uint32_t i = (uint32_t)(leaf * cells + cell);
    double sigma = 0;

    *seen = leaf == 0 ? 0 : leaf == 1 ? cell == cells / 3 : leaf == 6 ? cell % 2 : 1;
    if (leaf == 6 && !*seen)
        return cell % 4 ? 0x7F80 : 0x7FFF;
    switch (leaf) {
    case 2:
        sigma = 1.05;
        break;
    case 3:
        sigma = 1e4 * exp(70);
        break;
    case 5:
        sigma = pow(10, cln_check_uniform(111, i, -36, -20));
        break;
    case 7:
        sigma = cell == cells - 1 ? 1e30 : 1e-3;
        break;
    default:
        sigma = pow(10, cln_check_uniform(111, i, -30, 34));
    }
    return ref_to_bf16((float)sigma);
}

static cln_status check_densities(cln_checks *c)
{
    static const char range[] = "densities 1e-36 to 2.5e34, one, half or none of the cells seen";
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int n1 = p->config.n1, cells = n1 * n1 * n1;
    const size_t all = (size_t)(LEAVES * cells);
    cln_extreme mean = cln_extreme_row(c, "mean density", range);
    cln_extreme peak = cln_extreme_row(c, "largest density", range);
    uint16_t *density = NULL;
    uint8_t *seen = NULL;
    float got[LEAVES * 2];

    CLN_TRY(cln_alloc(&density, all, sizeof *density, "self-test"));
    CLN_TRY(cln_alloc(&seen, all, sizeof *seen, "self-test"));
    for (int i = 0; i < (int)all; i++)
        density[i] = density_of(i / cells, i % cells, cells, &seen[i]);
    CLN_TRY(cln_check_put(p->device, &p->density, density, all * sizeof *density));
    CLN_TRY(cln_check_put(p->device, &p->seen, seen, all));
    CLN_TRY(cln_stage_stats(p, got));
    for (int s = 0; s < LEAVES; s++) {
        double sum = 0, most = 0;
        int count = 0;

        for (int i = s * cells; i < (s + 1) * cells; i++)
            if (seen[i]) {
                sum += ref_from_bf16(density[i]);
                most = fmax(most, ref_from_bf16(density[i]));
                count++;
            }
        sum /= count > 0 ? count : 1;
        cln_extreme_meet(&mean, got[2 * s], sum, sum, bound_of(count), "%s", names[s]);
        cln_extreme_meet(&peak, got[2 * s + 1], most, 1, 0, "%s", names[s]);
    }
    cln_extreme_report(&mean);
    cln_extreme_report(&peak);
done:
    free(density);
    free(seen);
    return st;
}

/* ---- measures ---- */

/* A large step, then many of which each is lost beside the sum. Leaf 7 has no sample. */
static double measure_of(int i, int numbers, bool later)
{
    const int leaf = i / numbers % (LEAVES - 1);

    return (later ? 3e-8 : 1) * pow(10, -30 + 10 * leaf) *
           cln_check_uniform(112 + later, (uint32_t)i, 0.1, 1);
}

static cln_status check_measures(cln_checks *c)
{
    static const char range[] = "1e-30 to 1e30, a large step and 2,000 of a share of 3e-8 of it";
    cln_status st = CLN_OK;
    cln_pipeline *p = c->p;
    const int numbers = cln_pipeline_measures(&p->config);
    const size_t bytes = SAMPLES * (size_t)numbers * sizeof(float);
    cln_extreme sums = cln_extreme_row(c, "measures", range);
    cln_extreme counts = cln_extreme_row(c, "samples", "up to 2^31 - 1, where they stay");
    cln_sample samples[SAMPLES];
    float values[SAMPLES * CLN_MEASURES], got[LEAVES][CLN_MEASURES][2];
    double want[LEAVES][CLN_MEASURES] = {{0}};
    int32_t met[LEAVES];
    int each[LEAVES] = {0};
    uint32_t slices = 0;

    for (int i = 0; i < SAMPLES; i++) {
        samples[i] = (cln_sample){.slot = i % (LEAVES - 1)};
        each[i % (LEAVES - 1)]++;
    }
    CLN_TRY(cln_check_put(p->device, &p->samples, samples, sizeof samples));
    CLN_TRY(cln_stage_group(p, SAMPLES, &slices));
    CLN_TRY(cln_check_spoil(p->device, &p->leaf_sums, sizeof got));
    CLN_TRY(cln_check_spoil(p->device, &p->leaf_met, sizeof met));
    CLN_TRY(cln_stage_measure_reset(p));
    for (int later = 0; later < 2; later++) {
        for (int i = 0; i < SAMPLES * numbers; i++) {
            values[i] = (float)measure_of(i, numbers, later);
            want[i / numbers % (LEAVES - 1)][i % numbers] +=
                (later ? STEPS : 1) * (double)values[i];
        }
        CLN_TRY(cln_check_put(p->device, &p->measures, values, bytes));
        for (int step = 0; step < (later ? STEPS : 1); step++)
            CLN_TRY(cln_stage_measure(p, SAMPLES));
    }
    CLN_TRY(cln_buffer_read(p->device, &p->leaf_sums, 0, got, sizeof got));
    CLN_TRY(cln_buffer_read(p->device, &p->leaf_met, 0, met, sizeof met));
    for (int s = 0; s < LEAVES; s++) {
        for (int q = 0; q < numbers; q++)
            cln_extreme_meet(&sums, got[s][q][0], want[s][q], want[s][q], bound_of(each[s]),
                             "leaf %d, measure %d", s, q);
        cln_extreme_meet(&counts, met[s], (1.0 + STEPS) * each[s], 1, 0, "leaf %d", s);
        met[s] = INT_MAX - 3;
    }
    CLN_TRY(cln_check_put(p->device, &p->leaf_met, met, sizeof met));
    CLN_TRY(cln_stage_measure(p, SAMPLES));
    CLN_TRY(cln_buffer_read(p->device, &p->leaf_met, 0, met, sizeof met));
    for (int s = 0; s < LEAVES; s++)
        cln_extreme_meet(&counts, met[s], each[s] > 0 ? INT_MAX : INT_MAX - 3, 1, 0,
                         "leaf %d, near 2^31", s);
    cln_extreme_report(&sums);
    cln_extreme_report(&counts);
done:
    return st;
}

cln_status cln_extremes_leaves(cln_checks *c)
{
    cln_status st = CLN_OK;
    cln_model model = {0};

    CLN_TRY(cln_model_create(&c->p->config, &model));
    CLN_ASSERT(model.tree.leaf_count == LEAVES);
    CLN_TRY(cln_pipeline_upload(c->p, &model, false));
    CLN_TRY(check_densities(c));
    CLN_TRY(check_measures(c));
done:
    cln_model_free(&model);
    return st;
}
