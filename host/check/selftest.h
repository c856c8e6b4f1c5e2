/* The self-test on a device that is already open (cln_selftest opens one): kernels against the
 * float64 reference on small shapes. What the kernels gave can be had besides, to compare devices
 * with one another (tests/device/device_cases.c). */
#ifndef CLN_SELFTEST_H
#define CLN_SELFTEST_H

#include "base/config_rows.h"
#include "check/compare.h"

typedef enum cln_shapes { CLN_SHAPES_QUICK, CLN_SHAPES_ALL, CLN_SHAPES_TINY } cln_shapes;

typedef struct cln_selftest_plan {
    cln_shapes shapes;    /* quick: about a second once kernels are built; tiny: for simulators */
    cln_check_sink *sink; /* may be NULL */
    cln_output_sink *outputs; /* may be NULL */
    void *user;
} cln_selftest_plan;

/* CLN_CHECK names the first check that failed. */
cln_status cln_selftest_device(cln_device *device, const cln_selftest_plan *plan);

/* The same checks for the networks, sampling and loss of these settings alone, with the parameters
 * that the device has for them. */
cln_status cln_selftest_config(cln_device *device, const cln_config *config, cln_check_sink *sink,
                               void *user);

/* What a training with these settings asks of its device: the quick set, and where the fast preset
 * has other networks, these. */
cln_status cln_selftest_training(cln_device *device, const cln_config *config);

#endif
