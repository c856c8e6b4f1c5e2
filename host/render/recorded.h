/* What run.json records of a run, for those who go on with it or look at it: its settings,
 * its kernel parameters and its scene. */
#ifndef CLN_RECORDED_H
#define CLN_RECORDED_H

#include "base/config_rows.h"
#include "device/device.h"
#include "scene/scene.h"

/* The settings of the run, and the path of its scene (scene may be NULL; the caller frees *scene).
 * Reads run.json: CLN_INPUT. */
cln_status cln_run_config(const char *run, cln_config *config, char **scene);

/* Sets device->tune to the kernel parameters that the run began with, so that its bits do not
 * depend on what a file of rows says by now. Leaves them if they were given (--tune), and on
 * another device or driver. Reads run.json: CLN_INPUT. */
cln_status cln_recorded_tune(const char *run, cln_device *device);

/* Warns if the scene is not the one that run.json names: the results would silently be others.
 * Reads run.json: CLN_INPUT. */
cln_status cln_recorded_compare(const char *run, const cln_scene *scene);

#endif
