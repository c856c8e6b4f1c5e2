/* A leaf network with samples in all of its leaves, and what of it is compared with float64. */
#ifndef BENCH_NETWORK_H
#define BENCH_NETWORK_H

#include "bench.h"

enum { DENSITY, EVAL, TRAINING, FORWARD, ROULETTE, BACKWARD, ADAM, UPDATE, NETWORK_PARTS };

/* Of the roulette's own row; the backward pass is timed with all samples. */
#define ROULETTE_CUTOFF 1.0

typedef struct network_run {
    cln_pipeline *p;
    cln_model model;
    uint32_t n, slice_count;
    int refreshed; /* leaves */
    cln_sample *samples;
    float (*ray_o)[4], (*ray_d)[4], (*dout)[4];
    cln_slice *slices;
    int part;
} network_run;

/* No gradient comes in at the samples of compared leaves that have a pre-activation next to zero:
 * on the other side float32 would be right, too. */
void network_drop_kinks(network_run *r);

/* Runs r->part once and compares. */
cln_status network_check(network_run *r, bench_body *body, bench_errors *errors);
cln_status network_check_transposed(const network_run *r, bench_errors *errors);

#endif
