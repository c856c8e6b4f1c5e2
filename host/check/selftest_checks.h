/* What the parts of the self-test share: selftest.c runs them on one pipeline after the other,
 * selftest_rays.c, selftest_networks.c and selftest_structure.c hold the checks. The comparison with float64
 * and the reference's side of a pipeline serve tests and benches, too. */
#ifndef CLN_SELFTEST_CHECKS_H
#define CLN_SELFTEST_CHECKS_H

#include "check/selftest.h"
#include "pipeline/stages.h"
#include "reference/reference.h"

typedef struct cln_checks {
    cln_pipeline *p;
    const cln_model *model;
    const char *shape; /* name of the pipeline, before the check's in reports */
    const cln_selftest_plan *plan;
    bool tiny; /* as little work as shows anything */
    int failed;
    char first[512]; /* of the failed ones */
} cln_checks;

/* Reports a check. */
void cln_check_say(cln_checks *c, const char *name, bool passed, const char *fmt, ...)
    __attribute__((format(printf, 4, 5)));

/* How far n values are from float64: NMSE, and the worst element in units of the reference's rms, which is
 * element `at`. Infinite where a value is not finite, or is not zero though the reference is all zero. */
typedef struct cln_error {
    double nmse, worst;
    size_t at;
} cln_error;
cln_error cln_check_error(const float *got, const double *want, size_t n);

/* The reference's side of a pipeline: leaf `slot` of a model; the rules of a batch's samples. */
ref_network cln_check_network(const cln_config *config, const cln_model *model, int slot);
ref_way cln_check_way(const cln_octree *tree, const cln_config *config, const cln_sampling *s);

/* Is got, values what a stable sort makes of keys with the values 0 .. n - 1? *wrong: places that are not. */
cln_status cln_check_sorted(const uint64_t *keys, const uint64_t *got, const uint32_t *values,
                            uint32_t n, uint32_t *wrong);

/* Reports a comparison with float64 (cln_compare_values), and the values as outputs. */
void cln_check_compare(cln_checks *c, const char *name, const float *got, const double *want,
                       size_t n, double nmse, double worst);

/* Outputs that have no float64 reference, for plan->outputs alone: floats, and whole numbers that are
 * the same on every device. */
void cln_check_values(cln_checks *c, const char *name, const float *values, size_t n, double nmse,
                      double worst);
void cln_check_numbers(cln_checks *c, const char *name, const uint32_t *numbers, size_t n);

/* A uniform number in [low, high), always the same for (stream, index). */
double cln_check_uniform(uint32_t stream, uint32_t index, double low, double high);

/* *buffer holds at least `bytes`, all of them NaN: what a kernel leaves out shows. */
cln_status cln_check_spoil(cln_device *device, cln_buffer *buffer, size_t bytes);
cln_status cln_check_put(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes);

/* The checks; each reports itself. A status other than CLN_OK means that no verdict was possible. */
cln_status cln_check_scan(cln_checks *c);
cln_status cln_check_sort(cln_checks *c, bool wide);
cln_status cln_check_rays(cln_checks *c);
cln_status cln_check_densities(cln_checks *c);
cln_status cln_check_networks(cln_checks *c);
cln_status cln_check_composite(cln_checks *c);
cln_status cln_check_structure(cln_checks *c); /* only where the pipeline measures */

#endif
