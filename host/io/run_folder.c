/* The run folder: which one may be written to, run.json, other JSON documents, rows of
 * metrics.jsonl. See run_folder.h; checkpoints are model/checkpoint.c's. */
#include "io/run_folder.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/number.h"
#include "base/text.h"
#include "io/disk.h"
#include "io/hold.h"

#define SCHEMA "cl-nascent.run/1"
static const char trains[] = "trains this run"; /* what its holder does */
enum { TEXT_FLAGS = JSON_REAL_PRECISION(17), METRICS_MAX_GIB = 4 };

struct cln_metrics {
    char *path;
    int fd;
};

/* The lock, and a temporary file of a first run.json that was never finished, do not count. */
static cln_status folder_is_empty(const char *path, bool *empty)
{
    DIR *dir = opendir(path);

    if (!dir)
        return cln_fail(CLN_OUTPUT, "%s: cannot look into this folder: %s", path, strerror(errno));
    *empty = true;
    for (struct dirent *e = readdir(dir); e; e = readdir(dir))
        if (strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0 &&
            strcmp(e->d_name, "lock") != 0 && strncmp(e->d_name, "run.json.tmp.", 13) != 0)
            *empty = false;
    closedir(dir);
    return CLN_OK;
}

static cln_status check_writable(const char *run, bool resume)
{
    if (access(run, W_OK | X_OK) != 0)
        return cln_fail(CLN_OUTPUT, "%s: cannot write to this folder: %s; %s", run, strerror(errno),
                        resume ? "copy the run to a folder that can be written to"
                               : "choose another with -o");
    return CLN_OK;
}

cln_status cln_run_check(const char *run, bool resume, bool *empty)
{
    char quoted[CLN_QUOTED_BYTES];
    cln_status st = CLN_OK;
    char *path = NULL, *reason = NULL;
    json_t *document = NULL;
    struct stat info;

    *empty = true;
    if (lstat(run, &info) == 0 && !cln_is_dir(run))
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: is not a folder; choose another with -o", run));
    if (cln_is_dir(run))
        CLN_TRY(folder_is_empty(run, empty));
    if (*empty) {
        if (resume)
            CLN_TRY(cln_fail(CLN_INPUT, "%s: no run there to resume; train one with -o %s", run,
                             cln_shell_quote(run, quoted, sizeof quoted)));
        CLN_TRY(cln_disk_check(run, 0, ""));
        goto done;
    }
    CLN_TRY(cln_path_join(&path, run, "run.json"));
    if (!cln_is_file(path))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: holds other files (there is no run.json), so nothing is written to "
                         "it; choose a new folder",
                         run));
    if (cln_run_read(run, &document) != CLN_OK) {
        CLN_TRY(cln_strdup(&reason, cln_error_text()));
        cln_clear_error();
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: nothing is written to it: %s; choose a new folder", run,
                         reason));
    }
    free(path);
    path = NULL;
    CLN_TRY(cln_path_join(&path, run, "checkpoint"));
    if (!resume && (cln_run_is_held(run) || cln_held_by(run) == CLN_HOLDER_US))
        CLN_TRY(cln_held_refuse(run, trains));
    if (!resume && !cln_is_dir(path))
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: holds a run that ended before its first checkpoint, so nothing of "
                         "it can be used; remove the folder, or choose a new one%s",
                         run,
                         cln_held_by(run) == CLN_HOLDER_UNKNOWN
                             ? " (if no process trains it still, which its file system cannot tell)"
                             : ""));
    if (!resume)
        CLN_TRY(cln_fail(CLN_OUTPUT,
                         "%s: already holds a run; continue it with --resume %s, or choose a new "
                         "folder",
                         run, cln_shell_quote(run, quoted, sizeof quoted)));
    CLN_TRY(check_writable(run, true));
done:
    json_decref(document);
    free(reason);
    free(path);
    return st;
}

cln_status cln_run_open(const char *run, bool resume)
{
    cln_status st = CLN_OK;
    bool empty = false;

    CLN_TRY(cln_run_check(run, resume, &empty));
    if (empty) {
        CLN_TRY(cln_make_dirs(run));
        CLN_TRY(check_writable(run, resume));
    }
done:
    return st;
}

const char *cln_run_state(const char *run, const json_t *document)
{
    const char *state = json_string_value(json_object_get(document, "state"));

    if (!state || strcmp(state, "running") != 0)
        return state ? state : "";
    /* without a lock, of an older program or left out of a copy, nobody knows */
    return cln_held_by(run) == CLN_HOLDER_NONE ? "broken off" : state;
}

bool cln_run_is_held(const char *run)
{
    return cln_held_by(run) == CLN_HOLDER_ANOTHER;
}

/* Training appends to, replaces and removes these: not what lies elsewhere, as of a run that was
 * made of links to another. */
static cln_status refuse_links(const char *run)
{
    static const char *const names[] = {"metrics.jsonl", "checkpoint", "eval", "at"};
    cln_status st = CLN_OK;
    struct stat info;
    char *path = NULL;

    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        free(path);
        path = NULL;
        CLN_TRY(cln_path_join(&path, run, names[i]));
        if (lstat(path, &info) == 0 && S_ISLNK(info.st_mode))
            CLN_TRY(cln_fail(CLN_OUTPUT,
                             "%s is a link, and training would change what it leads to; put a copy "
                             "in its place, or link the whole run",
                             path));
    }
done:
    free(path);
    return st;
}

cln_status cln_run_hold(const char *run, int *lock)
{
    cln_status st = CLN_OK;

    *lock = -1;
    CLN_TRY(refuse_links(run));
    CLN_TRY(cln_hold(run, trains, "", lock));
done:
    return st;
}

void cln_run_release(int lock)
{
    cln_hold_release(lock);
}

cln_status cln_run_write_json(const char *run, const char *name, const json_t *document)
{
    cln_status st = CLN_OK;
    char *path = NULL, *folder = NULL, *text = NULL, *slash = NULL;
    size_t length = 0;

    CLN_TRY(cln_path_join(&path, run, name));
    CLN_TRY(cln_strdup(&folder, path));
    slash = strrchr(folder, '/');
    if (slash && slash != folder) {
        *slash = 0;
        CLN_TRY(cln_make_dirs(folder));
    }
    text = json_dumps(document, JSON_INDENT(2) | TEXT_FLAGS);
    if (!text) /* documents hold what JSON can, so nothing else can fail */
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: no memory for its contents", path));
    length = strlen(text);
    text[length] = '\n'; /* replaces the zero; the length is given below */
    CLN_TRY(cln_write_file(path, text, length + 1));
done:
    free(text);
    free(folder);
    free(path);
    return st;
}

cln_status cln_run_write(const char *run, const json_t *document)
{
    return cln_run_write_json(run, "run.json", document);
}

/* Fails for a path that is not a run; for one within a run, names the run. */
static cln_status fail_no_run(const char *run)
{
    cln_status st = CLN_OK;
    char *around = NULL, *path = NULL, *slash = NULL;

    CLN_TRY(cln_strdup(&around, run));
    for (size_t n = strlen(around); n > 1 && around[n - 1] == '/'; n--)
        around[n - 1] = 0;
    slash = strrchr(around, '/');
    if (slash && slash != around) {
        *slash = 0;
        CLN_TRY(cln_path_join(&path, around, "run.json"));
    }
    if (path && cln_is_file(path))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: not a run, but in one: give %s", run, around));
    CLN_TRY(cln_fail(
        CLN_INPUT, "%s: %s; give the folder that `cl-nascent train SCENE -o RUN` made", run,
        cln_is_dir(run) ? "not a run, as there is no run.json in it" : "no such folder"));
done:
    free(around);
    free(path);
    return st;
}

cln_status cln_run_read(const char *run, json_t **document)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    json_t *read = NULL;
    const char *schema = NULL;

    *document = NULL;
    CLN_TRY(cln_path_join(&path, run, "run.json"));
    if (!cln_is_file(path))
        CLN_TRY(fail_no_run(run));
    CLN_TRY(cln_json_read(path, false, &read));
    schema = json_string_value(json_object_get(read, "schema"));
    if (!schema || strcmp(schema, SCHEMA) != 0)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: its schema is %s, not %s; another program wrote it", path,
                         schema ? schema : "not named", SCHEMA));
    *document = read;
    read = NULL;
done:
    json_decref(read);
    free(path);
    return st;
}

bool cln_run_is_of_others(const char *run)
{
    static const char ours[] = "cl-nascent.run/"; /* of any version */
    char *path = NULL;
    json_t *read = NULL;
    bool others = false;

    if (cln_path_join(&path, run, "run.json") == CLN_OK && cln_is_file(path) &&
        cln_json_read(path, false, &read) == CLN_OK)
        others = strncmp(cln_json_text(read, "schema"), ours, sizeof ours - 1) != 0;
    cln_clear_error();
    json_decref(read);
    free(path);
    return others;
}

/* Returns whether a line is a row up to `step`; over: of an interval that is. An event belongs to
 * the beginning of the next step: a run resumed at the event's step repeats it. */
static bool keep_row(const char *line, size_t length, int64_t step, bool over)
{
    json_t *row = json_loadb(line, length, 0, NULL);
    const json_t *at = json_object_get(row, "step");
    json_int_t last = json_object_get(row, "event") ? step - 1 : step;
    bool keep = json_is_integer(at) && json_integer_value(at) <= last &&
                !(over && json_is_true(json_object_get(row, "unfinished")));

    json_decref(row);
    return keep;
}

/* Drops rows beyond `step` and what a crash left unfinished, atomically. */
static cln_status cut_rows(const char *path, int64_t step)
{
    cln_status st = CLN_OK;
    char *text = NULL;
    size_t bytes = 0, kept = 0;

    CLN_TRY(cln_read_file(path, (size_t)METRICS_MAX_GIB << 30, &text, &bytes));
    for (size_t at = 0; at < bytes;) {
        char *end = memchr(text + at, '\n', bytes - at);
        size_t length = end ? (size_t)(end - (text + at)) + 1 : bytes - at;
        if (end && keep_row(text + at, length, step, true)) {
            memmove(text + kept, text + at, length);
            kept += length;
        }
        at += length;
    }
    if (kept != bytes)
        CLN_TRY(cln_write_file(path, text, kept));
done:
    free(text);
    return st;
}

cln_status cln_run_drop_evals(const char *run, int64_t step)
{
    cln_status st = CLN_OK;
    char *folder = NULL, *path = NULL, *to = NULL;
    DIR *dir = NULL;
    int dropped = 0;

    CLN_TRY(cln_path_join(&folder, run, "eval"));
    dir = opendir(folder);
    for (struct dirent *e = dir ? readdir(dir) : NULL; e; e = readdir(dir)) {
        const char *dot = strrchr(e->d_name, '.');
        long long of = -1;

        if (!dot || strcmp(dot, ".json") != 0 || sscanf(e->d_name, "%lld-", &of) != 1 || of <= step)
            continue;
        free(path);
        free(to);
        path = to = NULL;
        CLN_TRY(cln_path_join(&path, folder, e->d_name));
        CLN_TRY(cln_asprintf(&to, "%s" CLN_DROPPED, path));
        if (rename(path, to) != 0)
            cln_warn("%s: figures of a model that is gone, which cannot be renamed: %s", path,
                     strerror(errno));
        else
            dropped++;
    }
    if (dropped)
        cln_info(
            "%s: figures of %d evaluation%s of later steps are set aside, as *.json" CLN_DROPPED,
            folder, dropped, cln_plural(dropped, "", "s"));
done:
    if (dir)
        closedir(dir);
    free(folder);
    free(path);
    free(to);
    return st;
}

double cln_run_drop_result(json_t *document, int64_t step)
{
    const double ended = cln_json_number(json_object_get(document, "result"), "step");

    if (!(ended > (double)step))
        return NAN;
    json_object_set_new(document, "result", json_null());
    return ended;
}

cln_status cln_metrics_open(const char *run, int64_t step, cln_metrics **out)
{
    cln_status st = CLN_OK;
    cln_metrics *metrics = NULL;

    *out = NULL;
    CLN_TRY(cln_alloc(&metrics, 1, sizeof *metrics, "metrics"));
    metrics->fd = -1;
    CLN_TRY(cln_path_join(&metrics->path, run, "metrics.jsonl"));
    if (cln_is_file(metrics->path))
        CLN_TRY(cut_rows(metrics->path, step));
    else if (access(metrics->path, F_OK) == 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s is no file; move it away", metrics->path));
    metrics->fd = open(metrics->path, O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0666);
    if (metrics->fd < 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", metrics->path, strerror(errno)));
    *out = metrics;
    metrics = NULL;
done:
    cln_metrics_close(metrics);
    return st;
}

cln_status cln_metrics_add(cln_metrics *metrics, const json_t *row)
{
    cln_status st = CLN_OK;
    char *text = json_dumps(row, JSON_COMPACT | TEXT_FLAGS);
    size_t length = 0, written = 0;
    off_t start = lseek(metrics->fd, 0, SEEK_END);

    if (!text) /* rows hold what JSON can, so nothing else can fail */
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: no memory for its next row", metrics->path));
    length = strlen(text);
    text[length++] = '\n';
    while (written < length) {
        ssize_t n = write(metrics->fd, text + written, length - written);
        if (n < 0 && errno == EINTR)
            continue;
        if (n < 0) {
            int reason = errno;
            /* Half a row would spoil the next one. */
            if (start >= 0 && written && ftruncate(metrics->fd, start) != 0)
                cln_warn("%s: its last row is incomplete", metrics->path);
            CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s; make room or choose another folder",
                             metrics->path, strerror(reason)));
        }
        written += (size_t)n;
    }
done:
    free(text);
    return st;
}

/* The last whole row up to `step` that is no event, its first byte, and how many follow it. key: it
 * has a number of this name; NULL: any. */
static cln_status find_last(const char *path, int64_t step, const char *key, json_t **row,
                            size_t *at, size_t *behind)
{
    cln_status st = CLN_OK;
    char *text = NULL;
    size_t bytes = 0, end = 0;

    *row = NULL;
    CLN_TRY(cln_read_file(path, (size_t)METRICS_MAX_GIB << 30, &text, &bytes));
    for (end = bytes; end > 0 && !*row; end = *at) {
        for (*at = end - 1; *at > 0 && text[*at - 1] != '\n'; --*at)
            ;
        *behind = bytes - end;
        if (text[end - 1] == '\n' && keep_row(text + *at, end - *at, step, false))
            *row = json_loadb(text + *at, end - *at, 0, NULL);
        if (json_object_get(*row, "event") ||
            (key && !json_is_number(json_object_get(*row, key)))) {
            json_decref(*row);
            *row = NULL;
        }
    }
done:
    free(text);
    return st;
}

cln_status cln_metrics_amend(cln_metrics *metrics, int64_t step, const char *key, double number)
{
    cln_status st = CLN_OK;
    json_t *row = NULL;
    size_t at = 0, behind = 0;

    CLN_TRY(find_last(metrics->path, step, NULL, &row, &at, &behind));
    if (!row || behind > 0 || json_integer_value(json_object_get(row, "step")) != step)
        goto done;
    json_object_set_new(row, key, cln_json_real(number));
    if (ftruncate(metrics->fd, (off_t)at) != 0)
        CLN_TRY(cln_fail(CLN_OUTPUT, "%s: %s", metrics->path, strerror(errno)));
    CLN_TRY(cln_metrics_add(metrics, row));
done:
    json_decref(row);
    return st;
}

cln_status cln_metrics_last(const char *run, int64_t step, const char *key, json_t **row)
{
    cln_status st = CLN_OK;
    char *path = NULL;
    size_t at = 0, behind = 0;

    *row = NULL;
    CLN_TRY(cln_path_join(&path, run, "metrics.jsonl"));
    if (cln_is_file(path))
        CLN_TRY(find_last(path, step, key, row, &at, &behind));
done:
    free(path);
    return st;
}

void cln_metrics_close(cln_metrics *metrics)
{
    if (!metrics)
        return;
    if (metrics->fd >= 0)
        close(metrics->fd);
    free(metrics->path);
    free(metrics);
}

void cln_utc_now(char out[32])
{
    time_t now = time(NULL);
    struct tm utc;

    gmtime_r(&now, &utc);
    strftime(out, 32, "%Y-%m-%dT%H:%M:%SZ", &utc);
}
