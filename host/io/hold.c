/* Folders held by one process. See hold.h. */
#include "io/hold.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include "base/files.h"
#include "base/log.h"

/* Reads what the holder of a lock wrote into its file: "process 123 on HOST". */
static void read_holder(int lock, char *out, size_t bytes)
{
    const ssize_t n = pread(lock, out, bytes - 1, 0);

    out[n > 0 ? n : 0] = 0;
    out[strcspn(out, "\n")] = 0;
    if (!out[0])
        snprintf(out, bytes, "another process");
}

/* Makes what this process writes there. */
static void name_holder(char *out, size_t bytes)
{
    char host[128] = "";

    gethostname(host, sizeof host - 1);
    snprintf(out, bytes, "process %ld on %s", (long)getpid(), host);
}

cln_holder cln_held_by(const char *folder)
{
    char *path = NULL, holder[192], ours[192];
    cln_holder by = CLN_HOLDER_UNKNOWN;
    int file = -1;

    if (cln_path_join(&path, folder, "lock") == CLN_OK)
        file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    free(path);
    if (file < 0)
        return by;
    if (flock(file, LOCK_SH | LOCK_NB) == 0) {
        by = CLN_HOLDER_NONE;
    } else if (errno == EWOULDBLOCK) { /* a lock of this process refuses this file, too */
        read_holder(file, holder, sizeof holder);
        name_holder(ours, sizeof ours);
        by = strcmp(holder, ours) == 0 ? CLN_HOLDER_US : CLN_HOLDER_ANOTHER;
    }
    close(file);
    return by;
}

static cln_status refuse(int lock, const char *folder, const char *does, const char *instead)
{
    char holder[192];

    read_holder(lock, holder, sizeof holder);
    return cln_fail(CLN_OUTPUT, "%s: %s %s; wait for its end, or stop it%s", folder, holder, does,
                    instead);
}

cln_status cln_held_refuse(const char *folder, const char *does)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    int file = -1;

    CLN_TRY(cln_path_join(&path, folder, "lock"));
    file = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (file >= 0)
        CLN_TRY(refuse(file, folder, does, ""));
done:
    if (file >= 0)
        close(file);
    free(path);
    return st;
}

/* Takes the lock; 0, or errno. Its holder has it alone; a command that only looks who has it
 * (cln_held_by) shares it, and is in the way for a moment. */
static int take_lock(int file)
{
    enum { TRIES = 100 };
    static const struct timespec moment = {.tv_nsec = 5000000};

    for (int i = 1; flock(file, LOCK_EX | LOCK_NB) != 0; i++) {
        const int refused = errno;

        if (refused != EWOULDBLOCK || i == TRIES || flock(file, LOCK_SH | LOCK_NB) != 0)
            return refused;
        (void)flock(file, LOCK_UN);
        (void)nanosleep(&moment, NULL);
    }
    return 0;
}

/* Is the open file the one at this path? Its last holder may have removed it. */
static bool is_there(int file, const char *path)
{
    struct stat ours, there;

    return fstat(file, &ours) == 0 && stat(path, &there) == 0 && ours.st_dev == there.st_dev &&
           ours.st_ino == there.st_ino;
}

cln_status cln_hold(const char *folder, const char *does, const char *instead, int *lock)
{
    cln_status st = CLN_OK;
    char *path = NULL, text[192], holder[192];
    int file = -1, refused = 0;

    *lock = -1;
    CLN_TRY(cln_path_join(&path, folder, "lock"));
    do {
        if (file >= 0)
            close(file);
        file = open(path, O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK, 0666);
        if (file < 0 && errno == ELOOP)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s is a link, not a lock; remove it", path));
        if (file < 0)
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot be written: %s", path, strerror(errno)));
        refused = take_lock(file);
    } while (!refused && !is_there(file, path));
    if (refused == EWOULDBLOCK)
        CLN_TRY(refuse(file, folder, does, instead));
    if (refused)
        cln_warn("%s: cannot be locked: %s; take care that no other process %s", path,
                 strerror(refused), does);
    name_holder(holder, sizeof holder);
    snprintf(text, sizeof text, "%.180s\n", holder);
    if (ftruncate(file, 0) != 0 || pwrite(file, text, strlen(text), 0) < 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot be written: %s", path, strerror(errno)));
    *lock = file;
    file = -1;
done:
    if (file >= 0)
        close(file);
    free(path);
    return st;
}

void cln_hold_release(int lock)
{
    if (lock < 0)
        return;
    (void)!ftruncate(lock, 0); /* what is finished does not tell which process made it */
    close(lock);
}

void cln_hold_remove(const char *folder, int lock)
{
    char *path = NULL;

    if (lock >= 0 && cln_path_join(&path, folder, "lock") == CLN_OK && is_there(lock, path))
        unlink(path);
    free(path);
    cln_hold_release(lock);
}
