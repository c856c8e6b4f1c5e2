/* The one header that includes OpenCL's own; pins the version we ask of it. Only device/ and
 * pipeline/ may include this. */
#ifndef CLN_CL_H
#define CLN_CL_H

#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>

#endif
