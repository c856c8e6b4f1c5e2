/* `cl-nascent tune`: settings -> cln_tune_search, then the sets that were tried, the best one, and
 * the file that has its row. */
#include "cli/commands.h"

#include <stdio.h>
#include <string.h>
#include "base/settings.h"
#include "base/text.h"
#include "cli/console.h"
#include "io/json.h"

static const char *const verdicts[] = {[CLN_SET_REFUSED] = "refused",
                                       [CLN_SET_SLOWER] = "not faster",
                                       [CLN_SET_TAKEN] = "taken",
                                       [CLN_SET_UNDECIDED] = "not timed"};

static json_t *try_json(const cln_tune_try *try)
{
    return json_pack("{s:s s:s s:s* s:o s:o s:o s:i s:i}", "tune", try->tune, "verdict",
                     verdicts[try->verdict], "reason", *try->reason ? try->reason : NULL, "seconds",
                     cln_json_real(try->seconds), "against", cln_json_real(try->against), "ratio",
                     cln_json_real(try->ratio), "pairs", try->pairs, "slower", try->slower);
}

static cln_status print_json(const cln_tune_result *r, const char *file)
{
    json_t *tries = json_array();

    for (int i = 0; i < r->count; i++)
        json_array_append_new(tries, try_json(&r->tries[i]));
    return cln_print_json(json_pack(
        "{s:s s:s s:s s:s s:s s:s s:s* s:o s:o s:i s:i s:i s:b s:o}", "schema", "cl-nascent.tune/1",
        "device", r->device.name, "driver", r->device.driver, "network", r->network, "tune",
        r->tune, "row", r->row, "file", file, "seconds", cln_json_real(r->seconds), "gain",
        cln_json_real(r->gain), "rays", r->rays, "samples", r->samples, "leaves", r->leaves,
        "complete", r->complete, "tries", tries));
}

/* leaves: "voxels" or "networks"; read: other commands read this file anyway */
static void print_result(const cln_tune_result *r, const char *leaves, const char *file, bool read)
{
    int count[4] = {0}, compared = 0;

    for (int i = 0; i < r->count; i++) {
        count[r->tries[i].verdict]++;
        compared += r->tries[i].pairs > 0;
        if (r->tries[i].verdict == CLN_SET_REFUSED)
            printf("refused     %s: %s\n", r->tries[i].tune, r->tries[i].reason);
    }
    printf("device      %s (driver %s)\n", r->device.name, r->device.driver);
    printf("%-10s  %s; a step of %d rays, %d samples in %d %s\n", leaves, r->network, r->rays,
           r->samples, r->leaves, cln_plural(r->leaves, "leaf", "leaves"));
    printf("tried       %d set%s: %d refused, %d not faster, %d not timed; %s\n", r->count,
           cln_plural(r->count, "", "s"), count[CLN_SET_REFUSED], count[CLN_SET_SLOWER],
           count[CLN_SET_UNDECIDED],
           r->complete ? "no better one is known" : "--budget ended the search");
    if (!r->complete && compared == 0)
        printf("            no set was compared with the first, as building kernels took the time; "
               "those that\n            were built are kept: run it again, or give more "
               "--budget\n");
    printf("best        %s\n", r->tune);
    printf("time        %.4g ms a step, %.2f times as fast as the set that the search began with\n",
           1e3 * r->seconds, r->gain);
    if (file)
        printf("written to  %s\nused        for such %s %s%s\n", file, leaves,
               read ? "from now on" : "with --tune-file ", read ? "" : file);
    printf("%s\n", r->row);
}

cln_status cln_cmd_tune(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_console console = {0};
    cln_tune_result result = {0};
    cln_tune_desc desc = {.device = options->device,
                          .settings = options->settings,
                          .budget = options->budget,
                          .file = options->output ? options->output : options->tune_path};

    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    st = cln_tune_search(&desc, &result);
    cln_console_close(&console);
    CLN_TRY(st);
    if (options->json)
        CLN_TRY(print_json(&result, desc.file));
    else
        print_result(&result, cln_leaf_kind_of(options->settings->config.encoding)->name, desc.file,
                     options->tune_path && strcmp(desc.file, options->tune_path) == 0);
done:
    cln_console_close(&console);
    cln_tune_free(&result);
    return st;
}
