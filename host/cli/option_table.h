/* The command line as data: the commands, and the options that are no hyperparameters; beside them
 * stand the rows of base/config.h. Parser, help and error suggestions all walk these tables, so
 * they cannot drift apart. Only data and look-ups: nothing here reads an argument. */
#ifndef CLN_OPTION_TABLE_H
#define CLN_OPTION_TABLE_H

#include <stddef.h>
#include "base/config.h"

struct cln_options;

enum {
    CLN_DEVICES = 1,
    CLN_TRAIN = 2,
    CLN_EVAL = 4,
    CLN_RENDER = 8,
    CLN_INFO = 16,
    CLN_SELFTEST = 32,
    CLN_EXPORT = 64,
    CLN_TUNE = 128,
    CLN_BUGREPORT = 256,
    CLN_VIEW = 512,
    CLN_CHECK_SCENE = 1024,
    CLN_POSES = 2048,
    CLN_COMPLETION = 4096
};

#define CLN_SHELLS "bash|zsh|fish" /* that completion knows */

typedef struct cln_command {
    const char *name;
    unsigned bit;          /* CLN_DEVICES ... */
    const char *operand;   /* "SCENE", or NULL if it takes none */
    bool operand_required; /* train: not with --resume */
    const char *usage, *purpose, *notes;
    cln_status (*run)(const struct cln_options *options);
} cln_command;

extern const cln_command cln_commands[];
extern const int cln_command_count;

typedef enum {
    CLN_ARG_FLAG,   /* bool; --name, and --no-name if negatable */
    CLN_ARG_COUNT,  /* int; one more each time */
    CLN_ARG_TEXT,   /* const char * */
    CLN_ARG_WORD,   /* const char *, one of words */
    CLN_ARG_INT,    /* int in [min, max] */
    CLN_ARG_OPTINT, /* the same; given without a value it is its standard, not given it is 0 */
    CLN_ARG_REAL    /* double in [min, max] */
} cln_arg_kind;

typedef struct cln_arg {
    const char *name;
    char letter; /* 0 = none */
    cln_arg_kind kind;
    const char *value; /* how help names the value: "DIR" */
    const char *words;
    double min, max;
    bool negatable;
    bool seconds;         /* REAL: also 90s, 10m, 2h, 1:30 */
    bool exports;         /* names what to export, too */
    const char *env;      /* environment variable that gives it when the command line does not */
    const char *standard; /* the default, as it would be given; NULL = nothing (0, NULL, false) */
    const char *shown;    /* default in words, where it is no value; NULL = as `standard` */
    unsigned commands;
    size_t offset; /* into cln_options */
    const char *help;
} cln_arg;

enum { CLN_ARGS_MAX = 128 };

extern const cln_arg cln_args[];
extern const int cln_arg_count;

/* Does this row of the table belong to the command (NULL: none does)? */
bool cln_command_takes_row(const cln_command *command, const cln_config_row *row);
bool cln_command_takes_arg(const cln_command *command, const cln_arg *arg);

/* Finds a command, or an option that the command takes, by its name ([length]: it may go on after
 * that) or letter; NULL if there is none. */
const cln_command *cln_command_find(const char *name);
const cln_arg *cln_arg_find(const cln_command *command, const char *name, size_t length);
const cln_arg *cln_arg_find_letter(const cln_command *command, char letter);
const cln_config_row *cln_row_find(const cln_command *command, const char *name, size_t length);

/* CLN_USAGE for an option that the command does not take, or an unknown command: the sentence says
 * which command takes the option, or which known name this one resembles. */
cln_status cln_fail_option(const cln_command *command, const char *name, size_t length);

/* Fails for --output of export. */
cln_status cln_fail_output(void);
cln_status cln_fail_command(const char *name);

/* The first command that has this option, with or without dashes, perhaps =VALUE, or "no-" of a
 * switch; NULL: none. */
const char *cln_command_of_option(const char *name);

/* Fails for an argument with dashes where the command belongs: says which command, or which of the
 * options that need none, it resembles. */
cln_status cln_fail_before_command(const char *argument);

#endif
