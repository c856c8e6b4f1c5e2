/* Shared declarations of build/bench-kernels. A family is a kind of work at several shapes. Its
 * run function prepares one shape; for every wanted part it runs the stage that training calls,
 * compares the output with float64 (discrete results for equality), times the stage, and adds a
 * row.
 *
 *   bench_kernels.c                options, the list of families, coverage of kernels
 *   bench.c                        ceilings, timing, comparison
 *   bench_work.c                   FLOP and bytes of every part, and how they are counted
 *   bench_output.c, bench_page.c   rows as table, JSON, CSV; as page and Markdown
 *   other files                    the families */
#ifndef BENCH_H
#define BENCH_H

#include "check/selftest_checks.h"
#include "pipeline/stages.h"

typedef struct bench_time {
    double min, median, max; /* seconds of one call */
} bench_time;

/* Least work: every multiply and add that the method needs, every input read once, every output
 * written once (bench_work.c). */
typedef struct bench_work {
    double flop, bytes;
} bench_work;

typedef struct bench_errors {
    size_t compared;
    double nmse, worst; /* discrete results: the share of wrong values */
    bool exact;         /* discrete: compared for equality */
    bool failed;        /* error beyond the bounds, or not equal */
} bench_errors;

enum { BENCH_NAME = 96 };

/* A row above this share of the FMA ceiling shows that the probe, or the row's FLOP, are wrong. The
 * part above 1 is for noise: row and probe are not timed in the same instant. */
#define BENCH_MOST_SHARE 1.05

typedef struct bench_row {
    char name[BENCH_NAME], shape[64]; /* KERNEL/SHAPE without blanks; SHAPE */
    const char *family, *kernel, *kernels;
    bench_time time;
    bench_work work;
    bench_errors errors;
    double fma, copy; /* ceilings: FLOP/s, bytes/s */
    bool above;       /* above BENCH_MOST_SHARE of the FMA ceiling */
    char tune[256];
} bench_row;

/* A part: the kernel that names it, and all kernels that it launches, separated by blanks. */
typedef struct bench_part {
    const char *kernel, *kernels;
} bench_part;

struct bench;
typedef struct bench_family {
    const char *name;
    const bench_part *parts;
    int part_count, shape_count;
    void (*shape)(int shape, char out[64]);
    cln_status (*run)(struct bench *b, int shape);
} bench_family;

enum { BENCH_PARTS = 8, BENCH_PROBES = 8 }; /* most parts of a family; most shapes of the probe */

/* A shape of the FMA probe: `chains` accumulators of `vw` floats. */
typedef struct bench_probe {
    cln_program program;
    cl_kernel kernel;
    int vw, chains;
} bench_probe;

typedef struct bench {
    cln_device *device;
    double budget; /* seconds of timing per row */
    /* probes of the ceilings: by the device's usual vector width, ignoring --tune */
    cln_tune usual;
    bench_probe probes[BENCH_PROBES];
    int probe_count;
    cl_kernel peak_copy; /* of the first probe's program */
    cln_buffer in, out;
    /* current shape */
    const bench_family *family;
    char shape[64];
    bool wanted[BENCH_PARTS];
    /* one pipeline at a time, reused until the settings change */
    cln_config config;
    cln_tune tune;
    bool distortion;
    cln_pipeline pipeline;
    /* results */
    bench_row *rows;
    int row_count;
    void (*report)(const struct bench *b, const bench_row *row);
} bench;

cln_status bench_open(bench *b, const cln_device_desc *desc);
void bench_close(bench *b);

/* The pipeline for these settings; `tune` ("HALF=1", or NULL) overrides the device's parameters.
 * The small configuration is the fast preset with the smallest network. */
cln_status bench_pipeline(bench *b, const cln_config *config, bool distortion, const char *tune,
                          cln_pipeline **out);
cln_status bench_small_config(cln_config *out);

/* The small configuration with the kernels that measure (one number per sample) and distil, and its
 * pipeline. */
cln_status bench_measuring(bench *b, cln_config *config, cln_pipeline **p);

/* Adds a comparison to *errors; bounds as in the self-test. bench_equal: `wrong` of n values
 * differ. */
void bench_compare(bench_errors *errors, const float *got, const double *want, size_t n,
                   double nmse, double worst);
void bench_equal(bench_errors *errors, size_t wrong, size_t n);

/* KERNEL/SHAPE of a part, blanks replaced by -. */
void bench_name(const bench_family *family, int part, const char *shape, char out[BENCH_NAME]);

/* Measures a part and adds its row: warm-up, one probe, then five series of calls that fill the
 * budget (three single calls if one exceeds it). Both ceilings are probed around each series,
 * because the load of the machine may change; the row keeps the best. `before` (or NULL) runs
 * untimed before every call. The time is that of `stage` by events, or the wall clock's if
 * stage is CLN_STAGES. */
typedef cln_status bench_body(void *context);
cln_status bench_add(bench *b, int part, bench_body *body, bench_body *before, void *context,
                     cln_stage stage, bench_work work, const bench_errors *errors);

/* Share of the binding ceiling: the least seconds that it allows over the row's best. *bound: its
 * name. */
double bench_share(const bench_row *row, const char **bound);

/* Are the row's results right, and is its rate possible? */
bool bench_ok(const bench_row *row);

/* ---- work (bench_work.c) of n samples, leaves with samples, slices ---- */

bench_work bench_work_density(const cln_network *net, double cells, double leaves);
bench_work bench_work_forward(const cln_network *net, const cln_tune *tune, bool training, double n,
                              double leaves, double slices);
bench_work bench_work_in_order(const cln_network *net, double n, double rays, double leaves);
bench_work bench_work_backward(const cln_network *net, const cln_tune *tune, double n,
                               double leaves, double slices);
bench_work bench_work_adam(const cln_config *config, const cln_network *net, const cln_tune *tune,
                           double n, double leaves, double slices);
bench_work bench_work_roulette(double n);
bench_work bench_work_update(const cln_config *config, const cln_network *net, const cln_tune *tune,
                             double n, double leaves, double slices);
bench_work bench_work_upload(const cln_config *config, const cln_network *net, double leaves);
bench_work bench_work_carry(const cln_config *config, const cln_network *net, double leaves);
bench_work bench_work_scan(double n);
bench_work bench_work_sort(double n, bool wide);
bench_work bench_work_group(double n, double leaves, double slices);
bench_work bench_work_rays(double rays);
bench_work bench_work_intervals(double rays, double intervals, double cells);
bench_work bench_work_samples(double rays, double intervals, double cells, double n);
bench_work bench_work_project(double cells, double views, double entries);
bench_work bench_work_lists(double entries, double cells, double lists, double padded);
bench_work bench_work_composite(double rays, double n);
bench_work bench_work_composite_pixels(double rays, double n);
bench_work bench_work_composite_train(double rays, double n, double measures);
bench_work bench_work_seen(double cells, double views);
bench_work bench_work_stats(double cells, double leaves);
bench_work bench_work_leaf_measure(double n, double leaves, double measures);
bench_work bench_work_distil(double n);
bench_work bench_work_points(double points, double pairs);
bench_work bench_work_points_gradient(double points, double pairs);

/* ---- output ---- */

void bench_print_row(const bench *b, const bench_row *row);  /* a line of the table */
void bench_print_json(const bench *b, const bench_row *row); /* one JSON object, one line */
cln_status bench_write_csv(const bench *b, const char *path);
cln_status bench_write_page(const bench *b, const char *path);
cln_status bench_write_markdown(const bench *b, const char *path);

extern const bench_family bench_networks, bench_arithmetic, bench_upload, bench_scan, bench_sort,
    bench_sort64, bench_group, bench_rays, bench_splat, bench_stats, bench_composite, bench_leaf,
    bench_distil, bench_regularise, bench_carry, bench_carry_voxels, bench_voxels;

#endif
