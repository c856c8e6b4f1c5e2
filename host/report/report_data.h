/* The report's data, read from a run folder: run.json, metrics.jsonl, eval/. Any of it may be
 * missing or damaged. For the report, and the benches' tables. */
#ifndef CLN_REPORT_DATA_H
#define CLN_REPORT_DATA_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>
#include "base/status.h"

enum { CLN_REPORT_STAGES = 32, CLN_REPORT_POINTS = 600 };

/* The columns of metrics.jsonl's rows of training; NaN where a row has no number. */
typedef struct cln_report_rows {
    int count;
    double *step, *seconds, *psnr_train, *psnr_test; /* [count] */
    double *rays_per_s, *samples_per_ray, *leaves, *params;
    double *smooth; /* psnr_train, lightly smoothed */
    int stage_count;
    struct {
        char name[48];
        double seconds; /* over all rows */
    } stages[CLN_REPORT_STAGES];
} cln_report_rows;

/* A row of metrics.jsonl with the event "structure", a decision of the integer program; NaN where
 * the row has no number. */
typedef struct cln_report_decision {
    double step, seconds, leaves_before, leaves, split, merged, budget;
    double psnr_before, psnr_after, psnr_pretrained, work_seconds;
    bool over_budget; /* the budget could not be met */
} cln_report_decision;

/* A row with the event "balance": leaves that moved between processes. */
typedef struct cln_report_move {
    double step, leaves, before, after;
} cln_report_move;

/* The wall clock over the rows: each start of a run is another process, whose clock begins anew. */
typedef struct cln_report_clock {
    double from_step, wall; /* of the latest row; from_step: NaN of older runs */
    double earlier;         /* seconds of the processes before its */
} cln_report_clock;

/* Sums over the rows of several processes; a resumed run counts bytes from 0 again. */
typedef struct cln_report_ranks_sum {
    double ranks; /* of the latest row; 0 or NaN without */
    double steps, rays, seconds, bytes, message_seconds;
    double balanced, balance_weight; /* sums of balance x steps, and of steps */
    double last_step, last_seconds, last_bytes, last_message_seconds;
    double vertex_bytes, last_vertex_bytes; /* of voxels: for common vertices */
    double photos[2]; /* latest row: bytes of the least and of the most that a process has */
    int stage_count;
    struct {
        char name[48];
        double least, most; /* seconds: sums of each interval's idlest and busiest rank */
    } stages[CLN_REPORT_STAGES];
} cln_report_ranks_sum;

/* One eval/NNNNNNNN-SPLIT.json. */
typedef struct cln_report_eval {
    char *stem; /* "00012300-test" */
    json_t *document;
    const char *split;                /* in document */
    double step, seconds, psnr, ssim; /* seconds of training; means */
    int images;
    bool chosen;  /* of views that --views or --max-images chose */
    char how[96]; /* " with --fast"; "" for pictures as they are */
} cln_report_eval;

typedef struct cln_report_data {
    const char *folder; /* the run folder; the caller's */
    json_t *run;        /* an empty object if there is none */
    cln_report_rows rows;
    cln_report_clock clock;
    int decision_count;
    cln_report_decision *decisions; /* in the file's order */
    int move_count;
    cln_report_move *moves; /* likewise */
    cln_report_ranks_sum ranks;
    int eval_count;
    cln_report_eval *evals; /* by step, split, images; those with options first */
    int shown;              /* the eval whose views are shown: latest, test before val before train;
                               -1 = none */
    json_t *tree;           /* tree.json beside its pictures; NULL if there is none */
    int64_t until;          /* the model's step; INT64_MAX: not told */
    double gone;            /* the step at which it ended, if that model is gone; else NaN */
} cln_report_data;

/* until: the step of the model that RUN has, as its newest checkpoint may be damaged or deleted:
 * rows, evaluations and a result of later steps, and evaluations of another model of this step, are
 * left out, but of a run that another process trains. INT64_MAX: all are taken. */
cln_status cln_report_data_read(const char *run, int64_t until, cln_report_data *out);
void cln_report_data_free(cln_report_data *data);

/* The name, without suffixes, of the pictures of an evaluation's image: its "file" or, in older
 * evaluations that lack it, its name made fit for a file. The caller frees *file. */
cln_status cln_report_file(const json_t *image, char **file);

/* Thins out count points for a curve: of each group of neighbours the least and the greatest finite
 * one, in order, so that no peak is lost. x, y: [CLN_REPORT_POINTS]; returns how many they hold. */
int cln_report_decimate(int count, const double *from_x, const double *from_y, double *x,
                        double *y);

#endif
