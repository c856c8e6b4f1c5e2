/* cl-nascent.conf beside a scene: settings that this scene is always trained with. A line has an
 * option of train and its value, "rays 2048" or "rays = 2048"; "no-adaptive" or "adaptive no" for
 * switches; # begins a comment. Only a preset and hyperparameters: nothing in it names a device or
 * a folder to write. */
#ifndef CLN_CONF_H
#define CLN_CONF_H

#include "base/settings.h"

/* Sets what the file beside `scene` (a folder or a file) says, except `overridden` rows
 * ([cln_config_row_count]), which the command line sets, and its preset unless `keep_preset`;
 * nothing is given in `settings` yet then. info reads it, too, as it tells what a
 * training would need. *said: a line for the log that names what was set, or NULL where there is no
 * file; the caller frees it. CLN_INPUT names file and line. */
cln_status cln_conf_read(const char *scene, const bool *overridden, bool keep_preset,
                         cln_settings *settings, char **said);

/* cln_settings_set; the path of a file (CLN_ROW_FILE) becomes one from the root, so that it is
 * found from any folder later, where such a file is there and the path fits. folder: that a
 * relative path begins in, NULL = the present one. */
cln_status cln_conf_set(cln_settings *settings, const cln_config_row *row, const char *value,
                        const char *folder);

/* A resumed run keeps its settings. Says in *said which ones the file beside the scene (NULL: the
 * run's own) has otherwise; NULL if none, if there is no such file, or if it cannot be read. The
 * caller frees it. */
cln_status cln_conf_compare(const char *run, const char *scene, const bool *overridden,
                            const cln_settings *settings, char **said);

#endif
