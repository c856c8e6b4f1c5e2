/* What a training would need: steps, memory, time. */
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

#endif
