/* Comparison, inputs and reports of checks. See compare.h. */
#include "check/compare.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "base/rng.h"

void cln_check_report(const cln_checks *c, const char *name, bool passed, bool skipped,
                      const char *detail)
{
    if (c->verdicts.sink)
        c->verdicts.sink(name, passed, skipped, detail, c->verdicts.user);
}

void cln_check_say(cln_checks *c, const char *name, bool passed, const char *fmt, ...)
{
    char full[96], detail[256];
    va_list args;

    va_start(args, fmt);
    vsnprintf(detail, sizeof detail, fmt, args);
    va_end(args);
    snprintf(full, sizeof full, "%s: %s", c->shape, name);
    if (!passed && c->failed++ == 0)
        snprintf(c->first, sizeof c->first, "%s: %s", full, detail);
    cln_check_report(c, full, passed, false, detail);
}

cln_error cln_check_error(const float *got, const double *want, size_t n)
{
    cln_error e = {0};
    double error = 0, square = 0, largest = 0;

    for (size_t i = 0; i < n; i++) {
        const double off = fabs((double)got[i] - want[i]);

        if (!isfinite(got[i]))
            return (cln_error){INFINITY, INFINITY, i};
        error += off * off;
        square += want[i] * want[i];
        if (off > largest) {
            largest = off;
            e.at = i;
        }
    }
    if (!(error == 0)) {         /* NaN too */
        e.nmse = error / square; /* infinite if the reference is all zero */
        e.worst = largest / sqrt(square / (double)n);
    }
    return e;
}

bool cln_compare_values(const float *got, const double *want, size_t n, double nmse, double worst,
                        char text[256])
{
    const cln_error e = cln_check_error(got, want, n);
    const bool within = n > 0 && e.nmse <= nmse && e.worst <= worst;

    if (n == 0)
        snprintf(text, 256, "no element to compare");
    else if (within)
        snprintf(text, 256, "%.1f %% of the bound, %zu elements",
                 100 * fmax(e.nmse / nmse, e.worst / worst), n);
    else
        snprintf(text, 256,
                 "NMSE %.2g (bound %.0g), worst %.2g rms (bound %.0g): element %zu of %zu is %.6g, "
                 "should be %.6g",
                 e.nmse, nmse, e.worst, worst, e.at, n, (double)got[e.at], want[e.at]);
    return within;
}

void cln_check_compare(cln_checks *c, const char *name, const float *got, const double *want,
                       size_t n, double nmse, double worst)
{
    char text[256];
    const bool within = cln_compare_values(got, want, n, nmse, worst, text);

    cln_check_say(c, name, within, "%s", text);
    cln_check_values(c, name, got, n, nmse, worst);
}

static void put_out(const cln_checks *c, const char *name, cln_output output)
{
    char full[96];

    snprintf(full, sizeof full, "%s: %s", c->shape, name);
    output.name = full;
    if (c->verdicts.outputs)
        c->verdicts.outputs(&output, c->verdicts.user);
}

void cln_check_values(cln_checks *c, const char *name, const float *values, size_t n, double nmse,
                      double worst)
{
    put_out(c, name, (cln_output){.n = n, .values = values, .nmse = nmse, .worst = worst});
}

void cln_check_numbers(cln_checks *c, const char *name, const uint32_t *numbers, size_t n)
{
    put_out(c, name, (cln_output){.discrete = true, .n = n, .numbers = numbers});
}

double cln_check_uniform(uint32_t stream, uint32_t index, double low, double high)
{
    float u[4];

    cln_uniform4(stream, CLN_STREAM_SCENE, 5, index / 4, 0, u);
    return low + (high - low) * u[index % 4];
}

cln_status cln_check_put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes)
{
    cln_status st = CLN_OK;

    CLN_TRY(cln_buffer_reserve(device, buffer, bytes, "self-test"));
    CLN_TRY(cln_buffer_write(device, buffer, 0, data, bytes));
done:
    return st;
}

cln_status cln_check_spoil(cln_device *device, cln_buffer *buffer, size_t bytes)
{
    cln_status st = CLN_OK;
    unsigned char *spoilt = NULL;

    CLN_TRY(cln_alloc(&spoilt, bytes, 1, "self-test"));
    memset(spoilt, 0xFF, bytes); /* a NaN in every float */
    CLN_TRY(cln_check_put(device, buffer, spoilt, bytes));
done:
    free(spoilt);
    return st;
}
