/* The memory plans of a run: device and host memory by purpose, before anything is allocated.
 * train logs them first and writes them to run.json. A run that does not fit ends with CLN_MEMORY
 * and the plan in its sentence; growth of the tree that would not fit is left out with a warning.
 * Batches are cut so that buffers that grow with rays or samples stay below the device's largest
 * allocation; arrays of a row per leaf are split into up to CLN_PARTS parts (pipeline.h).
 *
 * The device's plan is a bound: it counts every buffer of buffer_list.h at its largest. The host's
 * is an estimate: it counts the program's own arrays and an allowance for driver and compiler. */
#ifndef CLN_PLAN_H
#define CLN_PLAN_H

#include <jansson.h>
#include "pipeline/pipeline.h"

enum { CLN_PLAN_ROWS = 12 };

/* Purposes of two rows of the host's plan. */
#define CLN_PLAN_IMAGES   "images"
#define CLN_PLAN_PICTURES "batches and pictures"
#define CLN_PLAN_SHARED   "the device's, the same memory"

/* Constants of the plans besides the settings. */
enum {
    CLN_RENDER_RAYS = 16384, /* most rays of a picture's batch */
    /* A batch has room for so many times --batch-samples: in training, as numbers of samples vary;
     * in pictures if memory allows, else for 2 or 1. */
    CLN_TRAINING_BATCHES = 2,
    CLN_RENDER_BATCHES = 4,
    CLN_DISTIL_BATCHES = 16, /* batches of distil-samples points that a merge cycles through */
    CLN_LOOK_RAYS = 1 << 18, /* rays that --regrow looks at, of all photos */
    /* Smaller --batch-samples and --rays are not looked for where memory is short. */
    CLN_LEAST_BATCH = 4096,
    CLN_LEAST_RAYS = 16
};

/* Code, driver and kernel compiler, as measured with PoCL 3.1, which has all three in this
 * process. */
#define CLN_PROGRAM_BYTES (300.0 * (1 << 20))

typedef struct cln_plan {
    struct {
        const char *purpose;
        double bytes;
        double largest;      /* bytes of its largest single buffer */
        int parts;           /* parts of each of its arrays P (pipeline.h); 1 = not split */
        const char *way_out; /* what to lower; NULL = nothing can be */
    } rows[CLN_PLAN_ROWS];
    int count;
    bool rendering; /* no option lowers its rows */
    double total, limit;
    bool hard;    /* the limit is one of the process or its control group, which no option raises */
    double least; /* bytes with the smallest batch, where even that is above the limit; else 0 */
    double least_fixed;   /* bytes of that which no option lowers */
    double cells;         /* cells of stage 1 over all leaves; kernels index them with 32 bits */
    int max_rays;         /* most rays of a batch, so that its intervals fit one buffer */
    size_t max_samples;   /* most samples of a batch, likewise */
    size_t batch_samples; /* samples aimed at: --batch-samples, or fewer if max_samples is small */
    int fitting_samples;  /* a smaller --batch-samples that would be within the limit; 0 = none */
    int fitting_rays;     /* --rays that it needs as well; 0 = those that there are */
    size_t max_entries;   /* projected samples held at a time (splat) */
    int distil_nets;      /* merged leaves trained together */
} cln_plan;

/* What a rank has at most: leaves; other ranks' leaves with vertices that are its own; both
 * together; links (halo.h). They may be different ranks'. */
typedef struct cln_deal {
    int own, far, sliced;
    int64_t links;
} cln_deal;

typedef struct cln_plan_desc {
    const cln_pipeline *pipeline; /* device, settings, network; no buffers needed */
    const cln_scene *scene;
    int leaves;
    bool training;         /* else only rendering */
    double coverage_bytes; /* training: host memory of train/coverage.h, photo_edges.h */
    int depth;             /* of the tree; 0: as deep as it may become */
    const cln_deal *deal;  /* by ranks; NULL: as leaves may move (cln_share_most) */
    /* Pixels of the largest view that is rendered (n^2 times as many with n x n rays a pixel), and
     * of the largest picture that the host keeps; 0: of the scene's largest view. */
    double view_pixels, picture_pixels;
    double photos; /* bytes of the photos' pixels in memory; 0: of those that are loaded */
} cln_plan_desc;

/* The deal of a tree by p->rank_first. */
cln_status cln_plan_deal(const cln_pipeline *p, const cln_octree *tree, cln_deal *out);

/* Likewise where it is not known how they lie in the tree: a rank has at most `own`. */
cln_deal cln_plan_any_deal(const cln_plan_desc *desc, int own);

/* The most leaves that a rank may get, however they lie in the tree, so that the device's plan and
 * the host's are within their limits: up to cln_share_most(), 0 if not even the deal's fit. */
int cln_plan_most_own(const cln_plan_desc *desc);

/* limit: --device-mem, else 90 % of the device's memory. */
void cln_plan_device(const cln_plan_desc *desc, cln_plan *out);

/* limit: --host-mem, else the machine's memory. A CPU's device memory is the host's. */
void cln_plan_host(const cln_plan_desc *desc, const cln_plan *device_plan, cln_plan *out);

/* Whether both are within their limits: no check below would fail. */
bool cln_plan_fits(const cln_device *device, const cln_plan *plan, const cln_plan *host);

/* CLN_MEMORY if a plan exceeds its limit, or a buffer (or part) the device's largest allocation. */
cln_status cln_plan_check(const cln_device *device, const cln_plan *plan);
cln_status cln_plan_check_host(const cln_plan *plan);

/* Sets the pipeline's limits: device memory, rays, samples, entries. */
void cln_plan_apply(const cln_plan *plan, cln_pipeline *pipeline);

/* "weights 12 MiB in 3 parts, activations 80 MiB, ... = 230 MiB of 3.2 GiB". */
void cln_plan_text(const cln_plan *plan, char *out, size_t bytes);
cln_status cln_plan_json(const cln_plan *plan, json_t **out);

#endif
