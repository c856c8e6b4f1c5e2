/* The self-test on a device that is already open (cln_selftest opens one): kernels against the float64
 * reference on small shapes. */
#ifndef CLN_SELFTEST_H
#define CLN_SELFTEST_H

#include "device/device.h"

/* quick: about a second once kernels are built. CLN_CHECK names the first check that failed. */
cln_status cln_selftest_device(cln_device *device, bool quick, cln_check_sink *sink, void *user);

/* The same checks for the networks, sampling and loss of these settings alone, with the parameters that the
 * device has for them. */
cln_status cln_selftest_config(cln_device *device, const cln_config *config, cln_check_sink *sink,
                               void *user);

#endif
