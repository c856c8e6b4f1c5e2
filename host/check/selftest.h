/* The self-test on an open device (cln_selftest opens one): kernels against the float64 reference
 * on small shapes. It can also output the kernels' results, to compare devices with one another
 * (tests/device/device_cases.c). */
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
    const cln_callbacks *callbacks; /* show progress and can end it; may be NULL */
} cln_selftest_plan;

/* CLN_CHECK names the first check that failed. CLN_SIGINT, CLN_SIGTERM by the callbacks. */
cln_status cln_selftest_device(cln_device *device, const cln_selftest_plan *plan);

/* CLN_CHECK if long loops end early. Kernels may then read and write anywhere. */
cln_status cln_selftest_loops(cln_device *device, cln_check_sink *sink, void *user);

/* Runs the same checks only for the networks, sampling and loss of these settings, with the
 * device's parameters for them. */
cln_status cln_selftest_config(cln_device *device, const cln_config *config, cln_check_sink *sink,
                               void *user);

/* Runs the checks before a training: the quick set, for a forward or shell space its rays, and
 * these settings if their leaves' kernels differ from the default preset's. Shows its progress and
 * can be interrupted (CLN_SIGINT, CLN_SIGTERM), as it takes a minute if the driver has to compile
 * all kernels. */
cln_status cln_selftest_training(cln_device *device, const cln_config *config,
                                 const cln_space *space, const cln_callbacks *callbacks);

#endif
