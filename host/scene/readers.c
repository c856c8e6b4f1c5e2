/* The readers that there are, and the choice among them. */
#include "scene/reader.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include "base/files.h"
#include "base/memory.h"
#include "scene/found.h"

/* Tried in this order. */
static const cln_reader *const readers[] = {
    &cln_reader_transforms,
};

enum { READERS = sizeof readers / sizeof *readers };

static bool is_scene(const char *path)
{
    const char *missing = NULL;

    for (int i = 0; i < READERS; i++)
        if (readers[i]->detect(path, &missing))
            return true;
    return false;
}

/* "NAME wants ...: what is missing", for every reader. The caller frees *out. */
static cln_status list_readers(const char *path, char **out)
{
    cln_status st = CLN_OK;
    char *list = NULL, *longer = NULL;

    for (int i = 0; i < READERS; i++) {
        const char *missing = "";

        readers[i]->detect(path, &missing);
        CLN_TRY(cln_asprintf(&longer, "%s%s%s wants %s: %s", list ? list : "", list ? "; " : "",
                             readers[i]->name, readers[i]->wants, missing));
        free(list);
        list = longer;
        longer = NULL;
    }
    *out = list;
    list = NULL;
done:
    free(list);
    return st;
}

cln_status cln_reader_pick(const char *path, const cln_reader **out)
{
    cln_status st = CLN_OK;
    char *what = NULL, *advice = NULL, *list = NULL;
    const char *missing = NULL;

    for (int i = 0; i < READERS; i++)
        if (readers[i]->detect(path, &missing)) {
            *out = readers[i];
            return CLN_OK;
        }
    errno = 0;
    if (!cln_is_dir(path) && !cln_is_file(path))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %s; give the folder of a scene, or its transforms JSON file", path,
                         errno ? strerror(errno) : "neither a folder nor a file"));
    CLN_TRY(cln_found_at(path, is_scene, &what, &advice));
    CLN_TRY(list_readers(path, &list));
    CLN_TRY(cln_fail(CLN_INPUT, "%s: not a scene: %s; %s; %s", path, what, list, advice));
done:
    free(what);
    free(advice);
    free(list);
    return st;
}
