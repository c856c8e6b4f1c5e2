/* regularise.cl: extra samples have correct positions (points inside their leaf, pairs on a face
 * that both leaves share); gradients equal central differences, in double, of the two losses of
 * method.md 10; densities from 0 to 1e4. Two parameter sets, one of them a GPU's. */
#include "unit.h"
#include "device_test.h"
#include "near.h"
#include "sampling_test.h"
#include "tests.h"

enum {
    POINTS = 4096,
    PAIRS = 2048,
    EXTRA = POINTS + 2 * PAIRS,
    WG = 100 /* of the last group, some work-items have no point */
};
static const double SPARSITY = 0.5, EDGE = 0.25;

/* Loss of one pair: U |f_a - f_b| summed over f = alpha (r, g, b, 1), times its share of the
 * mean. */
static double pair_loss(const double a[4], const double b[4], double spacing, double u)
{
    const double alpha = -expm1(-spacing * a[3]), beta = -expm1(-spacing * b[3]);
    double sum = fabs(alpha - beta);

    for (int c = 0; c < 3; c++)
        sum += fabs(alpha * a[c] - beta * b[c]);
    return EDGE * u * sum / 4 / PAIRS;
}

static double point_loss(double sigma)
{
    return SPARSITY * -expm1(-0.05 * sigma) / POINTS;
}

/* Central difference of a pair's loss with respect to element c of one side. */
static double difference(const double a[4], const double b[4], double spacing, double u, int c,
                         bool of_b)
{
    double low[2][4], high[2][4];
    const double h = 1e-7 * fmax(1e-3, fabs(of_b ? b[c] : a[c])); /* well inside the kinks */

    for (int k = 0; k < 4; k++) {
        low[0][k] = high[0][k] = a[k];
        low[1][k] = high[1][k] = b[k];
    }
    low[of_b][c] -= h;
    high[of_b][c] += h;
    return (pair_loss(high[0], high[1], spacing, u) - pair_loss(low[0], low[1], spacing, u)) /
           (2 * h);
}

static void check_places(const cln_model *model, const float *boxes, const cln_sample *samples,
                         float (*o)[4], float (*d)[4])
{
    int shared = 0;

    for (int i = 0; i < POINTS + PAIRS; i++) {
        const cln_sample *a = &samples[i], *b = &samples[i + (i < POINTS ? 0 : PAIRS)];
        const float *box = boxes + 4 * a->slot;
        double norm = 0, outside[3];
        int faces = 0, axis = 0;

        assert_true(a->ray == (cln_u32)i && b->ray == a->ray && a->t == 0);
        assert_true(a->slot >= 0 && a->slot < model->tree.leaf_count);
        assert_true(b->slot >= 0 && b->slot < model->tree.leaf_count);
        for (int k = 0; k < 3; k++) {
            norm += (double)d[i][k] * d[i][k];
            assert_true(o[i][k] >= box[k] - 1e-6f && o[i][k] <= box[k] + box[3] + 1e-6f);
            if (fabsf(o[i][k] - box[k]) < 1e-6f || fabsf(o[i][k] - box[k] - box[3]) < 1e-6f) {
                faces++;
                axis = k;
            }
            outside[k] = o[i][k];
        }
        assert_near(norm, 1, 1e-5);
        if (i < POINTS)
            continue;
        assert_true(faces >= 1);
        if (b->slot == a->slot || faces > 1)
            continue;
        outside[axis] += (o[i][axis] > box[axis] + box[3] / 2 ? 1 : -1) * 1e-3 * box[3];
        assert_int_equal(cln_octree_find(&model->tree, outside), b->slot);
        shared++;
    }
    assert_true(shared > PAIRS / 4); /* many leaves have neighbours */
}

static void check_gradients(const float *boxes, int n1, const cln_sample *samples, float (*out)[4],
                            const float *dout, uint64_t seed, uint32_t step)
{
    double *want = test_alloc((size_t)EXTRA * 4, sizeof *want);

    for (int i = 0; i < POINTS; i++) {
        const double sigma = out[i][3], h = 1e-6 * fmax(1, sigma);

        want[4 * i + 3] = (point_loss(sigma + h) - point_loss(sigma - h)) / (2 * h);
    }
    for (int i = POINTS; i < POINTS + PAIRS; i++) {
        const int j = i + PAIRS;
        const double side = fmin(boxes[4 * samples[i].slot + 3], boxes[4 * samples[j].slot + 3]);
        double a[4], b[4];
        float u[4];

        cln_uniform4(seed, CLN_STREAM_POINTS, step, (uint32_t)i, 1, u);
        for (int c = 0; c < 4; c++) {
            a[c] = out[i][c];
            b[c] = out[j][c];
        }
        for (int c = 0; c < 4; c++) {
            want[4 * i + c] = difference(a, b, side / n1, u[3], c, false);
            want[4 * j + c] = difference(a, b, side / n1, u[3], c, true);
        }
    }
    compare("points", dout, want, (size_t)POINTS * 4, (bounds){1e-9, 1e-4});
    compare("pairs", dout + 4 * POINTS, want + 4 * POINTS, (size_t)PAIRS * 8, (bounds){1e-7, 1e-3});
    free(want);
}

static void run_set(const tune_set *set)
{
    cln_config config = small_config();
    const cln_sampling s = {.jitter = true, .seed = 5, .step = 9, .max_samples = 1 << 20};
    const size_t vector = 4 * sizeof(float);
    const float background[4] = {1, 1, 1, 0};
    cln_model model = {0};
    cln_pipeline *p = NULL;
    float *boxes = NULL, (*o)[4] = NULL, (*d)[4] = NULL, (*out)[4] = NULL, *dout = NULL;
    cln_sample *samples = NULL;
    uint32_t count = 0;

    config.sparsity = SPARSITY;
    config.edge = EDGE;
    p = test_pipeline(set, &config, false, false);
    p->tune.wg = WG;
    make_sampling_model(&config, &model);
    assert_ok(cln_pipeline_upload(p, &model, false));
    assert_ok(cln_octree_boxes(&model.tree, &boxes));
    assert_int_equal(cln_pipeline_extra_samples(p), EXTRA);
    assert_ok(cln_pipeline_batch(p, (cln_pixel[]){{0}}, 0, NULL, background));
    test_fill(p->device, &p->ray_o, NULL, (POINTS + PAIRS) * vector);
    test_fill(p->device, &p->ray_d, NULL, (POINTS + PAIRS) * vector);
    test_fill(p->device, &p->samples, NULL, EXTRA * sizeof *samples);
    assert_ok(cln_stage_regularise(p, &s, 0, &count));
    assert_int_equal(count, EXTRA);
    o = test_read(p->device, &p->ray_o, (POINTS + PAIRS) * vector, "origins");
    d = test_read(p->device, &p->ray_d, (POINTS + PAIRS) * vector, "directions");
    samples = test_read(p->device, &p->samples, EXTRA * sizeof *samples, "samples");
    check_places(&model, boxes, samples, o, d);
    out = test_alloc(EXTRA, sizeof *out);
    for (int i = 0; i < EXTRA; i++)
        for (int c = 0; c < 4; c++)
            out[i][c] = (float)(c < 3   ? test_uniform(40, 4 * i + c, 0, 1)
                                : i % 7 ? pow(10, test_uniform(41, i, -6, 4))
                                        : 0);
    test_fill(p->device, &p->out, out, EXTRA * sizeof *out);
    test_fill(p->device, &p->dout, NULL, EXTRA * sizeof *out);
    assert_ok(cln_stage_regularise_gradient(p, &s, EXTRA));
    dout = test_read(p->device, &p->dout, EXTRA * sizeof *out, "gradients");
    check_gradients(boxes, config.n1, samples, out, dout, s.seed, s.step);
    free(boxes);
    free(o);
    free(d);
    free(out);
    free(dout);
    free(samples);
    cln_model_free(&model);
    test_report(set->name);
}

static void test_cpu_shape(void **state)
{
    (void)state;
    run_set(&tune_sets[0]);
}

static void test_gpu_shape(void **state)
{
    (void)state;
    run_set(&tune_sets[4]);
}

int test_group_regularise(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_cpu_shape),
        cmocka_unit_test(test_gpu_shape),
    };

    test_wanted = CLN_PROGRAM_BIT(regularise);
    return cmocka_run_group_tests_name("regularise", tests, NULL, test_device_close);
}
