/* Names of a view's files, the same for evaluation, rendering and the report. Those of a loaded
 * scene are in its views (cln_view.file). */
#ifndef CLN_NAMES_H
#define CLN_NAMES_H

#include <stdbool.h>
#include <stddef.h>
#include "base/status.h"

/* Makes a file name of a dataset's view name, without .png, .jpg or another image's ending:
 * "train/r_0.png" -> "train_r_0". The caller frees *out. */
cln_status cln_view_file_name(const char *name, char **out);

/* The same for all views of a scene: files[i] is the file name of names[i]. If different names
 * would share it ("a/b" and "a_b"; "A" and "a"), "-" and eight hex digits of the name's digest are
 * added; also in place of what a name has beyond 180 bytes. Equal names have equal files. On
 * failure files may be partly filled; the caller frees them. */
cln_status cln_view_file_names(int count, const char *const *names, char **files);

/* Bytes of the folder that has all names, with its separator, / or \\; 0 if none has. count > 0. */
size_t cln_names_folder(int count, const char *const *names);

/* Is it a path from the root, or from a drive of Windows? */
bool cln_name_is_absolute(const char *name);

#endif
