/* Inspects a scene before hours are spent on it, for the command `check`: finds everything that
 * looks like a mistake, each with its likely cause and a way out, and the measures behind it. Needs
 * the pixels of all splits. */
#ifndef CLN_INSPECT_H
#define CLN_INSPECT_H

#include <jansson.h>
#include "scene/scene.h"

/* Appends a finding to an array: {"what": word, "likely_fault": bool, "views": [names], "text"}.
 * Takes `views` over; NULL: no view in particular. */
void cln_found_fault(json_t *findings, const char *what, bool likely_fault, json_t *views,
                     const char *fmt, ...) __attribute__((format(printf, 5, 6)));

/* *out = {"findings": [as above, likely faults first], "measures": {...}, "views": [{name, split,
 * place, axis, ...}], "points": [[x, y, z]]}, docs/formats.md. The caller owns it. callbacks: told
 * of what is compared; NULL: none. */
cln_status cln_scene_inspect(const cln_scene *scene, const cln_callbacks *callbacks, json_t **out);

#endif
