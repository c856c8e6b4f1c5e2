/* The report's sections of sentences: "What was left out", work that the scene does not need, and
 * "Warnings", those of the training. */
#include "report/report_sections.h"

#include "report/html.h"

bool cln_report_has_left_out(const cln_report_data *data)
{
    return json_is_array(json_object_get(data->run, "left_out"));
}

static void put_sentences(FILE *to, const json_t *sentences)
{
    fputs("<ul>\n", to);
    for (size_t i = 0; i < json_array_size(sentences); i++) {
        fputs("<li>", to);
        cln_html_text(to, json_string_value(json_array_get(sentences, i)));
        fputc('\n', to);
    }
    fputs("</ul>\n", to);
}

cln_status cln_report_left_out(FILE *to, const cln_report_data *data)
{
    const json_t *sentences = json_object_get(data->run, "left_out");

    if (json_array_size(sentences) == 0) {
        fputs("<p>Nothing: this scene needs all of it.</p>\n", to);
        return CLN_OK;
    }
    fputs("<p class=soft>Kernels and training leave out what this scene does not need.</p>\n", to);
    put_sentences(to, sentences);
    return CLN_OK;
}

bool cln_report_has_warnings(const cln_report_data *data)
{
    return json_array_size(json_object_get(data->run, "warnings")) > 0;
}

cln_status cln_report_warnings(FILE *to, const cln_report_data *data)
{
    put_sentences(to, json_object_get(data->run, "warnings"));
    return CLN_OK;
}
