/* What generated pages have in common: escaped text, and pictures inside the page. */
#ifndef CLN_HTML_H
#define CLN_HTML_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

/* Text as character data or attribute value of HTML and SVG: & < > " ' are escaped, control
 * characters and bytes that are not UTF-8 become U+FFFD. NULL writes nothing. */
void cln_html_text(FILE *to, const char *text);

/* Base64 with padding (RFC 4648), no line breaks. */
void cln_base64_write(FILE *to, const uint8_t *data, size_t bytes);

#endif
