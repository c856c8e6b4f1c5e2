/* What checks of kernels have in common: inputs, the comparison with float64, and the report of a
 * verdict. For the self-test, the tuner, tests and benches. */
#ifndef CLN_COMPARE_H
#define CLN_COMPARE_H

#include "pipeline/stages.h"

/* ---- comparing ---- */

/* How far n values are from float64: NMSE, and the worst element in units of the reference's rms,
 * which is element `at`. Infinite where a value is not finite, or is not zero though all of the
 * reference is. */
typedef struct cln_error {
    double nmse, worst;
    size_t at;
} cln_error;
cln_error cln_check_error(const float *got, const double *want, size_t n);

/* Are n values within both bounds? NMSE misses one bad element in many, the worst element a small
 * error everywhere. Values that are not finite are out of bounds; an all-zero reference must be met
 * exactly. text: by how much, as a phrase. */
bool cln_compare_values(const float *got, const double *want, size_t n, double nmse, double worst,
                        char text[256]);

/* ---- inputs ---- */

/* A uniform number in [low, high), always the same for (stream, index). */
double cln_check_uniform(uint32_t stream, uint32_t index, double low, double high);

/* Makes *buffer hold `bytes` of data. CLN_MEMORY, CLN_CL. */
cln_status cln_check_put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes);

/* Makes *buffer hold `bytes` of NaNs: what a kernel leaves out shows. CLN_MEMORY, CLN_CL. */
cln_status cln_check_spoil(cln_device *device, cln_buffer *buffer, size_t bytes);

/* ---- verdicts ---- */

/* Outputs of a check: n floats with the bounds they are held to, or n whole numbers, which are the
 * same on every device. */
typedef struct cln_output {
    const char *name; /* "SHAPE: CHECK" */
    bool discrete;
    size_t n;
    const float *values;     /* [n] unless discrete */
    const uint32_t *numbers; /* [n] if discrete */
    double nmse, worst;      /* bounds, as of cln_compare_values */
} cln_output;
typedef void cln_output_sink(const cln_output *output, void *user);

/* Who is told of verdicts and outputs; NULL = nobody. */
typedef struct cln_verdicts {
    cln_check_sink *sink;
    cln_output_sink *outputs;
    void *user;
} cln_verdicts;

/* Checks on one pipeline, and how they went. */
typedef struct cln_checks {
    cln_pipeline *p;
    const cln_model *model;
    const char *shape; /* name of the pipeline, before the check's in reports */
    cln_verdicts verdicts;
    bool tiny;       /* as little work as shows anything */
    int failed;      /* checks */
    char first[512]; /* name and detail of the first that failed */
} cln_checks;

/* Tells the sink of a verdict and does not count it. */
void cln_check_report(const cln_checks *c, const char *name, bool passed, bool skipped,
                      const char *detail);

/* Counts and reports a verdict. */
void cln_check_say(cln_checks *c, const char *name, bool passed, const char *fmt, ...)
    __attribute__((format(printf, 4, 5)));

/* The same of a comparison (cln_compare_values), and puts the values out. */
void cln_check_compare(cln_checks *c, const char *name, const float *got, const double *want,
                       size_t n, double nmse, double worst);

/* Puts out what has no float64 reference: floats, and whole numbers that are the same on every
 * device. */
void cln_check_values(cln_checks *c, const char *name, const float *values, size_t n, double nmse,
                      double worst);
void cln_check_numbers(cln_checks *c, const char *name, const uint32_t *numbers, size_t n);

#endif
