/* A folder held by one process alone, by a lock (flock) on its file `lock`, which names the
 * process: whoever dies in any way holds nothing. Knows no run. */
#ifndef CLN_HOLD_H
#define CLN_HOLD_H

#include "base/status.h"

/* Holds the folder until it is released or the process ends. does: what this process does there,
 * "trains this run"; instead: what another one may do, or "". CLN_OUTPUT names the process that
 * holds it already. Warns on a file system without locks. *lock: -1 after a failure. */
cln_status cln_hold(const char *folder, const char *does, const char *instead, int *lock);

/* Release: the file stays, empty. Remove: it goes, too. Both accept a negative lock. */
void cln_hold_release(int lock);
void cln_hold_remove(const char *folder, int lock);

/* Who holds it. Nobody knows without the file, or on a file system without locks. */
typedef enum cln_holder {
    CLN_HOLDER_UNKNOWN,
    CLN_HOLDER_NONE,
    CLN_HOLDER_US, /* this process */
    CLN_HOLDER_ANOTHER
} cln_holder;
cln_holder cln_held_by(const char *folder);

/* CLN_OUTPUT, which names the process that holds it and does that, also where this account may only
 * read; CLN_OK if its lock is gone. */
cln_status cln_held_refuse(const char *folder, const char *does);

#endif
