/* A leaf network with samples in all leaves, and its comparisons with float64. */
#ifndef BENCH_NETWORK_H
#define BENCH_NETWORK_H

#include "bench.h"

enum { DENSITY, EVAL, TRAINING, FORWARD, ROULETTE, BACKWARD, ADAM, UPDATE, NETWORK_PARTS };

/* Cutoff of the roulette's own row; the backward pass is timed on all samples. */
#define ROULETTE_CUTOFF 1.0

typedef struct network_run {
    cln_pipeline *p;
    cln_model model;
    uint32_t n, slice_count;
    int refreshed; /* leaves */
    int along;     /* samples of a ray, one after another */
    cln_sample *samples;
    float (*ray_o)[4], (*ray_d)[4], (*dout)[4];
    cln_slice *slices;
    int part;
} network_run;

/* Zeroes the incoming gradient of samples of compared leaves that have a pre-activation close to
 * zero: there float32 may land on the other side of the kink without being wrong. */
void network_drop_kinks(network_run *r);

/* Runs r->part once and compares. */
cln_status network_check(network_run *r, bench_body *body, bench_errors *errors);
cln_status network_check_transposed(const network_run *r, bench_errors *errors);

#endif
