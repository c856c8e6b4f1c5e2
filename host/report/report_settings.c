/* The report's section "Settings": run.json's configuration beside that of its preset. Settings
 * that have no effect with the others are named below, not listed. */
#include "report/report_sections.h"

#include <string.h>
#include "base/config.h"
#include "base/settings.h"
#include "io/json.h"
#include "report/html.h"

/* A value of run.json as its option would be written. */
static void put_value(FILE *to, const json_t *value)
{
    if (json_is_string(value)) {
        cln_html_text(to, *json_string_value(value) ? json_string_value(value) : "\u2013");
    } else if (json_is_boolean(value)) {
        fputs(json_is_true(value) ? "yes" : "no", to);
    } else if (json_is_integer(value)) {
        fprintf(to, "%lld", (long long)json_integer_value(value));
    } else if (json_is_real(value)) {
        fprintf(to, "%.10g", json_real_value(value));
    } else {
        fputs("&ndash;", to);
    }
}

static bool same_value(const json_t *a, const json_t *b)
{
    if (json_is_number(a) && json_is_number(b))
        return json_number_value(a) == json_number_value(b);
    return json_equal(a, b);
}

static void put_row(FILE *to, const cln_config_row *row, const json_t *value,
                    const json_t *standard)
{
    bool differs = standard && !same_value(value, standard);

    fprintf(to, "<tr%s><th scope=row>%s<td class=n>", differs ? " class=set" : "", row->option);
    put_value(to, value);
    if (differs) {
        fputs(" <span class=soft>(", to);
        put_value(to, standard);
        fputs(")</span>", to);
    }
    fputc('\n', to);
}

void cln_report_idle(const cln_report_data *data, bool idle[CLN_SETTINGS_MAX])
{
    const cln_status before = cln_error_status();
    const json_t *dataset = json_object_get(data->run, "dataset");
    const char *space = cln_json_text(dataset, "space");
    const cln_settings_facts facts = {.has_alpha = json_is_true(json_object_get(dataset, "alpha")),
                                      .forward = strcmp(space, "ndc") == 0,
                                      .shell = strcmp(space, "shell") == 0,
                                      .no_masks = json_is_null(json_object_get(dataset, "masks")),
                                      .ranks = data->ranks.ranks > 1 ? 2 : 1};
    cln_config config;
    bool readable = cln_config_from_json(json_object_get(data->run, "config"), &config) == CLN_OK;

    if (!readable && before == CLN_OK)
        cln_clear_error();
    for (int i = 0; i < cln_config_row_count; i++)
        idle[i] = readable && cln_settings_why_idle(&config, &facts, &cln_config_rows[i]);
}

static void put_idle(FILE *to, const json_t *config, const bool idle[CLN_SETTINGS_MAX])
{
    const char *before = "<p class=soft>Not listed, as they have no effect with these: ";

    for (int i = 0; i < cln_config_row_count; i++) {
        if (!idle[i] || !json_object_get(config, cln_config_rows[i].field))
            continue;
        fprintf(to, "%s%s", before, cln_config_rows[i].option);
        before = ", ";
    }
    if (*before == ',')
        fputs(".</p>\n", to);
}

bool cln_report_has_settings(const cln_report_data *data)
{
    return json_is_object(json_object_get(data->run, "config"));
}

cln_status cln_report_settings(FILE *to, const cln_report_data *data)
{
    cln_status before = cln_error_status();
    const json_t *config = json_object_get(data->run, "config");
    const char *preset = cln_json_text(data->run, "preset");
    cln_config standard;
    json_t *standards = NULL;
    bool idle[CLN_SETTINGS_MAX];

    cln_report_idle(data, idle);
    if (!*preset || cln_config_preset(preset, &standard) != CLN_OK ||
        cln_config_to_json(&standard, &standards) != CLN_OK) {
        if (before == CLN_OK)
            cln_clear_error();
    }
    if (standards) {
        fputs("<p class=soft>Settings that differ from the preset <b>", to);
        cln_html_text(to, preset);
        fputs("</b> are marked; the preset's value follows in brackets.</p>\n", to);
    }
    fputs("<div class=settings>\n", to);
    for (int g = 0; g < CLN_CONFIG_GROUPS; g++) {
        fprintf(to, "<section><h3>%s</h3><table>\n", cln_config_groups[g][1]);
        for (int i = 0; i < cln_config_row_count; i++) {
            const cln_config_row *row = &cln_config_rows[i];
            const json_t *value = json_object_get(config, row->field);
            if (value && !idle[i] && strcmp(row->group, cln_config_groups[g][0]) == 0)
                put_row(to, row, value, json_object_get(standards, row->field));
        }
        fputs("</table></section>\n", to);
    }
    fputs("</div>\n", to);
    put_idle(to, config, idle);
    json_decref(standards);
    return CLN_OK;
}
