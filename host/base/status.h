/* How an error travels: functions that can fail return a cln_status; the sentence for the user sits
 * in one thread-local record. Nothing in the library prints an error or exits; the CLI's main()
 * prints the record and turns the status into an exit code (users see them in cl-nascent(1), they
 * are never renumbered).
 *
 * A sentence has the object, the reason and, where there is one, the way out:
 *   "scene/transforms.json: line 3 column 7: ',' expected; fix the file or re-export it"
 */
#ifndef CLN_STATUS_H
#define CLN_STATUS_H

#include <stdbool.h>

/* X(name, exit code, phrase) */
#define CLN_STATUS_LIST(X)                                 \
    X(OK, 0, "ok")                                         \
    X(FAILED, 1, "failed")                                 \
    X(INTERNAL, 1, "internal error")                       \
    X(USAGE, 2, "wrong usage")                             \
    X(INPUT, 3, "input data unreadable or invalid")        \
    X(NO_DEVICE, 4, "no usable OpenCL device")             \
    X(CL, 4, "OpenCL call failed")                         \
    X(BUILD, 4, "kernel does not build")                   \
    X(MEMORY, 5, "out of memory")                          \
    X(DIVERGED, 6, "training diverged")                    \
    X(OUTPUT, 7, "cannot write output")                    \
    X(CHECKPOINT, 8, "checkpoint corrupt or incompatible") \
    X(THRESHOLD, 9, "quality threshold not met")           \
    X(CHECK, 10, "self-test failed")                       \
    X(SIGINT, 130, "interrupted")                          \
    X(SIGTERM, 143, "terminated")

typedef enum cln_status {
#define X(name, code, phrase) CLN_##name,
    CLN_STATUS_LIST(X)
#undef X
} cln_status;

/* Exit code and fixed phrase of a status. */
int cln_status_exit_code(cln_status st);
const char *cln_status_phrase(cln_status st);

/* Records the sentence and returns st. The first failure wins: while a record stands, later calls
 * keep it (cleanup code may fail too without hiding the cause). */
cln_status cln_fail(cln_status st, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Adds "; while <context>" to the standing record, on the way up. Nothing if there is none. */
void cln_note(const char *fmt, ...) __attribute__((format(printf, 1, 2)));

/* The standing sentence ("" if none), its status, and forgetting it. The text lives until the next
 * cln_fail or cln_clear_error of this thread. */
const char *cln_error_text(void);
cln_status cln_error_status(void);
void cln_clear_error(void);

/* expr yields a cln_status; on failure jump to the function's one `done:` label. */
#define CLN_TRY(expr)     \
    do {                  \
        st = (expr);      \
        if (st != CLN_OK) \
            goto done;    \
    } while (0)

/* Bugs of ours, alive in release builds: prints file, line and expression, then aborts. */
#define CLN_ASSERT(cond) ((cond) ? (void)0 : cln_assert_failed(__FILE__, __LINE__, #cond))
void cln_assert_failed(const char *file, int line, const char *what) __attribute__((noreturn));

#endif
