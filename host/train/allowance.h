/* A share of the time, as seconds that may be spent: what is spent stays below the share of what
 * has passed, but for the last piece. Its clock is the caller's. */
#ifndef CLN_ALLOWANCE_H
#define CLN_ALLOWANCE_H

#include <stdbool.h>

typedef struct cln_allowance {
    double share;
    double most;   /* seconds that can be saved up: a long rest allows no long work */
    double credit; /* seconds; below 0 the last piece took more */
    double at;     /* when it was counted last */
} cln_allowance;

/* Time has passed; returns whether a piece may be begun. */
bool cln_allowance_pass(cln_allowance *allowance, double now);
void cln_allowance_spend(cln_allowance *allowance, double seconds);

#endif
