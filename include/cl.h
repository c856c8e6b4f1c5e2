/* The only header that includes OpenCL's, at one version. Only device/ and pipeline/ may include
 * this one. */
#ifndef CLN_CL_H
#define CLN_CL_H

#define CL_TARGET_OPENCL_VERSION 120
#define CL_USE_DEPRECATED_OPENCL_1_2_APIS
#include <CL/cl.h>

#endif
