/* `cl-nascent export`: the octree of a run as a file for other programs. */
#include "cli/commands.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
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

static void print_sentence(FILE *to, const char *file, const cln_export_result *r)
{
    const char *before = " (";
    char text[32];

    cln_format_count(r->leaves, text);
    fprintf(to, "%s: %s leaves", file, text);
    for (int level = 0; level < CLN_LEVELS; level++) {
        if (r->levels[level] == 0)
            continue;
        cln_format_count(r->levels[level], text);
        fprintf(to, "%slevel %d: %s", before, level, text);
        before = ", ";
    }
    cln_format_count((double)r->step, text);
    fprintf(to, "%s of step %s\n", r->leaves > 0 ? ")" : "", text);
}

/* "-": to a file that only we know, and from there to standard output. */
static cln_status export_to_stdout(const cln_options *options, cln_export_desc *desc,
                                   cln_export_result *result)
{
    cln_status st = CLN_OK;
    const char *folder = getenv("TMPDIR");
    char *path = NULL, *bytes = NULL;
    size_t count = 0;
    int file = -1;

    if (options->json)
        return cln_fail(CLN_USAGE, "--%s - and --json both want standard output; name a file",
                        desc->what);
    if (isatty(STDOUT_FILENO))
        return cln_fail(CLN_USAGE,
                        "--%s -: standard output is a terminal, and the file is not text; add "
                        "> FILE, or | and a program that reads it",
                        desc->what);
    CLN_TRY(cln_asprintf(&path, "%s/cl-nascent-XXXXXX", folder && *folder ? folder : "/tmp"));
    file = mkstemp(path);
    if (file < 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s; set TMPDIR to a folder that can be written", path,
                         strerror(errno)));
    desc->file = path;
    desc->overwrite = true;
    CLN_TRY(cln_export(desc, result));
    CLN_TRY(cln_read_file(path, SIZE_MAX / 2, &bytes, &count));
done:
    if (file >= 0) {
        close(file);
        unlink(path);
    }
    if (st == CLN_OK)
        st = cln_write_stdout(bytes, count);
    free(bytes);
    free(path);
    return st;
}

cln_status cln_cmd_export(const cln_options *options)
{
    cln_status st = CLN_OK;
    cln_export_result result = {0};
    cln_export_desc desc = {.run = options->operand,
                            .what = options->export_what,
                            .file = options->export_file,
                            .colour = options->colour,
                            .overwrite = options->overwrite};

    if (strcmp(options->export_file, "-") == 0) {
        CLN_TRY(export_to_stdout(options, &desc, &result));
        if (!options->quiet)
            print_sentence(stderr, "standard output", &result);
        goto done;
    }
    CLN_TRY(cln_export(&desc, &result));
    if (options->json)
        CLN_TRY(print_document(options, &result));
    else
        print_sentence(stdout, options->export_file, &result);
done:
    return st;
}
