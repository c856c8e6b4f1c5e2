/* Room on a disk. See disk.h; leaves nothing behind. */
#include "io/disk.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/progress.h"

/* The path itself, or the nearest above it that is there. */
static cln_status nearest(const char *path, char **out)
{
    cln_status st = CLN_OK;
    struct stat info;

    CLN_TRY(cln_strdup(out, *path ? path : "."));
    while (lstat(*out, &info) != 0 && strcmp(*out, ".") != 0 && strcmp(*out, "/") != 0) {
        char *slash = strrchr(*out, '/');

        if (!slash)
            strcpy(*out, ".");
        else
            slash[slash == *out] = 0; /* "/x" is in "/" */
    }
done:
    return st;
}

/* Some file systems let nobody make a folder (/proc), though access() has nothing against it. */
static cln_status try_folder(const char *folder, const char *there)
{
    cln_status st = CLN_OK;
    char *trial = NULL;

    CLN_TRY(cln_path_join(&trial, there, ".cl-nascent-XXXXXX"));
    if (!mkdtemp(trial))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: in %s no folder can be made: %s; choose another", folder,
                         there, strerror(errno)));
    rmdir(trial);
done:
    free(trial);
    return st;
}

cln_status cln_disk_check(const char *folder, double bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *there = NULL, need[32], have[32];
    struct statvfs disk;
    double room = 0;

    CLN_TRY(nearest(folder, &there));
    if (!cln_is_dir(there))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s is not a folder; choose another", folder, there));
    if (access(there, W_OK | X_OK) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s cannot be written to: %s; choose another", folder,
                         strcmp(there, ".") == 0      ? "the folder one is in"
                         : strcmp(there, folder) == 0 ? "this folder"
                                                      : there,
                         strerror(errno)));
    if (statvfs(there, &disk) != 0 || disk.f_blocks == 0) { /* some file systems do not tell */
        CLN_TRY(try_folder(folder, there));
        goto done;
    }
    room = (double)disk.f_bavail * (double)disk.f_frsize;
    if (bytes <= room)
        goto done;
    cln_format_bytes(bytes, need);
    cln_format_bytes(room, have);
    CLN_TRY(cln_fail(CLN_OUTPUT,
                     "%s: the disk has too little room: %s need up to %s, %s are free; make room, "
                     "or choose another folder",
                     folder, what, need, have));
done:
    free(there);
    return st;
}

cln_status cln_disk_check_file(const char *path, double bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *folder = NULL, *slash = NULL;

    CLN_TRY(cln_strdup(&folder, path));
    slash = strrchr(folder, '/');
    if (slash)
        slash[slash == folder] = 0; /* "/x" is in "/" */
    CLN_TRY(cln_disk_check(slash ? folder : ".", bytes, what));
done:
    free(folder);
    return st;
}
