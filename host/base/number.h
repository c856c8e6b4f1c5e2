/* Numbers from and to text in the C locale, whatever LC_NUMERIC says, with the units that options
 * take. The readers only tell whether a text is a number; the caller writes the sentence
 * (base/config.h). */
#ifndef CLN_NUMBER_H
#define CLN_NUMBER_H

#include <stdbool.h>

enum { CLN_NUMBER_BYTES = 40 };

/* Shortest decimal text that reads back as the same double. */
void cln_number_write(double value, char out[CLN_NUMBER_BYTES]);

/* Reads a finite decimal number from the front of text; *end points behind it. False if there is
 * none: no spaces, hexadecimal, "nan" or "inf", which would surprise in settings. */
bool cln_number_read(const char *text, double *value, const char **end);

/* A whole text: decimal integer; seconds >= 0 with s, m or h behind; bytes >= 0 with K, M, G or T
 * (1024 each). has_unit (may be NULL) tells whether there was a unit. */
bool cln_integer_read(const char *text, long long *value);
bool cln_seconds_read(const char *text, double *seconds, bool *has_unit);
bool cln_bytes_read(const char *text, double *bytes);

/* Exactly `count` numbers, comma separated. On false *out is untouched. */
bool cln_reals_read(const char *text, int count, double *out);

/* Ascending; none of them NaN. */
void cln_reals_sort(double *values, int count);

#endif
