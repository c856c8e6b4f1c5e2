/* This room wraps OpenCL: every failed call becomes a cln_status whose sentence names call and
 * code. Devices differ by tuning parameters, not by code. One thread at a time per cln_device.
 *
 * A file calls only files above it in this list:
 *   cl_error    error codes as statuses
 *   tune        tuning parameters: their list, text, rows for devices
 *   kernel_dir  checks the folder of --kernel-dir
 *   cache       checks the folder in which PoCL keeps what it compiled
 *   device      finds, describes, opens and closes a device; chooses its parameters
 *   queue       launches kernels, waits, accounts for device time
 *   buffer      owns device memory and moves data
 *   program     builds programs from the embedded kernel files */
#ifndef CLN_DEVICE_H
#define CLN_DEVICE_H

#include <stddef.h>
#include <stdint.h>
#include "cl.h"
#include "cl_nascent.h"
#include "device/cache.h"
#include "device/tune.h"

/* Stages whose device time is reported, in the order of the pipeline. */
#define CLN_STAGE_LIST(X)            \
    X(UPLOAD, "upload")              \
    X(RAYS, "rays")                  \
    X(PROJECT, "project")            \
    X(SORT, "sort")                  \
    X(INTERVALS, "intervals")        \
    X(SAMPLES, "samples")            \
    X(GROUP, "group")                \
    X(FORWARD, "networks forward")   \
    X(COMPOSITE, "composite")        \
    X(BACKWARD, "networks backward") \
    X(ADAM, "adam")                  \
    X(REFRESH, "stage 1 refresh")    \
    X(STRUCTURE, "structure")        \
    X(PROBE, "probes")               \
    X(POSES, "poses")                \
    X(EVALUATION, "evaluation")      \
    X(VIEWING, "viewing")            \
    X(OTHER, "other")

typedef enum cln_stage {
#define X(name, text) CLN_STAGE_##name,
    CLN_STAGE_LIST(X)
#undef X
        CLN_STAGES
} cln_stage;
extern const char *const cln_stage_names[CLN_STAGES];

/* A stage's name in texts for people: of voxels, what files call networks are voxels. Other names
 * stay as they are. */
const char *cln_stage_text(const char *name, bool voxels);

/* A launch whose time is not yet known. */
typedef struct cln_pending {
    cl_event event;
    cln_stage stage;
} cln_pending;

typedef struct cln_device {
    cl_device_id id;
    cl_context context;
    cl_command_queue queue;
    cln_device_info info;
    cln_tune tune; /* its class's defaults with --tune on top; see cln_device_tune */
    char tune_from[CLN_TUNE_FROM]; /* source of `tune`; "": rows take precedence */
    bool tune_exact; /* use `tune` only (self-test, tuner, tests): no rows, no plain fallback */
    cln_tune_rows *rows[2]; /* the user's (may be NULL), data/tune */
    char *kernel_dir;
    /* Asked before each program is built, which may take a minute, whether to stop; the caller's,
     * NULL: never. */
    const cln_callbacks *callbacks;
    cln_cache_turn turn; /* at compiling; the caller says when it is due, and ends it (cache.h) */
    bool cache_ready;    /* the driver's folder of kernels was checked (cache.h) */
    double compile_seconds; /* processors' seconds that builds took which found nothing there */
    size_t local_mem, max_alloc, max_group; /* bytes, bytes, work-items of a group */
    size_t own_alloc;                       /* max_alloc without --max-alloc */
    bool unified; /* its memory is the host's: processors, and GPUs beside them on one chip */
    size_t allocated, peak;    /* bytes of live buffers, and the most so far */
    struct cln_blocks *blocks; /* memory of a CPU's buffers */
    bool spoil;   /* tests: new buffers start as NaN, to expose reads of unwritten elements */
    size_t limit; /* allocations beyond this fail; 0 = only the device's own limits */
    double stage_seconds[CLN_STAGES]; /* device time since cln_device_open */
    cln_stage booked; /* stage of all launches (cln_queue_book); CLN_STAGES: each its own */
    /* for queue.c: launches whose time is not yet known; number of launches whose time is known and
     * of waits by the host, since cln_device_open */
    cln_pending *pending;
    int pending_count, pending_capacity;
    uint64_t settled, waits;
} cln_device;

/* Checks before photos are read that there is such a device, with such kernels and parameters. */
cln_status cln_device_check(const cln_device_desc *desc);

/* Picks by desc->spec (cl_nascent.h) and opens. */
cln_status cln_device_open(const cln_device_desc *desc, cln_device **out);
void cln_device_close(cln_device *device); /* accepts NULL */

/* Raw handles of all devices of all platforms in the loader's order; the caller frees *out.
 * CLN_NO_DEVICE if there is none. */
cln_status cln_device_ids(cl_device_id **out, int *count);
void cln_device_describe(cl_device_id id, cln_device_info *info);

/* Chooses the parameters for a network ("W32-D3-V32"); from: their source, as a phrase. */
void cln_device_tune(const cln_device *device, const char *network, cln_tune *out,
                     char from[CLN_TUNE_FROM]);

#endif
