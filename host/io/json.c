/* JSON through jansson, and the relaxed dialect of instant-ngp's files. See json.h.
 *
 * Relaxed text is cleaned in place before jansson sees it: comments (but not their newlines) and
 * trailing commas become blanks, NaN a string, so jansson's line and column are the file's. */
#include "io/json.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include "base/files.h"
#include "base/memory.h"
#include "io/progress.h"

static const size_t MAX_BYTES = (size_t)512 << 20; /* 100,000 frames take about 100 MB */

json_t *cln_json_real(double value)
{
    return isfinite(value) ? json_real(value) : json_null();
}

json_t *cln_json_whole(double value)
{
    return isfinite(value) ? json_integer((json_int_t)ceil(value)) : json_null();
}

double cln_json_digits(float value)
{
    return round(value * 1e7) / 1e7;
}

double cln_json_number(const json_t *object, const char *key)
{
    const json_t *value = json_object_get(object, key);

    return json_is_number(value) ? json_number_value(value) : NAN;
}

const char *cln_json_text(const json_t *object, const char *key)
{
    const char *text = json_string_value(json_object_get(object, key));

    return text ? text : "";
}

static bool has_text(const json_t *list, const char *text)
{
    for (size_t i = 0; i < json_array_size(list); i++) {
        const char *other = json_string_value(json_array_get(list, i));

        if (other && strcmp(other, text) == 0)
            return true;
    }
    return false;
}

void cln_json_add_warned(json_t *document, const cln_warned *warned)
{
    json_t *list = json_object_get(document, "warnings");

    if (!json_is_array(list)) {
        json_object_set_new(document, "warnings", json_array());
        list = json_object_get(document, "warnings");
    }
    for (int i = 0; i < warned->count; i++) {
        if (!has_text(list, warned->lines[i]))
            json_array_append_new(list, json_string(warned->lines[i]));
    }
}

/* Index after the closing quote of the string literal that opens at `at`, or bytes. */
static size_t skip_string(const char *text, size_t bytes, size_t at)
{
    for (at++; at < bytes && text[at] != '"' && text[at] != '\n'; at++)
        if (text[at] == '\\')
            at++;
    return at < bytes ? at + 1 : bytes;
}

static cln_status open_comment(const char *path, const char *text, size_t at)
{
    int line = 1, column = 1;

    for (size_t i = 0; i < at; i++) {
        column = text[i] == '\n' ? 1 : column + 1;
        line += text[i] == '\n';
    }
    return cln_fail(CLN_INPUT, "%s: line %d column %d: comment is not closed; add */", path, line,
                    column);
}

/* Blanks comments, one blank per UTF-8 character, as jansson's columns count characters; *bytes may
 * shrink. */
static cln_status blank_comments(const char *path, char *text, size_t *bytes)
{
    size_t out = 0, at = 0;
    const size_t end = *bytes;

    while (at < end) {
        if (text[at] == '"') {
            const size_t after = skip_string(text, end, at);

            memmove(text + out, text + at, after - at);
            out += after - at;
            at = after;
        } else if (text[at] == '/' && at + 1 < end &&
                   (text[at + 1] == '/' || text[at + 1] == '*')) {
            const bool block = text[at + 1] == '*';
            const size_t start = at;

            for (at += 2; at < end; at++)
                if (block ? text[at] == '*' && at + 1 < end && text[at + 1] == '/'
                          : text[at] == '\n')
                    break;
            if (block && at >= end)
                return open_comment(path, text, start);
            at += block ? 2 : 0;
            for (size_t i = start; i < at; i++)
                if (text[i] == '\n' || ((unsigned char)text[i] & 0xC0) != 0x80)
                    text[out++] = text[i] == '\n' ? '\n' : ' ';
        } else {
            text[out++] = text[at++];
        }
    }
    text[out] = 0;
    *bytes = out;
    return CLN_OK;
}

/* Blanks commas between a value and a closing bracket; "[,]" stays an error. */
static void blank_trailing_commas(char *text, size_t bytes)
{
    size_t last = 0;               /* index of the last significant byte */
    char before = 0, previous = 0; /* the significant bytes: before, previous (at last), this */

    for (size_t at = 0; at < bytes; at++) {
        const char c = text[at];

        if (c == ' ' || c == '\t' || c == '\n' || c == '\r')
            continue;
        if ((c == ']' || c == '}') && previous == ',' && before && !strchr("[{,:", before))
            text[last] = ' ';
        if (c == '"')
            at = skip_string(text, bytes, at) - 1;
        before = previous;
        previous = c;
        last = at;
    }
}

static const char *const no_numbers[] = {"NaN", "Infinity", "-Infinity", "inf", "-inf"};
enum { NO_NUMBERS = sizeof no_numbers / sizeof *no_numbers };

const char *cln_json_not_finite(const json_t *value)
{
    const char *text = json_string_value(value);

    for (int i = 0; i < NO_NUMBERS && text; i++)
        if (strlen(text) + 2 == strlen(no_numbers[i]) &&
            strncasecmp(text, no_numbers[i] + 1, strlen(text)) == 0)
            return no_numbers[i];
    return NULL;
}

/* NaN and infinities, which Python writes and JSON does not have, become strings of the same
 * length: the reader of the value then says where it stands and that it is not a number. */
static void quote_no_numbers(char *text, size_t bytes)
{
    for (size_t at = 0; at < bytes; at++) {
        if (text[at] == '"') {
            at = skip_string(text, bytes, at) - 1;
            continue;
        }
        for (int i = 0; i < NO_NUMBERS; i++) {
            const size_t n = strlen(no_numbers[i]);

            if (n > bytes - at || strncasecmp(text + at, no_numbers[i], n) != 0 ||
                (at + n < bytes && !strchr(",]} \t\r\n", text[at + n])))
                continue;
            text[at] = text[at + n - 1] = '"';
            at += n - 1;
            break;
        }
    }
}

/* What jansson takes at most for a text: a short one of many brackets takes 45 times its size. */
static double bytes_of_values(const char *text, size_t bytes)
{
    enum { VALUE = 48, ARRAY = 128, OBJECT = 400 };
    double sum = (double)bytes;

    for (size_t i = 0; i < bytes; i++)
        sum += text[i] == ',' ? VALUE : text[i] == '[' ? ARRAY : text[i] == '{' ? OBJECT : 0;
    return sum;
}

static cln_status check_memory(const char *path, const char *text, size_t bytes)
{
    static const double SMALL = 64 << 20;
    const double need = bytes_of_values(text, bytes);
    char needed[32];

    if (need < SMALL || need < cln_available_memory(""))
        return CLN_OK;
    cln_format_bytes(need, needed);
    return cln_fail(CLN_MEMORY, "%s: its values may take %s of memory, and there is not so much",
                    path, needed);
}

static cln_status read_json(const char *path, size_t most, bool relaxed, json_t **out)
{
    cln_status st = CLN_OK;
    char *text = NULL;
    size_t bytes = 0;
    json_error_t error;

    *out = NULL;
    CLN_TRY(cln_read_file(path, most, &text, &bytes));
    if (bytes >= 3 && !memcmp(text, "\xEF\xBB\xBF", 3)) /* byte order mark of Windows editors */
        memset(text, ' ', 3);
    if (relaxed) {
        CLN_TRY(blank_comments(path, text, &bytes));
        blank_trailing_commas(text, bytes);
        quote_no_numbers(text, bytes);
    }
    CLN_TRY(check_memory(path, text, bytes));
    *out = json_loadb(text, bytes, 0, &error);
    if (!*out && cln_is_utf16(text, bytes))
        CLN_TRY(cln_fail(CLN_INPUT, "%s: is UTF-16; save it as UTF-8", path));
    if (!*out && (error.line < 0 || json_error_code(&error) == json_error_out_of_memory))
        CLN_TRY(cln_fail(CLN_MEMORY, "%s: no host memory for its contents", path));
    if (!*out && strspn(text, " \t\r\n") == bytes)
        CLN_TRY(
            cln_fail(CLN_INPUT, "%s: line 1: the file is empty; copy or export it again", path));
    if (!*out && json_error_code(&error) == json_error_invalid_utf8)
        CLN_TRY(cln_fail(CLN_INPUT,
                         "%s: line %d is not UTF-8, as JSON must be: save the file in UTF-8 (an "
                         "older editor's: iconv -f CP1252 -t UTF-8)",
                         path, error.line));
    if (!*out)
        CLN_TRY(cln_fail(CLN_INPUT, "%s: line %d column %d: %s; correct it there%s", path,
                         error.line, error.column, error.text,
                         strncmp(error.text, "invalid escape", 14) == 0
                             ? " (a backslash is written twice in JSON; in paths / does, too)"
                             : ""));
done:
    free(text);
    return st;
}

cln_status cln_json_read(const char *path, bool relaxed, json_t **out)
{
    return read_json(path, MAX_BYTES, relaxed, out);
}

cln_status cln_json_read_large(const char *path, size_t most, json_t **out)
{
    return read_json(path, most, false, out);
}
