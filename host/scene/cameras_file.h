/* RUN/cameras.json: the views of the scene that a run was trained on, without their photos, for
 * what needs cameras alone where the scene is not (docs/formats.md). */
#ifndef CLN_CAMERAS_FILE_H
#define CLN_CAMERAS_FILE_H

#include "scene/scene.h"

#define CLN_CAMERAS_FILE "cameras.json"

/* Writes it. given: [training view] 3x4 poses in place of the scene's, which training may have
 * moved; NULL: the scene's. CLN_INPUT if the scene's folder is gone, CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_cameras_write(const char *run, const cln_scene *scene, const double (*given)[12]);

/* Reads it as a scene without photos: its views in their order, the numbers of their cameras to the
 * bit, with what names their files; folder, split_rule, box, lenses and digest. The caller knows
 * the space and the background. CLN_INPUT: it is damaged or of another program; CLN_MEMORY. *out is
 * NULL on failure. */
cln_status cln_cameras_read(const char *run, cln_scene **out);

#endif
