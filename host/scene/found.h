/* Says what lies at a path that no reader takes, for the error sentence. Knows no reader. */
#ifndef CLN_SCENE_FOUND_H
#define CLN_SCENE_FOUND_H

#include <stdbool.h>
#include "base/status.h"

/* Says what is there and what the user can do, in two phrases that the caller frees: "it holds 12
 * images (the first is 'a.jpg')". is_scene tells scenes among the folders in it. CLN_INPUT if the
 * folder may not be read. */
cln_status cln_found_at(const char *path, bool (*is_scene)(const char *path), char **what,
                        char **advice);

/* Is a run there, with or without its run.json? */
bool cln_found_run(const char *path);

/* What is there in place of a run, and what the user can do: the rest of a sentence that begins
 * with the path, which the caller frees. */
cln_status cln_found_no_run(const char *path, bool (*is_scene)(const char *path), char **what);

/* What to do with a scene of OpenMVG: its exporter knows no panoramas and no lenses of Brown's. */
#define CLN_OPENMVG                                                                          \
    "openMVG_main_openMVG2Colmap writes COLMAP's files of it, which are read (of panoramas " \
    "openMVG_main_openMVGSpherical2Cubic first, of cameras by Brown's model "                \
    "openMVG_main_ExportUndistortedImages)"

#endif
