/* Escaping and base64. See html.h. */
#include "report/html.h"

#include "base/text.h"

void cln_html_text(FILE *to, const char *text)
{
    for (; text && *text; text++) {
        unsigned char c = (unsigned char)*text;

        if (c == '&')
            fputs("&amp;", to);
        else if (c == '<')
            fputs("&lt;", to);
        else if (c == '>')
            fputs("&gt;", to);
        else if (c == '"')
            fputs("&quot;", to);
        else if (c == '\'')
            fputs("&#39;", to);
        else if ((c < 32 && c != '\n' && c != '\t') || c == 127)
            fputs("&#xFFFD;", to);
        else {
            const int bytes = cln_utf8_bytes(text);

            if (!bytes)
                fputs("&#xFFFD;", to);
            fwrite(text, 1, (size_t)bytes, to);
            text += bytes ? bytes - 1 : 0;
        }
    }
}

void cln_base64_write(FILE *to, const uint8_t *data, size_t bytes)
{
    static const char digits[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";

    for (size_t i = 0; i < bytes; i += 3) {
        size_t left = bytes - i;
        uint32_t group = (uint32_t)data[i] << 16;

        if (left > 1)
            group |= (uint32_t)data[i + 1] << 8;
        if (left > 2)
            group |= data[i + 2];
        fputc(digits[group >> 18], to);
        fputc(digits[group >> 12 & 63], to);
        fputc(left > 1 ? digits[group >> 6 & 63] : '=', to);
        fputc(left > 2 ? digits[group & 63] : '=', to);
    }
}
