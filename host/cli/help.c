/* Prints the option tables for people: name and value on the left, on the right the sentence, then
 * what is legal and the default of each preset, wrapped to 80 columns. */
#include "cli/help.h"

#include <jansson.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>
#include "base/commit.h"
#include "base/number.h"
#include "cl_nascent.h"

/* columns; those that a list of words goes on at; commands of an option of most commands */
enum { LEFT = 26, RIGHT = 80, LIST = 6, MOST = 5 };

/* ---- layout ---- */

/* Prints the words of a text from column `column` on, wrapped, later lines indented. */
static void put_wrapped(FILE *to, int column, int indent, const char *text)
{
    bool first = true;

    for (text += strspn(text, " "); *text; text += strspn(text, " ")) {
        int length = (int)strcspn(text, " ");

        if (!first && column + 1 + length > RIGHT) {
            fprintf(to, "\n%*s", indent, "");
            column = indent;
        } else if (!first) {
            fputc(' ', to);
            column++;
        }
        fprintf(to, "%.*s", length, text);
        column += length;
        text += length;
        first = false;
    }
    fputc('\n', to);
}

static void put_entry(FILE *to, const char *left, const char *help)
{
    int length = (int)strlen(left), column = 0;

    while (column + length > RIGHT) { /* a list of words: broken between two of them */
        int part = RIGHT - column;

        while (part > 0 && left[part - 1] != '|')
            part--;
        part = part > 0 ? part : length;
        fprintf(to, "%.*s\n%*s", part, left, LIST, "");
        column = LIST;
        left += part;
        length -= part;
    }
    fputs(left, to);
    length += column;
    if (length > LEFT - 2) {
        fputc('\n', to);
        length = 0;
    }
    fprintf(to, "%*s", LEFT - length, "");
    put_wrapped(to, LEFT, LEFT, help);
}

/* ---- entries ---- */

static void put_arg(FILE *to, const cln_arg *arg)
{
    char left[96], help[512], letter[8] = "";
    const char *value = arg->value ? arg->value : arg->words;
    const char *standard = arg->shown ? arg->shown : arg->standard;
    bool range =
        arg->kind == CLN_ARG_INT || arg->kind == CLN_ARG_OPTINT || arg->kind == CLN_ARG_REAL;
    int used = 0;

    if (arg->letter)
        snprintf(letter, sizeof letter, "-%c, ", arg->letter);
    if (!value)
        snprintf(left, sizeof left, "  %s--%s%s", letter, arg->negatable ? "[no-]" : "", arg->name);
    else if (arg->kind == CLN_ARG_OPTINT)
        snprintf(left, sizeof left, "  %s--%s [%s]", letter, arg->name, value);
    else
        snprintf(left, sizeof left, "  %s--%s %s", letter, arg->name, value);
    used = snprintf(help, sizeof help, "%s", arg->help);
    if (range || standard || arg->env) {
        const char *comma = "";

        used += snprintf(help + used, sizeof help - (size_t)used, " (");
        if (range) {
            used += snprintf(help + used, sizeof help - (size_t)used, "%.10g to %.10g", arg->min,
                             arg->max);
            comma = "; ";
        }
        if (standard) {
            used +=
                snprintf(help + used, sizeof help - (size_t)used, "%sdefault %s", comma, standard);
            comma = "; ";
        }
        if (arg->env)
            used += snprintf(help + used, sizeof help - (size_t)used, "%senvironment: %s", comma,
                             arg->env);
        snprintf(help + used, sizeof help - (size_t)used, ")");
    }
    put_entry(to, left, help);
}

/* The presets that help names values of, the default one first. */
static const char *const shown_presets[] = {CLN_DEFAULT_PRESET, "fast", "paper"};
enum { SHOWN = sizeof shown_presets / sizeof shown_presets[0] };

/* "default X" where all presets agree, else "voxel X, fast Y, paper Z"; those that agree share a
 * value: "voxel and fast X, paper Y". */
static void text_of_values(const cln_config presets[SHOWN], const cln_config_row *row, char *out,
                           size_t bytes)
{
    char values[SHOWN][CLN_TEXT_BYTES];
    size_t used = 0;
    bool equal = true;

    for (int i = 0; i < SHOWN; i++) {
        cln_config_text(&presets[i], row, values[i]);
        equal = equal && strcmp(values[i], values[0]) == 0;
    }
    if (equal) {
        snprintf(out, bytes, "default %s", *values[0] ? values[0] : "none");
        return;
    }
    for (int i = 0; i < SHOWN; i++) {
        const bool next = i + 1 < SHOWN && strcmp(values[i], values[i + 1]) == 0;

        used += (size_t)snprintf(out + used, bytes - used, "%s ", shown_presets[i]);
        used += next ? (size_t)snprintf(out + used, bytes - used, "and ")
                     : (size_t)snprintf(out + used, bytes - used, "%s%s",
                                        *values[i] ? values[i] : "none", i + 1 < SHOWN ? ", " : "");
    }
}

static void put_row(FILE *to, const cln_config_row *row, const cln_config presets[SHOWN])
{
    char left[96], help[1280], range[2 * CLN_NUMBER_BYTES + 8] = "";
    char values[SHOWN * (CLN_TEXT_BYTES + 16)];
    char min[CLN_NUMBER_BYTES], max[CLN_NUMBER_BYTES], alias[64] = "";

    text_of_values(presets, row, values, sizeof values);
    if (cln_config_is_switch(row))
        snprintf(left, sizeof left, "  --[no-]%s%s%s", row->option, row->words ? "=" : "",
                 row->words ? row->words : "");
    else
        snprintf(left, sizeof left, "  --%s %s", row->option,
                 row->type == CLN_ROW_ENUM   ? row->words
                 : row->flags & CLN_ROW_FILE ? "FILE"
                 : row->type == CLN_ROW_TEXT ? "TEXT"
                                             : "N");
    if (row->type == CLN_ROW_INT) {
        snprintf(range, sizeof range, "%.0f to %.0f; ", row->min, row->max);
    } else if (row->type == CLN_ROW_REAL) {
        cln_number_write(row->min, min);
        cln_number_write(row->max, max);
        snprintf(range, sizeof range, "%s to %s; ", min, max);
    }
    if (row->alias)
        snprintf(alias, sizeof alias, "; also --%s", row->alias);
    snprintf(help, sizeof help, "%s (%s%s%s)", row->help, range, values, alias);
    put_entry(to, left, help);
}

/* Prints the settings that a command takes, group by group, each by `put` with the same values. */
static void put_groups(FILE *to, const cln_command *command,
                       void (*put)(FILE *, const cln_config_row *, const cln_config *),
                       const cln_config *values)
{
    for (int g = 0; g < CLN_CONFIG_GROUPS; g++) {
        bool titled = false;

        for (int i = 0; i < cln_config_row_count; i++) {
            const cln_config_row *row = &cln_config_rows[i];

            if (strcmp(row->group, cln_config_groups[g][0]) != 0 ||
                !cln_command_takes_row(command, row))
                continue;
            if (!titled)
                fprintf(to, "\n%s:\n", cln_config_groups[g][1]);
            titled = true;
            put(to, row, values);
        }
    }
}

static void put_rows(FILE *to, const cln_command *command)
{
    cln_config presets[SHOWN];

    for (int i = 0; i < SHOWN; i++)
        if (cln_config_preset(shown_presets[i], &presets[i]) != CLN_OK)
            return;
    put_groups(to, command, put_row, presets);
}

static bool is_of_most(const cln_arg *arg)
{
    int commands = 0;

    for (unsigned bits = arg->commands; bits; bits &= bits - 1)
        commands++;
    return commands >= MOST;
}

/* Prints a command's options: those of most commands, or the others, which come first. */
static void put_args(FILE *to, const cln_command *command, bool of_most, const char *title)
{
    bool titled = false;

    for (int i = 0; i < cln_arg_count; i++) {
        if (!cln_command_takes_arg(command, &cln_args[i]) || is_of_most(&cln_args[i]) != of_most)
            continue;
        if (!titled)
            fprintf(to, "\n%s:\n", title);
        titled = true;
        put_arg(to, &cln_args[i]);
    }
}

static void put_command(FILE *to, const cln_command *command)
{
    fprintf(to, "Usage: cl-nascent %s\n\n%s.\n", command->usage, command->purpose);
    put_wrapped(to, 0, 0, command->notes);
    put_args(to, command, false, "Options");
    put_args(to, command, true, "Options of most commands");
    put_rows(to, command);
}

static void put_program(FILE *to)
{
    fprintf(to, "Usage: cl-nascent COMMAND [OPTIONS]\n\n"
                "Posed photos in, a scene to look at from anywhere out, on any OpenCL device.\n\n"
                "Commands:\n");
    for (int i = 0; i < cln_command_count; i++)
        fprintf(to, "  %-12s%s\n", cln_commands[i].name, cln_commands[i].purpose);
    fprintf(to, "  %-12s%s\n", "help",
            "This, or the options of a command: `cl-nascent help train`");
    fprintf(to, "  %-12s%s\n", "version",
            "Versions: the program's, with -v those of libraries, too");
    fprintf(to, "\n"
                "  -h, --help            this help; after a command, its options\n"
                "  -V, --version         version; with -v also those of libraries and drivers\n"
                "\n"
                "For example:\n"
                "  cl-nascent devices\n"
                "  cl-nascent train scene/ -o run/ --time-limit 10m\n"
                "  cl-nascent eval run/\n"
                "  cl-nascent render run/ --orbit 60\n"
                "\n"
                "Sizes are given as 512M or 4G, times as 90s, 10m, 2h or 1:30. Results go to\n"
                "standard output, log and progress to standard error. The system's loader and\n"
                "drivers decide which OpenCL devices there are (they read OCL_ICD_VENDORS,\n"
                "POCL_DEVICES, CUDA_VISIBLE_DEVICES and the like).\n"
                "The manual, with exit codes and files: man cl-nascent\n");
}

void cln_help_print(FILE *to, const cln_command *command)
{
    if (command)
        put_command(to, command);
    else
        put_program(to);
}

/* A setting's value; in brackets the default preset's, if it differs. */
static void put_value(FILE *to, const cln_config_row *row, const cln_config values[2])
{
    char value[CLN_TEXT_BYTES], other[CLN_TEXT_BYTES];

    cln_config_text(&values[0], row, value);
    cln_config_text(&values[1], row, other);
    fprintf(to, "  --%-22s %s", row->option, *value ? value : "none");
    if (strcmp(value, other) != 0)
        fprintf(to, "  (%s)", *other ? other : "none");
    fputc('\n', to);
}

/* "--name, of train, check:" */
static void put_owners(FILE *to, const char *name, const cln_arg *arg, const cln_config_row *row)
{
    const char *before = "of ";

    fprintf(to, "--%s, ", name);
    for (int i = 0; i < cln_command_count; i++)
        if (arg ? cln_command_takes_arg(&cln_commands[i], arg)
                : cln_command_takes_row(&cln_commands[i], row)) {
            fprintf(to, "%s%s", before, cln_commands[i].name);
            before = ", ";
        }
    fprintf(to, ":\n");
}

cln_status cln_help_print_option(FILE *to, const cln_command *command, const char *option)
{
    cln_status st = CLN_OK;
    cln_config presets[SHOWN];
    const char *name = option + strspn(option, "-");
    size_t length = strcspn(name, "=");
    int found = 0;

    for (int i = 0; i < SHOWN; i++)
        CLN_TRY(cln_config_preset(shown_presets[i], &presets[i]));
    if (strncmp(name, "no-", 3) == 0 && cln_command_of_option(name)) {
        name += 3;
        length -= 3;
    }
    for (int i = 0; i < cln_arg_count; i++)
        if (cln_command_takes_arg(command, &cln_args[i]) &&
            (length == 1 ? cln_args[i].letter == *name
                         : strlen(cln_args[i].name) == length &&
                               strncmp(cln_args[i].name, name, length) == 0)) {
            put_owners(to, cln_args[i].name, &cln_args[i], NULL);
            put_arg(to, &cln_args[i]);
            found++;
        }
    for (int i = 0; i < cln_config_row_count; i++)
        if ((!command || cln_command_takes_row(command, &cln_config_rows[i])) &&
            cln_config_named(&cln_config_rows[i], name, length)) {
            put_owners(to, cln_config_rows[i].option, NULL, &cln_config_rows[i]);
            put_row(to, &cln_config_rows[i], presets);
            found++;
        }
    if (found == 0 && command)
        st = cln_fail_option(command, name, length);
    else if (found == 0)
        st = cln_fail(CLN_USAGE,
                      "no command has an option %s; `cl-nascent help COMMAND` lists a "
                      "command's options",
                      option);
done:
    return st;
}

cln_status cln_help_print_preset(FILE *to, const cln_command *command, const char *preset)
{
    cln_status st = CLN_OK;
    cln_config values[2];

    CLN_TRY(cln_config_preset(preset, &values[0]));
    CLN_TRY(cln_config_preset(CLN_DEFAULT_PRESET, &values[1]));
    fprintf(to, "Settings of --preset %s", preset);
    if (strcmp(preset, CLN_DEFAULT_PRESET) != 0)
        fprintf(to, " (in brackets those of " CLN_DEFAULT_PRESET ", where they differ)");
    fprintf(to, ".\nWhat each is: `cl-nascent help %s`\n", command->name);
    put_groups(to, command, put_value, values);
done:
    return st;
}

const char *cln_built_with(void)
{
#ifdef CLN_WITH_MICROHTTPD
#define WITH_VIEW "with libmicrohttpd (view)"
#else
#define WITH_VIEW "without libmicrohttpd (no view)"
#endif
#ifdef CLN_WITH_MESHOPTIMIZER
#define WITH_TRIANGLES "with meshoptimizer (export --triangles)"
#else
#define WITH_TRIANGLES "without meshoptimizer (no export --triangles)"
#endif
#ifdef CLN_WITH_LCMS2
#define WITH_COLOURS "with Little CMS (colour profiles of photos)"
#else
#define WITH_COLOURS "without Little CMS (colour profiles of photos count as sRGB)"
#endif
#ifdef CLN_WITH_UTF8PROC
#define WITH_NAMES "with utf8proc (names of files in either Unicode form)"
#else
#define WITH_NAMES "without utf8proc (names of files in one Unicode form alone)"
#endif
#ifdef CLN_WITH_EXPAT
#define WITH_XML "with expat (cameras of Metashape)"
#else
#define WITH_XML "without expat (no cameras of Metashape in XML)"
#endif
    return "built " WITH_VIEW ", " WITH_TRIANGLES ", " WITH_COLOURS ", " WITH_NAMES ", " WITH_XML;
}

void cln_version_print(FILE *to, bool verbose)
{
    cln_device_info *devices = NULL;
    int count = 0;

    fprintf(to, "cl-nascent " CLN_VERSION "\n");
    if (!verbose)
        return;
    fprintf(to, "commit %s\n", cln_commit());
    fprintf(to, "jansson %s\nzlib %s\n", jansson_version_str(), zlibVersion());
    fprintf(to, "%s\n", cln_built_with());
    if (cln_devices_list(NULL, false, &devices, &count) != CLN_OK) {
        cln_clear_error();
        fprintf(to, "OpenCL: no device\n");
    }
    for (int i = 0; i < count; i++)
        fprintf(to, "OpenCL: %s, %s: %s, driver %s\n", devices[i].platform, devices[i].version,
                devices[i].name, devices[i].driver);
    free(devices);
}
