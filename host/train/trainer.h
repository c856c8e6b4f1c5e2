/* The state of a training run. cln_train (api/train.c) makes it, loop.c runs it, step.c trains it,
 * maintain.c has its tree changed, record.c writes its record, watch.c shows it to a browser. */
#ifndef CLN_TRAINER_H
#define CLN_TRAINER_H

#include <jansson.h>
#include "base/config.h"
#include "base/log.h"
#include "train/batch.h"
#include "train/exposure.h"
#include "pipeline/plan.h"
#include "io/run_folder.h"

typedef struct cln_refine {
    double (*given)[12]; /* [training view] the scene's poses; NULL without --refine-poses */
} cln_refine;

typedef struct cln_trainer {
    const cln_train_desc *desc;
    int lock;    /* on the run folder (io/run_folder.h) */
    bool writes; /* the run folder: rank 0 (ranks/ranks.h) */
    cln_device *device;
    cln_scene *scene;
    cln_model model;
    bool other_scene;   /* of a resumed run: than its last start had */
    cln_config trained; /* of a resumed run: the settings of its checkpoint */
    cln_pipeline pipeline;
    cln_plan plan, host_plan;
    struct {
        cln_plan device, host; /* each the largest so far */
        bool full;             /* it was said that one does not fit */
    } dealt;                   /* by ranks (plans.h) */
    cln_batch batch;
    cln_ray_result *results; /* [config.rays] */
    bool drawn;              /* the next step's batch is drawn */
    bool box_found;          /* config.bbox is by what photos show, nobody's choice */
    bool space_found;        /* and so is config.space */
    bool undone;             /* the step on its way will be undone */
    cln_exposure exposure;
    cln_refine refine;
    struct { /* results that the host has not read yet */
        bool due;
        int64_t step;
        int rays;
        uint32_t samples;
    } owed;
    int64_t steps; /* budget in steps; 0 = only in time */
    /* What decides about the next whole level (grow.c) and is in no checkpoint: found anew before
     * each step that asks for it, so that a resumed run decides alike. */
    struct {
        bool no_room; /* no memory for it */
        bool finest;  /* the voxels that there are are as fine as the photos */
    } next_level;
    struct {                     /* once by this process; decides nothing */
        bool used_up;            /* the budget of a resumed run */
        bool no_room_for_leaves; /* no memory for a single leaf */
        bool whole;              /* no whole level of voxels comes any more */
        bool none_came;          /* no decision until --structure-until */
        bool too_many;           /* --max-leaves is below what the tree has */
        bool host_full;          /* host memory exceeds --host-mem */
        bool long_evaluation;    /* or need not be */
    } said;
    bool hit_target;               /* --target-psnr */
    double began, checkpoint_at;   /* monotonic seconds */
    int64_t from_step;             /* step that this process began after */
    double clock, from_clock;      /* training seconds by this rank's clock; at from_step */
    double cpu_began;              /* this process's, when `clock` last went on */
    double device_began;           /* the device's, likewise */
    double cpu_seconds;            /* of processors for these; NaN if an earlier start tells none */
    double device_peak, host_peak; /* bytes, of the starts before this one; 0 of a new run */
    double psnr_train, psnr_test;  /* newest, NaN before */
    int psnr_train_steps;          /* steps that psnr_train is of; 0 before */
    int64_t eval_step;             /* that psnr_test is of */
    double psnr_fitted;            /* of the same evaluation; NaN if not known */
    double fitted_gain;            /* likewise (cln_eval_result) */
    double psnr_exposed;           /* of the same views as psnr_test (cln_eval_image) */
    double start_seconds;          /* from `began` to the first step; NaN before it */
    double eval_seconds;           /* time of the newest evaluation; NaN before the first */
    cln_train_progress shown;      /* rates and means of the newest results */
    int signal;                    /* SIGINT or SIGTERM came: stop after a checkpoint */
    bool save_wanted;              /* SIGUSR1 came */
    int64_t saved_step;            /* of the newest checkpoint of this process; -1 before */
    uint64_t parts_digest;   /* of its weights, if ranks wrote it: none has them all; else 0 */
    struct cln_watch *watch; /* NULL = nobody can watch */

    int *eval_views, eval_count; /* test views for evaluations during training */
    char *eval_folder;           /* of the final one */
    cln_points eval_at, save_at;
    double looked_seconds; /* training seconds when due points were last looked for */

    json_t *run;       /* run.json */
    cln_warned warned; /* since this start */
    cln_metrics *metrics;
    struct { /* since the last row of metrics.jsonl of this process; what lasts: model.row */
        int steps;
        double stage_seconds[CLN_STAGES];                 /* the device's counter at its start */
        uint64_t waits;                                   /* likewise */
        double samples_own, samples_busiest, samples_all; /* the pipeline's, likewise */
        double stretches_own, stretches_all, intervals_all;
        double ranked_seconds[CLN_STAGES + 1]; /* stages, and messages to other ranks, likewise */
    } window;
} cln_trainer;

#endif
