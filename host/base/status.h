/* How an error travels: functions that can fail return a cln_status; the sentence for the user sits
 * in one thread-local record, which cl_nascent.h reads (cln_error_text). Nothing in the library
 * prints an error or exits; the CLI's main() prints the record and turns the status into an exit
 * code (users see them in cl-nascent(1), they are never renumbered).
 *
 * A sentence has the object, the reason and, where there is one, the way out:
 *   "scene/transforms.json: line 3 column 7: ',' expected; fix the file or re-export it"
 */
#ifndef CLN_STATUS_H
#define CLN_STATUS_H

#include "cl_nascent.h"

/* Records the sentence and returns st. The first failure wins: while a record stands, later calls
 * keep it (cleanup code may fail too without hiding the cause). */
cln_status cln_fail(cln_status st, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Adds "; while <context>" to the standing record, on the way up. Nothing if there is none. */
void cln_note(const char *fmt, ...) __attribute__((format(printf, 1, 2)));

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
