/* Room on a disk, asked for before hours of work rather than after. */
#ifndef CLN_DISK_H
#define CLN_DISK_H

#include <stdbool.h>

#include "base/status.h"

/* Can `bytes` be written in this folder, which need not be there yet: CLN_OUTPUT if it, or the
 * nearest above it that is there, is no folder, cannot be written to, or has less room on its disk.
 * `what` is the subject of that sentence: "2 checkpoints". */
cln_status cln_disk_check(const char *folder, double bytes, const char *what);

/* The same for a file in its folder. */
cln_status cln_disk_check_file(const char *path, double bytes, const char *what);

/* Can a file be written there: its folder exists and can be written to, and nothing is at `path`
 * but, if it is to be replaced, a plain file. CLN_OUTPUT. */
cln_status cln_disk_check_new(const char *path, bool replace);

#endif
