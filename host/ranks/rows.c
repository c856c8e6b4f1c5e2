/* Rows of all ranks in any order. See rows.h. In a message, the rows of each rank are adjacent;
 * within a rank they keep their order. */
#include "ranks/rows.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"

cln_status cln_rows_create(int capacity, size_t row, cln_rows *out)
{
    cln_status st = CLN_OK;
    const size_t count = (size_t)capacity;

    memset(out, 0, sizeof *out);
    out->capacity = capacity;
    out->row = row;
    CLN_TRY(cln_alloc(&out->rank, count, sizeof *out->rank, "rows of ranks"));
    if (cln_ranks_count() > 1)
        CLN_TRY(cln_alloc(&out->sent, count, row, "rows of ranks"));
done:
    if (st != CLN_OK)
        cln_rows_free(out);
    return st;
}

void cln_rows_free(cln_rows *x)
{
    free(x->rank);
    if (!x->begun)
        free(x->sent);
    memset(x, 0, sizeof *x);
}

/* Fills in `first`, and this rank's part of `sent`. */
static void pack(cln_rows *x, int n, const char *rows)
{
    const int me = cln_ranks_me(), ranks = cln_ranks_count();
    char *to = NULL;

    CLN_ASSERT(!x->begun && n <= x->capacity);
    x->n = n;
    memset(x->first, 0, sizeof *x->first * ((size_t)ranks + 1));
    for (int i = 0; i < n; i++)
        x->first[x->rank[i] + 1]++;
    for (int r = 0; r < ranks; r++)
        x->first[r + 1] += x->first[r];
    to = x->sent + (size_t)x->first[me] * x->row;
    for (int i = 0; i < n; i++)
        if (x->rank[i] == me) {
            memcpy(to, rows + (size_t)i * x->row, x->row);
            to += x->row;
        }
}

static void unpack(const cln_rows *x, char *rows)
{
    int next[CLN_RANKS_MOST];

    memcpy(next, x->first, sizeof *next * (size_t)cln_ranks_count());
    for (int i = 0; i < x->n; i++)
        memcpy(rows + (size_t)i * x->row, x->sent + (size_t)next[x->rank[i]]++ * x->row, x->row);
}

void cln_rows_share(cln_rows *x, int n, void *rows)
{
    if (cln_ranks_count() == 1)
        return;
    pack(x, n, rows);
    cln_ranks_gather(x->sent, x->row, x->first, true);
    unpack(x, rows);
}

void cln_rows_begin(cln_rows *x, int n, const void *rows)
{
    if (cln_ranks_count() == 1)
        return;
    pack(x, n, rows);
    x->begun = true;
    cln_ranks_gather_begin(x->sent, x->row, x->first);
}

void cln_rows_end(cln_rows *x, void *rows)
{
    if (!x->begun)
        return;
    cln_ranks_gather_end();
    x->begun = false;
    if (rows)
        unpack(x, rows);
}
