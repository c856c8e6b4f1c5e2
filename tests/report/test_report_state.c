/* The report of a run that is broken off: what can be done with it. Oracle: literal texts. */
#include "unit.h"
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>
#include "io/run_folder.h"
#include "report/report.h"
#include "report/report_data.h"
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

/* Of a run that another process trains all is shown: its checkpoint is behind its figures. */
static void test_held_by_another(void **state)
{
    const char *run = *state;
    char byte = 0;
    int holds[2], ends[2];
    pid_t child = -1;

    put_text(run, "run.json", "{\"schema\":\"cl-nascent.run/1\",\"result\":{\"step\":20}}");
    assert_int_equal(cln_make_dirs(scratch_path(run, "eval")), CLN_OK);
    put_text(run, "eval/00000020-test.json", "{\"step\":20,\"split\":\"test\"}");
    assert_int_equal(pipe(holds), 0);
    assert_int_equal(pipe(ends), 0);
    child = fork();
    if (child == 0) {
        int lock = -1;

        close(ends[1]);
        if (cln_run_hold(run, &lock) == CLN_OK && write(holds[1], "x", 1) == 1)
            (void)!read(ends[0], &byte, 1);
        _exit(0);
    }
    assert_true(child > 0);
    close(holds[1]);
    assert_int_equal(read(holds[0], &byte, 1), 1);
    for (int held = 1; held >= 0; held--) {
        cln_report_data data;

        assert_int_equal(cln_report_data_read(run, 10, &data), CLN_OK);
        assert_int_equal(data.eval_count, held);
        assert_true(isnan(data.gone) == (held == 1));
        cln_report_data_free(&data);
        close(held ? ends[1] : ends[0]);
        assert_int_equal(held ? waitpid(child, NULL, 0) : child, child);
    }
    close(holds[0]);
}

int test_group_report_state(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_broken_off, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_held_by_another, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("report_state", tests, NULL, NULL);
}
