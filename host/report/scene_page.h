/* The page of `check`: what was found, cameras, points and cube from three sides, the photos; one
 * HTML file that refers to nothing elsewhere. */
#ifndef CLN_SCENE_PAGE_H
#define CLN_SCENE_PAGE_H

#include <jansson.h>
#include "scene/scene.h"

/* document: as of cln_check (docs/formats.md). The scene's pixels must be loaded. Atomic;
 * CLN_OUTPUT if it cannot be written. */
cln_status cln_scene_page(const char *path, const cln_scene *scene, const json_t *document);

#endif
