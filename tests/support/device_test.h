/* Support of the kernels' tests: a device, parameter sets that represent kinds of devices (PoCL
 * also runs the GPU's), buffers that start as NaN and end in a guard, and comparison with float64
 * by two bounds. Without a device tests are skipped and counted as skipped.
 *
 *   buffer   |<- what the stage may write ->|<- GUARD bytes ->|      all bytes 0xFF: as floats NaN
 *
 * CLN_TEST_DEVICE chooses the device, as --device does; CLN_TEST_KERNEL_DIR is a folder of kernels,
 * as for --kernel-dir. */
#ifndef CLN_TESTS_DEVICE_TEST_H
#define CLN_TESTS_DEVICE_TEST_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "base/config.h"
#include "base/rng.h"
#include "device/device.h"
#include "outcome.h"
#include "pipeline/stages.h"

enum { GUARD = 4096 };

/* "" stands for the device's own defaults. */
typedef struct tune_set {
    const char *name, *text;
} tune_set;

static const tune_set tune_sets[] = {
    {"default", ""},
    {"plain", "VW=1,NV=1,LS=1,TS=1,NB=8,SL=16,WG=1,DB=5,CHUNK=16,LEAF=0"},
    {"wide vectors", "VW=16,NV=1,LS=1,TS=4,NB=12,SL=48,WG=8,SG=8,DB=7,CHUNK=100"},
    {"vectors and items", "VW=4,NV=1,LS=16,TS=4,NB=16,SL=64,WG=32,SG=32,DB=3,CHUNK=33"},
    /* a GPU's own, tune.h */
    {"gpu", "VW=1,NV=1,LS=64,TS=8,NB=16,SL=128,WG=64,SG=256,DB=8,CHUNK=2048,LEAF=0"},
};
enum { TUNE_SETS = sizeof tune_sets / sizeof tune_sets[0] };

/* Other arithmetic, for kernels that support it. */
static const tune_set native_set = {"native", "NATIVE=1"};
static const tune_set half_sets[] = {
    {"half", "HALF=1"},
    {"half, gpu", "VW=1,NV=1,LS=64,TS=8,NB=16,SL=128,WG=64,CHUNK=64,HALF=1,LEAF=0"},
};

/* Fails the test with the current error's sentence if st is not CLN_OK. */
static cln_device *test_device_open;
static cln_tune test_device_tune; /* its defaults */

/* The device of this process, opened once, with the parameters of a set. Without a device it skips
 * the test. */
static inline cln_device *test_device(const tune_set *set)
{
    if (!test_device_open) {
        const cln_device_desc desc = {.spec = getenv("CLN_TEST_DEVICE"),
                                      .kernel_dir = getenv("CLN_TEST_KERNEL_DIR")};
        const cln_status st = cln_device_open(&desc, &test_device_open);

        if (st == CLN_NO_DEVICE) {
            print_message("skipped: %s\n", cln_error_text());
            cln_clear_error();
            skip();
        }
        assert_ok(st);
        test_device_tune = test_device_open->tune;
        test_device_open->tune_exact = true; /* exactly the sets below */
    }
    test_device_open->tune = test_device_tune;
    assert_ok(cln_tune_parse(set->text, &test_device_open->tune));
    return test_device_open;
}

/* Pipelines are kept until the group's teardown: building programs takes most of a test's time. */
typedef struct test_pipeline_entry {
    const tune_set *set;
    cln_config config;
    unsigned lenses, alpha;
    cln_space space;
    cln_pipeline pipeline;
} test_pipeline_entry;

/* The programs that this group's kernels are in: without the others it builds faster. */
static uint32_t test_wanted = CLN_PROGRAMS_ALL;

enum { MAX_PIPELINES = 40 };
static test_pipeline_entry test_pipelines[MAX_PIPELINES];
static int test_pipeline_count;

static inline cln_pipeline *test_pipeline_in(const tune_set *set, const cln_config *config,
                                             unsigned lenses, bool alpha, const cln_space *space)
{
    cln_device *device = test_device(set);
    test_pipeline_entry *e = test_pipelines;

    for (int i = 0; i < test_pipeline_count; i++, e++) {
        if (e->set == set && memcmp(&e->config, config, sizeof *config) == 0 &&
            e->lenses == lenses && e->alpha == alpha && cln_space_equal(&e->space, space))
            return &e->pipeline;
    }
    assert_true(test_pipeline_count < MAX_PIPELINES);
    assert_ok(cln_pipeline_create(
        device, config, &(cln_pipeline_facts){.lenses = lenses, .alpha = alpha, .space = space},
        test_wanted, &e->pipeline));
    e->set = set;
    e->config = *config;
    e->lenses = lenses;
    e->alpha = alpha;
    e->space = *space;
    test_pipeline_count++;
    return &e->pipeline;
}

static inline cln_pipeline *test_pipeline(const tune_set *set, const cln_config *config,
                                          unsigned lenses, bool alpha)
{
    return test_pipeline_in(set, config, lenses, alpha, &cln_space_unit);
}

/* A cmocka group teardown. */
static inline int test_device_close(void **state)
{
    (void)state;
    for (int i = 0; i < test_pipeline_count; i++)
        cln_pipeline_free(&test_pipelines[i].pipeline);
    test_pipeline_count = 0;
    cln_device_close(test_device_open);
    test_device_open = NULL;
    return 0;
}

/* The fast preset with the smallest network: for tests that are not about the network. */
static inline cln_config small_config(void)
{
    cln_config config;

    memset(&config, 0, sizeof config); /* also clears padding: settings are compared as bytes */
    assert_ok(cln_config_preset("fast", &config));
    config.width = config.view_width = 16;
    config.depth = config.bands = 2;
    config.view_bands = 1;
    config.start_level = 1;
    config.level_at[0] = 0;
    config.n1 = 4;
    config.depth_loss = 0; /* no ray shows a known point */
    return config;
}

static inline double test_uniform(uint64_t seed, int index, double low, double high)
{
    float u[4];

    cln_uniform4(seed, CLN_STREAM_SCENE, 77, (uint32_t)index / 4, 0, u);
    return low + (high - low) * u[index % 4];
}

static inline void *test_alloc(size_t count, size_t size)
{
    void *memory = calloc(count ? count : 1, size);

    assert_non_null(memory);
    return memory;
}

/* ---- buffers ---- */

/* *buffer = `bytes` of the given data (NULL: 0xFF), followed by a guard. */
static inline void test_fill(cln_device *device, cln_buffer *buffer, const void *data, size_t bytes)
{
    unsigned char *all = test_alloc(bytes + GUARD, 1);

    memset(all, 0xFF, bytes + GUARD);
    if (data)
        memcpy(all, data, bytes);
    cln_buffer_free(device, buffer);
    assert_ok(cln_buffer_reserve(device, buffer, bytes + GUARD, "test"));
    assert_ok(cln_buffer_write(device, buffer, 0, all, bytes + GUARD));
    free(all);
}

/* Reads `bytes` into new memory and checks that the guard after them is unchanged. */
static inline void *test_read(cln_device *device, const cln_buffer *buffer, size_t bytes,
                              const char *what)
{
    unsigned char *all = test_alloc(bytes + GUARD, 1);

    if (buffer->bytes != (bytes + GUARD < 16 ? 16 : bytes + GUARD))
        fail_msg("%s: %zu bytes were reserved for %zu", what, buffer->bytes, bytes);
    assert_ok(cln_buffer_read(device, buffer, 0, all, bytes + GUARD));
    for (size_t i = 0; i < GUARD; i++) {
        if (all[bytes + i] != 0xFF)
            fail_msg("%s: byte %zu behind the end was written", what, i);
    }
    return all;
}

/* ---- comparison ---- */

/* Bounds on the NMSE, which misses one bad element in a million, and on the worst element in units
 * of the reference's rms, which misses a small bias everywhere. */
typedef struct bounds {
    double nmse, worst;
} bounds;

static double test_share; /* largest share of a bound used since test_report */

static inline void compare(const char *what, const float *got, const double *want, size_t n,
                           bounds b)
{
    double error = 0, square = 0, worst = 0, rms = 0;
    size_t at = 0;

    for (size_t i = 0; i < n; i++) {
        const double e = fabs((double)got[i] - want[i]);

        if (!isfinite(got[i]))
            fail_msg("%s: element %zu of %zu is %g, the reference has %.9g", what, i, n,
                     (double)got[i], want[i]);
        error += e * e;
        square += want[i] * want[i];
        if (e > worst) {
            worst = e;
            at = i;
        }
    }
    if (n == 0)
        return;
    rms = sqrt(square / (double)n);
    if (rms == 0) { /* compared absolutely: zero is exact everywhere */
        if (worst != 0)
            fail_msg("%s: element %zu is %g, the reference is all zero", what, at, (double)got[at]);
        return;
    }
    if (!(error <= b.nmse * square))
        fail_msg("%s: NMSE %.3g of %zu elements is above %.3g", what, error / square, n, b.nmse);
    if (!(worst <= b.worst * rms))
        fail_msg("%s: element %zu of %zu is %.9g, the reference has %.9g: off by %.3g rms, allowed "
                 "%.3g",
                 what, at, n, (double)got[at], want[at], worst / rms, b.worst);
    test_share = fmax(test_share, fmax(error / square / b.nmse, worst / rms / b.worst));
}

/* The same with a scale for each element, so that small ones count as much as large ones: the error
 * must be at most bound * scale. Differences below 1e-36 count as none: a device may flush
 * denormals. */
static inline void compare_scaled(const char *what, const float *got, const double *want,
                                  const double *scale, size_t n, double bound)
{
    for (size_t i = 0; i < n; i++) {
        const double e = fabs((double)got[i] - want[i]);

        if (!(e <= fmax(bound * scale[i], 1e-36)))
            fail_msg("%s: element %zu of %zu is %.9g, the reference has %.9g: off by %.3g of its "
                     "scale %.3g, allowed %.3g",
                     what, i, n, (double)got[i], want[i], e / scale[i], scale[i], bound);
        if (e > 1e-36)
            test_share = fmax(test_share, e / scale[i] / bound);
    }
}

/* Prints the share of its bounds that a test used, which reveals drift before a failure. */
static inline void test_report(const char *name)
{
    print_message("%-24s at most %5.1f %% of a bound\n", name, 100 * test_share);
    test_share = 0;
}

#endif
