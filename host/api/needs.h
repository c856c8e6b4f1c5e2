/* What a training would need: steps, memory, time; and what its settings are told of the scene. */
#ifndef CLN_NEEDS_H
#define CLN_NEEDS_H

#include <jansson.h>
#include "base/settings.h"
#include "scene/scene.h"

/* The object "training" of docs/formats.md, for the device that `device` chooses; if there is none,
 * its key "no_device" says why. probe: seconds to spend on timing a step; 0 = no timing.
 * callbacks: told of it; NULL: none. If they interrupt it, times are missing. */
json_t *cln_needs_describe(const cln_scene *scene, const cln_settings *settings,
                           const cln_device_desc *device, double probe,
                           const cln_callbacks *callbacks);

/* What decides about settings without effect, of a training that begins on this scene, by several
 * processes: whether there is one alone, the caller tells. */
cln_settings_facts cln_needs_facts(const cln_scene *scene, const cln_config *config);

#endif
