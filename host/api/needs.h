/* What a training would need, before it is begun: steps, memory, time. */
#ifndef CLN_NEEDS_H
#define CLN_NEEDS_H

#include <jansson.h>
#include "base/settings.h"
#include "scene/scene.h"

/* The object "training" of docs/formats.md, with the device that `device` chooses; its key
 * "no_device" says why if there is none. probe: seconds to measure a step in; 0 = not. */
json_t *cln_needs_describe(const cln_scene *scene, const cln_settings *settings,
                           const cln_device_desc *device, double probe);

#endif
