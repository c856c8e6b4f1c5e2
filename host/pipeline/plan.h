/* The memory plans of a run: what it will allocate on the device, and what it will hold on the
 * host, by purpose, before anything is allocated. Said first, in train's log and in run.json; a
 * run that does not fit ends here (CLN_MEMORY) with the plan in its sentence, and growth of the
 * tree that would not fit is left out with a warning. Batches are cut so that every buffer that
 * grows with rays or samples stays below the device's largest allocation; what has a row per
 * leaf is split into parts (pipeline.h), and refused where CLN_PARTS of them do not do.
 *
 * The device's plan is a bound: every buffer of buffer_list.h is in it at its largest. The
 * host's is an estimate: the program's own arrays are counted, driver and compiler are an
 * allowance. */
#ifndef CLN_PLAN_H
#define CLN_PLAN_H

#include <jansson.h>
#include "pipeline/pipeline.h"

enum { CLN_PLAN_ROWS = 12 };

/* What plans count with besides the settings. */
enum {
    CLN_RENDER_RAYS = 16384, /* most rays of a picture's batch */
    CLN_DISTIL_BATCHES = 16  /* batches of distil-samples points that a merge cycles through */
};

typedef struct cln_plan {
    struct {
        const char *purpose;
        double bytes;
        double largest; /* the largest single buffer of it */
        int parts; /* buffers that each of its arrays of a row per leaf is split into; 1 = none */
        const char *way_out; /* what to lower; NULL = nothing to be done */
    } rows[CLN_PLAN_ROWS];
    int count;
    double total, limit;
    double cells;         /* of stage 1 over all leaves; kernels index them with 32 bits */
    int max_rays;         /* of a batch, so that its intervals stay within one buffer */
    size_t max_samples;   /* of a batch; the same for all that is kept per sample */
    size_t batch_samples; /* aimed at: --batch-samples, or less where max_samples is small */
    size_t max_entries;   /* projected samples held at a time (splat) */
    int distil_nets;      /* merged leaves trained together */
} cln_plan;

typedef struct cln_plan_desc {
    const cln_pipeline *pipeline; /* device, settings, network; no buffers needed */
    const cln_scene *scene;
    int leaves;
    bool training;         /* or rendering alone */
    double coverage_bytes; /* training: host memory of train/coverage.h */
} cln_plan_desc;

/* limit: --device-mem, else 90 % of the device's memory. */
void cln_plan_device(const cln_plan_desc *desc, cln_plan *out);

/* limit: --host-mem, else the machine's memory. A CPU's device memory is the host's. */
void cln_plan_host(const cln_plan_desc *desc, const cln_plan *device_plan, cln_plan *out);

/* CLN_MEMORY if a plan does not fit its limit, or one buffer (or part) the device's largest
 * allocation. */
cln_status cln_plan_check(const cln_device *device, const cln_plan *plan);
cln_status cln_plan_check_host(const cln_plan *plan);

/* What a pipeline must keep to: the device's limit, rays, samples, entries. */
void cln_plan_apply(const cln_plan *plan, cln_pipeline *pipeline);

/* "weights 12 MiB in 3 parts, activations 80 MiB, ... = 230 MiB of 3.2 GiB". */
void cln_plan_text(const cln_plan *plan, char *out, size_t bytes);
cln_status cln_plan_json(const cln_plan *plan, json_t **out);

#endif
