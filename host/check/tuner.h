/* How the tuner decides about a set of kernel parameters, and what it says (tuner.c). */
#ifndef CLN_TUNER_H
#define CLN_TUNER_H

#include "cl_nascent.h"

/* Decides by ratios of times, of a set and of the best one before it, one for each pair of
 * timings (at most 9): ratio, pairs, slower and verdict. Too few pairs leave *set as it is. */
void cln_tune_decide(const double *ratios, int pairs, cln_tune_try *set);

/* Logs what became of the set, and why. */
void cln_tune_tell(const cln_tune_try *set);

#endif
