/* Advice for trainings whose tree never adapted, by playing through when levels would come and a
 * decision be due (grow.h, decide.h) in a longer one, or in one that waits less. It decides
 * nothing: if the schedule there changes and this does not, only numbers in a sentence are off. */
#ifndef CLN_ADVICE_H
#define CLN_ADVICE_H

#include "train/trainer.h"

/* Warns if the first tree has more leaves than --max-leaves, which none may be split beyond. */
void cln_advise_first_tree(cln_trainer *t);

/* Says once that the tree never adapted, as the first decision waited (cln_grow_awaited) until
 * --structure-until, and what would do. A training of a few steps is a try, so its user is not
 * warned. fraction: 0..1 of the budget. */
void cln_advise_none_came(cln_trainer *t, double fraction);

#endif
