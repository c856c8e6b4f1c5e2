/* Similarity of two names, for "did you mean", UTF-8, words for a shell, and an order of names. */
#ifndef CLN_TEXT_H
#define CLN_TEXT_H

#include <stdbool.h>
#include <stddef.h>

/* Number of edits (insert, delete, replace, swap of neighbours) between two names, of which the
 * first 63 characters count. */
int cln_edit_distance(const char *a, const char *b);

/* Bytes of the UTF-8 character (RFC 3629) that begins at `at`: 1 to 4, or 0 if none does. The
 * terminating zero counts as a character of one byte. */
int cln_utf8_bytes(const char *at);

/* Returns whether the whole text is UTF-8. */
bool cln_utf8_valid(const char *text);

/* The text as one word of a shell command, in single quotes if necessary. Returns out, which is
 * "..." if the word does not fit; 4 * strlen(text) + 3 bytes always suffice. */
enum { CLN_QUOTED_BYTES = 4096 };
const char *cln_shell_quote(const char *text, char *out, size_t bytes);

/* Ends a line of a text file before blanks and a carriage return, and returns where it begins
 * behind blanks. */
char *cln_trim_blanks(char *line);

/* The same, and before a comment (a `#` first or after a blank). */
char *cln_trim(char *line);

/* Does the text end with these characters? */
bool cln_ends_with(const char *text, const char *end);

/* "3", or "1 to 3" where they differ. */
enum { CLN_SPAN_BYTES = 32 };
void cln_format_span(int least, int most, char out[CLN_SPAN_BYTES]);

/* The form of a word beside this number: cln_plural(count, "leaf", "leaves"). */
const char *cln_plural(double count, const char *one, const char *more);

/* Bytes of the first `most` of text, without a character that these only begin. */
size_t cln_utf8_whole(const char *text, size_t most);

/* The first few of a list in a sentence, "a, b, c, ...", and how many there are. Zeroed: none. */
enum { CLN_LISTED_BYTES = 832 };
typedef struct cln_listed {
    int count;
    char text[CLN_LISTED_BYTES];
} cln_listed;

/* Counts one more. Of the first `most` the text has what the format makes, of the next "..."; what
 * is longer than 159 bytes is cut between characters. */
void cln_listed_add(cln_listed *listed, int most, const char *fmt, ...)
    __attribute__((format(printf, 3, 4)));

/* Replaces each byte outside UTF-8 characters by '?'. */
void cln_utf8_repair(char *text);

/* Makes a line safe to print: control characters, which a terminal would obey or which would make
 * lines of their own, become '?', but for tabs. */
void cln_text_plain(char *text);

/* Order of names, runs of digits by their value: "r_2" before "r_10". Below, at or above 0 as by
 * strcmp. */
int cln_natural_compare(const char *a, const char *b);

/* Bytes of a path before its last slash, 0 if it has none; and where the name after that begins. */
size_t cln_folder_length(const char *path);
const char *cln_last_name(const char *path);

/* The path without "./" before it. */
const char *cln_without_dot(const char *path);

#endif
