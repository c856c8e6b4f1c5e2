/* Common parts of kernel checks: inputs, comparison with float64, reports of verdicts. For the
 * self-test, the tuner, tests and benches. */
#ifndef CLN_COMPARE_H
#define CLN_COMPARE_H

#include "pipeline/stages.h"

/* ---- comparing ---- */

/* Errors of n values against float64: NMSE, and the worst error, element `at`, in units of the
 * reference's rms. Infinite if a value is not finite, or not zero with an all-zero reference. */
typedef struct cln_error {
    double nmse, worst;
    size_t at;
} cln_error;
cln_error cln_check_error(const float *got, const double *want, size_t n);

/* Returns whether n values are within both bounds: NMSE misses one bad element in many, the worst
 * element misses a small error everywhere. Values that are not finite are out of bounds; an
 * all-zero reference must be met exactly. text: the margin, as a phrase. */
bool cln_compare_values(const float *got, const double *want, size_t n, double nmse, double worst,
                        char text[256]);

/* ---- inputs ---- */

/* A uniform number in [low, high), always the same for (stream, index). */
double cln_check_uniform(uint32_t stream, uint32_t index, double low, double high);

/* Reserves *buffer and fills it with `bytes` of data. CLN_MEMORY, CLN_CL. */
cln_status cln_check_put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes);

/* Reserves *buffer and fills it with `bytes` of NaNs, to expose elements that a kernel does not
 * write. CLN_MEMORY, CLN_CL. */
cln_status cln_check_spoil(cln_device *device, cln_buffer *buffer, size_t bytes);

/* ---- verdicts ---- */

/* Outputs of a check: n floats with their bounds, or n integers, the same on every device. */
typedef struct cln_output {
    const char *name; /* "SHAPE: CHECK" */
    bool discrete;
    size_t n;
    const float *values;     /* [n] unless discrete */
    const uint32_t *numbers; /* [n] if discrete */
    double nmse, worst;      /* bounds, see cln_compare_values */
} cln_output;
typedef void cln_output_sink(const cln_output *output, void *user);

/* Receivers of verdicts and outputs; each may be NULL. */
typedef struct cln_verdicts {
    cln_check_sink *sink;
    cln_output_sink *outputs;
    void *user;
} cln_verdicts;

/* Checks on a pipeline, and their results. */
typedef struct cln_checks {
    cln_pipeline *p;
    const cln_model *model;
    const char *shape; /* name of the pipeline; precedes a check's name in reports */
    cln_verdicts verdicts;
    bool tiny;              /* as little work as possible */
    const float (*crop)[4]; /* that rays are cut to (cln_sampling); NULL: none */
    int failed;             /* number of failed checks */
    char first[512];        /* name and detail of the first one */
} cln_checks;

/* Reports a verdict to the sink without counting it. */
void cln_check_report(const cln_checks *c, const char *name, bool passed, bool skipped,
                      const char *detail);

/* Counts and reports a verdict. */
void cln_check_say(cln_checks *c, const char *name, bool passed, const char *fmt, ...)
    __attribute__((format(printf, 4, 5)));

/* The same for a comparison (cln_compare_values); also outputs the values. */
void cln_check_compare(cln_checks *c, const char *name, const float *got, const double *want,
                       size_t n, double nmse, double worst);

/* Output results without float64 reference: floats, and integers that are the same on every
 * device. */
void cln_check_values(cln_checks *c, const char *name, const float *values, size_t n, double nmse,
                      double worst);
void cln_check_numbers(cln_checks *c, const char *name, const uint32_t *numbers, size_t n);

#endif
