/* Reads a file's bytes from front to back: little-endian binary, and text by lines and fields.
 * Checks counts and lengths against the file's size before using them. */
#ifndef CLN_CURSOR_H
#define CLN_CURSOR_H

#include <stddef.h>
#include "base/status.h"

typedef struct cln_cursor {
    const char *path; /* for sentences */
    char *data;       /* [size] and a zero byte, from cln_read_file */
    size_t size, at;
    int line; /* number of cln_cursor_line's newest line */
} cln_cursor;

/* Copies the next `bytes` bytes. CLN_INPUT if the file ends before: "PATH: the file ends within
 * WHAT ...". */
cln_status cln_cursor_take(cln_cursor *cursor, const char *what, void *out, size_t bytes);

/* The next u64: the number of `what` that follow, each of at least `least` bytes. CLN_INPUT if the
 * rest of the file cannot hold them, even if the caller skips them. */
cln_status cln_cursor_count(cln_cursor *cursor, const char *what, size_t least, size_t *count);

/* The next zero-terminated text, in the file's memory. CLN_INPUT if there is none. */
cln_status cln_cursor_text(cln_cursor *cursor, const char *what, const char **text);

/* The next line without its end ("\n" or "\r\n") and, of the first, without the byte order mark of
 * Windows editors, in the file's memory, which it changes; NULL after the last. */
char *cln_cursor_line(cln_cursor *cursor);

/* The next field of a line, after blanks; moves *at past it. False at the line's end, and if it is
 * not a finite number, or not a whole number from 0 to `most` (at most 2^53). */
bool cln_field_word(char **at, char **word);
bool cln_field_number(char **at, double *value);
bool cln_field_whole(char **at, double most, double *value);

#endif
