/* Room on a disk. See disk.h; leaves nothing behind. */
#include "io/disk.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/progress.h"

enum {
    NAME_WHILE_WRITTEN = 24, /* bytes that base/files.c adds to a file's name */
    NAMES_IN_FOLDER = 256    /* bytes of a path below a folder of results */
};

cln_status cln_disk_nearest(const char *path, char **out)
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

/* Some file systems (/proc) let nobody create a file, though access() says that one may. */
static cln_status try_folder(const char *subject, const char *there)
{
    cln_status st = CLN_OK;
    char *trial = NULL;

    CLN_TRY(cln_path_join(&trial, there, ".cl-nascent-XXXXXX"));
    if (!mkdtemp(trial))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: no file can be created in %s: %s; choose another place",
                         subject, there, strerror(errno)));
    rmdir(trial);
done:
    free(trial);
    return st;
}

/* Bytes of the first characters of a long name, for a message. */
static int beginning_of(const char *name)
{
    int used = 0;

    for (int next = 1; used < 40 && name[used] && next > 0; used += next)
        next = cln_utf8_bytes(name + used);
    return used;
}

/* Checks the lengths of the path and of the names in it. The last one needs room for `suffix` more
 * bytes: of a file's name while it is written, or of names in the folder. */
static cln_status check_lengths(const char *path, const char *there, size_t suffix)
{
    const long name = pathconf(there, _PC_NAME_MAX), whole = pathconf(there, _PC_PATH_MAX);

    for (const char *at = path + strspn(path, "/"); *at && name > 0;) {
        const size_t bytes = strcspn(at, "/"), gap = strspn(at + bytes, "/");
        const size_t most = (size_t)name - (at[bytes + gap] ? 0 : suffix);

        if (bytes > most)
            return cln_fail(CLN_OUTPUT,
                            "%.*s...: this name is too long: it has %zu bytes, and at most %zu "
                            "are possible here; choose a shorter one",
                            beginning_of(at), at, bytes, most);
        at += bytes + gap;
    }
    if (whole > 0 && strlen(path) + NAMES_IN_FOLDER > (size_t)whole)
        return cln_fail(CLN_OUTPUT,
                        "%.*s...: this path is too long: it has %zu bytes, and at most %ld are "
                        "possible here; choose a shorter one",
                        beginning_of(path), path, strlen(path), whole - NAMES_IN_FOLDER);
    return CLN_OK;
}

/* Free bytes; INFINITY where the file system does not tell, as some do. */
static double room_at(const char *there)
{
    struct statvfs disk;

    if (statvfs(there, &disk) != 0 || disk.f_blocks == 0)
        return INFINITY;
    return (double)disk.f_bavail * (double)disk.f_frsize;
}

double cln_disk_room(const char *folder)
{
    char *there = NULL;
    double room = INFINITY;

    if (cln_disk_nearest(folder, &there) == CLN_OK)
        room = room_at(there);
    else
        cln_clear_error();
    free(there);
    return room;
}

/* subject: what is to be written, in `folder` or the folder itself; begins the error sentence. */
static cln_status check(const char *subject, const char *folder, double bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *there = NULL, need[32], have[32];
    double room = 0;

    CLN_TRY(cln_disk_nearest(folder, &there));
    CLN_TRY(check_lengths(subject, there, folder == subject ? 0 : NAME_WHILE_WRITTEN));
    if (!cln_is_dir(there))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s is not a folder; choose another place", subject,
                         strcmp(there, subject) == 0 ? "this" : there));
    if (access(there, W_OK | X_OK) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s cannot be written to: %s; choose another place",
                         subject,
                         strcmp(there, ".") == 0       ? "the current folder"
                         : strcmp(there, subject) == 0 ? "this folder"
                                                       : there,
                         strerror(errno)));
    room = room_at(there);
    if (isinf(room))
        CLN_TRY(try_folder(subject, there));
    if (bytes <= room)
        goto done;
    cln_format_bytes(bytes, need);
    cln_format_bytes(room, have);
    CLN_TRY(cln_fail(CLN_OUTPUT,
                     "%s: the disk has too little room for %s: up to %s, and %s are free; make "
                     "room, or choose another folder",
                     subject, what, need, have));
done:
    free(there);
    return st;
}

cln_status cln_disk_check_size(const char *subject, double bytes, const char *what)
{
    struct rlimit most;
    char need[32], have[32];

    if (getrlimit(RLIMIT_FSIZE, &most) != 0 || most.rlim_cur == RLIM_INFINITY ||
        (double)most.rlim_cur >= bytes)
        return CLN_OK;
    cln_format_bytes(bytes, need);
    cln_format_bytes((double)most.rlim_cur, have);
    return cln_fail(CLN_OUTPUT,
                    "%s: no file may be as large as %s, up to %s: this shell's limit is %s; raise "
                    "it (ulimit -f)",
                    subject, what, need, have);
}

cln_status cln_disk_check(const char *folder, double bytes, const char *what)
{
    return check(folder, folder, bytes, what);
}

/* "a/b": "a"; "/b": "/"; "b": ".". */
static cln_status folder_of(const char *path, char **folder)
{
    cln_status st = CLN_OK;
    const char *slash = strrchr(path, '/');

    if (!slash)
        CLN_TRY(cln_strdup(folder, "."));
    else
        CLN_TRY(cln_asprintf(folder, "%.*s", slash == path ? 1 : (int)(slash - path), path));
done:
    return st;
}

cln_status cln_disk_check_file(const char *path, double bytes, const char *what)
{
    cln_status st = CLN_OK;
    char *folder = NULL;

    CLN_TRY(folder_of(path, &folder));
    CLN_TRY(check(path, folder, bytes, what));
done:
    free(folder);
    return st;
}

cln_status cln_disk_check_new(const char *path, bool replace)
{
    cln_status st = CLN_OK;
    char *folder = NULL;
    struct stat info;
    const bool there = lstat(path, &info) == 0;

    if (there && S_ISLNK(info.st_mode))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: a link, which would be replaced; give the file that it leads to, or "
                         "choose another name",
                         path));
    if (there && !S_ISREG(info.st_mode))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: already exists and is not a plain file; choose another name", path));
    if (there && !replace)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: already exists; choose another name, or give --overwrite",
                         path));
    CLN_TRY(folder_of(path, &folder));
    if (access(folder, F_OK) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: there is no folder %s; make it, or choose another place",
                         path, folder));
    CLN_TRY(check(path, folder, 0, ""));
done:
    free(folder);
    return st;
}
