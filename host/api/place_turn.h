/* The similarity that brings a scene to the GPS positions of its cameras, with up by these and by
 * cameras that are held level, each as well as it tells it. */
#ifndef CLN_PLACE_TURN_H
#define CLN_PLACE_TURN_H

#include <stdbool.h>
#include "render/up.h"
#include "scene/similarity.h"

typedef struct cln_place_turn {
    cln_similarity to;      /* from the scene's frame to metres east, north and up */
    int used;               /* positions that count */
    double up, north;       /* standard deviations: degrees */
    double length;          /* and relative */
    double apart;           /* degrees between up by positions and by cameras; 0: these tell none */
    double by_gps, by_them; /* the standard deviations of both, degrees */
    double drift;           /* metres of height that this is from end to end of the cameras */
    bool differ;            /* by more than both can be off */
    bool theirs;            /* then: the cameras' up is taken */
} cln_place_turn;

/* Of cameras at [count] `from` in the scene, and metres from the middle of all at `to`. told: in
 * the scene's frame. CLN_MEMORY. */
cln_status cln_place_turn_find(int count, double (*from)[3], double (*to)[3],
                               const cln_up_told *told, cln_place_turn *out);

/* Likewise of places without heights: up is that of the cameras, which must tell it, and the middle
 * of them becomes height 0. */
cln_status cln_place_turn_flat(int count, double (*from)[3], double (*to)[3],
                               const cln_up_told *told, cln_place_turn *out);

#endif
