/* What a run found of its scene by itself, which its settings do not carry on to another scene. */
#ifndef CLN_FOUND_ANEW_H
#define CLN_FOUND_ANEW_H

#include "base/settings.h"
#include "scene/scene.h"

/* Tells, of a new training with the settings of a run, what was found otherwise for its scene:
 * masks as alpha or not, space, background and cube, and the options that keep the run's. Nothing
 * of what the settings fix, nor where all is as it was. */
cln_status cln_found_anew_tell(const cln_scene *scene, const cln_settings *settings);

#endif
