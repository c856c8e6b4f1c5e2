/* Text in CSV files (RFC 4180): names of devices and runs may have commas and quotes. */
#ifndef BENCH_CSV_H
#define BENCH_CSV_H

#include <stdio.h>

static inline void csv_text(FILE *to, const char *text)
{
    fputc('"', to);
    for (; *text; text++) {
        if (*text == '"')
            fputc('"', to);
        fputc(*text, to);
    }
    fputc('"', to);
}

#endif
