/* `cl-nascent selftest`: one line per check as it ends, then the count; with --json one
 * document. */
#include "cli/commands.h"

#include <stdio.h>
#include "cli/console.h"

typedef struct tally {
    bool json;
    json_t *checks;
    int passed, failed, skipped;
} tally;

static void on_check(const char *name, bool passed, bool skipped, const char *detail, void *user)
{
    tally *t = user;
    const char *verdict = skipped ? "skipped" : passed ? "passed" : "failed";

    *(skipped ? &t->skipped : passed ? &t->passed : &t->failed) += 1;
    if (t->json) {
        json_array_append_new(t->checks, json_pack("{s:s s:s s:s}", "name", name, "verdict",
                                                   verdict, "detail", detail ? detail : ""));
        return;
    }
    printf("%-7s  %-52s  %s\n", verdict, name, detail ? detail : "");
    fflush(stdout);
}

cln_status cln_cmd_selftest(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_status tested = CLN_OK;
    tally t = {.json = options->json, .checks = json_array()};

    tested = options->extremes
                 ? cln_selftest_extremes(&options->device, options->quick, on_check, &t)
                 : cln_selftest(&options->device, options->quick, on_check, &t);
    if (tested != CLN_OK && tested != CLN_CHECK)
        CLN_TRY(tested);
    if (options->json)
        CLN_TRY(cln_print_json(json_pack("{s:s s:i s:i s:i s:O}", "schema", "cl-nascent.selftest/1",
                                         "passed", t.passed, "failed", t.failed, "skipped",
                                         t.skipped, "checks", t.checks)));
    else
        printf("%d checks: %d passed, %d failed, %d skipped\n", t.passed + t.failed + t.skipped,
               t.passed, t.failed, t.skipped);
    st = tested;
done:
    json_decref(t.checks);
    return st;
}
