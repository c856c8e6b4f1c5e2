/* The self-test at extremes (selftest --extremes): kernels, forward and backward, against float64
 * or exact integers, where numbers are large, tiny, equal, saturated or on an edge. A subject is a
 * function on a pipeline of its own. A row of the table has the errors of one kind of number over a
 * range; docs/stability.md lists the rows. The ordinary self-test (selftest.h) has ordinary
 * shapes. */
#ifndef CLN_EXTREMES_H
#define CLN_EXTREMES_H

#include "check/selftest.h"

typedef struct cln_extremes_plan {
    bool quick;           /* sorts and scans of at most 2^17 + 1 elements */
    const char *only;     /* the subject of this name; NULL: all */
    cln_check_sink *sink; /* may be NULL */
    void *user;
} cln_extremes_plan;

/* Runs subjects with the device's parameters. CLN_CHECK names the first row that failed. */
cln_status cln_extremes_device(cln_device *device, const cln_extremes_plan *plan);

/* A row while numbers are added. Each number has a scale for its error (itself, a sum, 1) and a
 * bound; the row reports the number that uses the largest share of its bound. */
typedef struct cln_extreme {
    cln_checks *checks;
    const char *name, *range; /* what is compared; what was varied, and how far */
    size_t n, not_finite;
    bool compared;              /* at least one number had an oracle */
    double share, error, bound; /* of the worst number */
    char where[80];
} cln_extreme;

cln_extreme cln_extreme_row(cln_checks *c, const char *name, const char *range);

/* Compares a number: |got - want| / scale against the bound. Scale or bound 0: they must be equal.
 * Numbers that are not finite fail the row. Differences below 1e-36 count as none: a device may
 * flush denormals. fmt: where the number is. */
void cln_extreme_meet(cln_extreme *e, double got, double want, double scale, double bound,
                      const char *fmt, ...) __attribute__((format(printf, 6, 7)));

/* A camera without an image, `distance` half sides before the cube's centre, and `aside` times that
 * to its side. Its angles depend on v: with 0 it looks along an axis, so its rotation has zeros. */
void cln_extremes_camera(int v, const cln_space *space, double distance, double aside,
                         cln_camera *c);

/* Camera i of these, 10 to 10^6 half sides away: it sees the cube in 500 x 500 pixels, on its axis
 * or off it, through one of three lenses. */
enum { CLN_EXTREMES_FAR = 12 };
void cln_extremes_far(int i, const cln_space *space, cln_camera *k);

/* Rays of pixels of cameras; o, d: `bytes` of their origins and of their directions. */
typedef struct cln_extremes_shot {
    int views, rays;
    const cln_camera *cameras; /* [views] */
    const cln_pixel *pixels;   /* [rays] */
    size_t bytes;
    void *o, *d;
} cln_extremes_shot;

/* Makes the rays and reads them back to o and d; on the device they were NaNs before. CLN_MEMORY,
 * CLN_CL. */
cln_status cln_extremes_shoot(cln_pipeline *p, const cln_space *space, const cln_extremes_shot *s);

/* Counts a number without an oracle: it must be finite. */
void cln_extreme_finite(cln_extreme *e, double got, const char *fmt, ...)
    __attribute__((format(printf, 3, 4)));

/* Reports the row; one without any number fails. */
void cln_extreme_report(cln_extreme *e);

/* ---- subjects, with what their pipelines must have (extremes.c makes them) ---- */

cln_status cln_extremes_composite(cln_checks *c);     /* the L2 loss, at most a Cauchy prior */
cln_status cln_extremes_regularised(cln_checks *c);   /* any loss */
cln_status cln_extremes_stretches(cln_checks *c);     /* any loss; shares the pipeline, scan */
cln_status cln_extremes_cameras(cln_checks *c);       /* all lenses */
cln_status cln_extremes_intervals(cln_checks *c);     /* any space */
cln_status cln_extremes_cropped(cln_checks *c);       /* the cube's space, sampling_crop */
cln_status cln_extremes_forward(cln_checks *c);       /* a forward space */
cln_status cln_extremes_networks(cln_checks *c);      /* dead slopes (0), see extremes.c */
cln_status cln_extremes_large_weights(cln_checks *c); /* any network */
cln_status cln_extremes_adam(cln_checks *c);
cln_status cln_extremes_roulette(cln_checks *c);
cln_status cln_extremes_carry(cln_checks *c);            /* networks */
cln_status cln_extremes_share(cln_checks *c);            /* shares the pipeline; scan, group */
cln_status cln_extremes_voxels(cln_checks *c);           /* voxels, decoder or none */
cln_status cln_extremes_leaves(cln_checks *c);           /* measures of leaves */
cln_status cln_extremes_shell(cln_checks *c);            /* a shell space */
cln_status cln_extremes_distil(cln_checks *c);           /* measures of leaves */
cln_status cln_extremes_regularisers(cln_checks *c);     /* sparsity and edge */
cln_status cln_extremes_splat(cln_checks *c);            /* splatting, all lenses, n1 4 */
cln_status cln_extremes_sort(cln_checks *c, bool quick); /* splatting */

#endif
