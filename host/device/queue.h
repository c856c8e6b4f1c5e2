/* The command queue of a device, in order: launches, waiting, and the device time of each stage. */
#ifndef CLN_QUEUE_H
#define CLN_QUEUE_H

#include "device/device.h"

typedef struct cln_arg {
    size_t bytes;
    const void *value;
    int count; /* of arguments in a row, their values one behind the other */
} cln_arg;

#define CLN_ARG(x)         \
    {                      \
        sizeof(x), &(x), 1 \
    }

/* One-dimensional: `groups` groups of `local` work-items; groups 0 launches nothing. */
cln_status cln_launch(cln_device *device, cl_kernel kernel, cln_stage stage, size_t groups,
                      size_t local, const cln_arg *args, int count);
#define CLN_LAUNCH(device, kernel, stage, groups, local, ...)                        \
    cln_launch(device, kernel, stage, groups, local, (const cln_arg[]){__VA_ARGS__}, \
               (int)(sizeof((const cln_arg[]){__VA_ARGS__}) / sizeof(cln_arg)))

/* ceil(a / b). */
static inline size_t cln_groups(size_t a, size_t b)
{
    return (a + b - 1) / b;
}

/* Waits for all work and adds the events' times to stage_seconds (as every read and write that
 * waits). */
cln_status cln_device_finish(cln_device *device);
/* What is enqueued starts now, if it has not yet. */
cln_status cln_device_flush(cln_device *device);

/* A place in the queue. Waiting for it waits for what was enqueued before, not for what came
 * behind, and data of fetches before it are there. Every mark is waited for, once. */
typedef struct cln_mark {
    cl_event event;
    uint64_t launches;
} cln_mark;
cln_status cln_device_mark(cln_device *device, cln_mark *out);
cln_status cln_device_wait(cln_device *device, cln_mark *mark);

/* After a call outside this file that waited for all work: adds the events' times to
 * stage_seconds. */
void cln_queue_waited(cln_device *device);

#endif
