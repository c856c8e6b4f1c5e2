/* A run folder RUN/ and its files that are not checkpoints: run.json, metrics.jsonl, eval/
 * (docs/formats.md). Only a folder that is new, empty, or holds a run.json of this program is
 * written to; any other is refused (CLN_OUTPUT) and stays as it is. */
#ifndef CLN_RUN_FOLDER_H
#define CLN_RUN_FOLDER_H

#include <stdint.h>
#include "base/status.h"
#include "io/json.h"

/* Fails as cln_run_open would, before any work is done. *empty: RUN is new or empty. */
cln_status cln_run_check(const char *run, bool resume, bool *empty);

/* Prepares RUN for training: creates it for a new run; with `resume` it must hold one, else
 * CLN_INPUT. CLN_OUTPUT: it holds other files, or a run although `resume` is false, or cannot be
 * written. */
cln_status cln_run_open(const char *run, bool resume);

/* Holds RUN for this process alone, until cln_run_release or the process ends in any way: by a lock
 * on RUN/lock, which names the process. CLN_OUTPUT names the process that holds it already, or
 * what of RUN is a link to elsewhere. Warns
 * on a file system without locks. The caller releases *lock. */
cln_status cln_run_hold(const char *run, int *lock);
void cln_run_release(int lock); /* accepts a negative one */

/* Returns whether another process holds RUN; false on a file system without locks. */
bool cln_run_is_held(const char *run);

/* The state that run.json has, a text of the document; "broken off" in place of "running" if no
 * process holds RUN: it was killed, or the machine went down. "" without one. */
const char *cln_run_state(const char *run, const json_t *document);

/* What became of a run that is broken off, in the middle of a sentence, and what goes on from there
 * if it has no checkpoint. */
#define CLN_RUN_BROKEN_OFF "its process ended without a word (killed, or the machine went down)"
#define CLN_RUN_NO_CHECKPOINT \
    ", before the first checkpoint, so nothing of it can be used; remove the folder"

/* run.json, written atomically, and read; the reader checks "schema" ("cl-nascent.run/1") and gives
 * the document to the caller. */
cln_status cln_run_write(const char *run, const json_t *document);
cln_status cln_run_read(const char *run, json_t **document);

/* Is there a run.json that another program wrote, as a scene's folder may have? A damaged one
 * counts as ours. */
bool cln_run_is_of_others(const char *run);

/* Any JSON document at RUN/name, written atomically; folders are made as needed. */
cln_status cln_run_write_json(const char *run, const char *name, const json_t *document);

/* metrics.jsonl, an object a line, appended at once. Opening drops rows beyond `step`, those of an
 * interval that a stop left "unfinished", and events (rows with "event") of `step` itself, which
 * happen as the next step begins: a resumed run leaves the rows of one that was never
 * interrupted. */
typedef struct cln_metrics cln_metrics;
cln_status cln_metrics_open(const char *run, int64_t step, cln_metrics **out);
cln_status cln_metrics_add(cln_metrics *metrics, const json_t *row);
void cln_metrics_close(cln_metrics *metrics);

/* Gives figures in eval/ of steps beyond `step` the ending CLN_DROPPED more, as a run that goes on
 * from there has not come by these models: nothing shows them again. Pictures stay. Says how many;
 * warns of what cannot be renamed. */
#define CLN_DROPPED ".dropped"
cln_status cln_run_drop_evals(const char *run, int64_t step);

/* Makes the result of a run's document null where it is of a step beyond `step`: its model is gone.
 * Returns that step, else NAN. */
double cln_run_drop_result(json_t *document, int64_t step);

/* Gives the last row a number, written anew, if it is of `step` and no event; else does nothing. */
cln_status cln_metrics_amend(cln_metrics *metrics, int64_t step, const char *key, double number);

/* *row: the last row of RUN/metrics.jsonl up to `step`, events aside, that has a number `key`
 * (NULL: any row); NULL if there is none. The caller owns it. */
cln_status cln_metrics_last(const char *run, int64_t step, const char *key, json_t **row);

/* UTC as ISO 8601, "2026-01-02T03:04:05Z", as run.json has it. */
void cln_utc_now(char out[32]);

#endif
