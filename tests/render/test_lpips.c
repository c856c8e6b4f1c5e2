/* LPIPS (render/lpips.h): weights drawn at random in files as the authors' package writes them,
 * pictures of odd sizes. Oracle: the networks layer by layer in float64, from method.md section 14.
 * The published weights are not here; docs/results.md has a comparison with them. */
#include "unit.h"
#include <math.h>
#include "device_test.h"
#include "io/safetensors.h"
#include "near.h"
#include "render/lpips.h"
#include "run_fixture.h"
#include "tests.h"

/* ---- networks and their files ---- */

/* "PN" pools of N x N pixels at every second one, "N:K/S+B" convolutions of K x K pixels to N
 * channels with stride S and a border of B; "=" features are compared. */
static const struct {
    const char *name, *numbers, *layers;
} nets[] = {
    {"alex", "0 3 6 8 10", "64:11/4+2 = P3 192:5/1+2 = P3 384:3/1+1 = 256:3/1+1 = 256:3/1+1 ="},
    {"vgg", "0 2 5 7 10 12 14 17 19 21 24 26 28",
     "64:3/1+1 64:3/1+1 = P2 128:3/1+1 128:3/1+1 = P2 256:3/1+1 256:3/1+1 256:3/1+1 = P2 "
     "512:3/1+1 512:3/1+1 512:3/1+1 = P2 512:3/1+1 512:3/1+1 512:3/1+1 ="},
};

enum { MOST = 13 };
typedef struct drawn {
    int layers, slices;
    float *weights[MOST], *biases[MOST], *lins[5];
} drawn;

static float *draw(uint32_t key, size_t count, double size)
{
    float *values = malloc(count * sizeof *values);

    assert_non_null(values);
    for (size_t i = 0; i < count; i++)
        values[i] = (float)(size * ((cln_hash((uint32_t)i ^ key << 24) >> 8) / 8388608.0 - 1));
    return values;
}

/* Draws a network and writes its file, without the tensor `without` (NULL: whole). */
static void make_net(int net, const char *path, const char *without, drawn *d)
{
    const char *at = nets[net].layers, *number = nets[net].numbers;
    cln_tensor tensors[2 * MOST + 5];
    char names[2 * MOST + 5][64];
    int inputs = 3, count = 0, left = 0;

    memset(d, 0, sizeof *d);
    for (; *at; at += strcspn(at, " "), at += *at == ' ') {
        int n, k, s, b;
        char *end = NULL;

        if (*at == '=') {
            const cln_tensor lin = {names[count],
                                    CLN_DTYPE_F32,
                                    4,
                                    {1, inputs, 1, 1},
                                    d->lins[d->slices] =
                                        draw(77u + (uint32_t)count, (size_t)inputs, 0.5)};

            for (int i = 0; i < inputs; i++)
                d->lins[d->slices][i] += 0.5f; /* as the published ones not below 0 */
            snprintf(names[count], sizeof names[0], "lin%s%d.model.1.weight", net ? "s." : "",
                     d->slices);
            tensors[count++] = lin;
            d->slices++;
        } else if (sscanf(at, "%d:%d/%d+%d", &n, &k, &s, &b) == 4) {
            const long place = strtol(number, &end, 10);
            const size_t fan = (size_t)(inputs * k * k);
            const cln_tensor w = {names[count],
                                  CLN_DTYPE_F32,
                                  4,
                                  {n, inputs, k, k},
                                  d->weights[d->layers] = draw((uint32_t)count, (size_t)n * fan,
                                                               sqrt(6.0 / (double)fan))};
            const cln_tensor bias = {names[count + 1],
                                     CLN_DTYPE_F32,
                                     1,
                                     {n},
                                     d->biases[d->layers] =
                                         draw(999u + (uint32_t)count, (size_t)n, 0.1)};

            number = end;
            snprintf(names[count], sizeof names[0], "net.slice%d.%ld.weight", d->slices + 1, place);
            snprintf(names[count + 1], sizeof names[0], "net.slice%d.%ld.bias", d->slices + 1,
                     place);
            tensors[count++] = w;
            tensors[count++] = bias;
            d->layers++;
            inputs = n;
        }
    }
    for (int i = 0; i < count; i++)
        if (!without || strcmp(names[i], without) != 0)
            tensors[left++] = tensors[i];
    assert_ok(cln_safetensors_write(path, left, tensors, NULL));
}

static void free_net(drawn *d)
{
    for (int i = 0; i < MOST; i++) {
        free(d->weights[i]);
        free(d->biases[i]);
    }
    for (int i = 0; i < 5; i++)
        free(d->lins[i]);
}

/* ---- the oracle ---- */

typedef struct features {
    int channels, width, height;
    double *at; /* [channel][height][width] */
} features;

static double value(const features *f, int n, int y, int x)
{
    return x < 0 || y < 0 || x >= f->width || y >= f->height
               ? 0
               : f->at[((size_t)n * (size_t)f->height + (size_t)y) * (size_t)f->width + (size_t)x];
}

static features features_of(int channels, int width, int height)
{
    features f = {channels, width, height,
                  calloc((size_t)channels * (size_t)width * (size_t)height, sizeof *f.at)};

    assert_non_null(f.at);
    return f;
}

static void convolve(features *f, int n, int k, int s, int b, const float *w, const float *bias)
{
    features out = features_of(n, (f->width + 2 * b - k) / s + 1, (f->height + 2 * b - k) / s + 1);
    double *to = out.at;

    for (int c = 0; c < n; c++)
        for (int y = 0; y < out.height; y++)
            for (int x = 0; x < out.width; x++) {
                const float *weight = w + (size_t)c * (size_t)(f->channels * k * k);
                double sum = (double)bias[c];

                for (int i = 0; i < f->channels; i++)
                    for (int v = 0; v < k; v++)
                        for (int u = 0; u < k; u++)
                            sum += (double)*weight++ * value(f, i, y * s + v - b, x * s + u - b);
                *to++ = fmax(sum, 0);
            }
    free(f->at);
    *f = out;
}

static void pool(features *f, int size)
{
    features out = features_of(f->channels, (f->width - size) / 2 + 1, (f->height - size) / 2 + 1);
    double *to = out.at;

    for (int c = 0; c < f->channels; c++)
        for (int y = 0; y < out.height; y++)
            for (int x = 0; x < out.width; x++, to++)
                for (int i = 0; i < size * size; i++)
                    *to = fmax(*to, value(f, c, 2 * y + i / size, 2 * x + i % size));
    free(f->at);
    *f = out;
}

static double distance(const features f[2], const float *lin)
{
    double sum = 0;

    for (int y = 0; y < f->height; y++)
        for (int x = 0; x < f->width; x++) {
            double length[2] = {0};

            for (int c = 0; c < f->channels; c++)
                for (int i = 0; i < 2; i++)
                    length[i] += pow(value(&f[i], c, y, x), 2);
            for (int c = 0; c < f->channels; c++)
                sum += (double)lin[c] * pow(value(&f[0], c, y, x) / (sqrt(length[0]) + 1e-10) -
                                                value(&f[1], c, y, x) / (sqrt(length[1]) + 1e-10),
                                            2);
        }
    return sum / f->width / f->height;
}

static double expected(int net, const drawn *d, int width, int height, float *const pictures[2])
{
    static const double shift[] = {-.030, -.088, -.188}, scale[] = {.458, .448, .450};
    const char *at = nets[net].layers;
    features f[2];
    double sum = 0;
    int layer = 0, slice = 0;

    for (int i = 0; i < 2; i++) {
        f[i] = features_of(3, width, height);
        for (int c = 0; c < 3; c++)
            for (int p = 0; p < width * height; p++)
                f[i].at[c * width * height + p] =
                    (2 * fmin(fmax((double)pictures[i][3 * p + c], 0), 1) - 1 - shift[c]) /
                    scale[c];
    }
    for (; *at; at += strcspn(at, " "), at += *at == ' ') {
        int n, k, s, b;

        if (*at == '=')
            sum += distance(f, d->lins[slice++]);
        else if (sscanf(at, "P%d", &k) == 1)
            pool(&f[0], k), pool(&f[1], k);
        else if (sscanf(at, "%d:%d/%d+%d", &n, &k, &s, &b) == 4) {
            for (int i = 0; i < 2; i++)
                convolve(&f[i], n, k, s, b, d->weights[layer], d->biases[layer]);
            layer++;
        }
    }
    free(f[0].at);
    free(f[1].at);
    return sum;
}

/* ---- tests ---- */

static void measure_as_float64(void **state, int net, int width, int height, int sets)
{
    const char *path = scratch_path(*state, "weights.safetensors");
    const size_t pixels = (size_t)width * (size_t)height;
    float *pictures[2] = {draw(5, 3 * pixels, 1.2), draw(6, 3 * pixels, 1.2)}; /* clipped */
    drawn d;
    double want = 0;

    make_net(net, path, NULL, &d);
    want = expected(net, &d, width, height, pictures);
    for (int t = 0; t < sets; t++) {
        cln_lpips *l = NULL;
        double got = 0, same = 1, turned = 0;

        assert_ok(cln_lpips_open(test_device(&tune_sets[t]), path, &l));
        assert_string_equal(cln_lpips_network(l), nets[net].name);
        assert_ok(cln_lpips_measure(l, width, height, NULL, pictures[0], pictures[1], &got));
        assert_true(fabs(got - want) < 1e-4 * want);
        assert_ok(cln_lpips_measure(l, width, height, NULL, pictures[1], pictures[1], &same));
        assert_true(same == 0);
        /* a buffer that was larger, and other borders before */
        assert_ok(cln_lpips_measure(l, height, width, NULL, pictures[0], pictures[1], &turned));
        assert_ok(cln_lpips_measure(l, width, height, NULL, pictures[0], pictures[1], &same));
        assert_true(same == got);
        cln_lpips_close(l);
    }
    free_net(&d);
    free(pictures[0]);
    free(pictures[1]);
}

static void alexnet(void **state)
{
    measure_as_float64(state, 0, 47, 34, TUNE_SETS);
}

static void vgg(void **state)
{
    measure_as_float64(state, 1, 19, 16, 1);
}

static void what_is_left_out_is_black(void **state)
{
    enum { WIDTH = 40, HEIGHT = 33, PIXELS = WIDTH * HEIGHT };
    const char *path = scratch_path(*state, "weights.safetensors");
    float *pictures[2] = {draw(5, 3 * PIXELS, 1), draw(6, 3 * PIXELS, 1)};
    uint8_t kept[PIXELS];
    cln_lpips *l = NULL;
    drawn d;
    double want = 0, got = 0;

    make_net(0, path, NULL, &d);
    for (int i = 0; i < PIXELS; i++)
        kept[i] = i % 5 != 0;
    assert_ok(cln_lpips_open(test_device(&tune_sets[0]), path, &l));
    assert_ok(cln_lpips_measure(l, WIDTH, HEIGHT, kept, pictures[0], pictures[1], &got));
    cln_lpips_close(l);
    for (int i = 0; i < 3 * PIXELS; i++)
        if (!kept[i / 3])
            pictures[0][i] = pictures[1][i] = 0;
    want = expected(0, &d, WIDTH, HEIGHT, pictures);
    assert_true(fabs(got - want) < 1e-4 * want);
    free_net(&d);
    free(pictures[0]);
    free(pictures[1]);
}

/* The least pictures leave a pixel for the last layer. */
static void least_pictures(void **state)
{
    const char *path = scratch_path(*state, "weights.safetensors");

    for (int net = 0; net < 2; net++) {
        cln_lpips *l = NULL;
        float *pictures[2];
        double got = 0, want = 0;
        drawn d;
        int side = 0;

        make_net(net, path, NULL, &d);
        assert_ok(cln_lpips_open(test_device(&tune_sets[0]), path, &l));
        side = cln_lpips_least(l);
        assert_int_equal(side, net ? 16 : 31);
        for (int i = 0; i < 2; i++)
            pictures[i] = draw(8u + (uint32_t)i, (size_t)(3 * side * side), 1);
        assert_ok(cln_lpips_measure(l, side, side, NULL, pictures[0], pictures[1], &got));
        want = expected(net, &d, side, side, pictures);
        assert_true(want > 0 && fabs(got - want) < 1e-4 * want);
        cln_lpips_close(l);
        free(pictures[0]);
        free(pictures[1]);
        free_net(&d);
    }
}

static void other_files_are_refused(void **state)
{
    const char *path = scratch_path(*state, "weights.safetensors");
    const float values[4] = {0};
    const cln_tensor other = {"net.slice1.0.weight", CLN_DTYPE_F32, 4, {1, 1, 2, 2}, values};
    cln_lpips *l = NULL;
    drawn d;

    make_net(0, path, "net.slice3.6.bias", &d);
    assert_fails(cln_lpips_open(test_device(&tune_sets[0]), path, &l), CLN_INPUT,
                 "has no 'net.slice3.6.bias'");
    assert_null(l);
    assert_ok(cln_safetensors_write(path, 1, &other, NULL));
    assert_fails(cln_lpips_open(test_device(&tune_sets[0]), path, &l), CLN_INPUT,
                 "'net.slice1.0.weight' has another shape");
    scratch_put(path, "no tensors", 10);
    assert_fails(cln_lpips_open(test_device(&tune_sets[0]), path, &l), CLN_INPUT,
                 "not a safetensors file");
    free_net(&d);
}

/* eval's figure is that of the picture it renders, and the mean is over the views; too small ones
 * are refused. */
static void eval_measures_it(void **state)
{
    const char *weights = fixture_path("vgg.safetensors"), *alex = fixture_path("alex.safetensors");
    cln_eval_desc desc = {.run = fixture_path("whole"),
                          .device = fixture_device(),
                          .lpips = weights,
                          .save_images = true};
    uint8_t *bytes[2];
    float pictures[2][3 * SIDE * SIDE];
    char *text = NULL;
    json_t *document = NULL;
    cln_eval_result result;
    double want = 0;
    drawn d;

    NEED_DEVICE();
    make_net(1, weights, NULL, &d);
    assert_ok(cln_eval(&desc, &result));
    assert_string_equal(result.lpips_network, "vgg");
    for (int i = 0; i < 2; i++) {
        int width = 0, height = 0, channels = 0;

        assert_ok(cln_image_load(fixture_path(i ? "whole/eval/00000030-test/test_r_1.truth.png"
                                                : "whole/eval/00000030-test/test_r_1.png"),
                                 &width, &height, &channels, &bytes[i]));
        assert_int_equal(width * height * channels, 3 * SIDE * SIDE);
        for (int k = 0; k < 3 * SIDE * SIDE; k++)
            pictures[i][k] = (float)bytes[i][k] / 255;
        free(bytes[i]);
    }
    want = expected(1, &d, SIDE, SIDE, (float *const[2]){pictures[0], pictures[1]});
    assert_true(want > 0 && fabs(result.images[1].lpips - want) < 0.05 * want); /* 8 bits */
    assert_near(result.lpips, (result.images[0].lpips + result.images[1].lpips) / 2, 1e-12);
    assert_ok(cln_eval_json(&result, &text));
    document = fixture_parse(text);
    assert_near(json_real_value(fixture_at(document, "mean.lpips")), result.lpips, 1e-12);
    assert_string_equal(json_string_value(fixture_at(document, "lpips.network")), "vgg");
    json_decref(document);
    cln_eval_free(&result);
    free_net(&d);
    make_net(0, alex, NULL, &d);
    free_net(&d);
    desc.lpips = alex;
    assert_fails(cln_eval(&desc, &result), CLN_INPUT, "24 x 24 pixels; for LPIPS it needs 31 x 31");
    desc.lpips = fixture_path("none");
    assert_fails(cln_eval(&desc, &result), CLN_INPUT, "none: no such file");
    desc.lpips = NULL;
    assert_ok(cln_eval(&desc, &result));
    assert_true(isnan(result.lpips) && isnan(result.images[0].lpips));
    cln_eval_free(&result);
}

static int close_all(void **state)
{
    test_device_close(state);
    return fixture_teardown(state);
}

int test_group_lpips(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(alexnet, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(vgg, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(what_is_left_out_is_black, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(least_pictures, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(other_files_are_refused, scratch_make, scratch_remove),
        cmocka_unit_test(eval_measures_it)};

    return cmocka_run_group_tests_name("lpips", tests, fixture_setup, close_all);
}
