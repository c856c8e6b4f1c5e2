/* The ordinary self-test (cl-nascent selftest), in its smallest shapes: each of these rows can
 * fail. Kernels are made wrong in one number, and the rows of that number must name it; all pass
 * with the kernels as they are. */
#include "unit.h"
#include <stdio.h>
#include <string.h>
#include "check/selftest.h"
#include "run_fixture.h"
#include "tests.h"

typedef struct tally {
    int passed;
    char failures[8192]; /* names of rows, a line each */
} tally;

static void on_row(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    tally *t = user;
    const size_t used = strlen(t->failures);

    assert_true(passed || !skipped);
    t->passed += passed;
    if (!passed) {
        print_message("%s: %s\n", name, detail);
        snprintf(t->failures + used, sizeof t->failures - used, "%s\n", name);
    }
}

static cln_status run(const char *kernel_dir, tally *t)
{
    cln_status st = CLN_OK;
    const cln_selftest_plan plan = {.shapes = CLN_SHAPES_TINY, .sink = on_row, .user = t};
    cln_device_desc desc = fixture_device();
    cln_device *device = NULL;

    if (kernel_dir)
        desc.kernel_dir = kernel_dir;
    CLN_TRY(cln_device_open(&desc, &device));
    CLN_TRY(cln_selftest_device(device, &plan));
done:
    cln_device_close(device);
    return st;
}

static void test_passes(void **state)
{
    tally t = {0};

    NEED_DEVICE();
    assert_ok(run(NULL, &t));
    assert_string_equal(t.failures, "");
    assert_true(t.passed >= 60);
}

/* What is changed, and a row that it makes fail. All are in one set of kernels, as building takes
 * most of the time; but for those of samples none changes the numbers that another one's row
 * compares. */
static const struct {
    const char *file, *from, *to, *row;
} faults[] = {
    {"rays.cl", "    ray_o[r] = o;", "    ray_o[r] = o * 1.001f;", ": rays\n"},
    /* samples behind their leaves, with lengths that add up; then lengths that do not */
    {"sampling.cl", "= {ts[l], deltas[l],", "= {ts[l] + 4.0f, deltas[l],", ": samples: order\n"},
    {"sampling.cl", "4.0f, deltas[l],", "4.0f, deltas[l] * 1.0001f,",
     ": samples: deltas add up to the chord\n"},
    {"sampling.cl", "v = {t->of.t_in[l], t->of.t_out[l],",
     "v = {t->of.t_in[l], t->of.t_out[l] + 1e-3f,", ": intervals: chord of a ray\n"},
    {"sampling.cl", "uniform_share / length", "uniform_share", ": samples: t\n"},
    {"composite.cl", "behind[l] = EXP(-behind[l]);", "behind[l] = EXP(-1.001f * behind[l]);",
     ": composite\n"},
    {"adam.h", ") + EPSILON);", ") * 1.01f + EPSILON);", ": adam\n"},
    {"regularise.cl", "p = box.xyz + u.xyz * box.w;", "p = box.xyz + 1.1f * u.xyz * box.w;",
     ": points of the volume\n"},
    {"turns.cl", "k < n", "k < min(n, 15u)", "loops: turns\n"},
    {"voxel.cl", "if (c[a] > 0)", "if (c[a] > 1)", "tiny, voxels: networks backward\n"},
};

static void test_notices(void **state)
{
    const char *kernels = NULL;
    cln_device_desc desc = fixture_device();
    tally t = {0};

    NEED_DEVICE();
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        kernels = fixture_kernels_changed("wrong", faults[i].file, faults[i].from, faults[i].to);
    assert_fails(run(kernels, &t), CLN_CHECK,
                 "wrong: loops: turns: it ends before 256 turns, and more; mend these");
    for (size_t i = 0; i < sizeof faults / sizeof *faults; i++)
        if (!strstr(t.failures, faults[i].row))
            fail_msg("%s with \"%s\": failed are\n%s", faults[i].file, faults[i].to, t.failures);
    desc.kernel_dir = kernels; /* a driver that ends loops has crashed in longer ones */
    assert_fails(cln_selftest_extremes(&desc, true, NULL, NULL), CLN_CHECK, ": loops: turns: ");
}

/* A wrong scan by itself: nothing that needs its sums runs after it. */
static void test_notices_scan(void **state)
{
    tally t = {0};

    NEED_DEVICE();
    assert_fails(
        run(fixture_kernels_changed("wrong scan", "scan.cl", "at += value;", "at += value + 1u;"),
            &t),
        CLN_CHECK, "scan");
    assert_non_null(strstr(t.failures, ": scan"));
}

int test_group_selftest(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_passes),
        cmocka_unit_test(test_notices),
        cmocka_unit_test(test_notices_scan),
    };

    return cmocka_run_group_tests_name("selftest", tests, fixture_setup_folder, fixture_teardown);
}
