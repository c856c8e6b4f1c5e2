/* Support of tests of files: a fresh folder per test (a cmocka fixture), reading and writing whole
 * files, and a log sink that counts warnings. */
#ifndef CLN_TESTS_SCRATCH_H
#define CLN_TESTS_SCRATCH_H

#include <limits.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include "base/files.h"
#include "base/log.h"

/* Paths that scratch_path made; freed by scratch_remove. */
static struct {
    char *path[512];
    int count;
} scratch_paths;

/* cmocka setup and teardown: *state = path of a fresh folder. */
static inline int scratch_make(void **state)
{
    char *path = malloc(PATH_MAX);
    const char *base = getenv("TMPDIR");

    if (!path)
        return -1;
    snprintf(path, PATH_MAX, "%s/cln-test-XXXXXX", base ? base : "/tmp");
    *state = mkdtemp(path);
    cln_clear_error();
    return *state ? 0 : -1;
}

static inline int scratch_remove(void **state)
{
    char command[PATH_MAX + 16];
    int rc = 0;

    snprintf(command, sizeof command, "rm -rf '%s'", (const char *)*state);
    rc = system(command);
    free(*state);
    while (scratch_paths.count > 0)
        free(scratch_paths.path[--scratch_paths.count]);
    cln_clear_error();
    cln_log_set_sink(NULL, NULL);
    return rc;
}

/* "folder/name", valid until the test ends. */
static inline const char *scratch_path(const char *folder, const char *name)
{
    char *path = NULL;

    assert_int_equal(cln_path_join(&path, folder, name), CLN_OK);
    assert_in_range(scratch_paths.count, 0, 511);
    scratch_paths.path[scratch_paths.count++] = path;
    return path;
}

static inline void scratch_put(const char *path, const void *data, size_t bytes)
{
    FILE *f = fopen(path, "wb");

    assert_non_null(f);
    assert_int_equal(fwrite(data, 1, bytes, f), bytes);
    assert_int_equal(fclose(f), 0);
}

static inline char *scratch_get(const char *path, size_t *bytes)
{
    static char *data; /* not automatic: gcc 12 would warn of pointers into it */

    assert_int_equal(cln_read_file(path, (size_t)1 << 30, &data, bytes), CLN_OK);
    return data;
}

/* A log sink: counts warnings into *(int *)user. */
static inline void scratch_count_warnings(cln_log_level level, const char *line, void *user)
{
    (void)line;
    *(int *)user += level == CLN_LOG_WARN;
}

/* Simulates a full disk: no file grows beyond `bytes` (RLIM_INFINITY ends it). */
static inline void scratch_limit_files(rlim_t bytes)
{
    struct rlimit limit = {bytes, RLIM_INFINITY};

    signal(SIGXFSZ, bytes == RLIM_INFINITY ? SIG_DFL : SIG_IGN);
    assert_int_equal(setrlimit(RLIMIT_FSIZE, &limit), 0);
}

#endif
