/* Names of a view's files, the same for evaluation, rendering and the report. */
#ifndef CLN_NAMES_H
#define CLN_NAMES_H

#include "base/status.h"

/* Makes a file name of a dataset's view name, without .png, .jpg or .jpeg: "train/r_0.png" ->
 * "train_r_0". The caller frees *out. */
cln_status cln_view_file_name(const char *name, char **out);

#endif
