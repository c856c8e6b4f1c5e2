/* Files, folders, paths and content digests. See files.h for the contracts.
 *
 * An atomic write goes to "PATH.tmp.PID.N" beside PATH (the same file system, so that rename is
 * atomic), is flushed to the disk, and only then takes PATH's name:
 *   open temp -> write -> fflush, fsync -> rename -> fsync the folder
 * A failure before the rename leaves PATH as it was. Not for appending. */
#include "base/files.h"

#include <ctype.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include "base/memory.h"

struct cln_atomic_file {
    char *path, *temp;
    FILE *stream;
};

bool cln_is_file(const char *path)
{
    struct stat info;

    return path && stat(path, &info) == 0 && S_ISREG(info.st_mode);
}

bool cln_is_dir(const char *path)
{
    struct stat info;

    return path && stat(path, &info) == 0 && S_ISDIR(info.st_mode);
}

static bool holds(const char *folder, const char *name, bool (*is_kind)(const char *path))
{
    char *path = NULL;
    const bool has = cln_path_join(&path, folder, name) == CLN_OK && is_kind(path);

    free(path);
    return has;
}

bool cln_is_same_file(const char *a, const char *b)
{
    struct stat x, y;

    return stat(a, &x) == 0 && stat(b, &y) == 0 && x.st_dev == y.st_dev && x.st_ino == y.st_ino;
}

bool cln_has_file(const char *folder, const char *name)
{
    return holds(folder, name, cln_is_file);
}

bool cln_has_dir(const char *folder, const char *name)
{
    return holds(folder, name, cln_is_dir);
}

cln_status cln_read_file(const char *path, size_t max_bytes, char **out, size_t *bytes)
{
    cln_status st = CLN_OK;
    int fd = -1;
    char *data = NULL;
    size_t size = 0, used = 0;
    struct stat info;

    *out = NULL;
    *bytes = 0;
    /* O_NONBLOCK: a FIFO of that name must not block the program before fstat refuses it. */
    fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0 || fstat(fd, &info) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path, strerror(errno)));
    if (!S_ISREG(info.st_mode))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path,
                         S_ISDIR(info.st_mode) ? "is a folder, not a file" : "not a regular file"));
    if ((uintmax_t)info.st_size > max_bytes)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: %jd bytes, more than the %zu that are accepted here", path,
                         (intmax_t)info.st_size, max_bytes));
    size = (size_t)info.st_size;
    CLN_TRY(cln_alloc(&data, size + 1, 1, path));
    while (used < size) {
        ssize_t got = read(fd, data + used, size - used);

        if (got < 0 && errno == EINTR)
            continue;
        if (got < 0)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path, strerror(errno)));
        if (got == 0) /* shrunk since fstat */
            break;
        used += (size_t)got;
    }
    data[used] = 0;
    *out = data;
    *bytes = used;
    data = NULL;
done:
    free(data);
    if (fd >= 0)
        close(fd);
    return st;
}

static void free_atomic(cln_atomic_file *file)
{
    if (file->stream)
        fclose(file->stream);
    free(file->path);
    free(file->temp);
    free(file);
}

cln_status cln_atomic_open(const char *path, cln_atomic_file **out)
{
    static atomic_uint counter;
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    int fd = -1;

    *out = NULL;
    CLN_TRY(cln_alloc(&file, 1, sizeof *file, path));
    CLN_TRY(cln_strdup(&file->path, path));
    /* A few tries: a killed process with our id may have left its temp file behind. */
    for (int attempt = 0; attempt < 100 && fd < 0; attempt++) {
        free(file->temp);
        file->temp = NULL;
        CLN_TRY(cln_asprintf(&file->temp, "%s.tmp.%ld.%u", path, (long)getpid(),
                             atomic_fetch_add(&counter, 1)));
        fd = open(file->temp, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
        if (fd < 0 && errno != EEXIST)
            break;
    }
    if (fd < 0 || !(file->stream = fdopen(fd, "wb"))) {
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot create a file there: %s", path, strerror(errno)));
    }
    *out = file;
    file = NULL;
done:
    if (file) {
        if (fd >= 0 && !file->stream)
            close(fd);
        if (fd >= 0)
            unlink(file->temp);
        free_atomic(file);
    }
    return st;
}

FILE *cln_atomic_stream(cln_atomic_file *file)
{
    return file->stream;
}

const char *cln_atomic_temp(const cln_atomic_file *file)
{
    return file->temp;
}

static cln_status cannot_write(const cln_atomic_file *file, const char *reason)
{
    return cln_fail(CLN_OUTPUT, "%s: cannot write: %s; make room or choose another folder",
                    file->path, reason);
}

cln_status cln_atomic_write(cln_atomic_file *file, const void *data, size_t bytes)
{
    if (bytes && fwrite(data, 1, bytes, file->stream) != bytes)
        return cannot_write(file, strerror(errno));
    return CLN_OK;
}

/* The rename survives a power cut only if the folder is synced too. A folder that cannot be opened
 * or synced (some network file systems) is no error: the file is complete either way. */
static void sync_folder_of(const char *path)
{
    const char *slash = strrchr(path, '/');
    size_t length = slash ? (size_t)(slash - path) : 0;
    char *folder = slash ? strndup(path, length ? length : 1) : strdup(".");
    int fd = folder ? open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC) : -1;

    if (fd >= 0) {
        (void)!fsync(fd);
        close(fd);
    }
    free(folder);
}

static const double LITTLE_ROOM = 65536; /* bytes: what a stream gathers before it writes */

/* Why a write failed before, of which the stream does not keep the reason. */
static const char *why_failed(FILE *stream)
{
    struct statvfs disk;

    if (fstatvfs(fileno(stream), &disk) == 0 &&
        (double)disk.f_bavail * (double)disk.f_frsize < LITTLE_ROOM)
        return strerror(ENOSPC);
    return "a write failed before";
}

/* What is written is on the disk then, under the temp file's name. */
static cln_status finish(cln_atomic_file *file)
{
    cln_status st = CLN_OK;
    int failed = 0;

    if (ferror(file->stream))
        CLN_TRY(cannot_write(file, why_failed(file->stream)));
    if (fflush(file->stream) != 0 || fsync(fileno(file->stream)) != 0)
        CLN_TRY(cannot_write(file, strerror(errno)));
    failed = fclose(file->stream);
    file->stream = NULL;
    if (failed)
        CLN_TRY(cannot_write(file, strerror(errno)));
done:
    return st;
}

cln_status cln_atomic_commit_all(cln_atomic_file **const files[], int count)
{
    cln_status st = CLN_OK;

    for (int i = 0; i < count; i++)
        CLN_TRY(finish(*files[i]));
    for (int i = 0; i < count; i++) {
        cln_atomic_file *file = *files[i];

        if (rename(file->temp, file->path) != 0)
            CLN_TRY(cannot_write(file, strerror(errno)));
        sync_folder_of(file->path);
        free_atomic(file);
        *files[i] = NULL;
    }
done:
    for (int i = 0; i < count; i++) {
        cln_atomic_abandon(*files[i]);
        *files[i] = NULL;
    }
    return st;
}

cln_status cln_atomic_commit(cln_atomic_file **file)
{
    return cln_atomic_commit_all(&file, 1);
}

void cln_atomic_abandon(cln_atomic_file *file)
{
    if (!file)
        return;
    unlink(file->temp);
    free_atomic(file);
}

bool cln_is_drive_path(const char *path)
{
    return isalpha((unsigned char)path[0]) && path[1] == ':' && (path[2] == '\\' || path[2] == '/');
}

bool cln_is_utf16(const char *text, size_t bytes)
{
    const bool marked =
        bytes >= 2 && (memcmp(text, "\xFF\xFE", 2) == 0 || memcmp(text, "\xFE\xFF", 2) == 0);

    return marked || (bytes >= 4 && ((text[0] && !text[1] && text[2] && !text[3]) ||
                                     (!text[0] && text[1] && !text[2] && text[3])));
}

cln_status cln_read_text(const char *path, size_t max_bytes, char **out, size_t *bytes)
{
    cln_status st = cln_read_file(path, max_bytes, out, bytes);

    if (st != CLN_OK || !cln_is_utf16(*out, *bytes))
        return st;
    free(*out);
    *out = NULL;
    *bytes = 0;
    return cln_fail(CLN_INPUT, "%s: is UTF-16; save it as UTF-8", path);
}

cln_status cln_write_file(const char *path, const void *data, size_t bytes)
{
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;

    CLN_TRY(cln_atomic_open(path, &file));
    CLN_TRY(cln_atomic_write(file, data, bytes));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    return st;
}

bool cln_turn_slashes(char *path)
{
    const bool any = strchr(path, '\\') != NULL;

    for (char *p = path; *p; p++)
        if (*p == '\\')
            *p = '/';
    return any;
}

cln_status cln_make_dirs(const char *path)
{
    cln_status st = CLN_OK;
    char *part = NULL;

    if (!*path)
        CLN_TRY(cln_fail(CLN_OUTPUT, "cannot create a folder without a name"));
    CLN_TRY(cln_strdup(&part, path));
    for (char *p = part + 1;; p++) {
        char kept = *p;

        if (kept != '/' && kept)
            continue;
        *p = 0;
        if (mkdir(part, 0777) != 0) {
            int reason = errno;

            if (!cln_is_dir(part))
                CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot create this folder: %s", part,
                                 strerror(reason)));
        }
        *p = kept;
        if (!kept)
            break;
    }
done:
    free(part);
    return st;
}

cln_status cln_path_join(char **out, const char *dir, const char *name)
{
    size_t length = strlen(dir);

    if (!length || name[0] == '/')
        return cln_strdup(out, name);
    return cln_asprintf(out, "%s%s%s", dir, dir[length - 1] == '/' ? "" : "/", name);
}

cln_status cln_path_absolute(char **out, const char *path)
{
    *out = realpath(path, NULL);
    return *out ? CLN_OK : cln_fail(CLN_INPUT, "%s: %s", path, strerror(errno));
}

cln_status cln_path_relative(char **out, const char *from, const char *to)
{
    cln_status st = CLN_OK;
    char *up = NULL;
    size_t shared = 0, i = 0;

    for (;; i++) { /* counts whole names with which both paths begin */
        const bool ends = (from[i] == '/' || !from[i]) && (to[i] == '/' || !to[i]);

        if (ends && i > 0)
            shared = i;
        if (from[i] != to[i] || !from[i])
            break;
    }
    CLN_TRY(cln_strdup(&up, ""));
    for (const char *p = from + shared; *p; p++)
        if (*p == '/' && p[1])
            CLN_TRY(cln_append(&up, "../"));
    to += shared + (to[shared] == '/');
    CLN_TRY(*up || *to ? cln_asprintf(out, "%s%s", up, to) : cln_strdup(out, "."));
done:
    free(up);
    return st;
}

static const uint64_t prime = 0x100000001b3ull;

/* One more word. FNV over words mixes upwards only, hence the shift. */
static uint64_t mix(uint64_t digest, uint64_t word)
{
    digest = (digest ^ word) * prime;
    return digest ^ digest >> 32;
}

void cln_digest_begin(cln_digest_part *d, uint64_t digest)
{
    *d = (cln_digest_part){.digest = digest};
}

void cln_digest_more(cln_digest_part *d, const void *data, size_t bytes)
{
    const unsigned char *p = data;
    uint64_t digest = d->digest, word = d->word;
    size_t i = 0;

    for (; i < bytes && d->bytes % 8; i++) { /* completes a word that an earlier piece began */
        word |= (uint64_t)p[i] << 8 * (d->bytes++ % 8);
        if (d->bytes % 8 == 0) {
            digest = mix(digest, word);
            word = 0;
        }
    }
    d->bytes += bytes - i;
    for (; i + 8 <= bytes; i += 8) {
        word = 0;
        for (size_t k = 0; k < 8; k++) /* little endian on any host; compiles to one load */
            word |= (uint64_t)p[i + k] << 8 * k;
        digest = mix(digest, word);
        word = 0;
    }
    for (size_t k = 0; i + k < bytes; k++)
        word |= (uint64_t)p[i + k] << 8 * k;
    d->digest = digest;
    d->word = word;
}

uint64_t cln_digest_end(const cln_digest_part *d)
{
    uint64_t digest = (d->digest ^ d->word) * prime;

    /* The length keeps "ab" + "" apart from "a" + "b", and zero bytes apart from none. */
    digest = (digest ^ d->bytes) * prime;
    digest ^= digest >> 33;
    digest *= 0xff51afd7ed558ccdull;
    digest ^= digest >> 33;
    digest *= 0xc4ceb9fe1a85ec53ull;
    digest ^= digest >> 33;
    return digest;
}

uint64_t cln_digest(uint64_t digest, const void *data, size_t bytes)
{
    cln_digest_part d;

    cln_digest_begin(&d, digest);
    cln_digest_more(&d, data, bytes);
    return cln_digest_end(&d);
}

void cln_digest_text(uint64_t digest, char out[CLN_DIGEST_TEXT])
{
    snprintf(out, CLN_DIGEST_TEXT, "%016" PRIx64, digest);
}

cln_status cln_copy_file(const char *from, const char *to)
{
    enum { PIECE = 1 << 20 };
    cln_status st = CLN_OK;
    cln_atomic_file *file = NULL;
    FILE *in = NULL;
    char *piece = NULL;
    size_t got = 0;

    CLN_TRY(cln_alloc(&piece, PIECE, 1, to));
    in = fopen(from, "rb");
    if (!in)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot be copied: %s", from, strerror(errno)));
    CLN_TRY(cln_atomic_open(to, &file));
    while ((got = fread(piece, 1, PIECE, in)) > 0)
        CLN_TRY(cln_atomic_write(file, piece, got));
    if (ferror(in))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: cannot be copied: %s", from, strerror(errno)));
    CLN_TRY(cln_atomic_commit(&file));
done:
    cln_atomic_abandon(file);
    if (in)
        fclose(in);
    free(piece);
    return st;
}

cln_status cln_link_or_copy(const char *from, const char *to)
{
    if (linkat(AT_FDCWD, from, AT_FDCWD, to, AT_SYMLINK_FOLLOW) == 0)
        return CLN_OK;
    return cln_copy_file(from, to);
}
