/* Inspects a scene before hours are spent on it, for the command `check`: finds everything that
 * looks like a mistake, each with its likely cause and a way out, and the measures behind it. Needs
 * the pixels of all splits. */
#ifndef CLN_INSPECT_H
#define CLN_INSPECT_H

#include <jansson.h>
#include "scene/findings.h"
#include "scene/scene.h"

/* *out = {"findings": [as above, likely faults first], "measures": {...}, "views": [{name, split,
 * place, axis, ...}], "points": [[x, y, z]]}, docs/formats.md. The caller owns it. callbacks: told
 * of what is compared; NULL: none. */
cln_status cln_scene_inspect(const cln_scene *scene, const cln_callbacks *callbacks, json_t **out);

/* Where a new training's cube is, if neither settings nor the dataset say so: around what alpha
 * shows (cln_scene_narrow_cube), or, of cameras that look in parallel, whose guess says nothing of
 * how far things are, around what their photos show alike, with a shell where --space lets it.
 * Changes the scene, and says so. box: as --bbox, "": nothing changed. For one process; training
 * photos are loaded. CLN_MEMORY; CLN_SIGINT, CLN_SIGTERM. */
typedef struct cln_placed {
    char box[CLN_SETTING_BYTES];
    int space; /* config.space from now on */
} cln_placed;
cln_status cln_scene_place_cube(cln_scene *scene, const cln_config *config,
                                const cln_callbacks *callbacks, cln_placed *out);

/* What becomes of a backdrop that stands still while the object turns; of cln_scene.still. */
#define CLN_STILL_EFFECT                                                                         \
    "It would be learnt as fog around the object: mask all but the object (--masks), or cut it " \
    "out as alpha"
/* Of the number of views, and of their poses by cln_scene_few_stands. */
#define CLN_STANDS_ADVICE                                                                          \
    "%d photos were taken from %d places alone, looking the same way from each: if a thing was "   \
    "turned before a camera that stood still, these are the poses of what stood still behind it, " \
    "and the thing becomes a smear: cut it out (alpha, or masks by poses --mask-path) and find "   \
    "poses anew; of copies and exposures of one picture leave one"

#define CLN_STILL_ADVICE                                                                           \
    "the photos' borders are the same in all of them, although the cameras turn: a backdrop that " \
    "stands still while the object turns before a camera. " CLN_STILL_EFFECT

#endif
