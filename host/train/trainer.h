/* A training run in memory: made by cln_train (api/train.c), run by loop.c, trained by step.c, its
 * tree changed by maintain.c, written down by record.c. A struct without functions of its own. */
#ifndef CLN_TRAINER_H
#define CLN_TRAINER_H

#include <jansson.h>
#include "train/batch.h"
#include "pipeline/plan.h"
#include "pipeline/stages.h"
#include "io/run_folder.h"

enum { CLN_EVAL_POINTS = 32 };

typedef struct cln_trainer {
    const cln_train_desc *desc;
    int lock; /* on the run folder (io/run_folder.h) */
    cln_device *device;
    cln_scene *scene;
    cln_model model;
    cln_pipeline pipeline;
    cln_plan plan, host_plan;
    cln_batch batch;
    cln_ray_result *results; /* [config.rays] */
    bool drawn;              /* batch is that of the next step */
    struct {                 /* results that are still on their way */
        bool due;
        int64_t step;
        int rays;
        uint32_t samples;
    } owed;
    int64_t steps;                /* budget in steps; 0 = time alone */
    bool full;                    /* a finer tree does not fit in memory: said once, tried again */
    bool host_full;               /* more host memory than --host-mem: said once */
    double began, saved_at;       /* monotonic seconds */
    double psnr_train, psnr_test; /* newest, NaN before */
    int signal;                   /* SIGINT or SIGTERM came: stop after a checkpoint */
    bool save_wanted;             /* SIGUSR1 came */

    int *eval_views, eval_count; /* test views for evaluations during training */
    char *eval_folder;           /* of the final one */
    double point_seconds[CLN_EVAL_POINTS];
    double looked_seconds; /* training seconds up to which points have been looked at */
    int point_steps[CLN_EVAL_POINTS], point_count;

    json_t *run; /* run.json */
    cln_metrics *metrics;
    struct { /* since the last row of metrics.jsonl */
        int steps;
        int64_t rays, samples;
        double loss, square; /* sums of the steps' means */
        double began_seconds;
        double stage_seconds[CLN_STAGES]; /* the device's at the start of it */
        uint64_t waits;                   /* likewise */
    } window;
} cln_trainer;

#endif
