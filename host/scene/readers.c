/* The table of readers, and the choice among them. */
#include "scene/reader.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/files.h"
#include "base/memory.h"
#include "io/run_folder.h"
#include "scene/found.h"

/* By the words of --format, which are tried in this order. */
static const cln_reader *const readers[CLN_FORMATS] = {
    [CLN_FORMAT_TRANSFORMS] = &cln_reader_transforms,
    [CLN_FORMAT_COLMAP] = &cln_reader_colmap,
    [CLN_FORMAT_LLFF] = &cln_reader_llff,
    [CLN_FORMAT_NEUS] = &cln_reader_neus,
    [CLN_FORMAT_NSVF] = &cln_reader_nsvf,
    [CLN_FORMAT_OPENSFM] = &cln_reader_opensfm,
    [CLN_FORMAT_METASHAPE] = &cln_reader_metashape,
    [CLN_FORMAT_POLYCAM] = &cln_reader_polycam,
    [CLN_FORMAT_RECORD3D] = &cln_reader_record3d,
};

bool cln_reader_detects(const char *path)
{
    const char *missing = NULL;

    for (int i = CLN_FORMAT_AUTO + 1; i < CLN_FORMATS; i++)
        if (readers[i]->detect(path, &missing))
            return true;
    return false;
}

cln_status cln_reader_run(const char *path, json_t **document)
{
    cln_status st = CLN_OK;
    char *what = NULL;

    *document = NULL;
    if (cln_has_file(path, "run.json"))
        return cln_run_read(path, document);
    CLN_TRY(cln_found_no_run(path, cln_reader_detects, &what));
    CLN_TRY(cln_fail(CLN_INPUT, "%s: %s", path, what));
done:
    free(what);
    return st;
}

/* " (NAME wants ...: what is missing)" for the readers that found a part of their format, or for
 * that of `format`; "" if there is none. The caller frees *out. */
static cln_status list_readers(const char *path, int format, char **out)
{
    cln_status st = CLN_OK;
    char *list = NULL;

    CLN_TRY(cln_strdup(&list, ""));
    for (int i = CLN_FORMAT_AUTO + 1; i < CLN_FORMATS; i++) {
        const char *missing = NULL;

        readers[i]->detect(path, &missing);
        if (format == CLN_FORMAT_AUTO ? !missing : format != i)
            continue;
        CLN_TRY(cln_append(&list, " (%s wants %s%s%s)", readers[i]->name, readers[i]->wants,
                           missing ? ": " : "", missing ? missing : ""));
    }
    *out = list;
    list = NULL;
done:
    free(list);
    return st;
}

/* The words of the formats after `format` that are found there; NULL if none is. */
static cln_status list_others(const char *path, int format, char **out)
{
    cln_status st = CLN_OK;
    const cln_config_row *row = cln_config_find("format");
    cln_config config = {0};

    *out = NULL;
    for (int i = format + 1; i < CLN_FORMATS; i++) {
        char word[CLN_TEXT_BYTES];
        const char *missing = NULL;

        if (!readers[i]->detect(path, &missing))
            continue;
        config.format = i;
        cln_config_text(&config, row, word);
        CLN_TRY(cln_append(out, "%s%s", *out ? " or " : "", word));
    }
done:
    return st;
}

cln_status cln_reader_pick(const char *path, int format, const cln_reader **out, char **others)
{
    cln_status st = CLN_OK;
    char *what = NULL, *advice = NULL, *list = NULL, *there = NULL;
    const char *missing = NULL;

    *others = NULL;
    for (int i = CLN_FORMAT_AUTO + 1; i < CLN_FORMATS; i++)
        if ((format == CLN_FORMAT_AUTO || format == i) && readers[i]->detect(path, &missing)) {
            *out = readers[i];
            return format == CLN_FORMAT_AUTO ? list_others(path, i, others) : CLN_OK;
        }
    errno = 0;
    if (!cln_is_dir(path) && !cln_is_file(path))
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %s; give the folder of a scene, or its transforms JSON file", path,
                         errno ? strerror(errno) : "neither a folder nor a file"));
    if (format != CLN_FORMAT_AUTO)
        CLN_TRY(list_others(path, CLN_FORMAT_AUTO, &there));
    if (there) {
        CLN_TRY(cln_asprintf(&what, "it is one of --format %s", there));
        CLN_TRY(cln_strdup(&advice, "give that, or leave --format out"));
    } else {
        CLN_TRY(cln_found_at(path, cln_reader_detects, &what, &advice));
    }
    CLN_TRY(list_readers(path, format, &list));
    CLN_TRY(cln_fail(CLN_INPUT, "%s: not a scene%s: %s; %s%s", path,
                     format == CLN_FORMAT_AUTO ? "" : " of this --format", what, advice, list));
done:
    free(what);
    free(advice);
    free(list);
    free(there);
    return st;
}
