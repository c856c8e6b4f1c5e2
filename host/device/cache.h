/* The folder in which PoCL, the driver of CPUs, keeps the kernels that it has compiled. It needs
 * room there even for kernels that it has, cannot go without, and makes sub-folders that no other
 * account may read. What is wrong with the folder looks, from its calls, like an error in a kernel,
 * or LLVM ends the process. Other drivers are left alone. */
#ifndef CLN_CACHE_H
#define CLN_CACHE_H

#include <stdbool.h>
#include <stddef.h>

#include "base/callbacks.h"
#include "base/status.h"

/* Checks before photos are read that this account can write to the folder of a platform's driver,
 * and that it has room: 16 MiB if no program is in it, else 2 MiB. CLN_OUTPUT names the folder, the
 * reason and the way out. */
cln_status cln_cache_check(const char *platform);

/* The same before a program is built. Before a device's first one (*ready is false, and true
 * afterwards) it also warns if there is less than 16 MiB, and of folders in it that this account
 * cannot write to, which kernels may need. */
cln_status cln_cache_ready(const char *platform, bool *ready);

/* A process's turn at compiling: all 0, or due until it had one. Several that start at once have
 * the same kernels to compile: one does while the others wait for it, once, and find then what it
 * made. The system gives its lock back, however the process ends. */
typedef struct cln_cache_turn {
    bool due;  /* set by who will end it, and does not wait for another process before that */
    bool held; /* `lock` is this process's */
    int lock;
    double waited; /* seconds */
} cln_cache_turn;

/* Before a program is built (compiled is false), and after one that the driver had to compile:
 * takes a turn that is due, or waits while another process has one, ten minutes at most. Goes on at
 * once where the folder takes no lock, and if it has programs and nothing was compiled yet.
 * CLN_SIGINT, CLN_SIGTERM if the callbacks say so meanwhile. */
cln_status cln_cache_take_turn(const char *platform, bool compiled, const cln_callbacks *callbacks,
                               cln_cache_turn *turn);
void cln_cache_end_turn(cln_cache_turn *turn); /* accepts one that was never taken */

/* After a build that failed: CLN_OUTPUT if the folder may be the reason. by_folders: so may those
 * in it that this account cannot write to. */
cln_status cln_cache_blame(const char *platform, bool by_folders);

/* Of no device: why there may be none. *out = a phrase, NULL if the folder can be used. The caller
 * frees it. */
void cln_cache_doubt(char **out);

/* The sentence for a driver that ends the process; false, without one, if there is room in the
 * folder. Takes no memory, as a signal's handler may ask. */
bool cln_cache_last_words(char *out, size_t bytes);

/* Are programs kept for later processes, as far as is known? */
bool cln_cache_keeps(const char *platform);

#endif
