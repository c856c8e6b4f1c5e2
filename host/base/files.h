/* Files: whole-file reads, atomic writes (temp file in the same folder, fsync, rename), folders,
 * paths, and content digests. Errors name the path and errno's reason. */
#ifndef CLN_FILES_H
#define CLN_FILES_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include "base/status.h"

bool cln_is_file(const char *path);
bool cln_is_dir(const char *path);

/* Has the folder a file, or a folder, of this name? */
bool cln_is_same_file(const char *a, const char *b); /* or folder, by whatever paths */
bool cln_has_file(const char *folder, const char *name);
bool cln_has_dir(const char *folder, const char *name);

/* Does the path begin with a drive of Windows, C:\ or C:/? */
bool cln_is_drive_path(const char *path);

/* Reads a whole file; a zero byte follows its *bytes. CLN_INPUT on failure, also if the file is
 * larger than max_bytes. The caller frees *out. */
cln_status cln_read_file(const char *path, size_t max_bytes, char **out, size_t *bytes);

/* The same of a text. CLN_INPUT, too, if it is UTF-16, as PowerShell and editors of Windows write
 * it. */
cln_status cln_read_text(const char *path, size_t max_bytes, char **out, size_t *bytes);

/* Is it text in UTF-16, by its mark or the zero bytes beside its first letters? */
bool cln_is_utf16(const char *text, size_t bytes);

/* Writes atomically: a reader sees the old file or the new one. CLN_OUTPUT on failure: the old file
 * stays, the temp file is removed. */
cln_status cln_write_file(const char *path, const void *data, size_t bytes);

/* The same for large or streamed files: open a temp file beside path, write, then commit (flush,
 * fsync, rename, fsync of the folder) or abandon. Both free it. Commit sets *file to NULL, also
 * when it fails, so that a function may abandon it at its end in any case. */
typedef struct cln_atomic_file cln_atomic_file;
cln_status cln_atomic_open(const char *path, cln_atomic_file **out);
FILE *cln_atomic_stream(cln_atomic_file *file);
const char *cln_atomic_temp(const cln_atomic_file *file); /* its path until the commit */
cln_status cln_atomic_write(cln_atomic_file *file, const void *data, size_t bytes);
cln_status cln_atomic_commit(cln_atomic_file **file);
/* Files that belong together: all are flushed and synced before the first is renamed, in this
 * order. */
cln_status cln_atomic_commit_all(cln_atomic_file **const files[], int count);
void cln_atomic_abandon(cln_atomic_file *file); /* accepts NULL */

/* Copies a file, atomically. CLN_OUTPUT. */
cln_status cln_copy_file(const char *from, const char *to);

/* Makes `to`, which is not there yet, another name of the file `from` (of what a symbolic link
 * leads to), or, on a file system without such names, a copy. CLN_OUTPUT. */
cln_status cln_link_or_copy(const char *from, const char *to);

/* Turns backslashes of a path that was written on Windows into slashes; false if it has none. */
bool cln_turn_slashes(char *path);

/* mkdir -p. CLN_OUTPUT on failure. */
cln_status cln_make_dirs(const char *path);

/* *out = "dir/name" ("name" if dir is empty or name is absolute). */
cln_status cln_path_join(char **out, const char *dir, const char *name);

/* *out = the path from the root, without links; CLN_INPUT if nothing is there. */
cln_status cln_path_absolute(char **out, const char *path);

/* *out = the path of `to` relative to the folder `from`, both as cln_path_absolute makes them. */
cln_status cln_path_relative(char **out, const char *from, const char *to);

/* 64-bit content digest (FNV-1a over 8-byte words with a final mix; not cryptographic): start with
 * CLN_DIGEST_START and add pieces in order. */
#define CLN_DIGEST_START 0xcbf29ce484222325ull
uint64_t cln_digest(uint64_t digest, const void *data, size_t bytes);

/* The same digest for data that come in pieces. Another process may continue with the struct. */
typedef struct cln_digest_part {
    uint64_t digest, word, bytes; /* word: the last bytes % 8 bytes, not in the digest yet */
} cln_digest_part;
void cln_digest_begin(cln_digest_part *part, uint64_t digest);
void cln_digest_more(cln_digest_part *part, const void *data, size_t bytes);
uint64_t cln_digest_end(const cln_digest_part *part);

/* A digest as texts have it: 16 hexadecimal digits. */
enum { CLN_DIGEST_TEXT = 17 };
void cln_digest_text(uint64_t digest, char out[CLN_DIGEST_TEXT]);

#endif
