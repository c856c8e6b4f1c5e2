/* Counter-based random numbers: Philox4x32-10 (Salmon et al., "Parallel Random Numbers: As Easy as
 * 1, 2, 3", SC 2011). A number is a pure function of (seed, stream, step, index, draw), so a
 * resumed run needs no stored state and the order of evaluation does not matter. kernels/rng.h has
 * the same generator for the device; tests compare both with the published known answers. */
#ifndef CLN_RNG_H
#define CLN_RNG_H

#include <stdint.h>

/* Purposes of numbers; the counter's second word is (stream << 24) | draw. */
enum {
    CLN_STREAM_PIXELS = 1,     /* host: which pixel of which view a ray goes through */
    CLN_STREAM_INIT = 2,       /* host: initial weights */
    CLN_STREAM_GRID = 3,       /* device: jitter of stage-1 samples */
    CLN_STREAM_SAMPLES = 4,    /* device: jitter of stage-2 samples */
    CLN_STREAM_BACKGROUND = 5, /* host: random background */
    CLN_STREAM_POINTS = 6,     /* device: random points of the regularisers */
    CLN_STREAM_SCENE = 7,      /* host: generated scenes */
    CLN_STREAM_DISTIL = 8,     /* host: points that merged leaves learn from */
    CLN_STREAM_SURFACE = 9,    /* host: exported points of a surface */
    CLN_STREAM_SIGHTS = 10,    /* host: sparse point that a ray is shot at */
    CLN_STREAM_POSES = 11,     /* host: pixels used to refine poses */
    CLN_STREAM_SPOTS = 12,     /* host: where in its pixel a ray goes */
    CLN_STREAM_MERGED = 13,    /* host: marks that two parts of a scene share */
    CLN_STREAM_PLACES = 14     /* host: cameras that may tell where a scene is by GPS */
};

/* out[4] = philox4x32-10(counter, key). */
void cln_philox(const uint32_t counter[4], const uint32_t key[2], uint32_t out[4]);

/* Four uniforms in [0,1), 24 bits each, for (seed, stream, step, index, draw). */
void cln_uniform4(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index, uint32_t draw,
                  float out[4]);

/* A well-mixed 32-bit hash, C. Wellons' "lowbias32", as in kernels/rng.h. */
uint32_t cln_hash(uint32_t x);

/* A uniform in [0,1), 24 bits, for (seed, stream, step, index, number, draw): Philox gives the key
 * of stream and step, a hash the rest (kernels/rng.h). */
float cln_uniform_hash(uint64_t seed, uint32_t stream, uint32_t step, uint32_t index,
                       uint32_t number, uint32_t draw);

/* An integer in [0, n), n > 0, from 32 random bits (multiply-shift; bias < n / 2^32). */
uint32_t cln_bounded(uint32_t random, uint32_t n);

#endif
