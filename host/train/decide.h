/* Structure decisions (method.md 12.2, 12.3): when one is due, and which leaves split and merge by
 * the integer program over their measures (measure.h, model/integer_program.h). restructure.h
 * carries it out. */
#ifndef CLN_DECIDE_H
#define CLN_DECIDE_H

#include "train/trainer.h"

/* Of a resumed run: counts no more decisions than are due by now, as its budget may have grown and
 * its fraction is then smaller again. Without another budget or schedule it changes nothing. */
void cln_decide_recount(cln_trainer *t);

/* Whether a decision is due before the next step, counting it even if the tree is then left alone.
 * grown: a whole level has just come; then none is. Says once that none ever came. fraction: 0..1
 * of the budget. */
bool cln_decide_due(cln_trainer *t, double fraction, bool grown);

/* Decides and carries the decision out, or waits for the next while the error still falls
 * (--structure-wait). Cached densities must be fresh. CLN_BUILD, CLN_MEMORY, CLN_CL, CLN_OUTPUT,
 * CLN_DIVERGED. */
cln_status cln_decide(cln_trainer *t, double fraction);

#endif
