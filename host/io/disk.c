/* Room on a disk. See disk.h; writes nothing. */
#include "io/disk.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/progress.h"

/* The folder itself, or the nearest above it that is there. */
static cln_status nearest_folder(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *slash = NULL;

    CLN_TRY(cln_strdup(out, *path ? path : "."));
    while (!cln_is_dir(*out) && strcmp(*out, ".") != 0 && strcmp(*out, "/") != 0) {
        slash = strrchr(*out, '/');
        if (!slash)
            strcpy(*out, ".");
        else
            slash[slash == *out] = 0; /* "/x" is in "/" */
    }
done:
    return st;
}

cln_status cln_disk_check(const char *path, double bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *folder = NULL, need[32], have[32];
    struct statvfs disk;
    double room = 0;

    CLN_TRY(nearest_folder(path, &folder));
    if (access(folder, W_OK | X_OK) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot write to %s: %s; choose another place with -o",
                         path, folder, strerror(errno)));
    if (statvfs(folder, &disk) != 0) /* some network file systems do not tell */
        goto done;
    room = (double)disk.f_bavail * (double)disk.f_frsize;
    if (bytes <= room)
        goto done;
    cln_format_bytes(bytes, need);
    cln_format_bytes(room, have);
    CLN_TRY(cln_fail(CLN_OUTPUT,
                     "%s: the disk has too little room: %s need up to %s, %s are free; make room, "
                     "or choose another place with -o",
                     path, what, need, have));
done:
    free(folder);
    return st;
}
