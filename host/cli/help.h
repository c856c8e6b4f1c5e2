/* Help and version texts, made from the tables of option_table.h and base/config.h. */
#ifndef CLN_HELP_H
#define CLN_HELP_H

#include <stdio.h>
#include "cli/option_table.h"

/* Prints the help of a command, or with NULL the list of commands. */
void cln_help_print(FILE *to, const cln_command *command);

/* Prints what a command's help tells of one option, by its name with or without dashes; NULL: of
 * all commands that have one so called, each such option with their names. CLN_USAGE: none. */
cln_status cln_help_print_option(FILE *to, const cln_command *command, const char *option);

/* Prints the value of every setting of a command in a preset, and in brackets the default preset's
 * where that is another. CLN_USAGE: no such preset. */
cln_status cln_help_print_preset(FILE *to, const cln_command *command, const char *preset);

/* The optional libraries that this program was or was not built with, a line without newline. */
const char *cln_built_with(void);

/* "cl-nascent 0.1.0"; verbose: also the libraries and OpenCL platforms it runs on. */
void cln_version_print(FILE *to, bool verbose);

#endif
