/* The live progress line on stderr: redrawn in place on a terminal, written as a plain line now and
 * then off one. Log lines that come between clear it first (it installs itself as the log's sink).
 * Knows nothing of what is in progress: the caller formats the text; the CLI's wording is documented in
 * docs/cl-nascent.1. */
#ifndef CLN_PROGRESS_H
#define CLN_PROGRESS_H

#include <stdint.h>
#include "base/status.h"

typedef struct cln_progress cln_progress;

/* mode: "auto" (bar if stderr is a terminal, else line), "bar", "line", "none". One at a time. Whether
 * a terminal can do it (TERM=dumb, CI) is for the caller to say, by "line". */
cln_status cln_progress_open(const char *mode, cln_progress **out);

/* Shows `text` (already formatted, one line, no newline); fraction 0..1 of the work done. A bar is
 * redrawn at most 10 times a second and cut to the terminal's width; a plain line is written at most
 * every 10 s, and then once 1 % more is done, other work has begun (the fraction falls) or a minute has
 * passed. */
void cln_progress_show(cln_progress *progress, double fraction, const char *text);

/* Brings the last text to the screen, ends the line, gives the log back to stderr; accepts NULL. */
void cln_progress_close(cln_progress *progress);

/* "08:12", "1:02:03"; "--:--" if not finite. */
void cln_format_duration(double seconds, char out[32]);
/* "612 MiB", "1.2 GiB". */
void cln_format_bytes(double bytes, char out[32]);
/* "12,400", rounded to a whole number. */
void cln_format_count(double count, char out[32]);
/* "950", "182 k", "3.1 M": about three digits. */
void cln_format_short(double value, char out[32]);

#endif
