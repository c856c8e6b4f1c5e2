/* `cl-nascent completion SHELL`: what bash, zsh or fish must know to complete command lines, from
 * the option tables. Where an option or operand takes a file, or anything else, shells offer
 * files. */
#include "cli/commands.h"

#include <stdio.h>
#include <string.h>
#include "cli/option_table.h"
#include "cli/options.h"

/* An option of one of the tables, as completion sees it. */
typedef struct entry {
    const char *name, *help, *words; /* words: "a|b|c", or NULL */
    char letter;                     /* 0 = none */
    bool value, negatable;           /* value: one must follow */
} entry;

typedef void put_entry(const cln_command *command, const entry *e);

static void each_option(const cln_command *command, put_entry *put)
{
    for (int i = 0; i < cln_arg_count; i++) {
        const cln_arg *arg = &cln_args[i];
        const bool plain =
            arg->kind == CLN_ARG_FLAG || arg->kind == CLN_ARG_COUNT || arg->kind == CLN_ARG_OPTINT;
        const entry e = {arg->name, arg->help, arg->words, arg->letter, !plain, arg->negatable};

        if (cln_command_takes_arg(command, arg))
            put(command, &e);
    }
    for (int i = 0; i < cln_config_row_count; i++) {
        const cln_config_row *row = &cln_config_rows[i];
        const bool toggle = cln_config_is_switch(row);
        const entry e = {row->option, row->help, toggle ? NULL : row->words, 0, !toggle, toggle};

        if (cln_command_takes_row(command, row))
            put(command, &e);
    }
}

/* Words in a command's place that are none. */
#define HELP    "The commands, or the options of one"
#define VERSION "The version"

/* "a|b|c" with spaces. */
static void put_words(const char *words)
{
    for (; *words; words++)
        putchar(*words == '|' ? ' ' : *words);
}

/* Prints a text that stands within single quotes. Brackets, which would end it in zsh, become
 * parentheses. */
static void put_text(const char *text)
{
    for (; *text; text++)
        if (*text == '\'')
            printf("'\\''");
        else
            putchar(*text == '[' ? '(' : *text == ']' ? ')' : *text);
}

/* The words that a command's operand can be, if it is no file. */
static const char *operand_words(const cln_command *command)
{
    return command->bit == CLN_COMPLETION ? CLN_SHELLS : NULL;
}

/* ---- bash ---- */

static void put_bash_words(const cln_command *command, const entry *e)
{
    if (!e->words)
        return;
    printf("    %s,--%s) words='", command->name, e->name);
    put_words(e->words);
    printf("' ;;\n");
}

static void put_bash_name(const cln_command *command, const entry *e)
{
    (void)command;
    printf(" --%s", e->name);
    if (e->negatable)
        printf(" --no-%s", e->name);
}

static void put_bash(void)
{
    printf(
        "# bash completion for cl-nascent, by `cl-nascent completion bash`\n"
        "_cl_nascent()\n{\n"
        "    local cur=${COMP_WORDS[COMP_CWORD]} prev=${COMP_WORDS[COMP_CWORD-1]} words=\n"
        "    if [ \"$cur\" = = ]; then\n"
        "        cur=\n"
        "    elif [ \"$prev\" = = ]; then\n" /* --option=value is three words */
        "        prev=${COMP_WORDS[COMP_CWORD-2]}\n"
        "    fi\n"
        "    COMPREPLY=()\n"
        "    if [ \"$COMP_CWORD\" = 1 ] || [ \"$COMP_CWORD ${COMP_WORDS[1]}\" = '2 help' ]; then\n"
        "        COMPREPLY=($(compgen -W 'help version");
    for (int i = 0; i < cln_command_count; i++)
        printf(" %s", cln_commands[i].name);
    printf("' -- \"$cur\"))\n        return\n    fi\n    case ${COMP_WORDS[1]},$prev in\n");
    for (int i = 0; i < cln_command_count; i++)
        each_option(&cln_commands[i], put_bash_words);
    for (int i = 0; i < cln_command_count; i++)
        if (operand_words(&cln_commands[i])) {
            printf("    %s,%s) words='", cln_commands[i].name, cln_commands[i].name);
            put_words(operand_words(&cln_commands[i]));
            printf("' ;;\n");
        }
    printf("    esac\n    case $cur in\n    -*)\n        case ${COMP_WORDS[1]} in\n");
    for (int i = 0; i < cln_command_count; i++) {
        printf("        %s) words='", cln_commands[i].name);
        each_option(&cln_commands[i], put_bash_name);
        printf("' ;;\n");
    }
    printf("        esac ;;\n    esac\n"
           "    [ -z \"$words\" ] || COMPREPLY=($(compgen -W \"$words\" -- \"$cur\"))\n"
           "}\ncomplete -o default -F _cl_nascent cl-nascent\n");
}

/* ---- zsh ---- */

static void put_zsh_option(const cln_command *command, const entry *e)
{
    (void)command;
    printf("        ");
    if (e->letter)
        printf("'(-%c --%s)'{-%c%s,--%s%s}'[", e->letter, e->name, e->letter, e->value ? "+" : "",
               e->name, e->value ? "=" : "");
    else
        printf("'--%s%s[", e->name, e->value ? "=" : "");
    put_text(e->help);
    printf("]");
    if (e->words) {
        printf(":%s:(", e->name);
        put_words(e->words);
        printf(")");
    } else if (e->value) {
        printf(":%s:_files", e->name);
    }
    printf("' \\\n");
    if (e->negatable)
        printf("        '--no-%s[not --%s]' \\\n", e->name, e->name);
}

static void put_zsh(void)
{
    printf("#compdef cl-nascent\n# by `cl-nascent completion zsh`\n"
           "if (( CURRENT == 2 )) || [[ $CURRENT$words[2] = 3help ]]; then\n"
           "    local -a commands\n    commands=(\n"
           "        'help:" HELP "'\n        'version:" VERSION "'\n");
    for (int i = 0; i < cln_command_count; i++) {
        printf("        '%s:", cln_commands[i].name);
        put_text(cln_commands[i].purpose);
        printf("'\n");
    }
    printf("    )\n    _describe command commands\n    return\nfi\n"
           "local command=$words[2]\nshift words\n(( CURRENT-- ))\ncase $command in\n");
    for (int i = 0; i < cln_command_count; i++) {
        const cln_command *c = &cln_commands[i];

        printf("%s)\n    _arguments \\\n", c->name);
        each_option(c, put_zsh_option);
        if (operand_words(c)) {
            printf("        '1:%s:(", c->operand);
            put_words(operand_words(c));
            printf(")' ;;\n");
        } else {
            printf("        '%s' ;;\n", c->bit == CLN_INFO ? "*:file:_files"
                                        : c->operand       ? "1:file:_files"
                                                           : "*::");
        }
    }
    printf("esac\n");
}

/* ---- fish ---- */

static void put_fish_option(const cln_command *command, const entry *e)
{
    const char *start = "complete -c cl-nascent -n '__fish_seen_subcommand_from";

    printf("%s %s' -l %s", start, command->name, e->name);
    if (e->letter)
        printf(" -s %c", e->letter);
    if (e->words) {
        printf(" -x -a '");
        put_words(e->words);
        printf("'");
    } else if (e->value) {
        printf(" -r");
    }
    printf(" -d '");
    put_text(e->help);
    printf("'\n");
    if (e->negatable)
        printf("%s %s' -l no-%s -d 'not --%s'\n", start, command->name, e->name, e->name);
}

static void put_fish(void)
{
    const char *start = "complete -c cl-nascent -n";

    printf("# fish completion for cl-nascent, by `cl-nascent completion fish`\n"
           "%s __fish_use_subcommand -f -a help -d '" HELP "'\n"
           "%s __fish_use_subcommand -f -a version -d '" VERSION "'\n"
           "%s '__fish_seen_subcommand_from help' -f -a 'help version",
           start, start, start);
    for (int i = 0; i < cln_command_count; i++)
        printf(" %s", cln_commands[i].name);
    printf("'\n");
    for (int i = 0; i < cln_command_count; i++) {
        const cln_command *c = &cln_commands[i];

        printf("%s __fish_use_subcommand -f -a %s -d '", start, c->name);
        put_text(c->purpose);
        printf("'\n");
        if (operand_words(c)) {
            printf("%s '__fish_seen_subcommand_from %s' -f -a '", start, c->name);
            put_words(operand_words(c));
            printf("'\n");
        }
    }
    for (int i = 0; i < cln_command_count; i++)
        each_option(&cln_commands[i], put_fish_option);
}

cln_status cln_cmd_completion(const cln_options *options)
{
    if (strcmp(options->operand, "bash") == 0)
        put_bash();
    else if (strcmp(options->operand, "zsh") == 0)
        put_zsh();
    else if (strcmp(options->operand, "fish") == 0)
        put_fish();
    else
        return cln_fail(CLN_USAGE, "completion: '%s' is not one of " CLN_SHELLS, options->operand);
    return CLN_OK;
}
