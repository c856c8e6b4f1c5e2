/* Measures of the structure optimisation, and the distillation of merged leaves: each sample's
 * share of its ray's error and its transmittance-weighted density (composite.cl), their sums over
 * leaves and steps (stats.cl) and the gradient of the distillation (distil.cl), each against
 * float64 code of this file. */
#include "unit.h"
#include "device_test.h"
#include "reference/reference.h"
#include "tests.h"

enum { RAYS = 97, MOST = 40, SAMPLES = RAYS * MOST };

static cln_config measuring_config(int weight)
{
    cln_config config = small_config();

    config.adaptive = true;
    config.density_weight = weight;
    return config;
}

/* Rays of 0 to MOST samples with densities over many orders of magnitude. */
typedef struct batch {
    uint32_t starts[RAYS + 1], samples;
    cln_sample sample[SAMPLES];
    float out[SAMPLES][4], targets[RAYS][4], background[4];
} batch;

static void make_batch(batch *b)
{
    uint32_t at = 0;

    memset(b, 0, sizeof *b);
    for (int k = 0; k < 3; k++)
        b->background[k] = 0.25f * (float)(k + 1);
    for (int r = 0; r < RAYS; r++) {
        const int n = r % 11 == 5 ? 0 : r % 7 == 0 ? 1 : 1 + r * 17 % MOST;

        b->starts[r] = at;
        for (int i = 0; i < n; i++, at++) {
            const double delta = pow(10, test_uniform(31, (int)at, -3, -1));
            const double depth = r % 5 == 0   ? 0
                                 : r % 5 == 1 ? 1e5
                                              : pow(10, test_uniform(32, (int)at, -9, 0.5));

            b->sample[at] = (cln_sample){.t = (float)i, .delta = (float)delta, .ray = (uint32_t)r};
            for (int k = 0; k < 3; k++)
                b->out[at][k] = (float)test_uniform(33, 3 * (int)at + k, 0, 1);
            b->out[at][3] = (float)(depth / delta);
        }
        for (int k = 0; k < 3; k++)
            b->targets[r][k] = (float)test_uniform(34, 3 * r + k, 0, 1);
    }
    b->starts[RAYS] = b->samples = at;
}

/* The three numbers of every sample of ray r, in double. */
static void measure_ray(const batch *b, int r, double (*want)[3])
{
    const uint32_t begin = b->starts[r], n = b->starts[r + 1] - begin;
    double out[MOST][4], delta[MOST], background[3], target[3];

    for (uint32_t i = 0; i < n; i++) {
        delta[i] = b->sample[begin + i].delta;
        for (int k = 0; k < 4; k++)
            out[i][k] = b->out[begin + i][k];
    }
    for (int k = 0; k < 3; k++) {
        background[k] = b->background[k];
        target[k] = b->targets[r][k];
    }
    ref_measures((int)n, (const double(*)[4])out, delta, background, target, want + begin);
}

static void check_shares(const tune_set *set, const batch *b, int weight)
{
    const cln_config config = measuring_config(weight);
    const uint32_t numbers = weight == CLN_WEIGHT_VISIBILITY ? 3 : 1;
    cln_pipeline *p = test_pipeline(set, &config, false, false);
    double(*want)[3] = test_alloc(b->samples, sizeof *want), *wide = NULL, sum = 0, all = 0;
    float *got = NULL, *narrow = test_alloc(b->samples, sizeof *narrow);
    cln_ray_result *results = NULL;

    test_fill(p->device, &p->sample_starts, b->starts, sizeof b->starts);
    test_fill(p->device, &p->samples, b->sample, b->samples * sizeof *b->sample);
    test_fill(p->device, &p->out, b->out, b->samples * sizeof *b->out);
    test_fill(p->device, &p->targets, b->targets, sizeof b->targets);
    test_fill(p->device, &p->backgrounds, b->background, sizeof b->background);
    test_fill(p->device, &p->results, NULL, RAYS * sizeof *results);
    test_fill(p->device, &p->dout, NULL, b->samples * sizeof *b->out);
    test_fill(p->device, &p->measures, NULL, b->samples * numbers * sizeof *got);
    assert_ok(cln_stage_composite_train(p, RAYS, b->samples));
    got = test_read(p->device, &p->measures, b->samples * numbers * sizeof *got, "measures");
    results = test_read(p->device, &p->results, RAYS * sizeof *results, "results");
    for (int r = 0; r < RAYS; r++)
        measure_ray(b, r, want);
    wide = test_alloc(b->samples, sizeof *wide);
    for (uint32_t q = 0; q < numbers; q++) {
        for (uint32_t i = 0; i < b->samples; i++) {
            narrow[i] = got[i * numbers + q];
            wide[i] = want[i][q];
        }
        compare(q == 0 ? "error shares" : "weighted densities", narrow, wide, b->samples,
                (bounds){1e-11, 1e-4});
    }
    /* the shares sum to the square error of all rays with samples */
    for (uint32_t i = 0; i < b->samples; i++)
        sum += got[i * numbers];
    for (int r = 0; r < RAYS; r++)
        all += b->starts[r + 1] > b->starts[r] ? results[r].square_error : 0;
    assert_true(fabs(sum - all) < 1e-5 * all);
    free(got);
    free(narrow);
    free(want);
    free(wide);
    free(results);
}

static void test_shares(void **state)
{
    batch *b = test_alloc(1, sizeof *b);

    (void)state;
    make_batch(b);
    for (int set = 0; set < TUNE_SETS; set++)
        check_shares(&tune_sets[set], b, set % 2 ? CLN_WEIGHT_VISIBILITY : CLN_WEIGHT_MASK);
    free(b);
    test_report("shares of the error");
}

/* Sums over leaves of no, one and many samples, over many steps; excludes regularisers' samples. */
static void check_sums(const tune_set *set)
{
    enum { LEAVES = 8, N = 700, COMPOSITED = 650, STEPS = 300 };
    const cln_config config = measuring_config(CLN_WEIGHT_VISIBILITY);
    cln_pipeline *p = test_pipeline(set, &config, false, false);
    cln_model model;
    cln_sample *samples = test_alloc(N, sizeof *samples);
    float(*numbers)[3] = test_alloc(N, sizeof *numbers), *sums = NULL, got[LEAVES * 3];
    double want[LEAVES][3] = {{0}};
    int32_t *met = NULL, want_met[LEAVES] = {0};
    uint32_t slices = 0;

    assert_ok(cln_model_create(&config, &model));
    assert_int_equal(model.tree.leaf_count, LEAVES);
    assert_ok(cln_pipeline_upload(p, &model, true));
    for (int i = 0; i < N; i++) {
        const int draw = (int)test_uniform(41, i, 0, 40);

        samples[i].slot = i == 17 ? 3 : draw < 4 ? draw % 2 : draw < 20 ? 5 : 6 + draw % 2;
        for (int q = 0; q < 3; q++) {
            numbers[i][q] = (float)pow(10, test_uniform(42, 3 * i + q, -6, 1));
            want[samples[i].slot][q] += i < COMPOSITED ? STEPS * (double)numbers[i][q] : 0;
        }
        want_met[samples[i].slot] += i < COMPOSITED ? STEPS : 0;
    }
    test_fill(p->device, &p->samples, samples, N * sizeof *samples);
    test_fill(p->device, &p->measures, numbers, N * sizeof *numbers);
    test_fill(p->device, &p->leaf_sums, NULL, LEAVES * 6 * sizeof(float));
    test_fill(p->device, &p->leaf_met, NULL, LEAVES * sizeof(int32_t));
    assert_ok(cln_stage_group(p, N, &slices));
    assert_ok(cln_stage_measure_reset(p));
    for (int i = 0; i < STEPS; i++)
        assert_ok(cln_stage_measure(p, COMPOSITED));
    sums = test_read(p->device, &p->leaf_sums, LEAVES * 6 * sizeof(float), "leaf_sums");
    met = test_read(p->device, &p->leaf_met, LEAVES * sizeof(int32_t), "leaf_met");
    for (int i = 0; i < LEAVES * 3; i++)
        got[i] = sums[2 * i];
    for (int i = 0; i < LEAVES; i++)
        assert_int_equal(met[i], want_met[i]);
    /* compensated: as accurate after 300 steps as after one */
    compare("sums of leaves", got, want[0], LEAVES * 3, (bounds){1e-12, 3e-6});
    free(samples);
    free(numbers);
    free(sums);
    free(met);
    cln_model_free(&model);
}

static void test_sums(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        check_sums(&tune_sets[set]);
    test_report("sums of leaves");
}

/* ---- distillation ---- */

static double distil_loss(const double out[4], const float target[4], double delta)
{
    const double miss = -expm1(-out[3] * delta) - target[3];
    double colour = 0;

    for (int k = 0; k < 3; k++)
        colour += (out[k] - target[k]) * (out[k] - target[k]) / 3;
    return miss * miss + target[3] * colour;
}

/* Central differences of the loss, four points; densities from nothing to far beyond opaque. */
static void check_distil(const tune_set *set)
{
    enum { N = 301 };
    const cln_config config = measuring_config(CLN_WEIGHT_MASK);
    const double scale = 0.125;
    cln_pipeline *p = test_pipeline(set, &config, false, false);
    cln_sample samples[N] = {{0}};
    float out[N][4], targets[N][4], *dout = NULL, *losses = NULL, density[N], colour[3 * N];
    double want_loss[N], want_colour[3 * N], want_density[N];

    for (int i = 0; i < N; i++) {
        samples[i].ray = (uint32_t)((i * 7) % N);
        samples[i].delta = (float)test_uniform(51, i, 0.01, 0.1);
        for (int k = 0; k < 3; k++) {
            out[i][k] = (float)test_uniform(52, 3 * i + k, 0, 1);
            targets[i][k] = (float)test_uniform(53, 3 * i + k, 0, 1);
        }
        out[i][3] =
            i % 10 == 0 ? 0.0f : (float)(pow(10, test_uniform(54, i, -6, 1)) / samples[i].delta);
        targets[i][3] = i % 6 == 0 ? 0.0f : (float)test_uniform(55, i, 0, 1);
    }
    for (int i = 0; i < N; i++) {
        const float *target = targets[samples[i].ray];
        const double at[4] = {out[i][0], out[i][1], out[i][2], out[i][3]};

        want_loss[i] = distil_loss(at, target, samples[i].delta);
        for (int k = 0; k < 4; k++) {
            const double h = k == 3 ? 1e-4 / samples[i].delta : 1e-4;
            double value[4], gradient = 0;
            static const double offset[4] = {-2, -1, 1, 2}, factor[4] = {1, -8, 8, -1};

            for (int s = 0; s < 4; s++) {
                memcpy(value, at, sizeof value);
                value[k] += offset[s] * h;
                gradient += factor[s] * distil_loss(value, target, samples[i].delta) / (12 * h);
            }
            if (k == 3)
                want_density[i] = scale * gradient;
            else
                want_colour[3 * i + k] = scale * gradient;
        }
    }
    test_fill(p->device, &p->samples, samples, sizeof samples);
    test_fill(p->device, &p->out, out, sizeof out);
    test_fill(p->device, &p->targets, targets, sizeof targets);
    test_fill(p->device, &p->dout, NULL, sizeof out);
    test_fill(p->device, &p->losses, NULL, N * sizeof *losses);
    assert_ok(cln_stage_distil_gradient(p, N, scale));
    dout = test_read(p->device, &p->dout, sizeof out, "dout");
    losses = test_read(p->device, &p->losses, N * sizeof *losses, "losses");
    for (int i = 0; i < N; i++) {
        memcpy(colour + 3 * i, dout + 4 * i, 3 * sizeof *colour);
        density[i] = dout[4 * i + 3];
    }
    compare("distillation losses", losses, want_loss, N, (bounds){1e-12, 1e-5});
    compare("distillation colours", colour, want_colour, 3 * N, (bounds){1e-11, 1e-5});
    compare("distillation densities", density, want_density, N, (bounds){1e-10, 1e-4});
    free(dout);
    free(losses);
}

static void test_distil(void **state)
{
    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        check_distil(&tune_sets[set]);
    test_report("distillation");
}

int test_group_measure(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_shares),
        cmocka_unit_test(test_sums),
        cmocka_unit_test(test_distil),
    };

    test_wanted = CLN_PROGRAM_BIT(scan) | CLN_PROGRAM_BIT(group) | CLN_PROGRAM_BIT(composite) |
                  CLN_PROGRAM_BIT(stats) | CLN_PROGRAM_BIT(distil) | CLN_PROGRAM_BIT(adam);
    return cmocka_run_group_tests_name("measure", tests, NULL, test_device_close);
}
