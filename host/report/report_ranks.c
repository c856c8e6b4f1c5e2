/* The report's section "Processes": messages between the processes of one training, and how even
 * their work was before and after leaves moved. The figures of the first table are those of rank 0,
 * which wrote the rows. */
#include "report/report_sections.h"

#include "io/progress.h"
#include "report/html.h"

bool cln_report_has_ranks(const cln_report_data *data)
{
    return data->ranks.ranks > 1;
}

static void put_moves(FILE *to, const cln_report_data *data)
{
    fputs("<table><tr><th class=n>step<th class=n>leaves that moved<th class=n>the busiest "
          "process's work over the mean, before<th class=n>after\n",
          to);
    for (int i = 0; i < data->move_count; i++) {
        const cln_report_move *m = &data->moves[i];

        fprintf(to, "<tr><td class=n>%.0f<td class=n>%.0f<td class=n>", m->step, m->leaves);
        cln_report_number(to, m->before, 2);
        fputs("<td class=n>", to);
        cln_report_number(to, m->after, 2);
        fputs("\n", to);
    }
    fputs("</table>\n", to);
}

static void put_stages(FILE *to, const cln_report_data *data)
{
    const cln_report_ranks_sum *r = &data->ranks;

    fputs(
        "<table><tr><th>stage<th class=n>ms per step, the idlest process<th class=n>the busiest\n",
        to);
    for (int i = 0; i < r->stage_count; i++) {
        fputs("<tr><td>", to);
        cln_html_text(to, cln_report_stage(data, r->stages[i].name));
        fputs("<td class=n>", to);
        cln_report_number(to, 1000 * r->stages[i].least / r->steps, 2);
        fputs("<td class=n>", to);
        cln_report_number(to, 1000 * r->stages[i].most / r->steps, 2);
        fputs("\n", to);
    }
    fputs("</table>\n<p class=soft>Of all processes, since one row of metrics.jsonl to the next; "
          "messages include waiting: the process that waits least is the one that others wait "
          "for.</p>\n",
          to);
}

cln_status cln_report_ranks(FILE *to, const cln_report_data *data)
{
    const cln_report_ranks_sum *r = &data->ranks;
    char messages[32], least[32], most[32];

    cln_format_duration(r->message_seconds, messages);
    cln_format_bytes(r->photos[0], least);
    cln_format_bytes(r->photos[1], most);
    fprintf(to,
            "<table><tr><th scope=row>processes<td class=n>%.0f\n<tr><th scope=row>bytes that the "
            "first one sent, "
            "per step<td class=n>%.0f\n<tr><th scope=row>the same, per ray<td class=n>",
            r->ranks, r->bytes / r->steps);
    cln_report_number(to, r->bytes / r->rays, 1);
    if (r->vertex_bytes > 0)
        fprintf(
            to,
            "\n<tr><th scope=row>of these, for common vertices of leaves, per step<td class=n>%.0f",
            r->vertex_bytes / r->steps);
    fprintf(to, "\n<tr><th scope=row>its time in messages, waiting included<td class=n>%s (",
            messages);
    cln_report_number(to, 100 * r->message_seconds / r->seconds, 1);
    fputs("&thinsp;% of training)\n<tr><th scope=row>balance: the busiest process's samples over "
          "the mean"
          "<td class=n>",
          to);
    cln_report_number(to, r->balanced / r->balance_weight, 2);
    if (r->photos[1] > 0)
        fprintf(to,
                "\n<tr><th scope=row>memory for photos, the process with the least of them<td "
                "class=n>%s"
                "\n<tr><th scope=row>the one with the most<td class=n>%s",
                least, most);
    fputs("\n</table>\n", to);
    if (r->stage_count > 0)
        put_stages(to, data);
    if (data->move_count > 0)
        put_moves(to, data);
    else
        fputs("<p class=soft>No leaf moved between processes.</p>\n", to);
    return CLN_OK;
}
