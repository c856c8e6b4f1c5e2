/* The choice of samples for the backward pass (kernels/roulette.cl) against float64, for parameters
 * of all kinds of devices: slices of few and many samples; gradients of very different size, zero,
 * tiny and huge; the expectation is the whole gradient; NaN. test_mlp.c tests the backward pass of
 * chosen samples. */
#include "unit.h"
#include "device_test.h"
#include "reference/reference.h"
#include "tests.h"

enum {
    SEGMENT = CLN_ROULETTE_SEGMENT,
    LEAVES = 9,
    SLICES = LEAVES + 1, /* the last is empty */
    LEAST = 4
}; /* the kernel's; leaves, one slice each; --min-leaf-samples */

/* Samples per leaf: too few, about a vector, about a segment, several. */
static const int counts[LEAVES] = {LEAST - 1, LEAST, 7, 8, 9, SEGMENT, SEGMENT + 1, 700, 33};

typedef struct batch {
    uint32_t n;
    float (*out)[4], (*dout)[4]; /* [sample] */
    cl_uint *order;              /* [grouped] */
    cl_uint begin[LEAVES], end[LEAVES];
    cln_slice slices[SLICES];
} batch;

typedef struct choice {
    float (*heads)[4];
    cl_uint *chosen, *counts;
} choice;

/* scale: factor of all gradients. Those of the last leaf are zero. */
static void make_batch(float scale, batch *b)
{
    uint32_t at = 0;

    memset(b, 0, sizeof *b);
    for (int l = 0; l < LEAVES; l++)
        b->n += (uint32_t)counts[l];
    b->out = test_alloc(b->n, sizeof *b->out);
    b->dout = test_alloc(b->n, sizeof *b->dout);
    b->order = test_alloc(b->n, sizeof *b->order);
    for (int l = 0; l < LEAVES; l++) {
        b->begin[l] = at;
        b->slices[l] = (cln_slice){l, at, (cl_uint)counts[l], LEAVES};
        at = b->end[l] = at + (cl_uint)counts[l];
    }
    for (uint32_t i = 0; i < b->n; i++) { /* 367 has no divisor in common with n */
        const uint32_t id = b->order[i] = (cl_uint)((uint64_t)i * 367 % b->n);
        const double size = pow(10, test_uniform(1, (int)id, -4, 0)); /* most are small */

        assert_true(b->n % 367 != 0);
        for (int k = 0; k < 4; k++) {
            b->out[id][k] = (float)test_uniform(2, (int)(4 * id) + k, 0.02, 0.98);
            b->dout[id][k] = scale * (float)(size * test_uniform(3, (int)(4 * id) + k, -1, 1));
            if (i >= b->begin[LEAVES - 1])
                b->dout[id][k] = 0;
        }
        b->out[id][3] *= id % 3 ? 5 : 200;
    }
}

static void free_batch(batch *b)
{
    free(b->out);
    free(b->dout);
    free(b->order);
}

static void run(cln_pipeline *p, const batch *b, double cutoff, uint32_t step_key, choice *out)
{
    test_fill(p->device, &p->slices, b->slices, sizeof b->slices);
    test_fill(p->device, &p->begin, b->begin, sizeof b->begin);
    test_fill(p->device, &p->end, b->end, sizeof b->end);
    test_fill(p->device, &p->values[0], b->order, b->n * sizeof *b->order);
    test_fill(p->device, &p->out, b->out, b->n * sizeof *b->out);
    test_fill(p->device, &p->dout, b->dout, b->n * sizeof *b->dout);
    test_fill(p->device, &p->heads, NULL, b->n * sizeof *out->heads);
    test_fill(p->device, &p->chosen, NULL, b->n * sizeof *out->chosen);
    test_fill(p->device, &p->chosen_counts, NULL, SLICES * sizeof *out->counts);
    assert_ok(cln_stage_roulette(p, b->n, SLICES, LEAST, cutoff, step_key));
    out->heads = test_read(p->device, &p->heads, b->n * sizeof *out->heads, "heads");
    out->chosen = test_read(p->device, &p->chosen, b->n * sizeof *out->chosen, "chosen");
    out->counts = test_read(p->device, &p->chosen_counts, SLICES * sizeof *out->counts, "counts");
}

static void free_choice(choice *c)
{
    free(c->heads);
    free(c->chosen);
    free(c->counts);
}

/* float64's choice among the samples [first, first + n) of a leaf. */
static double expected(const cln_pipeline *p, const batch *b, int leaf, int first, int n,
                       double cutoff, uint32_t step_key, double (*heads)[4], double *factors)
{
    const ref_network r = {.density = p->config.density, .kappa = (float)p->config.density_scale};

    return ref_roulette(&r, cutoff, cln_hash(step_key), n, b->order + b->begin[leaf] + first,
                        b->out, b->dout, heads, factors);
}

static void check(cln_pipeline *p, const batch *b, double cutoff, uint32_t step_key, double *share)
{
    choice c;
    uint32_t all = 0, went = 0;

    run(p, b, cutoff, step_key, &c);
    assert_int_equal(c.counts[0], 0); /* too few samples: chooses none */
    assert_int_equal(c.counts[LEAVES], 0);
    for (int l = 1; l < LEAVES; l++) {
        const cl_uint *chosen = c.chosen + b->begin[l];
        cl_uint used = 0;

        all += (uint32_t)counts[l];
        for (int first = 0; first < counts[l]; first += SEGMENT) {
            const int n = counts[l] - first < SEGMENT ? counts[l] - first : SEGMENT;
            double heads[SEGMENT][4], factors[SEGMENT];

            /* no draw is so close that rounding in float32 could change the choice */
            assert_true(expected(p, b, l, first, n, cutoff, step_key, heads, factors) > 1e-6);
            for (int i = 0; i < n; i++) {
                if (factors[i] == 0)
                    continue;
                if (used >= c.counts[l] || chosen[used] != (cl_uint)(first + i))
                    fail_msg("leaf %d, sample %d was not chosen", l, first + i);
                for (int k = 0; k < 4; k++) {
                    const double got = (double)c.heads[b->begin[l] + used][k];

                    if (!(fabs(got - heads[i][k]) <= 1e-5 * fabs(heads[i][k])))
                        fail_msg("leaf %d, sample %d, head %d: %g, not %g", l, first + i, k, got,
                                 heads[i][k]);
                }
                used++;
            }
        }
        if (used == 0) { /* chooses one without gradient, so that a (zero) gradient exists */
            assert_int_equal(chosen[0], 0);
            for (int k = 0; k < 4; k++)
                assert_true(c.heads[b->begin[l]][k] == 0);
            used = 1;
        }
        assert_int_equal(c.counts[l], used);
        went += used;
    }
    *share = (double)went / all;
    free_choice(&c);
}

/* A higher cutoff chooses fewer; the gradients' scale does not matter. */
static void test_choice(void **state)
{
    static const float scales[] = {1, 1e-30f, 1e30f};
    cln_config config = small_config();

    (void)state;
    for (int set = 0; set < TUNE_SETS; set++)
        for (int s = 0; s < 3; s++) {
            cln_pipeline *p = test_pipeline(&tune_sets[set], &config, false, false);
            double all = 0, some = 0, few = 0;
            batch b;

            make_batch(scales[s], &b);
            check(p, &b, 0, 1, &all);
            check(p, &b, 1, 2, &some);
            check(p, &b, 4, 3, &few);
            assert_true(all == 1 && some < 0.5 && few < 0.7 * some);
            free_batch(&b);
        }
}

/* Densities with different slopes. */
static void test_densities(void **state)
{
    static const int densities[] = {CLN_DENSITY_RELU, CLN_DENSITY_EXP};

    (void)state;
    for (int i = 0; i < 2; i++) {
        cln_config config = small_config();
        double share = 0;
        batch b;

        config.density = densities[i];
        make_batch(1, &b);
        check(test_pipeline(&tune_sets[0], &config, false, false), &b, 1, 5, &share);
        free_batch(&b);
    }
}

/* Over many steps the chosen gradients sum to the whole; no two steps choose alike. */
static void test_expectation(void **state)
{
    enum { KEYS = 400, LEAF = 7 };
    cln_config config = small_config();
    cln_pipeline *p = test_pipeline(&tune_sets[0], &config, false, false);
    double sum[4] = {0}, squares[4] = {0}, whole[4] = {0};
    uint32_t most = 0, fewest = 1000;
    batch b;
    choice c;

    (void)state;
    make_batch(1, &b);
    run(p, &b, 0, 0, &c);
    for (int i = 0; i < counts[LEAF]; i++)
        for (int k = 0; k < 4; k++)
            whole[k] += (double)c.heads[b.begin[LEAF] + (uint32_t)i][k];
    free_choice(&c);
    for (uint32_t key = 1; key <= KEYS; key++) {
        run(p, &b, 2, key, &c);
        most = c.counts[LEAF] > most ? c.counts[LEAF] : most;
        fewest = c.counts[LEAF] < fewest ? c.counts[LEAF] : fewest;
        for (int k = 0; k < 4; k++) {
            double step = 0;

            for (uint32_t i = 0; i < c.counts[LEAF]; i++)
                step += (double)c.heads[b.begin[LEAF] + i][k];
            sum[k] += step / KEYS;
            squares[k] += step * step / KEYS;
        }
        free_choice(&c);
    }
    assert_true(most > fewest + 5);
    for (int k = 0; k < 4; k++) {
        const double deviation = sqrt((squares[k] - sum[k] * sum[k]) / KEYS);

        if (!(fabs(sum[k] - whole[k]) < 4 * deviation))
            fail_msg("head %d: %g on average over %d steps, the whole is %g, deviation %g", k,
                     sum[k], KEYS, whole[k], deviation);
    }
    free_batch(&b);
}

/* NaN gradients are not dropped: they reveal a diverging training. */
static void test_no_number(void **state)
{
    static const float bad[] = {NAN, INFINITY};
    cln_config config = small_config();

    (void)state;
    for (int i = 0; i < 2; i++) {
        cln_pipeline *p = test_pipeline(&tune_sets[0], &config, false, false);
        bool seen = false;
        batch b;
        choice c;

        make_batch(1, &b);
        b.dout[b.order[b.begin[7] + 50]][1] = bad[i];
        run(p, &b, 1, 1, &c);
        for (uint32_t k = 0; k < c.counts[7]; k++)
            seen |= c.chosen[b.begin[7] + k] == 50 && !isfinite(c.heads[b.begin[7] + k][1]);
        assert_true(seen);
        free_choice(&c);
        free_batch(&b);
    }
}

int test_group_roulette(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_choice),
        cmocka_unit_test(test_densities),
        cmocka_unit_test(test_expectation),
        cmocka_unit_test(test_no_number),
    };

    test_wanted = CLN_PROGRAM_BIT(roulette);
    return cmocka_run_group_tests_name("roulette", tests, NULL, test_device_close);
}
