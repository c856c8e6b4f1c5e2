/* Names of the files that belong to a view: eval, render and the report must agree on them. */
#ifndef CLN_NAMES_H
#define CLN_NAMES_H

#include "base/status.h"

/* "train/r_0.png" -> "train_r_0": the dataset's name without .png, .jpg or .jpeg, in one folder. The caller
 * frees *out. */
cln_status cln_view_file_name(const char *name, char **out);

#endif
