/* Timing by repetition, the FMA ceiling, and samples for the leaf networks, for the comparison with
 * peers, not all of which are kernels. The kernel benches have bench/kernels/bench.h. */
#ifndef BENCH_PEERS_TIMING_H
#define BENCH_PEERS_TIMING_H

#include "pipeline/stages.h"

/* FLOP/s of the device's FMA ceiling at this moment: depends on the machine's load, so measure it
 * in the same run. */
cln_status bench_peak(cln_device *device, double *flops);

/* Makes and groups `per_leaf` samples in each of the first `leaves` leaves of an uploaded model: at
 * random positions, in mixed order, each on its own ray; and gradients of their outputs for the
 * backward pass. *origins (may be NULL): the positions, [sample][4]; the caller frees them. */
cln_status bench_fill_leaves(cln_pipeline *p, const cln_model *model, int leaves, int per_leaf,
                             uint32_t *slices, float (**origins)[4]);

typedef struct bench_time {
    double min, median, max; /* seconds of one call */
    int calls;
} bench_time;

/* Warm-up, one timed probe, then five series of calls that fill `budget` seconds. */
typedef cln_status bench_body(void *context);
cln_status bench_run(bench_body *body, void *context, double budget, bench_time *out);

#endif
