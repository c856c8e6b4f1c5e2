/* The library's calls that ask of devices: the self-test, which names a wrong kernel, and the
 * list. */
#include "unit.h"
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include "run_fixture.h"
#include "tests.h"

typedef struct tally {
    int passed, failed;
    char first[128];
} tally;

static void on_check(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    tally *t = user;

    assert_non_null(detail);
    if (!passed && !skipped && t->failed == 0)
        snprintf(t->first, sizeof t->first, "%s", name);
    t->passed += passed;
    t->failed += !passed && !skipped;
}

typedef struct work {
    int calls, done, total;
} work;

static void on_work(const char *what, int done, int total, void *user)
{
    work *w = user;

    assert_string_equal(what, "checking kernels");
    assert_true(w->calls == 0 ? done == 0 : done == w->done + 1); /* at the start, and one by one */
    *w = (work){w->calls + 1, done, total};
}

static int on_poll(void *user)
{
    (void)user;
    return SIGINT;
}

static void test_selftest_passes(void **state)
{
    const cln_device_desc device = fixture_device();
    cln_device_info *devices = NULL;
    tally t = {0};
    work worked = {0};
    int count = 0;

    NEED_DEVICE();
    assert_ok(cln_selftest(&device, true, on_check, &t));
    assert_true(t.passed > 30);
    assert_int_equal(t.failed, 0);
    assert_ok(cln_devices_list(&device, true, &devices, &count));
    assert_true(count > 0);
    for (int i = 0; i < count; i++)
        assert_true(devices[i].verdict[0] != 0 && devices[i].name[0] != 0);
    memset(devices[0].verdict, 0, sizeof devices[0].verdict);
    assert_ok(
        cln_devices_test(&device, 0, &(cln_callbacks){.work = on_work, .user = &worked}, devices));
    assert_true(devices[0].verdict[0] != 0);
    assert_true(worked.calls > 1);
    assert_int_equal(worked.done, worked.total);
    assert_fails(cln_devices_test(&device, count, NULL, devices), CLN_NO_DEVICE,
                 "no device number");
    assert_fails(cln_devices_test(&device, 0, &(cln_callbacks){.interrupted = on_poll}, devices),
                 CLN_SIGINT, "stopped by a signal");
    free(devices);
}

/* The self-test detects and names a kernel that builds but computes something else; of others
 * test_selftest.c shows it in smaller shapes, which build faster. */
static void check_wrong_kernel(const char *file, const char *from, const char *to, const char *name)
{
    cln_device_desc device = fixture_device();
    char folder[32];
    tally t = {0};

    snprintf(folder, sizeof folder, "wrong %s", name);
    device.kernel_dir = fixture_kernels_changed(folder, file, from, to);
    assert_fails(cln_selftest(&device, true, on_check, &t), CLN_CHECK, name);
    assert_true(t.failed > 0);
    assert_non_null(strstr(t.first, name));
}

static void test_selftest_notices(void **state)
{
    NEED_DEVICE();
    check_wrong_kernel("composite.cl", "behind[l] = EXP(-behind[l]);",
                       "behind[l] = EXP(-0.99f * behind[l]);", "composite");
}

int test_group_devices(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_selftest_passes),
        cmocka_unit_test(test_selftest_notices),
    };

    return cmocka_run_group_tests_name("devices", tests, fixture_setup, fixture_teardown);
}
