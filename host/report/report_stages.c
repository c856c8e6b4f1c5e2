/* The report's section "Time per stage": a bar and a table of each stage's time by OpenCL events,
 * and the rest of the training time. Work that is not training (evaluations, probes) is listed
 * below it. */
#include "report/report_sections.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include "device/device.h"
#include "io/json.h"
#include "io/progress.h"
#include "report/html.h"

static const char *const stage_colours[] = {"#2f6da8", "#c2501c", "#4d8a5f", "#8a63a6",
                                            "#c59a2e", "#4f9bab", "#a65068", "#7d8791"};
enum { STAGE_COLOURS = sizeof stage_colours / sizeof stage_colours[0] };
static const char rest_colour[] = "#d5dade";

static int by_time(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return x < y ? 1 : x > y ? -1 : 0;
}

static const char *stage_colour(int rank)
{
    return stage_colours[rank < STAGE_COLOURS ? rank : STAGE_COLOURS - 1];
}

static void put_stage(FILE *to, const char *name, const char *colour, double seconds, double total,
                      double steps)
{
    char time[32];

    cln_format_duration(seconds, time);
    fprintf(to, "<tr><td class=name><span class=key style='background:%s'></span>", colour);
    cln_html_text(to, name);
    fprintf(to, "<td class=n>%s<td class=n>%.1f&thinsp;%%<td class=n>", time,
            100 * seconds / total);
    cln_report_number(to, 1000 * seconds / steps, seconds / steps < 0.01 ? 2 : 1);
    fprintf(to, "<td class=wide><span class=bar style='width:%.1f%%;background:%s'></span>\n",
            100 * seconds / total, colour);
}

/* Is it no stage of a training step, but work that is counted apart? */
static bool is_apart(const char *name)
{
    return strcmp(name, cln_stage_names[CLN_STAGE_PROBE]) == 0 ||
           strcmp(name, cln_stage_names[CLN_STAGE_EVALUATION]) == 0 ||
           strcmp(name, cln_stage_names[CLN_STAGE_VIEWING]) == 0;
}

static void put_apart(FILE *to, const cln_report_data *data, double training)
{
    const cln_report_rows *r = &data->rows;
    const json_t *result = json_object_get(data->run, "result");
    const double wall =
        data->clock.earlier + fmax(data->clock.wall, cln_json_number(result, "wall_seconds"));
    char time[32], all[32];
    const char *comma = "";

    fputs("<p class=soft>Between stages: the host's own work, waiting for the device.", to);
    for (int i = 0; i < r->stage_count; i++) {
        if (!is_apart(r->stages[i].name))
            continue;
        cln_format_duration(r->stages[i].seconds, time);
        fputs(*comma ? comma : " Not in the table: ", to);
        cln_html_text(to, r->stages[i].name);
        fprintf(to, " %s", time);
        comma = ", ";
    }
    fputs(*comma ? "." : "", to);
    cln_format_duration(training, time);
    cln_format_duration(wall, all);
    fprintf(to, " Training took %s", time);
    if (wall > training)
        fprintf(to, "; %s by the clock, with start, evaluations and checkpoints", all);
    fputs(".</p>\n", to);
}

cln_status cln_report_stages(FILE *to, const cln_report_data *data)
{
    const cln_report_rows *r = &data->rows;
    double order[CLN_REPORT_STAGES][2]; /* seconds, index */
    double sum = 0, training = 0, total = 0, steps = 0;
    int count = 0;

    for (int i = 0; i < r->stage_count; i++) {
        if (is_apart(r->stages[i].name))
            continue;
        order[count][0] = r->stages[i].seconds;
        order[count++][1] = i;
        sum += r->stages[i].seconds;
    }
    if (!(sum > 0)) {
        fputs("<p class=soft>No stage was timed.</p>\n", to);
        return CLN_OK;
    }
    qsort(order, (size_t)count, sizeof order[0], by_time);
    for (int i = 0; i < r->count; i++)
        training = fmax(training, r->seconds[i]);
    total = fmax(sum, training);
    if (r->count > 0 && r->step[r->count - 1] > 0)
        steps = r->step[r->count - 1];
    fputs("<div class=stack>", to);
    for (int i = 0; i < count; i++) {
        fprintf(to, "<i style='width:%.3f%%;background:%s' title='", 100 * order[i][0] / total,
                stage_colour(i));
        cln_html_text(to, cln_report_stage(data, r->stages[(int)order[i][1]].name));
        fputs("'></i>", to);
    }
    fprintf(to, "<i style='flex:1;background:%s' title='between stages'></i></div>\n", rest_colour);
    fputs("<table class=wide><tr><th>stage<th class=n>time<th class=n>share<th class=n>ms per "
          "step<td>\n",
          to);
    for (int i = 0; i < count; i++)
        put_stage(to, cln_report_stage(data, r->stages[(int)order[i][1]].name), stage_colour(i),
                  order[i][0], total, steps > 0 ? steps : NAN);
    if (total - sum > 0.001 * total)
        put_stage(to, "between stages", rest_colour, total - sum, total, steps > 0 ? steps : NAN);
    fputs("</table>\n", to);
    put_apart(to, data, training);
    return CLN_OK;
}
