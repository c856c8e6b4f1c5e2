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

cln_status cln_grow(void *array_pointer, int64_t count, size_t size, const char *what)
{
    void **array = array_pointer;
    void *more = NULL;
    cln_status st = CLN_OK;

    if (count & (count - 1))
        return CLN_OK;
    CLN_TRY(cln_alloc(&more, count ? 2 * (size_t)count : 1, size, what));
    if (count)
        memcpy(more, *array, (size_t)count * size);
    free(*array);
    *array = more;
done:
    return st;
}

cln_status cln_strdup(char **out, const char *text)
{
    *out = NULL;
    return text ? cln_asprintf(out, "%s", text) : CLN_OK;
}

/* *out = `before` and the text. */
static cln_status format(char **out, const char *before, const char *fmt, va_list args)
{
    cln_status st = CLN_OK;
    const size_t kept = strlen(before);
    size_t length = 0;
    va_list again;

    va_copy(again, args);
    length = (size_t)vsnprintf(NULL, 0, fmt, again);
    va_end(again);
    CLN_TRY(cln_alloc(out, kept + length + 1, 1, "text"));
    memcpy(*out, before, kept);
    vsnprintf(*out + kept, length + 1, fmt, args);
done:
    return st;
}

cln_status cln_asprintf(char **out, const char *fmt, ...)
{
    cln_status st = CLN_OK;
    va_list args;

    va_start(args, fmt);
    st = format(out, "", fmt, args);
    va_end(args);
    return st;
}

cln_status cln_append(char **text, const char *fmt, ...)
{
    cln_status st = CLN_OK;
    char *longer = NULL;
    va_list args;

    va_start(args, fmt);
    st = format(&longer, *text ? *text : "", fmt, args);
    va_end(args);
    if (st == CLN_OK) {
        free(*text);
        *text = longer;
    }
    return st;
}

/* The first number of PATH, or with `key` of its line "key NUMBER"; NAN without. */
static double read_number(const char *path, const char *key)
{
    FILE *file = fopen(path, "re");
    char line[256];
    double number = NAN, value = 0;

    while (file && isnan(number) && fgets(line, sizeof line, file)) {
        const size_t length = key ? strlen(key) : 0;

        if (key && (strncmp(line, key, length) != 0 || line[length] != ' '))
            continue;
        if (sscanf(line + length, "%lf", &value) == 1) /* "max": none */
            number = value;
        if (!key)
            break;
    }
    if (file)
        fclose(file);
    return number;
}

/* Files of a control group, by version; of "stat" the names of what the system drops first. */
typedef struct group_files {
    const char *base, *limit, *use, *dropped[2];
} group_files;

static const group_files versions[] = {
    {"/sys/fs/cgroup", "memory.max", "memory.current", {"inactive_file", "active_file"}},
    {"/sys/fs/cgroup/memory",
     "memory.limit_in_bytes",
     "memory.usage_in_bytes",
     {"total_inactive_file", "total_active_file"}},
};

/* What a group allows, or has left; INFINITY if it does not tell. */
static double allowed(const char *folder, const group_files *files, bool left)
{
    char path[2560];
    double bytes = 0, used = 0;

    snprintf(path, sizeof path, "%s/%s", folder, files->limit);
    bytes = read_number(path, NULL);
    if (!(bytes > 0))
        return INFINITY;
    if (!left)
        return bytes;
    snprintf(path, sizeof path, "%s/%s", folder, files->use);
    used = read_number(path, NULL);
    if (!(used > 0))
        return INFINITY;
    snprintf(path, sizeof path, "%s/memory.stat", folder);
    for (int i = 0; i < 2; i++)
        used -= fmax(0, read_number(path, files->dropped[i])); /* fmax(0, NAN) is 0 */
    return fmax(0, bytes - fmax(0, used));
}

/* The least of a group and of those above it. */
static double least_above(const char *root, const char *group, const group_files *files, bool left)
{
    char folder[2300], rest[1024];
    double least = INFINITY;

    snprintf(rest, sizeof rest, "%s", group);
    for (char *end = rest + strlen(rest); end; end = strrchr(rest, '/')) {
        *end = 0;
        snprintf(folder, sizeof folder, "%s%s%s", root, files->base, rest);
        least = fmin(least, allowed(folder, files, left));
    }
    return least;
}

static double group_memory(const char *root, bool left)
{
    char path[1024], line[1024];
    double least = INFINITY;
    FILE *groups = NULL;

    snprintf(path, sizeof path, "%s/proc/self/cgroup", root);
    groups = fopen(path, "re");
    while (groups && fgets(line, sizeof line, groups)) { /* number:controllers:group */
        char *controllers = strchr(line, ':'), *group = NULL;
        int version = 0;

        group = controllers ? strchr(controllers + 1, ':') : NULL;
        if (!group)
            continue;
        *group++ = 0;
        group[strcspn(group, "\n")] = 0;
        if (strcmp(controllers, ":memory") == 0)
            version = 1;
        else if (strcmp(controllers, ":") != 0)
            continue;
        least = fmin(least, least_above(root, group, &versions[version], left));
    }
    if (groups)
        fclose(groups);
    return least;
}

double cln_group_memory(const char *root)
{
    return group_memory(root, false);
}

/* Pages that a process has: addresses, resident ones and of these shared ones, private data. */
typedef struct pages {
    double addresses, resident, shared, data;
} pages;

static pages own_pages(const char *root)
{
    char path[1024];
    pages p = {0};
    double code = 0, unused = 0;
    FILE *file = NULL;

    snprintf(path, sizeof path, "%s/proc/self/statm", root);
    file = fopen(path, "re");
    if (!file || fscanf(file, "%lf %lf %lf %lf %lf %lf", &p.addresses, &p.resident, &p.shared,
                        &code, &unused, &p.data) != 6)
        p = (pages){0};
    if (file)
        fclose(file);
    return p;
}

/* What a limit on pages of a kind leaves for memory that is used: some are only reserved. */
static double limit_of_kind(int kind, double all, double own)
{
    struct rlimit limit;

    if (getrlimit(kind, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY)
        return INFINITY;
    return fmax(0, (double)limit.rlim_cur - fmax(0, all - own) * (double)sysconf(_SC_PAGESIZE));
}

/* What ulimit -v and -d leave for this process. */
static double limits_memory(const pages *p)
{
    const double own = fmax(0, p->resident - p->shared);

    return fmin(limit_of_kind(RLIMIT_AS, p->addresses, own),
                limit_of_kind(RLIMIT_DATA, p->data, own));
}

double cln_available_memory(const char *root)
{
    const pages p = own_pages(root);
    char path[1024];
    double system = 0;

    snprintf(path, sizeof path, "%s/proc/meminfo", root);
    system = 1024 * read_number(path, "MemAvailable:");
    return fmin(fmin(isnan(system) ? INFINITY : system, group_memory(root, true)) +
                    (p.resident - p.shared) * (double)sysconf(_SC_PAGESIZE),
                limits_memory(&p));
}

double cln_hard_memory(void)
{
    const pages p = own_pages("");

    return fmin(cln_group_memory(""), limits_memory(&p));
}

double cln_machine_memory(void)
{
    return (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGESIZE);
}

double cln_shared_memory(int processes)
{
    const double all = fmin(cln_machine_memory(), cln_group_memory(""));

    return fmin(all / processes, cln_hard_memory());
}

double cln_host_memory(void)
{
    return cln_shared_memory(1);
}

double cln_peak_rss(void)
{
    struct rusage usage;

    return getrusage(RUSAGE_SELF, &usage) == 0 ? 1024.0 * (double)usage.ru_maxrss : 0;
}
