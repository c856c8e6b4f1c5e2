/* The tuner (cln_tune_search): it ends, writes a row that matches, and never times or chooses a set
 * whose kernels compute wrong results. Oracle: kernels made wrong on purpose, for some sets or for
 * all. Asserts no speed. */
#include <stdarg.h>
#include <stddef.h>
#include <setjmp.h>
#include <stdint.h>
#include <cmocka.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "device/tune.h"
#include "run_fixture.h"
#include "tests.h"

/* Appended to lanes.h: makes sums of products slightly wrong. */
#define WRONG "#undef MAD\n#define MAD(a, b, c) (1.001f * fma((a), (b), (c)))\n"

static cln_tune_desc tuner_desc(const char *kernel_dir, const char *tune)
{
    static cln_settings settings; /* outlives the desc */
    cln_tune_desc desc = {.device = fixture_device(), .settings = &settings, .budget = 600};

    settings.config = fixture_config();
    settings.config.batch_samples = 256;
    desc.device.tune = tune;
    if (kernel_dir)
        desc.device.kernel_dir = kernel_dir;
    return desc;
}

/* All sets but those with tiles of 4 samples are made wrong: none of these may be timed or
 * chosen. */
static void test_wrong_sets_are_refused(void **state)
{
    const char *wrong =
        fixture_kernels_with("wrong", "#if defined(TS) && TS != 4\n" WRONG "#endif");
    cln_tune_desc desc = tuner_desc(wrong, "VW=4,NV=1,TS=4,NB=16");
    const char *file = fixture_path("found.txt");
    cln_tune_result r;
    cln_tune_rows *rows = NULL;
    int refused = 0;

    NEED_DEVICE();
    desc.max_tries = 4;
    desc.file = file;
    assert_ok(cln_tune_search(&desc, &r));
    assert_in_range(r.count, 2, 4);
    for (int i = 0; i < r.count; i++) {
        if (strstr(r.tries[i].tune, "TS=4,"))
            continue;
        refused++;
        assert_int_equal(r.tries[i].verdict, CLN_SET_REFUSED);
        assert_true(isnan(r.tries[i].seconds));
        assert_non_null(strstr(r.tries[i].reason, "these networks: "));
    }
    assert_true(refused > 0);
    assert_non_null(strstr(r.tune, "TS=4,"));
    assert_string_equal(r.network, "W16-D2-V16");
    assert_true(r.seconds > 0);
    assert_ok(cln_tune_rows_read(file, &rows)); /* the row matches device and network */
    assert_non_null(cln_tune_rows_find(rows, r.device.name, r.device.driver, r.network));
    assert_string_equal(rows->row[0].list, r.tune);
    cln_tune_rows_free(rows);
    cln_tune_free(&r);
}

/* If its first set is wrong, the tuner starts from the plain one; even the smallest budget ends
 * with a correct set. */
static void test_wrong_start(void **state)
{
    const char *wrong = fixture_kernels_with("wrong", "#if VW > 1\n" WRONG "#endif");
    cln_tune_desc desc = tuner_desc(wrong, "VW=4");
    cln_tune_result r;

    NEED_DEVICE();
    desc.budget = 0.01;
    assert_ok(cln_tune_search(&desc, &r));
    assert_int_equal(r.tries[0].verdict, CLN_SET_REFUSED);
    assert_int_equal(r.tries[1].verdict, CLN_SET_TAKEN);
    assert_int_equal(r.count, 2);
    assert_memory_equal(r.tune, "VW=1,NV=1,LS=1,", 15);
    assert_false(r.complete);
    cln_tune_free(&r);
}

static void test_nothing_is_right(void **state)
{
    const char *wrong = fixture_kernels_with("wrong", WRONG);
    cln_tune_desc desc = tuner_desc(wrong, "VW=4");
    const char *file = fixture_path("never.txt");
    cln_tune_result r;

    NEED_DEVICE();
    desc.file = file;
    assert_fails(cln_tune_search(&desc, &r), CLN_CHECK, "these networks: ");
    assert_false(cln_is_file(file));
}

static void test_tuner_stops(void **state)
{
    fixture_stop stop = {.signal = SIGINT, .pictures = 1};
    cln_tune_desc desc = tuner_desc(NULL, "VW=4");
    const char *file = fixture_path("never.txt");
    cln_tune_result r;

    NEED_DEVICE();
    desc.callbacks = fixture_callbacks(&stop);
    desc.callbacks.train = NULL;
    desc.file = file;
    assert_fails(cln_tune_search(&desc, &r), CLN_SIGINT, "signal");
    assert_false(cln_is_file(file));
}

int test_group_tuner(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_wrong_sets_are_refused),
        cmocka_unit_test(test_wrong_start),
        cmocka_unit_test(test_nothing_is_right),
        cmocka_unit_test(test_tuner_stops),
    };

    return cmocka_run_group_tests_name("tuner", tests, fixture_setup, fixture_teardown);
}
