/* Settings by name and text: the rows of config.h behind an opaque type. api/train.c makes those of
 * a run. */
#include "base/settings.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/memory.h"
#include "base/number.h"

cln_status cln_settings_create(const char *preset, cln_settings **out)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;

    *out = NULL;
    preset = preset ? preset : "fast";
    CLN_ASSERT(cln_config_row_count <= CLN_SETTINGS_MAX);
    CLN_TRY(cln_alloc(&settings, 1, sizeof *settings, "settings"));
    CLN_TRY(cln_config_preset(preset, &settings->config));
    settings->base = settings->config;
    snprintf(settings->preset, sizeof settings->preset, "%s", preset);
    *out = settings;
    settings = NULL;
done:
    free(settings);
    return st;
}

void cln_settings_free(cln_settings *settings)
{
    free(settings);
}

static cln_status find_row(const char *name, const cln_config_row **row)
{
    *row = cln_config_find(name);
    if (*row)
        return CLN_OK;
    if (!cln_config_nearest(name))
        return cln_fail(CLN_USAGE, "'%.60s': no such setting; `cl-nascent train --help` lists them",
                        name);
    return cln_fail(CLN_USAGE, "'%s': no such setting; did you mean '%s'?", name,
                    cln_config_nearest(name));
}

/* Drops another budget that is used up, which would end the run at once. */
static void lift_used_up(cln_settings *settings)
{
    cln_config *c = &settings->config;

    if (c->steps > 0 && settings->steps >= c->steps)
        c->steps = 0;
    if (c->time_limit > 0 && settings->seconds >= c->time_limit)
        c->time_limit = 0;
}

/* What a run used, if it ended far beyond its budget, which was lowered later; else 0. A last step
 * that ends some seconds after --time-limit is not far beyond. */
static double used_beyond(const cln_settings *settings, const cln_config_row *row, double budget)
{
    if (strcmp(row->option, "steps") == 0 && settings->steps > budget)
        return settings->steps;
    if (strcmp(row->option, "time-limit") == 0 && settings->seconds > budget + 10)
        return settings->seconds;
    return 0;
}

/* "+N" of a budget: the run's own plus N; without such a budget, or where the run is far beyond it,
 * N more from where the run ended. The last value counts, as for any setting. */
static cln_status extend(cln_settings *settings, const cln_config_row *row, const char *more)
{
    cln_status st = CLN_OK;
    cln_config added = settings->base;
    char before[CLN_TEXT_BYTES], after[CLN_TEXT_BYTES];
    double a = 0, b = 0;

    if (settings->preset[0])
        return cln_fail(CLN_USAGE,
                        "--%s +%s: only a run's budget can be extended; give --resume RUN",
                        row->option, more);
    cln_config_text(&added, row, before);
    CLN_TRY(cln_config_set(&added, row, more));
    cln_config_text(&added, row, after);
    if (!cln_reals_read(before, 1, &a) || !cln_reals_read(after, 1, &b) || a == 0) {
        a = row->type == CLN_ROW_INT ? settings->steps : settings->seconds;
        if (!(a > 0))
            return cln_fail(CLN_USAGE,
                            "--%s +%s: the run has no such budget to extend, and has not ended; "
                            "give --%s N for the whole",
                            row->option, more, row->option);
        lift_used_up(settings);
    } else if (used_beyond(settings, row, a) > 0) {
        a = used_beyond(settings, row, a);
    }
    snprintf(after, sizeof after, row->type == CLN_ROW_INT ? "%.0f" : "%.17g", a + b);
    CLN_TRY(cln_config_set(&settings->config, row, after));
done:
    return st;
}

cln_status cln_settings_set(cln_settings *settings, const char *name, const char *value)
{
    cln_status st = CLN_OK;
    const cln_config_row *row = NULL;

    CLN_TRY(find_row(name, &row));
    if (row->flags & CLN_ROW_BUDGET && value[0] == '+')
        CLN_TRY(extend(settings, row, value + 1));
    else
        CLN_TRY(cln_config_set(&settings->config, row, value));
    settings->given[row - cln_config_rows] = true;
done:
    return st;
}

cln_status cln_settings_get(const cln_settings *settings, const char *name, char *value,
                            size_t bytes)
{
    cln_status st = CLN_OK;
    const cln_config_row *row = NULL;
    char text[CLN_TEXT_BYTES];

    CLN_TRY(find_row(name, &row));
    cln_config_text(&settings->config, row, text);
    if (strlen(text) >= bytes)
        return cln_fail(CLN_USAGE, "'%s': its value needs %zu bytes, the buffer has %zu", name,
                        strlen(text) + 1, bytes);
    memcpy(value, text, strlen(text) + 1);
done:
    return st;
}

cln_status cln_settings_check(const cln_settings *settings)
{
    return cln_config_check(&settings->config);
}

bool cln_settings_given(const cln_settings *settings, const cln_config_row *row)
{
    return settings->given[row - cln_config_rows];
}

bool cln_setting_describe(int index, cln_setting_info *info)
{
    static const char *const types[] = {[CLN_ROW_INT] = "int",
                                        [CLN_ROW_REAL] = "real",
                                        [CLN_ROW_BOOL] = "switch",
                                        [CLN_ROW_ENUM] = "word",
                                        [CLN_ROW_TEXT] = "text"};
    const cln_config_row *row = NULL;

    if (index < 0 || index >= cln_config_row_count)
        return false;
    row = &cln_config_rows[index];
    *info = (cln_setting_info){.name = row->option,
                               .alias = row->alias,
                               .group = row->group,
                               .help = row->help,
                               .type = types[row->type],
                               .words = row->words,
                               .min = row->min,
                               .max = row->max};
    return true;
}
