/* Checked allocation: overflow-safe sizes, zeroed memory, CLN_MEMORY with the size in the sentence.
 * Large blocks ask for huge pages (granted on request by Debian's default): with 4 KiB pages a
 * processor's TLB covers only a few MiB, and prefetching stops at each page. */
#ifndef CLN_MEMORY_H
#define CLN_MEMORY_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/status.h"

/* *out = zeroed memory for count elements of size bytes; not NULL even for count 0. what: its name
 * in the error sentence. On failure *out is NULL. */
cln_status cln_alloc(void *out_pointer, size_t count, size_t size, const char *what);

/* Makes room in *array for one more element of size bytes after the first `count`; the array grows
 * at powers of two. On failure it is as before. */
cln_status cln_grow(void *array_pointer, int64_t count, size_t size, const char *what);

/* *out = copy of text; NULL stays NULL. */
cln_status cln_strdup(char **out, const char *text);

/* *out = printf-style text. */
cln_status cln_asprintf(char **out, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* The same behind *text, which may be NULL for none yet; on failure it is as before. */
cln_status cln_append(char **text, const char *fmt, ...) __attribute__((format(printf, 2, 3)));

/* Memory for a large array, not zeroed, aligned to a huge page; free() frees it. NULL if memory is
 * short, if bytes are less than a huge page, or if the system has none. */
enum { CLN_HUGE_PAGE = 2 << 20 };
void *cln_huge_pages(size_t bytes);

/* Whether memory that is never touched costs nothing: no limit on the process's addresses or data
 * (ulimit -v, -d), and a system that does not count what is only reserved (vm.overcommit_memory
 * 2). */
bool cln_address_space_is_free(void);

/* Bytes of memory that this process may take: the machine's, or fewer in a control group (a
 * container, a batch job) or by limits of the process (ulimit -v and -d, less the addresses that it
 * has reserved and does not use now). */
double cln_host_memory(void);

/* The same of one of so many processes, which share what the machine and the group have. */
double cln_shared_memory(int processes);

/* Bytes of the machine's memory. */
double cln_machine_memory(void);

/* What of that no setting can exceed: limits of the process and of its control groups; INFINITY
 * without any. */
double cln_hard_memory(void);

/* The least that a control group of this process or one above it allows, by the files below root
 * ("" but in tests); INFINITY without a limit. */
double cln_group_memory(const char *root);

/* Bytes that this process could have in all as things are: what it has, and what the system could
 * give it without swapping, or a control group of it (limit less use, but for what is kept of
 * files), within the limits of the process. root: as above. INFINITY if unknown. */
double cln_available_memory(const char *root);

/* Peak resident memory of this process, in bytes; 0 if unknown. */
double cln_peak_rss(void);

#endif
