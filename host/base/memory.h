/* Checked allocation: overflow-safe sizes, zeroed memory, CLN_MEMORY with the size in the sentence. */
#ifndef CLN_MEMORY_H
#define CLN_MEMORY_H

#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

/* *out = zeroed memory for count elements of size bytes (count 0 gives a valid pointer to free).
 * `what` names it in the error sentence. On failure *out is NULL. */
cln_status cln_alloc(void *out_pointer, size_t count, size_t size, const char *what);

/* *out = copy of text; NULL stays NULL. */
cln_status cln_strdup(char **out, const char *text);

/* *out = printf-style text. */
cln_status cln_asprintf(char **out, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Bytes of memory that this machine has. */
double cln_host_memory(void);

#endif
