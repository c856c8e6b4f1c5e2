/* The member `history` of run.json: the starts of a run, a new one and each that resumed it, with
 * the settings that changed between them (docs/formats.md). Runs of older programs lack it. */
#ifndef CLN_RUN_HISTORY_H
#define CLN_RUN_HISTORY_H

#include <jansson.h>
#include <stdint.h>
#include "base/config.h"

enum { CLN_HISTORY_BYTES = 512 }; /* of a text about a start */

/* *out: `before`, the history so far (NULL: none), without starts that left no step behind, and a
 * start at `step` with the settings `now`; `saved`: those that the checkpoint was trained with,
 * NULL for a new run; scenes: digests of the scene before and now; programs: that of run.json and
 * this one, versions with their commits; NULL if not known. The caller owns *out. CLN_MEMORY. */
cln_status cln_history_add(const json_t *before, int64_t step, const char *command,
                           const char *started, const cln_config *saved, const cln_config *now,
                           const char *const scenes[2], const char *const programs[2],
                           json_t **out);

/* The program that trained before the last start, if it was another; or NULL. */
const char *cln_history_other_program(const json_t *history);

/* Whether a start went on with other settings, of those that a model depends on, with another
 * scene, or by another program; and that as text:
 * "resumed at step 120 with other settings: lr 0.1 -> 0.05, seed 7 -> 9". */
bool cln_history_changed(const json_t *start);
void cln_history_text(const json_t *start, char out[CLN_HISTORY_BYTES]);

#endif
