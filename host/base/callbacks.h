/* The caller's callbacks in long work without a ray: shows how much is done, and asks whether to
 * stop. */
#ifndef CLN_CALLBACKS_H
#define CLN_CALLBACKS_H

#include "cl_nascent.h"

/* callbacks: NULL, or with members that are NULL, is fine. total 0: shows nothing. CLN_SIGINT or
 * CLN_SIGTERM if the caller wants the work to stop. */
cln_status cln_tell_work(const cln_callbacks *callbacks, const char *what, int done, int total);

#endif
