/* The parser over the tables of option_table.h. Options stand after the command, in any order; of a
 * repeated one the last counts. The only place that reads the environment. Calls no part of the
 * library but the settings. */
#ifndef CLN_PARSE_H
#define CLN_PARSE_H

#include "cli/options.h"

/* Reads a command line into *out, which the caller frees also on failure. CLN_USAGE sentences name
 * the option and what is legal, or the option nearest to an unknown name. Errors of reading the run
 * of --resume pass through. */
cln_status cln_options_parse(int argc, char **argv, cln_options *out);
/* Whether messages have colours: as --color says; auto: on a terminal that has colours, unless
 * NO_COLOR is set. Also for options whose parsing failed. */
bool cln_options_colour(const cln_options *options);
void cln_options_free(cln_options *options);

#endif
