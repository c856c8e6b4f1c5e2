/* Where on the earth a scene's frame has its origin: coordinates are metres east, north and up from
 * there, on a plane that touches the ellipsoid of WGS 84. A file beside the model tells it
 * (docs/formats.md), as models of COLMAP do not. Places are latitude and longitude, degrees north
 * and east, and height, metres. */
#ifndef CLN_ORIGIN_H
#define CLN_ORIGIN_H

#include <jansson.h>
#include <stdbool.h>
#include "base/status.h"

/* The frame's axes, east, north and up, earth-centred. */
void cln_origin_axes(const double origin[3], double axes[3][3]);

/* A place in the frame: metres east, north and up from the origin. */
void cln_origin_local(const double origin[3], const double place[3], double out[3]);

/* The place of earth-centred coordinates (Bowring, "Transformation from spatial to geographical
 * coordinates", Survey Review 1976: to a millimetre near the ground). */
void cln_origin_of_centred(const double at[3], double place[3]);

/* Rounds to what the file has of it: 1e-8 degrees, a millimetre. */
void cln_origin_round(double origin[3]);

/* What the file says beside the origin; NAN: it does not. */
typedef struct cln_origin_doubt {
    double distance; /* of the middle one of the cameras from its GPS position, metres */
    double up; /* standard deviation, degrees, where level cameras counted beside GPS already */
} cln_origin_doubt;

/* Writes the folder's file. CLN_OUTPUT, CLN_MEMORY. */
cln_status cln_origin_write(const char *folder, const double origin[3], cln_origin_doubt doubt);

/* Reads it; false if there is none, or it is another program's. */
bool cln_origin_read(const char *folder, double origin[3], cln_origin_doubt *doubt);
bool cln_origin_is_there(const char *folder);
bool cln_origin_is_named(const char *name); /* a file, in its folder */

/* Takes the place out of what a run or scene says of its dataset. CLN_MEMORY. */
cln_status cln_origin_hide(json_t *dataset);

#endif
