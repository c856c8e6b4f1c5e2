/* Settings by name and text: the rows of config.h behind an opaque type. api/train.c makes those of
 * a run. */
#include "base/settings.h"

#include <math.h>
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/given.h"
#include "base/memory.h"
#include "base/number.h"

cln_status cln_settings_create(const char *preset, cln_settings **out)
{
    cln_status st = CLN_OK;
    cln_settings *settings = NULL;

    CLN_TRY(cln_given("cln_settings_create", "out", out));
    *out = NULL;
    preset = preset ? preset : CLN_DEFAULT_PRESET;
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

cln_status cln_given_settings(const cln_settings *given, cln_settings **own,
                              const cln_settings **use)
{
    cln_status st = CLN_OK;

    *own = NULL;
    if (!given)
        CLN_TRY(cln_settings_create(NULL, own));
    *use = given ? given : *own;
done:
    return st;
}

void cln_settings_free(cln_settings *settings)
{
    if (settings)
        free(settings->run);
    free(settings);
}

static cln_status find_row(const char *name, const cln_config_row **row)
{
    if (!name)
        return cln_fail(CLN_USAGE, "a setting's name is missing (NULL); give it");
    *row = cln_config_find(name);
    if (*row)
        return CLN_OK;
    if (strcmp(name, "preset") == 0)
        return cln_fail(CLN_USAGE, "'preset': no setting, but what settings begin with; give its "
                                   "name to cln_settings_create");
    if (!cln_config_nearest(name))
        return cln_fail(CLN_USAGE, "'%.60s': no such setting; `cl-nascent train --help` lists them",
                        name);
    return cln_fail(CLN_USAGE, "'%s': no such setting; did you mean '%s'?", name,
                    cln_config_nearest(name));
}

/* Drops the run's budgets that are used up, which would end it at once; that which is extended is
 * set after this. One that was given stays. */
static void lift_used_up(cln_settings *settings)
{
    cln_config *c = &settings->config;

    if (c->steps > 0 && settings->used.steps >= c->steps && !cln_settings_has(settings, "steps"))
        c->steps = 0;
    if (c->time_limit > 0 && settings->used.time_limit >= c->time_limit &&
        !cln_settings_has(settings, "time-limit"))
        c->time_limit = 0;
}

/* Has the run used up a budget other than this row's? */
static bool ended_by_other(const cln_settings *settings, const cln_config_row *row)
{
    const cln_config *run = &settings->base, *used = &settings->used;

    if (row->offset != offsetof(cln_config, steps) && run->steps > 0 && used->steps >= run->steps)
        return true;
    return row->offset != offsetof(cln_config, time_limit) && run->time_limit > 0 &&
           used->time_limit >= run->time_limit;
}

static double number_of(const cln_config *config, const cln_config_row *row)
{
    const void *field = (const char *)config + row->offset;

    return row->type == CLN_ROW_INT ? *(const int *)field : *(const double *)field;
}

/* The run's own budget; 0 without one. Its epochs count only where no other budget is set. */
static double budget_of(const cln_config *run, const cln_config_row *row)
{
    const bool others = run->steps > 0 || run->time_limit > 0;

    return row->offset == offsetof(cln_config, epochs) && others ? 0 : number_of(run, row);
}

/* "+N" of a budget: the run's own plus N; without such a budget, where another one ended the run
 * before it, or where the run ended far beyond it, because it was lowered later, N more from where
 * the run ended. A last step that ends some seconds after --time-limit is not far beyond. The last
 * value counts, as for any setting. */
static cln_status extend(cln_settings *settings, const cln_config_row *row, const char *more)
{
    cln_status st = CLN_OK;
    /* what a whole budget may end beyond: a last step is not cut, and epochs are rounded up */
    const double slack = row->flags & CLN_ROW_SECONDS ? 10 : strcmp(row->option, "epochs") == 0;
    const double budget = budget_of(&settings->base, row);
    const double used = number_of(&settings->used, row);
    const bool whole = budget > 0 && used <= budget + slack &&
                       !(used > 0 && used < budget && ended_by_other(settings, row));
    cln_config added = settings->base;
    char sum[CLN_TEXT_BYTES];

    if (settings->preset[0])
        return cln_fail(CLN_USAGE,
                        "--%s +%s: only a run's budget can be extended; give --resume RUN",
                        row->option, more);
    CLN_TRY(cln_config_set(&added, row, more));
    if (!(number_of(&added, row) > 0))
        return cln_fail(CLN_USAGE, "--%s +%s adds nothing; leave it out, or give more", row->option,
                        more);
    if (!(budget > 0) && !(used > 0))
        return cln_fail(CLN_USAGE,
                        "--%s +%s: the run has no such budget to extend, and has not ended; "
                        "give --%s N for the whole",
                        row->option, more, row->option);
    cln_format(sum, sizeof sum, row->type == CLN_ROW_INT ? "%.0f" : "%.10g",
               (whole ? budget : ceil(1e3 * used) / 1e3) + number_of(&added, row));
    CLN_TRY(cln_config_set(&added, row, sum)); /* if it is too much, nothing changes */
    lift_used_up(settings);
    CLN_TRY(cln_config_set(&settings->config, row, sum));
done:
    return st;
}

/* Levels of a new run's preset (or of the run whose settings it takes) that --start-level begins
 * with or beyond, and of a tree that adapts those beyond --max-level, are left out: what was given
 * counts. A list that was given is held against both. */
static void fit_levels(cln_settings *settings)
{
    cln_config *c = &settings->config;
    const bool first = cln_settings_has(settings, "start-level"),
               last = cln_settings_has(settings, "max-level");

    if ((first || last) && settings->preset[0] && !cln_settings_has(settings, "level-at"))
        cln_config_keep_levels(settings->base.level_at, first ? c->start_level : -1,
                               last && c->adaptive ? c->max_level : CLN_LEVELS, c->level_at);
}

cln_status cln_settings_set(cln_settings *settings, const char *name, const char *value)
{
    cln_status st = CLN_OK;
    const cln_config_row *row = NULL;

    CLN_TRY(cln_given("cln_settings_set", "settings", settings));
    CLN_TRY(find_row(name, &row));
    CLN_TRY(cln_given("cln_settings_set", "value", value));
    if (row->flags & CLN_ROW_BUDGET && value[0] == '+')
        CLN_TRY(extend(settings, row, value + 1));
    else
        CLN_TRY(cln_config_set(&settings->config, row, value));
    settings->given[row - cln_config_rows] = true;
    fit_levels(settings);
done:
    return st;
}

void cln_settings_forget_same(cln_settings *settings)
{
    char now[CLN_TEXT_BYTES], before[CLN_TEXT_BYTES];

    for (int i = 0; i < cln_config_row_count; i++) {
        cln_config_text(&settings->config, &cln_config_rows[i], now);
        cln_config_text(&settings->base, &cln_config_rows[i], before);
        settings->given[i] &= strcmp(now, before) != 0;
    }
}

cln_status cln_settings_get(const cln_settings *settings, const char *name, char *value,
                            size_t bytes)
{
    cln_status st = CLN_OK;
    const cln_config_row *row = NULL;
    char text[CLN_TEXT_BYTES];

    CLN_TRY(cln_given("cln_settings_get", "settings", settings));
    CLN_TRY(find_row(name, &row));
    CLN_TRY(cln_given("cln_settings_get", "value", value));
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
    if (!settings)
        return cln_given("cln_settings_check", "settings", settings);
    if (settings->preset[0] && settings->base.encoding == CLN_ENCODING_VOXEL &&
        settings->config.encoding != CLN_ENCODING_VOXEL && !cln_settings_has(settings, "lr"))
        return cln_fail(CLN_USAGE,
                        "--encoding: networks do not train at preset %s's learning rate "
                        "(--lr); give --preset fast, too",
                        settings->preset);
    return cln_config_check(&settings->config);
}

int cln_settings_epochs(const cln_settings *settings, double pixels)
{
    const cln_config *c = &settings->config;
    const double least = cln_config_step_epochs(c, pixels, CLN_VOXEL_STEPS);

    if (c->encoding != CLN_ENCODING_VOXEL || cln_settings_has(settings, "epochs") ||
        c->epochs >= least || c->steps > 0 || c->time_limit > 0)
        return c->epochs;
    return (int)fmin(1e6, ceil(least));
}

bool cln_settings_given(const cln_settings *settings, const cln_config_row *row)
{
    return settings->given[row - cln_config_rows];
}

bool cln_settings_has(const cln_settings *settings, const char *option)
{
    return cln_settings_given(settings, cln_config_find(option));
}

bool cln_setting_describe(int index, cln_setting_info *info)
{
    static const char *const types[] = {[CLN_ROW_INT] = "int",
                                        [CLN_ROW_REAL] = "real",
                                        [CLN_ROW_BOOL] = "switch",
                                        [CLN_ROW_ENUM] = "word",
                                        [CLN_ROW_TEXT] = "text"};
    const cln_config_row *row = NULL;

    if (!info || index < 0 || index >= cln_config_row_count)
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
