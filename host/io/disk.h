/* Room on a disk, checked before hours of work rather than after. */
#ifndef CLN_DISK_H
#define CLN_DISK_H

#include <stdbool.h>

#include "base/status.h"

/* *out = the path itself, or its nearest ancestor that exists; "." for a relative one without. The
 * caller frees it. CLN_MEMORY. */
cln_status cln_disk_nearest(const char *path, char **out);

/* Checks that `bytes` can be written in a folder, which need not exist yet: CLN_OUTPUT if it, or
 * its nearest ancestor that exists, is not a folder, cannot be written to, or has less room on its
 * disk, or if a name in the path is too long. what: subject of the sentence about room, "2
 * checkpoints". */
cln_status cln_disk_check(const char *folder, double bytes, const char *what);

/* CLN_OUTPUT if no file of this process may have so many bytes (ulimit -f). subject: begins the
 * sentence. */
cln_status cln_disk_check_size(const char *subject, double bytes, const char *what);

/* The same for a file in its folder. */
cln_status cln_disk_check_file(const char *path, double bytes, const char *what);

/* Free bytes of the disk that the folder is, or will be, on; INFINITY if it does not tell. */
double cln_disk_room(const char *folder);

/* Checks that a file can be written at `path`: its folder exists and can be written to, and nothing
 * is there, or with `replace` at most a plain file. CLN_OUTPUT. */
cln_status cln_disk_check_new(const char *path, bool replace);

#endif
