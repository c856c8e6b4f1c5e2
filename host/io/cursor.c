/* Reading binary and text from memory, with bounds. See cursor.h. */
#include "io/cursor.h"

#include <math.h>
#include <stdint.h>
#include <string.h>
#include "base/number.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "cursor.c is for little-endian hosts");

static const char blanks[] = " \t\r";

static cln_status cut_off(const cln_cursor *cursor, const char *what)
{
    return cln_fail(CLN_INPUT,
                    "%s: the file ends within %s, after %zu bytes; it is cut off or not of this "
                    "format; copy or export it again",
                    cursor->path, what, cursor->size);
}

cln_status cln_cursor_take(cln_cursor *cursor, const char *what, void *out, size_t bytes)
{
    if (bytes > cursor->size - cursor->at)
        return cut_off(cursor, what);
    memcpy(out, cursor->data + cursor->at, bytes);
    cursor->at += bytes;
    return CLN_OK;
}

cln_status cln_cursor_count(cln_cursor *cursor, const char *what, size_t least, size_t *count)
{
    cln_status st = CLN_OK;
    uint64_t told = 0;

    CLN_TRY(cln_cursor_take(cursor, what, &told, sizeof told));
    if (told > (cursor->size - cursor->at) / least)
        CLN_TRY(
            cln_fail(CLN_INPUT,
                     "%s: it announces %llu %s, but has %zu bytes left; it is cut off or not of "
                     "this format; copy or export it again",
                     cursor->path, (unsigned long long)told, what, cursor->size - cursor->at));
    *count = (size_t)told;
done:
    return st;
}

cln_status cln_cursor_text(cln_cursor *cursor, const char *what, const char **text)
{
    const char *start = cursor->data + cursor->at;
    const char *end = memchr(start, 0, cursor->size - cursor->at);

    if (!end)
        return cut_off(cursor, what);
    *text = start;
    cursor->at += (size_t)(end - start) + 1;
    return CLN_OK;
}

char *cln_cursor_line(cln_cursor *cursor)
{
    char *start = cursor->data + cursor->at, *end = NULL;

    if (cursor->at >= cursor->size)
        return NULL;
    if (cursor->at == 0 && strncmp(start, "\xEF\xBB\xBF", 3) == 0)
        start += 3;
    end = memchr(start, '\n', cursor->size - (size_t)(start - cursor->data));
    if (!end)
        end = cursor->data + cursor->size;
    cursor->at = (size_t)(end - cursor->data) + 1;
    *end = 0;
    if (end > start && end[-1] == '\r')
        end[-1] = 0;
    cursor->line++;
    return start;
}

bool cln_field_word(char **at, char **word)
{
    size_t length = 0;

    *at += strspn(*at, blanks);
    length = strcspn(*at, blanks);
    if (!length)
        return false;
    *word = *at;
    *at += length;
    if (**at)
        *(*at)++ = 0;
    return true;
}

bool cln_field_number(char **at, double *value)
{
    const char *end = NULL;

    *at += strspn(*at, blanks);
    if (!cln_number_read(*at, value, &end) || (*end && !strchr(blanks, *end)))
        return false;
    *at += end - *at;
    return true;
}

bool cln_field_whole(char **at, double most, double *value)
{
    return cln_field_number(at, value) && *value >= 0 && *value <= most && *value == floor(*value);
}
