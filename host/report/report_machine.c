/* The report's section "Machine and data": the device, its memory as planned, and the data, from
 * run.json. */
#include "io/json.h"
#include "report/report_sections.h"

#include <math.h>
#include <string.h>
#include "base/text.h"
#include "io/progress.h"
#include "report/html.h"

static void put_fact(FILE *to, const char *name, const char *value)
{
    if (!value || !*value)
        return;
    fprintf(to, "<tr><th scope=row class=soft>%s<td>", name);
    cln_html_text(to, value);
    fputc('\n', to);
}

static void put_device(FILE *to, const json_t *run)
{
    const json_t *device = json_object_get(run, "device");
    double units = cln_json_number(device, "compute_units");
    char global[32], largest[32];

    fputs("<section><h3>Device</h3><table>\n", to);
    put_fact(to, "name", cln_json_text(device, "name"));
    put_fact(to, "type", cln_json_text(device, "type"));
    if (isfinite(units))
        fprintf(to, "<tr><th scope=row class=soft>compute units<td>%.0f\n", units);
    put_fact(to, "platform", cln_json_text(device, "platform"));
    put_fact(to, "vendor", cln_json_text(device, "vendor"));
    put_fact(to, "version", cln_json_text(device, "version"));
    put_fact(to, "driver", cln_json_text(device, "driver"));
    if (isfinite(cln_json_number(device, "global_mem"))) {
        cln_format_bytes(cln_json_number(device, "global_mem"), global);
        cln_format_bytes(cln_json_number(device, "max_alloc"), largest);
        fprintf(to, "<tr><th scope=row class=soft>memory<td>%s, largest allocation %s\n", global,
                largest);
    }
    put_fact(to, "tuning", cln_json_text(run, "tune"));
    put_fact(to, "tuning from", cln_json_text(run, "tune_from"));
    fputs("</table></section>\n", to);
}

static bool is_purpose(const char *key)
{
    return strcmp(key, "total") != 0 && strcmp(key, "limit") != 0;
}

static void put_bytes(FILE *to, const char *name, double bytes)
{
    char text[32];

    cln_format_bytes(bytes, text);
    fputs("<tr><th scope=row class=soft>", to);
    cln_html_text(to, name);
    fprintf(to, "<td class=n>%s\n", text);
}

static void put_plan(FILE *to, const json_t *run)
{
    const json_t *plan = json_object_get(run, "plan"), *result = json_object_get(run, "result");
    const char *key = NULL;
    json_t *bytes = NULL;
    double total = 0;

    json_object_foreach((json_t *)plan, key, bytes)
    {
        if (is_purpose(key) && json_is_number(bytes))
            total += json_number_value(bytes);
    }
    if (!(total > 0))
        return;
    fputs("<section><h3>Device memory as planned</h3><table>\n", to);
    json_object_foreach((json_t *)plan, key, bytes)
    {
        if (is_purpose(key) && json_is_number(bytes))
            put_bytes(to, key, json_number_value(bytes));
    }
    put_bytes(to, "total", total);
    if (cln_json_number(plan, "limit") > 0)
        put_bytes(to, "limit", cln_json_number(plan, "limit"));
    if (cln_json_number(result, "device_peak") > 0)
        put_bytes(to, "used at most", cln_json_number(result, "device_peak"));
    if (cln_json_number(result, "host_peak") > 0)
        put_bytes(to, "host memory used at most", cln_json_number(result, "host_peak"));
    fputs("</table></section>\n", to);
}

static void put_data(FILE *to, const json_t *dataset)
{
    const json_t *views = json_object_get(dataset, "splits");
    double downscale = cln_json_number(dataset, "downscale");
    double least = cln_json_number(dataset, "downscale_least"); /* NaN: an older run's */
    char span[CLN_SPAN_BYTES];

    if (!json_is_object(dataset))
        return;
    fputs("<section><h3>Data</h3><table>\n", to);
    put_fact(to, "path", cln_json_text(dataset, "path"));
    put_fact(to, "read as", cln_json_text(dataset, "dialect"));
    put_fact(to, "because", cln_json_text(dataset, "because"));
    if (json_is_object(views)) {
        fputs("<tr><th scope=row class=soft>views<td>", to);
        cln_report_number(to, cln_json_number(views, "train"), 0);
        fputs(" train, ", to);
        cln_report_number(to, cln_json_number(views, "val"), 0);
        fputs(" val, ", to);
        cln_report_number(to, cln_json_number(views, "test"), 0);
        fputs(" test\n", to);
    }
    put_fact(to, "masks", cln_json_text(json_object_get(dataset, "masks"), "because"));
    put_fact(to, "split", cln_json_text(dataset, "split_rule"));
    if (downscale > 1) {
        cln_format_span((int)(least < downscale ? least : downscale), (int)downscale, span);
        fprintf(to, "<tr><th scope=row class=soft>size divided by<td>%s\n", span);
    }
    put_fact(to, "scene cube", cln_json_text(dataset, "bounds_rule"));
    put_fact(to, "digest", cln_json_text(dataset, "digest"));
    fputs("</table></section>\n", to);
}

bool cln_report_has_machine(const cln_report_data *data)
{
    return json_is_object(json_object_get(data->run, "device")) ||
           json_is_object(json_object_get(data->run, "dataset"));
}

cln_status cln_report_machine(FILE *to, const cln_report_data *data)
{
    fputs("<div class=settings>\n", to);
    put_device(to, data->run);
    put_plan(to, data->run);
    put_data(to, json_object_get(data->run, "dataset"));
    fputs("</div>\n", to);
    return CLN_OK;
}
