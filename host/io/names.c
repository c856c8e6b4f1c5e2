/* View names to file names. See names.h. */
#include "io/names.h"

#include <stdbool.h>
#include <string.h>
#include <strings.h>
#include "base/memory.h"

/* Extensions of images. Any other dot belongs to the name, as in "frame.0001". */
static bool is_extension(const char *dot)
{
    return !strcasecmp(dot, ".png") || !strcasecmp(dot, ".jpg") || !strcasecmp(dot, ".jpeg");
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
        *c = *c == '/' || *c == '\\' ? '_' : *c;
done:
    return st;
}
