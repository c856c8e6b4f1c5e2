/* Texts that look alike: a letter with its mark may be one character (NFC), or the letter and then
 * the mark (NFD), as Macs write names of files. By utf8proc; a program built without it knows no
 * other form. */
#ifndef CLN_UNICODE_H
#define CLN_UNICODE_H

#include <stdbool.h>

/* The text composed (NFC) or decomposed (NFD), if that differs from it, else NULL; the caller frees
 * it. NULL, too, if it is no UTF-8. */
char *cln_unicode_form(const char *text, bool composed);

/* The text without differences of case, as names of files that a file system may take for one; NULL
 * if it is no UTF-8, or where that is not known. The caller frees it. */
char *cln_unicode_fold(const char *text);

#endif
