/* What run.json records of a run, for commands that continue it or show it: its settings, its
 * kernel parameters and its scene. */
#ifndef CLN_RECORDED_H
#define CLN_RECORDED_H

#include <jansson.h>
#include "base/config_rows.h"
#include "device/device.h"
#include "scene/scene.h"

/* The settings of the run. Reads run.json: CLN_INPUT. */
cln_status cln_run_config(const char *run, cln_config *config);

/* Sets device->tune to the kernel parameters that the run began with, so that its bits do not
 * depend on later changes of a file of rows. Leaves them if they were given (--tune), and on
 * another device or driver. Reads run.json: CLN_INPUT. */
cln_status cln_recorded_tune(const char *run, cln_device *device);

/* Takes over the largest buffer of the run's device, if this is the same and allows more: batches
 * are cut by it, so a training would go on with others. */
cln_status cln_recorded_alloc(const char *run, cln_device *device);

/* Where the run's scene is now, as cln_recorded_load finds it: CLN_INPUT if it is nowhere. The
 * caller frees *path. */
cln_status cln_recorded_scene(const char *run, char **path);

/* Loads the run's scene. desc->path NULL: from the path in run.json; if nothing is there, from the
 * same place relative to the run, then by its name beside the run. A scene found in these two
 * places is reported, and must be the same one (by digest), else CLN_INPUT. At desc->path or the
 * path in run.json, another scene is a warning, as it gives other results. *same: whether it is the
 * same. */
cln_status cln_recorded_load(const char *run, const cln_scene_desc *desc, cln_scene **scene,
                             bool *same);

/* The same for a training that resumes the run, whose command takes SCENE in another place.
 * CLN_INPUT for one whose poses are elsewhere (cln_scene_moved_since), and for another one at
 * desc->path without any photo that is the same: the run would belong to it. */
cln_status cln_recorded_resume(const char *run, const cln_scene_desc *desc, cln_scene **scene,
                               bool *same);

/* The scene's views as the run keeps them, without photos (scene/cameras_file.h). CLN_INPUT if they
 * are damaged, or not those of the scene in run.json. */
cln_status cln_recorded_cameras(const char *run, cln_scene **scene);

/* Checks the photos of a resumed run: CLN_INPUT if other frames are left out for missing images
 * than when it began; a warning if their size or background differs from before. */
cln_status cln_recorded_photos(const char *run, const cln_scene *scene);

/* Sets the members of run.json's dataset that say where its scene is, for cln_recorded_load. */
cln_status cln_recorded_place(const char *run, const char *scene, json_t *dataset);

#endif
