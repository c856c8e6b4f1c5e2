/* Tuning parameters: text, rows. See tune.h. */
#include "device/tune.h"

#include <fnmatch.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/files.h"
#include "base/memory.h"
#include "device/kernel_source.h"

static const struct {
    const char *name;
    size_t offset;
    int cpu, gpu, plain, min, max;
} tune_rows[] = {
#define X(field, name, cpu, gpu, plain, min, max, meaning) \
    {name, offsetof(cln_tune, field), cpu, gpu, plain, min, max},
    CLN_TUNE_LIST(X)
#undef X
};
enum { TUNE_ROWS = sizeof tune_rows / sizeof tune_rows[0], FILES = 16, MAX_BYTES = 1 << 20 };

static int *tune_field(cln_tune *tune, int row)
{
    return (int *)((char *)tune + tune_rows[row].offset);
}

/* ---- lists of parameters ---- */

void cln_tune_text(const cln_tune *tune, char out[CLN_TUNE_TEXT])
{
    int used = 0;

    for (int i = 0; i < TUNE_ROWS; i++)
        used += snprintf(out + used, CLN_TUNE_TEXT - (size_t)used, "%s%s=%d", i ? "," : "",
                         tune_rows[i].name, *tune_field((cln_tune *)tune, i));
}

/* Returns whether a parameter must be a power of two: widths divide the networks' layers, and scans
 * halve their groups. */
static bool is_power(int row)
{
    static const size_t powers[] = {offsetof(cln_tune, vw), offsetof(cln_tune, nv),
                                    offsetof(cln_tune, ls), offsetof(cln_tune, sg)};

    for (size_t i = 0; i < sizeof powers / sizeof *powers; i++)
        if (tune_rows[row].offset == powers[i])
            return true;
    return false;
}

/* Writes what a parameter takes: "a whole number from 1 to 32", "1, 2, 4, 8 or 16". */
static void name_values(int row, char out[CLN_TUNE_TEXT])
{
    const int most = tune_rows[row].max;
    int used = 0;

    if (!is_power(row)) {
        snprintf(out, CLN_TUNE_TEXT, "a whole number from %d to %d", tune_rows[row].min, most);
        return;
    }
    for (int value = tune_rows[row].min; value <= most; value *= 2)
        used += snprintf(out + used, CLN_TUNE_TEXT - (size_t)used, "%s%d",
                         value == tune_rows[row].min ? ""
                         : value == most             ? " or "
                                                     : ", ",
                         value);
}

/* where: start of the error sentence, "--tune" or file and line. */
static cln_status parse_list(cln_status bad, const char *where, const char *text, cln_tune *tune)
{
    while (*text) {
        const size_t length = strcspn(text, "=,");
        char names[CLN_TUNE_TEXT] = "";
        int row = 0, used = 0;
        char *end = NULL;
        long value = 0;

        while (row < TUNE_ROWS && (strlen(tune_rows[row].name) != length ||
                                   strncmp(tune_rows[row].name, text, length) != 0))
            row++;
        if (row == TUNE_ROWS || text[length] != '=') {
            for (int i = 0; i < TUNE_ROWS; i++)
                used += snprintf(names + used, sizeof names - (size_t)used, "%s%s",
                                 i == 0               ? ""
                                 : i == TUNE_ROWS - 1 ? " or "
                                                      : ", ",
                                 tune_rows[i].name);
            return cln_fail(bad,
                            "%s: '%.*s' is not a tuning parameter; use %s with =NUMBER, comma "
                            "separated",
                            where, (int)length, text, names);
        }
        value = strtol(text + length + 1, &end, 10);
        if (end == text + length + 1 || (*end && *end != ',') || value < tune_rows[row].min ||
            value > tune_rows[row].max || (is_power(row) && (value & (value - 1)))) {
            name_values(row, names);
            return cln_fail(bad, "%s: '%.*s': %s takes %s", where, (int)strcspn(text, ","), text,
                            tune_rows[row].name, names);
        }
        *tune_field(tune, row) = (int)value;
        text = *end ? end + 1 : end;
    }
    return CLN_OK;
}

cln_status cln_tune_parse(const char *text, cln_tune *tune)
{
    return parse_list(CLN_USAGE, "--tune", text, tune);
}

void cln_tune_unmet(const char *text, const cln_tune *used, char out[CLN_TUNE_TEXT])
{
    cln_tune given;
    int length = 0;

    out[0] = 0;
    memset(&given, -1, sizeof given); /* no parameter has such a value */
    CLN_ASSERT(parse_list(CLN_INTERNAL, "--tune", text, &given) == CLN_OK);
    for (int i = 0; i < TUNE_ROWS && length < CLN_TUNE_TEXT; i++) {
        const int asked = *tune_field(&given, i), its = *tune_field((cln_tune *)used, i);

        if (asked >= 0 && asked != its)
            length += snprintf(out + length, CLN_TUNE_TEXT - (size_t)length, "%s%s=%d (%d is used)",
                               length ? ", " : "", tune_rows[i].name, asked, its);
    }
}

void cln_tune_class_default(cl_device_id id, bool cpu, cln_tune *out)
{
    cl_uint native = 0;

    for (int i = 0; i < TUNE_ROWS; i++)
        *tune_field(out, i) = cpu ? tune_rows[i].cpu : tune_rows[i].gpu;
    if (out->vw == 0) {
        clGetDeviceInfo(id, CL_DEVICE_NATIVE_VECTOR_WIDTH_FLOAT, sizeof native, &native, NULL);
        out->vw = native >= 16 ? 16 : native >= 8 ? 8 : 4;
    }
}

void cln_tune_plain(cln_tune *out)
{
    for (int i = 0; i < TUNE_ROWS; i++)
        *tune_field(out, i) = tune_rows[i].plain;
}

/* ---- rows ---- */

/* Takes a line's next part, up to `end`, without blanks around it; false if it does not fit. */
static bool part(const char **at, char end, char *out, size_t bytes)
{
    const size_t whole = strcspn(*at, (const char[]){end, 0});
    size_t length = whole;
    const char *from = *at;

    *at += whole + (from[whole] != 0);
    while (length > 0 && strchr(" \t\r", *from)) {
        from++;
        length--;
    }
    while (length > 0 && strchr(" \t\r", from[length - 1]))
        length--;
    if (length >= bytes)
        return false;
    memcpy(out, from, length);
    out[length] = 0;
    return true;
}

/* Reads a line without its newline. *found: false if it is blank or only a comment. */
static cln_status parse_row(const char *file, int number, const char *text, cln_tune_row *row,
                            bool *found)
{
    cln_status st = CLN_OK;
    const size_t length = strcspn(text, "#");
    char *line = NULL, where[CLN_TUNE_FROM];
    const char *at = NULL;
    int bars = 0;
    bool fits = true;
    cln_tune ignored = {0};

    *found = false;
    CLN_TRY(cln_alloc(&line, length + 1, 1, "tuning row"));
    memcpy(line, text, length);
    if (line[strspn(line, " \t\r")] == 0)
        goto done;
    snprintf(where, sizeof where, "%s: line %d", file, number);
    for (const char *c = line; *c; c++)
        bars += *c == '|';
    at = line;
    fits = part(&at, '|', row->device, sizeof row->device) &&
           part(&at, '|', row->driver, sizeof row->driver) &&
           part(&at, '|', row->network, sizeof row->network) &&
           part(&at, '|', row->list, sizeof row->list);
    if (bars != 3 || !fits || !*row->device || !*row->driver || !*row->network || !*row->list)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: %s; a row is DEVICE | DRIVER | NETWORK | VW=8,TS=6,... with shell "
                         "patterns for the first three, and `cl-nascent tune` writes them",
                         where,
                         bars != 3 ? "it does not have four parts separated by |"
                         : fits    ? "one of its parts is empty"
                                   : "one of its parts is too long"));
    CLN_TRY(parse_list(CLN_INPUT, where, row->list, &ignored));
    row->file = file;
    row->line = number;
    *found = true;
done:
    free(line);
    return st;
}

static cln_status append(cln_tune_rows *rows, const cln_tune_row *row)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_grow(&rows->row, rows->count, sizeof *rows->row, "tuning rows"));
    rows->row[rows->count++] = *row;
done:
    return st;
}

cln_status cln_tune_rows_add(const char *file, const char *text, cln_tune_rows **rows)
{
    cln_status st = CLN_OK;
    char *name = NULL, *line = NULL;
    int number = 0;

    if (!*rows)
        CLN_TRY(cln_alloc(rows, 1, sizeof **rows, "tuning rows"));
    CLN_ASSERT((*rows)->file_count < FILES);
    CLN_TRY(cln_strdup(&name, file));
    (*rows)->files[(*rows)->file_count++] = name;
    while (*text) {
        const size_t length = strcspn(text, "\n");
        cln_tune_row row = {0};
        bool found = false;

        CLN_TRY(cln_asprintf(&line, "%.*s", (int)length, text));
        CLN_TRY(parse_row(name, ++number, line, &row, &found));
        if (found)
            CLN_TRY(append(*rows, &row));
        free(line);
        line = NULL;
        text += length + (text[length] == '\n');
    }
done:
    free(line);
    return st;
}

cln_status cln_tune_rows_read(const char *path, cln_tune_rows **rows)
{
    cln_status st = CLN_OK;
    char *text = NULL;
    size_t bytes = 0;

    st = cln_read_file(path, MAX_BYTES, &text, &bytes);
    if (st != CLN_OK)
        cln_note("reading tuning rows (--tune-file names another file)");
    CLN_TRY(st);
    if (strlen(text) != bytes)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: it is not a text file, as it has bytes of value 0", path));
    CLN_TRY(cln_tune_rows_add(path, text, rows));
done:
    free(text);
    return st;
}

cln_status cln_tune_rows_shipped(cln_tune_rows **rows)
{
    cln_status st = CLN_OK;
    char *text = NULL, *name = NULL;

    for (const cln_kernel_source *source = cln_tune_sources; source->name; source++) {
        size_t bytes = 1, used = 0;

        for (const char *const *line = source->lines; *line; line++)
            bytes += strlen(*line);
        CLN_TRY(cln_alloc(&text, bytes, 1, "tuning rows"));
        for (const char *const *line = source->lines; *line; line++) {
            memcpy(text + used, *line, strlen(*line));
            used += strlen(*line);
        }
        CLN_TRY(cln_asprintf(&name, "data/tune/%s", source->name));
        CLN_TRY(cln_tune_rows_add(name, text, rows));
        free(text);
        free(name);
        text = name = NULL;
    }
done:
    free(text);
    free(name);
    return st;
}

void cln_tune_rows_free(cln_tune_rows *rows)
{
    if (!rows)
        return;
    for (int i = 0; i < rows->file_count; i++)
        free(rows->files[i]);
    free(rows->row);
    free(rows);
}

/* Ignores blanks around `text`: some drivers pad their names, and a row's parts have none. */
static bool matches(const char *pattern, const char *text)
{
    char trimmed[160];

    return part(&text, 0, trimmed, sizeof trimmed) && fnmatch(pattern, trimmed, 0) == 0;
}

static const cln_tune_row *last_row(const cln_tune_rows *rows, const char *device,
                                    const char *driver, const char *network)
{
    for (int i = rows ? rows->count - 1 : -1; i >= 0; i--)
        if (matches(rows->row[i].device, device) && matches(rows->row[i].driver, driver) &&
            matches(rows->row[i].network, network))
            return &rows->row[i];
    return NULL;
}

const cln_tune_row *cln_tune_rows_find(const cln_tune_rows *rows, const char *device,
                                       const char *driver, const char *network)
{
    const cln_tune_row *row = last_row(rows, device, driver, network), *without = NULL;
    const size_t decoder = strcspn(network, "-"); /* of voxels: their name without one */
    char bare[32];

    if (network[0] != 'X' || !network[decoder] || decoder >= sizeof bare)
        return row;
    snprintf(bare, sizeof bare, "%.*s", (int)decoder, network);
    without = last_row(rows, device, driver, bare);
    return !row || (without > row && matches(row->network, bare)) ? without : row;
}

void cln_tune_row_apply(const cln_tune_row *row, cln_tune *tune)
{
    CLN_ASSERT(parse_list(CLN_INTERNAL, row->file, row->list, tune) == CLN_OK);
}

/* ---- writing rows ---- */

/* Makes a pattern that matches a name: characters with a meaning in a row become a `?`. */
static void as_pattern(const char *name, char out[160])
{
    part(&name, 0, out, 160);
    for (char *c = out; *c; c++)
        if (strchr("*?[]\\|#\n\r", *c))
            *c = '?';
}

void cln_tune_row_text(const cln_device_info *info, const char *network, const cln_tune *tune,
                       const char *comment, char out[1024])
{
    char device[160], driver[160], list[CLN_TUNE_TEXT];

    as_pattern(info->name, device);
    as_pattern(info->driver, driver);
    cln_tune_text(tune, list);
    snprintf(out, 1024, "%s | %s | %s | %s  # %s", device, driver, network, list, comment);
}

static const char header[] =
    "# Tuning rows of cl-nascent (docs/formats.md): DEVICE | DRIVER | NETWORK | parameters.\n"
    "# The first three are shell patterns; of several rows that match, the last counts.\n";

cln_status cln_tune_row_put(const char *path, const char *line)
{
    cln_status st = CLN_OK;
    cln_tune_rows *rows = NULL;
    cln_tune_row ours = {0}, other = {0};
    char *text = NULL, *kept = NULL, *one = NULL, *folder = NULL, *slash = NULL;
    size_t bytes = 0, used = 0;
    bool found = false;

    CLN_TRY(parse_row("the new row", 1, line, &ours, &found));
    CLN_ASSERT(found);
    if (cln_is_file(path)) {
        CLN_TRY(cln_tune_rows_read(path, &rows));
        CLN_TRY(cln_read_file(path, MAX_BYTES, &text, &bytes));
    } else {
        CLN_TRY(cln_strdup(&folder, path));
        slash = strrchr(folder, '/');
        if (slash && slash != folder) {
            *slash = 0;
            CLN_TRY(cln_make_dirs(folder));
        }
        CLN_TRY(cln_strdup(&text, header));
        bytes = strlen(text);
    }
    CLN_TRY(cln_alloc(&kept, bytes + strlen(line) + 3, 1, path));
    for (const char *at = text; *at;) {
        const size_t length = strcspn(at, "\n");

        free(one);
        one = NULL;
        CLN_TRY(cln_asprintf(&one, "%.*s", (int)length, at));
        CLN_TRY(parse_row(path, 0, one, &other, &found));
        if (!found || strcmp(other.device, ours.device) != 0 ||
            strcmp(other.driver, ours.driver) != 0 || strcmp(other.network, ours.network) != 0)
            used += (size_t)sprintf(kept + used, "%s\n", one);
        at += length + (at[length] == '\n');
    }
    used += (size_t)sprintf(kept + used, "%s\n", line);
    CLN_TRY(cln_write_file(path, kept, used));
done:
    cln_tune_rows_free(rows);
    free(text);
    free(kept);
    free(one);
    free(folder);
    return st;
}
