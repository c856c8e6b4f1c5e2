/* JSON files, members of objects, and reals that need not be finite. */
#ifndef CLN_JSON_H
#define CLN_JSON_H

#include <jansson.h>
#include <stdbool.h>
#include "base/log.h"
#include "base/status.h"

/* A real, or null if it is not finite. */
json_t *cln_json_real(double value);
/* A whole number, as of bytes, for readers whose numbers have types; null unless it is finite. */
json_t *cln_json_whole(double value);
/* A float of 0..1 to a float's digits: 0.1f is 0.1. */
double cln_json_digits(float value);

/* A member's number or text; NaN or "" if it is absent or of another type, or the object is NULL.
 */
double cln_json_number(const json_t *object, const char *key);
const char *cln_json_text(const json_t *object, const char *key);

/* The document's `warnings` (docs/formats.md): a list of texts, which gets those that it lacks.
 * What no memory is left for is missing. */
void cln_json_add_warned(json_t *document, const cln_warned *warned);

/* Parses a file; with `relaxed`, // and block comments and trailing commas are allowed, as in
 * instant-ngp's files, and NaN and infinities become strings. CLN_INPUT: "path: line L column C:
 * reason". The caller owns *out. */
cln_status cln_json_read(const char *path, bool relaxed, json_t **out);

/* "NaN", "-Infinity", ...: what a relaxed reading made this value of; else NULL. */
const char *cln_json_not_finite(const json_t *value);

/* The same, not relaxed, of files larger than the 512 MiB that it takes: `most` bytes. */
cln_status cln_json_read_large(const char *path, size_t most, json_t **out);

#endif
