/* What run.json records of a run, for those who go on with it or look at it: its settings,
 * its kernel parameters and its scene. */
#ifndef CLN_RECORDED_H
#define CLN_RECORDED_H

#include <jansson.h>
#include "base/config_rows.h"
#include "device/device.h"
#include "scene/scene.h"

/* The settings of the run. Reads run.json: CLN_INPUT. */
cln_status cln_run_config(const char *run, cln_config *config);

/* Sets device->tune to the kernel parameters that the run began with, so that its bits do not
 * depend on what a file of rows says by now. Leaves them if they were given (--tune), and on
 * another device or driver. Reads run.json: CLN_INPUT. */
cln_status cln_recorded_tune(const char *run, cln_device *device);

/* Loads the run's scene. desc->path NULL: from where run.json says; if nothing is there, from the
 * same place seen from the run, then from beside the run by its name, which is said, and only if it
 * is the same scene (by digest): else CLN_INPUT. At the place told, another scene is a warning: the
 * results would silently be others. *same tells. */
cln_status cln_recorded_load(const char *run, const cln_scene_desc *desc, cln_scene **scene,
                             bool *same);

/* What a resumed run sees of its photos: CLN_INPUT if other frames are left out for missing images
 * than when it began; a warning if they have another size or background than so far. */
cln_status cln_recorded_photos(const char *run, const cln_scene *scene);

/* The members of run.json's dataset that say where a scene is, for cln_recorded_load. */
cln_status cln_recorded_place(const char *run, const cln_scene *scene, json_t *dataset);

#endif
