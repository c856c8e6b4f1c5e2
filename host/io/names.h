/* Names of a view's files, for evaluation, rendering and the report alike. */
#ifndef CLN_NAMES_H
#define CLN_NAMES_H

#include "base/status.h"

/* "train/r_0.png" -> "train_r_0": the dataset's name as one file's name, without .png, .jpg or
 * .jpeg. The caller frees *out. */
cln_status cln_view_file_name(const char *name, char **out);

#endif
