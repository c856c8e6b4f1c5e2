/* OpenCL's error codes as statuses: the sentence names the call and the code. */
#ifndef CLN_CL_ERROR_H
#define CLN_CL_ERROR_H

#include "base/status.h"
#include "cl.h"

/* Name of an OpenCL error code, "CL_OUT_OF_RESOURCES". */
const char *cln_cl_name(cl_int code);

/* CLN_MEMORY for the codes of missing memory, else CLN_CL. call: its text, cut at "(". */
cln_status cln_cl_failed(const char *call, cl_int code);

/* Like CLN_TRY, for a call that returns an error code, or for a code. */
#define CLN_CL(call)                          \
    do {                                      \
        const cl_int code_ = (call);          \
        if (code_ != CL_SUCCESS) {            \
            st = cln_cl_failed(#call, code_); \
            goto done;                        \
        }                                     \
    } while (0)

#endif
