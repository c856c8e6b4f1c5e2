/* Checked allocation. See memory.h. */
#include "base/memory.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/mman.h>
#endif

enum { HUGE_PAGE = 2 << 20 };

/* Asks for huge pages in [p, p + bytes); they only affect speed. */
static void ask_for_huge_pages(void *p, size_t bytes)
{
#ifdef MADV_HUGEPAGE
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), skip = (page - (uintptr_t)p % page) % page;

    if (bytes >= HUGE_PAGE + skip)
        (void)madvise((char *)p + skip, (bytes - skip) / page * page, MADV_HUGEPAGE);
#else
    (void)p;
    (void)bytes;
#endif
}

void *cln_huge_pages(size_t bytes)
{
    void *p = NULL;

#ifdef MADV_HUGEPAGE
    if (bytes < HUGE_PAGE || posix_memalign(&p, HUGE_PAGE, bytes) != 0)
        return NULL;
    ask_for_huge_pages(p, bytes);
#else
    (void)bytes;
#endif
    return p;
}

cln_status cln_alloc(void *out_pointer, size_t count, size_t size, const char *what)
{
    void *p = NULL;

    if (size == 0 || count <= SIZE_MAX / size)
        p = calloc(count ? count : 1, size ? size : 1);
    memcpy(out_pointer, &p, sizeof p);
    if (!p)
        return cln_fail(CLN_MEMORY, "%s: cannot allocate %zu x %zu bytes of host memory", what,
                        count, size);
    ask_for_huge_pages(p, count * size);
    return CLN_OK;
}

cln_status cln_strdup(char **out, const char *text)
{
    *out = NULL;
    return text ? cln_asprintf(out, "%s", text) : CLN_OK;
}

cln_status cln_asprintf(char **out, const char *fmt, ...)
{
    cln_status st = CLN_OK;
    int length = 0;
    va_list args;

    va_start(args, fmt);
    length = vsnprintf(NULL, 0, fmt, args);
    va_end(args);
    CLN_TRY(cln_alloc(out, (size_t)length + 1, 1, "text"));
    va_start(args, fmt);
    vsnprintf(*out, (size_t)length + 1, fmt, args);
    va_end(args);
done:
    return st;
}

double cln_host_memory(void)
{
    return (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
}

double cln_peak_rss(void)
{
    struct rusage usage;

    return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024.0 * (double)usage.ru_maxrss : 0;
}
