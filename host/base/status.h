/* Errors: functions that can fail return a cln_status; a thread-local record holds the sentence for
 * the user, which cln_error_text returns. The library never prints an error or exits; the command
 * line's main() prints the record and turns the status into an exit code (listed in cl-nascent(1),
 * never renumbered).
 *
 * A sentence has the object, the reason and, if there is one, the way out:
 *   "scene/transforms.json: line 3 column 7: ',' expected; fix the file or re-export it"
 */
#ifndef CLN_STATUS_H
#define CLN_STATUS_H

#include "cl_nascent.h"

/* Records the sentence and returns st. The first failure wins: later calls keep its record, so that
 * failing cleanup code does not hide the cause. */
cln_status cln_fail(cln_status st, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Adds "; while <context>" to the record, if there is one. */
void cln_note(const char *fmt, ...) __attribute__((format(printf, 1, 2)));

/* Evaluates a cln_status; on failure jumps to the function's one `done:` label. */
#define CLN_TRY(expr)     \
    do {                  \
        st = (expr);      \
        if (st != CLN_OK) \
            goto done;    \
    } while (0)

/* For bugs of ours, active in every build: prints file, line and expression, then aborts. */
#define CLN_ASSERT(cond) ((cond) ? (void)0 : cln_assert_failed(__FILE__, __LINE__, #cond))
void cln_assert_failed(const char *file, int line, const char *what) __attribute__((noreturn));

#endif
