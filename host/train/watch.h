/* Lets a browser watch and steer a training (cln_live_desc): the viewer's server over the trainer's
 * pipeline. Viewing takes up to a share of the clock's time, which does not count as training; it
 * changes nothing else: a training gives the same bits with and without it. Without t->watch all
 * functions do nothing. */
#ifndef CLN_WATCH_H
#define CLN_WATCH_H

#include "train/trainer.h"

/* Makes t->watch and listens, if t->desc->live asks for it. Call it before anything is written.
 * CLN_USAGE (address, port, share, several ranks), CLN_FAILED without libmicrohttpd. */
cln_status cln_watch_open(cln_trainer *t);

/* Answers requests from here on, and calls `ready`. The pipeline has tree, weights and densities.
 * CLN_FAILED, CLN_CL, CLN_MEMORY. */
cln_status cln_watch_start(cln_trainer *t);
void cln_watch_close(cln_trainer *t);

/* Publishes the training's progress to viewers, as JSON: state, step, steps, fraction, seconds,
 * wall_seconds, eta, unmeasured, rays_per_s, samples_per_ray, loss, psnr_train, psnr_test, leaves,
 * params, device_bytes (cln_train_progress has their meaning), saved_step, viewing (the share of
 * the time that it took), stages: device seconds by name since the start, curve: [[seconds,
 * psnr_train, psnr_test, leaves]]. Unknown values are null. state: a word that lives forever. */
void cln_watch_say(cln_trainer *t, const char *state);

/* Orders since the last call, as the signal of the same meaning: SIGINT to stop, SIGUSR1 for a
 * checkpoint, else 0. Pauses are kept in t->watch. */
int cln_watch_orders(cln_trainer *t);
bool cln_watch_paused(const cln_trainer *t);
bool cln_watch_stopped(const cln_trainer *t);

/* Whether something may be painted now, or the training is paused; publishes the progress from time
 * to time. Call it between steps. */
bool cln_watch_due(cln_trainer *t);

/* Paints what the share allows, a fraction of a second at most; waits a little for requests while
 * the training pauses. No results may be owed. CLN_CL, CLN_BUILD, CLN_MEMORY. */
cln_status cln_watch_paint(cln_trainer *t);

#endif
