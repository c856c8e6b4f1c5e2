/* Checked allocation: overflow-safe sizes, zeroed memory, CLN_MEMORY with the size in the sentence.
 * Large pieces lie in huge pages where the system gives them to those who ask (Debian's default):
 * of 4 KiB pages a processor remembers the places of a few MiB only, and its prefetching ends with
 * each. */
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

/* Memory for a large array, not zeroed, at the start of a huge page; free() frees it. NULL if there
 * is none, if it is less than a huge page, or if the system has no such pages. */
void *cln_huge_pages(size_t bytes);

/* Bytes of memory that this machine has. */
double cln_host_memory(void);

/* The largest resident memory that this process had, in bytes; 0 if unknown. */
double cln_peak_rss(void);

#endif
