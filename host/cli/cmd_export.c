/* `cl-nascent export`: writes what a run holds into a file for other programs. */
#include "cli/commands.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "cli/console.h"
#include "export/list.h"
#include "model/model.h"
#include "render/crop.h"
#include "render/up.h"

/* The counts of an export, by the words that document and sentence have for them. */
static json_t *counts_of(const cln_export_result *r)
{
    json_t *counts = json_object();

    if (r->vertices > 0)
        json_object_set_new(counts, r->faces > 0 ? "vertices" : "points",
                            json_integer((json_int_t)r->vertices));
    if (r->faces > 0)
        json_object_set_new(counts, "triangles", json_integer((json_int_t)r->faces));
    if (r->shape[0] > 0)
        json_object_set_new(counts, "grid",
                            json_pack("[i,i,i]", r->shape[0], r->shape[1], r->shape[2]));
    if (r->views > 0)
        json_object_set_new(counts, "cameras", json_integer(r->views));
    return counts;
}

/* Of the file that was written, or a copy's model; -1 of another folder. */
static json_int_t bytes_of(const char *path)
{
    struct stat info;
    const double model = cln_is_dir(path) ? cln_checkpoint_newest_bytes(path) : 0;

    if (model > 0)
        return (json_int_t)model;
    return stat(path, &info) == 0 && S_ISREG(info.st_mode) ? (json_int_t)info.st_size : -1;
}

static bool is_any(const double numbers[3])
{
    return numbers[0] != 0 || numbers[1] != 0 || numbers[2] != 0;
}

static cln_status print_document(const cln_options *options, const cln_export_result *r)
{
    json_t *levels = json_array(), *counts = counts_of(r), *document = NULL;

    for (int level = 0; level < CLN_LEVELS; level++)
        json_array_append_new(levels, json_integer(r->levels[level]));
    document = json_pack("{s:s s:s s:s s:I s:i s:o}", "schema", "cl-nascent.export/1", "run",
                         options->operand, "file", options->export_file, "step",
                         (json_int_t)r->step, "leaves", r->leaves, "levels", levels);
    json_object_update(document, counts);
    if (bytes_of(options->export_file) >= 0)
        json_object_set_new(document, "bytes", json_integer(bytes_of(options->export_file)));
    if (r->faces_before > 0) {
        json_object_set_new(document, "triangles_before",
                            json_integer((json_int_t)r->faces_before));
        json_object_set_new(document, "reduction_error", json_real(r->reduction_error));
    }
    if (r->parts > 0) {
        json_object_set_new(document, "parts", json_integer((json_int_t)r->parts));
        json_object_set_new(document, "triangles_left_out",
                            json_integer((json_int_t)r->faces_left_out));
    }
    if (r->vertices > 0) {
        json_t *box = json_array(), *written = json_array();

        for (int i = 0; i < 6; i++) {
            json_array_append_new(box, json_real(r->box[i]));
            json_array_append_new(written, json_real(r->written[i]));
        }
        json_object_set_new(document, "size",
                            json_pack("[f,f,f]", r->size[0], r->size[1], r->size[2]));
        json_object_set_new(document, "box", box);
        json_object_set_new(document, "written", written);
        json_object_set_new(document, "seen_through_share", json_real(r->faint));
        json_object_set_new(document, "few_views_share", json_real(r->few_views));
    }
    if (r->faces > 0) {
        if (r->fine > 0)
            json_object_set_new(document, "cell", json_real(r->fine));
        json_object_set_new(document, "area", json_real(r->area));
        json_object_set_new(document, "open_edges", json_integer((json_int_t)r->open_edges));
        json_object_set_new(document, "volume",
                            r->open_edges == 0 ? json_real(r->volume) : json_null());
        if (options->closed)
            json_object_set_new(document, "unseen_share", json_real(r->unseen));
        if (is_any(r->taken_off))
            json_object_set_new(
                document, "taken_off",
                json_pack("[f,f,f]", r->taken_off[0], r->taken_off[1], r->taken_off[2]));
    }
    if (r->refined)
        json_object_set_new(document, "refined_poses", json_true());
    if (r->beyond_left_out)
        json_object_set_new(document, "beyond_left_out", json_true());
    json_decref(counts);
    return cln_print_json(document);
}

static void print_leaves(FILE *to, const cln_export_result *r)
{
    const char *before = " (";
    char text[32];

    cln_format_count(r->leaves, text);
    fprintf(to, "%s %s", text, cln_plural(r->leaves, "leaf", "leaves"));
    for (int level = 0; level < CLN_LEVELS; level++) {
        if (r->levels[level] == 0)
            continue;
        cln_format_count(r->levels[level], text);
        fprintf(to, "%slevel %d: %s", before, level, text);
        before = ", ";
    }
    fprintf(to, "%s", r->leaves > 0 ? ")" : "");
}

static void print_box(FILE *to, const char *where, const double b[6])
{
    const double side = fmax(fmax(b[3] - b[0], b[4] - b[1]), b[5] - b[2]);
    char text[CLN_BOX_BYTES];

    cln_box_write(b, side > 0 ? side : 1, text);
    fprintf(to, ", %s within %s", where, text);
}

/* The size as it is written, by which a wrong unit is seen, where that is, if the file's numbers
 * are not the scene's, and the box as --crop takes it. */
static void print_size(FILE *to, const cln_export_desc *desc, bool glb, const cln_export_result *r)
{
    const bool scaled = desc->scale != 1;
    const bool metres = glb && !scaled;
    const bool changed = glb || scaled || desc->up_auto || is_any(desc->up) ||
                         is_any(desc->offset) || is_any(r->taken_off);

    fprintf(to, ", %.3g x %.3g x %.3g units%s", r->size[0], r->size[1], r->size[2],
            metres ? " (to glTF they are metres: --scale)" : "");
    if (changed)
        print_box(to, "in the file", r->written);
    print_box(to, "in the scene's frame", r->box);
}

static void print_area(FILE *to, const cln_export_result *r)
{
    if (r->open_edges > 0) {
        fprintf(to, ", open (area %.4g", r->area);
        if (r->fine > 0)
            fprintf(to, "; its cells are %.2g", r->fine);
        fputs(")", to);
        return;
    }
    fprintf(to, ", closed (area %.4g, volume %.4g", r->area, r->volume);
    if (r->fine > 0)
        fprintf(to, "; a surface off by one cell, %.2g, makes %.2g of it", r->fine,
                r->area * r->fine);
    fputs(")", to);
}

/* bytes: of the file; -1 = not told */
static void print_sentence(FILE *to, const char *file, const cln_export_desc *desc,
                           json_int_t bytes, const cln_export_result *r)
{
    json_t *counts = counts_of(r), *value = NULL;
    const char *key = NULL, *before = "";
    char text[32];

    fprintf(to, "%s: ", file);
    if (json_object_size(counts) == 0)
        print_leaves(to, r);
    json_object_foreach(counts, key, value)
    {
        if (json_is_array(value)) {
            fprintf(to, "a grid of %d x %d x %d", r->shape[2], r->shape[1], r->shape[0]);
        } else {
            cln_format_count((double)json_integer_value(value), text);
            fprintf(to, "%s%s %.*s", before, text, /* one has no s */
                    (int)strlen(key) - (json_integer_value(value) == 1), key);
        }
        before = ", ";
    }
    json_decref(counts);
    if (r->refined)
        fprintf(to, ", with the poses that training corrected");
    if (r->faces_before > 0) {
        cln_format_count((double)r->faces_before, text);
        fprintf(to, " (of %s; moved by up to %.2g units)", text, r->reduction_error);
    }
    if (r->parts == 1)
        fprintf(to, ", in one part");
    if (r->parts > 1) {
        cln_format_count((double)r->parts, text);
        fprintf(to, ", the largest of %s parts", text);
        cln_format_count((double)r->faces_left_out, text);
        fprintf(to, " (the others had %s %s)", text,
                cln_plural((double)r->faces_left_out, "triangle", "triangles"));
    }
    if (r->vertices > 0)
        print_size(to, desc, cln_ends_with(file, ".glb"), r);
    if (r->faces > 0)
        print_area(to, r);
    if (bytes >= 0) {
        cln_format_bytes((double)bytes, text);
        fprintf(to, ", %s", text);
    }
    cln_format_count((double)r->step, text);
    fprintf(to, ", of the model at step %s\n", text);
}

/* The first ending of an export's files: ".ply". */
static void ending_of(const char *what, char *out, size_t bytes)
{
    static const struct {
        const char *what, *form;
    } forms[] = {
#define X(name, needs, form, help) {#name, form},
        CLN_EXPORT_LIST(X)
#undef X
    };

    for (size_t i = 0; i < sizeof forms / sizeof *forms; i++) {
        const char *dot = strchr(forms[i].form, '.');

        if (dot && strcmp(what, forms[i].what) == 0)
            snprintf(out, bytes, "%.*s", (int)strcspn(dot, "|"), dot);
    }
}

/* "-": exports to a temporary file and copies that to standard output. */
static cln_status export_to_stdout(const cln_options *options, cln_export_desc *desc,
                                   cln_export_result *result)
{
    cln_status st = CLN_OK;
    const char *folder = getenv("TMPDIR");
    char *path = NULL, *bytes = NULL, ending[16] = "";
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
    if (strcmp(desc->what, "volume") == 0)
        return cln_fail(CLN_USAGE,
                        "--volume -: a volume is two files, the array and its place; name a "
                        "file");
    ending_of(desc->what, ending, sizeof ending);
    if (strcmp(desc->what, "copy") == 0)
        return cln_fail(CLN_USAGE, "--copy -: a copy of a run is a folder; name it");
    CLN_TRY(
        cln_asprintf(&path, "%s/cl-nascent-XXXXXX%s", folder && *folder ? folder : "/tmp", ending));
    file = mkstemps(path, (int)strlen(ending));
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

/* CLN_USAGE for `export --mesh RUN FILE`. */
static cln_status check_order(const cln_options *options)
{
    cln_status st = CLN_OK;
    char *manifest = NULL, run[CLN_QUOTED_BYTES], file[CLN_QUOTED_BYTES];

    CLN_TRY(cln_path_join(&manifest, options->export_file, "run.json"));
    if (cln_is_file(manifest) && !cln_is_dir(options->operand))
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--%s %s: this is a run; it comes first, and the file here: "
                         "`cl-nascent export %s --%s %s`",
                         options->export_what, options->export_file,
                         cln_shell_quote(options->export_file, run, sizeof run),
                         options->export_what,
                         cln_shell_quote(options->operand, file, sizeof file)));
done:
    free(manifest);
    return st;
}

cln_status cln_cmd_export(const cln_options *options)
{
    cln_status st = CLN_OK;
    const bool to_stdout = strcmp(options->export_file, "-") == 0;
    cln_console console = {0};
    cln_export_result result = {0};
    cln_export_desc desc = {.run = options->operand,
                            .what = options->export_what,
                            .file = options->export_file,
                            .colour = options->box_colour,
                            .overwrite = options->overwrite,
                            .scene = options->scene,
                            .spacing = options->spacing,
                            .count = options->count,
                            .closed = options->closed,
                            .scale = options->scale,
                            .triangles = options->triangles,
                            .largest = options->largest,
                            .device = options->device};

    CLN_TRY(check_order(options));
    CLN_TRY(cln_crop_of_option(options->crop, &desc.cropped, desc.crop, desc.crop_turn));
    if (options->up)
        CLN_TRY(cln_up_read("--up", options->up, desc.up));
    desc.up_auto = options->up && strcmp(options->up, "auto") == 0;
    if (options->offset && !cln_reals_read(options->offset, 3, desc.offset))
        CLN_TRY(cln_fail(CLN_USAGE, "--offset: '%s' is not three numbers X,Y,Z", options->offset));
    CLN_TRY(cln_console_open(options, &console));
    desc.callbacks = console.callbacks;
    if (to_stdout)
        CLN_TRY(export_to_stdout(options, &desc, &result));
    else
        CLN_TRY(cln_export(&desc, &result));
    cln_console_close(&console);
    if (options->json)
        CLN_TRY(print_document(options, &result));
    else if (!to_stdout)
        print_sentence(stdout, options->export_file, &desc, bytes_of(options->export_file),
                       &result);
    else if (!options->quiet)
        print_sentence(stderr, "standard output", &desc, -1, &result);
done:
    cln_console_close(&console);
    return st;
}
