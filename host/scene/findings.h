/* Findings: what may be wrong with a scene, as a JSON array of sentences (docs/formats.md). */
#ifndef CLN_FINDINGS_H
#define CLN_FINDINGS_H

#include <jansson.h>
#include <stdbool.h>

/* Appends a finding to an array: {"what": word, "likely_fault": bool, "views": [names], "text"}.
 * Takes `views` over; NULL: no view in particular. */
void cln_found_fault(json_t *findings, const char *what, bool likely_fault, json_t *views,
                     const char *fmt, ...) __attribute__((format(printf, 5, 6)));

/* Removes findings of that kind. Returns whether there were any. */
bool cln_findings_take_back(json_t *findings, const char *what);

/* The first names of a list: "a, b, c and 4 more". Of a list of pairs: "a and b; c and d; and 4
 * more pairs". Return out. */
const char *cln_findings_names(const json_t *names, char *out, size_t bytes);
const char *cln_findings_pairs(const json_t *names, char *out, size_t bytes);

#endif
