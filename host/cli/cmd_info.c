/* `cl-nascent info`: the library's JSON about a scene or a run, as it is or laid out for
 * reading. */
#include "cli/commands.h"

#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "cli/console.h"
#include "io/run_folder.h"
#include "io/run_history.h"

enum { LISTED = 8, NAMED = 16 };

static void write_scalar(FILE *to, const json_t *value)
{
    const double number = json_number_value(value);
    char *text = NULL;

    if (json_is_real(value) && fabs(number) >= 1e5 && fabs(number) < 1e15 &&
        number == floor(number)) { /* counts and seeds, which some writers keep as reals */
        fprintf(to, "%.0f", number);
        return;
    }
    if (json_is_string(value)) {
        fprintf(to, "%s", json_string_value(value));
        return;
    }
    text = json_dumps(value, JSON_ENCODE_ANY | JSON_REAL_PRECISION(7));
    fprintf(to, "%s", json_is_null(value) ? "-" : text ? text : "?");
    free(text);
}

static bool is_scalar(const json_t *value)
{
    return !json_is_object(value) && !json_is_array(value);
}

static bool is_flat(const json_t *array)
{
    for (size_t i = 0; i < json_array_size(array); i++) {
        if (!is_scalar(json_array_get(array, i)))
            return false;
    }
    return true;
}

/* Writes bytes for people, if the key names memory or belongs to a memory plan. */
static bool write_memory(FILE *to, const char *parent, const char *key, const json_t *value)
{
    char text[32];

    if (!json_is_number(value) || json_number_value(value) == 0)
        return false;
    if (!strstr(key, "_memory") && strncmp(key, "disk", 4) != 0 && !cln_ends_with(key, "_mem") &&
        !cln_ends_with(key, "_peak") && strcmp(key, "max_alloc") != 0 &&
        !cln_ends_with(parent, "plan"))
        return false;
    cln_format_bytes(json_number_value(value), text);
    fprintf(to, "%s", text);
    return true;
}

/* Writes minutes and seconds; those of a training to come are an estimate. */
static bool write_time(FILE *to, const char *parent, const char *key, const json_t *value)
{
    char text[32];

    if (!json_is_number(value) || !(strcmp(key, "seconds") == 0 || cln_ends_with(key, "_seconds")))
        return false;
    cln_format_duration(json_number_value(value), text);
    fprintf(to, "%s%s", strcmp(parent, "training") == 0 ? "about " : "", text);
    return true;
}

/* Writes scalars in one line: "800, 600" or "name lego/r_0.png, width 800". */
static void write_inline(FILE *to, const json_t *value)
{
    const char *key = NULL;
    json_t *member = NULL;
    const char *comma = "";

    if (json_is_array(value)) {
        for (size_t i = 0; i < json_array_size(value); i++) {
            fprintf(to, "%s", i ? ", " : "");
            write_inline(to, json_array_get(value, i));
        }
    } else if (json_is_object(value)) {
        json_object_foreach((json_t *)value, key, member)
        {
            if (json_is_object(member) && json_object_size(member) == 0)
                continue;
            fprintf(to, "%s%s ", comma, key);
            write_inline(to, member);
            comma = ", ";
        }
    } else {
        write_scalar(to, value);
    }
}

/* Writes a point with a thousandth of half a side of the cube, however far the origin is. */
static void write_place(FILE *to, const json_t *place, double half)
{
    double values[3];

    for (size_t a = 0; a < 3; a++)
        values[a] = json_number_value(json_array_get(place, a));
    for (size_t a = 0; a < 3; a++)
        fprintf(to, "%s%.*g", a ? ", " : "", cln_reals_digits(3, values, half), values[a]);
}

/* Prints "KEY  VALUE", the key in `width` columns, unless it is "". On a terminal, lines are broken
 * at its width; elsewhere they stay whole, for other programs. half: of the cube, of a scene. */
static cln_status print_entry(const char *parent, const char *key, int width, int indent,
                              double half, const json_t *value)
{
    cln_status st = CLN_OK;
    const int gap = *key ? 2 : 0, begin = indent + width + gap;
    const int columns = cln_stdout_columns(INT_MAX);
    char *text = NULL;
    size_t bytes = 0;
    FILE *to = open_memstream(&text, &bytes);

    if (!to)
        CLN_TRY(cln_fail(CLN_MEMORY, "description: out of memory"));
    if (json_is_array(value) && json_array_size(value) == 0)
        fprintf(to, "none");
    else if (half > 0 && strcmp(key, "centre") == 0)
        write_place(to, value, half);
    else if (!write_memory(to, parent, key, value) && !write_time(to, parent, key, value))
        write_inline(to, value);
    if (fclose(to) != 0)
        CLN_TRY(cln_fail(CLN_MEMORY, "description: out of memory"));
    printf("%*s%-*s%*s", indent, "", width, key, gap, "");
    cln_print_wrapped(begin, begin < columns / 2 ? (*key ? begin : indent + 2) : indent + 2,
                      columns, text);
done:
    free(text);
    return st;
}

/* Prints a line for each member; of long lists only for the first ones. */
static cln_status print_list(const json_t *array, int indent)
{
    cln_status st = CLN_OK;
    size_t count = json_array_size(array);

    for (size_t i = 0; i < count && i < LISTED; i++)
        CLN_TRY(print_entry("", "", 0, indent, 0, json_array_get(array, i)));
    if (count > LISTED)
        printf("%*s... %zu more, all with --json\n", indent, "", count - LISTED);
done:
    return st;
}

static cln_status print_object(const char *name, const json_t *object, int indent)
{
    cln_status st = CLN_OK;
    const char *key = NULL;
    json_t *value = NULL;
    int width = 0;

    json_object_foreach((json_t *)object, key, value)
    {
        if (!json_is_object(value) && (int)strlen(key) > width)
            width = (int)strlen(key);
    }
    json_object_foreach((json_t *)object, key, value)
    {
        if (json_is_object(value)) {
            printf("%*s%s\n", indent, "", key);
            CLN_TRY(print_object(key, value, indent + 2));
        } else if (json_is_array(value) && !is_flat(value)) {
            printf("%*s%s\n", indent, "", key);
            CLN_TRY(print_list(value, indent + 2));
        } else {
            CLN_TRY(print_entry(name, key, width, indent,
                                json_number_value(json_object_get(object, "half")), value));
        }
    }
done:
    return st;
}

/* ---- time ---- */

static double number_at(const json_t *document, const char *object, const char *key)
{
    return json_number_value(json_object_get(json_object_get(document, object), key));
}

/* Names settings that a step's time depends on and that differ from the run's: "rays, width". */
static cln_status name_differences(const char *run, const cln_settings *settings, char *out,
                                   size_t bytes)
{
    cln_status st = CLN_OK;
    cln_settings *its = NULL;
    size_t used = 0;
    int count = 0;

    out[0] = 0;
    CLN_TRY(cln_settings_of_run(run, &its));
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        char a[CLN_SETTING_BYTES], b[CLN_SETTING_BYTES];

        if (!(row->flags & CLN_ROW_TIME))
            continue;
        CLN_TRY(cln_settings_get(its, row->option, a, sizeof a));
        CLN_TRY(cln_settings_get(settings, row->option, b, sizeof b));
        if (strcmp(a, b) != 0 && count++ < NAMED && used < bytes)
            used +=
                (size_t)snprintf(out + used, bytes - used, "%s%s", used ? ", " : "", row->option);
    }
    if (count > NAMED && used < bytes)
        snprintf(out + used, bytes - used, " and %d more", count - NAMED);
done:
    cln_settings_free(its);
    return st;
}

/* Mean number of pixels of a view; 0 if unknown. */
static double mean_pixels(const json_t *described)
{
    const json_t *sizes = json_object_get(described, "sizes");
    double views = 0, pixels = 0;

    for (size_t i = 0; i < json_array_size(sizes); i++) {
        const json_t *size = json_array_get(sizes, i);
        const double n = json_number_value(json_object_get(size, "views"));

        views += n;
        pixels += n * json_number_value(json_object_get(size, "width")) *
                  json_number_value(json_object_get(size, "height"));
    }
    return views > 0 ? pixels / views : 0;
}

/* Counts the evaluations of a training of `steps` steps, with the one at its end. */
static cln_status count_evaluations(const cln_settings *settings, double steps, double *count)
{
    cln_status st = CLN_OK;
    char every[CLN_SETTING_BYTES], at[CLN_SETTING_BYTES];

    CLN_TRY(cln_settings_get(settings, "eval-every", every, sizeof every));
    CLN_TRY(cln_settings_get(settings, "eval-at", at, sizeof at));
    *count = 1;
    if (atof(every) > 0)
        *count += floor((steps - 1) / atof(every));
    for (const char *c = at; *c; c += strspn(c, ","), *count += 1)
        c += strcspn(c, ",");
done:
    return st;
}

/* Adds times besides training: the start, and evaluations, whose time grows with the pixels. */
static cln_status add_other_times(const cln_settings *settings, const json_t *run,
                                  const json_t *scene, double steps, json_t *training)
{
    cln_status st = CLN_OK;
    const double views = number_at(run, "result", "eval_views");
    const double seconds = number_at(run, "result", "eval_seconds");
    const double start = number_at(run, "result", "start_seconds");
    const double its = mean_pixels(json_object_get(run, "dataset")), ours = mean_pixels(scene);
    double wanted = 0, evaluations = 0, tests = number_at(scene, "splits", "test");
    char images[CLN_SETTING_BYTES];

    CLN_TRY(cln_settings_get(settings, "eval-images", images, sizeof images));
    CLN_TRY(count_evaluations(settings, steps, &evaluations));
    wanted = atof(images) > 0 ? fmin(atof(images), tests) : tests;
    json_object_set_new(training, "evaluation_seconds",
                        views > 0 && seconds > 0 && its > 0
                            ? json_real(evaluations * wanted * seconds / views * ours / its)
                            : json_null());
    json_object_set_new(training, "start_seconds", start > 0 ? json_real(start) : json_null());
done:
    return st;
}

/* Adds the time that training would take at the pace of a run, as nothing else tells it before the
 * first step. The pace is a mean over that run's growth, so it holds for a run that grows alike. */
static cln_status add_time(const cln_options *options, const json_t *scene, json_t *training)
{
    cln_status st = CLN_OK;
    double steps = json_number_value(json_object_get(training, "steps"));
    const double limit = json_number_value(json_object_get(training, "time_limit"));
    const char *device = json_string_value(json_object_get(training, "device")), *its = NULL;
    char *text = NULL, *from = NULL, differences[512] = "";
    json_t *run = NULL;
    double pace = 0;

    if (limit > 0 && !(steps > 0) && !options->like) {
        json_object_set_new(training, "training_seconds", json_real(limit));
        json_object_set_new(training, "training_seconds_from", json_string("--time-limit"));
        goto done;
    }
    if (!options->like) {
        json_object_set_new(training, "training_seconds", json_null());
        json_object_set_new(training, "training_seconds_from",
                            json_string("not known yet: --like RUN estimates it from the pace of a "
                                        "run on this device, train --time-limit sets it"));
        goto done;
    }
    CLN_TRY(cln_info_run(options->like, &text));
    run = json_loads(text, 0, NULL);
    if (!(number_at(run, "result", "step") > 0) || !(number_at(run, "result", "seconds") > 0))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "--like %s: it has no result yet, so its pace is unknown; wait for its "
                         "end",
                         options->like));
    pace = number_at(run, "result", "seconds") / number_at(run, "result", "step");
    its = json_string_value(json_object_get(json_object_get(run, "device"), "name"));
    if (!(steps > 0)) {
        steps = floor(limit / pace);
        json_object_set_new(training, "steps_in_time_limit", json_integer((json_int_t)steps));
    }
    CLN_TRY(name_differences(options->like, options->settings, differences, sizeof differences));
    if (its && device && strcmp(its, device) == 0)
        its = NULL;
    CLN_TRY(cln_asprintf(&from, "%.0f steps at the pace of %s, %.3g ms over its %.0f%s%s%s%s",
                         steps, options->like, 1e3 * pace, number_at(run, "result", "step"),
                         its ? ", on another device: " : "", its ? its : "",
                         *differences ? "; with another " : "", differences));
    json_object_set_new(training, "training_seconds",
                        json_real(limit > 0 ? fmin(limit, pace * steps) : pace * steps));
    json_object_set_new(training, "training_seconds_from", json_string(from));
    CLN_TRY(add_other_times(options->settings, run, scene, steps, training));
done:
    json_decref(run);
    free(text);
    free(from);
    return st;
}

/* Says what became of a run whose process is gone, and the way on. */
static void say_broken_off(const char *run, const json_t *about)
{
    const json_int_t step = json_integer_value(json_object_get(about, "step"));
    const char *state = json_string_value(json_object_get(about, "state"));
    char quoted[CLN_QUOTED_BYTES];

    if (!state || strcmp(state, "broken off") != 0)
        return;
    cln_shell_quote(run, quoted, sizeof quoted);
    if (json_is_integer(json_object_get(about, "step")))
        cln_warn("%s: " CLN_RUN_BROKEN_OFF
                 "; `cl-nascent train --resume %s` goes on from step %lld",
                 run, quoted, (long long)step);
    else
        cln_warn("%s: " CLN_RUN_BROKEN_OFF CLN_RUN_NO_CHECKPOINT, run);
}

/* Lays out the starts of a run, a line each: "begun COMMAND", "resumed at step 120 ... COMMAND". */
static void lay_out_history(json_t *about)
{
    const json_t *history = json_object_get(about, "history");
    json_t *lines = json_array();
    char text[CLN_HISTORY_BYTES];

    for (size_t i = 0; i < json_array_size(history); i++) {
        const json_t *start = json_array_get(history, i), *step = json_object_get(start, "step");
        const char *command = json_string_value(json_object_get(start, "command"));

        cln_history_text(start, text);
        if (json_integer_value(step) == 0)
            cln_format(text, sizeof text, "begun");
        json_array_append_new(lines, json_pack("{s:s}", text, command ? command : ""));
    }
    if (json_array_size(history) > 1)
        json_object_set(about, "history", lines);
    else
        json_object_del(about, "history"); /* `command` tells the same */
    json_decref(lines);
}

cln_status cln_cmd_info(const cln_options *options)
{
    cln_status st = CLN_OK;
    char *manifest = NULL, *text = NULL;
    json_t *document = NULL;
    bool is_run = false;

    if (options->operand_count > 1)
        return cln_info_runs(options);
    CLN_TRY(cln_path_join(&manifest, options->operand, "run.json"));
    is_run = cln_is_file(manifest) && !cln_run_is_of_others(options->operand);
    if (is_run && options->like)
        CLN_TRY(
            cln_fail(CLN_USAGE, "--like requires a SCENE, but '%s' is a run", options->operand));
    if (is_run)
        CLN_TRY(cln_info_run(options->operand, &text));
    else if (options->conf_said)
        cln_info("settings %s", options->conf_said);
    if (!text)
        CLN_TRY(cln_info_scene(options->operand, options->settings, &text));
    document = json_loads(text, 0, NULL);
    if (!json_is_object(document))
        CLN_TRY(
            cln_fail(CLN_INTERNAL, "%s: its description is not a JSON object", options->operand));
    if (is_run)
        say_broken_off(options->operand, document);
    if (json_object_get(document, "training"))
        CLN_TRY(add_time(options, document, json_object_get(document, "training")));
    if (options->json)
        CLN_TRY(cln_print_json(json_incref(document)));
    else {
        lay_out_history(document);
        CLN_TRY(print_object("", document, 0));
    }
done:
    json_decref(document);
    free(text);
    free(manifest);
    return st;
}
