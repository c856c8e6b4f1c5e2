/* Timing by repetition, the FMA ceiling, and samples for the leaf networks, for the bench beside
 * peers, whose contestants are not all kernels. The kernels' bench is bench/kernels/bench.h. */
#ifndef BENCH_PEERS_TIMING_H
#define BENCH_PEERS_TIMING_H

#include "pipeline/stages.h"

/* FLOP/s of the device's FMA ceiling now; the machine may be busy, so take it in the same run. */
cln_status bench_peak(cln_device *device, double *flops);

/* `per_leaf` samples in each of the first `leaves` leaves of an uploaded model, at random
 * positions, in mixed order, each on a ray of its own, grouped; and gradients of their outputs for
 * the backward pass. *origins (may be NULL): the positions, [sample][4]; the caller frees them. */
cln_status bench_fill_leaves(cln_pipeline *p, const cln_model *model, int leaves, int per_leaf,
                             uint32_t *slices, float (**origins)[4]);

typedef struct bench_time {
    double min, median, max; /* seconds of one call */
    int calls;
} bench_time;

/* Warm-up, one timed probe, then five times as many calls as fill `budget` seconds. */
typedef cln_status bench_body(void *context);
cln_status bench_run(bench_body *body, void *context, double budget, bench_time *out);

#endif
