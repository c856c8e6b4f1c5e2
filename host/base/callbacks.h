/* The caller's callbacks in long work: shows how much is done, and asks whether to stop. Callbacks
 * that are NULL, or have members that are NULL, are fine. */
#ifndef CLN_CALLBACKS_H
#define CLN_CALLBACKS_H

#include "cl_nascent.h"

/* Shows how much of `what` is done; nothing if total is 0. */
void cln_show_work(const cln_callbacks *callbacks, const char *what, int done, int total);

/* The signal that the caller has for the work: SIGINT or SIGTERM to stop, SIGUSR1, or 0. */
int cln_poll_signal(const cln_callbacks *callbacks);

/* CLN_SIGINT or CLN_SIGTERM for these signals, else CLN_OK. left: what the end leaves behind, a
 * phrase for the sentence; may be NULL. */
cln_status cln_stopped_by(int signal, const char *left);

/* Shows work, and stops at a signal: CLN_SIGINT, CLN_SIGTERM. */
cln_status cln_tell_work(const cln_callbacks *callbacks, const char *what, int done, int total);

#endif
