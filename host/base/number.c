/* Numbers as text, independent of the locale. See number.h. */
#include "base/number.h"

#include <ctype.h>
#include <errno.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

int cln_format_list(char *out, size_t bytes, const char *fmt, va_list args)
{
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t before = uselocale(c_locale);
    const int length = vsnprintf(out, bytes, fmt, args);

    uselocale(before);
    freelocale(c_locale);
    return length;
}

int cln_format(char *out, size_t bytes, const char *fmt, ...)
{
    va_list args;
    int length = 0;

    va_start(args, fmt);
    length = cln_format_list(out, bytes, fmt, args);
    va_end(args);
    return length;
}

void cln_number_write(double value, char out[CLN_NUMBER_BYTES])
{
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    locale_t before = uselocale(c_locale);

    for (int digits = 6; digits <= 17; digits++) {
        snprintf(out, CLN_NUMBER_BYTES, "%.*g", digits, value);
        if (strtod(out, NULL) == value)
            break;
    }
    uselocale(before);
    freelocale(c_locale);
}

bool cln_number_read(const char *text, double *value, const char **end)
{
    locale_t c_locale = (locale_t)0;
    size_t length = strspn(text, "+-.0123456789eE");
    char digits[64];
    char *stop = NULL;

    if (length == 0 || length >= sizeof digits)
        return false;
    memcpy(digits, text, length);
    digits[length] = 0;
    c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    *value = strtod_l(digits, &stop, c_locale);
    freelocale(c_locale);
    *end = text + (stop - digits);
    return stop != digits && isfinite(*value);
}

bool cln_integer_read(const char *text, long long *value)
{
    char *end = NULL;

    if (*text == 0 || !strchr("+-0123456789", *text))
        return false;
    errno = 0;
    *value = strtoll(text, &end, 10);
    return errno == 0 && *end == 0 && end != text;
}

/* "1:30" (minutes, seconds) or "1:02:03"; two digits below 60 after each colon. */
static bool read_clock(const char *text, double *seconds)
{
    size_t digits = strspn(text, "0123456789");
    double sum = 0;
    int parts = 1;

    if (digits == 0 || digits > 9)
        return false;
    sum = strtol(text, NULL, 10);
    for (text += digits; *text; text += 3, parts++) {
        if (parts == 3 || *text != ':' || strspn(text + 1, "0123456789") != 2 || text[1] > '5')
            return false;
        sum = 60 * sum + 10 * (text[1] - '0') + (text[2] - '0');
    }
    if (parts > 1)
        *seconds = sum;
    return parts > 1;
}

/* Reads "90", or spans with their units: "90s", "1h30m". */
static bool read_spans(const char *text, double *seconds)
{
    static const struct {
        const char *unit;
        double seconds;
    } units[] = {{"min", 60}, {"s", 1}, {"m", 60}, {"h", 3600}};
    const char *end = NULL;
    double span = 0;

    *seconds = 0;
    if (cln_number_read(text, &span, &end) && *end == 0)
        *seconds = span;
    else
        do {
            int unit = 0;

            if (!cln_number_read(text, &span, &end) || span < 0)
                return false;
            while (unit < 4 && strncmp(end, units[unit].unit, strlen(units[unit].unit)) != 0)
                unit++;
            if (unit == 4)
                return false;
            *seconds += span * units[unit].seconds;
            text = end + strlen(units[unit].unit);
        } while (*text);
    return *seconds >= 0 && isfinite(*seconds);
}

bool cln_seconds_read(const char *text, double *seconds, bool *has_unit)
{
    const bool clock = read_clock(text, seconds);

    if (has_unit)
        *has_unit = text[strspn(text, "+-.0123456789eE")] != 0;
    return clock || read_spans(text, seconds);
}

bool cln_bytes_read(const char *text, double *bytes)
{
    static const char letters[] = "KMGT";
    const char *end = NULL, *letter = NULL;

    if (!cln_number_read(text, bytes, &end))
        return false;
    letter = *end ? strchr(letters, toupper((unsigned char)*end)) : NULL;
    if (letter)
        *bytes = ldexp(*bytes, 10 * (int)(letter - letters + 1));
    end += letter != NULL;
    if (letter && strncasecmp(end, "iB", 2) == 0)
        end += 2;
    else if (letter && strncasecmp(end, "B", 1) == 0)
        end++;
    return *end == 0 && *bytes >= 0 && isfinite(*bytes);
}

bool cln_reals_read(const char *text, int count, double *out)
{
    for (int pass = 0; pass < 2; pass++) { /* the first only checks, so that *out stays whole */
        const char *at = text;

        for (int i = 0; i < count; i++) {
            double value = 0;

            if (!cln_number_read(at, &value, &at) || *at != (i + 1 < count ? ',' : 0))
                return false;
            if (pass)
                out[i] = value;
            at++;
        }
    }
    return true;
}

int cln_reals_digits(int count, const double *values, double least)
{
    double largest = 0;

    for (int i = 0; i < count; i++)
        largest = fmax(largest, fabs(values[i]));
    return (int)fmin(fmax(3 + ceil(log10(largest / least)), 4), 17); /* NaN: 4 */
}

void cln_box_write(const double box[6], double least, char out[CLN_BOX_BYTES])
{
    const int n = cln_reals_digits(6, box, least);

    cln_format(out, CLN_BOX_BYTES, "%.*g,%.*g,%.*g,%.*g,%.*g,%.*g", n, box[0], n, box[1], n, box[2],
               n, box[3], n, box[4], n, box[5]);
}

static int by_value(const void *a, const void *b)
{
    const double x = *(const double *)a, y = *(const double *)b;

    return x < y ? -1 : x > y;
}

static int by_float(const void *a, const void *b)
{
    const float x = *(const float *)a, y = *(const float *)b;

    return x < y ? -1 : x > y;
}

void cln_reals_sort(double *values, int count)
{
    qsort(values, (size_t)count, sizeof *values, by_value);
}

void cln_floats_sort(float *values, size_t count)
{
    qsort(values, count, sizeof *values, by_float);
}

/* Hoare, "Algorithm 65: FIND", Communications of the ACM 4 (1961); the pivot is what stands where
 * the border will be. */
void cln_reals_split(double *values, size_t count, size_t first)
{
    const ptrdiff_t border = (ptrdiff_t)first - 1;
    ptrdiff_t low = 0, high = (ptrdiff_t)count - 1; /* where the border's value is */

    while (border >= 0 && low < high) {
        const double pivot = values[border];
        ptrdiff_t i = low, j = high;

        while (i <= j) {
            while (values[i] < pivot)
                i++;
            while (values[j] > pivot)
                j--;
            if (i <= j) {
                const double swapped = values[i];

                values[i++] = values[j];
                values[j--] = swapped;
            }
        }
        if (j < border)
            low = i;
        if (border < i)
            high = j;
    }
}
