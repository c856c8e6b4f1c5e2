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

#else

char *cln_unicode_form(const char *text, bool composed)
{
    (void)text;
    (void)composed;
    return NULL;
}

#endif
