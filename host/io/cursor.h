/* A file's bytes read from front to back: little-endian binary, and text by lines and fields. What
 * files say of themselves (counts, lengths) is held against their size before it is believed. */
#ifndef CLN_CURSOR_H
#define CLN_CURSOR_H

#include <stddef.h>
#include "base/status.h"

typedef struct cln_cursor {
    const char *path; /* for sentences */
    char *data;       /* [size], and a zero byte behind, as cln_read_file gives it */
    size_t size, at;
    int line; /* number of the line that cln_cursor_line gave last */
} cln_cursor;

/* Copies the next `bytes` bytes. CLN_INPUT if the file ends before: "PATH: the file ends within
 * WHAT ...". */
cln_status cln_cursor_take(cln_cursor *cursor, const char *what, void *out, size_t bytes);

/* The next u64: how many `what` follow, of at least `least` bytes each, or are to be skipped.
 * CLN_INPUT if the rest of the file cannot hold them. */
cln_status cln_cursor_count(cln_cursor *cursor, const char *what, size_t least, size_t *count);

/* The next text with a zero byte behind it, in the file's memory. CLN_INPUT if there is none. */
cln_status cln_cursor_text(cln_cursor *cursor, const char *what, const char **text);

/* The next line without its end ("\n" or "\r\n"), in the file's memory, which is changed; NULL
 * behind the last. */
char *cln_cursor_line(cln_cursor *cursor);

/* The next field of a line, with blanks before it, and *at behind it. False at the line's end, and
 * if it is not a finite number, or not a whole one from 0 to `most` (at most 2^53). */
bool cln_field_word(char **at, char **word);
bool cln_field_number(char **at, double *value);
bool cln_field_whole(char **at, double most, double *value);

#endif
