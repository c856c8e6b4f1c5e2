/* A run folder RUN/ and the files in it that are not checkpoints: run.json, metrics.jsonl, eval/.
 * docs/formats.md documents them. Only a folder that does not exist, is empty, or holds a run.json of
 * ours is written to; anything else is refused (CLN_OUTPUT), nothing in it touched. */
#ifndef CLN_RUN_FOLDER_H
#define CLN_RUN_FOLDER_H

#include <jansson.h>
#include <stdint.h>
#include "base/status.h"

/* Prepares RUN for a new training run: creates it; refuses one that is not ours, and one that already
 * holds a run unless `resume`. With resume it must hold one. */
cln_status cln_run_open(const char *run, bool resume);

/* run.json whole, atomically; and back. The reader checks "schema" ("cl-nascent.run/1"). */
cln_status cln_run_write(const char *run, const json_t *document);
cln_status cln_run_read(const char *run, json_t **document);

/* Any JSON document at RUN/name, atomically (folders made as needed). */
cln_status cln_run_write_json(const char *run, const char *name, const json_t *document);

/* metrics.jsonl: one object per line, appended and flushed. On resume rows with "step" beyond `step` (and
 * events, which have a key "event", of `step` itself: they happen as the step after it begins) are cut off
 * first, so that an interrupted run leaves the same rows as one that was not. NaN and
 * infinities are written as null by cln_json_real. */
typedef struct cln_metrics cln_metrics;
cln_status cln_metrics_open(const char *run, int64_t step, cln_metrics **out);
cln_status cln_metrics_add(cln_metrics *metrics, const json_t *row);
void cln_metrics_close(cln_metrics *metrics);

/* JSON helpers: a real or null when not finite; any document as text with full precision. */
json_t *cln_json_real(double value);
/* Parses a JSON file; with `relaxed`, // and block comments and trailing commas are allowed (instant-ngp
 * files have them). CLN_INPUT: "path: line L column C: reason". */
cln_status cln_json_read(const char *path, bool relaxed, json_t **out);

/* Peak resident memory of this process, bytes (0 if unknown); UTC time as ISO-8601. */
double cln_peak_rss(void);
void cln_utc_now(char out[32]);

#endif
