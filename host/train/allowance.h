/* Limits work to a share of the elapsed time: the seconds spent exceed that share by at most the
 * last piece of work. The caller supplies the clock. */
#ifndef CLN_ALLOWANCE_H
#define CLN_ALLOWANCE_H

#include <stdbool.h>

typedef struct cln_allowance {
    double share;
    double most;   /* limit of the credit, so that a long rest allows no long work */
    double credit; /* seconds; below 0 if the last piece took more */
    double at;     /* time of the last cln_allowance_pass */
} cln_allowance;

/* Adds the credit of the time until `now`; returns whether a piece of work may begin. */
bool cln_allowance_pass(cln_allowance *allowance, double now);
void cln_allowance_spend(cln_allowance *allowance, double seconds);

#endif
