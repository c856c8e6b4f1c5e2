/* Runs side by side: what differs between them and which one is best, for `info RUN RUN`. From
 * their files alone, without checkpoints. */
#ifndef CLN_SIDE_BY_SIDE_H
#define CLN_SIDE_BY_SIDE_H

#include <jansson.h>
#include "base/status.h"

/* *out: the document that docs/formats.md describes as what `info RUN RUN` prints; the caller owns
 * it. CLN_INPUT if one of the folders is not a run. */
cln_status cln_side_by_side(int count, const char *const runs[], json_t **out);

#endif
