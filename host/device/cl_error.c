/* Names of OpenCL's error codes, and failed calls as statuses. */
#include "device/cl_error.h"

#include <string.h>

const char *cln_cl_name(cl_int code)
{
    static const struct {
        cl_int code;
        const char *name;
    } names[] = {
#define N(x) {x, #x}
        N(CL_SUCCESS),
        N(CL_DEVICE_NOT_FOUND),
        N(CL_DEVICE_NOT_AVAILABLE),
        N(CL_COMPILER_NOT_AVAILABLE),
        N(CL_MEM_OBJECT_ALLOCATION_FAILURE),
        N(CL_OUT_OF_RESOURCES),
        N(CL_OUT_OF_HOST_MEMORY),
        N(CL_BUILD_PROGRAM_FAILURE),
        N(CL_INVALID_VALUE),
        N(CL_INVALID_DEVICE),
        N(CL_INVALID_CONTEXT),
        N(CL_INVALID_QUEUE_PROPERTIES),
        N(CL_INVALID_COMMAND_QUEUE),
        N(CL_INVALID_MEM_OBJECT),
        N(CL_INVALID_BINARY),
        N(CL_INVALID_BUILD_OPTIONS),
        N(CL_INVALID_PROGRAM),
        N(CL_INVALID_PROGRAM_EXECUTABLE),
        N(CL_INVALID_KERNEL_NAME),
        N(CL_INVALID_KERNEL_DEFINITION),
        N(CL_INVALID_KERNEL),
        N(CL_INVALID_ARG_INDEX),
        N(CL_INVALID_ARG_VALUE),
        N(CL_INVALID_ARG_SIZE),
        N(CL_INVALID_KERNEL_ARGS),
        N(CL_INVALID_WORK_DIMENSION),
        N(CL_INVALID_WORK_GROUP_SIZE),
        N(CL_INVALID_WORK_ITEM_SIZE),
        N(CL_INVALID_GLOBAL_OFFSET),
        N(CL_INVALID_EVENT_WAIT_LIST),
        N(CL_INVALID_OPERATION),
        N(CL_INVALID_BUFFER_SIZE),
        N(CL_INVALID_GLOBAL_WORK_SIZE),
#undef N
    };

    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].code == code)
            return names[i].name;
    return "unknown OpenCL error";
}

cln_status cln_cl_failed(const char *call, cl_int code)
{
    const bool memory = code == CL_MEM_OBJECT_ALLOCATION_FAILURE || code == CL_OUT_OF_HOST_MEMORY;

    return cln_fail(memory ? CLN_MEMORY : CLN_CL, "%.*s: %s (%d)", (int)strcspn(call, "("), call,
                    cln_cl_name(code), (int)code);
}
