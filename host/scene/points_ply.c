/* The points of a PLY file, ASCII or binary little-endian: its first element, `vertex`, with x, y,
 * z and where it has them red, green, blue; its other properties, and elements behind it, are
 * passed over. Of structure from motion, as nerfstudio keeps them: in how many images they are is
 * not told. Points of depth sensors have NaN, or zeros, where nothing was measured. */
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/log.h"
#include "base/memory.h"
#include "base/text.h"
#include "io/cursor.h"
#include "scene/dataset.h"

enum { MOST_PROPERTIES = 256, MOST_POINTS = 50000000 };
static const size_t MAX_BYTES = (size_t)4 << 30;
static const double FARTHEST = 1e12;
/* Points at the origin are told from so many on, if they are such a share of all. */
enum { ZEROS_LEAST = 21 };
static const double ZEROS_SHARE = 0.01;

typedef enum kind { I8, U8, I16, U16, I32, U32, F32, F64, KINDS } kind;
static const struct {
    const char *names[2];
    size_t bytes;
} kinds[KINDS] = {
    [I8] = {{"char", "int8"}, 1},      [U8] = {{"uchar", "uint8"}, 1},
    [I16] = {{"short", "int16"}, 2},   [U16] = {{"ushort", "uint16"}, 2},
    [I32] = {{"int", "int32"}, 4},     [U32] = {{"uint", "uint32"}, 4},
    [F32] = {{"float", "float32"}, 4}, [F64] = {{"double", "float64"}, 8},
};

static const char *const meanings[6] = {"x", "y", "z", "red", "green", "blue"};

typedef struct vertices {
    bool ascii;
    double count;
    int properties;
    kind kinds[MOST_PROPERTIES];
    int meaning[6]; /* the property that has it; -1: none */
    size_t row;     /* bytes, if binary */
} vertices;

static cln_status bad_header(const cln_cursor *c, const char *what)
{
    return cln_fail(CLN_INPUT,
                    "%s: line %d: %s; it must be an ASCII or little-endian PLY file whose first "
                    "element is vertex, with x, y and z",
                    c->path, c->line, what);
}

static bool is_next(char **at, const char *word)
{
    char *found = NULL;

    return cln_field_word(at, &found) && strcmp(found, word) == 0;
}

static cln_status add_property(const cln_cursor *c, char *rest, vertices *v)
{
    char *type = NULL, *name = NULL;
    int k = 0;

    if (!cln_field_word(&rest, &type) || !cln_field_word(&rest, &name))
        return bad_header(c, "a property without type or name");
    while (k < KINDS && strcmp(type, kinds[k].names[0]) != 0 &&
           strcmp(type, kinds[k].names[1]) != 0)
        k++;
    if (k == KINDS || v->properties == MOST_PROPERTIES)
        return bad_header(c, k == KINDS ? "a vertex has a property that is not a number"
                                        : "a vertex has more than 256 properties");
    for (int m = 0; m < 6; m++)
        if (strcmp(name, meanings[m]) == 0)
            v->meaning[m] = v->properties;
    v->kinds[v->properties++] = (kind)k;
    v->row += kinds[k].bytes;
    return CLN_OK;
}

static cln_status read_header(cln_cursor *c, vertices *v)
{
    cln_status st = CLN_OK;
    char *line = cln_cursor_line(c), *format = NULL;
    int elements = 0;

    if (!line || strcmp(line, "ply") != 0)
        return cln_fail(CLN_INPUT,
                        "%s: not a PLY file, its first line is not ply; export the points again",
                        c->path);
    line = cln_cursor_line(c);
    if (!line || !is_next(&line, "format") || !cln_field_word(&line, &format) ||
        (strcmp(format, "ascii") != 0 && strcmp(format, "binary_little_endian") != 0))
        return bad_header(c, "not a format that is read");
    v->ascii = strcmp(format, "ascii") == 0;
    for (;;) {
        char *word = NULL;

        line = cln_cursor_line(c);
        if (!line)
            return bad_header(c, "the file ends within its header");
        if (!cln_field_word(&line, &word) || strcmp(word, "comment") == 0 ||
            strcmp(word, "obj_info") == 0)
            continue;
        if (strcmp(word, "end_header") == 0)
            break;
        if (strcmp(word, "element") == 0) {
            if (elements++ == 0 &&
                (!is_next(&line, "vertex") || !cln_field_whole(&line, MOST_POINTS, &v->count)))
                return bad_header(c, "not an element vertex of at most 50 million points");
        } else if (strcmp(word, "property") != 0 || elements == 0) {
            return bad_header(c, "neither an element nor its property");
        } else if (elements == 1) {
            CLN_TRY(add_property(c, line, v));
        }
    }
    for (int m = 0; m < 3; m++)
        if (v->meaning[m] < 0)
            return bad_header(c, "a vertex has no x, y or z");
done:
    return st;
}

static double number_of(kind k, const char *at)
{
    int8_t i8;
    int16_t i16;
    uint16_t u16;
    int32_t i32;
    uint32_t u32;
    float f32;
    double f64;

    switch (k) {
    case I8:
        return memcpy(&i8, at, 1), i8;
    case U8:
        return *(const uint8_t *)at;
    case I16:
        return memcpy(&i16, at, 2), i16;
    case U16:
        return memcpy(&u16, at, 2), u16;
    case I32:
        return memcpy(&i32, at, 4), i32;
    case U32:
        return memcpy(&u32, at, 4), u32;
    case F32:
        return memcpy(&f32, at, 4), (double)f32;
    case F64:
        return memcpy(&f64, at, 8), f64;
    case KINDS:
        break;
    }
    return 0;
}

/* The next number of a line, or what C, Python and C++ libraries print for one that is none. */
static bool read_value(char **line, double *out)
{
    char *word = NULL;

    if (cln_field_number(line, out))
        return true;
    if (!cln_field_word(line, &word))
        return false;
    word += *word == '-' || *word == '+';
    *out = strncasecmp(word, "inf", 3) == 0 ? INFINITY : NAN;
    return strncasecmp(word, "nan", 3) == 0 || strcasecmp(word, "inf") == 0 ||
           strcasecmp(word, "infinity") == 0;
}

/* The numbers of the next vertex, one a property. */
static cln_status read_row(cln_cursor *c, const vertices *v, int index, double *numbers)
{
    char *line = NULL;

    if (!v->ascii) {
        for (int i = 0; i < v->properties; i++) {
            numbers[i] = number_of(v->kinds[i], c->data + c->at);
            c->at += kinds[v->kinds[i]].bytes;
        }
        return CLN_OK;
    }
    line = cln_cursor_line(c);
    if (!line)
        return cln_fail(CLN_INPUT, "%s: the file ends after %d of its %.0f points; copy it again",
                        c->path, index, v->count);
    for (int i = 0; i < v->properties; i++)
        if (!read_value(&line, &numbers[i]))
            return cln_fail(CLN_INPUT,
                            "%s: line %d has no %d numbers; correct it, or export the points again",
                            c->path, c->line, v->properties);
    return CLN_OK;
}

/* Tells of points without a place, which were left out, and of those that have none but say 0. */
static cln_status tell_unplaced(const char *path, const cln_reader_result *result, int count)
{
    const int kept = result->point_count, left = count - kept;
    int zeros = 0;

    if (left > 0 && kept == 0)
        return cln_fail(CLN_INPUT,
                        "%s: none of its %d points has a place (NaN or infinite); export the "
                        "points again",
                        path, count);
    if (left > 0)
        cln_info("%s: %d of its %d points %s no place (NaN or infinite) and %s left out", path,
                 left, count, cln_plural(left, "has", "have"), cln_plural(left, "is", "are"));
    for (int i = 0; i < kept; i++) {
        const double *at = result->points[i].xyz;

        zeros += at[0] == 0 && at[1] == 0 && at[2] == 0;
    }
    if (zeros >= ZEROS_LEAST && zeros >= ZEROS_SHARE * kept)
        cln_warn("%s: %d of its %d points are exactly at the origin, as sensors write where they "
                 "measured nothing; they widen the cube: leave them out of the file, or give "
                 "--bbox",
                 path, zeros, kept);
    return CLN_OK;
}

cln_status cln_dataset_read_ply(const char *path, cln_reader_result *result)
{
    cln_status st = CLN_OK;
    cln_cursor c = {.path = path};
    vertices v = {.meaning = {-1, -1, -1, -1, -1, -1}};
    double numbers[MOST_PROPERTIES];

    CLN_TRY(cln_read_file(path, MAX_BYTES, &c.data, &c.size));
    CLN_TRY(read_header(&c, &v));
    /* a last line need not end, so the cursor may be one behind the end */
    if (v.count * (v.ascii ? 2.0 * v.properties : (double)v.row) >
        (double)c.size - (double)c.at + v.ascii)
        CLN_TRY(cln_fail(
            CLN_INPUT, "%s: the file is too short for the %.0f points of its header; copy it again",
            path, v.count));
    CLN_TRY(cln_alloc(&result->points, (size_t)v.count, sizeof *result->points, "points"));
    for (int n = 0; n < (int)v.count; n++) {
        cln_point *point = &result->points[result->point_count];
        bool placed = true;

        CLN_TRY(read_row(&c, &v, n, numbers));
        for (int m = 0; m < 3; m++) {
            point->xyz[m] = numbers[v.meaning[m]];
            placed = placed && isfinite(point->xyz[m]);
            if (isfinite(point->xyz[m]) && fabs(point->xyz[m]) > FARTHEST)
                CLN_TRY(cln_fail(CLN_INPUT,
                                 "%s: point %d is at %g, which is nowhere; correct it, or export "
                                 "the points again",
                                 path, n, point->xyz[m]));
            if (v.meaning[3 + m] >= 0)
                point->rgb[m] = (uint8_t)fmax(0, fmin(255, numbers[v.meaning[3 + m]]));
        }
        result->point_count += placed;
    }
    CLN_TRY(tell_unplaced(path, result, (int)v.count));
done:
    free(c.data);
    return st;
}
