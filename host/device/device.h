/* OpenCL, wrapped once: pick a device, build programs, own buffers, launch kernels, account for time and
 * memory. Every OpenCL call's failure comes out as a cln_status with the call's and the code's name.
 * Devices differ by the parameters in cln_tune (more: tune.h), not by code. One thread at a time per
 * cln_device. */
#ifndef CLN_DEVICE_H
#define CLN_DEVICE_H

#include <stddef.h>
#include <stdint.h>
#include "cl.h"
#include "cl_nascent.h"

/* Tuning parameters: X(field, name, cpu, gpu, min, max, meaning). From this list: the struct, the
 * defaults, the parser of "VW=8,TS=6" and its range check, the text form. */
#define CLN_TUNE_LIST(X)                                                                           \
    X(vw, "VW", 0, 1, 1, 16, "floats per vector; cpu 0 = the device's native width")               \
    X(nv, "NV", 2, 1, 1, 8, "vectors per work-item in a tile")                                     \
    X(ls, "LS", 1, 64, 1, 1024, "work-items of a network work-group")                              \
    X(ts, "TS", 6, 8, 1, 32, "samples of a register tile")                                         \
    X(nb, "NB", 48, 16, 1, 1024, "samples of a leaf in local memory at a time")                    \
    X(sl, "SL", 480, 128, 1, 65536, "most samples of a slice (one work-group)")                    \
    X(wg, "WG", 16, 64, 1, 1024, "work-items of a group of the scalar kernels")                    \
    X(sg, "SG", 1, 256, 1, 1024, "work-items of a scan, sort or sum group; 2^k")                   \
    X(db, "DB", 12, 8, 1, 12, "most bits of a digit of the sort")                                  \
    X(chunk, "CHUNK", 1024, 2048, 16, 65536, "fewest elements a scan or sort group takes in turn") \
    X(native, "NATIVE", 0, 0, 0, 1, "native_exp and the like in networks")                         \
    X(half, "HALF", 0, 0, 0, 1, "activations kept for backward in 16 bits")                        \
    X(leaf, "LEAF", 1, 0, 0, 1, "a leaf's gradient and transposed weights in local memory")

typedef struct cln_tune {
#define X(field, name, cpu, gpu, min, max, meaning) int field;
    CLN_TUNE_LIST(X)
#undef X
} cln_tune;

enum { CLN_TUNE_TEXT = 256, CLN_TUNE_FROM = 512 }; /* bytes of such texts */

/* Stages whose device time is accounted for, in the order of the pipeline. */
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
    X(OTHER, "other")

typedef enum cln_stage {
#define X(name, text) CLN_STAGE_##name,
    CLN_STAGE_LIST(X)
#undef X
        CLN_STAGES
} cln_stage;
extern const char *const cln_stage_names[CLN_STAGES];

typedef struct cln_device {
    cl_device_id id;
    cl_context context;
    cl_command_queue queue;
    cln_device_info info;
    cln_tune tune; /* those of its class, with --tune over them; cln_tune_choose has the rest */
    char tune_from[CLN_TUNE_FROM]; /* where `tune` comes from, or "": the rows go before it */
    bool tune_exact; /* `tune` or nothing (self-test, tuner, tests): no rows, no falling back */
    struct cln_tune_rows *rows[2]; /* the user's (may be NULL), data/tune */
    char *kernel_dir;
    size_t local_mem, max_alloc, max_group; /* bytes, bytes, work-items of a group */
    size_t allocated, peak;                 /* bytes of live buffers, and the most so far */
    bool spoil;   /* tests: new buffers start as NaN, so that what was never written shows */
    size_t limit; /* allocations beyond this fail; 0 = only the device's own limits */
    double stage_seconds[CLN_STAGES]; /* device time since cln_device_open */
    struct cln_pending *pending;      /* events not yet accounted for */
    int pending_count, pending_capacity;
    uint64_t settled; /* events accounted for since cln_device_open */
    uint64_t waits;   /* how often the host waited for the device since then */
} cln_device;

/* Picks by desc->spec (cl_nascent.h) and opens. */
cln_status cln_device_open(const cln_device_desc *desc, cln_device **out);
void cln_device_close(cln_device *device); /* accepts NULL */

/* Waits for all work and adds the events' times to stage_seconds (as every read and write that waits). */
cln_status cln_device_finish(cln_device *device);
/* What is enqueued starts now, if it has not yet. */
cln_status cln_device_flush(cln_device *device);

/* A place in the queue. Waiting for it waits for what was enqueued before, not for what came behind, and data
 * of fetches before it are there. Every mark is waited for, once. */
typedef struct cln_mark {
    cl_event event;
    uint64_t launches;
} cln_mark;
cln_status cln_device_mark(cln_device *device, cln_mark *out);
cln_status cln_device_wait(cln_device *device, cln_mark *mark);

/* "VW=8,NV=2,...", all of them. */
void cln_tune_text(const cln_tune *tune, char out[CLN_TUNE_TEXT]);
/* Applies "VW=8,TS=6"; CLN_USAGE names what is wrong and the range. */
cln_status cln_tune_parse(const char *text, cln_tune *tune);

/* ---- programs ---- */

typedef struct cln_program {
    cl_program program;
    char name[32];
} cln_program;

/* Builds device_abi.h, lanes.h, the headers that NAME.cl names in its first line, and NAME.cl, with `defines` as
 * "#define A 1" lines in the source text itself (some drivers' caches ignore -D). On CLN_BUILD the
 * whole build log goes to the log at warn level. */
cln_status cln_program_build(cln_device *device, const char *name, const char *defines,
                             cln_program *out);
void cln_program_free(cln_program *program);
cln_status cln_kernel_create(const cln_program *program, const char *name, cl_kernel *out);
void cln_kernel_free(cl_kernel *kernel);

/* ---- buffers ---- */

/* One buffer, or one array in CLN_PARTS buffers: byte b lies in part b / part_bytes. OpenCL allows at least
 * a quarter of the device's memory in one buffer, so that four reach all of it. */
enum { CLN_PARTS = 4 };
typedef struct cln_buffer {
    size_t bytes;      /* of all parts */
    size_t part_bytes; /* 0 = one buffer */
    union {
        cl_mem mem;
        cl_mem part[CLN_PARTS]; /* all there if part_bytes > 0 */
    };
} cln_buffer;

/* Makes *buffer hold at least `bytes` (contents are lost when it grows; at least 16 bytes are there,
 * so that a kernel always gets a valid buffer). `what` is for the CLN_MEMORY sentence. */
cln_status cln_buffer_reserve(cln_device *device, cln_buffer *buffer, size_t bytes,
                              const char *what);
/* The same in CLN_PARTS parts of at most part_bytes > 0, each with at least 16 bytes; contents are lost when
 * part_bytes changes, too. */
cln_status cln_buffer_reserve_parts(cln_device *device, cln_buffer *buffer, size_t bytes,
                                    size_t part_bytes, const char *what);
void cln_buffer_free(cln_device *device, cln_buffer *buffer);
/* Read and write take a range of the whole array, in however many parts it lies. */
cln_status cln_buffer_write(cln_device *device, const cln_buffer *buffer, size_t offset,
                            const void *data, size_t bytes);
cln_status cln_buffer_read(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                           size_t bytes);
/* The same without waiting. Send: `data` must stay as it is, fetch: it is there, once a later cln_buffer_read,
 * cln_buffer_write or cln_device_finish has returned. */
cln_status cln_buffer_send(cln_device *device, const cln_buffer *buffer, size_t offset,
                           const void *data, size_t bytes);
cln_status cln_buffer_fetch(cln_device *device, const cln_buffer *buffer, size_t offset, void *data,
                            size_t bytes);
/* Not of parts. */
cln_status cln_buffer_zero(cln_device *device, const cln_buffer *buffer, size_t bytes);

/* ---- launches ---- */

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

/* Name of an OpenCL error code, "CL_OUT_OF_RESOURCES". */
const char *cln_cl_name(cl_int code);
cln_status cln_cl_failed(const char *call, cl_int code);
#define CLN_CL(call)                          \
    do {                                      \
        const cl_int code_ = (call);          \
        if (code_ != CL_SUCCESS) {            \
            st = cln_cl_failed(#call, code_); \
            goto done;                        \
        }                                     \
    } while (0)

/* Monotonic seconds. */
double cln_now(void);

#endif
