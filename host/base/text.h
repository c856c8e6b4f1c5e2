/* Text helpers that belong to no format: how alike two names are, for "did you mean". */
#ifndef CLN_TEXT_H
#define CLN_TEXT_H

/* Edits (insert, delete, replace, swap of neighbours) between two names; of each only the first 63
 * characters count. */
int cln_edit_distance(const char *a, const char *b);

#endif
