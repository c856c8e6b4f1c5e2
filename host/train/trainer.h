/* A training run in memory: made by session.c (cln_train), stepped by train.c, written down by
 * record.c. */
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

/* Fraction 0..1 of the budget used so far. */
double cln_trainer_fraction(const cln_trainer *t);

/* Which training pixels have a leaf before them, after a change of the tree: the next batch is drawn from those. The
 * newest step has been accounted for. */
void cln_trainer_cover(cln_trainer *t);

/* Waits for the newest step's results and adds them to the model's and the interval's sums; nothing if they
 * are there. CLN_DIVERGED. Whoever reads or restarts those sums calls this first. */
cln_status cln_trainer_catch_up(cln_trainer *t);

/* Runs until a budget is used up, the target is reached or a signal comes; checkpoints and final
 * evaluation included. */
cln_status cln_trainer_run(cln_trainer *t);

#endif
