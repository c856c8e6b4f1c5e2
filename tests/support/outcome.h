/* What a call returned, and the sentence it left. */
#ifndef CLN_TESTS_OUTCOME_H
#define CLN_TESTS_OUTCOME_H

#include <string.h>
#include "base/status.h"

static inline void assert_ok(cln_status st)
{
    if (st != CLN_OK)
        fail_msg("%s: %s", cln_status_phrase(st), cln_error_text());
}

/* Asserts the status and words of its sentence; clears the error. */
static inline void assert_fails(cln_status got, cln_status want, const char *words)
{
    if (got != want || !strstr(cln_error_text(), words))
        fail_msg("%s: '%s', not %s with '%s'", cln_status_phrase(got), cln_error_text(),
                 cln_status_phrase(want), words);
    cln_clear_error();
}

#endif
