/* adam.cl against the float64 reference, with moments of 32 and of 16 bits: two successive updates
 * of leaves with no, too few, just enough and many samples, over one and many slices; untouched
 * leaves keep every bit, the transposed copy matches the weights, and a launch repeated from the
 * same state gives the same bytes. */
#include "unit.h"
#include "device_test.h"
#include "reference/reference.h"
#include "tests.h"

enum { LEAVES = 8, LEAST = 8 };

typedef struct adam_case {
    const char *name;
    int set;
    bool view, skip;
    int depth;
    double beta1, beta2, epsilon, view_l2;
} adam_case;

static const adam_case cases[] = {
    {"paper's betas", 0, true, false, 2, 0.9, 0.999, 1e-8, 0},
    {"fast betas, skip", 1, true, true, 6, 0.9, 0.99, 1e-10, 0},
    {"no view", 2, false, false, 3, 0.9, 0.99, 1e-8, 0},
    {"view norm", 3, true, false, 2, 0.9, 0.99, 1e-8, 0.05},
    {"no momentum", 4, true, true, 6, 0, 0.9, 1e-3, 0},
};

static cln_config config_of(const adam_case *c, int moments)
{
    cln_config config = small_config();

    config.view_dependence = c->view;
    config.skip = c->skip;
    config.depth = c->depth;
    config.beta1 = c->beta1;
    config.beta2 = c->beta2;
    config.epsilon = c->epsilon;
    config.view_l2 = c->view_l2;
    config.moments = moments;
    config.min_leaf_samples = LEAST;
    return config;
}

/* Samples of each leaf and its slices, as from cln_stage_group. */
static uint32_t make_slices(const cln_pipeline *p, uint32_t begin[LEAVES], uint32_t end[LEAVES],
                            uint32_t starts[LEAVES + 1])
{
    const uint32_t sl = (uint32_t)p->tune.sl;
    const uint32_t counts[LEAVES] = {0, LEAST - 1, LEAST, sl, sl + 1, 1, 3 * sl + 2, LEAST + 1};
    uint32_t at = 0, slices = 0;

    for (int s = 0; s < LEAVES; s++) {
        begin[s] = counts[s] ? at : 0;
        end[s] = counts[s] ? at + counts[s] : 0;
        starts[s] = slices;
        at += counts[s];
        slices += (counts[s] + sl - 1) / sl;
    }
    starts[LEAVES] = slices;
    return slices;
}

/* Puts them, and their gradients, on the device. */
static void put_slices(cln_pipeline *p, const uint32_t begin[LEAVES], const uint32_t end[LEAVES],
                       const uint32_t starts[LEAVES + 1], const float *grads)
{
    const size_t slices = starts[LEAVES];

    assert_ok(cln_buffer_write(p->device, &p->begin, 0, begin, LEAVES * sizeof *begin));
    assert_ok(cln_buffer_write(p->device, &p->end, 0, end, LEAVES * sizeof *end));
    assert_ok(
        cln_buffer_write(p->device, &p->slice_starts, 0, starts, (LEAVES + 1) * sizeof *starts));
    test_fill(p->device, &p->slices, NULL, slices * sizeof(cln_slice));
    test_fill(p->device, &p->grads, grads, slices * (size_t)p->net.params * sizeof *grads);
}

/* Stored moments, float or bfloat16, as double. */
static double *widen_moments(const cln_config *config, const void *moments, size_t n)
{
    double *wide = test_alloc(n, sizeof *wide);

    for (size_t i = 0; i < n; i++)
        wide[i] = config->moments == CLN_MOMENTS_BFLOAT16
                      ? (double)ref_from_bf16(((const uint16_t *)moments)[i])
                      : (double)((const float *)moments)[i];
    return wide;
}

static void set_moment(const cln_config *config, void *moments, size_t i, double value)
{
    if (config->moments == CLN_MOMENTS_BFLOAT16)
        ((uint16_t *)moments)[i] = ref_to_bf16((float)value);
    else
        ((float *)moments)[i] = (float)value;
}

/* The model in double, updated by the reference. */
typedef struct wide_model {
    double *params, *m, *v;
    int32_t steps[LEAVES];
} wide_model;

static double *widen(const float *values, size_t n)
{
    double *wide = test_alloc(n, sizeof *wide);

    for (size_t i = 0; i < n; i++)
        wide[i] = values[i];
    return wide;
}

/* One update; grads [slice][params]. */
static void update(const adam_case *c, const cln_network *net, const uint32_t *begin,
                   const uint32_t *end, const uint32_t *starts, const float *grads, double lr,
                   wide_model *w)
{
    const int n = net->params, view = (net->width + net->dir_pad) * net->view_width;

    for (int s = 0; s < LEAVES; s++) {
        double *p = w->params + s * n, *g = test_alloc((size_t)n, sizeof *g), norm = 0;

        if (end[s] - begin[s] < LEAST) {
            free(g);
            continue;
        }
        for (uint32_t slice = starts[s]; slice < starts[s + 1]; slice++) {
            for (int i = 0; i < n; i++)
                g[i] += grads[slice * (uint32_t)n + (uint32_t)i];
        }
        for (int i = 0; c->view_l2 > 0 && i < view; i++)
            norm += p[net->view_w + i] * p[net->view_w + i];
        for (int i = 0; c->view_l2 > 0 && i < view; i++) /* d |w| / dw = w / |w| */
            g[net->view_w + i] += (float)c->view_l2 * p[net->view_w + i] / sqrt(norm);
        ref_adam(n, p, g, w->m + s * n, w->v + s * n, ++w->steps[s],
                 (ref_adam_rule){lr, (float)c->beta1, (float)c->beta2, (float)c->epsilon});
        free(g);
    }
}

/* Moments of 16 bits: each is one of the value's two neighbours; of values nearer to the lower
 * neighbour, the expected number is rounded up (round-to-nearest would give none). */
static void check_rounded(const char *name, const double *got, const double *want, size_t n)
{
    double expected = 0, up = 0, variance = 0;

    for (size_t i = 0; i < n; i++) {
        int exponent = 0;
        double unit = 0, low = 0, part = 0;

        frexp(want[i], &exponent);
        unit = ldexp(1, exponent - 8);
        low = floor(fabs(want[i]) / unit) * unit;
        part = (fabs(want[i]) - low) / unit;
        if (fabs(got[i] - want[i]) > unit * (1 + 1e-3))
            fail_msg("%s %zu: %.9g, not next to %.9g", name, i, got[i], want[i]);
        if (part < 1e-3 || part > 0.5) /* the device's float rounding may reach the unit */
            continue;
        expected += part;
        up += fabs(got[i]) > low + unit / 2;
        variance += part * (1 - part);
    }
    assert_true(variance > 100);
    if (fabs(up - expected) > 5 * sqrt(variance))
        fail_msg("%s: %.0f went up, not %.0f +- %.0f", name, up, expected, sqrt(variance));
}

/* Compares the device's state after an update with the reference; untouched leaves bit for bit. */
static void check_state(const adam_case *c, cln_pipeline *p, const cln_model *before,
                        const uint32_t *begin, const uint32_t *end, wide_model *want)
{
    const size_t n = (size_t)p->net.params, moment = cln_moment_bytes(&p->config), row = n * moment;
    const bool rounded = p->config.moments == CLN_MOMENTS_BFLOAT16;
    cln_model got = *before;
    double *m = NULL, *v = NULL;

    got.params = test_alloc(LEAVES * n, sizeof(float));
    got.adam_m = test_alloc(LEAVES, row);
    got.adam_v = test_alloc(LEAVES, row);
    got.adam_steps = test_alloc(LEAVES, sizeof(int32_t));
    got.density = test_alloc(LEAVES * 64, sizeof(uint16_t));
    assert_ok(cln_pipeline_download(p, &got, true));
    for (size_t s = 0; s < LEAVES; s++) {
        assert_int_equal(got.adam_steps[s], want->steps[s]);
        if (end[s] - begin[s] < LEAST) {
            assert_memory_equal(got.params + s * n, before->params + s * n, n * sizeof(float));
            assert_memory_equal((char *)got.adam_m + s * row, (char *)before->adam_m + s * row,
                                row);
            assert_memory_equal((char *)got.adam_v + s * row, (char *)before->adam_v + s * row,
                                row);
        }
    }
    compare(c->name, got.params, want->params, LEAVES * n, (bounds){1e-12, 1e-5});
    m = widen_moments(&p->config, got.adam_m, LEAVES * n);
    v = widen_moments(&p->config, got.adam_v, LEAVES * n);
    if (rounded) { /* the next update starts from the stored moments */
        check_rounded("first moment", m, want->m, LEAVES * n);
        check_rounded("second moment", v, want->v, LEAVES * n);
        memcpy(want->m, m, LEAVES * n * sizeof *m);
        memcpy(want->v, v, LEAVES * n * sizeof *v);
    } else {
        compare("first moments", got.adam_m, want->m, LEAVES * n, (bounds){1e-12, 1e-5});
        compare("second moments", got.adam_v, want->v, LEAVES * n, (bounds){1e-12, 1e-5});
    }
    free(m);
    free(v);
    free(got.params);
    free(got.adam_m);
    free(got.adam_v);
    free(got.adam_steps);
    free(got.density);
}

/* wt[n][k] = w[k][n] of the trunk's and the view layer's first `width` rows, exactly. */
static void check_transposed(cln_pipeline *p)
{
    const cln_network *net = &p->net;
    const size_t stride = (size_t)cln_pipeline_transposed(net), n = (size_t)net->params;
    float *wt = test_alloc(LEAVES * stride, sizeof *wt),
          *params = test_alloc(LEAVES * n, sizeof *wt);

    assert_ok(cln_buffer_read(p->device, &p->transposed, 0, wt, LEAVES * stride * sizeof *wt));
    assert_ok(cln_buffer_read(p->device, &p->params, 0, params, LEAVES * n * sizeof *wt));
    for (size_t s = 0; s < LEAVES; s++) {
        const float *at = wt + s * stride;

        for (int layer = 1; layer <= net->depth; layer++) {
            const bool view = layer == net->depth;
            const int columns = view ? net->view_width : net->width;
            const float *w = params + s * n + (view ? net->view_w : net->trunk_w[layer]);

            if (view && !net->view_dependence)
                continue;
            for (int k = 0; k < net->width; k++) {
                for (int j = 0; j < columns; j++)
                    assert_true(at[j * net->width + k] == w[k * columns + j]);
            }
            at += columns * net->width;
        }
    }
    free(wt);
    free(params);
}

static void check_case(const adam_case *c, int moments)
{
    const cln_config config = config_of(c, moments);
    cln_pipeline *p = test_pipeline(&tune_sets[c->set], &config, false, false);
    const size_t n = (size_t)p->net.params;
    uint32_t begin[LEAVES], end[LEAVES], starts[LEAVES + 1];
    const uint32_t slices = make_slices(p, begin, end, starts);
    float *grads = test_alloc(slices * n, sizeof *grads), *first = NULL, *second = NULL;
    cln_model model;
    wide_model want;

    assert_ok(cln_model_create(&config, &model));
    for (size_t i = 0; i < LEAVES * n; i++) {
        model.params[i] = (float)test_uniform(1, (int)i, -1, 1);
        set_moment(&config, model.adam_m, i, test_uniform(2, (int)i, -1e-3, 1e-3));
        set_moment(&config, model.adam_v, i, test_uniform(3, (int)i, 0, 1e-5));
    }
    for (int s = 0; s < LEAVES; s++)
        model.adam_steps[s] = s * s * s;    /* 0 (its first update) to 343 */
    for (size_t i = 0; i < slices * n; i++) /* sizes from 1e-8 to 1 */
        grads[i] =
            (float)(test_uniform(4, (int)i, -1, 1) * pow(10, test_uniform(5, (int)i, -8, 0)));
    want.params = widen(model.params, LEAVES * n);
    want.m = widen_moments(&config, model.adam_m, LEAVES * n);
    want.v = widen_moments(&config, model.adam_v, LEAVES * n);
    memcpy(want.steps, model.adam_steps, sizeof want.steps);

    for (int pass = 0; pass < 2; pass++) {
        float **bytes = pass ? &second : &first;

        assert_ok(cln_pipeline_upload(p, &model, true));
        put_slices(p, begin, end, starts, grads);
        if (!p->tune.leaf)
            check_transposed(p);
        for (int step = 0; step < 2; step++) {
            assert_ok(cln_stage_adam(p, LEAST, 0.01));
            if (pass == 0) {
                update(c, &p->net, begin, end, starts, grads, (float)0.01, &want);
                check_state(c, p, &model, begin, end, &want);
                if (!p->tune.leaf)
                    check_transposed(p);
            }
        }
        free(test_read(p->device, &p->grads, slices * n * sizeof *grads, "grads"));
        *bytes = test_alloc(LEAVES * n, sizeof **bytes);
        assert_ok(cln_buffer_read(p->device, &p->params, 0, *bytes, LEAVES * n * sizeof **bytes));
    }
    assert_memory_equal(first, second, LEAVES * n * sizeof *first);
    cln_model_free(&model);
    free(grads);
    free(first);
    free(second);
    free(want.params);
    free(want.m);
    free(want.v);
}

static void test_updates(void **state)
{
    (void)state;
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        check_case(&cases[i], CLN_MOMENTS_FLOAT32);
        check_case(&cases[i], CLN_MOMENTS_BFLOAT16);
    }
    test_report("Adam");
}

/* A NaN whose bits are all set, as some devices make them, stays one in moments of 16 bits. */
static void test_nan(void **state)
{
    const cln_config config = config_of(&cases[0], CLN_MOMENTS_BFLOAT16);
    cln_pipeline *p = test_pipeline(&tune_sets[cases[0].set], &config, 0, false);
    const size_t n = (size_t)p->net.params;
    uint32_t begin[LEAVES], end[LEAVES], starts[LEAVES + 1];
    const uint32_t slices = make_slices(p, begin, end, starts);
    float *grads = test_alloc(slices * n, sizeof *grads);
    uint16_t *moments = test_alloc(LEAVES * n, sizeof *moments);
    cln_model model;

    (void)state;
    memset(grads, 0xFF, slices * n * sizeof *grads);
    for (size_t i = 0; i < slices * n; i++) /* of both signs */
        ((unsigned char *)grads)[4 * i + 3] = i % 2 ? 0xFF : 0x7F;
    assert_ok(cln_model_create(&config, &model));
    assert_ok(cln_pipeline_upload(p, &model, true));
    put_slices(p, begin, end, starts, grads);
    assert_ok(cln_stage_adam(p, LEAST, 0.01));
    for (int second = 0; second < 2; second++) {
        assert_ok(cln_buffer_read(p->device, second ? &p->adam_v : &p->adam_m, 0, moments,
                                  LEAVES * n * sizeof *moments));
        for (size_t s = 0; s < LEAVES; s++)
            for (size_t i = 0; i < n && end[s] - begin[s] >= LEAST; i++)
                if ((moments[s * n + i] & 0x7FFF) <= 0x7F80)
                    fail_msg("a moment of NaN is %04x", moments[s * n + i]);
    }
    cln_model_free(&model);
    free(grads);
    free(moments);
}

/* Equal moments are rounded by other bits in each leaf, at each of its steps, and of both kinds. */
static void test_rounding(void **state)
{
    enum { ONE = 2, OTHER = 3 }; /* leaves of one slice */
    const cln_config config = config_of(&cases[0], CLN_MOMENTS_BFLOAT16);
    cln_pipeline *p = test_pipeline(&tune_sets[cases[0].set], &config, 0, false);
    const size_t n = (size_t)p->net.params;
    uint32_t begin[LEAVES], end[LEAVES], starts[LEAVES + 1];
    const uint32_t slices = make_slices(p, begin, end, starts);
    float *grads = test_alloc(slices * n, sizeof *grads);
    uint16_t *moments[2][2]; /* [step][first, second] */
    int leaves = 0, steps = 0, first_up = 0, second_up = 0;
    cln_model model;

    (void)state;
    for (size_t i = 0; i < slices * n; i++)
        grads[i] = 0.3f;
    assert_ok(cln_model_create(&config, &model));
    memset(model.params, 0, LEAVES * n * sizeof *model.params);
    for (int step = 0; step < 2; step++) {
        for (int s = 0; s < LEAVES; s++)
            model.adam_steps[s] = step;
        assert_ok(cln_pipeline_upload(p, &model, true));
        put_slices(p, begin, end, starts, grads);
        assert_ok(cln_stage_adam(p, LEAST, 0.01));
        for (int k = 0; k < 2; k++) {
            moments[step][k] = test_alloc(LEAVES * n, sizeof **moments[step]);
            assert_ok(cln_buffer_read(p->device, k ? &p->adam_v : &p->adam_m, 0, moments[step][k],
                                      LEAVES * n * sizeof **moments[step]));
        }
    }
    for (size_t i = 0; i < n; i++) {
        const size_t at = ONE * n + i;
        const bool a = moments[0][0][at] % 2 == 0; /* 0.03: up, from an odd neighbour */
        const bool b = moments[0][1][at] % 2 == 1; /* 9e-5: up, from an even one */

        leaves += moments[0][0][at] != moments[0][0][OTHER * n + i];
        steps += moments[0][0][at] != moments[1][0][at];
        first_up += a && !b;
        second_up += b && !a;
    }
    /* of chances of 3/4: 3/8 of all differ, 3/16 go either way */
    assert_true(leaves > (int)n / 4 && steps > (int)n / 4);
    assert_true(first_up > (int)n / 10 && second_up > (int)n / 10);
    for (int i = 0; i < 4; i++)
        free(moments[i / 2][i % 2]);
    cln_model_free(&model);
    free(grads);
}

int test_group_adam(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_updates),
        cmocka_unit_test(test_nan),
        cmocka_unit_test(test_rounding),
    };

    test_wanted = CLN_PROGRAM_BIT(adam);
    return cmocka_run_group_tests_name("adam", tests, NULL, test_device_close);
}
