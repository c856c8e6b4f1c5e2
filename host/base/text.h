/* Text of no format: how alike two names are, for "did you mean", and UTF-8. */
#ifndef CLN_TEXT_H
#define CLN_TEXT_H

#include <stdbool.h>

/* Edits (insert, delete, replace, swap of neighbours) between two names; of each only the first 63
 * characters count. */
int cln_edit_distance(const char *a, const char *b);

/* Bytes of the UTF-8 character (RFC 3629) that begins at `at`: 1 to 4, 0 if none does. The final
 * zero byte is a character of one byte. */
int cln_utf8_bytes(const char *at);

/* Is the whole text UTF-8? */
bool cln_utf8_valid(const char *text);

/* Puts '?' for each byte that belongs to no UTF-8 character. */
void cln_utf8_repair(char *text);

#endif
