/* The command queue: launches, waiting, and the device time of launches. */
#include "device/queue.h"

#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "device/cl_error.h"

/* Adds up the times of the first `count` launches, which are done. */
static void settle(cln_device *device, int count)
{
    device->waits++;
    for (int i = 0; i < count; i++) {
        cl_ulong start = 0, end = 0;
        const cl_event event = device->pending[i].event;

        if (clGetEventProfilingInfo(event, CL_PROFILING_COMMAND_START, sizeof start, &start,
                                    NULL) == CL_SUCCESS &&
            clGetEventProfilingInfo(event, CL_PROFILING_COMMAND_END, sizeof end, &end, NULL) ==
                CL_SUCCESS &&
            end > start)
            device->stage_seconds[device->pending[i].stage] += 1e-9 * (double)(end - start);
        clReleaseEvent(event);
    }
    device->settled += (uint64_t)count;
    device->pending_count -= count;
    if (device->pending_count > 0)
        memmove(device->pending, device->pending + count,
                (size_t)device->pending_count * sizeof *device->pending);
}

void cln_queue_waited(cln_device *device)
{
    settle(device, device->pending_count);
}

void cln_queue_book(cln_device *device, cln_stage stage)
{
    device->booked = stage;
}

cln_status cln_device_finish(cln_device *device)
{
    cln_status st = CLN_OK;

    CLN_CL(clFinish(device->queue));
done:
    settle(device, device->pending_count);
    return st;
}

cln_status cln_device_flush(cln_device *device)
{
    cln_status st = CLN_OK;

    CLN_CL(clFlush(device->queue));
done:
    return st;
}

cln_status cln_device_mark(cln_device *device, cln_mark *out)
{
    cln_status st = CLN_OK;

    out->launches = device->settled + (uint64_t)device->pending_count;
    CLN_CL(clEnqueueMarkerWithWaitList(device->queue, 0, NULL, &out->event));
done:
    return st;
}

cln_status cln_device_wait(cln_device *device, cln_mark *mark)
{
    cln_status st = CLN_OK;

    CLN_CL(clFlush(device->queue));
    CLN_CL(clWaitForEvents(1, &mark->event));
    settle(device, mark->launches > device->settled ? (int)(mark->launches - device->settled) : 0);
done:
    clReleaseEvent(mark->event);
    mark->event = NULL;
    return st;
}

cln_status cln_launch(cln_device *device, cl_kernel kernel, cln_stage stage, size_t groups,
                      size_t local, const cln_arg *args, int count)
{
    cln_status st = CLN_OK;
    const size_t global = groups * local;
    cl_event event = NULL;
    cl_int code = CL_SUCCESS;
    char name[64] = "";
    cl_uint index = 0;

    if (groups == 0)
        return CLN_OK;
    for (int i = 0; i < count; i++)
        for (int k = 0; k < args[i].count && code == CL_SUCCESS; k++)
            code = clSetKernelArg(kernel, index++, args[i].bytes,
                                  (const char *)args[i].value + (size_t)k * args[i].bytes);
    if (code == CL_SUCCESS)
        code = clEnqueueNDRangeKernel(device->queue, kernel, 1, NULL, &global, &local, 0, NULL,
                                      &event);
    if (code != CL_SUCCESS) {
        clGetKernelInfo(kernel, CL_KERNEL_FUNCTION_NAME, sizeof name, name, NULL);
        st = cln_cl_failed("launch", code);
        cln_note("launching kernel %s with %zu groups of %zu", name, groups, local);
        goto done;
    }
    if (device->pending_count == device->pending_capacity) {
        const int capacity = device->pending_capacity ? 2 * device->pending_capacity : 256;
        cln_pending *bigger = NULL;

        CLN_TRY(cln_alloc(&bigger, (size_t)capacity, sizeof *bigger, "event list"));
        if (device->pending_count)
            memcpy(bigger, device->pending, (size_t)device->pending_count * sizeof *bigger);
        free(device->pending);
        device->pending = bigger;
        device->pending_capacity = capacity;
    }
    device->pending[device->pending_count++] =
        (cln_pending){event, device->booked < CLN_STAGES ? device->booked : stage};
    event = NULL;
done:
    if (event)
        clReleaseEvent(event);
    return st;
}
