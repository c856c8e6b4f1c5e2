/* The command queue of a device, in order: launches, waiting, and the device time of each stage. */
#ifndef CLN_QUEUE_H
#define CLN_QUEUE_H

#include "device/device.h"

typedef struct cln_arg {
    size_t bytes;
    const void *value;
    int count; /* of successive arguments, whose values are adjacent */
} cln_arg;

#define CLN_ARG(x)         \
    {                      \
        sizeof(x), &(x), 1 \
    }

/* Launches `groups` groups of `local` work-items in one dimension; nothing if groups is 0. */
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

/* Waits for all work and adds its times to stage_seconds, like every read and write that waits. */
cln_status cln_device_finish(cln_device *device);
/* Submits enqueued work without waiting. */
cln_status cln_device_flush(cln_device *device);

/* A place in the queue. Waiting for it waits for the work enqueued before it, fetches included, not
 * for later work. Wait for every mark exactly once. */
typedef struct cln_mark {
    cl_event event;
    uint64_t launches;
} cln_mark;
cln_status cln_device_mark(cln_device *device, cln_mark *out);
cln_status cln_device_wait(cln_device *device, cln_mark *mark);

/* Books the time of all later launches on this stage, as pictures use training's stages but are not
 * part of training. CLN_STAGES: each launch counts for its own stage again. */
void cln_queue_book(cln_device *device, cln_stage stage);

/* Adds launch times to stage_seconds; call it after a call outside this file that waited for all
 * work. */
void cln_queue_waited(cln_device *device);

#endif
