/* The self-test at extremes (selftest --extremes): its rows pass with the parameters of several
 * kinds of devices, and each kind of row can fail: a kernel is made wrong in a way that ordinary
 * numbers hardly show, and its row must name it. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "check/extremes.h"
#include "run_fixture.h"
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

static void test_passes(void **state)
{
    tally t = {0};

    (void)state;
    NEED_DEVICE();
    assert_ok(run(NULL, NULL, NULL, &t));
    assert_int_equal(t.failed, 0);
    assert_true(t.passed >= 55);
}

/* A GPU's parameters, and wide vectors with odd tiles, where these matter. */
static void test_passes_with_others(void **state)
{
    static const char gpu[] =
        "VW=1,NV=1,LS=64,TS=8,NB=16,SL=128,WG=64,SG=256,DB=8,CHUNK=2048,LEAF=0";
    static const char wide[] = "VW=16,NV=1,LS=1,TS=4,NB=12,SL=48,WG=8,SG=8,DB=7,CHUNK=100";
    tally t = {0};

    (void)state;
    NEED_DEVICE();
    assert_ok(run(NULL, gpu, "composite", &t));
    assert_ok(run(NULL, gpu, "scan and sort", &t));
    assert_ok(run(NULL, wide, "rays", &t));
    assert_int_equal(t.failed, 0);
}

/* Faults, and the row that must fail. */
static const struct {
    const char *file, *from, *to, *subject, *row;
} faults[] = {
    /* alpha cancels for faint samples */
    {"lanes.h", "(x) < (T)(0.15f))", "(x) < (T)(0.0f))", "composite", "composite: opacity"},
    {"lanes.h", "(x) < (T)(0.15f))", "(x) < (T)(0.0f))", "distillation", "distillation: loss"},
    /* transmittance rounds faint samples away */
    {"composite.cl", "through = EXP(-tau);", "through *= 1.0f - alpha;", "composite",
     "composite: transmittance"},
    {"composite.cl", "fmin(o.w, 1e6f)", "o.w", "composite, cauchy", "composite, cauchy: "},
    /* t of far cameras begins at the camera */
    {"camera.h", "if (c.start > 0.0f) {", "if (c.start > 5e4f) {", "rays",
     "rays: place near the cube"},
    {"lens.h", "r * fabs(omega) < M_PI_2_F", "true", "rays",
     "rays: share of pixels judged otherwise"},
    /* slopes of 1e-4 count as none */
    {"walk.h", "(vf)(1e-12f)", "(vf)(1e-3f)", "rays", "grazing rays: samples in their leaf"},
    {"space.h", "fmax(p.z, 1.0f)", "fmax(p.z, 0.9f)", "forward space",
     "forward space: where rays begin"},
    {"network.h", "z > 70.0f)", "z > 1e30f)", "networks, exp", "networks, exp: "},
    {"adam.h", ") + EPSILON);", "));", "networks, float moments",
     "networks, float moments: Adam's step"},
    {"scan.cl", "at += value;", "at += value & 0x7FFFFFFFu;", "scan and sort",
     "scan and sort: scan"},
};

static void test_notices(void **state)
{
    (void)state;
    NEED_DEVICE();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++) {
        char folder[32];
        const char *kernels = NULL;
        tally t = {0};

        snprintf(folder, sizeof folder, "wrong %zu", i);
        kernels = fixture_kernels_changed(folder, faults[i].file, faults[i].from, faults[i].to);
        assert_int_equal(run(kernels, NULL, faults[i].subject, &t), CLN_CHECK);
        assert_non_null(strstr(cln_error_text(), "at extremes"));
        cln_clear_error();
        if (!strstr(t.failures, faults[i].row))
            fail_msg("%s with \"%s\": failed are\n%s", faults[i].file, faults[i].to, t.failures);
    }
}

int test_group_extremes(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_passes),
        cmocka_unit_test(test_passes_with_others),
        cmocka_unit_test(test_notices),
    };

    return cmocka_run_group_tests_name("extremes", tests, fixture_setup, fixture_teardown);
}
