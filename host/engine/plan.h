/* The memory plan: what a run will allocate on the device, by purpose, before anything is allocated.
 * Said first, in train's log and in run.json; a run that does not fit ends here (CLN_MEMORY) with the
 * plan in its sentence, and growth of the tree that would not fit is left out with a warning. */
#ifndef CLN_PLAN_H
#define CLN_PLAN_H

#include <jansson.h>
#include "engine/stages.h"

enum { CLN_PLAN_ROWS = 9 };

typedef struct cln_plan {
    struct {
        const char *purpose;
        double bytes;
        double largest;      /* the largest single buffer of it */
        const char *way_out; /* what to lower */
    } rows[CLN_PLAN_ROWS];
    int count;
    double total, limit;
    double cells;         /* of stage 1 over all leaves; kernels index them with 32 bits */
    size_t max_samples;   /* of a batch; its activations stay within one buffer of the device */
    size_t batch_samples; /* aimed at: --batch-samples, or less where max_samples is small */
    size_t max_entries;   /* projected samples held at a time (splat) */
} cln_plan;

/* Plans for `leaves` leaves. Training, or rendering alone. limit: --device-mem, else 90 % of the
 * device's memory. */
void cln_plan_make(const cln_device *device, const cln_config *config, const cln_network *net,
                   const cln_tune *tune, int leaves, int views, bool training, cln_plan *out);

/* CLN_MEMORY if the plan does not fit the limit, or one buffer the device's largest allocation. */
cln_status cln_plan_check(const cln_device *device, const cln_plan *plan);

/* "weights 12 MiB, activations 80 MiB, ... = 230 MiB of 3.2 GiB". */
void cln_plan_text(const cln_plan *plan, char *out, size_t bytes);
cln_status cln_plan_json(const cln_plan *plan, json_t **out);

#endif
