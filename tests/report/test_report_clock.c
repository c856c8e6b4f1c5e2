/* The report's clock over the processes that trained a run, by rows as metrics.jsonl has them.
 * Oracle: sums by hand. */
#include "unit.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "report/report.h"
#include "scratch.h"
#include "tests.h"

enum { MOST_ROWS = 4 };

typedef struct row {
    const char *from_step; /* "" of an older run */
    double wall, bytes;
} row;

static void put_rows(const char *run, const row rows[MOST_ROWS])
{
    FILE *f = NULL;

    assert_int_equal(cln_make_dirs(run), CLN_OK);
    f = fopen(scratch_path(run, "metrics.jsonl"), "w");
    assert_non_null(f);
    for (int i = 0; i < MOST_ROWS && rows[i].wall > 0; i++)
        fprintf(f,
                "{\"step\":%d,\"seconds\":%d,\"wall_seconds\":%g,%s\"ranks\":2,\"sent_bytes\":%g,"
                "\"message_seconds\":1,\"stages\":{\"forward\":1}}\n",
                10 * (i + 1), 2 * (i + 1), rows[i].wall, rows[i].from_step, rows[i].bytes);
    assert_int_equal(fclose(f), 0);
}

/* Each process adds its last row's clock and bytes, however long it took to its first. */
static void test_processes(void **state)
{
    static const struct {
        const char *name;
        row rows[MOST_ROWS];
        const char *clock, *bytes;
    } cases[] = {
        {"one",
         {{"\"from_step\":0,", 9, 1e3}, {"\"from_step\":0,", 30, 4e3}},
         "; 00:30 by the clock",
         "sent, per step<td class=n>200\n"},
        {"a long start",
         {{"\"from_step\":0,", 9, 1e3},
          {"\"from_step\":10,", 30, 3e3},
          {"\"from_step\":10,", 34, 5e3}},
         "; 00:43 by the clock", /* 9 + 34 */
         "sent, per step<td class=n>200\n"},
        {"three processes",
         {{"\"from_step\":0,", 9, 1e3},
          {"\"from_step\":10,", 30, 3e3},
          {"\"from_step\":20,", 20, 2e3}},
         "; 00:59 by the clock",
         "sent, per step<td class=n>200\n"},
        {"one of an older program before",
         {{"", 9, 1e3}, {"\"from_step\":10,", 30, 3e3}},
         "; 00:39 by the clock",
         "sent, per step<td class=n>200\n"},
        {"older ones",
         {{"", 9, 4e3}, {"", 8, 5e3}, {"", 12, 8e3}},
         "; 00:21 by the clock", /* 9 + 12 */
         "sent, per step<td class=n>400\n"},
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *run = scratch_path(*state, cases[i].name);
        char *page = NULL;
        size_t bytes = 0;

        put_rows(run, cases[i].rows);
        assert_int_equal(cln_report_write(run, INT64_MAX), CLN_OK);
        page = scratch_get(scratch_path(run, "report.html"), &bytes);
        if (!strstr(page, cases[i].clock) || !strstr(page, cases[i].bytes))
            fail_msg("%s: not '%s' and '%s'", cases[i].name, cases[i].clock, cases[i].bytes);
        free(page);
    }
}

/* What a process did after its last row is in the result alone. */
static void test_result(void **state)
{
    static const row rows[MOST_ROWS] = {{"\"from_step\":0,", 9, 1e3},
                                        {"\"from_step\":10,", 30, 3e3}};
    static const struct {
        const char *wall, *clock;
    } cases[] = {
        {"50", "; 00:59 by the clock"},
        {"null", "; 00:39 by the clock"},
        {"20", "; 00:39 by the clock"}, /* of a process before */
    };

    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *run = scratch_path(*state, "run");
        char text[160], *page = NULL;
        size_t bytes = 0;

        put_rows(run, rows);
        snprintf(text, sizeof text,
                 "{\"schema\":\"cl-nascent.run/1\",\"state\":\"done\",\"result\":"
                 "{\"wall_seconds\":%s}}",
                 cases[i].wall);
        scratch_put(scratch_path(run, "run.json"), text, strlen(text));
        assert_int_equal(cln_report_write(run, INT64_MAX), CLN_OK);
        page = scratch_get(scratch_path(run, "report.html"), &bytes);
        if (!strstr(page, cases[i].clock))
            fail_msg("a result of %s seconds: not '%s'", cases[i].wall, cases[i].clock);
        free(page);
    }
}

int test_group_report_clock(void)
{
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(test_processes, scratch_make, scratch_remove),
        cmocka_unit_test_setup_teardown(test_result, scratch_make, scratch_remove),
    };

    return cmocka_run_group_tests_name("report_clock", tests, NULL, NULL);
}
