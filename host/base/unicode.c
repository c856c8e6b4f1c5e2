/* Canonical forms of texts. See unicode.h. */
#include "base/unicode.h"

#include <stddef.h>

#ifdef CLN_WITH_UTF8PROC

#include <stdlib.h>
#include <string.h>
#include <utf8proc.h>

char *cln_unicode_form(const char *text, bool composed)
{
    const utf8proc_uint8_t *in = (const utf8proc_uint8_t *)text;
    char *out = (char *)(composed ? utf8proc_NFC(in) : utf8proc_NFD(in));

    if (out && strcmp(out, text) == 0) {
        free(out);
        out = NULL;
    }
    return out;
}

char *cln_unicode_fold(const char *text)
{
    utf8proc_uint8_t *out = NULL;

    return utf8proc_map((const utf8proc_uint8_t *)text, 0, &out,
                        UTF8PROC_NULLTERM | UTF8PROC_STABLE | UTF8PROC_COMPOSE |
                            UTF8PROC_CASEFOLD) < 0
               ? NULL
               : (char *)out;
}

#else

char *cln_unicode_fold(const char *text)
{
    (void)text;
    return NULL;
}

char *cln_unicode_form(const char *text, bool composed)
{
    (void)text;
    (void)composed;
    return NULL;
}

#endif
