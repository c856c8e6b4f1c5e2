/* See run_history.h. A start is {"step", "started", "program", "command", "changed"}; `changed`
 * has, by field name, an array of the value before and the one since, by `scene` the digests, and
 * by `program` versions with their commits. */
#include "io/run_history.h"

#include <stdio.h>
#include <string.h>
#include "base/number.h"

#define SCENE   "scene" /* no setting is called so */
#define PROGRAM "program"

/* What is only measured or written does not change the model. */
static bool shapes_model(const cln_config_row *row)
{
    return strncmp(row->option, "eval-", 5) != 0 && strcmp(row->option, "log-every") != 0 &&
           strcmp(row->option, "save-every") != 0 && strcmp(row->option, "save-at") != 0;
}

static json_int_t step_of(const json_t *start)
{
    return json_integer_value(json_object_get(start, "step"));
}

/* By field: what differs. */
static cln_status compare(const cln_config *saved, const cln_config *now, json_t *changed)
{
    cln_status st = CLN_OK;
    json_t *before = NULL, *since = NULL, *value = NULL;
    const char *field = NULL;

    CLN_TRY(cln_config_to_json(saved, &before));
    CLN_TRY(cln_config_to_json(now, &since));
    json_object_foreach(since, field, value)
    {
        json_t *old = json_object_get(before, field);

        if (!json_equal(old, value))
            json_object_set_new(changed, field, json_pack("[O, O]", old, value));
    }
done:
    json_decref(before);
    json_decref(since);
    return st;
}

/* Of two texts that are known and differ. */
static void compare_texts(const char *const texts[2], const char *key, json_t *changed)
{
    if (texts[0] && texts[1] && strcmp(texts[0], texts[1]) != 0)
        json_object_set_new(changed, key, json_pack("[s, s]", texts[0], texts[1]));
}

/* Did the start, number i, leave a step behind, for a run that goes on from this one? */
static bool is_kept(const json_t *before, size_t i, int64_t step)
{
    return i == 0 || step_of(json_array_get(before, i)) < step;
}

/* The program that trained up to `step`: of the last start that left a step, or what the one after
 * it found; else the last that wrote run.json. Older programs tell none of their starts. */
static const char *trained_by(const json_t *before, int64_t step, const char *last)
{
    const json_t *start = NULL, *next = NULL, *pair = NULL;
    const char *found = NULL;

    for (size_t i = 0; i < json_array_size(before) && !next; i++)
        if (is_kept(before, i, step))
            start = json_array_get(before, i);
        else
            next = json_array_get(before, i);
    found = json_string_value(json_object_get(start, PROGRAM));
    if (found || !next)
        return found ? found : last;
    pair = json_object_get(json_object_get(next, "changed"), PROGRAM);
    found = json_string_value(pair ? json_array_get(pair, 0) : json_object_get(next, PROGRAM));
    return found ? found : last;
}

cln_status cln_history_add(const json_t *before, int64_t step, const char *command,
                           const char *started, const cln_config *saved, const cln_config *now,
                           const char *const scenes[2], const char *const programs[2], json_t **out)
{
    cln_status st = CLN_OK;
    json_t *history = json_array(), *changed = json_object(), *start = NULL;

    *out = NULL;
    if (saved) {
        CLN_TRY(compare(saved, now, changed));
        compare_texts(scenes, SCENE, changed);
        compare_texts((const char *const[2]){trained_by(before, step, programs[0]), programs[1]},
                      PROGRAM, changed);
    }
    for (size_t i = 0; i < json_array_size(before); i++) {
        if (is_kept(before, i, step)) /* else its steps are trained anew */
            json_array_append(history, json_array_get(before, i));
    }
    start = json_pack("{s:I, s:s, s:s*, s:s, s:O}", "step", (json_int_t)step, "started", started,
                      PROGRAM, programs[1], "command", command, "changed", changed);
    if (json_array_append_new(history, start) != 0)
        CLN_TRY(cln_fail(CLN_MEMORY, "history: cannot make JSON"));
    *out = history;
    history = NULL;
done:
    json_decref(history);
    json_decref(changed);
    return st;
}

const char *cln_history_other_program(const json_t *history)
{
    const json_t *start = json_array_get(history, json_array_size(history) - 1);
    const json_t *pair = json_object_get(json_object_get(start, "changed"), PROGRAM);

    return json_string_value(json_array_get(pair, 0));
}

bool cln_history_changed(const json_t *start)
{
    const json_t *changed = json_object_get(start, "changed");

    for (int i = 0; i < cln_config_row_count; i++)
        if (shapes_model(&cln_config_rows[i]) && json_object_get(changed, cln_config_rows[i].field))
            return true;
    return json_object_get(changed, SCENE) || json_object_get(changed, PROGRAM);
}

static void write_value(const json_t *value, char *out, size_t bytes)
{
    if (json_is_string(value))
        cln_format(out, bytes, "%s", *json_string_value(value) ? json_string_value(value) : "none");
    else if (json_is_boolean(value))
        cln_format(out, bytes, "%s", json_is_true(value) ? "yes" : "no");
    else
        cln_format(out, bytes, "%.10g", json_number_value(value));
}

void cln_history_text(const json_t *start, char out[CLN_HISTORY_BYTES])
{
    const json_t *changed = json_object_get(start, "changed");
    const json_t *scenes = json_object_get(changed, SCENE);
    const json_t *programs = json_object_get(changed, PROGRAM);
    char text[CLN_HISTORY_BYTES] = "";
    size_t used = 0;

    for (int i = 0; i < cln_config_row_count && used < sizeof text; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        const json_t *pair = json_object_get(changed, row->field);
        char before[64], since[64];

        if (!pair || !shapes_model(row))
            continue;
        write_value(json_array_get(pair, 0), before, sizeof before);
        write_value(json_array_get(pair, 1), since, sizeof since);
        used += (size_t)snprintf(text + used, sizeof text - used, "%s%s %s -> %s", used ? ", " : "",
                                 row->option, before, since);
    }
    cln_format(out, CLN_HISTORY_BYTES, "resumed at step %lld with %s%s", (long long)step_of(start),
               *text ? "other settings: " : "the same settings", text);
    if (scenes)
        cln_format(out + strlen(out), CLN_HISTORY_BYTES - strlen(out),
                   "%s other photos or poses: scene %s -> %s", *text ? ", and" : ", but",
                   json_string_value(json_array_get(scenes, 0)),
                   json_string_value(json_array_get(scenes, 1)));
    if (programs)
        cln_format(out + strlen(out), CLN_HISTORY_BYTES - strlen(out),
                   ", by another program: %s -> %s", json_string_value(json_array_get(programs, 0)),
                   json_string_value(json_array_get(programs, 1)));
}
