/* Random numbers for tests that need no device. */
#ifndef CLN_TESTS_DRAWS_H
#define CLN_TESTS_DRAWS_H

#include "base/rng.h"

/* Uniform in [low, high), a function of (seed, index). */
static inline double uniform(uint64_t seed, int index, double low, double high)
{
    float u[4];

    cln_uniform4(seed, CLN_STREAM_POINTS, 0, (uint32_t)index / 4, 0, u);
    return low + (high - low) * u[index % 4];
}

#endif
