/* `cl-nascent export`: the octree of a run as a file for other programs. */
#include "cli/commands.h"

#include <stdio.h>
#include "cli/console.h"

static cln_status print_document(const cln_options *options, const cln_export_result *r)
{
    json_t *levels = json_array();

    for (int level = 0; level < CLN_LEVELS; level++)
        json_array_append_new(levels, json_integer(r->levels[level]));
    return cln_print_json(json_pack("{s:s s:s s:s s:I s:i s:o}", "schema", "cl-nascent.export/1",
                                    "run", options->operand, "file", options->export_file, "step",
                                    (json_int_t)r->step, "leaves", r->leaves, "levels", levels));
}

static void print_sentence(const cln_options *options, const cln_export_result *r)
{
    const char *before = " (";
    char text[32];

    cln_format_count(r->leaves, text);
    printf("%s: %s leaves", options->export_file, text);
    for (int level = 0; level < CLN_LEVELS; level++) {
        if (r->levels[level] == 0)
            continue;
        cln_format_count(r->levels[level], text);
        printf("%slevel %d: %s", before, level, text);
        before = ", ";
    }
    cln_format_count((double)r->step, text);
    printf("%s of step %s\n", r->leaves > 0 ? ")" : "", text);
}

cln_status cln_cmd_export(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_export_result result = {0};
    const cln_export_desc desc = {.run = options->operand,
                                  .what = options->export_what,
                                  .file = options->export_file,
                                  .colour = options->colour,
                                  .overwrite = options->overwrite};

    CLN_TRY(cln_export(&desc, &result));
    if (options->json)
        CLN_TRY(print_document(options, &result));
    else
        print_sentence(options, &result);
done:
    return st;
}
