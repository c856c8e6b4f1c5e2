/* The log: sentences for a person. They go to the sink that cln_log_to sets; without one they are
 * dropped. Levels: error is for main() and for a rank that ends all (ranks/ranks.c), warn for what
 * changes a result, info for train's normal lines, debug for -v. Not for results (stdout) or the
 * live progress line (io/progress.h), which clears itself before a line of the log. */
#ifndef CLN_LOG_H
#define CLN_LOG_H

#include "cl_nascent.h"

/* cln_log_to in two parts. Level: lines above it are dropped (default CLN_LOG_INFO). Sink: gets the
 * others; NULL drops them. */
void cln_log_set_level(cln_log_level level);
void cln_log_set_sink(cln_log_sink *sink, void *user);

/* The sink of programs: a line on stderr; the word "warning" is coloured if colours are on. */
cln_log_sink cln_log_stderr;
void cln_log_use_colour(bool on);

/* What this thread warns of between open and close, for documents: the first of it, without the
 * word "warning", as UTF-8, the same only once; whatever level and sink are. The list that was
 * opened last is closed first. */
enum { CLN_WARNED_MOST = 64 };
typedef struct cln_warned {
    int count;
    char *lines[CLN_WARNED_MOST];
    struct cln_warned *outer;
} cln_warned;
void cln_warned_open(cln_warned *list);
void cln_warned_close(cln_warned *list);

void cln_log(cln_log_level level, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
#define cln_warn(...)  cln_log(CLN_LOG_WARN, __VA_ARGS__)
#define cln_info(...)  cln_log(CLN_LOG_INFO, __VA_ARGS__)
#define cln_debug(...) cln_log(CLN_LOG_DEBUG, __VA_ARGS__)

#endif
