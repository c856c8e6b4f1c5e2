/* Writes the record of a training run: run.json, rows of metrics.jsonl, evaluations, the report,
 * and what was left out. Not checkpoints. Functions fail with CLN_OUTPUT or CLN_MEMORY. */
#ifndef CLN_RECORD_H
#define CLN_RECORD_H

#include "pipeline/share.h"
#include "train/trainer.h"

/* A structure decision: one row of metrics.jsonl ("event": "structure") and one line of the log.
 * PSNR is over a fixed batch of training rays, without jitter; NaN where nothing changed. */
typedef struct cln_decision {
    int leaves_before, leaves, splits, merges, keeps, budget;
    bool infeasible;
    double objective, objective_before;
    double psnr_before, psnr_after, psnr_pretrained;
    int distil_steps;
    double work_seconds;
} cln_decision;

/* Of the model's weights; by ranks, of the newest checkpoint's, as no rank has them all. */
uint64_t cln_record_digest(const cln_trainer *t);

/* Most bytes of device buffers, and of the process, over all starts of the run; by ranks, this
 * one's. */
double cln_record_device_peak(const cln_trainer *t);
double cln_record_host_peak(const cln_trainer *t);

/* Write run.json: at the start with state "running", and then the scene's cameras
 * (scene/cameras_file.h); at the end with state and result. */
cln_status cln_record_start(cln_trainer *t);
cln_status cln_record_end(cln_trainer *t, const char *state);

/* Notes in run.json, once, that memory holds the tree back: with more of it the same settings give
 * another model. */
cln_status cln_record_held(cln_trainer *t);

/* Makes the folder `run`, which has a checkpoint of now, a run that was interrupted here: run.json,
 * the cameras, and the rows so far. */
cln_status cln_record_keep(const cln_trainer *t, const char *run);

/* Adds a row for the interval that ends now, or that a stop leaves unfinished. */
cln_status cln_record_row(cln_trainer *t, double lr, bool evaluated, bool unfinished);

/* Adds the row of a structure decision. */
cln_status cln_record_decision(cln_trainer *t, const cln_decision *decision);

/* Adds the row of leaves that moved between ranks. */
cln_status cln_record_move(cln_trainer *t, const cln_share_move *move);

/* Path of an evaluation: IN/STEP-SPLIT, or IN/STEP-SPLIT-COUNT if it has `count` of more views, so
 * that it never replaces an evaluation of all. The folder of its pictures has that name, its
 * document that name and ".json". */
cln_status cln_record_place(const char *in, int64_t step, const char *split, int count, int total,
                            char **place);
cln_status cln_record_eval(const char *place, const cln_eval_result *result);

/* Lists what this run leaves out, as an array of phrases: "lens distortion (pinhole cameras)". */
cln_status cln_record_left_out(const cln_trainer *t, json_t **out);

#endif
