/* The thread-local error record of status.h. */
#include "base/status.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/text.h"

/* Enough for a path, a reason and a way out; device/program.c logs build logs by itself. */
enum { TEXT_BYTES = 4096 };

static _Thread_local struct {
    cln_status status;
    char text[TEXT_BYTES];
} record;

static const struct {
    int code;
    const char *phrase;
} table[] = {
#define X(name, code, phrase) {code, phrase},
    CLN_STATUS_LIST(X)
#undef X
};

const char *cln_version(void)
{
    return CLN_VERSION;
}

/* A program may be linked with an older library than it was compiled for. */
static bool is_known(cln_status st)
{
    return (size_t)st < sizeof table / sizeof table[0];
}

int cln_status_exit_code(cln_status st)
{
    return is_known(st) ? table[st].code : 1;
}

const char *cln_status_phrase(cln_status st)
{
    return is_known(st) ? table[st].phrase : "unknown status";
}

cln_status cln_fail(cln_status st, const char *fmt, ...)
{
    if (record.status == CLN_OK) {
        va_list args;
        va_start(args, fmt);
        vsnprintf(record.text, sizeof record.text, fmt, args);
        va_end(args);
        cln_text_plain(record.text); /* it may quote a file */
        record.status = st;
    }
    return st;
}

void cln_note(const char *fmt, ...)
{
    size_t used = strlen(record.text);
    va_list args;

    if (record.status == CLN_OK || used + 16 > sizeof record.text)
        return;
    used += (size_t)snprintf(record.text + used, sizeof record.text - used, "; while ");
    va_start(args, fmt);
    vsnprintf(record.text + used, sizeof record.text - used, fmt, args);
    va_end(args);
}

const char *cln_error_text(void)
{
    return record.text;
}

cln_status cln_error_status(void)
{
    return record.status;
}

void cln_clear_error(void)
{
    record.status = CLN_OK;
    record.text[0] = 0;
}

void cln_assert_failed(const char *file, int line, const char *what)
{
    fprintf(stderr, "cl-nascent: %s:%d: assertion failed: %s (a bug of ours, please report it)\n",
            file, line, what);
    abort();
}
