/* Edit distance by dynamic programming over prefixes (optimal string alignment: Levenshtein's with
 * swaps), UTF-8, words for a shell, and an order of names. See text.h. */
#include "base/text.h"

#include <ctype.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>

int cln_edit_distance(const char *a, const char *b)
{
    enum { MAX = 63 };
    int cost[MAX + 1][MAX + 1];
    int na = (int)strnlen(a, MAX), nb = (int)strnlen(b, MAX);

    for (int i = 0; i <= na; i++) {
        for (int j = 0; j <= nb; j++) {
            int best = i + j; /* right for the first row and column */

            if (i > 0 && j > 0) {
                best = cost[i - 1][j - 1] + (a[i - 1] != b[j - 1]);
                if (cost[i - 1][j] + 1 < best)
                    best = cost[i - 1][j] + 1;
                if (cost[i][j - 1] + 1 < best)
                    best = cost[i][j - 1] + 1;
                if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] &&
                    cost[i - 2][j - 2] + 1 < best)
                    best = cost[i - 2][j - 2] + 1;
            }
            cost[i][j] = best;
        }
    }
    return cost[na][nb];
}

int cln_utf8_bytes(const char *at)
{
    static const uint32_t least[] = {0, 0, 0x80, 0x800, 0x10000}; /* overlong forms are invalid */
    const unsigned char first = (unsigned char)*at;
    const int bytes = first < 0x80 ? 1 : first < 0xC0 ? 0 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    uint32_t code = bytes == 1 ? first : first & (0xFFu >> (bytes + 1));

    for (int i = 1; i < bytes; i++) {
        if (((unsigned char)at[i] & 0xC0) != 0x80)
            return 0;
        code = code << 6 | ((unsigned char)at[i] & 0x3F);
    }
    if (first >= 0xF8 || code < least[bytes] || code > 0x10FFFF ||
        (code >= 0xD800 && code <= 0xDFFF))
        return 0;
    return bytes;
}

bool cln_utf8_valid(const char *text)
{
    while (*text && cln_utf8_bytes(text))
        text += cln_utf8_bytes(text);
    return !*text;
}

size_t cln_utf8_whole(const char *text, size_t most)
{
    const size_t length = strnlen(text, most);
    size_t first = length; /* of the last character, once below */

    while (first > 0 && length - first < 3 && ((unsigned char)text[first - 1] & 0xC0) == 0x80)
        first--;
    if (first > 0) {
        const unsigned char lead = (unsigned char)text[first - 1];
        const size_t bytes = lead < 0xC0 ? 0 : lead < 0xE0 ? 2 : lead < 0xF0 ? 3 : 4;

        if (bytes > length - first + 1)
            return first - 1;
    }
    return length;
}

void cln_listed_add(cln_listed *listed, int most, const char *fmt, ...)
{
    enum { ONE = 160 };
    const size_t used = strlen(listed->text);
    char one[ONE];
    va_list args;

    if (listed->count++ > most)
        return;
    va_start(args, fmt);
    vsnprintf(one, sizeof one, fmt, args);
    va_end(args);
    one[cln_utf8_whole(one, ONE - 1)] = 0;
    (void)snprintf(listed->text + used, CLN_LISTED_BYTES - used, "%s%s", used ? ", " : "",
                   listed->count > most ? "..." : one);
    listed->text[cln_utf8_whole(listed->text, CLN_LISTED_BYTES - 1)] = 0;
}

void cln_utf8_repair(char *text)
{
    while (*text) {
        const int bytes = cln_utf8_bytes(text);

        if (!bytes)
            *text = '?';
        text += bytes ? bytes : 1;
    }
}

/* Bytes of the control character that begins here, 0 for another: of ASCII but a tab, of Latin-1
 * (U+0080..9F: some terminals obey them), or one that ends a line or turns the direction of text
 * (U+2028..2E, U+2066..69). */
static int control_bytes(const unsigned char *c)
{
    if ((c[0] < 0x20 && c[0] != '\t') || c[0] == 0x7f)
        return 1;
    if (c[0] == 0xC2 && c[1] >= 0x80 && c[1] < 0xA0)
        return 2;
    if (c[0] == 0xE2 && ((c[1] == 0x80 && c[2] >= 0xA8 && c[2] <= 0xAE) ||
                         (c[1] == 0x81 && c[2] >= 0xA6 && c[2] <= 0xA9)))
        return 3;
    return 0;
}

void cln_text_plain(char *text)
{
    while (*text) {
        const int bytes = control_bytes((const unsigned char *)text);

        memset(text, '?', (size_t)bytes);
        text += bytes ? bytes : 1;
    }
}

const char *cln_shell_quote(const char *text, char *out, size_t bytes)
{
    bool plain = *text != 0;
    size_t used = 0;

    for (const char *c = text; *c && plain;
         c++) /* characters beyond ASCII mean nothing to a shell */
        plain = (unsigned char)*c >= 0x80 || isalnum((unsigned char)*c) || strchr("_./:=,+@%-", *c);
    if (4 * strlen(text) + 3 > bytes) {
        snprintf(out, bytes, "...");
        return out;
    }
    if (!plain)
        out[used++] = '\'';
    for (; *text; text++) {
        if (*text == '\'') {
            memcpy(out + used, "'\\''", 4);
            used += 4;
        } else {
            out[used++] = *text;
        }
    }
    if (!plain)
        out[used++] = '\'';
    out[used] = 0;
    return out;
}

char *cln_trim_blanks(char *line)
{
    char *end = NULL;

    line += strspn(line, " \t\r");
    end = line + strlen(line);
    while (end > line && strchr(" \t\r", end[-1]))
        end--;
    *end = 0;
    return line;
}

char *cln_trim(char *line)
{
    char *end = line;

    while (*end && !(*end == '#' && (end == line || strchr(" \t", end[-1]))))
        end++;
    *end = 0;
    return cln_trim_blanks(line);
}

bool cln_ends_with(const char *text, const char *end)
{
    const size_t length = strlen(text), n = strlen(end);

    return length >= n && strcmp(text + length - n, end) == 0;
}

void cln_format_span(int least, int most, char out[CLN_SPAN_BYTES])
{
    if (least == most)
        snprintf(out, CLN_SPAN_BYTES, "%d", most);
    else
        snprintf(out, CLN_SPAN_BYTES, "%d to %d", least, most);
}

const char *cln_plural(double count, const char *one, const char *more)
{
    return count == 1 ? one : more;
}

int cln_natural_compare(const char *a, const char *b)
{
    const char *first = a, *second = b;

    while (*a && *b) {
        if (isdigit((unsigned char)*a) && isdigit((unsigned char)*b)) {
            size_t length_a = 0, length_b = 0;
            int order = 0;

            a += strspn(a, "0");
            b += strspn(b, "0");
            length_a = strspn(a, "0123456789");
            length_b = strspn(b, "0123456789");
            if (length_a != length_b)
                return length_a < length_b ? -1 : 1;
            order = strncmp(a, b, length_a);
            if (order)
                return order;
            a += length_a;
            b += length_b;
        } else if (*a != *b) {
            break;
        } else {
            a++;
            b++;
        }
    }
    if (*a != *b)
        return (unsigned char)*a < (unsigned char)*b ? -1 : 1;
    return strcmp(first, second); /* "r_1" and "r_01" */
}

size_t cln_folder_length(const char *path)
{
    const char *slash = strrchr(path, '/');

    return slash ? (size_t)(slash - path) : 0;
}

const char *cln_last_name(const char *path)
{
    const char *slash = strrchr(path, '/');

    return slash ? slash + 1 : path;
}

const char *cln_without_dot(const char *path)
{
    while (path[0] == '.' && path[1] == '/')
        path += 2 + strspn(path + 2, "/");
    return path;
}
