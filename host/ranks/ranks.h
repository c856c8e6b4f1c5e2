/* The processes of one training, by MPI: who this one is, and what they say to each other. Each is
 * a rank, with a device of its own; rank 0 writes what is written. Built without MPI (the default),
 * or started alone, there is one rank, and every function here is trivial. No OpenCL, no model.
 *
 * All ranks call these in the same order with the same sizes. If one fails, it says so and ends all
 * (cln_ranks_close); a rank that dies without a word is named by mpirun, and one that does not come
 * to where the others wait for it by one of them (CLN_RANKS_PATIENCE). */
#ifndef CLN_RANKS_H
#define CLN_RANKS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

enum { CLN_RANKS_MOST = 1024 };

/* Seconds for which a rank waits for one that does nothing that others could notice; then it logs a
 * sentence that names that one, and ends all with CLN_FAILED's exit code. Time in which the waiting
 * rank itself was stopped does not count. Nothing that a rank does alone takes as long, on slow
 * machines and with large scenes. Rank 0's variable CL_NASCENT_RANK_WAIT has another time for all,
 * 0 for ever. */
enum { CLN_RANKS_PATIENCE = 1800 };

/* Joins the ranks that this process was started with (mpirun, srun); once per process. CLN_USAGE
 * with more than CLN_RANKS_MOST, or another CL_NASCENT_RANK_WAIT. */
cln_status cln_ranks_open(void);

/* Leaves them at the end of the process. With an error it ends all ranks with this exit code, and
 * does not return. */
void cln_ranks_close(bool failed, int exit_code);

int cln_ranks_count(void);        /* 1 before cln_ranks_open */
int cln_ranks_me(void);           /* 0 .. count - 1 */
int cln_ranks_me_here(void);      /* among the ranks of this machine, 0 .. */
int cln_ranks_here(void);         /* ranks of this machine, which share its memory */
const char *cln_ranks_name(void); /* "rank 1 of 2 on HOST: ", from what mpirun told this process
                                     before cln_ranks_open; "" if alone */

/* Answers ranks that ask whether this one is still there. For long work that it does alone, while
 * others wait. */
void cln_ranks_answer(void);

/* Each of n values becomes the largest of all ranks' values, on all ranks. */
void cln_ranks_largest(double *values, int n);

/* The same in two calls, between which this rank works on and says other things: `values` must stay
 * until the second, which waits. One at a time. */
void cln_ranks_largest_begin(double *values, int n);
void cln_ranks_largest_end(void);

/* Rank 0's bytes to all; or another's, at most INT_MAX of them. */
void cln_ranks_tell(void *data, size_t bytes);
void cln_ranks_tell_from(int rank, void *data, size_t bytes);

/* Some bytes go from rank 0 to the last in turn, and back to rank 0. Take: waits for them; rank 0
 * has them. Hand: gives them on; rank 0 waits until they are back. */
void cln_ranks_take(void *baton, size_t bytes);
void cln_ranks_hand(void *baton, size_t bytes);

/* Compares a digest of all ranks: if they differ, CLN_USAGE on all, with the first rank that
 * differs and its host. what: "settings", "scene". */
cln_status cln_ranks_agree(uint64_t digest, const char *what);

/* Do all have a run to go on with at this path, or none? CLN_USAGE on all if some have, with the
 * first of those that have not and its host. */
cln_status cln_ranks_have(bool here, const char *run);

/* Rows [first[r], first[r + 1]) of an array are rank r's; after it, everyone (or, if not `all`,
 * rank 0) has all rows. first: [count + 1]. */
void cln_ranks_gather(void *rows, size_t row_bytes, const int *first, bool all);

/* The same, to all, in two calls, between which this rank works on and says other things: `rows`
 * must stay until the second, which waits. One at a time. */
void cln_ranks_gather_begin(void *rows, size_t row_bytes, const int *first);
void cln_ranks_gather_end(void);

/* The same rows dealt anew: `from` has this rank's rows by old_first, `to` gets those by new_first;
 * both begin with the rank's first row. */
void cln_ranks_deal(const void *from, const int *old_first, void *to, const int *new_first,
                    size_t row_bytes);

/* Rows to and from some other ranks: rows [sent_first[r], sent_first[r + 1]) of `sent` go to rank
 * r, perhaps none, if to[r]; those that rank r sends come to got + got_first[r] rows. r sends if
 * there is room for some, up to got_first[r + 1]. got_count[r]: how many came. to, got_count:
 * [count]. */
void cln_ranks_swap(const void *sent, const int *sent_first, const bool *to, void *got,
                    const int *got_first, int *got_count, size_t row_bytes);

/* What this rank has sent so far, and how long it has waited for others. */
typedef struct cln_ranks_traffic {
    double bytes, seconds;
} cln_ranks_traffic;
cln_ranks_traffic cln_ranks_sent(void);

#endif
