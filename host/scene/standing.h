/* What stands still in all photos although their cameras move, with edges that stand still, too: a
 * logo, a date, a game's HUD, bars, the round field of an endoscope, the vehicle that carries the
 * camera. Before cameras that do not turn, what is far away stands still, too: there only what is
 * black or sharply drawn counts, and only if they pass what they see (cln_scene.amid). It is learnt
 * as fog before each camera, unless a mask leaves it out. Ours: two photos far apart in the set
 * differ nearly everywhere else; before a backdrop of one colour, where they do not, the object's
 * outline moves, and such an edge is none. */
#ifndef CLN_STANDING_H
#define CLN_STANDING_H

#include "scene/scene.h"

typedef struct cln_standing {
    int width, height; /* of `is` */
    uint8_t *is;       /* [height][width] 1: it stands there; NULL: nothing does */
    double share;      /* of the picture */
    bool plain;        /* of one colour, as bars, but as the sky or a backdrop, too */
    bool one_way;      /* cameras do not turn: what may be far away was left out */
    char where[96];    /* "top left, bottom" */
} cln_standing;

/* Looks at a grid of `longer` cells along the longer side of the photos that have the first
 * training photo's size (8 at least, loaded, without alpha), or at their pixels, if these are
 * fewer. CLN_MEMORY. Free out->is. */
cln_status cln_scene_find_standing(const cln_scene *scene, int longer, cln_standing *out);

/* Is there any, of photos without a backdrop that stands still (cln_scene.still)? Then its text for
 * people: share, place, and what to do. *plain: as above; then it may be right as it is. */
enum { CLN_STANDING_BYTES = 2048 };
bool cln_scene_tell_standing(const cln_scene *scene, char text[CLN_STANDING_BYTES], bool *plain);

/* Writes a mask of the photos' size, as they are loaded: black where something stands, a little
 * wider, else white. CLN_INPUT if nothing stands still, CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_scene_write_standing(const cln_scene *scene, const char *path);

#endif
