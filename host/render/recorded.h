/* What run.json records of a run, for those who go on with it or look at it: its settings (cln_run_config,
 * cl_nascent.h), its kernel parameters and its scene. */
#ifndef CLN_RECORDED_H
#define CLN_RECORDED_H

#include "device/device.h"
#include "scene/scene.h"

/* Sets device->tune to the kernel parameters that the run began with, so that its bits do not depend on
 * what a file of rows says by now. Leaves them if they were given (--tune), and on another device or driver.
 * Reads run.json: CLN_INPUT. */
cln_status cln_recorded_tune(const char *run, cln_device *device);

/* Warns if the scene is not the one that run.json names: the results would silently be others.
 * Reads run.json: CLN_INPUT. */
cln_status cln_recorded_compare(const char *run, const cln_scene *scene);

#endif
