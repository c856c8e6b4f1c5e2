/* The progress line on stderr: redrawn in place on a terminal, now and then a plain line elsewhere.
 * It is the log's sink while it is open, so that log lines clear it first. The caller formats its
 * text. */
#ifndef CLN_PROGRESS_H
#define CLN_PROGRESS_H

#include <stdint.h>
#include "base/status.h"

typedef struct cln_progress cln_progress;

/* mode: "auto" (bar if stderr is a terminal, else line), "bar", "line" or "none". One at a time.
 * For a terminal that cannot redraw (TERM=dumb, CI) the caller gives "line". CLN_USAGE: another
 * mode. */
cln_status cln_progress_open(const char *mode, cln_progress **out);

/* Shows text, one line without its newline; fraction (0..1) of the work is done. A bar is redrawn
 * at most 10 times a second, or when other work has begun (another first word, or the fraction
 * falls), with as many of its fields (" | " between them) as the terminal has room for. A plain
 * line is written at most every 10 s: when 1 % more is done, when other work has begun (the
 * fraction falls), or after a minute. */
void cln_progress_show(cln_progress *progress, double fraction, const char *text);

/* Shows the last text, ends the line and gives the log back to stderr; accepts NULL. */
void cln_progress_close(cln_progress *progress);

/* Columns of the terminal behind a stream (a file number); `otherwise` if there is none. */
int cln_terminal_columns(int stream, int otherwise);

/* "08:12", "1:02:03"; "--:--" if not finite. */
void cln_format_duration(double seconds, char out[32]);
/* "612 MiB", "1.2 GiB". */
void cln_format_bytes(double bytes, char out[32]);
/* "12,400", rounded to a whole number. */
void cln_format_count(double count, char out[32]);
/* "950", "182 k", "3.1 M": about three digits. */
void cln_format_short(double value, char out[32]);

#endif
