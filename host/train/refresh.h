/* Refreshes the densities that stage 1 has cached: which leaves', and when (method.md 4). The
 * pipeline computes them (pipeline/networks.c). */
#ifndef CLN_REFRESH_H
#define CLN_REFRESH_H

#include "train/trainer.h"

/* Refresh all leaves; the marked ones [slot] alone. CLN_MEMORY, CLN_CL. */
cln_status cln_refresh_all(cln_trainer *t);
cln_status cln_refresh_marked(cln_trainer *t, const uint8_t *marks);

/* Refreshes what is due before the next step: all leaves, at once if `now` asks for it, or the next
 * part of them with --rolling-refresh. *whole: all leaves are refreshed since the last time that it
 * was true. CLN_MEMORY, CLN_CL. */
cln_status cln_refresh_due(cln_trainer *t, bool now, bool *whole);

#endif
