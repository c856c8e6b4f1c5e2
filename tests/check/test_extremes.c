/* The self-test at extremes (selftest --extremes): its rows pass with the parameters of several
 * kinds of devices, and each kind of row can fail: a kernel is made wrong in a way that ordinary
 * numbers hardly show, and its row must name it. */
#include "unit.h"
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "check/extremes.h"
#include "run_fixture.h"
#include "sanitized.h"
#include "tests.h"

typedef struct tally {
    int passed, failed;
    char failures[4096]; /* names of rows, a line each */
} tally;

static void on_row(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    tally *t = user;
    const size_t used = strlen(t->failures);

    (void)skipped;
    assert_non_null(strstr(detail, passed ? "all finite" : ""));
    t->passed += passed;
    t->failed += !passed;
    if (!passed) {
        print_message("%s: %s\n", name, detail);
        snprintf(t->failures + used, sizeof t->failures - used, "%s\n", name);
    }
}

static cln_status run(const char *kernel_dir, const char *tune, const char *only, tally *t)
{
    cln_status st = CLN_OK;
    const cln_extremes_plan plan = {.quick = true, .only = only, .sink = on_row, .user = t};
    cln_device_desc desc = fixture_device();
    cln_device *device = NULL;

    if (kernel_dir)
        desc.kernel_dir = kernel_dir;
    CLN_TRY(cln_device_open(&desc, &device));
    if (tune) {
        CLN_TRY(cln_tune_parse(tune, &device->tune));
        device->tune_exact = true;
    }
    CLN_TRY(cln_extremes_device(device, &plan));
done:
    cln_device_close(device);
    return st;
}

/* A twin, its scale or its bound that is no number fails a row, wherever it comes. */
static void test_twin_is_no_number(void **state)
{
    (void)state;
    for (int k = 0; k < 4; k++)
        for (int place = 0; place < 2; place++) {
            cln_checks checks = {.shape = "by hand"};
            cln_extreme e = cln_extreme_row(&checks, "row", "");

            if (place > 0)
                cln_extreme_meet(&e, 1, 1, 1, 1e-3, "first");
            cln_extreme_meet(&e, 5, k == 1 ? NAN : 5.001, k == 2 ? NAN : 5, k == 3 ? NAN : 1e-3,
                             "second");
            cln_extreme_report(&e);
            assert_int_equal(checks.failed, k > 0);
        }
}

static void test_passes(void **state)
{
    tally t = {0};

    (void)state;
    NEED_DEVICE();
    assert_ok(run(NULL, NULL, NULL, &t));
    assert_int_equal(t.failed, 0);
    assert_true(t.passed >= 100);
}

/* A GPU's parameters; other tests of these kernels have more of them. */
static void test_passes_with_others(void **state)
{
    static const char gpu[] =
        "VW=1,NV=1,LS=64,TS=8,NB=16,SL=128,WG=64,SG=256,DB=8,CHUNK=2048,LEAF=0";
    static const char *const subjects[] = {
        "composite", "rays",   "shell space", "sums over leaves", "decoder",
        "grid",      "voxels", "splatting",   "roulette",         "change of the tree"};

    (void)state;
    NEED_DEVICE();
    for (size_t i = 0; i < sizeof subjects / sizeof *subjects; i++) {
        tally t = {0};

        assert_ok(run(NULL, gpu, subjects[i], &t));
        assert_true(t.passed >= 2);
        assert_int_equal(t.failed, 0);
    }
}

/* Faults of a subject's kernels, and the row that must fail. Rows of one subject are one build. */
static const struct {
    const char *subject, *file, *from, *to, *row;
} faults[] = {
    /* alpha cancels for faint samples */
    {"composite", "lanes.h", "(x) < (T)(0.15f))", "(x) < (T)(0.0f))", "composite: opacity"},
    {"distillation", "lanes.h", "(x) < (T)(0.15f))", "(x) < (T)(0.0f))", "distillation: loss"},
    {"regularisers", "lanes.h", "(x) < (T)(0.15f))", "(x) < (T)(0.0f))",
     "regularisers: edge gradient"},
    /* transmittance rounds faint samples away */
    {"composite, cauchy", "composite.cl", "through = behind[l];", "through *= 1.0f - alphas[l];",
     "composite, cauchy: transmittance"},
    {"composite, cauchy", "loss.h", "fmin(sigma, 1e6f)", "sigma", "composite, cauchy: loss"},
    /* the last gradients are of the light behind */
    {"composite, every loss", "loss.h", "delta * (kept.z * gain", "delta * (kept.x * gain",
     "composite, every loss: density gradient"},
    /* the distortion's moments are about t = 0 */
    {"composite, every loss", "composite.cl", "begin < end ? samples[begin].t : 0.0f", "0.0f",
     "composite, every loss: density gradient"},
    /* of another rank's stretch, the light behind it counts as none */
    {"composite, stretches", "stretch.cl", "s->rest += gain;", "s->rest += 0.999f * gain;",
     "composite, stretches: density gradient"},
    /* far cameras see from their plane's middle; what is beyond a fold is seen */
    {"cameras", "camera.h", "if (c.start > 0.0f) {", "if (c.start > 5e4f) {",
     "cameras: place near the cube"},
    {"cameras", "lens.h", "r * fabs(omega) < M_PI_2_F", "true",
     "cameras: share of pixels judged otherwise"},
    /* slopes of 1e-4 count as none */
    {"rays", "walk.h", "fabs(d) < (vf)(1e-12f)", "fabs(d) < (vf)(1e-3f)",
     "rays, grazing: samples in their leaf"},
    {"cropped rays", "walk.h", "fabs(along) < (vf)(1e-12f)", "fabs(along) < (vf)(1e-3f)",
     "cropped rays, grazing: samples fill the chord"},
    /* a bisection that begins beyond the fold */
    {"cameras", "lens.h", "high = fmin(c.limit, 1e4f)", "high = fmax(c.limit, 1e4f)",
     "cameras: share of pixels judged otherwise"},
    {"forward space", "space.h", "fmax(p.z, 1.0f)", "fmax(p.z, 0.9f)",
     "forward space: where rays begin"},
    {"networks", "roulette.cl", "o * (1.0f - o)", "o", "networks: gradients of weights"},
    /* pre-activations of 16 bits */
    {"networks, HALF=1", "network.h", "HALF_MOST   65504.0f", "HALF_MOST   1e38f",
     "networks, HALF=1: every gradient"},
    {"networks, HALF=1", "network.h", "IN_HALF(v)  fmax(", "IN_HALF(v)  1.01f * fmax(",
     "networks, HALF=1: gradients of weights"},
    /* squares of gradients overflow; tiny ones count as none */
    {"roulette", "roulette.cl", "return (a.x + a.y) + (a.z + a.w);", "return sqrt(dot(a, a));",
     "roulette: samples that take part"},
    {"roulette", "roulette.cl", "(vf)(least) / size", "(vf)(least) / (size + 1e-20f)",
     "roulette: gradients of heads"},
    {"roulette, exp", "network.h", "KAPPA * 3269017.4f", "1e3f",
     "roulette, exp: gradients of heads"},
    /* infinities, cells a half beside */
    {"change of the tree", "carry.cl",
     "-1 ? old[i] :", "-1 ? as_uint4(fmin(as_float4(old[i]), MAXFLOAT)) :",
     "change of the tree: copies of weights and moments"},
    {"change of the tree", "carry.cl", "(uint4)(0u);", "old[i] & 1u;",
     "change of the tree: moments of new leaves"},
    {"change of the tree", "carry.cl", "2u * at + 1u + 2u", "2u * at + 3u + 2u",
     "change of the tree: densities of the nearest cells"},
    {"shared samples", "share.cl", "= out[order[first + i]];",
     "= fmin(out[order[first + i]], MAXFLOAT);", "shared samples: values that leave"},
    {"shared samples", "share.cl", "(i < first || i >= end)", "(i < first || i > end)",
     "shared samples: values after the exchange"},
    {"grid", "encoding_grid.h", "(yz & 1 ? y : 1.0f - y)", "(yz & 1 ? y : 1.001f - y)",
     "grid: colour"},
    {"grid", "encoding_grid.h", "V_SUM(sum);", "V_SUM(sum) * 1.001f;",
     "grid: gradients of weights"},
    {"voxels", "harmonics.h", "1.7320508f * d.y", "1.7330508f * d.y", "voxels: colour"},
    {"voxels", "voxel.cl", "h + 1] * d[a]", "h + 1] * d[a] * 1.001f",
     "voxels: gradients of weights"},
    {"voxels", "roulette.cl", "g.w * sigma[l]", "g.w * sigma[l] * 1.001f",
     "voxels: gradients of weights"},
    /* moments that are small count as none; the second copy of a vertex keeps its number */
    {"voxels", "voxel.cl", "before == (vf)(0.0f)", "before < (vf)(1e-20f)",
     "voxels: a vertex's step"},
    {"voxels", "voxel.cl", "for (int i = 1; i < s->count; i++)",
     "for (int i = 2; i < s->count; i++)", "voxels: copies of a vertex"},
    {"voxels", "voxel.cl", "0.125f * (((", "0.12501f * (((",
     "voxels: a split, and common vertices after it"},
    /* hidden units below 0 have a gradient */
    {"decoder", "decoder.cl", "hidden[j] > 0.0f", "hidden[j] > -1.0f",
     "decoder: gradients of the decoder"},
    {"decoder", "decoder.cl", "before > 0.0f ?", "before > -1.0f ?", "decoder: the decoder's step"},
    {"Adam, float moments", "adam.h", ") + EPSILON);", "));", "Adam, float moments: Adam's step"},
    /* what is lost beside a large sum, densities of over 1e30 */
    {"sums over leaves", "stats.cl", "add -= old.y;", "", "sums over leaves: measures"},
    {"sums over leaves", "stats.cl", "min(met[leaf], INT_MAX - count)", "met[leaf]",
     "sums over leaves: samples"},
    {"sums over leaves", "stats.cl", "sum += sigma;", "sum += fmin(sigma, 1e30f);",
     "sums over leaves: mean density"},
    {"sums over leaves", "stats.cl", "fmax(peak, sigma);", "fmax(peak, fmin(sigma, 1e30f));",
     "sums over leaves: largest density"},
    {"shell space", "shell.h", "0.5f * w * u", "0.5001f * w * u",
     "shell space: places along the lines"},
    {"splatting", "splat.cl", "const float t = fmax(", "const float t = 1.0001f * fmax(",
     "splatting: depth along its ray"},
    {"splatting", "splat.cl", "= bfloat16_value(LEAF_ELEMENT(density, values[i], cells));",
     "= fmin(bfloat16_value(LEAF_ELEMENT(density, values[i], cells)), 1e30f);",
     "splatting: density"},
    {"splatting", "splat.cl", "(uint)(keys[i - 1u] >> 32) + 1u", "(uint)(keys[i - 1u] >> 32)",
     "splatting: lists and their order"},
    {"splatting", "splat.cl", "sigma * spacing >= min_alpha", "sigma * spacing > min_alpha",
     "splatting: samples that a view has"},
    {"splatting", "stage1.h", "0.5f * length : distance", "0.51f * length : distance",
     "splatting: optical depth of intervals"},
    /* the left half of an image's first column */
    {"splatting", "stats.cl", "point_pixel(cameras[v], point, &pixel);",
     "point_pixel(cameras[v], point, &pixel) && pixel.x > 0.5f;",
     "splatting: cells that a view sees"},
    {"splatting, faint samples", "splat.cl", "(uint)pixel.x / grid.coarse_x,",
     "(uint)(pixel.x + 0.01f) / grid.coarse_x,",
     "splatting, faint samples: distance from the list's square"},
    {"scan and sort", "scan.cl", "at += value;", "at += value & 0x7FFFFFFFu;",
     "scan and sort: scan"},
};
enum { FAULTS = sizeof faults / sizeof *faults };

/* Sanitizers see the host's code alone, of which each fault runs the same: there the first few. */
static void test_notices(void **state)
{
    (void)state;
    NEED_DEVICE();
    for (size_t i = 0, next = 0; i < (SANITIZED ? 5 : FAULTS); i = next) {
        const char *subject = faults[i].subject, *kernels = NULL;
        char folder[32];
        tally t = {0};

        snprintf(folder, sizeof folder, "wrong %zu", i);
        for (next = i; next < FAULTS && strcmp(faults[next].subject, subject) == 0; next++)
            kernels = fixture_kernels_changed(folder, faults[next].file, faults[next].from,
                                              faults[next].to);
        assert_int_equal(run(kernels, NULL, subject, &t), CLN_CHECK);
        assert_non_null(strstr(cln_error_text(), "at extremes"));
        cln_clear_error();
        for (size_t k = i; k < next; k++)
            if (!strstr(t.failures, faults[k].row))
                fail_msg("%s with \"%s\": failed are\n%s", faults[k].file, faults[k].to,
                         t.failures);
    }
}

int test_group_extremes(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_twin_is_no_number),
        cmocka_unit_test(test_passes),
        cmocka_unit_test(test_passes_with_others),
        cmocka_unit_test(test_notices),
    };

    return cmocka_run_group_tests_name("extremes", tests, fixture_setup_folder, fixture_teardown);
}
