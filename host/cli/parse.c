/* The parser over the tables of option_table.h. Two passes: first every argument is matched and
 * what sets a hyperparameter is put aside, then the base settings (preset, or the run to resume)
 * are fetched and the rest is applied in the order given; so an option's place on the line never
 * matters.
 *
 *   precedence   command line > environment > cl-nascent.conf > preset (or the resumed run)
 *   forms        --name value   --name=value   --no-name   -n value   -nvalue   -qv   -- */
#include "cli/parse.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/settings.h"
#include "base/text.h"
#include "cli/conf.h"
#include "cli/option_table.h"
#include "export/list.h"
#include "io/film.h"
#include "io/json.h"
#include "io/run_folder.h"
#include "model/model.h"
#include "scene/dataset.h"
#include "scene/reader.h"

/* ", --points FILE.ply", .... */
#define X(what, needs, form, help) ", --" #what " " form
static const char exports[] = CLN_EXPORT_LIST(X);
#undef X

/* A row of the table to be set, in the order of the line. */
typedef struct setting {
    const cln_config_row *row;
    const char *text;
} setting;

typedef struct parser {
    int argc;
    char **argv;
    int at; /* next argument */
    cln_options *out;
    setting *settings; /* [argc] */
    int setting_count;
    bool given[CLN_ARGS_MAX]; /* by row of cln_args */
    const char *dashed;       /* an argument of letters that also names a file, "-dash", or NULL */
} parser;

/* ---- values ---- */

static void *field_of(cln_options *options, const cln_arg *arg)
{
    return (char *)options + arg->offset;
}

static cln_status fail_range(const cln_arg *arg, const char *text)
{
    return cln_fail(CLN_USAGE, "--%s: '%s' is not a %snumber from %.10g to %.10g%s", arg->name,
                    text, arg->kind == CLN_ARG_REAL ? "" : "whole ", arg->min, arg->max,
                    arg->seconds ? " seconds (or 90s, 10m, 2h, 1:30)" : "");
}

static bool is_word_of(const char *words, const char *text)
{
    size_t wanted = strlen(text);

    for (; *words; words += words[0] == '|') {
        size_t length = strcspn(words, "|");
        if (length == wanted && memcmp(words, text, length) == 0)
            return true;
        words += length;
    }
    return false;
}

static cln_status number_in_range(const cln_arg *arg, const char *text, double *value)
{
    const bool read =
        arg->seconds ? cln_seconds_read(text, value, NULL) : cln_reals_read(text, 1, value);

    if (!read || !(*value >= arg->min && *value <= arg->max) ||
        (arg->kind != CLN_ARG_REAL && *value != floor(*value)))
        return fail_range(arg, text);
    return CLN_OK;
}

static cln_status set_arg(cln_options *out, const cln_arg *arg, const char *text)
{
    cln_status st = CLN_OK;
    void *field = field_of(out, arg);
    double value = 0;

    switch (arg->kind) {
    case CLN_ARG_FLAG:
        *(bool *)field = strcmp(text, "no") != 0;
        break;
    case CLN_ARG_COUNT:
        ++*(int *)field;
        break;
    case CLN_ARG_WORD:
        if (!is_word_of(arg->words, text))
            return cln_fail(CLN_USAGE, "--%s: '%s' is not one of %s", arg->name, text, arg->words);
        *(const char **)field = text;
        break;
    case CLN_ARG_TEXT:
        if (!*text)
            return cln_fail(CLN_USAGE, "--%s: the value is empty", arg->name);
        *(const char **)field = text;
        break;
    case CLN_ARG_INT:
    case CLN_ARG_OPTINT:
        CLN_TRY(number_in_range(arg, text, &value));
        *(int *)field = (int)value;
        break;
    case CLN_ARG_REAL:
        CLN_TRY(number_in_range(arg, text, &value));
        *(double *)field = value;
        break;
    }
done:
    return st;
}

/* Is the argument an option of one letter, "-q"? */
static bool is_letter(const parser *p, const char *argument)
{
    return argument[0] == '-' && argument[1] && !argument[2] &&
           cln_arg_find_letter(p->out->command, argument[1]);
}

/* The value of an option: after '=', or the next argument. Negative numbers are values; an argument
 * that starts with "--", or is an option of one letter, is the next option. */
static cln_status take_value(parser *p, const char *name, const char *form, const char *attached,
                             const char **text)
{
    *text = attached;
    if (attached)
        return CLN_OK;
    if (p->at >= p->argc || strncmp(p->argv[p->at], "--", 2) == 0 || is_letter(p, p->argv[p->at]))
        return cln_fail(CLN_USAGE, "--%s needs a value: --%s %s", name, name, form);
    *text = p->argv[p->at++];
    return CLN_OK;
}

static const char *form_of_arg(const cln_arg *arg)
{
    return arg->value ? arg->value : arg->words;
}

static const char *form_of_row(const cln_config_row *row)
{
    if (row->type == CLN_ROW_ENUM)
        return row->words;
    if (row->flags & CLN_ROW_FILE)
        return "FILE";
    return row->type == CLN_ROW_TEXT ? "TEXT" : "N";
}

static cln_status choose_export(cln_options *out, const cln_arg *arg)
{
    if (out->export_what && strcmp(out->export_what, arg->name) != 0)
        return cln_fail(CLN_USAGE, "--%s and --%s: one at a time; leave one out", out->export_what,
                        arg->name);
    out->export_what = arg->name;
    return CLN_OK;
}

/* Sets every option's default, before the environment and the command line are read. */
static cln_status set_standards(cln_options *out)
{
    cln_status st = CLN_OK;

    out->elevation = NAN; /* no option can set it */
    for (int i = 0; i < cln_arg_count; i++) {
        if (cln_args[i].standard && cln_args[i].kind != CLN_ARG_OPTINT)
            CLN_TRY(set_arg(out, &cln_args[i], cln_args[i].standard));
    }
done:
    return st;
}

static cln_status apply_arg(parser *p, const cln_arg *arg, const char *attached)
{
    cln_status st = CLN_OK;
    const char *text = "yes";

    p->given[arg - cln_args] = true;
    if (arg->kind == CLN_ARG_FLAG || arg->kind == CLN_ARG_COUNT) {
        if (attached)
            return cln_fail(CLN_USAGE, "--%s takes no value", arg->name);
    } else if (arg->kind == CLN_ARG_OPTINT && !attached) {
        /* "--orbit RUN" as well as "--orbit 60 RUN": its value are digits, or a wrong number that
         * is no run; "--" ends options. */
        text = p->at < p->argc ? p->argv[p->at] : "";
        if (*text && (text[strspn(text, "0123456789")] == 0 ||
                      (text[strspn(text, "-+.,0123456789")] == 0 && strpbrk(text, "0123456789") &&
                       !cln_is_dir(text)))) {
            p->at++;
        } else {
            text = arg->standard;
        }
    } else {
        CLN_TRY(take_value(p, arg->name, form_of_arg(arg), attached, &text));
    }
    CLN_TRY(set_arg(p->out, arg, text));
    if (arg->exports)
        CLN_TRY(choose_export(p->out, arg));
done:
    return st;
}

static void put_aside(parser *p, const cln_config_row *row, const char *text)
{
    p->settings[p->setting_count++] = (setting){row, text};
}

/* ---- one argument ---- */

static cln_status parse_long(parser *p, const char *argument)
{
    cln_status st = CLN_OK;
    const cln_command *command = p->out->command;
    const char *name = argument + 2;
    size_t length = strcspn(name, "=");
    const char *attached = name[length] ? name + length + 1 : NULL;
    const cln_arg *arg = cln_arg_find(command, name, length);
    const cln_config_row *row = arg ? NULL : cln_row_find(command, name, length);
    const char *text = NULL;

    if (arg) {
        CLN_TRY(apply_arg(p, arg, attached));
    } else if (row && cln_config_is_switch(row)) {
        if (!attached && p->at < p->argc && cln_config_is_word(row, p->argv[p->at]))
            attached = p->argv[p->at++]; /* --exposure auto: no scene is called so */
        put_aside(p, row, attached ? attached : "yes");
    } else if (row) {
        CLN_TRY(take_value(p, row->option, form_of_row(row), attached, &text));
        put_aside(p, row, text);
    } else if (strncmp(name, "no-", 3) == 0 && !attached) {
        arg = cln_arg_find(command, name + 3, length - 3);
        row = cln_row_find(command, name + 3, length - 3);
        if (arg && arg->negatable)
            *(bool *)field_of(p->out, arg) = false;
        else if (row && cln_config_is_switch(row))
            put_aside(p, row, "no");
        else
            st = cln_fail_option(command, name, length);
    } else if (strncmp(name, "no-", 3) == 0 &&
               (row = cln_row_find(command, name + 3, length - 3)) && cln_config_is_switch(row)) {
        st = cln_fail(CLN_USAGE, "--%s: a switch that is off takes no value; write --%.*s alone",
                      name, (int)length, name);
    } else {
        st = cln_fail_option(command, name, length);
    }
done:
    return st;
}

static cln_status fail_dashed(const char *name)
{
    return cln_fail(CLN_USAGE, "%s: names that begin with a dash are taken for options; give ./%s",
                    name, name);
}

/* "-steps" is a long option with one dash too few. */
static cln_status fail_letters(const cln_command *command, const char *argument, char letter)
{
    const size_t length = strcspn(argument + 1, "=");

    if (cln_arg_find(command, argument + 1, length) || cln_row_find(command, argument + 1, length))
        return cln_fail(CLN_USAGE, "%s: long options begin with two dashes: --%s", argument,
                        argument + 1);
    if (access(argument, F_OK) == 0)
        return fail_dashed(argument);
    if (letter == 'o' && command->bit == CLN_EXPORT)
        return cln_fail_output();
    for (int i = 0; i < cln_command_count; i++) {
        const cln_arg *arg = cln_arg_find_letter(&cln_commands[i], letter);

        if (arg && !cln_arg_find(command, arg->name, strlen(arg->name)))
            return cln_fail_option(command, arg->name, strlen(arg->name));
    }
    return cln_fail(CLN_USAGE, "unknown option -%c", letter);
}

/* "-q", "-qv", "-o DIR", "-oDIR". */
static cln_status parse_letters(parser *p, const char *argument)
{
    cln_status st = CLN_OK;

    for (const char *letter = argument + 1; *letter; letter++) {
        const cln_arg *arg = cln_arg_find_letter(p->out->command, *letter);
        bool valued = arg && arg->kind != CLN_ARG_FLAG && arg->kind != CLN_ARG_COUNT;

        if (!arg)
            return fail_letters(p->out->command, argument, *letter);
        if (valued && letter[1] == '=') /* as behind a long name */
            letter++;
        CLN_TRY(apply_arg(p, arg, valued && letter[1] ? letter + 1 : NULL));
        if (valued && letter[1] && access(argument, F_OK) == 0)
            p->dashed = argument;
        if (valued)
            break;
    }
done:
    return st;
}

/* Length of a dash or a minus sign (U+2010 to U+2015, U+2212) that text begins with, or 0. */
static size_t dash_length(const char *text)
{
    const unsigned char *c = (const unsigned char *)text;

    return (c[0] == 0xE2 && c[1] == 0x80 && c[2] >= 0x90 && c[2] <= 0x95) ||
                   (c[0] == 0xE2 && c[1] == 0x88 && c[2] == 0x92)
               ? 3
               : 0;
}

/* An option whose hyphens a page, a letter or a word processor made to a dash. */
static cln_status check_dash(const char *argument)
{
    const char *name = argument;

    if (dash_length(argument) == 0 || access(argument, F_OK) == 0)
        return CLN_OK;
    while (*name == '-' || dash_length(name))
        name += *name == '-' ? 1 : dash_length(name);
    if (!*name)
        return cln_fail(CLN_USAGE,
                        "'%s' is a dash alone, as text that was copied from a page has it: leave "
                        "it out, or type hyphens and the name of an option",
                        argument);
    return cln_fail(CLN_USAGE,
                    "'%s' begins with a dash, not with hyphens, as text that was copied from a "
                    "page does: type %s%s",
                    argument, name[0] && (!name[1] || name[1] == '=') ? "-" : "--", name);
}

static cln_status parse_operand(parser *p, const char *argument)
{
    const cln_command *command = p->out->command;

    if (check_dash(argument) != CLN_OK)
        return CLN_USAGE;
    if (!command->operand)
        return cln_fail(CLN_USAGE, "unexpected argument '%s': %s takes only options", argument,
                        command->name);
    /* "poses *.jpg" */
    if (p->out->operand && cln_dataset_is_image(p->out->operand) && cln_dataset_is_image(argument))
        return cln_fail(CLN_USAGE,
                        "unexpected argument '%s' beside '%s': give the folder that the "
                        "photos are in",
                        argument, p->out->operand);
    if (p->out->operand && command->bit != CLN_INFO)
        return cln_fail(CLN_USAGE, "unexpected argument '%s': %s takes one %s, and has '%s'%s",
                        argument, command->name, command->operand, p->out->operand,
                        cln_arg_find_letter(command, 'o') ? "; name the output with -o"
                        : cln_arg_find(command, "mesh", 4)
                            ? "; what to write is an option, such as "
                              "--mesh FILE.glb"
                            : "");
    if (!*argument)
        return cln_fail(CLN_USAGE, "%s: the name of %s is empty", command->name, command->operand);
    p->out->operand = p->out->operand ? p->out->operand : argument;
    p->out->operands[p->out->operand_count++] = argument;
    return CLN_OK;
}

static cln_status parse_rest(parser *p)
{
    cln_status st = CLN_OK;
    bool only_operands = false;

    while (p->at < p->argc) {
        const char *argument = p->argv[p->at++];
        if (only_operands || argument[0] != '-' || !argument[1])
            st = parse_operand(p, argument);
        else if (strcmp(argument, "--") == 0)
            only_operands = true;
        else if (argument[1] == '-')
            st = parse_long(p, argument);
        else
            st = parse_letters(p, argument);
        CLN_TRY(st);
    }
done:
    return st;
}

/* ---- the first word ---- */

/* "cl-nascent photos/" */
static cln_status fail_folder_first(const char *folder)
{
    cln_status st = CLN_OK;
    char quoted[CLN_QUOTED_BYTES], *manifest = NULL;

    CLN_TRY(cln_path_join(&manifest, folder, "run.json"));
    cln_shell_quote(folder, quoted, sizeof quoted);
    CLN_TRY(
        cln_is_file(manifest)
            ? cln_fail(CLN_USAGE,
                       "%s: a command comes first; this is a run: `cl-nascent view %s` shows it",
                       folder, quoted)
            : cln_fail(CLN_USAGE,
                       "%s: a command comes first: of photos `cl-nascent poses %s -o SCENE`, of "
                       "photos with poses `cl-nascent train %s -o RUN`",
                       folder, quoted, quoted));
done:
    free(manifest);
    return st;
}

static bool takes_preset(const cln_command *command)
{
    return command && cln_arg_find(command, "preset", 6);
}

/* help [CMD] [--OPTION | --preset NAME], --help, --version [-v], or a command. */
static cln_status parse_first(parser *p)
{
    cln_options *out = p->out;
    const char *first = p->argc > 1 ? p->argv[1] : NULL;

    if (!first)
        return cln_fail(CLN_USAGE, "no command is given, such as train or eval");
    p->at = 2;
    if (strcmp(first, "help") == 0) {
        out->help = true;
        if (p->at + 1 == p->argc &&
            (strcmp(p->argv[p->at], "--help") == 0 || strcmp(p->argv[p->at], "-h") == 0))
            p->at++;
        if (p->at < p->argc && p->argv[p->at][0] != '-') {
            const char *about = p->argv[p->at++];

            out->command = cln_command_find(about);
            if (!out->command && cln_command_of_option(about))
                out->help_option = about;
            else if (!out->command && strcmp(about, "help") != 0 && strcmp(about, "version") != 0)
                return cln_fail_command(about);
        }
        if (p->at < p->argc && takes_preset(out->command)) {
            const char *argument = p->argv[p->at];

            if (strncmp(argument, "--preset=", 9) == 0)
                out->help_preset = argument + 9;
            else if (strcmp(argument, "--preset") == 0 && p->at + 1 < p->argc)
                out->help_preset = p->argv[++p->at];
            p->at += out->help_preset != NULL;
        }
        if (p->at < p->argc && p->argv[p->at][0] == '-' && !out->help_preset && !out->help_option)
            out->help_option = p->argv[p->at++];
        if (p->at < p->argc)
            return cln_fail(CLN_USAGE,
                            "unexpected argument '%s': help takes one command, and one option or "
                            "--preset NAME for its values there",
                            p->argv[p->at]);
        return CLN_OK;
    }
    if (first[0] == '-' || strcmp(first, "version") == 0) {
        out->version = first[0] != '-';
        p->at = first[0] == '-' ? 1 : 2;
        for (; p->at < p->argc && p->argv[p->at][0] == '-'; p->at++) {
            const char *argument = p->argv[p->at];
            if (strcmp(argument, "--help") == 0 || strcmp(argument, "-h") == 0)
                out->help = true;
            else if (strcmp(argument, "--version") == 0 || strcmp(argument, "-V") == 0)
                out->version = true;
            else if (strcmp(argument, "--verbose") == 0 || strcmp(argument, "-v") == 0)
                out->verbose++;
            else
                return cln_fail_before_command(argument);
        }
        if (!out->help && !out->version)
            return cln_fail_before_command(first);
        if (out->help && p->at < p->argc) /* "--help train" */
            out->command = cln_command_find(p->argv[p->at++]);
        if (p->at < p->argc)
            return cln_fail(CLN_USAGE, "unexpected argument '%s'", p->argv[p->at]);
        return CLN_OK;
    }
    out->command = cln_command_find(first);
    if (!out->command && cln_is_dir(first))
        return fail_folder_first(first);
    return out->command ? CLN_OK : cln_fail_command(first);
}

/* ---- checks of several arguments ---- */

static cln_status read_environment(parser *p)
{
    for (int i = 0; i < cln_arg_count; i++) {
        const cln_arg *arg = &cln_args[i];
        const char *text = arg->env ? getenv(arg->env) : NULL;

        if (!text || !*text || p->given[i] || !cln_command_takes_arg(p->out->command, arg))
            continue;
        /* Only TEXT and WORD options have a variable. */
        if (arg->kind == CLN_ARG_WORD && !is_word_of(arg->words, text))
            return cln_fail(CLN_USAGE, "%s: '%s' is not one of %s", arg->env, text, arg->words);
        *(const char **)field_of(p->out, arg) = text;
    }
    return CLN_OK;
}

static bool is_given(const parser *p, const char *name)
{
    const cln_arg *arg = cln_arg_find(p->out->command, name, strlen(name));

    return arg && p->given[arg - cln_args];
}

/* Tells settings that were made for another run's scene and are not its preset's: those that the
 * command line does not have. */
static cln_status tell_of_scene(const char *run, const cln_settings *its, const cln_config *usual,
                                const bool *overridden, char **said)
{
    cln_status st = CLN_OK;
    char list[1024] = "";

    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        char here[CLN_TEXT_BYTES], there[CLN_TEXT_BYTES];

        cln_config_text(&its->config, row, here);
        cln_config_text(usual, row, there);
        if (row->flags & CLN_ROW_SCENE && !overridden[i] && strcmp(here, there) != 0)
            snprintf(list + strlen(list), sizeof list - strlen(list), " --%s=%s", row->option,
                     here);
    }
    if (list[0])
        CLN_TRY(cln_asprintf(said, "of %s for its scene, taken over, too:%s", run, list));
done:
    return st;
}

/* Settings for a new run that are those of another one, as if they were a preset's. */
static cln_status take_settings_of(const char *run, const bool *overridden, cln_settings **out,
                                   char **said)
{
    cln_status st = CLN_OK;
    json_t *document = NULL;
    cln_config known;

    st = cln_settings_of_run(run, out);
    if (st != CLN_OK)
        cln_note("taking the settings of --settings-of");
    CLN_TRY(st);
    CLN_TRY(cln_reader_run(run, &document));
    if (json_is_true(json_object_get(document, "bbox_found"))) /* of its photos, nobody's choice */
        memset((*out)->config.bbox, 0, sizeof(*out)->config.bbox);
    if (json_is_true(json_object_get(document, "space_found")))
        (*out)->config.space = CLN_SPACE_AUTO;
    cln_format((*out)->preset, sizeof(*out)->preset, "%s", cln_json_text(document, "preset"));
    if (cln_config_preset((*out)->preset, &known) != CLN_OK) { /* another version's */
        cln_clear_error();
        cln_format((*out)->preset, sizeof(*out)->preset, "%s", CLN_DEFAULT_PRESET);
        CLN_TRY(cln_config_preset(CLN_DEFAULT_PRESET, &known));
    }
    CLN_TRY(tell_of_scene(run, *out, &known, overridden, said));
done:
    json_decref(document);
    return st;
}

static cln_status apply_settings(parser *p)
{
    cln_status st = CLN_OK;
    cln_options *out = p->out;
    bool *overridden = NULL; /* by row of the settings: the command line has it */

    CLN_TRY(cln_alloc(&overridden, (size_t)cln_config_row_count, sizeof *overridden, "options"));
    for (int i = 0; i < p->setting_count; i++)
        overridden[p->settings[i].row - cln_config_rows] = true;
    if (out->resume)
        CLN_TRY(cln_settings_of_run(out->resume, &out->settings));
    else if (out->settings_of)
        CLN_TRY(take_settings_of(out->settings_of, overridden, &out->settings, &out->conf_said));
    else
        CLN_TRY(cln_settings_create(out->preset, &out->settings));
    if (out->conf && out->operand_count == 1 && !out->resume && !out->settings_of &&
        out->command->bit != CLN_TUNE)
        CLN_TRY(cln_conf_read(out->operand, overridden, is_given(p, "preset"), out->settings,
                              &out->conf_said));
    if (out->conf && out->resume)
        CLN_TRY(cln_conf_compare(out->resume, out->operand, overridden, out->settings,
                                 &out->conf_said));
    for (int i = 0; i < p->setting_count; i++)
        CLN_TRY(cln_conf_set(out->settings, p->settings[i].row, p->settings[i].text, NULL));
    if (out->resume && out->resume_or_start)
        cln_settings_forget_same(out->settings);
    st = cln_settings_check(out->settings);
    if (st != CLN_OK && out->conf_said && !out->resume)
        cln_note("also taking settings %s", out->conf_said);
done:
    free(overridden);
    return st;
}

/* --resume-or-start: goes on with the run in -o if it has a checkpoint. What a new run begins with
 * may be given again: of a preset the same, as the run has it; --settings-of was taken over. */
static cln_status choose_start(parser *p)
{
    cln_status st = CLN_OK;
    cln_options *out = p->out;
    json_t *document = NULL;
    char *path = NULL;
    bool there = false;

    CLN_TRY(cln_path_join(&path, out->output, "run.json"));
    if (cln_is_file(path))
        CLN_TRY(cln_checkpoint_exists(out->output, &there));
    if (!there)
        goto done;
    CLN_TRY(cln_reader_run(out->output, &document));
    if (is_given(p, "preset") && strcmp(cln_json_text(document, "preset"), out->preset) != 0)
        CLN_TRY(cln_fail(CLN_USAGE,
                         "--preset %s: %s began with preset %s, and a run keeps its settings; "
                         "leave it out, or choose a new folder",
                         out->preset, out->output, cln_json_text(document, "preset")));
    out->resume = out->output;
    out->output = NULL;
done:
    json_decref(document);
    free(path);
    return st;
}

static cln_status check_train(parser *p)
{
    static const char *const of_view[] = {"view-share", "port", "listen", "open"};
    const cln_options *out = p->out;

    if (out->resume && out->resume_or_start)
        return cln_fail(CLN_USAGE, "--resume-or-start cannot be combined with --resume; give SCENE "
                                   "and -o RUN");
    if (out->resume && out->output)
        return cln_fail(CLN_USAGE,
                        "--output '%s' cannot be combined with --resume '%s', which is the folder",
                        out->output, out->resume);
    if (out->settings_of && (out->resume || is_given(p, "preset")))
        return cln_fail(CLN_USAGE,
                        "--settings-of cannot be combined with --%s: both have all settings; leave "
                        "one out",
                        out->resume ? "resume" : "preset");
    if (out->resume && is_given(p, "preset"))
        return cln_fail(CLN_USAGE, "--preset cannot be combined with --resume: a run keeps its "
                                   "settings; give single options");
    if (!out->resume && !out->operand && p->dashed)
        return fail_dashed(p->dashed);
    if (!out->resume && !out->operand)
        return cln_fail(CLN_USAGE, "train: SCENE is missing; give a folder, or --resume RUN");
    if (!out->resume && !out->output)
        return cln_fail(CLN_USAGE, "train: the folder to write is missing; give -o RUN");
    for (size_t i = 0; i < sizeof of_view / sizeof of_view[0]; i++)
        if (!out->watch && is_given(p, of_view[i]))
            return cln_fail(CLN_USAGE, "--%s requires --view", of_view[i]);
    return out->resume_or_start ? choose_start(p) : CLN_OK;
}

/* Runs side by side: what describes a scene would do nothing there. */
static cln_status check_info(const parser *p)
{
    static const char *const of_scene[] = {"preset", "like", "conf"};
    const cln_options *out = p->out;
    const char *name = p->setting_count > 0 ? p->settings[0].row->option : NULL;

    if (out->operand_count < 2)
        return CLN_OK;
    for (size_t i = 0; i < sizeof of_scene / sizeof of_scene[0]; i++)
        if (is_given(p, of_scene[i]))
            name = of_scene[i];
    if (!out->conf)
        name = "no-conf";
    return name ? cln_fail(CLN_USAGE, "--%s requires one SCENE, but %d names are given", name,
                           out->operand_count)
                : CLN_OK;
}

/* A place on a drive of Windows would be a file of that name here. */
static cln_status check_drive(const char *path)
{
    if (path && cln_is_drive_path(path) && !cln_is_dir(path))
        return cln_fail(CLN_USAGE, "%s: names a drive of Windows, which is no place here", path);
    return CLN_OK;
}

/* A film has only colours, and a folder must not be named like a film or a picture. */
static cln_status check_render_output(const parser *p)
{
    static const char *const of_folder[] = {"pfm",        "normals", "seen",
                                            "depth-unit", "z-depth", "bits"};
    static const char *const files[] = {".avi",  ".m4v",  ".mpg",  ".mpeg", ".ogv",
                                        ".png",  ".jpg",  ".jpeg", ".tif",  ".exr",
                                        ".webp", ".apng", ".avif", ".tiff", ".wmv"};
    const char *output = p->out->output, *dot = output ? strrchr(output, '.') : NULL;

    if (output && cln_film_named(output)) {
        for (size_t i = 0; i < sizeof of_folder / sizeof of_folder[0]; i++)
            if (is_given(p, of_folder[i]))
                return cln_fail(
                    CLN_USAGE,
                    "--%s: a film has only colours; leave it out, or name a folder with -o",
                    of_folder[i]);
        if (p->out->transparent && !cln_film_takes_alpha(output))
            return cln_fail(CLN_USAGE, CLN_FILM_NO_ALPHA, output);
        return CLN_OK;
    }
    if (is_given(p, "fps"))
        return cln_fail(CLN_USAGE, "--fps requires a film: -o FILE.mp4");
    for (size_t i = 0; dot && i < sizeof files / sizeof files[0]; i++)
        if (strcasecmp(dot, files[i]) == 0 && !cln_is_dir(output))
            return cln_fail(CLN_USAGE,
                            "-o %s: is not the name of a film (.mp4 .mov .mkv .webm .gif .y4m); "
                            "give one, or a folder for pictures%s",
                            output,
                            p->out->map && strncasecmp(dot, ".tif", 4) == 0
                                ? "; gdal_translate makes a GeoTIFF of a map (man cl-nascent)"
                            : strcasecmp(dot, ".webp") == 0 || strcasecmp(dot, ".apng") == 0
                                ? "; pages show .mp4 and .webm, and .webm with --transparent"
                                : "");
    return CLN_OK;
}

static cln_status check_render(const parser *p)
{
    static const char *const sources[] = {"orbit", "spiral", "poses", "split", "map"};
    static const char *const of_map[] = {"spacing", "offset"};
    static const char *const not_of_map[] = {"views", "max-images", "interpolate", "frames"};
    static const char *const of_path[] = {"fov", "up"};
    static const char *const of_orbit[] = {"elevation", "circle"};
    const cln_options *out = p->out;
    const bool path = out->orbit_frames || out->spiral_frames;
    const char *source = NULL;

    for (size_t i = 0; i < sizeof sources / sizeof sources[0]; i++) {
        if (!is_given(p, sources[i]))
            continue;
        if (source)
            return cln_fail(CLN_USAGE, "--%s and --%s cannot be combined; give one of them", source,
                            sources[i]);
        source = sources[i];
    }
    for (size_t i = 0; i < sizeof not_of_map / sizeof not_of_map[0]; i++)
        if (out->map && is_given(p, not_of_map[i]))
            return cln_fail(CLN_USAGE, "--%s cannot be combined with --map, which is one picture",
                            not_of_map[i]);
    for (size_t i = 0; i < sizeof of_map / sizeof of_map[0]; i++)
        if (!out->map && is_given(p, of_map[i]))
            return cln_fail(CLN_USAGE, "--%s requires --map", of_map[i]);
    if (out->loop && !out->interpolate)
        return cln_fail(CLN_USAGE, "--loop requires --interpolate%s",
                        path ? "; an orbit or spiral is closed as it is" : "");
    if (!path && is_given(p, "radius"))
        return cln_fail(CLN_USAGE, "--radius requires --orbit or --spiral");
    for (size_t i = 0; i < sizeof of_path / sizeof of_path[0]; i++)
        if (!path && !out->interpolate && !(out->map && strcmp(of_path[i], "up") == 0) &&
            is_given(p, of_path[i]))
            return cln_fail(CLN_USAGE, "--%s requires --orbit, --spiral%s or --interpolate",
                            of_path[i], strcmp(of_path[i], "up") == 0 ? ", --map" : "");
    for (size_t i = 0; i < sizeof of_orbit / sizeof of_orbit[0]; i++)
        if (!out->orbit_frames && is_given(p, of_orbit[i]))
            return cln_fail(CLN_USAGE, "--%s requires --orbit", of_orbit[i]);
    if (out->views && (path || out->poses))
        return cln_fail(CLN_USAGE,
                        "--views cannot be combined with --%s; it names views of --split", source);
    if (path && out->max_images)
        return cln_fail(CLN_USAGE, "--max-images cannot be combined with --%s; give --%s N", source,
                        source);
    if (path && out->interpolate)
        return cln_fail(CLN_USAGE,
                        "--interpolate cannot be combined with --%s; give --split or --poses",
                        source);
    return check_render_output(p);
}

/* Chooses plain lines for a terminal that cannot redraw a line, or a log that keeps redraws. */
static void settle_progress(parser *p)
{
    const char *term = getenv("TERM");
    const char *ci = getenv("CI");

    if (p->out->quiet && !is_given(p, "progress"))
        p->out->progress = "none";
    else if (strcmp(p->out->progress, "auto") == 0 &&
             ((term && strcmp(term, "dumb") == 0) || (ci && *ci)))
        p->out->progress = "line";
}

/* --tune-file and its variable name a file that must exist (except for tune, which makes it); the
 * standard file need not exist. */
static cln_status settle_tune_file(parser *p)
{
    cln_status st = CLN_OK;
    cln_options *out = p->out;
    const char *config = getenv("XDG_CONFIG_HOME"), *home = getenv("HOME");
    const bool given = out->device.tune_file != NULL;

    if (given)
        CLN_TRY(cln_strdup(&out->tune_path, out->device.tune_file));
    else if (config && config[0] == '/')
        CLN_TRY(cln_path_join(&out->tune_path, config, "cl-nascent/tune.txt"));
    else if (home && *home)
        CLN_TRY(cln_path_join(&out->tune_path, home, ".config/cl-nascent/tune.txt"));
    if ((!given || out->command->bit == CLN_TUNE) && out->tune_path)
        out->device.tune_file = cln_is_file(out->tune_path) ? out->tune_path : NULL;
done:
    return st;
}

static cln_status settle(parser *p)
{
    cln_status st = CLN_OK;
    cln_options *out = p->out;
    unsigned bit = out->command->bit;

    settle_progress(p);
    CLN_TRY(settle_tune_file(p));
    if (out->output && strcmp(out->output, "-") == 0)
        CLN_TRY(cln_fail(
            CLN_USAGE, "-o -: %s does not write to standard output; name a file or folder%s",
            out->command->name, bit & CLN_EVAL ? ", or take the numbers with --json" : ""));
    if (bit == CLN_TRAIN)
        CLN_TRY(check_train(p));
    else if (bit == CLN_RENDER)
        CLN_TRY(check_render(p));
    else if (bit == CLN_INFO)
        CLN_TRY(check_info(p));
    if (bit != CLN_TRAIN && out->command->operand_required && !out->operand)
        CLN_TRY(p->dashed ? fail_dashed(p->dashed)
                          : cln_fail(CLN_USAGE, "%s: %s is missing: `cl-nascent %s %s%s`",
                                     out->command->name, out->command->operand, out->command->name,
                                     bit == CLN_COMPLETION ? CLN_SHELLS : out->command->operand,
                                     bit == CLN_POSES ? " -o SCENE" : ""));
    CLN_TRY(check_drive(out->output));
    CLN_TRY(check_drive(out->export_file));
    if (bit == CLN_POSES && !out->output)
        CLN_TRY(cln_fail(CLN_USAGE, "poses: the folder to write is missing; give -o SCENE"));
    if (bit == CLN_EXPORT && !out->export_what)
        CLN_TRY(
            cln_fail(CLN_USAGE, "export: what to write is missing; give one of%s", exports + 1));
    if (bit & (CLN_TRAIN | CLN_CHECK_SCENE | CLN_INFO | CLN_TUNE))
        CLN_TRY(apply_settings(p));
done:
    return st;
}

/* The command line in a form that can be typed again; for run.json. */
static cln_status quote_line(int argc, char **argv, char **out)
{
    cln_status st = CLN_OK;
    size_t bytes = 1;
    char *to = NULL;

    for (int i = 0; i < argc; i++)
        bytes += 4 * strlen(argv[i]) + 3;
    CLN_TRY(cln_alloc(out, bytes, 1, "command line"));
    to = *out;
    for (int i = 0; i < argc; i++) {
        if (i > 0)
            *to++ = ' ';
        cln_shell_quote(argv[i], to, bytes - (size_t)(to - *out));
        to += strlen(to);
    }
done:
    return st;
}

cln_status cln_options_parse(int argc, char **argv, cln_options *out)
{
    cln_status st = CLN_OK;
    parser p = {.argc = argc, .argv = argv, .out = out};

    *out = (cln_options){0};
    CLN_TRY(set_standards(out));
    for (int i = 1; i < argc; i++)
        if (!cln_utf8_valid(argv[i])) {
            st = cln_fail(CLN_USAGE,
                          "'%s': this is not UTF-8, and run.json could not hold it; rename it",
                          argv[i]);
            goto done;
        }
    CLN_TRY(cln_alloc(&p.settings, (size_t)argc + 1, sizeof *p.settings, "options"));
    CLN_TRY(cln_alloc(&out->operands, (size_t)argc + 1, sizeof *out->operands, "options"));
    CLN_TRY(quote_line(argc, argv, &out->line));
    CLN_TRY(parse_first(&p));
    if (!out->command || out->help)
        goto done;
    CLN_TRY(parse_rest(&p));
    if (!out->help && !out->version)
        CLN_TRY(read_environment(&p));
    if (out->help && takes_preset(out->command) && is_given(&p, "preset"))
        out->help_preset = out->preset;
    if (!out->help && !out->version)
        CLN_TRY(settle(&p));
done:
    free(p.settings);
    return st;
}

bool cln_options_colour(const cln_options *options)
{
    const char *when = options->color ? options->color : "auto";
    const char *none = getenv("NO_COLOR"), *term = getenv("TERM");

    if (strcmp(when, "auto") != 0)
        return strcmp(when, "always") == 0;
    return isatty(STDERR_FILENO) && !(none && *none) && term && strcmp(term, "dumb") != 0;
}

void cln_options_free(cln_options *options)
{
    free(options->operands);
    free(options->line);
    free(options->tune_path);
    free(options->conf_said);
    cln_settings_free(options->settings);
    options->settings = NULL;
    options->operands = NULL;
    options->line = options->tune_path = options->conf_said = NULL;
}
