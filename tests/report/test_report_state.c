/* The report of a run that is broken off: what can be done with it. Oracle: literal texts. */
#include "unit.h"
#include <stdlib.h>
#include <string.h>
#include "report/report.h"
#include "scratch.h"
#include "tests.h"

static void put_text(const char *run, const char *name, const char *text)
{
    scratch_put(scratch_path(run, name), text, strlen(text));
}

static void assert_page(const char *run, const char *part, bool there)
{
    char *page = NULL;
    size_t bytes = 0;

    assert_int_equal(cln_report_write(run, INT64_MAX), CLN_OK);
    page = scratch_get(scratch_path(run, "report.html"), &bytes);
    if (!strstr(page, part) == there)
        fail_msg("'%s' is %s the page", part, there ? "not in" : "in");
    free(page);
}

/* It goes on from a checkpoint, if it has one. */
static void test_broken_off(void **state)
{
    const char *run = *state;

    put_text(run, "run.json", "{\"schema\":\"cl-nascent.run/1\",\"state\":\"running\"}");
    put_text(run, "lock", "process 1 on nowhere\n");
    assert_page(run, "ended without a word", true);
    assert_page(run, "before the first checkpoint", true);
    assert_page(run, "--resume", false);
    assert_int_equal(cln_make_dirs(scratch_path(run, "checkpoint")), CLN_OK);
    put_text(run, "checkpoint/00000010.json", "{}");
    assert_page(run, "ended without a word", true);
    assert_page(run, "before the first checkpoint", false);
    assert_page(run, "train --resume", true);
}

int test_group_report_state(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_broken_off, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("report_state", tests, NULL, NULL);
}
