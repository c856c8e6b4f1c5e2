/* View names to file names. See names.h. */
#include "io/names.h"

#include <inttypes.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/memory.h"
#include "base/text.h"
#include "base/unicode.h"

/* Bytes of a view's part of a file's name: file systems have 255, of which others add split, kind,
 * ending and what a file is called while it is written. */
enum { LONGEST = 180 };

/* How many bytes of the name stay: whole characters. */
static int length_of(const char *file)
{
    int used = 0;

    for (int next = 0; file[used]; used += next) {
        next = cln_utf8_bytes(file + used);
        next = next ? next : 1;
        if (used + next > LONGEST)
            break;
    }
    return used;
}

/* Extensions of images, also of those that only a file of poses names. Any other dot belongs to the
 * name, as in "frame.0001". */
static bool is_extension(const char *dot)
{
    static const char *const endings[] = {"png", "jpg",  "jpeg", "exr", "tif", "tiff",
                                          "dpx", "webp", "heic", "bmp", "tga", "hdr"};

    for (size_t i = 0; i < sizeof endings / sizeof *endings; i++)
        if (!strcasecmp(dot + 1, endings[i]))
            return true;
    return false;
}

cln_status cln_view_file_name(const char *name, char **out)
{
    cln_status st = CLN_OK;
    char *base = NULL, *dot = NULL;

    while (name[0] == '.' && name[1] == '/')
        name += 2;
    CLN_TRY(cln_strdup(out, name));
    base = strrchr(*out, '/');
    base = base ? base + 1 : *out;
    dot = strrchr(base, '.');
    if (dot && dot != base && is_extension(dot))
        *dot = 0;
    for (char *c = *out; *c; c++)
        *c = strchr("/\\:", *c) ? '_' : *c; /* of Windows' paths, too */
done:
    return st;
}

typedef struct named {
    const char *name;
    char *file, *folded;
    int index;
    bool shared;
} named;

static int by_file(const void *a, const void *b)
{
    const named *x = a, *y = b;
    const int order = strcasecmp(x->folded, y->folded);

    return order ? order : strcmp(x->name, y->name);
}

cln_status cln_view_file_names(int count, const char *const *names, char **files)
{
    cln_status st = CLN_OK;
    named *sorted = NULL;

    CLN_TRY(cln_alloc(&sorted, (size_t)count, sizeof *sorted, "names of files"));
    for (int i = 0; i < count; i++) {
        CLN_TRY(cln_view_file_name(names[i], &files[i]));
        sorted[i] = (named){names[i], files[i], cln_unicode_fold(files[i]), i, false};
        if (!sorted[i].folded)
            CLN_TRY(cln_strdup(&sorted[i].folded, files[i]));
    }
    qsort(sorted, (size_t)count, sizeof *sorted, by_file);
    for (int first = 0, end = 0; first < count; first = end) {
        /* sticks and other disks take names for one that differ in case alone */
        while (end < count && strcasecmp(sorted[end].folded, sorted[first].folded) == 0)
            end++;
        for (int i = first; i < end; i++) /* in a group, equal names stand together */
            sorted[i].shared = strcmp(sorted[first].name, sorted[end - 1].name) != 0;
    }
    for (int i = 0; i < count; i++) {
        const uint64_t digest =
            cln_digest(CLN_DIGEST_START, sorted[i].name, strlen(sorted[i].name));

        if (!sorted[i].shared && strlen(sorted[i].file) <= LONGEST)
            continue;
        CLN_TRY(cln_asprintf(&files[sorted[i].index], "%.*s-%08" PRIx32, length_of(sorted[i].file),
                             sorted[i].file, (uint32_t)digest));
        free(sorted[i].file);
    }
done:
    for (int i = 0; i < count && sorted; i++)
        free(sorted[i].folded);
    free(sorted);
    return st;
}

static bool is_separator(char c)
{
    return c == '/' || c == '\\';
}

size_t cln_names_folder(int count, const char *const *names)
{
    size_t same = strlen(names[0]);

    for (int i = 0; i < count; i++) {
        size_t k = 0;

        while (k < same && names[i][k] == names[0][k])
            k++;
        same = k;
    }
    while (same > 0 && !is_separator(names[0][same - 1]))
        same--;
    return same;
}

bool cln_name_is_absolute(const char *name)
{
    return is_separator(*name) || cln_is_drive_path(name);
}
