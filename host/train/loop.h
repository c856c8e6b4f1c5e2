/* The training loop: steps and maintenance of the tree until a budget is used up, with evaluations,
 * checkpoints and signals between them. */
#ifndef CLN_LOOP_H
#define CLN_LOOP_H

#include "train/trainer.h"

/* Runs until a budget is used up, the target PSNR is reached or a signal comes; writes checkpoints,
 * rows of metrics.jsonl and the final evaluation. CLN_SIGINT or CLN_SIGTERM: stopped by the signal,
 * after a checkpoint. CLN_DIVERGED, CLN_MEMORY, CLN_CL, CLN_OUTPUT. */
cln_status cln_loop_run(cln_trainer *t);

/* Whether the budget of a resumed run is used up, which is said once. A budget in epochs is known
 * only to cln_loop_run. */
bool cln_loop_used_up(cln_trainer *t);

/* Polls the caller and the browser for a signal, and keeps it (t->signal, t->save_wanted). All
 * ranks poll at the same places, and each obeys a signal to any of them. user: a cln_trainer. */
int cln_loop_poll(void *user);

/* For long work within a training: shown to the caller, interrupted by cln_loop_poll. */
cln_callbacks cln_loop_callbacks(cln_trainer *t);

#endif
