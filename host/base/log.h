/* The log: sentences for a person, on stderr by default. Levels: error is for main() alone, warn for
 * what changes a result, info for what train prints anyway, debug for -v. Not for results (stdout)
 * nor for the live progress line (io/progress.h), which it clears before a line of its own. */
#ifndef CLN_LOG_H
#define CLN_LOG_H

typedef enum { CLN_LOG_ERROR, CLN_LOG_WARN, CLN_LOG_INFO, CLN_LOG_DEBUG } cln_log_level;

/* Lines above this level are dropped. Default CLN_LOG_INFO. */
void cln_log_set_level(cln_log_level level);

/* Where lines go: called with the finished line (no newline). NULL = stderr. */
typedef void cln_log_sink(cln_log_level level, const char *line, void *user);
void cln_log_set_sink(cln_log_sink *sink, void *user);

void cln_log(cln_log_level level, const char *fmt, ...) __attribute__((format(printf, 2, 3)));
#define cln_warn(...)  cln_log(CLN_LOG_WARN, __VA_ARGS__)
#define cln_info(...)  cln_log(CLN_LOG_INFO, __VA_ARGS__)
#define cln_debug(...) cln_log(CLN_LOG_DEBUG, __VA_ARGS__)

#endif
