/* Checked allocation. See memory.h. */
#include "base/memory.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>
#ifdef __linux__
#include <sys/mman.h>
#endif

/* Asks for huge pages in [p, p + bytes); they only affect speed. */
static void ask_for_huge_pages(void *p, size_t bytes)
{
#ifdef MADV_HUGEPAGE
    const size_t page = (size_t)sysconf(_SC_PAGESIZE), skip = (page - (uintptr_t)p % page) % page;

    if (bytes >= CLN_HUGE_PAGE + skip)
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
    if (bytes < CLN_HUGE_PAGE || posix_memalign(&p, CLN_HUGE_PAGE, bytes) != 0)
        return NULL;
    ask_for_huge_pages(p, bytes);
#else
    (void)bytes;
#endif
    return p;
}

bool cln_address_space_is_free(void)
{
    struct rlimit limit;
    FILE *file = NULL;
    int mode = '0';

    if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur != RLIM_INFINITY ||
        getrlimit(RLIMIT_DATA, &limit) != 0 || limit.rlim_cur != RLIM_INFINITY)
        return false;
    file = fopen("/proc/sys/vm/overcommit_memory", "r");
    if (file) {
        mode = fgetc(file);
        fclose(file);
    }
    return mode != '2';
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

/* The least number in FILE of a folder and of the folders above it, as far as `base`. */
static double least_above(const char *base, const char *group, const char *file)
{
    char path[2048], rest[1024];
    double least = INFINITY;

    snprintf(rest, sizeof rest, "%s", group);
    for (char *end = rest + strlen(rest); end; end = strrchr(rest, '/')) {
        FILE *f = NULL;
        double bytes = 0;

        *end = 0;
        snprintf(path, sizeof path, "%s%s/%s", base, rest, file);
        f = fopen(path, "re");
        if (f && fscanf(f, "%lf", &bytes) == 1 && bytes > 0) /* "max": none */
            least = fmin(least, bytes);
        if (f)
            fclose(f);
    }
    return least;
}

double cln_group_memory(const char *root)
{
    char path[1024], line[1024];
    double least = INFINITY;
    FILE *groups = NULL;

    snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
    groups = fopen(path, "re");
    while (groups && fgets(line, sizeof line, groups)) { /* number:controllers:group */
        char *controllers = strchr(line, ':'), *group = NULL;
        const char *file = NULL;

        group = controllers ? strchr(controllers + 1, ':') : NULL;
        if (!group)
            continue;
        *group++ = 0;
        group[strcspn(group, "\n")] = 0;
        if (strcmp(controllers, ":") == 0) { /* version 2 */
            snprintf(path, sizeof path, "%s/sys/fs/cgroup", root);
            file = "memory.max";
        } else if (strcmp(controllers, ":memory") == 0) {
            snprintf(path, sizeof path, "%s/sys/fs/cgroup/memory", root);
            file = "memory.limit_in_bytes";
        } else {
            continue;
        }
        least = fmin(least, least_above(path, group, file));
    }
    if (groups)
        fclose(groups);
    return least;
}

double cln_host_memory(void)
{
    const double all = (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);

    return fmin(all, cln_group_memory(""));
}

double cln_peak_rss(void)
{
    struct rusage usage;

    return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024.0 * (double)usage.ru_maxrss : 0;
}
