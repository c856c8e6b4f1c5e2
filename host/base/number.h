/* Numbers from and to text in the C locale, whatever LC_NUMERIC is, with the units of options. The
 * readers return false for other text; the caller writes the sentence (base/config.h). Also sorts
 * numbers. */
#ifndef CLN_NUMBER_H
#define CLN_NUMBER_H

#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>

enum { CLN_NUMBER_BYTES = 40 };

/* snprintf and vsnprintf with decimal points: for numbers that programs read, also those that a
 * sentence advises to give. Other numbers of sentences are as the caller's locale has them. */
int cln_format(char *out, size_t bytes, const char *fmt, ...) __attribute__((format(printf, 3, 4)));
int cln_format_list(char *out, size_t bytes, const char *fmt, va_list args)
    __attribute__((format(printf, 3, 0)));

/* Shortest decimal text that reads back as the same double. */
void cln_number_write(double value, char out[CLN_NUMBER_BYTES]);

/* Reads a finite decimal number at the start of text; *end points after it. False for spaces,
 * hexadecimal, "nan" and "inf", which would surprise in settings. */
bool cln_number_read(const char *text, double *value, const char **end);

/* Read a whole text: a decimal integer; seconds >= 0, as 90, 90s, 10m or 10min, 2h, 1h30m, 1:30 or
 * 1:02:03; bytes >= 0, with an optional unit K, M, G or T (powers of 1024), also in small letters
 * and as KiB or KB. *has_unit (may be NULL): whether there is a unit or a colon. */
bool cln_integer_read(const char *text, long long *value);
bool cln_seconds_read(const char *text, double *seconds, bool *has_unit);
bool cln_bytes_read(const char *text, double *bytes);

/* Reads exactly `count` numbers, comma separated. On false *out stays as it is. */
bool cln_reals_read(const char *text, int count, double *out);

/* Significant digits, for %.*g, with which all values keep lengths of `least` to a thousandth: at
 * least 4, at most 17. */
int cln_reals_digits(int count, const double *values, double least);

/* A box {x, y, z, x, y, z} as options take it, in such digits. */
enum { CLN_BOX_BYTES = 160 };
void cln_box_write(const double box[6], double least, char out[CLN_BOX_BYTES]);

/* Sort ascending; no NaN allowed. */
void cln_reals_sort(double *values, int count);
void cln_floats_sort(float *values, size_t count);
/* Moves the `first` smallest to the front, in an order that depends on the values alone. None may
 * be NaN. */
void cln_reals_split(double *values, size_t count, size_t first);

#endif
