/* cl-nascent.conf beside a scene: settings that this scene is always trained with. A line has an
 * option of train and its value, "rays 2048" or "rays = 2048"; "no-adaptive" or "adaptive no" for
 * switches; # begins a comment. Only hyperparameters: nothing in it names a device or a folder to
 * write. */
#ifndef CLN_CONF_H
#define CLN_CONF_H

#include "cli/option_table.h"
#include "cli/options.h"

/* Sets what the file beside `scene` (a folder or a file) says, of the rows that the command takes;
 * those of another command are passed over, and so are `overridden` ones (by row;
 * [cln_config_row_count]), which the command line sets. *said: a line for the log that names what
 * was set, or NULL where there is no file; the caller frees it. CLN_INPUT names file and line. */
cln_status cln_conf_read(const char *scene, const cln_command *command, const bool *overridden,
                         cln_settings *settings, char **said);

#endif
