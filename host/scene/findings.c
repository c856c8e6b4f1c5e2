/* Findings as JSON. See findings.h. */
#include "scene/findings.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include "base/text.h"

enum { NAMED = 5 };

/* Takes off a character at the end that was cut, which JSON would refuse. */
static void end_whole(char *text)
{
    text[cln_utf8_whole(text, strlen(text))] = 0;
}

void cln_found_fault(json_t *findings, const char *what, bool likely_fault, json_t *views,
                     const char *fmt, ...)
{
    char text[2048];
    va_list args;

    va_start(args, fmt);
    vsnprintf(text, sizeof text, fmt, args);
    va_end(args);
    end_whole(text);
    cln_utf8_repair(text); /* paths may be anything */
    json_array_append_new(findings, json_pack("{s:s, s:b, s:o, s:s}", "what", what, "likely_fault",
                                              likely_fault, "views", views ? views : json_array(),
                                              "text", text));
}

bool cln_findings_take_back(json_t *findings, const char *what)
{
    const size_t count = json_array_size(findings);

    for (size_t i = count; i-- > 0;)
        if (!strcmp(json_string_value(json_object_get(json_array_get(findings, i), "what")), what))
            json_array_remove(findings, i);
    return json_array_size(findings) < count;
}

const char *cln_findings_names(const json_t *views, char *out, size_t bytes)
{
    const size_t count = json_array_size(views);
    size_t used = 0;

    out[0] = 0;
    for (size_t i = 0; i < count && i < NAMED && used < bytes; i++)
        used += (size_t)snprintf(out + used, bytes - used, "%s%s", i ? ", " : "",
                                 json_string_value(json_array_get(views, i)));
    if (count > NAMED && used < bytes)
        snprintf(out + used, bytes - used, " and %zu more", count - NAMED);
    end_whole(out);
    return out;
}

const char *cln_findings_pairs(const json_t *views, char *out, size_t bytes)
{
    const size_t count = json_array_size(views) / 2;
    size_t used = 0;

    out[0] = 0;
    for (size_t i = 0; i < count && i < NAMED && used < bytes; i++)
        used += (size_t)snprintf(out + used, bytes - used, "%s%s and %s", i ? "; " : "",
                                 json_string_value(json_array_get(views, 2 * i)),
                                 json_string_value(json_array_get(views, 2 * i + 1)));
    if (count > NAMED && used < bytes)
        snprintf(out + used, bytes - used, "; and %zu more pair%s", count - NAMED,
                 cln_plural((double)(count - NAMED), "", "s"));
    end_whole(out);
    return out;
}
