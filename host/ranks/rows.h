/* Rows that each rank has some of, in any order, brought to all: at once, or begun early and waited
 * for when they are needed. With one rank nothing is done. */
#ifndef CLN_RANKS_ROWS_H
#define CLN_RANKS_ROWS_H

#include "ranks/ranks.h"

typedef struct cln_rows {
    int capacity, n;
    size_t row;                    /* bytes */
    uint16_t *rank;                /* [capacity] that has the row; the caller's to fill in */
    char *sent;                    /* [capacity], by rank */
    int first[CLN_RANKS_MOST + 1]; /* in `sent` */
    bool begun;                    /* a message is on its way */
} cln_rows;

/* CLN_MEMORY. */
cln_status cln_rows_create(int capacity, size_t row, cln_rows *out);

/* Accepts a zeroed one. After a failure between begin and end, `sent` stays allocated, as messages
 * may still arrive there. */
void cln_rows_free(cln_rows *x);

/* Share: n rows, [n][row], of which this rank has those whose x->rank is its own, become all
 * ranks'. Begin sends this rank's, End waits for the others' (NULL: forgets them); without a begin
 * it does nothing. Of all cln_rows, one can be begun at a time; meanwhile others may be shared. */
void cln_rows_share(cln_rows *x, int n, void *rows);
void cln_rows_begin(cln_rows *x, int n, const void *rows);
void cln_rows_end(cln_rows *x, void *rows);

#endif
