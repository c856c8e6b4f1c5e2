/* See cache.h. The folder's name is found as PoCL finds it; programs are in sub-folders of it that
 * are named by two letters, A to P, of a digest. */
#include "device/cache.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/file.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/files.h"
#include "base/log.h"
#include "io/disk.h"
#include "io/progress.h"

/* A training with its self-test fills 4.5 MB; sources of one program on their way take up to 1. */
static const double COLD = 16 << 20, LEAST = 2 << 20;
static const double LARGEST = 1 << 20; /* file of a kernel */
enum { LETTERS = 16, FOLDERS = LETTERS * LETTERS };

static bool is_pocl(const char *platform)
{
    return strstr(platform, "Portable Computing Language") != NULL;
}

/* PoCL's own paths are no longer. */
enum { PATH = 1024 };

static bool is_by_xdg(void)
{
    const char *cache = getenv("XDG_CACHE_HOME");

    return !getenv("POCL_CACHE_DIR") && cache && *cache;
}

/* Behind the folder's name: the variable that it comes from, where the way out is another one. */
static const char *source(void)
{
    return is_by_xdg() ? " (by XDG_CACHE_HOME)" : "";
}

/* By the user, or in the user's home: not a folder that all accounts have. */
static bool is_chosen(void)
{
    return getenv("POCL_CACHE_DIR") || is_by_xdg() || getenv("HOME");
}

/* PoCL keeps nothing for other processes. */
static bool is_off(void)
{
    const char *keeps = getenv("POCL_KERNEL_CACHE");

    return keeps && (*keeps == '0' || strcasecmp(keeps, "false") == 0);
}

static void find(char out[PATH])
{
    const char *own = getenv("POCL_CACHE_DIR"), *cache = getenv("XDG_CACHE_HOME");
    const char *home = getenv("HOME");
    const char *name = is_off() ? "pocl/uncached" : "pocl/kcache";

    if (own)
        snprintf(out, PATH, "%s", own);
    else if (is_by_xdg())
        snprintf(out, PATH, "%s/%s", cache, name);
    else if (home)
        snprintf(out, PATH, "%s/.cache/%s", home, name);
    else
        snprintf(out, PATH, "/tmp/%s", name);
}

/* out = sub-folder number i, which need not be there. */
static void folder(const char *cache, int i, char out[PATH + 4])
{
    snprintf(out, PATH + 4, "%s/%c%c", cache, 'A' + i / LETTERS, 'A' + i % LETTERS);
}

/* Creates a file of so many bytes and removes it. *reason: of errno, 0 if that went well. A quota
 * is not in what the file system says of its room. */
static cln_status try_file(const char *where, double bytes, int *reason)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    struct rlimit most = {.rlim_cur = RLIM_INFINITY};
    int fd = -1, failed = 0;

    CLN_TRY(cln_path_join(&path, where, ".cl-nascent-XXXXXX"));
    fd = mkstemp(path);
    *reason = fd < 0 ? errno : 0;
    (void)getrlimit(RLIMIT_FSIZE, &most);
    if (fd >= 0 && bytes > 0 && (double)most.rlim_cur > bytes) /* else a signal would end us */
        failed = posix_fallocate(fd, 0, (off_t)bytes);
    if (failed == ENOSPC || failed == EDQUOT)
        *reason = failed;
    if (fd >= 0) {
        close(fd);
        unlink(path);
    }
done:
    free(path);
    return st;
}

/* Finds a folder in the cache that this account cannot write to; foreign: only if it is another's.
 * *found: whether there is one; out: its path. */
static cln_status find_closed(const char *cache, bool foreign, char out[PATH + 4],
                              struct stat *info, bool *found)
{
    cln_status st = CLN_OK;
    int reason = 0;

    *found = false;
    for (int i = 0; i < FOLDERS && !*found; i++) {
        folder(cache, i, out);
        if (lstat(out, info) != 0 || !S_ISDIR(info->st_mode) ||
            (foreign && info->st_uid == geteuid()))
            continue;
        CLN_TRY(try_file(out, 0, &reason));
        *found = reason != 0 && reason != ENOSPC && reason != EDQUOT;
    }
done:
    return st;
}

/* Finds a folder of the cache, or the one that it is in, to which another account than this one and
 * root can write: kernels are programs, so what that account puts there runs as this one. Other
 * members of a group are trusted, as many systems give each account a group of its own. */
static bool find_open(const char *cache, char out[PATH + 4])
{
    for (int i = -2; i < FOLDERS; i++) {
        struct stat info;
        bool sticky = false;

        if (i >= 0)
            folder(cache, i, out);
        else
            snprintf(out, PATH + 4, "%s", cache);
        if (i == -2 && strrchr(out, '/') > out)
            *strrchr(out, '/') = 0;
        if (stat(out, &info) != 0 || !S_ISDIR(info.st_mode))
            continue;
        sticky = i == -2 && info.st_mode & S_ISVTX; /* others cannot put one in its place */
        if ((info.st_uid != geteuid() && info.st_uid != 0) || (info.st_mode & S_IWOTH && !sticky))
            return true;
    }
    return false;
}

bool cln_cache_keeps(const char *platform)
{
    return is_pocl(platform) && !is_off();
}

static bool is_cold(const char *cache)
{
    struct stat info;
    char path[PATH + 4];
    bool cold = true;

    for (int i = 0; i < FOLDERS && cold; i++) {
        folder(cache, i, path);
        cold = lstat(path, &info) != 0;
    }
    return cold;
}

static const char way_out[] = "make room there, or set POCL_CACHE_DIR to a folder with room";

static cln_status no_room(const char *cache, double need)
{
    const double room = cln_disk_room(cache);
    char have[32], most[32];

    cln_format_bytes(room, have);
    cln_format_bytes(need, most);
    if (room >= need)
        return cln_fail(
            CLN_OUTPUT,
            "PoCL's kernel cache %s%s has too little room: a quota leaves less than the "
            "%s that may be needed; %s",
            cache, source(), most, way_out);
    return cln_fail(CLN_OUTPUT,
                    "PoCL's kernel cache %s%s has too little room: %s are free, and up to %s are "
                    "needed; %s",
                    cache, source(), have, most, way_out);
}

static cln_status closed(const char *cache, int reason)
{
    return cln_fail(CLN_OUTPUT,
                    "PoCL's kernel cache %s%s cannot be written by this account: %s; set "
                    "POCL_CACHE_DIR to a folder of your own, as each account needs one",
                    cache, source(), strerror(reason));
}

/* ulimit -f: a driver that may not write a kernel ends the process, or calls it broken. */
static cln_status check_file_size(const char *cache)
{
    char subject[PATH + 128];

    snprintf(subject, sizeof subject, "PoCL's kernel cache %s%s", cache, source());
    return cln_disk_check_size(subject, LARGEST, "a kernel");
}

/* Writing: whether the folder itself takes a file of `need` bytes. */
static cln_status check_writing(const char *cache, double need)
{
    cln_status st = CLN_OK;
    struct statvfs disk;
    char *there = NULL;
    int reason = 0;

    CLN_TRY(check_file_size(cache));
    CLN_TRY(cln_disk_nearest(cache, &there)); /* PoCL makes the folder */
    if (cln_disk_room(there) < need)
        CLN_TRY(no_room(cache, need));
    CLN_TRY(try_file(there, need, &reason));
    if (reason == ENOSPC || reason == EDQUOT)
        CLN_TRY(no_room(cache, need));
    if (reason != 0)
        CLN_TRY(closed(cache, reason));
    if (statvfs(there, &disk) == 0 && disk.f_flag & ST_NOEXEC)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "PoCL's kernel cache %s%s is on a file system that runs no programs "
                         "(noexec), and kernels are programs; set POCL_CACHE_DIR to a folder on "
                         "another one",
                         cache, source()));
done:
    free(there);
    return st;
}

cln_status cln_cache_check(const char *platform)
{
    cln_status st = CLN_OK;
    char cache[PATH], path[PATH + 4];

    if (!is_pocl(platform))
        return CLN_OK;
    find(cache);
    if (!is_chosen() && find_open(cache, path))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "PoCL's kernel cache is %s, as HOME is not set, and another account can "
                         "write to %s: kernels are programs, and those that it puts there would "
                         "run as this account; set POCL_CACHE_DIR to a folder of your own",
                         cache, path));
    CLN_TRY(check_writing(cache, is_cold(cache) ? COLD : LEAST));
done:
    return st;
}

static cln_status warn(const char *cache)
{
    cln_status st = CLN_OK;
    char path[PATH + 4], have[32], most[32];
    struct stat info;
    bool found = false;

    if (cln_disk_room(cache) < COLD) {
        cln_format_bytes(cln_disk_room(cache), have);
        cln_format_bytes(COLD, most);
        cln_warn("PoCL's kernel cache %s%s has %s free; kernels that are not in it yet may need up "
                 "to %s: %s",
                 cache, source(), have, most, way_out);
    }
    CLN_TRY(find_closed(cache, true, path, &info, &found));
    if (found)
        cln_warn("PoCL's kernel cache has folders of another account: this one cannot write to %s "
                 "(of user %u), and kernels that belong there cannot be built; set POCL_CACHE_DIR "
                 "to a folder of your own, as each account needs one",
                 path, (unsigned)info.st_uid);
    else if (find_open(cache, path))
        cln_warn("another account can write to %s, of PoCL's kernel cache: kernels are programs, "
                 "and those that it puts there run as this account; set POCL_CACHE_DIR to a "
                 "folder of your own unless you trust it",
                 path);
done:
    return st;
}

cln_status cln_cache_ready(const char *platform, bool *ready)
{
    cln_status st = CLN_OK;
    char cache[PATH];

    if (!is_pocl(platform))
        return CLN_OK;
    find(cache);
    if (*ready && cln_disk_room(cache) < LEAST)
        CLN_TRY(no_room(cache, LEAST));
    if (!*ready) {
        CLN_TRY(cln_cache_check(platform));
        CLN_TRY(warn(cache));
    }
    *ready = true;
done:
    return st;
}

/* ---- turns ---- */

/* Waits while another process has its turn. A stopped one would keep us for ever. */
static cln_status wait_for_turn(const char *cache, int lock, const cln_callbacks *callbacks,
                                double *waited)
{
    static const double PATIENCE = 600; /* seconds; on a busy machine all takes four minutes */
    static const struct timespec moment = {.tv_nsec = 50000000};
    cln_status st = CLN_OK;
    const double began = cln_now();

    cln_info("another process is building kernels in %s; waiting for it, to have them from there",
             cache);
    while (flock(lock, LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK) {
        CLN_TRY(cln_stopped_by(cln_poll_signal(callbacks), NULL));
        *waited = cln_now() - began;
        if (*waited > PATIENCE) {
            cln_info("it still is, after %.0f minutes: going on without it", PATIENCE / 60);
            break;
        }
        (void)nanosleep(&moment, NULL);
    }
done:
    return st;
}

cln_status cln_cache_take_turn(const char *platform, bool compiled, const cln_callbacks *callbacks,
                               cln_cache_turn *turn)
{
    cln_status st = CLN_OK;
    char cache[PATH], *path = NULL;
    int lock = -1;

    if (!turn->due || !is_pocl(platform) || is_off())
        return CLN_OK;
    find(cache);
    if (!compiled && !is_cold(cache))
        return CLN_OK;
    turn->due = false;
    CLN_TRY(cln_path_join(&path, cache, "cl-nascent.lock"));
    if (cln_make_dirs(cache) == CLN_OK)
        lock = open(path, O_RDWR | O_CREAT | O_CLOEXEC, 0666);
    cln_clear_error();
    if (lock >= 0 && flock(lock, LOCK_EX | LOCK_NB) == 0) {
        turn->held = true;
        turn->lock = lock;
        lock = -1;
    } else if (lock >= 0 && errno == EWOULDBLOCK) {
        CLN_TRY(wait_for_turn(cache, lock, callbacks, &turn->waited));
    }
done:
    if (lock >= 0)
        close(lock);
    free(path);
    return st;
}

void cln_cache_end_turn(cln_cache_turn *turn)
{
    if (turn->held)
        close(turn->lock);
    *turn = (cln_cache_turn){0};
}

/* ---- what is wrong with it ---- */

cln_status cln_cache_blame(const char *platform, bool by_folders)
{
    cln_status st = CLN_OK;
    char cache[PATH], path[PATH + 4];
    struct stat info;
    bool found = false;

    if (!is_pocl(platform))
        return CLN_OK;
    find(cache);
    CLN_TRY(check_writing(cache, LEAST));
    if (!by_folders)
        goto done;
    CLN_TRY(find_closed(cache, false, path, &info, &found));
    if (found)
        CLN_TRY(
            cln_fail(CLN_OUTPUT,
                     "PoCL's kernel cache %s%s cannot be written by this account: its folder %s "
                     "belongs to user %u; set POCL_CACHE_DIR to a folder of your own, as each "
                     "account needs one",
                     cache, source(), path + strlen(cache) + 1, (unsigned)info.st_uid));
done:
    return st;
}

void cln_cache_doubt(char **out)
{
    char cache[PATH];

    *out = NULL;
    find(cache);
    if (check_writing(cache, 0) == CLN_OUTPUT)
        *out = strdup(cln_error_text());
    cln_clear_error();
}

bool cln_cache_last_words(char *out, size_t bytes)
{
    struct statvfs disk;
    char cache[PATH];

    find(cache);
    if (statvfs(cache, &disk) != 0 || disk.f_blocks == 0 ||
        (double)disk.f_bavail * (double)disk.f_frsize >= 2 * LEAST)
        return false;
    snprintf(out, bytes, "PoCL's kernel cache %s%s has no room left; %s", cache, source(), way_out);
    return true;
}
