/* Room on a disk, asked for before hours of work rather than after. */
#ifndef CLN_DISK_H
#define CLN_DISK_H

#include "base/status.h"

/* Asks before the work whether `bytes` can be written at `path`, a file or folder that need not be
 * there yet: CLN_OUTPUT if the folder, or the nearest above it that is there, cannot be written to,
 * or if its disk has less room. `what` is the subject of that sentence: "2 checkpoints". */
cln_status cln_disk_check(const char *path, double bytes, const char *what);

#endif
