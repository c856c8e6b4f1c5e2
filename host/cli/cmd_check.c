/* `cl-nascent check`: the library's JSON about a scene, as it is or as sentences: what was found,
 * likely faults first, then the measures that people look for. */
#include "cli/commands.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "cli/console.h"
#include "io/json.h"

enum { COLUMNS = 96, INDENT = 9 };

/* In lines of the terminal's width, without one of COLUMNS; all but the first have an INDENT. */
static void print_wrapped(int column, const char *text)
{
    const int has = cln_stdout_columns(COLUMNS);

    cln_print_wrapped(column, INDENT, has < COLUMNS ? has : COLUMNS, text);
}

static const char *text_of(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));

    return text ? text : "-";
}

/* Does the finding's sentence leave out photos that it is about? */
static bool leaves_out(const json_t *finding)
{
    const json_t *views = json_object_get(finding, "views");

    for (size_t i = 0; i < json_array_size(views); i++)
        if (!strstr(text_of(finding, "text"), json_string_value(json_array_get(views, i))))
            return true;
    return false;
}

static void print_views(const json_t *views)
{
    char *text = NULL;

    for (size_t i = 0; i < json_array_size(views); i++)
        if (cln_append(&text, "%s%s", i ? ", " : "", json_string_value(json_array_get(views, i))) !=
            CLN_OK)
            break;
    if (text)
        print_wrapped(printf("%*sall: ", INDENT, ""), text);
    free(text);
}

static void print_findings(const json_t *findings, bool all)
{
    const size_t count = json_array_size(findings);
    size_t faults = 0;
    bool more = false;

    for (size_t i = 0; i < count; i++)
        faults += json_is_true(json_object_get(json_array_get(findings, i), "likely_fault"));
    printf("%zu likely fault%s, %zu remark%s\n", faults, cln_plural(faults, "", "s"),
           count - faults, cln_plural(count - faults, "", "s"));
    for (size_t i = 0; i < count; i++) {
        const json_t *one = json_array_get(findings, i);
        const bool fault = json_is_true(json_object_get(one, "likely_fault"));
        const int column = printf("  %s %s: ", fault ? "FAULT " : "remark", text_of(one, "what"));

        print_wrapped(column, text_of(one, "text"));
        if (all && leaves_out(one))
            print_views(json_object_get(one, "views"));
        more |= leaves_out(one);
    }
    if (more && !all)
        print_wrapped(printf("%*s", INDENT, ""), "(all the photos that are meant: -v)");
}

/* Photos that share nothing have fewer measures. */
static void print_overlap(const json_t *measures)
{
    const double agreeing = cln_json_number(measures, "agreeing_share");
    const double partners = cln_json_number(measures, "mean_partners");
    char line[512];

    if (isnan(agreeing) && cln_json_number(measures, "ties") > 0)
        snprintf(line, sizeof line, "%.0f mark%s that two photos share: too few to tell",
                 cln_json_number(measures, "ties"),
                 cln_plural(cln_json_number(measures, "ties"), "", "s"));
    else if (isnan(agreeing))
        snprintf(line, sizeof line, "no two photos share a mark");
    else
        snprintf(line, sizeof line,
                 "%.0f%% of %.0f marks that two photos share lie where both poses put them",
                 100 * agreeing, cln_json_number(measures, "ties"));
    if (!isnan(partners))
        snprintf(line + strlen(line), sizeof line - strlen(line),
                 "; a photo shares much with %.2g of those that it was compared with", partners);
    print_wrapped(printf("overlap  "), line);
}

static void print_measures(const json_t *document)
{
    const json_t *measures = json_object_get(document, "measures");
    const json_t *scene = json_object_get(document, "scene");
    const json_t *splits = json_object_get(scene, "splits");
    const double fov[2] = {cln_json_number(measures, "fov_least"),
                           cln_json_number(measures, "fov_most")};
    char line[512], least[32], most[32];
    bool one = false;

    snprintf(line, sizeof line, "%.0f train, %.0f val, %.0f test, as %s; %s",
             cln_json_number(splits, "train"), cln_json_number(splits, "val"),
             cln_json_number(splits, "test"), text_of(scene, "dialect"),
             text_of(scene, "split_rule"));
    print_wrapped(printf("photos   "), line);
    if (json_is_object(json_object_get(scene, "masks")))
        print_wrapped(printf("masks    "), text_of(json_object_get(scene, "masks"), "because"));
    snprintf(least, sizeof least, "%.3g", fov[0]);
    snprintf(most, sizeof most, "%.3g", fov[1]);
    one = strcmp(least, most) == 0;
    snprintf(line, sizeof line, "%.0f inside the cube, %.0f outside",
             cln_json_number(measures, "cameras_inside"),
             cln_json_number(measures, "cameras_outside"));
    if (!isnan(fov[0]) && !isnan(fov[1])) /* panoramas have none */
        snprintf(line + strlen(line), sizeof line - strlen(line), "; field of view %s%s%s degrees",
                 one ? "" : least, one ? "" : " to ", most);
    print_wrapped(printf("cameras  "), line);
    snprintf(line, sizeof line, "half side %.6g, %s; %.1f%% of the training rays meet it",
             cln_json_number(scene, "half"), text_of(scene, "bounds_rule"),
             100 * cln_json_number(measures, "cube_share"));
    if (!isnan(cln_json_number(measures, "points_inside")))
        snprintf(line + strlen(line), sizeof line - strlen(line),
                 ", it holds %.0f%% of what the photos show",
                 100 * cln_json_number(measures, "points_inside"));
    print_wrapped(printf("cube     "), line);
    print_overlap(measures);
}

/* Milliseconds with three digits, but without an exponent. */
static const char *in_ms(double seconds, char text[32])
{
    snprintf(text, 32, 1e3 * seconds < 999.5 ? "%.3g" : "%.0f", 1e3 * seconds);
    return text;
}

/* A sentence, if there is one, in a line of its own. */
static void print_note(const json_t *training, const char *key)
{
    const char *text = json_string_value(json_object_get(training, key));

    if (text)
        print_wrapped(printf("%*s", INDENT, ""), text);
}

static void print_training(const json_t *training)
{
    const json_t *time = json_object_get(training, "time");
    char line[768], need[3][32], limit[3][32], duration[3][32], range[160] = "";
    char step[4][32];

    if (json_is_string(json_object_get(training, "no_device"))) {
        print_wrapped(printf("training "), text_of(training, "no_device"));
        return;
    }
    cln_format_bytes(cln_json_number(training, "device_memory"), need[0]);
    cln_format_bytes(cln_json_number(training, "device_memory_limit"), limit[0]);
    cln_format_bytes(cln_json_number(training, "host_memory"), need[1]);
    cln_format_bytes(cln_json_number(training, "host_memory_limit"), limit[1]);
    cln_format_bytes(cln_json_number(training, "disk"), need[2]);
    cln_format_bytes(cln_json_number(training, "disk_free"), limit[2]);
    snprintf(line, sizeof line,
             "%s on the device (of %s), %s on the host (of %s), %s on the disk for checkpoints (%s "
             "are free here), at the largest tree of %.0f %s, on %s",
             need[0], limit[0], need[1], limit[1], need[2], limit[2],
             cln_json_number(training, "most_leaves"),
             cln_plural(cln_json_number(training, "most_leaves"), "leaf", "leaves"),
             text_of(training, "device"));
    print_wrapped(printf("memory   "), line);
    print_note(training, "batch_note");
    print_note(training, "tree_note");
    print_note(training, "photos_note");
    print_note(training, "free_note");
    if (json_is_string(json_object_get(training, "no_time"))) {
        print_wrapped(printf("time     "), text_of(training, "no_time"));
        return;
    }
    if (!time)
        return;
    cln_format_duration(cln_json_number(time, "seconds"), duration[0]);
    cln_format_duration(cln_json_number(time, "seconds_least"), duration[1]);
    cln_format_duration(cln_json_number(time, "seconds_most"), duration[2]);
    if (!isnan(cln_json_number(time, "seconds")))
        snprintf(range, sizeof range, "about %s of training (%s to %s), ", duration[0], duration[1],
                 duration[2]);
    if (!isnan(cln_json_number(time, "steps_in_time_limit")))
        snprintf(range, sizeof range, "about %.0f step%s within --time-limit, ",
                 cln_json_number(time, "steps_in_time_limit"),
                 cln_plural(cln_json_number(time, "steps_in_time_limit"), "", "s"));
    snprintf(line, sizeof line,
             "%s%s ms a step (%s with the first tree, %s with the largest), %s ms a picture of "
             "%.2g megapixels that is filled. This is %s",
             range, in_ms(cln_json_number(time, "step_seconds"), step[0]),
             in_ms(cln_json_number(time, "step_seconds_first"), step[1]),
             in_ms(cln_json_number(time, "step_seconds_last"), step[2]),
             in_ms(cln_json_number(time, "picture_seconds"), step[3]),
             1e-6 * cln_json_number(time, "picture_pixels"), text_of(time, "how_good"));
    print_wrapped(printf("time     "), line);
    print_note(time, "others_note");
}

cln_status cln_cmd_check(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_check_desc desc = {.scene = options->operand,
                           .settings = options->settings,
                           .device = options->device,
                           .probe = options->probe,
                           .page = options->output,
                           .mask = options->write_mask,
                           .overwrite = options->overwrite};
    cln_console console = {0};
    char *text = NULL;
    json_t *document = NULL;

    if (options->conf_said)
        cln_info("settings %s", options->conf_said);
    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    CLN_TRY(cln_check(&desc, &text));
    cln_console_close(&console);
    if (options->json) {
        CLN_TRY(cln_write_stdout(text, strlen(text)));
        CLN_TRY(cln_write_stdout("\n", 1));
        goto done;
    }
    document = json_loads(text, 0, NULL);
    if (!json_is_object(document))
        CLN_TRY(cln_fail(CLN_INTERNAL, "%s: its findings are not a JSON object", options->operand));
    print_findings(json_object_get(document, "findings"), options->verbose > 0);
    print_measures(document);
    print_training(json_object_get(document, "training"));
    if (options->output)
        printf("page     %s\n", options->output);
    if (options->write_mask)
        printf("mask     %s\n", options->write_mask);
done:
    cln_console_close(&console);
    json_decref(document);
    free(text);
    return st;
}
