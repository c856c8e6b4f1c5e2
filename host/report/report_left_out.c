/* The report's section "What was left out": work that the scene does not need. */
#include "report/report_sections.h"

#include "report/html.h"

bool cln_report_has_left_out(const cln_report_data *data)
{
    return json_is_array(json_object_get(data->run, "left_out"));
}

cln_status cln_report_left_out(FILE *to, const cln_report_data *data)
{
    const json_t *sentences = json_object_get(data->run, "left_out");

    if (json_array_size(sentences) == 0) {
        fputs("<p>Nothing: this scene needs all of it.</p>\n", to);
        return CLN_OK;
    }
    fputs("<p class=soft>Kernels and training leave out what this scene does not need.</p>\n"
          "<ul>\n",
          to);
    for (size_t i = 0; i < json_array_size(sentences); i++) {
        fputs("<li>", to);
        cln_html_text(to, json_string_value(json_array_get(sentences, i)));
        fputc('\n', to);
    }
    fputs("</ul>\n", to);
    return CLN_OK;
}
